"""The detection model: P_D, its gradient and its uncertainty.

References, in order of independence: `oracle` (fifty digits, the formulas as the corrected paper
has them), `chain_rule` (the paper's derivation of the gradient by λ and φ), SciPy's rotations,
and pinned numbers. `test_published` has the numbers of other tools.
"""

import math

import chain_rule
import numpy as np
import oracle
import pytest
from mpmath import mp, mpf
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.special import erfcinv
from studies.bands import package

from radar_sense.covariance import variance_along
from radar_sense.model.detection_model import DetectionModel, Linearization
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS, SpikeballRCS
from radar_sense.states import BLOCK

#: The largest relative error of one correctly rounded operation.
ROUNDING = 2.0**-53

KINDS = ("constant", "ellipsoid", "spikeball")

PAPER = DetectionModel(rcs=EllipsoidRCS(a=0.15, b=0.13, c=0.21), p_fa=1.7e-4)


def random_poses(rng, count):
    """Aircraft (count, 6) 100 m to 2000 km from radars (count, 4) that have no constant yet."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = np.exp(rng.uniform(np.log(100.0), np.log(2e6), (count, 1)))
    radar = np.zeros((count, 4))
    radar[:, :3] = rng.uniform(-1e6, 1e6, (count, 3))
    attitude = rng.uniform(-1, 1, (count, 3)) * [np.pi, np.pi / 2, np.pi]
    return np.hstack((radar[:, :3] + direction * distance, attitude)), radar


def random_rcs(rng, kind):
    """Return a model of a kind, and the tuple of the model for the oracles."""
    if kind == "constant":
        parameters = [10.0 ** rng.uniform(-3, 2)]
    elif kind == "ellipsoid":
        parameters = rng.uniform(0.05, 0.5, 3)
    else:
        parameters = int(rng.integers(1, 9)), *rng.uniform(0.05, 0.5, 2)
    return package.model_of((kind, *parameters)), (kind, *parameters)


def constant_for(snr, aircraft, radar, rcs):
    """Radar constants (...) that give this signal-to-noise ratio, by NumPy's linear algebra."""
    line = radar[:, :3] - aircraft[:, :3]
    x, y, z = Rotation.from_euler("ZYX", aircraft[:, :2:-1]).inv().apply(line).T
    sigma = chain_rule.cross_section(rcs, np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))
    return snr * chain_rule.BOLTZMANN * np.linalg.norm(line, axis=1) ** 4 / sigma


def inverse_north(p_d, p_fa):
    return (np.sqrt(-np.log(p_fa)) - erfcinv(2 * p_d)) ** 2 - 0.5


def random_case(rng, kind, count):
    """A model with P_fa from 1e-12 to 1e-2, its tuple, and poses with P_D between 0.05 and 0.95."""
    rcs, known_as = random_rcs(rng, kind)
    p_fa = 10.0 ** rng.uniform(-12, -2)
    aircraft, radar = random_poses(rng, count)
    snr = inverse_north(rng.uniform(0.051, 0.949, count), p_fa)
    radar[:, 3] = constant_for(snr, aircraft, radar, known_as)
    return DetectionModel(rcs, p_fa), known_as, aircraft, radar


def partials(lin):
    """All ten partials (..., 10), aircraft first."""
    return np.concatenate((lin.jac_aircraft, lin.jac_radar), axis=-1)


def block_errors(actual, expected):
    """Largest error (..., 4) of the partials by each of the aircraft's position and attitude, and
    the radar's position and constant, relative to the largest: each block has one unit.
    """
    error, scale = (
        np.maximum.reduceat(abs(x), [0, 3, 6, 9], axis=-1) for x in (actual - expected, expected)
    )
    # Where a block is zero throughout, only zero is right.
    return error / np.where(scale == 0, ROUNDING**4, scale)


