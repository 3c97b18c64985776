"""The scenario: states of aircraft and radars in SI units, and their covariances."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense import axis as axes
from radar_sense import covariance
from radar_sense.axis import Axis
from radar_sense.errors import InputError, check_choice, describe, shorten_list
from radar_sense.flight import Geometry, Path, States
from radar_sense.limits import (
    MAX_NAME,
    METHODS,
    NAME,
    NOT_NEGATIVE,
    RADAR_NAME,
    RUNS,
    SEED,
    STD_DB,
    Limit,
    check_number,
)
from radar_sense.model.geodesy import is_place
from radar_sense.model.network import NetworkModel, as_network
from radar_sense.model.radar_constant import Tolerance
from radar_sense.model.rcs import RCS
from radar_sense.states import AIRCRAFT, CONSTANTS, RADAR, FloatArray, real_array, size_of
from radar_sense.uncertain_states import UncertainStates

#: The fields that are mappings by level, each with an example.
_BY_LEVEL = {
    "cov_radar": "{'medium': (4, 4)}",
    "tolerances": "{'medium': ((Tolerance, ...),)}",
    "attenuation_std": "{'medium': (1e-6,)}",
}


#: Fields that are numbers of the file.
_OF_FILE = ("aircraft", "cov_aircraft", "radar", *_BY_LEVEL, "model", "rcs_db", "correlation_s")
#: Most numbers of an array that a record has as they are: a covariance of two radars.
_FEW = 64
_NO_POSES = States(axes.pose_number(0), np.zeros((0, len(AIRCRAFT))))


@dataclass(frozen=True, eq=False)
class Source:
    """The file that a scenario was read from, for its record.

    Attributes:
        file: The file, a `scenario_file.sections.File`.
        made: Fields of the scenario as they were made from the file.
        again: Reads the file again with other values of some keys.
    """

    file: Any
    made: Mapping[str, Any] = field(repr=False)
    again: Callable[[Mapping[str, Any]], Scenario] = field(repr=False)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Scenario:
    """A scenario, checked, in SI units and radians. All arrays are read-only.

    `load_scenario` reads a scenario from a file. In Python these fields are enough:

        Scenario(model=DetectionModel(...), aircraft=(n, 6), radar=(4,), cov_aircraft=(6, 6),
                 cov_radar={"medium": (4, 4)})

    Attributes:
        model: The radars: RCS, P_fa, detector and limits of each. A `DetectionModel` becomes the
            network of one radar without a name.
        aircraft: Nominal aircraft states (n, 6).
        radar: Nominal radar state (4,), or (4m,) of a network of m.
        cov_aircraft: C_aa (6, 6), or one for each pose (n, 6, 6).
        cov_radar: C_rr (4, 4), or (4m, 4m), for each level of radar uncertainty.
        name: Stem of the names of output files.
        axis: Azimuth, time or distance of the poses (n,). The default is time where `time_s` is
            given, else the number of the pose.
        level: The level for analyses of one level. The default is the first level.
        runs: Monte Carlo runs.
        seed: Seed of the Monte Carlo draws.
        method: How uncertain states become a distribution of P_D, one of `limits.METHODS`.
        tolerances: Tolerances that make the c_r of each radar (m,) uncertain, by level. C_rr
            has them to first order.
        time_s: Time of each pose (n,) [s] of a path; None on an orbit.
        rcs_db: Standard deviation of the RCS [dB]. The error is one log-normal factor at all
            radars, poses and looks. 0 for an RCS table with std_db.
        attenuation_std: Standard deviation of the attenuation of each radar (m,) [dB/m], by level.
            The attenuation is log-normal, with the value of the model as its median.
        correlation_s: Correlation time [s] of the pose errors, a first-order Gauss–Markov process.
            0 gives independent errors at all poses, and infinity one error at all poses.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the
            frame. None unless the route is in latitude and longitude.
        geometry: The poses and the flight between them. The default is a path where `time_s` is
            given, else states alone.
        source: The file that the scenario was read from; None if made in Python.
    """

    model: NetworkModel
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: Mapping[str, FloatArray]
    name: str = "scenario"
    axis: Axis = field(default_factory=lambda: axes.pose_number(0))
    level: str = ""
    runs: int = 500
    seed: int = 1
    method: str = "automatic"
    tolerances: Mapping[str, tuple[tuple[Tolerance, ...], ...]] = field(default_factory=dict)
    time_s: FloatArray | None = None
    rcs_db: float = 0.0
    attenuation_std: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    correlation_s: float = 0.0
    origin: tuple[float, float, float] | None = None
    geometry: Geometry = _NO_POSES
    source: Source | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "model", as_network(self.model))
        for name in ("aircraft", "radar", "cov_aircraft", "time_s"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _read_only(name, getattr(self, name)))
        if self.aircraft.ndim == 1:
            object.__setattr__(self, "aircraft", self.aircraft[np.newaxis])
        for name, example in _BY_LEVEL.items():
            if not isinstance(getattr(self, name), Mapping):
                raise InputError(f"{name} must be a mapping of levels, {example}")
        if not isinstance(self.axis, Axis):
            raise InputError(f"axis must be an Axis, got {self.axis!r}")
        levels = {level: _read_only(level, c) for level, c in self.cov_radar.items()}
        object.__setattr__(self, "cov_radar", MappingProxyType(levels))
        for name in ("tolerances", "attenuation_std"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        if not len(self.axis):
            along = axes.pose_number(len(self.aircraft))
            if self.time_s is not None:
                along = axes.time(self.time_s)
            object.__setattr__(self, "axis", along)
        if not self.level:
            object.__setattr__(self, "level", next(iter(levels), ""))
        self._check_states()
        self._check_covariances()
        self._check_of_radars()
        self._check_choices()
        object.__setattr__(self, "runs", int(self.runs))  # 500.0 is a whole number too
        object.__setattr__(self, "seed", int(self.seed))
        object.__setattr__(self, "geometry", self._geometry())

    def _geometry(self) -> Geometry:
        """Return the geometry given, or the geometry of other poses than it has."""
        given, along = self.geometry, self.axis
        each = self.cov_aircraft if self.cov_aircraft.ndim == 3 else None
        own = (self.aircraft, along, each, self.time_s, self.origin)
        path = (given.time_s, given.origin) if isinstance(given, Path) else (None, None)
        made = (given.aircraft, given.axis, given.covariance, *path)
        if all(one is other for one, other in zip(own, made, strict=True)):
            return given
        if self.time_s is None:
            return States(along, self.aircraft, each)
        step_s = given.step_s if isinstance(given, Path) else None
        return Path(
            along, self.aircraft, each, time_s=self.time_s, origin=self.origin, step_s=step_s
        )

    def _check_states(self) -> None:
        count, size = len(self.aircraft), len(RADAR) * self._radar_count
        if self.aircraft.shape != (count, len(AIRCRAFT)) or not count:
            raise InputError(
                f"aircraft must have shape (n, {len(AIRCRAFT)}) for {', '.join(AIRCRAFT)}, "
                f"got {self.aircraft.shape}"
            )
        if self.radar.shape != (size,):
            raise InputError(
                f"radar must have shape ({size},) for {', '.join(RADAR)}"
                + (f" of each of {self._radar_count} radars" if size > len(RADAR) else "")
                + f", got {self.radar.shape}"
            )
        for name, values in (("aircraft", self.aircraft), ("radar", self.radar)):
            if not np.isfinite(values).all():
                raise InputError(f"{name} must be finite, got {values[~np.isfinite(values)][0]}")
        if not (self.radar[CONSTANTS] > 0).all():
            lowest = self.radar[CONSTANTS].min()
            raise InputError(f"radar constants must be greater than 0, got {lowest:g}")
        along = {"axis": self.axis.values}
        if self.time_s is not None:
            along["time_s"] = self.time_s
        for name, values in along.items():
            if np.shape(values) != (count,):
                raise InputError(
                    f"{name} must have one value for each of {count} poses, got {np.shape(values)}"
                )
        if self.time_s is not None and not (np.diff(self.time_s) > 0).all():
            raise InputError("time_s must increase from pose to pose")
        if self.origin is not None and not is_place(self.origin):
            raise InputError(
                f"origin must be latitude and longitude [rad] and height [m], got {self.origin!r}"
            )

    def _check_covariances(self) -> None:
        _check_covariance("cov_aircraft", self.cov_aircraft, len(AIRCRAFT), len(self.aircraft))
        if not self.cov_radar:
            raise InputError("cov_radar needs at least one level, {'medium': (4, 4)}")
        for level, matrix in self.cov_radar.items():
            if not isinstance(level, str):
                raise InputError(f"levels of cov_radar must be text, got {level!r}")
            _check_covariance(f"cov_radar[{level!r}]", matrix, len(self.radar))

    def _check_of_radars(self) -> None:
        """Check the names of the radars, and what each radar has by level."""
        for name in self.model.names:
            if not RADAR_NAME.allows(name):
                raise InputError(f"names of radars must be {RADAR_NAME}, got {name!r}")
        for name in ("tolerances", "attenuation_std"):
            for level, of_radars in getattr(self, name).items():
                if level not in self.cov_radar:
                    raise InputError(f"{name} has a level {level!r}, missing in cov_radar")
                if not _is_sequence(of_radars) or len(of_radars) != self._radar_count:
                    raise InputError(
                        f"{name}[{level!r}] must be a tuple with an entry for each radar, "
                        f"{self._radar_count}, got {of_radars!r}"
                    )
        for level, by_radar in self.tolerances.items():
            for tolerances in by_radar:
                if not _is_sequence(tolerances) or not all(
                    isinstance(tolerance, Tolerance) for tolerance in tolerances
                ):
                    raise InputError(
                        f"tolerances[{level!r}] must have a tuple of Tolerance for each radar, "
                        f"got {tolerances!r}"
                    )
        for level, stds in self.attenuation_std.items():
            for std, model in zip(stds, self.model.models, strict=True):
                check_number(
                    f"attenuation_std[{level!r}]", std, Limit(at_least=0, at_most=model.attenuation)
                )

    def _check_choices(self) -> None:
        if not NAME.allows(self.name):
            raise InputError(f"name must be {NAME}, got {self.name!r}")
        check_choice("level", self.level, self.cov_radar)
        check_choice("method", self.method, METHODS)
        for name, value, limit in (("runs", self.runs, RUNS), ("seed", self.seed, SEED)):
            check_number(name, value, limit)
        if self.correlation_s != math.inf:
            check_number("correlation_s", self.correlation_s, NOT_NEGATIVE)
        check_number("rcs_db", self.rcs_db, STD_DB)
        if self.rcs_db and self._rcs_spread is not None:
            raise InputError(
                "rcs_db and std_db of the RCS table exclude each other: both are the uncertainty "
                "of the RCS"
            )

    def __repr__(self) -> str:
        return (
            f"<Scenario {self.name!r}: {len(self.aircraft)} poses by {self.axis.name}, "
            f"{self.model.in_words}, level {self.level} of {shorten_list(list(self.cov_radar))}, "
            f"{self.runs} runs, seed {self.seed}>"
        )

    @property
    def rcs_std(self) -> float:
        """Standard deviation of the error ε of the RCS, see `model.rcs`; 0 without an error."""
        return self.rcs_db if self._rcs_spread is None else 1.0

    @property
    def shared(self) -> FloatArray:
        """Nominal states common to all poses: radars (4m,), and further errors, see `states`."""
        further = self._shared_size - len(self.radar)
        return np.append(self.radar, np.zeros(further)) if further else self.radar

    @property
    def cov_shared(self) -> FloatArray:
        """Covariance of the shared states, at the level."""
        matrix, size = self.cov_radar[self.level], self._shared_size
        end = len(matrix)
        if size == end:
            return matrix
        std = np.zeros(size)
        std[end] = self.rcs_std
        if size > end + 1:
            for i, (model, std_attenuation) in enumerate(
                zip(self.model.models, self._attenuation, strict=True)
            ):
                std[end + 1 + i] = std_attenuation / model.attenuation if std_attenuation else 0.0
        shared = covariance.from_std(std)
        shared[:end, :end] = matrix
        return shared

    @property
    def attenuation_uncertain(self) -> bool:
        """Whether the attenuation of any radar is uncertain, at the level."""
        return any(self._attenuation)

    @property
    def _attenuation(self) -> tuple[float, ...]:
        return self.attenuation_std.get(self.level, (0.0,) * self._radar_count)

    @property
    def _shared_size(self) -> int:
        return size_of(
            self._radar_count, rcs=self.rcs_std > 0, attenuation=self.attenuation_uncertain
        )

    @property
    def _rcs_spread(self) -> RCS | None:
        spread: RCS | None = getattr(self.model.rcs, "spread", None)
        return spread

    @property
    def _radar_count(self) -> int:
        return len(self.model.radars)

    @property
    def tolerances_at_level(self) -> tuple[tuple[Tolerance, ...], ...]:
        """Tolerances of the c_r of each radar (m,) at the level; () for a Gaussian c_r."""
        return self.tolerances.get(self.level, ((),) * self._radar_count)

    @property
    def log_constant(self) -> NDArray[np.bool_]:
        """Whether each radar (m,) has a c_r with tolerances, which is modelled as log-normal."""
        return np.array([bool(tolerances) for tolerances in self.tolerances_at_level])

    def states(self) -> UncertainStates:
        """Return the uncertain states of all poses, at the level."""
        cov_aircraft = self.cov_aircraft
        return UncertainStates(
            self.model,
            self.log_constant,
            self.aircraft,
            self.shared[np.newaxis],
            cov_aircraft[np.newaxis] if cov_aircraft.ndim == 2 else cov_aircraft,
            self.cov_shared[np.newaxis],
            self.tolerances_at_level,
            self.seed,
            self.runs,
        )

    def at_poses(self, poses: slice | NDArray[np.intp]) -> Scenario:
        """Return the scenario with only some poses.

        Raises:
            InputError: If the poses are none of the scenario, or out of the order of a path.
        """
        try:
            times = np.arange(len(self.axis)) if self.time_s is None else self.time_s
            chosen = times[poses]
        except (IndexError, TypeError, ValueError) as error:
            raise InputError(
                f"poses must be a slice or an array of numbers of the {len(self.axis)} poses, "
                f"got {describe(poses)}"
            ) from error
        if chosen.ndim != 1 or not len(chosen):
            raise InputError(f"poses must select one pose or more, got {describe(poses)}")
        if self.time_s is not None and not (np.diff(chosen) >= 0).all():
            raise InputError(f"poses of a path must stay in order, got {describe(poses)}")
        return self._with(
            axis=self.axis.at_poses(poses),
            aircraft=self.aircraft[poses],
            cov_aircraft=self.cov_aircraft
            if self.cov_aircraft.ndim == 2
            else self.cov_aircraft[poses],
            time_s=None if self.time_s is None else self.time_s[poses],
            geometry=self.geometry.at_poses(poses),
        )

    def at_states(self, aircraft: FloatArray) -> Scenario:
        """Return the scenario at other aircraft states (..., 6), one pose after the other.

        All states have the covariance of the first pose. The values are not checked.
        """
        geometry = States(axes.pose_number(aircraft.size // 6), aircraft.reshape(-1, len(AIRCRAFT)))
        return self._with(
            axis=geometry.axis,
            aircraft=geometry.aircraft,
            cov_aircraft=self.cov_aircraft.reshape(-1, len(AIRCRAFT), len(AIRCRAFT))[0],
            time_s=None,
            geometry=geometry,
        )

    def along(self, geometry: Geometry) -> Scenario:
        """Return the scenario at other poses of its flight, as `geometry.at` returns them.

        The record still has the orbit or the path of the file.
        """
        time_s = geometry.time_s if isinstance(geometry, Path) else None
        covariances = self.cov_aircraft if geometry.covariance is None else geometry.covariance
        poses = {"aircraft": geometry.aircraft, "cov_aircraft": covariances}
        source = self.source
        if source is not None:
            known = {name: new for name, new in poses.items() if self._is_of_file(name)}
            source = dataclasses.replace(source, made={**source.made, **known})
        return self._with(
            axis=geometry.axis, time_s=time_s, geometry=geometry, source=source, **poses
        )

    def of_file(self, file: Any, again: Callable[[Mapping[str, Any]], Scenario]) -> Scenario:
        """Return the scenario with the file that it was made of.

        Args:
            file: A `scenario_file.sections.File`.
            again: Reads the file again with other values of some keys.
        """
        return self._with(source=Source(file, {**self.__getstate__(), "rcs": self.rcs}, again))

    def with_keys(self, changes: Mapping[str, Any]) -> Scenario:
        """Return the scenario of the same file with other values of some keys.

        Level, method, runs and seed are those of this scenario.

        Args:
            changes: Values by path of keys, such as {"radar.constant": 200}.

        Raises:
            InputError: If the scenario is not as its file made it, or a value is not allowed.
        """
        source = self.source
        if source is None or not all(map(self._is_of_file, _OF_FILE)):
            raise InputError("keys can be changed of a scenario that is as its file made it")
        changed = source.again(changes).with_analysis(
            level=self.level, runs=self.runs, seed=self.seed, method=self.method
        )
        chosen = self.model.names
        if len(chosen) < len(changed.model.names):
            return for_radar(changed, *chosen)
        return changed

    def resolved(self) -> dict[str, Any]:
        """Return the scenario as in its file: keys and numbers as typed, defaults filled in.

        A section that is not as the file made it has the fields of this class in its place, with
        the digests of long arrays. No file has such a section.
        """
        several, levels = bool(self.model.names), tuple(_BY_LEVEL)
        fields = {
            "radars" if several else "radar": ("model", "radar", *(levels if several else ())),
            "aircraft": ("rcs",),
            "geometry": ("aircraft",),
            "uncertainty": (
                "cov_aircraft",
                "rcs_db",
                "correlation_s",
                *(() if several else levels),
            ),
        }
        document = {} if self.source is None else self.source.file.document()
        for section, names in fields.items():
            if not all(map(self._is_of_file, names)):
                states = {name: _recorded(getattr(self, name)) for name in names}
                document[section] = {"type": "states", **states}
        if not self._is_of_file("aircraft"):
            document["aircraft"].pop("attitude_deg", None)
        choices = {"level": self.level, "runs": self.runs, "seed": self.seed}
        return {
            "name": self.name,
            **{section: document[section] for section in fields},
            "analysis": {**choices, "method": self.method},
        }

    @property
    def rcs(self) -> RCS:
        """Radar cross section of the aircraft."""
        return self.model.rcs

    def _is_of_file(self, name: str) -> bool:
        """Return whether a field is as it was made from the file."""
        return self.source is not None and _same(getattr(self, name), self.source.made[name])

    def with_analysis(
        self,
        *,
        level: str | None = None,
        runs: int | None = None,
        seed: int | None = None,
        method: str | None = None,
    ) -> Scenario:
        """Return the scenario with other choices of analysis; None keeps a choice.

        Raises:
            InputError: If there is no such level or method, or runs or seed are out of range.
        """
        chosen = self._with(
            level=self.level if level is None else level,
            runs=self.runs if runs is None else runs,
            seed=self.seed if seed is None else seed,
            method=self.method if method is None else method,
        )
        chosen._check_choices()
        return chosen._with(runs=int(chosen.runs), seed=int(chosen.seed))

    def _with(self, **changes: Any) -> Scenario:
        """Return the scenario with fields that need no new check."""
        changed = object.__new__(type(self))
        for name, value in (vars(self) | changes).items():
            object.__setattr__(changed, name, value)
        return changed

    def __getstate__(self) -> dict[str, Any]:
        # a mapping proxy cannot be pickled
        return vars(self) | {name: dict(getattr(self, name)) for name in _BY_LEVEL}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update(state)
        for name in _BY_LEVEL:
            vars(self)[name] = MappingProxyType(state[name])
        for array in (*state.values(), *self.cov_radar.values()):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False


def check_scenario(scenario: object) -> None:
    """Raise InputError unless the argument is a scenario."""
    if not isinstance(scenario, Scenario):
        raise InputError(
            f"scenario must be a Scenario, as load_scenario returns, got {describe(scenario)}"
        )


def single_radar_scenarios(scenario: Scenario) -> dict[str, Scenario]:
    """Return the scenario of each radar of a network by name; {} for a single radar.

    The scenarios have the limits, the state and the covariance of the radar. Correlations with
    other radars are left out.
    """
    model = scenario.model
    if len(model.radars) < 2:
        return {}
    source, found = scenario.source, {}
    for i, radar in enumerate(model.radars):
        own = None
        if source is not None and source.file.radars and len(source.file.radars) > i:
            file = dataclasses.replace(source.file, radars=(source.file.radars[i],))
            own = Source(file, {**source.made, **_of_radar(source.made, i)}, source.again)
        found[radar.name] = scenario._with(**_of_radar(vars(scenario), i), source=own)
    return found


def for_radar(scenario: Scenario, name: str) -> Scenario:
    """Return the scenario of one radar of a network, with the radar in its name.

    Raises:
        InputError: If there is no such radar, or the only radar has no name.
    """
    names = scenario.model.names
    if not names:
        raise InputError(
            f"radar {describe(name)} cannot be chosen: this scenario has a single radar, "
            "not a network"
        )
    check_choice("radar", name, names)
    stem = f"{scenario.name}_{name}"
    if len(stem) > MAX_NAME:
        raise InputError(
            f"the name {stem} has more than {MAX_NAME} letters; give the scenario a shorter one"
        )
    return single_radar_scenarios(scenario).get(name, scenario)._with(name=stem)


def _of_radar(fields: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Return the fields of a scenario that belong to its radars, for one of the radars."""
    components = slice(len(RADAR) * i, len(RADAR) * (i + 1))
    by_level = {
        "cov_radar": {c: m[components, components] for c, m in fields["cov_radar"].items()},
        "tolerances": {level: (of[i],) for level, of in fields["tolerances"].items()},
        "attenuation_std": {level: (of[i],) for level, of in fields["attenuation_std"].items()},
    }
    return {
        "model": NetworkModel((fields["model"].radars[i],)),
        "radar": fields["radar"][components],
        **{name: MappingProxyType(of_levels) for name, of_levels in by_level.items()},
    }


