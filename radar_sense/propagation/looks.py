"""Looks at poses by draws: few draws at first, and more where they do not settle a question."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import largest_variance
from radar_sense.progress import report
from radar_sense.propagation.draws import Estimate, estimate
from radar_sense.states import ATTITUDE, POSITION, TILT_ERROR, of_radar
from radar_sense.uncertain_states import UncertainStates

#: Draws at a pose of the first look, growth from look to look, and most draws at a pose.
FIRST, GROWTH, LAST = 1024, 4, 2**18
#: Draws of the first look where the RCS has lobes: a lobe that weighs 0.13 % has five at least.
LOBED = FIRST * GROWTH**2


def first_look(states: UncertainStates, beta: float, p_max: float = np.nan) -> Estimate:
    """Return what few draws say of P_D at each pose, more of them where the RCS has lobes.

    Args:
        states: The uncertain states of k poses.
        beta: β of the bounds.
        p_max: Limit whose exceedance is counted; NaN for none.
    """
    found, with_lobes = Estimate.constant(len(states), np.nan), lobed(states)
    for mask, draws in ((~with_lobes, FIRST), (with_lobes, LOBED)):
        rows = np.flatnonzero(mask)
        if rows.size:
            found.put(rows, estimate(states.at(rows), draws, beta, p_max))
    return found


def look_until(
    settled: Callable[[NDArray[np.intp], Estimate], NDArray[np.bool_]],
    states: UncertainStates,
    first: Estimate,
    beta: float,
    p_max: float = np.nan,
    *,
    most: int,
) -> Estimate:
    """Return what draws say of P_D, more of them at the poses that a first look does not settle.

    What a pose gets depends on this pose alone.

    Args:
        settled: Returns where (j,) an estimate at the poses (j,) is enough.
        states: The uncertain states of k poses.
        first: What the first look says, which is not changed.
        beta: β of the bounds.
        p_max: Limit whose exceedance is counted; NaN for none.
        most: Most draws at a pose.
    """
    drawn, rows = first.at(slice(None)), np.arange(len(states))
    while rows.size:
        rows = rows[~settled(rows, drawn.at(rows))]
        report("poses looked at by draws", len(states) - rows.size, len(states))
        rows = rows[drawn.draws[rows] * GROWTH <= most]
        more = GROWTH * drawn.draws[rows].astype(int)
        for draws in np.unique(more):
            some = rows[more == draws]
            drawn.put(some, estimate(states.at(some), int(draws), beta, p_max))
    return drawn


def lobed(states: UncertainStates) -> NDArray[np.bool_]:
    """Return where (k,) ±3σ of the aspect of a radar are wider than a lobe of RCS or antenna.

    Few draws may then miss a lobe that weighs as much as a tail. σ is at most this.
    """
    result = np.zeros(len(states), dtype=bool)
    attitude = largest_variance(states.cov_aircraft, ATTITUDE)
    for i, radar in enumerate(states.model.radars):
        position = of_radar(i, POSITION)
        line = states.aircraft[:, POSITION] - states.radar[:, position]
        across = largest_variance(states.cov_aircraft, POSITION)
        across = across + largest_variance(states.cov_radar, position)
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = across / np.sum(line * line, axis=1)
        result |= ~(radar.model.rcs.detail >= 6.0 * np.sqrt(attitude + turned))
        if radar.model.antenna is not None:
            tilt = largest_variance(
                states.cov_radar, of_radar(i, slice(TILT_ERROR, TILT_ERROR + 1))
            )
            result |= ~(radar.model.antenna.detail >= 6.0 * np.sqrt(tilt + turned))
    return result
