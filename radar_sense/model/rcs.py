"""Radar cross section by aspect: one small frozen class per model.

A model has two methods over body-frame vectors to the radar (..., 3) of any length above 0:
`cross_section` returns σ_r (...) [m²], and `linearize` returns σ_r and its gradient by the vector
(..., 3). An RCS depends on direction alone, so the gradient is perpendicular to the vector.

The models prefer direction cosines to the angles λ = atan2(y, x) and φ = atan2(z, √(x² + y²)).
Direction cosines have no artificial singularity. λ is undefined straight above and below the
aircraft. There the models use λ = 0, as atan2 does, and the gradient of a model with λ is NaN.

An RCS here is a function of aspect only, the mean over fluctuations from pulse to pulse or scan to
scan (P. Swerling, IRE Trans. IT-6(2), 1960). The detector models the fluctuations.

The mean itself is not known exactly: measured values are "seldom" better than 0.5 dB (E. F. Knott,
J. F. Shaeffer and M. T. Tuley, Radar Cross Section, 2nd ed. 1993). Its error is one number ε for
all aspects, radars and looks, and σ_r is multiplied by 10^(s ε/10). The spread s is 1 dB, or
depends on aspect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from radar_sense.errors import InputError, check_has, check_pair, describe
from radar_sense.limits import NOT_NEGATIVE, POSITIVE, Checked, Limit, parameter, plain_number
from radar_sense.model.geometry import Turn, join, split
from radar_sense.model.radar_equation import MOST_NEPERS, NEPERS
from radar_sense.states import FloatArray, real_array

#: What turns the directions in which an RCS is asked for its gradient off axes of symmetry; the
#: step of the differences [m], a millionth of the distance; and the relative errors of σ_r and of
#: the gradient that are allowed, the latter beside rounding, a part of σ_r.
_ASIDE, _STEP = np.array([0.13, 0.07, 0.09]), 0.1
_VALUE_ERROR, _GRADIENT_ERROR, _ROUNDING = 1e-6, 0.02, 1e-14
_LOBES = Limit(at_least=1, at_most=1e6, whole=True)


class RCS(Protocol):
    """What every RCS model has. A class of one's own that has it needs no base class.

    σ_r is finite and not negative in every direction, straight above and below too.

    Attributes:
        isotropic: Whether σ_r is the same at all aspects. The attitude is not used then.
    """

    isotropic: ClassVar[bool]

    @property
    def detail(self) -> float:
        """Width [rad] of the narrowest lobe or cell of σ_r in azimuth and elevation."""

    def cross_section(self, body_vector: FloatArray) -> FloatArray:
        """Return σ_r (...) [m²] towards body-frame vectors (..., 3)."""

    def linearize(self, body_vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return σ_r (...) [m²] and its gradient (..., 3) [m²/m]."""


