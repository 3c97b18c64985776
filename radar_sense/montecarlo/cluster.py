"""Computing on an existing Dask cluster; nothing else in the package knows of Dask.

Needs the extra `radar-sense[dask]`, on the workers as well.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from radar_sense.errors import ScenarioError

#: Seconds to wait for a scheduler that does not answer.
TIMEOUT = 5


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Connect to the scheduler of a Dask cluster.

    A worker that is lost makes no difference: the scheduler gives its tasks to another one.

    Args:
        address: Where it listens, such as tcp://host:8786.

    Yields:
        An executor, and the number of threads that all workers have together.

    Raises:
        ScenarioError: If Dask is not installed, nobody answers, or there are no workers.
    """
    try:
        import distributed
    except ImportError as error:
        raise ScenarioError(
            "--dask needs more to be installed: pip install 'radar-sense[dask]'"
        ) from error
    connect: Any = distributed.Client  # which has no types
    try:
        # Knock first: a client that finds nobody complains once more when it is cleared away.
        parts = urlsplit(address)
        socket.create_connection((parts.hostname, parts.port or 8786), TIMEOUT).close()
        client = connect(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, UnicodeError) as error:
        raise ScenarioError(
            f"--dask: no Dask scheduler answers at {address!r}, an address is like tcp://host:8786"
        ) from error
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise ScenarioError(f"--dask: the scheduler at {address} has no workers")
        # pure=False: a task is known by a name of its own, not by a digest of all that it is given
        yield client.get_executor(pure=False), threads
