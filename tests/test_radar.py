"""The radar constant from data-sheet parameters, and its uncertainty from theirs."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from mpmath import mp, mpf
from scenarios import document

import radar_sense as rs
from radar_sense import analyses
from radar_sense.analyses.error_budget import error_budget, required_accuracies
from radar_sense.errors import ScenarioError
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.radar_constant import (
    LOWEST_DIVISOR,
    MAX_DIVISOR_STD,
    Tolerance,
    factors,
    relative_std,
    shape,
    shape_warning,
)
from radar_sense.model.radar_equation import SEARCH_FACTORS, SurveillanceRadar, TrackingRadar
from radar_sense.model.rcs import ConstantRCS
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.propagation import METHODS, propagate_scenario
from radar_sense.propagation.standard_space import StandardNormalSpace, uncertain_states
from radar_sense.reading.parse import load_scenario, parse_scenario
from radar_sense.states import SOURCES

SURVEILLANCE = {
    "average_power_kw": 10,
    "aperture_m2": 15,
    "temperature_k": 290,
    "rotation_rpm": 10,
    "search_volume_sr": 2,
    "loss_db": 8,
    "noise_figure_db": 3,
}
TRACKING = {
    "peak_power_kw": 250,
    "gain_dbi": 40,
    "frequency_ghz": 9.4,
    "pulse_width_us": 0.8,
    "temperature_k": 290,
    "loss_db": 6,
    "noise_figure_db": 4,
}
TOLERANCES = {
    "surveillance": {"loss_db": 1, "noise_figure_db": 0.5, "average_power_kw": 0.5},
    "tracking": {"gain_dbi": 0.5, "frequency_ghz": 0.05, "pulse_width_us": 0.05, "loss_db": 0.7},
}
#: Geometries at which P_D of the two is neither 0 nor 1.
RANGES = {"surveillance": 220, "tracking": 30}
FEW = {"start": 0, "stop": 90, "step": 15}


def described(kind="surveillance", radar=None, tolerances=None, steps=FEW, **analysis):
    """Document of the paper's scenario with a radar given by its parameters."""
    given = radar or {"surveillance": SURVEILLANCE, "tracking": TRACKING}[kind]
    changed = document(
        radar={"position_m": [0, 0, 0], kind: given, "p_fa": 1e-6},
        geometry__range_km=RANGES[kind],
        geometry__azimuth_deg=steps,
        analysis={"level": "sheet", "runs": 500, "seed": 1, **analysis},
    )
    std = TOLERANCES[kind] if tolerances is None else tolerances
    changed["uncertainty"]["radar"] = {
        "number": {"position_m": 100, "constant": 0.1},
        "sheet": {"position_m": 100, "constant": std},
    }
    return changed


def text(described_document):
    # PyYAML writes 1e-06 as `1.0e-06`, which is a number to the package's reader
    return yaml.safe_dump(described_document, sort_keys=False)


def scenario(*args, **kwargs):
    return parse_scenario(text(described(*args, **kwargs)))


def part_name(key):
    """Name of a part in the budget of a single radar."""
    return f"radar_constant_{key}"


# The constant itself.

#: Every key of the two kinds: its formula in SI, in mpmath.
TO_SI = {
    "average_power_w": ("P", lambda v: v),
    "average_power_kw": ("P", lambda v: v * 1000),
    "peak_power_w": ("P", lambda v: v),
    "peak_power_kw": ("P", lambda v: v * 1000),
    "aperture_m2": ("A", lambda v: v),
    "temperature_k": ("T", lambda v: v),
    "scan_time_s": ("t", lambda v: v),
    "rotation_rpm": ("t", lambda v: 60 / v),
    "search_volume_sr": ("O", lambda v: v),
    "wavelength_m": ("lam", lambda v: v),
    "frequency_ghz": ("lam", lambda v: mpf(299792458) / (v * 10**9)),
    "bandwidth_mhz": ("B", lambda v: v * 10**6),
    "pulse_width_us": ("B", lambda v: 1 / (v / 10**6)),
    "gain_dbi": ("G", lambda v: mpf(10) ** (v / 10)),
    "loss_db": ("L", lambda v: mpf(10) ** (v / 10)),
    "noise_figure_db": ("F", lambda v: mpf(10) ** (v / 10)),
}
KEYS = {
    "surveillance": [
        ("average_power_w", "average_power_kw"),
        ("aperture_m2",),
        ("temperature_k",),
        ("scan_time_s", "rotation_rpm"),
        ("search_volume_sr",),
        ("loss_db",),
        ("noise_figure_db",),
    ],
    "tracking": [
        ("peak_power_w", "peak_power_kw"),
        ("gain_dbi",),
        ("wavelength_m", "frequency_ghz"),
        ("bandwidth_mhz", "pulse_width_us"),
        ("temperature_k",),
        ("loss_db",),
        ("noise_figure_db",),
    ],
}


