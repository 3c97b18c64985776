"""Propagation where tolerances make the constants of some radars of a network log-normal."""

import math

import numpy as np
import pytest
from helpers import cov_by_level, mixed_document, mixed_network, mixed_radars, yaml_text
from numpy.testing import assert_allclose, assert_array_equal

from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.propagation import METHODS, propagate_scenario, unreliable_in_scenario
from radar_sense.propagation.form import Form
from radar_sense.scenario import single_radar_scenarios
from radar_sense.scenario_file.load import parse_scenario
from radar_sense.sources import value_function


def test_form_converges_where_one_radar_fades_and_the_others_do_not():
    """Only one c_r is uncertain. P_D grows with c_r, so its quantiles are known."""
    s = mixed_network()
    cov = np.zeros((12, 12))
    cov[3, 3] = cov_by_level(s)["sheet"][3, 3]
    only = s.states().with_covariances(
        np.zeros((6, 6)), np.zeros((21, 21)), (s.tolerances[0], (), ())
    )
    found = Form(only)
    bounds = {beta: found.quantile(beta) for beta in (-3, 3)}
    relative = math.sqrt(cov[3, 3]) / s.radar[3]
    for beta, bound in bounds.items():
        radar = s.radar.copy()
        radar[3] *= math.exp(beta * relative)
        assert_allclose(bound, s.model.p_d(s.aircraft, radar), atol=5e-5)
    u, weight = np.polynomial.hermite_e.hermegauss(60)
    radars_ = np.tile(s.radar, (60, 1))
    radars_[:, 3] *= np.exp(relative * u)
    p_d = s.model.p_d(s.aircraft[:, np.newaxis], radars_)
    mean = p_d @ weight / weight.sum()
    std = np.sqrt((p_d - mean[:, np.newaxis]) ** 2 @ weight / weight.sum())
    # less well in the middle, where the search for extremes has little to say
    assert_allclose(found.mean, mean, atol=0.002)
    assert_allclose(found.std, std, rtol=0.03)


@pytest.mark.parametrize("method", METHODS)
def test_huge_tolerances_overflow_nothing(method):
    s = mixed_network(mixed_radars({"loss_db": 20}, {"gain_dbi": 20}))
    found = propagate_scenario(s, method=method)
    warned = unreliable_in_scenario(s.with_analysis(method=method), found)
    assert warned.any() == (method != "automatic")
    assert warned.all() or method in ("automatic", "montecarlo")
    if method == "automatic":
        mc = monte_carlo(s, runs=1 << 16, sampler="sobol")
        assert np.all(mc.upper - mc.lower > 0.4)
        assert np.all(abs(found.lower - mc.lower) < 0.005 + 4 * found.error)
        assert np.all(abs(found.upper - mc.upper) < 0.005 + 4 * found.error)
    three_sigma = value_function(mixed_network(), method)(["a_constant_loss_db"], 1e6)
    assert np.all((three_sigma <= 1.5) | (method == "linear") | np.isnan(three_sigma))


def test_each_radar_by_itself_has_its_parts():
    s = mixed_network()
    parts = single_radar_scenarios(s)
    for i, (name, one) in enumerate(parts.items()):
        assert one.tolerances == (s.tolerances[i],)
        assert one.with_analysis(level="plain").tolerances == ((),)
        given = next(r for r in mixed_radars() if r["name"] == name)
        del given["name"]
        single = mixed_document()
        single["uncertainty"]["radar"] = given.pop("uncertainty")
        del single["radars"]
        expected = propagate_scenario(
            parse_scenario(yaml_text(single | {"radar": given})), method="form"
        )
        assert_array_equal(propagate_scenario(one, method="form").upper, expected.upper)
