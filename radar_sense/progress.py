"""Progress of a computation: the computing code reports steps, and one listener shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeAlias

#: Called with the name of the steps, the steps done, and all steps.
Listener: TypeAlias = Callable[[str, int, int], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def report(what: str, done: int, total: int) -> None:
    """Report the steps done to the listener of this thread, if there is one."""
    listener = _listener.get()
    if listener is not None:
        listener(what, done, total)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call a listener with all reports of this thread, within the context."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
