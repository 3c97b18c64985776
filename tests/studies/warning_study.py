"""How often the methods miss a bound without a warning, and how often a warning is false.

    python tests/studies/warning_study.py [SCENARIOS]

Random scenarios of one radar and of several, with tables of sharp lobes among their RCS, three
poses each. A bound is off where it differs by more than 0.005 from that of draws, by more than
4 standard errors of the draws. A miss is a bound that is off without a warning. A warning is false
where both bounds are good to 0.005 and σ to 3 %, or to 3e-5 where it is below 0.001.
"""

import sys
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import Marcum, North, Swerling1, Swerling3
from radar_sense.model.network import NetworkModel, Radar
from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS, SpikeballRCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.propagation import METHODS, nonlinear, propagate

OFF, STD_OFF, BETA, POSES = 0.005, 0.03, 3.0, 3
KINDS = ("constant", "ellipsoid", "spikeball", "table", "lobes")


@dataclass(frozen=True)
class Verdict:
    """The errors of a method at one pose, against draws."""

    kind: str
    error: float
    std_error: float
    warned: bool

    @property
    def off(self):
        """Whether a bound is off, or missing."""
        return not self.error <= OFF

    @property
    def good(self):
        """Whether bounds are good to 0.005, and σ to 3 % or 3e-5."""
        return self.error <= OFF and self.std_error <= STD_OFF


def random_rcs(rng, kind):
    if kind == "constant":
        return ConstantRCS(0.1)
    if kind == "ellipsoid":
        return EllipsoidRCS(*rng.uniform(0.12, 0.3, 3))
    if kind == "spikeball":
        return SpikeballRCS(int(rng.integers(1, 7)), *rng.uniform(0.02, 0.2, 2))
    if kind == "table":  # smooth: some harmonics of azimuth and elevation
        azimuth, elevation = np.arange(-180, 180, 5.0), np.arange(-90, 91, 5.0)
        a, e = np.deg2rad(azimuth)[:, None], np.deg2rad(elevation)
        decibels = np.zeros((len(azimuth), len(elevation)))
        for n in range(1, 9):
            decibels += rng.normal(0, 4 / n) * np.cos(n * a + rng.uniform(0, 6)) * np.cos(e)
        decibels[:, [0, -1]] = 0.0
        return TableRCS(np.deg2rad(azimuth), 10 ** (decibels / 10 - 1), np.deg2rad(elevation))
    # sharp lobes on a low floor
    step = rng.choice([2.0, 3.0, 5.0])
    azimuth, elevation = np.arange(-180, 180, step), np.arange(-90, 91, 5.0)
    grid_a, grid_e = np.meshgrid(azimuth, elevation, indexing="ij")
    decibels = np.full(grid_a.shape, -12.0)
    for _ in range(rng.integers(10, 60)):
        apart = (grid_a - rng.uniform(-180, 180) + 180) % 360 - 180
        height = rng.uniform(5, 25)
        lobe = height * np.exp(
            -0.5 * (apart / rng.uniform(1.5, 4)) ** 2
            - 0.5 * ((grid_e - rng.normal(0, 20)) / rng.uniform(5, 15)) ** 2
        )
        decibels = np.maximum(decibels, -12.0 + lobe)
    decibels[:, [0, -1]] = -12.0
    return TableRCS(np.deg2rad(azimuth), 10 ** (decibels / 10), np.deg2rad(elevation))


def correlated(rng, std):
    """A covariance with these standard deviations, correlated in half of all cases."""
    if rng.uniform() < 0.5:
        return np.diag(np.square(std))
    root = rng.normal(size=(len(std), len(std))) + 2 * np.eye(len(std))
    root /= np.linalg.norm(root, axis=1, keepdims=True)
    return np.outer(std, std) * (root @ root.T)


