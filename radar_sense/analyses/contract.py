"""The contract of an analysis: its options, its result, and what makes a function a command.

    @analysis(plot=plot, options=["level", "radar"], examples=["radar-sense rcs"])
    def rcs(scenario, *, step_deg=1.0): ...

`rcs` is then an `Analysis`. From Python it is called with a scenario; the command line makes a
command of it.
"""

from __future__ import annotations

import dataclasses
import html
import inspect
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from radar_sense import files
from radar_sense.analyses.plausibility import plausibility_warnings
from radar_sense.errors import did_you_mean
from radar_sense.limits import FORMATS, MAX_WORKERS, RUNS, SEED, Limit
from radar_sense.propagation import METHODS
from radar_sense.scenario import Scenario, for_radar
from radar_sense.states import FloatArray

if TYPE_CHECKING:
    from radar_sense.plotting import Figure


class Progress(Protocol):
    """Shows how far a computation is."""

    def __call__(
        self, total: int, what: str
    ) -> AbstractContextManager[Callable[[int], None] | None]:
        """Start to show progress; the value of the context is called with the steps just done."""
        ...


def silent(total: int, what: str) -> AbstractContextManager[None]:
    """Show no progress."""
    return nullcontext()


@dataclass(frozen=True)
class Option:
    """A keyword of an analysis, and an option of its command.

    Attributes:
        name: The keyword; `step_km` is --step-km on the command line.
        help: The line in the command's help.
        limit: What a number must be; None for a word.
        metavar: What stands for the value in the help.
        default: The value where none is given.
        default_text: The default in words, where None stands for it.
        count: Numbers that the option takes.
        flag: Whether the option takes no value.
    """

    name: str
    help: str
    limit: Limit | None = None
    metavar: str = "N"
    default: Any = None
    default_text: str = ""
    count: int = 1
    flag: bool = False


#: The options that mean the same everywhere.
OPTIONS: Mapping[str, Option] = {
    option.name: option
    for option in (
        Option("level", "Level of radar uncertainty.", metavar="NAME"),
        Option("radar", "Only this radar of a network, as if there were no other.", metavar="NAME"),
        Option(
            "method",
            f"Method of propagation: {', '.join(METHODS)}.",
            metavar="NAME",
            default="linear",
        ),
        Option("runs", "Number of runs.", RUNS, default_text="the scenario's"),
        Option("seed", "Seed of the random draws.", SEED, default_text="the scenario's"),
        Option(
            "sampler",
            "random, or sobol: quasi-random points, fewer for the same accuracy of mean and sigma.",
            metavar="NAME",
            default="random",
        ),
        Option(
            "workers",
            "Threads to compute with; the numbers do not depend on the number of threads.",
            Limit(at_least=1, at_most=MAX_WORKERS, whole=True),
            default_text="all cores, at most 8",
        ),
        Option(
            "dask",
            "Compute on the Dask cluster whose scheduler listens there, such as tcp://host:8786.",
            metavar="ADDRESS",
        ),
    )
}

#: Options that choose something of the scenario, unless the analysis has a keyword of that name.
_OF_SCENARIO = ("level", "radar", "runs", "seed")


