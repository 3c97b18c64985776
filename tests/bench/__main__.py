"""`make bench`: one table of how fast the package is, each row a ratio to a peer run beside it.

The package and the peer take turns in one process, and each turn gives a ratio: the row has the
median, the least and the greatest. What a peer computes is compared first. A door is the CPU time
of `radar-sense budget --no-plot -q`, which takes turns with the commands. Rows for peers that are
not installed are not measured.
"""

import datetime
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
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the tool sets it itself

import numpy as np
import peers
from chain_rule import linearize as chain_rule
from helpers import scenario
from scipy.special import ndtr

import radar_sense as rs
from radar_sense.propagation import METHODS

sys.path.pop(0)  # whose folder `coverage` Numba would take for the package of that name

ROOT = Path(__file__).resolve().parents[2]
P_FA, AXES = 1.7e-4, (0.15, 0.13, 0.21)
TAIL = float(ndtr(-3.0))
#: Most doors of a command. Exit code 3 is an answer, too.
DOORS = {
    "variance": 1.3,
    "sensitivity": 1.3,
    "budget": 1.3,
    "check": 1.3,
    "init -": 1.3,
    "rcs": 1.3,
    "detectors": 1.3,
    "montecarlo": 1.6,
    "range": 2,
    "map": 3,
    "report": 4,
    "validate": 20,
    "compare": 3,
    "convergence": 8,
    "variance configs/corridor.yaml --threshold 0.1": 6,
    "map configs/corridor.yaml": 4,
    "mission configs/corridor.yaml --m 3 --n 5": 15,
    "budget configs/corridor.yaml --method form": 3,
}
#: Commands without a figure, or without files.
NO_FIGURE, NO_FILES = ("report",), ("check", "init -")


def main():
    found = [f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "matplotlib")]
    missing = []
    for name in ("jax", "numba", "openturns"):
        present = util.find_spec(name)
        (found if present else missing).append(
            f"{name} {metadata.version(name)}" if present else name
        )
    machine = f"{cpu()}, {len(cores())} cores, Python {platform.python_version()}"
    print(f"{datetime.date.today()}; {machine}, {', '.join(found)}")
    print(f"not measured, because not installed: {', '.join(missing) or 'none'}\n")
    print("| | ours | peer | ratio | spread | at most |\n|---|---:|---:|---:|---:|---:|")
    two_workers()  # before JAX is there, beside which threads of Python wait longer
    with one_core():
        gradients()
        samples()
        propagation()
        networks()
        sizes()
    doors()


def row(what, ours, peer, *, counts=(1, 1), rounds=5, clock=time.process_time, most=""):
    """Measure and print a row.

    Args:
        what: What is compared.
        ours: A function.
        peer: The function that it is compared with.
        counts: What the times of each are divided by.
        rounds: Number of turns.
        clock: What measures.
        most: The limit of the ratio, if there is one.
    """
    pair = tuple(zip((ours, peer), counts, strict=True))
    times = np.array([[timed(f, clock) / count for f, count in pair] for _ in range(rounds)])
    show(what, times, most)


def timed(function, clock):
    """Return the time of the second of two calls: the first gets the memory back."""
    function()
    start = clock()
    function()
    return clock() - start


def show(what, times, most=""):
    """Print a row of times (rounds, 2), ours and the peer's [s]."""
    ours, peer = (in_unit(statistics.median(column)) for column in times.T)
    ratios = times[:, 0] / times[:, 1]
    over = " **over**" if most and min(ratios) > most else ""
    print(
        f"| {what} | {ours} | {peer} | {statistics.median(ratios):.2g} "
        f"| {min(ratios):.2g} to {max(ratios):.2g} | {most}{over} |",
        flush=True,
    )


