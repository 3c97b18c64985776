"""The small version of the study in `tests/studies/bands`: `make study` runs all of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr
from studies.bands import judging, model, package, paths, truth
from studies.bands.populations import POPULATIONS, problem

import radar_sense as rs
from radar_sense.acceptance import refinement

SEED = 11


@pytest.mark.parametrize("population", POPULATIONS)
def test_p_d_of_the_independent_model_is_that_of_the_package(population):
    """At drawn states, with the errors of the RCS and of the attenuation."""
    for number in range(10):
        case = problem(population, SEED, number)
        scenario, independent = package.scenario(case), model.Oracle(case)
        aircraft, radars, rcs_error, attenuation = independent.draw(np.random.default_rng(1), 50)
        states = []
        for i in range(len(case.radars)):
            of_alpha = 0.0 if attenuation is None else attenuation[i]
            errors = (np.broadcast_to(error, 50) for error in (rcs_error, of_alpha, 0.0))
            states += [*radars[4 * i : 4 * i + 4], *errors]
        found = scenario.model.p_d(aircraft.T, np.stack(states, axis=-1))
        expected = independent.p_d(aircraft, radars, rcs_error, attenuation)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10, err_msg=f"{number}")


@pytest.mark.parametrize("number", [1, 3, 7, 18])
def test_draws_have_the_distribution_of_the_draws_of_the_package(number):
    """Data sheets, correlations, RCS and attenuation: the mean of P_D and its square agree."""
    case = problem("general", SEED, number)
    runs = 20_000
    drawn = rs.monte_carlo(package.scenario(case), runs=runs, seed=3)
    exact = truth.truth(case, SEED, most=100_000)
    error = np.sqrt(exact.mean_se**2 + exact.std**2 / runs)
    assert abs(drawn.mean[0] - exact.mean) < 4.5 * error
    error = np.hypot(exact.std_se, exact.std_se * np.sqrt(exact.draws / runs))
    assert abs(drawn.std[0] - exact.std) < 4.5 * error


def test_standard_errors_of_quantiles_are_their_deviation():
    """Against 400 repetitions with normal numbers; half the distance of two order statistics."""
    rng = np.random.default_rng(5)
    found = [truth.ends(rng.standard_normal(20_000), ndtr(2.0)) for _ in range(400)]
    middle, error, between = (np.array(values) for values in zip(*found, strict=True))
    assert abs(middle.mean() - 2.0) < 4 * middle.std() / 20
    assert error.mean() == pytest.approx(middle.std(), rel=0.15)
    assert np.mean((between[:, 0] <= 2.0) & (between[:, 1] >= 2.0)) > 0.99


def test_a_band_is_judged_by_both_bounds_and_by_four_standard_errors():
    exact = truth.truth(problem("general", SEED, 3), SEED, most=50_000)
    right = package.Band(exact.lower, exact.upper, 0.0, 0.0, warned=False)
    assert not judging.judge(exact, right).off
    high = exact.upper_between[1]
    far = max(high, exact.upper + judging.OFF) + 1e-6
    assert judging.judge(exact, replace(right, upper=far)).off
    assert not judging.judge(exact, replace(right, upper=far, upper_se=1e-6)).off
    assert not judging.judge(exact, replace(right, upper=high)).off
    assert judging.judge(exact, replace(right, lower=np.nan)).off
    verdicts = [judging.Judged(0, off, warned) for off in (True, False) for warned in (True, False)]
    assert judging.counts(verdicts) == (4, 1, 1, 1)


@pytest.mark.parametrize("number", [26, 294, 704])
def test_a_limit_that_is_entered_and_left_between_two_rows_is_found(number):
    """The rows are on both sides of the greatest margin, and nothing else divides the step."""
    path = paths.grazing(2027, number)
    scenario = package.scenario(path.problem, aircraft=path.aircraft, time_s=path.time_s)
    poses = refinement.along(scenario, refinement.places(scenario))
    assert poses.model.p_d(poses.aircraft, poses.radar).max() > path.threshold
