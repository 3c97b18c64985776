"""Values that are set by path of keys, in place of those of a scenario file.

`radar.constant` is a key of a section, `radars.ridge.p_fa` one of a radar by name, and
`radar.position_m[3]` the third value of a list.
"""

from __future__ import annotations

import re

import yaml

from radar_sense.errors import InputError, shorten
from radar_sense.scenario_file.place import NO_TAG, compose

_PART = re.compile(r"[^.\[\]]+|\[[0-9]{1,4}\]")
_PATH = re.compile(r"[^.\[\]]+(\.[^.\[\]]+|\[[0-9]{1,4}\])*")


def change(root: yaml.Node, path: str, value: str) -> None:
    """Set a value below a node, or take it away.

    Args:
        root: The node, which is changed.
        path: Path of keys.
        value: The value as YAML; "" takes the key away.

    Raises:
        InputError: If the path is none or leads nowhere, or the value is not valid YAML.
    """
    option = f"--set {path}={value}"
    if not _PATH.fullmatch(path):
        raise InputError(f"{option}: write a key before the =, such as radar.p_fa=1e-6")
    try:
        new = compose(value or "{}", option)
    except InputError as error:
        raise InputError(f"{option}: is not valid YAML") from error
    node, parts = root, _PART.findall(path)
    for number, part in enumerate(parts, start=1):
        if isinstance(node, yaml.SequenceNode):
            place = _entry(node, part, option)
        elif isinstance(node, yaml.MappingNode):
            keys = [key.value for key, _ in node.value]
            place = keys.index(part) if part in keys else len(keys)
        else:
            raise InputError(f"{option}: {shorten(str(node.value))} has no key {part!r}")
        ends, found = number == len(parts), node.value[place : place + 1]
        if ends and not value and not found:
            raise InputError(f"{option}: there is no {path} to take away")
        if ends or not found:
            below = new if ends else yaml.MappingNode(NO_TAG[yaml.MappingNode], [], new.start_mark)
            key = yaml.ScalarNode(NO_TAG[yaml.ScalarNode], part, new.start_mark)
            pair = below if isinstance(node, yaml.SequenceNode) else (key, below)
            node.value[place : place + 1] = [] if ends and not value else [pair]
            found = [pair]
        node = found[0] if isinstance(node, yaml.SequenceNode) else found[0][1]


def _entry(node: yaml.SequenceNode, part: str, option: str) -> int:
    """Return the number of an entry of a list, by its place from 1 or by its name."""
    names = [
        next((value.value for key, value in entry.value if key.value == "name"), "")
        if isinstance(entry, yaml.MappingNode)
        else ""
        for entry in node.value
    ]
    if part in names:
        return names.index(part)
    number = int(part[1:-1]) - 1 if part.startswith("[") else -1
    if not 0 <= number < len(names):
        known = ", ".join(name or f"[{i}]" for i, name in enumerate(names, start=1))
        raise InputError(f"{option}: the list has no entry {part}, it has {known}")
    return number
