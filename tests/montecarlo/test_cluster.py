"""Monte Carlo on a real Dask cluster that loses a worker, and on fake clusters that fail."""

import logging
import os
import signal
import socket
import sys
import threading
import time
from concurrent.futures import CancelledError, Executor, Future
from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from helpers import scenario

from radar_sense.errors import ComputationError, ScenarioError
from radar_sense.montecarlo import cluster as module
from radar_sense.montecarlo.cluster import cluster
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.parallel import in_order

RUNS = 8_000
ADDRESS = "tcp://host:8786"


@pytest.fixture(scope="module")
def two_workers():
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as local:
        yield local


@pytest.mark.filterwarnings("ignore")  # of Dask's, about a worker that is gone
def test_a_cluster_gives_the_same_bytes_even_if_a_worker_is_killed(two_workers, tmp_path):
    s = scenario()
    here = monte_carlo(s, runs=RUNS)
    came_in = []

    def kill_one(runs):
        came_in.append(runs)
        if len(came_in) == 5:
            os.kill(next(iter(two_workers.workers.values())).pid, signal.SIGKILL)

    with cluster(two_workers.scheduler_address) as (executor, threads):
        there = monte_carlo(s, runs=RUNS, workers=threads, executor=executor, progress=kill_one)
    assert threads == 2
    assert len(came_in) > 25
    for name in ("mean", "std", "lower", "upper", "inside", "sample_paths"):
        assert getattr(here, name).tobytes() == getattr(there, name).tobytes(), name
    assert here.clipped == there.clipped
    assert len(there.rounding_digests) == 1

    from click.testing import CliRunner

    from radar_sense.cli import cli

    tables = []
    for options in ([], ["--dask", two_workers.scheduler_address]):
        out = tmp_path / str(len(options))
        args = ["montecarlo", "--runs", "600", "--no-plot", "-q", "--out", str(out), *options]
        assert CliRunner().invoke(cli, args).exit_code == 0
        tables.append((out / "paper_montecarlo.csv").read_bytes())
    assert tables[0] == tables[1]


NOBODY = r"^--dask: no Dask scheduler answers at '.*' *, an address is like tcp://host:8786$"


@pytest.mark.parametrize(
    "address",
    [
        "tcp://127.0.0.1:1",
        "nonsense",
        "",
        "tcp://127.0.0.1:none",
        "tcp://no.invalid:1",
        "http://127.0.0.1:8786",
        "tls://127.0.0.1:8786",
    ],
)
def test_an_address_where_nobody_is_gives_one_line(address):
    with pytest.raises(ScenarioError, match=NOBODY), cluster(address):
        pass


def test_a_server_of_another_kind_gives_one_line(monkeypatch):
    """A web server sends nothing first. Other servers close the connection."""
    monkeypatch.setattr(module, "TIMEOUT", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(ScenarioError, match=NOBODY), cluster(address):
            pass
    monkeypatch.setattr(module, "TIMEOUT", 5)
    with socket.create_server(("127.0.0.1", 0)) as closing:
        address = f"tcp://127.0.0.1:{closing.getsockname()[1]}"
        threading.Thread(target=lambda: closing.accept()[0].close(), daemon=True).start()
        with pytest.raises(ScenarioError, match=NOBODY), cluster(address):
            pass


def test_without_the_extra_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ScenarioError, match=r"pip install 'radar-sense\[dask\]'"), cluster("x"):
        pass


class Inner(Executor):
    """An executor whose futures the test completes."""

    def __init__(self):
        self.futures = []

    def submit(self, function, /, *args):
        self.futures.append(Future())
        return self.futures[-1]


class FakeClient:
    """A fake client of a cluster."""

    def __init__(self, threads=1, spec="found"):
        self.status, self.workers, self.inner = "running", {"w": threads}, Inner()
        self.threads, self.spec, self.closed = threads, spec, False

    def nthreads(self):
        return {"w": self.threads} if self.threads else {}

    def run(self, function, *args, on_error):
        return {"tcp://w:1": self.spec}

    def scheduler_info(self, n_workers):
        return {"workers": self.workers}

    def get_executor(self, pure):
        return self.inner

    def close(self, timeout):
        self.closed = True