def relative_error(actual, exact):
    """Relative error of a float, judged with fifty digits."""
    with mp.workdps(oracle.DIGITS):
        return float(abs(mpf(float(actual)) / exact - 1))


@pytest.mark.parametrize("kind", KINDS)
def test_values_agree_with_fifty_digits(kind):
    rng = np.random.default_rng(1)
    for _ in range(15):
        rcs, known_as = random_rcs(rng, kind)
        p_fa = 10.0 ** rng.uniform(-12, -2)
        aircraft, radar = random_poses(rng, 10)
        wanted = 10.0 ** rng.uniform(-3, 2, len(radar))
        radar[:, 3] = constant_for(wanted, aircraft, radar, known_as)
        model = DetectionModel(rcs, p_fa)
        body = body_vector(aircraft, radar)
        found = np.stack([
            rcs.cross_section(body),
            rcs.linearize(body)[0],
            model.snr(aircraft, radar),
            model.p_d(aircraft, radar),
            model.linearize(aircraft, radar).p_d,
        ])  # fmt: skip
        distances = slant_range(aircraft, radar)
        for a, r, distance, of_body, values in zip(
            aircraft, radar, distances, body, found.T, strict=True
        ):
            seen = oracle.body_vector(a, r)
            off = np.max(np.abs(of_body - np.array(seen, dtype=float)))
            assert off <= 1e-15 * np.linalg.norm(of_body)
            sigma, snr = oracle.cross_section(known_as, seen), oracle.snr(a, r, known_as)
            p_d = oracle.north(snr, p_fa)
            assert relative_error(distance, oracle.slant_range(a, r)) < 1e-15
            for value, exact in zip(values, (sigma, sigma, snr, p_d, p_d), strict=True):
                assert relative_error(value, exact) < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_partials_agree_with_eighty_digits(kind):
    rng = np.random.default_rng(3)
    for _ in range(8):
        model, known_as, aircraft, radar = random_case(rng, kind, 3)
        lin = model.linearize(aircraft, radar)
        # Else the claim would be empty: at P_D = 1 every partial is zero.
        assert np.all((lin.p_d > 0.05) & (lin.p_d < 0.95))
        exact = [
            oracle.partials(a, r, known_as, model.p_fa)
            for a, r in zip(aircraft, radar, strict=True)
        ]
        assert np.all(block_errors(partials(lin), np.array(exact, dtype=float)) < 1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_agrees_with_the_papers_chain_rule(kind):
    rng = np.random.default_rng(10)
    for _ in range(20):
        model, known_as, aircraft, radar = random_case(rng, kind, 1000)
        lin = model.linearize(aircraft, radar)
        p_d, jac_aircraft, jac_radar = chain_rule.linearize(aircraft, radar, known_as, model.p_fa)
        assert_allclose(lin.p_d, p_d, rtol=1e-12)
        expected = np.concatenate((jac_aircraft, jac_radar), axis=1)
        errors = block_errors(partials(lin), expected)
        # λ is ill-conditioned near the vertical, where u (R/h)² of the chain rule shows.
        assert np.all(errors < 1e-10)
        assert np.all(np.median(errors, axis=0) < 1e-14)


# Broadcasting: states of any shapes that fit, with results as if pose by pose.


def assert_pose_by_pose(model, aircraft, radar):
    """All results have the broadcast shape and are bit for bit those of each pose alone."""
    shape = np.broadcast_shapes(np.shape(aircraft)[:-1], np.shape(radar)[:-1])
    lin = model.linearize(aircraft, radar)
    p_d, snr = model.p_d(aircraft, radar), model.snr(aircraft, radar)
    assert np.shape(p_d) == np.shape(snr) == np.shape(lin.p_d) == shape
    assert lin.jac_aircraft.shape == (*shape, 6)
    assert lin.jac_radar.shape == (*shape, 4)
    aircraft = np.broadcast_to(aircraft, (*shape, 6))
    radar = np.broadcast_to(radar, (*shape, 4))
    for i in np.ndindex(shape):
        alone = model.linearize(aircraft[i], radar[i])
        assert p_d[i] == model.p_d(aircraft[i], radar[i])
        assert snr[i] == model.snr(aircraft[i], radar[i])
        assert lin.p_d[i] == alone.p_d
        assert_array_equal(lin.jac_aircraft[i], alone.jac_aircraft)
        assert_array_equal(lin.jac_radar[i], alone.jac_radar)


@pytest.mark.parametrize("kind", KINDS)
def test_a_pose_has_the_numbers_that_it_has_alone(monkeypatch, kind):
    """In arrays of any shape and blocks of any size, and beside a pose without a gradient."""
    model, _, aircraft, radar = random_case(np.random.default_rng(13), kind, 20)
    aircraft[1] = [*radar[0, :3] - [0, 0, 3e3], 0, 0, 1]
    for block in (BLOCK, 7, 1):
        for name in ("states", "model.detection_model"):
            monkeypatch.setattr(f"radar_sense.{name}.BLOCK", block)
        for of_aircraft, of_radar in (
            *(((), ()), ((20,), ()), ((), (9,)), ((7, 1), (5,)), ((1,), (3, 1)), ((0,), ())),
            ((20,), (20,)),
        ):
            count, radars = math.prod(of_aircraft), math.prod(of_radar)
            assert_pose_by_pose(
                model,
                aircraft[:count].reshape(*of_aircraft, 6),
                radar[:radars].reshape(*of_radar, 4),
            )


def test_layout_and_type_of_the_input_do_not_matter():
    whole = [300_000, 400_000, -3_000, 1, 0, 2], [10, -20, 0, 167]
    states = [np.array(state, dtype=float) for state in whole]
    expected = PAPER.linearize(*states)
    every_second = [np.repeat(state, 2)[::2] for state in states]
    for same in (whole, [np.array(state) for state in whole], every_second):
        lin = PAPER.linearize(*same)
        assert lin.p_d == expected.p_d
        assert_array_equal(partials(lin), partials(expected))


@pytest.mark.parametrize(
    ("aircraft", "radar", "says"),
    [
        (np.zeros(5), np.ones(4), "aircraft"),
        (0.0, np.ones(4), "aircraft"),
        (np.zeros(6), np.ones(3), "radar"),
        (np.zeros(6), [1, 1, 1, -1e-300], "negative"),
        (np.zeros(6), [[1, 1, 1, 1], [1, 1, 1, -1]], "negative"),
    ],
)
def test_states_that_do_not_fit_are_refused(aircraft, radar, says):
    for method in ("p_d", "snr", "linearize"):
        with pytest.raises(ValueError, match=says):
            getattr(PAPER, method)(aircraft, radar)


# Propagation: A C A', correlations and all.


def random_covariance(rng, n, rank):
    """A full covariance (n, n) of that rank, its components of very different size."""
    root = rng.normal(size=(n, rank)) * 10.0 ** rng.uniform(-2, 2, (n, 1))
    return root @ root.T


def exact_form(jacobian, covariance):
    """A C A' with fifty digits, and the sum of its terms' magnitudes."""
    with mp.workdps(oracle.DIGITS):
        terms = [
            mpf(float(a)) * mpf(float(covariance[i, j])) * mpf(float(b))
            for i, a in enumerate(jacobian)
            for j, b in enumerate(jacobian)
        ]
        return mp.fsum(terms), mp.fsum(terms, absolute=True)


@pytest.mark.parametrize("rank", [1, 2, 6])
def test_std_agrees_with_fifty_digits(rank):
    """36 + 16 products of three: two roundings each, up to 52 to add them, four for the rest."""
    rng = np.random.default_rng(17)
    for _ in range(50):
        jac_aircraft, jac_radar = rng.normal(size=6), rng.normal(size=4)
        cov_aircraft, cov_radar = random_covariance(rng, 6, rank), random_covariance(rng, 4, rank)
        std = Linearization(np.array(0.5), jac_aircraft, jac_radar).std(cov_aircraft, cov_radar)
        from_aircraft, size = exact_form(jac_aircraft, cov_aircraft)
        from_radar, more_size = exact_form(jac_radar, cov_radar)
        error = abs(mpf(float(std)) ** 2 - from_aircraft - from_radar)
        assert error <= 58 * ROUNDING * (size + more_size)


def test_std_of_a_covariance_for_every_pose():
    rng = np.random.default_rng(18)
    model, _, aircraft, radar = random_case(rng, "ellipsoid", 12)
    lin = model.linearize(aircraft.reshape(3, 4, 6), radar.reshape(3, 4, 4))
    cov_aircraft = np.array([[random_covariance(rng, 6, 6)] * 4 for _ in range(3)])
    cov_radar = np.array([random_covariance(rng, 4, 4) for _ in range(4)])
    std = lin.std(cov_aircraft, cov_radar)
    for i in np.ndindex(std.shape):
        alone = Linearization(lin.p_d[i], lin.jac_aircraft[i], lin.jac_radar[i])
        assert std[i] == pytest.approx(alone.std(cov_aircraft[i], cov_radar[i[1]]), rel=1e-13)
    assert lin.std(cov_aircraft[0, 0], cov_radar[0]).shape == std.shape == (3, 4)
    assert alone.std(cov_aircraft, cov_radar).shape == (3, 4)
    with pytest.raises(ValueError, match="covariance must have shape"):
        lin.std(np.ones(6), cov_radar)


def test_singular_covariance_is_never_nan():
    """The variance along a direction without uncertainty rounds to below 0 in half of all cases."""
    direction, jacobian = np.random.default_rng(19).normal(size=(2, 500, 6))
    along = np.sum(jacobian * direction, axis=1) / np.sum(direction**2, axis=1)
    jacobian -= direction * along[:, np.newaxis]
    covariance = direction[:, :, np.newaxis] * direction[:, np.newaxis]
    raw = [a @ c @ a for a, c in zip(jacobian, covariance, strict=True)]
    assert min(raw) < 0  # else this would test nothing
    variance = variance_along(jacobian, covariance)
    assert np.all((variance >= 0) & (variance < 1e-13))
    std = Linearization(np.full(500, 0.5), jacobian, np.zeros((500, 4))).std(covariance, np.eye(4))
    assert np.all(std >= 0)


@pytest.mark.parametrize("lobes", [1, 2, 4, 7])
def test_spikeball_has_the_slope_of_one_side_at_the_bottom_of_a_lobe(lobes):
    """A central difference gives zero there, and a deviation of zero would be wrong."""
    amplitude, floor = 0.18, 0.1
    model = DetectionModel(SpikeballRCS(lobes, amplitude, floor), p_fa=1e-4)
    radar = [0.0, 0.0, 0.0, 150.0]
    for bottom in np.arange(lobes) * 2 * np.pi / lobes:
        at_bottom = [-400e3, 0.0, 0.0, 0.0, 0.0, -bottom]  # λ = −ψ with the radar due north
        lin = model.linearize(at_bottom, radar)
        constant = DetectionModel(ConstantRCS(floor), p_fa=1e-4).linearize(at_bottom, radar)
        # σ is the floor, and ∂P_D/∂σ_r = ∂P_D/∂c_r c_r/σ_r there.
        assert lin.p_d == pytest.approx(constant.p_d, rel=1e-12)
        per_sigma = constant.jac_radar[3] * radar[3] / floor
        one_sided = per_sigma * amplitude * lobes / 2
        assert abs(lin.jac_aircraft[5]) == pytest.approx(one_sided, rel=1e-9)
        ahead, behind = (model.p_d([*at_bottom[:5], h - bottom], radar) for h in (1e-7, -1e-7))
        # The second derivative makes a one-sided difference wrong by about its step, 1e-7.
        assert (ahead - lin.p_d) / 1e-7 == pytest.approx(one_sided, rel=1e-5)
        assert (behind - lin.p_d) / 1e-7 == pytest.approx(one_sided, rel=1e-5)
    # At the nose it is the slope towards larger azimuth.
    sigma, gradient = SpikeballRCS(lobes, amplitude, floor).linearize(np.array([2.0, 0.0, 1.0]))
    assert sigma == floor
    assert_allclose(gradient, [0, amplitude * lobes / 2 / 2.0, 0], rtol=1e-15)


@pytest.mark.parametrize("height", [-3e3, 3e3])
@pytest.mark.parametrize(
    ("rcs", "sigma"),
    [
        (EllipsoidRCS(0.15, 0.13, 0.21), np.pi * (0.15 * 0.13 / 0.21) ** 2),  # λ = 0
        (EllipsoidRCS(0.2, 0.2, 0.2), np.pi * 0.2**2),
        (SpikeballRCS(4, 0.18, 0.1), 0.1),
    ],
)
def test_straight_above_and_below_the_value_exists_and_the_gradient_does_not(rcs, sigma, height):
    """Python warnings are errors in this suite, and there is none here."""
    model = DetectionModel(rcs, p_fa=1e-4)
    aircraft = [0.0, 0.0, height, 0.0, 0.0, 1.0]
    radar = [0.0, 0.0, 0.0, 1e-8 / sigma]  # S is 9
    constant = DetectionModel(ConstantRCS(sigma), p_fa=1e-4)
    lin = model.linearize(aircraft, radar)
    assert 0.4 < lin.p_d < 0.9
    assert lin.p_d == pytest.approx(constant.p_d(aircraft, radar), rel=1e-13)
    assert model.p_d(aircraft, radar) == pytest.approx(lin.p_d, rel=1e-13)
    assert np.all(np.isnan(lin.jac_aircraft))
    assert np.all(np.isnan(lin.jac_radar[:3]))
    assert np.isnan(lin.std(np.eye(6), np.eye(4)))
    lin_constant = constant.linearize(aircraft, radar)
    assert lin.jac_radar[3] == pytest.approx(lin_constant.jac_radar[3])
    assert_array_equal(lin_constant.jac_aircraft[[0, 1, 3, 4, 5]], 0)  # this has a gradient
    assert lin_constant.jac_aircraft[2] * np.sign(height) < 0  # nearer is seen better


def test_overwhelming_signal_is_certain_detection_with_no_slope():
    model, known_as, aircraft, radar = random_case(np.random.default_rng(20), "ellipsoid", 20)
    radar[:, 3] = constant_for(1e100, aircraft, radar, known_as)
    lin = model.linearize(aircraft, radar)
    assert_array_equal([lin.p_d, model.p_d(aircraft, radar)], 1.0)
    assert_array_equal(partials(lin), 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_radar_without_power_detects_noise(kind):
    """At S = 0 only the partial by c_r differs from 0."""
    model, known_as, aircraft, radar = random_case(np.random.default_rng(21), kind, 4)
    radar[:, 3] = 0.0
    lin = model.linearize(aircraft, radar)
    assert_allclose(lin.p_d, float(oracle.north(0, model.p_fa)), rtol=1e-13)
    assert_array_equal(model.p_d(aircraft, radar), lin.p_d)
    assert_array_equal(lin.jac_aircraft, 0.0)
    assert_array_equal(lin.jac_radar[:, :3], 0.0)
    for a, r, found in zip(aircraft, radar, lin.jac_radar[:, 3], strict=True):
        assert found > 0
        exact = oracle.partials(a, r, known_as, model.p_fa)[9]
        assert relative_error(found, exact) < 1e-12
