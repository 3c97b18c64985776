"""The misprints of the paper: the error of each printed formula, and a check of the correction.

The numbers are for the paper's scenario unless a test states otherwise: "Medium" uncertainty, 500
km, θ_r = 45°, k = 1.38e-23. Each test has the printed formula. The tests of Monte Carlo cover the
perturbed states and the coverage of the band.
"""

import chain_rule
import numpy as np
import oracle
import pytest
from helpers import paper_aircraft
from scipy.spatial.transform import Rotation

from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS, SpikeballRCS

A, B, C = 0.15, 0.13, 0.21
P_FA = 1.7e-4
MODEL = DetectionModel(EllipsoidRCS(a=A, b=B, c=C), P_FA)

# The package uses k in SI. Only c_r/k matters, so scaling c_r and its deviation turns k into this.
PAPERS_K = 1.38e-23
RESCALED = chain_rule.BOLTZMANN / PAPERS_K
RADAR = np.array([0.0, 0.0, 0.0, 167.0 * RESCALED])

DEGREE = np.radians(1.0)
AIRCRAFT_STD = np.array([10.0] * 3 + [DEGREE] * 3)
RADAR_STD = np.array([100.0] * 3 + [5.0 * RESCALED])


def three_sigma(jac_aircraft, jac_radar, aircraft_variances, radar_variances):
    """3σ_pd for independent components: eq. (35) written out."""
    variance = jac_aircraft**2 @ aircraft_variances + jac_radar**2 @ radar_variances
    return 3 * np.sqrt(variance).item()


# eq. (12): the matrix called R_n^b is body to north-east-down.


def printed_matrix(roll, pitch, yaw):
    """The matrix of eq. (12), term by term."""
    cf, ct, cp = np.cos([roll, pitch, yaw])
    sf, st, sp = np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cp * ct, -cf * sp + cp * sf * st, sf * sp + cf * cp * st],
            [ct * sp, cf * cp + sf * sp * st, -cp * sf + cf * sp * st],
            [-st, ct * sf, cf * ct],
        ]
    )


def test_printed_rotation_gives_another_p_d():
    """It is 0.971 in place of 0.272 for roll, pitch, yaw = 10°, 20°, 30°. In level flight to the
    east, as in the paper, λ is off by 180°, and an ellipsoid is the same from behind.
    """
    for aircraft, p_d in ((turned_at_45(10, 20, 30), 0.272), (paper_aircraft(45.0), 0.5939)):
        printed = there(aircraft[np.newaxis], RADAR[np.newaxis], (A, B, C), P_FA)[0]
        assert MODEL.p_d(aircraft, RADAR) == pytest.approx(p_d, abs=0.0005)
        assert printed == pytest.approx(0.971 if p_d == 0.272 else p_d, abs=0.0005)
    assert printed == pytest.approx(MODEL.p_d(aircraft, RADAR), rel=1e-12)


def turned_at_45(*angles):
    return np.concatenate([paper_aircraft(45.0)[:3], np.radians(angles)])


# κ and D under eq. (22).


def printed_kappa(rcs, lam, phi):
    """eq. (21) with the + c² of the print; the rest as corrected."""
    a, b, c = rcs[1:]
    kappa = (a * np.cos(phi)) ** 2 + (b * np.sin(phi)) ** 2 + c**2
    d = chain_rule.ellipsoid_denominator(a, b, c, lam, phi)
    by_lam = -2 * np.pi * (a * b * c) ** 2 * np.sin(2 * lam) * kappa / d**3
    return by_lam, chain_rule.cross_section_partials(rcs, lam, phi)[1]


def printed_d(rcs, lam, phi):
    """eq. (21) and eq. (22) with the D of the print; κ as corrected."""
    a, b, c = rcs[1:]
    d = (a**2 + b**2) * (np.sin(lam) * np.sin(phi)) ** 2 + (c * np.cos(phi)) ** 2
    corrected = np.array(chain_rule.cross_section_partials(rcs, lam, phi))
    return tuple(corrected * (chain_rule.ellipsoid_denominator(a, b, c, lam, phi) / d) ** 3)


