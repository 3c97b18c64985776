"""Bounds of P_D by every method against Monte Carlo."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from radar_sense import words
from radar_sense.command import (
    DASK,
    LEVEL,
    NUMBER_OF_RUNS,
    ONE_RADAR,
    SAMPLER,
    SEED_OF_DRAWS,
    WORKER_THREADS,
    Result,
    command,
)
from radar_sense.montecarlo.montecarlo import MonteCarlo, monte_carlo
from radar_sense.propagation import METHODS, Moments, propagate_scenario
from radar_sense.scenario import Scenario

if TYPE_CHECKING:
    from radar_sense.axis import Axis
    from radar_sense.plotting import Figure


@command(
    LEVEL,
    ONE_RADAR,
    NUMBER_OF_RUNS,
    SEED_OF_DRAWS,
    SAMPLER,
    WORKER_THREADS,
    DASK,
    examples=(
        "radar-sense compare",
        "radar-sense compare my.yaml --level high --runs 1e4",
        "radar-sense compare network.yaml --radar ridge",
    ),
)
def compare(
    scenario: Scenario,
    *,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
) -> Result:
    """Bounds of P_D by every method against Monte Carlo.

    Many runs are needed for smooth Monte Carlo bounds: try 100000 runs.

    Args:
        scenario: The scenario.
        sampler: "random" or "sobol".
        workers: Threads to compute with; the result does not depend on their number.
        executor: Computes the blocks in place of threads.

    Raises:
        InputError: If there is no such sampler.
    """
    axis, result = scenario.axis, Result(scenario)
    mc = monte_carlo(scenario, sampler=sampler, workers=workers, executor=executor)
    moments = {method: propagate_scenario(scenario, method=method) for method in METHODS}

    words.add_axis(result.table, axis)
    result.table.add("p_d", mc.band.p_d, words.NOMINAL)
    words.add_draws(result.table, mc)
    for method, m in moments.items():
        result.table.add(f"mean_pd_{method}", m.mean, f"Mean of P_D by {method}.")
        result.table.add(f"sigma_pd_{method}", m.std, f"Standard deviation of P_D by {method}.")
        for end, bound in (("lower", m.lower), ("upper", m.upper)):
            meaning = f"{end.capitalize()} 3-sigma bound of P_D by {method}."
            result.table.add(f"{end}_3sigma_{method}", bound, meaning)

    worst = {}
    for method, m in moments.items():
        bounds = np.maximum(abs(m.lower - mc.lower), abs(m.upper - mc.upper))
        off = {"bounds": bounds, "sigma": abs(m.std - mc.std), "mean": abs(m.mean - mc.mean)}
        worst[method] = {name: words.peak(values, axis) for name, values in off.items()}
    result.summary |= {"runs": mc.runs, "sampler": mc.sampler, "largest_difference": worst}
    by = f"({scenario.level}, seed {mc.seed}{words.points_named(mc)})"
    result.report += [
        f"largest difference from {mc.runs} runs {by}:",
        f"  {'':10}{'3-sigma bounds':28}{'sigma':28}{'mean'}",
    ]
    for method, differences in worst.items():
        cells = [f"{words.describe_extreme(top, axis):28}" for top in differences.values()]
        result.report.append(f"  {method:10}{''.join(cells).rstrip()}")

    for method, m in moments.items():
        result.warnings += words.validity_warnings(scenario, m, method, "the draws hold there")
    result.warnings += words.table_warnings(scenario, runs=mc.runs)
    result.draw = partial(_draw, axis=axis, mc=mc, moments=moments)
    return result


def _draw(figure: Figure, axis: Axis, mc: MonteCarlo, moments: Mapping[str, Moments]) -> None:
    """Draw the bounds, and their differences from the draws."""
    from radar_sense import plotting

    (top, bottom), x = plotting.pose_panels(figure, 2, axis)
    plotting.draw_fill(top, x, mc.lower, mc.upper, color="0.8", lw=0, label="Monte Carlo")
    for (method, m), style in zip(moments.items(), plotting.LINES, strict=False):
        for bound, drawn, label in ((m.upper, mc.upper, method), (m.lower, mc.lower, None)):
            plotting.draw_line(top, x, bound, style, label=label)
            plotting.draw_line(bottom, x, bound - drawn, style)
    top.set_ylabel(r"$3\,\sigma$ bounds of $P_D$")
    bottom.set_ylabel("Bounds minus\nMonte Carlo bounds")
    plotting.draw_legend(figure, top)
