"""`detectors --p-d`: the SNR needed, the margin with its band, and the terms of the SNR.

The oracles are arithmetic in decibels, integrals of SciPy's noncentral chi-square distribution over
the fluctuation, and draws of the parameters; none of them calls the package.
"""

import dataclasses
import functools
import math

import numpy as np
import pytest
import yaml
from helpers import (
    CONFIGS,
    OVERHEAD,
    corridor,
    drawn_states,
    known_to,
    scenario,
    sheet_scenario,
    with_arrays,
    yaml_text,
)
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import ndtr, ndtri
from scipy.stats import betaprime, chi2, gamma, ncx2

import radar_sense as rs
from radar_sense.analyses.margin import snr_terms
from radar_sense.errors import InputError

K, C = 1.380649e-23, 299792458.0
#: Shape of the gamma distribution of the energy of N pulses, by Swerling's case.
SHAPES = {"swerling1": lambda n: 1, "swerling2": lambda n: n, "swerling3": lambda n: 2,
          "swerling4": lambda n: 2 * n}  # fmt: skip
ONE_POSE = {"start": 0, "stop": 0, "step": 1}


def db(ratio):
    return 10 * math.log10(ratio)


def detected(case, pulses, p_fa, snr_db):
    """P_D: the energy of N pulses is noncentral chi-square, mixed over a gamma."""
    threshold, snr = chi2.isf(p_fa, 2 * pulses), 10 ** (snr_db / 10)
    if case == "marcum":
        return ncx2.sf(threshold, 2 * pulses, 2 * pulses * snr)
    shape = SHAPES[case](pulses)
    energy = gamma(shape, scale=pulses * snr / shape)
    # over quantiles of the energy, whose integrand is bounded
    return quad(lambda q: ncx2.sf(threshold, 2 * pulses, 2 * energy.ppf(q)), 0, 1, limit=200)[0]


def assert_needed(snr_db, case, pulses, p_fa, p_d):
    """Insist that P_D is reached at an SNR of a pulse, to 2e-6 dB."""
    ends = [detected(case, pulses, p_fa, snr_db + error) for error in (-2e-6, 2e-6)]
    assert ends[0] < p_d < ends[1], case


def tracking(level=None, rcs=None, uncertain=None, **radar):
    """A tracking radar of known numbers, 30 km away."""
    sheet = {"peak_power_kw": 250, "gain_dbi": 40, "frequency_ghz": 9.4, "pulse_width_us": 0.8,
             "noise_figure_db": 4, "losses_db": {"line": 2, "beam_shape": 1.6}}  # fmt: skip
    given = {"position_m": [0, 0, 0], "tracking": sheet, "p_fa": 1e-6, "detector": "swerling1"}
    parts = {"gain_dbi": 0.5, "noise_figure_db": 0.3, "losses_db": {"line": 0.4}}
    aircraft = {"position_m": 0, "attitude_deg": 0, **(uncertain or {})}
    own = {"sheet": {"position_m": 0, "constant": parts, **(level or {})}}
    return scenario(
        radar=given | radar,
        aircraft__rcs=rcs or {"model": "constant", "rcs_m2": 0.2},
        geometry__range_km=30,
        geometry__azimuth_deg=ONE_POSE,
        uncertainty={"aircraft": aircraft, "radar": own},
        analysis={"level": "sheet", "runs": 500, "seed": 1},
    )


# The SNR needed.


@pytest.mark.parametrize(("pulses", "p_d"), [(1, 0.5), (24, 0.99)])
def test_needed_of_every_fluctuation(pulses, p_d):
    s = scenario(geometry__azimuth_deg=ONE_POSE)
    found = rs.analyses.detectors(s, p_d=p_d, pulses=pulses).summary["needed_db_by_fluctuation"]
    more = f", {pulses} pulses" if pulses > 1 else ""
    assert set(found) == {f"{case}{more}" for case in ("marcum", *SHAPES)}
    for case in ("marcum", *SHAPES):
        assert_needed(found[f"{case}{more}"], case, pulses, 1.7e-4, p_d)


