"""Attitude from a track, and attitudes and covariances turned into the frame of an origin.

Attitude and covariance of an aircraft are relative to north, east and down at the aircraft, as a
navigation filter writes them. Over the curved earth, level differs from place to place. The
functions here turn attitudes and covariances into the north-east-down frame of one origin.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g as gravity

from radar_sense.covariance import symmetric_square_root, without_rounding
from radar_sense.errors import InputError
from radar_sense.model import geodesy
from radar_sense.states import AIRCRAFT, ATTITUDE, POSITION, FloatArray, slices

#: Below this speed over ground [m/s] from row to row an aircraft hovers: a drift shows no heading.
HOVER = 0.1
#: How many times as steep as the steeper leg beside it a path is at a row.
STEEPER = 2.0
#: A slower velocity over ground [m/s] is rounding, and has no direction.
_NO_SPEED = 1e-9
#: Nearer than this [rad] to straight up or down, errors of yaw and roll grow more than 500-fold.
_STEEP = 0.002
#: Columns of a route file that hold the attitude, for errors.
ATTITUDE_COLUMNS = tuple(f"{name}_deg" for name in AIRCRAFT[ATTITUDE])


def over_ground(velocity: FloatArray, down: FloatArray | None) -> FloatArray:
    """Return velocities (n, 3) without the part along down (n, 3), None if that is (0, 0, 1)."""
    if down is None:
        return velocity * [1.0, 1.0, 0.0]
    return velocity - np.sum(velocity * down, axis=-1, keepdims=True) * down


def velocity_on_legs(
    time: FloatArray, position: FloatArray, down: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return velocities over ground (n − 1, 3), and rates of climb (n − 1,), from row to row."""
    velocity = np.diff(position, axis=0) / np.diff(time)[:, np.newaxis]
    level = over_ground(velocity, None if down is None else down[:-1])
    return level, np.linalg.norm(velocity - level, axis=1)


def hovering(time: FloatArray, position: FloatArray, down: FloatArray | None) -> NDArray[np.bool_]:
    """Return whether the aircraft hovers (n − 1,) from row to row."""
    level, _ = velocity_on_legs(time, position, down)
    return np.linalg.norm(level, axis=1) < HOVER


def largest_climb(
    time: FloatArray, position: FloatArray, ground: FloatArray, down: FloatArray | None
) -> FloatArray:
    """Return the largest rate of climb (n,) at rows with a speed over ground (n,).

    Without a limit the nose would point straight up where an aircraft that climbs stops over ground
    or turns back. A row between two legs on which it hovers has none.
    """
    level, climb = velocity_on_legs(time, position, down)
    speed = np.linalg.norm(level, axis=1)
    moves = speed >= HOVER
    slope = np.divide(climb, speed, out=np.zeros_like(climb), where=moves)
    moves, steepest = (
        np.maximum(np.append(of[0], of), np.append(of, of[-1])) for of in (moves, slope)
    )
    steepest[[0, -1]] = steepest[[1, -2]]  # a climb may begin and end on the outermost legs
    return np.where(moves, STEEPER * steepest * ground, np.inf)


