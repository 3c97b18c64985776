"""Result, and what makes a function a command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from radar_sense.montecarlo.montecarlo import MonteCarlo
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class Result:
    """What an analysis found.

    Attributes:
        analysis: Its name.
        scenario: The scenario, with level, runs and seed as they were used.
        table: Columns of the CSV file, by name, each (n,).
        summary: Numbers for the JSON record.
        report: Lines for the terminal.
        warnings: Where the numbers are not to be trusted, one sentence each.
        method: Method of propagation behind the numbers.
        monte_carlo: The draws behind the table, if there were any.
        passed: Whether what was asked for holds; false if a method is not validated.
    """

    analysis: str
    scenario: Scenario
    table: Mapping[str, FloatArray]
    summary: Mapping[str, Any]
    report: tuple[str, ...]
    warnings: tuple[str, ...]
    method: str = "linear"
    monte_carlo: MonteCarlo | None = None
    passed: bool = True
