"""The analyses of a network, called from Python: budgets, tables and figures."""

import numpy as np
import pytest
from helpers import cov_by_level, paper_network, parsed_network, radar_entry, stds_of, with_arrays
from numpy.testing import assert_allclose, assert_array_equal

from radar_sense import analyses
from radar_sense.accuracy import required_accuracies
from radar_sense.analyses.rcs import rcs
from radar_sense.propagation import propagate, propagate_scenario
from radar_sense.scenario import single_radar_scenarios
from radar_sense.scenario_file.load import load_scenario, parse_scenario
from radar_sense.sources import error_budget

PAPER = load_scenario()
RADAR_MODEL = PAPER.model.radars[0].model


# Budgets and analyses.


def test_budget_has_rows_for_the_aircraft_and_each_radar():
    scenario = paper_network([(0, 0, 0), (1e5, 0, 0), (0, -2e5, 0)], [60, 100, 30])
    found = error_budget(scenario)
    assert list(found.sources) == ["aircraft_position", "aircraft_orientation", "r0", "r1", "r2"]
    parts = [f"r{i}_{part}" for i in range(3) for part in ("position", "constant")]
    assert list(found.finer) == ["aircraft", *parts]
    squares = {name: std**2 for name, std in stds_of({**found.sources, **found.finer}).items()}
    assert_allclose(sum(squares[s] for s in found.sources), found.total.std**2, rtol=1e-12)
    both = squares["aircraft_position"] + squares["aircraft_orientation"]
    assert_allclose(squares["aircraft"], both)
    lin = scenario.model.linearize(scenario.aircraft, scenario.radar)
    expected = np.sum(lin.jac_radar[:, 4:8] ** 2 * np.diag(PAPER.cov_radar), axis=1)
    assert_allclose(squares["r1"], expected)
    for i in range(3):
        parts = squares[f"r{i}_position"] + squares[f"r{i}_constant"]
        assert_allclose(squares[f"r{i}"], parts, rtol=1e-12)
        assert_allclose(found.finer[f"r{i}_constant"].std, 5 * lin.jac_radar[:, 4 * i + 3])
    two = paper_network([(0, 0, 0), (1e5, 0, 0)], [60, 100], poses=slice(90, 91))
    allowed = required_accuracies(two, 0.05)
    assert list(allowed) == ["aircraft_position", "aircraft_orientation", "r0", "r1", "all"]


def test_each_radar_by_itself():
    scenario = paper_network([(0, 0, 0), (1e5, 0, 0)], [60, 100])
    # the second is twice as uncertain as the first
    worse = {level: np.kron(np.diag([1, 4]), c) for level, c in cov_by_level(PAPER).items()}
    scenario = with_arrays(scenario, cov_radar=worse)
    parts = single_radar_scenarios(scenario)
    assert list(parts) == ["r0", "r1"]
    assert_array_equal(parts["r1"].radar, [1e5, 0, 0, 100])
    assert_array_equal(cov_by_level(parts["r0"])["high"], cov_by_level(PAPER)["high"])
    assert_array_equal(cov_by_level(parts["r1"])["high"], 4 * cov_by_level(PAPER)["high"])
    states = scenario.aircraft, parts["r1"].radar
    expected = propagate(RADAR_MODEL, *states, scenario.cov_aircraft, 4 * PAPER.cov_radar)
    assert_array_equal(propagate_scenario(parts["r1"]).std, expected.std)


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
