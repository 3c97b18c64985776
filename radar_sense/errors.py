"""Errors that are one line, and suggestions for misspelled words."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from radar_sense.units import ascii_unit

#: Letters of the beginning of a word that suggest the word.
_BEGINNING = 3


class InputError(ValueError):
    """Bad input, described in one line: place, value, and what is allowed.

    File names and cells in the line may come from untrusted files. Control characters are escaped,
    because a terminal would execute them.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def printable(text: str) -> str:
    """Return the text with control characters and line breaks escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )


def describe(value: object) -> str:
    """Return a value for an error, at most 40 letters: text in quotes, else as Python writes it."""
    if isinstance(value, str):
        return repr(value if len(value) <= 40 else value[:37] + "...")
    text = " ".join(repr(value).split())
    return text if len(text) <= 40 else text[:37] + "..."


def shorten_list(names: Sequence[str]) -> str:
    """Return the first six names, and the number of the others."""
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return ", ".join(names[:6]) + more


def counted(count: int, noun: str) -> str:
    """Return a number of things, as in "1 radar" and "2 radars"."""
    return f"{count} {noun}{'s' if count != 1 else ''}"


def reason(error: Exception) -> object:
    """Return what an error of the system says, without its number and the name of the file."""
    return getattr(error, "strerror", None) or error


def check_choice(name: str, value: object, allowed: Iterable[str]) -> None:
    """Raise InputError unless a value is one of the allowed words."""
    words = list(allowed)
    if not isinstance(value, str) or value not in words:
        raise InputError(
            f"{name} must be one of {', '.join(words)}, got {describe(value)}"
            + did_you_mean(str(value), words)
        )


def check_has(name: str, value: object, needed: Sequence[str], kind: str, example: str) -> None:
    """Raise InputError unless a value has all that a kind of thing needs."""
    missing = [attribute for attribute in needed if not hasattr(value, attribute)]
    if isinstance(value, type) or len(missing) == len(needed):
        raise InputError(f"{name} must be {kind} such as {example}, got {describe(value)}")
    if missing:
        raise InputError(f"{name} has no {missing[0]}, which {kind} has, got {describe(value)}")


def check_pair(what: str, returned: Any) -> tuple[Any, Any]:
    """Return what a function of a user returns, or raise InputError unless it is a pair."""
    if not isinstance(returned, tuple) or len(returned) != 2:
        raise InputError(
            f"{what} must return a pair, a value and a slope, got {describe(returned)}"
        )
    return returned


class ComputationError(RuntimeError):
    """A computation that could not be completed, described in one line with the remedy."""


class FigureError(RuntimeError):
    """A figure that could not be drawn; table and record were written.

    Attributes:
        paths: The files that were written.
    """

    paths: Sequence[Path] = ()


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """Return a suggestion to append to an error; "" if no allowed word is close.

    Capitals make no difference, and the beginning of one word alone is close to it. The suggestion
    says in which unit, if the word ends with another one.
    """
    known = {name.lower(): name for name in allowed}
    given = word.lower()
    close = [known[name] for name in difflib.get_close_matches(given, list(known), n=1)]
    if not close and len(given) >= _BEGINNING:
        close = [name for low, name in known.items() if low.startswith(given)]
    if len(close) != 1:
        return ""
    other = word.rpartition("_")[2] != close[0].rpartition("_")[2]
    unit = ascii_unit(close[0]) if other else ""
    return f"; did you mean '{close[0]}'{unit and f', in {unit}'}?"
