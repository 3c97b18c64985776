"""The JSON Schema of scenario files agrees with the reader."""

import collections
import contextlib
import dataclasses
import json
import re
from pathlib import Path
from typing import ClassVar

import jsonschema
import pytest
import yaml
from fuzz.drawing import CONFIG, broken, checked, each
from helpers import PAPER, SURVEILLANCE, document

from radar_sense.errors import InputError
from radar_sense.limits import POSITIVE, parameter
from radar_sense.model.detectors import DETECTORS
from radar_sense.model.rcs import RCS_MODELS
from radar_sense.scenario_file.declare import keys_of, schema, sections
from radar_sense.scenario_file.load import parse_scenario
from radar_sense.scenario_file.sections import File, schema_text

ROOT = Path(__file__).parents[2]
CONFIGS = [*sorted(ROOT.glob("configs/*.yaml")), *sorted(ROOT.glob("radar_sense/**/*.yaml"))]
SCHEMA = json.loads(schema_text())
VALIDATOR = jsonschema.Draft7Validator(SCHEMA)


class Core(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
    """YAML 1.2 with its core schema, as the language server of an editor reads it."""

    yaml_implicit_resolvers: ClassVar = {}

    def flatten_mapping(self, node):
        """YAML 1.2 has no merge keys."""

    def construct_mapping(self, node, deep=False):
        keys = [key.value if isinstance(key, yaml.ScalarNode) else "?" for key, _ in node.value]
        if len(set(keys)) < len(keys):
            raise yaml.YAMLError("duplicate key")
        values = [self.construct_object(value, deep=True) for _, value in node.value]
        return dict(zip(keys, values, strict=True))


_NUMBER = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"
for _tag, _pattern in {
    "null": r"~|null|Null|NULL|",
    "bool": r"true|True|TRUE|false|False|FALSE",
    "int": r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+",
    "float": rf"{_NUMBER}|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
}.items():
    Core.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), None)
Core.add_constructor(
    "tag:yaml.org,2002:int",
    lambda _, node: int(node.value, 0 if node.value[:2] in ("0x", "0o") else 10),
)
Core.add_constructor("tag:yaml.org,2002:bool", lambda _, node: node.value[0] in "tT")


def as_editor(text):
    """Return the value of a scenario as an editor reads it."""
    return yaml.load(text, Core)


NETWORK = as_editor((ROOT / "configs/network.yaml").read_text(encoding="utf-8"))
#: A radar with a data sheet that lacks its losses.
SHEET = {
    **{key: value for key, value in PAPER["radar"].items() if key != "constant"},
    "surveillance": {key: value for key, value in SURVEILLANCE.items() if key != "loss_db"},
}


