"""Inputs at random: scenarios from the schema, broken files, command lines and calls from Python.

The schema and click's options say what is allowed, and the example scenarios what is ordinary. A
new key and a new option are drawn without a change here.
"""

from __future__ import annotations

import functools
import inspect
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import click
import hypothesis
import numpy as np
import yaml
from helpers import yaml_text
from hypothesis import strategies as st
from hypothesis_jsonschema import from_schema

import radar_sense as rs
from radar_sense import cli as command_line
from radar_sense.limits import METHODS
from radar_sense.model.detectors import DETECTORS
from radar_sense.scenario_file import declare
from radar_sense.scenario_file.load import default_text
from radar_sense.scenario_file.sections import schema_text

#: The scenario file of a case, and the files that a scenario may name.
CONFIG, ROUTE, GPX, RCS = "my.yaml", "route.csv", "route.gpx", "rcs.csv"
SCHEMA = json.loads(schema_text())
#: Files of a radar, each with its name.
CURVES = {
    "elevation_gain": b"elevation_deg,gain_db\n-5,-3\n1,0\n20,-9.5\n",
    "mask": b"azimuth_deg,elevation_deg\n0,0.1\n120,-1\n250,2\n",
}
EXAMPLES = Path(__file__).parents[2] / "configs"
#: Where the poses come from: an orbit, or the rows of an example.
FLIGHTS = ("", "", "path_route.csv", "corridor_route.csv", GPX)
LEVELS = ("low", "high")
#: Commands of which a case takes long.
SLOW = {"compare", "convergence", "detectors", "report", "validate"}
FAST = tuple(name for name in command_line.commands() if name not in SLOW)
#: Options that are always given, because their defaults take long.
WORK = {"runs", "digits", "step_km", "step_deg", "north_km", "east_km"}
#: Options that need each other, and a number that is 0 one time in four.
TOGETHER = (*(("k", "threshold"), ("probability", "threshold")), *(("m", "n"), ("n", "m")))
ONE_OF_FOUR = st.integers(0, 3)
#: Options that reach beyond the folder and the process of the test.
BEYOND = {"dask", "workers", "help", "version"}
#: Numbers of all sizes.
POWERS = [0, *(sign * 10.0**n for n in range(-20, 21) for sign in (1, -1))]
#: Ordinary sizes that take little work.
SMALL: dict[str, tuple[float, float]] = {
    "runs": (2, 64),
    "digits": (1, 1),
    "pulses": (1, 20),
    "step_s": (10, 60),
    "step_km": (20, 100),
    "step_deg": (30, 90),
    "north_km": (-100, 100),
    "east_km": (-100, 100),
    "threshold": (0.05, 0.99),
    "probability": (1e-4, 0.4),
    "m": (1, 3),
    "n": (3, 5),
}
#: Words that are wrong nearly everywhere.
_WORDS = (
    "~ null .nan NaN inf -.inf 1e400 1e-400 5e-324 -0.0 -1 0 1 2.5 1e11 0x10 0o17 1_000 1:30 1,5 "
    "1e . + --1 .5 +.5e+1 १२ ² １２ −1 true NO 2026-01-01 '5' ' \" [] {} {a:1} [[[1]]] !!int ? | > "
    "% @ !!python/name:os.system !x &a *a << ` - --- .. / /dev/null # <a &lt; \0 \x1b[31m \u202e 😀"
)
WORDS = (
    *_WORDS.split(" "),
    *("&a [*a]", "{<<: *a}", "[1, [2], 3]", '"\\0"', '"\\ud800"', "a: b: c", "[" * 60, "9" * 5000),
    *("", "\r", "\x85", "\u2028", "\ufeff", "\t"),
)


def _numbers(value: Any, key: str = "") -> list[tuple[str, float]]:
    """Return the numbers of a document, each with its key."""
    if isinstance(value, dict):
        return [pair for name, item in value.items() for pair in _numbers(item, name)]
    if isinstance(value, list):
        return [pair for item in value for pair in _numbers(item, key)]
    return [(key, value)] if type(value) in (int, float) else []


@functools.cache
def _ordinary() -> dict[str, tuple[float, float]]:
    """Return the interval of each number by key: that of the examples, or that of `SMALL`."""
    given: dict[str, list[float]] = {}
    for path in EXAMPLES.glob("*.yaml"):
        for key, number in _numbers(yaml.safe_load(path.read_text(encoding="utf-8"))):
            given.setdefault(key, []).append(number)
    return {key: (min(numbers), max(numbers)) for key, numbers in given.items()} | SMALL


