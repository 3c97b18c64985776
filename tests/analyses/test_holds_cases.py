"""Cases in which version 0.1 said "holds" where it does not, or gave a wrong bound.

The truth is by two million plain draws of an independent program, with its standard error:
`python -m bands.cases` of `tests/studies` prints it. Each bound is at 3 sigma, and each probability
is P(P_D > P_max) at one row.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from helpers import few_judging_draws

import radar_sense as rs

pytestmark = pytest.mark.usefixtures("fewer_draws")

CASES = Path(__file__).parents[1] / "studies" / "cases"
#: A bound may be off by this, or by four standard errors of the truth.
BOUND = 0.01
#: A probability may be off by this part of itself, or by four standard errors of both numbers.
PROBABILITY = 0.05


@pytest.fixture
def fewer_draws(monkeypatch):
    """Draw at most 2¹⁴ times at a pose in place of 2²⁰: enough for these tolerances."""
    few_judging_draws(monkeypatch, 2**14)


class Row(NamedTuple):
    """The truth at one row: upper bound and P(P_D > P_max), each with its standard error."""

    row: int
    upper: float
    upper_se: float
    above: float
    above_se: float


class Anywhere(NamedTuple):
    """P(P_D > P_max) at the rows, and on a path at every two seconds, with its standard error."""

    at_rows: float
    along: float
    error: float


class Case(NamedTuple):
    """A threshold that is violated, and the truth at some rows and anywhere."""

    name: str
    threshold: float
    rows: tuple[Row, ...]
    anywhere: Anywhere | None = None


VIOLATED = (
    Case("adv5_83", 0.2, (Row(0, 0.9977, 0.0001, 0.05744, 0.00016),)),
    Case("rate_8", 0.3, (Row(0, 0.9974, 0.0001, 0.03131, 0.00012),)),
    Case("rate_149", 0.6, (Row(0, 1.0000, 0.0001, 0.03544, 0.00013),)),
    Case("rate_140", 0.2, (Row(0, 0.9717, 0.0011, 0.02553, 0.00011),)),
    Case("rate_1", 0.05, (Row(0, 0.2338, 0.0084, 0.00274, 0.00004),)),
    Case("adv_sam_any2", 0.1473, (Row(3, 0.8141, 0.0033, 0.02087, 0.00010),),
         Anywhere(0.0380, 0.0467, 0.0009)),
    Case("adv_shorad", 0.1,
         (Row(0, 1.0000, 0.0001, 0.20738, 0.00029), Row(9, 1.0000, 0.0001, 0.20788, 0.00029)),
         Anywhere(0.4274, 1.0, 0.0020)),
    Case("adv_shorad_net", 0.1, (Row(5, 1.0000, 0.0001, 0.07412, 0.00019),),
         Anywhere(0.0871, 0.1087, 0.0013)),
    Case("bug", 0.1, (Row(2, 0.8506, 0.0002, 0.00233, 0.00003),)),
    Case("f2_above", 0.1, (Row(0, 0.9254, 0.0003, 0.65506, 0.00034),),
         Anywhere(0.7101, 1.0, 0.0019)),
)  # fmt: skip


@pytest.mark.parametrize("case", VIOLATED, ids=lambda case: case.name)
def test_a_violated_threshold_is_violated_with_the_true_bound(case):
    s = rs.load_scenario(CASES / f"{case.name}.yaml")
    result = rs.analyses.variance(s, threshold=case.threshold)
    assert result.summary["threshold"]["verdict"] == "violated"
    assert result.passed is False
    for truth in case.rows:
        upper = result.table["upper_3sigma"][truth.row]
        own = result.table.get("error_3sigma", np.zeros_like(result.table["p_d"]))[truth.row]
        error = np.hypot(truth.upper_se, own)
        assert upper == pytest.approx(truth.upper, abs=max(BOUND, 4 * error))
        above = result.table["probability_above"][truth.row]
        runs = result.summary["threshold"]["runs"]
        error = np.hypot(truth.above_se, np.sqrt(truth.above * (1 - truth.above) / runs))
        tolerance = max(PROBABILITY * truth.above, 4 * error)
        assert above == pytest.approx(truth.above, abs=tolerance)
    if case.anywhere is not None:
        check_anywhere(result, case.anywhere)


def check_anywhere(result, truth):
    """Insist on a probability between the truth at the rows and the truth every two seconds.

    On an orbit the probability depends on the azimuth step, and need not be given.
    """
    summary, each = result.summary["threshold"], result.table["probability_above"]
    anywhere = summary.get("probability_above_at_any_pose")
    if result.scenario.time_s is None and anywhere is None:
        return
    found, margin = anywhere["value"], 4 * np.hypot(truth.error, anywhere["standard_error"])
    assert summary["highest_probability_above"]["value"] <= found <= 1
    if not summary["poses_between_rows"]:
        assert found <= each.sum()
    assert truth.at_rows - margin <= found <= truth.along + margin


@pytest.mark.parametrize(
    ("name", "threshold", "ends"),
    [("adv_graze_ell", 0.3, None), ("lobe_0.15_98.37", 0.2, (100.0, 128.0))],
)
def test_p_d_above_the_threshold_between_the_rows_is_found(name, threshold, ends):
    """P_D is 1 from 501.5 to 529.8 s, and from 114.36 to 115.07 s; the rows are at the ends."""
    s = rs.load_scenario(CASES / f"{name}.yaml")
    s = s.along(s.geometry.at(np.array(ends))) if ends else s
    result = rs.analyses.variance(s, threshold=threshold)
    assert result.summary["threshold"]["verdict"] == "violated"
    assert result.summary["threshold"]["p_d_itself_above"]
    assert not (result.table["p_d"] > threshold).any()


def test_heights_of_both_ends_of_a_horizon():
    """The mean is 0.8309, and the lower bound 0; `form` named alone says that it is off."""
    scenario = rs.load_scenario(CASES / "low1.yaml")
    result = rs.analyses.variance(scenario)
    assert result.table["lower_3sigma"] == pytest.approx(np.zeros(11), abs=BOUND)
    assert result.table["mean_pd"] == pytest.approx(np.full(11, 0.8309), abs=BOUND)
    assert result.table["sigma_pd"] == pytest.approx(np.full(11, 0.3394), abs=BOUND)
    assert rs.analyses.variance(scenario, method="form").warnings
