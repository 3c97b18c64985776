"""Every key of a scenario file: meaning, unit, limits, default, and what excludes what.

The name of a key ends with its unit. A new key is a line here, and where `build` makes SI of it.
RCS models, detectors and data sheets declare their keys with the fields of their classes.
"""

from __future__ import annotations

import dataclasses
import json
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from radar_sense.limits import (
    ANY,
    BAND,
    CORRELATION,
    LEVEL_NAME,
    MAX_RADARS,
    METHODS,
    NAME,
    NOT_NEGATIVE,
    POSITIVE,
    PROBABILITY,
    RADAR_NAME,
    RUNS,
    SEED,
    STD_DB,
    TYPE,
    Limit,
    Text,
)
from radar_sense.model import trajectory
from radar_sense.model.antenna import TILT
from radar_sense.model.detectors import DETECTORS, Detector, North
from radar_sense.model.radar_equation import LOSSES, LOSSES_KEY, RADARS, SEARCH_FACTORS, STANDARD_K
from radar_sense.model.rcs import RCS_MODELS
from radar_sense.model.rcs_table import ENVELOPE
from radar_sense.scenario_file.declare import (
    Section,
    by_word,
    deviations,
    key,
    list_of,
    matrix,
    named,
    number,
    numbers,
    optional,
    or_section,
    schema,
    section,
    write,
    yes_no,
)

SCHEMA_TITLE = "Scenario of radar-sense"
_FILE = Text(r"[^\0\r\n]{1,1000}", "the name of a file")
_LOSS = Text(
    "[a-z][a-z0-9_]{0,29}",
    "the name of a loss, up to 30 letters a to z, digits and '_', a letter first",
)
SPEED = Limit(at_least=1e-3, at_most=1e5)
_ANGLE = Limit(at_least=-360, at_most=360)
_AZIMUTH = Limit(at_least=-360, at_most=720)
#: Meaning and kind of a key that two sections have.
_AZIMUTH_FROM = (
    "Direction of azimuth 0: east as in the paper, or north as on a compass.",
    ("east", "north"),
)
#: Names of detectors elsewhere: a target that does not fluctuate is Swerling's case 0 or 5.
_STEADY = dict.fromkeys(("swerling0", "swerling5"), "marcum")


@dataclass(frozen=True, kw_only=True)
class Geodetic(Section):
    """A place on the earth."""

    latitude_deg: float = key("WGS-84 latitude.", Limit(at_least=-90, at_most=90))
    longitude_deg: float = key("WGS-84 longitude.", Limit(at_least=-180, at_most=360))
    altitude_m: float = key("Height above the ellipsoid.", Limit(at_least=-10e3, at_most=100e3))


def _section(name: str, doc: str, keys: Mapping[str, Any]) -> type:
    """Return a section of this module that is made of keys by name."""
    namespace = {"__doc__": doc, "__module__": __name__}
    fields = [(key, Any, declared) for key, declared in keys.items()]
    return dataclasses.make_dataclass(
        name, fields, bases=(Section,), namespace=namespace, frozen=True, kw_only=True
    )


# The uncertainty.


@dataclass(frozen=True, kw_only=True)
class HalfWidth(Section):
    """A rectangular distribution: limits in place of a standard deviation."""

    half_width: float = key("Half width, in the unit of the parameter.", NOT_NEGATIVE)


def _tolerances() -> type:
    """Return the section of standard deviations by parameter of a data sheet."""
    limits = {
        name: STD_DB if f.metadata["decibels"] else NOT_NEGATIVE
        for cls in RADARS.values()
        for f in dataclasses.fields(cls)
        for name in f.metadata.get("units", {})
        if f.default is dataclasses.MISSING
    }
    keys: dict[str, Any] = {
        name: optional(f"Standard deviation of {name}.", or_section(limit, HalfWidth))
        for name, limit in limits.items()
    }
    losses = named(_LOSS, or_section(STD_DB, HalfWidth), "loss")
    keys[LOSSES_KEY] = optional("Standard deviations of the losses by name.", losses)
    return _section("Tolerances", "Standard deviations by parameter of a data sheet.", keys)


Tolerances = _tolerances()
Types = Mapping[str, Mapping[str, Any]]
_TYPES = dataclasses.replace(
    named(TYPE, named(LEVEL_NAME, section(Tolerances), "level of uncertainty"), "type"),
    allowed="standard deviations by parameter, by level, by type",
)


