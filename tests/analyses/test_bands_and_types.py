"""RCS by band, and errors that radars of a type share, against draws by formulas of their own."""

import math

import chain_rule
import numpy as np
import pytest
import yaml
from helpers import csv_text, on_route, stds_of, yaml_text
from numpy.testing import assert_allclose
from scipy.constants import Boltzmann, speed_of_light

import radar_sense as rs
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import parse_scenario
from radar_sense.sources import error_budget

P_FA = 1e-6
SHEET = yaml.safe_load("""
{peak_power_kw: 60, gain_dbi: 33, frequency_ghz: 3, pulse_width_us: 5, temperature_k: 290,
 noise_figure_db: 3, losses_db: {lines: 2}}
""")
AREAS = {"s": 0.06, "x": 0.04}
OWN, SHARED, RCS_DB, DISTANCE = 0.4, 1.2, 1.5, 40e3


def radar(name, band, **changes):
    """A radar 40 km from the aircraft, with an error of its own in the noise figure."""
    uncertainty = {"one": {"position_m": 0, "constant": {"noise_figure_db": OWN}}}
    given = {"position_m": [0, 0, 0], "p_fa": P_FA, "band": band, "type": "filler"}
    return {"name": name, **given, "tracking": SHEET, "uncertainty": uncertainty, **changes}


def document(*radars, **changes):
    """Radars at one place, an aircraft that is known but for its RCS, and gain by type."""
    fixed = yaml.safe_load(f"""
        name: shared
        types: {{filler: {{one: {{gain_dbi: {SHARED / 2}}}}}}}
        geometry: {{type: orbit, range_km: {DISTANCE / 1e3}, down_km: 0,
                   azimuth_deg: {{start: 0, stop: 0, step: 1}}}}
        uncertainty: {{aircraft: {{position_m: 0, attitude_deg: 0, rcs_db: {RCS_DB}}}}}
        analysis: {{level: one}}
    """)
    rcs = {band: {"model": "constant", "rcs_m2": area} for band, area in AREAS.items()}
    aircraft = {"rcs": {"bands": rcs}, "attitude_deg": [0, 0, 0]}
    return {**fixed, "radars": list(radars), "aircraft": aircraft, **changes}


def made(content):
    return parse_scenario(yaml_text(content))


def p_d(area, decibels):
    """P_D of one radar by the radar equation and North's approximation, with an error in dB."""
    power, gain = SHEET["peak_power_kw"] * 1e3, 10 ** (SHEET["gain_dbi"] / 10)
    wavelength = speed_of_light / (SHEET["frequency_ghz"] * 1e9)
    energy = power * SHEET["pulse_width_us"] * 1e-6 * gain**2 * wavelength**2 * area
    losses = SHEET["losses_db"]["lines"] + SHEET["noise_figure_db"]
    noise = Boltzmann * SHEET["temperature_k"] * (4 * np.pi) ** 3 * DISTANCE**4
    snr = energy / noise * 10 ** ((decibels - losses) / 10)
    return chain_rule.north(snr, P_FA)


def fused(bands):
    """Draws of P_D of a network, with errors of type and band that are shared."""
    rng, runs = np.random.default_rng(3), 400_000
    of_type, missed = SHARED * rng.standard_normal(runs), 1.0
    of_band = {band: RCS_DB * rng.standard_normal(runs) for band in AREAS}
    for band in bands:
        error = of_type + of_band[band] + OWN * rng.standard_normal(runs)
        missed = missed * (1 - p_d(AREAS[band], error))
    return 1 - missed


def bounds(draws):
    """Both 3-sigma bounds of draws, and their standard errors from four parts."""
    ranks = [0.0013499, 0.9986501]
    parts = np.quantile(draws.reshape(4, -1), ranks, axis=1)
    return np.quantile(draws, ranks), parts.std(axis=1, ddof=1) / 2


@pytest.mark.parametrize("bands", ["ssx", "xxx"])
def test_p_d_and_its_band_are_those_of_draws_with_common_errors(bands):
    s = made(document(*(radar(f"r{i}", band) for i, band in enumerate(bands))))
    nominal = 1 - np.prod([1 - p_d(AREAS[band], 0.0) for band in bands])
    assert_allclose(s.model.p_d(s.aircraft, s.radar), nominal, rtol=1e-12)
    draws = fused(bands)
    exact, error = bounds(draws)
    found = propagate_scenario(s)
    allowed = 0.002 + 4 * np.hypot(error, found.error)
    assert np.all(abs(np.concatenate([found.lower, found.upper]) - exact) < allowed)
    assert found.std[0] == pytest.approx(draws.std(), rel=0.02)
    drawn = rs.monte_carlo(s, 200_000, 5)
    assert drawn.mean[0] == pytest.approx(draws.mean(), abs=5 * draws.std() / 400)
    assert drawn.std[0] == pytest.approx(draws.std(), rel=0.02)


def test_sigma_to_first_order_has_a_closed_form():
    """Alike radars at one place: shared errors add up, errors of their own add up in squares."""
    for count in (1, 2, 4):
        s = made(document(*(radar(f"r{i}", "s") for i in range(count))))
        single = p_d(AREAS["s"], 0.0)
        slope = (p_d(AREAS["s"], 1e-5) - p_d(AREAS["s"], -1e-5)) / 2e-5
        each = slope * (1 - single) ** (count - 1)
        alone = {
            "own": OWN * each * math.sqrt(count),
            "type_filler": SHARED * each * count,
            "aircraft_rcs": RCS_DB * each * count,
        }
        total = math.sqrt(sum(v**2 for v in alone.values()))
        assert propagate_scenario(s, method="linear").std[0] == pytest.approx(total, rel=1e-6)
        budget = stds_of(error_budget(s, "linear").sources)
        if count > 1:
            own = math.sqrt(sum(budget[f"r{i}"][0] ** 2 for i in range(count)))
            assert own == pytest.approx(alone["own"], rel=1e-6)
            for name in ("type_filler", "aircraft_rcs"):
                assert budget[name][0] == pytest.approx(alone[name], rel=1e-6)


