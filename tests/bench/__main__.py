"""`make bench`: how fast the package is, each figure as a ratio to a peer run beside it.

Calls of the package and of the peer take turns in one process, and medians are compared. Results
are compared first: a peer computes the same. A missed ratio is named in the last column.
"""

import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from functools import partial
from importlib import metadata, util
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests have peers too
# A second thread of BLAS spins while it waits, and would count as CPU time.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import peers
from chain_rule import linearize as chain_rule
from helpers import scenario
from scipy.special import ndtr

import radar_sense as rs
from radar_sense.propagation import METHODS, propagate_scenario
from radar_sense.uncertain_states import uncertain_states

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]

P_FA = 1.7e-4
TAIL = float(ndtr(-3.0))
POSES = 300_000
RUNS = 20_000
#: What several workers share: enough for them not to wait for the last of them.
MORE_RUNS = 100_000
#: The NumPy transcriptions hold all draws at once, and some 0.4 kB a sample beside them.
FEWER_RUNS = 6_000

#: The RCS models: class of the package, tuple of the peers, and keys of a scenario file.
RCS = {
    "ellipsoid": (
        rs.EllipsoidRCS(a=0.15, b=0.13, c=0.21),
        ("ellipsoid", 0.15, 0.13, 0.21),
        {"model": "ellipsoid", "a_m": 0.15, "b_m": 0.13, "c_m": 0.21},
    ),
    "spikeball": (
        rs.SpikeballRCS(lobes=4, amplitude=0.18, floor=0.1),
        ("spikeball", 4, 0.18, 0.1),
        {"model": "spikeball", "lobes": 4, "amplitude_m2": 0.18, "floor_m2": 0.1},
    ),
    "constant": (
        rs.ConstantRCS(rcs=0.2),
        ("constant", 0.2),
        {"model": "constant", "rcs_m2": 0.2},
    ),
}


def main():
    heading()
    workers()  # before JAX is there, beside which threads of Python wait longer
    with one_core():
        for kind in RCS:
            linearization(kind)
        for kind in RCS:
            monte_carlo(kind)
        integration()
        propagation()
        networks()
        whole_path()
        print(
            "\n* does not turn to the body frame; the compiler sees that a constant needs no aspect"
        )
    door()


def heading():
    found = [f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "matplotlib")]
    for name in ("numba", "jax"):
        if util.find_spec(name):
            found.append(f"{name} {metadata.version(name)}")
        else:
            print(f"{name} is not installed here: its rows are left out")
    print(f"{cpu()}, {len(cores())} cores; Python {platform.python_version()}, {', '.join(found)}")
    print(f"\n{'':50}{'ours':>10}{'peer':>10}    ratio            wanted")


def title(text):
    print(f"\n{text}")


def row(what, times, count, unit, *, faster=None, longer=None):
    """Print one row of the table.

    Args:
        what: What is compared.
        times: Ours and the peer's [s].
        count: What the times are divided by.
        unit: Unit of the outcome, "ns" or "ms".
        faster: Wanted speed, as a multiple of the peer's; or
        longer: longest time, as a multiple of the peer's.
    """
    scale = {"ns": 1e9, "ms": 1e3}[unit] / count
    ours, peer = times
    if faster is not None:
        ratio, wanted, holds = f"{peer / ours:.2f}x faster", f">= {faster:g}", peer / ours >= faster
    else:
        ratio, wanted, holds = (
            f"{ours / peer:.2f}x the time",
            f"<= {longer:g}",
            ours / peer <= longer,
        )
    print(
        f"  {what:48}{ours * scale:7.1f} {unit}{peer * scale:7.1f} {unit}    {ratio:16} {wanted:8}"
        f"{'yes' if holds else 'MISSED'}",
        flush=True,
    )


def interleaved(*functions, rounds=5, clock=time.process_time):
    """Median CPU time [s], or time by another clock, of each of some functions that take turns.

    Each function is called twice in its turn, and the second call is timed. The first call gets
    back the memory that another function has released.
    """
    times = [[] for _ in functions]
    for _ in range(rounds):
        for function, found in zip(functions, times, strict=True):
            function()
            start = clock()
            function()
            found.append(clock() - start)
    return [statistics.median(found) for found in times]


