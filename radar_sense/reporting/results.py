"""The results of the analyses in a report, computed in a bounded time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.analyses.budget import budget
from radar_sense.analyses.compare import compare
from radar_sense.analyses.contract import Progress, Result
from radar_sense.analyses.coverage_map import coverage_map
from radar_sense.analyses.error_budget import value_function
from radar_sense.analyses.mission import mission
from radar_sense.analyses.report import reached
from radar_sense.analyses.variance import variance
from radar_sense.analyses.verdicts.plausibility import plausibility_warnings
from radar_sense.errors import InputError
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Draws at each pose of the comparison of methods.
DRAWS = 20_000
#: Most poses of the comparison, and most poses times radars. These bound the time.
POSES, POSES_BY_RADARS = 31, 250


@dataclass(frozen=True, eq=False)
class Results:
    """The results of the analyses in a report.

    Attributes:
        scenario: The scenario, with the level, the seed and the radar of the report.
        implausible: Warnings of possible but implausible values in the scenario.
        variance: P_D with its band, and the threshold test if there is one.
        budget: The error budget, and the accuracies that the threshold requires.
        halved: 3σ of P_D with half the deviation of one source or part, by name. The pose is the
            pose of the largest 3σ.
        comparison: All methods against draws, at some of the poses.
        repeated: The same comparison with other draws.
        mission: The mission, or the reason why there is none; None without a path.
        map: P_D over an area, or the reason why there is no map.
    """

    scenario: Scenario
    implausible: tuple[str, ...]
    variance: Result
    budget: Result
    halved: Mapping[str, float]
    comparison: Result
    repeated: Result
    mission: Result | InputError | None
    map: Result | InputError

    @property
    def threshold(self) -> Mapping[str, Any] | None:
        """Summary of the threshold test; None without a threshold."""
        summary: Mapping[str, Any] | None = self.variance.summary.get("threshold")
        return summary

    def warnings_of(self, result: Result) -> tuple[str, ...]:
        """Return the warnings of a result, without the warnings of the scenario."""
        of_scenario = {*self.implausible, *plausibility_warnings(result.scenario)}
        return tuple(warning for warning in result.warnings if warning not in of_scenario)


def run_analyses(
    scenario: Scenario,
    *,
    method: str,
    threshold: float | None,
    k: float | None,
    workers: int,
    progress: Progress,
) -> Results:
    """Run the analyses of a report, with the options of the command `report`."""
    with progress(6, "analyses") as advance:

        def done(result: Any) -> Any:
            if advance:
                advance(1)
            return result

        along = done(variance(scenario, method=method, threshold=threshold, k=k))
        goal = {} if threshold is None else _goal(along)
        sources = done(budget(scenario, method=method, **goal))
        compared = scenario.at_poses(compared_poses(along)).with_analysis(runs=DRAWS)
        comparison = done(compare(compared, workers=workers))
        repeated = done(compare(compared, seed=compared.seed + 1, workers=workers))
        looks = done(_mission(scenario, workers))
        area = done(_map(scenario, workers))
    return Results(
        scenario=scenario,
        implausible=plausibility_warnings(scenario),
        variance=along,
        budget=sources,
        halved=_halved(sources),
        comparison=comparison,
        repeated=repeated,
        mission=looks,
        map=area,
    )


def _goal(along: Result) -> dict[str, float]:
    """Return the options of `budget` for the threshold, at the pose of the least margin."""
    test, margin = along.summary["threshold"], along.table["margin"]
    pose = int(np.argmin(np.where(np.isnan(margin), np.inf, margin)))
    return {
        "threshold": test["p_max"],
        "k": test["k"],
        "at": float(along.scenario.axis.values[pose]),
    }


def compared_poses(along: Result) -> NDArray[np.intp]:
    """Return the poses at which the methods are compared.

    The poses are evenly spaced over the geometry, with the poses of the largest 3σ and of the
    highest bound added.
    """
    count = len(along.scenario.axis)
    most = max(2, min(POSES, POSES_BY_RADARS // len(along.scenario.model.radars)))
    even = np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)
    worst = [first_largest(along.table[column]) for column in ("sigma_pd", "upper_3sigma")]
    return np.union1d(even, worst)


def first_largest(values: FloatArray) -> int:
    """Return the first pose at which the largest value is reached."""
    return int(np.argmax(reached(values)))


def _halved(sources: Result) -> dict[str, float]:
    """Return 3σ of P_D at the pose of the largest 3σ, with half the deviation of each source."""
    scenario = sources.scenario
    columns = [name for name in sources.table if name.startswith("three_sigma_")]
    names = [name.removeprefix("three_sigma_") for name in columns]
    pose = first_largest(sources.table["three_sigma_total"])
    three_sigma = value_function(scenario.at_poses(np.array([pose])), sources.method)
    return {name: float(three_sigma([name], 0.5)[0]) for name in names if name != "total"}


def _mission(scenario: Scenario, workers: int) -> Result | InputError | None:
    if scenario.time_s is None:
        return None
    try:
        return mission(scenario, workers=workers)
    except InputError as error:
        return error


def _map(scenario: Scenario, workers: int) -> Result | InputError:
    try:
        return coverage_map(scenario, workers=workers)
    except InputError as error:
        return error
