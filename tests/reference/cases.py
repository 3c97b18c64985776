"""The scenarios and poses of the reference set: the paper's, and random ones.

A scenario is what a JSON file can say: an RCS, a detector, a radar with its limits, covariances.
All numbers are rounded to a few digits, so that a reader of the files has the same doubles.
"""

import exact
import numpy as np

DEG = np.pi / 180
SEED = 20261123
POSES, RANDOM = 20, 90
#: Angle [deg] of the paper's orbit, and what the radar's states are known to at its three levels.
THETA_DEG = np.arange(73) * 2.5
LEVELS = {"low": (10.0, 1.0), "medium": (100.0, 5.0), "high": (1000.0, 10.0)}
RCS = ("constant", "ellipsoid", "ellipsoid_exact", "spikeball", "cut", "table", "spread")
DETECTORS = (
    {"model": "north"},
    {"model": "marcum"},
    {"model": "swerling1"},
    {"model": "swerling3"},
    {"model": "marcum", "pulses": 8},
    {"model": "swerling1", "pulses": 10},
    {"model": "swerling2", "pulses": 10},
    {"model": "swerling3", "pulses": 2},
    {"model": "swerling3", "pulses": 10},
    {"model": "swerling4"},
    {"model": "swerling4", "pulses": 6},
    {"model": "marcum", "pulses": 32},
    {"model": "swerling1", "cfar": {"model": "cell_averaging", "cells": 16}},
    {"model": "marcum", "pulses": 4, "cfar": {"model": "cell_averaging", "cells": 24}},
    {"model": "swerling2", "cfar": {"model": "ordered_statistics", "cells": 24, "rank": 18}},
    {"model": "swerling2", "binary": {"m": 2, "n": 3}},
    {"model": "marcum", "binary": {"m": 3, "n": 5}},
)
LIMITS = ("max_range_m", "min_range_m", "horizon")


def scenarios():
    """Yield each scenario with its aircraft states (n, 6), in metres and radians."""
    for level, (position, constant) in LEVELS.items():
        yield paper(level, position, constant), orbit()
    for number in range(RANDOM):
        rng = np.random.default_rng([SEED, number])
        yield random_case(rng, number)


def paper(level, position, constant):
    """Return the scenario of the paper at one of its levels of uncertainty."""
    return {
        "name": f"paper, {level}",
        "rcs": {"model": "ellipsoid", "a_m": 0.15, "b_m": 0.13, "c_m": 0.21},
        "rcs_error_std": 0.0,
        "detector": {"model": "north"},
        "p_fa": 1.7e-4,
        "radar": {"position_m": [0.0, 0.0, 0.0], "constant": 167.0},
        "attenuation_db_per_m": 0.0,
        "max_range_m": None,
        "min_range_m": None,
        "horizon": False,
        "cov_aircraft": np.diag(np.square([10.0] * 3 + [float(1 * DEG)] * 3)).tolist(),
        "cov_radar": np.diag(np.square([position] * 3 + [constant])).tolist(),
    }


def orbit():
    """Return the aircraft of the paper: 500 km away, 3 km up, heading east."""
    states = np.zeros((len(THETA_DEG), 6))
    states[:, 0], states[:, 1] = 500e3 * np.sin(THETA_DEG * DEG), 500e3 * np.cos(THETA_DEG * DEG)
    states[:, 2], states[:, 5] = -3e3, np.pi / 2
    return states


