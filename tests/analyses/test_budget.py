"""The budget: sums of shares, indices in closed form, and required accuracies."""

import re

import chain_rule
import numpy as np
import pytest
import yaml
from helpers import OVERHEAD, SOURCES, known_to, required, scenario, shares_of, stds_of, yaml_text
from scipy.constants import Boltzmann
from scipy.stats import norm

import radar_sense as rs
from radar_sense import analyses
from radar_sense.acceptance import accuracy as module
from radar_sense.acceptance.accuracy import required_accuracies
from radar_sense.acceptance.requirement import Requirement
from radar_sense.errors import InputError
from radar_sense.propagation import METHODS, form, propagate_scenario
from radar_sense.propagation.staged import MANY
from radar_sense.scenario_file.load import load_scenario, parse_scenario
from radar_sense.sources import Budget, Contribution, error_budget, worth_most
from radar_sense.states import CONSTANT, RCS_ERROR
from radar_sense.words import describe_poses, probability

FEW = {"start": 0, "stop": 90, "step": 15}


@pytest.mark.parametrize("method", METHODS)
def test_shares_add_up_to_one(method):
    s = scenario(geometry__azimuth_deg=FEW).with_analysis(level="high", runs=1024)
    shares = shares_of(error_budget(s, method))
    assert list(shares) == [*SOURCES, "interaction"]
    np.testing.assert_allclose(np.sum(list(shares.values()), axis=0), 1.0, rtol=1e-12)
    if method == "linear":
        np.testing.assert_allclose(shares["interaction"], 0, atol=1e-12)


def test_shares_add_up_under_correlation():
    s = load_scenario("configs/covariance.yaml")
    shares = shares_of(error_budget(s))
    np.testing.assert_allclose(np.sum(list(shares.values()), axis=0), 1.0, rtol=1e-12)
    assert np.max(abs(shares["interaction"])) > 0.01
    linear = s.model.linearize(s.aircraft, s.radar)
    cov = s.cov_radar
    # the only correlation that matters: north with c_r
    both = 2 * linear.jac_radar[:, 0] * linear.jac_radar[:, 3] * cov[0, 3]
    aircraft = linear.jac_aircraft
    both += 2 * aircraft[:, 0] * aircraft[:, 5] * s.cov_aircraft[0, 5]
    both += 2 * aircraft[:, 2] * aircraft[:, 4] * s.cov_aircraft[2, 4]
    total = linear.std(s.cov_aircraft, cov) ** 2
    np.testing.assert_allclose(shares["interaction"], both / total, atol=1e-12)


def test_sobol_indices_agree_with_the_linear_budget_where_that_is_good():
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 45, "step": 1})
    s = s.with_analysis(runs=2**14, seed=3)
    sobol, linear = error_budget(s, "montecarlo"), error_budget(s)
    for source in SOURCES:
        share, error = sobol.sources[source].share[0], sobol.sources[source].share_error[0]
        assert share == pytest.approx(linear.sources[source].share[0], abs=4 * error + 0.02)
    assert sobol.total.std[0] == pytest.approx(linear.total.std[0], rel=0.01)
    assert sobol.total.std[0] * 3e-4 < sobol.total.three_sigma_error[0] < sobol.total.std[0] * 0.03
    found = analyses.budget(s, method="montecarlo")
    error = sobol.total.three_sigma_error
    np.testing.assert_array_equal(found.table["three_sigma_error_total"], error)
    assert any(line.endswith(f" +/- {probability(error[0])}") for line in found.report)
    for source in SOURCES:
        assert sobol.sources[source].total_index[0] >= sobol.sources[source].share[0] - 0.02


def test_the_error_of_the_interaction_is_its_spread_over_seeds():
    """The errors of two large sources cancel in it, since each is known by the other."""
    s = load_scenario().at_poses([94])
    budgets = [
        error_budget(s.with_analysis(runs=256, seed=seed), "montecarlo") for seed in range(40)
    ]
    found, errors = np.array(
        [(b.interaction.share[0], b.interaction.share_error[0]) for b in budgets]
    ).T
    # 39 and 40 · 7 degrees of freedom: the ratio is known to 12 %
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(found.std(ddof=1), rel=4 * 0.12)
    assert errors.mean() < 0.2 * np.mean([b.sources["radar_constant"].share_error for b in budgets])