def check_rcs(rcs: Any) -> None:
    """Raise InputError unless an RCS is as `RCS` says, finite and >= 0, with the right gradient.

    A model of this package is. Any other is asked in 26 directions around the aircraft.
    """
    needed = ("cross_section", "linearize", "isotropic", "detail")
    check_has("rcs", rcs, needed, "an RCS model", "ConstantRCS(0.1)")
    if type(rcs).__module__.startswith("radar_sense."):
        return
    name, detail = type(rcs).__name__, plain_number(rcs.detail)
    if not isinstance(detail, (int, float)) or not detail > 0:  # NaN is not
        raise InputError(f"{name}.detail must be a number greater than 0, got {describe(detail)}")
    around = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    vectors = 1e5 * around[around.any(axis=1)].reshape(2, 13, 3)
    sigma, gradient = check_pair(f"{name}.linearize", rcs.linearize(vectors))
    for what, values, shape in (
        (f"{name}.cross_section", rcs.cross_section(vectors), (2, 13)),
        (f"{name}.linearize", sigma, (2, 13)),
        (f"the gradient of {name}.linearize", gradient, (2, 13, 3)),
    ):
        if not isinstance(values, np.ndarray):
            raise InputError(f"{what} must return an array, got {describe(values)}")
        array = real_array(what, values)
        if array.shape != shape:
            raise InputError(f"{what} must return shape {shape} for (2, 13, 3), got {array.shape}")
        wrong = ~((array >= 0) & (array < math.inf))
        if len(shape) == 2 and wrong.any():
            x, y, z = vectors[wrong][0]
            azimuth, elevation = np.rad2deg([np.arctan2(y, x), np.arctan2(0 - z, np.hypot(x, y))])
            raise InputError(
                f"{what} must be finite and not negative, got {array[wrong][0]:g} at azimuth "
                f"{azimuth:.3g} and elevation {elevation:.3g} deg"
            )
    same = {
        f"{name}.linearize must return the σ_r of cross_section": rcs.cross_section(vectors),
        f"σ_r of {name} must not depend on the distance": rcs.cross_section(10.0 * vectors),
    }
    if rcs.isotropic:
        same[f"σ_r of {name}, which is isotropic, must be the same at all aspects"] = sigma[:1, :1]
    for problem, other in same.items():
        if not np.allclose(other, sigma, rtol=_VALUE_ERROR, atol=0.0):
            raise InputError(problem)
    aside = vectors + _ASIDE * np.linalg.norm(vectors, axis=-1, keepdims=True)
    numeric = join(
        (rcs.cross_section(aside + step) - rcs.cross_section(aside - step)) / (2.0 * _STEP)
        for step in _STEP * np.eye(3)
    )
    difference = np.linalg.norm(rcs.linearize(aside)[1] - numeric, axis=-1)
    rounding = _ROUNDING * np.max(sigma)
    off = difference > _GRADIENT_ERROR * np.linalg.norm(numeric, axis=-1) + rounding
    if np.count_nonzero(off) > off.size / 2:  # at an edge of a lobe there is no gradient
        raise InputError(
            f"the gradient of {name}.linearize is not that of {name}.cross_section, by differences "
            f"of it in {np.count_nonzero(off)} of {off.size} directions"
        )


def with_error(rcs: RCS, body_vector: FloatArray, error: FloatArray) -> FloatArray:
    """Return σ_r (...) [m²] towards body-frame vectors (..., 3) where the RCS has an error ε (...).

    The spread is 1 dB unless the RCS has a `spread`, which is like an RCS with values in dB.
    """
    if not error.any():
        return rcs.cross_section(body_vector)
    spread: RCS | None = getattr(rcs, "spread", None)
    decibels = error if spread is None else error * spread.cross_section(body_vector)
    return rcs.cross_section(body_vector) * np.exp(np.minimum(NEPERS * decibels, MOST_NEPERS))


