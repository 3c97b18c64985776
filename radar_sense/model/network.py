"""Several radars that look at one aircraft: the probability that at least one detects it.

Given the states, the radars' receivers are independent of each other (each has a noise of its own;
that a target fluctuates is independent from radar to radar too), and so, `·` over all radars,

    P_D = 1 − Π (1 − P_i).

The states are not: every radar looks at the same aircraft, in the same position and attitude. So a
network is one function of one state, x_a (..., 6) and the radars' (..., 4m) one after the other,
and whoever propagates or draws that state has the part that they share right.

In terms of z_i = Φ⁻¹(P_i) a miss has the probability Q_i = Φ(−z_i), which keeps its digits where
P_i rounds to 1, and

    Q = Π Q_i,  z = Φ⁻¹(1 − Q),  ∂z/∂z_i = (Q/Q_i) φ(z_i)/φ(z),  ∂P_D/∂z_i = (Q/Q_i) φ(z_i).

A radar may have limits beyond which it sees nothing, P_i = 0. Such an edge has no gradient: draws
see it where they are, while a gradient, and what is propagated by it, knows only on which side of
it the nominal states are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri_exp

from radar_sense.model.detection_model import DetectionModel, Linearization
from radar_sense.model.geometry import join, slant_range
from radar_sense.model.horizon import Horizon
from radar_sense.model.rcs import RCS
from radar_sense.states import RADAR, FloatArray, check_finite

#: z of a radar that does not see the target, in sums that minus infinity would make NaN: no z is
#: as low as the logarithm of the least number there is, and Φ(−1e6) is 0.
_UNSEEN = -1e6
#: Below Φ(−9) = 1e-19 probabilities simply add up, as far as double precision can tell.
_RARE = -9.0
_LOG_HALF = math.log(0.5)


@dataclass(frozen=True)
class Station:
    """One radar of a network: how it detects, and how far it sees.

    Attributes:
        model: RCS, P_fa and detector.
        name: What to call it.
        max_range: Slant range beyond which it sees nothing [m].
        horizon: The horizon that hides what is below it; None to see through the earth, as the
            paper does.
        scan_period: Time from one look to the next [s], for what goes along a mission; None if it
            is not known.
    """

    model: DetectionModel
    name: str = "radar"
    max_range: float = math.inf
    horizon: Horizon | None = None
    scan_period: float | None = None

    def __post_init__(self) -> None:
        if not self.max_range > 0:
            raise ValueError(f"max_range must be greater than 0, got {self.max_range}")
        if self.scan_period is not None and not 0 < self.scan_period < math.inf:
            raise ValueError(f"scan_period must be greater than 0, got {self.scan_period}")

    def visible(self, aircraft: ArrayLike, radar: ArrayLike) -> NDArray[np.bool_]:
        """Say where (...) aircraft (..., 6) are within the limits of a radar (..., 4)."""
        aircraft, radar = np.asarray(aircraft, dtype=float), np.asarray(radar, dtype=float)
        shape = np.broadcast_shapes(aircraft.shape[:-1], radar.shape[:-1])
        seen = np.ones(shape, dtype=bool)
        if self.max_range < math.inf:
            seen &= slant_range(aircraft, radar) <= self.max_range
        if self.horizon is not None:
            seen &= self.horizon.visible(aircraft, radar)
        return seen

    @property
    def limited(self) -> bool:
        """Whether there is anything that it does not see."""
        return self.max_range < math.inf or self.horizon is not None


@dataclass(frozen=True)
class NetworkModel:
    """Probability that at least one of m radars detects an aircraft with a single pulse.

    It is used as a `DetectionModel` is, with radar states (..., 4m): north, east, down [m] and c_r
    [J m²/K] of the first radar, then of the second, and so on. A network of one is the single
    radar, bit for bit.

    Attributes:
        stations: The radars; all see the same aircraft, and have the same RCS therefore.
    """

    stations: tuple[Station, ...]

    def __post_init__(self) -> None:
        if not self.stations:
            raise ValueError("a network needs at least one radar")
        if any(station.model.rcs != self.rcs for station in self.stations):
            raise ValueError("the radars of a network must have the RCS of one and the same target")
        problem = name_problem(self.names)
        if problem:
            raise ValueError(problem)

    @property
    def rcs(self) -> RCS:
        """Radar cross section by aspect."""
        return self.stations[0].model.rcs

    @property
    def models(self) -> tuple[DetectionModel, ...]:
        """The detection model of each radar, without its limits."""
        return tuple(station.model for station in self.stations)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the radars."""
        return tuple(station.name for station in self.stations)

    @property
    def limited(self) -> bool:
        """Whether there is anything that a radar does not see."""
        return any(station.limited for station in self.stations)

    def visible(self, aircraft: ArrayLike, radar: ArrayLike) -> NDArray[np.bool_]:
        """Say which radars (..., m) see the aircraft.

        Raises:
            ValueError: If a shape does not fit.
        """
        states = self._split(radar)
        seen = [s.visible(aircraft, r) for s, r in zip(self.stations, states, strict=True)]
        return np.stack(seen, axis=-1)

    def snr(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Signal-to-noise ratio at each radar (..., m), 0 where it does not see the aircraft.

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        return join(self._each(DetectionModel.snr, aircraft, radar))

    def p_d_each(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Probability of detection by each radar (..., m).

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        return join(self._each(DetectionModel.p_d, aircraft, radar))

    def p_d(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Probability of detection by at least one radar (...).

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
        """Fused probability of detection, its partials for the aircraft and for all radars.

        `jac_radar` is (..., 4m). Where no radar sees the aircraft all of it is 0.

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        check_finite("aircraft", aircraft)
        check_finite("radar", radar)
        if len(self.stations) == 1:
            (station,) = self.stations
            lin = station.model.linearize(aircraft, radar)
            if not station.limited:
                return lin
            seen = self.visible(aircraft, radar)
            return Linearization(
                np.where(seen[..., 0], lin.p_d, 0.0)[()],
                np.where(seen, lin.jac_aircraft, 0.0),
                np.where(seen, lin.jac_radar, 0.0),
            )
        seen = self.visible(aircraft, radar)
        z, by_aircraft, by_radar = self._each_probit(aircraft, radar, seen, continued=False)
        missed = log_ndtr(-z)
        # ∂P_D/∂z_i = exp(ln Q − ln Q_i) φ(z_i)
        weight = np.exp(_others(missed) - 0.5 * z * z) / math.sqrt(2.0 * math.pi)
        fused = ndtr(z[0])
        for part in z[1:]:
            fused = _either(fused, ndtr(part))
        return Linearization(fused, *_weighted(weight, by_aircraft, by_radar))

    def linearize_probit(
        self, aircraft: ArrayLike, radar: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The fused probit z = Φ⁻¹(P_D), minus infinity where no radar sees the aircraft.

        Returns:
            z (...), its partials for the aircraft (..., 6) and for the radars (..., 4m).

        Raises:
            ValueError: If a shape does not fit, a state is not finite or a radar constant is
                negative.
        """
        check_finite("aircraft", aircraft)
        check_finite("radar", radar)
        seen = self.visible(aircraft, radar)
        z, by_aircraft, by_radar = self._fused_probit(aircraft, radar, seen, continued=False)
        return np.where(seen.any(axis=-1), z, -np.inf)[()], by_aircraft, by_radar

    def continued_probit(
        self, aircraft: FloatArray, radar: FloatArray, visible: NDArray[np.bool_]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The fused probit as a smooth function, see `Model`; -1e6 where none is `visible`.

        Each z_i goes on below c_r = 0 on its own, and is fused then. The fused P_D is too low there
        by less than what those radars detect of noise alone, which is about their P_fa.
        """
        return self._fused_probit(aircraft, radar, visible, continued=True)

    def floor(self, visible: NDArray[np.bool_]) -> FloatArray:
        """The least fused z (...) there is, that without any signal; -1e6 where none is visible."""
        floors = [m.floor(visible[..., :1]) for m in self.models]
        lowest = [np.where(visible[..., i], z, _UNSEEN) for i, z in enumerate(floors)]
        return _fuse(np.stack(lowest))

    def _split(self, radar: ArrayLike) -> list[FloatArray]:
        """Take radar states (..., 4m) apart into those of each radar (..., 4)."""
        states, size = np.asarray(radar, dtype=float), len(RADAR)
        if states.shape[-1:] != (size * len(self.stations),):
            raise ValueError(
                f"radar states must have shape (..., {size * len(self.stations)}) for "
                f"{', '.join(RADAR)} of each of {len(self.stations)} radars, got {states.shape}"
            )
        return [states[..., size * i : size * (i + 1)] for i in range(len(self.stations))]

    def _each(
        self,
        quantity: Callable[[DetectionModel, ArrayLike, ArrayLike], FloatArray],
        aircraft: ArrayLike,
        radar: ArrayLike,
    ) -> Iterator[FloatArray]:
        """Give a quantity (...) of each radar, 0 where that does not see the aircraft."""
        check_finite("radar", radar)
        for station, state in zip(self.stations, self._split(radar), strict=True):
            values = quantity(station.model, aircraft, state)
            if station.limited:
                values = np.where(station.visible(aircraft, state), values, 0.0)[()]
            yield values

    def _each_probit(
        self, aircraft: ArrayLike, radar: ArrayLike, seen: NDArray[np.bool_], *, continued: bool
    ) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """z_i (m, ...) and the partials of each, (..., 6) and (..., 4)."""
        values, by_aircraft, by_radar = [], [], []
        for i, state in enumerate(self._split(radar)):
            model, one = self.models[i], seen[..., i : i + 1]
            z, by_a, by_r = (
                model.continued_probit(np.asarray(aircraft), state, one)
                if continued
                else model.linearize_probit(aircraft, state)
            )
            values.append(np.where(one[..., 0], z, _UNSEEN))
            by_aircraft.append(np.where(one, by_a, 0.0))
            by_radar.append(np.where(one, by_r, 0.0))
        return np.stack(values), by_aircraft, by_radar

    def _fused_probit(
        self, aircraft: ArrayLike, radar: ArrayLike, seen: NDArray[np.bool_], *, continued: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        z, by_aircraft, by_radar = self._each_probit(aircraft, radar, seen, continued=continued)
        if len(z) == 1:
            return z[0], by_aircraft[0], by_radar[0]
        fused = _fuse(z)
        # φ(z_i)/φ(z) from the difference of squares, so that neither underflows
        log_weight = _others(log_ndtr(-z)) + 0.5 * (fused - z) * (fused + z)
        weight = np.exp(np.minimum(log_weight, 0.0))  # at most 1, but for rounding where z is huge
        return (fused, *_weighted(weight, by_aircraft, by_radar))


def name_problem(names: Sequence[str]) -> str | None:
    """Say why radars cannot have these names, or None if they can: a budget has rows for each."""
    taken = {"total", "all", "interaction", "aircraft", "aircraft_position", "aircraft_orientation"}
    taken |= {f"error_{name}" for name in taken}  # share_error_... is a column too
    for name in names:
        for row in (name, f"{name}_position", f"{name}_constant", f"error_{name}"):
            if row in taken:
                return f"radars cannot be named {', '.join(names)}: {row!r} would mean two things"
            taken.add(row)
    for name in names:  # rows for the parts of c_r, whatever they are
        for start in (f"{name}_constant_", f"error_{name}_constant_"):
            if any(row.startswith(start) for row in taken):
                return f"radars cannot be named {', '.join(names)}: {start!r} begins parts of c_r"
    return None


def _either(p: FloatArray, q: FloatArray) -> FloatArray:
    """1 − (1 − p)(1 − q), without a difference of nearly equal numbers, and never above 1."""
    return p + (1.0 - p) * q


def _others(log_missed: FloatArray) -> FloatArray:
    """Sum over all radars but one, for each (m, ...), without subtracting."""
    m = len(log_missed)
    return np.stack([np.sum(np.delete(log_missed, i, axis=0), axis=0) for i in range(m)])


def _fuse(z: FloatArray) -> FloatArray:
    """Fused z (...) of the z_i (m, ...), from the lesser of P_D and 1 − P_D."""
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


def _weighted(
    weight: FloatArray, by_aircraft: Sequence[FloatArray], by_radar: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Fuse partials: those for the aircraft add up, those for the radars stand side by side."""
    factors = weight[..., np.newaxis]
    together = factors[0] * by_aircraft[0]
    for factor, partials in zip(factors[1:], by_aircraft[1:], strict=True):
        together += factor * partials
    parts = [f * partials for f, partials in zip(factors, by_radar, strict=True)]
    return together, np.concatenate(parts, axis=-1)