def exactly(kind, values, factor="16"):
    """c_r in fifty digits, from values by key."""
    with mp.workdps(50):
        p = {TO_SI[key][0]: TO_SI[key][1](mpf(value)) for key, value in values.items()}
        if kind == "surveillance":
            below = {"16": mpf(16), "4pi": 4 * mp.pi}[factor]
            return p["P"] * p["A"] * p["t"] / (below * p["T"] * p["L"] * p["F"] * p["O"])
        signal = p["P"] * p["G"] ** 2 * p["lam"] ** 2
        return signal / ((4 * mp.pi) ** 3 * p["T"] * p["B"] * p["F"] * p["L"])


def any_radar(kind, rng):
    """Values by key over some decades, each parameter under one of its keys."""
    while True:
        values = {
            (key := keys[rng.integers(len(keys))]): float(rng.uniform(0, 50))
            if key.endswith("_db")  # losses, which are none below 0
            else float(rng.uniform(-30, 50))
            if key.endswith("_dbi")
            else float(10 ** rng.uniform(-3, 1 if key == "search_volume_sr" else 3))
            for keys in KEYS[kind]
        }
        if 1e-19 < exactly(kind, values) < 1e19:  # what a scenario allows
            return values


@pytest.mark.parametrize("kind", KEYS)
def test_constant_in_fifty_digits(kind):
    rng = np.random.default_rng(5)
    for _ in range(60):
        values = any_radar(kind, rng)
        given = dict(values)
        factor = "16"
        if kind == "surveillance":
            factor = ["16", "4pi"][rng.integers(2)]
            given["search_factor"] = factor if factor == "4pi" or rng.integers(2) else 16
        exact = exactly(kind, values, factor)
        assert scenario(kind, given, 0.0).radar[3] == pytest.approx(float(exact), rel=1e-13)


def test_the_search_factor_is_a_key():
    sixteen, none, four_pi = (
        scenario("surveillance", {**SURVEILLANCE, **changed})
        for changed in ({"search_factor": 16}, {}, {"search_factor": "4pi"})
    )
    assert none.radar[3] == sixteen.radar[3]
    assert 10 * math.log10(four_pi.radar[3] / none.radar[3]) == pytest.approx(1.0491, abs=5e-5)
    assert none.resolved()["radar"]["surveillance"]["search_factor"] == 16
    with pytest.raises(ValueError, match="16 or 4π"):
        SurveillanceRadar(1, 1, 1, 1, 1, 0, 0, search_factor=12.0)
    assert SurveillanceRadar(1, 1, 1, 1, 1, 0, 0).search_factor == SEARCH_FACTORS["16"]


def snr_db(radar, rcs, distance):
    snr = DetectionModel(ConstantRCS(rcs), p_fa=1e-6).snr(
        np.zeros(6), [distance, 0, 0, radar.constant()]
    )
    return 10 * np.log10(snr)


def test_search_radar_numbers_of_the_radar_toolbox():
    """MATLAB's reference pages; their solid angle of az, el ranges is Δaz (sin el₂ − sin el₁)."""
    # radareqsearchpap: 1 m² at 111 km with 13 dB takes 2.3689e4 W m²
    volume = 2 * np.pi * np.sin(np.pi / 4)
    radar = SurveillanceRadar(2.3689e4, 1, 487, 60 / 12.5, volume, 20, 0, SEARCH_FACTORS["4pi"])
    assert snr_db(radar, 1.0, 111e3) == pytest.approx(13, abs=10 * np.log10(1 + 0.5 / 2.3689e4))
    # radareqsearchsnr: 3e6 W m², 10 s, −10 dBsm at 1000 km, 6 dB losses give 13.8182 dB
    volume = np.radians(30) * np.sin(np.pi / 4)
    radar = SurveillanceRadar(3e6, 1, 487, 10, volume, 6, 0, SEARCH_FACTORS["4pi"])
    assert snr_db(radar, 0.1, 1000e3) == pytest.approx(13.8182, abs=0.00005)