def linearization(kind):
    rcs, plain, _ = RCS[kind]
    title(f"P_D and all ten partials of {POSES:,} random poses, {kind} RCS, one core; per pose")
    aircraft, radar = random_poses(np.random.default_rng(1))
    ours = partial(rs.DetectionModel(rcs=rcs, p_fa=P_FA).linearize, aircraft, radar)
    lin = ours()
    expected = lin.p_d, lin.jac_aircraft, lin.jac_radar

    peer = partial(chain_rule, aircraft, radar, plain, P_FA)
    same(expected, peer())
    row("the paper's chain rule in NumPy", interleaved(ours, peer), POSES, "ns", faster=6)
    if util.find_spec("jax"):
        compiled, to_device = peers.jax_linearize(plain, P_FA)
        peer = partial(compiled, to_device(aircraft), to_device(radar))
        p_d, gradient = peer()
        same(expected, (p_d, *gradient))
        note = " *" if kind == "constant" else ""
        row(f"reverse-mode JAX{note}", interleaved(ours, peer), POSES, "ns", faster=5)


def random_poses(rng):
    """Aircraft 300 to 800 km away in any attitude, and the radar and its constant as they come."""
    azimuth, radius = rng.uniform(-np.pi, np.pi, POSES), rng.uniform(300e3, 800e3, POSES)
    down = rng.uniform(-15e3, -1e3, POSES)
    position = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), down], axis=1)
    attitude = rng.uniform(-1, 1, (POSES, 3)) * [np.pi, np.pi / 2, np.pi]
    radar = np.column_stack([rng.normal(0, 1e3, (POSES, 3)), rng.uniform(100, 200, POSES)])
    return np.hstack([position, attitude]), radar


def same(ours, theirs):
    """Insist that P_D and every partial agree to 1e-9 of the largest of its kind."""
    for a, b in zip(ours, theirs, strict=True):
        assert np.all(np.abs(a - b) <= 1e-9 * np.abs(a).max(axis=0))


def monte_carlo(kind):
    _, plain, document = RCS[kind]
    title(f"Monte Carlo over 361 poses, {kind} RCS, one core; per sample")
    case = scenario(aircraft__rcs=document)
    nominal = case.aircraft, case.radar
    covariances = case.cov_aircraft, case.cov_radar[case.level]

    if util.find_spec("numba"):
        ours = partial(rs.monte_carlo, case, runs=RUNS, seed=1)
        mc = ours()
        kernel = peers.numba_monte_carlo(plain, P_FA)
        generator = np.random.Generator(np.random.SFC64(2))
        std = [np.sqrt(np.diag(c)) for c in covariances]
        peer = partial(kernel, generator, RUNS, nominal, std, band_of(mc), TAIL)
        alike(mc, peer())
        name = f"fused Numba kernel, {RUNS:,} runs" + " *" * (kind == "constant")
        row(name, interleaved(ours, peer), RUNS * len(case.aircraft), "ns", longer=1.3)
    ours = partial(rs.monte_carlo, case, runs=FEWER_RUNS, seed=1)
    mc = ours()
    for name, turn in (
        ("NumPy, rotation matrices multiplied", peers.matrix_by_products),
        ("NumPy, rotation matrix written out", peers.matrix_by_elements),
    ):
        rest = nominal, covariances, plain, P_FA, band_of(mc), TAIL
        peer = partial(peers.numpy_monte_carlo, turn, np.random.default_rng(2), FEWER_RUNS, *rest)
        alike(mc, peer())
        times = interleaved(ours, peer, rounds=3)
        row(f"{name}, {FEWER_RUNS:,} runs", times, FEWER_RUNS * len(case.aircraft), "ns", faster=8)


def integration():
    title("Ten integrated pulses beside North's single pulse, one core")
    north = scenario()
    ten = scenario(
        radar__detector={
            "model": "swerling2",
            "pulses": 10,
            "cfar": {"type": "cell_averaging", "cells": 24},
        },
        radar__constant=40,
    )
    draws = [partial(rs.monte_carlo, s, runs=FEWER_RUNS, seed=1) for s in (ten, north)]
    row("Monte Carlo, per sample", interleaved(*draws), FEWER_RUNS * 361, "ns", longer=3)
    aircraft, radar = random_poses(np.random.default_rng(1))
    for what in ("p_d", "linearize", "linearize_probit"):
        calls = [partial(getattr(s.model, what), aircraft, radar) for s in (ten, north)]
        row(f"{what} of {POSES:,} poses, per pose", interleaved(*calls), POSES, "ns", longer=3)
    start = time.perf_counter()
    rs.Marcum(pulses=10).p_d(np.ones(1), 1.2345e-6)
    print(f"  (the table of a detector is made in {time.perf_counter() - start:.2f} s)")