def attitude_from_motion(
    source: str,
    velocity: FloatArray,
    acceleration: FloatArray,
    hovers: NDArray[np.bool_],
    turn: FloatArray | None = None,
) -> FloatArray:
    """Return the attitude (n, 3) [rad] of coordinated flight without wind or angle of attack.

    V_h is the horizontal speed. Yaw is the course χ = atan2(v_e, v_n). Pitch is the climb angle
    atan2(−v_d, V_h). Roll is the bank of a coordinated turn, tan φ = V_h χ̇ / g (R. W. Beard and T.
    W. McLain, *Small Unmanned Aircraft*, 2012, ch. 9, with χ = ψ). The acceleration to the right is
    V_h χ̇ = (v_n a_e − v_e a_n)/V_h.

    Where it hovers, yaw is the last known course, and the aircraft is level, also where it climbs.
    Before the first known course, yaw is the first known course. An aircraft that never moves
    horizontally is refused.

    Args:
        source: Name of the track in errors.
        velocity: North, east, down (n, 3) [m/s], in the order of time.
        acceleration: North, east, down (n, 3) [m/s²].
        hovers: Whether the aircraft hovers (n,).
        turn: Matrices (n, 3, 3) from level at the aircraft to the frame of the motion, in which the
            attitude is returned; None if level is the same everywhere.
    """
    if turn is not None:
        level = [np.einsum("...ij,...i->...j", turn, of) for of in (velocity, acceleration)]
        attitude = attitude_from_motion(source, level[0], level[1], hovers)
        return geodesy.turned_attitude(attitude, turn)
    north, east, down = (velocity[:, i] for i in range(3))
    speed = np.hypot(north, east)
    moves = ~hovers & (speed > _NO_SPEED)
    if not moves.any():
        raise InputError(
            f"{source}: the aircraft never moves horizontally at {HOVER:g} m/s or more, attitude "
            f"cannot be derived from the track; give the columns {', '.join(ATTITUDE_COLUMNS)}"
        )
    known = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), -1))
    first = int(np.argmax(moves))
    if first and speed[first - 1] > _NO_SPEED:  # the course at the end of a hover, as it departs
        first -= 1
    known[known < 0] = first
    yaw = np.arctan2(east, north)[known]
    pitch = np.where(moves, np.arctan2(-down, speed), 0.0)
    acceleration_right = north * acceleration[:, 1] - east * acceleration[:, 0]
    roll = np.arctan(acceleration_right / (gravity * np.where(moves, speed, np.inf)))
    return np.stack([roll, pitch, yaw], axis=-1)


