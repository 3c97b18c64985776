"""The package against the reference set, whose numbers are from programs without its code."""

import numpy as np
import oracle
import pytest
from numpy.testing import assert_allclose
from reference import draws, reading
from reference.judging import exact_errors, judge
from scipy.special import ndtr
from studies.bands import truth

from radar_sense.propagation import METHODS

SET = reading.read()
#: Relative errors of the package, some twice what is measured.
P_D, SLOPE = 2e-14, 4e-12


def test_the_set_is_what_its_page_says():
    columns = [columns for _, columns in SET]
    assert sum(len(c["p_d"]) for c in columns) == 2019
    assert len({block["rcs"]["model"] for block, _ in SET}) == 5
    assert len({str(block["detector"]) for block, _ in SET}) == 17
    for block, c in SET:
        assert len(c["p_d"]) == block["poses"] == (73 if block["scenario"] < 3 else 20)
        assert c["relative_error"].max() <= 5.1e-17
        for name in ("mean", "std", "lower_3", "upper_3", "exceedance"):
            assert c[f"{name}_se"].max() <= 0.002
        assert np.all(c["lower_3"] <= c["upper_3"] + 1e-9)


def test_p_d_gradient_and_sigma_to_first_order():
    for block, c in SET:
        errors = exact_errors(block, c)
        most = np.where(c["p_d"] == 0, 0.0, [[P_D], [SLOPE], [SLOPE]])
        assert np.all(errors <= most), f"{block['scenario']} {block['name']}"


@pytest.mark.parametrize("method", METHODS)
def test_bounds_are_right_or_warned(method):
    """At one pose in some scenarios; `make study` takes all poses."""
    some = SET[:: 8 if method in ("linear", "probit") else 4]
    judged = [judge(b, c, method, slice(b["scenario"] % 20, None, 73)) for b, c in some]
    wrong = [j.scenario for j in judged if (j.off & ~j.warned).any()]
    assert not wrong
    if method == "automatic":
        assert not any(j.off.any() for j in judged)


@pytest.mark.parametrize("method", ["form", "automatic"])
def test_probabilities_of_exceeding_a_limit(method):
    """Where FORM is right at all: the kinds of RCS without corners, and no limits."""
    for b, c in SET[::9]:
        if "range" in b["name"] or "horizon" in b["name"] or "spikeball" in b["name"]:
            continue
        s = reading.as_scenario(b, c)
        for i in range(0, len(c["p_d"]), 12):
            found = METHODS[method](s.states().at(np.array([i]))).exceedance(c["p_max"][i])[0]
            assert abs(found - c["exceedance"][i]) < 0.02


@pytest.mark.parametrize("number", [0, 1, 2, 3, 6, 38, 39])
def test_fifty_digits_have_the_exact_numbers_of_the_set(number):
    """A third program: P_D of one pulse, and the ten partials with North's detector."""
    block, c = SET[number]
    assert not block["attenuation_db_per_m"]
    (name,) = block["detector"].values()
    rcs, radar, p_fa = tuple(block["rcs"].values()), block["radar"], block["p_fa"]
    for i in (3, 11, 19):
        states = [float(c[name][i]) for name in reading.STATE]
        states = states, [*radar["position_m"], radar["constant"]], rcs
        p_d = getattr(oracle, name)(oracle.snr(*states), p_fa)
        expected = float(p_d if name == "north" else p_d[0])
        assert c["p_d"][i] == pytest.approx(expected, rel=3e-16)
        if name == "north":
            found = [c[slope][i] for slope in (*reading.OF_AIRCRAFT, *reading.OF_RADAR[:4])]
            slopes = [float(slope) for slope in oracle.partials(*states, p_fa)]
            assert_allclose(found, slopes, rtol=3e-16, atol=1e-23)


def test_the_set_is_not_at_odds_with_itself():
    """A share above an upper bound is at most that of the bound, by the standard errors of both."""
    for _, c in SET:
        for k in (1, 2, 3):
            above = c["p_max"] > c[f"upper_{k}"] + 4 * c[f"upper_{k}_se"]
            most = ndtr(-k) + 4 * c["exceedance_se"]
            assert np.all(c["exceedance"][above] <= most[above])


@pytest.mark.parametrize("number", [1, 3, 20, 22, 54, 55, 71, 72])
def test_plain_draws_have_the_numbers_of_the_set(number):
    """Without Sobol' points, and with c_r drawn; the detectors that have closed forms."""
    block, c = SET[number]
    case = draws.problem(block, np.array([c[name][1] for name in reading.STATE]))
    assert set(block["detector"]) == {"model"}
    drawn = truth.truth(case, 5, most=100_000)
    for name in ("mean", "std"):
        error = np.hypot(getattr(drawn, f"{name}_se"), c[f"{name}_se"][1])
        assert abs(getattr(drawn, name) - c[name][1]) <= 4.5 * error
    for end in ("lower", "upper"):
        low, high = getattr(drawn, f"{end}_between")
        assert low <= c[f"{end}_3"][1] <= high