def test_a_share_of_few_runs_is_not_negative():
    """The estimate of the index is -6."""
    s = load_scenario("configs/network.yaml").at_poses([318]).with_analysis(runs=32, seed=1)
    assert min(c.std for c in error_budget(s, "montecarlo").sources.values()) == 0


def test_sobol_indices_are_refused_under_correlation():
    with pytest.raises(InputError, match="independent sources"):
        error_budget(load_scenario("configs/covariance.yaml"), "montecarlo")
    # within a source correlation does no harm
    error_budget(load_scenario("configs/covariance.yaml").with_analysis(level="survey"), "linear")
    tilted = {"position_m": [[100, 50, 0], [50, 100, 0], [0, 0, 1]], "constant": 5}
    choices = {"level": "tilted", "runs": 512}
    s = scenario(geometry__azimuth_deg=FEW, uncertainty__radar={"tilted": tilted}, analysis=choices)
    found = shares_of(error_budget(s, "montecarlo"))
    linear = shares_of(error_budget(s))
    np.testing.assert_allclose(found["radar_position"], linear["radar_position"], atol=0.02)


@pytest.mark.parametrize(("method", "target"), [*((m, 0.03) for m in METHODS), ("form", 0.085)])
def test_required_accuracies_reach_the_target(method, target):
    s = scenario(geometry__azimuth_deg=FEW)
    for source, found in required_accuracies(
        s, Requirement(target, width=True), method=method
    ).items():
        if found.factor is None:
            assert found.residual > target
            assert found.residual_from in SOURCES
            assert source != "all"
        else:
            # draws have an error of 0.3 %; a factor that they refuse is reduced by 0.5 % at least
            assert found.residual == pytest.approx(target, rel=1e-6 if found.known else 0.01)
            assert found.residual <= target


def test_required_accuracies_are_those_of_the_closed_form():
    """For independent sources, s² V_i + V_rest = (target/3)² at the worst pose by `linear`."""
    s, target = load_scenario().at_poses(slice(None, None, 3)), 0.08
    alone = {source: 9 * std**2 for source, std in stds_of(error_budget(s).sources).items()}
    total = sum(alone.values())
    found = required_accuracies(s, Requirement(target, width=True))
    for source, own in alone.items():
        depends = own > 0
        squared = np.min((target**2 - (total - own))[depends] / own[depends])
        if squared < 0:
            assert found[source].factor is None
            assert found[source].residual == pytest.approx(np.sqrt(np.max(total - own)), rel=1e-9)
        else:
            assert found[source].factor == pytest.approx(np.sqrt(squared), rel=1e-6)
    assert found["all"].factor == pytest.approx(target / np.sqrt(total.max()), rel=1e-6)
    impossible = {source for source, f in found.items() if f.factor is None}
    assert impossible == {"aircraft_position", "radar_position"}


def test_a_small_contribution_has_one_digit_in_the_report():
    s = scenario(uncertainty__aircraft={"position_m": 1, "attitude_deg": 1})
    rows = [line.split() for line in analyses.budget(s).report]
    assert ["aircraft_position", "2e-05", "0.0%"] in rows


@pytest.mark.parametrize("rounding", [-4.5e-16, 4.5e-16])
@pytest.mark.parametrize("limit", [0.25, np.nextafter(4.0, 0.0)])
def test_required_accuracies_where_a_limit_is_a_value(limit, rounding, monkeypatch):
    """The last bit of a value may depend on the other poses."""
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 90, "step": 45})

    def value_function(scenario, method, k=None, of_miss=False):
        values = (1.0 + rounding * (3 - len(scenario.axis))) * (1.0 - scenario.axis.values / 100)
        return lambda names, factor: factor * values

    monkeypatch.setattr(module, "value_function", value_function)
    for found in required_accuracies(s, Requirement(limit, width=True)).values():
        assert found.factor == pytest.approx(limit, rel=1e-8)


def test_the_poses_between_the_azimuths_of_a_table_are_counted():
    """`test_required` has the factor of a target that is met between them."""
    few = scenario(geometry__azimuth_deg={"start": 0, "stop": 80, "step": 20})
    result = analyses.budget(few, target=0.088, method="probit")
    found, rows = result.summary["target"], len(result.table["theta_r_deg"])
    assert found["poses_between_rows"] == found["poses"] - rows > 2 * rows
    assert f"and at {found['poses_between_rows']} between them" in str(result.report)
    one = analyses.budget(few, target=0.088, at=0, method="probit").summary["target"]
    assert (one["poses"], one["poses_between_rows"], one["at_deg"]) == (1, 0, 0)