def test_tracking_radar_numbers_of_the_radar_toolbox():
    """MATLAB's reference pages radareqsnr, radareqpow and radareqrng, with B = 1/τ."""
    x_band = 299792458 / 10e9
    radar = TrackingRadar(1e6, 40, x_band, 1 / 1e-6, 300, 3, 0)
    assert snr_db(radar, 0.5, 100e3) == pytest.approx(14.3778, abs=0.00005)
    radar = TrackingRadar(1e6, 20, 299792458 / 1e9, 1 / 0.2e-6, 290, 0, 0)
    assert snr_db(radar, 1.0, 50e3) == pytest.approx(5.5868, abs=0.00005)
    radar = TrackingRadar(2.2809e6, 30, x_band, 1 / 1e-6, 300, 3, 0)
    assert snr_db(radar, 0.5, 50e3) == pytest.approx(10, abs=10 * np.log10(1 + 0.5e-4 / 2.2809))
    radar = TrackingRadar(1e6, 40, x_band, 1 / 10e-6, 290, 3, 0)
    assert snr_db(radar, 0.1, 1.9426e5) == pytest.approx(6, abs=40 * np.log10(1 + 0.5e-4 / 1.9426))


def test_c_band_example_of_the_textbook():
    """Mahafza (2000), section 1.4: 0.1 m² is seen with 20 dB as far as 86.2 km.

    His sum of decibels is 61.761 + 90 − 25.421 − 10 − 32.976 + 136.987 − 3 − 20 = 197.351, with
    k = 1.38e-23 and c = 3e8; these, and three decimals of a decibel, are worth 0.01 dB.
    """
    radar = TrackingRadar(1.5e6, 45, 3e8 / 5.6e9, 5e6, 290, 0, 3)
    assert snr_db(radar, 0.1, 10 ** (19.7351 / 4)) == pytest.approx(20, abs=0.01)


# Its uncertainty.


def parts_of(kind, values, std):
    """Parts by key, by way of a scenario."""
    found = scenario(kind, values, std).tolerances["sheet"][0]
    assert {part.key: part.std for part in found} == std
    return found


@pytest.mark.parametrize("kind", KEYS)
def test_derivatives_are_those_of_the_formula(kind):
    rng = np.random.default_rng(7)
    for _ in range(25):
        values = any_radar(kind, rng)
        std = {
            key: float(rng.uniform(0.01, 0.15) * (5 if key.endswith(("_db", "_dbi")) else value))
            for key, value in values.items()
        }
        parts = parts_of(kind, values, std)
        total = mpf(0)
        with mp.workdps(50):
            nominal = exactly(kind, values)
            for part in parts:
                step = mpf(std[part.key]) * mpf("1e-15")
                ahead, behind = (
                    exactly(kind, {**values, part.key: mpf(values[part.key]) + h})
                    for h in (step, -step)
                )
                slope = (ahead - behind) / (2 * step) * mpf(std[part.key]) / nominal
                assert part.slope == pytest.approx(float(slope), rel=1e-13)
                total += slope**2
        assert relative_std(parts) == pytest.approx(float(mp.sqrt(total)), rel=1e-13)


@pytest.mark.parametrize("kind", KEYS)
def test_covariance_is_that_of_first_order(kind):
    s = scenario(kind)
    assert s.cov_radar["sheet"][3, 3] == pytest.approx(
        (s.radar[3] * relative_std(s.tolerances_at_level[0])) ** 2, rel=1e-14
    )
    assert s.cov_radar["number"][3, 3] == pytest.approx(0.01, rel=1e-14)
    assert s.with_analysis(level="number").tolerances_at_level == ((),)
    off = s.cov_radar["sheet"] - np.diag(np.diag(s.cov_radar["sheet"]))
    assert not off.any()


@pytest.mark.parametrize("kind", KEYS)
def test_factors_are_those_of_the_formula(kind):
    """A draw multiplies c_r by what the formula makes of the parameters drawn."""
    rng = np.random.default_rng(9)
    for _ in range(20):
        values = any_radar(kind, rng)
        std = {
            key: 1.0 if key.endswith(("_db", "_dbi")) else 0.1 * value
            for key, value in values.items()
        }
        parts = parts_of(kind, values, std)
        white = rng.standard_normal(len(parts))
        moved = dict(values)
        for part, u in zip(parts, white, strict=True):
            moved[part.key] = mpf(values[part.key]) + mpf(std[part.key]) * mpf(u)
        exact = exactly(kind, moved) / exactly(kind, values)
        assert factors(parts, white) == pytest.approx(float(exact), rel=1e-12)


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
def test_moments_of_a_factor_in_fifty_digits(part):
    def factor(u):
        x = part.value + mpf(part.std) * u
        if part.decibels:
            return mpf(10) ** (part.power * (x - part.value) / 10)
        if part.power > 0:
            return max(x / part.value, mpf(0)) ** part.power
        return (max(x, part.value - 5 * mpf(part.std)) / part.value) ** part.power

    zero = -part.value / part.std if part.std else -100
    # the integrand has corners where a draw is set to zero or to the least that there is
    corners = sorted({-40.0, -5.0, 0.0, 5.0, 12.0, 40.0} | ({zero} if -40 < zero < 0 else set()))
    with mp.workdps(25):
        for order in (1, 2, 3):
            exact = mp.quad(lambda u, n=order: factor(u) ** n * mp.npdf(u), corners)
            assert part.moment(order) == pytest.approx(float(exact), rel=1e-9)