@dataclass(frozen=True, eq=False)
class Result:
    """What an analysis found.

    Attributes:
        scenario: The scenario, with level, runs and seed as they were used.
        table: Columns of the table by name, all of one length (n,); of a map axes and planes.
        summary: Numbers for the JSON record.
        report: Lines for the terminal.
        warnings: Where the numbers are not to be trusted, one sentence each.
        method: Method of propagation behind the numbers.
        arrays: What the figure shows and the table does not have, by name.
        passed: Whether the answer is yes, where the analysis answers a question.
        by: The analysis.
    """

    scenario: Scenario
    table: Mapping[str, FloatArray]
    summary: Mapping[str, Any] = field(default_factory=dict)
    report: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    method: str = "linear"
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)
    passed: bool = True
    by: Analysis | None = None

    @property
    def analysis(self) -> str:
        """Name of the analysis."""
        return self.by.name if self.by else "result"

    @property
    def stem(self) -> str:
        """Name of the files of the result, without folder and ending."""
        return f"{self.scenario.name}_{self.analysis}"

    @property
    def band_label(self) -> str:
        """What the figure calls the 3σ band."""
        linear = self.method == "linear"
        band = r"$\pm 3\,\sigma_{pd}$" if linear else rf"$\pm 3\,\sigma$ by {self.method}"
        return f"{band} ({self.scenario.level})"

    def plot(self) -> Figure:
        """Draw the figure.

        Raises:
            ValueError: If the result does not come from an analysis.
        """
        from radar_sense.plotting import draw

        if self.by is None:
            raise ValueError("only the result of an analysis has a figure")
        return draw(self.by.plot, self)

    def save(
        self,
        folder: str | Path = ".",
        formats: Sequence[str] = ("png",),
        *,
        command: Sequence[str] = (),
    ) -> list[Path]:
        """Write table, figure and record, all of them or none.

        Args:
            folder: Where to; made if it does not exist.
            formats: Formats of the figure: png, pdf, svg. Without any no figure is written.
            command: The command line, for the record.

        Returns:
            The files: the table, the figures, the record.

        Raises:
            OSError: If a file cannot be written; then none is.
            ValueError: If there is no such format.
        """
        for name in formats:
            if name not in FORMATS:
                raise ValueError(f"format must be one of {', '.join(FORMATS)}, got {name!r}")
        ending, content = files.data(self.table)
        contents = {f"{self.stem}.{ending}": content}
        if formats:
            from radar_sense.plotting import render

            figure = self.plot()
            for name in dict.fromkeys(formats):
                contents[f"{self.stem}.{name}"] = render(figure, name)
        contents[f"{self.stem}.json"] = files.record(
            analysis=self.analysis,
            command=command,
            seed=self.scenario.seed,
            scenario=self.scenario.resolved(),
            warnings=self.warnings,
            summary=self.summary,
        )
        paths = {Path(folder) / name: content for name, content in contents.items()}
        files.write(paths)
        return list(paths)

    def __repr__(self) -> str:
        rows = max((len(column) for column in self.table.values()), default=0)
        names = list(self.table)
        more = f" and {len(names) - 6} more" if len(names) > 6 else ""
        return (
            f"<Result of {self.analysis}: {self.scenario.name}, {rows} rows of "
            f"{', '.join(names[:6])}{more}; .report, .warnings, .table, .plot(), .save(folder)>"
        )

    def _repr_html_(self) -> str:
        def lines(items: Sequence[str]) -> str:
            return html.escape("\n".join(items))

        warnings = f"<pre><b>Warnings</b>\n{lines(self.warnings)}</pre>" if self.warnings else ""
        title = f"{self.analysis}: {self.scenario.name}"
        return f"<b>{html.escape(title)}</b><pre>{lines(self.report)}</pre>{warnings}"


@dataclass(frozen=True, eq=False)
class Analysis:
    """An analysis, called with a scenario.

    Attributes:
        name: Name of the command.
        run: Computes the result.
        plot: Draws the figure of a result into an empty figure; reads the result only.
        options: Options of the command.
        examples: Commands for the help.
    """

    name: str
    run: Callable[..., Result]
    plot: Callable[[Result, Figure], None]
    options: tuple[Option, ...]
    examples: tuple[str, ...]

    def __call__(self, scenario: Scenario, **options: Any) -> Result:
        """Return the result of the analysis.

        Args:
            scenario: The scenario.
            options: Those of the command, and `workers`, `executor` and `progress` where the
                analysis has them; `level`, `radar` and `seed` always.

        Raises:
            InputError: If an option is not allowed.
            TypeError: If the analysis has no such option.
        """
        for name in options:
            if name not in self.keywords and name not in _OF_SCENARIO:
                allowed = sorted({*self.keywords, *_OF_SCENARIO})
                raise TypeError(
                    f"{self.name}() has no option {name!r}, allowed: {', '.join(allowed)}"
                    + did_you_mean(name, allowed)
                )
        of_run = {name: value for name, value in options.items() if name in self.keywords}
        chosen = {name: value for name, value in options.items() if name not in of_run}
        radar = chosen.pop("radar", None)
        scenario = scenario.with_analysis(**chosen)
        if radar is not None:
            scenario = for_radar(scenario, radar)
        result = self.run(scenario, **of_run)
        warnings = (*plausibility_warnings(scenario), *result.warnings)
        return dataclasses.replace(result, warnings=warnings, by=self)

    @property
    def keywords(self) -> tuple[str, ...]:
        """Keywords of the function that computes the result."""
        return tuple(inspect.signature(self.run).parameters)[1:]

    @property
    def help(self) -> str:
        """What the analysis does: its docstring up to the arguments."""
        text = inspect.getdoc(self.run) or ""
        return text.partition("\nArgs:")[0].partition("\nRaises:")[0].strip()

    def __repr__(self) -> str:
        return f"<analysis {self.name}: {self.help.partition(chr(10))[0]}>"


def analysis(
    *,
    plot: Callable[[Result, Figure], None],
    options: Sequence[str | Option] = (),
    examples: Sequence[str] = (),
    name: str = "",
) -> Callable[[Callable[..., Result]], Analysis]:
    """Make an analysis of a function from a scenario to a result.

    Args:
        plot: Draws the figure.
        options: Names in `OPTIONS`, or options of the analysis' own.
        examples: Commands for the help.
        name: Name of the command, that of the function by default.
    """

    def decorate(run: Callable[..., Result]) -> Analysis:
        chosen = tuple(OPTIONS[o] if isinstance(o, str) else o for o in options)
        return Analysis(name or run.__name__, run, plot, chosen, tuple(examples))

    return decorate