def test_required_accuracies_keep_correlations():
    """A factor on a source also scales its covariances with other sources."""
    s = load_scenario("configs/covariance.yaml").at_poses(slice(None, None, 6))
    scale = np.diag(
        [1, 1, 1, required_accuracies(s, Requirement(0.15, width=True))["radar_constant"].factor]
    )
    cov = scale @ s.cov_radar @ scale
    linear = s.model.linearize(s.aircraft, s.radar)
    assert 3 * linear.std(s.cov_aircraft, cov).max() == pytest.approx(0.15, rel=1e-6)


@pytest.mark.all_draws
def test_what_remains_is_said_in_digits_that_show_it_beyond_the_limit():
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 60, "step": 15})
    text = "\n".join(analyses.budget(s, threshold=0.9085, method="automatic").report)
    remains = {*re.findall(r"about ([0-9.]+) remains at 60 deg, from radar_constant", text)}
    assert remains
    assert all(0.9085 < float(value) < 0.91 for value in remains)


def test_what_to_know_first_is_not_known_where_a_half_has_no_value():
    """FORM does not converge with half of the gain's deviation, which leaves least."""
    s = load_scenario("configs/gap_fillers.yaml").at_poses(slice(43, 44))
    assert s.axis.at(0) == "86 deg"
    line, heading, *_ = analyses.budget(s, method="form").report
    assert line.startswith("what to know better first is not known: form has no value")
    assert line.endswith("at 86 deg; use --method automatic")
    assert heading.startswith("3 sigma of P_D")


def test_the_report_of_a_budget_has_the_required_accuracies():
    result = analyses.budget(load_scenario(), target=0.05)
    text = "\n".join(result.report)
    assert "impossible alone (0.0728 remains at 45.5 deg, from radar_constant)" in text
    assert "  all                   54.6 %" in text
    assert result.summary["target"]["required_accuracy"]["all"]["factor"] == pytest.approx(
        0.5458, rel=1e-4
    )


def test_methods_other_than_linear_add_columns():
    s = scenario(geometry__azimuth_deg=FEW).with_analysis(runs=256)
    plain = list(analyses.budget(s, method="linear").table)
    for method in METHODS:
        table = analyses.budget(s, method=method).table
        assert list(table)[: len(plain)] == plain
        assert ("mean_pd" in table) == ("share_interaction" in table) == (method != "linear")
    for analysis in (analyses.variance, analyses.montecarlo, analyses.sensitivity):
        plain = list(analysis(s, method="linear").table)
        for method in ("linear", "probit", "form"):
            table = analysis(s, method=method).table
            assert list(table)[: len(plain)] == plain
            means = [key for key in table if key.startswith("mean_pd")]
            assert bool(means) == (method != "linear")  # by `linear` the mean is P_D itself


@pytest.mark.parametrize("method", ["linear", "automatic"])
def test_tiny_targets_are_reached(method):
    s = scenario(geometry__azimuth_deg=FEW)
    factor = required_accuracies(s, Requirement(1e-6, width=True), method=method)["all"].factor
    # 3σ is proportional to the deviations where they are so small
    assert factor == pytest.approx(1e-6 / (3 * error_budget(s, "linear").total.std.max()), rel=1e-3)
    assert required_accuracies(s, Requirement(1e-9, width=True), method=method)["all"].factor == 0
    assert any("less than a millionth" in line for line in analyses.budget(s, target=1e-9).report)


def test_factors_beyond_the_values_of_a_method_are_not_known(monkeypatch):
    monkeypatch.setattr(form, "ITERATIONS", 20)  # a search that fails takes all of them
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 45, "step": 1})
    some = required(s, 1.5, "radar_constant", "aircraft_orientation", method="form")
    for found in some.values():
        # draws find that 3σ of P_D is not above 1.5, whatever the error is
        assert found.factor == np.inf
        assert found.known
        assert found.residual <= 1.5
    # Form does not converge where two lobes meet.
    spiky = load_scenario("configs/spikeball.yaml").at_poses(slice(0, None, 60))
    unknown = np.flatnonzero(np.isnan(propagate_scenario(spiky, method="form").std))
    found = required(spiky.at_poses(unknown[:1]), 0.02, "radar_constant", "all", method="form")
    # draws answer in place of the method
    alone, together = found.values()
    assert (alone.factor, alone.known) == (None, True)
    assert alone.residual > 0.02
    assert 0 < together.factor < 1
    assert not together.known