@pytest.mark.parametrize("kind", KEYS)
def test_draws_have_the_moments(kind):
    s = scenario(kind)
    sampler = Sampler.of(s)
    runs = 400_000
    white = np.random.default_rng(3).standard_normal((runs, sampler.radar_normals))
    assert sampler.radar_normals == 3 + len(TOLERANCES[kind])
    radar, zero = sampler.draw_radar(white)
    drawn, exact = radar[:, 3] / s.radar[3], shape(s.tolerances_at_level[0])
    assert not zero.any()
    # 4.5 standard errors: of the mean, of the deviation (by the fourth moment), of the skewness
    assert drawn.mean() == pytest.approx(exact.mean, abs=4.5 * exact.std / math.sqrt(runs))
    centred = (drawn - drawn.mean()) / drawn.std()
    error = math.sqrt((np.mean(centred**4) - 1) / (4 * runs))
    assert drawn.std() == pytest.approx(exact.std, rel=4.5 * error)
    assert np.mean(centred**3) == pytest.approx(exact.skewness, abs=0.05)
    # and they are far from the first order, which would not pass
    assert exact.std / relative_std(s.tolerances_at_level[0]) - 1 > 3 * 4.5 * error
    np.testing.assert_allclose(radar[:, :3].std(axis=0), 100, rtol=0.01)
    assert np.max(abs(np.corrcoef(radar.T) - np.eye(4))) < 0.01


def test_a_power_below_zero_is_no_power():
    sampler = Sampler.of(scenario(tolerances={"average_power_kw": 6, "loss_db": 1}))
    white = np.zeros((4, 5))
    white[:, 3] = [-3, -1.7, -1.6, 0]  # 10 + 6 u kW
    radar, zero = sampler.draw_radar(white)
    assert zero.tolist() == [True, True, False, False]
    np.testing.assert_allclose(radar[:, 3] / radar[3, 3], [0, 0, 0.04, 1], rtol=1e-12, atol=0)


def test_a_divisor_never_comes_near_zero():
    part = Tolerance("temperature_k", 300, 300 * MAX_DIVISOR_STD, -1, decibels=False)
    lowest = 1 + LOWEST_DIVISOR * MAX_DIVISOR_STD
    assert part.factor(np.array([-100.0, -5.0])).tolist() == pytest.approx([1 / lowest] * 2)


def test_radar_positions_stay_as_they_were_drawn():
    """Parts take the place of c_r's unit normal; the first three remain the position's."""
    sampler = Sampler.of(scenario())
    white = np.random.default_rng(1).standard_normal((50, sampler.radar_normals))
    radar, _ = sampler.draw_radar(white)
    np.testing.assert_allclose(radar[:, :3], 100 * white[:, :3], rtol=1e-14)


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_monte_carlo_draws_the_true_distribution(sampler):
    """P_D far from any pose's edge, with nothing uncertain but c_r: E and σ by quadrature."""
    d = described(tolerances={"loss_db": 1.0}, steps={"start": 40, "stop": 40, "step": 1})
    d["uncertainty"]["aircraft"] = {"position_m": 0, "attitude_deg": 0}
    d["uncertainty"]["radar"]["sheet"]["position_m"] = 0
    s = parse_scenario(text(d))
    u = np.linspace(-8, 8, 4001)
    weight = np.exp(-u * u / 2)
    weight /= weight.sum()
    states = np.broadcast_to(s.radar, (len(u), 4)).copy()
    states[:, 3] *= 10 ** (-u / 10)
    p_d = s.model.p_d(s.aircraft[0], states)
    mean = np.sum(weight * p_d)
    std = math.sqrt(np.sum(weight * (p_d - mean) ** 2))
    mc = monte_carlo(s, runs=2**15, sampler=sampler)
    within = 4.5 / math.sqrt(2**15) if sampler == "random" else 2e-3
    assert mc.mean[0] == pytest.approx(mean, abs=within * std)
    assert mc.std[0] == pytest.approx(std, rel=within)
    # in one dimension, P_D at the quantiles of the loss, but for the tolerance of the search
    form = propagate_scenario(s, method="form")
    lower, upper = (
        s.model.p_d(s.aircraft[0], [*s.radar[:3], s.radar[3] * 10 ** (side * 0.3)])
        for side in (-1, 1)
    )
    assert form.lower[0] == pytest.approx(lower, rel=1e-3)
    assert form.upper[0] == pytest.approx(upper, rel=1e-3)
    assert form.std[0] == pytest.approx(std, rel=2e-3)
    assert form.mean[0] == pytest.approx(mean, rel=1e-3)