def band_of(mc):
    return mc.band.p_d, mc.band.lower, mc.band.upper


def alike(mc, theirs):
    """Insist that the statistics of two independent sets of draws agree.

    Mean and coverage do at every pose, to 5 standard errors. Deviation and quantiles scatter too
    much where P_D has a heavy tail, near 1 say; they do at most poses.
    """
    mean, std, coverage, lower, upper = theirs
    error = np.sqrt(2.0 / mc.runs)
    share = np.clip((coverage + mc.coverage) / 2, 1 / mc.runs, 1 - 1 / mc.runs)
    assert np.all(abs(mean - mc.mean) < 5 * error * mc.std)
    assert np.all(abs(coverage - mc.coverage) < 5 * error * np.sqrt(share * (1 - share)))
    assert np.median(abs(std / mc.std - 1)) < 5 * error / np.sqrt(2)
    assert np.median(abs(lower - mc.lower) / mc.std) < 1
    assert np.median(abs(upper - mc.upper) / mc.std) < 1


def propagation():
    """Each method beside its gradient, at the level low, where automatic needs the fewest draws."""
    case = scenario(analysis__level="low")
    aircraft = np.tile(case.aircraft, (60, 1))
    aircraft[:, :3] += np.random.default_rng(3).normal(0.0, 100.0, (len(aircraft), 3))
    states = case.model, aircraft, case.radar, case.cov_aircraft, case.cov_radar[case.level]
    title(f"Propagation of {len(aircraft):,} poses beside model.linearize; per pose")
    gradient = partial(case.model.linearize, aircraft, case.radar)

    def one_bound():
        return METHODS["form"](uncertain_states(*states)[1]).quantile(3.0)

    for what, ours, longer in (
        ("linear", partial(rs.propagate, *states, method="linear"), 2.0),
        ("probit", partial(rs.propagate, *states, method="probit"), 2.0),
        ("form: bounds, mean and sigma", partial(rs.propagate, *states, method="form"), 270.0),
        ("form: one bound", one_bound, 100.0),
        # a judgement is 1024 draws of a pose or more
        ("automatic", partial(rs.propagate, *states), 3000.0),
        ("unreliable, of linear", partial(rs.unreliable, *states, method="linear"), 3000.0),
    ):
        times = interleaved(ours, gradient, rounds=3)
        row(what, times, len(aircraft), "ns", longer=longer)
    one = case.model, aircraft[0], case.radar, case.cov_aircraft, case.cov_radar[case.level]
    alone = repeated(partial(case.model.linearize, aircraft[0], case.radar), 200)
    for name, longer in (("linear", 5.0), ("form", 25.0), ("automatic", 110.0)):
        ours = repeated(partial(rs.propagate, *one, method=name), 200)
        row(f"one pose alone: {name}", interleaved(ours, alone, rounds=3), 200, "ns", longer=longer)
    draws = partial(rs.monte_carlo, case, runs=RUNS, seed=1)
    form = partial(propagate_scenario, case, method="form")
    ours, peer = interleaved(form, draws, rounds=3)
    times = ours, peer * 1e6 / RUNS
    row("form beside 1,000,000 draws a pose", times, len(case.aircraft), "ns", faster=2000)


def repeated(function, times):
    def run():
        for _ in range(times):
            function()

    return run


