"""Scenarios to start from: the files that `radar-sense init` writes."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path

from radar_sense import schema
from radar_sense.reading.parse import default_text

#: The route of the starter, as its scenario names it.
_ROUTE = "route.csv"
_PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def starter_text(kind: str) -> str:
    """Return the text of a commented scenario.

    Args:
        kind: "network", "route", "data_sheet", or "" for the scenario of the paper.
    """
    return _template(f"{kind}.yaml") if kind else default_text()


def starter_files(kind: str, file: Path) -> dict[str, bytes]:
    """Return the files of a starter by name: the scenario, its schema, its route.

    Args:
        kind: "network", "route", "data_sheet", or "" for the scenario of the paper.
        file: The scenario file. The other files are for the folder of this file.

    Raises:
        ValueError: If the scenario file would have the name of the schema.
    """
    if file.name == schema.FILE_NAME:
        raise ValueError(f"{file.name} is the name of the schema; choose another name")
    text = schema.MODELINE + starter_text(kind)
    files = {file.name: text.encode()}
    if kind == "route":
        route = f"{file.stem}_{_ROUTE}"
        quoted = route if _PLAIN.fullmatch(route) else json.dumps(route, ensure_ascii=False)
        files[file.name] = text.replace(f"file: {_ROUTE}", f"file: {quoted}").encode()
        files[route] = _template(_ROUTE).encode()
    files[schema.FILE_NAME] = schema.text().encode()
    return files


def is_old_schema(path: Path) -> bool:
    """Return whether a file is the schema beside a scenario, as some version has written it."""
    if path.name != schema.FILE_NAME:
        return False
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("title") == schema.TITLE


def _template(name: str) -> str:
    folder = resources.files("radar_sense").joinpath("templates")
    return folder.joinpath(name).read_text(encoding="utf-8")