def test_first_order_does_not_know_of_logarithms():
    s = scenario()
    cov = s.cov_aircraft, s.cov_radar["sheet"]
    linear = s.model.linearize(s.aircraft, s.radar).std(*cov)
    np.testing.assert_allclose(propagate_scenario(s).std, linear, rtol=1e-14)
    as_number, as_log = (
        rs.propagate(s.model, s.aircraft, s.radar, *cov, method="form", log_constant=log)
        for log in (False, True)
    )
    assert np.max(abs(as_number.lower - as_log.lower)) > 0.05
    np.testing.assert_array_equal(as_log.lower, propagate_scenario(s, method="form").lower)


def test_gradient_of_z_where_ln_c_is_gaussian():
    s = scenario()
    states = s.model, s.aircraft, s.radar, s.cov_aircraft, s.cov_radar["sheet"]
    z = StandardNormalSpace.of(uncertain_states(*states, log_constant=True)[1])
    pose = np.arange(len(s.aircraft))
    u = np.random.default_rng(2).standard_normal(z.gradient.shape)
    gradient = z(u, pose)[1]
    for i in range(len(u)):
        step = 1e-5 * np.eye(len(u))[:, i, np.newaxis]
        slope = (z(u + step, pose)[0] - z(u - step, pose)[0]) / 2e-5
        np.testing.assert_allclose(gradient[i], slope, rtol=1e-6, atol=1e-7)


def test_validation_draws_the_true_distribution():
    d = described(steps={"start": 40, "stop": 40, "step": 1})
    found = analyses.validate(parse_scenario(text(d)), method="form", digits=1)
    assert found.passed
    assert not analyses.validate(parse_scenario(text(d)), digits=1).passed


# Where c_r is not what a method takes it for.


def test_doubt_says_what_the_distribution_is():
    decibel = [Tolerance("loss_db", 8, 1.0, -1, decibels=True)]
    said = shape_warning(decibel, "linear", log_normal=False)
    s = math.log(10) / 10
    growth = math.exp(s * s)
    mean, std = math.sqrt(growth), math.sqrt(growth * (growth - 1))
    skewness = (growth + 2) * math.sqrt(growth - 1)
    assert f"its mean is {mean:.1%} (Gaussian: 100.0%)" in said
    assert f"standard deviation {std:.1%} ({s:.1%})" in said
    assert f"skewness {skewness:.2f} (0.00)" in said
    # a tolerance in decibels is what probit and form assume
    assert shape_warning(decibel, "probit", log_normal=True) is None
    assert shape_warning(decibel, "form", log_normal=True) is None
    assert (
        shape_warning([Tolerance("loss_db", 8, 0.2, -1, decibels=True)], "linear", log_normal=False)
        is None
    )
    power = [Tolerance("average_power_kw", 10, 3, 1, decibels=False)]
    assert shape_warning(power, "linear", log_normal=False) is None
    assert "c_r is not log-normal, the assumption of form" in shape_warning(power, "form", log_normal=True)
    assert (
        shape_warning([Tolerance("loss_db", 8, 0, -1, decibels=True)], "linear", log_normal=False)
        is None
    )


@pytest.mark.parametrize(
    "analyse", [analyses.variance, analyses.budget, analyses.montecarlo, analyses.sensitivity]
)
def test_every_analysis_says_so(analyse):
    said = "c_r is not Gaussian, the assumption of linear"
    warnings = [w for w in analyse(scenario()).warnings if said in w]
    assert len(warnings) == 1
    assert warnings[0].startswith("sheet: ") == (analyse is analyses.sensitivity)
    plain = scenario(level="number")
    if analyse is not analyses.sensitivity:
        assert not [w for w in analyse(plain).warnings if said in w]


# The budget.