#: At 151 km a weak radar sees the aircraft. A strong radar, whose limit is at 150 km, sees it only
#: if errors bring the two together.
AT_A_LIMIT = """
name: limit
radars:
  - {name: near, position_m: [0, 0, -20], constant: 0.08, p_fa: 1.0e-6,
     uncertainty: {s: {position_m: 10, constant: 0.0008}}}
  - {name: edge, position_m: [0, 0, -20], constant: 20, p_fa: 1.0e-6, max_range_km: 150,
     uncertainty: {s: {position_m: 500, constant: 1}}}
aircraft: {rcs: {model: constant, rcs_m2: 1}, attitude_deg: [0, 0, 90]}
geometry: {type: orbit, range_km: 151, down_km: -3, azimuth_deg: {start: 0, stop: 0, step: 1},
           azimuth_from: north}
uncertainty: {aircraft: {position_m: 10, attitude_deg: 1}}
analysis: {level: s}
"""


@pytest.fixture
def many_draws(monkeypatch):
    """Let draws find a factor as for a user, and a quarter of those for a user judge it."""
    monkeypatch.setattr(module, "PRECISE", 4096)
    monkeypatch.setattr(module, "MANY", MANY)


def three_sigma_at_a_limit(near, edge, aircraft):
    """3 sigma of P_D of `AT_A_LIMIT`, with factors on the deviations, by plain draws."""
    rng, runs, missed = np.random.default_rng(7), 100_000, 1.0
    at = np.array([151e3, 0, -3000]) + 10 * aircraft * rng.standard_normal((runs, 3))
    for constant, std, std_constant, limit, factor in (
        (0.08, 10, 0.0008, np.inf, near),
        (20, 500, 1, 150e3, edge),
    ):
        radar = np.array([0, 0, -20]) + std * factor * rng.standard_normal((runs, 3))
        c_r = np.maximum(constant + std_constant * factor * rng.standard_normal(runs), 0)
        distance = np.linalg.norm(at - radar, axis=1)
        p_d = chain_rule.north(c_r / (Boltzmann * distance**4), 1e-6)
        missed = missed * (1 - np.where(distance <= limit, p_d, 0))
    return 3 * np.std(missed)


@pytest.mark.usefixtures("many_draws")
def test_a_limit_in_reach_of_errors_bounds_the_factors():
    """FORM does not see the limit. σ grows with a factor and falls again, as radars scatter."""
    s = parse_scenario(AT_A_LIMIT)
    assert three_sigma_at_a_limit(1, 1, 1) > 0.25
    assert three_sigma_at_a_limit(1, 1e6, 1) < 0.1
    found = required(s, 0.2, "aircraft_position", "edge")
    alone = found["aircraft_position"]
    assert (alone.factor, alone.known) == (None, True)
    assert alone.residual_from in ("edge", "edge_position")  # which differ by less than the noise
    assert alone.residual == pytest.approx(0.278, rel=0.12)
    grown = required(s, 0.5, "edge")
    for limit, edge in ((0.2, found["edge"]), (0.5, grown["edge"])):
        assert three_sigma_at_a_limit(1, edge.factor, 1) == pytest.approx(limit, rel=0.1)


@pytest.mark.usefixtures("many_draws")
def test_a_growth_that_meets_a_limit_is_not_allowed():
    """The limit is 20 km away, 200 σ, and beyond some 1000 σ the radar is seldom in range."""
    content = yaml.safe_load(AT_A_LIMIT)
    del content["radars"][0]
    content["radars"][0] |= {"max_range_km": 100, "constant": 5}
    content["radars"][0]["uncertainty"] = {"s": {"position_m": 10, "constant": 0.5}}
    content["uncertainty"]["aircraft"]["position_m"] = 100
    content["geometry"]["range_km"] = 120
    positions = ("aircraft_position", "radar_position")
    found = required(parse_scenario(yaml_text(content)), 0.2, *positions, "radar_constant")
    normals = np.random.default_rng(1).standard_normal((400_000, 3))
    for name, std in zip(positions, (100, 10), strict=True):
        # P_D is 1 where an error brings the aircraft into range
        line = [120e3, 0, -2980] + found[name].factor * std * normals
        inside = np.mean(np.linalg.norm(line, axis=1) < 100e3)
        assert 3 * np.sqrt(inside * (1 - inside)) == pytest.approx(0.2, rel=0.06)
    assert found["radar_constant"].factor == np.inf


