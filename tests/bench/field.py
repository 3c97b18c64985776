"""What general tools say of one pose of the paper, beside this package: the table of docs/field.md.

    pip install openturns suncal
    PYTHONPATH=tests python tests/bench/field.py

The pose is at 45 degrees, Medium. All tools have the same function of ten states, written without
the package (`studies.bands`). A tool that is not installed has no row.
"""

import time
from importlib import util

import numpy as np
from studies.bands.model import Oracle, Problem, Radar

import radar_sense as rs
from radar_sense.propagation import propagate_scenario

NAMES = ("north", "east", "down", "roll", "pitch", "yaw", "rn", "re", "rd", "constant")
ANGLE, DRAWS, TAILS = np.radians(45), 10**6, (0.001349898, 0.998650102)
VALUES = np.array(
    [500e3 * np.sin(ANGLE), 500e3 * np.cos(ANGLE), -3e3, 0, 0, np.pi / 2, 0, 0, 0, 167]
)
STD = np.array([10.0] * 3 + [np.radians(1)] * 3 + [100.0] * 3 + [5.0])
ORACLE = Oracle(
    Problem(
        population="paper",
        number=0,
        aircraft=VALUES[:6],
        radars=(Radar(VALUES[6:], "north", 1.7e-4),),
        rcs=("ellipsoid", 0.15, 0.13, 0.21),
        cov_aircraft=np.diag(STD[:6] ** 2),
        cov_radar=np.diag(STD[6:] ** 2),
    )
)


def p_d(*states):
    """Return P_D of ten states, each a number or an array."""
    states = np.stack(np.broadcast_arrays(*states))
    return ORACLE.p_d(states[:6], np.concatenate([states[6:9], np.maximum(states[9:], 0)]))


def timed(function):
    """Return the least CPU time [s] of three calls, and what the function returns."""
    times = []
    for _ in range(3):
        start = time.process_time()
        found = function()
        times.append(time.process_time() - start)
    return min(times), found


def line(name, seconds, std, lower=np.nan, upper=np.nan):
    print(f"| {name} | {std:.5f} | {lower:.4f} to {upper:.4f} | {1e3 * seconds:.3g} ms |")


def package():
    scenario = rs.load_scenario().with_analysis(level="medium").at_poses(slice(90, 91))
    for method in ("linear", "form", "automatic"):
        seconds, found = timed(lambda m=method: propagate_scenario(scenario, method=m))
        line(f"radar-sense, {method}", seconds, found.std[0], found.lower[0], found.upper[0])


def suncal():
    import suncal

    def function(north, east, down, roll, pitch, yaw, rn, re, rd, constant):
        return p_d(north, east, down, roll, pitch, yaw, rn, re, rd, constant)

    model = suncal.ModelCallable(function)
    for name, value, std in zip(NAMES, VALUES, STD, strict=True):
        model.var(name).measure(float(value)).typeb(std=float(std))
    seconds, found = timed(model.calculate_gum)
    (std,), (value,) = found.uncertainty.values(), found.expected.values()
    line("Suncal, GUM", seconds, std, value - 3 * std, value + 3 * std)
    seconds, found = timed(lambda: model.monte_carlo(samples=DRAWS))
    (std,), (band,) = found.uncertainty.values(), found.expanded(conf=1 - 2 * TAILS[0]).values()
    line("Suncal, a million draws", seconds, std, band.low, band.high)


def openturns():
    import openturns as ot

    function = ot.PythonFunction(
        10, 1, lambda x: [float(p_d(*x))], func_sample=lambda x: p_d(*np.array(x).T)[:, np.newaxis]
    )
    function = ot.Function(function)
    step = ot.Point((1e-4 * STD).tolist())
    function.setGradient(ot.CenteredFiniteDifferenceGradient(step, function.getEvaluation()))
    states = ot.JointDistribution(
        [ot.Normal(float(v), float(s)) for v, s in zip(VALUES, STD, strict=True)]
    )
    result = ot.CompositeRandomVector(function, ot.RandomVector(states))
    seconds, std = timed(lambda: ot.TaylorExpansionMoments(result).getCovariance()[0, 0] ** 0.5)
    value = float(p_d(*VALUES))
    line("OpenTURNS, Taylor", seconds, std, value - 3 * std, value + 3 * std)
    seconds, sample = timed(lambda: np.array(result.getSample(DRAWS)).ravel())
    line("OpenTURNS, a million draws", seconds, sample.std(), *np.quantile(sample, TAILS))


def main():
    print("| tool | σ | 3σ bounds | CPU |\n|---|---:|---|---:|")
    package()
    for name, rows in {"suncal": suncal, "openturns": openturns}.items():
        if util.find_spec(name):
            rows()


if __name__ == "__main__":
    main()
