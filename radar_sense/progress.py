"""Progress of a computation, reported by whoever computes and shown by whoever listens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeAlias

#: Called with what is computed, how much of it is done, and how much there is.
Listener: TypeAlias = Callable[[str, int, int], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def report(what: str, done: int, total: int) -> None:
    """Tell the listener of this thread, if there is one, how far a computation is."""
    listener = _listener.get()
    if listener is not None:
        listener(what, done, total)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Let a listener hear all reports of this thread within the context."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
