"""Values that are set by path of keys, in place of those of a scenario file.

`radar.constant` is a key of a section, `radars.ridge.p_fa` one of a radar by name, and
`radar.position_m[3]` the third value of a list.
"""

from __future__ import annotations

import copy
import re

import yaml

from radar_sense.errors import InputError, describe, did_you_mean
from radar_sense.scenario_file.place import NO_TAG, compose

_PART = re.compile(r"[^.\[\]]+|\[[0-9]{1,4}\]")
_PATH = re.compile(r"[^.\[\]]+(\.[^.\[\]]+|\[[0-9]{1,4}\])*")


def changed(root: yaml.Node, path: str, value: str) -> yaml.Node:
    """Return a document with another value, or without one.

    The document itself stays as it is: an anchor of the file and its aliases are one node, of which
    only one place is to change.

    The value is YAML, and "" takes the key away.

    Raises:
        InputError: If the path is none or leads nowhere, or the value is not valid YAML.
    """
    option = f"{path}={value}"
    if not _PATH.fullmatch(path):
        raise InputError(f"{option}: write a key before the =, such as radar.p_fa=1e-6")
    try:
        new = compose(value or "{}", option)
    except InputError as error:
        raise InputError(f"{option}: is not valid YAML") from error

    def below(node: yaml.Node, part: str, *parts: str) -> yaml.Node:
        """Return a node with the change at the end of some parts of the path."""
        if isinstance(node, yaml.SequenceNode):
            place, items = _entry(node, part, option), [(key_of(part), e) for e in node.value]
        elif isinstance(node, yaml.MappingNode):
            keys, items = [key.value for key, _ in node.value], node.value
            place = keys.index(part) if part in keys else len(keys)
        else:
            raise InputError(f"{option}: {describe(str(node.value))} has no key {part!r}")
        found = items[place : place + 1]
        if parts:
            empty = yaml.MappingNode(NO_TAG[yaml.MappingNode], [], new.start_mark)
            key, child = found[0] if found else (key_of(part), empty)
            put = [(key, below(child, *parts))]
        elif value or found:
            put = [(key_of(part), new)] if value else []
        else:
            raise InputError(f"{option}: there is no {path} to take away")
        copied = copy.copy(node)
        items = [*items[:place], *put, *items[place + 1 :]]
        is_list = isinstance(node, yaml.SequenceNode)
        copied.value = [entry for _, entry in items] if is_list else items
        return copied

    def key_of(part: str) -> yaml.Node:
        return yaml.ScalarNode(NO_TAG[yaml.ScalarNode], part, new.start_mark)

    return below(root, *_PART.findall(path))


def _entry(node: yaml.SequenceNode, part: str, option: str) -> int:
    """Return the number of an entry of a list, by its place from 1 or by its name."""
    names = []
    for entry in node.value:
        pairs = entry.value if isinstance(entry, yaml.MappingNode) else ()
        found = (v.value for k, v in pairs if k.value == "name" and isinstance(v, yaml.ScalarNode))
        names.append(next(found, ""))
    if part in names:
        return names.index(part)
    number = int(part[1:-1]) - 1 if part.startswith("[") else -1
    if not 0 <= number < len(names):
        known = ", ".join(name or f"[{i}]" for i, name in enumerate(names, start=1))
        hint = did_you_mean(part, filter(None, names))
        raise InputError(f"{option}: the list has no entry {part}, it has {known}{hint}")
    return number
