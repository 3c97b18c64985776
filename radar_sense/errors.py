"""Errors that are one line, and suggestions for misspelled words."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ScenarioError(ValueError):
    """Bad input, in one line: where it is, what it is, and what is allowed."""


class ComputationError(RuntimeError):
    """A computation that could not be completed, in one line: what happened, and the remedy."""


def printable(text: str) -> str:
    """Return the text with control characters and line breaks escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """Return a suggestion to append to an error, or nothing if no allowed word is close."""
    close = difflib.get_close_matches(word, list(allowed), n=1)
    return f"; did you mean '{close[0]}'?" if close else ""
