"""The commands with a network: its columns, its map, and a list of one radar."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import cov_by_level, network_document, radar_entry, write, yaml_text
from numpy.testing import assert_array_equal

import radar_sense as rs

pytestmark = pytest.mark.usefixtures("quick")

CONFIGS = Path(__file__).parents[2] / "configs"


# Commands.


def with_few_poses(text):
    """The document of a scenario of `configs` at few azimuths, its files found from elsewhere."""
    content = yaml.safe_load(text)
    for where in (content["geometry"], content["aircraft"]["rcs"]):
        if "file" in where:
            where["file"] = str(CONFIGS / where["file"])
    if "azimuth_deg" in content["geometry"]:
        content["geometry"]["azimuth_deg"]["step"] = 30
    return content


@pytest.mark.parametrize("name", ["paper", "covariance", "s_band_surveillance", "path"])
def test_a_list_of_one_radar_is_that_radar_bit_for_bit(tool, name):
    content = with_few_poses((CONFIGS / f"{name}.yaml").read_text())
    write(yaml_text(content), "single.yaml")
    of_radar = content["uncertainty"].pop("radar")
    content["radars"] = [{"name": "one", **content.pop("radar"), "uncertainty": of_radar}]
    write(yaml_text(content))
    for line in (
        "variance --method form",
        "sensitivity --method probit",
        "budget",
        "montecarlo --runs 64",
        "montecarlo --runs 64 --sampler sobol",
    )[: {"paper": 5, "s_band_surveillance": 4}.get(name, 1)]:
        tables = []
        for file in ("my.yaml", "single.yaml"):
            code, _, err = tool(*line.split(), file, "--no-plot", "--out", file[0])
            assert code == 0, err
            (table,) = Path(file[0]).glob("*.csv")
            tables.append(table.read_bytes())
            table.unlink()
        assert tables[0] == tables[1], line


NETWORK = network_document(
    radar_entry("east", position_m=[0, 2e5, -30], constant=20, max_range_km=600),
    radar_entry("west", position_m=[0, -2e5, -30], constant=30, detector="swerling1"),
)


def test_the_map_of_a_network(tool):
    write(yaml_text(NETWORK))
    line = "map my.yaml --upper --method form --step-km 100 --no-plot --out out"
    code, _, err = tool(*line.split(), *["--north-km", "-400", "400", "--east-km", "-700", "700"])
    assert code == 0, err
    with np.load("out/paper_map.npz") as file:
        found = dict(file)
    s = rs.parse_scenario(yaml_text(NETWORK))
    states = np.tile(s.aircraft[0], (9, 15, 1))
    states[..., 0], states[..., 1] = found["north_m"][:, np.newaxis], found["east_m"]
    p_d = s.model.p_d(states, s.radar)
    assert_array_equal(found["p_d"], p_d.astype(np.float32))
    moments = rs.propagate(
        s.model, states, s.radar, s.cov_aircraft, cov_by_level(s)["low"], method="form"
    )
    seen = s.model.visible(states, s.radar)
    distance = np.linalg.norm(states[..., :3] - s.radar[:3], axis=-1)
    error = 3 * (np.sqrt(s.cov_aircraft[0, 0]) + np.sqrt(cov_by_level(s)["low"][0, 0]))
    crossed = ~seen[..., 0] & (distance - error < 600e3)
    assert np.count_nonzero(crossed) == 1
    same = np.isclose(found["upper_3sigma"], moments.upper, rtol=1e-6, equal_nan=True)
    assert np.array_equal(same, ~crossed)
    assert np.all(found["upper_3sigma"][crossed] > moments.upper[crossed])
    assert not seen[..., 0].all()  # the limit of one of them is on the map
    for i, model in enumerate(s.model.models):
        by_itself = model.p_d(states, s.radar[4 * i : 4 * i + 4])
        assert np.all(p_d >= np.where(seen[..., i], by_itself, 0))
