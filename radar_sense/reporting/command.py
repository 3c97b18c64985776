"""The command `report`: gathers the analyses of a scenario, and writes them as one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from radar_sense import files
from radar_sense.analyses.contract import (
    OPTIONS,
    Command,
    FigureError,
    Progress,
    Written,
    silent,
)
from radar_sense.analyses.variance import variance
from radar_sense.analyses.verdicts.threshold import AUTOMATIC
from radar_sense.reporting.page import page
from radar_sense.reporting.results import Results, run_analyses
from radar_sense.reporting.sections import Section, sections
from radar_sense.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Report:
    """The report of a scenario: results of analyses, and sections with answers.

    Attributes:
        results: The results of the analyses.
        sections: The questions, with their answers.
    """

    results: Results
    sections: tuple[Section, ...]

    @property
    def stem(self) -> str:
        """Name of the file, without folder and ending."""
        return report.stem(self.results.scenario)

    @property
    def passed(self) -> bool:
        """Whether the threshold test holds, if there is one."""
        return self.results.variance.passed

    @property
    def report(self) -> tuple[str, ...]:
        """The answers, for the terminal."""
        return tuple(section.answer for section in self.sections)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of all analyses, each once."""
        return tuple(dict.fromkeys(w for section in self.sections for w in section.warnings))

    def html(self, command: Sequence[str] = ()) -> str:
        """Return the page.

        Args:
            command: The command line, for the record.

        Raises:
            FigureError: If a figure cannot be drawn.
        """
        return page(
            self.results.scenario,
            self.sections,
            command=command,
            versions=files.versions(),
            document=files.yaml_text(self.results.scenario.resolved()),
        )

    def save(self, folder: str | Path = ".", *, command: Sequence[str] = ()) -> list[Path]:
        """Write the page.

        Args:
            folder: Folder of the file; made if missing.
            command: The command line, for the record.

        Returns:
            The file.

        Raises:
            FigureError: If a figure cannot be drawn. No file is written then.
            OSError: If the file cannot be written.
        """
        written = self.write(folder, command=command)
        if written.figure_error is not None:
            raise written.figure_error
        return written.paths

    def write(
        self, folder: str | Path, formats: Sequence[str] = (), *, command: Sequence[str] = ()
    ) -> Written:
        """Write the page as `save` does, and return the written files as `Result.write` does."""
        folder, name = Path(folder), f"{self.stem}.html"
        try:
            content = self.html(command).encode()
        except FigureError as error:
            return Written([], [], None, error)
        files.write(folder, {name: content})
        return Written([folder / name], [], None, None)


class Gathering(Command):
    """A command that gathers several analyses, called with a scenario."""

    endings: ClassVar[tuple[str, ...]] = ("html",)
    has_figures: ClassVar[bool] = False

    def __call__(self, scenario: Scenario, **options: Any) -> Report:
        """Return the report, as `Command.__call__` does."""
        made: Report = super().__call__(scenario, **options)
        return made


def _report(
    scenario: Scenario,
    *,
    method: str = AUTOMATIC,
    threshold: float | None = None,
    k: float | None = None,
    workers: int = 1,
    progress: Progress = silent,
) -> Report:
    """One HTML page: the questions about a scenario, and the answers.

    The page has P_D with its band, the error budget, and a comparison of the methods. The mission
    along a path, a map, all warnings, and the scenario follow. With a threshold the page has the
    threshold test too. Exit code 3 means that the test is violated or not known. The page needs no
    network and no script. There is no JSON record: the page has the command, the versions, the seed
    and the scenario.

    Args:
        scenario: The scenario.
        method: Method of propagation. "automatic" is as in `variance` and `budget`.
        threshold: P_max of the threshold test; None for no test.
        k: Number of σ in the threshold test, 3 by default.
        workers: Threads to compute with; the page does not depend on their number.
        progress: Shows the analyses that are done.

    Raises:
        InputError: If an option is not allowed, or k is given alone.
    """
    results = run_analyses(
        scenario, method=method, threshold=threshold, k=k, workers=workers, progress=progress
    )
    return Report(results, sections(results))


_OF_VARIANCE = {option.name: option for option in variance.options}

report = Gathering(
    name="report",
    run=_report,
    options=(
        OPTIONS["level"],
        OPTIONS["radar"],
        _OF_VARIANCE["method"],
        _OF_VARIANCE["threshold"],
        _OF_VARIANCE["k"],
        OPTIONS["seed"],
        OPTIONS["workers"],
    ),
    examples=(
        "radar-sense report",
        "radar-sense report my.yaml --threshold 0.1 --k 3",
        "radar-sense report network.yaml --radar ridge --level high",
    ),
)
