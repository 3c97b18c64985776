"""Bounds of P_D by every method against Monte Carlo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from radar_sense import options, plotting, words
from radar_sense.axis import Axis
from radar_sense.command import Figure, Result, command
from radar_sense.cost import EMPHASIS, foresee
from radar_sense.montecarlo.adaptive import ERRORS, draw_in_parts
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.statistics import DrawStatistics
from radar_sense.propagation import METHODS, MONTE_CARLO, Moments, propagate_scenario
from radar_sense.scenario import Scenario

#: Draws with emphasis on the tails of all poses and radars together, about a second; and least and
#: most draws at a pose.
TOGETHER, LEAST, MOST = 3e6, 2**10, 2**17
#: What is compared, and the values in it.
COMPARED = {"bounds": ("lower", "upper"), "sigma": ("std",), "mean": ("mean",)}


@command(
    options.LEVEL,
    options.ONE_RADAR,
    replace(
        options.NUMBER_OF_RUNS,
        help="Number of plain runs, in place of draws with emphasis on the tails.",
        default_text="no plain runs",
    ),
    options.SEED_OF_DRAWS,
    options.SAMPLER,
    options.K,
    options.WORKER_THREADS,
    options.DASK,
    examples=(
        "radar-sense compare",
        "radar-sense compare my.yaml --level high --runs 1e5 --k 2",
        "radar-sense compare network.yaml --radar ridge",
    ),
)
def compare(
    scenario: Scenario,
    *,
    runs: int | None = None,
    sampler: str = "random",
    k: float = 3.0,
    workers: int = 1,
    executor: Executor | None = None,
) -> Result:
    """Bounds of P_D by every method against Monte Carlo.

    The draws have an emphasis on the tails. A difference that they cannot tell from none is said to
    be so. Plain runs take their place if --runs, --sampler sobol or a cluster ask for them.
    """
    plain = runs is not None or sampler != "random" or executor is not None
    scenario = scenario.with_analysis(runs=runs)
    axis, result = scenario.axis, Result(scenario)
    if plain:
        draws, kind = scenario.runs, "plain runs" if sampler == "random" else "Sobol' points"
        drawn: DrawStatistics = monte_carlo(
            scenario, k=k, sampler=sampler, workers=workers, executor=executor
        )
        error = DrawStatistics(*np.zeros((4, len(axis))))
    else:
        kind = "draws a pose with emphasis on the tails"
        draws, drawn, error = _draw_tails(scenario, k)
    moments = {method: propagate_scenario(scenario, method=method, beta=k) for method in METHODS}

    words.add_axis(result.table, axis)
    result.table.add("p_d", moments["linear"].p_d, words.NOMINAL)
    words.add_draws(result.table, drawn, k)
    for method, m in moments.items():
        result.table.add(f"mean_pd_{method}", m.mean, f"Mean of P_D by {method}.")
        result.table.add(f"sigma_pd_{method}", m.std, f"Standard deviation of P_D by {method}.")
        for end, bound in (("lower", m.lower), ("upper", m.upper)):
            meaning = f"{end.capitalize()} {k:g}-sigma bound of P_D by {method}."
            result.table.add(f"{end}_{k:.12g}sigma_{method}", bound, meaning)
    for name, values in vars(error).items() if not plain else ():
        result.table.add(f"mc_{name}_error", values, f"Standard error of mc_{name}.")

    result.report += [
        f"largest difference from {draws:,} {kind} ({scenario.level}, seed {scenario.seed}):",
        f"  {'':10} {f'{k:g}-sigma bounds':28}{'sigma':28}{'mean'}",
    ]
    largest: dict[str, Any] = {}
    bounds, told = {}, []
    for method, m in moments.items():
        found = {name: _difference(m, drawn, error, ends, axis) for name, ends in COMPARED.items()}
        largest[method] = {name: top for name, (top, *_) in found.items()}
        *_, bounds[method] = found["bounds"]
        cells = "".join(f"{text:27} " for *_, text in found.values())
        result.report.append(f"  {method:10} {cells.rstrip()}")
        if not plain and any(tells for _, tells, _ in found.values()):
            told.append(method)
    missing = {
        method: ~np.isfinite(m.mean + m.std + m.lower + m.upper) for method, m in moments.items()
    }
    if not plain:
        noise = words.peak(ERRORS * np.maximum(error.lower, error.upper), axis)
        shown = words.describe_extreme(noise, axis)
        result.report += [
            f"the method {MONTE_CARLO} has {scenario.runs:,} runs",
            f"noise of the draws: up to {shown} in a bound",
        ]
    # a method that has no value at a pose is not nearest, and no draws would tell it from the truth
    whole = [method for method in moments if not missing[method].any()]
    unknown = [method for method in whole if method not in told]
    if plain:
        result.report.append(
            f"the noise of the {kind} is in these differences; without --runs, --sampler and "
            "--dask the draws know their own"
        )
    elif not drawn.std.any():
        same = "every method" if len(whole) == len(moments) else "every method that has a value"
        result.report.insert(0, f"P_D is certain: {same} has the same")
    elif unknown:
        better = [method for method in unknown if method != MONTE_CARLO][:1]
        more = "".join(f"; the command validate with --method {m} makes more" for m in better)
        result.report.insert(
            0,
            f"{draws:,} draws a pose cannot tell {words.listed(unknown)} from the truth{more}",
        )
    else:
        farthest = {m: words.probability(largest[m]["bounds"]["value"]) for m in whole}
        best = [m for m in whole if farthest[m] == min(farthest.values(), key=float)]
        nearest = f"nearest to {draws:,} draws a pose: {words.listed(best)}"
        result.report.insert(0, f"{nearest}, bounds within {bounds[best[0]]}")
    result.summary |= {
        "runs": draws,
        "k": k,
        "sampler": sampler,
        "emphasis_on_tails": not plain,
        "largest_difference": largest,
        "methods_told": told,
    }

    # Where a method is off is the answer of this command, and no warning.
    result.warnings += [
        words.warning("no-value", f"{method} has no value {place}")
        for method, place in words.places(missing, axis).items()
    ]
    result.warnings += words.table_warnings(scenario)
    result.draw = partial(_draw, axis=axis, k=k, drawn=drawn, error=error, moments=moments)
    return result


def _draw_tails(scenario: Scenario, k: float) -> tuple[int, DrawStatistics, DrawStatistics]:
    """Return a number of draws at a pose, what they say, and its standard errors."""
    poses, radars = len(scenario.axis), len(scenario.model.radars)
    affordable = max(LEAST, min(int(TOGETHER / (poses * radars)), MOST))
    draws = 1 << affordable.bit_length() - 1  # a power of two
    what = f"{draws:,} draws at {poses:,} poses"
    foresee(what, float(draws) * poses * radars * EMPHASIS, less="fewer poses")
    drawn, error = draw_in_parts(scenario.states(), draws, k)
    return draws, DrawStatistics(*drawn), DrawStatistics(*error)


def _difference(
    m: Moments, drawn: DrawStatistics, error: DrawStatistics, names: Sequence[str], axis: Axis
) -> tuple[dict[str, Any], bool, str]:
    """Return the largest difference of values from those by draws, with its places.

    Whether the draws tell a difference from their noise at any pose follows, and the largest in
    words: it may be noise where a smaller one at another pose is not.
    """
    values, by_draws, noise = (
        np.stack([getattr(x, name) for name in names]) for x in (m, drawn, error)
    )
    distance = abs(values - by_draws)
    told = distance > np.maximum(ERRORS * noise, words.LEAST)
    top = words.peak(distance.max(axis=0), axis)
    if np.isnan(top["value"]):
        return top, False, "undefined"
    text = words.describe_extreme(top, axis, gaps=False)  # a warning says it
    is_noise = top["value"] >= words.LEAST and not told[distance == top["value"]].any()
    return top, bool(told.any()), f"{text} (noise)" if is_noise else text


def _draw(
    figure: Figure,
    axis: Axis,
    k: float,
    drawn: DrawStatistics,
    error: DrawStatistics,
    moments: Mapping[str, Moments],
) -> None:
    """Draw the bounds, and their differences from the draws with the noise of the draws."""
    (top, bottom), x = plotting.pose_panels(figure, 2, axis)
    plotting.draw_fill(top, x, drawn.lower, drawn.upper, color="0.8", lw=0, label="reference")
    noise = ERRORS * np.maximum(error.lower, error.upper)
    plotting.draw_fill(bottom, x, -noise, noise, color="0.8", lw=0)
    for (method, m), style in zip(moments.items(), plotting.LINES, strict=False):
        ends = ((m.upper, drawn.upper, method), (m.lower, drawn.lower, None))
        for bound, by_draws, label in ends:
            plotting.draw_line(top, x, bound, style, label=label)
            plotting.draw_line(bottom, x, bound - by_draws, style)
    top.set_ylabel(rf"${k:g}\,\sigma$ bounds of $P_D$")
    bottom.set_ylabel("Bounds minus reference")
    plotting.draw_legend(figure, top)
