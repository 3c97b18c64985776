"""A line of ranges: `geometry: {type: radial}`, against arithmetic of its own."""

import math

import numpy as np
import pytest
from helpers import CONFIGS, document, known_to, yaml_text
from numpy.testing import assert_allclose
from routes import GEO, HEAD
from scenario_file.refused import refused
from scipy.constants import Boltzmann

import radar_sense as rs
from radar_sense import analyses
from radar_sense.scenario_file.load import parse_scenario

CONFIG = CONFIGS / "radial.yaml"


def radial(changes=(), **geometry):
    """A radar of Swerling 1 that sees 0.1 m^2, on a line of ranges."""
    ranges = {"start": 50, "stop": 400, "step": 50}
    line = {"type": "radial", "range_km": ranges, "azimuth_deg": 30, "down_km": -9, **geometry}
    content = document(
        radar={"position_m": [0, 0, 0], "p_fa": 1e-6, "constant": 100, "detector": "swerling1"},
        aircraft={"rcs": {"model": "constant", "rcs_m2": 0.1}, "attitude_deg": [0, 0, 0]},
        geometry=line,
        **known_to(100, 1, position_m=50, constant=5),
    )
    paths = {path.replace(".", "__"): value for path, value in dict(changes).items()}
    return parse_scenario(yaml_text(document(content, **paths)))


def swerling(ranges_m):
    """P_D of Swerling 1 by hand: P_fa^(1/(1 + S)), S = c_r sigma/(k R^4)."""
    snr = 100 * 0.1 / (Boltzmann * ranges_m**4)
    return 1e-6 ** (1 / (1 + snr)), snr


@pytest.mark.parametrize(("origin", "direction"), [("east", (0.25, 0.75)), ("north", (0.75, 0.25))])
def test_positions_are_on_the_line(origin, direction):
    s = radial(azimuth_from=origin)
    ranges = np.arange(50.0, 401.0, 50.0)
    assert s.axis.values.tolist() == ranges.tolist()
    assert_allclose(s.aircraft[:, :2], 1e3 * ranges[:, None] * np.sqrt(direction), rtol=1e-14)
    assert np.all(s.aircraft[:, 2] == -9000)
    assert np.all(s.aircraft[:, 3:] == 0)


def test_p_d_and_snr_along_the_line():
    table = analyses.variance(radial(), method="linear").table
    ranges = np.hypot(1e3 * table["range_km"], 9000)
    p_d, snr = swerling(ranges)
    assert_allclose(table["range_m"], ranges, rtol=1e-14)
    assert_allclose(table["p_d"], p_d, rtol=1e-11)
    assert_allclose(table["snr_db"], 10 * np.log10(snr), rtol=1e-11)


@pytest.mark.all_draws
def test_the_greatest_p_d_between_two_ranges_is_found():
    """The line passes a radar of 2 km between the ranges of 100 and 150 km."""
    changes = {"radar.position_m": [62_500, 108_253, -8_900], "radar.max_range_km": 2.0}
    s = radial(changes, range_km={"start": 100, "stop": 150, "step": 50})
    assert s.model.p_d(s.aircraft, s.radar).max() == 0
    result = analyses.variance(s, threshold=0.5)
    assert result.report[0].startswith("VIOLATED at 12")
    test = result.summary["threshold"]
    assert test["verdict"] == "violated"
    more = 3 * math.hypot(0.1, 0.05)  # the bound reaches 3 sigma of the range farther
    assert test["above_km"] == pytest.approx(4.0 + 2 * more, abs=0.05)


def test_what_needs_times_or_an_attitude_says_so():
    with refused("a mission needs times, which only a path has"):
        analyses.mission(radial())
    with refused("missing key 'attitude_deg', required on a radial"):
        radial({"aircraft": {"rcs": {"model": "constant", "rcs_m2": 0.1}}})


def test_the_figure_has_p_d_and_snr():
    s = rs.load_scenario(CONFIG, {"geometry.range_km.step": 10})
    result = analyses.variance(s, method="form")
    assert result.table["range_km"].tolist() == list(range(2, 61, 10))
    upper, lower = result.plot().axes
    assert lower.get_xlabel() == "Ground range [km]"
    assert lower.get_ylabel() == "SNR [dB]"
    assert_allclose(lower.lines[0].get_ydata(), result.table["snr_db"])
    assert upper.get_ylabel().startswith("Probability")


def test_a_route_is_shifted_as_a_whole(tmp_path):
    for name, text in {
        "ned.csv": f"{HEAD}\n0,0,9e4,-3000\n60,9e3,9e4,-4000\n",
        "geo.csv": f"{GEO}\n0,45,11,3000\n60,45.1,11,4000\n",
        "high.csv": f"{GEO}\n0,45,11,3500\n60,45.1,11,4500\n",
    }.items():
        (tmp_path / name).write_text(text)
    place = {"latitude_deg": 45, "longitude_deg": 10, "altitude_m": 0}

    def path(name, **keys):
        geometry = {"type": "path", "file": str(tmp_path / name), **keys}
        return rs.load_scenario(changes={"geometry": geometry, "aircraft.attitude_deg": ""})

    lifted, before = path("ned.csv", down_km=-0.5), path("ned.csv")
    assert_allclose(lifted.aircraft[:, :3], before.aircraft[:, :3] - [0, 0, 500], rtol=1e-12)
    lifted, high = path("geo.csv", origin=place, altitude_m=500), path("high.csv", origin=place)
    assert_allclose(lifted.aircraft, high.aircraft, rtol=1e-9, atol=1e-9)
    aside = path("ned.csv", north_km=2, east_km=-1).aircraft
    assert_allclose(aside[:, :3], before.aircraft[:, :3] + [2000, -1000, 0], rtol=1e-12)
    below = {**place, "longitude_deg": 11}  # the first row; the earth curves away by d^2/2R
    aside = path("geo.csv", origin=below, north_km=2, east_km=-1).aircraft
    assert_allclose(aside[0, :3], [2000, -1000, -3000 + 5e6 / 2 / 6.37e6], atol=0.01)
    pole = {"latitude_deg": 90, "longitude_deg": 0, "altitude_m": 0}
    (tmp_path / "pole.csv").write_text(f"{GEO}\n0,89.99,11,3000\n60,89.98,11,4000\n")
    beyond = path("pole.csv", origin=pole, north_km=3).aircraft[0, :2]
    assert np.hypot(*beyond) == pytest.approx(3000 - 0.01 * 111_694, abs=1.0)
    for name, keys, message in (
        ("ned.csv", {"altitude_m": 5}, "altitude_m shifts latitude and longitude; here down_km"),
        ("geo.csv", {"down_km": 5, "origin": place}, "down_km shifts north, east, down; here alt"),
    ):
        with refused(message):
            path(name, **keys)
