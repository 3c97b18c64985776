"""The contract of commands that are not yet written with `command`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from radar_sense import command
from radar_sense.analyses.columns import Column, find
from radar_sense.command import Command as Command
from radar_sense.command import Option as Option
from radar_sense.errors import FigureError as FigureError
from radar_sense.progress import steps
from radar_sense.propagation import METHODS
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

Analysis = Command


class Progress(Protocol):
    """Starts to report steps: called with their number and name."""

    def __call__(self, total: int, what: str) -> AbstractContextManager[Callable[[int], None]]:
        """Return a context, with a function that is called with the number of new steps."""
        ...


silent: Progress = steps

OPTIONS: Mapping[str, Option] = {
    option.name: option
    for option in (
        command.LEVEL,
        command.ONE_RADAR,
        replace(
            command.METHOD,
            help=f"Method of propagation: {', '.join(METHODS)}.",
            default_text="the scenario's",
            choices=METHODS,
        ),
        command.NUMBER_OF_RUNS,
        command.SEED_OF_DRAWS,
        command.SAMPLER,
        command.WORKER_THREADS,
        command.DASK,
        command.DOWN_KM,
        command.COURSE_DEG,
    )
}


@dataclass(frozen=True, eq=False)
class Result:
    """Result of an analysis, from which a `command.Result` is made."""

    scenario: Scenario
    table: Mapping[str, FloatArray]
    summary: Mapping[str, Any] = field(default_factory=dict)
    report: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    method: str = "linear"
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)
    passed: bool = True

    @property
    def band_label(self) -> str:
        """Label of the 3σ band in the figure."""
        linear = self.method == "linear"
        band = r"$\pm 3\,\sigma$" if linear else rf"$\pm 3\,\sigma$ by {self.method}"
        return f"{band} ({self.scenario.level})"


def analysis(
    *,
    plot: Callable[[Result, Figure], None],
    options: Sequence[str | Option] = (),
    examples: Sequence[str] = (),
    columns: Sequence[Column] = (),
    name: str = "",
) -> Callable[[Callable[..., Result]], Command]:
    """Make a command of a function from a scenario to a result."""

    def decorate(run: Callable[..., Result]) -> Command:
        @functools.wraps(run)
        def made(*args: Any, **options: Any) -> command.Result:
            old = run(*args, **options)
            result = command.Result(
                old.scenario,
                old.method,
                summary=dict(old.summary),
                report=list(old.report),
                warnings=list(old.warnings),
                draw=functools.partial(plot, old),
                passed=old.passed,
            )
            for column, values in old.table.items():
                declared = find(columns, column) or Column(column, "", "")
                result.table.add(column, values, declared.meaning, declared.unit)
            return result

        chosen = tuple(OPTIONS[o] if isinstance(o, str) else o for o in options)
        return Command(made, chosen, tuple(examples), name)

    return decorate