def test_steps_from_a_steady_target_to_the_radar():
    """MATLAB's radarbudgetplot has the same steps: one pulse, integration, fluctuation, CFAR."""
    s = rs.load_scenario(CONFIGS / "airport_surveillance.yaml").at_poses(slice(0, 1))
    result = rs.analyses.detectors(s, p_d=0.9, method="linear")
    after = result.summary["needed_db_after"]
    names = ["steady target, 1 pulse", "18 pulses", "swerling3", "cell_averaging 16"]
    assert list(after) == names
    cases = [("marcum", 1), ("marcum", 18), ("swerling3", 18)]
    for name, (case, pulses) in zip(names, cases, strict=False):
        assert_needed(after[name], case, pulses, 1e-6, 0.9)
    # cells add a loss: P_D at that SNR is 0.9, by draws of cells and pulses
    rng, runs, snr = np.random.default_rng(1), 400_000, 10 ** (after["cell_averaging 16"] / 10)
    cells = rng.gamma(16 * 18, size=runs)
    energy = rng.gamma(18 + rng.poisson(18 * snr * rng.gamma(2, 0.5, size=runs)))
    # P_fa of a ratio of gamma variables is a beta distribution
    factor = betaprime.isf(1e-6, 18, 16 * 18)
    assert np.mean(energy > factor * cells) == pytest.approx(0.9, abs=4 * 0.3 / math.sqrt(runs))
    assert "  needed                      8.21" in result.report
    assert "  cell_averaging 16           0.34" in result.report


@pytest.mark.parametrize(
    ("detector", "steps"),
    [
        ("marcum", []),
        ("north", ["north"]),
        ("swerling1", ["swerling1"]),
        ({"model": "swerling4", "pulses": 4, "binary": {"m": 3, "n": 5}},
         ["4 pulses", "swerling4", "3 of 5"]),
        ({"model": "marcum", "pulses": 4, "cfar": {"type": "cell_averaging", "cells": 8},
          "binary": {"m": 2, "n": 3}}, ["4 pulses", "cell_averaging 8", "2 of 3"]),
        ({"model": "swerling1",
          "cfar": {"type": "ordered_statistics", "cells": 24, "rank": 18}},
         ["swerling1", "ordered_statistics 18 of 24"]),
    ],
)  # fmt: skip
def test_steps_of_detectors(detector, steps):
    s = scenario(radar__detector=detector, geometry__azimuth_deg=ONE_POSE)
    summary = rs.analyses.detectors(s, p_d=0.8).summary
    after = summary["needed_db_after"]
    assert list(after) == ["steady target, 1 pulse", *steps]
    *_, needed = after.values()
    (radar,) = s.model.models
    assert radar.detector.p_d(np.array(10 ** (needed / 10)), 1.7e-4) == pytest.approx(0.8)


# The margin and its band.


@pytest.mark.parametrize("method", ["linear", "probit", "form", "automatic"])
def test_tolerances_in_decibels_give_a_normal_margin(method):
    """All terms with a tolerance are in dB: the margin is normal, and its band exact."""
    result = rs.analyses.detectors(tracking(), p_d=0.9, method=method)
    distance = math.hypot(30e3, 3e3)
    snr = db(250e3) + 2 * 40 + 2 * db(C / 9.4e9) + db(0.2) - 3 * db(4 * math.pi)
    snr -= db(K * 290 / 0.8e-6) + 4 + 2 + 1.6 + 4 * db(distance)
    # Swerling 1: P_D = P_fa^(1/(1 + S))
    expected = snr - db(math.log(1e-6) / math.log(0.9) - 1)
    std = math.sqrt((2 * 0.5) ** 2 + 0.3**2 + 0.4**2)
    (margin,), (lower,), (upper,) = (
        result.table[f"{end}margin_db"] for end in ("", "lower_3sigma_", "upper_3sigma_")
    )
    assert margin == pytest.approx(expected, abs=1e-9)
    accuracy = 0.05 * std if method == "automatic" else 1e-6
    assert lower == pytest.approx(expected - 3 * std, abs=accuracy)
    assert upper == pytest.approx(expected + 3 * std, abs=accuracy)
    assert result.report[0] == (
        f"least margin for P_D 0.9: {margin:.2f} dB at 0 deg, between {lower:.2f} and "
        f"{upper:.2f} (3 sigma)"
    )


