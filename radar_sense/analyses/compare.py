"""Bounds of P_D by every method against Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from matplotlib.figure import Figure

from radar_sense.analyses.contract import Result
from radar_sense.analyses.report import (
    _doubts,
    _drawn,
    _mixed_rounding,
    _not_as_taken,
    _points,
    at,
    peak,
)
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.plotting import _LINES, _fill, _legend, _line, _new, _x
from radar_sense.propagation import METHODS, propagate_scenario
from radar_sense.scenario import Scenario


def _compare(result: Result) -> Figure:
    figure, (top, bottom) = _new(2, result)
    table, x = result.table, _x(result)
    ends = {"lower": table["mc_lower"], "upper": table["mc_upper"]}
    _fill(top, x, ends["lower"], ends["upper"], color="0.8", lw=0, label="Monte Carlo")
    for method, style in zip(METHODS, _LINES, strict=False):
        for end, drawn in ends.items():
            label = method if end == "upper" else None
            _line(top, x, table[f"{end}_3sigma_{method}"], style, label=label)
            _line(bottom, x, table[f"{end}_3sigma_{method}"] - drawn, style)
    top.set_ylabel(r"Bounds of $P_D$ at $\Phi(\pm 3)$")
    bottom.set_ylabel("Bounds less those\nof Monte Carlo")
    _legend(figure, top)
    return figure


def compare(
    scenario: Scenario,
    *,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Bounds of P_D by every method of propagation against those of Monte Carlo."""
    axis = scenario.axis
    mc = monte_carlo(
        scenario, sampler=sampler, workers=workers, executor=executor, progress=progress
    )
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
        analysis="compare",
        scenario=scenario,
        table={
            axis.key: axis.values,
            "p_d": mc.band.p_d,
            **_drawn(mc.mean, mc.std, mc.lower, mc.upper),
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
            f"({scenario.level}, seed {mc.seed}{_points(mc)}):",
            f"  {'':10}{'3-sigma bounds':28}{'sigma':28}{'mean'}",
            *(
                f"  {method:10}"
                + "".join(f"{at(extreme, axis):28}" for extreme in w.values()).rstrip()
                for method, w in worst.items()
            ),
        ),
        warnings=(
            *(
                doubt
                for method, m in moments.items()
                for doubt in (*_doubts(m, method, axis), *_not_as_taken(scenario, method))
            ),
            *_mixed_rounding(mc),
        ),
        monte_carlo=mc,
    )
