"""Several radars that look at one aircraft: the probability that at least one detects it.

Receiver noise and target fluctuation are independent from radar to radar. For given states,
detections are therefore independent, and

    P_D = 1 − Π (1 − P_i).

All radars look at one aircraft with one position and attitude. A network is one function of one
state, x_a (..., 6) and the states of all radars (..., 4m) or (..., 7m), see `states`. Propagation
and draws of this state include the dependence between the radars.

A radar may have limits beyond which P_i = 0. Such an edge has no gradient. A gradient, and moments
propagated with it, depend only on the side of the edge where the nominal states are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from radar_sense.errors import InputError, counted, shorten_list
from radar_sense.model.detection_model import DetectionModel, Linearization
from radar_sense.model.fusion import UNSEEN, either, fuse_probits, linearize_fusion, slopes_of_p_d
from radar_sense.model.geometry import join
from radar_sense.model.radar import Radar
from radar_sense.states import FloatArray, checked_states, components_first, of_each, real_array


@dataclass(frozen=True)
class NetworkModel:
    """Probability that at least one of m radars detects an aircraft with a single pulse.

    A network has the methods of a `DetectionModel`, with radar states (..., 4m) or (..., 7m).

    Attributes:
        radars: The radars, one or more.
    """

    radars: tuple[Radar, ...]

    def __post_init__(self) -> None:
        given: Any = self.radars
        if not isinstance(given, tuple | list) or not given:
            raise InputError(f"radars must be a tuple of one radar or more, got {given!r}")
        for radar in given:
            if not isinstance(radar, Radar):
                raise InputError(f"radars must be of class Radar, got {radar!r}")
        object.__setattr__(self, "radars", tuple(self.radars))
        if len(self.radars) > 1 and not all(radar.name for radar in self.radars):
            raise InputError("every radar of a network needs a name")
        for i, name in enumerate(self.names):
            if name in self.names[:i]:
                raise InputError(f"every radar needs a name of its own, {name!r} is there twice")

    def __repr__(self) -> str:
        return f"<NetworkModel: {self.in_words}>"

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
        return f"{counted(count, 'radar')}{names}"

    def visible(self, aircraft: ArrayLike, radar: ArrayLike) -> NDArray[np.bool_]:
        """Return which radars (..., m) see the aircraft."""
        states = of_each(real_array("radar states", radar), len(self.radars))
        each = zip(self.radars, states, strict=True)
        return np.stack([single.visible(aircraft, state) for single, state in each], axis=-1)

    def snr(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Return the signal-to-noise ratio at each radar (..., m), 0 where it sees no aircraft."""
        aircraft, radar = checked_states(aircraft, radar, len(self.radars))
        return join(self._each(DetectionModel.unchecked_snr, aircraft, radar))

    def p_d(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Return the probability of detection by at least one radar (...)."""
        return self.unchecked_p_d(*checked_states(aircraft, radar, len(self.radars)))

    def unchecked_p_d(self, aircraft: FloatArray, radar: FloatArray) -> FloatArray:
        """Return `p_d` of states that have been checked."""
        # one radar after the other: no more than two arrays at a time
        return reduce(either, self._each(DetectionModel.unchecked_p_d, aircraft, radar))

    def linearize(self, aircraft: ArrayLike, radar: ArrayLike) -> Linearization:
        """Return P_D by at least one radar, and its partials by aircraft and radar states.

        `jac_radar` has the shape of the radar states. P_D and its partials are 0 where no radar
        sees the aircraft.
        """
        return self.unchecked_linearize(*checked_states(aircraft, radar, len(self.radars)))

    def unchecked_linearize(self, aircraft: FloatArray, radar: FloatArray) -> Linearization:
        """Return `linearize` of states that have been checked."""
        visible = self.visible(aircraft, radar)
        z, by_aircraft, by_radar = self._each_probit(aircraft, radar, visible)
        fused = reduce(either, map(ndtr, z))
        return Linearization(fused, *_weighted(slopes_of_p_d(z), by_aircraft, by_radar))

    def linearize_probit(
        self, aircraft: ArrayLike, radar: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the fused probit z = Φ⁻¹(P_D) (...), and its partials by both states.

        z is minus infinity where no radar sees the aircraft.
        """
        aircraft, radar = checked_states(aircraft, radar, len(self.radars))
        visible = self.visible(aircraft, radar)
        z, by_aircraft, by_radar = self.extrapolated_probit(aircraft, radar, visible)
        return np.where(visible.any(axis=-1), z, -np.inf)[()], by_aircraft, by_radar

    def extrapolated_probit(
        self, aircraft: FloatArray, radar: FloatArray, visible: NDArray[np.bool_]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return a smooth z and its partials, for expansions about a state.

        A radar constant below 0 counts as 0, where z has its floor. For smoothness each z_i is
        extrapolated linearly below c_r = 0 before fusion. The fused P_D is then too low by less
        than the sum of the P_fa of the radars with c_r < 0. A method applies the floor last:
        quantiles of max(z, floor) are max(quantile of z, floor).

        Args:
            aircraft: (..., 6).
            radar: (..., 4m) or (..., 7m); c_r may be negative.
            visible: Radars (..., m) taken to see the aircraft; z is -1e6 where none does.
        """
        z, by_aircraft, by_radar = self._each_probit(aircraft, radar, visible)
        if len(z) == 1:  # fusion changes nothing, and takes ten times as long as z
            return z[0], by_aircraft[0], by_radar[0]
        fused, weight = linearize_fusion(z)
        return (fused, *_weighted(weight, by_aircraft, by_radar))

    def floor(self, visible: NDArray[np.bool_]) -> FloatArray:
        """Return the fused z (...) without any signal; -1e6 where no radar sees the aircraft."""
        floors = [m.detector.linearize_probit(np.zeros(()), m.p_fa)[0] for m in self.models]
        lowest = [np.where(visible[..., i], z, UNSEEN) for i, z in enumerate(floors)]
        return fuse_probits(np.stack(lowest))

    def _each(
        self,
        quantity: Callable[[DetectionModel, FloatArray, FloatArray], FloatArray],
        aircraft: FloatArray,
        radar: FloatArray,
    ) -> Iterator[FloatArray]:
        """Yield a quantity (...) of each radar, 0 where the radar does not see the aircraft."""
        horizons = {single.horizon for single in self.radars if single.horizon is not None}
        heights = {horizon: horizon.height(aircraft) for horizon in horizons}
        for single, state in zip(self.radars, of_each(radar, len(self.radars)), strict=True):
            if not single.limited:
                yield quantity(single.model, aircraft, state)
                continue
            height = heights[single.horizon] if single.horizon else None
            visible = single.visible(aircraft, state, height)
            values, places = np.zeros(visible.shape), np.flatnonzero(visible)
            if places.size:
                seen = (_at(each, visible.shape, places) for each in (aircraft, state))
                values.reshape(-1)[places] = quantity(single.model, *seen)
            yield values[()]

    def _each_probit(
        self, aircraft: FloatArray, radar: FloatArray, visible: NDArray[np.bool_]
    ) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """Return z_i (m, ...) and its partials by the aircraft and by each radar.

        The arguments are as of `extrapolated_probit`.
        """
        values, by_aircraft, by_radar = [], [], []
        for i, state in enumerate(of_each(radar, len(self.radars))):
            z, by_a, by_r = self.radars[i].model.unchecked_probit(aircraft, state)
            seen = visible[..., i]
            if not seen.all():
                z = np.where(seen, z, UNSEEN)
                by_a, by_r = (np.where(seen[..., np.newaxis], by, 0.0) for by in (by_a, by_r))
            values.append(z)
            by_aircraft.append(by_a)
            by_radar.append(by_r)
        return np.array(values), by_aircraft, by_radar


def as_network(model: DetectionModel | NetworkModel) -> NetworkModel:
    """Return the network of one radar for a detection model, or a network unchanged."""
    if isinstance(model, NetworkModel):
        return model
    if isinstance(model, DetectionModel):
        return NetworkModel((Radar(model),))
    raise InputError(f"model must be a DetectionModel or a NetworkModel, got {model!r}")


def _at(states: FloatArray, shape: tuple[int, ...], places: NDArray[np.intp]) -> FloatArray:
    """Return the states (j, n) at places (j,) of states (..., n) broadcast to a shape (...)."""
    n = states.shape[-1]
    components = components_first(np.broadcast_to(states, (*shape, n))).reshape(n, -1)
    return components.take(places, axis=1).T  # several times as fast as by a mask


def _weighted(
    weight: FloatArray, by_aircraft: Sequence[FloatArray], by_radar: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return fused partials by the aircraft state and by the states of all radars."""
    factors = weight[..., np.newaxis]
    together = factors[0] * by_aircraft[0]
    for factor, partials in zip(factors[1:], by_aircraft[1:], strict=True):
        together += factor * partials
    parts = [factor * partials for factor, partials in zip(factors, by_radar, strict=True)]
    return together, np.concatenate(parts, axis=-1)