@functools.cache
def margins_by_draws():
    """Return draws of the margin of `test_band_against_draws` [dB]."""
    rng, runs = np.random.default_rng(3), 300_000
    parts = 0.5**2 * 4 + 0.3**2 + 0.4**2 + 0.7**2
    decibels = math.sqrt(parts) * rng.standard_normal(runs)
    radar = 200 * rng.standard_normal((3, runs))
    line = np.array([0.0, 30e3, -3e3])[:, np.newaxis] - radar  # azimuth 0 is east
    angles = np.array([90, 0, 0]) + rng.standard_normal((runs, 3)) * [8, 2, 2]
    to_ned = Rotation.from_euler("ZYX", angles, degrees=True)
    x, y, z = to_ned.inv().apply(-line.T).T
    a, b, c = 0.15, 0.13, 0.21
    lam, phi = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    shape = (a * np.sin(lam) * np.cos(phi)) ** 2 + (b * np.sin(lam) * np.sin(phi)) ** 2
    sigma = math.pi * (a * b * c) ** 2 / (shape + (c * np.cos(lam)) ** 2) ** 2
    distance = np.linalg.norm(line, axis=0)
    path = 2 * 0.1e-3 * np.exp(0.3 * rng.standard_normal(runs)) * distance
    snr = db(250e3) + 80 + 2 * db(C / 9.4e9) - 3 * db(4 * math.pi) - db(K * 290 / 0.8e-6) - 7.6
    snr = snr + 10 * np.log10(sigma) - 40 * np.log10(distance) - path + decibels
    return snr - db(math.log(1e-6) / math.log(0.9) - 1)


@pytest.mark.parametrize(("method", "k"), [("form", 3), ("automatic", 2), ("montecarlo", 3)])
def test_band_against_draws(method, k):
    """With an uncertain attenuation, aspect and c_r the margin is skewed."""
    s = tracking(
        level={"attenuation_db_per_km": 0.03, "position_m": 200},
        rcs={"model": "ellipsoid", "a_m": 0.15, "b_m": 0.13, "c_m": 0.21},
        uncertain={"attitude_deg": [2, 2, 8], "rcs_db": 0.7},
        attenuation_db_per_km=0.1,
    )
    result = rs.analyses.detectors(s, p_d=0.9, method=method, runs=20_000, k=k)
    low, high = np.quantile(margins_by_draws(), [ndtr(-k), ndtr(k)])
    accuracy = 0.6 if method == "montecarlo" else 0.12
    assert result.table[f"lower_{k}sigma_margin_db"][0] == pytest.approx(low, abs=accuracy)
    assert result.table[f"upper_{k}sigma_margin_db"][0] == pytest.approx(high, abs=accuracy)


def test_a_band_that_is_off_is_warned_of():
    """At a peak of the cross section first order sees no effect of the aspect."""
    s = tracking(rcs={"model": "spikeball", "lobes": 8, "amplitude_m2": 1, "floor_m2": 0.001},
                 uncertain={"attitude_deg": [0, 0, 6]})  # fmt: skip
    (text,) = rs.analyses.detectors(s, p_d=0.9, method="linear").warnings
    assert text == ("the linear band of the margin is off at 0 deg by over 0.25 dB [band-off]")


