"""An uncertain RCS and an uncertain attenuation, against draws of the program in `studies.bands`.

One factor of the RCS holds for all radars and all looks. Each radar has an attenuation of its own.
"""

import numpy as np
import pytest
from helpers import document, place, read_back, refusal, scenario, with_arrays, yaml_text
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm
from studies.bands import cases, truth
from studies.bands.model import Oracle

import radar_sense as rs
from radar_sense import analyses
from radar_sense.acceptance.requirement import Requirement
from radar_sense.model.rcs import ConstantRCS
from radar_sense.montecarlo.exceedance import exceedance
from radar_sense.propagation import METHODS, distribution, propagate_scenario
from radar_sense.sources import error_budget

pytestmark = pytest.mark.usefixtures("quick")

P_FA, AREA, POSE, DECIBELS = 1e-4, 0.05, 500.0, 1.5
TAILS = norm.cdf([-3, 3])
#: Place, its standard deviation, and c_r with its own without an attenuation.
RADARS = {
    "one": ((0.0, 0.0, -20.0), 1000.0, (0.006, 0.0004)),
    "two": ((10e3, 20e3, -20.0), 500.0, (0.0016, 0.0001)),
    "three": ((20e3, -20e3, -20.0), 800.0, (0.001, 0.00008)),
}
#: c_r and its standard deviation with an attenuation, the attenuation and its own [dB/km].
ATTENUATED = {
    "one": ((0.04, 0.003), 0.05, 0.01),
    "two": ((0.02, 0.001), 0.1, 0.015),
    "three": ((0.003, 0.0003), 0.0, 0.0),
}
NORTH = np.array([60e3, 0.0, -6e3, 0.0, 0.0, np.pi / 2])


def network(names=tuple(RADARS), rcs_db=0.0, attenuation=None):
    """Document of radars that see an aircraft 60 km north of the origin, with Swerling 1.

    The attenuation is None, "certain" or "uncertain".
    """
    content = document(
        geometry__range_km=60,
        geometry__down_km=-6,
        geometry__azimuth_from="north",
        geometry__azimuth_deg={"start": 0, "stop": 0, "step": 1},
        aircraft__rcs={"model": "constant", "rcs_m2": AREA},
        analysis={"level": "one", "runs": 2**13, "seed": 1},
        uncertainty={"aircraft": {"position_m": POSE, "attitude_deg": 1, "rcs_db": rcs_db}},
        radars=[],
    )
    for name in names:
        at, std, (constant, std_constant) = RADARS[name]
        entry, level = {}, {}
        if attenuation:
            (constant, std_constant), alpha, std_alpha = ATTENUATED[name]
            entry = {"attenuation_db_per_km": alpha}
            if std_alpha and attenuation == "uncertain":
                level = {"attenuation_db_per_km": std_alpha}
        level = {"position_m": std, "constant": std_constant, **level}
        content["radars"].append({
            "name": name, "position_m": list(at), "constant": constant, "p_fa": P_FA, **entry,
            "detector": "swerling1", "uncertainty": {"one": level},
        })  # fmt: skip
    return content


def parsed(*args, **kwargs):
    return rs.parse_scenario(yaml_text(network(*args, **kwargs)))


def drawn_at(content, poses, runs, seed):
    """P_D (runs, n) at poses (n, 6), with the same errors at all of them."""
    oracle = Oracle(cases.of_document(content, NORTH))
    aircraft, *errors = oracle.draw(np.random.default_rng(seed), runs)
    error = aircraft - NORTH[:, np.newaxis]
    p_d = [oracle.p_d(pose[:, np.newaxis] + error, *errors) for pose in poses]
    return np.stack(p_d, axis=1)


