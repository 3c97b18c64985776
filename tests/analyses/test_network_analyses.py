"""The analyses of a network: its columns, its map, and a list of one radar."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import (
    CONFIGS,
    few_draws,
    paper_network,
    parsed_network,
    radar_entry,
    read_record,
    write,
    yaml_text,
)
from numpy.testing import assert_allclose, assert_array_equal

from radar_sense import analyses
from radar_sense.analyses.rcs import rcs
from radar_sense.propagation import propagate
from radar_sense.scenario import single_radar_scenarios
from radar_sense.scenario_file.load import parse_scenario


def test_variance_table_has_each_radar_and_the_network():
    scenario = paper_network([(0, 0, 0), (1e5, 0, 0)], [60, 100], max_range=5.005e5)
    table = analyses.variance(scenario, method="probit").table
    for i in range(2):
        part = single_radar_scenarios(scenario)[f"r{i}"]
        given = part.model, part.aircraft, part.radar, part.cov_aircraft, part.cov_radar
        single = propagate(*given, method="probit")
        assert_array_equal(table[f"p_d_r{i}"], single.p_d)
        assert_array_equal(table[f"sigma_pd_r{i}"], single.std)
        away = np.linalg.norm(scenario.aircraft[:, :3] - part.radar[:3], axis=1)
        assert_allclose(table[f"range_m_r{i}"], away, rtol=1e-14)
        assert_array_equal(table[f"snr_db_r{i}"] == -np.inf, away > 5.005e5)
        assert_array_equal(single.p_d == 0, away > 5.005e5)
    hidden = table["snr_db_r1"] == -np.inf
    assert 0 < hidden.sum() < len(hidden)
    miss = (1 - table["p_d_r0"]) * (1 - table["p_d_r1"])
    assert_allclose(table["p_d"], 1 - miss, rtol=0, atol=1e-15)


def test_the_cross_sections_seen_are_those_towards_every_radar():
    above, below = (
        radar_entry("a", position_m=[0, 0, -60e3]),
        radar_entry("b", position_m=[0, 0, -30]),
    )
    seen = [rcs(parsed_network(*radars)).summary["geometry"] for radars in ([above], [below])]
    both = rcs(parsed_network(below, above)).summary["geometry"]
    for key in ("elevation_deg", "rcs_m2"):
        ends = np.array([part[key] for part in seen])
        assert_array_equal(both[key], [ends.min(), ends.max()])


@pytest.mark.all_draws
def test_a_radar_alone_is_judged_too():
    """The network is certain by its strong radar. 3 sigma of the other is 0.257 by plain draws."""
    content = """
name: alone
radars:
  - {name: strong, position_m: [0, 0, -20], constant: 5000, p_fa: 1.0e-6,
     uncertainty: {s: {position_m: 10, constant: 10}}}
  - {name: edge, position_m: [0, 40000, -20], constant: 3, p_fa: 1.0e-6, max_range_km: 108.5,
     uncertainty: {s: {position_m: 300, constant: 1}}}
aircraft: {rcs: {model: constant, rcs_m2: 1}, attitude_deg: [0, 0, 90]}
geometry: {type: orbit, range_km: 100, down_km: -3, azimuth_deg: {start: 0, stop: 2, step: 1},
           azimuth_from: north}
uncertainty: {aircraft: {position_m: 20, attitude_deg: 1}}
analysis: {level: s}
"""
    s = parse_scenario(content)
    for analysis in (analyses.variance, analyses.sensitivity):
        named = analysis(s, method="form")
        assert [text for text in named.warnings if text.startswith("edge alone")], analysis
    found = analyses.variance(s, method="automatic")
    assert not found.warnings
    largest = found.summary["largest_three_sigma_by_itself"]["edge"]["value"]
    assert largest == pytest.approx(0.257, rel=0.03)


# Commands.


@pytest.mark.parametrize(
    ("config", "lines"),
    [
        ("s_band_surveillance", ["variance --method form", "budget", "montecarlo --runs 64"]),
        ("mission", ["mission --m 3 --n 4 --runs 64"]),
    ],
)
def test_a_list_of_one_radar_is_that_radar_bit_for_bit(tool, monkeypatch, config, lines):
    few_draws(monkeypatch)
    content = yaml.safe_load((CONFIGS / f"{config}.yaml").read_text())
    if config == "mission":
        content["geometry"]["file"] = str(CONFIGS / content["geometry"]["file"])
    else:
        content["geometry"]["azimuth_deg"]["step"] = 30
    write(yaml_text(content), "single.yaml")
    of_radar = content["uncertainty"].pop("radar")
    content["radars"] = [{"name": "one", **content.pop("radar"), "uncertainty": of_radar}]
    write(yaml_text(content))
    for line in lines:
        found = []
        for file in ("my.yaml", "single.yaml"):
            code, out, err = tool(*line.split(), file, "--no-plot", "--out", file[0])
            assert code == 0, err
            (table,) = Path(file[0]).glob("*.csv")
            words = out.partition(f"{file[0]}/")[0]
            found.append((table.read_bytes(), words, read_record(table.with_suffix(".json"))))
            table.unlink()
        one, other = found
        assert one[:2] == other[:2], line
        assert one[2]["summary"] == other[2]["summary"], line