@pytest.mark.all_draws
@pytest.mark.parametrize("km", [30, 1.5])
def test_a_bound_of_a_large_margin_is_right_to_a_quarter_of_a_decibel(km):
    """A narrow lobe seen from near: the bound by FORM is 1.7 dB too low, 0.00006 of P."""
    rcs = {"model": "ellipsoid", "a_m": 0.15, "b_m": 0.13, "c_m": 2.0}
    s = scenario(
        aircraft__rcs=rcs,
        **known_to(10 * km / 3, 2, position_m=10 * km / 3, constant=5),
        geometry__range_km=km,
        geometry__down_km=-km / 30,
        geometry__azimuth_deg={"start": 90, "stop": 90, "step": 2},
    )
    table = rs.analyses.detectors(s, p_d=0.5, method="automatic").table
    states = drawn_states(s, 200_000), (s.aircraft, s.radar)
    snr, nominal = (10 * np.log10(s.model.snr(*x).ravel()) for x in states)
    low, high = np.quantile(snr - nominal, ndtr([-3, 3])) + table["margin_db"]
    assert table["lower_3sigma_margin_db"][0] == pytest.approx(low, abs=0.35)
    assert table["upper_3sigma_margin_db"][0] == pytest.approx(high, abs=0.35)


@pytest.mark.parametrize("method", ["linear", "form"])
def test_a_margin_without_a_band(method):
    """Straight below the aircraft the aspect has no gradient: draws have a band there."""
    s = scenario(**OVERHEAD)
    result = rs.analyses.detectors(s, p_d=0.9, method=method)
    assert result.report[0].endswith("59.03 dB at 0 deg, without a band (3 sigma)")
    assert result.warnings == (f"the {method} band of the margin has no value at 0 deg [no-value]",)
    table = rs.analyses.detectors(s, p_d=0.9, method="automatic").table
    assert 58 < table["lower_3sigma_margin_db"][0] < 59.03 < table["upper_3sigma_margin_db"][0] < 70


@pytest.mark.parametrize("p_d", [0.9, 1e-3])  # which need an SNR above and below 0 dB
def test_a_radar_constant_that_may_be_zero(p_d):
    """The margin is then below every number: no SNR."""
    level = {"medium": {"position_m": 0, "constant": 160}}
    s = scenario(uncertainty__radar=level, geometry__azimuth_deg=ONE_POSE)
    found = rs.analyses.detectors(s, p_d=p_d, method="automatic")
    table = found.table
    assert table["lower_3sigma_margin_db"][0] == -math.inf
    most = table["upper_3sigma_margin_db"][0]
    assert found.report[0].endswith(f" at 0 deg, at most {most:.2f} (3 sigma)")
    upper = table["margin_db"][0] + db(1 + 3 * 160 / 167)
    assert table["upper_3sigma_margin_db"][0] == pytest.approx(upper, abs=0.1)
    no_rcs = {"model": "spikeball", "lobes": 4, "amplitude_m2": 0.1, "floor_m2": 0}
    s = scenario(aircraft__rcs=no_rcs, geometry__azimuth_deg={"start": 45, "stop": 90, "step": 45})
    for constant in (167.0, 1e20):
        radar = s.radar * [1, 1, 1, constant / 167]
        other = with_arrays(s, radar=radar)
        result = rs.analyses.detectors(other, p_d=0.9, method="linear")
        snr = 10 * np.log10(s.model.snr(s.aircraft, radar)[:, 0])
        assert_allclose(result.table["term_snr"], snr)
        assert np.isfinite(result.table["margin_db"]).all()
        FigureCanvasAgg(result.plot()).draw()


# The terms.