@pytest.mark.usefixtures("many_draws")
def test_draws_find_the_poses_at_which_they_verify(monkeypatch):
    """Of 31 poses on a line one is 30 m beyond the limit, with errors of 100 m."""
    monkeypatch.setattr(module, "VERIFIED", 1)
    content = yaml.safe_load(AT_A_LIMIT)
    del content["radars"][0]
    content["radars"][0]["uncertainty"]["s"]["position_m"] = 100
    line = {"type": "radial", "azimuth_deg": 0, "down_km": -3, "azimuth_from": "north"}
    content["geometry"] = {**line, "range_km": {"start": 120, "stop": 180, "step": 2}}
    found = required(parse_scenario(yaml_text(content)), 0.3, "all")["all"]
    beyond = np.hypot(150e3, 2980) - 150e3
    # P_D is 1 within the limit and 0 beyond, which has the variance q (1 - q)
    inside = norm.sf(beyond / (found.factor * np.hypot(100, 10)))
    assert 3 * np.sqrt(inside * (1 - inside)) == pytest.approx(0.3, rel=0.05)


def test_undefined_gradients_of_certain_states_do_not_matter():
    """With the radar straight below λ is undefined, but P_D depends on c_r in a known way."""
    s = scenario(
        **OVERHEAD,
        radar__constant=1e-4,
        **known_to(constant=1e-6),
    )
    linear, form = error_budget(s), error_budget(s, "form")
    assert 0 < linear.total.std[0] < 1
    assert form.total.std[0] == pytest.approx(linear.total.std[0], rel=0.01)


def test_a_source_without_a_value_is_not_dominant():
    """`form` has no value for the orientation at -90 deg, or for a total that did not converge."""
    for name in ("covariance", "spikeball"):
        s = rs.load_scenario(f"configs/{name}.yaml")
        s = s.at_poses(np.arange(0, len(s.aircraft), 12))
        found = analyses.budget(s, method="form")
        size = {source: found.table[f"three_sigma_{source}"] for source in (*SOURCES, "total")}
        unknown = {name: np.isnan(size[name]) for name in ("aircraft_orientation", "total")}
        assert unknown["aircraft_orientation"].any()
        assert "nan" not in " ".join(found.report)
        first = np.flatnonzero(unknown["aircraft_orientation"] & ~unknown["total"])[:1]
        if len(first):
            at_one = analyses.budget(s.at_poses(first), method="form")
            assert at_one.summary["dominant"] is None
        for source, mask in unknown.items():
            line = f"{source} has no value {describe_poses(mask, s.axis)}"
            assert (line in found.report) == mask.any()
        any_unknown = unknown["aircraft_orientation"] | unknown["total"]
        others = np.maximum(size["radar_constant"], size["aircraft_position"])
        own = (0.999 * size["aircraft_orientation"] > others) & (size["total"] > 0)
        expected = describe_poses(own & ~any_unknown, s.axis)
        assert found.summary["dominates"].get("aircraft_orientation", "") == expected


def test_of_equals_none_dominates():
    """Two radars at one place have one effect; a third, with a constant known worse, has more."""
    one = {"p_fa": 1e-6, "position_m": [0, 0, 0], "constant": 160}
    known, worse = ({"medium": {"position_m": 0, "constant": of}} for of in (2, 4))
    certain = {"aircraft": {"position_m": 0, "attitude_deg": 0}}
    for third, expected in ((known, None), (worse, "r2")):
        radars = [
            {**one, "name": f"r{i}", "uncertainty": levels}
            for i, levels in enumerate((known, known, third))
        ]
        s = scenario(radars=radars, uncertainty=certain, analysis__level="medium")
        found = analyses.budget(s)
        assert found.summary["dominant"] == expected
        assert found.summary["dominates"] == ({expected: "at all 361 poses"} if expected else {})


def test_a_figure_of_many_lines_names_those_that_it_leaves_out():
    s = rs.load_scenario("configs/rainy_day.yaml")
    s = s.at_poses(np.arange(0, len(s.aircraft), 10))
    found = error_budget(s)
    tops = {c.name: c.std.max() for c in (*found.sources.values(), *found.parts.values())}
    left_out = {name for name, top in tops.items() if top < 0.01 * found.total.std.max()}
    assert 0 < len(left_out) < len(tops)
    figure = analyses.budget(s, method="linear").plot()
    (text,) = (t.get_text() for t in figure.texts if "below 1%" in t.get_text())
    named = text.splitlines()[0].removeprefix("below 1% of the total: ").split(", ")
    assert {name.replace(" ", "_") for name in named} == left_out
    drawn = [line for line in figure.axes[0].lines if not line.get_label().startswith("_")]
    assert len(drawn) == len(tops) - len(left_out) + 1
    # every line that is drawn reaches 1 % of the total somewhere
    highest = max(np.nanmax(line.get_ydata()) for line in drawn)
    assert all(np.nanmax(line.get_ydata()) >= 0.01 * highest for line in drawn)