def _same(one: Any, other: Any) -> bool:
    """Return whether two fields of scenarios are the same."""
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, np.ndarray):
        return one is other or np.array_equal(one, other)
    return bool(one == other)


def _recorded(value: Any) -> Any:
    """Return a field of a scenario for its record."""
    if isinstance(value, Mapping):
        return {key: _recorded(item) for key, item in value.items()}
    if isinstance(value, np.ndarray) and value.size > _FEW:
        little_endian = np.asarray(value, dtype="<f8").tobytes()
        return {"shape": list(value.shape), "sha256": hashlib.sha256(little_endian).hexdigest()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, NetworkModel):
        return [repr(radar) for radar in value.radars]
    return value if isinstance(value, float) and math.isfinite(value) else repr(value)


def _is_sequence(values: object) -> bool:
    return isinstance(values, Sequence) and not isinstance(values, str)


def _read_only(name: str, values: Any) -> FloatArray:
    """Return a read-only array, a copy unless the array is read-only already."""
    if isinstance(values, np.ndarray) and values.dtype == float and not values.flags.writeable:
        return values
    array = real_array(name, values).copy()
    array.flags.writeable = False
    return array


def _check_covariance(name: str, matrix: FloatArray, size: int, count: int | None = None) -> None:
    """Raise InputError unless an array is a covariance, or one for each of some poses."""
    shapes = [(size, size), *([] if count is None else [(count, size, size)])]
    if matrix.shape not in shapes:
        allowed = " or ".join(str(shape) for shape in shapes)
        raise InputError(f"{name} must have shape {allowed}, got {matrix.shape}")
    wrong = covariance.first_wrong(matrix.reshape(-1, size, size))
    if wrong:
        pose = f"[{wrong[0]}]" if matrix.ndim == 3 else ""
        raise InputError(f"{name}{pose} {wrong[1]}")
