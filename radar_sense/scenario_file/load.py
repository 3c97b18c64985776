"""A scenario file to a `Scenario`."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from radar_sense.errors import InputError, describe
from radar_sense.scenario import Scenario
from radar_sense.scenario_file import declare, sections
from radar_sense.scenario_file.build import build
from radar_sense.scenario_file.changes import changed
from radar_sense.scenario_file.place import Place, parse
from radar_sense.scenario_file.starters import template
from radar_sense.scenario_file.text_file import read_text

#: Largest scenario file. A scenario is a page of text, far smaller than this.
MAX_BYTES = 64 * 1024


def default_text() -> str:
    """Return the text of the embedded scenario, which is the scenario of the paper."""
    return template("").read_text(encoding="utf-8")


def load_scenario(
    path: str | Path | None = None, changes: Mapping[str, Any] | None = None
) -> Scenario:
    """Read and check a scenario file, or the scenario of the paper if no path is given.

    Args:
        path: The file.
        changes: Values in place of those of the file by path of keys, such as
            {"radar.constant": 200}. "" takes a key away.

    Raises:
        InputError: If the file cannot be read or anything in the file is not allowed.
    """
    if path is None:
        return parse_scenario(default_text(), "paper.yaml", changes)
    if {":", "\n"} <= {*str(path)} and not os.path.lexists(path):
        raise InputError("path must be the name of a file; parse_scenario reads text")
    return parse_scenario(read_text(path, "a scenario file", MAX_BYTES), str(path), changes)


def parse_scenario(
    text: str, source: str = "scenario", changes: Mapping[str, Any] | None = None
) -> Scenario:
    """Check the text of a scenario.

    Args:
        text: YAML.
        source: Name of the text in errors. Files that the scenario names are looked for from the
            folder of this name.
        changes: As in `load_scenario`.

    Raises:
        InputError: If anything in the text is not allowed.
    """
    if not isinstance(text, str):
        raise InputError(f"text must be YAML as text, got {describe(text)}")
    if not isinstance(changes, Mapping | None):
        raise InputError(f"changes must be values by key, got {describe(changes)}")
    root = parse(text, source)
    for key, value in (changes or {}).items():
        words = value if isinstance(value, str) else json.dumps(value, default=_plain)
        root = Place(changed(root.node, str(key), words), "", source)
    again = partial(_again, text, source, dict(changes or {}))
    return build(declare.read_file(root, sections.File), again)


def _plain(value: Any) -> Any:
    """Return a number or an array of NumPy as JSON has it, and anything else as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _again(
    text: str, source: str, before: Mapping[str, Any], changes: Mapping[str, Any]
) -> Scenario:
    """Return the scenario of a text with further changes."""
    kept = {key: value for key, value in before.items() if key not in changes}
    return parse_scenario(text, source, {**kept, **changes})  # the later of two changes wins
