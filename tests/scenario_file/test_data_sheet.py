"""Radars by their data sheets: allowed and refused keys of a scenario."""

import re

import numpy as np
import pytest
from helpers import (
    SURVEILLANCE,
    TOLERANCES,
    TRACKING,
    document,
    read_back,
    read_table,
    sheet_document,
    sheet_scenario,
    write,
    yaml_text,
)
from scenario_file.refused import refused

from radar_sense.model.radar_constant import relative_std
from radar_sense.scenario_file.load import load_scenario, parse_scenario

# Allowed keys.


SHEETS = {"surveillance": SURVEILLANCE, "tracking": TRACKING}


@pytest.mark.parametrize("kind", TOLERANCES)
def test_the_noise_temperature_may_be_left_out_and_is_in_the_record(kind):
    stated, cold = (sheet_scenario(kind, {**SHEETS[kind], "temperature_k": t}) for t in (290, 145))
    tolerances = {**TOLERANCES[kind], "temperature_k": 20}
    left_out = parse_scenario(yaml_text(changed(kind, ["temperature_k"], tolerances)))
    np.testing.assert_array_equal(left_out.radar, stated.radar)
    assert left_out.radar[3] == pytest.approx(cold.radar[3] / 2)
    block = left_out.resolved()["radar"][kind]
    assert block == stated.resolved()["radar"][kind]
    assert block["temperature_k"] == 290
    (part,) = (p for p in left_out.tolerances[0] if p.key == "temperature_k")
    assert (part.value, part.std) == (290, 20)
    read_back(left_out)


def changed(kind, without=(), tolerances=None, **added):
    sheet = {**SHEETS[kind], **added}
    radar = {key: value for key, value in sheet.items() if key not in without}
    return sheet_document(kind, radar, tolerances)


#: A document, and the error behind its line; `...` stands for any letters.
BAD = {
    "loss with the name of a key": (
        changed("tracking", losses_db={"noise_figure": 1}),
        "losses_db.noise_figure: must have another name, as 'noise_figure_db' is a key"),
    "loss without a name": (
        changed("tracking", losses_db={"": 1}), "must be the name of a loss, up to 30 letters"),
    "tolerance of a loss that is not given": (
        changed("tracking", tolerances={"losses_db": {"beam": 1}}, losses_db={"beam_shape": 1}),
        "losses_db.beam: is not in the data sheet, allowed: ..., losses_db.beam_shape"),
    "impossible constant": (
        changed("tracking", gain_dbi=200, peak_power_kw=1e10),
        "radar.tracking: makes the radar constant ...e+37 J m^2/K"),
    "tolerance of what is not given": (
        changed("surveillance", tolerances={"average_power_w": 500}),
        "sheet.constant.average_power_w: is not in the data sheet, allowed: average_power_kw, "
        "...did you mean 'average_power_kw'"),
    "no tolerance": (
        changed("surveillance", tolerances={}),
        "sheet.constant: needs at least one of the keys average_power_kw, aperture_m2"),
    "divisor that may be zero": (
        changed("surveillance", tolerances={"temperature_k": 48.334}),
        "sheet.constant.temperature_k: must be a number not less than 0 and not greater than "
        "48.3333, 1/6 of the parameter because c_r is divided by this parameter; got 48.334"),
    "divisor in inverse units": (
        changed("surveillance", tolerances={"rotation_rpm": 2}),
        "sheet.constant.rotation_rpm: must be ...not greater than 1.66667"),
    "parts of a number": (
        document(uncertainty__radar__low__constant={"loss_db": 1}),
        "low.constant: must be a number not less than 0, got ...need radar.surveillance or "
        "radar.tracking in place"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_refusals(case):
    bad, says = BAD[case]
    with refused(f"my.yaml:...: ...{says}"):
        parse_scenario(yaml_text(bad), "my.yaml")


# Losses by name, and pulses that are integrated coherently.

NAMED = {"beam_shape": 1.6, "line": 2.0}
SPREAD = {"losses_db": {"beam_shape": 0.4}, "noise_figure_db": 0.3}


@pytest.mark.parametrize("kind", TOLERANCES)
def test_losses_by_name(kind):
    """They are losses as any other: c_r falls by their sum, and each has its tolerance."""
    plain = sheet_scenario(kind)
    named = sheet_scenario(kind, {**SHEETS[kind], "losses_db": NAMED}, SPREAD)
    assert named.radar[3] == pytest.approx(plain.radar[3] * 10 ** (-3.6 / 10), rel=1e-14)
    found = {part.name: part for part in named.tolerances[0]}
    assert list(found) == ["noise_figure_db", "beam_shape_db"]
    nepers = np.log(10) / 10
    assert found["beam_shape_db"].slope == pytest.approx(-0.4 * nepers, rel=1e-14)
    assert relative_std(found.values()) == pytest.approx(0.5 * nepers, rel=1e-14)
    resolved = named.resolved()
    assert resolved["radar"][kind]["losses_db"] == NAMED
    assert resolved["uncertainty"]["radar"]["sheet"]["constant"] == SPREAD
    read_back(named)
    # and with all of them named none is left without a name
    only = {key: value for key, value in SHEETS[kind].items() if key != "loss_db"}
    everything = {**NAMED, "rest": SHEETS[kind]["loss_db"]}
    other = sheet_scenario(kind, {**only, "losses_db": everything}, SPREAD)
    assert other.radar[3] == pytest.approx(named.radar[3], rel=1e-14)
    read_back(other)


def test_losses_by_name_are_rows_of_the_budget(tool):
    sheet = {**TRACKING, "losses_db": NAMED}
    name = write(yaml_text(sheet_document("tracking", sheet, SPREAD)))
    code, out, _ = tool("budget", name, "--method", "linear", "--no-plot", "--out", "out")
    assert code == 0
    assert re.search(r"^ +beam_shape_db +0\.\d+ +6\d\.\d%$", out, re.M)  # 0.4^2 of 0.5^2
    table = read_table("out/paper_budget.csv")
    start = "three_sigma_radar_constant"
    beam, noise = table[f"{start}_beam_shape_db"], table[f"{start}_noise_figure_db"]
    np.testing.assert_allclose(beam / noise, 4 / 3, rtol=1e-9)


def test_coherent_pulses_are_a_gain():
    one = sheet_scenario("tracking")
    sixteen = sheet_scenario("tracking", {**TRACKING, "coherent_pulses": 16})
    assert sixteen.radar[3] == pytest.approx(16 * one.radar[3], rel=1e-15)
    assert sixteen.resolved()["radar"]["tracking"]["coherent_pulses"] == 16
    read_back(sixteen)
    assert one.resolved()["radar"]["tracking"]["coherent_pulses"] == 1


# The configurations.


def test_s_band_configuration_is_as_published():
    """MATLAB's radareqsearchrng: 34 dB at 2.5 GHz, az ±180°, el 0 to 40°, 12.5 rpm."""
    given = load_scenario("configs/s_band_surveillance.yaml").resolved()["radar"]["surveillance"]
    aperture = 10**3.4 * (299792458 / 2.5e9) ** 2 / (4 * np.pi)
    assert given["aperture_m2"] == pytest.approx(aperture, abs=5e-4)
    assert given["search_volume_sr"] == pytest.approx(2 * np.pi * np.sin(np.radians(40)), abs=5e-4)
