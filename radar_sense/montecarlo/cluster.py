"""Executor of an existing Dask cluster; the only module that imports Dask.

Needs the extra `radar-sense[dask]`, on the workers as well.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import Any
from urllib.parse import urlsplit

from radar_sense.errors import ComputationError, InputError

#: Seconds to wait for a scheduler that does not answer.
TIMEOUT = 5
#: Seconds without a result before a line on the state of the cluster.
PATIENCE = 8
#: Seconds without a scheduler, or without workers, before the computation is given up.
GIVE_UP = 30
#: Loggers of Dask that write tracebacks. This module raises errors of one line instead.
LOGGERS = (
    "distributed",
    "distributed.client",
    "distributed.core",
    "distributed.batched",
    "tornado.application",
)


@contextmanager
def cluster(address: str) -> Iterator[tuple[ClusterExecutor, int]]:
    """Connect to the scheduler of a Dask cluster.

    The scheduler gives the tasks of a lost worker to another worker. If no results arrive, standard
    error gets a line on the state of the cluster.

    Args:
        address: Address of the scheduler, such as tcp://host:8786.

    Yields:
        An executor, and the number of threads of all workers.

    Raises:
        InputError: If Dask is not installed, no scheduler answers, or there are no workers.
        ComputationError: If the cluster is lost while it computes.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError("--dask needs Dask: pip install 'radar-sense[dask]'") from error
    connect: Any = distributed.Client  # which has no types
    with _quiet_loggers():
        try:
            _knock(address)
            client = connect(address, timeout=TIMEOUT, set_as_default=False)
        except (OSError, ValueError, UnicodeError, asyncio.CancelledError) as error:
            raise InputError(
                f"--dask: no Dask scheduler answers at {address!r}, an address is like "
                "tcp://host:8786"
            ) from error
        try:
            threads = sum(client.nthreads().values())
            if not threads:
                raise InputError(f"--dask: the scheduler at {address} has no workers")
            _require_package(client)
            # pure=False gives each task a unique name, in place of a digest of the arguments
            executor = ClusterExecutor(client, client.get_executor(pure=False), address)
            with executor:
                yield executor, threads
        except asyncio.CancelledError as error:  # from Dask, when the scheduler is lost
            raise ComputationError(_lost(address)) from error
        finally:
            with suppress(Exception, asyncio.CancelledError):
                client.close(timeout=TIMEOUT if client.status == "running" else 0)


class ClusterExecutor(Executor):
    """Executor of a Dask client that reports stalls, and loss of the cluster as one line.

    Args:
        client: The Dask client.
        inner: Executor of the client.
        address: Address of the scheduler.
    """

    def __init__(self, client: Any, inner: Executor, address: str) -> None:
        self._client, self._inner, self._address = client, inner, address
        self._pending: set[Future[Any]] = set()
        self._last_result = time.monotonic()
        self._reported = ""
        self._closed = threading.Event()
        self._lock = threading.RLock()
        self._watch = threading.Thread(target=self._watch_until_closed, daemon=True)
        self._watch.start()

    def submit(self, function: Callable[..., Any], /, *args: Any, **options: Any) -> Future[Any]:
        """Submit a call to the cluster."""
        outer: Future[Any] = Future()
        with self._lock:
            if not self._pending:
                self._last_result = time.monotonic()
            self._pending.add(outer)
        try:
            inner = self._inner.submit(function, *args, **options)
        except Exception as error:
            raise ComputationError(f"{_lost(self._address)} ({type(error).__name__})") from error
        inner.add_done_callback(lambda done: self._finish(done, outer))
        return outer

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop watching. Closing the client drops the calls that have not begun."""
        self._closed.set()

    def _finish(self, inner: Future[Any], outer: Future[Any]) -> None:
        """Copy the result or the error of a call to the future that `submit` returned."""
        with self._lock:
            self._pending.discard(outer)
            self._last_result, self._reported = time.monotonic(), ""
            if outer.done():
                return
            error: BaseException | None
            try:
                error = inner.exception()
            except (CancelledError, asyncio.CancelledError) as cancelled:
                error = cancelled
            if error is None:
                outer.set_result(inner.result())
            else:
                outer.set_exception(_explained(error, self._address))

    def _watch_until_closed(self) -> None:
        while not self._closed.wait(1.0):
            self.check(time.monotonic())

    def check(self, now: float) -> None:
        """Report a stall of PATIENCE, and give up after GIVE_UP without scheduler or workers.

        Args:
            now: Present time by `time.monotonic`.
        """
        with self._lock:
            stalled = now - self._last_result
            if not self._pending or stalled < PATIENCE:
                return
            state, hopeless = self._state()
            if hopeless and stalled >= GIVE_UP:
                for future in list(self._pending):
                    if not future.done():
                        future.set_exception(
                            ComputationError(f"given up after {GIVE_UP} s: {state}")
                        )
                self._pending.clear()
            elif state != self._reported:
                self._reported = state
                print(f"No results for {stalled:.0f} s: {state}", file=sys.stderr, flush=True)

    def _state(self) -> tuple[str, bool]:
        """Return the state of the cluster in words, and whether no worker computes."""
        if self._client.status != "running":
            return f"the Dask scheduler at {self._address} does not answer", True
        # The client's copy of the list needs no answer from the scheduler.
        workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        if not workers:
            return f"the Dask scheduler at {self._address} has no workers", True
        return f"waiting for {len(self._pending)} tasks on {workers} workers", False


def _knock(address: str) -> None:
    """Raise OSError or ValueError unless a Dask scheduler seems to listen at an address.

    A scheduler sends the first byte, and a web server does not. A Dask client would need a minute
    to refuse a web server, and prints tracebacks if there is no server.
    """
    parts = urlsplit(address)
    if parts.scheme != "tcp":
        raise ValueError(f"scheme {parts.scheme!r} is not tcp")
    with socket.create_connection((parts.hostname, parts.port or 8786), TIMEOUT) as connection:
        if not connection.recv(1):
            raise ConnectionError("closed without a word")


def _require_package(client: Any) -> None:
    """Raise InputError if a worker lacks the package, because it would crash at the first task."""
    specs = client.run(find_spec, "radar_sense", on_error="return")
    lacking = [worker for worker, spec in specs.items() if spec is None]
    if lacking:
        raise InputError(
            f"--dask: {len(lacking)} of {len(specs)} workers, such as {lacking[0]}, cannot load "
            "radar_sense; pip install 'radar-sense[dask]' there, the same version as here"
        )


def _lost(address: str) -> str:
    return f"the Dask scheduler at {address} is gone; start it again, or compute without --dask"


def _explained(error: BaseException, address: str) -> BaseException:
    """Return the error of a call, as one line if the cluster is the cause."""
    name = type(error).__name__
    if (
        isinstance(error, (CancelledError, asyncio.CancelledError))
        or name == "FutureCancelledError"
    ):
        return ComputationError(_lost(address))
    if isinstance(error, ImportError) or "deserializ" in str(error).lower():
        return ComputationError(
            f"a Dask worker or the scheduler cannot load radar_sense ({name}: {error}); "
            "pip install 'radar-sense[dask]' there, the same version as here"
        )
    if name == "KilledWorker":
        return ComputationError(
            "several Dask workers died over the same task; their memory may be too small"
        )
    return error


@contextmanager
def _quiet_loggers() -> Iterator[None]:
    """Silence Dask's own messages."""
    loggers = [logging.getLogger(name) for name in LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
