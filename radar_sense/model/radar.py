"""One radar: what detects, where it stands and how far it sees, and how uncertain that is."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.covariance import checked, largest_variance, variance_along
from radar_sense.errors import InputError, check_choice, describe
from radar_sense.limits import (
    BAND,
    LEVEL_NAME,
    NOT_NEGATIVE,
    POSITIVE,
    Limit,
    check_number,
    check_parameters,
    declared,
)
from radar_sense.model.antenna import Mask
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.geometry import slant_range
from radar_sense.model.horizon import Horizon, horizon_range
from radar_sense.model.radar_constant import DataSheet, Tolerance
from radar_sense.states import (
    CONSTANT,
    DOWN,
    FACTOR_ERRORS,
    FACTORS,
    RADAR,
    FloatArray,
    ReadOnly,
    check_finite,
    read_only,
    with_errors,
)

#: Whether a radar sees an aircraft whose position is uncertain, see `Radar.sight`.
NEVER, PERHAPS, ALWAYS = np.arange(3, dtype=np.int8)


@dataclass(frozen=True, eq=False)
class Level(ReadOnly):
    """The uncertainty of a radar at one level.

    Attributes:
        covariance: C_rr (4, 4). Of a c_r with tolerances it has the variance to first order.
        tolerances: Tolerances that make c_r uncertain; () for a Gaussian c_r.
        errors: Standard deviations of the errors of factors of the model, by parameter:
            {"attenuation": of ln α, "tilt": of the tilt of the antenna [rad]}.
    """

    covariance: FloatArray
    tolerances: tuple[Tolerance, ...] = ()
    errors: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        matrix, n = read_only("radar covariance", self.covariance), len(RADAR)
        if matrix.shape != (n, n):
            raise InputError(f"radar covariance must have shape {(n, n)}, got {matrix.shape}")
        object.__setattr__(self, "covariance", checked("radar", matrix, n))
        given: Any = self.tolerances
        if not isinstance(given, tuple | list) or not all(isinstance(t, Tolerance) for t in given):
            raise InputError(f"tolerances must be a tuple of Tolerance, got {given!r}")
        if len({tolerance.key for tolerance in given}) < len(given):
            raise InputError("tolerances must have a key each")
        object.__setattr__(self, "tolerances", tuple(self.tolerances))
        if self.tolerances and np.any(matrix[CONSTANT, :CONSTANT]):
            raise InputError("c_r with tolerances must not be correlated with the position")
        if not isinstance(self.errors, Mapping):
            raise InputError("errors must be a mapping, {'attenuation': 0.2}")
        for parameter, std in self.errors.items():
            check_choice("errors", parameter, FACTORS)
            check_number(f"errors[{parameter!r}]", std, NOT_NEGATIVE)
        object.__setattr__(self, "errors", dict(self.errors))


@dataclass(frozen=True, eq=False)
class Vicinity:
    """States, and where errors of their positions of up to `reach` standard deviations lead.

    What several radars ask of an aircraft is computed once.

    Attributes:
        states: (k, 3 or more).
        covariance: C (k, 3, 3) of the positions, or (1, 3, 3) if they are alike.
        reach: Number of σ.
    """

    states: FloatArray
    covariance: FloatArray
    reach: float
    _heights: dict[Horizon, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @functools.cached_property
    def distance(self) -> FloatArray:
        """The largest distance (k,) [m] from the states."""
        return self.reach * np.sqrt(largest_variance(self.covariance))

    def along(self, axis: FloatArray) -> FloatArray:
        """Return the largest distance (k,) [m] along a direction (3,)."""
        return self.reach * np.sqrt(variance_along(axis, self.covariance))

    def heights(self, horizon: Horizon) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest height (k,) [m]."""
        if horizon not in self._heights:
            height = horizon.height(self.states)
            error = horizon.height_error(self.states, self.covariance, self.reach)
            self._heights[horizon] = height - error, height + error
        return self._heights[horizon]


