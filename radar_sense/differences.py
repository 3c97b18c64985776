"""What two records say differently: of the scenario, of the numbers, and of the warnings."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

from radar_sense.errors import InputError, describe

#: Version of the keys of the JSON record, see docs/questions/use.md.
RECORD = 1
#: Relative difference of numbers that are equal but for rounding. In a summary, which has
#: probabilities and shares, it is the absolute difference too. An input may be smaller.
ROUNDING = 1e-12
#: Most lines of a section.
MOST_LINES = 60
#: What a record must have, see docs/questions/use.md.
SECTIONS = {"scenario": Mapping, "summary": Mapping, "warnings": list, "analysis": str}


def parsed(text: str, source: str) -> dict[str, Any]:
    """Return the record of an analysis from JSON; `source` names the file in errors."""
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: is not JSON, as the record of an analysis is") from error
    if not isinstance(record, dict) or not all(
        isinstance(record.get(name), kind) for name, kind in SECTIONS.items()
    ):
        raise InputError(f"{source}: is not the JSON record of an analysis")
    if record.get("record") != RECORD:
        raise InputError(
            f"{source}: record must be {RECORD}, the version of the keys, got "
            f"{describe(record.get('record'))}"
        )
    return record


def compared(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return what changed from a record to another of the same analysis, in lines."""
    if old["analysis"] != new["analysis"]:
        raise InputError(
            f"records of {old['analysis']} and {new['analysis']} have no common numbers"
        )
    lines = []
    for title, name in (("scenario", "scenario"), ("numbers", "summary"), ("versions", "versions")):
        changes = [
            f"  {path}: {_shown(one)} -> {_shown(other)}{_by(one, other)}"
            for path, one, other in _changes(
                old.get(name), new.get(name), ROUNDING if name == "summary" else 0.0
            )
        ]
        more = len(changes) - MOST_LINES
        lines += [f"{title}:", *changes[:MOST_LINES]] if changes else []
        lines += [f"  and {more} more"] if more > 0 else []
    warnings = [f"  gone: {text}" for text in old["warnings"] if text not in new["warnings"]]
    warnings += [f"  new: {text}" for text in new["warnings"] if text not in old["warnings"]]
    lines += ["warnings:", *warnings] if warnings else []
    same = f"the two records of {old['analysis']} say the same"
    return lines or [same if _tables(old) == _tables(new) else f"{same}, but their tables differ"]


def _tables(record: Mapping[str, Any]) -> list[str]:
    """Return the digests of the tables of a record."""
    files = record.get("files")
    named = files.items() if isinstance(files, Mapping) else ()
    return [digest for name, digest in named if name.endswith((".csv", ".npz"))]


def _changes(old: Any, new: Any, zero: float, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield path, old and new value of what differs by more than `zero`; None without a value."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys([*old, *new]):
            yield from _changes(old.get(key), new.get(key), zero, f"{path}.{key}".lstrip("."))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (one, other) in enumerate(zip(old, new, strict=True), start=1):
            yield from _changes(one, other, zero, f"{path}[{i}]")
    elif old != new:
        floats = isinstance(old, float) and isinstance(new, float)
        if not (floats and math.isclose(old, new, rel_tol=ROUNDING, abs_tol=zero)):
            yield path, old, new


def _shown(value: Any) -> str:
    """Return a value in a few letters."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return "nothing" if value is None else describe(json.dumps(value)).strip("'")


def _by(old: Any, new: Any) -> str:
    """Return the difference of two numbers."""
    numbers = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in (old, new))
    return f" ({new - old:+.3g})" if numbers else ""
