"""Monte Carlo on a real Dask cluster, and the errors where there is none."""

import socket
import sys
import threading
from concurrent.futures import CancelledError
from contextlib import suppress

import pytest
from click.testing import CliRunner
from helpers import scenario

from radar_sense.cli import cli
from radar_sense.errors import ComputationError, InputError
from radar_sense.montecarlo.cluster import cluster
from radar_sense.montecarlo.montecarlo import monte_carlo


@pytest.fixture(scope="module")
def address():
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=2, processes=True, dashboard_address=":0", silence_logs=50
    ) as local:
        yield local.scheduler_address


@pytest.mark.usefixtures("quick")
def test_a_cluster_gives_the_same_bytes(address, tmp_path):
    some = scenario(geometry__azimuth_deg__step=15)
    here = monte_carlo(some, runs=2000)
    with cluster(address) as (executor, threads):
        there = monte_carlo(some, runs=2000, workers=threads, executor=executor)
    assert threads == 2
    for name in ("mean", "std", "lower", "upper", "inside", "sample_paths"):
        assert getattr(here, name).tobytes() == getattr(there, name).tobytes(), name

    tables = []
    for options in ([], ["--dask", address]):
        out = tmp_path / str(len(options))
        args = ["montecarlo", "--runs", "600", "--no-plot", "-q", "--out", str(out), *options]
        assert CliRunner().invoke(cli, args).exit_code == 0
        tables.append((out / "paper_montecarlo.csv").read_bytes())
    assert tables[0] == tables[1]


def test_a_cluster_that_is_lost_is_one_line(address):
    says = rf"^--dask {address}: the cluster is lost; start it again$"
    with pytest.raises(ComputationError, match=says), cluster(address):
        raise CancelledError


def test_other_errors_stay_themselves(address):
    with pytest.raises(ZeroDivisionError), cluster(address) as (executor, _):
        executor.submit(divmod, 1, 0).result()


def test_a_cluster_without_workers_is_refused():
    from distributed import LocalCluster

    says = r"^--dask tcp://[\d.:]+: the cluster has no workers$"
    with (
        LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as local,
        pytest.raises(InputError, match=says),
        cluster(local.scheduler_address),
    ):
        pass


NOBODY = r"^--dask: no Dask scheduler answers at '.*', an address is like tcp://host:8786$"


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:1", "nonsense", "", "tcp://127.0.0.1:none", "tls://127.0.0.1:8786"]
)
def test_an_address_where_nobody_is_gives_one_line(address):
    with pytest.raises(InputError, match=NOBODY), cluster(address):
        pass


@pytest.mark.parametrize(("more", "answer"), [("", b""), ("/x", b"x"), ("?a=1", b"x")])
def test_a_server_that_is_no_scheduler_gives_one_line(more, answer):
    """It closes the connection; an address with a path would end in a traceback of Dask."""

    def serve():
        with suppress(OSError), server.accept()[0] as connection:  # the other side may be gone
            connection.sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}{more}"
        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(InputError, match=NOBODY), cluster(address):
            pass


def test_without_the_extra_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'radar-sense\[dask\]'"), cluster("x"):
        pass
