"""Scenarios to start from: the files that `radar-sense init` writes."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path

from radar_sense.errors import InputError, check_choice
from radar_sense.limits import MAX_NAME

_PACKAGE = Path(str(resources.files("radar_sense")))
_PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
#: The name of a scenario, and a file that it names outside of comments.
_NAME = re.compile(r"^name: \S+", re.MULTILINE)
_FILE = re.compile(r"^([^#\n]*\bfile: )([\w.-]+)", re.MULTILINE)


def template(kind: str) -> Path:
    """Return the commented scenario of a kind: network, route, data_sheet, or "" for the paper."""
    return _PACKAGE / f"templates/{kind}.yaml" if kind else _PACKAGE / "paper.yaml"


def examples() -> dict[str, Path]:
    """Return the example scenarios by name, from the installed package or the working copy."""
    installed = _PACKAGE / "configs"
    folder = installed if installed.is_dir() else _PACKAGE.parent / "configs"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def example(name: str) -> Path:
    """Return an example scenario.

    Raises:
        InputError: If there is no such example.
    """
    check_choice("--from", name, examples())
    return examples()[name]


def files(source: Path, file: Path) -> dict[str, str]:
    """Return the text of each file of a starter by name: the scenario, and the files it names.

    The source is a template or an example. The file to write gives the scenario its name.

    Raises:
        InputError: If the scenario file has the name of a file that the scenario names.
    """
    text = source.read_text(encoding="utf-8")
    beside = {}

    def own(found: re.Match[str]) -> str:
        name = f"{file.stem}_{found[2].removeprefix(f'{source.stem}_')}"
        beside[name] = (source.parent / found[2]).read_text(encoding="utf-8")
        return found[1] + (name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False))

    text = _FILE.sub(own, text)
    if stem := re.sub(r"[^A-Za-z0-9_.-]", "_", file.stem).lstrip("_.-")[:MAX_NAME]:
        text = _NAME.sub(lambda found: f"name: {stem}".ljust(len(found[0])), text, count=1)
    if file.name in beside:
        raise InputError(f"{file.name} is the name of a file of this scenario; choose another name")
    return {file.name: text, **beside}
