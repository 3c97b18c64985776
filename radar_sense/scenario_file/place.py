"""A value of a YAML document with its place, for errors with file, line and path of keys.

PyYAML parses. The declaration of a key says what a scalar means: `1e-6` is a number, and `NO` is a
name. Duplicate keys and tags are errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import yaml

from radar_sense.errors import InputError, describe
from radar_sense.scenario_file.text_file import NUMBER

#: Tags of values without a tag in the file. `BaseLoader` gives no others.
NO_TAG = {
    yaml.ScalarNode: "tag:yaml.org,2002:str",
    yaml.SequenceNode: "tag:yaml.org,2002:seq",
    yaml.MappingNode: "tag:yaml.org,2002:map",
}
#: What is probably wrong, by what PyYAML was reading where it began ...
_BEGUN = {
    "while scanning a quoted scalar": "the quote is not closed",
    "while scanning a simple key": "a key needs a colon, and a space after it",
    "while parsing a flow mapping": "the brace { is not closed, or lacks a comma",
    "while parsing a flow sequence": "the bracket [ is not closed, or lacks a comma",
}
#: ... and by what PyYAML found.
_FOUND = {
    "expected <block end>": "this does not fit the lines above; check its indentation, and that "
    "quotes and brackets are closed",
    "mapping values are not allowed": "no key may stand here; check its indentation, the space "
    "after the colon of the line above, and the quotes of a value with a colon",
}


@dataclass(frozen=True)
class Place:
    """A value of a YAML document."""

    node: yaml.Node
    path: str
    file: str

    def __post_init__(self) -> None:
        if self.node.tag != NO_TAG[type(self.node)]:
            raise self.error(f"tags are not supported, got {describe(self.node.tag)}")

    def error(self, message: str) -> InputError:
        """Return the error to raise about this value."""
        mark = self.node.start_mark
        place = mark.name if self.is_set else f"{self.file}:{mark.line + 1}"
        return InputError(": ".join(filter(None, (place, self.path, message))))

    def wrong(self, allowed: object, hint: str = "") -> InputError:
        """Return the error for a value other than the allowed ones."""
        return self.error(f"must be {allowed}, got {self.described}{hint}")

    @property
    def text(self) -> str | None:
        """Text of a scalar; None for a list or a mapping."""
        return str(self.node.value) if isinstance(self.node, yaml.ScalarNode) else None

    @property
    def plain(self) -> str | None:
        """Text of a scalar without quotes, or None."""
        quoted = getattr(self.node, "style", None)  # of scalars
        return None if quoted else self.text

    @property
    def described(self) -> str:
        """The value in a few letters, for errors."""
        if self.text is None:
            return "a mapping" if self.is_mapping else f"a list of {len(self.node.value)}"
        if self.plain and len(self.plain) <= 40 and NUMBER.fullmatch(self.plain):
            return self.plain
        return describe(self.text) if self.text else "nothing"

    @property
    def is_set(self) -> bool:
        """Whether this is a value of `--set`, whose mark has the option as its name."""
        return bool(self.node.start_mark.name != self.file)

    @property
    def is_mapping(self) -> bool:
        """Whether this is a mapping."""
        return isinstance(self.node, yaml.MappingNode)

    @property
    def is_list(self) -> bool:
        """Whether this is a list."""
        return isinstance(self.node, yaml.SequenceNode)

    def items(self) -> dict[str, Place]:
        """Return the values of a mapping by key."""
        return {name: value for name, (_, value) in self._pairs.items()}

    def of_key(self, name: str) -> Place:
        """Return the place of a key of a mapping, for errors about the key."""
        return self._pairs[name][0]

    @cached_property
    def _pairs(self) -> dict[str, tuple[Place, Place]]:
        if not self.is_mapping:
            raise self.wrong("a mapping (key: value)")
        pairs: dict[str, tuple[Place, Place]] = {}
        for key_node, value in self.node.value:
            key = Place(key_node, self.path, self.file)
            if key.text is None:
                raise key.error("keys must be plain words")
            if key.text in pairs:
                first = pairs[key.text][0].node.start_mark.line + 1
                raise key.error(f"duplicate key {describe(key.text)}, first on line {first}")
            path = f"{self.path}.{key.text}".lstrip(".")
            pairs[key.text] = key, Place(value, path, self.file)
        return pairs

    def entries(self) -> list[Place]:
        """Return the values of a list; none if this is no list."""
        nodes = enumerate(self.node.value if self.is_list else (), start=1)
        return [Place(node, f"{self.path}[{i}]", self.file) for i, node in nodes]

    def __getitem__(self, key: str) -> Place:
        """Return the place of a value; this place if the file does not have the value."""
        return self.items().get(key, self)


def parse(text: str, file: str) -> Place:
    """Return the root of one YAML document, see `compose`."""
    return Place(compose(text, file), "", file)


def compose(text: str, file: str) -> yaml.Node:
    """Return the node of one YAML document, with the name of its file in errors.

    Raises:
        InputError: If it is empty or not valid YAML.
    """
    try:
        loader = yaml.BaseLoader(text)
        loader.name = file
        node: yaml.Node | None = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        slips = (slip for found, slip in _FOUND.items() if f"{error.problem}".startswith(found))
        slip = next(slips, error.problem)
        if error.context in _BEGUN:  # seen later, perhaps at the end of the file
            mark, slip = error.context_mark, _BEGUN[error.context]
        problem = f"is not valid YAML: {slip}"
        if error.problem == "but found another document":
            problem = "must be one YAML document; another one begins here"
        if "'\\t'" in f"{error.problem}":
            problem = "has a tab where YAML allows spaces only"
        raise InputError(f"{file}:{mark.line + 1 if mark else 1}: {problem}") from error
    except yaml.reader.ReaderError as error:
        line = text[: int(error.position)].count("\n") + 1
        raise InputError(
            f"{file}:{line}: is not a text file: character {ord(text[error.position]):#x}"
        ) from error
    except RecursionError as error:
        raise InputError(f"{file}: is nested too deeply for a scenario") from error
    if node is None:
        raise InputError(f"{file}: is empty; `radar-sense init` writes one to start from")
    return node