def each(strategy: st.SearchStrategy[Any], seed: int, function: Callable[[Any], object]) -> None:
    """Call a function with ten cases, the same for the same seed.

    More cases of one seed would be much like each other. A failing case is not made smaller, which
    would run many others.
    """

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=10,
        database=None,
        deadline=None,
        phases=[hypothesis.Phase.generate],
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(strategy)
    def one(case: Any) -> None:
        function(case)

    one()


# --- values that the schema accepts ---------------------------------------------------------------


@functools.cache
def _plain(schema: str) -> st.SearchStrategy[Any]:
    return from_schema(json.loads(schema))


class Values:
    """Draws values that a schema accepts.

    Objects are drawn here, key by key, and plain values with hypothesis-jsonschema, which would
    work for minutes on the alternatives of the whole schema.

    Attributes:
        draw: Draws from a strategy.
        need: Paths of keys that are always given.
        never: Paths of keys that are not.
        wild: Of 32 numbers, how many are of any size that is allowed.
    """

    def __init__(self, draw: Any, need: Any = frozenset(), never: Any = frozenset()) -> None:
        self.draw, self.need, self.never = draw, need, never
        self.wild = draw(st.sampled_from((0, 0, 0, 1, 4)))

    def of(self, schema: Any, path: str) -> Any:
        """Return a value."""
        kind, key = schema.get("type"), path.rpartition(".")[2]
        if "anyOf" in schema:
            return self.of(self._one(schema["anyOf"]), path)
        if kind == "object":
            return self._object(schema, path)
        if kind == "array":
            most = min(schema["maxItems"], schema["minItems"] + 1)
            count = self.draw(st.integers(schema["minItems"], most))
            items = [self.of(schema["items"], path) for _ in range(count)]
            return _covariance(items) if isinstance(items[0], list) else items
        if key == "level":
            return self.draw(st.sampled_from(LEVELS))
        if kind in ("number", "integer"):
            schema = self._number(schema, *_ordinary().get(key, (1, 5)))
        elif isinstance(kind, list):  # a name, which YAML may read as a number
            schema = {**schema, "type": "string"}
        plain = {k: v for k, v in schema.items() if k not in ("description", "default")}
        return self.draw(_plain(json.dumps(plain)))

    def _one(self, alternatives: list[Any]) -> Any:
        """Return an alternative, mostly the first, because a covariance has many numbers."""
        return self.draw(st.sampled_from([*alternatives[:1] * 3, *alternatives]))

    def _number(self, schema: Any, least: float, most: float) -> Any:
        """Return the schema of a number with ordinary ends, or of any size, or as it is."""
        if self.wild and self.draw(st.integers(1, 32)) <= self.wild:
            return self.draw(st.sampled_from((schema, {**schema, "enum": POWERS})))
        least = max(least, schema.get("minimum", -math.inf))
        most = min(most, schema.get("maximum", math.inf))
        if least >= most:
            return {"const": most}
        # in steps, so that no number is nearly 0
        size = math.floor(math.log10(most - least)) - 2
        step = 1 if schema["type"] == "integer" else 10.0**size
        return {**schema, "minimum": least, "maximum": most, "multipleOf": step}

    def _object(self, schema: Any, path: str) -> dict[str, Any]:
        """Return an object: what is required, one key of each group, and up to two others."""
        if schema.get("additionalProperties"):
            return {name: self.of(schema["additionalProperties"], path) for name in LEVELS}
        rules, required = schema.get("allOf", []), schema["required"]
        if rules and "if" in rules[0]:  # a word says which section the other keys are of
            (word,) = required
            kinds = {rule["if"]["properties"][word]["const"]: rule["then"] for rule in rules}
            name = self.draw(st.sampled_from([n for n in kinds if f"{path}.{n}" not in self.never]))
            keys = {key: of for key, of in kinds[name]["properties"].items() if key != word}
            return {word: name, **self._object({**kinds[name], "properties": keys}, path)}
        paths = {key: f"{path}.{key}".lstrip(".") for key in schema["properties"]}
        given = [*required, *(key for key in paths if paths[key] in self.need)]
        free = [key for key in paths if paths[key] not in self.never]
        for rule in rules:
            group = [rule["required"][0] for rule in rule.get("oneOf", rule.get("anyOf", []))]
            allowed = [key for key in group if key in free]
            free = [key for key in free if key not in group]
            if allowed and not {*group} & {*given}:
                given.append(self._one(allowed))
        given += self.draw(st.lists(st.sampled_from(free), max_size=2)) if free else []
        for rule in rules:
            if "not" in rule and {*rule["not"]["required"]} <= {*given}:
                given = [key for key in given if key != rule["not"]["required"][1]]
        return {key: self.of(schema["properties"][key], paths[key]) for key in dict.fromkeys(given)}


