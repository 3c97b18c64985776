"""Unit and meaning of columns. `conftest` insists that every column of every result has them."""

from pathlib import Path

from helpers import few_draws

import radar_sense as rs

ROOT = Path(__file__).parents[2]


def test_columns_of_a_network_on_a_path():
    s = rs.load_scenario(ROOT / "configs/corridor.yaml").at_poses(slice(0, None, 200))
    columns = rs.analyses.variance(s, method="linear").columns
    assert columns["time_s"].unit == "s"
    assert columns["range_m_north"].unit == "m"
    assert "radar north" in columns["range_m_north"].meaning
    assert "all radars" not in columns["p_d_north"].meaning


def test_columns_of_a_mission(monkeypatch):
    few_draws(monkeypatch)
    s = rs.load_scenario(ROOT / "configs/mission.yaml").at_poses(slice(0, 60))
    result = rs.analyses.mission(s, m=2, n=3, runs=4)
    assert "a track" in result.columns["track_p_d"].meaning
