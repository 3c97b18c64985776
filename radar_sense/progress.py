"""Progress of a computation: reports of the computing code, and a listener that shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeAlias

#: Called with the name of the computation, the steps done, and all steps.
Listener: TypeAlias = Callable[[str, int, int], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def report(what: str, done: int, total: int) -> None:
    """Report the steps done to the listener of this thread; do nothing without a listener."""
    listener = _listener.get()
    if listener is not None:
        listener(what, done, total)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Send all reports of this thread to a listener within the context."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