def slopes_by_difference(lam, phi):
    """∂σ_r/∂λ and ∂σ_r/∂φ of eq. (13) by central differences, good to some 1e-9."""

    def sigma(lam, phi):
        body = np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)
        return float(oracle.cross_section(("ellipsoid", A, B, C), body))

    h = 1e-6
    by_lam = (sigma(lam + h, phi) - sigma(lam - h, phi)) / (2 * h)
    by_phi = (sigma(lam, phi + h) - sigma(lam, phi - h)) / (2 * h)
    return by_lam, by_phi


@pytest.mark.parametrize(
    ("printed", "by_lam", "by_phi"), [(printed_kappa, -2.96, 1.00), (printed_d, 0.51, 0.51)]
)
def test_printed_rcs_slopes_are_not_those_of_the_rcs(printed, by_lam, by_phi):
    """The factors of the error at λ = 45° and φ = 20°. The corrected formulas are the slopes."""
    lam, phi = np.radians([45.0, 20.0])
    exact = np.array(slopes_by_difference(lam, phi))
    rcs = ("ellipsoid", A, B, C)
    corrected = chain_rule.cross_section_partials(rcs, lam, phi)
    np.testing.assert_allclose(corrected, exact, rtol=1e-7)
    assert printed(rcs, lam, phi) / exact == pytest.approx([by_lam, by_phi], abs=0.005)


@pytest.mark.parametrize(
    ("rcs_partials", "by_yaw", "orientation", "total"),
    [
        (chain_rule.cross_section_partials, 1.0508, 0.0550, 0.0912),
        (printed_kappa, -3.2400, 0.1696, 0.1846),
        (printed_d, 0.4524, 0.0237, 0.0765),
    ],
)
def test_printed_rcs_slopes_give_another_deviation(rcs_partials, by_yaw, orientation, total):
    """The printed κ gives the yaw partial a wrong sign, and the printed D a wrong size."""
    aircraft = paper_aircraft(45.0)
    _, jac_aircraft, jac_radar = chain_rule.linearize(
        aircraft[np.newaxis], RADAR[np.newaxis], ("ellipsoid", A, B, C), P_FA, rcs_partials
    )
    assert jac_aircraft[0, 5] == pytest.approx(by_yaw, abs=0.00005)
    angles_alone = np.where(np.arange(6) < 3, 0, AIRCRAFT_STD**2)
    found = three_sigma(jac_aircraft, jac_radar, angles_alone, np.zeros(4))
    assert found == pytest.approx(orientation, abs=0.00005)
    found = three_sigma(jac_aircraft, jac_radar, AIRCRAFT_STD**2, RADAR_STD**2)
    assert found == pytest.approx(total, abs=0.00005)
    # The package is with the corrected ones, and only with them.
    lin = MODEL.linearize(aircraft, RADAR)
    package = 3 * lin.std(np.diag(AIRCRAFT_STD**2), np.diag(RADAR_STD**2))
    off = abs(package / found - 1)
    assert off < 1e-12 if rcs_partials is chain_rule.cross_section_partials else off > 0.1


# C_xx and C_rr: standard deviations where variances belong.


def test_covariances_printed_with_standard_deviations():
    """The text has "nearly 0.1": 0.0912 with σ² on the diagonal, 0.418 with the printed σ. The 1
    of Table I, read in radians, gives 3.15 for a probability.
    """
    lin = MODEL.linearize(paper_aircraft(45.0), RADAR)
    radians = np.where(np.arange(6) < 3, AIRCRAFT_STD, 1.0)
    for aircraft, radar, three in (
        (AIRCRAFT_STD**2, RADAR_STD**2, "0.0912"),
        (AIRCRAFT_STD, RADAR_STD, "0.418"),
        (radians**2, RADAR_STD**2, "3.15"),
    ):
        assert f"{3 * lin.std(np.diag(aircraft), np.diag(radar)):.3g}" == three


# p_a^n: θ_r is measured from east, and R is horizontal.


def test_printed_azimuth_is_measured_from_east():
    """At θ_r = 0 the aircraft is due east of the radar; the paper's figure shows due north."""
    np.testing.assert_allclose(paper_aircraft(0.0)[:3], [0, 500e3, -3e3], atol=1e-9)
    np.testing.assert_allclose(paper_aircraft(0.0, "north")[:3], [500e3, 0, -3e3], atol=1e-9)
    assert MODEL.p_d(paper_aircraft(0.0), RADAR) == pytest.approx(0.2186, abs=0.00005)
    assert MODEL.p_d(paper_aircraft(0.0, "north"), RADAR) == pytest.approx(0.9881, abs=0.00005)


