"""NaN, infinity and matrices that are no covariances raise errors."""

import numpy as np
import pytest

import radar_sense as rs
from radar_sense.covariance import checked
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Radar

POSES = 20
NAN, INF = np.nan, np.inf


def states():
    """Poses and a radar that are well within reach."""
    aircraft = np.zeros((POSES, 6))
    aircraft[:, 0] = np.linspace(4e5, 7e5, POSES)
    return aircraft, np.array([0.0, 0, 0, 167])


def model():
    return rs.DetectionModel(rs.EllipsoidRCS(0.15, 0.13, 0.21), 1.7e-4)


def network():
    radars = tuple(Radar(model(), name=name) for name in ("one", "two"))
    return NetworkModel(radars)


CALLS = ("snr", "p_d", "linearize", "linearize_probit")


@pytest.mark.parametrize("call", CALLS)
def test_the_models_name_the_value_and_its_place(call):
    of_one, of_two = getattr(model(), call), getattr(network(), call)
    names = ("north", "east", "down", "roll", "pitch", "yaw")
    for component, (name, value) in enumerate(zip(names, (NAN, INF, -INF) * 2, strict=True)):
        aircraft, radar = states()
        aircraft[17, component] = value
        message = rf"^aircraft states must be finite, got {value:g} for {name} at pose 17 "
        with pytest.raises(ValueError, match=message):
            of_one(aircraft, radar)
        with pytest.raises(ValueError, match=message):
            of_two(aircraft, np.tile(radar, 2))
        with pytest.raises(ValueError, match=rf"got {value:g} for {name}$"):
            of_one(aircraft[17], radar)
    for component, name in enumerate(("north", "east", "down", "constant")):
        aircraft, radar = states()
        radar[component] = NAN
        message = f"^radar states must be finite, got nan for {name}"
        with pytest.raises(ValueError, match=message + "$"):
            of_one(aircraft, radar)
        with pytest.raises(ValueError, match=message + " of radar 2$"):
            of_two(aircraft, np.concatenate([states()[1], radar]))


@pytest.mark.parametrize("call", CALLS)
def test_a_range_whose_fourth_power_overflows_or_underflows(call):
    aircraft, radar = states()
    aircraft[3, 1] = -1e300
    with pytest.raises(ValueError, match=r"most 1e\+60 in size, got -1e\+300 for east at pose 3"):
        getattr(model(), call)(aircraft, radar)
    aircraft[3, :3] = [1e-90, 0, 0]
    result = getattr(model(), call)(aircraft, radar)
    p_d = result.p_d if call == "linearize" else result[0] if isinstance(result, tuple) else result
    assert np.isnan(p_d).tolist() == [pose == 3 for pose in range(POSES)]


class Cube:
    """An RCS from outside whose values are given by a function of the shape (...)."""

    isotropic = False
    detail = 1.0

    def __init__(self, values):
        self.values = values

    def cross_section(self, body_vector):
        return self.values(body_vector.shape[:-1])

    def linearize(self, body_vector):
        return self.cross_section(body_vector), np.zeros(body_vector.shape)


NO_RCS = {
    "must be finite and not negative, got nan at azimuth -135 and elevation 35.3 deg": (
        lambda shape: np.full(shape, NAN)
    ),
    "must be finite and not negative, got inf at azimuth 0 and elevation 90 deg": (
        lambda shape: np.where(np.arange(26).reshape(shape) == 12, INF, 1.0)
    ),
    "must be finite and not negative, got -1 at azimuth .*": lambda shape: np.full(shape, -1.0),
    r"must return shape \(2, 13\) .*, got \(3,\)": lambda shape: np.ones(3),
    "must be an array of real numbers, got complex128": lambda shape: np.full(shape, 1j),
}


@pytest.mark.parametrize("message", NO_RCS)
def test_an_rcs_from_outside_is_named_with_what_it_returns(message):
    assert rs.DetectionModel(Cube(np.ones), 1e-6).p_d(*states()).shape == (POSES,)
    with pytest.raises(rs.InputError, match=rf"^Cube\.cross_section {message}$"):
        rs.DetectionModel(Cube(NO_RCS[message]), 1e-6)


NOT_REAL = {
    "text": (["1", "2", "3", "4"], "radar states must be an array of real numbers, got <U1"),
    "complex": (np.array([0, 0, 0, 1j]), "real numbers, got complex128"),
    "booleans": ([True, True, True, True], "real numbers, got bool"),
    "dates": (np.array(["2026-01-01"] * 4, "M8[D]"), "real numbers, got datetime64"),
    "objects": ([None, 0, 0, 1], "real numbers, got object"),
    "ragged": ([[0], [0, 0]], "must be an array of numbers: "),
    "masked": (np.ma.masked_less([0.0, 0, 0, 167], 1), "must not be a masked array"),
}


@pytest.mark.parametrize("name", NOT_REAL)
def test_what_is_no_real_number_is_refused(name):
    wrong, message = NOT_REAL[name]
    aircraft, _ = states()
    for call in (model().p_d, network().linearize):
        with pytest.raises(ValueError, match=message):
            call(aircraft, wrong)
    with pytest.raises(ValueError, match=message):
        rs.propagate(model(), aircraft, wrong, np.eye(6), np.eye(4))
    with pytest.raises(ValueError, match=message.removeprefix("radar states ")):
        checked("radar", [wrong] * 4 if name != "masked" else wrong, 4)


def test_the_ellipsoid_gives_nan_for_nan():
    body = np.array([[NAN, 1, 1], [1, NAN, 1], [1, 1, NAN]])
    for rcs in (rs.EllipsoidRCS(0.15, 0.13, 0.21), rs.SpikeballRCS(4, 0.2, 0.1)):
        assert np.isnan(rcs.cross_section(body)[:2]).all()


def no_covariances(size):
    """Yield the problem and a matrix with it."""
    for message, (i, j), value in (
        (r"got nan for entry \[2\]\[2\]", (1, 1), NAN),
        ("got inf", (1, 1), INF),
        ("negative", (1, 1), -1),
        ("is not symmetric", (0, 1), 0.5),
        ("is not positive semidefinite", ([0, 1], [1, 0]), 2.0),
    ):
        wrong = np.eye(size)
        wrong[i, j] = value
        yield message, wrong


def test_a_matrix_that_is_no_covariance_is_an_error_of_every_computation():
    lin = model().linearize(*states())
    computations = (lambda *cov: rs.propagate(model(), *states(), *cov), lin.std)
    for message, wrong in no_covariances(6):
        many = np.tile(np.eye(6), (POSES, 1, 1))
        many[13] = wrong
        for cov, place in ((wrong, ""), (many, r" at pose 13 \(counted from 0\)")):
            for compute in computations:
                with pytest.raises(ValueError, match=f"^aircraft covariance{place} .*{message}"):
                    compute(cov, np.eye(4))
    for message, wrong in no_covariances(4):
        for compute in computations:
            with pytest.raises(ValueError, match=f"^radar covariance .*{message}"):
                compute(np.eye(6), wrong)