@pytest.mark.parametrize(
    ("names", "rcs_db", "attenuation"),
    [
        (tuple(RADARS), DECIBELS, None),
        (("one",), 0.0, "uncertain"),
        (("one",), 1.0, "uncertain"),
        (("three", "one", "two"), 1.0, "uncertain"),
    ],
)
def test_the_distribution_is_that_of_plain_draws(names, rcs_db, attenuation):
    content = network(names, rcs_db, attenuation)
    s = rs.parse_scenario(yaml_text(content))
    oracle = Oracle(cases.of_document(content, NORTH))
    every = truth.drawn(oracle, np.random.default_rng(1), 400_000)
    std, ends = every.std(), np.quantile(every, TAILS)
    within, density = 0.02 if attenuation else 0.01, 0.07 * std  # four errors of a quantile
    assert std > 0.03
    form = propagate_scenario(s, method="form")
    assert form.mean[0] == pytest.approx(every.mean(), abs=within * std)
    assert form.std[0] == pytest.approx(std, rel=within)
    of_form = 0.12 * std if attenuation else density + 0.002
    assert_allclose([form.lower[0], form.upper[0]], ends, atol=of_form)
    if not attenuation:
        assert propagate_scenario(s, method="probit").std[0] == pytest.approx(std, rel=0.1)
    mc = rs.monte_carlo(s, runs=100_000)
    assert mc.mean[0] == pytest.approx(every.mean(), abs=5 * std * np.sqrt(1.25e-5))
    assert mc.std[0] == pytest.approx(std, rel=0.025)
    assert_allclose([mc.lower[0], mc.upper[0]], ends, atol=4 * density)
    assert rs.monte_carlo(s, runs=2**14, sampler="sobol").std[0] == pytest.approx(std, rel=0.03)
    level = float(np.quantile(every, 0.9))
    assert distribution(s, "form").exceedance(level)[0] == pytest.approx(0.1, abs=0.003)
    less = parsed(names, 0.0 if attenuation is None else rcs_db, attenuation and "certain")
    assert propagate_scenario(less, method="form").std[0] < 0.96 * std


def test_poses_share_the_factor():
    poses = np.tile(NORTH, (3, 1))
    poses[1:, :2] = [[40e3, 45e3], [-45e3, 40e3]]
    s = with_arrays(
        parsed(rcs_db=DECIBELS), aircraft=poses, correlation_s=np.inf, time_s=[0, 10, 20], seed=1
    )
    every = drawn_at(network(rcs_db=DECIBELS), poses, 200_000, 3)
    p_max = float(np.quantile(every[:, 0], 0.98))
    exceeded = every > p_max
    found = exceedance(s, Requirement(p_max).margin, 50_000)
    expected = exceeded.any(axis=1).mean()
    error = found.error(found.anywhere)
    assert found.anywhere / found.runs == pytest.approx(expected, abs=5 * error)
    assert error < 0.06 * expected
    mc = rs.monte_carlo(s, runs=4000)
    # pose errors are drawn at each pose, the RCS is not
    assert np.corrcoef(mc.sample_paths.T)[0, 2] > 0.5
    assert mc.std[2] == pytest.approx(every[:, 2].std(), rel=0.05)


FIXED = ["aircraft_position", "aircraft_orientation", "radar_position", "radar_constant", "total"]
MEDIUM = {"position_m": 100, "constant": 5}


ATTENUATION = {
    "radar__attenuation_db_per_km": 0.01,
    "uncertainty__radar__medium": {**MEDIUM, "attenuation_db_per_km": 1e-3},
}
OWN_SOURCES = {
    "aircraft_rcs": {"uncertainty__aircraft__rcs_db": 1},
    "radar_attenuation": ATTENUATION,
}


@pytest.mark.parametrize("source", OWN_SOURCES)
def test_the_budget_has_a_source_of_its_own_after_the_fixed_columns(source):
    one = scenario(**OWN_SOURCES[source]).at_poses(slice(None, None, 4))
    found = analyses.budget(one)
    names = [f"three_sigma_{name}" for name in (*FIXED, source)]
    assert list(found.table) == ["theta_r_deg", *names]
    parts = [found.table[name] for name in names if "total" not in name]
    assert_allclose(np.sqrt(np.sum(np.square(parts), axis=0)), found.table[names[4]], rtol=1e-12)
    assert any(source in line for line in found.report)
    own = error_budget(one).sources[source].std
    if source == "radar_attenuation":  # 0.001 dB/km on 500 km is 1 dB there and back
        plain = with_arrays(one, errors={}, rcs_db=1.0)
        assert_allclose(own, error_budget(plain).sources["aircraft_rcs"].std, rtol=2e-5)
        return
    certain = {"medium": np.zeros((4, 4))}
    only = with_arrays(one, cov_aircraft=np.zeros((6, 6)), cov_radar=certain, level="medium")
    for method in ("linear", "probit", "form"):
        alone = error_budget(one, method).sources[source].std
        assert_allclose(alone, propagate_scenario(only, method=method).std, rtol=1e-3)