def test_range_is_the_horizontal_radius():
    """The slant range is 500.009 km. A range of 500 km would raise the signal by 7.2e-5."""
    aircraft = paper_aircraft(45.0)
    assert np.hypot(*aircraft[:2]) == pytest.approx(500e3, rel=1e-15)
    assert slant_range(aircraft, RADAR) == pytest.approx(500.009e3, abs=0.5)
    sigma = MODEL.rcs.cross_section(body_vector(aircraft, RADAR))
    at_radius = RADAR[3] * sigma / (chain_rule.BOLTZMANN * 500e3**4)
    assert at_radius / MODEL.snr(aircraft, RADAR) - 1 == pytest.approx(7.2e-5, abs=5e-7)


# The axes of a, b and c.

# Each as the formula's (along the wing, down, along the nose).
AXES = {"formula": (A, B, C), "text": (C, B, A), "table": (B, C, A)}


def test_axes_of_the_formula():
    """The RCS of an ellipsoid along an axis is π times both other axes squared over this axis
    squared.

    The formula agrees ahead and abeam (tested slightly off each axis). Below, the formula depends
    on λ: at 45° it mixes the c² of the nose into the b².
    """
    nose, wing, bottom = (MODEL.rcs.cross_section(np.array(v)) for v in np.eye(3) + 1e-12)
    assert nose == pytest.approx(np.pi * (A * B / C) ** 2, rel=1e-9)
    assert wing == pytest.approx(np.pi * (B * C / A) ** 2, rel=1e-9)
    assert nose == pytest.approx(0.0271, abs=0.00005)  # with a forward it would be 0.1041
    assert wing == pytest.approx(0.1041, abs=0.00005)
    assert bottom == pytest.approx(np.pi * (2 * A * B * C / (B**2 + C**2)) ** 2, rel=1e-9)


@pytest.mark.parametrize(
    ("whose", "p_d_at_0", "p_d_at_45", "three_sigma_at_45"),
    [
        ("formula", 0.2186, 0.59392, 0.0912),
        ("text", 0.9881, 0.59394, 0.0912),
        ("table", 0.9881, 0.99919, 0.0009),
    ],
)
def test_axes_of_text_and_table_are_not_those_of_the_formula(
    whose, p_d_at_0, p_d_at_45, three_sigma_at_45
):
    """Only the axes of the formula give the paper's P_D from behind and at 45°."""
    model = DetectionModel(EllipsoidRCS(*AXES[whose]), P_FA)
    assert model.p_d(paper_aircraft(0.0), RADAR) == pytest.approx(p_d_at_0, abs=0.00005)
    lin = model.linearize(paper_aircraft(45.0), RADAR)
    assert lin.p_d == pytest.approx(p_d_at_45, abs=0.000005)
    found = 3 * lin.std(np.diag(AIRCRAFT_STD**2), np.diag(RADAR_STD**2))
    assert found == pytest.approx(three_sigma_at_45, abs=0.00005)


# k: three digits where the SI has seven.


def test_boltzmanns_constant():
    """SI lowers the signal by 0.05 % and P_D at 45° from 0.5939 to 0.5935."""
    aircraft, si = paper_aircraft(45.0), np.array([0.0, 0.0, 0.0, 167.0])
    assert MODEL.p_d(aircraft, RADAR) == pytest.approx(0.5939, abs=0.00005)
    assert MODEL.p_d(aircraft, si) == pytest.approx(0.5935, abs=0.00005)
    one = DetectionModel(ConstantRCS(1.0), P_FA).snr(np.zeros(6), [1e6, 0, 0, 1.0])
    assert one * 1e24 * 1.380649e-23 == pytest.approx(1, rel=1e-15)
    assert one * 1e24 * PAPERS_K - 1 == pytest.approx(-0.00047, abs=0.000005)


# eq. (8): the arctangent of all four quadrants.


