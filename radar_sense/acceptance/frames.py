"""What a far origin of the frame does to errors of attitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import largest_variance, square_root
from radar_sense.model import geodesy
from radar_sense.propagation.moments import BETA
from radar_sense.scenario import Scenario
from radar_sense.states import ATTITUDE, POSITION, FloatArray

#: Angle [rad] that is smaller than any lobe of an aircraft.
LEAST_TURN = 1e-4


def turned_wrongly(scenario: Scenario) -> NDArray[np.bool_]:
    """Return where (n,) an error of the attitude of 3σ is off by more than `LEAST_TURN`.

    A covariance is turned into the frame of the origin to first order. With a tilt τ between the
    level planes of the aircraft and the origin, an error δ of the attitude is off by τ δ²/2.
    """
    if scenario.origin is None:
        return np.zeros(len(scenario.aircraft), dtype=bool)
    turn = geodesy.turn_from_level(scenario.aircraft[:, POSITION], scenario.origin)
    tilt = np.arccos(np.clip(turn[:, 2, 2], -1.0, 1.0))
    attitude = scenario.cov_aircraft.reshape(-1, 6, 6)[:, ATTITUDE, ATTITUDE]
    return 0.5 * tilt * BETA**2 * largest_variance(attitude) > LEAST_TURN


def attitude_off(scenario: Scenario) -> FloatArray:
    """Return by how much (n,) an error of the attitude of 3σ moves P_D wrongly, about a far origin.

    It is 0 where the error itself is hardly off, see `turned_wrongly`.
    """
    off, rows = np.zeros(len(scenario.aircraft)), np.flatnonzero(turned_wrongly(scenario))
    if not rows.size:
        return off
    scenario = scenario.at_poses(rows)
    position, attitude = scenario.aircraft[:, POSITION], scenario.aircraft[:, ATTITUDE]
    turn = geodesy.turn_from_level(position, np.array(scenario.origin))
    level = geodesy.turned_attitude(attitude, np.swapaxes(turn, -1, -2))
    to_level = geodesy.turned_attitude_jacobian(attitude, level)
    root = square_root(scenario.cov_aircraft.reshape(-1, 6, 6)[:, ATTITUDE, ATTITUDE])
    for column in np.moveaxis(root, -1, 0):
        for error in (BETA * column, -BETA * column):
            of_level = (to_level @ error[..., np.newaxis])[..., 0]
            ends = attitude + error, geodesy.turned_attitude(level + of_level, turn)
            first_order, exact = (
                scenario.model.p_d(np.hstack([position, end]), scenario.radar) for end in ends
            )
            off[rows] = np.fmax(off[rows], abs(exact - first_order))
    return off
