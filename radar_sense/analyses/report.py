"""Ask the other commands, and write their answers as one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense import files, options, progress
from radar_sense.analyses.budget import budget
from radar_sense.analyses.check import overview
from radar_sense.analyses.compare import compare
from radar_sense.analyses.map import coverage_map
from radar_sense.analyses.mission import mission
from radar_sense.analyses.range import detection_range
from radar_sense.analyses.variance import variance
from radar_sense.command import Command, Result, command
from radar_sense.errors import InputError
from radar_sense.page import Section, page
from radar_sense.plausibility import plausibility_warnings
from radar_sense.scenario import Scenario

#: Most poses of the comparison, and most poses times radars. These bound the time.
POSES, POSES_BY_RADARS = 31, 250
#: Degrees between the bearings of the ranges.
BEARINGS_DEG = 5.0


@dataclass(eq=False, repr=False)
class Report(Result):
    """The report of a scenario: a result without table and figure of its own, and one file.

    Attributes:
        sections: The questions, with their answers.
    """

    sections: tuple[Section, ...] = ()

    def html(self, command: Sequence[str] = ()) -> str:
        """Return the page with the command line, or raise FigureError."""
        return page(self.scenario, self.sections, command)

    def save(  # type: ignore[override]  # one file has no formats
        self, folder: str | Path = ".", *, command: Sequence[str] = ()
    ) -> list[Path]:
        """Write the page, and return the file; the errors are those of `Result.save`."""
        content = self.html(command).encode()
        return files.write(Path(folder), {f"{self.stem}.html": content})


@command(
    options.LEVEL,
    options.ONE_RADAR,
    options.METHOD,
    options.THRESHOLD,
    options.AT_LEAST,
    options.K,
    options.PROBABILITY,
    options.SEED_OF_DRAWS,
    options.WORKER_THREADS,
    examples=(
        "radar-sense report",
        "radar-sense report my.yaml --threshold 0.1 --k 3",
        "radar-sense report network.yaml --radar ridge --level high",
    ),
    endings=("html",),
    formats=(),
)
def report(
    scenario: Scenario,
    *,
    threshold: float | None = None,
    at_least: float | None = None,
    k: float | None = None,
    probability: float | None = None,
    workers: int = 1,
) -> Report:
    """One HTML page: the questions about a scenario, and the answers.

    Each question is answered by a command: its lines, warnings and figure, and the extremes of its
    table. With --threshold or --at-least the page has this test too, with the range and the map of
    this P_D, and exit code 3 means that the test is violated or not known. The page needs no
    network and no script. It ends with the command, the versions and the scenario.
    """
    limits = {"threshold": threshold, "at_least": at_least}
    test = {**limits, "k": k, "probability": probability}
    at_k: dict[str, Any] = {} if k is None else {"k": k}
    limit = threshold if at_least is None else at_least
    of_limit: dict[str, Any] = {"p_d": limit} if limit and limit < 1 else {}
    compared = scenario.at_poses(compared_poses(scenario))
    few, all_poses = len(compared.axis), len(scenario.axis)
    sample = f" Looked at {few} of {all_poses} poses." if few < all_poses else ""
    # commands, each with its question, scenario and options
    asked: list[tuple[Command, str, Scenario, dict[str, Any]]] = [
        (variance, "How sure is the probability of detection?", scenario, test),
        (
            budget,
            "Where does the uncertainty come from, and what should be measured better first?",
            scenario,
            test if limit else {},
        ),
        (compare, f"How far can each method be trusted here?{sample}", compared, at_k),
        (mission, "Will the flight have been detected?", scenario, {"workers": workers, **at_k}),
        (
            detection_range,
            "How far does each radar see?",
            scenario,
            {"step_deg": BEARINGS_DEG, **at_k, **of_limit},
        ),
        (
            coverage_map,
            "Where in the area is P_D high?",
            scenario,
            {"workers": workers, **of_limit},
        ),
    ]
    if scenario.time_s is None:
        asked = [of_one for of_one in asked if of_one[0] is not mission]
    warnings = plausibility_warnings(scenario)
    sections = [Section("check", "Who looks at whom?", overview(scenario), warnings)]
    for done, (asks, question, poses, chosen) in enumerate(asked):
        progress.report("questions", done, len(asked))
        seen = {warning for section in sections for warning in section.warnings}
        if poses is not scenario:  # a sample has its poses far apart
            seen |= {*plausibility_warnings(poses)}
        try:
            result = asks(poses, **chosen)
        except InputError as error:
            if asks is variance:  # a scenario may have no answer, but it has P_D
                raise
            sections.append(Section(asks.name, question, (f"no answer: {error}",)))
        else:
            new = tuple(warning for warning in result.warnings if warning not in seen)
            sections.append(Section(asks.name, question, tuple(result.report), new, result))
    results = [section.result for section in sections if section.result]
    return Report(
        scenario,
        report=[f"{section.key}: {section.answer}" for section in sections],
        warnings=[text for section in sections[1:] for text in section.warnings],
        passed=all(result.passed for result in results),
        sections=tuple(sections),
    )


def compared_poses(scenario: Scenario) -> NDArray[np.intp]:
    """Return the poses at which the methods are compared, evenly spaced over the geometry."""
    count = len(scenario.axis)
    most = max(2, min(POSES, POSES_BY_RADARS // len(scenario.model.radars)))
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)