def motion_of_samples(
    time: FloatArray, position: FloatArray, down: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return velocity [m/s] and acceleration [m/s²] (n, 3) of sampled positions.

    The velocity at a sample is the derivative of the parabola through the sample and its two
    neighbours. Twice the second divided difference of three samples is the acceleration at the mean
    of their times. The acceleration is extrapolated linearly to the time of the sample. Velocity
    and acceleration have errors of second order in the time step, whether steps are equal or not.
    At the ends the nearest parabola and line are continued. Where the velocity over ground is
    against the step that leads to a sample, it is that of the step. A climb is within
    `largest_climb`.

    Positions rounded to δ make the acceleration wrong by some 2δ/h² at steps h. Samples that are
    close in time need positions with many digits.

    Args:
        time: (n,) [s], strictly increasing, n ≥ 3.
        position: North, east, down (n, 3) [m].
        down: Down at the samples (n, 3); None if it is the same everywhere.
    """
    velocity = np.gradient(position, time, axis=0, edge_order=2)
    slope = np.diff(position, axis=0) / np.diff(time)[:, np.newaxis]
    leading = np.vstack([slope[:1], slope])
    against = np.sum(over_ground(velocity, down) * leading, axis=1) < 0
    velocity[against] = leading[against]
    level = over_ground(velocity, down)
    climb = np.linalg.norm(velocity - level, axis=1)
    most = largest_climb(time, position, np.linalg.norm(level, axis=1), down)
    part = np.divide(most, climb, out=np.ones_like(climb), where=climb > most)
    velocity = level + part[:, np.newaxis] * (velocity - level)
    second = 2.0 * np.diff(slope, axis=0) / (time[2:] - time[:-2])[:, np.newaxis]
    if len(second) == 1:
        return velocity, np.repeat(second, 3, axis=0)
    step = np.diff(time)
    offset = (step[1:] - step[:-1]) / 3.0  # from the middle of three times to their mean
    spacing = (step[:-2] + step[1:-1] + step[2:]) / 3.0  # from one mean of three to the next
    slope = np.diff(second, axis=0) / spacing[:, np.newaxis]
    # Second difference i belongs to row i + 1. If the mean time of difference i is later than this
    # row, the line goes through differences i − 1 and i. Otherwise the line goes through
    # differences i and i + 1.
    rows = np.arange(len(second))
    line = np.clip(np.where(offset > 0, rows - 1, rows), 0, len(slope) - 1)
    inner = second - offset[:, np.newaxis] * slope[line]
    first = second[0] - (step[0] + offset[0]) * slope[0]
    last = second[-1] + (step[-1] - offset[-1]) * slope[-1]
    return velocity, np.concatenate([first[np.newaxis], inner, last[np.newaxis]])


def covariance_in_frame(
    covariance: FloatArray, time: FloatArray, aircraft: FloatArray, origin: tuple[float, ...]
) -> FloatArray:
    """Return C_aa of each pose (n, 6, 6) in the frame of an origin.

    An error of position turns level too, by 0.001° for 100 m. This turn is neglected. A nose that
    points straight up or down in the frame is refused: roll and yaw have no covariance there.

    Args:
        covariance: C_aa (6, 6) or (n, 6, 6), relative to north, east and down at the aircraft.
        time: Time of each pose (n,) [s], for errors.
        aircraft: States (n, 6) in the frame of the origin.
        origin: The origin, see `geodesy`.
    """
    found = np.array(np.broadcast_to(covariance, (len(time), *covariance.shape[-2:])))
    for block, jacobian in _jacobians(found, time, aircraft, origin):
        turned = jacobian @ found[block] @ np.swapaxes(jacobian, -1, -2)
        turned = 0.5 * (turned + np.swapaxes(turned, -1, -2))
        # A variance of 0 may round to a negative number.
        certain = np.diagonal(turned, axis1=-2, axis2=-1) <= 0
        turned[certain[:, :, np.newaxis] | certain[:, np.newaxis, :]] = 0.0
        found[block] = turned
    return without_rounding(found)


def square_root_in_frame(
    covariance: FloatArray, time: FloatArray, aircraft: FloatArray, origin: tuple[float, ...]
) -> FloatArray:
    """Return F (n, 6, 6) with F Fᵀ = C_aa in the frame of an origin, continuous from pose to pose.

    F is the symmetric square root of the covariance at the aircraft, turned into the frame. Errors
    that are correlated from pose to pose are then the same errors about any origin. The arguments
    are as of `covariance_in_frame`.
    """
    covariance = np.broadcast_to(covariance, (len(time), *covariance.shape[-2:]))
    root = symmetric_square_root(covariance)
    for block, jacobian in _jacobians(covariance, time, aircraft, origin):
        root[block] = jacobian @ root[block]
    return root


def _jacobians(
    covariance: FloatArray, time: FloatArray, aircraft: FloatArray, origin: tuple[float, ...]
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield blocks of poses, and the partials (k, 6, 6) of the aircraft state by that at level.

    The states are in the frame of the origin, and relative to north, east and down at the aircraft.
    The partials of an attitude without errors are 0.
    """
    for block in slices(len(aircraft)):
        turn = geodesy.turn_from_level(aircraft[block, POSITION], origin)
        attitude = aircraft[block, ATTITUDE]
        uncertain = np.any(covariance[block, ATTITUDE, ATTITUDE] != 0, axis=(-2, -1))
        steep = uncertain & (np.abs(attitude[:, 1]) > np.pi / 2 - _STEEP)
        if steep.any():
            raise InputError(
                f"at time_s {float(time[block][steep][0])!r} the aircraft's nose points straight "
                "up or down, where roll and yaw have no covariance; another origin may help"
            )
        jacobian = np.zeros((len(turn), 6, 6))
        jacobian[:, POSITION, POSITION] = turn
        # The Jacobian is infinite at a pitch of ±90°. A certain attitude does not need it.
        level = geodesy.turned_attitude(attitude[uncertain], np.swapaxes(turn[uncertain], -1, -2))
        jacobian[uncertain, ATTITUDE, ATTITUDE] = geodesy.turned_attitude_jacobian(
            level, attitude[uncertain]
        )
        yield block, jacobian