def in_unit(time):
    """Return a time [s] in the unit that suits it."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if time >= size:
            return f"{time / size:.3g} {unit}"
    return f"{1e9 * time:.3g} ns"


def two_workers():
    if len(cores()) < 2:
        return
    runs = 30_000
    two, one = (partial(rs.monte_carlo, scenario(), runs=runs, workers=n) for n in (2, 1))
    counts = [runs * len(scenario().aircraft)] * 2
    row("two workers beside one, a sample (time)", two, one, counts=counts, clock=time.perf_counter)


def gradients():
    """P_D and its ten partials at random poses."""
    poses = 300_000
    aircraft, radar = random_poses(np.random.default_rng(1), poses)
    model = rs.DetectionModel(rcs=rs.EllipsoidRCS(*AXES), p_fa=P_FA)
    ours = partial(model.linearize, aircraft, radar)
    lin = ours()
    expected = lin.p_d, lin.jac_aircraft, lin.jac_radar
    if util.find_spec("jax"):
        compiled, to_device = peers.jax_linearize(AXES, P_FA)
        peer = partial(compiled, to_device(aircraft), to_device(radar))
        p_d, gradient = peer()
        same(expected, (p_d, *gradient))
        row("gradient of a pose, beside JAX", ours, peer, counts=(poses, poses))
    peer = partial(chain_rule, aircraft, radar, ("ellipsoid", *AXES), P_FA)
    same(expected, peer())
    row("gradient of a pose, beside the paper's chain rule", ours, peer, counts=(poses, poses))


def random_poses(rng, poses):
    """Aircraft 300 to 800 km away in any attitude, and the radar and its constant as they come."""
    azimuth, radius = rng.uniform(-np.pi, np.pi, poses), rng.uniform(300e3, 800e3, poses)
    down = rng.uniform(-15e3, -1e3, poses)
    position = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), down], axis=1)
    attitude = rng.uniform(-1, 1, (poses, 3)) * [np.pi, np.pi / 2, np.pi]
    radar = np.column_stack([rng.normal(0, 1e3, (poses, 3)), rng.uniform(100, 200, poses)])
    return np.hstack([position, attitude]), radar


def same(ours, theirs):
    """Insist that P_D and every partial agree to 1e-9 of the largest of its kind."""
    for a, b in zip(ours, theirs, strict=True):
        assert np.all(np.abs(a - b) <= 1e-9 * np.abs(a).max(axis=0))


def samples():
    """A sample is one draw of the states of one pose, its P_D and all statistics."""
    case = scenario()
    nominal = case.aircraft, case.radar
    covariances = case.cov_aircraft, case.cov_radar
    for runs, package in ((20_000, "numba"), (6_000, "numpy")):  # NumPy holds all draws at once
        if not util.find_spec(package):
            continue
        ours = partial(rs.monte_carlo, case, runs=runs, seed=1)
        mc = ours()
        band = mc.band.p_d, mc.band.lower, mc.band.upper
        if package == "numba":
            std = [np.sqrt(np.diag(c)) for c in covariances]
            generator = np.random.Generator(np.random.SFC64(2))
            kernel = peers.numba_monte_carlo(AXES, P_FA)
            peer = partial(kernel, generator, runs, nominal, std, band, TAIL)
        else:
            rest = runs, nominal, covariances, AXES, P_FA, band, TAIL
            peer = partial(peers.numpy_monte_carlo, np.random.default_rng(2), *rest)
        alike(mc, peer())
        name = {"numba": "a compiled Numba loop", "numpy": "NumPy over all draws"}[package]
        row(f"sample, beside {name}", ours, peer, counts=[runs * len(case.aircraft)] * 2)


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
    """`form` beside draws and OpenTURNS, and each method beside its gradient."""
    case = scenario()
    draws = 20_000
    form = partial(propagate, case, "form")
    many = partial(rs.monte_carlo, case, runs=draws, seed=1)
    counts = len(case.aircraft), len(case.aircraft) * draws / 1e6
    row("form, a pose, beside 1e6 draws", form, many, counts=counts, rounds=3)
    if util.find_spec("openturns"):
        pose = case.at_poses(slice(90, 91))
        states = pose.states()
        limit = float(METHODS["form"](states).quantile(2.0)[0])
        theirs = partial(peers.openturns_form, pose, limit)
        # FORM alone has no curvature; ours is within a tenth of it at two standard deviations
        assert abs(theirs() / METHODS["form"](states).exceedance(limit)[0] - 1) < 0.1
        counts = len(case.aircraft), 1
        row("form, a pose, beside OpenTURNS' FORM", form, theirs, counts=counts)
    many_poses = case.aircraft.repeat(60, axis=0)
    for what in ("linear", "probit", "form"):
        ours = partial(propagate, case, what, many_poses)
        gradient = partial(case.model.linearize, many_poses, case.radar)
        counts = [len(many_poses)] * 2
        row(f"σ of a pose by {what}, beside its gradient", ours, gradient, counts=counts)


def propagate(case, method, aircraft=None):
    aircraft = case.aircraft if aircraft is None else aircraft
    covariances = case.cov_aircraft, case.cov_radar
    return rs.propagate(case.model, aircraft, case.radar, *covariances, method=method)


def networks():
    """Networks beside one radar, a pose and radar; all radars see all poses."""
    case = scenario()

    def ours(method, radars, poses):
        state = np.tile(case.radar, radars)
        state[0::4] += 2e3 * np.arange(radars)
        model = case.model.radars[0].model
        network = rs.NetworkModel(tuple(rs.Radar(model, name=f"r{i}") for i in range(radars)))
        cov = np.kron(np.eye(radars), case.cov_radar)
        aircraft = np.tile(case.aircraft, (6, 1))[:poses]
        rest = aircraft, state, case.cov_aircraft, cov
        return partial(rs.propagate, network, *rest, method=method)

    for method, radars, poses in (("linear", 64, 2048), ("form", 8, 512), ("form", 64, 128)):
        counts = radars * poses, 2048
        what = f"{radars} radars by {method}, a pose and radar, beside one radar"
        pair = ours(method, radars, poses), ours(method, 1, 2048)
        row(what, *pair, counts=counts, rounds=3)


def sizes():
    """A million poses and a million runs, beside ten thousand."""
    case = scenario()
    aircraft, _ = random_poses(np.random.default_rng(1), 1_000_000)
    for method, poses, name in (("linear", 10**6, "a million"), ("form", 10**5, "100,000")):
        ours, peer = (partial(propagate, case, method, aircraft[:n]) for n in (poses, 10**4))
        what = f"{name} poses by {method}, a pose, beside 10,000"
        row(what, ours, peer, counts=(poses, 10**4), rounds=3)
    few = case.at_poses(slice(0, None, 30))
    ours, peer = (partial(rs.monte_carlo, few, runs=n, seed=1) for n in (10**6, 10**4))
    row("a million runs, a run, beside 10,000", ours, peer, counts=(10**6, 10**4), rounds=3)


def doors():
    """Commands beside a door, and the figure of each in addition."""
    with tempfile.TemporaryDirectory() as folder:
        door = partial(command, "budget", folder, "--no-plot")
        for line, most in DOORS.items():
            plain = () if line in (*NO_FIGURE, *NO_FILES) else ("--no-plot",)
            times, figures = [], []
            for _ in range(3):
                times.append([command(line, folder, *plain), door()])
                if plain:
                    figures.append([command(line, folder) - times[-1][0], times[-1][1]])
            show(f"`{line}`, doors", np.array(times), most)
            if figures:
                show(f"`{line}`, its figure in addition", np.array(figures), 1)


def command(line, folder, *options):
    """Run a command and return its CPU time [s]; compiled modules are kept."""
    usual = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    files = () if line in NO_FILES else ("--out", folder)
    arguments = [*line.split(), "-q", *files, *options]
    before = os.times()
    done = subprocess.run(
        [sys.executable, "-m", "radar_sense", *arguments], cwd=ROOT, env=usual, capture_output=True
    )
    after = os.times()
    assert done.returncode in (0, 3), done.stderr.decode()
    return sum(after[2:4]) - sum(before[2:4])


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
