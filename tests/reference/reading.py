"""Read the reference set, and its scenarios as those of the package."""

import csv
import json
from functools import cache
from pathlib import Path

import numpy as np
from studies.bands import package

from radar_sense.model.detectors import CFARS, DETECTORS, BinaryIntegration

from . import draws

HERE = Path(__file__).parent
#: Runs of the method `montecarlo`: 500 runs, the default, have no 3σ bound.
RUNS = 20_000
STATE = ("north_m", "east_m", "down_m", "roll_rad", "pitch_rad", "yaw_rad")
OF_AIRCRAFT = ("dp_north", "dp_east", "dp_down", "dp_roll", "dp_pitch", "dp_yaw")
OF_RADAR = ("dp_radar_north", "dp_radar_east", "dp_radar_down", "dp_constant", "dp_rcs_error")


@cache
def read():
    """Return scenarios (dict), each with the columns of its poses: arrays (n,) by their heads.

    An empty cell is NaN.
    """
    scenarios = json.loads((HERE / "scenarios.json").read_text())["scenarios"]
    with (HERE / "poses.csv").open(newline="") as file:
        heads, *rows = csv.reader(file)
    cells = np.array([[float(cell or "nan") for cell in row] for row in rows])
    table = dict(zip(heads, cells.T, strict=True))
    return [
        (
            scenario,
            {head: c[table["scenario"] == scenario["scenario"]] for head, c in table.items()},
        )
        for scenario in scenarios
    ]


def paper(level):
    """Return the columns of the paper's scenario at a level: every 2.5 degrees of its orbit."""
    (columns,) = (columns for block, columns in read() if block["name"] == f"paper, {level}")
    return columns


def as_scenario(block, columns, poses=slice(None)):
    """Return a scenario of the package with some of the poses."""
    states = np.stack([columns[name] for name in STATE], axis=-1)[poses]
    made = draws.problem(block, states, detector=detector(block["detector"]))
    return package.scenario(made).with_analysis(runs=RUNS)


def detector(block):
    """Return the detector of the package."""
    fields = {key: value for key, value in block.items() if key != "model"}
    if "cfar" in fields:
        kind, *parameters = fields["cfar"].values()
        fields["cfar"] = CFARS[kind](*parameters)
    if "binary" in fields:
        fields["binary"] = BinaryIntegration(**fields["binary"])
    return DETECTORS[block["model"]](**fields)


def gradient(columns):
    """Return the gradient by aircraft (n, 6) and radar (n, 4), or (n, 5) with that of the RCS."""
    of_aircraft, of_radar = (
        np.stack([columns[name] for name in names], axis=-1) for names in (OF_AIRCRAFT, OF_RADAR)
    )
    return of_aircraft, of_radar[:, ~np.isnan(of_radar).all(axis=0)]