def verdicts(text):
    """Return the error of the reader, or None, and the errors of the schema."""
    try:
        parse_scenario(text)
        reader = None
    except InputError as error:
        reader = str(error)
    try:
        value = as_editor(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        return reader, [str(error)]
    return reader, [error.message[:100] for error in VALIDATOR.iter_errors(value)]


#: Rules that a schema cannot express, with errors of the reader. The reader refuses these files,
#: and an editor does not mark them.
NOT_EXPRESSED = {
    "numbers that depend on each other": (
        r"is not symmetric|is not positive semidefinite|has a negative variance"
        r"|makes the radar constant|must be at most the attenuation|hides the target within"
        r"|1/6 of the parameter|must be a step other than 0|values, allowed are|on top of"
        r"|must not both be 0|hides the target within"
    ),
    "names that depend on each other": (
        r"analysis.level: must be one of|that no other radar has|must be a level that"
        r"|missing level|would have the column|aircraft\.rcs\.bands|must be one of types"
        r"|the levels of its radars"
    ),
    "other files, and what is in them": r"^(route|rcs)\.csv:|cannot be read|the RCS table covers"
    r"|or the column std_db",
    "tags, and numbers that are no decimals": r"tags are not supported|must be finite|'0[xo]\d+'",
    "numbers too small to compute with": r"of a size from",
    "sections that depend on each other": (
        r"must be left out|required (with|on an orbit|unless the route file)|needs a path"
        r"|is not in the data sheet|standard deviations by parameter need|must be of one pulse"
        r"|required without covariance|needs at least one of the keys|needs the length"
        r"|ordered_statistics is for|binary needs pulses|as the radar has a type"
        r"|stands at a radar of this type too"
    ),
    "names that YAML reads as numbers, booleans or nothing": (
        r"must be (a|the) name .*got ('?[-+.\dtf]|nothing)"
    ),
}


def judged(text):
    """Return whether a scenario is refused by the reader and by the schema, as both must agree."""
    reader, marks = verdicts(text)
    if reader and not marks:
        assert any(re.search(rule, reader) for rule in NOT_EXPRESSED.values()), f"{reader}\n{text}"
    if marks and not reader:
        pytest.fail(f"the reader accepts what the schema refuses: {marks}\n{text}")
    return bool(reader), bool(marks)


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_the_schema_accepts_the_files_of_the_project(config):
    value = as_editor(config.read_text(encoding="utf-8"))
    assert [error.message for error in VALIDATOR.iter_errors(value)] == []


def test_the_schema_is_valid():
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"] == "http://json-schema.org/draft-07/schema#"


@pytest.mark.parametrize(
    ("strategy", "verdict"), [(checked(), (False, False)), (broken(".yaml"), (True, True))]
)
def test_random_scenarios_are_judged_alike(tmp_path, monkeypatch, strategy, verdict):
    monkeypatch.chdir(tmp_path)
    counts = collections.Counter()

    def judge(case):
        for name, content in case.files.items():
            Path(name).write_bytes(content)
        with contextlib.suppress(UnicodeDecodeError):
            counts[judged(case.files[CONFIG].decode())] += 1

    for seed in range(3):
        each(strategy, seed, judge)
    assert counts[verdict] > 10


#: One mistake of each kind that an editor marks; the keys are paths into the paper's scenario.
MISTAKES = [
    {"name": "a b"},
    {"nme": 1},
    {"radar__constant": 0},
    {"radar__constant": "167"},
    {"radar__constant": 1e21},
    {"radar__tracking": {}},
    {"radar__detector": "mracum"},
    {"radar__position_m": [0, 0]},
    {"radar__position_geodetic": {"latitude_deg": 1, "longitude_deg": 1, "altitude_m": 0}},
    {"radar__horizon": 1},
    {"radar": None},
    {"radars": []},
    {"radars": NETWORK["radars"]},
    {"aircraft__rcs": {"a_m": 1}},
    {"aircraft__rcs": {"model": "cube"}},
    {"aircraft__rcs": {"model": "constant", "rcs_m2": 1, "a_m": 1}},
    {"aircraft__rcs": {"model": "spikeball", "lobes": 1.5, "amplitude_m2": 1, "floor_m2": 1}},
    {"aircraft__rcs": {"model": "table", "file": "a.csv", "sha256": "12"}},
    {"geometry__type": "circle"},
    {"geometry__azimuth_deg": {"start": 0, "stop": 10}},
    {"geometry": {"type": "path"}},
    {"uncertainty__aircraft": {}},
    {"uncertainty__aircraft__position_m": [[1, 0], [0, 1]]},
    {"uncertainty__aircraft__covariance": [[0] * 6] * 6},
    {"uncertainty__aircraft_correlation_s": "long"},
    {"uncertainty__radar": {}},
    {"uncertainty__radar__medium": {"position_m": 1}},
    {"uncertainty__radar__a b": {"position_m": 1, "constant": 1}},
    {"analysis__runs": 2.5},
    {"analysis__method": "fomr"},
    {"radar": SHEET},
    {"radar": {**SHEET, "surveillance": {**SURVEILLANCE, "scan_time_s": 1}}},
    {"radar": {**SHEET, "surveillance": {**SURVEILLANCE, "search_factor": 15}}},
]


@pytest.mark.parametrize("mistake", MISTAKES, ids=str)
def test_mistakes_fail_the_schema_and_are_refused(mistake):
    text = yaml.safe_dump(document(PAPER, **mistake), sort_keys=False)
    assert judged(text) == (True, True)


def test_a_newcomer_is_in_the_schema(monkeypatch):
    @dataclasses.dataclass(frozen=True)
    class Cube:
        """A cube."""

        edge: float = parameter("edge_m", "Edge of the cube.", POSITIVE)

    monkeypatch.setitem(RCS_MODELS, "cube", Cube)
    monkeypatch.setitem(DETECTORS, "ear", DETECTORS["north"])
    validator = jsonschema.Draft7Validator(schema(File))
    cube = document(aircraft__rcs={"model": "cube", "edge_m": 1}, radar__detector="ear")
    assert validator.is_valid(cube)
    assert not VALIDATOR.is_valid(cube)
    assert not validator.is_valid(document(cube, aircraft__rcs__edge_m=0))
    one, by_band = schema(File)["properties"]["aircraft"]["properties"]["rcs"]["anyOf"]
    edge, of_band = (
        of_model["then"]["properties"]["edge_m"]
        for place in (one, by_band["properties"]["bands"]["additionalProperties"])
        for of_model in place["allOf"]
        if "edge_m" in of_model["then"]["properties"]
    )
    assert of_band == edge
    description = "Edge of the cube. Unit: m. A number greater than 0."
    assert edge == {
        "description": description,
        "type": "number",
        "exclusiveMinimum": 0,
        "maximum": 1e20,
    }


def test_every_key_has_a_description_and_a_shape():
    """A key without a shape would let an editor accept everything."""
    waiting, names = [SCHEMA], set()
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict):
            if "additionalProperties" in node and "properties" in node:
                for name, value in node["properties"].items():
                    names.add(name)
                    assert value["description"], name
                    assert len(value.keys() - {"default"}) > 1, name
            waiting += node.values()
        elif isinstance(node, list):
            waiting += node
    declared = {key.name for _, section in sections(File) for key in keys_of(section)}
    assert names == declared | {"model", "type"}


def test_the_command_prints_the_schema(tool):
    assert tool("schema") == (0, schema_text(), "")
