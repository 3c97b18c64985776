"""The JSON Schema of scenario files agrees with the reader."""

import dataclasses

import jsonschema
import pytest
import yaml
from editor import SCHEMA, VALIDATOR, as_editor, judged
from helpers import CONFIGS, PAPER, ROOT, SURVEILLANCE, document

from radar_sense.limits import POSITIVE, parameter
from radar_sense.model.detectors import DETECTORS
from radar_sense.model.rcs import RCS_MODELS
from radar_sense.scenario_file.declare import keys_of, schema, sections
from radar_sense.scenario_file.sections import File, schema_text

SCENARIOS = [*sorted(CONFIGS.glob("*.yaml")), *sorted(ROOT.glob("radar_sense/**/*.yaml"))]

NETWORK = as_editor((CONFIGS / "network.yaml").read_text(encoding="utf-8"))
#: A radar with a data sheet that lacks its losses.
SHEET = {
    **{key: value for key, value in PAPER["radar"].items() if key != "constant"},
    "surveillance": {key: value for key, value in SURVEILLANCE.items() if key != "loss_db"},
}


@pytest.mark.parametrize("config", SCENARIOS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_the_schema_accepts_the_files_of_the_project(config):
    value = as_editor(config.read_text(encoding="utf-8"))
    assert [error.message for error in VALIDATOR.iter_errors(value)] == []


def test_the_schema_is_valid():
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"] == "http://json-schema.org/draft-07/schema#"


#: One mistake of each kind that an editor marks; the keys are paths into the paper's scenario.
MISTAKES = [
    {"nme": 1},
    {"radar__constant": "167"},
    {"radar__constant": 1e21},
    {"radar__tracking": {}},
    {"radar__detector": "mracum"},
    {"radar__horizon": 1},
    {"radars": NETWORK["radars"], "radar": PAPER["radar"]},
    {"aircraft__rcs": {"model": "constant", "rcs_m2": 1, "a_m": 1}},
    {"aircraft__rcs": {"model": "table", "file": "a.csv", "sha256": "12"}},
    {"geometry__type": "circle"},
    {"geometry__azimuth_deg": {"start": 0, "stop": 10}},
    {"geometry": {"type": "path"}},
    {"uncertainty__aircraft": {}},
    {"uncertainty__aircraft__position_m": [[1, 0], [0, 1]]},
    {"uncertainty__aircraft__covariance": [[0] * 6] * 6},
    {"uncertainty__aircraft_correlation_s": "long"},
    {"uncertainty__radar": {}},
    {"uncertainty__radar__a b": {"position_m": 1, "constant": 1}},
    {"analysis__runs": 2.5},
    {"radar": SHEET},
    {"radar": {**SHEET, "surveillance": {**SURVEILLANCE, "scan_time_s": 1}}},
    {"radar": {**SHEET, "surveillance": {**SURVEILLANCE, "search_factor": 15}}},
]


@pytest.mark.parametrize("mistake", MISTAKES, ids=str)
def test_mistakes_fail_the_schema_and_are_refused(mistake):
    text = yaml.safe_dump(document(PAPER, **mistake), sort_keys=False)
    assert judged(text) == (True, True)


def test_a_word_in_quotes_is_the_word():
    text = yaml.safe_dump(document(PAPER, radar__horizon="true"), sort_keys=False)
    assert "'true'" in text
    assert judged(text) == (False, False)


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
    radar, *_ = schema(File)["properties"]["aircraft"]["properties"]["rcs"]["anyOf"]
    (edge,) = (
        k for of in radar["allOf"] for k in of["then"]["properties"].items() if k[0] == "edge_m"
    )
    meaning = "Edge of the cube. Unit: m. A number greater than 0."
    limits = {"type": "number", "exclusiveMinimum": 0, "maximum": 1e20}
    assert edge[1] == {"description": meaning, **limits}
    bands = {"bands": {"l": cube["aircraft"]["rcs"], "s": {"model": "cube"}}}
    (error,) = validator.iter_errors(document(cube, aircraft__rcs=bands))
    assert "edge_m" in str(error)


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
    declared = [key for _, section in sections(File) for key in keys_of(section)]
    assert names == {key.name for key in declared} | {"model", "type"}
    assert all(key.meaning.endswith(".") for key in declared)


def test_the_command_prints_the_schema(tool):
    assert tool("schema") == (0, schema_text(), "")
