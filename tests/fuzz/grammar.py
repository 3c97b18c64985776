"""Random scenarios, routes, RCS tables and options, made from the declarations that readers use.

A new key of a scenario file, a new column and a new option are fuzzed without a change here. Only a
key that is a section of its own needs a rule in `RandomScenario.rules`.

Numbers are drawn from usual intervals, or from the whole interval that is declared. Mutations then
break some of the inputs.
"""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from radar_sense import cli
from radar_sense.command import WORKER_THREADS, Command, Option
from radar_sense.limits import LARGEST, NOT_NEGATIVE, SMALLEST, STYLES, Limit
from radar_sense.model.detectors import DETECTORS
from radar_sense.model.radar_equation import RADARS, SEARCH_FACTORS
from radar_sense.model.rcs import RCS_MODELS
from radar_sense.scenario_file import declare, rcs_file, route_file
from radar_sense.scenario_file.declare import Key, keys_of
from radar_sense.scenario_file.sections import File, Surveillance, Tracking

#: The scenario file of a case.
CONFIG = "my.yaml"

#: Intervals that make ordinary scenarios, by key.
USUAL: Mapping[str, tuple[float, float]] = {
    "position_m": (1, 1e5),
    "constant": (1, 300),
    "p_fa": (1e-9, 1e-3),
    "scan_period_s": (1, 100),
    "attenuation_db_per_km": (1e-3, 0.2),
    "rcs_db": (0.1, 3),
    "max_range_km": (50, 800),
    "min_range_km": (0.1, 20),
    "latitude_deg": (30, 40),
    "longitude_deg": (5, 15),
    "altitude_m": (0, 1e4),
    "attitude_deg": (0.1, 90),
    "range_km": (10, 800),
    "down_km": (-15, -1),
    "p_d": (0.05, 0.95),
    "threshold": (0.05, 1),
    "target": (0.01, 1.5),
    "runs": (2, 100),
    "step_s": (1, 100),
    "max_gap_s": (100, 1e4),
    "geoid_height_m": (-100, 80),
    "envelope_deg": (0.5, 20),
    # data sheets
    "average_power_w": (1e3, 1e5),
    "average_power_kw": (1, 100),
    "aperture_m2": (2, 40),
    "scan_time_s": (2, 12),
    "rotation_rpm": (5, 15),
    "search_volume_sr": (0.2, 6),
    "peak_power_w": (1e5, 3e6),
    "peak_power_kw": (100, 3000),
    "gain_dbi": (30, 40),
    "frequency_ghz": (1, 10),
    "wavelength_m": (0.03, 0.3),
    "bandwidth_mhz": (0.1, 5),
    "pulse_width_us": (0.5, 20),
    "temperature_k": (290, 1000),
    "coherent_pulses": (1, 64),
    "aircraft_correlation_s": (0, 1000),
}