def test_terms_of_a_tracking_radar():
    """Each term by arithmetic from the data sheet, and its tolerance."""
    s = tracking(
        level={"attenuation_db_per_km": 0.03, "position_m": 200},
        uncertain={"position_m": 100, "rcs_db": 0.7},
        attenuation_db_per_km=0.1,
    )
    distance = math.hypot(30e3, 3e3)
    # 1/R^4, and 0.2 dB/km along the way there and back
    std_range = math.hypot(100, 200) * (40 / math.log(10) / distance + 2 * 0.1e-3)
    path = 2 * 0.1e-3 * distance
    expected = {
        "peak_power_kw": (db(250e3), 0), "gain_dbi": (2 * 40, 2 * 0.5),
        "frequency_ghz": (2 * db(C / 9.4e9), 0), "pulse_width_us": (-db(1 / 0.8e-6), 0),
        "temperature_k": (-db(290), 0), "noise_figure_db": (-4, 0.3), "coherent_pulses": (0, 0),
        "line_db": (-2, 0.4), "beam_shape_db": (-1.6, 0), "boltzmann": (-db(K), 0),
        "rest_of_constant": (-3 * db(4 * math.pi), 0), "range": (-4 * db(distance), std_range),
        "attenuation": (-path, path * 0.3), "aircraft_rcs": (db(0.2), 0.7),
    }  # fmt: skip
    terms = snr_terms(s)
    assert set(terms) == {*expected, "snr"}
    for name, (value, std) in expected.items():
        assert terms[name][0][0] == pytest.approx(value, abs=1e-9), name
        assert terms[name][1][0] == pytest.approx(std, rel=1e-9, abs=1e-12), name
    value, std = (sum(x) for x in zip(*((v, d**2) for v, d in expected.values()), strict=True))
    assert terms["snr"][0][0] == pytest.approx(value, abs=1e-9)
    assert terms["snr"][1][0] == pytest.approx(math.sqrt(std), rel=1e-9)
    report = rs.analyses.detectors(s, p_d=0.9, method="linear").report
    assert any(line.split() == ["gain_dbi", "80.00", "1.00"] for line in report)
    assert not any("coherent" in line for line in report)
    assert [line for line in report if "margin" in line] == [report[0]]  # one pose, one margin
    one = rs.analyses.detectors(tracking(rcs={"model": "constant", "rcs_m2": 1}), p_d=0.9)
    assert not any("-0.00" in line for line in one.report)


@pytest.mark.parametrize("level", ["sheet", "number"])
def test_terms_of_a_surveillance_radar(level):
    """A deviation of c_r as a whole is of what is left of c_r."""
    s = sheet_scenario("surveillance", level=level)
    terms = snr_terms(s)
    whole = 10 / math.log(10) * 0.1 / s.radar[3]
    expected = {
        "average_power_kw": (db(10e3), 10 / math.log(10) * 0.5 / 10), "aperture_m2": (db(15), 0),
        "temperature_k": (-db(290), 0), "rotation_rpm": (db(6), 0), "loss_db": (-8, 1),
        "search_volume_sr": (-db(2), 0), "noise_figure_db": (-3, 0.5),
        "rest_of_constant": (-db(16), 0),
    }  # fmt: skip
    for name, (value, std) in expected.items():
        if level == "number":
            std = whole if name == "rest_of_constant" else 0
        assert_allclose(terms[name][0], value, atol=1e-9, err_msg=name)
        assert_allclose(terms[name][1], std, rtol=1e-9, err_msg=name)


def test_terms_of_a_constant():
    """Without a data sheet, or with another c_r than its own, c_r is one term."""
    other = sheet_scenario("tracking", level="number")
    radar = other.radar * [1, 1, 1, 2]
    for s, constant, std in (
        (scenario(), 167, 5),
        (with_arrays(other, radar=radar), 2 * other.radar[3], 0.1),
    ):
        terms = snr_terms(s)
        assert list(terms) == ["radar_constant", "boltzmann", "range", "aircraft_rcs", "snr"]
        assert_allclose(terms["radar_constant"][0], db(constant))
        assert_allclose(terms["radar_constant"][1], 10 / math.log(10) * std / constant)
        assert_allclose(terms["snr"][0], 10 * np.log10(s.model.snr(s.aircraft, s.radar)[:, 0]))


