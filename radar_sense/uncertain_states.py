"""The problem of propagation: nominal states of poses, their covariances, and the radars.

A state is uncertain by a Gaussian error, with these exceptions:

- c_r with tolerances is its nominal value times independent random factors, one for each
  tolerance. Methods that need one factor take c_r as log-normal with the same σ to first order.
- c_r below 0 counts as 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.covariance import block_square_root, checked, draws, square_root
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel, as_network
from radar_sense.model.radar_constant import Tolerance, factors
from radar_sense.model.radar_equation import MOST_NEPERS
from radar_sense.states import (
    AIRCRAFT,
    CONSTANT,
    RADAR,
    FloatArray,
    check_finite,
    components_of,
    real_array,
)

#: Numbers in the largest array of a block of poses, which bounds memory (16 MB).
MAX_NUMBERS = 2_000_000
#: Most poses in a block. More poses save time in Python, and arrays of differences have 1 MB here.
BLOCK = 2048


@dataclass(frozen=True, eq=False)
class UncertainStates:
    """Nominal states of k poses, their covariances, and the detection model.

    An array with the same rows at all poses may have one row instead of k. `uncertain_states` and
    `Scenario.states` make and check them.

    Attributes:
        model: The detection model, of a radar or of a network of m.
        log_constant: Radars (m,) whose ln c_r is Gaussian: c_r = c̄_r exp(Δ/c̄_r), Δ of C_rr.
        aircraft: Nominal aircraft states (k, 6).
        radar: Nominal radar states (k, 4m), or more with the errors of further parameters.
        cov_aircraft: C_aa (k, 6, 6).
        cov_radar: C_rr (k, 4m, 4m), or more.
        tolerances: Tolerances that make the c_r of each radar (m,) uncertain; () for none.
        seed: Seed of draws of these states.
        runs: Draws at each pose of the method `montecarlo`.
    """

    model: NetworkModel
    log_constant: NDArray[np.bool_]
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: FloatArray
    tolerances: tuple[tuple[Tolerance, ...], ...]
    seed: int = 1
    runs: int = 500

    def __len__(self) -> int:
        """Number of poses."""
        lengths = {len(array) for array in self._arrays}
        return 0 if 0 in lengths else max(lengths)

    @property
    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """C_aa (6, 6) or (k, 6, 6), and C_rr alike."""
        aircraft, radar = (c[0] if len(c) == 1 else c for c in (self.cov_aircraft, self.cov_radar))
        return aircraft, radar

    def blocks(self, numbers: int) -> Iterator[UncertainStates]:
        """Yield blocks of poses for an algorithm that needs this many numbers a pose."""
        return self.cut(max(1, min(BLOCK, MAX_NUMBERS // numbers)))

    def cut(self, size: int) -> Iterator[UncertainStates]:
        """Yield parts with at most this number of poses, one part if there are no poses."""
        for start in range(0, max(len(self), 1), size):
            yield self._with(*(a if len(a) == 1 else a[start : start + size] for a in self._arrays))

    def at(self, rows: NDArray[np.intp] | slice) -> UncertainStates:
        """Return the states of some poses."""
        return self._with(*(a if len(a) == 1 < len(self) else a[rows] for a in self._arrays))

    def with_covariances(
        self,
        cov_aircraft: FloatArray,
        cov_radar: FloatArray,
        tolerances: tuple[tuple[Tolerance, ...], ...] | None = None,
    ) -> UncertainStates:
        """Return the states with other covariances (n, n) or (k, n, n), and other tolerances."""
        covariances = (c[np.newaxis] if c.ndim == 2 else c for c in (cov_aircraft, cov_radar))
        changed = self._with(self.aircraft, self.radar, *covariances)
        return changed if tolerances is None else replace(changed, tolerances=tolerances)

    def of_radar(self, number: int) -> UncertainStates:
        """Return the states of one radar alone."""
        own = components_of([number], len(self.model.radars), self.radar.shape[-1])
        return UncertainStates(
            NetworkModel((self.model.radars[number],)),
            self.log_constant[[number]],
            self.aircraft,
            self.radar[:, own],
            self.cov_aircraft,
            self.cov_radar[:, own][..., own],
            self.tolerances[number : number + 1],
            self.seed,
            self.runs,
        )

    @property
    def normals(self) -> int:
        """Number d of unit normals of all states at a pose."""
        more = sum(max(0, len(tolerances) - 1) for tolerances in self.tolerances)
        return len(AIRCRAFT) + int(self.radar.shape[-1]) + more

    @cached_property
    def columns(self) -> list[list[int]]:
        """The unit normals of the tolerances of each radar.

        The first tolerance has the normal of c_r, the others follow the normals of all components.
        """
        first, columns = len(AIRCRAFT) + int(self.radar.shape[-1]), []
        for i, tolerances in enumerate(self.tolerances):
            after = first + max(0, len(tolerances) - 1)
            own = [len(AIRCRAFT) + len(RADAR) * i + CONSTANT, *range(first, after)]
            columns.append(own if tolerances else [])
            first = after
        return columns

    @cached_property
    def sqrt_cov_aircraft(self) -> FloatArray:
        """F (k, 6, 6) with F Fᵀ = C_aa."""
        return square_root(self.cov_aircraft)

    @cached_property
    def sqrt_cov_radar(self) -> FloatArray:
        """F (k, n, n) with F Fᵀ = C_rr. A c_r with tolerances has a column of its own."""
        places = [len(RADAR) * i + CONSTANT for i, t in enumerate(self.tolerances) if t]
        return np.stack([block_square_root(c, places) for c in self.cov_radar])

    def at_normals(self, u: FloatArray, rows: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Return aircraft states (k, n, 6) and radar states (k, n, 4m or more) at unit normals.

        Args:
            u: Unit normals (k, d, n).
            rows: The k poses of the unit normals.
        """
        a, size = len(AIRCRAFT), int(self.radar.shape[-1])
        normals = np.moveaxis(u, 1, -1)

        def at(array: FloatArray) -> FloatArray:
            """Return an array of the poses (k, 1, ...), or of all of them (1, 1, ...)."""
            return (array if len(array) == 1 else array[rows])[:, np.newaxis]

        aircraft = draws(at(self.aircraft), at(self.sqrt_cov_aircraft), normals[..., :a])
        radar = draws(at(self.radar), at(self.sqrt_cov_radar), normals[..., a : a + size])
        for i, (tolerances, columns) in enumerate(zip(self.tolerances, self.columns, strict=True)):
            c = len(RADAR) * i + CONSTANT
            constant, nominal = radar[..., c], at(self.radar)[..., c]
            if tolerances:
                constant[:] = nominal * factors(tolerances, normals[..., columns])
            elif self.log_constant[i]:
                constant[:] = nominal * np.exp(np.minimum(constant / nominal - 1.0, MOST_NEPERS))
            else:
                np.maximum(constant, 0.0, out=constant)
        return aircraft, radar

    def by_normals(
        self, by_aircraft: FloatArray, by_radar: FloatArray, radar: FloatArray
    ) -> FloatArray:
        """Return the gradient (k, d) of a function of the states by unit normals.

        Args:
            by_aircraft: Its gradient by the aircraft state (k, 6).
            by_radar: Its gradient by the radar states (k, 4m or more).
            radar: The radar states (k, 4m or more) of the gradient.
        """
        a, size = len(AIRCRAFT), int(self.radar.shape[-1])
        gradient, by_radar = np.zeros((len(self), self.normals)), by_radar.copy()
        for i, (tolerances, columns) in enumerate(zip(self.tolerances, self.columns, strict=True)):
            c = len(RADAR) * i + CONSTANT
            by_log = by_radar[:, c] * radar[:, c]
            if tolerances:
                by_radar[:, c] = 0.0
                gradient[:, columns] = by_log[:, np.newaxis] * [t.slope for t in tolerances]
            elif self.log_constant[i]:
                by_radar[:, c] = by_log / self._constant(i)[:, 0]
        gradient[:, :a] = (by_aircraft[:, np.newaxis] @ self.sqrt_cov_aircraft)[:, 0]
        gradient[:, a : a + size] += (by_radar[:, np.newaxis] @ self.sqrt_cov_radar)[:, 0]
        return gradient

    def _constant(self, number: int) -> FloatArray:
        """Return the nominal c_r (k, 1) of a radar."""
        return self.radar[:, len(RADAR) * number + CONSTANT, np.newaxis]

    def _with(self, *arrays: FloatArray) -> UncertainStates:
        aircraft, radar, cov_aircraft, cov_radar = arrays
        return replace(
            self,
            aircraft=aircraft,
            radar=radar,
            cov_aircraft=cov_aircraft,
            cov_radar=cov_radar,
        )

    @property
    def _arrays(self) -> tuple[FloatArray, ...]:
        return self.aircraft, self.radar, self.cov_aircraft, self.cov_radar


