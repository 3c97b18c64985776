"""A section of a scenario file is a dataclass. Reading, record, schema and reference come from it.

    @dataclass(frozen=True, kw_only=True)
    class Circle(Section):
        range_km: float = key("Horizontal radius of the orbit.", NOT_NEGATIVE)
        azimuth_from: str = key("Direction of azimuth 0.", ("east", "north"), default="east")

`read(place, Circle)` returns a `Circle` with the numbers as typed, or raises an error with file,
line, path of keys, what is allowed and what was probably meant. The circle knows its place, for
later errors about it. `write(circle)` is the section as in a file. `schema(Circle)` is its JSON
Schema. `keys_of(Circle)` are its declarations.

What the value of a key may be is a `Kind`, which `number`, `words`, `section` and so on return. The
classes of RCS models, detectors and CFARs are sections too. They declare their fields by `limits`.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import yaml

from radar_sense.errors import InputError, describe, did_you_mean
from radar_sense.limits import ANY, LARGEST, NOT_NEGATIVE, SMALLEST, Limit, Text
from radar_sense.scenario_file.place import Place
from radar_sense.scenario_file.text_file import NOT_FINITE, NUMBER, advice
from radar_sense.units import unit_name

S = TypeVar("S")
Schema = dict[str, Any]

REQUIRED: Any = dataclasses.MISSING
#: Most sections that an error names.
NAMED = 3
#: Most digits of a number. A seed may have more digits than a float, and Python takes 4300.
MAX_DIGITS = 400
_INFINITE = re.compile(r"\+?\.?inf(inity)?", re.IGNORECASE)
_BRACKETS = re.compile(r" \[([^]]*)\]")


# Declarations.


class Section:
    """A mapping of a file, as a dataclass of keys.

    Attributes:
        place: Where `read` has found it.
    """

    place: Place

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "place"}


@dataclass(frozen=True)
class Kind:
    """What the value of a key may be.

    Attributes:
        allowed: What is allowed, in words; "" of sections, whose keys say it.
        read: Returns the value at a place of a file, or raises InputError.
        schema: Returns the JSON Schema.
        write: Returns a value as in a file.
        sections: Returns the classes of sections that the value may have, by what their titles add
            to the name of the key: "", "[]", " (type: orbit)".
    """

    allowed: str
    read: Callable[[Place], Any]
    schema: Callable[[], Schema]
    write: Callable[[Any], Any] = lambda value: value
    sections: Callable[[], Mapping[str, type]] = dict


def key(
    meaning: str,
    kind: Kind | Limit | Text | tuple[str, ...] | type | Mapping[str, type],
    *,
    default: Any = REQUIRED,
    one_of: str = "",
    unless: Sequence[str] = (),
    instead_of: Sequence[str] = (),
) -> Any:
    """Declare a key of a section.

    Args:
        meaning: Meaning of the value, a sentence. A unit that the name does not have is in [].
        kind: What the value is. A `Limit` stands for a number, a `Text` for text, a tuple for one
            of its words, a dataclass for a section, and dataclasses by name for one by its `type`.
        default: Value of a missing key. Without a default the key is required.
        one_of: Name of a group. Keys of a group exclude each other, and one of them is required.
        unless: The key is required unless one of these keys is given.
        instead_of: The key stands in place of these keys, which are not allowed beside it.
    """
    if (one_of or unless) and default is REQUIRED:
        default = None
    metadata = {"meaning": meaning, "kind": kind, "one_of": one_of}
    metadata |= {"unless": tuple(unless), "instead_of": tuple(instead_of)}
    return dataclasses.field(default=default, metadata=metadata)


def optional(meaning: str, kind: Any, *, instead_of: Sequence[str] = ()) -> Any:
    """Declare a key that may be missing, and has no default then."""
    return key(meaning, kind, default=None, instead_of=instead_of)


@dataclass(frozen=True)
class Key:
    """A key of a section, as declared by `key` or by `limits`.

    Attributes:
        name: The key in the file.
        field: Name of the field of the dataclass.
        meaning: Meaning of the value, without the unit.
        unit: Unit of the value, or ""; the keys of a section have units of their own.
        kind: What the value is.
        default: Value of a missing key, or `REQUIRED`. The rest is as in `key`.
    """

    name: str
    field: str
    meaning: str
    unit: str
    kind: Kind
    default: Any
    one_of: str = ""
    unless: tuple[str, ...] = ()
    instead_of: tuple[str, ...] = ()

    @property
    def shown_default(self) -> str:
        """The default as in a file; "" without one."""
        if self.default in (None, REQUIRED):
            return ""
        value = self.kind.write(self.default)
        return value if isinstance(value, str) else json.dumps(value).removesuffix(".0")

    @property
    def description(self) -> str:
        """Meaning, unit, allowed values and default in a line."""
        allowed = self.kind.allowed
        parts = [
            self.meaning,
            self.unit and f"Unit: {self.unit}.",
            allowed and f"{allowed[0].upper()}{allowed[1:]}.",
            self.shown_default and f"Default: {self.shown_default}.",
        ]
        return " ".join(filter(None, parts))


#: Keys of the sections asked for. mypy does not let `functools.cache` take a class.
_KEYS: dict[Any, tuple[Key, ...]] = {}


def keys_of(cls: Any) -> tuple[Key, ...]:
    """Return the keys of a section, in order."""
    if cls in _KEYS:  # a file asks some sixty times
        return _KEYS[cls]
    keys = []
    for f in dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ():
        if "meaning" not in f.metadata:
            continue
        declared = {"key": f.name, **f.metadata}
        name, meaning, kind = (declared.pop(of) for of in ("key", "meaning", "kind"))
        kind, brackets = _kind(kind), _BRACKETS.search(meaning)
        unit = unit_name(name) or (brackets[1] if brackets else "")
        unit, meaning = unit if kind.allowed else "", _BRACKETS.sub("", meaning)
        keys.append(Key(name, f.name, meaning, unit, kind, f.default, **declared))
    _KEYS[cls] = tuple(keys)
    return _KEYS[cls]


def groups_of(keys: Sequence[Key]) -> list[list[str]]:
    """Return the keys that exclude each other, group by group."""
    groups: dict[str, list[str]] = {}
    for k in keys:
        if k.one_of:
            groups.setdefault(k.one_of, []).append(k.name)
    return list(groups.values())


def sections(cls: type, title: str = "") -> Iterator[tuple[str, type]]:
    """Yield a section and all sections below it, each with its title."""
    yield title, cls
    path = title.partition(" (")[0]
    for k in keys_of(cls):
        for ending, below in k.kind.sections().items():
            yield from sections(below, f"{path}.{k.name}{ending}".lstrip("."))


# Reading and writing sections.


class UnknownKeyError(InputError):
    """The error of a key that its section does not have, with titles of sections that have it."""

    def __init__(
        self, place: Place, name: str, allowed: Sequence[str], owners: Sequence[str] = ()
    ) -> None:
        self.place, self.name, self.allowed, self.owners = place, name, allowed, owners
        at = place.of_key(name)
        meant = allowed if at.is_set else [k for k in allowed if k not in place.items()]
        hint = f"; it is a key of {', '.join(owners)}" if owners else did_you_mean(name, meant)
        if name == "<<":
            hint = "; merges are not read: write the keys out, or let an alias stand for a section"
        elif name.isdecimal() and not at.is_set:
            hint = "; a comma ends the value before: write a decimal point, such as 0.6 for 0,6"
        text = f"unknown key {describe(name)}, allowed: {', '.join(allowed)}{hint}"
        super().__init__(str(at.error(text)))


def read_file(place: Place, cls: type[S]) -> S:
    """Read the mapping of a whole file. An unknown key may be one of any section of the file."""
    try:
        return read(place, cls)
    except UnknownKeyError as error:
        names = {title: {k.name for k in keys_of(c)} for title, c in sections(cls) if title}
        owners = error.owners or [title for title, keys in names.items() if error.name in keys]
        raise UnknownKeyError(error.place, error.name, error.allowed, owners[:NAMED]) from error


def read(place: Place, cls: type[S], word: str = "", others: Mapping[str, type] | None = None) -> S:
    """Read a mapping into a section.

    The word is a further key, which the caller has read. The error of an unknown key says which
    section below has the key, or which of `others`, sections by name.

    Raises:
        InputError: If anything in the mapping is not allowed.
    """
    items, keys = place.items(), keys_of(cls)
    allowed = [*filter(None, [word]), *(k.name for k in keys)]
    for name in items:
        if name not in allowed:
            below = [(k.name, c) for k in keys for c in k.kind.sections().values()]
            elsewhere = [*(others or {}).items(), *below]
            owners = dict.fromkeys(o for o, c in elsewhere if name in (k.name for k in keys_of(c)))
            raise UnknownKeyError(place, name, allowed, [*owners])
    _check_present(place, items, keys, word)
    return _made(cls, {k.field: k.kind.read(items[k.name]) for k in keys if k.name in items}, place)


def _made(cls: type[S], values: Mapping[str, Any], place: Place) -> S:
    try:
        section = cls(**values)
    except ValueError as error:
        raise place.error(f"{error}") from error
    if isinstance(section, Section):
        object.__setattr__(section, "place", place)  # sections are frozen
    return section


def _check_present(
    place: Place, items: Mapping[str, Place], keys: Sequence[Key], word: str
) -> None:
    """Raise InputError unless the keys that are needed are there, without those they exclude."""
    for k in keys:
        if k.default is REQUIRED and k.name not in items:
            required = [word, *(k.name for k in keys if k.default is REQUIRED)]
            raise place.error(
                f"missing key '{k.name}', required: {', '.join(filter(None, required))}"
            )
        if k.unless and not {k.name, *k.unless} & items.keys():
            raise place.error(f"missing key '{k.name}', required without {' and '.join(k.unless)}")
        for other in k.instead_of if k.name in items else ():
            if other in items:
                raise _beside(items[k.name], other)
    for group in groups_of(keys):
        given = [name for name in items if name in group]
        if len(given) > 1:
            raise _beside(items[given[1]], given[0])
        if not given and len(group) == 1:
            raise place.error(f"missing key '{group[0]}'")
        if not given:
            *first, last = (f"'{name}'" for name in group)
            raise place.error(f"needs one of the keys {', '.join(first)} and {last}")


def _beside(place: Place, other: str) -> InputError:
    return place.error(f"stands beside '{other}'; give only one of the two")


def write(instance: Any) -> dict[str, Any]:
    """Return a section as in a file, with defaults filled in.

    A key at its default is left out if the default is nothing: none, 0 or false.
    """
    values = [(k, getattr(instance, k.field)) for k in keys_of(type(instance))]
    return {
        k.name: k.kind.write(value)
        for k, value in values
        if value is not None and (value or value != k.default)
    }


class Typed(float):
    """A number with the text that was typed."""

    text: str

    def __new__(cls, text: str) -> Typed:
        """Make the number of its text."""
        number = super().__new__(cls, text)
        number.text = f"{text}"
        return number

    def __repr__(self) -> str:
        return self.text


def _as_typed(dumper: Any, number: Typed) -> yaml.Node:
    """Return the node of a number, for PyYAML to write."""
    tag = dumper.resolve(yaml.ScalarNode, number.text, (True, False))
    return yaml.ScalarNode(tag, number.text)


yaml.representer.SafeRepresenter.add_representer(Typed, _as_typed)


# JSON Schema.


def schema(cls: type, word: str = "") -> Schema:
    """Return the JSON Schema of a section, of draft-07, which language servers support best.

    A schema cannot express all checks of the reader, such as a covariance that is not positive
    semidefinite. It refuses nothing that the reader accepts. The word is a further key, which says
    that a mapping is of this section.
    """
    keys = keys_of(cls)
    kind = {"description": "The kind of section.", "type": "string"}
    properties: Schema = {word: kind} if word else {}
    for k in keys:
        properties[k.name] = {"description": k.description, **k.kind.schema()}
        if k.shown_default:
            properties[k.name]["default"] = k.kind.write(k.default)
    rules: list[Schema] = [{"oneOf": [_with(name) for name in group]} for group in groups_of(keys)]
    rules += [{"anyOf": [_with(name) for name in (k.name, *k.unless)]} for k in keys if k.unless]
    rules += [{"not": _with(k.name, other)} for k in keys for other in k.instead_of]
    return {
        "type": "object",
        "properties": properties,
        "required": [k.name for k in keys if k.default is REQUIRED],
        "additionalProperties": False,
        **({"allOf": rules} if rules else {}),
    }


def _with(*names: str) -> Schema:
    return {"required": list(names)}


# Kinds of values.


def _kind(kind: Kind | Limit | Text | tuple[str, ...] | type | Mapping[str, type]) -> Kind:
    """Return the kind for which another declaration stands, as in `key`."""
    if isinstance(kind, Limit):
        return number(kind)
    if isinstance(kind, Text):
        return text(kind)
    if isinstance(kind, tuple):
        return words(kind)
    if isinstance(kind, Mapping):
        return by_word("type", kind)
    return kind if isinstance(kind, Kind) else section(kind)


def number(limit: Limit) -> Kind:
    """Return the kind of a number: an int where it must be whole, else `Typed` or infinity."""

    def read(place: Place) -> float:
        text = place.plain or ""
        if limit.infinite and _INFINITE.fullmatch(place.text or ""):
            return math.inf  # with quotes too, because JSON has no infinite numbers
        if NOT_FINITE.fullmatch(text) and not limit.infinite:
            raise place.error(f"must be finite, and {limit}, got {text}")
        if len(text) > MAX_DIGITS or not NUMBER.fullmatch(text):
            quoted = not text and NUMBER.fullmatch(place.text or "")
            raise place.wrong(limit, "; leave out the quotes" if quoted else advice(text, limit))
        value = int(text) if limit.whole and _is_whole(text) else Typed(text)
        if not limit.allows(value):
            raise place.wrong(limit)
        if limit.whole:
            return int(value)  # 1e4 is a whole number
        if abs(value) > LARGEST or (0 < abs(value) < SMALLEST and limit.below is None):
            raise place.wrong(f"{limit}, of a size from {SMALLEST:g} to {LARGEST:g} if it is not 0")
        return value

    def write(value: float) -> float | str:
        if value == math.inf:
            return ".inf"
        return int(value) if _is_whole(getattr(value, "text", "")) else value

    def schema() -> Schema:
        ends = {
            "exclusiveMinimum": limit.above,
            "minimum": limit.at_least,
            "exclusiveMaximum": limit.below,
            "maximum": limit.at_most,
        }
        if not (limit.whole or limit.infinite):
            if limit.above is None and limit.at_least is None:
                ends["minimum"] = -LARGEST
            if limit.below is None and limit.at_most is None:
                ends["maximum"] = LARGEST
        finite: Schema = {"type": "integer" if limit.whole else "number"}
        finite |= {name: end for name, end in ends.items() if end is not None}
        infinity = {"type": "string", "pattern": r"^\+?\.?[iI][nN][fF]([iI][nN][iI][tT][yY])?$"}
        return {"anyOf": [finite, infinity]} if limit.infinite else finite

    return Kind(str(limit), read, schema, write)


def _is_whole(text: str) -> bool:
    return text.lstrip("+-").isdigit()


def text(pattern: Text) -> Kind:
    """Return the kind of a text that matches a pattern."""

    def read(place: Place) -> str:
        if place.text is None or not pattern.allows(place.text):
            raise place.wrong(pattern)
        return place.text

    # YAML reads the name 1 as a number, true as a boolean, and null as nothing
    types = ["string", "number", "boolean", "null"]
    matches = {"type": types, "pattern": f"^(?:{pattern.pattern})$"}
    return Kind(pattern.words, read, lambda: dict(matches))


def words(choices: tuple[str, ...]) -> Kind:
    """Return the kind of one of some words."""
    numbers = [int(word) for word in choices if word.isdigit()]  # as YAML reads a word of digits
    return Kind(
        f"one of {', '.join(choices)}",
        lambda place: read_word(place, choices),
        lambda: {"enum": [*choices, *numbers]},
        lambda value: int(value) if value.isdigit() else value,
    )


def read_word(
    place: Place, choices: Collection[str], synonyms: Mapping[str, str] | None = None
) -> str:
    """Return one of some words. An error says which of them to write in place of a synonym."""
    text = place.text or ""
    if text not in choices:
        instead = (synonyms or {}).get(text)
        hint = f"; write '{instead}'" if instead else did_you_mean(text, choices)
        raise place.wrong(f"one of {', '.join(choices)}", hint)
    return text


def yes_no() -> Kind:
    """Return the kind of true or false."""
    choices = ("true", "false")
    return Kind(
        f"one of {', '.join(choices)}",
        lambda place: read_word(place, choices) == "true",
        lambda: {"enum": [True, False, *choices]},  # quotes change nothing
    )


def numbers(size: int, limit: Limit = ANY) -> Kind:
    """Return the kind of a list of numbers, which is read as a tuple."""
    return list_of(number(limit), f"{size} numbers", size, size, f"{size} numbers: each {limit}")


def matrix(size: int) -> Kind:
    """Return the kind of a square matrix, a list of rows, which is read as a tuple of tuples."""
    what = f"{size} rows of {size} numbers"
    return list_of(numbers(size), what, size, size, what)


def list_of(kind: Kind, what: str, least: int, most: int, allowed: str = "") -> Kind:
    """Return the kind of a list of values, read as a tuple; an error says what they are."""

    def read_list(place: Place) -> tuple[Any, ...]:
        entries = place.entries()
        if len(entries) < least or least == most < len(entries):
            raise place.wrong(f"a list of {what}")
        if len(entries) > most:
            raise place.error(f"has {len(entries)} entries, allowed are {most}")
        return tuple(map(kind.read, entries))

    return Kind(
        allowed,
        read_list,
        lambda: {"type": "array", "items": kind.schema(), "minItems": least, "maxItems": most},
        lambda value: [kind.write(item) for item in value],
        sections=lambda: {f"[]{end}": cls for end, cls in kind.sections().items()},
    )


def deviations(size: int) -> Kind:
    """Return the kind of a standard deviation of all components, one of each, or a covariance."""
    one, each, rows = number(NOT_NEGATIVE), numbers(size, NOT_NEGATIVE), matrix(size)

    def of_place(place: Place) -> Kind:
        if not place.is_list:
            return one
        return rows if any(entry.is_list for entry in place.entries()) else each

    def of_value(value: Any) -> Kind:
        if not isinstance(value, tuple):
            return one
        return rows if isinstance(value[0], tuple) else each

    return _either((one, each, rows), of_place, of_value)


def section(cls: type) -> Kind:
    """Return the kind of a mapping with the keys of a dataclass."""
    return Kind(
        "", lambda place: read(place, cls), lambda: schema(cls), write, sections=lambda: {"": cls}
    )


def by_word(
    word: str,
    members: Mapping[str, type],
    *,
    bare: bool = False,
    synonyms: Mapping[str, str] | None = None,
) -> Kind:
    """Return the kind of a mapping in which a word says which section the other keys are of.

    Args:
        word: Key of the word.
        members: Sections by the word. Sections may be added later.
        bare: Whether the word alone stands for a section whose keys are at their defaults.
        synonyms: The word to write in place of other words.
    """

    def read_section(place: Place) -> Any:
        if bare and not place.is_mapping:
            cls = members[read_word(place, members, synonyms)]
            required = [k.name for k in keys_of(cls) if k.default is REQUIRED]
            if required:
                raise place.error(f"needs a mapping with '{word}' and {', '.join(required)}")
            return cls()
        items = place.items()
        if word not in items:
            known = dict.fromkeys(k.name for cls in members.values() for k in keys_of(cls))
            unknown = [name for name in items if name not in known]
            if unknown:
                raise UnknownKeyError(place, unknown[0], [word, *known])
            raise place.error(f"missing key '{word}', one of {', '.join(members)}")
        cls = members[read_word(items[word], members, synonyms)]
        return read(place, cls, word, members)

    def write_section(value: Any) -> Any:
        name = next(name for name, cls in members.items() if type(value) is cls)
        values = [(k, getattr(value, k.field)) for k in keys_of(type(value))]
        if bare and all(item == k.default for k, item in values):
            return name
        return {word: name, **write(value)}

    def schema_by_word() -> Schema:
        names = {"enum": list(members)}
        choice = {"description": f"One of {', '.join(members)}.", **names}
        rules = [
            {
                "if": {"properties": {word: {"const": name}}, **_with(word)},
                "then": schema(cls, word),
            }
            for name, cls in members.items()
        ]
        mapping = {"type": "object", "properties": {word: choice}, **_with(word), "allOf": rules}
        return {"anyOf": [names, mapping]} if bare else mapping

    return Kind(
        "",
        read_section,
        schema_by_word,
        write_section,
        sections=lambda: {f" ({word}: {name})": cls for name, cls in members.items()},
    )


def named(name: Text, kind: Kind, what: str) -> Kind:
    """Return the kind of a mapping of values by names that the user chooses, at least one.

    An error says what has the names.
    """

    def read(place: Place) -> dict[str, Any]:
        items = place.items()
        if not items:
            raise place.error(f"needs at least one {what}")
        for given in items:
            if not name.allows(given):
                raise place.of_key(given).wrong(name)
        return {given: kind.read(item) for given, item in items.items()}

    return Kind(
        kind.allowed and f"{kind.allowed}, by name",
        read,
        lambda: {
            "type": "object",
            "minProperties": 1,
            "propertyNames": {"pattern": f"^(?:{name.pattern})$"},
            "additionalProperties": kind.schema(),
        },
        lambda value: {given: kind.write(item) for given, item in value.items()},
        sections=lambda: {f".NAME{end}": cls for end, cls in kind.sections().items()},
    )


def or_section(kind: Kind | Limit | Text, cls: type, *, alone: str = "") -> Kind:
    """Return a kind, or a section in its place: a mapping, with a key of it if both are one.

    `alone` is the key of the section for which a value of the kind stands alone.
    """
    first, instead, names = _kind(kind), section(cls), {k.name for k in keys_of(cls)}
    if alone:
        read_alone = first.read
        first = dataclasses.replace(
            first, read=lambda place: _made(cls, {alone: read_alone(place)}, place)
        )

    def of_place(place: Place) -> Kind:
        is_section = place.is_mapping and (not first.sections() or names & place.items().keys())
        return instead if is_section else first

    return _either(
        (first, instead), of_place, lambda value: instead if isinstance(value, cls) else first
    )


def _either(
    kinds: Sequence[Kind], of_place: Callable[[Place], Kind], of_value: Callable[[Any], Kind]
) -> Kind:
    """Return the kind of any of some kinds; errors name what the first allows."""
    return Kind(
        kinds[0].allowed,
        lambda place: of_place(place).read(place),
        lambda: {"anyOf": [kind.schema() for kind in kinds]},
        lambda value: of_value(value).write(value),
        sections=lambda: {end: cls for kind in kinds for end, cls in kind.sections().items()},
    )
