"""Networks of radars whose constants are uncertain by their parameters: draws, bounds, budgets."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import assert_refused, write
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import erfc

import radar_sense as rs
from radar_sense import analyses
from radar_sense.analyses.convergence import LinearModel
from radar_sense.analyses.error_budget import error_budget, required_accuracies, value_function
from radar_sense.model.network import name_problem
from radar_sense.model.radar_constant import shape_warning
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.sampler import Sampler, columns, normals
from radar_sense.propagation import (
    METHODS,
    nonlinear_in_scenario,
    propagate,
    propagate_scenario,
)
from radar_sense.propagation.standard_space import StandardNormalSpace, uncertain_states
from radar_sense.reading.parse import default_text, load_scenario, parse_scenario
from radar_sense.scenario import single_radar_scenarios
from radar_sense.states import CONSTANTS


def mission(scenario, *, m_of_n=None, **options):
    """Call the analysis with m and n as a pair."""
    m, n = m_of_n or (None, None)
    return rs.analyses.mission(scenario, m=m, n=n, **options)


#: Two radars by their data sheets and one by a number, and how uncertain they are at level sheet.
SEARCH = {
    "average_power_kw": 2.1,
    "aperture_m2": 2.874,
    "temperature_k": 487,
    "rotation_rpm": 12.5,
    "search_volume_sr": 4.039,
    "loss_db": 22.5,
    "noise_figure_db": 0,
}
TRACK = {
    "peak_power_kw": 2000,
    "gain_dbi": 36,
    "frequency_ghz": 9.4,
    "pulse_width_us": 0.8,
    "temperature_k": 290,
    "loss_db": 6,
    "noise_figure_db": 4,
}
SEARCH_STD = {"average_power_kw": 0.1, "temperature_k": 30, "loss_db": 1.2}
TRACK_STD = {"gain_dbi": 0.5, "frequency_ghz": 0.3, "loss_db": 0.8}
RANGE, DOWN, AREA, P_FA = 70e3, -3e3, 0.8, 1e-6
POSITIONS = {"a": [0, 0, -15], "b": [8e3, -5e3, 0], "c": [-5e3, 8e3, -40]}
NUMBER = (0.0045, 0.0004)  # c_r of the third, and its standard deviation


def entry(name, makeup, std, position_m=20, **more):
    return {
        "name": name,
        "position_m": POSITIONS[name],
        **makeup,
        "p_fa": P_FA,
        **more,
        "uncertainty": {
            "plain": {"position_m": position_m, "constant": 0.0002},
            "sheet": {"position_m": position_m, "constant": std},
        },
    }


def radars(search_std=SEARCH_STD, track_std=TRACK_STD, **more):
    return [
        entry("a", {"surveillance": SEARCH}, search_std, **more),
        entry("b", {"tracking": TRACK}, track_std, **more),
        entry("c", {"constant": NUMBER[0]}, NUMBER[1], **more),
    ]


def document(several=None, sweep=(30, 90, 30), runs=500, aircraft=None, **changes):
    found = yaml.safe_load(default_text())
    del found["radar"]
    found["radars"] = radars() if several is None else several
    found["aircraft"]["rcs"] = {"model": "constant", "rcs_m2": AREA}
    start, stop, step = sweep
    found["geometry"] |= {
        "range_km": RANGE / 1e3,
        "down_km": DOWN / 1e3,
        "azimuth_from": "north",
        "azimuth_deg": {"start": start, "stop": stop, "step": step},
    }
    found["uncertainty"] = {"aircraft": aircraft or {"position_m": 50, "attitude_deg": 1}}
    found["analysis"] = {"level": "sheet", "runs": runs, "seed": 1}
    return {**found, **changes}


def text(content):
    return yaml.safe_dump(content, sort_keys=False)


def network(*args, **kwargs):
    return parse_scenario(text(document(*args, **kwargs)))


# Draws.


def brute_force(draws, azimuth_deg, seed):
    """Fused P_D of draws (draws,), written out without any of the package."""
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal
    azimuth = math.radians(azimuth_deg)
    here = [RANGE * math.cos(azimuth), RANGE * math.sin(azimuth), DOWN]
    aircraft = np.array(here) + 50 * normal((draws, 3))

    def missed(name, constant):
        radar = np.array(POSITIONS[name]) + 20 * normal((draws, 3))
        squared = np.sum((aircraft - radar) ** 2, axis=1)
        ratio = constant * AREA / (1.380649e-23 * squared**2)
        return 1 - 0.5 * erfc(math.sqrt(-math.log(P_FA)) - np.sqrt(ratio + 0.5))

    power, temperature = 2100 + 100 * normal(draws), 487 + 30 * normal(draws)
    loss = 22.5 + 1.2 * normal(draws)
    search = power * 2.874 * (60 / 12.5) / (16 * temperature * 10 ** (loss / 10) * 4.039)
    gain, ghz = 36 + 0.5 * normal(draws), 9.4 + 0.3 * normal(draws)
    loss = 6 + 0.8 * normal(draws)
    length = 299792458 / (ghz * 1e9)
    track = 2000e3 * 10 ** (2 * gain / 10) * length**2 * 0.8e-6
    track /= (4 * math.pi) ** 3 * 290 * 10 ** ((loss + 4) / 10)
    number = NUMBER[0] + NUMBER[1] * normal(draws)
    return 1 - missed("a", search) * missed("b", track) * missed("c", number)


@pytest.mark.parametrize("azimuth", [30, 90])
def test_a_network_drawn_by_hand(azimuth):
    draws = 200_000
    drawn = brute_force(draws, azimuth, seed=4)
    s = network(sweep=(azimuth, azimuth, 1), runs=100_000)
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
    # what it would be with Gaussian constants is not the same
    linear = propagate_scenario(s)
    assert max(abs(linear.lower[0] - ends[0]), abs(linear.upper[0] - ends[1])) > 2 * near


def test_a_mission_draws_the_constants_as_their_parts_make_them(tmp_path):
    header = "time_s,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg"
    route = tmp_path / "route.csv"
    route.write_text(f"{header}\n0,60e3,35e3,-3000,0,0,0\n10,60e3,34e3,-3000,0,0,0\n")
    path = {"type": "path", "file": str(route)}
    content = document(radars(scan_period_s=100), geometry=path)
    del content["aircraft"]["attitude_deg"]
    s = parse_scenario(text(content))
    found = mission(s, runs=20_000)
    expected = monte_carlo(s.part(slice(1)), runs=20_000, seed=5)
    assert 0.1 < expected.mean[0] < 0.9
    assert found.table["mc_mean"] == pytest.approx(expected.mean, abs=5 * expected.std[0] / 100)
    assert found.table["mc_std"] == pytest.approx(expected.std, rel=0.03)
    end = 0.2 * expected.std[0]
    assert found.table["mc_lower"] == pytest.approx(expected.lower, abs=end)
    assert found.table["mc_upper"] == pytest.approx(expected.upper, abs=end)
    assert [w[:2] for w in found.warnings if "log-normal" in w] == []


def test_every_part_has_a_unit_normal_of_its_own():
    s = network()
    inputs = columns(12, s.tolerances_at_level)
    assert inputs == [[3, 12, 13], [7, 14, 15], []]
    assert normals(12, s.tolerances_at_level) == Sampler.of(s).radar_normals == 16
    assert columns(4, s.tolerances_at_level[:1]) == [[3, 4, 5]]  # as ever for a single radar
    assert columns(12, ()) == [] == columns(12, ((), (), ()))[0]
    sampler = Sampler.of(s)
    at_rest = sampler.draw_radar(np.zeros((1, 16)))[0][0]
    assert_array_equal(at_rest, s.radar)
    for i, (parts, own) in enumerate(zip(s.tolerances_at_level, inputs, strict=True)):
        for part, column in zip(parts, own, strict=True):
            drawn, negative = sampler.draw_radar(np.eye(16)[[column]])
            changed = np.flatnonzero(drawn[0] != s.radar)
            assert list(changed) == [4 * i + 3]
            assert drawn[0, changed] / s.radar[changed] == pytest.approx(
                part.factor(np.array(1.0)), rel=1e-15
            )
            assert not negative
    # the third is a number still
    assert sampler.draw_radar(np.eye(16)[[11]])[0][0, 11] == NUMBER[0] + NUMBER[1]


#: A place known better across than along; its eigenvectors are not in the order of its axes.
ALONG = [[1e4, 9e3, 0], [9e3, 1e4, 0], [0, 0, 25]]


def test_a_part_moves_its_constant_and_nothing_else():
    """Also beside places whose errors are correlated, and beside a radar with all of them so."""
    several = radars(position_m=ALONG)
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[3, 3] = ALONG, 1e-7
    several[2]["uncertainty"]["sheet"] = {"covariance": whole.tolist()}
    for radar in (several, several[1:], several[:1]):
        s = network(radar)
        sampler = Sampler.of(s)
        moved = sampler.draw_radar(np.eye(sampler.radar_normals))[0] - s.radar
        own = columns(len(s.radar), s.tolerances_at_level)
        for i, of_radar in enumerate(own):
            assert np.all(moved[of_radar, 4 * i + 3])
            assert_array_equal(np.delete(moved[of_radar], 4 * i + 3, axis=1), 0.0)
            others = np.setdiff1d(np.arange(len(moved)), of_radar) if of_radar else []
            assert_array_equal(moved[others, 4 * i + 3], 0.0)
        root = sampler.sqrt_cov_radar
        assert_allclose(root @ root.T, s.cov_radar["sheet"], rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("several", [1, 3])
def test_indices_of_parts_do_not_have_the_place(several):
    """Of a place that is all of the variance, and constants that are as good as certain."""
    known = {"loss_db": 1e-6}
    far = [[1e6, 9e5, 0], [9e5, 1e6, 0], [0, 0, 25]]
    s = network(radars(known, known, position_m=far)[:several], runs=4096)
    found = error_budget(s, "montecarlo")
    for share in found.part_shares().values():
        assert share.max() < 0.05


def test_a_power_below_zero_is_counted_once_a_run():
    s = network(radars({"average_power_kw": 0.7}, {"peak_power_kw": 400, "gain_dbi": 2}))
    white = np.zeros((5, 13))
    white[4, 7] = -2  # a Gaussian c_r, known to 94 %, would be below zero
    white[[0, 2], 3] = -3.5
    white[[0, 1], 7] = -5.5
    radar, negative = Sampler.of(s).draw_radar(white)
    assert_array_equal(negative, [True, True, True, False, False])
    assert_array_equal(radar[:, 3] == 0, [True, False, True, False, False])
    assert_array_equal(radar[:, 7] == 0, [True, True, False, False, False])


# Propagation.


@pytest.mark.parametrize("logarithmic", [(True, False), (False, True), (True, True)])
def test_log_normal_constants_are_those_of_each_radar(logarithmic):
    s = alone_pair()
    cov = 30 * s.cov_radar["sheet"]
    states = s.model, s.aircraft, s.radar, s.cov_aircraft, cov
    z = StandardNormalSpace.of(uncertain_states(*states, log_constant=logarithmic)[1])
    pose = np.arange(len(s.aircraft))
    u = np.random.default_rng(3).uniform(-0.3, 0.3, z.gradient.shape)
    shift = np.einsum("kij,jk->ki", z.sqrt_cov, u)
    aircraft, radar = s.aircraft.copy(), s.radar + shift[:, 3:]
    aircraft[:, 3:] += shift[:, :3]
    nominal, changed = s.radar[CONSTANTS], shift[:, 3:][:, CONSTANTS]
    radar[:, CONSTANTS] = np.where(
        logarithmic, nominal * np.exp(changed / nominal), nominal + changed
    )
    value, gradient = z(u, pose)
    expected = s.model.linearize_probit(aircraft, radar)[0]
    assert_allclose(value, expected, rtol=1e-11)
    for i in range(len(u)):
        step = 1e-5 * np.eye(len(u))[:, i, np.newaxis]
        slope = (z(u + step, pose)[0] - z(u - step, pose)[0]) / 2e-5
        assert_allclose(gradient[i], slope, rtol=1e-6, atol=1e-6)


def alone_pair():
    return network(radars()[1:])


def test_form_settles_where_one_radar_fades_and_the_others_do_not():
    """With a certain pose, and one uncertain c_r, quantiles are known: P_D grows with it."""
    s = network()
    cov = np.zeros((12, 12))
    cov[3, 3] = s.cov_radar["sheet"][3, 3]
    nothing = np.zeros((6, 6))
    found = propagate(
        s.model, s.aircraft, s.radar, nothing, cov, method="form", log_constant=s.log_constant
    )
    assert found.converged.all()
    relative = math.sqrt(cov[3, 3]) / s.radar[3]
    for bound, beta in ((found.lower, -3), (found.upper, 3)):
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
def test_tolerances_beyond_all_reason_overflow_nothing(method):
    s = network(radars({"loss_db": 20}, {"gain_dbi": 20}))
    assert nonlinear_in_scenario(s, propagate_scenario(s, method=method), method=method).all()
    three_sigma = value_function(network(), method)(["a_constant_loss_db"], 1e6)
    assert np.all((three_sigma <= 1.5) | (method == "linear") | np.isnan(three_sigma))


def test_which_constants_are_log_normal():
    s = network()
    assert list(s.log_constant) == [True, True, False]
    assert list(s.with_analysis(level="plain").log_constant) == [False, False, False]
    assert s.with_analysis(level="plain").tolerances_at_level == ((), (), ())
    assert [[part.key for part in parts] for parts in s.tolerances_at_level] == [
        ["average_power_kw", "temperature_k", "loss_db"],
        ["gain_dbi", "frequency_ghz", "loss_db"],
        [],
    ]
    assert len(load_scenario().log_constant) == 1


def test_each_radar_by_itself_has_its_parts():
    s = network()
    parts = single_radar_scenarios(s)
    for i, (name, one) in enumerate(parts.items()):
        assert one.tolerances_at_level == (s.tolerances_at_level[i],)
        assert one.with_analysis(level="plain").tolerances_at_level == ((),)
        given = next(r for r in radars() if r["name"] == name)
        del given["name"]
        single = document()
        single["uncertainty"]["radar"] = given.pop("uncertainty")
        del single["radars"]
        expected = propagate_scenario(
            parse_scenario(text(single | {"radar": given})), method="form"
        )
        assert_array_equal(propagate_scenario(one, method="form").upper, expected.upper)


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_a_network_of_one_is_the_single_radar_bit_for_bit(sampler):
    """What the command writes is compared in `test_radars`; this is what is beside it."""
    (of_a, *_) = radars()
    one = network([of_a])
    content = document()
    del content["radars"], of_a["name"]
    content["uncertainty"]["radar"] = of_a.pop("uncertainty")
    single = parse_scenario(text(content | {"radar": of_a}))
    for mine, theirs in (
        (error_budget(one, method), error_budget(single, method))
        for method in ("linear", "form", "montecarlo")
    ):
        assert mine.finer == theirs.finer == {}
        assert list(mine.parts) == list(theirs.parts) == [f"radar_constant_{k}" for k in SEARCH_STD]
        for group in ("alone", "parts"):
            for name, std in getattr(mine, group).items():
                assert_array_equal(std, getattr(theirs, group)[name])
    assert single_radar_scenarios(one) == single_radar_scenarios(single) == {}
    mine, theirs = (monte_carlo(s, sampler=sampler) for s in (one, single))
    assert_array_equal(mine.sample_paths, theirs.sample_paths)
    mine, theirs = (LinearModel.of(Sampler.of(s)) for s in (one, single))
    assert_array_equal(mine.by_radar, theirs.by_radar)
    assert analyses.budget(one).report == analyses.budget(single).report
    assert analyses.budget(one).warnings == analyses.budget(single).warnings


def test_the_control_variate_knows_the_parts_of_every_radar():
    s = network()
    linear = LinearModel.of(Sampler.of(s))
    assert linear.by_radar.shape == (3, 16)
    assert_allclose(linear.std, propagate_scenario(s).std, rtol=1e-12)
    sampler, step = Sampler.of(s), 1e-5
    for i in range(16):
        ahead, behind = (
            s.model.p_d(s.aircraft, sampler.draw_radar(side * np.eye(16)[[i]])[0])
            for side in (step, -step)
        )
        assert_allclose(linear.by_radar[:, i], (ahead - behind) / (2 * step), atol=1e-8)


def test_doubts_say_of_whom():
    s = network()
    said = [w for w in analyses.variance(s).warnings if "c_r is not" in w]
    assert said == [
        f"{name}: {shape_warning(s.tolerances_at_level[i], 'linear', log_normal=False)}"
        for i, name in enumerate("ab")
    ]
    assert not [w for w in analyses.variance(s, method="form").warnings if "c_r is not" in w]
    by_level = analyses.sensitivity(s).warnings
    assert [w[:10] for w in by_level if "c_r is not" in w] == ["sheet: a: ", "sheet: b: "]


# The budget.

ROWS = [*(f"a_constant_{key}" for key in SEARCH_STD), *(f"b_constant_{key}" for key in TRACK_STD)]


@pytest.mark.parametrize("method", METHODS)
def test_rows_of_parts(method):
    s = network()
    found = error_budget(s, method)
    assert list(found.parts) == ROWS
    assert list(found.alone) == ["aircraft_position", "aircraft_orientation", "a", "b", "c"]
    for name in "ab":
        mine = [std for row, std in found.parts.items() if row.startswith(f"{name}_")]
        together = np.sqrt(np.sum(np.square(mine), axis=0))
        within = {"linear": 1e-12, "probit": 0.05, "form": 0.15}[method]
        assert_allclose(together, found.finer[f"{name}_constant"], rtol=within)
    # a part alone is the network with nothing else uncertain, and the other radars as they are
    nothing = {"position_m": 0, "attitude_deg": 0}
    for name, keys in (("a", SEARCH_STD), ("b", TRACK_STD)):
        for key, std in keys.items():
            of = [{"loss_db": 0}, {"loss_db": 0}]
            of["ab".index(name)] = {key: std}
            several = radars(*of, position_m=0)
            several[2]["uncertainty"]["sheet"]["constant"] = 0
            expected = propagate_scenario(network(several, aircraft=nothing), method=method).std
            assert_allclose(found.parts[f"{name}_constant_{key}"], expected, rtol=1e-4)


def test_indices_of_parts():
    """With a quarter of the tolerances P_D is nearly linear, and indices are linear shares."""
    quarter = [{k: std / 4 for k, std in stds.items()} for stds in (SEARCH_STD, TRACK_STD)]
    s = network(radars(*quarter), sweep=(60, 60, 1), runs=2**14)
    found, linear = error_budget(s, "montecarlo"), error_budget(s)
    assert list(found.parts) == list(linear.parts) == ROWS
    assert found.std[0] == pytest.approx(linear.std[0], rel=0.02)
    for mine, theirs in (
        (found.part_shares(), linear.part_shares()),
        (found.shares(), linear.shares()),
    ):
        assert list(mine) == list(theirs)
        for name, share in mine.items():
            assert found.share_error[name][0] < 0.02
            assert share[0] == pytest.approx(theirs[name][0], abs=0.03)
    assert max(share[0] for share in linear.part_shares().values()) > 0.2
    assert sum(share[0] for share in found.shares().values()) == pytest.approx(1)


def test_how_much_a_part_of_one_radar_must_be_reduced():
    def known_to(gain):
        several = radars({**SEARCH_STD, "loss_db": 0.2}, {**TRACK_STD, "gain_dbi": gain})
        several[1]["uncertainty"]["sheet"]["position_m"] = 6000
        return network(several, sweep=(60, 60, 1))

    s, half = known_to(0.5), known_to(0.25)
    target = 3 * propagate_scenario(half).std.max()
    three_sigma = value_function(s, "linear")
    assert three_sigma(["b_constant_gain_dbi"], 0.5) == pytest.approx(target, rel=1e-12)
    allowed = required_accuracies(s, target)
    assert list(allowed) == [*error_budget(s).alone, *ROWS, "all"]
    assert allowed["b_constant_gain_dbi"].factor == pytest.approx(0.5, rel=1e-6)
    found = error_budget(s)
    rest = {**found.alone, **found.parts, "b_position": found.finer["b_position"]}
    for name in ("b", "a_constant_average_power_kw", "a_constant_temperature_k",
                 "a_constant_loss_db", "b_constant_gain_dbi"):  # fmt: skip
        del rest[name]
    # of the radar that it is a part of there is the rest, not the whole
    assert max(rest, key=lambda n: rest[n][0]) == "b_position"
    assert allowed["b_constant_gain_dbi"].residual_from == "b_position"
    both = three_sigma(["a_constant_loss_db", "b_constant_gain_dbi"], 0.0) ** 2 / 9
    gone = found.parts["a_constant_loss_db"] ** 2 + found.parts["b_constant_gain_dbi"] ** 2
    assert_allclose(both, found.std**2 - gone, rtol=1e-12)


def test_the_command_shows_the_parts(tool):
    write(text(document(sweep=(60, 60, 1))))
    code, out, err = tool("budget", "my.yaml", "--target", "0.1", "--no-plot", "--out", "out")
    assert code == 0, err
    lines = out.splitlines()
    rows = [line.split()[0] for line in lines[1 : 1 + 12]]
    at = {row: i for i, row in enumerate(rows)}
    # under the radar that they are of, largest first
    for name, keys in (("a", SEARCH_STD), ("b", TRACK_STD)):
        mine = rows[at[name] + 1 : at[name] + 4]
        assert set(mine) == {f"constant_{key}" for key in keys}
    shown = [re.search(r" (\d\.\d{4})", line).start() for line in lines[1:13]]
    assert len(set(shown)) == 1  # in one column
    assert re.search(
        r"^of the radar constants, [ab]_constant_\w+ is what to measure better first: with half "
        r"its deviation the total would be 0\.\d{4}$",
        out,
        re.MULTILINE,
    )
    assert re.search(r"^  b_constant_gain_dbi +", out, re.MULTILINE)
    header = Path("out/paper_budget.csv").read_text().splitlines()[0].split(",")
    assert header[-6:] == [f"three_sigma_{row}" for row in ROWS]
    assert len(set(header)) == len(header)
    record = json.loads(Path("out/paper_budget.json").read_text())
    assert list(record["summary"]["radar_constant_parts_at_largest"]) == ROWS
    again = parse_scenario(yaml.safe_dump(record["scenario"]))
    assert again.tolerances == network().tolerances


def test_the_figure_shows_the_parts():
    lines = analyses.budget(network()).plot().axes[0].lines
    labels = {str(line.get_label()): line for line in lines}
    assert {"a loss_db", "b loss_db", "b gain_dbi"} < set(labels)
    assert labels["b loss_db"].get_color() == labels["b"].get_color()
    assert labels["a loss_db"].get_color() == labels["a"].get_color() != labels["b"].get_color()


def test_check_says_how_every_constant_is_distributed(tool):
    write(text(document()))
    code, out, _ = tool("check", "my.yaml")
    assert code == 0
    said = [line for line in out.splitlines() if "has mean" in line]
    assert [line[:21] for line in said] == ["# a, sheet: c_r has m", "# b, sheet: c_r has m"]
    assert parse_scenario(out).tolerances == network().tolerances


@pytest.mark.parametrize(
    "names", [("a", "a_constant_loss_db"), ("error_a_constant_x", "a"), ("a_constant_b", "c", "a")]
)
def test_names_that_a_part_may_have_are_refused(tool, names):
    assert "begins parts of c_r" in name_problem(names)
    several = [{**radars()[0], "name": name} for name in names]
    write(text(document(several)))
    code, out, err = tool("variance", "my.yaml")
    assert_refused(code, out, err)
    assert name_problem(["a", "b", "a_loss_db", "a_constan"]) is None


def test_tolerances_need_a_radar_that_has_them(tool):
    several = radars()
    several[2]["uncertainty"]["sheet"]["constant"] = {"loss_db": 1}
    write(text(document(several)))
    code, out, err = tool("variance", "my.yaml")
    assert_refused(code, out, err)
    assert "radars[3].uncertainty.sheet.constant: " in err
    assert "in place of radar.constant" in err
