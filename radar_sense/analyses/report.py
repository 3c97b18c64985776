"""Saying in words where along the geometry something happens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.axis import Axis
from radar_sense.model.radar_constant import doubts
from radar_sense.montecarlo.montecarlo import MonteCarlo
from radar_sense.propagation import BOUND_CHANGE, STD_CHANGE, Moments, propagate_scenario
from radar_sense.scenario import Scenario, alone
from radar_sense.states import FloatArray


def reached(values: FloatArray) -> NDArray[np.bool_]:
    """Mark the poses at which the largest value is reached.

    Poses that mirror each other differ by rounding, which must not decide between them.
    """
    top = np.nanmax(values, initial=-np.inf)
    return np.greater_equal(values, top - 1e-9 * abs(top))


def peak(values: FloatArray, axis: Axis) -> dict[str, Any]:
    """Return the largest value and all places at which it is reached."""
    if not np.isfinite(values).any():
        return {"value": float("nan"), axis.key: []}
    return {"value": float(np.nanmax(values)), axis.key: axis.values[reached(values)].tolist()}


def trough(values: FloatArray, axis: Axis) -> dict[str, Any]:
    """Return the smallest value and all places at which it is reached."""
    top = peak(-values, axis)
    return {**top, "value": -top["value"]}


def at(extreme: Mapping[str, Any], axis: Axis) -> str:
    """Describe a peak or a trough: its value and the places."""
    places = extreme[axis.key]
    if not places:
        return "undefined"
    if len(places) > 3:
        said = f"{len(places)} poses"
    else:
        *others, last = map(axis.number, places)
        said = " and ".join(filter(None, (", ".join(others), last))) + f" {axis.unit}"
    return f"{extreme['value']:.4f} at {said}"


def where(mask: NDArray[np.bool_], axis: Axis) -> str:
    """Describe the poses of a mask; nothing if there are none."""
    count = int(np.count_nonzero(mask))
    if count == 0:
        return ""
    if count == mask.size:
        return "at every pose" if count > 1 else f"at {axis.at(0)}"
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    if len(edges) > 8:
        first, last = map(axis.number, axis.values[mask][[0, -1]])
        return f"at {count} of {mask.size} poses between {first} and {last} {axis.unit}"
    firsts, lasts = (map(axis.number, axis.values[e]) for e in (edges[::2], edges[1::2] - 1))
    spans = (a if a == b else f"{a} to {b}" for a, b in zip(firsts, lasts, strict=True))
    return f"at {', '.join(spans)} {axis.unit}"


def _largest_by_radar(scenario: Scenario, method: str | None) -> dict[str, dict[str, Any]]:
    """Largest 3σ of P_D, and where, of each radar of a network by itself."""
    return {
        name: peak(3 * propagate_scenario(one, method=_chosen(method)).std, scenario.axis)
        for name, one in alone(scenario).items()
    }


def _by_radar(said: Mapping[str, str], how: str = "") -> tuple[str, ...]:
    """Return a line for each radar of a network, under a heading; nothing for a single radar."""
    if not said:
        return ()
    width = max(map(len, said))
    return (
        f"largest {f'{how} ' if how else ''}3 sigma of each radar by itself (more with --radar):",
        *(f"  {name:{width}}  {words}" for name, words in said.items()),
    )


def _by_radar_summary(found: Mapping[str, Any]) -> dict[str, Any]:
    return {"largest_three_sigma_by_itself": dict(found)} if found else {}


def _chosen(method: str | None) -> str:
    return "linear" if method is None else method


def _drawn(
    mean: FloatArray, std: FloatArray, lower: FloatArray, upper: FloatArray
) -> dict[str, FloatArray]:
    return {"mc_mean": mean, "mc_std": std, "mc_lower": lower, "mc_upper": upper}


def _band(moments: Moments) -> dict[str, FloatArray]:
    return {
        "p_d": moments.p_d,
        "sigma_pd": moments.std,
        "lower_3sigma": moments.lower,
        "upper_3sigma": moments.upper,
    }


def _mean(mean: FloatArray, method: str | None, ending: str = "") -> dict[str, FloatArray]:
    """Return the column for the method's mean; the paper's tables, without a method, have none."""
    return {} if method is None else {f"mean_pd{ending}": mean}


def _by(method: str | None) -> str:
    return "" if method is None else f" ({method})"


def _named(level: str, method: str | None) -> str:
    return level if method is None else f"{level}, {method}"


def _band_name(method: str | None) -> str:
    return "linearized" if method in (None, "linear") else str(method)


def _doubts(moments: Moments, method: str | None, axis: Axis) -> tuple[str, ...]:
    """Say where the band of a method is not to be trusted."""
    name = _band_name(method)
    undefined = ~np.isfinite(moments.std)
    outside = (moments.lower < 0) | (moments.upper > 1)
    said = (
        (~moments.settled, f"{name} did not settle, or its gradient is undefined,"),
        (
            undefined & moments.settled,
            "the gradient is undefined, with the radar straight above or below the aircraft,",
        ),
        (outside, f"the {name} 3-sigma band leaves [0, 1]"),
        (
            moments.curved & ~undefined,
            "effects of higher order would change sigma by over "
            f"{STD_CHANGE:.0%} or a bound by over {BOUND_CHANGE:g}: do not rely on the {name} band",
        ),
    )
    return tuple(f"{words} {place}" for mask, words in said if (place := where(mask, axis)))


def _points(mc: MonteCarlo) -> str:
    return "" if mc.sampler == "random" else ", Sobol' points"


def _mixed_rounding(mc: MonteCarlo) -> tuple[str, ...]:
    """Warn if the processes of a cluster rounded differently."""
    if len(mc.canaries) < 2:
        return ()
    return (
        f"the workers round in {len(mc.canaries)} different ways, as their CPUs differ: the last "
        "digits depend on which worker computed which runs",
    )


def _not_as_taken(scenario: Scenario, method: str | None) -> tuple[str, ...]:
    """Say so if a radar constant is not distributed as the method takes it to be."""
    return doubts(scenario.model.names, scenario.parts, _chosen(method))


def _clipped(count: int) -> tuple[str, ...]:
    if not count:
        return ()
    return (f"the radar constant was drawn below zero and set to zero in {count} runs",)
