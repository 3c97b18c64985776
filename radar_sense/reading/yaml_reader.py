"""Reading YAML strictly: every value knows its file, line and key path, and can complain with them.

PyYAML parses; the meaning of a scalar is decided here by what the scenario expects at that place.
That is what lets `1e-6` be a number and `NO` a name, finds duplicate keys, and gives errors a line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from radar_sense.errors import ScenarioError, did_you_mean
from radar_sense.limits import ANY, LARGEST, SMALLEST, Limit

#: A scenario is a page of text; more than this is some other file.
MAX_BYTES = 64 * 1024
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"\+?\.?inf(inity)?", re.IGNORECASE)
_NOT_FINITE = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)
T = TypeVar("T")


@dataclass(frozen=True)
class Entry:
    """One value of a YAML document, with where it stands."""

    node: yaml.Node
    path: str
    source: str

    def error(self, message: str) -> ScenarioError:
        """Return the error to raise about this value."""
        place = f"{self.source}:{self.node.start_mark.line + 1}"
        return ScenarioError(": ".join(filter(None, (place, self.path, message))))

    def wrong(self, allowed: object) -> ScenarioError:
        """Return the error for a value that is not what is allowed here."""
        return self.error(f"must be {allowed}, got {self._description()}")

    def entries(self) -> dict[str, Entry]:
        """Read a mapping with any keys."""
        if not self.is_mapping():
            raise self.wrong("a mapping (key: value)")
        found: dict[str, Entry] = {}
        lines: dict[str, int] = {}
        for key_node, value_node in self.node.value:
            key_entry = Entry(key_node, self.path, self.source)
            if not isinstance(key_node, yaml.ScalarNode):
                raise key_entry.error("keys must be plain words")
            key = key_node.value
            if key in found:
                raise key_entry.error(f"duplicate key {_shorten(key)}, first on line {lines[key]}")
            lines[key] = key_node.start_mark.line + 1
            found[key] = Entry(value_node, f"{self.path}.{key}".lstrip("."), self.source)
        return found

    def mapping(self, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Entry]:
        """Read a mapping that has the required keys, may have the optional ones, and no other."""
        found = self.entries()
        allowed = [*required, *optional]
        for key_node, _ in self.node.value:
            if key_node.value not in allowed:
                raise Entry(key_node, self.path, self.source).error(
                    f"unknown key {_shorten(key_node.value)}, allowed: {', '.join(allowed)}"
                    + did_you_mean(key_node.value, set(allowed) - set(found))
                )
        missing = [key for key in required if key not in found]
        if missing:
            raise self.error(f"missing key '{missing[0]}', required: {', '.join(required)}")
        return found

    def named(self, pattern: str, allowed: str) -> dict[str, Entry]:
        """Read a mapping whose keys are names that the user chooses."""
        for key_node, _ in self.node.value if self.is_mapping() else ():
            Entry(key_node, self.path, self.source).text(pattern, allowed)
        return self.entries()

    def number(self, limit: Limit = ANY) -> float:
        """Read a number."""
        text = self._plain_text()
        if text is None or not _NUMBER.fullmatch(text):
            if text is not None and _NOT_FINITE.fullmatch(text):
                raise self.error(f"must be finite, got {text}")
            raise self.wrong(limit)
        value = float(text)
        if not limit.allows(value):
            raise self.wrong(limit)
        if abs(value) > LARGEST or (0 < abs(value) < SMALLEST and limit.below is None):
            raise self.wrong(f"{limit}, of a size from {SMALLEST:g} to {LARGEST:g} if it is not 0")
        return value

    def number_or_infinity(self, limit: Limit = ANY) -> float:
        """Read a number, or `.inf`; with quotes too, as JSON has no other way to write it."""
        text = self.node.value if isinstance(self.node, yaml.ScalarNode) else ""
        if _INFINITE.fullmatch(text):
            return math.inf
        if not _NUMBER.fullmatch(text):
            raise self.wrong(f"{limit}, or .inf")
        return self.number(limit)

    def integer(self, limit: Limit) -> int:
        """Read a whole number; `1e4` and `500.0` are whole numbers."""
        text = self._plain_text()
        if text is not None and re.fullmatch(r"[-+]?[0-9]{1,400}", text):
            value = int(text)  # not by way of a float: a seed may have more digits than that holds
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
        """Say whether this is a mapping."""
        return isinstance(self.node, yaml.MappingNode)

    def is_list(self) -> bool:
        """Say whether this is a list."""
        return isinstance(self.node, yaml.SequenceNode)

    def is_matrix(self) -> bool:
        """Say whether this is a list of lists."""
        return self.is_list() and any(
            isinstance(item, yaml.SequenceNode) for item in self.node.value
        )

    def text(self, pattern: str, allowed: str) -> str:
        """Read text that matches the pattern; `allowed` says it in words."""
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

    def instance(self, cls: type[T], *, besides: Sequence[str] = ()) -> tuple[T, dict[str, Any]]:
        """Read a mapping into a dataclass whose fields are declared with `limits.parameter`.

        Args:
            cls: The dataclass.
            besides: Keys that are required too but that someone else reads.

        Returns:
            The instance, and its numbers by key.
        """
        declared = {f.metadata["key"]: f for f in fields(cls)}  # type: ignore[arg-type]
        found = self.mapping([*besides, *declared])
        values = {
            key: found[key].integer(f.metadata["limit"])
            if f.metadata["limit"].whole
            else found[key].number(f.metadata["limit"])
            for key, f in declared.items()
        }
        try:
            return cls(**{f.name: values[key] for key, f in declared.items()}), values
        except ValueError as error:
            raise self.error(str(error)) from error

    def _items(self, count: int, what: str) -> list[Entry]:
        if not self.is_list() or len(self.node.value) != count:
            raise self.wrong(f"a list of {count} {what}")
        return self.items()

    def _plain_text(self) -> str | None:
        """Text of a scalar that was written without quotes or tag."""
        if isinstance(self.node, yaml.ScalarNode) and self.node.style is None:
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
        if text is not None and _NUMBER.fullmatch(text) and len(text) <= 40:
            return text
        return _shorten(self.node.value)


def recorded(path: Path) -> str:
    """How a resolved scenario names another file: from the working folder if it is in there.

    A record then says nothing of the machine that it was made on.
    """
    absolute, here = path.absolute(), Path.cwd()
    return (absolute.relative_to(here) if absolute.is_relative_to(here) else absolute).as_posix()


def read_file(path: str | Path) -> str:
    """Read a text file that is not too large to be a scenario.

    Raises:
        ScenarioError: If it cannot be read, is too large, or is not UTF-8 text.
    """
    try:
        with Path(path).open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except IsADirectoryError as error:
        raise ScenarioError(f"{path}: is a directory, not a scenario file") from error
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte in it
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{path}: cannot be read: {reason}") from error
    if len(data) > MAX_BYTES:
        raise ScenarioError(
            f"{path}: is larger than {MAX_BYTES // 1024} KiB, too large for a scenario"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise ScenarioError(
            f"{path}:{line}: is not UTF-8 text: byte 0x{data[error.start]:02x}"
        ) from error


def parse(text: str, source: str) -> Entry:
    """Parse one YAML document.

    Raises:
        ScenarioError: If it is empty or not valid YAML.
    """
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise ScenarioError(f"{source}:{line}: is not valid YAML: {error.problem}") from error
    except yaml.reader.ReaderError as error:
        line = text[: int(error.position)].count("\n") + 1
        raise ScenarioError(
            f"{source}:{line}: is not a text file: character {ord(text[error.position]):#x}"
        ) from error
    except RecursionError as error:
        raise ScenarioError(f"{source}: is nested too deeply for a scenario") from error
    if node is None:
        raise ScenarioError(f"{source}: is empty; `radar-sense init` writes one to start from")
    root = Entry(node, "", source)
    _refuse_tags(root)
    return root


def _refuse_tags(root: Entry) -> None:
    """Refuse `!!python/object` and the like; a scenario has no use for them."""
    # Aliases make the same node appear in many places; each is looked at once.
    seen: set[int] = set()
    waiting = [root]
    while waiting:
        entry = waiting.pop()
        node = entry.node
        if id(node) in seen:
            continue
        seen.add(id(node))
        if node.tag != _implicit_tag(node):
            raise entry.error(f"tags are not supported, got {_shorten(node.tag)}")
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
    """Return the tag that a node has if its author wrote none."""
    plain = getattr(node, "style", None) is None
    resolver: Any = yaml.resolver.Resolver()  # which has no types
    return str(resolver.resolve(type(node), node.value, (plain, not plain)))


def _shorten(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
