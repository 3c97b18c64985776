"""The detection model: geometry, RCS, radar equation and detector in one chain, with its gradient.

Each link of the chain has a function for its value and one called `linearize` for its value and
derivative. Here the derivatives are multiplied together, eq. (17) of the paper. A block of poses is
small enough for all intermediate arrays to stay in the processor's cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from radar_sense.covariance import checked, variance_along
from radar_sense.errors import InputError, check_choice, check_has, counted
from radar_sense.limits import Limit, check_parameters, declared
from radar_sense.model.detectors import Detector, North, check_detector, linearize
from radar_sense.model.geometry import Attitude, Vector, join, radar_from_aircraft, range_squared
from radar_sense.model.radar_equation import boltzmann_r4
from radar_sense.model.rcs import RCS, check_rcs, linearize_with_error, with_error
from radar_sense.states import (
    BLOCK,
    CONSTANT,
    FACTOR_ERRORS,
    FACTORS,
    RADAR,
    RCS_ERROR,
    FloatArray,
    blocks,
    checked_states,
    common_shape,
)

#: From S and P_fa to a value of a detector, and its slope by S.
Slope: TypeAlias = Callable[[FloatArray, float], tuple[FloatArray, ...]]
_ZERO = np.zeros(())
# glibc returns free memory beyond twice the largest array freed so far (mallopt(3)). Blocks would
# fetch it again page by page, and a gradient would take twice the time. Never touched.
np.empty(3 << 20)


class Factor(Protocol):
    """A factor of the signal by the way to the radar, with one parameter that may be uncertain.

    Attributes:
        term: Name of the factor in a table of decibels.
        parameter: Name of the parameter, one of `states.FACTORS`.
        std_limit: Standard deviations that the error of the parameter may have.
        detail: Least change [rad] of the direction, or of the error, that changes the factor much;
            infinity for a factor without lobes.
    """

    term: ClassVar[str]
    parameter: ClassVar[str]
    std_limit: ClassVar[Limit]

    @property
    def detail(self) -> float: ...  # noqa: D102

    def nepers(self, line: Vector, error: FloatArray) -> FloatArray:
        """Return ln of the factor (...) along d, with an error (...) of the parameter."""

    def linearize(self, line: Vector, error: FloatArray) -> tuple[FloatArray, Vector, FloatArray]:
        """Return `nepers`, their gradient by d, and by the error."""

    def rise(self, line: Vector, error: FloatArray, part: FloatArray) -> FloatArray:
        """Return by how much (...) `nepers` may rise at most on the way to a part of the distance.

        The aircraft flies level towards the radar, and passes over or under it.
        """


@dataclass(frozen=True, eq=False, repr=False)
class Linearization:
    """P_D and its partials at the given states, eq. (18) of the paper.

    Attributes:
        p_d: Probability of detection (...).
        jac_aircraft: A_Pa (..., 6), partials for north, east, down [1/m], roll, pitch, yaw [1/rad].
        jac_radar: A_Pr (..., 4), partials for north, east, down [1/m] and c_r [K/(J m²)]; for a
            network (..., 4m), radar after radar. The partials for further errors follow, where the
            radar states have them.
    """

    p_d: FloatArray
    jac_aircraft: FloatArray
    jac_radar: FloatArray

    def __repr__(self) -> str:
        poses = counted(self.p_d.size, "pose")
        return f"<Linearization of P_D at {poses}: p_d, jac_aircraft, jac_radar>"

    def std(self, cov_aircraft: ArrayLike, cov_radar: ArrayLike) -> FloatArray:
        """Return the standard deviation σ_pd (...) of P_D to first order, eq. (35) of the paper.

        Args:
            cov_aircraft: C_aa (..., 6, 6), in metres and radians.
            cov_radar: C_rr (..., 4, 4), or (..., 4m, 4m), in metres and J m²/K.

        Raises:
            InputError: If a covariance has another shape, or is not finite, symmetric and positive
                semidefinite.
        """
        c_aa = checked("aircraft", cov_aircraft, self.jac_aircraft.shape[-1])
        c_rr = checked("radar", cov_radar, self.jac_radar.shape[-1])
        common_shape(self.p_d.shape, c_aa.shape[:-2], c_rr.shape[:-2])
        return np.sqrt(
            variance_along(self.jac_aircraft, c_aa) + variance_along(self.jac_radar, c_rr)
        )


@dataclass(frozen=True)
class DetectionModel:
    """Probability that a radar detects an aircraft with a single pulse.

    Aircraft states are (..., 6): north, east, down [m], roll, pitch, yaw [rad]. Radar states are
    (..., 4): north, east, down [m] and radar constant c_r [J m²/K]. Three errors may follow: ε of
    the RCS multiplies σ_r by 10^(s ε/10), see `rcs`. `Attenuation` and `ElevationGain` say what the
    errors of an attenuation and of a tilt do. The two states broadcast against each other. All
    results are NaN where aircraft and radar coincide. InputError is raised if a shape does not fit,
    a state is not finite or c_r is negative.

    Attributes:
        rcs: Radar cross section by aspect.
        p_fa: Probability of false alarm, between 0 and 1.
        detector: Detector, from signal-to-noise ratio to P_D. The default is North's approximation.
        factors: Factors of S by the way to the target and back, such as `Attenuation` and
            `ElevationGain`.
    """

    rcs: RCS
    p_fa: float = declared(Limit(above=0, below=1))
    detector: Detector = field(default_factory=North)
    factors: tuple[Factor, ...] = ()

    def __post_init__(self) -> None:
        check_parameters(self)
        check_rcs(self.rcs)
        check_detector(self.detector, self.p_fa)
        given: Any = self.factors
        if not isinstance(given, tuple | list):
            raise InputError(f"factors must be a tuple, got {given!r}")
        needed = ("term", "parameter", "std_limit", "detail", "nepers", "linearize", "rise")
        for factor in given:
            check_has("each of factors", factor, needed, "a factor of S", "Attenuation(2e-5)")
            check_choice("the parameter of a factor", factor.parameter, FACTORS)
        parameters = [factor.parameter for factor in given]
        if len({*parameters}) < len(parameters):
            raise InputError(f"factors must have a parameter each, got {', '.join(parameters)}")
        object.__setattr__(self, "factors", tuple(given))

    @property
    def has_spread(self) -> bool:
        """Whether the RCS knows its own uncertainty by aspect, see `model.rcs`."""
        return getattr(self.rcs, "spread", None) is not None

    def snr(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Return the signal-to-noise ratio (...) at each pose, a ratio of powers."""
        return self.unchecked_snr(*checked_states(aircraft, radar))

    def p_d(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Return P_D (...) at each pose."""
        return self.unchecked_p_d(*checked_states(aircraft, radar))

    def linearize(self, aircraft: ArrayLike, radar: ArrayLike) -> Linearization:
        """Return P_D and its partials by all ten states."""
        aircraft, radar = checked_states(aircraft, radar)
        chain = partial(self._chain, partial(linearize, self.detector))
        return Linearization(*_in_blocks(chain, aircraft, radar))

    def linearize_probit(
        self, aircraft: ArrayLike, radar: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the probit z = Φ⁻¹(P_D) (...), and its partials by both states.

        z is far closer to linear in the states than P_D.
        """
        return self.unchecked_probit(*checked_states(aircraft, radar))

    def unchecked_snr(self, aircraft: FloatArray, radar: FloatArray) -> FloatArray:
        """Return `snr` of states that have been checked."""
        (snr,) = _in_blocks(lambda a, r: (self._snr(a, r),), aircraft, radar)
        return snr

    def unchecked_p_d(self, aircraft: FloatArray, radar: FloatArray) -> FloatArray:
        """Return `p_d` of states that have been checked."""
        return self.detector.p_d(self.unchecked_snr(aircraft, radar), self.p_fa)

    def unchecked_probit(
        self, aircraft: FloatArray, radar: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return `linearize_probit` of states that have been checked, linear below c_r = 0.

        It is NaN where a state is not finite: a diverging search reaches such states.
        """
        below_zero = np.minimum(radar[..., CONSTANT], 0.0)
        negative = below_zero.any()
        if negative:
            radar = radar.copy(order="K")
            radar[..., CONSTANT] -= below_zero
        chain = partial(self._chain, self.detector.linearize_probit)
        z, by_aircraft, by_radar = _in_blocks(chain, aircraft, radar)
        if negative:
            z = z + by_radar[..., CONSTANT] * below_zero
        return z, by_aircraft, by_radar

    def _snr(self, aircraft: FloatArray, radar: FloatArray) -> FloatArray:
        line = radar_from_aircraft(aircraft, radar)
        body = line if self.rcs.isotropic else Attitude.from_state(aircraft).to_body(line)
        sigma = with_error(self.rcs, join(body), _error(radar, RCS_ERROR))
        ratio = radar[..., CONSTANT] * sigma / boltzmann_r4(range_squared(line))
        for factor in self.factors:
            error = _error(radar, FACTOR_ERRORS[factor.parameter])
            ratio = ratio * np.exp(factor.nepers(line, error))
        return ratio

    def unchecked_rise(
        self, aircraft: FloatArray, radar: FloatArray, part: FloatArray
    ) -> FloatArray:
        """Return by how much (...) ln of all factors may rise on the way to a part of the range."""
        line = radar_from_aircraft(aircraft, radar)
        rise = np.zeros(line.x.shape)
        for factor in self.factors:
            rise += factor.rise(line, _error(radar, FACTOR_ERRORS[factor.parameter]), part)
        return rise

    def _chain(
        self, detector: Slope, aircraft: FloatArray, radar: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Return the value of a detector, and its partials by both states."""
        line = radar_from_aircraft(aircraft, radar)
        attitude = None if self.rcs.isotropic else Attitude.from_state(aircraft)
        body = line if attitude is None else attitude.to_body(line)
        squared = range_squared(line)
        sigma, sigma_gradient, by_error = linearize_with_error(
            self.rcs, join(body), _error(radar, RCS_ERROR)
        )
        # S is a product, and each partial is S without a factor. It exists where the factor is 0.
        constant, noise = radar[..., CONSTANT], boltzmann_r4(squared)
        ratio, ds_dconstant, ds_dsigma = constant * sigma / noise, sigma / noise, constant / noise
        nepers, by_path = _ZERO, []
        by_errors = dict.fromkeys((RCS_ERROR, *FACTOR_ERRORS.values()), _ZERO)
        by_errors[RCS_ERROR] = by_error
        for factor in self.factors:
            place = FACTOR_ERRORS[factor.parameter]
            own, by_line, by_errors[place] = factor.linearize(line, _error(radar, place))
            nepers = nepers + own
            by_path.append(by_line)
        if by_path:
            gain = np.exp(nepers)
            ratio, ds_dconstant, ds_dsigma = gain * ratio, gain * ds_dconstant, gain * ds_dsigma
        value, by_snr = detector(ratio, self.p_fa)

        by_log = by_snr * ratio
        by_range = -4.0 * by_log / squared  # ∂S/∂R ∂R/∂p_r = −4 S/R · d/R
        by_position = [by_range * d for d in line]
        for by_line in by_path:
            by_position = [p + by_log * g for p, g in zip(by_position, by_line, strict=True)]
        if attitude is None:
            by_attitude = Vector(*[0.0 * by_snr] * 3)  # NaN where aircraft and radar coincide
        else:
            # σ_r depends on the body-frame vector, the range does not.
            by_sigma = by_snr * ds_dsigma
            by_aspect, by_attitude = attitude.pull_back(
                body, Vector(*(by_sigma * sigma_gradient[..., i] for i in range(3)))
            )
            by_position = [p + g for p, g in zip(by_position, by_aspect, strict=True)]
        of_radar = [*by_position, by_snr * ds_dconstant]
        if radar.shape[-1] > len(RADAR):
            of_radar += [by_log * by for by in by_errors.values()]
        return value, join([*(-p for p in by_position), *by_attitude]), join(of_radar)


def _error(radar: FloatArray, component: int) -> FloatArray:
    """Return an error (...) of radar states (..., 7); 0 of (..., 4), which have none."""
    return radar[..., component] if radar.shape[-1] > len(RADAR) else _ZERO


def _in_blocks(
    function: Callable[[FloatArray, FloatArray], tuple[FloatArray, ...]],
    aircraft: FloatArray,
    radar: FloatArray,
) -> tuple[FloatArray, ...]:
    """Return the arrays (..., *tail) that a function computes from states, block after block.

    Each component of an array is contiguous in memory.
    """
    shape = np.broadcast_shapes(aircraft.shape[:-1], radar.shape[:-1])
    aircraft, radar = (
        s if s.shape[:-1] == shape else np.broadcast_to(s, shape + s.shape[-1:])
        for s in (aircraft, radar)
    )
    if math.prod(shape) <= BLOCK:
        return function(aircraft, radar)
    results: list[FloatArray] = []
    for block in blocks(shape):
        values = function(aircraft[block], radar[block])
        if not results:
            results = [_component_first(shape, value.shape[len(shape) :]) for value in values]
        for result, value in zip(results, values, strict=True):
            result[block] = value
    return tuple(results)


def _component_first(shape: tuple[int, ...], tail: tuple[int, ...]) -> FloatArray:
    """Return an empty array (*shape, *tail) with each component contiguous in memory."""
    empty = np.empty(tail + shape)
    return np.moveaxis(empty, range(len(tail)), range(-len(tail), 0))