@dataclass(frozen=True, eq=False, repr=False)
class Radar(ReadOnly):
    """One radar at every level of its uncertainty.

    A radar without state and levels is physics alone, for a `NetworkModel`.

    Attributes:
        model: RCS, P_fa, detector, and factors of the signal.
        name: Name in tables and reports. A single radar needs none.
        state: x_r (4,): north, east, down [m] and c_r [J m²/K]; None for physics alone.
        levels: Its uncertainty by level.
        max_range: Slant range beyond which P_D is 0 [m].
        horizon: Horizon below which P_D is 0; None for a transparent earth, as in the paper.
        scan_period: Time from one look to the next [s]; None if unknown.
        min_range: Slant range within which P_D is 0 [m].
        sheet: The data sheet that c_r was computed from, or None.
        band: The frequency band. Radars of one band have one error of the RCS.
        mask: Terrain that hides what is below it; None for none.
    """

    model: DetectionModel
    name: str = ""
    state: FloatArray | None = None
    levels: Mapping[str, Level] = field(default_factory=dict)
    max_range: float = declared(Limit(above=0, infinite=True), default=math.inf)
    horizon: Horizon | None = declared(Horizon, default=None)
    scan_period: float | None = declared(POSITIVE, default=None)
    min_range: float = declared(NOT_NEGATIVE, default=0.0)
    sheet: DataSheet | None = declared(DataSheet, default=None)
    band: str = ""
    mask: Mask | None = declared(Mask, default=None)

    def __post_init__(self) -> None:
        if not isinstance(self.model, DetectionModel):
            raise InputError(f"model must be a DetectionModel, got {self.model!r}")
        for name in ("name", "band"):
            if not isinstance(getattr(self, name), str):
                raise InputError(f"{name} must be text, got {getattr(self, name)!r}")
        if self.state is not None:
            object.__setattr__(self, "state", _checked_state(self.state))
        self._check_levels()
        check_parameters(self)
        if self.min_range >= self.max_range:
            raise InputError(
                f"min_range must be less than max_range, {self.max_range:g}, got {self.min_range:g}"
            )
        if self.band and not BAND.allows(self.band):
            raise InputError(f"band must be {BAND}, got {self.band!r}")

    def _check_levels(self) -> None:
        if not isinstance(self.levels, Mapping):
            raise InputError("levels must be a mapping, {'medium': Level(...)}")
        given: Mapping[Any, Any] = self.levels
        limits = {factor.parameter: factor.std_limit for factor in self.model.factors}
        for name, level in given.items():
            if not LEVEL_NAME.allows(name):
                raise InputError(f"levels must have names, {LEVEL_NAME}, got {describe(name)}")
            if not isinstance(level, Level):
                raise InputError(f"levels[{name!r}] must be a Level, got {level!r}")
            for parameter, std in level.errors.items():
                what = f"levels[{name!r}].errors[{parameter!r}]"
                if parameter in limits:
                    check_number(what, std, limits[parameter])
                elif std:
                    raise InputError(f"{what} needs a factor of the model with this parameter")
        object.__setattr__(self, "levels", MappingProxyType(dict(self.levels)))

    def __repr__(self) -> str:
        names = ("max_range", "min_range", "horizon", "scan_period", "band", "mask")
        values = {name: getattr(self, name) for name in names}
        limits = (f", {n} {v!r}" for n, v in values.items() if v != getattr(Radar, n))
        return f"<Radar {self.name!r}: {self.model!r}{''.join(limits)}>"

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "levels": dict(self.levels)}  # a mapping proxy cannot be pickled

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        super().__setstate__({**state, "levels": MappingProxyType(state["levels"])})

    def visible(
        self, aircraft: ArrayLike, radar: ArrayLike, height: FloatArray | None = None
    ) -> NDArray[np.bool_]:
        """Return where (...) aircraft (..., 6) are within the limits of a radar (..., 4).

        The heights (...) [m] of the aircraft, for a horizon, are computed if they are not given.
        """
        aircraft, radar = np.asarray(aircraft, dtype=float), np.asarray(radar, dtype=float)
        if not self.limited:
            return np.ones(np.broadcast(aircraft[..., 0], radar[..., 0]).shape, dtype=bool)
        return self.margin(aircraft, radar, height) >= 0

    def margin(
        self, aircraft: FloatArray, radar: FloatArray, height: FloatArray | None = None
    ) -> FloatArray:
        """Return the distance (...) [m] to the nearest limit, negative beyond it; as `visible`."""
        return functools.reduce(np.minimum, self.margins(aircraft, radar, height).values())

    def margins(
        self, aircraft: FloatArray, radar: FloatArray, height: FloatArray | None = None
    ) -> dict[str, FloatArray]:
        """Return the distance (...) [m] to each limit by its name; as `margin`."""
        distance = slant_range(aircraft, radar)
        margins = {
            "maximum range": self.max_range - distance,
            "minimum range": distance - self.min_range,
        }
        if self.horizon is not None:
            height = self.horizon.height(aircraft) if height is None else height
            margins["horizon"] = horizon_range(self.horizon.height(radar), height) - distance
        if self.mask is not None:
            margins["mask"] = distance * self.mask.clearance(aircraft, radar)
        return margins

    def sight(self, aircraft: Vicinity, radar: Vicinity) -> NDArray[np.int8]:
        """Return whether (k,) aircraft are in sight, `NEVER`, `PERHAPS` or `ALWAYS`.

        A radar that is alike at all poses may have one row.
        """
        distance = slant_range(aircraft.states, radar.states)
        error = aircraft.distance + radar.distance
        near, far = np.maximum(distance - error, 0.0), distance + error
        may = (far >= self.min_range) & (near <= self.max_range)
        must = (near >= self.min_range) & (far <= self.max_range)
        if self.horizon is not None:
            own, other = (of.heights(self.horizon) for of in (radar, aircraft))
            must &= far <= horizon_range(own[0], other[0])
            may &= near <= horizon_range(own[1], other[1])
        if self.mask is not None:
            down = self.mask.axes[:, DOWN]
            up = aircraft.along(down) + radar.along(down)
            low, high = self.mask.clearance_within(aircraft.states, radar.states, error, up)
            may, must = may & (high >= 0), must & (low >= 0)
        return np.where(must, ALWAYS, np.where(may, PERHAPS, NEVER))

    def covariance(self, level: str) -> FloatArray:
        """Return C_rr (7, 7) at a level, with the errors of factors, see `states`."""
        matrix = with_errors(self.levels[level].covariance, radars=1, axes=2)
        for parameter, std in self.levels[level].errors.items():
            place = FACTOR_ERRORS[parameter]
            matrix[place, place] = std**2
        return matrix

    def without_limits(self) -> Radar:
        """Return the radar without minimum and maximum range, horizon and mask."""
        return replace(self, min_range=0.0, max_range=math.inf, horizon=None, mask=None)

    @property
    def called(self) -> str:
        """The radar in a sentence, with its name if it has one."""
        return f"radar {self.name!r}" if self.name else "the radar"

    @property
    def limited(self) -> bool:
        """Whether the radar has a maximum range, a minimum range, a horizon or a mask."""
        in_range = self.min_range <= 0 and self.max_range == math.inf
        return not in_range or self.horizon is not None or self.mask is not None


def _checked_state(values: ArrayLike) -> FloatArray:
    """Return the state of a radar (4,), read-only."""
    state = read_only("radar state", values)
    if state.shape != (len(RADAR),):
        raise InputError(
            f"radar state must have shape ({len(RADAR)},) for {', '.join(RADAR)}, got {state.shape}"
        )
    check_finite("radar", state)
    if not state[CONSTANT] > 0:
        raise InputError(f"radar constants must be greater than 0, got {state[CONSTANT]:g}")
    return state
