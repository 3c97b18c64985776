"""The scenario: states of aircraft and radars in SI units, and their covariances."""

from __future__ import annotations

import dataclasses
import html
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense import axis as axes
from radar_sense import covariance, record
from radar_sense.axis import Axis
from radar_sense.errors import InputError, check_choice, describe, shorten_list
from radar_sense.keys import ANALYSIS_METHOD, NAME, RADAR_NAME, RUNS_KEY, SEED_KEY
from radar_sense.limits import (
    MAX_NAME,
    METHODS,
    NOT_NEGATIVE,
    RUNS,
    SEED,
    STD_DB,
    Limit,
    check_number,
)
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.geodesy import is_place
from radar_sense.model.network import NetworkModel, as_network
from radar_sense.model.radar_constant import Tolerance
from radar_sense.model.rcs import RCS
from radar_sense.model.trajectory import Route
from radar_sense.provenance import Provenance, StatedCovariance
from radar_sense.states import AIRCRAFT, CONSTANTS, RADAR, FloatArray, size_of

#: The fields that are mappings by level, each with an example.
_BY_LEVEL = {
    "cov_radar": "{'medium': (4, 4)}",
    "tolerances": "{'medium': ((Tolerance, ...),)}",
    "attenuation_std": "{'medium': (1e-6,)}",
}


