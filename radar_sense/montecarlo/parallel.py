"""Tasks computed in their order, by threads or by an executor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, Protocol, TypeVar

from radar_sense.errors import ComputationError

T = TypeVar("T")


class Mergeable(Protocol):
    """Statistics of some runs that can be merged with the statistics of other runs."""

    @property
    def runs(self) -> int:
        """Number of runs."""
        ...

    def merge(self, other: Any, /) -> None:
        """Add the statistics of other runs."""
        ...


S = TypeVar("S", bound=Mergeable)


def merged(
    statistics: Callable[[int], S],
    tasks: int,
    workers: int,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> S:
    """Compute the statistics of tasks 0 to tasks − 1 and merge them in this order.

    Args:
        statistics: Computes the statistics of a task.
        tasks: Number of tasks, at least one.
        workers: Number of threads.
        executor: Computes in place of threads.
        progress: Called with the number of runs of each task that has been merged.
    """
    total: S | None = None
    for part in in_order(statistics, tasks, workers, executor):
        if progress:
            progress(part.runs)
        if total is None:
            total = part
        else:
            total.merge(part)
    assert total is not None
    return total


def in_order(
    function: Callable[[int], T], count: int, workers: int, executor: Executor | None = None
) -> Iterator[T]:
    """Yield function(0) to function(count − 1), computed by threads or an executor.

    Raises:
        ComputationError: If memory or threads run out.
    """
    try:
        if executor:
            yield from _submitted(executor, function, count, ahead=8 * workers)
        elif workers == 1:
            yield from map(function, range(count))
        else:
            with ThreadPoolExecutor(min(workers, count)) as threads:
                yield from _submitted(threads, function, count, ahead=workers)
    except MemoryError as error:
        raise ComputationError(
            "out of memory; use fewer workers, or a scenario with fewer poses"
        ) from error


def all_in_order(
    function: Callable[[int], T],
    count: int,
    workers: int,
    progress: Callable[[int], None] | None = None,
) -> list[T]:
    """Return function(0) to function(count − 1), with a call of progress(1) after each."""
    results = []
    for result in in_order(function, count, workers):
        results.append(result)
        if progress:
            progress(1)
    return results


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
        if "thread" not in str(error):
            raise
        raise ComputationError(
            f"no more threads can be started ({error}); use fewer workers"
        ) from error