def test_arctangent_of_a_quotient_cannot_tell_nose_from_tail():
    """The ellipsoid hides the error. A spikeball of 3 lobes has a null ahead and a peak behind."""
    amplitude, floor = 0.18, 0.1
    rcs = SpikeballRCS(3, amplitude, floor)
    behind = np.array([-1.0, 1e-9, 0.0])
    printed = abs(amplitude * np.sin(3 / 2 * np.arctan(behind[1] / behind[0]))) + floor
    assert printed == pytest.approx(0.10, abs=1e-8)
    assert rcs.cross_section(behind) == pytest.approx(0.28, abs=1e-8)
    x, y, z = np.random.default_rng(1).normal(size=(3, 100))
    angles = np.arctan(y / x), np.arctan(z / np.hypot(x, y))
    ellipsoid = chain_rule.cross_section(("ellipsoid", A, B, C), *angles)
    found = MODEL.rcs.cross_section(np.stack((x, y, z), axis=-1))
    np.testing.assert_allclose(found, ellipsoid, rtol=1e-12)


# The authors' published code, advanced_path_planning, has the printed matrix. docs/paper.md says
# what its compiled functions give; here its formulas are written down.


def there(aircraft, radar, shape, p_fa):
    """P_D (n,) with the printed matrix, of aircraft (n, 6) and radars (n, 4)."""
    matrices = np.array([printed_matrix(*angles) for angles in aircraft[:, 3:]])
    return chain_rule.p_d(aircraft, radar, ("ellipsoid", *shape), p_fa, matrices)


def random_poses(count, steepest):
    """Aircraft (n, 6) at 500 km, up to this roll [rad] and half this pitch, and radars (n, 4)."""
    rng = np.random.default_rng(1)
    angle, yaw = rng.uniform(-np.pi, np.pi, (2, count))
    aircraft = np.zeros((count, 6))
    aircraft[:, 0], aircraft[:, 1], aircraft[:, 2] = 5e5 * np.cos(angle), 5e5 * np.sin(angle), -3e3
    aircraft[:, 3:5] = rng.uniform(-1, 1, (count, 2)) * [steepest, steepest / 2]
    aircraft[:, 5] = yaw
    radar = np.zeros((count, 4))
    radar[:, 3] = 10 ** rng.uniform(1, 3, count)
    return aircraft, radar


def test_with_angles_transposed_the_published_code_agrees():
    aircraft, radar = random_poses(2000, np.radians(60))
    turned = aircraft.copy()
    rotations = Rotation.from_euler("ZYX", aircraft[:, :2:-1])
    turned[:, 3:] = rotations.inv().as_euler("ZYX")[:, ::-1]
    found = there(turned, radar, (A, B, C), P_FA)
    np.testing.assert_allclose(found, MODEL.p_d(aircraft, radar), rtol=0, atol=2e-14)


def test_with_the_same_angles_the_published_code_differs():
    """By up to 0.81 in level flight and 0.89 with rolls of 60°; not on courses along the axes."""
    for steepest, largest in ((0.0, 0.81), (np.radians(60), 0.89)):
        aircraft, radar = random_poses(20_000, steepest)
        apart = abs(there(aircraft, radar, (A, B, C), P_FA) - MODEL.p_d(aircraft, radar))
        assert apart.max() == pytest.approx(largest, abs=0.015)
    aircraft, radar = random_poses(500, 0.0)
    aircraft[:, 5] = np.pi / 2 * np.arange(500)
    found = there(aircraft, radar, (A, B, C), P_FA)
    np.testing.assert_allclose(found, MODEL.p_d(aircraft, radar), rtol=0, atol=1e-12)


def test_a_radar_of_the_demos_nose_on_at_course_45():
    """P_D is 0.280 and there 0.775, 200 km north and 200 km east of the aircraft."""
    shape, p_fa = (0.18, 0.17, 0.20), 1e-9
    model = DetectionModel(EllipsoidRCS(*shape), p_fa)
    aircraft, radar = np.zeros((1, 6)), np.array([[200e3, 200e3, 0, 20.0]])
    aircraft[0, 5] = np.pi / 4
    assert model.p_d(aircraft, radar)[0] == pytest.approx(0.2803, abs=5e-5)
    assert there(aircraft, radar, shape, p_fa)[0] == pytest.approx(0.7749, abs=5e-5)
    # The demos pass √σ where a covariance belongs: σ of the position is 33 m, of c_r 1/3.
    std = np.array([100 / 3] * 3 + [1 / 3])
    lin = model.linearize(aircraft[0], radar[0])
    certain = np.zeros((6, 6))
    assert 3 * lin.std(certain, np.diag(std**2)) == pytest.approx(0.0479, abs=5e-5)
    assert 3 * lin.std(certain, np.diag(np.sqrt(std))) == pytest.approx(0.1091, abs=5e-5)