@pytest.mark.parametrize("kind", KEYS)
def test_parts_add_up_in_quadrature(kind):
    s = scenario(kind)
    found = error_budget(s)
    assert list(found.parts) == [part_name(part.key) for part in s.tolerances_at_level[0]]
    assert {part.key for part in s.tolerances_at_level[0]} == set(TOLERANCES[kind])
    together = np.sqrt(np.sum([std**2 for std in found.parts.values()], axis=0))
    np.testing.assert_allclose(together, found.alone["radar_constant"], rtol=1e-12)
    by_c = s.model.linearize(s.aircraft, s.radar).jac_radar[:, 3]
    for part in s.tolerances_at_level[0]:
        expected = abs(by_c * s.radar[3] * part.slope)
        np.testing.assert_allclose(found.parts[part_name(part.key)], expected, rtol=1e-10)
    assert list(found.shares()) == [*SOURCES, "interaction"]
    np.testing.assert_allclose(np.sum(list(found.shares().values()), axis=0), 1, rtol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_part_alone_is_the_scenario_with_nothing_else(method):
    found = error_budget(scenario(), method)
    for key, std in TOLERANCES["surveillance"].items():
        d = described(tolerances={key: std})
        d["uncertainty"]["aircraft"] = {"position_m": 0, "attitude_deg": 0}
        d["uncertainty"]["radar"]["sheet"]["position_m"] = 0
        alone = propagate_scenario(parse_scenario(text(d)), method=method).std
        # by the search for extremes to its tolerance
        np.testing.assert_allclose(found.parts[part_name(key)], alone, rtol=1e-4)


def test_indices_of_parts_by_monte_carlo():
    s = scenario(steps={"start": 40, "stop": 40, "step": 1}, runs=2**14)
    found = error_budget(s, "montecarlo")
    form = error_budget(s, "form")
    assert found.std[0] == pytest.approx(form.std[0], rel=0.01)
    shares, errors = found.part_shares(), found.share_error
    for key in TOLERANCES["surveillance"]:
        assert errors[part_name(key)][0] < 0.02
        assert shares[part_name(key)][0] == pytest.approx(
            form.part_shares()[part_name(key)][0], rel=0.35
        )
    of_sources = [errors[source][0] for source in SOURCES]
    assert errors["interaction"][0] == pytest.approx(np.linalg.norm(of_sources), rel=1e-12)
    # what a part brings about alone, and averaged over the others, are not quite the same
    together = sum(share[0] for share in shares.values())
    whole = found.shares()["radar_constant"][0]
    assert 0.9 * whole < together < whole + 0.02
    assert np.sum(list(found.shares().values()), axis=0) == pytest.approx(1)
    # the index of the whole does not depend on its parts being listed too
    assert whole == pytest.approx(found.total_index["radar_constant"][0], abs=0.02)


def test_budget_shows_the_parts(tool):
    Path("my.yaml").write_text(text(described()))
    code, out, _ = tool("budget", "my.yaml", "--out", "out", "--no-plot")
    assert code == 0
    result = analyses.budget(load_scenario("my.yaml"))
    assert out.splitlines()[:-2] == list(result.report)
    rows = re.findall(r"^    (\w+) +([\d.]+) +([\d.]+)%$", out, re.MULTILINE)
    assert [key for key, _, _ in rows] == ["loss_db", "noise_figure_db", "average_power_kw"]
    assert out.index("radar_constant ") < out.index("    loss_db") < out.index("  total")
    columns = (Path("out") / "paper_budget.csv").read_text().splitlines()[0].split(",")
    assert columns == [
        "theta_r_deg",
        *(f"three_sigma_{source}" for source in SOURCES),
        "three_sigma_total",
        *(
            f"three_sigma_radar_constant_{part.key}"
            for part in result.scenario.tolerances_at_level[0]
        ),
    ]
    summary = json.loads((Path("out") / "paper_budget.json").read_text())["summary"]
    at_largest = summary["radar_constant_parts_at_largest"]
    for key, three_sigma, share in rows:
        assert at_largest[key] == pytest.approx(float(three_sigma), abs=5e-5)
        assert summary["shares_of_radar_constant_parts_at_largest"][key] == pytest.approx(
            float(share) / 100, abs=5e-4
        )
    assert sum(at**2 for at in at_largest.values()) == pytest.approx(
        summary["at_largest"]["radar_constant"] ** 2
    )


def test_budget_says_what_to_measure_better():
    s = scenario()
    result = analyses.budget(s)
    line = next(line for line in result.report if "measure better" in line)
    assert "loss_db is what to measure better first" in line
    better = scenario(tolerances={**TOLERANCES["surveillance"], "loss_db": 0.5})
    pose = s.theta_r_deg.tolist().index(
        result.summary["largest_three_sigma_total"]["theta_r_deg"][0]
    )
    total = 3 * propagate_scenario(better).std[pose]
    assert line.endswith(f"with half its deviation the total would be {total:.4f}")
    plain = analyses.budget(scenario(level="number"))
    assert not [line for line in plain.report if "measure better" in line]
    assert not [column for column in plain.table if "radar_constant_" in column]
    assert not [key for key in plain.summary if "parts" in key]


@pytest.mark.parametrize("method", ["linear", "probit"])
def test_how_much_a_part_must_be_reduced(method):
    s = scenario()
    # as small as it gets with half of the loss's deviation, so that 0.5 is the answer
    half = scenario(tolerances={**TOLERANCES["surveillance"], "loss_db": 0.5})
    target = 3 * propagate_scenario(half, method=method).std.max()
    allowed = required_accuracies(s, target, method=method)
    parts = [part_name(part.key) for part in s.tolerances_at_level[0]]
    assert list(allowed) == [*SOURCES, *parts, "all"]
    assert allowed["radar_constant_loss_db"].factor == pytest.approx(0.5, rel=1e-6)
    assert allowed["radar_constant_average_power_kw"].factor is None
    assert allowed["radar_constant_average_power_kw"].residual_from == "radar_constant_loss_db"
    assert allowed["aircraft_position"].residual_from == "radar_constant"
    report = "\n".join(analyses.budget(s, method=method, target=target).report)
    assert re.search(r"^    loss_db +0\.5$", report, re.MULTILINE)


def test_certain_parts_bring_nothing():
    s = scenario(tolerances={"loss_db": 0.0, "average_power_kw": 0})
    found = error_budget(s)
    assert not found.alone["radar_constant"].any()
    assert not np.any(list(found.parts.values()))
    assert shape_warning(s.tolerances_at_level[0], "linear", log_normal=False) is None
    assert analyses.budget(s, method="montecarlo").report


def test_figure_of_a_budget_with_parts(tool):

    labels = [str(line.get_label()) for line in analyses.budget(scenario()).plot().axes[0].lines]
    assert {"loss_db", "noise_figure_db", "average_power_kw"} < set(labels)


# What a scenario may say.


@pytest.mark.parametrize("kind", KEYS)
@pytest.mark.parametrize("level", ["sheet", "number"])
def test_resolved_scenario_reads_back(tool, kind, level):
    Path("my.yaml").write_text(text(described(kind, level=level)))
    code, out, err = tool("check", "my.yaml")
    assert (code, err) == (0, "")
    first, again = load_scenario("my.yaml"), parse_scenario(out)
    assert again.resolved() == first.resolved()
    np.testing.assert_array_equal(again.radar, first.radar)
    for name, cov in first.cov_radar.items():
        np.testing.assert_array_equal(again.cov_radar[name], cov)
    assert again.tolerances == first.tolerances
    assert again.tolerances_at_level == (first.tolerances["sheet"] if level == "sheet" else ((),))


def test_check_shows_the_distribution(tool):
    Path("my.yaml").write_text(text(described()))
    _, out, _ = tool("check", "my.yaml")
    s = load_scenario("my.yaml")
    exact, c = shape(s.tolerances_at_level[0]), s.radar[3]
    assert out.splitlines()[1] == (
        f"# sheet: c_r has mean {c * exact.mean:.4g}, standard deviation {c * exact.std:.4g} "
        f"(first order {c * relative_std(s.tolerances_at_level[0]):.4g}), "
        f"skewness {exact.skewness:.2f}"
    )
    assert "# number" not in out


def changed(kind, without=(), tolerances=None, **added):
    base = {"surveillance": SURVEILLANCE, "tracking": TRACKING}[kind]
    radar = {key: value for key, value in {**base, **added}.items() if key not in without}
    return described(kind, radar, tolerances)


BAD = {
    "two keys of one parameter": (
        changed("surveillance", average_power_w=1),
        "radar.surveillance: needs exactly one of the keys 'average_power_w' and "
        "'average_power_kw'",
    ),
    "no key of a parameter": (
        changed("tracking", without=["frequency_ghz"]),
        "radar.tracking: needs exactly one of the keys 'frequency_ghz' and 'wavelength_m'",
    ),
    "missing": (
        changed("tracking", without=["gain_dbi"]),
        "radar.tracking: missing key 'gain_dbi'",
    ),
    "misspelled": (
        changed("tracking", without=["gain_dbi"], gain_db=40),
        "radar.tracking: unknown key 'gain_db', allowed: .*did you mean 'gain_dbi'",
    ),
    "key of the other kind": (
        changed("tracking", search_factor=16),
        "radar.tracking: unknown key 'search_factor'",
    ),
    "search factor": (
        changed("surveillance", search_factor="4π"),
        "radar.surveillance.search_factor: must be one of 16, 4pi, got '4π'",
    ),
    "search factor as a number": (
        changed("surveillance", search_factor=12.566),
        "must be one of 16, 4pi, got 12.566",
    ),
    "zero": (
        changed("tracking", frequency_ghz=0),
        "radar.tracking.frequency_ghz: must be a number greater than 0, got 0",
    ),
    "decibels": (
        changed("tracking", gain_dbi=4000),
        "radar.tracking.gain_dbi: must be a number not less than -200 and not greater than 200",
    ),
    "impossible constant": (
        changed("tracking", gain_dbi=200, peak_power_kw=1e10),
        r"radar.tracking: makes the radar constant 1.\d+e\+\d+ J m\^2/K",
    ),
    "two kinds": (
        {
            **described(),
            "radar": {
                "position_m": [0, 0, 0],
                "surveillance": SURVEILLANCE,
                "tracking": TRACKING,
                "p_fa": 1e-6,
            },
        },
        "radar: needs one of the keys 'constant', 'surveillance' and 'tracking', and not both",
    ),
    "tolerance of what is not given": (
        changed("surveillance", tolerances={"average_power_w": 500}),
        "sheet.constant: unknown key 'average_power_w', allowed: average_power_kw, .*"
        "did you mean 'average_power_kw'",
    ),
    "tolerance of the search factor": (
        changed("surveillance", tolerances={"search_factor": 1}, search_factor=16),
        "sheet.constant: unknown key 'search_factor'",
    ),
    "no tolerance": (
        changed("surveillance", tolerances={}),
        "sheet.constant: needs at least one of the keys average_power_kw, aperture_m2",
    ),
    "negative tolerance": (
        changed("surveillance", tolerances={"loss_db": -1}),
        "sheet.constant.loss_db: must be a number not less than 0 and not greater than 20, got -1",
    ),
    "absurd tolerance": (
        changed("surveillance", tolerances={"loss_db": 21}),
        "sheet.constant.loss_db: must be .* not greater than 20, got 21",
    ),
    "tolerance that is no number": (
        changed("surveillance", tolerances={"loss_db": "1 dB"}),
        "sheet.constant.loss_db: must be a number .*, got '1 dB'",
    ),
    "divisor that may be zero": (
        changed("surveillance", tolerances={"temperature_k": 50}),
        "sheet.constant.temperature_k: must be a number not less than 0 and not greater than "
        "48.3333, 1/6 of the parameter, as c_r is divided by it; got 50",
    ),
    "divisor in inverse units": (
        changed("surveillance", tolerances={"rotation_rpm": 2}),
        "sheet.constant.rotation_rpm: must be .*not greater than 1.66667",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_refused(tool, case):
    bad, says = BAD[case]
    Path("my.yaml").write_text(text(bad))
    code, out, err = tool("budget", "my.yaml", "--out", "out")
    assert (code, out) == (2, "")
    assert re.fullmatch(rf"Error: my.yaml:\d+: .*{says}.*\n", err), err
    assert not Path("out").exists()


def test_parts_need_a_radar_that_has_them(tool):
    bad = document(uncertainty__radar__low__constant={"loss_db": 1})
    with pytest.raises(ScenarioError, match=r"low.constant: must be a number not less than 0, got"):
        parse_scenario(text(bad))
    with pytest.raises(ScenarioError, match=r"need radar.surveillance or radar.tracking in place"):
        parse_scenario(text(bad))


def test_wide_tolerance_of_a_factor_is_allowed():
    s = scenario("tracking", tolerances={"pulse_width_us": 0.8, "wavelength_m": 0.01}, radar={
        **{key: value for key, value in TRACKING.items() if key != "frequency_ghz"},
        "wavelength_m": 0.03,
    })  # fmt: skip
    mc = monte_carlo(s, runs=500)
    assert np.isfinite(mc.mean).all()
    # Φ(−1) of the pulse widths and Φ(−3) of the wavelengths are below zero
    assert 50 < mc.clipped < 110


# The configurations.


@pytest.mark.parametrize("name", ["s_band_surveillance", "x_band_tracking"])
def test_configurations(name):
    s = load_scenario(f"configs/{name}.yaml")
    assert s.name == name
    p_d = s.model.p_d(s.aircraft, s.radar)
    assert 0.2 < p_d.min() < 0.6
    assert 0.9 < p_d.max() < 1
    for level in s.cov_radar:
        assert s.with_analysis(level=level).tolerances_at_level[0]


def test_s_band_configuration_is_as_published():
    """MATLAB's radareqsearchrng: 34 dB at 2.5 GHz, az ±180°, el 0 to 40°, 12.5 rpm."""
    given = load_scenario("configs/s_band_surveillance.yaml").resolved()["radar"]["surveillance"]
    aperture = 10**3.4 * (299792458 / 2.5e9) ** 2 / (4 * np.pi)
    assert given["aperture_m2"] == pytest.approx(aperture, abs=5e-4)
    assert given["search_volume_sr"] == pytest.approx(2 * np.pi * np.sin(np.radians(40)), abs=5e-4)
