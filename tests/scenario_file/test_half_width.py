"""Limits of a data sheet in place of a standard deviation: JCGM 101:2008, 6.4.2."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers import document, known_to, yaml_text
from numpy.testing import assert_allclose
from scenario_file.refused import refused
from scipy.constants import Boltzmann
from scipy.optimize import brentq
from scipy.special import ndtr

import radar_sense as rs
from radar_sense.model.radar_constant import Tolerance
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import parse_scenario

TOLERANCES = {
    "gain_dbi": {"half_width": 1},
    "losses_db": {"line": {"half_width": 0.5}},
    "noise_figure_db": 0.3,
}


SHEET = {
    **{"peak_power_kw": 1400, "gain_dbi": 34, "frequency_ghz": 2.8, "pulse_width_us": 0.6},
    **{"temperature_k": 290, "noise_figure_db": 4, "losses_db": {"line": 2}},
}
RANGES = {"start": 60, "stop": 160, "step": 25}


def scenario(tolerances=TOLERANCES):
    """A tracking radar by its data sheet, of Swerling 1, with nothing else uncertain."""
    radar = {"position_m": [0, 0, 0], "p_fa": 1e-6, "detector": "swerling1", "tracking": SHEET}
    content = document(
        radar=radar,
        aircraft={"rcs": {"model": "constant", "rcs_m2": 1}, "attitude_deg": [0, 0, 0]},
        geometry={"type": "radial", "range_km": RANGES, "azimuth_deg": 0, "down_km": -3},
        **known_to(constant=tolerances),
        analysis__runs=20_000,
    )
    return parse_scenario(yaml_text(content))


def decibels_below(x):
    """P(2 g + l + n <= x) by sums: g within 1 dB, l within 0.5 dB, n Gaussian with 0.3 dB."""
    g = (np.arange(2000) + 0.5) / 1000 - 1
    loss = (np.arange(200) + 0.5) / 200 - 0.5
    return float(np.mean(ndtr((x - 2 * g[:, None] - loss) / 0.3)))


def quantile(probability):
    return brentq(lambda x: decibels_below(x) - probability, -4, 4, xtol=1e-6)


def p_d_at(s, decibels):
    """P_D of Swerling 1 with so many decibels more of c_r."""
    distance = np.hypot(1e3 * s.axis.values, 3000)
    snr = s.radar[3] * 10 ** (decibels / 10) / (Boltzmann * distance**4)
    return 1e-6 ** (1 / (1 + snr))


@pytest.mark.parametrize("method", ["automatic", "montecarlo"])
def test_the_band_is_that_of_the_sum_of_rectangles(method):
    s = scenario()
    found = propagate_scenario(s.with_analysis(runs=60_000), method=method)
    for values, probability in ((found.lower, ndtr(-3)), (found.upper, ndtr(3))):
        exact = p_d_at(s, quantile(probability))
        assert np.all(abs(values - exact) < 0.005 + 4 * found.error)


def test_sigma_to_first_order_is_the_half_width_over_the_root_of_three():
    s = scenario()
    found = propagate_scenario(s, method="linear")
    step = 1e-4
    slope = (p_d_at(s, step) - p_d_at(s, -step)) / (2 * step)
    std = math.sqrt((2 * 1) ** 2 / 3 + 0.5**2 / 3 + 0.3**2)
    assert_allclose(found.std, abs(slope) * std, rtol=1e-6)


def test_the_draws_of_monte_carlo_are_within_the_limits():
    s = scenario({"gain_dbi": {"half_width": 1}})
    drawn = rs.monte_carlo(s, runs=20_000)
    for values, db in ((drawn.lower, -2), (drawn.upper, 2)):
        assert_allclose(values, p_d_at(s, db), atol=0.002)
    wide = propagate_scenario(s, method="automatic", beta=6.0)
    assert np.all(wide.upper <= p_d_at(s, 2) + 1e-9)
    assert np.all(wide.lower >= p_d_at(s, -2) - 1e-9)


@pytest.mark.parametrize(
    ("power", "decibels", "value"), [(2, True, 34), (-1, True, 2), (1, False, 10), (-1, False, 10)]
)
def test_moments_of_a_rectangular_factor(power, decibels, value):
    """In closed form: E exp(c x) = sinh(c a)/(c a), and means of powers over an interval."""
    half = 1.2
    found = Tolerance("x", value, half / math.sqrt(3), power, decibels, rectangular=True)
    for order in (1, 2, 3):
        n = power * order
        a = n * math.log(10) / 10 * half if decibels else half / value
        low, high = 1 - a, 1 + a
        if decibels:
            exact = math.sinh(a) / a
        elif n == -1:
            exact = math.log(high / low) / (2 * a)
        else:
            exact = (high ** (n + 1) - low ** (n + 1)) / (2 * a * (n + 1))
        assert found.moment(order) == pytest.approx(exact, rel=1e-9)
    u = np.random.default_rng(2).standard_normal(100_000)
    factors = found.factor(u)
    assert np.mean(factors) == pytest.approx(found.moment(1), rel=5e-3)
    ends = sorted(replace(found, rectangular=False).factor(np.array([-1, 1]) * math.sqrt(3)))
    assert ends[0] <= factors.min() < 1 < factors.max() <= ends[1]


def test_the_record_has_the_limits_as_typed():
    assert scenario().resolved()["uncertainty"]["radar"]["medium"]["constant"] == TOLERANCES


@pytest.mark.parametrize(
    ("tolerance", "message"),
    [
        ({"frequency_ghz": {"half_width": 2}}, "must be a number not less than 0 and not greater"),
        ({"peak_power_kw": {"half_width": 1e6}}, "peak_power_kw.half_width: must be at most "),
    ],
)
def test_wrong_limits_are_refused_in_one_line(tolerance, message):
    with refused(message):
        scenario(tolerance)
