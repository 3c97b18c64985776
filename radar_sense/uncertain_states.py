"""The problem of propagation: nominal states of poses, their covariances, and the radars.

A state is uncertain by a Gaussian error, with these exceptions:

- c_r with tolerances is its nominal value times independent random factors, one for each
  tolerance. Methods that need one factor take c_r as log-normal with the same σ to first order.
  Radars of one type may share a factor.
- c_r below 0 counts as 0.

Unit normals u of all states are 6 of the aircraft, then those of the radars (columns of F with
F Fᵀ = C_rr that are not 0), then one for each tolerance.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.covariance import (
    block_square_root,
    checked,
    draws,
    square_root,
    without_components,
)
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel, as_network
from radar_sense.model.radar import ALWAYS, NEVER, Vicinity
from radar_sense.model.radar_constant import ErrorKey, Tolerance, factors
from radar_sense.states import (
    AIRCRAFT,
    CONSTANT,
    POSITION,
    RADAR_AND_ERRORS,
    FloatArray,
    checked_states,
    common_shape,
    component,
    of_radar,
    slices,
    with_errors,
)

#: Numbers in the largest array of a block of poses, which bounds memory (16 MB).
MAX_NUMBERS = 2_000_000
#: Standard deviations of a position within which a limit is in reach. An error in three dimensions
#: is larger with a probability of 1e-13: what is left out by this is less than the rounding of P_D.
REACH = 8.0
#: Most poses in a block. More poses save time in Python, and arrays of differences have 1 MB here.
BLOCK = 2048


@dataclass(frozen=True, eq=False)
class UncertainStates:
    """Nominal states of k poses, their covariances, and the detection model.

    A covariance that is the same at all poses may have one row instead of k. `uncertain_states` and
    `Scenario.states` make and check them.

    Attributes:
        model: The network of m radars, or of one.
        aircraft: Nominal aircraft states (k, 6).
        radar: Nominal radar states (k, 7m).
        cov_aircraft: C_aa (k, 6, 6).
        cov_radar: C_rr (k, 7m, 7m), with a c_r with tolerances to first order.
        tolerances: Tolerances that make the c_r of each radar (m,) uncertain; () for a Gaussian
            c_r.
        seed: Seed of draws of these states.
        runs: Draws at each pose of the method `montecarlo`.
    """

    model: NetworkModel
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: FloatArray
    tolerances: tuple[tuple[Tolerance, ...], ...]
    seed: int = 1
    runs: int = 500

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.aircraft)

    @property
    def certain(self) -> bool:
        """Whether there are no errors at any pose."""
        return not (self.cov_aircraft.any() or self.cov_radar.any())

    def of_uncertain_radars(self) -> tuple[UncertainStates, FloatArray]:
        """Return the states of the radars whose P_D is uncertain, and P_D (k,) by the others."""
        m = len(self.model.radars)
        own = [i for i in range(m) if self.cov_radar[:, of_radar(i), of_radar(i)].any()]
        if self.cov_aircraft.any() or len(own) in (0, m):
            return self, np.zeros(len(self))
        others = self.of_radars([i for i in range(m) if i not in own])
        return self.of_radars(own), others.model.unchecked_p_d(others.aircraft, others.radar)

    @cached_property
    def log_constants(self) -> NDArray[np.intp]:
        """Where radar states (7m,) have a c_r with tolerances: c_r = c̄_r exp(Δ/c̄_r), Δ of C_rr."""
        which = np.flatnonzero([bool(tolerances) for tolerances in self.tolerances])
        return len(RADAR_AND_ERRORS) * which + CONSTANT

    @cached_property
    def columns(self) -> NDArray[np.intp]:
        """Columns (r,) of F that may differ from 0, at all poses of which these are a part."""
        if len(self.cov_radar) == 1:
            return np.flatnonzero(self._root.any(axis=(0, 1)))
        uncertain = np.any(np.diagonal(self.cov_radar, axis1=1, axis2=2), axis=0)
        uncertain[self.log_constants] = False
        return np.flatnonzero(uncertain)

    def blocks(self, numbers: int) -> Iterator[UncertainStates]:
        """Yield blocks of poses for an algorithm that needs this many numbers a pose."""
        return self.cut(max(1, min(BLOCK, MAX_NUMBERS // numbers)))

    def cut(self, size: int) -> Iterator[UncertainStates]:
        """Yield parts with at most this number of poses, one part if there are no poses."""
        if len(self) <= size:
            yield self
            return
        yield from map(self.at, slices(len(self), size))

    def at(self, rows: NDArray[np.intp] | slice) -> UncertainStates:
        """Return the states of some poses."""

        def some(array: FloatArray) -> FloatArray:
            return array if len(array) == 1 < len(self) else array[rows]

        part = replace(
            self,
            aircraft=self.aircraft[rows],
            radar=self.radar[rows],
            cov_aircraft=some(self.cov_aircraft),
            cov_radar=some(self.cov_radar),
        )
        roots = ("sqrt_cov_aircraft", "sqrt_cov_radar")
        known = {name: some(vars(self)[name]) for name in roots if name in vars(self)}
        vars(part).update(known, columns=self.columns)
        return part

    def with_covariances(
        self,
        cov_aircraft: FloatArray,
        cov_radar: FloatArray,
        tolerances: Sequence[Sequence[Tolerance]],
    ) -> UncertainStates:
        """Return the states with other covariances (n, n) or (k, n, n), and other tolerances.

        The variances of a c_r with tolerances follow from these, whatever C_rr has.
        """
        aircraft, radar = (c[np.newaxis] if c.ndim == 2 else c for c in (cov_aircraft, cov_radar))
        by_radar = tuple(map(tuple, tolerances))
        changed = replace(self, cov_aircraft=aircraft, cov_radar=radar, tolerances=by_radar)
        return changed._with_tolerances() if any(by_radar) and len(self) else changed

    def _with_tolerances(self) -> UncertainStates:
        """Return the states with every c_r that has tolerances to first order in C_rr.

        Two c_r are correlated by the tolerances that they share.
        """
        which, numbers = self.log_constants, self.tolerance_normals
        slopes = np.zeros((len(numbers), 1 + max(itertools.chain(*numbers))))
        for i, own in enumerate(self.tolerances):
            slopes[i, numbers[i]] = [t.slope for t in own]
        of_constants = self.radar[0, which, np.newaxis] * slopes[which // len(RADAR_AND_ERRORS)]
        covariance = without_components(self.cov_radar, which)
        covariance[:, which[:, np.newaxis], which] = of_constants @ of_constants.T
        return replace(self, cov_radar=covariance)

    def of_radars(
        self, numbers: Sequence[int], model: NetworkModel | None = None
    ) -> UncertainStates:
        """Return the states of some radars alone, with a model of them that is known to hold."""
        own = np.concatenate([np.arange(of_radar(i).start, of_radar(i).stop) for i in numbers])
        return replace(
            self,
            model=model or NetworkModel(tuple(self.model.radars[i] for i in numbers)),
            radar=self.radar[:, own],
            cov_radar=self.cov_radar[:, own[:, np.newaxis], own],
            tolerances=tuple(self.tolerances[i] for i in numbers),
        )

    def sight(self, reach: float = REACH) -> NDArray[np.int8]:
        """Return whether radars (k, m) see the aircraft at errors of positions within `reach` σ."""
        aircraft = Vicinity(self.aircraft, self.cov_aircraft[:, POSITION, POSITION], reach)
        alike = len(self.cov_radar) == 1 and np.array_equal(self.radar[1:], self.radar[:-1])
        rows, found = slice(1 if alike else None), []
        for i, radar in enumerate(self.model.radars):
            position = of_radar(i, POSITION)
            own = self.radar[rows, of_radar(i)], self.cov_radar[:, position, position]
            found.append(radar.sight(aircraft, Vicinity(*own, reach)))
        return np.stack(found, axis=-1)

    def by_sight(
        self, sight: NDArray[np.int8] | None = None
    ) -> Iterator[tuple[NDArray[np.intp], UncertainStates]]:
        """Yield poses (j,), and their states with the radars that may see the aircraft alone.

        Poses that no radar may see are left out, and so is a limit of a radar that always sees.
        What a pose has depends on this pose alone. The default sight (k, m) is `sight`.
        """
        given = self.sight() if sight is None else sight
        kinds, which = np.unique(given, axis=0, return_inverse=True)
        for i, kind in enumerate(kinds):
            if np.any(kind != NEVER):
                rows = np.flatnonzero(which.ravel() == i)
                yield rows, self.at(rows).of_radars(*in_sight(self.model, kind))

    @cached_property
    def tolerance_normals(self) -> list[list[int]]:
        """Unit normals of the tolerances of each radar (m,), counted after the columns of F.

        Radars that share a tolerance have one number of it.
        """
        numbers: dict[ErrorKey, int] = {}
        return [
            [numbers.setdefault(t.error_key(i), len(numbers)) for t in own]
            for i, own in enumerate(self.tolerances)
        ]

    @property
    def radar_normals(self) -> int:
        """Number of unit normals of the radar states."""
        numbers = itertools.chain(*self.tolerance_normals)
        return len(self.columns) + len(set(numbers))

    @property
    def normals(self) -> int:
        """Number d of unit normals of all states at a pose."""
        return len(AIRCRAFT) + self.radar_normals

    @cached_property
    def sqrt_cov_aircraft(self) -> FloatArray:
        """F (k, 6, 6) with F Fᵀ = C_aa."""
        return square_root(self.cov_aircraft)

    @cached_property
    def sqrt_cov_radar(self) -> FloatArray:
        """F (k, 7m, r) with F Fᵀ = C_rr but for every c_r with tolerances."""
        return self._root[:, :, self.columns]

    @cached_property
    def _root(self) -> FloatArray:
        """F (k, 7m, 7m) with F Fᵀ = C_rr but for every c_r with tolerances, which has 0."""
        certain = without_components(self.cov_radar, self.log_constants)
        return np.stack([block_square_root(matrix) for matrix in certain])

    def at_normals(self, u: FloatArray, rows: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Return aircraft states (k, n, 6) and radar states (k, n, 7m) at unit normals (k, d, n).

        The unit normals are of k of the poses, the rows.
        """
        normals, first = u.swapaxes(1, 2), len(AIRCRAFT)
        of_aircraft, of_radar = (
            (root if len(root) == 1 else root[rows])[:, np.newaxis]
            for root in (self.sqrt_cov_aircraft, self.sqrt_cov_radar)
        )
        nominal = self.aircraft[rows, np.newaxis], self.radar[rows, np.newaxis]
        aircraft = draws(nominal[0], of_aircraft, normals[..., :first])
        return aircraft, self._radars(nominal[1], of_radar, normals[..., first:])

    def radars_at(self, normals: FloatArray) -> FloatArray:
        """Return radar states (n, 7m) at unit normals (n, d − 6), for radars alike at all poses."""
        return self._radars(self.radar[0], self.sqrt_cov_radar[0], normals)

    def _radars(self, nominal: FloatArray, sqrt_cov: FloatArray, normals: FloatArray) -> FloatArray:
        """Return radar states (..., 7m) at unit normals (..., d − 6)."""
        first = len(self.columns)
        radar = draws(nominal, sqrt_cov, normals[..., :first])
        constants = radar[..., component(CONSTANT, len(self.tolerances))]  # a view
        for i, tolerances in enumerate(self.tolerances):
            if tolerances:
                own = normals[..., [first + number for number in self.tolerance_normals[i]]]
                constants[..., i] *= factors(tolerances, own)
        np.maximum(constants, 0.0, out=constants)
        return radar

    def by_normals(
        self, by_aircraft: FloatArray, by_radar: FloatArray, radar: FloatArray
    ) -> FloatArray:
        """Return the gradient (k, d) of a function of the states by unit normals.

        The function has a gradient by the aircraft (k, 6), and one by radar states (k, 7m).
        """
        first = len(AIRCRAFT)
        last = first + len(self.columns)
        gradient = np.zeros((len(self), self.normals))
        gradient[:, :first] = (by_aircraft[:, np.newaxis] @ self.sqrt_cov_aircraft)[:, 0]
        gradient[:, first:last] = (by_radar[:, np.newaxis] @ self.sqrt_cov_radar)[:, 0]
        by_log = (by_radar * radar)[:, component(CONSTANT, len(self.tolerances))]
        for i, tolerances in enumerate(self.tolerances):
            for tolerance, number in zip(tolerances, self.tolerance_normals[i], strict=True):
                gradient[:, last + number] += by_log[:, i] * tolerance.slope
        return gradient