def networks():
    """Networks of more and more radars beside one radar, per pose and radar that sees it."""
    case = scenario()
    title("Networks beside one radar, one core; per pose and radar that sees it")
    aircraft = np.tile(case.aircraft, (6, 1))

    def network(radars, poses, together=None):
        """Groups of radars 1000 km apart, which see the poses about their own group only."""
        groups = radars // (together or radars)
        north = 1e6 * (np.arange(radars) % groups)
        state = np.tile(case.radar, radars)
        state[0::4] += 2e3 * (np.arange(radars) // groups) + north
        model = case.model.radars[0].model
        limit = 5e5 if together else math.inf
        network = tuple(rs.Radar(model, name=f"r{i}", max_range=limit) for i in range(radars))
        cov = np.kron(np.eye(radars), case.cov_radar[case.level])
        places = aircraft[:poses].copy()
        places[:, 0] += 1e6 * (np.arange(poses) % groups)
        return rs.NetworkModel(network), places, state, case.cov_aircraft, cov

    def ours(method, radars, poses, seeing=None):
        return partial(rs.propagate, *network(radars, poses, seeing), method=method)

    methods = ("linear", "probit", "form")
    peer = {method: ours(method, 1, 2048) for method in methods}

    def measure(what, method, radars, poses, seeing):
        times = interleaved(ours(method, radars, poses, seeing), peer[method], rounds=3)
        taken, alone = times
        times = taken / (seeing or radars) / poses, alone / 2048
        row(f"{method}, {what}", times, 1, "ns", longer=1.5)

    for method in methods:
        # the matrices of FORM grow with the radars in sight
        for radars in (2, 4, 8) if method == "form" else (2, 4, 8, 16, 32, 64):
            poses = 512 if method == "form" else 2048
            measure(f"{radars} radars", method, radars, poses, None)
    for radars in (16, 32, 64):
        measure(f"{radars} radars, 8 of them in sight", "form", radars, 2048, 8)


def whole_path():
    """`variance` on 100 000 poses, file to file, beside the gradient of its poses."""
    case = scenario()
    title("variance on a path of 100,000 poses, file to file; per pose")
    aircraft = np.tile(case.aircraft, (277, 1))[:100_000]
    gradient = partial(case.model.linearize, aircraft, case.radar)
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "long.yaml"
        route = (ROOT / "configs/path_route.csv").as_posix()
        text = (ROOT / "configs/path.yaml").read_text(encoding="utf-8")
        text = text.replace("path_route.csv", route).replace("step_s: 2,", "step_s: 0.01445,")
        config.write_text(text, encoding="utf-8")
        (peer,) = interleaved(gradient)
        for method, longer in (("linear", 3000.0), ("form", 3600.0)):  # judged by draws
            options = "-q", "--no-plot", "--method", method, "--out", folder
            ours = partial(run, "-m", "radar_sense", "variance", str(config), *options)
            (taken,) = interleaved(ours, rounds=1, clock=of_children)
            row(f"variance --method {method}", (taken, peer), len(aircraft), "ns", longer=longer)


def of_children():
    """CPU time [s] of the processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def workers():
    if len(cores()) < 2:
        print("\nOnly one core is at hand: the row for several workers is left out")
        return
    title(f"Monte Carlo over 361 poses, {MORE_RUNS:,} runs, two cores; per sample")
    case = scenario()
    two, one = (partial(rs.monte_carlo, case, runs=MORE_RUNS, seed=1, workers=n) for n in (2, 1))
    samples = MORE_RUNS * len(case.aircraft)
    times = interleaved(two, one, clock=time.perf_counter)
    row("two workers beside one", times, samples, "ns", faster=1.8)
    single, pair = (statistics.median(side_by_side(n) for _ in range(3)) for n in (1, 2))
    print(f"  (two processes that know nothing of each other: {2 * single / pair:.2f}x)")


def side_by_side(processes):
    """Time [s] of the slowest of some processes that all compute the same with one worker."""
    running = [
        subprocess.Popen(
            [sys.executable, str(HERE / "one_worker.py"), str(MORE_RUNS)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(processes)
    ]
    return max(float(process.communicate()[0]) for process in running)


def door():
    title("At the door, a process each; per start")
    with tempfile.TemporaryDirectory() as folder:
        tool = partial(run, "-m", "radar_sense")
        click = partial(run, "-c", "import click")
        figure = partial(run, str(HERE / "figure_alone.py"), str(Path(folder) / "figure.png"))
        budget = partial(tool, "budget", "-q", "--out", folder)
        wrong = partial(tool, "budget", "--rns", "5", code=2)
        special = partial(run, "-c", "import scipy.special")
        start = partial(run, "-c", "pass")
        for what, ours, peer, longer in (
            ("--help beside Python and import click", partial(tool, "--help"), click, 2.0),
            ("a wrong argument beside NumPy and SciPy", wrong, special, 2.0),
            ("budget beside NumPy, SciPy, Matplotlib, a figure", budget, figure, 1.3),
        ):
            row(what, interleaved(ours, peer, clock=of_children), 1, "ms", longer=longer)
        (alone,) = interleaved(start, clock=of_children)
        print(f"  (Python itself starts in {alone * 1e3:.0f} ms)")


def run(*arguments, code=0):
    """Run Python and insist on its exit code; compiled modules are kept."""
    usual = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=usual, capture_output=True, check=False
    )
    assert done.returncode == code, done.stderr.decode()


@contextmanager
def one_core():
    """Keep the process on one core, and then let it go again."""
    allowed = cores()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(allowed)})
        yield
        os.sched_setaffinity(0, allowed)
    else:
        yield


def cores():
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def cpu():
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(
            line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")
        )
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


main()
