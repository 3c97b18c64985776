"""Several radars that look at one aircraft: the probability that at least one detects it.

Receiver noise and target fluctuation are independent from radar to radar. For given states,
detections are therefore independent, and

    P_D = 1 − Π (1 − P_i).

The states are shared: all radars look at one aircraft with one position and attitude. A network is
one function of one state, x_a (..., 6) and the states of all radars (..., 4m). Propagation and
draws of this state include the dependence between the radars.

With z_i = Φ⁻¹(P_i), radar i misses with probability Q_i = Φ(−z_i). Q_i keeps its digits where P_i
rounds to 1. The fused values are

    Q = Π Q_i,  z = Φ⁻¹(1 − Q),  ∂z/∂z_i = (Q/Q_i) φ(z_i)/φ(z),  ∂P_D/∂z_i = (Q/Q_i) φ(z_i).

A radar may have limits beyond which P_i = 0. Such an edge has no gradient. A gradient, and moments
propagated with it, depend only on the side of the edge where the nominal states are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri_exp

from radar_sense.errors import InputError, shorten_list
from radar_sense.limits import NOT_NEGATIVE, POSITIVE, check_number
from radar_sense.model.detection_model import DetectionModel, Linearization
from radar_sense.model.geometry import join, slant_range
from radar_sense.model.horizon import Horizon, horizon_range
from radar_sense.model.normal import density, hazard
from radar_sense.model.radar_constant import DataSheet
from radar_sense.model.rcs import RCS
from radar_sense.states import (
    AIRCRAFT_RCS,
    ATTENUATION_ERROR,
    CONSTANT,
    RADAR,
    RCS_ERROR,
    FloatArray,
    check_finite,
    components_of,
    real_array,
    sizes_of,
)

#: z of a radar that does not see the target. Minus infinity would make sums NaN, and Φ(−1e6) is 0.
_UNSEEN = -1e6
#: Below Φ(−9) = 1e-19, P_D equals the sum of all P_i in double precision.
_RARE = -9.0
_LOG_HALF = math.log(0.5)
#: Above this z the rounding of φ(z)/Φ(−z) − z exceeds the error of a short continued fraction.
_LARGE = 100.0


@dataclass(frozen=True)
class Radar:
    """One radar of a network: its detection model and its limits.

    Attributes:
        model: RCS, P_fa and detector.
        name: Name in tables and reports. The single radar of a network of one needs no name.
        max_range: Slant range beyond which P_D is 0 [m].
        horizon: Horizon below which P_D is 0; None for a transparent earth, as in the paper.
        scan_period: Time from one look to the next [s]; None if unknown.
        min_range: Slant range within which P_D is 0 [m].
        sheet: The data sheet that c_r was computed from, or None.
    """

    model: DetectionModel
    name: str = ""
    max_range: float = math.inf
    horizon: Horizon | None = None
    scan_period: float | None = None
    min_range: float = 0.0
    sheet: DataSheet | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.model, DetectionModel):
            raise InputError(f"model must be a DetectionModel, got {self.model!r}")
        if not isinstance(self.name, str):
            raise InputError(f"name must be text, got {self.name!r}")
        if self.max_range != math.inf:
            max_range = check_number("max_range", self.max_range, POSITIVE)
            object.__setattr__(self, "max_range", max_range)
        object.__setattr__(
            self, "min_range", check_number("min_range", self.min_range, NOT_NEGATIVE)
        )
        if self.min_range >= self.max_range:
            raise InputError(
                f"min_range must be less than max_range, {self.max_range:g}, got {self.min_range:g}"
            )
        if not isinstance(self.horizon, Horizon | None):
            raise InputError(f"horizon must be a Horizon() or None, got {self.horizon!r}")
        if self.scan_period is not None:
            period = check_number("scan_period", self.scan_period, POSITIVE)
            object.__setattr__(self, "scan_period", period)

    def visible(
        self, aircraft: ArrayLike, radar: ArrayLike, height: FloatArray | None = None
    ) -> NDArray[np.bool_]:
        """Return where (...) aircraft (..., 6) are within the limits of a radar (..., 4).

        Args:
            aircraft: States of the aircraft.
            radar: States of the radar.
            height: Heights (...) [m] of the aircraft for the horizon; computed if None.
        """
        aircraft, radar = np.asarray(aircraft, dtype=float), np.asarray(radar, dtype=float)
        visible = np.ones(np.broadcast_shapes(aircraft.shape[:-1], radar.shape[:-1]), dtype=bool)
        if not self.limited:
            return visible
        distance = slant_range(aircraft, radar)
        if self.max_range < math.inf:
            visible &= distance <= self.max_range
        if self.min_range > 0:
            visible &= distance >= self.min_range
        if self.horizon is not None:
            height = self.horizon.height(aircraft) if height is None else height
            visible &= distance <= horizon_range(self.horizon.height(radar), height)
        return visible

    def without_limits(self) -> Radar:
        """Return the radar without minimum and maximum range and horizon."""
        return replace(self, min_range=0.0, max_range=math.inf, horizon=None)

    @property
    def limited(self) -> bool:
        """Whether the radar has a maximum range, a minimum range or a horizon."""
        return self.max_range < math.inf or self.min_range > 0 or self.horizon is not None


#: The name until version 0.1.
Station = Radar


@dataclass(frozen=True)
class NetworkModel:
    """Probability that at least one of m radars detects an aircraft with a single pulse.

    A network has the methods of a `DetectionModel`, with radar states (..., 4m): north, east, down
    [m] and c_r [J m²/K] of each radar in turn. The errors of further parameters may follow: ε of
    the RCS for all radars together, then the error of ln α of each radar; see `states`. A network
    of one radar equals its detection model bit for bit.

    Attributes:
        radars: The radars. All have the RCS of the one aircraft.
    """

    radars: tuple[Radar, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.radars, tuple | list) or not self.radars:
            raise InputError(f"radars must be a tuple of one radar or more, got {self.radars!r}")
        for radar in self.radars:
            if not isinstance(radar, Radar):
                raise InputError(f"radars must be of class Radar, got {radar!r}")
        object.__setattr__(self, "radars", tuple(self.radars))
        if any(radar.model.rcs != self.rcs for radar in self.radars):
            raise InputError("the radars of a network must have the RCS of one and the same target")
        if len(self.radars) > 1 and not all(radar.name for radar in self.radars):
            raise InputError("every radar of a network needs a name")
        problem = name_problem(self.names)
        if problem:
            raise InputError(problem)

    def __repr__(self) -> str:
        return f"<NetworkModel: {self.in_words}, {self.rcs!r}>"

    @property
    def rcs(self) -> RCS:
        """Radar cross section by aspect."""
        return self.radars[0].model.rcs

    @property
    def models(self) -> tuple[DetectionModel, ...]:
        """The detection model of each radar, without its limits."""
        return tuple(radar.model for radar in self.radars)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the radars (m,); () for a single radar without a name."""
        return tuple(radar.name for radar in self.radars if radar.name)

    @property
    def in_words(self) -> str:
        """The number of radars, and names of radars."""
        count = len(self.radars)
        names = f" ({shorten_list(self.names)})" if self.names else ""
        return f"{count} radar{'s' if count > 1 else ''}{names}"

    @property
    def sizes(self) -> tuple[int, int, int]:
        """How many components the radar states may have, without and with further errors."""
        return sizes_of(len(self.radars))

    @property
    def limited(self) -> bool:
        """Whether any radar has a limit to its range, or a horizon."""
        return any(radar.limited for radar in self.radars)

    def visible(self, aircraft: ArrayLike, radar: ArrayLike) -> NDArray[np.bool_]:
        """Return which radars (..., m) see the aircraft.

        Raises:
            ValueError: If a shape does not fit.
        """
        states = self.split(radar)
        visible = [r.visible(aircraft, state) for r, state in zip(self.radars, states, strict=True)]
        return np.stack(visible, axis=-1)

    def snr(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Return the signal-to-noise ratio at each radar (..., m), 0 where the aircraft is unseen.

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        return join(self._each(DetectionModel.snr, aircraft, radar))

    def p_d(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Return the probability of detection by at least one radar (...).

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        # one radar after the other: no more than two arrays at a time
        each = self._each(DetectionModel.p_d, aircraft, radar)
        fused = next(each)
        for p_d in each:
            fused = _either(fused, p_d)
        return fused

    def linearize(self, aircraft: ArrayLike, radar: ArrayLike) -> Linearization:
        """Return P_D by at least one radar, and its partials by aircraft and radar states.

        `jac_radar` is (..., 4m), and the partials by further errors follow. P_D and its partials
        are 0 where no radar sees the aircraft.

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        check_finite("aircraft", aircraft)
        check_finite("radar", radar, len(self.radars))
        if len(self.radars) == 1:
            (single,) = self.radars
            lin = single.model.linearize(aircraft, radar)
            if not single.limited:
                return lin
            visible = self.visible(aircraft, radar)
            return Linearization(
                np.where(visible[..., 0], lin.p_d, 0.0)[()],
                np.where(visible, lin.jac_aircraft, 0.0),
                np.where(visible, lin.jac_radar, 0.0),
            )
        visible = self.visible(aircraft, radar)
        z, by_aircraft, by_radar = self._each_probit(aircraft, radar, visible, extrapolated=False)
        missed = log_ndtr(-z)
        # ∂P_D/∂z_i = exp(ln Q − ln Q_i) φ(z_i)
        weight = np.exp(_others(missed)) * density(z)
        fused = ndtr(z[0])
        for part in z[1:]:
            fused = _either(fused, ndtr(part))
        return Linearization(fused, *_weighted(weight, by_aircraft, by_radar))

    def linearize_probit(
        self, aircraft: ArrayLike, radar: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the fused probit z = Φ⁻¹(P_D), minus infinity where no radar sees the aircraft.

        Returns:
            z (...), its partials by the aircraft state (..., 6) and by radar states (..., 4m).

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        if len(self.radars) == 1 and not self.limited:
            return self.radars[0].model.linearize_probit(aircraft, radar)
        check_finite("aircraft", aircraft)
        check_finite("radar", radar, len(self.radars))
        visible = self.visible(aircraft, radar)
        z, by_aircraft, by_radar = self._fused_probit(aircraft, radar, visible, extrapolated=False)
        return np.where(visible.any(axis=-1), z, -np.inf)[()], by_aircraft, by_radar

    def p_d_and_probit(self, aircraft: ArrayLike, radar: ArrayLike) -> tuple[FloatArray, ...]:
        """Return P_D (...) and the values of `linearize_probit`, from one computation of each S.

        Raises:
            ValueError: As `linearize_probit`.
        """
        if len(self.radars) == 1 and not self.limited:
            return self.radars[0].model.p_d_and_probit(aircraft, radar)
        return self.p_d(aircraft, radar), *self.linearize_probit(aircraft, radar)

    def extrapolated_probit(
        self,
        aircraft: FloatArray,
        radar: FloatArray,
        visible: NDArray[np.bool_],
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return a smooth z and its partials, for expansions about a state.

        A radar constant below 0 counts as 0, where z has its floor. For smoothness each z_i is
        extrapolated linearly below c_r = 0 before fusion. The fused P_D is then too low by less
        than the sum of the P_fa of the radars with c_r < 0. A method applies the floor last:
        quantiles of max(z, floor) are max(quantile of z, floor).

        Args:
            aircraft: (k, 6).
            radar: (k, 4m); c_r may be negative.
            visible: Radars (k, m) that see the aircraft, at all states; z is -1e6 where none does.
        """
        if len(self.radars) == 1 and visible.all():
            return _extrapolated(self.radars[0].model, aircraft, radar)
        return self._fused_probit(aircraft, radar, visible, extrapolated=True)

    def floor(self, visible: NDArray[np.bool_]) -> FloatArray:
        """Return the fused z (...) without any signal; -1e6 where no radar sees the aircraft."""
        floors = [m.detector.linearize_probit(np.zeros(()), m.p_fa)[0] for m in self.models]
        lowest = [np.where(visible[..., i], z, _UNSEEN) for i, z in enumerate(floors)]
        return fuse_probits(np.stack(lowest))

    def split(self, radar: ArrayLike) -> list[FloatArray]:
        """Split radar states (..., 4m) into the state of each radar (..., 4).

        Each state has the errors of the RCS and of its attenuation too, up to (..., 6), where the
        radar states have these errors.

        Raises:
            ValueError: If the shape does not fit.
        """
        states, size, count = real_array("radar states", radar), len(RADAR), len(self.radars)
        total = states.shape[-1] if states.ndim else 0
        if total not in self.sizes:
            of_each = f" of each of {count} radars" if count > 1 else ""
            raise ValueError(
                f"radar states must have shape (..., {size * count}) for {', '.join(RADAR)}"
                f"{of_each}, got {states.shape}"
            )
        if total == size * count:
            return [states[..., size * i : size * (i + 1)] for i in range(count)]
        if count == 1:
            return [states]
        return [
            join(states[..., component] for component in components_of([i], count, total))
            for i in range(count)
        ]

    def _each(
        self,
        quantity: Callable[[DetectionModel, ArrayLike, ArrayLike], FloatArray],
        aircraft: ArrayLike,
        radar: ArrayLike,
    ) -> Iterator[FloatArray]:
        """Yield a quantity (...) of each radar, 0 where the radar does not see the aircraft."""
        check_finite("radar", radar, len(self.radars))
        heights: dict[Horizon, FloatArray] = {}
        for single, state in zip(self.radars, self.split(radar), strict=True):
            if not single.limited:
                yield quantity(single.model, aircraft, state)
                continue
            if single.horizon is not None and single.horizon not in heights:
                heights[single.horizon] = single.horizon.height(np.asarray(aircraft, dtype=float))
            height = None if single.horizon is None else heights[single.horizon]
            visible = single.visible(aircraft, state, height)
            values = np.zeros(visible.shape)
            if visible.any():
                seen = (
                    _at(np.asarray(states, dtype=float), visible) for states in (aircraft, state)
                )
                values[visible] = quantity(single.model, *seen)
            yield values[()]

    def _each_probit(
        self,
        aircraft: ArrayLike,
        radar: ArrayLike,
        visible: NDArray[np.bool_],
        *,
        extrapolated: bool,
    ) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """Return z_i (m, ...) and the partials of each, (..., 6) and (..., 4 to 6)."""
        values, by_aircraft, by_radar = [], [], []
        for i, (model, state) in enumerate(zip(self.models, self.split(radar), strict=True)):
            one = visible[..., i : i + 1]
            if extrapolated:
                z, by_a, by_r = _extrapolated(model, np.asarray(aircraft), state)
            else:
                z, by_a, by_r = model.linearize_probit(aircraft, state)
            if not one.all():
                z = np.where(one[..., 0], z, _UNSEEN)
                by_a, by_r = np.where(one, by_a, 0.0), np.where(one, by_r, 0.0)
            values.append(z)
            by_aircraft.append(by_a)
            by_radar.append(by_r)
        return np.stack(values), by_aircraft, by_radar

    def _fused_probit(
        self,
        aircraft: ArrayLike,
        radar: ArrayLike,
        visible: NDArray[np.bool_],
        *,
        extrapolated: bool,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        z, by_aircraft, by_radar = self._each_probit(
            aircraft, radar, visible, extrapolated=extrapolated
        )
        if len(z) == 1:
            return z[0], by_aircraft[0], by_radar[0]
        fused, weight = linearize_fusion(z)
        return (fused, *_weighted(weight, by_aircraft, by_radar))


def _at(states: FloatArray, mask: NDArray[np.bool_]) -> FloatArray:
    """Return the states (j, n) of broadcast states (..., n) where a mask (...) is True."""
    return join(np.broadcast_to(states[..., i], mask.shape)[mask] for i in range(states.shape[-1]))


def as_network(model: DetectionModel | NetworkModel) -> NetworkModel:
    """Return the network of one radar for a detection model, or a network unchanged."""
    if isinstance(model, NetworkModel):
        return model
    if isinstance(model, DetectionModel):
        return NetworkModel((Radar(model),))
    raise InputError(f"model must be a DetectionModel or a NetworkModel, got {model!r}")


def _extrapolated(
    model: DetectionModel, aircraft: FloatArray, radar: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return z of states (k, 6) and (k, 4 to 6) and its partials, linear below c_r = 0."""
    below_zero = np.minimum(radar[:, CONSTANT], 0.0)
    # Unchecked, because a diverging search reaches states that are not finite.
    if not below_zero.any():
        return model.unchecked_probit(aircraft, radar)
    radar = radar.copy(order="K")
    radar[:, CONSTANT] -= below_zero
    value, by_aircraft, by_radar = model.unchecked_probit(aircraft, radar)
    return value + by_radar[:, CONSTANT] * below_zero, by_aircraft, by_radar


def name_problem(names: Sequence[str]) -> str | None:
    """Return why these names of radars collide with rows of a budget, or None."""
    taken = {"total", "all", "interaction", "aircraft", "aircraft_position", "aircraft_orientation"}
    taken.add(AIRCRAFT_RCS)
    taken |= {f"error_{name}" for name in taken}  # share_error_... is a column too
    for name in names:
        parts = (f"{name}_{part}" for part in ("position", "constant", "attenuation"))
        for row in (name, *parts, f"error_{name}"):
            if row in taken:
                return f"radars cannot be named {', '.join(names)}: {row!r} would mean two things"
            taken.add(row)
    for name in names:  # rows of the tolerances of c_r
        for start in (f"{name}_constant_", f"error_{name}_constant_"):
            if any(row.startswith(start) for row in taken):
                return f"radars cannot be named {', '.join(names)}: {start!r} begins parts of c_r"
    return None


def _either(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return 1 − (1 − p)(1 − q) without cancellation, never above 1."""
    return p + (1.0 - p) * q


def _others(log_missed: FloatArray) -> FloatArray:
    """Return, for each radar, the sum over all others (m, ...), without subtraction."""
    others = np.zeros_like(log_missed)
    for i, missed in enumerate(log_missed):
        others[:i] += missed
        others[i + 1 :] += missed
    return others


def fuse_probits(z: FloatArray) -> FloatArray:
    """Return the fused z (...) of the z_i (m, ...), from the lesser of P_D and 1 − P_D."""
    if len(z) == 1:
        one: FloatArray = z[0]
        return one
    missed = np.sum(log_ndtr(-z), axis=0)  # ln Q
    upper = missed < _LOG_HALF
    rare = z.max(axis=0) < _RARE
    hit = np.log(-np.expm1(np.where(rare | upper, -1.0, missed)))
    hit = np.where(rare, np.logaddexp.reduce(log_ndtr(np.where(rare, z, 0.0)), axis=0), hit)
    fused: FloatArray = np.where(upper, -ndtri_exp(missed), ndtri_exp(np.where(upper, -1.0, hit)))
    return fused


def linearize_fusion(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the fused z (...) of the z_i (m, ...), and its partials ∂z/∂z_i (m, ...)."""
    fused = fuse_probits(z)
    # φ(z_i)/φ(z) from the difference of squares, so that neither underflows
    log_weight = _others(log_ndtr(-z)) + 0.5 * (fused - z) * (fused + z)
    return fused, np.exp(np.minimum(log_weight, 0.0))  # at most 1 without rounding


def excess_hazard(z: FloatArray) -> FloatArray:
    """Return e(z) = φ(z)/Φ(−z) − z (...), which is positive.

    The partials w_i = ∂z/∂z_i of the fused z have the derivatives

        ∂w_i/∂z_j = δ_ij w_i e(z_i) − w_i w_j e(z),

    because φ(z)/Φ(−z) is the derivative of −ln Φ(−z), and z the derivative of −ln φ(z). For large
    z, e(z) is the continued fraction 1/(z + 2/(z + 3/(z + …))) (DLMF 7.9.1).
    """
    large = np.maximum(z, _LARGE)
    excess: FloatArray = np.where(
        z < _LARGE, hazard(z) - z, 1.0 / (large + 2.0 / (large + 3.0 / (large + 4.0 / large)))
    )
    return excess


def _weighted(
    weight: FloatArray, by_aircraft: Sequence[FloatArray], by_radar: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return fused partials by the aircraft state and by the states of all radars.

    The partial by the error of the RCS is a sum over the radars, because all radars have the same
    error.
    """
    factors = weight[..., np.newaxis]
    together = factors[0] * by_aircraft[0]
    for factor, partials in zip(factors[1:], by_aircraft[1:], strict=True):
        together += factor * partials
    parts = [factor * partials for factor, partials in zip(factors, by_radar, strict=True)]
    shared = [part[..., RCS_ERROR:ATTENUATION_ERROR] for part in parts]
    if shared[0].shape[-1]:
        states = (part[..., :RCS_ERROR] for part in parts)
        attenuations = (part[..., ATTENUATION_ERROR:] for part in parts)
        parts = [*states, np.sum(shared, axis=0), *attenuations]
    return together, np.concatenate(parts, axis=-1)
