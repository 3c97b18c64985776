"""The second-order expansion of z: derivatives by the states, and invariants of a rotation of u."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel, Radar
from radar_sense.model.rcs import EllipsoidRCS
from radar_sense.propagation import gaussian_states, nonlinear, standard_space
from radar_sense.propagation.form import form, form_std, quantiles
from radar_sense.propagation.gaussian_states import UncertainStates, uncertain_states
from radar_sense.propagation.relative_probit import RelativeProbit
from radar_sense.propagation.second_order import (
    invariants,
    invariants_of_independent,
    trace_of_cube,
)
from radar_sense.propagation.standard_space import StandardNormalSpace

COV_AIRCRAFT = np.diag([30.0, 30.0, 30.0, 0.03, 0.0, 0.03]) ** 2  # the pitch is certain
POSES = 4


def network(rng, size, cov_radar, cov_aircraft=COV_AIRCRAFT):
    """Three radars at random places: z as a function of the relative states."""
    rcs = EllipsoidRCS(0.15, 0.13, 0.21)
    radars = [Radar(DetectionModel(rcs, 1e-4, attenuation=1e-5), name=n) for n in "abc"]
    states = np.zeros(size)
    states[:12] = np.column_stack([rng.normal(0, 2e5, (3, 3)), rng.uniform(30, 90, 3)]).ravel()
    aircraft = rng.uniform(-1, 1, (POSES, 6)) * [3e5, 3e5, 9e3, 0.5, 0.2, np.pi]
    _, uncertain = uncertain_states(
        NetworkModel(tuple(radars)),
        aircraft,
        states,
        cov_aircraft,
        cov_radar,
        log_constant=[False, True, False],
    )
    return RelativeProbit(uncertain)


def stds(size):
    """Standard deviations of the radar states, with errors of RCS and attenuations."""
    return np.append(np.tile([100.0, 100.0, 50.0, 5.0], 3), np.full(size - 12, 0.3))


def correlated(rng, std):
    mixed = rng.normal(size=(len(std), 2 * len(std)))
    return np.outer(std, std) * np.corrcoef(mixed)


def radar_of(size):
    """Which radar each component belongs to; 3 is the RCS."""
    return np.repeat(np.arange(3), 4).tolist() + [3, 0, 1, 2][: size - 12]


@pytest.mark.parametrize("sides", [1, 2])
@pytest.mark.parametrize("size", [12, 13, 16])  # without and with errors of RCS and attenuations
def test_derivatives_of_a_network_as_from_differences_of_its_z(size, sides):
    """Each radar is evaluated by itself, and its derivatives are fused.

    Differences of the fused z agree. The standard deviations are small, so that all steps are.
    """
    rng = np.random.default_rng(size)
    probit = network(rng, size, correlated(rng, 1e-3 * stds(size)), 1e-6 * COV_AIRCRAFT)
    found = probit.derivatives(sides=sides)
    step = 10.0 * np.broadcast_to(probit.std, found.gradient.shape)
    n = len(step)
    centre_value, centre = probit(np.zeros((n, 1, POSES)))
    assert_allclose(found.value, centre_value[0], rtol=1e-13)
    assert_allclose(found.gradient, centre[:, 0], rtol=1e-12)
    certain = step[:, 0] == 0
    assert certain.sum() == 1
    there, back = (np.eye(n)[:, :, np.newaxis] * (sign * step) for sign in (1.0, -1.0))
    differences = probit(there)[1] - probit(back)[1]
    differences = differences[:, ~certain] / (2.0 * step[~certain])
    units = step[:, np.newaxis] * step[~certain]
    second = found.matrix()
    assert np.all(second[:, certain] == 0)
    scale = np.abs(differences * units).max(axis=(0, 1))
    error = (second[:, ~certain] - differences) * units / scale
    assert np.abs(error).max() < 2e-4


@pytest.mark.parametrize("many", [False, True])  # covariances of all poses together, or of each
@pytest.mark.parametrize("independent", [False, True])
@pytest.mark.parametrize("size", [12, 13, 16])
def test_invariants_as_from_a_matrix_in_standard_normal_space(size, independent, many):
    rng = np.random.default_rng(size)
    cov = correlated(rng, stds(size))
    if independent:
        cov[np.not_equal.outer(radar_of(size), radar_of(size))] = 0.0
    if many:
        cov = rng.uniform(1, 2, (POSES, 1, 1)) * cov
    scale = rng.uniform(1, 2, (POSES, 1, 1)) if many else 1.0
    probit = network(rng, size, cov, scale * COV_AIRCRAFT)
    assert probit.states.has_independent_radars == independent
    root = probit.sqrt_cov
    std = np.sqrt(np.diagonal(probit.covariance, axis1=1, axis2=2))
    assert_allclose(std.T, probit.std, rtol=1e-14)
    unit = np.where(std > 0, std, 1.0)
    error = (probit.covariance - root @ root.swapaxes(1, 2)) / unit[:, :, None] / unit[:, None]
    assert np.abs(error).max() < 1e-14

    z = probit.derivatives()
    if independent:
        found, along = invariants_of_independent(
            z, probit.states.cov_aircraft, probit.states.cov_radar
        )
    else:
        found, along = invariants(z, probit.covariance)
    second = root.swapaxes(1, 2) @ np.moveaxis(z.matrix(), 2, 0) @ root
    for pose, (h, f) in enumerate(
        zip(second, np.broadcast_to(root, (POSES, *root.shape[1:])), strict=False)
    ):
        g = f.T @ z.gradient[:, pose]
        values = np.linalg.eigvalsh(h)
        expected = [z.value[pose], g @ g, g @ h @ g, *(np.sum(values**p) for p in (1, 2, 3))]
        size_of_h = np.abs(values).sum()
        tolerances = 1e-13 * np.array([1, 1, g @ g, 1, size_of_h, size_of_h**2]) * size_of_h
        error = np.abs(np.array([numbers[pose] for numbers in found]) - expected)
        assert np.all(error <= tolerances + 1e-13 * np.abs(expected))
        assert_allclose(along[:, pose], f @ g, rtol=1e-11, atol=1e-12 * np.abs(f @ g).max())


@pytest.mark.parametrize("size", [12, 13, 16])
def test_idle_components_are_left_out_of_form(size, monkeypatch):
    """Surveyed radars keep one component, and the quantiles of z stay where they were."""
    betas = np.array([-3.0, -1.0, 0.0, 2.0, 3.0])
    components = []
    for position_std in (1.0, 30.0, 100.0, 300.0, 1e3, 3e3):
        std = stds(size)
        std[:12].reshape(3, 4)[:, :3] = position_std
        std[13:] = 1e-3  # of ln α
        std[3] = 20.0  # bends z: ln c_r of the second radar is Gaussian, c_r of this one is
        cov = correlated(np.random.default_rng(size), std)
        cov[np.not_equal.outer(radar_of(size), radar_of(size))] = 0.0
        probit = network(np.random.default_rng(size), size, cov)
        z = probit.derivatives()
        some = StandardNormalSpace.expanded(probit, z)
        with monkeypatch.context() as patch:
            patch.setattr(UncertainStates, "has_independent_radars", False)
            all_ = StandardNormalSpace.expanded(probit, z)
        components.append(len(some.gradient))
        assert len(all_.gradient) == 5 + size  # the pitch is certain
        sigma = np.sqrt(np.sum(all_.gradient**2 + 0.5 * all_.curvature**2, axis=0))
        ours, every = (quantiles(space, betas, 3.0) for space in (some, all_))
        assert every.converged.all()
        assert np.abs(ours.corrected - every.corrected).max() < np.max(1.5e-4 * sigma)
        error = np.abs(ours.second_order - every.second_order) / sigma
        assert np.all(error < 0.5 * standard_space.IDLE**2 * 5.2**3)
    assert components[0] == 5 + 3 + (size > 12)
    assert components == sorted(components)
    assert components[-1] > components[0]


@pytest.mark.parametrize("component", range(4))
def test_radars_with_a_single_uncertain_component(component):
    std = np.zeros(12)
    std[component::4] = stds(12)[component::4]
    probit = network(np.random.default_rng(1), 12, np.diag(std**2))
    space = StandardNormalSpace.of(probit.states)
    assert len(space.gradient) == 5 + 3
    # with the certain components as rows and columns of zeros
    assert_allclose(
        space.sqrt_cov @ space.sqrt_cov.swapaxes(1, 2),
        np.broadcast_to(probit.covariance, (POSES, 15, 15)),
        rtol=1e-12,
        atol=1e-9,
    )


def test_sigma_by_form_of_independent_parts_of_correlated_errors(monkeypatch):
    """σ for other covariances uses the blocks of poses that the derivatives have.

    With independent errors alone, blocks would be longer.
    """
    rng = np.random.default_rng(2)
    cov = correlated(rng, stds(12))
    states = network(rng, 12, cov).states.at(np.arange(40) % POSES)
    monkeypatch.setattr(gaussian_states, "MAX_NUMBERS", 2000)
    assert not states.has_independent_radars
    std = form_std(states)
    alone = np.diag(np.diagonal(cov))
    assert states.with_covariances(COV_AIRCRAFT, alone).has_independent_radars
    found = std(COV_AIRCRAFT, alone)
    for pose in range(POSES):
        one = states.at(np.array([pose])).with_covariances(COV_AIRCRAFT, alone)
        # the derivatives are differences over a region of the same size
        expected = np.broadcast_to(form(one, 3.0).std, len(found[pose::POSES]))
        assert_allclose(found[pose::POSES], expected, rtol=2e-3)
    assert np.any(found > 0.01)


@pytest.mark.parametrize("method", ["linear", "probit", "form"])
@pytest.mark.parametrize("empty", ["aircraft", "radar", "both"])
def test_a_check_of_no_poses(method, empty):
    probit = network(np.random.default_rng(3), 12, np.diag(stds(12) ** 2))
    states = probit.states
    none = np.zeros((0, 6))
    cov_aircraft = np.zeros((0, 6, 6)) if empty != "radar" else COV_AIRCRAFT
    cov_radar = np.zeros((0, 12, 12)) if empty != "aircraft" else states.cov_radar[0]
    flags = nonlinear(states.model, none, states.radar[0], cov_aircraft, cov_radar, method=method)
    assert flags.shape == (0,)


@pytest.mark.parametrize("n", [3, 40])  # sums written out, and matrix products
def test_the_trace_of_the_cube_of_a_matrix(n):
    matrices = np.random.default_rng(n).normal(size=(n, n, 4))
    cubes = [np.linalg.matrix_power(matrices[..., i], 3) for i in range(4)]
    assert_allclose(trace_of_cube(matrices), np.trace(cubes, axis1=1, axis2=2), rtol=1e-9)
