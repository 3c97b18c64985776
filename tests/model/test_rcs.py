"""The exact ellipsoid, and the error of the paper's formula."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from helpers import scenario
from mpmath import mp, mpf

import radar_sense as rs
from radar_sense.analyses.rcs import directions
from radar_sense.model.rcs import RCS_MODELS

#: Table I: the paper's a acts along the wing, b down, c along the nose.
A, B, C = 0.15, 0.13, 0.21
PAPER = rs.EllipsoidRCS(a=A, b=B, c=C)
EXACT = rs.ExactEllipsoidRCS(x=C, y=A, z=B)


def by_support(semi_axes, body):
    """σ_r = π (s_x s_y s_z)²/(n'S²n)², with fifty digits and its gradient by differences."""
    with mp.workdps(80):
        s = [mpf(axis) for axis in semi_axes]

        def sigma(point):
            r = mp.sqrt(sum(c**2 for c in point))
            support = sum((axis * c / r) ** 2 for axis, c in zip(s, point, strict=True))
            return mp.pi * (s[0] * s[1] * s[2]) ** 2 / support**2

        point = [mpf(c) for c in body]
        step = mp.sqrt(sum(c**2 for c in point)) * mpf("1e-25")
        slopes = []
        for i in range(3):
            ends = [
                sigma([c + sign * step * (i == j) for j, c in enumerate(point)]) for sign in (1, -1)
            ]
            slopes.append((ends[0] - ends[1]) / (2 * step))
        return float(sigma(point)), [float(slope) for slope in slopes]


def test_against_fifty_digits():
    rng = np.random.default_rng(1)
    for _ in range(200):
        axes = 10.0 ** rng.uniform(-2, 2, 3)
        body = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 6, 3)
        sigma, gradient = rs.ExactEllipsoidRCS(*axes).linearize(body)
        exact, slopes = by_support(axes, body)
        assert sigma == pytest.approx(exact, rel=1e-13)
        assert rs.ExactEllipsoidRCS(*axes).cross_section(body) == sigma
        # Each component is a sum of two terms that may cancel: exact beside the larger of them.
        aa, bb, cc = axes**2
        x, y, z = body
        w = aa * x * x + bb * y * y + cc * z * z
        terms = np.array(
            [
                abs(x) * max(abs(bb - aa) * y * y, abs(cc - aa) * z * z),
                abs(y) * max(abs(aa - bb) * x * x, abs(cc - bb) * z * z),
                abs(z) * max(abs(aa - cc) * x * x, abs(bb - cc) * y * y),
            ]
        )
        scale = 4 * exact / (w * (body @ body)) * terms
        assert np.all(abs(gradient - slopes) <= 1e-12 * scale + 1e-300)


def test_along_an_axis_the_rcs_follows_the_curvature():
    """At the end of a semi-axis s the principal radii are the squares of the others over s."""
    axes = np.array([C, A, B])
    for axis, end in enumerate(np.eye(3)):
        expected = np.pi * (np.prod(np.delete(axes, axis)) / axes[axis]) ** 2
        sigma, gradient = EXACT.linearize(np.stack([end, -end]))
        np.testing.assert_allclose(sigma, expected, rtol=1e-14)
        assert np.all(gradient == 0)


def test_the_papers_ellipsoid_is_exact_at_elevation_zero_and_abeam():
    azimuth = np.linspace(-180, 180, 73)
    for directed in (
        directions(azimuth, np.zeros(73)),
        directions(np.full(73, 90.0), 0.499 * azimuth),
    ):
        np.testing.assert_allclose(
            EXACT.cross_section(directed), PAPER.cross_section(directed), rtol=1e-14
        )


@pytest.mark.parametrize(
    ("azimuth", "decibels", "elevation"),
    [(0, 0.1, 7.83), (0, 1.0, 24.83), (0, 3.0, 43.48), (45, 0.1, 9.63), (45, 1.0, 30.69)],
)
def test_where_the_papers_ellipsoid_is_off(azimuth, decibels, elevation):
    """The elevations that the documentation names, rounded to 0.01 deg."""
    for sign in (1, -1):
        around = sign * (elevation + np.array([-0.01, 0.01]))
        directed = directions(np.array(float(azimuth)), around)
        ratio = 10 * np.log10(EXACT.cross_section(directed) / PAPER.cross_section(directed))
        assert ratio[0] < decibels < ratio[1]


def test_the_papers_ellipsoid_jumps_straight_below_and_the_exact_one_does_not():
    nearly = np.array([[1e-9, 0, 1], [0, 1e-9, 1]])
    off = 10 * np.log10(PAPER.cross_section(nearly))
    assert off[1] - off[0] == pytest.approx(40 * np.log10(C / B), abs=1e-9)  # 8.33 dB
    np.testing.assert_allclose(EXACT.cross_section(nearly), np.pi * (C * A / B) ** 2, rtol=1e-14)


