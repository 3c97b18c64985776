"""The test of radars that are to detect, P_D - k sigma >= P_MIN, against draws and formulas."""

import numpy as np
import pytest
from helpers import scenario
from scipy.special import ndtr
from test_between_rows import flight, radar

from radar_sense import analyses

POSES = {"start": 30, "stop": 60, "step": 30}


@pytest.mark.parametrize("method", ["linear", "form", "automatic"])
def test_the_verdict_is_that_of_the_lower_bound(method):
    s = scenario(geometry__azimuth_deg=POSES).with_analysis(method=method)
    table = analyses.variance(s).table
    lower, ends = (
        table["lower_3sigma"],
        [table[n][0] for n in ("p_d", "lower_3sigma", "upper_3sigma")],
    )
    for p_min, verdict in ((lower.min() - 0.02, "holds"), (lower.min() + 0.02, "violated")):
        result = analyses.variance(s, at_least=float(p_min))
        test = result.summary["threshold"]
        assert (test["verdict"], result.passed) == (verdict, verdict == "holds")
        np.testing.assert_allclose(result.table["margin"], lower - p_min, atol=0.005)
        assert (test["p_min"], test["p_d_itself_below"]) == (p_min, False)
        p_d, low, high = (f"{end:.4f}" for end in ends)
        worst = f"at the worst pose, 30 deg: P_D {p_d}, between {low} and {high} (3 sigma)"
        assert worst in result.report
    assert result.report[0].startswith("VIOLATED at 30 to ")
    assert f"budget with --at-least {p_min:.12g} --k 3" in " ".join(result.report)
    above = analyses.variance(s, at_least=0.99).report
    assert "P_D itself is below 0.99 at all 9 poses: no better knowledge helps there" in above


@pytest.mark.parametrize(("sigmas", "verdict"), [(2.0, "violated"), (8.0, "holds")])
def test_a_hole_between_two_rows_that_errors_reach(tmp_path, sigmas, verdict):
    """The radar sees nothing within 10 km, and half way the aircraft is some sigma outside."""
    std = np.hypot(10.0, 1.0)
    beside = 10e3 + sigmas * std
    rows = f"0,-60000,{beside},0\n600,60000,{beside},0\n"
    rcs = {"model": "constant", "rcs_m2": 1}
    errors = {"position_m": 10, "attitude_deg": 0}
    s = flight(tmp_path, rows, [radar(1000, min_range_km=10)], rcs, errors)
    result = analyses.variance(s, at_least=0.5)
    test = result.summary["threshold"]
    assert test["verdict"] == verdict
    highest = test["highest_probability_below"]
    assert highest["value"] == pytest.approx(ndtr(-sigmas), abs=4 * highest["standard_error"])
    if verdict == "violated":
        assert highest["time_s"] == pytest.approx(300, abs=3)
        assert test["worst_margin"]["value"] == -0.5


SURE = {"position_m": 1, "attitude_deg": 0}
SPHERE = {"model": "constant", "rcs_m2": 1}


def test_a_peak_of_a_mask_between_two_rows(tmp_path):
    """The radar is hidden for some 100 m of 120 km, 2.8 deg above the horizon."""
    mask = "azimuth_deg,elevation_deg\n0,0\n69,0\n70,6\n71,0\n360,0\n"
    (tmp_path / "mask.csv").write_text(mask)
    rows = "0,-60000,60000,-6000\n600,60000,60000,-6000\n"
    s = flight(tmp_path, rows, [radar(1000, mask="mask.csv")], SPHERE, SURE)
    test = analyses.variance(s, at_least=0.5).summary["threshold"]
    assert (test["verdict"], test["p_d_itself_below"]) == ("violated", True)
    place = 600 * (0.5 + 60e3 / np.tan(np.deg2rad(70)) / 120e3)
    assert test["highest_probability_below"]["time_s"] == pytest.approx(place, abs=5)


