"""Make the reference set, in some fifteen minutes of CPU on one core.

    pip install -e . --group reference
    PYTHONPATH=tests nice python tests/reference

`scenarios.json` and `poses.csv` are written beside this file; docs/reference_data.md explains them.
"""

import csv
import json
import time
from pathlib import Path

import cases
import draws
import exact
import numpy as np

HERE = Path(__file__).parent
VERSION = 1
STATE = ("north_m", "east_m", "down_m", "roll_rad", "pitch_rad", "yaw_rad")
SLOPES = (
    *("north", "east", "down", "roll", "pitch", "yaw"),
    *("radar_north", "radar_east", "radar_down", "constant", "rcs_error"),
)
#: Numbers of standard deviations at which P_D is to be exceeded, roughly, in turn.
PICKS = (-1.0, 0.0, 1.0, 2.0, 3.0)
#: Points of a scramble; twice as many for the scenarios of the paper.
LOG2_POINTS = 14
#: A pose is taken, or is certain: σ of P_D is below this. A few such poses are enough.
TAKEN, CERTAIN, JUMP = 0, 1, 2
LEAST_STD, MOST_CERTAIN = 1e-4, 2
#: A pose is left out where a bound is not known to this: P_D jumps there.
KNOWN = 0.002
#: What is surely smaller than this is printed as 0.
ZERO = 1e-40


def main():
    start, rows, described = time.process_time(), [], []
    for number, (scenario, poses) in enumerate(cases.scenarios()):
        rcs = exact.cross_section(scenario["rcs"])
        p_d_of = exact.detector(scenario["detector"], scenario["p_fa"])
        detector = draws.Detector(lambda s, f=p_d_of: f(exact.arb(s))[0], scenario["p_fa"])
        papers = number < len(cases.LEVELS)
        log2_points = LOG2_POINTS + papers
        drawn = draws.Draws(scenario, detector, draws.points([cases.SEED, number], log2_points))
        found, taken = [0, 0, 0], 0
        for i, aircraft in enumerate(poses):
            kind, row = one_pose(scenario, rcs, p_d_of, drawn, aircraft, PICKS[i % len(PICKS)])
            found[kind] += 1
            if papers or kind == TAKEN or (kind == CERTAIN and found[CERTAIN] <= MOST_CERTAIN):
                rows.append([number, *row])
                taken += 1
            if taken == cases.POSES and not papers:
                break
        described.append({
            "scenario": number, **scenario, "draws": draws.SCRAMBLES * 2**log2_points,
            "poses": taken, "poses_with_a_jump": found[JUMP],
        })  # fmt: skip
        print(
            f"{number} {scenario['name']}: {taken} of {found}, {time.process_time() - start:.0f} s",
            flush=True,
        )
    write(rows, described)


def one_pose(scenario, rcs, p_d_of, drawn, aircraft, pick):
    """Return the kind of a pose, and its cells unless P_D jumps at a bound."""
    p_d, gradient, std = exact.first_order(scenario, rcs, p_d_of, aircraft)
    assert abs(float(p_d) - drawn.nominal(aircraft)) < 1e-7  # two programs agree
    p_max, found = drawn.at(aircraft, pick)
    if max(error for _, error in found.values()) > KNOWN:
        return JUMP, []
    if not scenario["rcs_error_std"]:
        gradient = gradient[:10]
    cells, errors = zip(*(printed(x) for x in (p_d, *gradient, std)), strict=True)
    cells = [*cells[:-1], *[""] * (exact.STATES - len(gradient)), cells[-1]]
    row = [*(repr(float(x)) for x in aircraft), *cells, f"{max(errors):.1e}"]
    for value in found.values():
        row += known(*value)
    return (TAKEN if found["std"][0] > LEAST_STD else CERTAIN), [*row, repr(p_max)]


def printed(x):
    """Return a ball as text of 17 digits, and a bound of the relative error of the text."""
    if abs(x) < ZERO:
        return "0", 0.0
    text = x.mid().str(17, radius=False)
    error = abs(exact.arb(text) - x) / abs(x)
    return text, float(error.upper())


def known(value, error):
    """Return a value as text of as many digits as its standard error allows, and the error."""
    error = max(error, 1e-12)
    digits = max(2 - int(np.floor(np.log10(error))), 1)
    return f"{value:.{digits}f}", f"{error:.1e}"


def columns():
    """Return the heads of the columns of poses.csv."""
    slopes = [f"dp_{name}" for name in SLOPES]
    heads = ["scenario", *STATE, "p_d", *slopes, "std_linear", "relative_error"]
    bounds = [
        f"{side}_{k}"
        for side, k in zip(["lower"] * 3 + ["upper"] * 3, [3, 2, 1, 1, 2, 3], strict=True)
    ]
    for name in ("mean", "std", *bounds, "exceedance"):
        heads += [name, f"{name}_se"]
    return [*heads, "p_max"]


def write(rows, described):
    with (HERE / "poses.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns())
        writer.writerows(rows)
    about = {
        "version": VERSION,
        "boltzmann": 1.380649e-23,
        "scrambles": draws.SCRAMBLES,
        "scenarios": described,
    }
    lines = json.dumps(about)
    (HERE / "scenarios.json").write_text(lines.replace('{"scenario"', '\n{"scenario"') + "\n")


if __name__ == "__main__":
    main()
