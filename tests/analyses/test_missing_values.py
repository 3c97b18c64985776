"""What has no value by a method is said where a largest value, an area or a band is."""

import numpy as np
import pytest

import radar_sense as rs
from radar_sense import analyses


def beside_a_flash(start, stop):
    """Poses of an aircraft with a narrow flash, at some of which FORM does not converge."""
    s = rs.load_scenario("configs/table.yaml")
    return s.at_poses(np.flatnonzero((s.axis.values >= start) & (s.axis.values <= stop)))


def test_a_largest_value_says_how_many_poses_have_none():
    result = analyses.sensitivity(beside_a_flash(144, 148), method="form")
    largest = result.summary["largest_three_sigma"]
    for line, level in zip(result.report[1:4], ("low", "medium", "high"), strict=True):
        missing = int(np.isnan(result.table[f"three_sigma_{level}"]).sum())
        assert largest[level].get("without_value", 0) == missing
        assert line.endswith("without a value)") == (missing > 0)


@pytest.mark.all_draws
def test_differences_beyond_the_noise_are_none_beside_a_pose_without_a_value():
    result = analyses.compare(beside_a_flash(144, 148))
    assert np.isnan(result.table["lower_3sigma_form"]).any()
    (line,) = (line for line in result.report if line.strip().startswith("form "))
    largest = result.summary["largest_difference"]["form"]["bounds"]["value"]
    assert largest > 4 * max(result.table[f"mc_{end}_error"].max() for end in ("lower", "upper"))
    assert "noise" not in line


def test_a_band_of_range_with_an_end_without_a_value_has_a_width():
    s = rs.load_scenario("configs/spikeball.yaml", {"radar.max_range_km": 615})
    result = analyses.range(s, method="form", step_deg=90)
    assert np.isnan(result.table["lower_3sigma_m_0.5"]).all()
    assert "the band has no width" not in "".join(result.report)
    assert "  P_D 0.5: the lower bound has no value at all 4 bearings" in result.report


def test_areas_are_given_with_cells_that_have_no_value_and_without():
    """The cell straight above a radar without signal has no bound by `form`."""
    constant = {"radar.constant": 1e-9, "uncertainty.radar.medium.constant": 1e-10}
    s = rs.load_scenario(changes={**constant, "geometry.range_km": 10})
    area = {"north_km": (-20, 20), "east_km": (-20, 20), "step_km": 10}
    report = analyses.coverage_map(s, upper=True, method="form", **area).report
    assert "  0.9 or more in 0.0 to 4.0 % of the area, 0 to 100 km^2" in report
