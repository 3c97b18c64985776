"""The cases of `tests/studies/cases`, read a second time, and their truth by plain draws.

    PYTHONPATH=tests/studies python -m bands.cases

In each case a bound, a probability or a verdict of version 0.1 is wrong. Only the keys that the
cases use are read.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from scipy.special import ndtr

from .model import Oracle, Problem, Radar, root
from .paths import along
from .populations import DEG, diagonal, slope
from .truth import drawn, ends, probability_se

FOLDER = Path(__file__).parents[1] / "cases"
SPEED_OF_LIGHT = 299_792_458.0
#: Power of c_r for the keys of a data sheet in decibels, and for other keys.
DECIBELS = {"gain_dbi": 2, "loss_db": -1, "noise_figure_db": -1}
LINEAR = {"average_power_kw": 1, "peak_power_kw": 1, "temperature_k": -1, "frequency_ghz": -2}


def read(name):
    """Return the coordinates (n,) [s] or [deg], the states of the rows (n, 6), and a problem.

    The aircraft of the problem is the first row.
    """
    document = yaml.safe_load((FOLDER / f"{name}.yaml").read_text())
    at, rows = geometry(document["geometry"], document["aircraft"].get("attitude_deg"))
    return at, rows, of_document(document, rows[0])


def of_document(document, aircraft):
    """Return the problem of a scenario as YAML has it, with an aircraft state (6,)."""
    known = document["uncertainty"]
    own = known["aircraft"]
    std = [own["position_m"] * np.ones(3), own["attitude_deg"] * np.ones(3) * DEG]
    blocks = document.get("radars") or [document["radar"]]
    levels = [block.get("uncertainty") or known["radar"] for block in blocks]
    radars, deviations = [], []
    for block, level in zip(blocks, levels, strict=True):
        (level,) = level.values()
        radars.append(one_radar(block, level))
        relative = np.sqrt(sum(slope(t) ** 2 for t in radars[-1].tolerances))
        constant = level["constant"]
        constant = relative * radars[-1].state[3] if isinstance(constant, dict) else constant
        deviations.append([*(level["position_m"] * np.ones(3)), constant])
    return Problem(
        population=document["name"],
        number=0,
        aircraft=np.array(aircraft, dtype=float),
        radars=tuple(radars),
        rcs=cross_section(document["aircraft"]["rcs"]),
        cov_aircraft=diagonal(np.concatenate(std)),
        cov_radar=diagonal(np.concatenate(deviations)),
        rcs_db=own.get("rcs_db", 0.0),
    )


def geometry(block, attitude):
    """Return coordinates (n,) and states (n, 6) of an orbit, or of a path in a file."""
    if block["type"] == "path":
        data = np.loadtxt(FOLDER / block["file"], delimiter=",", skiprows=1)
        return data[:, 0], np.hstack([data[:, 1:4], data[:, 4:7] * DEG])
    turn = block["azimuth_deg"]
    count = round((turn["stop"] - turn["start"]) / turn["step"]) + 1
    azimuth = turn["start"] + turn["step"] * np.arange(count)
    one, other = np.sin(azimuth * DEG), np.cos(azimuth * DEG)
    if block.get("azimuth_from") == "north":
        one, other = other, one
    rows = np.empty((count, 6))
    rows[:, 0], rows[:, 1] = 1e3 * block["range_km"] * one, 1e3 * block["range_km"] * other
    rows[:, 2], rows[:, 3:] = 1e3 * block["down_km"], np.array(attitude) * DEG
    return azimuth, rows


def one_radar(block, level):
    """Return a radar from its block, and from the uncertainty of its level."""
    tolerances, constant = (), block.get("constant")
    if constant is None:
        sheet = block.get("tracking") or block["surveillance"]
        constant = sheet_constant(sheet)
        if isinstance(level["constant"], dict):
            tolerances = tuple(
                (key, sheet[key], std, {**DECIBELS, **LINEAR}[key], key in DECIBELS)
                for key, std in level["constant"].items()
            )
    detector = block.get("detector", "north")
    if isinstance(detector, str):
        detector = {"model": detector}
    return Radar(
        state=np.array([*block["position_m"], constant], dtype=float),
        detector=detector["model"],
        p_fa=float(block["p_fa"]),
        max_range=1e3 * block.get("max_range_km", np.inf),
        horizon=block.get("horizon", False),
        attenuation=1e-3 * block.get("attenuation_db_per_km", 0.0),
        attenuation_std=1e-3 * level.get("attenuation_db_per_km", 0.0),
        tolerances=tolerances,
        pulses=detector.get("pulses", 1),
    )


def sheet_constant(sheet):
    """Return c_r of a data sheet."""
    decibels = sum(power * sheet.get(key, 0.0) for key, power in DECIBELS.items())
    constant = 10 ** (decibels / 10) / sheet.get("temperature_k", 290)
    if "aperture_m2" in sheet:
        seconds = 60 / sheet["rotation_rpm"]
        power = 1e3 * sheet["average_power_kw"] * sheet["aperture_m2"]
        return constant * power * seconds / (16 * sheet["search_volume_sr"])
    wavelength = SPEED_OF_LIGHT / (1e9 * sheet["frequency_ghz"])
    energy = 1e3 * sheet["peak_power_kw"] * 1e-6 * sheet["pulse_width_us"]
    return constant * energy * wavelength**2 / (4 * np.pi) ** 3


def cross_section(block):
    """Return the RCS."""
    if block["model"] == "table":
        azimuth, decibels = np.loadtxt(FOLDER / block["file"], delimiter=",", skiprows=1).T
        return "table", azimuth * DEG, 10 ** (decibels / 10), None, None
    if block["model"] == "constant":
        return "constant", block["rcs_m2"]
    return "ellipsoid", block["a_m"], block["b_m"], block["c_m"]


def at_row(problem, row):
    """Return the oracle of a problem with another aircraft state (6,)."""
    return Oracle(replace(problem, aircraft=row))


def anywhere(at, rows, problem, threshold, correlation_s, runs):
    """Return P(P_D > threshold) at any of some poses, and its standard error.

    The errors of the aircraft are a Gauss–Markov process along the path, and independent from pose
    to pose without a correlation time.
    """
    rng, oracle = np.random.default_rng(1), at_row(problem, rows[0])
    above, error, spread = np.zeros(runs, dtype=bool), 0.0, root(problem.cov_aircraft)
    _, radars, rcs_error, attenuation = oracle.draw(rng, runs)
    for i, row in enumerate(rows):
        kept = 0.0
        if i and correlation_s:
            kept = np.exp(-(at[i] - at[i - 1]) / correlation_s)
        fresh = spread @ rng.standard_normal((6, runs))
        error = kept * error + np.sqrt(1 - kept**2) * fresh
        above |= oracle.p_d(row[:, None] + error, radars, rcs_error, attenuation) > threshold
    share = above.mean()
    return share, probability_se(share, runs)


#: Case, P_max, and the coordinate of the pose that the truth is of.
POSES = (
    ("adv_sam", 0.15, 200.0),
    ("adv5_83", 0.2, 0.0),
    ("rate_8", 0.3, 192.98106867789966),
    ("rate_149", 0.6, 145.57196644182733),
    ("rate_140", 0.2, 107.64496870095337),
    ("rate_1", 0.05, 28.80364055033118),
    ("adv_sam_any2", 0.1473, 70.0),
    ("adv_sam_any2", 0.1473, 60.0),
    ("adv_sam_any2", 0.1473, 80.0),
    ("adv_shorad", 0.1, 0.0),
    ("adv_shorad", 0.1, 45.0),
    ("adv_shorad_net", 0.1, 300.0),
    ("bug", 0.1, 45.0),
    ("low1", 0.9, 0.0),
    ("low1", 0.9, 10.0),
    ("f2_above", 0.1, 0.0),
    ("f2_above", 0.1, 20.0),
)


def main():
    for name, threshold, coordinate in POSES:
        at, rows, problem = read(name)
        row = rows[0] if len(at) == 1 else along(at, rows, np.array([coordinate]))[0]
        oracle = at_row(problem, row)
        p_d = drawn(oracle, np.random.Generator(np.random.SFC64(9)), 2_000_000)
        share = np.mean(p_d > threshold)
        (lower, lower_se, _), (upper, upper_se, _) = (ends(p_d, ndtr(beta)) for beta in (-3, 3))
        print(
            f"{name} at {coordinate:g}: P_D {oracle.nominal():.4f}, mean {p_d.mean():.4f}, "
            f"sigma {p_d.std():.4f}, P(P_D > {threshold:g}) {share:.5f} +/- "
            f"{probability_se(share, len(p_d)):.5f}, lower {lower:.4f} +/- {lower_se:.4f}, "
            f"upper {upper:.4f} +/- {upper_se:.4f}",
            flush=True,
        )
    for name, threshold, correlation, step in (
        ("adv_sam", 0.15, 100.0, 2.0),
        ("adv_sam_any2", 0.1473, 100.0, None),
        ("adv_sam_any2", 0.1473, 100.0, 2.0),
        ("adv_shorad_net", 0.1, 100.0, None),
        ("adv_shorad_net", 0.1, 100.0, 2.0),
        ("f2_above", 0.1, 0.0, None),
        ("adv_shorad", 0.1, 0.0, None),
    ):
        at, rows, problem = read(name)
        if step:
            fine = np.arange(at[0], at[-1] + 1e-9, step)
            at, rows = fine, along(at, rows, fine)
        share, error = anywhere(at, rows, problem, threshold, correlation, 60_000)
        print(f"{name} at any of {len(at)} poses: {share:.4f} +/- {error:.4f}", flush=True)
    for name, threshold in (("adv_graze_ell", 0.3), ("lobe_0.15_98.37", 0.2)):
        at, rows, problem = read(name)
        fine = np.arange(at[0], at[-1], 0.001)
        p_d = at_row(problem, rows[0]).p_d(
            along(at, rows, fine).T, Oracle(problem).nominal_radars[:, None]
        )
        above = fine[p_d > threshold]
        print(f"{name}: P_D {p_d.max():.4f}, above from {above[0]:.2f} to {above[-1]:.2f} s")
    at, rows, problem = read("bud_b")
    for factor in (1.0, 3.727):
        spread = grown(problem, factor)
        three_sigma = [
            3 * drawn(at_row(spread, row), np.random.default_rng(2), 200_000).std() for row in rows
        ]
        print(f"bud_b: 3 sigma {max(three_sigma):.4f} with deviations {factor} times as large")


def grown(problem, factor):
    """Return a problem with all deviations multiplied by a factor."""
    radars = tuple(
        replace(
            radar,
            attenuation_std=factor * radar.attenuation_std,
            tolerances=tuple((*t[:2], factor * t[2], *t[3:]) for t in radar.tolerances),
        )
        for radar in problem.radars
    )
    return replace(
        problem,
        radars=radars,
        cov_aircraft=factor**2 * problem.cov_aircraft,
        cov_radar=factor**2 * problem.cov_radar,
        rcs_db=factor * problem.rcs_db,
    )


if __name__ == "__main__":
    main()