def in_sight(model: NetworkModel, sight: NDArray[np.int8]) -> tuple[list[int], NetworkModel]:
    """Return which radars may see the aircraft, by the `Radar.sight` of each, and their network."""
    numbers = np.flatnonzero(sight != NEVER).tolist()
    radars = [model.radars[i] for i in numbers]
    of_each = zip(radars, sight[numbers], strict=True)
    seen = tuple(r.without_limits() if s == ALWAYS else r for r, s in of_each)
    return numbers, replace(model, radars=seen)


def uncertain_states(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
) -> tuple[tuple[int, ...], UncertainStates]:
    """Return the shape (...) of all poses, and their states along one axis, checked.

    States (..., n) and covariances (..., n, n) broadcast against each other. Radar states have 4m
    or 7m components.
    """
    model = as_network(model)
    m = len(model.radars)
    x_a, x_r = checked_states(aircraft, radar, m)
    c_aa = checked("aircraft", cov_aircraft, x_a.shape[-1])
    c_rr = checked("radar", cov_radar, x_r.shape[-1])
    x_r, c_rr = with_errors(x_r, m), with_errors(c_rr, m, 2)
    shape = common_shape(x_a.shape[:-1], x_r.shape[:-1], c_aa.shape[:-2], c_rr.shape[:-2])

    def rows(array: FloatArray, axes: int) -> FloatArray:
        """Return a row for each pose."""
        tail = array.shape[-axes:]
        return np.broadcast_to(array, shape + tail).reshape(-1, *tail)

    of_aircraft, of_radar = (
        c.reshape(-1, *c.shape[-2:]) if math.prod(c.shape[:-2]) == 1 else rows(c, 2)
        for c in (c_aa, c_rr)
    )
    x_a, x_r = rows(x_a, 1), rows(x_r, 1)
    return shape, UncertainStates(model, x_a, x_r, of_aircraft, of_radar, ((),) * m)