def test_the_figure_names_a_band_and_not_a_unit():
    """Bands are S and L, in small letters: no seconds."""
    s = rs.load_scenario("configs/gap_fillers.yaml")
    s = s.at_poses(np.arange(0, len(s.aircraft), 10))
    (axes,) = analyses.budget(s, method="linear").plot().axes
    labels = axes.get_legend_handles_labels()[1]
    assert {"aircraft rcs s", "aircraft rcs l", "type gap filler", "long_range"} <= set(labels)


def test_what_to_know_first_is_what_leaves_least_if_it_is_halved():
    """By `form` c_r alone makes P_D more uncertain than the RCS does, but not both together."""
    s = scenario(
        geometry__azimuth_deg={"start": 0, "stop": 0, "step": 1},
        geometry__range_km=300,
        aircraft__rcs={"model": "constant", "rcs_m2": 0.1},
        radar__constant=854,
        radar__detector="swerling1",
        radar__p_fa=1e-6,
        **known_to(10, 1, rcs_db=5.2, position_m=10, constant=0.25 * 854),
    )
    result = analyses.budget(s, method="form")
    alone, states = result.summary["at_largest"], s.states()
    assert max(alone, key=alone.get) == "radar_constant"
    left = []
    for component in (CONSTANT, RCS_ERROR):
        halved = np.ones(7)
        halved[component] = 0.5
        given = (
            s.aircraft,
            states.radar,
            s.cov_aircraft,
            states.cov_radar * np.outer(halved, halved),
        )
        left.append(3 * float(rs.propagate(s.model, *given, method="form").std[0]))
    assert left[1] < 0.7 * left[0]
    assert result.report[0].startswith("know better first: aircraft_rcs, ")
    (shown,) = re.findall(r"half its deviation leaves (0\.\d+) of ", result.report[0])
    # the second derivatives of z are those at the whole deviation
    assert float(shown) == pytest.approx(left[1], rel=0.01)


def test_the_ranking_is_that_of_the_pose_asked_for():
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 90, "step": 45})
    at_45, at_90 = (analyses.budget(s, at=at) for at in (45, 90))
    assert analyses.budget(s).summary["at_largest"] == at_45.summary["at_pose"]
    for source, value in at_90.summary["at_pose"].items():
        assert value == at_90.table[f"three_sigma_{source}"][2]
    assert at_90.report[1] == "3 sigma of P_D (medium) at 90 deg, and share of its variance:"
    assert " at 90 deg; half its deviation leaves " in at_90.report[0]
    with pytest.raises(InputError, match="there is no pose at 50 deg, the nearest of 3 is at 45"):
        analyses.budget(s, at=50)


@pytest.mark.parametrize(("interaction", "noise"), [(-0.076, True), (0.10, True), (-0.15, False)])
def test_an_interaction_within_two_standard_errors_is_noise(interaction, noise):
    """Total and source have an error of 4 % of their variance each: 0.113 of the difference."""
    known, nothing = np.ones(1), np.zeros(1)
    parts = {
        name: Contribution(name, known, np.array([share]))
        for name, share in (("radar", 1.0), ("total", 1.0), ("interaction", interaction))
    }
    budget = Budget(
        nothing, {"radar": parts["radar"]}, {}, {}, parts["total"], parts["interaction"]
    )
    assert budget.interaction_is_noise("automatic") == noise
    assert not budget.interaction_is_noise("form")


@pytest.mark.all_draws
@pytest.mark.parametrize("seed", [1, 11, 13])
def test_draws_do_not_choose_between_equal_sources(seed):
    """A gain of the type off by 1 dB, there and back, is a cross section off by 2 dB."""
    s = rs.load_scenario("configs/gap_fillers.yaml", {"analysis.seed": seed})
    s = s.at_poses(slice(43, 44))
    first, _ = worth_most(s, error_budget(s, "automatic"))
    assert {c.name for c in first} == {"aircraft_rcs_s", "type_gap_filler_gain_dbi"}
