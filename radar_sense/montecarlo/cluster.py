"""Executor of an existing Dask cluster; the only module that imports Dask."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any
from urllib.parse import urlsplit

from radar_sense.errors import ComputationError, InputError

#: Seconds to wait for a scheduler.
TIMEOUT = 5
#: Loggers of Dask that write tracebacks.
_LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application")
_EXTRA = "pip install 'radar-sense[dask]'"


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Yield an executor on a Dask cluster, and the number of threads of its workers."""
    try:
        import distributed
    except ImportError as error:
        raise InputError(f"--dask needs Dask: {_EXTRA}") from error
    connect: Any = distributed.Client  # has no types
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        _require_scheduler(address)
        with connect(address, timeout=TIMEOUT, set_as_default=False) as client:
            specs, threads = client.run(find_spec, "radar_sense"), client.nthreads()
            if not threads:
                raise InputError(f"--dask {address}: the cluster has no workers")
            if None in specs.values():
                raise InputError(f"--dask {address}: a worker lacks radar_sense; {_EXTRA} there")
            # pure=False names each task uniquely, in place of a digest of its arguments
            yield client.get_executor(pure=False), sum(threads.values())
    except (CancelledError, asyncio.CancelledError, distributed.KilledWorker) as error:
        raise ComputationError(f"--dask {address}: the cluster is lost; start it again") from error
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _require_scheduler(address: str) -> None:
    """Raise InputError unless a Dask scheduler seems to listen, which sends the first byte."""
    try:  # a Dask client would need a minute, and print tracebacks
        parts = urlsplit(address)
        with socket.create_connection((parts.hostname, parts.port), TIMEOUT) as connection:
            if address != f"tcp://{parts.netloc}" or not connection.recv(1):
                raise ConnectionError
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--dask: no Dask scheduler answers at {address!r}, an address is like tcp://host:8786"
        ) from error