#: Scalars that are wrong nearly everywhere.
NASTY = (
    *("", "~", "null", ".nan", "NaN", "nan", ".inf", "-.inf", "inf", "Infinity", "'.inf'"),
    *("1e400", "-1e400", "1e-400", "1e308", "-1e308", "1e-308", "5e-324", "1e20", "-1e20", "1e-20"),
    *("1.0000000000000002e20", "9.9e-21", "-0", "-0.0", "0", "-1", "1", "2", "0.5", "1e6", "1e9"),
    *("0x10", "0o17", "1_000", "1:30", "1,5", "1e", ".", "+", "--1", "1e1e1", "5.", ".5", "+.5e+1"),
    *("१२", "٣", "²", "½", "１２", "−1", "1\u00a0", "\u200b1", "1e１"),
    *("true", "false", "True", "yes", "NO", "on", "2026-01-01", "'5'", '"5"', "'", '"', "north"),
    *("[]", "{}", "[1, 2, 3]", "[1, 2]", "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "[[[1]]]", "{a: 1}"),
    *("[-1, -1, -1]", "[.nan, 1, 1]", "[1, [2], 3]", "[[1, 2, 0], [2, 1, 0], [0, 0, 1]]"),
    *("!!float 1", "!!int '1'", "!!str x", "!!python/object/apply:os.system [ls]", "!x 1", "! 1"),
    *(
        "&a 1",
        "*a",
        "*b",
        "&a [*a]",
        "<<",
        "{<<: *a}",
        "? x",
        "|",
        ">",
        "%",
        "@",
        "`",
        "- 1",
        "---",
    ),
    *('"\\0"', '"\\e[31m"', '"\\u202e"', '"\\n"', '"\\ud800"', '"\\x80"', "'a\tb'", "a: b: c"),
    *("a" * 200, "9" * 400, "9" * 5000, "0." + "0" * 400 + "1", "1e" + "9" * 30, "-" * 50),
    *("[" * 60 + "]" * 60, "..", "../..", "/", "/dev/null", "/dev/stdin", "my.yaml", "*", "#", "é"),
)

#: Characters put anywhere into a file.
CHARACTERS = (
    "\0\a\b\t\x0b\x0c\r\x1b\x7f\x85\u00a0\u2028\u202e\ufeff\ufffe😀é٣\"'`{}[]#&*!|>%@:,-? \n;="
)
#: Bytes that are no UTF-8.
BAD_BYTES = (b"\xff", b"\xc3(", b"\xed\xa0\x80", b"\xfe\xff", b"\x80", b"\xf8\x88\x80\x80\x80")

Pairs = list[tuple[str, Any]]

SECTIONS = {title: keys_of(cls) for title, cls in declare.sections(File)}
#: Keys of a path that depend on its file.
CONVENTIONS = ("max_gap_s", "altitude_above", "geoid_height_m", "speed_m_s", "icao24")


@dataclass(frozen=True)
class Case:
    """Files and a command line.

    Attributes:
        files: Content by name.
        args: The command line.
        mutations: The changes that broke the input, in words.
    """

    files: Mapping[str, bytes]
    args: tuple[str, ...]
    mutations: tuple[str, ...] = field(default=())


def number(rng: random.Random, limit: Limit, usual: tuple[float, float] | None, wild: float) -> str:
    """Return a number within a limit: usual, or anywhere in the limit, or at one of the ends."""
    if usual is None and not wild:
        usual = _ordinary(limit)
    if usual is None or rng.random() < wild:
        low = limit.at_least if limit.at_least is not None else limit.above
        high = limit.at_most if limit.at_most is not None else limit.below
        ends = [end for end in (low, high) if end is not None]
        kind = rng.random()
        if ends and kind < 0.2:
            value = float(rng.choice(ends))
            if not limit.allows(value):
                value = math.nextafter(value, -value) if value else SMALLEST
        elif low is not None and high is not None and kind < 0.6:
            value = float(rng.uniform(low, high))
        else:
            value = 10 ** rng.uniform(math.log10(SMALLEST), math.log10(LARGEST))
            value = min(value, float(high)) if high is not None and limit.allows(high) else value
            if low is None and rng.random() < 0.5:
                value = -value
    else:
        low, high = usual
        if low > 0 and high / low > 50:
            value = math.exp(rng.uniform(math.log(low), math.log(high)))
        else:
            value = float(rng.uniform(low, high))
    if limit.whole:
        return str(int(value))
    digits = rng.choice((3, 6, 17))
    return rng.choice((f"{value:.{digits}g}", repr(value), f"{value:.{digits}e}"))


def _needed(key: Key) -> bool:
    return key.default is declare.REQUIRED or bool(key.one_of or key.unless)


def _limit(key: Key) -> Limit:
    """Return the limit of a number, or of each of some numbers."""
    schema = key.kind.schema()
    schema = schema.get("anyOf", [schema])[0]
    schema = schema.get("items", schema)
    ends = ("exclusiveMinimum", "minimum", "exclusiveMaximum", "maximum")
    return Limit(*(schema.get(end) for end in ends), whole=schema["type"] == "integer")


def _units(kind: str) -> list[list[Key]]:
    """Return the keys of each parameter of a data sheet."""
    parameters: dict[str, list[Key]] = {}
    for key in keys_of({"surveillance": Surveillance, "tracking": Tracking}[kind]):
        if key.name not in ("losses_db", "search_factor"):
            parameters.setdefault(key.one_of or key.name, []).append(key)
    return list(parameters.values())


def _ordinary(limit: Limit) -> tuple[float, float]:
    """Return an interval of ordinary sizes within a limit."""
    low = limit.at_least if limit.at_least is not None else limit.above
    high = limit.at_most if limit.at_most is not None else limit.below
    least = 1.0 if limit.whole else 0.1
    return max(least, low or 0.0), min(10.0, math.inf if high is None else high)


class RandomScenario:
    """Makes one scenario.

    Attributes:
        rng: The random numbers.
        wild: Probability that a number is anywhere in its limit.
        optional: Probability of a key that may be left out.
    """

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.wild = rng.choice((0.0, 0.0, 0.03, 0.15))
        self.sections = SECTIONS
        # most scenarios are small, because reading takes time in proportion to their length
        self.optional = rng.choice((0.1, 0.1, 0.4))
        levels = rng.choice((1, 1, 1, 2, 3))
        self.levels = rng.sample(["low", "medium", "high", "a-b_c", "L1"], levels)
        self.several = rng.random() < 0.3
        self.path = rng.random() < 0.3
        self.geodetic = self.path and rng.random() < 0.4
        self.route_has_cov = self.path and rng.random() < 0.6
        self.files: dict[str, bytes] = {}

    def make(self) -> Pairs:
        """Return the scenario as pairs of key and value."""
        given = {"radars": self.radars()} if self.several else {"radar": self.radar()}
        skip = {"radar", "radars"}
        return self.fill("", skip, name=f"s{self.rng.randrange(1000)}", **given)

    def fill(self, section: str, skip: set[str], **given: Any) -> Pairs:
        """Return the keys of a section."""
        pairs: Pairs = []
        for key in self.sections[section]:
            if key.name in given:
                pairs.append((key.name, given[key.name]))
            elif key.name not in skip and (_needed(key) or self.rng.random() < self.optional):
                pairs.append((key.name, self.value(section, key)))
        if self.rng.random() < 0.3:
            self.rng.shuffle(pairs)
        return pairs

    def value(self, section: str, key: Key) -> Any:
        """Return the value of a key."""
        rule = self.rules.get(f"{section}.{key.name}")
        if rule:
            return rule(self)
        schema = key.kind.schema()
        if schema.get("type") == "boolean":
            return self.rng.choice(("true", "false"))
        if "enum" in schema:
            return str(self.rng.choice(schema["enum"]))
        if "anyOf" in schema and self.rng.random() < 0.1:
            return ".inf"
        if schema.get("type") == "object":
            raise KeyError(f"{section}.{key.name} is a section and needs a rule in the grammar")
        several = [self.number(key) for _ in range(schema.get("minItems", 1))]
        return several if "minItems" in schema else several[0]

    def number(self, key: Key) -> str:
        """Return a number of a key."""
        wild = self.wild if key.name != "runs" else 0.0
        return number(self.rng, _limit(key), USUAL.get(key.name), wild)

    def radar(self, section: str = "radar", **given: Any) -> Pairs:
        """Return a radar: at a place, with a constant or a data sheet."""
        geodetic = self.geodetic and self.rng.random() < 0.7
        skip = {"constant", *RADARS, "position_m" if geodetic else "position_geodetic"}
        pairs = self.fill(section, {*skip, "uncertainty", "eclipsing"}, **given)
        self.attenuation = float(dict(pairs).get("attenuation_db_per_km", 0))
        kind = self.rng.choice(["constant", "constant", *RADARS])
        if kind == "constant":
            key = next(key for key in self.sections[section] if key.name == kind)
            self.sheet: list[Key] = []
            return [*pairs, (kind, self.number(key))]
        chosen = [self.rng.choice(units) for units in _units(kind)]
        sheet: Pairs = [(key.name, self.number(key)) for key in chosen]
        self.sheet = [key for key in chosen if key.name != "coherent_pulses"]
        if self.rng.random() < 0.3:
            losses = self.rng.sample(["beam_shape", "line", "x1"], self.rng.randint(1, 3))
            sheet.append(("losses_db", [(name, self.small()) for name in losses]))
        if kind == "surveillance":  # has the energy of all pulses
            pairs = [(name, value) for name, value in pairs if name != "detector"]
        if kind == "surveillance" and self.rng.random() < 0.5:
            sheet.append(("search_factor", self.rng.choice(list(SEARCH_FACTORS))))
        if any(key.name == "pulse_width_us" for key in self.sheet):
            pairs.append(("eclipsing", self.rng.choice(("true", "false"))))
        return [*pairs, (kind, sheet)]

    def detector(self) -> Any:
        """Return the name of a detector, or a mapping."""
        name = self.rng.choice(list(DETECTORS))
        if name == "north" or self.rng.random() < 0.6:
            return name
        cells = str(self.rng.randint(12, 40))
        cfar = [("type", "cell_averaging"), ("cells", cells)]
        binary = [("m", "2"), ("n", str(self.rng.randint(2, 5)))]
        pairs: Pairs = [("model", name), ("pulses", str(self.rng.randint(1, 20)))]
        if self.rng.random() < 0.5:
            pairs.append(("cfar", cfar))
        if name not in ("swerling1", "swerling3") and self.rng.random() < 0.3:
            pairs.append(("binary", binary))
        return pairs

    def with_attenuation(self, level: Pairs) -> Pairs:
        """Return a level, perhaps with the uncertainty of an attenuation, perhaps too large."""
        if self.rng.random() > (0.5 if self.attenuation else 0.005):
            return level
        std = self.attenuation * self.rng.uniform(0, 1.02)
        return [*level, ("attenuation_db_per_km", repr(std))]

    def radars(self) -> list[Pairs]:
        """Return several radars."""
        radars = []
        for i in range(self.rng.choice((1, 2, 2, 3))):
            radar = self.radar("radars[]", name=f"r{i}")
            radars.append([*radar, ("uncertainty", self.levels_of())])
        return radars

    def levels_of(self) -> Pairs:
        """Return the levels of the radar made last."""
        return [(level, self.with_attenuation(self.level())) for level in self.levels]

    def level(self) -> Pairs:
        """Return the uncertainty of a radar."""
        section = "uncertainty.radar.NAME"
        if self.rng.random() < 0.1:
            return [("covariance", self.matrix(4))]
        pairs: Pairs = [("position_m", self.std("position_m"))]
        if self.sheet and self.rng.random() < 0.7:
            chosen = self.rng.sample(self.sheet, self.rng.randint(1, len(self.sheet)))
            return [*pairs, ("constant", [(key.name, self.small()) for key in chosen])]
        constant = next(key for key in self.sections[section] if key.name == "constant")
        usual = (0.01, 10.0)
        return [*pairs, ("constant", number(self.rng, _limit(constant), usual, self.wild))]

    def small(self) -> str:
        return number(self.rng, NOT_NEGATIVE, (1e-4, 0.01), self.wild)

    def std(self, name: str) -> Any:
        """Return a standard deviation, one for each component, or a matrix."""
        usual = (0.1, 1000.0) if name == "position_m" else (0.01, 5.0)
        kind = self.rng.random()
        if kind < 0.2:
            return self.matrix(3)
        std = [number(self.rng, NOT_NEGATIVE, usual, self.wild) for _ in range(3)]
        return std[0] if kind < 0.7 else std

    def matrix(self, size: int) -> list[list[str]]:
        """Return a covariance."""
        count = self.rng.randint(1, size)
        scale = [10 ** self.rng.uniform(-2, 3) for _ in range(size)]
        factor = [[s * self.rng.gauss(0, 1) for _ in range(count)] for s in scale]
        some = range(size)
        return [
            [repr(sum(a * b for a, b in zip(factor[i], factor[j], strict=True))) for j in some]
            for i in some
        ]

    def cov_aircraft(self) -> Pairs:
        rcs: Pairs = []
        if self.rng.random() < 0.2:
            rcs.append(("rcs_db", repr(self.rng.uniform(0.1, 3))))
        if self.rng.random() < 0.15:
            return [("covariance", self.matrix(6)), *rcs]
        return [*((name, self.std(name)) for name in ("position_m", "attitude_deg")), *rcs]

    def uncertainty(self) -> Pairs:
        given = {} if self.route_has_cov else {"aircraft": self.cov_aircraft()}
        skip = {"aircraft"} if self.route_has_cov else set()
        if self.several:
            return self.fill("uncertainty", {*skip, "radar"}, **given)
        return self.fill("uncertainty", skip, **given, radar=self.levels_of())

    def rcs(self) -> Pairs:
        """Return an RCS model, with a file if it is a table."""
        model = self.rng.choice([*RCS_MODELS])
        section = f"aircraft.rcs (model: {model})"
        if model != "table":
            return [("model", model), *self.fill(section, set())]
        mirror = self.rng.random() < 0.5
        self.files["rcs.csv"] = rcs_table(self.rng, mirror=mirror)
        # an envelope takes half a second to make
        skip = {"sha256"} if self.rng.random() < 0.05 else {"sha256", "envelope_deg"}
        halved = "true" if mirror else "false"
        return [("model", model), *self.fill(section, skip, file="rcs.csv", mirror=halved)]

    def aircraft(self) -> Pairs:
        if self.path:
            return self.fill("aircraft", {"attitude_deg"})
        attitude = next(key for key in self.sections["aircraft"] if key.name == "attitude_deg")
        return self.fill("aircraft", set(), attitude_deg=self.value("aircraft", attitude))

    def geometry(self) -> Pairs:
        if not self.path:
            return [("type", "orbit"), *self.fill("geometry (type: orbit)", set())]
        section = "geometry (type: path)"
        skip = {"sha256", "origin", *CONVENTIONS}
        given: dict[str, Any] = {"origin": self.place("geometry.origin")} if self.geodetic else {}
        if self.geodetic and self.rng.random() < 0.4:
            given["altitude_above"] = "sea"
            given["geoid_height_m"] = repr(self.rng.uniform(-100, 80))
        self.files["route.csv"] = route(self.rng, geodetic=self.geodetic, cov=self.route_has_cov)
        return [("type", "path"), *self.fill(section, skip, file="route.csv", **given)]

    def place(self, section: str) -> Pairs:
        return self.fill(section, set())

    def sweep(self) -> Pairs:
        start, stop, _ = self.sections["geometry.azimuth_deg"]
        first, last = self.rng.uniform(-360, 720), self.rng.uniform(-360, 720)
        if self.rng.random() < self.wild:
            return [(key.name, self.number(key)) for key in self.sections["geometry.azimuth_deg"]]
        step = (last - first) / self.rng.choice((1, 2, 3, 5.5, 12))
        return [(start.name, repr(first)), (stop.name, repr(last)), ("step", repr(step))]

    def analysis(self) -> Pairs:
        return self.fill("analysis", set(), level=self.rng.choice(self.levels))

    #: How a value is made that is no number and no word.
    rules: Mapping[str, Any] = {
        ".aircraft": aircraft,
        ".geometry": geometry,
        ".uncertainty": uncertainty,
        ".analysis": analysis,
        "aircraft.rcs": rcs,
        "radar.detector": detector,
        "radars[].detector": detector,
        "geometry (type: orbit).azimuth_deg": sweep,
        "geometry (type: path).interpolate": lambda self: self.place("geometry.interpolate"),
        "geometry (type: path).origin": lambda self: self.place("geometry.origin"),
        "radar.position_geodetic": lambda self: self.place("radar.position_geodetic"),
        "radars[].position_geodetic": lambda self: self.place("radar.position_geodetic"),
    }


def _numbers(rng: random.Random, low: float, high: float) -> str:
    return repr(rng.uniform(low, high)) if rng.random() < 0.9 else str(rng.randint(-3, 3))


def route(rng: random.Random, *, geodetic: bool, cov: bool) -> bytes:
    """Return a route file with some of the columns that the reader declares."""
    columns = [rng.choice(("time_s", "time_s", "time_s", "speed_m_s"))]
    columns += route_file.GEODETIC if geodetic else [f"{a}_m" for a in ("north", "east", "down")]
    if not geodetic and rng.random() < 0.2:
        columns[1:4] = [name.replace("_m", rng.choice(("_m", "_km"))) for name in columns[1:4]]
    if rng.random() < 0.6:
        columns += ["roll_deg", "pitch_deg", "yaw_deg"]
    if cov:
        columns += rng.choice((route_file.STD, route_file.COV))
    if rng.random() < 0.3:
        rng.shuffle(columns)
    wild = rng.choice((0.0, 0.0, 0.0, 0.0, 0.05))
    rows, time = [], rng.choice((0.0, -50.0, 1e9))
    for _ in range(rng.randint(1, 7)):
        time += rng.choice((1, 10, 0.5, 1e-3, 100)) * (rng.random() + 1e-9)
        row = [repr(time) if name == "time_s" else _route_cell(rng, name, wild) for name in columns]
        rows.append(",".join(row))
    return ("\n".join([",".join(columns), *rows]) + "\n").encode()


def _route_cell(rng: random.Random, name: str, wild: float) -> str:
    if rng.random() < wild:
        return number(rng, route_file.COLUMNS[name].limit, None, 1.0)
    if name.startswith("cov_"):
        first, second = name.split("_")[1:3]
        return repr(rng.uniform(0.01, 3)) if first == second else repr(rng.uniform(-1, 1) * 1e-3)
    usual = {"north_m": 3e5, "east_m": 3e5, "down_m": -9e3, "altitude_m": 9e3}
    if name in usual:
        return repr(usual[name] * rng.uniform(0.9, 1.1))
    if name.endswith("_km"):
        return repr(rng.uniform(100, 300))
    if name in USUAL:
        return repr(rng.uniform(*USUAL[name]))
    if name == "speed_m_s":  # a slow aircraft has many poses
        return repr(rng.uniform(50, 500))
    return _numbers(rng, 0, 5)


def rcs_table(rng: random.Random, *, mirror: bool) -> bytes:
    """Return an RCS table on a complete grid."""
    low, high = rng.choice(((0, 180), (-180, 0)) if mirror else ((0, 360), (-180, 180)))
    # a table of the whole circle may leave out the other end
    steps = rng.choice((6, 12))
    azimuth = [
        low + (high - low) * i / steps for i in range(steps + (mirror or rng.random() < 0.5))
    ]
    elevations = ([None], [-90, -45, 0, 45, 90], [-60, -20, 20, 60])
    elevation: list[Any] = list(rng.choice(elevations))
    unit = rng.choice(("rcs_m2", "rcs_dbsm"))
    wild = rng.random() < 0.1
    limit = rcs_file.COLUMNS[unit].limit
    end = {(a, e): repr(rng.uniform(0.01, 3)) for a in azimuth[:1] for e in elevation}
    pole = repr(rng.uniform(0.01, 3))
    lines = [",".join(["azimuth_deg", *(["elevation_deg"] if elevation != [None] else []), unit])]
    for a in azimuth:
        for e in elevation:
            value = repr(rng.uniform(0.01, 3)) if not wild else number(rng, limit, None, 1.0)
            if a in (azimuth[0], azimuth[0] + 360):
                value = end[azimuth[0], e]
            if e in (-90, 90):
                value = pole
            lines.append(",".join([repr(a), *([] if e is None else [repr(e)]), value]))
    return ("\n".join(lines) + "\n").encode()


# --- text of a scenario --------------------------------------------------------------------------


def render(value: Any, rng: random.Random, indent: int = 0) -> str:
    """Return YAML: mappings as pairs, lists and scalars; in flow or block style."""
    if isinstance(value, str):
        return value
    mapping = _is_mapping(value)
    if indent and (not value or rng.random() < 0.4 or not mapping):
        if not mapping:
            return "[" + ", ".join(render(item, rng, 99) for item in value) + "]"
        return "{" + ", ".join(f"{k}: {render(v, rng, 99)}" for k, v in value) + "}"
    if indent == 99:
        return "{" + ", ".join(f"{k}: {render(v, rng, 99)}" for k, v in value) + "}"
    lines = []
    for key, item in value:
        text = render(item, rng, indent + 2)
        block = _is_mapping(item) and not text.startswith("{")
        lines.append(" " * indent + f"{key}:" + ("\n" if block else " ") + text)
    return "\n".join(lines)


def _is_mapping(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, tuple) for item in value)