class _Network:
    """The field `Scenario.model`, which turns a model of one radar or several into a network.

    With a descriptor type checkers accept both kinds of models and find a `NetworkModel`.
    """

    def __get__(self, scenario: Scenario | None, owner: type[Scenario]) -> NetworkModel:
        if scenario is None:
            raise AttributeError("model")  # for `dataclass`, the field has no default
        network: NetworkModel = vars(scenario)["model"]
        return network

    def __set__(self, scenario: Scenario, model: DetectionModel | NetworkModel) -> None:
        vars(scenario)["model"] = as_network(model)


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
        provenance: Files, orbit, places and data sheets that the arrays were made from.
    """

    model: _Network = _Network()
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: Mapping[str, FloatArray]
    name: str = "scenario"
    axis: Axis = field(default_factory=lambda: axes.pose_number(0))
    level: str = ""
    runs: int = RUNS_KEY.default
    seed: int = SEED_KEY.default
    method: str = ANALYSIS_METHOD.default
    tolerances: Mapping[str, tuple[tuple[Tolerance, ...], ...]] = field(default_factory=dict)
    time_s: FloatArray | None = None
    rcs_db: float = 0.0
    attenuation_std: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    correlation_s: float = 0.0
    origin: tuple[float, float, float] | None = None
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
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
        if not isinstance(self.provenance, Provenance):
            raise InputError(f"provenance must be a Provenance, got {self.provenance!r}")
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
        stated = self.provenance.cov_aircraft
        if stated is None or self.cov_aircraft is not stated.made:  # the reader has checked these
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
            if not re.fullmatch(RADAR_NAME.pattern, name):
                raise InputError(f"names of radars must be {RADAR_NAME.allowed}, got {name!r}")
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
        if not isinstance(self.name, str) or not re.fullmatch(NAME.pattern, self.name):
            raise InputError(f"name must be {NAME.allowed}, got {self.name!r}")
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

    def _repr_html_(self) -> str:
        rows = {
            "poses": f"{len(self.aircraft)}, {self.axis.name} {self.axis.at(0)} "
            f"to {self.axis.at(-1)}",
            "radars": self.model.in_words,
            "c<sub>r</sub> [J m²/K]": ", ".join(f"{c:g}" for c in self.radar[CONSTANTS]),
            "levels": ", ".join(self.cov_radar),
            "level": self.level,
            "runs": str(self.runs),
            "seed": str(self.seed),
        }
        cells = "".join(
            f"<tr><th style='text-align:left'>{key}</th><td>{html.escape(value)}</td></tr>"
            for key, value in rows.items()
        )
        return f"<table><caption>Scenario {html.escape(self.name)}</caption>{cells}</table>"

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

    @property
    def theta_r_deg(self) -> FloatArray:
        """Coordinate of each pose on the axis (n,): on an orbit θ_r [deg]."""
        return self.axis.values

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
        )

    def at_states(self, aircraft: FloatArray) -> Scenario:
        """Return the scenario at other aircraft states (..., 6), one pose after the other.

        All states have the covariance of the first pose. The values are not checked.
        """
        states = aircraft.reshape(-1, len(AIRCRAFT))
        return self._with(
            axis=axes.pose_number(len(states)),
            aircraft=states,
            cov_aircraft=self.cov_aircraft.reshape(-1, len(AIRCRAFT), len(AIRCRAFT))[0],
            time_s=None,
        )

    def route(self) -> Route:
        """Return the poses of a path as a route, to interpolate between them.

        Raises:
            InputError: If the poses have no times.
        """
        if self.time_s is None:
            raise InputError(
                "an orbit has no times: give a path, geometry: {type: path, file: my_route.csv}"
            )
        covariance = self.cov_aircraft
        return Route(
            time_s=self.time_s,
            aircraft=self.aircraft,
            covariance=covariance if covariance.ndim == 3 else None,
            attitude_given=True,  # interpolated, not derived from the track again
            origin=self.origin,
        )

    def along_path(
        self,
        *,
        axis: Axis,
        aircraft: FloatArray,
        cov_aircraft: FloatArray,
        time_s: FloatArray | None,
    ) -> Scenario:
        """Return the scenario with other poses of the same path or orbit.

        The record still has the path or the orbit.

        Args:
            axis: Axis of the poses (n,).
            aircraft: States (n, 6).
            cov_aircraft: C_aa (6, 6), or one for each pose (n, 6, 6).
            time_s: Time of each pose (n,) [s] of a path; None on an orbit.
        """
        source = self.provenance
        if record.is_as_made(self.aircraft, source):
            source = dataclasses.replace(source, aircraft=aircraft)
        stated = source.cov_aircraft
        if stated is not None and np.array_equal(self.cov_aircraft, stated.made):
            stated = StatedCovariance(stated.stated, cov_aircraft)
            source = dataclasses.replace(source, cov_aircraft=stated)
        return self._with(
            axis=axis,
            aircraft=_read_only("aircraft", aircraft),
            cov_aircraft=_read_only("cov_aircraft", cov_aircraft),
            time_s=None if time_s is None else _read_only("time_s", time_s),
            provenance=source,
        )

    def resolved(self) -> dict[str, Any]:
        """Return the scenario with the keys and units of a scenario file, defaults filled in.

        A scenario from a file reads back as the same scenario. See `record` for arrays without a
        file.
        """
        document: dict[str, Any] = {"name": self.name}
        uncertainty = {
            **record.cov_aircraft_block(
                self.cov_aircraft, self.provenance.cov_aircraft, self.rcs_db
            ),
            **record.correlation_block(self.correlation_s, has_times=self.time_s is not None),
        }
        if self.model.names:
            document["radars"] = [self._radar_document(i) for i in range(self._radar_count)]
        else:
            document["radar"] = self._radar_document(0)
            uncertainty["radar"] = self._levels_document(0)
        return {
            **document,
            "aircraft": {
                "rcs": record.rcs_block(self.model.rcs, self.provenance.rcs),
                **record.attitude_block(self.aircraft, self.provenance),
            },
            "geometry": record.geometry_block(self.aircraft, self.axis, self.provenance),
            "uncertainty": uncertainty,
            "analysis": {
                "level": self.level,
                "runs": self.runs,
                "seed": self.seed,
                "method": self.method,
            },
        }

    def _radar_document(self, i: int) -> dict[str, Any]:
        state, sources = self.radar[_components(i)], self.provenance.radars
        radar = self.model.radars[i]
        source = sources.get(radar.name)
        block = record.radar_block(radar.model, state, source, radar.scan_period)
        limits = record.limits_block(
            radar.max_range, radar.min_range, radar.horizon, self.provenance.earth
        )
        if not radar.name:
            return {**block, **{key: value for key, value in limits.items() if value}}
        return {
            "name": radar.name,
            **block,
            **limits,
            "uncertainty": self._levels_document(i),
        }

    def _levels_document(self, i: int) -> dict[str, Any]:
        components = _components(i)
        name = self.model.names[i] if self.model.names else ""
        source = self.provenance.radars.get(name)
        none: tuple[tuple[Tolerance, ...], ...] = ((),) * self._radar_count
        return {
            level: record.level_block(
                matrix[components, components],
                self.tolerances.get(level, none)[i],
                source,
                self.radar[components],
                level,
                self.attenuation_std[level][i] if level in self.attenuation_std else 0.0,
            )
            for level, matrix in self.cov_radar.items()
        }

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

    def __reduce__(self) -> tuple[Callable[..., Scenario], tuple[dict[str, Any]]]:
        # A mapping proxy cannot be pickled.
        names = ("cov_radar", "tolerances", "attenuation_std")
        mappings = {name: dict(getattr(self, name)) for name in names}
        return _make_scenario, (vars(self) | mappings,)


def _make_scenario(fields: Mapping[str, Any]) -> Scenario:
    """Make a scenario from its fields, as unpickling does."""
    return Scenario(**fields)


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
    return {
        radar.name: scenario._with(
            model=NetworkModel((radar,)),
            radar=scenario.radar[_components(i)],
            cov_radar=MappingProxyType(
                {
                    level: matrix[_components(i), _components(i)]
                    for level, matrix in scenario.cov_radar.items()
                }
            ),
            tolerances=MappingProxyType(
                {level: (of_radars[i],) for level, of_radars in scenario.tolerances.items()}
            ),
            attenuation_std=MappingProxyType(
                {level: (of_radars[i],) for level, of_radars in scenario.attenuation_std.items()}
            ),
        )
        for i, radar in enumerate(model.radars)
    }


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


def _components(radar: int) -> slice:
    """Return the components of one radar in the states of all radars."""
    return slice(len(RADAR) * radar, len(RADAR) * (radar + 1))


def _is_sequence(values: object) -> bool:
    return isinstance(values, Sequence) and not isinstance(values, str)


def _read_only(name: str, values: Any) -> FloatArray:
    """Return a read-only array, a copy unless the array is read-only already."""
    if isinstance(values, np.ndarray) and values.dtype == float and not values.flags.writeable:
        return values
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers: {error}") from error
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
