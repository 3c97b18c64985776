"""What the user can put right: the error, and the suggestion that goes with it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ScenarioError(ValueError):
    """Bad input, told in one line: where it is, what it says, and what is allowed."""


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """Return a suggestion to append to an error, or nothing if no allowed word is close."""
    close = difflib.get_close_matches(word, list(allowed), n=1)
    return f"; did you mean '{close[0]}'?" if close else ""