def _places(value: Any) -> list[tuple[list[Any], int]]:
    """Return every place (list, index) of a tree."""
    places = []
    if isinstance(value, list):
        for i, item in enumerate(value):
            places.append((value, i))
            places += _places(item[1] if isinstance(item, tuple) else item)
    return places


def mutate_tree(tree: Pairs, rng: random.Random) -> str:
    """Break a place of a scenario, and return the change in words."""
    container, i = rng.choice(_places(tree))
    item = container[i]
    key, value = item if isinstance(item, tuple) else ("", item)

    def put(new: Any, name: str = key) -> None:
        container[i] = (name, new) if isinstance(item, tuple) else new

    kind = rng.random()
    if kind < 0.55:
        put(new := rng.choice(NASTY))
        return f"{key} := {new[:60]!r}"
    if kind < 0.65:
        del container[i]
        return f"without {key}"
    if kind < 0.72:
        container.insert(rng.randrange(len(container) + 1), item)
        return f"{key} twice"
    if kind < 0.79 and key:
        name = rng.choice([key[:-1], key + "s", key.upper(), key[::-1], rng.choice(NASTY), "<<"])
        put(value, name)
        return f"{key} named {name[:60]!r}"
    if kind < 0.86:
        # a key of another section
        section = rng.choice([section for section in SECTIONS.values() if section])
        other = rng.choice(section).name
        container.append((other, rng.choice(NASTY)) if isinstance(item, tuple) else other)
        return f"{other} beside {key}"
    if kind < 0.93:
        other_container, j = rng.choice(_places(tree))
        other = copy.deepcopy(other_container[j])  # without a copy a value could hold itself
        put(other[1] if isinstance(other, tuple) else other)
        return f"{key} := a copy of another value"
    put(value[: rng.randrange(len(value) + 1)] if value else [])
    return f"{key} cut"