@pytest.fixture
def connected(monkeypatch):
    """Connect to a fake client at an address where a fake server sends a byte."""

    def connect(client):
        fake = SimpleNamespace(Client=lambda *_, **__: client)
        monkeypatch.setitem(sys.modules, "distributed", fake)
        server = nullcontext(SimpleNamespace(recv=bytes))
        monkeypatch.setattr(socket, "create_connection", lambda *_: server)
        return client

    return connect


@pytest.mark.parametrize(
    ("client", "says"),
    [
        ({"threads": 0}, "^--dask: the scheduler at tcp://host:8786 has no workers$"),
        ({"spec": None}, r"^--dask: 1 of 1 workers, such as tcp://w:1, cannot load radar_sense; "),
    ],
)
def test_a_cluster_that_cannot_compute_is_refused_at_once(connected, client, says):
    fake = connected(FakeClient(**client))
    with pytest.raises(ScenarioError, match=says), cluster(ADDRESS):
        pass
    assert fake.closed


def test_a_stall_is_told_within_ten_seconds_and_given_up_without_workers(
    connected, monkeypatch, capsys
):
    start = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: start)
    fake = connected(FakeClient())

    def lines():
        return capsys.readouterr().err.splitlines()

    with cluster(ADDRESS) as (executor, _):
        executor.check(1e9)
        assert lines() == []  # nothing is waited for
        future = executor.submit(abs, -1)
        executor.check(start + 7)
        assert lines() == []
        for seconds in (9, 10, 1000):  # slow tasks are no reason to give up
            executor.check(start + seconds)
        assert lines() == ["No results for 9 s: waiting for 1 tasks on 1 workers"]
        fake.workers = {}
        executor.check(start + 20)
        fake.status = "connecting"
        executor.check(start + 25)
        assert lines() == [
            "No results for 20 s: the Dask scheduler at tcp://host:8786 has no workers",
            "No results for 25 s: the Dask scheduler at tcp://host:8786 does not answer",
        ]
        assert not future.done()
        executor.check(start + module.GIVE_UP)
        with pytest.raises(ComputationError, match=r"^given up after 30 s: .* does not answer$"):
            future.result(timeout=0)
        fake.inner.futures[0].set_result(1)  # too late, and no error


class KilledWorker(Exception):  # noqa: N818 - the name of Dask
    """An error with the name of Dask's error."""


@pytest.mark.parametrize(
    ("error", "raised", "says"),
    [
        (CancelledError(), ComputationError, "^the Dask scheduler at tcp://host:8786 is gone; "),
        (KilledWorker("x"), ComputationError, "^several Dask workers died over the same task"),
        (ModuleNotFoundError("no x"), ComputationError, r"cannot load radar_sense \(.*no x\); pip"),
        (MemoryError(), ComputationError, "^out of memory; use fewer"),
        (ZeroDivisionError("a bug"), ZeroDivisionError, "^a bug$"),
    ],
)
def test_the_loss_of_a_cluster_is_one_line(connected, error, raised, says):
    fake = connected(FakeClient())
    with pytest.raises(raised, match=says) as caught, cluster(ADDRESS) as (executor, _):  # noqa: PT012
        results = in_order(abs, 3, 1, executor)
        submit = fake.inner.submit

        def fail(*args):
            future = submit(*args)
            future.set_exception(error)
            return future

        fake.inner.submit = fail
        list(results)
    assert "\n" not in str(caught.value)
    assert fake.closed


def test_an_interrupt_stays_one_and_closes_the_client(connected):
    fake = connected(FakeClient())

    def raise_cancelled(timeout):
        fake.closed = True
        raise CancelledError

    fake.close = raise_cancelled
    before = [logging.getLogger(name).level for name in module.LOGGERS]
    with pytest.raises(KeyboardInterrupt), cluster(ADDRESS):  # noqa: PT012
        assert not logging.getLogger("distributed.client").isEnabledFor(logging.CRITICAL)
        raise KeyboardInterrupt
    assert fake.closed
    assert before == [logging.getLogger(name).level for name in module.LOGGERS]


def test_every_result_belongs_to_its_call(connected):
    fake = connected(FakeClient(threads=2))
    with cluster(ADDRESS) as (executor, threads):
        assert threads == 2
        one, other = (executor.submit(abs, -n) for n in (1, 2))
        fake.inner.futures[1].set_result(2)
        assert (one.done(), other.result(timeout=0)) == (False, 2)