def test_the_budget_of_a_network_has_the_attenuation_of_each_radar():
    s = parsed(rcs_db=1.0, attenuation="uncertain")
    for method in METHODS:
        budget = error_budget(s, method)
        names = ["aircraft_position", "aircraft_orientation", *RADARS]
        assert list(budget.sources) == [*names, "aircraft_rcs"]
        if method == "montecarlo":  # Sobol' indices have no finer sources
            assert not budget.finer
            continue
        if method == "linear":
            for name in RADARS:
                parts = ("position", "constant", "attenuation")
                whole = sum(budget.finer[f"{name}_{part}"].std ** 2 for part in parts)
                assert_allclose(budget.sources[name].std ** 2, whole, rtol=1e-12)
        assert min(budget.finer[f"{name}_attenuation"].std[0] for name in ("one", "two")) > 0.002
        assert budget.finer["three_attenuation"].std[0] == 0
    result = analyses.budget(s)
    rows = [line.split() for line in result.report if line.startswith("    attenuation")]
    total = result.table["three_sigma_total"][0]
    shown = sorted(
        (f"{three:.4f}", f"{(three / total) ** 2:.1%}")
        for name in RADARS
        for three in result.table[f"three_sigma_{name}_attenuation"]
        if three > 0
    )
    assert sorted((three, share) for _, three, share in rows) == shown


# The attenuation alone.


def test_the_attenuation_is_read_and_read_back():
    s = parsed(rcs_db=1.5, attenuation="uncertain")
    alpha = [[factor.one_way for factor in m.factors] for m in s.model.models]
    assert alpha == [[pytest.approx(5e-5)], [pytest.approx(1e-4)], []]
    std = [radar.levels["one"].errors for radar in s.radars]
    assert std == [{"attenuation": pytest.approx(0.2)}, {"attenuation": pytest.approx(0.15)}, {}]
    each = s.states().radar.reshape(3, 7)
    assert_array_equal(each[:, :4], s.radar_states)
    assert not each[:, 4:].any()
    cov = s.states().cov_radar[0]
    assert_allclose(cov[4::7, 4::7], np.full((3, 3), 2.25), rtol=1e-12)  # one error of the RCS
    assert_allclose(cov[5::7, 5::7], np.diag([0.04, 0.0225, 0]), rtol=1e-12)
    record = s.resolved()
    assert "attenuation_db_per_km" not in record["radars"][2]
    assert record["radars"][1]["attenuation_db_per_km"] == 0.1
    assert record["radars"][1]["uncertainty"]["one"]["attenuation_db_per_km"] == 0.015
    assert_array_equal(read_back(s).states().cov_radar[0], cov)
    certain = parsed(attenuation="certain")
    assert not certain.states().cov_radar[0].reshape(3, 7, 21)[:, 4:].any()
    whole = {"covariance": np.eye(4).tolist(), "attenuation_db_per_km": 0.005}
    one = scenario(radar__attenuation_db_per_km=0.01, uncertainty__radar__low=whole)
    std = {name: level.errors for name, level in one.radars[0].levels.items()}
    assert std == {"low": {"attenuation": 0.5}, "medium": {}, "high": {}}
    assert not one.uncertain_parameters
    assert one.with_analysis(level="low").states().cov_radar[0, -2, -2] == pytest.approx(0.25)


def test_refusals_name_the_key(tool):
    level = "uncertainty.radar.medium.attenuation_db_per_km"
    for attenuation, std in ((0, 0.1), (0.1, 0.1001)):
        medium = {**MEDIUM, "attenuation_db_per_km": std}
        content = document(uncertainty__radar__medium=medium)
        content["radar"]["attenuation_db_per_km"] = attenuation
        _, key, complaint = place(refusal(tool, yaml_text(content)))
        assert key == level
        most = f"must be at most the attenuation_db_per_km of the radar, {attenuation}, got"
        assert most in complaint
    with pytest.raises(ValueError, match="one_way must be a number not less than 0"):
        rs.Attenuation(-1)
    with pytest.raises(ValueError, match="needs a factor of the model with this parameter"):
        with_arrays(parsed(("one",)), errors={"one": ({"tilt": 0.1},)})
    with pytest.raises(ValueError, match="got inf for the error of the attenuation"):
        rs.DetectionModel(ConstantRCS(1.0), 1e-6).p_d(
            np.ones(6), np.array([0, 0, 0, 1, 0, np.inf, 0])
        )
