"""The radar constant from data-sheet parameters, and its uncertainty from theirs."""

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers import sheet_scenario
from mpmath import mp, mpf
from scipy.integrate import quad

from radar_sense.model.radar_constant import (
    LOWEST_DIVISOR,
    MAX_DIVISOR_STD,
    Tolerance,
    factors,
    moments,
    relative_std,
)
from radar_sense.model.radar_equation import SEARCH_FACTORS, SurveillanceRadar

#: Every key of the two kinds, by parameter: its formula in SI, in mpmath.
SAME, DECIBELS = (lambda v: v), (lambda v: mpf(10) ** (v / 10))
ALL = [{"temperature_k": SAME}, {"loss_db": DECIBELS}, {"noise_figure_db": DECIBELS}]
KINDS = {
    "surveillance": [
        {"average_power_w": SAME, "average_power_kw": lambda v: v * 1000},
        {"aperture_m2": SAME},
        {"scan_time_s": SAME, "rotation_rpm": lambda v: 60 / v},
        {"search_volume_sr": SAME},
        *ALL,
    ],
    "tracking": [
        {"peak_power_w": SAME, "peak_power_kw": lambda v: v * 1000},
        {"gain_dbi": DECIBELS},
        {"wavelength_m": SAME, "frequency_ghz": lambda v: mpf(299792458) / (v * 10**9)},
        {"bandwidth_mhz": lambda v: v * 10**6, "pulse_width_us": lambda v: 1 / (v / 10**6)},
        *ALL,
    ],
}


def exactly(kind, values, factor="16"):
    """c_r in fifty digits, from values by key."""
    with mp.workdps(50):
        si = [next(to_si[k](mpf(values[k])) for k in to_si if k in values) for to_si in KINDS[kind]]
        *own, temperature, loss, noise = si
        if kind == "surveillance":
            power, aperture, time, volume = own
            below = {"16": mpf(16), "4pi": 4 * mp.pi}[factor] * volume
            return power * aperture * time / (below * temperature * loss * noise)
        power, gain, wavelength, bandwidth = own
        signal = power * gain**2 * wavelength**2
        return signal / ((4 * mp.pi) ** 3 * bandwidth * temperature * loss * noise)


def any_radar(kind, rng):
    """Values by key over some decades, each parameter under one of its keys."""
    while True:
        values = {}
        for keys in (list(to_si) for to_si in KINDS[kind]):
            key = keys[rng.integers(len(keys))]
            if key.endswith(("_db", "_dbi")):
                low = 0 if key.endswith("_db") else -30  # losses, which are none below 0
                values[key] = float(rng.uniform(low, 50))
            else:
                values[key] = float(10 ** rng.uniform(-3, 1 if key == "search_volume_sr" else 3))
        if 1e-19 < exactly(kind, values) < 1e19:  # what a scenario allows
            return values


@pytest.mark.parametrize("kind", KINDS)
def test_constant_slopes_and_factors_in_fifty_digits(kind):
    """A draw multiplies c_r by the ratio of the formula at drawn and nominal parameters."""
    rng = np.random.default_rng(5)
    for _ in range(30):
        values = any_radar(kind, rng)
        given, factor = dict(values), "16"
        if kind == "surveillance":
            factor = ["16", "4pi"][rng.integers(2)]
            given["search_factor"] = factor if factor == "4pi" or rng.integers(2) else 16
        std = {
            key: float(rng.uniform(0.01, 0.15) * (5 if key.endswith(("_db", "_dbi")) else value))
            for key, value in values.items()
        }
        s = sheet_scenario(kind, given, std)
        parts = s.tolerances[0]
        assert {part.key: part.std for part in parts} == std
        normals, moved, total = rng.standard_normal(len(parts)), dict(values), mpf(0)
        with mp.workdps(50):
            nominal = exactly(kind, values, factor)
            assert s.radar[3] == pytest.approx(float(nominal), rel=1e-13)
            for part, u in zip(parts, normals, strict=True):
                value, width = mpf(values[part.key]), mpf(std[part.key])
                step = width * mpf("1e-15")
                ahead, behind = (
                    exactly(kind, {**values, part.key: value + h}, factor) for h in (step, -step)
                )
                slope = (ahead - behind) / (2 * step) * width / nominal
                assert part.slope == pytest.approx(float(slope), rel=1e-13)
                total += slope**2
                moved[part.key] = value + width * mpf(u)
            drawn = exactly(kind, moved, factor) / nominal
        assert relative_std(parts) == pytest.approx(float(mp.sqrt(total)), rel=1e-13)
        assert factors(parts, normals) == pytest.approx(float(drawn), rel=1e-12)