def linearize_with_error(
    rcs: RCS, body_vector: FloatArray, error: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return σ_r (...) with an error ε (...), its gradient (..., 3), and ∂ ln σ_r/∂ε (...)."""
    spread: RCS | None = getattr(rcs, "spread", None)
    sigma, gradient = rcs.linearize(body_vector)
    decibels, slope = error, np.full(np.shape(error), NEPERS)
    if spread is None:
        if not error.any():
            return sigma, gradient, slope
    else:
        scale, by_vector = spread.linearize(body_vector)
        decibels, slope = error * scale, NEPERS * scale
        gradient = gradient + (NEPERS * sigma * error)[..., np.newaxis] * by_vector
    factor = np.exp(np.minimum(NEPERS * decibels, MOST_NEPERS))
    return sigma * factor, join(factor * g for g in split(gradient)), slope


@dataclass(frozen=True)
class ConstantRCS(Checked):
    """The same cross section at all aspects."""

    isotropic: ClassVar[bool] = True
    detail: ClassVar[float] = math.inf

    rcs: float = parameter("rcs_m2", "Radar cross section σ_r.", POSITIVE)

    def cross_section(self, body_vector: FloatArray) -> FloatArray:
        """Return σ_r (...) [m²] towards body-frame vectors (..., 3)."""
        return np.full(np.shape(body_vector)[:-1], self.rcs)

    def linearize(self, body_vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return σ_r (...) [m²] and its gradient (..., 3), which is zero."""
        return self.cross_section(body_vector), np.zeros(np.shape(body_vector))


@dataclass(frozen=True)
class EllipsoidRCS(Checked):
    """The paper's ellipsoid, eq. (13), taken literally.

    σ_r = π (abc)² / D² with D = (a sinλ cosφ)² + (b sinλ sinφ)² + (c cosλ)². Nose-on (λ = 0), σ_r
    is π a²b²/c². In the formula c acts along the nose, a along the wing and b down. The paper's
    text (a forward) and table (c up) differ from its formula.
    """

    isotropic: ClassVar[bool] = False

    a: float = parameter("a_m", "Axis that acts along the wing.", POSITIVE)
    b: float = parameter("b_m", "Axis that acts down.", POSITIVE)
    c: float = parameter("c_m", "Axis that acts along the nose.", POSITIVE)

    @property
    def detail(self) -> float:
        """Angle [rad] off the shortest axis at which D has doubled."""
        return min(self.a, self.b, self.c) / max(self.a, self.b, self.c)

    def cross_section(self, body_vector: FloatArray) -> FloatArray:
        """Return σ_r (...) [m²] towards body-frame vectors (..., 3)."""
        xx, yy, zz = split(np.square(np.asarray(body_vector, dtype=float)))
        hh = xx + yy
        rr = hh + zz
        with np.errstate(invalid="ignore"):
            inverse = self._inverse(xx, yy, zz, hh, rr)
        return np.pi * (self.a * self.b * self.c) ** 2 * inverse**2

    def linearize(self, body_vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return σ_r (...) [m²] and its gradient (..., 3) [m²/m], NaN straight above and below."""
        x, y, z = split(np.asarray(body_vector, dtype=float))
        aa, bb, cc = self.a**2, self.b**2, self.c**2
        xx, yy, zz = x * x, y * y, z * z
        hh = xx + yy
        rr = hh + zz
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = self._inverse(xx, yy, zz, hh, rr)
            sigma = np.pi * (self.a * self.b * self.c) ** 2 * inverse**2
            # D = c² + s (b² − c² + (a² − b²) q) with s = sin²λ = y²/h² and q = cos²φ = h²/r²;
            # ∇s = 2xy/h⁴ (−y, x, 0), ∇q = 2z/r⁴ (xz, yz, −h²), and dσ = −2 σ/D dD.
            outer = -4.0 * sigma * inverse
            along_s = outer * (bb - cc + (aa - bb) * hh / rr) * x * y / (hh * hh)
            along_q = outer * (aa - bb) * (yy / hh) * z / (rr * rr)
            gradient = join(
                (
                    along_q * x * z - along_s * y,
                    along_q * y * z + along_s * x,
                    -along_q * hh,
                )
            )
        return sigma, gradient

    def _inverse(
        self, xx: FloatArray, yy: FloatArray, zz: FloatArray, hh: FloatArray, rr: FloatArray
    ) -> FloatArray:
        """Return 1/D of eq. (13), from a sum of positive terms without cancellation."""
        # sin²λ cos²φ = (y²/h²)(h²/r²),  sin²λ sin²φ = (y²/h²)(z²/r²),  cos²λ = x²/h²
        times_hh = (self.a**2 * hh + self.b**2 * zz) * (yy / rr) + self.c**2 * xx
        inverse, aside = hh / times_hh, hh != 0  # NaN != 0 keeps NaN
        # Straight above or below, h = 0 and λ is undefined. With λ = 0, D is c².
        return inverse if aside.all() else np.where(aside, inverse, self.c**-2)


@dataclass(frozen=True)
class ExactEllipsoidRCS(Checked):
    """The exact ellipsoid, which the paper's formula approximates near the horizon.

    σ_r = π (s_x s_y s_z)² / D² with D = (s_x n_x)² + (s_y n_y)² + (s_z n_z)², for the direction n
    to the radar in the body frame. σ_r is π times the product of the principal radii of curvature
    at the specular point (E. F. Knott, J. F. Shaeffer and M. T. Tuley, Radar Cross Section, 2nd ed.
    1993). σ_r is smooth in every direction.

    Eq. (13) lacks a factor cos²φ in the term of the nose, and has a factor sin²λ too many
    in the term of down. With (a, b, c) = (s_y, s_z, s_x) the paper's D exceeds the exact D by
    (s_x² − s_z²) cos²λ sin²φ. The difference is 0 at the horizon and abeam, and largest straight
    above and below, where λ is undefined.
    """

    isotropic: ClassVar[bool] = False

    x: float = parameter("x_m", "Semi-axis along the nose.", POSITIVE)
    y: float = parameter("y_m", "Semi-axis along the wing.", POSITIVE)
    z: float = parameter("z_m", "Semi-axis down.", POSITIVE)

    @property
    def detail(self) -> float:
        """Angle [rad] off the shortest axis at which D has doubled."""
        return min(self.x, self.y, self.z) / max(self.x, self.y, self.z)

    def cross_section(self, body_vector: FloatArray) -> FloatArray:
        """Return σ_r (...) [m²] towards body-frame vectors (..., 3)."""
        sigma, _, _ = self._parts(*split(np.asarray(body_vector, dtype=float)))
        return sigma

    def linearize(self, body_vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return σ_r (...) [m²] and its gradient (..., 3) [m²/m]."""
        x, y, z = split(np.asarray(body_vector, dtype=float))
        sigma, (xx, yy, zz), weighted = self._parts(x, y, z)
        aa, bb, cc = self.x**2, self.y**2, self.z**2
        # With D = w/r² and w = Σ s_i² ρ_i², ∂σ/∂ρ_i = 4σ ρ_i (1/r² − s_i²/w). The bracket is
        # (w − s_i² r²)/(r² w), written so that s_i² drops out and nothing cancels.
        with np.errstate(divide="ignore", invalid="ignore"):
            outer = 4.0 * sigma / ((xx + yy + zz) * weighted)
            gradient = join(
                (
                    outer * x * ((bb - aa) * yy + (cc - aa) * zz),
                    outer * y * ((aa - bb) * xx + (cc - bb) * zz),
                    outer * z * ((aa - cc) * xx + (bb - cc) * yy),
                )
            )
        return sigma, gradient

    def _parts(
        self, x: FloatArray, y: FloatArray, z: FloatArray
    ) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray], FloatArray]:
        """Return σ_r, the squares of the components, and w = r² D."""
        xx, yy, zz = x * x, y * y, z * z
        weighted = self.x**2 * xx + self.y**2 * yy + self.z**2 * zz
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.x * self.y * self.z * (xx + yy + zz) / weighted
        return np.pi * ratio * ratio, (xx, yy, zz), weighted


