"""The scenario: radars, the flight of the aircraft, and the choices of an analysis."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense import axis as axes
from radar_sense import covariance
from radar_sense.axis import Axis
from radar_sense.errors import InputError, check_choice, describe, shorten_list
from radar_sense.flight import Geometry, Path, States
from radar_sense.limits import (
    CORRELATION,
    MAX_NAME,
    METHODS,
    NAME,
    RADAR_NAME,
    RUNS,
    SEED,
    STD_DB,
    check_parameters,
    declared,
    plain_number,
)
from radar_sense.model.geodesy import check_origin
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Radar
from radar_sense.model.radar_constant import Tolerance
from radar_sense.model.track import covariance_in_frame
from radar_sense.source_names import name_problem
from radar_sense.states import (
    AIRCRAFT,
    FACTORS,
    RADAR,
    RADAR_AND_ERRORS,
    RCS_ERROR,
    FloatArray,
    aircraft_states,
    check_finite,
    component,
    read_only,
    with_errors,
)
from radar_sense.uncertain_states import UncertainStates

#: Most numbers of an array that a record has as they are: a covariance of two radars.
_FEW = 64


@dataclass(frozen=True, eq=False)
class SourceFile:
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

        Scenario(
            radars=[Radar(model, state=(4,), levels={"medium": Level((4, 4))})],
            geometry=States.of(aircraft=(n, 6), covariance=(6, 6)),
        )

    Attributes:
        radars: The radars, each with its state and its levels of uncertainty. All have the same
            levels.
        geometry: The poses of the aircraft with their C_aa, and the flight between them.
        name: Stem of the names of output files.
        level: The level for analyses of one level. The default is the first level.
        runs: Monte Carlo runs.
        seed: Seed of the Monte Carlo draws.
        method: How uncertain states become a distribution of P_D, one of `limits.METHODS`.
        rcs_db: Standard deviation of the RCS [dB]. The error is one log-normal factor for all
            radars of a band, all poses and looks. 0 for an RCS table with std_db.
        correlation_s: Correlation time [s] of the pose errors, a first-order Gauss–Markov process.
            0 gives independent errors at all poses, and infinity one error at all poses.
        source: The file that the scenario was read from; None if made in Python.
    """

    radars: tuple[Radar, ...]
    geometry: Geometry
    name: str = declared(NAME, default="scenario")
    level: str = ""
    runs: int = declared(RUNS, default=500)
    seed: int = declared(SEED, default=1)
    method: str = declared(tuple(METHODS), default="automatic")
    rcs_db: float = declared(STD_DB, default=0.0)
    correlation_s: float = declared(CORRELATION, default=0.0)
    source: SourceFile | None = declared(SourceFile, default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radars", self.model.radars)
        if not isinstance(self.geometry, Geometry):
            raise InputError(
                "geometry must be poses or a path, States.of(aircraft) or Path.of(time_s, "
                f"aircraft), got {describe(self.geometry)}"
            )
        object.__setattr__(self, "geometry", _read_only(self.geometry))
        self._check_radars()
        if isinstance(self.level, str):
            object.__setattr__(self, "level", self.level or self.levels[0])
        self._check_poses()
        self._check_choices()

    def _check_radars(self) -> None:
        of_band = {radar.band: radar.model.rcs for radar in self.radars}
        for radar in self.radars:
            if not _same(radar.model.rcs, of_band[radar.band]):
                raise InputError(
                    "radars of one band must have the RCS of one and the same target: give them "
                    "one object"
                )
            if radar.name and not RADAR_NAME.allows(radar.name):
                raise InputError(f"names of radars must be {RADAR_NAME}, got {radar.name!r}")
            if radar.state is None:
                raise InputError("every radar of a scenario needs a state: north, east, down, c_r")
            if not radar.levels:
                raise InputError("every radar needs a level, levels={'medium': Level(...)}")
            if radar.levels.keys() != {*self.levels}:
                raise InputError(
                    f"all radars must have the levels {', '.join(self.levels)}, radar "
                    f"{radar.name!r} has {', '.join(radar.levels)}"
                )
        if problem := name_problem(self.model.names, self.bands, self.types):
            raise InputError(problem)

    def _check_poses(self) -> None:
        geometry, count = self.geometry, len(np.atleast_1d(self.aircraft))
        if self.aircraft.shape != (count, len(AIRCRAFT)) or not count:
            raise InputError(
                f"aircraft must have shape (n, {len(AIRCRAFT)}) for {', '.join(AIRCRAFT)}, "
                f"got {self.aircraft.shape}"
            )
        check_finite("aircraft", self.aircraft)
        if not isinstance(self.axis, Axis):
            raise InputError(f"axis must be an Axis, got {self.axis!r}")
        along = {"axis": self.axis.values}
        if self.time_s is not None:
            along["time_s"] = self.time_s
        for name, values in along.items():
            if np.shape(values) != (count,):
                raise InputError(
                    f"{name} must have one value for each of {count} poses, got {np.shape(values)}"
                )
            if not np.isfinite(values).all():
                raise InputError(f"{name} must be finite, got {values[~np.isfinite(values)][0]}")
        if self.time_s is not None and not (np.diff(self.time_s) > 0).all():
            raise InputError("time_s must increase from pose to pose")
        check_origin(self.origin)
        size = (len(AIRCRAFT),) * 2
        if geometry.covariance.shape not in (size, (count, *size)):
            raise InputError(
                f"covariance of the aircraft must have shape {size} or {(count, *size)}, "
                f"got {geometry.covariance.shape}"
            )
        if wrong := covariance.first_wrong(geometry.covariance.reshape(-1, *size)):
            pose = f" at pose {wrong[0]}" if geometry.covariance.ndim == 3 else ""
            raise InputError(f"covariance of the aircraft{pose} {wrong[1]}")

    def _check_choices(self) -> None:
        check_parameters(self)
        check_choice("level", self.level, self.levels)
        object.__setattr__(self, "level", str(self.level))  # text of NumPy has another class
        if self.rcs_db and any(radar.model.has_spread for radar in self.radars):
            raise InputError(
                "rcs_db and std_db of the RCS table exclude each other: both are the uncertainty "
                "of the RCS"
            )

    def __repr__(self) -> str:
        return (
            f"<Scenario {self.name!r}: {len(self.aircraft)} poses by {self.axis.name}, "
            f"{self.model.in_words}, level {self.level} of {shorten_list(list(self.levels))}, "
            f"{self.runs} runs, seed {self.seed}>"
        )

    @cached_property
    def model(self) -> NetworkModel:
        """The physics of the radars."""
        return NetworkModel(self.radars)

    @property
    def levels(self) -> tuple[str, ...]:
        """The levels of uncertainty of the radars."""
        return tuple(self.radars[0].levels)

    @property
    def axis(self) -> Axis:
        """Azimuth, range, time or distance of the poses (n,)."""
        return self.geometry.axis

    @property
    def aircraft(self) -> FloatArray:
        """Nominal aircraft states (n, 6)."""
        return self.geometry.aircraft

    @property
    def cov_aircraft(self) -> FloatArray:
        """C_aa (6, 6), or one for each pose (n, 6, 6), in the frame of the states."""
        return self.geometry.covariance_in_frame

    @property
    def time_s(self) -> FloatArray | None:
        """Time of each pose (n,) [s] of a path; None for poses without times."""
        return self.geometry.time_s if isinstance(self.geometry, Path) else None

    @property
    def origin(self) -> tuple[float, float, float] | None:
        """Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the frame.

        None unless the route is in latitude and longitude.
        """
        return self.geometry.origin

    @cached_property
    def radar(self) -> FloatArray:
        """Nominal states of the radars (4m,)."""
        states = np.concatenate([r.state for r in self.radars if r.state is not None])
        states.flags.writeable = False
        return states

    @property
    def radar_states(self) -> FloatArray:
        """Nominal state of each radar (m, 4)."""
        return self.radar.reshape(-1, len(RADAR))

    @property
    def cov_radar(self) -> FloatArray:
        """C_rr (4m, 4m) of positions and c_r at the level, tolerances to first order.

        Errors of RCS, attenuation and tilt are not in it. `propagate_scenario` has all errors.
        """
        m, size = len(self.radars), len(RADAR)
        whole = self._states.cov_radar[0].reshape(m, len(RADAR_AND_ERRORS), m, -1)
        return whole[:, :size, :, :size].reshape(m * size, m * size)

    @property
    def tolerances(self) -> tuple[tuple[Tolerance, ...], ...]:
        """Tolerances of the c_r of each radar (m,) at the level; () for a Gaussian c_r."""
        return tuple(radar.levels[self.level].tolerances for radar in self.radars)

    @property
    def bands(self) -> tuple[str, ...]:
        """The band of each radar (m,). Radars of a band have one error of the RCS."""
        return tuple(radar.band for radar in self.radars)

    @property
    def types(self) -> tuple[str, ...]:
        """The types of radars that share tolerances, at any level."""
        levels = (level for radar in self.radars for level in radar.levels.values())
        return tuple(dict.fromkeys(t.shared for v in levels for t in v.tolerances if t.shared))

    @property
    def rcs_std(self) -> FloatArray:
        """Standard deviation of the error ε of the RCS at each radar (m,), see `model.rcs`."""
        return np.array([1.0 if r.model.has_spread else self.rcs_db for r in self.radars])

    @property
    def uncertain_parameters(self) -> tuple[str, ...]:
        """Which parameters of factors of the signal are uncertain of any radar, at the level."""
        levels = [radar.levels[self.level] for radar in self.radars]
        return tuple(name for name in FACTORS if any(at.errors.get(name) for at in levels))

    def p_d(self) -> FloatArray:
        """Return P_D of the nominal states (n,)."""
        return self.model.p_d(self.aircraft, self.radar)

    def check_ranges(self, what: str = "") -> None:
        """Raise InputError where the aircraft is on top of a radar: P_D has no value there."""
        for radar in self.radars:
            if text := self.geometry.collision(radar, what):
                raise InputError(text)

    def states(self) -> UncertainStates:
        """Return the uncertain states of all poses, at the level."""
        return self._states

    @cached_property
    def _states(self) -> UncertainStates:
        m, geometry, rcs_std = len(self.radars), self.geometry, self.rcs_std
        cov_radar = covariance.block_diagonal([r.covariance(self.level) for r in self.radars])
        bands, of_rcs = np.array(self.bands), component(RCS_ERROR, m)
        cov_radar[of_rcs, of_rcs] = np.outer(rcs_std, rcs_std) * np.equal.outer(bands, bands)
        poses = len(geometry.aircraft)
        radar = np.broadcast_to(with_errors(self.radar, m), (poses, len(cov_radar)))
        nominal, covariances = (geometry.aircraft, radar), (geometry.covariance_in_frame, cov_radar)
        states = UncertainStates(self.model, *nominal, *covariances, (), self.seed, self.runs)
        states = states.with_covariances(*covariances, self.tolerances)
        states.cov_radar.flags.writeable = False
        return states

    def at_poses(self, poses: slice | NDArray[np.intp]) -> Scenario:
        """Return the scenario with only some poses, those of a path in order."""
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
        if self.time_s is not None and not (np.diff(chosen) > 0).all():
            raise InputError(f"poses of a path must stay in order, got {describe(poses)}")
        return self._with(geometry=self.geometry.at_poses(poses))

    def at_states(self, aircraft: FloatArray) -> Scenario:
        """Return the scenario at other aircraft states (..., 6), one pose after the other.

        All states have the covariance of the first pose, relative to north, east and down at the
        aircraft. The values are not checked.
        """
        states = aircraft_states(aircraft).reshape(-1, len(AIRCRAFT))
        along, covariance = axes.pose_number(len(states)), self.geometry.covariance
        if covariance.ndim == 3:
            covariance = covariance[0]
        if self.origin is not None:
            covariance = covariance_in_frame(covariance, along.values, states, self.origin)
        return self._with(geometry=States(along, states, covariance))

    def along(self, geometry: Geometry) -> Scenario:
        """Return the scenario at other poses of its flight, as `geometry.at` returns them.

        The record still has the orbit or the path of the file.
        """
        source = self.source
        if source is not None and self._is_as_made:
            source = dataclasses.replace(source, made={**source.made, "geometry": geometry})
        return self._with(geometry=geometry, source=source)

    def of_file(self, file: Any, again: Callable[[Mapping[str, Any]], Scenario]) -> Scenario:
        """Return the scenario with the file that it was made of, see `SourceFile`."""
        made = {name: getattr(self, name) for name in _OF_FILE}
        return self._with(source=SourceFile(file, made, again))

    def with_keys(self, changes: Mapping[str, Any]) -> Scenario:
        """Return the scenario of the same file with other values, such as {"radar.constant": 200}.

        Level, method, runs and seed stay as they are here, unless `changes` has them.
        """
        if not isinstance(changes, Mapping):
            raise InputError(f"changes must be values by key, got {describe(changes)}")
        source = self.source
        if source is None or not self._is_as_made:
            raise InputError(
                "keys can be changed only of a scenario of a file, and before at_poses and the like"
            )
        kept = [n for n in _CHOICES if not {"analysis", f"analysis.{n}"} & changes.keys()]
        changed = source.again(changes).with_analysis(**{n: getattr(self, n) for n in kept})
        names = self.model.names
        if len(names) < len(changed.model.names):
            return for_radar(changed, *names)
        return changed

    def resolved(self) -> dict[str, Any]:
        """Return the scenario as in its file: keys and numbers as typed, defaults filled in.

        A scenario that is not as its file made it, or of no file, has its fields in place of keys,
        with the digests of long arrays. No file has such sections.
        """
        document: dict[str, Any]
        if self.source is not None and self._is_as_made:
            document = self.source.file.document()
        else:
            states = {
                "radars": {
                    "radars": [repr(radar) for radar in self.radars],
                    "states": self.radar,
                    "levels": {r.name or "radar": r.levels for r in self.radars},
                },
                "aircraft": {"rcs": [repr(radar.model.rcs) for radar in self.radars]},
                "geometry": {
                    f.name: getattr(self.geometry, f.name)
                    for f in dataclasses.fields(self.geometry)
                    if f.name not in ("axis", "covariance")
                },
                "uncertainty": {
                    "cov_aircraft": self.cov_aircraft,
                    "rcs_db": self.rcs_db,
                    "correlation_s": self.correlation_s,
                },
            }
            sections = {k: {"type": "states", **_recorded(v)} for k, v in states.items()}
            document = {"name": self.name, **sections}
        analysis = {name: getattr(self, name) for name in _CHOICES}
        return document | {"name": self.name, "analysis": analysis}

    @property
    def _is_as_made(self) -> bool:
        """Whether all fields that a file makes are as the file made them."""
        source = self.source
        return source is not None and all(getattr(self, k) == v for k, v in source.made.items())

    def with_analysis(
        self,
        *,
        level: str | None = None,
        runs: int | None = None,
        seed: int | None = None,
        method: str | None = None,
    ) -> Scenario:
        """Return the scenario with other choices of analysis; None keeps a choice."""
        given = {"level": level, "runs": runs, "seed": seed, "method": method}
        chosen = self._with(**{name: value for name, value in given.items() if value is not None})
        chosen._check_choices()
        return chosen

    def _with(self, **changes: Any) -> Scenario:
        """Return the scenario with fields that need no new check."""
        changed = object.__new__(type(self))
        for name, value in (self.__getstate__() | changes).items():
            object.__setattr__(changed, name, value)
        return changed

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}


