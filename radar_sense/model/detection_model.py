"""The detection model: geometry, RCS, radar equation and detector in one chain, with its gradient.

Each link of the chain has a function for its value and one called `linearize` for its value and
derivative. Here they are multiplied together, `eq:pd_partial_long`, over blocks of poses small
enough that all intermediate arrays stay in the processor's cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from radar_sense.covariance import checked, variance_along
from radar_sense.errors import InputError
from radar_sense.limits import Limit, check_number
from radar_sense.model.detectors import Detector, North
from radar_sense.model.geometry import Attitude, Vector, join, radar_from_aircraft
from radar_sense.model.radar_equation import snr
from radar_sense.model.rcs import RCS
from radar_sense.states import AIRCRAFT, CONSTANT, RADAR, FloatArray, check_finite

#: Poses per block. The arrays in use at a time stay within a third-level cache, and NumPy's calls
#: are long enough for threads not to wait for each other between them.
BLOCK = 131_072
#: The same with all partials, where many more arrays are in use: within a second-level cache.
BLOCK_OF_PARTIALS = 16_384
#: What a detector offers: a value and its slope by S, from S and P_fa.
Slope: TypeAlias = Callable[[FloatArray, float], tuple[FloatArray, FloatArray]]
_ONE = np.ones(())


@dataclass(frozen=True, eq=False, repr=False)
class Linearization:
    """P_D and its partials at the given states, `eq:pd_partial_short`.

    Attributes:
        p_d: Probability of detection (...).
        jac_aircraft: A_Pa (..., 6), partials for north, east, down [1/m], roll, pitch, yaw [1/rad].
        jac_radar: A_Pr (..., 4), partials for north, east, down [1/m] and c_r [K/(J m²)]; those of
            m radars (..., 4m) one after the other.
    """

    p_d: FloatArray
    jac_aircraft: FloatArray
    jac_radar: FloatArray

    def __repr__(self) -> str:
        return f"<Linearization of P_D at {self.p_d.size} poses: p_d, jac_aircraft, jac_radar>"

    def std(self, cov_aircraft: ArrayLike, cov_radar: ArrayLike) -> FloatArray:
        """Standard deviation of P_D to first order, `eq:pd_var`.

        Args:
            cov_aircraft: C_aa (..., 6, 6), in metres and radians.
            cov_radar: C_rr (..., 4, 4), or (..., 4m, 4m), in metres and J m²/K.

        Returns:
            σ_pd (...).

        Raises:
            ValueError: If a covariance has another shape, or is not finite, symmetric and positive
                semidefinite.
        """
        return np.sqrt(
            variance_along(self.jac_aircraft, checked("aircraft", cov_aircraft))
            + variance_along(self.jac_radar, checked("radar", cov_radar))
        )


@dataclass(frozen=True)
class DetectionModel:
    """Probability that a radar detects an aircraft with a single pulse.

    Aircraft states are (..., 6): north, east, down [m], roll, pitch, yaw [rad]. Radar states are
    (..., 4): north, east, down [m] and radar constant c_r [J m²/K]. The two broadcast against each
    other. Where aircraft and radar coincide everything is NaN.

    Attributes:
        rcs: Radar cross section by aspect.
        p_fa: Probability of false alarm, between 0 and 1.
        detector: From signal-to-noise ratio to P_D; North's approximation unless another is given.
    """

    rcs: RCS
    p_fa: float
    detector: Detector = field(default_factory=North)

    def __post_init__(self) -> None:
        check_number("p_fa", self.p_fa, Limit(above=0, below=1))
        if not hasattr(self.rcs, "cross_section") or isinstance(self.rcs, type):
            raise InputError(f"rcs must be an RCS model such as ConstantRCS(0.1), got {self.rcs!r}")
        if not hasattr(self.detector, "linearize") or isinstance(self.detector, type):
            raise InputError(f"detector must be a detector such as Marcum(), got {self.detector!r}")

    def snr(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Signal-to-noise ratio (...), a ratio of powers.

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        _check_states(aircraft, radar)
        (snr,) = _in_blocks(lambda a, r: (self._snr(a, r),), ((),), aircraft, radar, BLOCK)
        return snr

    def p_d(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Probability of detection (...).

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        _check_states(aircraft, radar)
        (p_d,) = _in_blocks(
            lambda a, r: (self.detector.p_d(self._snr(a, r), self.p_fa),),
            ((),),
            aircraft,
            radar,
            BLOCK,
        )
        return p_d

    def linearize(self, aircraft: ArrayLike, radar: ArrayLike) -> Linearization:
        """Probability of detection and its partials for all ten states.

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        _check_states(aircraft, radar)
        return Linearization(*self._partials(self.detector.linearize, aircraft, radar))

    def linearize_probit(
        self, aircraft: ArrayLike, radar: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The probit z = Φ⁻¹(P_D), which is far closer to linear in the states than P_D is.

        Returns:
            z (...), its partials for the aircraft (..., 6) and for the radar (..., 4).

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        _check_states(aircraft, radar)
        return self._partials(self.detector.linearize_probit, aircraft, radar)

    def _partials(
        self, detector: Slope, aircraft: ArrayLike, radar: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        tails = ((), (len(AIRCRAFT),), (len(RADAR),))
        value, by_aircraft, by_radar = _in_blocks(
            lambda a, r: self._chain(detector, a, r), tails, aircraft, radar, BLOCK_OF_PARTIALS
        )
        return value, by_aircraft, by_radar

    def _snr(self, aircraft: FloatArray, radar: FloatArray) -> FloatArray:
        line = radar_from_aircraft(aircraft, radar)
        body = line if self.rcs.isotropic else Attitude.from_state(aircraft).to_body(line)
        return snr(radar[..., CONSTANT], self.rcs.cross_section(join(body)), _range_squared(line))

    def _chain(
        self, detector: Slope, aircraft: FloatArray, radar: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        line = radar_from_aircraft(aircraft, radar)
        attitude = None if self.rcs.isotropic else Attitude.from_state(aircraft)
        body = line if attitude is None else attitude.to_body(line)
        range_squared = _range_squared(line)
        sigma, sigma_gradient = self.rcs.linearize(join(body))
        constant = radar[..., CONSTANT]
        ratio = snr(constant, sigma, range_squared)
        # S is a product, so ∂S/∂c_r and ∂S/∂σ_r are S without that factor (and exist where it is 0)
        ds_dconstant = snr(_ONE, sigma, range_squared)
        value, by_snr = detector(ratio, self.p_fa)

        # ∂S/∂R ∂R/∂p_r = −4 S/R · d/R
        by_range = -4.0 * by_snr * ratio / range_squared
        by_position = Vector(*(by_range * d for d in line))
        if attitude is None:
            by_attitude = Vector(*[0.0 * by_snr] * 3)  # NaN where nothing has a meaning
        else:
            # The RCS turns with the aircraft, the range does not: only the first is rotated back.
            by_sigma = by_snr * snr(constant, _ONE, range_squared)
            by_aspect, by_attitude = attitude.pull_back(
                body, Vector(*(by_sigma * sigma_gradient[..., i] for i in range(3)))
            )
            by_position = Vector(*(g + p for g, p in zip(by_aspect, by_position, strict=True)))
        return (
            value,
            join((*(-g for g in by_position), *by_attitude)),
            join((*by_position, by_snr * ds_dconstant)),
        )


def _range_squared(line: Vector) -> FloatArray:
    """R² (...), NaN where aircraft and radar coincide and nothing has a meaning."""
    x, y, z = line
    squared = x * x
    squared += y * y
    squared += z * z
    apart = squared > 0
    return squared if apart.all() else np.where(apart, squared, np.nan)


def _in_blocks(
    function: Callable[[FloatArray, FloatArray], tuple[FloatArray, ...]],
    tails: tuple[tuple[int, ...], ...],
    aircraft: ArrayLike,
    radar: ArrayLike,
    size: int,
) -> tuple[FloatArray, ...]:
    """Broadcast the states against each other and apply a function to block after block of them.

    Args:
        function: From aircraft (..., 6) and radar (..., 4), which broadcast, to arrays of as many
            poses.
        tails: The shape of what it gives for one pose, an entry per array.
        aircraft: (..., 6).
        radar: (..., 4).
        size: Poses of a block.

    Returns:
        One array (..., *tail) for each entry of `tails`, in memory component by component.
    """
    aircraft = _states("aircraft", AIRCRAFT, aircraft)
    radar = _states("radar", RADAR, radar)
    if np.any(radar[..., CONSTANT] < 0):
        raise ValueError(
            f"radar constant must not be negative, got {np.nanmin(radar[..., CONSTANT])}"
        )
    shape = np.broadcast_shapes(aircraft.shape[:-1], radar.shape[:-1])
    _keep_freed_memory()
    aircraft, radar = (np.broadcast_to(s, shape + s.shape[-1:]) for s in (aircraft, radar))
    if math.prod(shape) <= size:
        return function(aircraft, radar)
    results = tuple(_component_first(shape, tail) for tail in tails)
    for block in _blocks(shape, size):
        values = function(aircraft[block], radar[block])
        for result, value in zip(results, values, strict=True):
            result[block] = value
    return tuple(result[()] for result in results)


@cache
def _keep_freed_memory() -> None:
    """Keep the C library from giving the memory of every block back and fetching it anew.

    glibc returns what is free at the end of the heap as soon as it is twice the largest array that
    was freed, and taking it again, page by page, costs as much as the arithmetic done in it. So one
    large array is freed first. (mallopt(3), M_TRIM_THRESHOLD and M_MMAP_THRESHOLD; no effect on the
    numbers, nor with another C library.)
    """
    np.empty(3 << 20)  # 24 MB, never touched


def _blocks(shape: tuple[int, ...], size: int) -> Iterator[tuple[slice, ...]]:
    """Cut an array of this shape into parts of no more than so many elements."""
    if not shape:
        yield ()
        return
    inner = int(np.prod(shape[1:]))
    together = max(1, size // max(1, inner))
    for start in range(0, shape[0], together):
        first = slice(start, start + together)
        if inner <= size:
            yield (first,)
        else:
            yield from ((first, *rest) for rest in _blocks(shape[1:], size))


def _component_first(shape: tuple[int, ...], tail: tuple[int, ...]) -> FloatArray:
    empty = np.empty(tail + shape)
    return np.moveaxis(empty, range(len(tail)), range(-len(tail), 0))


def _check_states(aircraft: ArrayLike, radar: ArrayLike) -> None:
    check_finite("aircraft", _states("aircraft", AIRCRAFT, aircraft))
    check_finite("radar", _states("radar", RADAR, radar))


def _states(whose: str, components: tuple[str, ...], values: ArrayLike) -> FloatArray:
    states = np.asarray(values, dtype=float)
    if states.shape[-1:] != (len(components),):
        raise ValueError(
            f"{whose} states must have shape (..., {len(components)}) for "
            f"{', '.join(components)}, got {states.shape}"
        )
    return states