def uncertain_states(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    log_constant: ArrayLike = False,
) -> tuple[tuple[int, ...], UncertainStates]:
    """Broadcast states and covariances against each other, with all poses along one axis.

    Args:
        model: The detection model, of a radar or of a network of m.
        aircraft: Nominal aircraft states (..., 6).
        radar: Nominal radar states (..., 4m).
        cov_aircraft: C_aa (..., 6, 6).
        cov_radar: C_rr (..., 4m, 4m).
        log_constant: Whether ln c_r is Gaussian, of all radars or of each (m,).

    Returns:
        The shape (...) of all poses, and the states.

    Raises:
        ValueError: If a shape does not fit, a state is not finite, or a matrix is not a covariance.
    """
    model = as_network(model)
    radar = real_array("radar states", radar)
    size = radar.shape[-1:]
    radars = size[0] if size and size[0] in model.sizes else model.sizes[0]
    arrays: list[tuple[FloatArray, tuple[int, ...]]] = []
    wanted: tuple[tuple[str, ArrayLike, tuple[int, ...]], ...] = (
        ("aircraft states", aircraft, (len(AIRCRAFT),)),
        ("radar states", radar, (radars,)),
        ("aircraft covariance", cov_aircraft, 2 * (len(AIRCRAFT),)),
        ("radar covariance", cov_radar, 2 * (radars,)),
    )
    for name, values, tail in wanted:
        array = real_array(name, values)
        if array.shape[-len(tail) :] != tail:
            expected = ", ".join(("...", *map(str, tail)))
            raise ValueError(f"{name} must have shape ({expected}), got {array.shape}")
        whose = name.split()[0]
        if len(tail) == 1:
            check_finite(whose, array, len(model.radars))
        else:
            checked(whose, array)
        arrays.append((array, tail))
    shape = np.broadcast_shapes(*(array.shape[: -len(tail)] for array, tail in arrays))
    rows = []
    for array, tail in arrays:
        if math.prod(array.shape[: -len(tail)]) != 1:
            array = np.broadcast_to(array, shape + tail)
        rows.append(array.reshape(-1, *tail))
    which = np.broadcast_to(np.asarray(log_constant, dtype=bool), len(model.models))
    x_a, x_r, c_aa, c_rr = rows
    no_tolerances = ((),) * len(model.models)
    return shape, UncertainStates(model, which, x_a, x_r, c_aa, c_rr, no_tolerances)
