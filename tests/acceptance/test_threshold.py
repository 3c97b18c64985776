"""The threshold test: margins, times above, and poses without an answer."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers import scenario

from radar_sense import analyses
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import PathTest


def threshold_test(upper, p_max, coordinate, violated=None, unknown=False):
    """A test whose verdict is that of the bound, unless it is given."""
    upper, coordinate = np.array(upper, dtype=float), np.array(coordinate, dtype=float)
    if violated is None:
        violated, unknown = upper > p_max, np.isnan(upper)
    unknown = np.logical_and(unknown, np.logical_not(violated))
    scenario = SimpleNamespace(geometry=SimpleNamespace(continuous=True, coordinate=coordinate))
    path, masks = SimpleNamespace(scenario=scenario), (np.array(violated), unknown, None, None)
    return PathTest(Requirement(p_max), path, None, upper, *masks)


def test_margin_and_poses():
    found = threshold_test([0.1, 0.3, 0.5, 0.7, 0.4], 0.5, [0, 1, 2, 4, 8])
    np.testing.assert_allclose(found.margin, [0.4, 0.2, 0, -0.2, 0.1], atol=1e-15)
    assert (found.first, found.passed) == (3, False)
    # from 2, where the limit is reached, to 4, and then 2/3 of the way to 8
    assert found.beyond == pytest.approx(2 + 4 * 2 / 3, rel=1e-14)
    equal = threshold_test([0.5, 0.5], 0.5, [0, 3])
    assert (equal.passed, equal.first, equal.beyond, equal.total) == (True, None, 0, 3)
    alone = threshold_test([0.9], 0.5, [7.0])
    assert (alone.beyond, alone.first) == (0, 0)


def test_time_above_is_that_of_the_broken_line():
    """Compare with linear interpolation at very many points."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        upper, coordinate = rng.uniform(0, 1.2, 12), np.cumsum(rng.uniform(0, 3, 12))
        p_max = rng.uniform(0.05, 1)
        found = threshold_test(upper, p_max, coordinate)
        dense = np.linspace(coordinate[0], coordinate[-1], 200_001)
        share = np.mean(np.interp(dense, coordinate, upper) > p_max)
        assert found.beyond == pytest.approx(share * found.total, abs=24 * found.total / 200_000)
        falling = threshold_test(upper, p_max, -coordinate)
        assert falling.beyond == pytest.approx(found.beyond, rel=1e-12, abs=1e-12)


def test_a_pose_without_a_bound_is_not_known():
    found = threshold_test([0.1, np.nan, 0.1, 0.1], 0.5, [0, 1, 3, 7])
    assert (found.verdict, found.passed) == ("not known", False)
    assert (found.first, found.beyond) == (None, 3)


def test_a_verdict_by_draws_is_kept_beside_the_bound():
    bound, unknown = [0.1, 0.1, 0.9, 0.9, 0.1], [False, True, True, False, False]
    found = threshold_test(bound, 0.5, range(5), [False] * 3 + [True, False], unknown)
    assert (found.verdict, found.first, found.passed) == ("violated", 3, False)
    without = threshold_test(bound, 0.5, range(5), [False] * 5, unknown)
    assert (without.verdict, without.first, without.passed) == ("not known", None, False)


def test_a_test_that_few_runs_decide_has_as_many_as_its_digits_need():
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 60, "step": 15})
    result = analyses.variance(s, threshold=0.5, probability=0.2)
    assert result.summary["threshold"]["runs"] == 4096
