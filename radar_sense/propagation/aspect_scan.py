"""Lobes of the RCS within reach of the states, each with an extreme of z.

A search from the nominal states finds the extreme of one lobe only. An RCS depends on aspect alone,
and aspect has two dimensions. A scan of the aspects within reach of the states finds the other
lobes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radar_sense.model.geometry import body_vector
from radar_sense.propagation.relative_probit import RelativeProbit
from radar_sense.states import RADAR, FloatArray

#: Rings of the scan, as fractions of the radius, and directions on each ring.
RINGS = (1 / 3, 2 / 3, 1.0)
DIRECTIONS = 8


class AspectScan(NamedTuple):
    """z at the scanned points of u-space: s points at each of k poses.

    Attributes:
        u: Points (r, s, k).
        value: z (s, k).
        best: u (r, s, k) of the greatest z in the ball, extrapolated linearly from the point.
        promise: Extrapolated z (s, k) at `best`.
        worst: u (r, s, k) of the least z in the ball, extrapolated linearly from the point.
        threat: Extrapolated z (s, k) at `worst`.
    """

    u: FloatArray
    value: FloatArray
    best: FloatArray
    promise: FloatArray
    worst: FloatArray
    threat: FloatArray


def scan_aspects(probit: RelativeProbit, sqrt_cov: FloatArray, radius: float) -> AspectScan:
    """Return z at aspects of every radar within a ball |u| ≤ radius.

    Range and radar constant are extrapolated linearly. From each point a step goes to the surface
    of the ball. The step is along the part of the gradient that is perpendicular to the axes of
    aspect.

    Args:
        probit: z as a function of the relative states, of k poses.
        sqrt_cov: F (k, n, r).
        radius: Radius of the ball.
    """
    k, _, r = sqrt_cov.shape
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    disc = np.array([(p * np.cos(a), p * np.sin(a)) for p in RINGS for a in angles])
    points, axes = [], []
    for i in range(len(probit.states.log_constant)):
        axes_of_radar = _aspect_axes(probit, sqrt_cov, i)  # (k, 2, r)
        points.append(radius * np.einsum("sa,kar->rsk", disc, axes_of_radar))
        axes.append(
            np.broadcast_to(
                axes_of_radar.transpose(1, 2, 0)[:, :, np.newaxis], (2, r, len(disc), k)
            )
        )
    u, across = np.concatenate(points, axis=1), np.concatenate(axes, axis=2)
    pose = np.tile(np.arange(k), u.shape[1])
    error = np.einsum("kij,jsk->isk", sqrt_cov, u)
    value, by_y = probit(error.reshape(len(error), len(pose)), pose)
    value, by_y = value.reshape(u.shape[1:]), by_y.reshape(error.shape)
    slope = np.einsum("kij,isk->jsk", sqrt_cov, by_y)
    for axis in across:
        slope -= axis * np.sum(axis * slope, axis=0)
    steep = np.sqrt(np.sum(slope * slope, axis=0))
    remaining = np.sqrt(np.maximum(radius**2 - np.sum(u * u, axis=0), 0.0))
    step = slope * (remaining / np.where(steep > 0, steep, 1.0))
    return AspectScan(
        u, value, u + step, value + steep * remaining, u - step, value - steep * remaining
    )


def _aspect_axes(probit: RelativeProbit, sqrt_cov: FloatArray, radar: int) -> FloatArray:
    """Return the unit vectors (k, 2, r) of u-space along which the aspect of a radar changes most.

    The vectors are 0 where the aspect does not change.
    """
    k, n, r = sqrt_cov.shape
    step = 0.1
    error = step * np.concatenate([sqrt_cov, -sqrt_cov], axis=2).transpose(1, 2, 0)  # (n, 2r, k)
    pose = np.tile(np.arange(k), 2 * r)
    aircraft, states, _ = probit.shifted(error.reshape(n, len(pose)), pose)
    components = slice(len(RADAR) * radar, len(RADAR) * (radar + 1))
    line = body_vector(aircraft, states[:, components])
    with np.errstate(invalid="ignore"):
        line = line / np.linalg.norm(line, axis=1, keepdims=True)
    ends = line.reshape(2, r, k, 3)
    jacobian = np.nan_to_num((ends[0] - ends[1]) / (2.0 * step)).transpose(1, 2, 0)  # (k, 3, r)
    _, vectors = np.linalg.eigh(jacobian @ jacobian.swapaxes(1, 2))
    axes: FloatArray = vectors[:, :, 1:].swapaxes(1, 2) @ jacobian
    length = np.linalg.norm(axes, axis=2, keepdims=True)
    axes /= np.where(length > 0, length, np.inf)
    return axes