def random_case(rng, kind):
    """Return a model, poses (3, 6), radar states and covariances."""
    radars = int(rng.choice([1, 1, 1, 2, 3]))
    rcs = random_rcs(rng, kind)
    detectors = (North(), North(), Marcum(), Swerling1(), Swerling3())
    models = [
        DetectionModel(rcs, 10.0 ** rng.uniform(-8, -3), detectors[rng.integers(5)])
        for _ in range(radars)
    ]
    model = models[0]
    if radars > 1:
        model = NetworkModel(tuple(Radar(m, name=f"r{i}") for i, m in enumerate(models)))
    poses = np.zeros((POSES, 6))
    distance = 10.0 ** rng.uniform(4.3, 5.7)
    angle = rng.uniform(0, 2 * np.pi, POSES)
    poses[:, 0], poses[:, 1] = distance * np.cos(angle), distance * np.sin(angle)
    poses[:, 2] = -rng.uniform(1e3, 1e4)
    poses[:, 3:] = rng.uniform(-1, 1, (POSES, 3)) * [0.4, 0.2, np.pi]
    angles = np.deg2rad(10.0 ** rng.uniform(-1, 0.7))
    near, far = 10.0 ** rng.uniform(0, 2.5, 2)
    relative = 10.0 ** rng.uniform(-2.5, -0.7, radars)
    states = np.zeros((radars, 4))
    states[:, :2] = rng.normal(size=(radars, 2)) * distance / 3
    cov_radar = np.zeros((4 * radars, 4 * radars))
    for i, one in enumerate(models):
        states[i, 3] = 1.0
        ratio = np.median(one.snr(poses, states[i]))
        states[i, 3] = 10.0 ** rng.uniform(0.2, 1.3) / ratio
        block = slice(4 * i, 4 * i + 4)
        cov_radar[block, block] = correlated(rng, [far, far, far, relative[i] * states[i, 3]])
    cov_aircraft = correlated(rng, [near] * 3 + [angles] * 3)
    return model, poses, states.ravel(), cov_aircraft, cov_radar


def drawn_bounds(rng, model, pose, radar, cov_aircraft, cov_radar, draws):
    """Return the ends of intervals (2, 2) for the quantiles at Φ(−3) and Φ(3), and σ."""
    aircraft = rng.multivariate_normal(pose, cov_aircraft, draws, method="eigh")
    states = rng.multivariate_normal(radar, cov_radar, draws, method="eigh")
    states[:, 3::4] = np.maximum(states[:, 3::4], 0.0)
    p_d = model.p_d(aircraft, states)
    error = 4 * np.sqrt(ndtr(-BETA) / draws)
    return np.quantile(p_d, ndtr([[-BETA], [BETA]]) + np.array([-error, error])), p_d.std()


def study(scenarios, draws, seed=1, kinds=KINDS):
    """Return the verdicts by method."""
    rng = np.random.default_rng(seed)
    verdicts = {name: [] for name in METHODS}
    for number in range(scenarios):
        kind = kinds[number % len(kinds)]
        states = random_case(rng, kind)
        model, poses, *rest = states
        ends = [drawn_bounds(rng, model, pose, *rest, draws) for pose in poses]
        for name in METHODS:
            found = propagate(*states, method=name)
            warned = nonlinear(*states, method=name, moments=found) | ~found.converged
            verdicts[name] += [judge(kind, found, warned, i, *end) for i, end in enumerate(ends)]
    return verdicts


def judge(kind, found, warned, i, between, std):
    """Return the verdict on a method at a pose."""
    given = np.array([found.lower[i], found.upper[i]])
    error = np.max([between[:, 0] - given, given - between[:, 1]])
    std_error = abs(found.std[i] - std) / max(std, 1e-3)
    return Verdict(kind, float(error), float(std_error), bool(warned[i]))


def counts(verdicts):
    """Return poses, bounds off, warnings, misses, warnings with good bounds, false warnings."""
    return (
        len(verdicts),
        sum(v.off for v in verdicts),
        sum(v.warned for v in verdicts),
        sum(v.off and not v.warned for v in verdicts),
        sum(v.warned and not v.off for v in verdicts),
        sum(v.warned and v.good for v in verdicts),
    )


def main():
    scenarios = int(sys.argv[1]) if len(sys.argv) > 1 else 120
    verdicts = study(scenarios, 400_000, seed=int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    heads = ("poses", "off", "warned", "missed", "bounds ok", "false")
    print(f"{'':22}" + "".join(f"{head:>10}" for head in heads))
    for name, all_kinds in verdicts.items():
        print(f"{name:22}" + "".join(f"{c:10}" for c in counts(all_kinds)))
        for kind in KINDS:
            some = [v for v in all_kinds if v.kind == kind]
            print(f"  {kind:20}" + "".join(f"{c:10}" for c in counts(some)))


if __name__ == "__main__":
    main()