def test_the_search_factor_is_16_or_4_pi():
    assert sheet_scenario().resolved()["radar"]["surveillance"]["search_factor"] == 16
    with pytest.raises(ValueError, match="16 or 4π"):
        SurveillanceRadar(1, 1, 1, 1, 1, 0, 0, search_factor=12.0)
    assert SurveillanceRadar(1, 1, 1, 1, 1, 0, 0).search_factor == SEARCH_FACTORS["16"]


EVERY_PART = [
    Tolerance("loss_db", 8, 1.2, -1, decibels=True),
    Tolerance("gain_dbi", 40, 0.5, 2, decibels=True),
    Tolerance("gain_dbi", -3, 0.0, 2, decibels=True),
    Tolerance("average_power_kw", 10, 0.5, 1, decibels=False),
    Tolerance("average_power_kw", 10, 6, 1, decibels=False),  # 5 % of the draws are below zero
    Tolerance("wavelength_m", 0.03, 0.003, 2, decibels=False),
    Tolerance("wavelength_m", 0.03, 0.02, 2, decibels=False),
    Tolerance("frequency_ghz", 9.0, 0.2, -2, decibels=False),
    Tolerance("frequency_ghz", 9.0, 1.5, -2, decibels=False),
    Tolerance("temperature_k", 290, 0, -1, decibels=False),
    Tolerance("temperature_k", 290, 290 / 6, -1, decibels=False),
]


@pytest.mark.parametrize("part", EVERY_PART, ids=lambda part: f"{part.key} {part.std:g}")
def test_moments_of_a_factor_by_quadrature(part):
    def factor(u):
        x = part.value + part.std * u
        if part.decibels:
            return 10 ** (part.power * part.std * u / 10)
        if part.power > 0:
            return max(x / part.value, 0.0) ** part.power
        return (max(x, part.value - 5 * part.std) / part.value) ** part.power

    def density(u):
        return math.exp(-0.5 * u * u) / math.sqrt(2 * math.pi)

    zero = -part.value / part.std if part.std else -100
    # the integrand has corners where a draw is set to zero or to the least that there is
    corners = sorted({-30.0, -5.0, 0.0, 5.0, 12.0, 30.0} | ({zero} if -30 < zero < 0 else set()))
    for order in (1, 2, 3):
        exact = sum(
            quad(lambda u, n=order: factor(u) ** n * density(u), *ends, epsabs=0, epsrel=1e-11)[0]
            for ends in pairwise(corners)
        )
        assert part.moment(order) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("std", [0.0, 1e-6, 1e-5, 3e-4, 1e-2, 1.0, 20.0])
def test_the_skewness_of_a_log_normal_factor_is_no_rounding(std):
    s2 = (std * math.log(10) / 10) ** 2
    skewness = (math.exp(s2) + 2) * math.sqrt(math.expm1(s2))
    _, _, found = moments([Tolerance("loss_db", 8, std, -1, decibels=True)])
    assert found == pytest.approx(skewness, rel=1e-9, abs=0.005)


def test_a_divisor_never_comes_near_zero():
    lowest = 1 + LOWEST_DIVISOR * MAX_DIVISOR_STD
    for wider in (1, 1e5):  # in a search for a factor
        std = wider * 300 * MAX_DIVISOR_STD
        part = Tolerance("temperature_k", 300, std, -1, decibels=False)
        assert part.factor(np.array([-100.0, -5.0])).tolist() == pytest.approx([1 / lowest] * 2)
