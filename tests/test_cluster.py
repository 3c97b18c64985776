"""Monte Carlo on a real Dask cluster: two worker processes, one of which is lost on the way."""

import os
import signal
import sys

import pytest
from scenarios import scenario

from radar_sense.errors import ScenarioError
from radar_sense.montecarlo.cluster import cluster
from radar_sense.montecarlo.montecarlo import monte_carlo

RUNS = 20_000


@pytest.fixture(scope="module")
def two_workers():
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as local:
        yield local


def assert_same(one, other):
    for name in ("mean", "std", "lower", "upper", "inside", "hairs"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert (one.clipped, one.rank_error) == (other.clipped, other.rank_error)


@pytest.mark.filterwarnings("ignore")  # of Dask's, about a worker that is gone
@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_a_cluster_gives_the_same_bytes_even_if_a_worker_is_killed(two_workers, sampler):
    s = scenario()
    here = monte_carlo(s, runs=RUNS, sampler=sampler)
    came_in = []

    def kill_one(runs):
        came_in.append(runs)
        if len(came_in) == 5:
            os.kill(next(iter(two_workers.workers.values())).pid, signal.SIGKILL)

    with cluster(two_workers.scheduler_address) as (executor, threads):
        there = monte_carlo(
            s, runs=RUNS, sampler=sampler, workers=threads, executor=executor, progress=kill_one
        )
    assert threads == 2
    assert len(came_in) > 50
    assert_same(here, there)


def test_the_option_computes_on_the_cluster(two_workers, tmp_path):
    from click.testing import CliRunner

    from radar_sense.cli import cli

    tables = []
    for options in ([], ["--dask", two_workers.scheduler_address]):
        out = tmp_path / str(len(options))
        args = ["montecarlo", "--runs", "2000", "--no-plot", "-q", "--out", str(out), *options]
        assert CliRunner().invoke(cli, args).exit_code == 0
        tables.append((out / "paper_montecarlo.csv").read_bytes())
    assert tables[0] == tables[1]


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:1", "nonsense", "", "tcp://127.0.0.1:none", "tcp://no.invalid:1"]
)
def test_an_address_where_nobody_is_gives_one_line(address):
    with (
        pytest.raises(ScenarioError, match=r"^--dask: no Dask scheduler answers at '.*tcp://host"),
        cluster(address),
    ):
        pass


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ScenarioError, match=r"pip install 'radar-sense\[dask\]'"), cluster("x"):
        pass
