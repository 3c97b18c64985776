"""Draws of networks whose radar constants are uncertain by their tolerances."""

import math

import numpy as np
import pytest
from helpers import (
    MIXED_DOWN,
    MIXED_RANGE,
    mixed_document,
    mixed_network,
    mixed_radars,
    part_shares,
    yaml_text,
)
from numpy.testing import assert_allclose, assert_array_equal
from studies.bands import cases, truth
from studies.bands.model import Oracle

from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.sampler import clipped
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import parse_scenario
from radar_sense.sources import error_budget


@pytest.mark.parametrize("azimuth", [30, 90])
def test_a_network_against_plain_draws(azimuth):
    draws, angle = 200_000, math.radians(azimuth)
    content = mixed_document(sweep=(azimuth, azimuth, 1), runs=100_000)
    s = parse_scenario(yaml_text(content))
    place = [MIXED_RANGE * math.cos(angle), MIXED_RANGE * math.sin(angle), MIXED_DOWN]
    content["radars"] = [
        {**radar, "uncertainty": {"sheet": radar["uncertainty"]["sheet"]}}
        for radar in content["radars"]
    ]
    problem = cases.of_document(content, [*place, 0.0, 0.0, 0.0])
    drawn = truth.drawn(Oracle(problem), np.random.default_rng(4), draws)
    each = [m.p_d(s.aircraft, s.radar[4 * i : 4 * i + 4])[0] for i, m in enumerate(s.model.models)]
    assert len(set(np.round(each, 2))) == 3
    found = monte_carlo(s)
    noise = drawn.std() * math.sqrt(1 / draws + 1 / found.runs)
    assert found.mean[0] == pytest.approx(drawn.mean(), abs=4.5 * noise)
    # 3 or so is the fourth standardized moment; the quantiles have 270 and 135 draws beyond them
    assert found.std[0] == pytest.approx(drawn.std(), rel=4.5 * 0.7 * math.sqrt(1.5e-5))
    ends = np.quantile(drawn, [0.00135, 0.99865])
    near = 0.15 * drawn.std()
    assert_allclose([found.lower[0], found.upper[0]], ends, atol=near)
    form = propagate_scenario(s, method="form")
    assert_allclose([form.lower[0], form.upper[0]], ends, atol=near)
    assert form.std[0] == pytest.approx(drawn.std(), rel=0.03)
    assert form.mean[0] == pytest.approx(drawn.mean(), abs=0.025 * drawn.std() + 4.5 * noise)
    automatic = propagate_scenario(s)
    assert_allclose([automatic.lower[0], automatic.upper[0]], ends, atol=0.006)
    # the band for Gaussian constants is another one
    linear = propagate_scenario(s, method="linear")
    assert max(abs(linear.lower[0] - ends[0]), abs(linear.upper[0] - ends[1])) > 2 * near


#: A place known better across than along; its eigenvectors are not in the order of its axes.
ALONG = [[1e4, 9e3, 0], [9e3, 1e4, 0], [0, 0, 25]]


def test_a_part_moves_its_constant_and_nothing_else():
    """Correlated positions, and a radar with correlated states, do not change the columns."""
    several = mixed_radars(position_m=ALONG)
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[3, 3] = ALONG, 1e-7
    several[2]["uncertainty"]["sheet"] = {"covariance": whole.tolist()}
    for radar in (several, several[1:], several[:1]):
        states = mixed_network(radar).states()
        expected = states.cov_radar[0].copy()
        moved = states.radars_at(np.eye(states.radar_normals)) - states.radar[0]
        for i, numbers in enumerate(states.tolerance_normals):
            if not numbers:
                continue
            at, parts = 7 * i + 3, len(states.columns) + np.array(numbers)
            assert np.all(moved[parts, at])
            assert_array_equal(np.delete(moved[parts], at, axis=1), 0.0)
            assert_array_equal(np.delete(moved[:, at], parts), 0.0)
            expected[at] = expected[:, at] = 0.0
        root = states.sqrt_cov_radar[0]
        assert_allclose(root @ root.T, expected, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("several", [1, 3])
def test_indices_of_parts_do_not_contain_the_position(several):
    """The positions have all of the variance, and the constants are nearly certain."""
    known = {"loss_db": 1e-6}
    far = [[1e6, 9e5, 0], [9e5, 1e6, 0], [0, 0, 25]]
    s = mixed_network(mixed_radars(known, known, position_m=far)[:several], runs=4096)
    found = error_budget(s, "montecarlo")
    for share in part_shares(found).values():
        assert share.max() < 0.05


def test_a_power_below_zero_is_counted_once_a_run():
    s = mixed_network(
        mixed_radars({"average_power_kw": 0.7}, {"peak_power_kw": 400, "gain_dbi": 2})
    )
    states = s.states()
    first, second, _ = np.arange(len(states.columns), states.radar_normals)
    errors = np.zeros((5, states.radar_normals))
    errors[4, second] = -2  # a Gaussian c_r, known to 94 %, would be below zero
    errors[[0, 2], first] = -3.5
    errors[[0, 1], second] = -5.5
    radar = states.radars_at(errors)
    assert [clipped(one) for one in radar[:, np.newaxis]] == [1, 1, 1, 0, 0]
    assert_array_equal(radar[:, 3] == 0, [True, False, True, False, False])
    assert_array_equal(radar[:, 10] == 0, [True, True, False, False, False])