def test_p_d_by_the_papers_ellipsoid_is_off_in_a_bank():
    """P_D is off by less than 3e-5 in level flight, and by 0.1 at a bank of 30 deg."""
    exact = {"model": "ellipsoid_exact", "x_m": C, "y_m": A, "z_m": B}
    worst = {}
    for roll in (0, 10, 30):
        flown = {
            "aircraft__attitude_deg": [roll, 0, 90],
            "geometry__azimuth_deg": {"start": 0, "stop": 360, "step": 0.5},
        }
        one, other = scenario(**flown), scenario(**flown, aircraft__rcs=exact)
        found = [s.model.p_d(s.aircraft, s.radar) for s in (one, other)]
        worst[roll] = np.max(abs(found[1] - found[0]))
    assert worst[0] < 3e-5
    assert worst[10] == pytest.approx(0.0113, abs=5e-5)
    assert worst[30] == pytest.approx(0.100, abs=5e-4)


def test_the_largest_value_of_a_flat_ellipsoid_is_beside_the_pole():
    """The paper's ellipsoid jumps straight above, from its limit π (abc)²/b⁴ to π (abc)²/c⁴."""
    a, b, c = 0.465, 0.119, 0.148
    changes = {"aircraft.rcs": f"{{model: ellipsoid, a_m: {a}, b_m: {b}, c_m: {c}}}"}
    found = rs.analyses.rcs(rs.load_scenario(None, changes)).summary["largest"]
    assert found["rcs_m2"] == pytest.approx(np.pi * (a * b * c) ** 2 / b**4, rel=1e-3)
    assert abs(found["elevation_deg"]) == pytest.approx(89.9)


@dataclass(frozen=True)
class Cardioid:
    """σ = 1.1 + the cosine of the angle from the nose, with a factor on the gradient."""

    factor: float
    isotropic: ClassVar[bool] = False
    detail: float = np.pi

    def cross_section(self, body_vector):
        return 1.1 + body_vector[..., 0] / np.linalg.norm(body_vector, axis=-1)

    def linearize(self, body_vector):
        distance = np.linalg.norm(body_vector, axis=-1, keepdims=True)
        unit = body_vector / distance
        gradient = (np.eye(3)[0] - unit[..., :1] * unit) / distance
        return self.cross_section(body_vector), self.factor * gradient


def own(name, **members):
    """Return a `Cardioid` of which some members are others."""
    return type(name, (Cardioid,), members)(1.0)


def number(detail):
    return f"Cardioid.detail must be a number greater than 0, got {detail}"


GRADIENT = "the gradient of Cardioid.linearize is not that of"
#: Cross sections of one's own, and what is wrong with them.
REFUSED = [
    (own("Halved", linearize=lambda rcs, body: (rcs.cross_section(body) / 2, 0.0 * body)),
     "Halved.linearize must return the σ_r of cross_section"),
    (own("Unscaled", cross_section=lambda rcs, body: 1e6 + body[..., 0]),
     "σ_r of Unscaled must not depend on the distance"),
    (own("Round", isotropic=True),
     "σ_r of Round, which is isotropic, must be the same at all aspects"),
    (own("Bare", linearize=Cardioid.cross_section),
     "Bare.linearize must return a pair, a value and a slope, got array"),
    *((Cardioid(1.0, detail), number(repr(detail))) for detail in (0, -1.0, np.nan, "x", None)),
    *((Cardioid(factor), GRADIENT) for factor in (0.0, 0.5, -1.0, 1.05)),
]  # fmt: skip


@pytest.mark.parametrize(("rcs", "says"), REFUSED)
def test_a_cross_section_of_ones_own_is_one_function_of_the_aspect(rcs, says, monkeypatch):
    """Also one that is registered."""
    for detail in (np.pi, np.inf):
        rs.DetectionModel(rcs=Cardioid(1.0, detail), p_fa=1e-4)
    for _ in range(2):
        with pytest.raises(rs.InputError, match=rf"^{says}"):
            rs.DetectionModel(rcs=rcs, p_fa=1e-4)
        monkeypatch.setitem(RCS_MODELS, "own", type(rcs))


@pytest.mark.parametrize("name", ["isotropic", "detail", "cross_section", "linearize"])
def test_what_a_cross_section_of_ones_own_lacks_is_named(name):
    members = {"isotropic": False, "detail": 1.0, "cross_section": len, "linearize": len}
    del members[name]
    with pytest.raises(rs.InputError, match=f"^rcs has no {name}, .*got .*Plate"):
        rs.DetectionModel(rcs=type("Plate", (), members)(), p_fa=1e-4)