@dataclass(frozen=True, kw_only=True)
class PoseUncertainty(Section):
    """The uncertainty of the aircraft, the same at all poses."""

    position_m: Any = key(
        "Uncertainty of north, east, down.", deviations(3), unless=("covariance", "rcs_db")
    )
    attitude_deg: Any = key(
        "Uncertainty of roll, pitch, yaw.", deviations(3), unless=("covariance", "rcs_db")
    )
    covariance: Any = optional(
        "Covariance of position, in m, and attitude, in degrees, together.",
        matrix(6),
        instead_of=("position_m", "attitude_deg"),
    )
    rcs_db: float = key(
        "Standard deviation of the RCS [dB], one factor for all looks, and all radars of a band.",
        STD_DB,
        default=0.0,
    )


@dataclass(frozen=True, kw_only=True)
class RadarUncertainty(Section):
    """The uncertainty of a radar at one level."""

    position_m: Any = key(
        "Uncertainty of north, east, down.", deviations(3), unless=("covariance",)
    )
    constant: Any = key(
        "Standard deviation of c_r [J m²/K], or standard deviations by parameter of its data "
        "sheet.",
        or_section(NOT_NEGATIVE, Tolerances),
        unless=("covariance",),
    )
    covariance: Any = optional(
        "Covariance of position, in m, and c_r, in J m²/K, together.",
        matrix(4),
        instead_of=("position_m", "constant"),
    )
    attenuation_db_per_km: float = key(
        "Uncertainty of the attenuation: divided by the attenuation, the standard deviation of its "
        "natural logarithm.",
        NOT_NEGATIVE,
        default=0.0,
    )
    tilt_deg: float = key(
        "Standard deviation of the tilt of the antenna.", Limit(at_least=0, at_most=90), default=0.0
    )


Levels = Mapping[str, RadarUncertainty]
_LEVELS = named(LEVEL_NAME, section(RadarUncertainty), "level of uncertainty")


@dataclass(frozen=True, kw_only=True)
class Uncertainty(Section):
    """The uncertainty of the states."""

    aircraft: PoseUncertainty | None = optional(
        "Covariance of the pose; required unless the route file has it.", PoseUncertainty
    )
    aircraft_correlation_s: float = key(
        "Correlation time of the pose errors.", CORRELATION, default=0.0
    )
    radar: Levels | None = optional(
        "Levels of uncertainty of the radar, by name; required with `radar`, not allowed with "
        "`radars`.",
        _LEVELS,
    )


# The radars.


def _data_sheet(kind: str) -> type:
    """Return the section of a data sheet, with one key a unit of each parameter."""
    keys: dict[str, Any] = {}
    for f in dataclasses.fields(RADARS[kind]):
        units = f.metadata.get("units", {})
        for name, unit in units.items():
            options: dict[str, Any] = {"one_of": f.name}
            if f.name == "loss_db":
                options = {"unless": (LOSSES_KEY,)}
            elif f.name == "temperature":
                options = {"default": STANDARD_K}
            elif f.default is not dataclasses.MISSING:
                options = {"default": f.default}
            meaning = unit.meaning or f.metadata["meaning"]
            keys[name] = key(meaning, f.metadata["kind"], **options)
    losses = named(_LOSS, number(LOSSES), "loss")
    keys[LOSSES_KEY] = optional("Further losses by name [dB].", losses)
    if kind == "surveillance":
        keys["search_factor"] = key(
            "Divisor of the power-aperture product in c_r.", tuple(SEARCH_FACTORS), default="16"
        )
    return _section(kind.capitalize(), f"{RADARS[kind].__doc__}", keys)


Surveillance, Tracking = _data_sheet("surveillance"), _data_sheet("tracking")


@dataclass(kw_only=True)  # and not frozen: who reads the file sets its name and digest
class DataFile(Section):
    """A file beside the scenario file, and what it must have in it."""

    file: str = key("Name of a CSV file, from the folder of the scenario file.", _FILE)
    sha256: str | None = optional(
        "Digest that the file must have.", Text("[0-9a-f]{64}", "64 digits 0 to 9 and a to f")
    )


#: The name of a file, or a `DataFile`.
_DATA_FILE = or_section(_FILE, DataFile, alone="file")


