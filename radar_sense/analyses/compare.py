"""Bounds of P_D by every method against Monte Carlo."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import TYPE_CHECKING

import numpy as np

from radar_sense.analyses.columns import AXIS, DRAWS, P_D, quantities
from radar_sense.analyses.contract import Result, analysis
from radar_sense.analyses.report import (
    describe_extreme,
    distribution_warnings,
    monte_carlo_columns,
    peak,
    points_named,
    table_warnings,
    validity_warnings,
)
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.propagation import METHODS, propagate_scenario
from radar_sense.scenario import Scenario

if TYPE_CHECKING:
    from radar_sense.plotting import Figure


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense import plotting

    (top, bottom), x = plotting.pose_panels(figure, 2, result.scenario.axis)
    table = result.table
    ends = {"lower": table["mc_lower"], "upper": table["mc_upper"]}
    plotting.draw_fill(top, x, ends["lower"], ends["upper"], color="0.8", lw=0, label="Monte Carlo")
    for method, style in zip(METHODS, plotting.LINES, strict=False):
        for end, drawn in ends.items():
            label = method if end == "upper" else None
            plotting.draw_line(top, x, table[f"{end}_3sigma_{method}"], style, label=label)
            plotting.draw_line(bottom, x, table[f"{end}_3sigma_{method}"] - drawn, style)
    top.set_ylabel(r"$3\,\sigma$ bounds of $P_D$")
    bottom.set_ylabel("Bounds minus\nMonte Carlo bounds")
    plotting.draw_legend(figure, top)


_TABLE = (
    *AXIS,
    P_D,
    *DRAWS,
    *quantities(
        {
            "mean_pd_<method>": "Mean of P_D by <method>.",
            "sigma_pd_<method>": "Standard deviation of P_D by <method>.",
            "lower_3sigma_<method>": "Lower 3-sigma bound of P_D by <method>.",
            "upper_3sigma_<method>": "Upper 3-sigma bound of P_D by <method>.",
        }
    ),
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["level", "radar", "runs", "seed", "sampler", "workers", "dask"],
    examples=[
        "radar-sense compare",
        "radar-sense compare my.yaml --level high --runs 1e4",
        "radar-sense compare network.yaml --radar ridge",
    ],
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
    axis = scenario.axis
    mc = monte_carlo(scenario, sampler=sampler, workers=workers, executor=executor)
    moments = {method: propagate_scenario(scenario, method=method) for method in METHODS}
    worst = {
        method: {
            "bounds": peak(np.maximum(abs(m.lower - mc.lower), abs(m.upper - mc.upper)), axis),
            "sigma": peak(abs(m.std - mc.std), axis),
            "mean": peak(abs(m.mean - mc.mean), axis),
        }
        for method, m in moments.items()
    }
    return Result(
        scenario=scenario,
        table={
            axis.key: axis.values,
            "p_d": mc.band.p_d,
            **monte_carlo_columns(mc),
            **{
                f"{name}_{method}": column
                for method, m in moments.items()
                for name, column in (
                    ("mean_pd", m.mean),
                    ("sigma_pd", m.std),
                    ("lower_3sigma", m.lower),
                    ("upper_3sigma", m.upper),
                )
            },
        },
        summary={
            "runs": mc.runs,
            "sampler": mc.sampler,
            "largest_difference": worst,
        },
        report=(
            f"largest difference from {mc.runs} runs "
            f"({scenario.level}, seed {mc.seed}{points_named(mc)}):",
            f"  {'':10}{'3-sigma bounds':28}{'sigma':28}{'mean'}",
            *(
                f"  {method:10}"
                + "".join(
                    f"{describe_extreme(extreme, axis):28}" for extreme in w.values()
                ).rstrip()
                for method, w in worst.items()
            ),
        ),
        warnings=(
            *(
                warning
                for method, m in moments.items()
                for warning in validity_warnings(scenario, m, method, "the draws hold there")
            ),
            *distribution_warnings(scenario, *METHODS),
            *table_warnings(scenario, runs=mc.runs),
        ),
    )