@dataclass(frozen=True)
class SpikeballRCS(Checked):
    """The simple spikeball, σ_r = |A sin(n λ/2)| + σ_min: n lobes around the aircraft.

    The slope jumps at the bottom of each lobe. There the gradient of one of the two lobes is
    returned. The gradients of the two lobes differ in sign only and give the same linearized
    deviation.

    A and σ_min are not both zero.
    """

    isotropic: ClassVar[bool] = False

    lobes: int = parameter("lobes", "Number n of lobes.", _LOBES)
    amplitude: float = parameter("amplitude_m2", "Amplitude A of the lobes.", NOT_NEGATIVE)
    floor: float = parameter("floor_m2", "Least cross section σ_min.", NOT_NEGATIVE)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.amplitude + self.floor == 0:
            raise InputError("amplitude and floor must not both be 0")

    @property
    def detail(self) -> float:
        """Width [rad] of a lobe."""
        return 2.0 * math.pi / self.lobes

    def cross_section(self, body_vector: FloatArray) -> FloatArray:
        """Return σ_r (...) [m²] towards body-frame vectors (..., 3)."""
        x, y, _ = split(np.asarray(body_vector, dtype=float))
        wave = Turn.by(0.5 * self.lobes * np.arctan2(y, x)).sin
        return self.floor + self.amplitude * np.abs(wave)

    def linearize(self, body_vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return σ_r (...) [m²] and its gradient (..., 3) [m²/m], NaN straight above and below."""
        x, y, _ = split(np.asarray(body_vector, dtype=float))
        half = 0.5 * self.lobes
        phase = Turn.by(half * np.arctan2(y, x))
        wave = phase.sin
        slope = np.where(wave < 0, -half, half) * self.amplitude * phase.cos
        # ∇λ = (−y, x, 0)/h²
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = slope / (x * x + y * y)
            gradient = join((-y * turn, x * turn, np.zeros_like(turn)))
        return self.floor + self.amplitude * np.abs(wave), gradient


#: The RCS models that a scenario can name, besides a table. Their keys are declared with their
#: fields.
RCS_MODELS: dict[str, type[Any]] = {
    "constant": ConstantRCS,
    "ellipsoid": EllipsoidRCS,
    "ellipsoid_exact": ExactEllipsoidRCS,
    "spikeball": SpikeballRCS,
}