def _covariance(rows: list[list[float]]) -> list[list[float]]:
    """Return a positive semidefinite matrix of the size of the rows."""
    factor = np.array(rows, dtype=float)
    return (factor @ factor.T / max(1.0, np.abs(factor).max())).tolist()


# --- scenarios and their files --------------------------------------------------------------------


#: Keys of a path that fit some route files only.
_OF_FILES = ("speed_m_s", "max_gap_s", "altitude_above", "down_km", "altitude_m")


@st.composite
def scenarios(draw: Any, flights: Any = FLIGHTS) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return a scenario as a document, and the files that it names.

    What goes with what is chosen here, because a schema cannot say it.
    """
    one, flight = draw(st.booleans()), draw(st.sampled_from(flights))
    on_earth = flight in ("corridor_route.csv", GPX)
    with_errors = flight not in ("", GPX) and draw(st.booleans())
    given = {
        "radar": one,
        "radars": not one,
        "uncertainty.radar": one,
        "uncertainty.aircraft": not with_errors,
        "aircraft.attitude_deg": not flight,
        "geometry.orbit": not flight,
        "geometry.radial": not flight,
        "geometry.path": flight != "",
        "geometry.origin": on_earth,
        "geometry.geoid_height_m": flight == GPX,
        **{f"{radar}.position_m": not on_earth for radar in ("radar", "radars")},
        **{f"{radar}.position_geodetic": on_earth for radar in ("radar", "radars")},
        # these say something of the content of a file
        **dict.fromkeys(("geometry.sha256", "geometry.icao24", "aircraft.rcs.sha256"), False),
        **{f"geometry.{key}": False for key in _OF_FILES},
    }
    need = {path for path in given if given[path]}
    document = Values(draw, need, given.keys() - need).of(SCHEMA, "")
    geometry, rcs, files = document["geometry"], document["aircraft"]["rcs"], {}
    if flight:
        geometry["file"] = GPX if flight == GPX else ROUTE
        files[geometry["file"]] = draw(routes(flight, with_errors))
    else:
        sweep = geometry["azimuth_deg" if geometry["type"] == "orbit" else "range_km"]
        sweep["step"] = (sweep["stop"] - sweep["start"]) / 7 or 1
    for table in (rcs, *rcs.get("bands", {}).values()):
        if "file" in table:
            table["file"] = RCS
            files[RCS] = draw(rcs_tables(table.get("mirror", False)))
    errors = document["uncertainty"].get("aircraft")
    if errors and "covariance" not in errors:
        errors |= {"position_m": 10, "attitude_deg": 1} | errors
    kinds = {"band": sorted(rcs.get("bands", ())), "type": sorted(document.get("types", ()))}
    for i, radar in enumerate(document.get("radars", [document.get("radar")])):
        for key, names in kinds.items():
            radar.pop(key, None)
            radar |= {key: names[i % len(names)]} if names else {}
        for key in CURVES.keys() & radar.keys():
            radar[key] = f"{key}.csv"
            files[radar[key]] = CURVES[key]
        if not one:
            radar["name"] = f"{radar['name'][:30]}{i}"
        _suit(radar, document["uncertainty"]["radar"] if one else radar["uncertainty"])
    return document, files


def _suit(radar: dict[str, Any], levels: dict[str, Any]) -> None:
    """Change what a radar cannot have, and let its levels be of what it has."""
    sheet = radar.get("surveillance", radar.get("tracking", {}))
    if "pulse_width_us" not in sheet:
        radar.pop("eclipsing", None)
    for level in levels.values():
        if "elevation_gain" not in radar:
            level.pop("tilt_deg", None)
            radar.pop("tilt_deg", None)
        if "attenuation_db_per_km" in level:
            level["attenuation_db_per_km"] = radar.get("attenuation_db_per_km", 0) / 2
        if isinstance(level.get("constant"), dict):
            known = [key for key in level["constant"] if type(sheet.get(key)) in (int, float)]
            level["constant"] = {key: sheet[key] / 100 for key in known} or 0.1
        if "covariance" in level:  # no error can be shared beside it
            radar.pop("type", None)
        elif "type" in radar and not isinstance(level.get("constant"), dict):
            level["constant"] = 0  # the error of the type stands beside errors by parameter


@st.composite
def routes(draw: Any, example: str, with_errors: bool) -> bytes:
    """Return some rows of a route of the examples, as CSV or GPX."""
    path = EXAMPLES / (example if example != GPX else "corridor_route.csv")
    _, names, *rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    start = draw(st.integers(0, len(rows) - 8))
    rows = rows[start : start + draw(st.integers(2, 8))]
    if example == GPX:
        points = "\n".join(
            f'<trkpt lat="{lat}" lon="{lon}"><ele>{height}</ele><time>2026-01-01T'
            f"{int(t) // 3600:02}:{int(t) // 60 % 60:02}:{int(t) % 60:02}Z</time></trkpt>"
            for t, lat, lon, height, *_ in rows
        )
        root = 'gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"'
        return f"<{root}><trk><trkseg>\n{points}\n</trkseg></trk></gpx>\n".encode()
    attitude = draw(st.booleans())
    ways = {"roll_deg": attitude, "pitch_deg": attitude, "yaw_deg": attitude}
    kept = [ways.get(name, with_errors or not name.startswith("std_")) for name in names]
    return "".join(",".join(compress(row, kept)) + "\n" for row in (names, *rows)).encode()


@st.composite
def rcs_tables(draw: Any, mirror: bool) -> bytes:
    """Return an RCS table by azimuth, or by azimuth and elevation."""
    elevations = draw(st.sampled_from(((), (-60, -20, 20, 60))))
    values = draw(st.lists(st.floats(1e-3, 9), min_size=4, max_size=4))
    lines = [f"azimuth_deg,{'elevation_deg,' * bool(elevations)}rcs_m2"]
    for azimuth in range(0, 181 if mirror else 360, draw(st.sampled_from((30, 60, 90)))):
        cells = [f"{azimuth},{elevation}" for elevation in elevations] or [f"{azimuth}"]
        lines += [f"{cell},{value}" for cell, value in zip(cells, values, strict=False)]
    return ("\n".join(lines) + "\n").encode()


# --- cases of the command line --------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """Files by name, and a command line."""

    files: dict[str, bytes]
    args: tuple[str, ...]


@st.composite
def checked(draw: Any, flights: Any = FLIGHTS) -> Case:
    """Return a case of `check` with a scenario from the schema."""
    document, files = draw(scenarios(flights))
    flow = draw(st.sampled_from((False, None, True)))
    text = yaml_text(document, default_flow_style=flow, allow_unicode=True)
    return Case({**files, CONFIG: text.encode()}, ("check", CONFIG))


@st.composite
def broken(draw: Any, ending: str) -> Case:
    """Return a case of `check` with a file of an ending that is broken, as a rule."""
    case = draw(checked([flight for flight in FLIGHTS if ending in (".yaml", flight[-4:])]))
    name = draw(st.sampled_from([name for name in case.files if name.endswith(ending)]))
    pieces = re.split(rb"([\s:,<>={}\[\]\"]+)", case.files[name])
    for _ in range(draw(st.integers(0, 3))):  # 0: other ends of lines alone
        at = draw(st.integers(0, len(pieces) - 1))
        word = draw(st.sampled_from(WORDS)).encode("utf-8", "surrogatepass")
        other, junk = draw(st.sampled_from(pieces)), draw(st.binary(max_size=3))
        twice = pieces[at : at + draw(st.integers(1, 20))]
        changed = ([word], [other], [pieces[at], junk], [*twice, pieces[at]], [])
        pieces[at : at + 1] = draw(st.sampled_from(changed))
    ends = draw(st.sampled_from((b"\n", b"\n", b"\n", b"\r\n", b"\r")))
    content = b"".join(pieces).replace(b"\n", ends)
    content = draw(st.sampled_from((b"", b"", b"", b"\xef\xbb\xbf"))) + content
    return Case({**case.files, name: content}, case.args)


@st.composite
def commands(draw: Any, names: tuple[str, ...], figures: bool = False) -> Case:
    """Return a case of one of some commands, with options as click declares them."""
    document, files = draw(scenarios())
    values, args = Values(draw), [draw(st.sampled_from(names))]
    # one of four command lines has values that are not allowed
    wrong = st.nothing() if draw(ONE_OF_FOUR) else st.sampled_from(WORDS)
    radars = [radar["name"] for radar in document.get("radars", ())]
    words = {"level": LEVELS, "radar": radars, "method": METHODS, "changes": ["analysis.seed=3"]}
    context = click.Context(command_line.cli)
    options = command_line.cli.get_command(context, args[0]).params
    chosen = {option.name for option in options if option.name in WORK or not draw(ONE_OF_FOUR)}
    chosen |= {other for name, other in TOGETHER if name in chosen}
    chosen -= {"target"} if "threshold" in chosen else set()
    chosen -= {"probability"} if "k" in chosen else set()
    chosen -= BEYOND if radars else {*BEYOND, "radar"}
    for option in options:
        if option.name == "out":
            args += ["--out", "out"]
        elif option.name == "no_plot" and not figures:
            args.append("--no-plot")
        elif isinstance(option, click.Option) and option.name in chosen:
            args.append(option.opts[-1])
            for _ in range(0 if option.is_flag else option.nargs):
                if isinstance(option.type, command_line.Number):
                    schema = declare.number(option.type.limit).schema()
                    if option.name == "runs":  # a billion runs say what they take, and take it
                        schema |= {"maximum": 100_000}
                    value = st.just(str(values.of(schema, option.name)))
                else:
                    known = [item.value for item in option.shell_complete(context, "")]
                    value = st.sampled_from(known or words.get(option.name, WORDS))
                args.append(draw(value | wrong))
    text = yaml_text(document, allow_unicode=True)
    by_place = ["analysis.seed", "1", "2", draw(st.sampled_from(("1", "2", "0", "-1", "x")))]
    has_places = any(option.name == "values" for option in options)
    return Case({**files, CONFIG: text.encode()}, (*args, CONFIG, *by_place * has_places))


# --- calls from Python ----------------------------------------------------------------------------

#: An argument of each name that fits, from which calls begin.
FITTING = {
    "aircraft": [1e5, 2e4, -9e3, 0.0, 0.0, 1.5],
    "radar": [0.0, 0.0, 0.0, 50.0],
    "cov_aircraft": np.diag([100.0] * 3 + [1e-4] * 3),
    "cov_radar": np.diag([100.0] * 3 + [1.0]),
    "model": rs.DetectionModel(rs.ConstantRCS(0.1), 1e-6),
    "rcs": rs.ConstantRCS(0.1),
    "scenario": rs.parse_scenario(default_text().replace("step: 0.5", "step: 90")),
    "p_fa": 1e-6,
    "azimuth": np.arange(6.0),
    "radars": (rs.Radar(rs.DetectionModel(rs.ConstantRCS(0.1), 1e-6)),),
    "runs": 4,
    "method": "linear",
    **dict.fromkeys(("a", "b", "c", "x", "y", "z", "amplitude", "floor"), 0.1),
    **dict.fromkeys(("m", "n", "cells", "rank", "lobes"), 1),
}
#: What is called, by name.
CALLED = {
    # RCS itself is a protocol
    **{name: getattr(rs, name) for name in rs.__all__ if name[1:].endswith(("RCS", "Model"))},
    **{made.__name__: made for made in (*DETECTORS.values(), rs.BinaryIntegration, rs.Radar)},
    **{of.__name__: of for of in (rs.propagate, rs.monte_carlo)},
    **{name: getattr(FITTING["model"], name) for name in ("p_d", "snr", "linearize")},
    **{name: getattr(rs.analyses, name) for name in ("variance", "budget", "mission")},
}
#: What is no number or no array of numbers, or has another shape.
ODD = (
    *(None, True, "1", b"1", 1j, [], {}, math.nan, math.inf, -1, 0, 1e300, 10**400, object()),
    *(["1"] * 6, [1j] * 6, [True] * 6, [[1.0], [1.0, 2.0]], [1.0] * 5, [None] * 4, [1e200] * 6),
    *(np.zeros((0, 6)), np.zeros((2, 3, 6)), np.full((6, 6), -1.0), np.eye(4) * 1e300),
    *(np.ma.masked_array([1.0] * 6, [True] * 6), np.array(["2026-01-01"] * 6, "datetime64[D]")),
)


@st.composite
def calls(draw: Any) -> tuple[str, dict[str, Any]]:
    """Return a name of `CALLED` and its keywords, of which up to two are odd."""
    name = draw(st.sampled_from(sorted(CALLED)))
    names = list(inspect.signature(CALLED[name]).parameters)
    given = {key: FITTING[key] for key in names if key in FITTING}
    for key in draw(st.lists(st.sampled_from(names), max_size=2)) if names else ():
        given[key] = draw(st.sampled_from(ODD) | st.floats() | st.text(max_size=3))
    return name, given
