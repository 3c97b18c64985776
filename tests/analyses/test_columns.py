"""Every column that an analysis writes is declared, whatever the options."""

from pathlib import Path

import pytest
from helpers import scenario

import radar_sense as rs
from radar_sense import cli

ROOT = Path(__file__).parents[2]
FEW = {"start": 40, "stop": 60, "step": 20}


@pytest.mark.parametrize("which", ["orbit", "network", "path", "data sheet"])
def test_every_column_is_declared(which):
    files = {"network": "network", "path": "corridor", "data sheet": "s_band_surveillance"}
    if which == "orbit":
        s = scenario(geometry__azimuth_deg=FEW)
    else:
        s = rs.load_scenario(ROOT / f"configs/{files[which]}.yaml").at_poses(slice(0, None, 200))
    runs = [
        ("variance", {"method": "form"}),
        ("variance", {"threshold": 0.5, "k": 2.5, "method": "linear"}),
        ("budget", {"method": "form"}),
        ("budget", {"method": "montecarlo", "runs": 16}),
        ("sensitivity", {"method": "probit"}),
        ("montecarlo", {"method": "probit", "runs": 4}),
    ]
    # between the poses of a path a threshold is tested too, which takes seconds
    for name, options in runs[:1] if which == "path" else runs:
        result = cli.load(name)(s, **options)
        assert list(result.columns) == list(result.table), (name, options)
    if which == "path":
        assert result.columns["time_s"].unit == "s"
        columns = rs.analyses.variance(s, method="linear").columns
        assert columns["range_m_north"].unit == "m"
        assert "radar north" in columns["range_m_north"].meaning
        assert "all radars" not in columns["p_d_north"].meaning


def test_columns_of_a_mission():
    s = rs.load_scenario(ROOT / "configs/mission.yaml").at_poses(slice(0, 60))
    result = rs.analyses.mission(s, m=2, n=3, runs=4)
    assert list(result.columns) == list(result.table)
    assert "a track" in result.columns["track_p_d"].meaning


def test_the_upper_bound_and_the_worst_heading_of_a_map():
    s = scenario(geometry__azimuth_deg=FEW)
    for options in ({"upper": True}, {"worst_heading": True}):
        result = rs.analyses.coverage_map(s, step_km=400, **options)
        assert list(result.columns) == list(result.table)