@dataclass(frozen=True, kw_only=True)
class Radar(Section):
    """The only radar."""

    position_m: tuple[float, float, float] | None = key(
        "North, east, down of the radar.", numbers(3), one_of="position"
    )
    position_geodetic: Geodetic | None = key(
        "Place of the radar, with a route in latitude and longitude.", Geodetic, one_of="position"
    )
    p_fa: float = key("Probability of false alarm.", PROBABILITY)
    constant: float | None = key("Radar constant c_r [J m²/K].", POSITIVE, one_of="constant")
    surveillance: Any = key(
        "Parameters of a surveillance radar, in place of the constant.",
        Surveillance,
        one_of="constant",
    )
    tracking: Any = key(
        "Parameters of a tracking radar, in place of the constant.", Tracking, one_of="constant"
    )
    detector: Detector = key(
        "Detector and fluctuation of the target.",
        by_word("model", DETECTORS, bare=True, synonyms=_STEADY),
        default=North(),
    )
    scan_period_s: float | None = optional(
        "Time from one look to the next, which mission needs; by default the scan time of "
        "surveillance.",
        POSITIVE,
    )
    attenuation_db_per_km: float = key(
        "One-way attenuation on the way to the target and back.", NOT_NEGATIVE, default=0.0
    )
    max_range_km: float | None = optional("Slant range beyond which P_D is 0.", POSITIVE)
    min_range_km: float = key("Slant range within which P_D is 0.", NOT_NEGATIVE, default=0.0)
    eclipsing: bool = key(
        "Whether P_D is 0 within c tau/2 (tau: pulse_width_us), where the transmitter hides the "
        "echo.",
        yes_no(),
        default=False,
    )
    horizon: bool = key("Whether P_D is 0 below the horizon.", yes_no(), default=False)
    mask: DataFile | None = optional(
        "CSV file with the lowest visible elevation by azimuth; P_D is 0 below.", _DATA_FILE
    )
    elevation_gain: DataFile | None = optional(
        "CSV file with the relative gain of the antenna by elevation, which counts there and back.",
        _DATA_FILE,
    )
    tilt_deg: float = key(
        "Elevation of the axis of the antenna, from which elevation_gain counts.", TILT, default=0.0
    )
    band: str | None = optional(
        "Frequency band, one of aircraft.rcs.bands; required with bands, not allowed without.", BAND
    )
    type: str | None = optional(
        "Type of the radar, one of types: radars of a type share its errors.", TYPE
    )


@dataclass(frozen=True, kw_only=True)
class _Name(Section):
    name: str = key("Name of the radar in columns and figures.", RADAR_NAME)


@dataclass(frozen=True, kw_only=True)
class NamedRadar(Radar, _Name):  # in this order the name is the first key
    """One of several radars."""

    uncertainty: Levels = key("Levels of uncertainty of this radar.", _LEVELS)


# The aircraft and its flight.


@dataclass(kw_only=True)
class Table(DataFile):
    """An RCS table."""

    mirror: bool = key(
        "Whether the file has one half of a symmetric aircraft.", yes_no(), default=False
    )
    envelope_deg: float | None = optional("Half width of the envelope of the table.", ENVELOPE)


#: The RCS models by name, with the section of a table. A model may be added at any time.
_RCS: ChainMap[str, type[Any]] = ChainMap({"table": Table}, RCS_MODELS)
_ONE_RCS = by_word("model", _RCS)


@dataclass(frozen=True, kw_only=True)
class Bands(Section):
    """The radar cross section by frequency band. Its error is one for the radars of a band."""

    bands: Mapping[str, Any] = key(
        "Radar cross sections by the `band` of the radars.", named(BAND, _ONE_RCS, "band")
    )


@dataclass(frozen=True, kw_only=True)
class Aircraft(Section):
    """The aircraft."""

    rcs: Any = key("Radar cross section, of all radars or by band.", or_section(_ONE_RCS, Bands))
    attitude_deg: tuple[float, float, float] | None = optional(
        "Roll, pitch, yaw on an orbit or a radial, where it is required; not allowed on a path.",
        numbers(3, _ANGLE),
    )


@dataclass(frozen=True, kw_only=True)
class Sweep(Section):
    """Azimuths of the poses."""

    start: float = key("First azimuth [°].", _AZIMUTH)
    stop: float = key("Last azimuth [°], if the step leads to it.", _AZIMUTH)
    step: float = key("Step of azimuth [°].", ANY)


@dataclass(frozen=True, kw_only=True)
class Orbit(Section):
    """A level circle about the origin."""

    range_km: float = key("Horizontal radius of the orbit.", NOT_NEGATIVE)
    down_km: float = key("Down coordinate of the orbit.", ANY)
    azimuth_deg: Sweep = key("Azimuths of the poses.", Sweep)
    azimuth_from: str = key(*_AZIMUTH_FROM, default="east")


@dataclass(frozen=True, kw_only=True)
class Ranges(Section):
    """Ground ranges of the poses."""

    start: float = key("First ground range [km].", NOT_NEGATIVE)
    stop: float = key("Last ground range [km], if the step leads to it.", NOT_NEGATIVE)
    step: float = key("Step of ground range [km].", ANY)


