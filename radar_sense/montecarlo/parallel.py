"""Tasks computed in their order, by threads or by an executor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import TypeVar

from radar_sense.errors import ComputationError

T = TypeVar("T")


def in_order(
    function: Callable[[int], T], count: int, workers: int, executor: Executor | None = None
) -> Iterator[T]:
    """Yield function(0) to function(count − 1), computed by threads or an executor."""
    try:
        if executor:
            yield from _submitted(executor, function, count, ahead=8 * workers)
        elif workers == 1:
            yield from map(function, range(count))
        else:
            with ThreadPoolExecutor(workers) as threads:
                yield from _submitted(threads, function, count, ahead=workers)
    except MemoryError as error:
        raise ComputationError(
            "out of memory; use fewer workers, or a scenario with fewer poses"
        ) from error


def _submitted(
    executor: Executor, function: Callable[[int], T], count: int, ahead: int
) -> Iterator[T]:
    """Yield results in order; at most `ahead` calls are pending, which bounds the memory."""
    pending: deque[Future[T]] = deque()
    try:
        for index in range(count):
            pending.append(_submit(executor, function, index))
            if len(pending) > ahead:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:  # after an interrupt, calls that have not begun are dropped
        for future in pending:
            future.cancel()


def _submit(executor: Executor, function: Callable[[int], T], index: int) -> Future[T]:
    try:
        return executor.submit(function, index)
    except RuntimeError as error:
        if "thread" not in str(error) and "schedule" not in str(error):
            raise
        raise ComputationError(
            f"no more calls can be started ({error}); use fewer workers, or a running executor"
        ) from error