def mutate_bytes(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    """Break the text of a file."""
    at = rng.randrange(len(content) + 1)
    kind = rng.choice(
        ("cut", "lost", "character", "bytes", "twice", "bom", "crlf", "cr", "mixed", "swap", "cell")
    )
    lines = content.split(b"\n")
    if kind == "cut":
        return content[:at], f"cut at byte {at}"
    if kind == "lost":
        end = at + rng.randint(1, 30)
        return content[:at] + content[end:], f"bytes {at} to {end} lost"
    if kind == "character":
        c = rng.choice(CHARACTERS)
        return content[:at] + c.encode() + content[at:], f"{c!r} at byte {at}"
    if kind == "bytes":
        b = rng.choice(BAD_BYTES)
        return content[:at] + b + content[at:], f"{b!r} at byte {at}"
    if kind == "twice":
        i = rng.randrange(len(lines))
        return b"\n".join([*lines[: i + 1], *lines[i:]]), f"line {i + 1} twice"
    if kind == "bom":
        return b"\xef\xbb\xbf" + content, "byte order mark"
    if kind == "crlf":
        return content.replace(b"\n", b"\r\n"), "CRLF"
    if kind == "cr":
        return content.replace(b"\n", b"\r"), "CR"
    if kind == "mixed":
        return b"".join(line + rng.choice((b"\n", b"\r\n", b"\r")) for line in lines), "mixed ends"
    if kind == "swap":
        i = rng.randrange(len(lines))
        j = rng.randrange(len(lines))
        lines[i], lines[j] = lines[j], lines[i]
        return b"\n".join(lines), f"lines {i + 1} and {j + 1} swapped"
    i = rng.randrange(len(lines))
    cells = lines[i].split(b",")
    new = rng.choice(NASTY)
    cells[rng.randrange(len(cells))] = new.encode("utf-8", "surrogatepass")
    lines[i] = b",".join(cells)
    return b"\n".join(lines), f"a cell of line {i + 1} := {new[:60]!r}"


# --- the command line ----------------------------------------------------------------------------

#: Numbers for options, some allowed and some not.
_OPTION_NUMBERS = (
    *("nan", "inf", "-inf", "0", "-0.0", "-1", "1", "2", "3", "1e-300", "5e-324", "1e300", "1e400"),
    *(
        "0.5",
        "0.1",
        "0.999999",
        "1e-20",
        "1e20",
        "9" * 400,
        "१२",
        "1_0",
        "",
        "x",
        "1e-9",
        "12",
        "13",
    ),
)
_WORDS = (
    "",
    "x",
    "low",
    "medium",
    "high",
    "r0",
    "r1",
    "Linear",
    "\x1b[31m",
    "é",
    "../x",
    "a" * 300,
)
#: Numbers that keep a run cheap, for options where allowed numbers can take hours.
#: The first two are allowed.
_CHEAP: Mapping[str, tuple[str, ...]] = {
    "runs": ("2", "3", "64", "1e2", "1", "0", "-5", "2.5", "nan", "1e10", "x"),
    "workers": ("1", "2", "0", "257", "1.5", "x"),
    "digits": ("1", "1e0", "0", "5", "1.5", "x"),
    "north_km": ("-100", "100", "1e5", "nan", "x"),
    "east_km": ("-50", "150", "1e5", "nan", "x"),
    "step_km": ("20", "100", "1e5", "0", "-1", "nan", "1e-7"),
    "step_deg": ("30", "90", "0", "-1", "nan"),
}


#: Options that are not allowed without another.
_NEEDS = {"k": "threshold", "at": "threshold", "m": "n", "n": "m"}


def options(command: Command, scenario: RandomScenario) -> list[str]:
    """Return options of a command, with values that are allowed or are not."""
    rng, args = scenario.rng, []
    wrong = rng.choice((0.0, 0.0, 0.3))
    names = [option.name for option in command.options]
    chosen = {name for name in names if name in _CHEAP or rng.random() < 0.25}
    if rng.random() >= wrong:
        chosen |= {_NEEDS[name] for name in chosen & _NEEDS.keys()}
        chosen -= {"target"} if "threshold" in chosen else set()
        chosen -= set() if scenario.several else {"radar"}
        chosen |= {"upper"} if command.name == "map" and "method" in chosen else set()
    for option in command.options:
        if option.name not in chosen or option.name in ("dask", "workers"):
            continue
        args.append(f"--{option.name.replace('_', '-')}")
        if not option.flag:
            if option.name in _CHEAP and option.count == 2 and rng.random() >= wrong:
                args += _CHEAP[option.name][:2]
            else:
                args += [_option_value(option, scenario, wrong) for _ in range(option.count)]
    if rng.random() < 0.1 * wrong:
        args.append(rng.choice(("--nonsense", "-z", "--runs", "--help", "--", "extra", "-q")))
    return args


def _option_value(option: Option, scenario: RandomScenario, wrong: float) -> str:
    rng = scenario.rng
    if option.limit is None:
        words = option.words or (scenario.levels if option.name == "level" else ("r0", "r1"))
        return rng.choice(_WORDS if rng.random() < wrong else tuple(words))
    if option.name in _CHEAP:
        return rng.choice(_CHEAP[option.name][: None if rng.random() < wrong else 2])
    if rng.random() < wrong:
        return rng.choice(_OPTION_NUMBERS)
    return number(rng, option.limit, USUAL.get(option.name), rng.choice((0.0, 0.0, 0.0, 1.0)))


# --- cases ---------------------------------------------------------------------------------------

#: Commands of which a case takes some 10 ms, and commands that take longer.
SLOW = ("convergence", "detectors", "validate", "report")
ANALYSES = tuple(sorted({*cli.commands()} - {*SLOW, "check"}))

#: Addresses at which no scheduler is.
_ADDRESSES = (
    *("", "x", "tcp://", "tcp://127.0.0.1:1", "tcp://[::1", "tcp://127.0.0.1:99999", "tls://x:1"),
    *("http://127.0.0.1:1", "tcp://127.0.0.1:x", "tcp://\x1b[31m:1", "tcp://" + "a" * 300),
)


def case(rng: random.Random, *, analyses: float, slow: float = 0.0) -> Case:
    """Return a case.

    Args:
        rng: The random numbers.
        analyses: Probability that a command other than `check` runs.
        slow: Probability that the command takes long, draws a figure, or connects to a cluster.
    """
    scenario = RandomScenario(rng)
    tree = scenario.make()
    files = dict(scenario.files)
    mutations: list[str] = []
    analysed = rng.random() < analyses
    # a broken scenario shows the same under every command
    broken = rng.choice((0, 0, 0, 0, 0, 0, 0, 1) if analysed else (0, 0, 0, 1, 1, 2, 4))
    of_text = 0
    for _ in range(broken):
        if tree and rng.random() < 0.55:
            mutations.append(mutate_tree(tree, rng))
        else:
            of_text += 1
    files[CONFIG] = render(tree, rng).encode("utf-8", "surrogatepass")
    for _ in range(of_text):
        name = rng.choice(list(files))
        files[name], what = mutate_bytes(files[name], rng)
        mutations.append(f"{name}: {what}")
    # to write and to read back takes twice as long as to read
    args = ["check", CONFIG, *rng.choice(((), ("-q",), ("-q",)))]
    if analysed:
        args = [*command(scenario, slow=rng.random() < slow), CONFIG]
    return Case(files, tuple(args), tuple(mutations))


def command(scenario: RandomScenario, *, slow: bool) -> list[str]:
    """Return a command other than `check`, with its options."""
    rng, commands = scenario.rng, ANALYSES + SLOW if slow else ANALYSES
    if not scenario.path and rng.random() < 0.9:
        commands = tuple(name for name in commands if name != "mission")
    chosen = cli.load(rng.choice(commands))
    names = {option.name for option in chosen.options}
    args = [chosen.name, "--out", "out", *options(chosen, scenario)]
    if "workers" in names:
        args += ["--workers", _option_value(WORKER_THREADS, scenario, 0.1)]
    if slow and "dask" in names and rng.random() < 0.2:
        args += ["--dask", rng.choice(_ADDRESSES)]
    if chosen.has_figures and not (slow and rng.random() < 0.8):
        args.append("--no-plot")
    elif chosen.has_figures:
        args += ["--format", rng.choice(chosen.formats), "--style", rng.choice(STYLES)]
    return args
