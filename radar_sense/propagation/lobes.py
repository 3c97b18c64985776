"""Lobes of the RCS within reach of the states, where an extreme of z may lie far from the nearest.

A search that starts at the nominal states finds the extreme of the lobe that it is in. Others can
only be seen from elsewhere. An RCS depends on aspect alone, which has two dimensions. The aspects
within reach of the states are scanned therefore.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radar_sense.model.geometry import body_vector
from radar_sense.propagation.standard_space import RelativeProbit
from radar_sense.states import RADAR, FloatArray

#: Rings of the scan, as parts of the radius, and directions on each of them.
RINGS = (1 / 3, 2 / 3, 1.0)
DIRECTIONS = 8


class Scan(NamedTuple):
    """z at the scanned points of u-space: s points at each of k poses.

    Attributes:
        u: Points (r, s, k).
        value: z (s, k).
        best: u (r, s, k) where z promises to be greatest in the ball, from the point on.
        promise: z (s, k) promised there.
        worst: u (r, s, k) where z promises to be least in the ball, from the point on.
        threat: z (s, k) promised there.
    """

    u: FloatArray
    value: FloatArray
    best: FloatArray
    promise: FloatArray
    worst: FloatArray
    threat: FloatArray


def scan(probit: RelativeProbit, root: FloatArray, radius: float) -> Scan:
    """Scan the aspects of every radar within a ball |u| ≤ radius.

    Range and radar constant are left to a linear step: what the radius allows beyond the point,
    along the gradient there and across the axes of aspect.

    Args:
        probit: z as a function of the relative states, of k poses.
        root: F (k, n, r).
        radius: Radius of the ball.
    """
    k, _, r = root.shape
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    disc = np.array([(p * np.cos(a), p * np.sin(a)) for p in RINGS for a in angles])
    points, axes = [], []
    for i in range(len(probit.states.log_constant)):
        pair = _aspect_axes(probit, root, i)  # (k, 2, r)
        points.append(radius * np.einsum("sa,kar->rsk", disc, pair))
        axes.append(
            np.broadcast_to(pair.transpose(1, 2, 0)[:, :, np.newaxis], (2, r, len(disc), k))
        )
    u, across = np.concatenate(points, axis=1), np.concatenate(axes, axis=2)
    pose = np.tile(np.arange(k), u.shape[1])
    error = np.einsum("kij,jsk->isk", root, u)
    value, by_y = probit(error.reshape(len(error), len(pose)), pose)
    value, by_y = value.reshape(u.shape[1:]), by_y.reshape(error.shape)
    slope = np.einsum("kij,isk->jsk", root, by_y)
    for axis in across:
        slope -= axis * np.sum(axis * slope, axis=0)
    steep = np.sqrt(np.sum(slope * slope, axis=0))
    left = np.sqrt(np.maximum(radius**2 - np.sum(u * u, axis=0), 0.0))
    step = slope * (left / np.where(steep > 0, steep, 1.0))
    return Scan(u, value, u + step, value + steep * left, u - step, value - steep * left)


def _aspect_axes(probit: RelativeProbit, root: FloatArray, radar: int) -> FloatArray:
    """Return the unit vectors (k, 2, r) of u-space along which the aspect of a radar changes most.

    Where the aspect does not change they are 0.
    """
    k, n, r = root.shape
    step = 0.1
    error = step * np.concatenate([root, -root], axis=2).transpose(1, 2, 0)  # (n, 2r, k)
    pose = np.tile(np.arange(k), 2 * r)
    aircraft, states, _ = probit.shifted(error.reshape(n, len(pose)), pose)
    own = slice(len(RADAR) * radar, len(RADAR) * (radar + 1))
    line = body_vector(aircraft, states[:, own])
    with np.errstate(invalid="ignore"):
        line = line / np.linalg.norm(line, axis=1, keepdims=True)
    ends = line.reshape(2, r, k, 3)
    jacobian = np.nan_to_num((ends[0] - ends[1]) / (2.0 * step)).transpose(1, 2, 0)  # (k, 3, r)
    _, vectors = np.linalg.eigh(jacobian @ jacobian.swapaxes(1, 2))
    axes: FloatArray = vectors[:, :, 1:].swapaxes(1, 2) @ jacobian
    length = np.linalg.norm(axes, axis=2, keepdims=True)
    axes /= np.where(length > 0, length, np.inf)
    return axes