#: The fields that a file makes, and those that its section `analysis` chooses.
_OF_FILE = ("radars", "geometry", "rcs_db", "correlation_s")
_CHOICES = ("level", "runs", "seed", "method")


def check_scenario(scenario: object) -> None:
    """Raise InputError unless the argument is a scenario."""
    if not isinstance(scenario, Scenario):
        raise InputError(
            f"scenario must be a Scenario, as load_scenario returns, got {describe(scenario)}"
        )


def single_radar_scenarios(scenario: Scenario) -> dict[str, Scenario]:
    """Return the scenario of each radar of a network by name; {} for a single radar.

    What radars share, the errors of the RCS and of their type, each has by itself.
    """
    if len(scenario.radars) < 2:
        return {}
    source, found = scenario.source, {}
    for i, radar in enumerate(scenario.radars):
        own, radars = None, (radar,)
        if source is not None and scenario._is_as_made:
            file = dataclasses.replace(source.file, radars=(source.file.radars[i],))
            own = SourceFile(file, {**source.made, "radars": radars}, source.again)
        found[radar.name] = scenario._with(radars=radars, source=own)
    return found


def for_radar(scenario: Scenario, name: str) -> Scenario:
    """Return the scenario of one radar of a network, with the radar in its name."""
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


def _same(rcs: object, other: object) -> bool:
    """Return whether two RCS are one object, or equal; arrays in them are not compared."""
    try:
        return rcs is other or bool(rcs == other)
    except ValueError:  # of arrays that are compared
        return False


def _recorded(value: Any) -> Any:
    """Return a field of a scenario for its record."""
    value = plain_number(value)
    if isinstance(value, Mapping):
        return {key: _recorded(item) for key, item in value.items()}
    if dataclasses.is_dataclass(value):
        return {f.name: _recorded(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, list | tuple):
        return [_recorded(item) for item in value]
    if isinstance(value, np.ndarray) and value.size > _FEW:
        little_endian = np.asarray(value, dtype="<f8").tobytes()
        return {"shape": list(value.shape), "sha256": hashlib.sha256(little_endian).hexdigest()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, str):
        return re.sub(" at 0x[0-9a-f]+", "", value)  # an address differs from run to run
    return repr(value) if isinstance(value, float) and not math.isfinite(value) else value


def _read_only(geometry: Geometry) -> Geometry:
    """Return a geometry with read-only arrays."""
    given = {n: getattr(geometry, n, None) for n in ("aircraft", "covariance", "time_s")}
    fixed = {n: read_only(n, values) for n, values in given.items() if values is not None}
    changes: dict[str, Any] = {n: array for n, array in fixed.items() if array is not given[n]}
    return dataclasses.replace(geometry, **changes) if changes else geometry
