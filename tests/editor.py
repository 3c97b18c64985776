"""A scenario file as an editor reads and marks it, beside the verdict of the reader."""

import json
import re
from typing import ClassVar

import jsonschema
import pytest
import yaml

from radar_sense.errors import InputError
from radar_sense.scenario_file.load import parse_scenario
from radar_sense.scenario_file.sections import schema_text

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
        r"|the levels of its radars|is the type of no radar"
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
