"""Where to draw: a mixture of densities of unit normals that is often in the tails of P_D.

The mixture (A. Owen and Y. Zhou, "Safe and effective importance sampling", J. Amer. Statist. Assoc.
95(449), 2000) has

- the natural density, N(0, 1) in every component. No weight can then exceed 1/NATURAL.
- a density for each radar that is wider in the few directions in which its signal depends on the
  errors: the line of sight in body axes, the gain, the tilt of an antenna, and heights where there
  is a horizon. It reaches lobes, limits and horizons.
- densities about centres that raise P_D: the greatest z of the network within β, the greatest z of
  each radar alone, the errors that bring the aircraft closest to each radar, or out of its minimum
  range, and those that raise both ends above a horizon, or the aircraft above a mask.
- densities about centres that lower P_D: the least z of the network, and the errors that lead out
  of sight, below a horizon or mask, beyond the maximum range or within the minimum range.

Centres and directions only choose where to draw. The weights, natural density over density of the
mixture, are exact for any choice.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from radar_sense.limits import MIN_RANGE
from radar_sense.model.geometry import Attitude, Vector, radar_from_aircraft, slant_range
from radar_sense.states import (
    AIRCRAFT,
    CONSTANT,
    DOWN,
    FACTOR_ERRORS,
    POSITION,
    RCS_ERROR,
    FloatArray,
    component,
    of_radar,
)
from radar_sense.uncertain_states import UncertainStates

#: Share of the draws from the natural density and from all wide densities, and the standard
#: deviation of a wide density. The errors of the bounds hardly depend on them: shares from 0.1 to
#: 0.5 and widths from 1.6 to 3 were tried on 400 random poses of four populations.
NATURAL, WIDE, WIDTH = 0.2, 0.3, 2.0
#: Share of the draws about centres that lower P_D, of those about any centre. And what a change of
#: P_D counts at least, as a part of the greatest: a lobe or limit beside a centre may change more.
FALLING, LEAST_PART = 0.25, 0.1
#: Most steps to an extreme, and how near it is near enough, in standard deviations.
STEPS, NEAR = 6, 0.05
#: Least c_r on the way to an extreme, as a part of its nominal value.
LEAST_CONSTANT = 1e-3
#: Step of a difference, as a part of the range.
DIFFERENCE = 1e-4
#: Largest ln of a ratio of densities: the exponential of more overflows. A draw with this ratio has
#: a weight of 1e-308, and counts for nothing.
MOST = math.log(sys.float_info.max)
#: A direction counts if its singular value is above this part of the largest.
INDEPENDENT = 1e-6

#: From states, of the aircraft (k, 6) and of the radars (k, 7m), to the gradient by both.
Gradient: TypeAlias = Callable[
    [UncertainStates, FloatArray, FloatArray], tuple[FloatArray, FloatArray]
]


@dataclass(frozen=True, eq=False)
class Mixture:
    """A mixture of densities of d unit normals at k poses.

    Attributes:
        bases: Orthonormal directions (k, d, q) of each wide density, 0 where they are fewer.
        centres: Centres (k, c, d) of the other densities, those that raise P_D first.
        shares: Share of each centre of the draws about centres (k, c).
        falling: Number of the first centre that lowers P_D.
    """

    bases: tuple[FloatArray, ...]
    centres: FloatArray
    shares: FloatArray
    falling: int

    @classmethod
    def of(cls, states: UncertainStates, beta: float) -> Mixture:
        """Return the mixture for the tails at Φ(−β) and Φ(β)."""
        bases = tuple(_directions(states, i) for i in range(len(states.model.radars)))
        rising, falling = _centres(states, beta)
        centres = np.stack([*rising, *falling], axis=1)
        return cls(bases, centres, _shares(states, centres, len(rising)), len(rising))

    def with_falling(self, other: Mixture) -> Mixture:
        """Return the mixture with the centres of another that lower P_D, which has as many."""
        centres, shares = (
            np.concatenate([own[:, : self.falling], of_other[:, self.falling :]], axis=1)
            for own, of_other in ((self.centres, other.centres), (self.shares, other.shares))
        )
        return replace(self, centres=centres, shares=shares)

    def at(self, rows: slice) -> Mixture:
        """Return the mixture at some poses."""
        bases = tuple(basis[rows] for basis in self.bases)
        return replace(self, bases=bases, centres=self.centres[rows], shares=self.shares[rows])

    def draw(self, normals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return unit normals u (k, d, n) of the mixture, and their weights (k, n).

        Also returned is how far they are towards the first centre that raises P_D and the first
        that lowers it (2, k, n): a unit normal each, 0 where the centre is 0. The independent unit
        normals (d, n) are the same at all poses.
        """
        n = normals.shape[1]
        wide, central = int(WIDE * n / len(self.bases)), int((1.0 - NATURAL - WIDE) * n)
        natural = n - central - wide * len(self.bases)
        u = np.repeat(normals[np.newaxis], len(self.centres), axis=0)
        end = natural
        for basis in self.bases:
            start, end = end, end + wide
            own = u[:, :, start:end]
            own += (WIDTH - 1.0) * (basis @ (basis.swapaxes(1, 2) @ own))
        places = (np.arange(central) + 0.5) / central
        ends = np.cumsum(self.shares, axis=1)[:, :-1, np.newaxis]
        which = np.count_nonzero(ends <= places, axis=1)[:, np.newaxis]
        chosen = (which == np.arange(self.centres.shape[1])[:, np.newaxis]).astype(float)
        u[:, :, end:] += self.centres.swapaxes(1, 2) @ chosen
        density, towards = self._density(u, natural / n, wide / n, np.sum(chosen, axis=2) / n)
        return u, 1.0 / density, towards

    def _density(
        self, u: FloatArray, natural: float, wide: float, central: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the density of the mixture over the natural density (k, n) at u (k, d, n).

        The shares of the draws are those from the natural density, from each wide density, and
        about each centre (k, c). How far u are towards two centres is returned too, see `draw`.
        """
        density = np.full((len(u), u.shape[2]), natural)
        for basis in self.bases:
            along = basis.swapaxes(1, 2) @ u
            q = np.count_nonzero(basis.any(axis=1), axis=-1)[:, np.newaxis]
            exponent = 0.5 * (1.0 - WIDTH**-2) * np.einsum("kqn,kqn->kn", along, along)
            density += wide * np.exp(np.minimum(exponent - q * np.log(WIDTH), MOST))
        exponents = self.centres @ u
        squares = np.sum(self.centres**2, axis=-1)[..., np.newaxis]
        towards = np.zeros((2, *density.shape))
        for side, first in zip(towards, (0, self.falling), strict=True):
            length = np.sqrt(squares[:, first])
            np.divide(exponents[:, first], length, out=side, where=length > 0)
        exponents -= 0.5 * squares
        np.minimum(exponents, MOST, out=exponents)
        np.exp(exponents, out=exponents)
        density += np.einsum("kc,kcn->kn", central, exponents)
        return density, towards


def _centres(states: UncertainStates, beta: float) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the centres (k, d) that raise P_D, and those that lower it."""
    both = (beta, -beta)
    greatest, least = _extremes(states, both, _of_network)
    rising, falling = [greatest], [least]
    for i, radar in enumerate(states.model.radars):
        if len(states.model.radars) > 1:
            rising += _extremes(states, (beta,), partial(_of_radar, number=i))
        rising.append(_approach(states, beta, i))
        if radar.min_range > 0:
            falling.append(rising[-1])
            rising.append(_approach(states, -beta, i))
        if radar.max_range < math.inf:
            falling.append(_approach(states, -beta, i))
        for limit, gradient in ((radar.horizon, _of_horizon), (radar.mask, _of_mask)):
            if limit is not None:
                above, below = _extremes(states, both, partial(gradient, number=i))
                rising.append(above)
                falling.append(below)
    return rising, falling


def _shares(states: UncertainStates, centres: FloatArray, falling: int) -> FloatArray:
    """Return the share (k, c) of each centre (k, c, d) of the draws about centres, see `Mixture`.

    The tails of P_D are about the centres with the greatest and the least P_D.
    """
    nominal = np.zeros_like(centres[:, :1])
    points = np.concatenate([nominal, centres], axis=1).swapaxes(1, 2)
    p_d = states.model.unchecked_p_d(*states.at_normals(points))
    shares = []
    for change, share in (
        (p_d[:, 1 : 1 + falling], 1.0 - FALLING),
        (p_d[:, :1] - p_d[:, 1 + falling :], FALLING),
    ):
        most = np.max(change, axis=1, keepdims=True)
        part = np.divide(change, most, out=np.ones_like(change), where=most > 0)
        part = np.maximum(part, LEAST_PART)
        shares.append(share * part / np.sum(part, axis=1, keepdims=True))
    return np.concatenate(shares, axis=1)


def _extremes(
    states: UncertainStates, betas: Sequence[float], gradient: Gradient
) -> list[FloatArray]:
    """Return u (k, d) for each β, near the greatest z within |u| ≤ β, or near the least within −β.

    Each step goes to β times the unit vector of the gradient (R. Rackwitz and B. Fiessler,
    Computers & Structures 9(5), 1978), half of the way after the first step. A search is done when
    a step is shorter than `NEAR`.
    """
    k, which = len(states), component(CONSTANT, len(states.tolerances))
    beta, found = np.repeat(betas, k)[:, np.newaxis], np.zeros((len(betas) * k, states.normals))
    rows = np.arange(len(found))
    for step in range(STEPS):
        u, some = found[rows], states.at(rows % k)
        aircraft, radar = (x[:, 0] for x in some.at_normals(u[:, :, np.newaxis]))
        constants, nominal = radar[:, which], some.radar[:, which]
        np.maximum(constants, LEAST_CONSTANT * nominal, out=constants)
        by_u = some.by_normals(*gradient(some, aircraft, radar), radar)
        length = np.sqrt(np.sum(by_u * by_u, axis=1, keepdims=True))
        with np.errstate(divide="ignore", invalid="ignore"):
            new = beta[rows] * by_u / length
            if step:
                new += u
                new *= abs(beta[rows]) / np.sqrt(np.sum(new * new, axis=1, keepdims=True))
        new = np.where(np.isfinite(new), new, u)
        found[rows] = new
        rows = rows[np.sum((new - u) ** 2, axis=1) > NEAR**2]
        if not rows.size:
            break
    return np.split(found, len(betas))


def _of_network(
    states: UncertainStates, aircraft: FloatArray, radar: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient of the fused z by the states, of all radars where none sees."""
    visible = states.model.visible(aircraft, radar)
    visible[~visible.any(axis=1)] = True
    return states.model.extrapolated_probit(aircraft, radar, visible)[1:]


def _of_radar(
    states: UncertainStates, aircraft: FloatArray, radar: FloatArray, number: int
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient of z of one radar by all states, without its limits."""
    own = of_radar(number)
    _, by_aircraft, of_own = states.model.models[number].unchecked_probit(aircraft, radar[:, own])
    return by_aircraft, _gradient(states, radar=(own, of_own))[1]


def _of_horizon(
    states: UncertainStates, aircraft: FloatArray, radar: FloatArray, number: int
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient of √h + √h', of the heights of the aircraft and of a radar.

    A height is `MIN_RANGE` at least, so that the gradient is finite.
    """
    horizon, own = states.model.radars[number].horizon, of_radar(number, POSITION)
    assert horizon is not None

    def by_down(position: FloatArray) -> FloatArray:
        return -0.5 / np.sqrt(np.maximum(horizon.height(position), MIN_RANGE))

    of_aircraft = DOWN, by_down(aircraft[:, POSITION])
    return _gradient(states, of_aircraft, (own.start + DOWN, by_down(radar[:, own])))


def _of_mask(
    states: UncertainStates, aircraft: FloatArray, radar: FloatArray, number: int
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient of the clearance above a mask, by central differences."""
    mask, position = states.model.radars[number].mask, of_radar(number, POSITION)
    assert mask is not None
    own, by_position = radar[:, position], np.empty((len(states), 3))
    step = DIFFERENCE * slant_range(aircraft, own)[:, np.newaxis]
    for i, axis in enumerate(np.eye(len(AIRCRAFT))[POSITION]):
        above, below = (mask.clearance(aircraft + s * axis, own) for s in (step, -step))
        by_position[:, i] = above - below
    return _gradient(states, (POSITION, by_position), (position, -by_position))


def _approach(states: UncertainStates, beta: float, number: int) -> FloatArray:
    """Return u (k, d) that brings aircraft and radar together, or as close as β allows.

    A negative β brings them apart.
    """
    position = of_radar(number, POSITION)
    way = states.radar[:, position] - states.aircraft[:, POSITION]
    distance = np.sqrt(np.sum(way * way, axis=1, keepdims=True))
    with np.errstate(divide="ignore", invalid="ignore"):
        gradient = _gradient(states, (POSITION, way / distance), (position, -way / distance))
        by_u = states.by_normals(*gradient, states.radar)
        std = np.sqrt(np.sum(by_u * by_u, axis=1, keepdims=True))
        centre = by_u / std * np.minimum(beta, distance / std)
    return np.nan_to_num(centre)


def _directions(states: UncertainStates, number: int) -> FloatArray:
    """Return orthonormal directions (k, d, q) of u in which the signal of a radar changes.

    The directions span the gradients of what the signal depends on, but for the direction of the
    line of sight in level axes where the aspect matters too: to add it lowers no error by 2 %.
    """
    radar, position = states.model.radars[number], of_radar(number, POSITION)
    line = radar_from_aircraft(states.aircraft, states.radar[:, position])
    distance = np.sqrt(line.x**2 + line.y**2 + line.z**2)
    with_lobes, without_lobes = (
        [FACTOR_ERRORS[f.parameter] for f in radar.model.factors if (f.detail < math.inf) == lobes]
        for lobes in (True, False)
    )
    if radar.model.rcs.isotropic:
        of_line = np.stack(line, axis=-1)[np.newaxis]  # the range is enough
        if with_lobes or radar.mask is not None:
            of_line = np.eye(3)[:, np.newaxis]
        gradients = [_gradient(states, (POSITION, -by), (position, by)) for by in of_line]
    else:
        gradients, attitude = [], Attitude.from_state(states.aircraft)
        body = attitude.to_body(line)
        for axis in np.eye(3):
            along = Vector(*(np.full(distance.shape, x) for x in axis))
            by_line, by_angles = (np.stack(by, axis=-1) for by in attitude.pull_back(body, along))
            of_aircraft = slice(None), np.hstack([-by_line, by_angles])
            gradients.append(_gradient(states, of_aircraft, (position, by_line)))
    of_gain = [position.start + at for at in (CONSTANT, RCS_ERROR, *without_lobes)]
    _, by_all = _of_radar(states, states.aircraft, states.radar, number)
    gradients.append(_gradient(states, radar=(of_gain, np.nan_to_num(by_all[:, of_gain]))))
    gradients += [_gradient(states, radar=(position.start + at, 1.0)) for at in with_lobes]
    if radar.horizon is not None:
        gradients.append(_gradient(states, (DOWN, 1.0)))
        gradients.append(_gradient(states, radar=(position.start + DOWN, 1.0)))
    by_u = [states.by_normals(*gradient, states.radar) for gradient in gradients]
    columns = np.nan_to_num(np.stack(by_u, axis=-1))
    length = np.sqrt(np.sum(columns**2, axis=1, keepdims=True))
    directions, size, _ = np.linalg.svd(
        columns / np.where(length > 0, length, 1.0), full_matrices=False
    )
    return np.where((size > INDEPENDENT * size[:, :1])[:, np.newaxis], directions, 0.0)


def _gradient(
    states: UncertainStates,
    aircraft: tuple[int | slice, FloatArray | float] = (0, 0.0),
    radar: tuple[int | slice | list[int], FloatArray | float] = (0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Return a gradient by the aircraft (k, 6) and by the radars (k, 7m).

    It is 0 but at some components of each, which are given with their values.
    """
    shapes = (len(states), len(AIRCRAFT)), (len(states), states.radar.shape[-1])
    gradient = np.zeros(shapes[0]), np.zeros(shapes[1])
    for by, (components, values) in zip(gradient, (aircraft, radar), strict=True):
        by[:, components] = values
    return gradient