def test_the_farthest_point_between_two_poses_is_out_of_range():
    """On a circle beside the radar the range is greatest between two of the azimuths."""
    certain = {"position_m": 1, "constant": 0.01}
    s = scenario(
        aircraft__rcs=SPHERE,
        radar__position_m=[0, -20000, 0],
        radar__max_range_km=119.95,
        geometry__range_km=100,
        geometry__azimuth_deg={"start": -10, "stop": 10, "step": 20},
        uncertainty={"aircraft": SURE, "radar": {"medium": certain}},
    )
    assert s.model.visible(s.aircraft, s.radar).all()
    test = analyses.variance(s, at_least=0.5).summary["threshold"]
    assert (test["verdict"], test["p_d_itself_below"]) == ("violated", True)


def test_a_row_of_the_file_between_the_poses(tmp_path):
    """One row is out of range, and the poses are 60 s apart."""
    east = {0: 79500, 94: 79500, 95: 80300, 96: 79500, 240: 79500}
    rows = "".join(f"{time},{time},{east},0\n" for time, east in east.items())
    one = radar(1000, max_range_km=80)
    s = flight(tmp_path, rows, [one], SPHERE, SURE)
    changed = s.with_keys({"geometry.interpolate": "{step_s: 60}"})
    assert len(changed.axis) == 5
    assert analyses.variance(changed, at_least=0.5).summary["threshold"]["p_d_itself_below"]


def test_rounding_of_weights_is_no_probability():
    """All draws are above the limit, and their weights add up to 1 but for rounding."""
    s = scenario(geometry__azimuth_deg={"start": 60, "stop": 60, "step": 1})
    test = analyses.variance(s, at_least=0.01, k=9.0, method="automatic").summary["threshold"]
    assert (test["verdict"], test["poses_violated"]) == ("not known", 0)


def test_the_accuracy_that_it_requires_is_the_least():
    s = scenario(geometry__azimuth_deg={"start": 30, "stop": 30, "step": 1})
    s = s.with_analysis(method="automatic")
    p_d, lower = s.p_d()[0], analyses.variance(s).table["lower_3sigma"][0]
    p_min = float(0.5 * (p_d + lower))
    result = analyses.budget(s, at_least=p_min)
    numbers = result.summary["threshold"]
    assert (numbers["p_min"], numbers["k"]) == (p_min, 3.0)
    found = numbers["required_accuracy"]["radar_constant"]
    factor = found["factor"]
    assert 0 < factor < 1
    assert found["residual"] == pytest.approx(p_min, abs=0.005)  # the bound at this factor
    for part, holds in ((0.96, True), (1.04, False)):
        std = part * factor * np.sqrt(s.cov_radar[3, 3])
        changed = s.with_keys({"uncertainty.radar.medium.constant": f"{std:.12g}"})
        assert analyses.variance(changed, at_least=p_min).passed == holds
    impossible = analyses.budget(s, at_least=float(p_d + 0.01)).report[0]
    assert impossible.endswith("no better knowledge helps: P_D itself is below, most at 30 deg")


def test_the_accuracy_to_first_order_is_in_closed_form():
    s = scenario(geometry__azimuth_deg={"start": 30, "stop": 30, "step": 1})
    found = {name: values[0] for name, values in analyses.budget(s, method="linear").table.items()}
    p_d, total, own = s.p_d()[0], found["three_sigma_total"], found["three_sigma_radar_position"]
    p_min = float(p_d - 0.5 * total)
    result = analyses.budget(s, method="linear", at_least=p_min)
    required = result.summary["threshold"]["required_accuracy"]
    assert required["all"]["factor"] == pytest.approx(0.5, rel=1e-6)
    impossible = required["radar_position"]
    assert impossible["factor"] is None
    assert impossible["residual"] == pytest.approx(p_d - np.sqrt(total**2 - own**2), rel=1e-9)
