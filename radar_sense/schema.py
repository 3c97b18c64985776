"""The JSON Schema of a scenario file, for editors: generated from the declarations in `keys`.

Names, units, limits, defaults and words come from `keys`. This module has the structure of a
scenario file, and the keys that exclude or require each other. The schema is of draft-07, which
language servers support best.

A schema cannot express all checks of the reader. For example, the schema accepts a covariance that
is not positive semidefinite. `tests/test_schema.py` lists these checks.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

from radar_sense import keys
from radar_sense.keys import YES_NO, Key
from radar_sense.limits import ANY, LARGEST, MAX_RADARS, NOT_NEGATIVE, Limit
from radar_sense.model.detectors import DETECTORS
from radar_sense.model.radar_constant import TOLERANCE_DB
from radar_sense.model.radar_equation import LOSSES, RADARS
from radar_sense.model.rcs import RCS_MODELS

Schema = dict[str, Any]

#: Name of the schema that `radar-sense init` writes into the folder of a scenario.
FILE_NAME = "radar_sense.schema.json"
TITLE = "Scenario of radar-sense"
#: First line of a scenario file, which names the schema for the YAML language server.
MODELINE = f"# yaml-language-server: $schema={FILE_NAME}\n"

_INFINITY = {"type": "string", "pattern": r"^\+?\.?[iI][nN][fF]([iI][nN][iI][tT][yY])?$"}


def text() -> str:
    """Return the schema as JSON."""
    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


def schema() -> Schema:
    """Return the JSON Schema of a scenario file."""
    several = _with("radars")
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": TITLE,
        "$comment": "Made by `radar-sense schema`.",
        **_mapping(
            keys.SCENARIO,
            {
                "radar": _radar(keys.RADAR),
                "radars": {
                    "type": "array",
                    "minItems": 1,
                    "maxItems": MAX_RADARS,
                    "items": _one_of_several(),
                },
                "aircraft": _mapping(keys.AIRCRAFT, {"rcs": _rcs()}, required=["rcs"]),
                "geometry": _geometry(),
                "uncertainty": _mapping(
                    keys.UNCERTAINTY,
                    {
                        "aircraft": _covariance(keys.COV_AIRCRAFT, besides=_OF_RCS, alone=True),
                        "radar": {"type": "object"},
                    },
                    required=[],
                ),
                "analysis": _mapping(keys.ANALYSIS),
            },
        ),
        **_one_of(["radar", "radars"]),
        "allOf": [
            _if(
                several,
                _at("uncertainty", _without("radar")),
                else_=_at("uncertainty", _with("radar")),
            ),
            *(
                _if(_at("radar", _with(kind)), _at("uncertainty", _at("radar", _levels_of(kind))))
                for kind in CONSTANTS
            ),
            _if(
                _at("geometry", _at("type", {"const": "path"})),
                _at("aircraft", _without("attitude_deg")),
                else_={
                    "allOf": [
                        _at("aircraft", _with("attitude_deg")),
                        _at("uncertainty", _at("aircraft", {"not": _only(_OF_RCS)})),
                    ]
                },
            ),
            *(
                _if(_at(name, place), _at("geometry", _with("origin")))
                for name, place in (("radar", _GEODETIC), ("radars", {"contains": _GEODETIC}))
            ),
        ],
        "definitions": {f"levels_{kind}": _levels(kind) for kind in CONSTANTS},
    }


# A value of a key.


def describe(key: Key) -> str:
    """Return the description of a key: meaning, unit, limits, default."""
    words = [key.meaning, f"Unit: {key.unit_name}." if key.unit_name else "", allowed(key)]
    words.append(f"Default: {default(key)}." if default(key) else "")
    return " ".join(filter(None, words))


def allowed(key: Key) -> str:
    """Return the allowed values of a key in a sentence."""
    if key.choices:
        return f"One of: {', '.join(key.choices)}."
    if key.allowed:
        return _sentence(key.allowed)
    if key.limit is None:
        return ""
    several = f"{key.size} numbers: each " if key.size > 1 else ""
    return _sentence(f"{several}{key.limit}{', or .inf' if key.infinite else ''}")


def default(key: Key) -> str:
    """Return the default of a key as in a scenario file; "" without a default."""
    if key.required or key.default is None:
        return ""
    value = json.dumps(key.default) if isinstance(key.default, bool) else f"{key.default}"
    return ".inf" if value == "inf" else value.removesuffix(".0")


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def _value(key: Key) -> Schema:
    """Return the schema of a number, numbers, a word or text; {} for a section."""
    if key.choices == YES_NO:
        return {"type": "boolean"}
    if key.choices:
        # YAML reads a word of digits as a number.
        return {"enum": [*key.choices, *(int(word) for word in key.choices if word.isdigit())]}
    if key.pattern:
        return _text(key)
    if key.limit is None:
        return {}
    if key.infinite:
        return {"anyOf": [_number(key.limit, largest=math.inf), _INFINITY]}
    number = _number(key.limit)
    return _list(key.size, number) if key.size > 1 else number


def _text(key: Key) -> Schema:
    # YAML reads the name 1 as a number, and the name true as a boolean.
    return {"type": ["string", "number", "boolean"], "pattern": f"^(?:{key.pattern})$"}


def _number(limit: Limit, largest: float = LARGEST) -> Schema:
    ends = {
        "exclusiveMinimum": limit.above,
        "minimum": limit.at_least,
        "exclusiveMaximum": limit.below,
        "maximum": limit.at_most,
    }
    if not limit.whole and math.isfinite(largest):
        if limit.above is None and limit.at_least is None:
            ends["minimum"] = -largest
        if limit.below is None and limit.at_most is None:
            ends["maximum"] = largest
    kind = "integer" if limit.whole else "number"
    return {"type": kind, **{name: end for name, end in ends.items() if end is not None}}


def _list(size: int, items: Schema) -> Schema:
    return {"type": "array", "items": items, "minItems": size, "maxItems": size}


# Mappings.


def _mapping(
    section: Sequence[Key],
    shapes: Mapping[str, Schema] | None = None,
    *,
    required: Sequence[str] | None = None,
) -> Schema:
    """Return the schema of a mapping with declared keys and no others.

    Args:
        section: The keys.
        shapes: Schemas of the values that are not numbers, words or text.
        required: The required keys; None for the keys declared as required.
    """
    shapes = shapes or {}
    if required is None:
        required = [key.name for key in section if key.required]
    properties = {}
    for key in section:
        properties[key.name] = {"description": describe(key)}
        properties[key.name] |= shapes.get(key.name, _value(key))
        if not key.required and key.default is not None and default(key) != ".inf":
            properties[key.name]["default"] = key.default
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _radar(section: Sequence[Key]) -> Schema:
    """Return the schema of a radar: a place, a radar constant or data sheet, and limits."""
    places = [keys.RADAR_POSITION.name, keys.RADAR_PLACE.name]
    shapes = {keys.RADAR_PLACE.name: _mapping(keys.PLACE)}
    shapes |= {kind: _data_sheet(kind) for kind in RADARS}
    shapes |= {keys.RADAR_UNCERTAINTY.name: {"type": "object"}, keys.DETECTOR.name: _detector()}
    required = [key.name for key in section if key.required and key.name not in places]
    pulse = _at("tracking", _with("pulse_width_us"))
    eclipsing = _if(_at(keys.ECLIPSING.name, {"const": True}), pulse)
    return {
        **_mapping(section, shapes, required=required),
        "allOf": [_one_of(places), _one_of(CONSTANTS), eclipsing],
    }


def _one_of_several() -> Schema:
    radar = _radar(keys.RADARS_ENTRY)
    name = keys.RADAR_UNCERTAINTY.name
    levels = [_if(_with(kind), _at(name, _levels_of(kind))) for kind in CONSTANTS]
    return {**radar, "allOf": [*radar["allOf"], *levels]}


def _detector() -> Schema:
    """Return the schema of a detector: a name, or a mapping with the keys of the model."""
    models = {name: _instance(cls, keys.DETECTOR_MODEL) for name, cls in DETECTORS.items()}
    return {"anyOf": [_value(keys.DETECTOR), _by_word(keys.DETECTOR_MODEL, models)]}


def _instance(cls: type, *words: Key) -> Schema:
    """Return the schema of a mapping that is read into a class."""
    shapes: dict[str, Schema] = {}
    sections = keys.declared_sections(cls)
    for name, field in sections.items():
        kinds = field.metadata["kinds"]
        if isinstance(kinds, type):
            shapes[name] = _instance(kinds)
        else:
            word = keys.TYPES[name]
            by_name = {kind: _instance(of_kind, word) for kind, of_kind in kinds.items()}
            shapes[name] = _by_word(word, by_name)
    return _mapping([*words, *keys.declared(cls), *keys.section_keys(cls)], shapes)


def _data_sheet(kind: str) -> Schema:
    """Return the schema of a data sheet, with one unit a parameter."""
    parameters = keys.declared_units(RADARS[kind])
    names = [[key.name for key in units] for units in parameters if units[0].required]
    others = [keys.LOSSES_DB, *([keys.SEARCH_FACTOR] if kind == "surveillance" else [])]
    parameter_keys = [key for units in parameters for key in units]
    total = "loss_db"
    required = [units[0] for units in names if len(units) == 1 and units[0] != total]
    losses = {
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"pattern": f"^(?:{keys.LOSS_NAME.pattern})$"},
        "additionalProperties": _number(LOSSES),
    }
    return {
        **_mapping([*parameter_keys, *others], {keys.LOSSES_DB.name: losses}, required=required),
        "allOf": [
            *(_one_of(units) for units in names if len(units) > 1),
            {"anyOf": [_with(total), _with(keys.LOSSES_DB.name)]},
        ],
    }


def _rcs() -> Schema:
    """Return the schema of an RCS, with the keys of the model."""
    models = {
        name: keys.TABLE if name == "table" else (keys.RCS_MODEL, *keys.declared(cls))
        for name, cls in RCS_MODELS.items()
    }
    return _by_word(keys.RCS_MODEL, {name: _mapping(section) for name, section in models.items()})


def _geometry() -> Schema:
    """Return the schema of a geometry, with the keys of the type."""
    orbit = _mapping(keys.ORBIT, {"azimuth_deg": _mapping(keys.SWEEP)})
    shapes = {"origin": _mapping(keys.PLACE), "interpolate": _mapping(keys.INTERPOLATE)}
    return _by_word(keys.GEOMETRY_TYPE, {"orbit": orbit, "path": _mapping(keys.PATH, shapes)})


def _by_word(key: Key, mappings: Mapping[str, Schema]) -> Schema:
    """Return the schema of a mapping in which a word determines the other keys."""
    return {
        "type": "object",
        "properties": {key.name: {"description": describe(key), **_value(key)}},
        "required": [key.name],
        "allOf": [
            _if(_at(key.name, {"const": word}), mapping) for word, mapping in mappings.items()
        ],
    }


# Covariances.


def _covariance(
    parts: Sequence[Key],
    shapes: Mapping[str, Schema] | None = None,
    besides: Sequence[Key] = (),
    *,
    alone: bool = False,
) -> Schema:
    """Return the schema of a covariance, part by part or as a whole.

    Args:
        parts: The keys of the parts.
        shapes: Schemas of parts that are more than numbers.
        besides: Further keys.
        alone: Whether a mapping may have further keys only, without a covariance.
    """
    whole = keys.COVARIANCE.name
    by_part = {key.name: _part(key) for key in parts}
    matrix = {whole: _matrix(sum(key.size for key in parts))}
    of_parts: Schema = {"required": list(by_part)}
    if alone:
        of_parts = {"anyOf": [of_parts, _only(besides)]}
    section = [*parts, keys.COVARIANCE, *besides]
    return {
        **_mapping(section, {**by_part, **matrix, **(shapes or {})}, required=[]),
        "if": _with(whole),
        "then": {"properties": dict.fromkeys(by_part, False)},
        "else": of_parts,
    }


def _only(section: Sequence[Key]) -> Schema:
    """Return the schema of a mapping that has some of the keys and no others."""
    return {"propertyNames": {"enum": [key.name for key in section]}, "minProperties": 1}


def _part(key: Key) -> Schema:
    """Return the schema of a standard deviation for all components, for each, or a matrix."""
    number = _number(key.limit or NOT_NEGATIVE)
    if key.size == 1:
        return number
    return {"anyOf": [number, _list(key.size, number), _matrix(key.size)]}


def _matrix(size: int) -> Schema:
    return _list(size, _list(size, _number(ANY)))


def _levels(kind: str) -> Schema:
    """Return the schema of levels of uncertainty.

    Args:
        kind: "constant", or a data sheet, whose parameters may have tolerances.
    """
    constant = keys.COV_RADAR[-1]
    shapes = {}
    if kind != constant.name:
        shapes[constant.name] = {"anyOf": [_part(constant), _tolerances(kind)]}
    return {
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"pattern": f"^(?:{keys.LEVEL_NAME.pattern})$"},
        "additionalProperties": _covariance(keys.COV_RADAR, shapes, [keys.ATTENUATION_STD]),
    }


def _tolerances(kind: str) -> Schema:
    """Return the schema of standard deviations by parameter of a data sheet."""
    cls = RADARS[kind]
    parameters = [f for f in fields(cls) if "units" in f.metadata]
    properties = {
        key.name: {
            "description": f"Standard deviation: {describe(key)}",
            **_number(TOLERANCE_DB if parameter.metadata["decibels"] else NOT_NEGATIVE),
        }
        for parameter, units in zip(parameters, keys.declared_units(cls), strict=True)
        for key in units
        if parameter.default is MISSING
    }
    properties[keys.LOSSES_DB.name] = {
        "description": "Standard deviations of the losses by name.",
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"pattern": f"^(?:{keys.LOSS_NAME.pattern})$"},
        "additionalProperties": _number(TOLERANCE_DB),
    }
    return {
        "type": "object",
        "properties": properties,
        "minProperties": 1,
        "additionalProperties": False,
    }


# Conditions.


def _if(condition: Schema, then: Schema, else_: Schema | None = None) -> Schema:
    return {"if": condition, "then": then, **({} if else_ is None else {"else": else_})}


def _one_of(names: Sequence[str]) -> Schema:
    return {"oneOf": [_with(name) for name in names]}


def _at(name: str, value: Schema) -> Schema:
    """Return the schema of a mapping with a key, from the schema of the value."""
    return {"properties": {name: value}, "required": [name]}


def _with(name: str) -> Schema:
    return {"required": [name]}


def _without(name: str) -> Schema:
    return {"not": {"required": [name]}}


def _levels_of(kind: str) -> Schema:
    return {"$ref": f"#/definitions/levels_{kind}"}


#: Keys that give the radar constant.
CONSTANTS = (keys.CONSTANT.name, *RADARS)
#: Keys beside the covariance of the pose.
_OF_RCS = (keys.RCS_DB,)
_GEODETIC = _with(keys.RADAR_PLACE.name)