def random_case(rng, number):
    """Return a random scenario, and more states of the aircraft (n, 6) than are needed.

    Kinds of RCS and detector take turns, which differ in length.
    """
    kind, detector = RCS[number % len(RCS)], DETECTORS[number % len(DETECTORS)]
    distance = few(10 ** rng.uniform(4.3, 5.5))
    turn = 10 ** rng.uniform(-0.7, 0.5) * DEG
    near, far = 10 ** rng.uniform(0, 2.3, 2)
    scenario = {
        "name": f"{kind}, {detector['model']}",
        "rcs": random_rcs(rng, kind),
        "rcs_error_std": 1.0 if kind == "spread" else few(rng.uniform(0.3, 2)) * (number % 3 == 0),
        "detector": detector,
        "p_fa": few(10 ** rng.uniform(-8, -3), 2),
        "radar": {
            "position_m": [*(few(x) for x in rng.normal(size=2) * 2e4), -few(rng.uniform(5, 60))],
            "constant": 1.0,
        },
        "attenuation_db_per_m": few(rng.uniform(0.5, 3) / distance) if number % 4 == 1 else 0.0,
        "max_range_m": None,
        "min_range_m": None,
        "horizon": False,
        "cov_aircraft": covariance(rng, [near] * 3 + [turn] * 3, number),
    }
    if number % 6 == 2:
        limit = LIMITS[number // 6 % 3]
        scenario[limit] = True if limit == "horizon" else distance
        scenario["name"] += ", " + limit.removesuffix("_m").replace("_", " ")
    poses = random_poses(rng, scenario, distance)
    # c_r that gives the first pose a P_D
    states = [exact.arb(x) for x in (*poses[0], *scenario["radar"]["position_m"], 1.0, 0.0)]
    gain = exact.snr(scenario, exact.cross_section(scenario["rcs"]), states)[0]
    snr = snr_of(detector, scenario["p_fa"], rng.uniform(0.2, 0.9))
    constant = scenario["radar"]["constant"] = few(snr / float(gain))
    spread = constant * 10 ** rng.uniform(-2.3, -0.8)
    scenario["cov_radar"] = covariance(rng, [far, far, 0.3 * far, spread], number + 1)
    return scenario, poses


def snr_of(detector, p_fa, p_d):
    """Return S at which a detector has a P_D, to some digits."""
    function, low, high = exact.detector(detector, p_fa), 1e-3, 1e4
    for _ in range(20):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if function(exact.arb(middle))[0] < p_d else (low, middle)
    return middle


def random_poses(rng, scenario, distance):
    """Return states (n, 6) around the radar, about a distance away."""
    n, radar = 3 * POSES, np.array(scenario["radar"]["position_m"])
    distance = distance * 10 ** rng.uniform(-0.12, 0.12, n)
    if scenario["horizon"]:
        # where a straight line in an earth of 4/3 radius just clears it
        reach = np.sqrt(distance * distance / (2 * 4 / 3 * 6_371_000))
        height = np.square(np.maximum(reach - np.sqrt(-radar[2]), 3)) * rng.uniform(0.9, 1.2, n)
    else:
        height = rng.uniform(300, 9000, n)
    angle = rng.uniform(-np.pi, np.pi, n)
    place = radar + np.stack([distance * np.cos(angle), distance * np.sin(angle), -height], axis=1)
    attitude = rng.uniform(-1, 1, (n, 3)) * [0.5, 0.25, np.pi]
    return np.hstack([np.round(place, 1), np.round(attitude, 5)])


def random_rcs(rng, kind):
    if kind == "constant":
        return {"model": kind, "rcs_m2": few(10 ** rng.uniform(-1.5, -0.5))}
    if kind == "ellipsoid":
        a, b, c = (few(x) for x in rng.uniform(0.12, 0.3, 3))
        return {"model": kind, "a_m": a, "b_m": b, "c_m": c}
    if kind == "ellipsoid_exact":
        x, y, z = (few(x) for x in rng.uniform(0.12, 0.3, 3))
        return {"model": kind, "x_m": x, "y_m": y, "z_m": z}
    if kind == "spikeball":
        amplitude, floor = (few(x) for x in rng.uniform(0.03, 0.2, 2))
        lobes = int(rng.integers(1, 7))
        return {"model": kind, "lobes": lobes, "amplitude_m2": amplitude, "floor_m2": floor}
    azimuth = np.arange(-180, 180, 10 if kind == "cut" else 20) * DEG
    elevation = (
        None if kind == "cut" else np.array([-90, -60, -40, -20, -10, 0, 10, 20, 40, 60, 90]) * DEG
    )
    decibels = sum(
        rng.normal(0, 4 / n) * np.cos(n * azimuth + rng.uniform(0, 6)) for n in range(1, 5)
    )
    table = {"model": "table", "azimuth_rad": azimuth.tolist(), "elevation_rad": None}
    if kind == "cut":
        return table | {"rcs_m2": [few(v) for v in 10 ** (decibels / 10 - 1)]}
    table["elevation_rad"] = elevation.tolist()
    decibels = decibels[:, None] * np.cos(elevation) + rng.normal(0, 4) * np.sin(elevation) ** 2
    table["rcs_m2"] = at_poles(10 ** (decibels / 10 - 1))
    if kind == "spread":
        around = np.cos(azimuth + rng.uniform(0, 6))[:, None] * np.cos(elevation)
        table["std_db"] = at_poles(rng.uniform(0.5, 1) + 0.4 * around)
    return table


def at_poles(values):
    """Return rows of rounded values, the same for all azimuths straight above and below."""
    values[:, [0, -1]] = values[0, [0, -1]]
    return [[few(v) for v in row] for row in values]


def covariance(rng, std, number):
    """Return a covariance, with correlations for every second number."""
    std, size = np.array([few(s) for s in std]), len(std)
    correlation = np.eye(size)
    if number % 2:
        matrix = rng.normal(size=(size, size)) + np.sqrt(size) * np.eye(size)
        matrix /= np.linalg.norm(matrix, axis=1, keepdims=True)
        correlation = matrix @ matrix.T
    full = np.outer(std, std) * correlation
    return [[few(full[min(i, j), max(i, j)], 7) for j in range(size)] for i in range(size)]


def few(value, digits=4):
    """Return a value of some significant digits."""
    return float(f"{value:.{digits}g}")
