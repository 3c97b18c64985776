"""The keys of a scenario file: meaning, unit, limits and default of each key.

The reader and `Scenario.resolved` use these declarations. Keys of RCS models, detectors and data
sheets are declared with the fields of their classes (`declared`, `declared_units`).
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from typing import Any

from radar_sense import limits
from radar_sense.limits import (
    ANY,
    DEG,
    MAX_NAME,
    NOT_NEGATIVE,
    POSITIVE,
    PROBABILITY,
    RUNS,
    SEED,
    STD_DB,
    Limit,
)
from radar_sense.model.detectors import CFARS, DETECTORS, BinaryIntegration
from radar_sense.model.radar_equation import LOSSES_KEY, RADARS, SEARCH_FACTORS
from radar_sense.model.rcs import RCS_MODELS
from radar_sense.model.rcs_table import ENVELOPE
from radar_sense.model.trajectory import METHODS

REQUIRED = object()
YES_NO = ("true", "false")
_BRACKETS = re.compile(r" \[([^]]*)\]")
#: Units by the last word of the name of a key or a column.
UNITS = {
    "m": "m",
    "km": "km",
    "m2": "m²",
    "deg": "°",
    "s": "s",
    "sr": "sr",
    "k": "K",
    "w": "W",
    "kw": "kW",
    "db": "dB",
    "dbi": "dBi",
    "rpm": "1/min",
    "ghz": "GHz",
    "mhz": "MHz",
    "us": "µs",
}
#: Names that become parts of the names of columns.
_LABEL = "[A-Za-z0-9][A-Za-z0-9_-]{0,39}"


@dataclass(frozen=True)
class Key:
    """A key of a scenario file.

    Attributes:
        name: The key, with the unit in the name.
        help: Meaning of the value.
        limit: The numbers allowed, in the unit of the key; None if the value is no number.
        unit: SI value of 1 in the unit of the key.
        size: Number of numbers in the value.
        choices: The words allowed; empty if any word is allowed.
        pattern: Regular expression of text.
        allowed: The pattern in words.
        default: Value of a missing key; `REQUIRED` if the key must be present.
        infinite: Whether `.inf` is allowed.
    """

    name: str
    help: str
    limit: Limit | None = None
    unit: float = 1.0
    size: int = 1
    choices: Collection[str] = ()
    pattern: str = ""
    allowed: str = ""
    default: Any = REQUIRED
    infinite: bool = False

    @property
    def required(self) -> bool:
        """Whether the key must be in the file."""
        return self.default is REQUIRED

    @property
    def meaning(self) -> str:
        """The help without the unit in brackets."""
        return _BRACKETS.sub("", self.help)

    @property
    def unit_name(self) -> str:
        """The unit of a number, from the name or else from the help; "" without a unit."""
        brackets = _BRACKETS.search(self.help)
        if self.limit is None:
            return ""
        return unit_name(self.name) or (brackets[1] if brackets else "")


def unit_name(name: str) -> str:
    """Return the unit at the end of a name, as in `range_km` or `db_per_km`; "" without a unit."""
    if name.endswith("_m_s"):
        return "m/s"
    stem, _, unit = name.rpartition("_")
    if stem.endswith("_per"):
        return f"{unit_name(stem.removesuffix('_per'))}/{UNITS.get(unit, unit)}"
    return UNITS.get(unit, "") if stem else ""


def declared(cls: Any) -> tuple[Key, ...]:
    """Return the keys that are declared with the fields of a dataclass by `limits.parameter`."""
    return tuple(
        Key(
            f.metadata["key"],
            _attribute_help(cls, f.name),
            f.metadata["limit"],
            default=REQUIRED if f.default is MISSING else f.default,
        )
        for f in _fields(cls)
        if "key" in f.metadata
    )


def declared_sections(cls: Any) -> dict[str, Field[Any]]:
    """Return the fields that are declared as mappings by `limits.section`, by key."""
    return {f.metadata["section"]: f for f in _fields(cls) if "section" in f.metadata}


def section_keys(cls: Any) -> tuple[Key, ...]:
    """Return the keys of the mappings that a dataclass declares by `limits.section`."""
    return tuple(
        Key(key, _attribute_help(cls, f.name), default=None)
        for key, f in declared_sections(cls).items()
    )


def _fields(cls: Any) -> tuple[Field[Any], ...]:
    return fields(cls) if is_dataclass(cls) else ()


def declared_units(cls: Any) -> tuple[tuple[Key, ...], ...]:
    """Return the keys of a data sheet: for each parameter one key a unit."""
    return tuple(
        tuple(
            Key(
                key,
                unit.meaning or _attribute_help(cls, f.name),
                f.metadata["limit"],
                default=f.metadata.get("assumed", REQUIRED) if f.default is MISSING else f.default,
            )
            for key, unit in f.metadata["units"].items()
        )
        for f in fields(cls)
        if "units" in f.metadata
    )


@functools.cache
def _attribute_help(cls: Any, name: str) -> str:
    """Return the text of an attribute in the docstrings of a class and its bases."""
    lines = [line for base in cls.__mro__ for line in (base.__doc__ or "").splitlines()]
    for i, line in enumerate(lines):
        if line.strip().startswith(f"{name}: "):
            text = [line.strip().removeprefix(f"{name}: ")]
            indent = len(line) - len(line.lstrip())
            for more in lines[i + 1 :]:
                if not more.strip() or len(more) - len(more.lstrip()) <= indent:
                    break
                text.append(more.strip())
            return " ".join(text)
    return ""


def in_unit(value: float, unit: float) -> float:
    """Return a number in a unit, the shortest decimal that reads back as the SI value.

    Args:
        value: The number in SI.
        unit: SI value of 1 in the unit.
    """
    exact = shortest(value, value / unit, lambda number: number * unit)
    return value / unit if exact is None else exact


def shortest(value: float, guess: float, to_si: Callable[[float], float]) -> float | None:
    """Return the shortest decimal near a guess with `to_si(decimal) == value`, or None.

    Neighbours of the guess are tried too, because the inverse of a product or a square rounds.
    """
    near = [guess]
    for end in (math.inf, -math.inf):
        step = guess
        for _ in range(2):
            step = math.nextafter(step, end)
            near.append(step)
    for digits in range(1, 18):
        if abs(float(f"{guess:.{digits}g}") - guess) > 1e-14 * abs(guess):
            continue  # a decimal so far away cannot read back as the value
        for number in near:
            decimal = float(f"{number:.{digits}g}")
            if to_si(decimal) == value:
                return decimal
    return None


NAME = Key(
    "name",
    "Stem of the names of the files written.",
    pattern=f"[A-Za-z0-9][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}",
    allowed=f"a name of up to {MAX_NAME} letters A to Z, digits, '_', '-' or '.'",
)
SCENARIO = (
    NAME,
    Key("radar", "The radar.", default=None),
    Key("radars", "Several radars in place of one, each with a name.", default=None),
    Key("aircraft", "RCS and attitude of the aircraft."),
    Key("geometry", "The poses of the aircraft: an orbit or a path."),
    Key("uncertainty", "Covariances of the states."),
    Key("analysis", "Choices for the analyses."),
)
PLACE = (
    Key("latitude_deg", "WGS-84 latitude.", Limit(at_least=-90, at_most=90), DEG),
    Key("longitude_deg", "WGS-84 longitude.", Limit(at_least=-180, at_most=360), DEG),
    Key("altitude_m", "Height above the ellipsoid.", Limit(at_least=-10e3, at_most=100e3)),
)
RADAR_POSITION = Key("position_m", "North, east, down of the radar.", ANY, size=3)
RADAR_PLACE = Key(
    "position_geodetic", "Place of the radar, with a route in latitude and longitude."
)
CONSTANT = Key("constant", "Radar constant c_r [J m²/K].", POSITIVE, default=None)
P_FA = Key("p_fa", "Probability of false alarm.", PROBABILITY)
ATTENUATION = Key(
    "attenuation_db_per_km",
    "One-way attenuation on the way to the target and back.",
    NOT_NEGATIVE,
    1e-3,
    default=0.0,
)
ATTENUATION_STD = Key(
    ATTENUATION.name,
    "Uncertainty of the attenuation: divided by the attenuation, the standard deviation of its "
    "natural logarithm.",
    NOT_NEGATIVE,
    1e-3,
    default=0.0,
)
DETECTOR = Key(
    "detector", "Detector and fluctuation of the target.", choices=DETECTORS, default="north"
)
DETECTOR_MODEL = Key("model", "Name of the detector.", choices=DETECTORS)
CFAR_TYPE = Key("type", "Kind of CFAR.", choices=CFARS)
#: Keys of the word for the kind of a mapping, by the key of the mapping.
TYPES = {"cfar": CFAR_TYPE}
SCAN_PERIOD = Key(
    "scan_period_s",
    "Time from one look to the next; without it each pose is a look.",
    POSITIVE,
    default=None,
)
RADAR_NAME = Key(
    "name",
    "Name of the radar in columns and figures.",
    pattern=_LABEL,
    allowed="the name of a radar, up to 40 letters A to Z, digits, '_' or '-'",
)
MAX_RANGE = Key(
    "max_range_km", "Slant range beyond which P_D is 0.", POSITIVE, 1e3, default=math.inf
)
MIN_RANGE = Key(
    "min_range_km", "Slant range within which P_D is 0.", NOT_NEGATIVE, 1e3, default=0.0
)
ECLIPSING = Key(
    "eclipsing",
    "Whether P_D is 0 within c tau/2 (tau: pulse_width_us), where the transmitter hides the echo.",
    choices=YES_NO,
    default=False,
)
HORIZON = Key("horizon", "Whether P_D is 0 below the horizon.", choices=YES_NO, default=False)
RADAR_UNCERTAINTY = Key("uncertainty", "Levels of uncertainty of this radar.")
DATA_SHEETS = tuple(
    Key(kind, f"Parameters of a {kind} radar, in place of the constant.", default=None)
    for kind in RADARS
)
LIMITS = (MAX_RANGE, MIN_RANGE, ECLIPSING, HORIZON)
RADAR = (
    RADAR_POSITION,
    RADAR_PLACE,
    P_FA,
    CONSTANT,
    *DATA_SHEETS,
    DETECTOR,
    SCAN_PERIOD,
    ATTENUATION,
    *LIMITS,
)
RADARS_ENTRY = (RADAR_NAME, *RADAR, RADAR_UNCERTAINTY)
LOSSES_DB = Key(
    LOSSES_KEY,
    "Further losses by name [dB].",
    allowed="numbers from 0 to 200 by name",
    default=None,
)
LOSS_NAME = Key(
    "loss",
    "Name of a loss.",
    pattern="[a-z][a-z0-9_]{0,29}",
    allowed="the name of a loss, up to 30 letters a to z, digits and '_', a letter first",
)
SEARCH_FACTOR = Key(
    "search_factor",
    "Divisor of the power-aperture product in c_r.",
    choices=SEARCH_FACTORS,
    default="16",
)
ATTITUDE = Key(
    "attitude_deg",
    "Roll, pitch, yaw on an orbit.",
    Limit(at_least=-360, at_most=360),
    DEG,
    size=3,
)
AIRCRAFT = (Key("rcs", "Radar cross section."), ATTITUDE)
RCS_MODEL = Key("model", "RCS model.", choices=RCS_MODELS)
FILE = Key(
    "file",
    "Name of a CSV file (a route: GPX too), from the folder of the scenario file.",
    pattern=r"[^\0\r\n]{1,1000}",
    allowed="the name of a CSV file",
)
SHA256 = Key(
    "sha256",
    "Digest that the file must have.",
    pattern="[0-9a-f]{64}",
    allowed="64 digits 0 to 9 and a to f",
    default=None,
)
MIRROR = Key(
    "mirror",
    "Whether the file has one half of a symmetric aircraft.",
    choices=YES_NO,
    default=False,
)
ENVELOPE_WIDTH = Key(
    "envelope_deg", "Half width of the envelope of the table.", ENVELOPE, DEG, default=None
)
TABLE = (RCS_MODEL, FILE, MIRROR, ENVELOPE_WIDTH, SHA256)
GEOMETRY_TYPE = Key("type", "Kind of geometry.", choices=("orbit", "path"))
RANGE = Key("range_km", "Horizontal radius of the orbit.", NOT_NEGATIVE, 1e3)
DOWN = Key("down_km", "Down coordinate of the orbit.", ANY, 1e3)
AZIMUTH_FROM = Key(
    "azimuth_from",
    "Direction of azimuth 0: east as in the paper, or north as on a compass.",
    choices=("east", "north"),
    default="east",
)
ORBIT = (GEOMETRY_TYPE, RANGE, DOWN, Key("azimuth_deg", "Azimuths of the poses."), AZIMUTH_FROM)
SWEEP = (
    Key("start", "First azimuth [°].", Limit(at_least=-360, at_most=720)),
    Key("stop", "Last azimuth [°].", Limit(at_least=-360, at_most=720)),
    Key("step", "Step of azimuth [°].", ANY),
)
AXIS = Key("axis", "Axis of tables and figures.", choices=("time", "distance"), default="time")
MAX_GAP = Key("max_gap_s", "Longest step of time allowed in the file.", POSITIVE, default=None)
ALTITUDE_ABOVE = Key(
    "altitude_above",
    "What the altitudes of the file are above. Without the key: the sea in GPX, else the "
    "ellipsoid. The sea and pressure altitude need geoid_height_m.",
    choices=("ellipsoid", "sea", "pressure"),
    default=None,
)
GEOID_HEIGHT = Key(
    "geoid_height_m",
    "Height of the sea level above the WGS-84 ellipsoid on the route.",
    Limit(at_least=-110, at_most=90),
    default=None,
)
SPEED = Key(
    "speed_m_s",
    "Speed along the legs between waypoints, for a file without times.",
    Limit(at_least=1e-3, at_most=1e5),
    default=None,
)
ICAO24 = Key(
    "icao24",
    "Address of the aircraft in a file of ADS-B state vectors with several aircraft.",
    pattern="[0-9A-Fa-f]{6}",
    allowed="6 digits 0 to 9 and a to f",
    default=None,
)
#: Conventions of a route file that the file does not state.
CONVENTIONS = (ALTITUDE_ABOVE, GEOID_HEIGHT, SPEED, ICAO24)
PATH = (
    GEOMETRY_TYPE,
    FILE,
    AXIS,
    Key("origin", "Origin of the frame of a route in latitude and longitude.", default=None),
    Key("interpolate", "Poses at equal steps of time.", default=None),
    MAX_GAP,
    *CONVENTIONS,
    SHA256,
)
STEP = Key("step_s", "Step of time.", POSITIVE)
METHOD = Key("method", "Interpolation in time.", choices=METHODS, default="legs")
INTERPOLATE = (STEP, METHOD)
CORRELATION = Key(
    "aircraft_correlation_s",
    "Correlation time of the pose errors.",
    NOT_NEGATIVE,
    default=0.0,
    infinite=True,
)
UNCERTAINTY = (
    Key("aircraft", "Covariance of the pose, unless the route file has the covariance."),
    CORRELATION,
    Key("radar", "Levels of uncertainty of the radar, by name."),
)
LEVEL_NAME = Key(
    "level",
    "Name of a level of uncertainty.",
    pattern=_LABEL,
    allowed="the name of a level, up to 40 letters A to Z, digits, '_' or '-'",
)
COVARIANCE = Key("covariance", "Covariance of the whole state.", ANY, default=None)
RCS_DB = Key(
    "rcs_db",
    "Standard deviation of the RCS [dB], one factor for all radars and looks.",
    STD_DB,
    default=0.0,
)
#: Parts of a covariance: a standard deviation for all components, for each, or a matrix.
COV_AIRCRAFT = (
    Key("position_m", "Uncertainty of north, east, down.", NOT_NEGATIVE, size=3),
    Key("attitude_deg", "Uncertainty of roll, pitch, yaw.", NOT_NEGATIVE, DEG, size=3),
)
COV_RADAR = (
    Key("position_m", "Uncertainty of north, east, down.", NOT_NEGATIVE, size=3),
    Key(
        "constant",
        "Standard deviation of c_r, or standard deviations by parameter of its data sheet.",
        NOT_NEGATIVE,
    ),
)
LEVEL = Key(
    "level",
    "Level of uncertainty of the radar.",
    pattern=_LABEL,
    allowed="one of the levels of the radar",
)
RUNS_KEY = Key("runs", "Monte Carlo runs.", RUNS, default=500)
SEED_KEY = Key("seed", "Seed of the random numbers.", SEED, default=1)
ANALYSIS_METHOD = Key(
    "method",
    "How uncertain states become a distribution of P_D.",
    choices=limits.METHODS,
    default="automatic",
)
ANALYSIS = (LEVEL, RUNS_KEY, SEED_KEY, ANALYSIS_METHOD)


def sections() -> Mapping[str, tuple[Key, ...]]:
    """Return all keys of a scenario file by section."""
    models = {
        f"aircraft.rcs (model: {name})": (RCS_MODEL, *declared(cls))
        for name, cls in RCS_MODELS.items()
        if name != "table"
    }
    sheets = {
        f"radar.{kind}": tuple(key for units in declared_units(cls) for key in units)
        + ((LOSSES_DB, SEARCH_FACTOR) if kind == "surveillance" else (LOSSES_DB,))
        for kind, cls in RADARS.items()
    }
    detectors = {
        f"radar.detector (model: {name})": (
            DETECTOR_MODEL,
            *declared(cls),
            *section_keys(cls),
        )
        for name, cls in DETECTORS.items()
    }
    cfars = {
        f"radar.detector.cfar (type: {name})": (CFAR_TYPE, *declared(cls))
        for name, cls in CFARS.items()
    }
    return {
        "": SCENARIO,
        "radar": RADAR,
        "radars[]": RADARS_ENTRY,
        "radar.position_geodetic": PLACE,
        **sheets,
        **detectors,
        **cfars,
        "radar.detector.binary": declared(BinaryIntegration),
        "aircraft": AIRCRAFT,
        **models,
        "aircraft.rcs (model: table)": TABLE,
        "geometry (type: orbit)": ORBIT,
        "geometry.azimuth_deg": SWEEP,
        "geometry (type: path)": PATH,
        "geometry.origin": PLACE,
        "geometry.interpolate": INTERPOLATE,
        "uncertainty": UNCERTAINTY,
        "uncertainty.aircraft": (*COV_AIRCRAFT, COVARIANCE, RCS_DB),
        "uncertainty.radar.LEVEL": (*COV_RADAR, COVARIANCE, ATTENUATION_STD),
        "analysis": ANALYSIS,
    }
