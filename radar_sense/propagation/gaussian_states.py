"""Gaussian states of poses: the nominal states and covariances that a method propagates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.covariance import checked
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel, as_network
from radar_sense.states import AIRCRAFT, FloatArray, check_finite, components_of, own_components_of

#: Numbers in the largest array of a block of poses, which bounds memory (16 MB).
MAX_NUMBERS = 2_000_000
#: Most poses in a block. More poses save time in Python, and arrays of differences have 1 MB here.
BLOCK = 2048

#: From C_aa and C_rr, each for all poses together or for each pose, to σ of P_D (k,).
StdFunction: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class UncertainStates:
    """Nominal states of k poses, their covariances, and the detection model.

    An array with the same rows at all poses may have one row instead of k.

    Attributes:
        model: The detection model, of a radar or of a network of m.
        log_constant: Radars (m,) whose ln c_r is Gaussian: c_r = c̄_r exp(Δ/c̄_r), Δ of C_rr.
        aircraft: Nominal aircraft states (k, 6).
        radar: Nominal radar states (k, 4m), or more with the errors of further parameters.
        cov_aircraft: C_aa (k, 6, 6).
        cov_radar: C_rr (k, 4m, 4m), or more.
    """

    model: NetworkModel
    log_constant: NDArray[np.bool_]
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: FloatArray

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
        return self.cut(block_size(numbers))

    def cut(self, size: int) -> Iterator[UncertainStates]:
        """Yield parts with at most this number of poses, one part if there are no poses."""
        for start in range(0, max(len(self), 1), size):
            arrays = (a if len(a) == 1 else a[start : start + size] for a in self._arrays)
            yield UncertainStates(self.model, self.log_constant, *arrays)

    def at(self, rows: NDArray[np.intp]) -> UncertainStates:
        """Return the states of some poses."""
        arrays = (a if len(a) == 1 < len(self) else a[rows] for a in self._arrays)
        return UncertainStates(self.model, self.log_constant, *arrays)

    def with_covariances(self, cov_aircraft: FloatArray, cov_radar: FloatArray) -> UncertainStates:
        """Return the states with other covariances (n, n) or (k, n, n)."""
        covariances = (c[np.newaxis] if c.ndim == 2 else c for c in (cov_aircraft, cov_radar))
        return UncertainStates(
            self.model, self.log_constant, self.aircraft, self.radar, *covariances
        )

    def sight(self) -> Iterator[tuple[NDArray[np.intp], list[int] | None]]:
        """Yield groups of poses that the same radars see, and the radars; None for all radars.

        The other radars change neither z nor the derivatives of z. A pose that no radar sees keeps
        one radar. Without poses there is one group.
        """
        if not len(self) or len(self.log_constant) == 1 or not self.model.limited:
            yield np.arange(len(self)), None
            return
        visible = self.model.visible(self.aircraft, self.radar)
        sets, group = np.unique(
            np.broadcast_to(visible, (len(self), visible.shape[-1])), axis=0, return_inverse=True
        )
        for number, seen in enumerate(sets):
            poses = np.flatnonzero(group.reshape(-1) == number)
            yield poses, np.flatnonzero(seen).tolist() or [0]

    def part(self, poses: NDArray[np.intp], radars: list[int] | None) -> UncertainStates:
        """Return the states of some poses, and of some radars or of all."""
        states = self.at(poses) if len(poses) < len(self) else self
        return states if radars is None else states.of_radars(radars)

    def of_radars(self, radars: list[int]) -> UncertainStates:
        """Return the states of some radars."""
        size = self.radar.shape[-1]
        components = components_of(radars, len(self.log_constant), size)
        return UncertainStates(
            NetworkModel(tuple(self.model.radars[i] for i in radars)),
            self.log_constant[radars],
            self.aircraft,
            self.radar[:, components],
            self.cov_aircraft,
            self.cov_radar[:, components][..., components],
        )

    @property
    def has_independent_radars(self) -> bool:
        """Whether radars of a network have independent errors at all poses; False for one radar."""
        m, size = len(self.log_constant), self.radar.shape[-1]
        if m == 1:
            return False
        together = np.eye(size, dtype=bool)
        for i in range(m):
            own = own_components_of(i, m, size)
            together[np.ix_(own, own)] = True
        return not self.cov_radar[:, ~together].any()

    @property
    def _arrays(self) -> tuple[FloatArray, ...]:
        return self.aircraft, self.radar, self.cov_aircraft, self.cov_radar


def block_size(numbers: int) -> int:
    """Return the number of poses in a block for an algorithm with this many numbers a pose."""
    return max(1, min(BLOCK, MAX_NUMBERS // numbers))


def uncertain_states(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    log_constant: ArrayLike = False,
    check: bool = True,
) -> tuple[tuple[int, ...], UncertainStates]:
    """Broadcast states and covariances against each other, with all poses along one axis.

    Args:
        model: The detection model, of a radar or of a network of m.
        aircraft: Nominal aircraft states (..., 6).
        radar: Nominal radar states (..., 4m).
        cov_aircraft: C_aa (..., 6, 6).
        cov_radar: C_rr (..., 4m, 4m).
        log_constant: Whether ln c_r is Gaussian, of all radars or of each (m,).
        check: Whether to check values. The arrays of a `Scenario` are checked already.

    Returns:
        The shape (...) of all poses, and the states.

    Raises:
        ValueError: If a shape does not fit, a state is not finite, or a matrix is not a covariance.
    """
    model = as_network(model)
    size = np.shape(radar)[-1:]
    radars = size[0] if size and size[0] in model.sizes else model.sizes[0]
    arrays: list[tuple[FloatArray, tuple[int, ...]]] = []
    wanted: tuple[tuple[str, ArrayLike, tuple[int, ...]], ...] = (
        ("aircraft states", aircraft, (len(AIRCRAFT),)),
        ("radar states", radar, (radars,)),
        ("aircraft covariance", cov_aircraft, 2 * (len(AIRCRAFT),)),
        ("radar covariance", cov_radar, 2 * (radars,)),
    )
    for name, values, tail in wanted:
        array = np.asarray(values, dtype=float)
        if array.shape[-len(tail) :] != tail:
            expected = ", ".join(("...", *map(str, tail)))
            raise ValueError(f"{name} must have shape ({expected}), got {array.shape}")
        whose = name.split()[0]
        if check and len(tail) == 1:
            check_finite(whose, array, len(model.radars))
        elif check:
            checked(whose, array)
        arrays.append((array, tail))
    shape = np.broadcast_shapes(*(array.shape[: -len(tail)] for array, tail in arrays))
    rows = []
    for array, tail in arrays:
        if math.prod(array.shape[: -len(tail)]) != 1:
            array = np.broadcast_to(array, shape + tail)
        rows.append(array.reshape(-1, *tail))
    which = np.broadcast_to(np.asarray(log_constant, dtype=bool), len(model.models))
    return shape, UncertainStates(model, which, *rows)