# The command.


def test_the_answer_at_several_poses():
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 30})
    result = rs.analyses.detectors(s, p_d=0.9, pulses=24, method="linear")
    first, second, *_ = result.report
    assert first.startswith("least margin for P_D 0.9: 5.75 dB at 0, 180 deg, between 5.36 and")
    assert second.startswith("largest margin for P_D 0.9: 11.59 dB at 90 deg, between 11.20 and")
    assert result.summary["detector"] == "marcum, 24 pulses"
    assert result.summary["least_margin_db"]["theta_r_deg"] == [0, 180]
    terms = {name: of for name, of in result.table.items() if name.startswith("term_")}
    total = terms.pop("term_snr")
    assert_allclose(sum(terms.values()), total, atol=1e-6)
    needed = total - result.table["margin_db"]
    assert_needed(needed[0], "marcum", 24, 1.7e-4, 0.9)
    assert_allclose(needed, needed[0], atol=1e-9)


def test_poses_beyond_a_limit_have_no_margin():
    s = corridor().at_poses(slice(0, None, 100))
    result = rs.analyses.detectors(s, p_d=0.9, radar="north", method="linear")
    seen = s.model.visible(s.aircraft, s.radar)[:, list(s.model.names).index("north")]
    assert 0 < seen.sum() < len(seen)
    for name in ("margin_db", "lower_3sigma_margin_db", "upper_3sigma_margin_db"):
        assert (np.isfinite(result.table[name]) == seen).all()
    assert any(line.startswith("no margin at ") for line in result.report)
    hidden = scenario(radar__max_range_km=100, geometry__azimuth_deg=ONE_POSE)
    result = rs.analyses.detectors(hidden, p_d=0.9)
    assert result.report[0] == "no margin at 0 deg: beyond a limit"
    FigureCanvasAgg(result.plot()).draw()


class Own:
    """A detector of one's own, P_D = S/(1 + S) but for noise."""

    def p_d(self, snr, p_fa):
        return (snr + p_fa) / (1 + snr)

    def linearize_probit(self, snr, p_fa):
        z = ndtri(self.p_d(snr, p_fa))
        return z, (1 - p_fa) / (1 + snr) ** 2 * math.sqrt(2 * math.pi) * np.exp(z * z / 2)


def test_a_detector_of_ones_own():
    model = dataclasses.replace(scenario().model.models[0], detector=Own())
    s = with_arrays(scenario(geometry__azimuth_deg=ONE_POSE), model=model)
    after = rs.analyses.detectors(s, p_d=0.9).summary["needed_db_after"]
    assert list(after.values())[-1] == pytest.approx(db((0.9 - 1.7e-4) / 0.1))
    with pytest.raises(InputError, match="'pulses' needs a detector that integrates, got <"):
        rs.analyses.detectors(s, p_d=0.9, pulses=4)


@pytest.mark.parametrize("p_d", [0.9, 1 - 1e-12])
def test_figure(p_d):
    """Every bar has its name and its number, and the numbers are inside the axes."""
    s = rs.load_scenario(CONFIGS / "rainy_day.yaml").at_poses(slice(0, 1))
    figure = rs.analyses.detectors(s, p_d=p_d, method="linear").plot()
    FigureCanvasAgg(figure).draw()
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["SNR without losses", "loss", "noise figure", "attenuation", "SNR",
                     "steady target, 1 pulse", "swerling1", "SNR needed", "margin"]  # fmt: skip
    assert len(axes.patches) == len(axes.texts) == len(names)
    inside = axes.get_window_extent()
    for text in axes.texts:
        box = text.get_window_extent()
        assert inside.x0 < box.x0 < box.x1 < inside.x1
    ends = {n: bar.get_x() + bar.get_width() for n, bar in zip(names, axes.patches, strict=True)}
    assert ends["attenuation"] == pytest.approx(ends["SNR"])
    assert ends["swerling1"] == pytest.approx(ends["SNR needed"])
    assert ends["margin"] == pytest.approx(ends["SNR"])


