"""Blocks of work in order, by threads or an executor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def in_order(
    function: Callable[[int], T], count: int, workers: int, executor: Executor | None = None
) -> Iterator[T]:
    """Compute a function of 0 to count − 1 by threads, or an executor, and give it in order."""
    if executor:
        yield from _submitted(executor, function, count, ahead=8 * workers)
    elif workers == 1:
        yield from map(function, range(count))
    else:
        with ThreadPoolExecutor(workers) as threads:
            yield from _submitted(threads, function, count, ahead=2 * workers)


def _submitted(
    executor: Executor, function: Callable[[int], T], count: int, ahead: int
) -> Iterator[T]:
    """Keep a few calls under way, so that memory does not grow with the number of them."""
    waiting: deque[Future[T]] = deque()
    try:
        for index in range(count):
            waiting.append(executor.submit(function, index))
            if len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:  # interrupted: what has not begun is not worth waiting for
        for future in waiting:
            future.cancel()