@dataclass(frozen=True, kw_only=True)
class Radial(Section):
    """A level straight line away from the origin."""

    range_km: Ranges = key("Ground ranges of the poses from the origin.", Ranges)
    azimuth_deg: float = key("Azimuth of the line.", _AZIMUTH)
    down_km: float = key("Down coordinate of the line.", ANY)
    azimuth_from: str = key(*_AZIMUTH_FROM, default="east")


@dataclass(frozen=True, kw_only=True)
class Interpolation(Section):
    """Poses at equal steps of time."""

    step_s: float = key("Step of time.", POSITIVE)
    method: str = key("Interpolation in time.", tuple(trajectory.METHODS), default="legs")


@dataclass(kw_only=True)
class Path(DataFile):
    """The path of a route file."""

    file: str = key("Name of a route file, from the folder of the scenario file.", _FILE)
    axis: str = key("Axis of tables and figures.", ("time", "distance"), default="time")
    origin: Geodetic | None = optional(
        "Origin of the frame of a route in latitude and longitude.", Geodetic
    )
    interpolate: Interpolation | None = optional(
        "Poses at equal steps of time; without it the rows of the file.", Interpolation
    )
    max_gap_s: float | None = optional("Longest step of time allowed in the file.", POSITIVE)
    altitude_above: str | None = optional(
        "What the altitudes of the file are above. Without the key: the sea in GPX, else the "
        "ellipsoid. The sea and pressure altitude need geoid_height_m.",
        ("ellipsoid", "sea", "pressure"),
    )
    geoid_height_m: float | None = optional(
        "Height of the sea level above the WGS-84 ellipsoid on the route. It is the surface of the "
        "horizon, too, also of altitudes for which altitude_above states the ellipsoid.",
        Limit(at_least=-110, at_most=90),  # by EGM2008 from -107 to 86
    )
    north_km: float = key("Shift of a whole route to the north.", ANY, default=0.0)
    east_km: float = key("Shift of a whole route to the east.", ANY, default=0.0)
    down_km: float = key(
        "Shift of a whole route in north, east, down; negative is up.", ANY, default=0.0
    )
    altitude_m: float = key(
        "Shift up of a whole route in latitude and longitude.", ANY, default=0.0
    )
    speed_m_s: float | None = optional(
        "Speed along the legs between waypoints, for a file without times.", SPEED
    )
    icao24: str | None = optional(
        "Address of the aircraft in a file of ADS-B state vectors with several aircraft.",
        Text("[0-9A-Fa-f]{6}", "6 digits 0 to 9 and a to f"),
    )


# The file.


@dataclass(frozen=True, kw_only=True)
class Analysis(Section):
    """Choices for the analyses."""

    level: str = key("Level of uncertainty of the radar, one of its levels.", LEVEL_NAME)
    runs: int = key("Monte Carlo runs.", RUNS, default=500)
    seed: int = key("Seed of the random numbers.", SEED, default=1)
    method: str = key(
        "How uncertain states become a distribution of P_D.", tuple(METHODS), default="automatic"
    )


@dataclass(frozen=True, kw_only=True)
class File(Section):
    """A scenario file."""

    name: str = key("Stem of the names of the files written.", NAME)
    radar: Radar | None = key("The radar.", Radar, one_of="radars")
    radars: tuple[NamedRadar, ...] | None = key(
        "Several radars in place of one, each with a name.",
        list_of(section(NamedRadar), "one radar or more, each with a name", 1, MAX_RADARS),
        one_of="radars",
    )
    types: Types | None = optional(
        "Standard deviations by parameter of a data sheet that the radars of a type share, by type "
        "and level.",
        _TYPES,
    )
    aircraft: Aircraft = key("RCS and attitude of the aircraft.", Aircraft)
    geometry: Orbit | Radial | Path = key(
        "The poses of the aircraft: an orbit, a line of ranges or a path.",
        {"orbit": Orbit, "radial": Radial, "path": Path},
    )
    uncertainty: Uncertainty = key("Covariances of the states.", Uncertainty)
    analysis: Analysis = key("Choices for the analyses.", Analysis)

    def document(self) -> dict[str, Any]:
        """Return the file with the numbers as typed and defaults filled in."""
        return write(self)


def schema_text() -> str:
    """Return the JSON Schema of a scenario file, as JSON."""
    head = {"$schema": "http://json-schema.org/draft-07/schema#", "title": SCHEMA_TITLE}
    return json.dumps({**head, **schema(File)}, indent=1, ensure_ascii=False) + "\n"
