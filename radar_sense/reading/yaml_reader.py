"""A strict reader of YAML: every value has its file, line and key path, for errors.

PyYAML parses. The key decides what a scalar means: `1e-6` is a number and `NO` is a name. Duplicate
keys, tags and unknown keys are errors.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from radar_sense.errors import InputError, did_you_mean, shorten
from radar_sense.keys import FILE, SHA256, YES_NO, Key, declared, declared_sections
from radar_sense.limits import ANY, LARGEST, SMALLEST, Limit
from radar_sense.scenario_file.text_file import (
    NOT_FINITE,
    NUMBER,
    DigestError,
    FileError,
    decoded,
    open_text,
)

#: Largest scenario file. A scenario is a page of text, far smaller than this.
MAX_BYTES = 64 * 1024
_RESOLVER: Any = yaml.resolver.Resolver()  # which has no types
_INFINITE = re.compile(r"\+?\.?inf(inity)?", re.IGNORECASE)
T = TypeVar("T")


@dataclass(frozen=True)
class Entry:
    """One value of a YAML document, with its place."""

    node: yaml.Node
    path: str
    source: str

    def error(self, message: str) -> InputError:
        """Return the error to raise about this value."""
        place = f"{self.source}:{self.node.start_mark.line + 1}"
        return InputError(": ".join(filter(None, (place, self.path, message))))

    def wrong(self, allowed: object) -> InputError:
        """Return the error for a value other than the allowed ones."""
        return self.error(f"must be {allowed}, got {self._description()}")

    def entries(self) -> dict[str, Entry]:
        """Read a mapping with any keys."""
        if not self.is_mapping():
            raise self.wrong("a mapping (key: value)")
        entries: dict[str, Entry] = {}
        lines: dict[str, int] = {}
        for key_node, value_node in self.node.value:
            key_entry = Entry(key_node, self.path, self.source)
            if not isinstance(key_node, yaml.ScalarNode):
                raise key_entry.error("keys must be plain words")
            key = key_node.value
            if key in entries:
                raise key_entry.error(f"duplicate key {shorten(key)}, first on line {lines[key]}")
            lines[key] = key_node.start_mark.line + 1
            entries[key] = Entry(value_node, f"{self.path}.{key}".lstrip("."), self.source)
        return entries

    def mapping(self, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Entry]:
        """Read a mapping with all required keys, any optional keys, and no others."""
        entries = self.entries()
        allowed = [*required, *optional]
        for key_node, _ in self.node.value:
            if key_node.value not in allowed:
                raise Entry(key_node, self.path, self.source).error(
                    f"unknown key {shorten(key_node.value)}, allowed: {', '.join(allowed)}"
                    + did_you_mean(key_node.value, set(allowed) - set(entries))
                )
        missing = [key for key in required if key not in entries]
        if missing:
            raise self.error(f"missing key '{missing[0]}', required: {', '.join(required)}")
        return entries

    def named(self, key: Key) -> dict[str, Entry]:
        """Read a mapping whose keys are names that the user chooses."""
        for key_node, _ in self.node.value if self.is_mapping() else ():
            Entry(key_node, self.path, self.source).text(key.pattern, key.allowed)
        return self.entries()

    def number(self, limit: Limit = ANY) -> float:
        """Read a number."""
        text = self._plain_text()
        if text is None or not NUMBER.fullmatch(text):
            if text is not None and NOT_FINITE.fullmatch(text):
                raise self.error(f"must be finite, and {limit}, got {text}")
            raise self.wrong(limit)
        value = float(text)
        if not limit.allows(value):
            raise self.wrong(limit)
        if abs(value) > LARGEST or (0 < abs(value) < SMALLEST and limit.below is None):
            raise self.wrong(f"{limit}, of a size from {SMALLEST:g} to {LARGEST:g} if it is not 0")
        return value

    def number_or_infinity(self, limit: Limit = ANY) -> float:
        """Read a number, or `.inf`; with quotes too, because JSON has no infinite numbers."""
        text = self.node.value if isinstance(self.node, yaml.ScalarNode) else ""
        if _INFINITE.fullmatch(text):
            return math.inf
        if not NUMBER.fullmatch(text):
            raise self.wrong(f"{limit}, or .inf")
        return self.number(limit)

    def integer(self, limit: Limit) -> int:
        """Read a whole number; `1e4` and `500.0` are whole numbers."""
        text = self._plain_text()
        if text is not None and re.fullmatch(r"[-+]?[0-9]{1,400}", text):
            value = int(text)  # a seed may have more digits than a float
            if not limit.allows(value):
                raise self.wrong(limit)
            return value
        return int(self.number(limit))

    def numbers(self, count: int, limit: Limit = ANY) -> list[float]:
        """Read a list of `count` numbers."""
        return [entry.number(limit) for entry in self._items(count, "numbers")]

    def matrix(self, size: int) -> list[list[float]]:
        """Read a square matrix, a list of rows."""
        return [row.numbers(size) for row in self._items(size, f"rows of {size} numbers")]

    def items(self) -> list[Entry]:
        """Read a list."""
        return [
            Entry(item, f"{self.path}[{i}]", self.source)
            for i, item in enumerate(self.node.value, start=1)
        ]

    def is_mapping(self) -> bool:
        """Return whether this is a mapping."""
        return isinstance(self.node, yaml.MappingNode)

    def is_list(self) -> bool:
        """Return whether this is a list."""
        return isinstance(self.node, yaml.SequenceNode)

    def is_matrix(self) -> bool:
        """Return whether this is a list of lists."""
        return self.is_list() and any(
            isinstance(item, yaml.SequenceNode) for item in self.node.value
        )

    def text(self, pattern: str, allowed: str) -> str:
        """Read text that matches the pattern; `allowed` is the pattern in words."""
        value = self.node.value if isinstance(self.node, yaml.ScalarNode) else None
        if value is None or not re.fullmatch(pattern, value):
            raise self.wrong(allowed)
        return str(value)

    def choice(self, choices: Iterable[str]) -> str:
        """Read one of the given words."""
        choices = list(choices)
        value = self.node.value if isinstance(self.node, yaml.ScalarNode) else ""
        if value not in choices:
            raise self.error(
                f"must be one of {', '.join(choices)}, got {self._description()}"
                + did_you_mean(value, choices)
            )
        return str(value)

    def section(self, keys: Sequence[Key], *besides: str) -> Section:
        """Read a mapping with declared keys; the required keys must be there.

        Args:
            keys: The declared keys.
            besides: Further keys that are allowed.
        """
        required = [key.name for key in keys if key.required]
        optional = [key.name for key in keys if not key.required]
        return Section(self.mapping(required, [*optional, *besides]))

    def value(self, key: Key) -> Any:
        """Read the value of a key, in the unit of the key."""
        if key.choices == YES_NO:
            return self.choice(YES_NO) == "true"
        if key.choices:
            return self.choice(key.choices)
        if key.pattern:
            return self.text(key.pattern, key.allowed)
        limit = key.limit or ANY
        if key.infinite:
            return self.number_or_infinity(limit)
        if key.size > 1:
            return self.numbers(key.size, limit)
        return self.integer(limit) if limit.whole else self.number(limit)

    def instance(self, cls: type[T], *, besides: Sequence[str] = ()) -> T:
        """Read a mapping into a dataclass whose fields are declared in `limits`.

        Args:
            cls: The dataclass.
            besides: Further required keys, which the caller reads.
        """
        declarations = fields(cls) if is_dataclass(cls) else ()
        attributes = {f.metadata["key"]: f.name for f in declarations if "key" in f.metadata}
        sections = declared_sections(cls)
        required = [key.name for key in declared(cls) if key.required]
        optional = [key.name for key in declared(cls) if not key.required]
        section = Section(self.mapping([*besides, *required], [*optional, *sections]))
        arguments = {attributes[key.name]: section.value(key) for key in declared(cls)}
        for name, field in sections.items():
            if name in section:
                arguments[field.name] = section[name].instance_of(field.metadata["kinds"])
        try:
            return cls(**arguments)
        except ValueError as error:
            raise self.error(str(error)) from error

    def instance_of(self, kinds: type | Mapping[str, type]) -> Any:
        """Read a mapping into a dataclass, which `type` names if there are several."""
        if isinstance(kinds, type):
            return self.instance(kinds)
        entries = self.entries()
        if "type" not in entries:
            raise self.error(f"missing key 'type', one of {', '.join(kinds)}")
        return self.instance(kinds[entries["type"].choice(kinds)], besides=["type"])

    def _items(self, count: int, what: str) -> list[Entry]:
        if not self.is_list() or len(self.node.value) != count:
            raise self.wrong(f"a list of {count} {what}")
        return self.items()

    def _plain_text(self) -> str | None:
        """Text of a scalar that was written without quotes or tag."""
        if isinstance(self.node, yaml.ScalarNode) and not self.node.style:
            return str(self.node.value)
        return None

    def _description(self) -> str:
        if isinstance(self.node, yaml.MappingNode):
            return "a mapping"
        if isinstance(self.node, yaml.SequenceNode):
            return f"a list of {len(self.node.value)}"
        if self.node.value == "":
            return "nothing"
        text = self._plain_text()
        if text is not None and NUMBER.fullmatch(text) and len(text) <= 40:
            return text
        return shorten(self.node.value)


@dataclass(frozen=True)
class Section:
    """The entries of a mapping, by key."""

    entries: Mapping[str, Entry]

    def __contains__(self, key: Key | str) -> bool:
        return (key if isinstance(key, str) else key.name) in self.entries

    def __getitem__(self, key: Key | str) -> Entry:
        return self.entries[key if isinstance(key, str) else key.name]

    def value(self, key: Key) -> Any:
        """Return the value of a key in the unit of the key, or its default."""
        return self[key].value(key) if key in self else key.default

    def si(self, key: Key) -> Any:
        """Return the value of a key in SI units, or its default."""
        return in_si(self[key].value(key), key) if key in self else key.default


def in_si(value: Any, key: Key) -> Any:
    """Return the value of a key in SI units."""
    if key.unit == 1.0:
        return value
    return [number * key.unit for number in value] if key.size > 1 else value * key.unit


@contextmanager
def file_errors(section: Section) -> Iterator[None]:
    """Raise errors of a file with the place of the key that names the file.

    Errors with a line of the file stay as they are.
    """
    try:
        yield
    except DigestError as error:
        raise section[SHA256].error(str(error)) from error
    except FileError as error:
        raise section[FILE].error(str(error)) from error


def read_file(path: str | Path) -> str:
    """Return the text of a scenario file.

    Raises:
        InputError: If the file cannot be read, is too large, or is not UTF-8 text.
    """
    with open_text(path, "a scenario file", MAX_BYTES) as file:
        pieces = []
        while data := file.read(MAX_BYTES):
            pieces.append(data)
    return decoded(b"".join(pieces), str(path)).removeprefix("\ufeff")


def parse(text: str, source: str) -> Entry:
    """Parse one YAML document.

    Raises:
        InputError: If it is empty or not valid YAML.
    """
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise InputError(f"{source}:{line}: is not valid YAML: {error.problem}") from error
    except yaml.reader.ReaderError as error:
        line = text[: int(error.position)].count("\n") + 1
        raise InputError(
            f"{source}:{line}: is not a text file: character {ord(text[error.position]):#x}"
        ) from error
    except RecursionError as error:
        raise InputError(f"{source}: is nested too deeply for a scenario") from error
    if node is None:
        raise InputError(f"{source}: is empty; `radar-sense init` writes one to start from")
    root = Entry(node, "", source)
    _refuse_tags(root)
    return root


def _refuse_tags(root: Entry) -> None:
    """Raise InputError for tags such as `!!python/object`."""
    # Aliases make the same node appear in many places. Each node is checked once.
    seen: set[int] = set()
    waiting = [root]
    while waiting:
        entry = waiting.pop()
        node = entry.node
        if id(node) in seen:
            continue
        seen.add(id(node))
        if node.tag != _implicit_tag(node):
            raise entry.error(f"tags are not supported, got {shorten(node.tag)}")
        if isinstance(node, yaml.SequenceNode):
            waiting += entry.items()
        elif isinstance(node, yaml.MappingNode):
            for key_node, value_node in node.value:
                name = key_node.value if isinstance(key_node, yaml.ScalarNode) else "?"
                key = f"{entry.path}.{name}".lstrip(".")
                waiting += [
                    Entry(key_node, entry.path, entry.source),
                    Entry(value_node, key, entry.source),
                ]


def _implicit_tag(node: yaml.Node) -> str:
    """Return the default tag of a node, which the author of the file did not write."""
    plain = not getattr(node, "style", None)
    return str(_RESOLVER.resolve(type(node), node.value, (plain, not plain)))