def test_a_budget_has_a_row_for_each_band_and_type():
    s = made(document(radar("a", "s"), radar("b", "s"), radar("c", "x")))
    for method in ("linear", "form", "automatic", "montecarlo"):
        found = error_budget(s.with_analysis(runs=4096), method)
        rows = ["a", "b", "c", "type_filler", "aircraft_rcs_s", "aircraft_rcs_x"]
        assert [*found.sources][2:] == rows
        assert "type_filler_gain_dbi" in found.parts
        assert found.parts["type_filler_gain_dbi"].std == pytest.approx(
            found.sources["type_filler"].std, rel=1e-12
        )
        if method == "linear":
            assert_allclose(
                sum(v**2 for v in stds_of(found.sources).values()), found.total.std**2, rtol=1e-12
            )
    draws, first = fused("ssx"), error_budget(s, "montecarlo")
    assert first.total.std[0] == pytest.approx(draws.std(), rel=0.1)


def test_one_band_for_all_is_no_band():
    several = [radar("a", "s"), radar("b", "s", position_m=[0, 5e3, 0])]
    s, content = made(document(*several)), document(*several)
    content["aircraft"]["rcs"] = content["aircraft"]["rcs"]["bands"]["s"]
    for one in content["radars"]:
        del one["band"]
    plain = made(content)
    for method in ("linear", "form", "automatic"):
        one, other = (propagate_scenario(x, method=method) for x in (s, plain))
        assert one.upper.tobytes() == other.upper.tobytes()
    assert rs.monte_carlo(s).mean.tobytes() == rs.monte_carlo(plain).mean.tobytes()


def of_type(**deviation):
    return {"types": {"filler": {"one": deviation}}}


def with_rcs(**rcs):
    return {"aircraft": {"rcs": rcs, "attitude_deg": [0, 0, 0]}}


NUMBER = {"uncertainty": {"one": {"position_m": 0, "constant": 0.1}}}
UNUSED = {"types": {t: {"one": {"gain_dbi": 1}} for t in ("filler", "other")}}
WRONG = {
    "radars[2].band: must be one of s, x of aircraft.rcs.bands, got 'ss'; d": (
        {"band": "ss"},
        {},
    ),
    "radars[2]: missing key 'band', one of s, x of aircraft.rcs.bands": ({"band": None}, {}),
    "radars[2].type: must be one of types (filler), got 'fuller'; did": ({"type": "fuller"}, {}),
    "types.filler: must have the levels of its radars": ({}, {"types": {"filler": {"two": {}}}}),
    "types.other: is the type of no radar": ({}, UNUSED),
    "noise_figure_db stands at a radar of this type too; giv": ({}, of_type(noise_figure_db=1)),
    "types.filler.one.aperture_m2: is not in the data sheet": ({}, of_type(aperture_m2=1)),
    "radars[2].uncertainty.one.constant: must have standard deviations by param": (NUMBER, {}),
    "aircraft.rcs.bands: needs at least one band": ({}, with_rcs(bands={})),
    "radars[1].band: needs aircraft.rcs.bands, an ": ({}, with_rcs(model="constant", rcs_m2=1)),
    "radars cannot be named a, type_filler": ({"name": "type_filler"}, {}),
    "radars cannot be named a, aircraft_rcs_s": ({"name": "aircraft_rcs_s"}, {}),
}


@pytest.mark.parametrize("says", WRONG)
def test_contradictions_are_one_line(says):
    own, changes = WRONG[says]
    other = {key: v for key, v in (radar("b", "s") | own).items() if v is not None}
    with pytest.raises(rs.InputError) as error:
        made(document(radar("a", "s"), other, **changes))
    line = str(error.value)
    assert says in line
    assert "\n" not in line
    assert line.startswith("scenario:")


def test_radars_of_a_mission_keep_their_common_errors(tmp_path):
    """The bounds of a mission by recombined draws, and by plain draws."""
    content = document(*(radar(f"r{i}", "s", scan_period_s=10) for i in range(2)))
    rows = (0, 40e3, 0, 0, 0, 0, 0), (20, 40e3, 100, 0, 0, 0, 0)
    found = rs.analyses.mission(on_route(tmp_path, content, rows), runs=60_000)
    for end in ("lower", "upper"):
        drawn, bound = found.table[f"mc_{end}"], found.table[f"{end}_3sigma"]
        assert_allclose(bound, drawn, atol=0.02)


def test_the_warning_of_a_table_names_the_one_that_ends(tmp_path):
    """Not the table of the last band, which goes from straight below to straight above."""
    tables = {"s": (-1, 1), "x": (-90, 0, 90)}
    for band, elevations in tables.items():
        rows = [(azimuth, e, 1) for e in elevations for azimuth in range(0, 360, 30)]
        (tmp_path / f"{band}.csv").write_text(csv_text("azimuth_deg,elevation_deg,rcs_m2", rows))
    content = document(radar("one", "s"), radar("two", "x"))
    content["aircraft"]["rcs"] = {
        "bands": {band: {"model": "table", "file": f"{band}.csv"} for band in tables}
    }
    content["uncertainty"]["aircraft"]["attitude_deg"] = 5
    found = rs.analyses.variance(parse_scenario(yaml_text(content), f"{tmp_path}/a.yaml"))
    (warning,) = [text for text in found.warnings if "[table-exceeded]" in text]
    assert "covers elevations from -1 to 1 deg" in warning