CELLS = {"type": "cell_averaging", "cells": 24}
DETECTOR = {"model": "swerling2", "pulses": 10, "cfar": CELLS}


@pytest.mark.parametrize("detector", ["north", "swerling1", DETECTOR])
def test_a_detector_that_radars_share_is_compared_once(detector):
    content = yaml.safe_load((CONFIGS / "network.yaml").read_text(encoding="utf-8"))
    for radar in content["radars"]:
        radar |= {"p_fa": 1e-6, "detector": detector}
    s = rs.parse_scenario(yaml_text(content)).at_poses(slice(0, 1))
    rows = rs.analyses.detectors(s).summary["required_snr"]
    compared = [(row["detector"], row["p_d"]) for row in rows]
    assert len(compared) == len(set(compared))


def test_detectors_of_two_radars():
    """The first radar integrates. The second has a P_fa at which North's approximation is low."""
    content = yaml.safe_load((CONFIGS / "network.yaml").read_text(encoding="utf-8"))
    content["radars"] = content["radars"][:2]
    content["radars"][0] |= {"p_fa": 1e-6, "detector": DETECTOR}
    content["radars"][1] |= {"p_fa": 0.2, "detector": "north"}
    s = rs.parse_scenario(yaml_text(content)).at_poses(slice(0, None, 40))
    result = rs.analyses.detectors(s)
    table, summary = result.table, result.summary
    # the error of North's approximation is the largest over the radars
    snr = s.model.snr(s.aircraft, s.radar).T
    errors = [
        abs(rs.North().p_d(of_radar, p_fa) - rs.Marcum().p_d(of_radar, p_fa))
        for of_radar, p_fa in zip(snr, (1e-6, 0.2), strict=True)
    ]
    assert summary["error_of_north_at_poses"]["value"] == np.max(errors)
    assert np.max(errors[0]) != np.max(errors[1])
    for worst in summary["largest_error_of_north"]:
        error = table["north_less_marcum"][table["p_fa"] == worst["p_fa"]]
        assert worst["error"] == error[np.argmax(abs(error))]
        assert (worst["error"] < 0) == (worst["p_fa"] == 0.2)
    steady = [row for row in summary["required_snr"] if row["detector"] == "swerling1"]
    p_fas = {row["p_fa"] for row in steady}
    closed = {(f, p): math.log(f) / math.log(p) - 1 for f in p_fas for p in (0.5, 0.9)}
    found = {(row["p_fa"], row["p_d"]): 10 ** (row["snr_db"] / 10) for row in steady}
    assert found == pytest.approx(closed, rel=1e-9)
    # a detector of a radar is shown for the P_fa of the radar
    rows = [row for row in summary["required_snr"] if "cell_averaging" in row["detector"]]
    assert [row["p_fa"] for row in rows] == [1e-6, 1e-6]
    assert any("swerling2, 10 pulses, cell_averaging 24 " in line for line in result.report)
    detector = s.model.models[0].detector
    for row in rows:
        ends = [detector.p_d(10 ** ((row["snr_db"] + db) / 10), 1e-6) for db in (-1e-4, 0, 1e-4)]
        assert ends[1] == pytest.approx(row["p_d"], abs=1e-9)
        assert row["dp_d_per_db"] == pytest.approx((ends[2] - ends[0]) / 2e-4, rel=1e-5)
    for p_fa in (1e-6, 0.2):
        at = table["p_fa"] == p_fa
        for pulses in (1, 10, 100):
            slope = np.gradient(table[f"p_d_swerling2_{pulses}"][at], table["snr_db"][at])
            found = table[f"dp_d_per_db_swerling2_{pulses}"][at]
            assert_allclose(found[1:-1], slope[1:-1], rtol=0, atol=3e-3 * slope.max())
