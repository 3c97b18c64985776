"""The detectors: P_D, its slope and its probit, in both tails, against mpmath and print."""

import numpy as np
import oracle
import pytest
from mpmath import mp, mpf
from numpy.testing import assert_allclose
from scipy.special import ndtr, ndtri
from scipy.stats import norm

from radar_sense.errors import InputError
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import Marcum, North, Swerling1, Swerling3, linearize
from radar_sense.model.rcs import ConstantRCS

ORACLES = {
    North: oracle.north_tails,
    Marcum: oracle.marcum,
    Swerling1: oracle.swerling1,
    Swerling3: oracle.swerling3,
}
#: The relative error of P_D that is allowed: what rounding of its argument is worth to North.
EXACT = {Marcum: "1e-13", Swerling1: "1e-13", Swerling3: "1e-13", North: "1e-12"}


def random_cases(rng, count):
    """P_fa from 1e-17 to 0.9 with S from 0 to 1e6, much of it about the threshold."""
    cases = []
    for i in range(count):
        p_fa = 10.0 ** rng.uniform(-17, np.log10(0.9))
        root = np.sqrt(-np.log(p_fa))
        snr = (
            10.0 ** rng.uniform(-8, 3),
            (root + rng.normal() * 3) ** 2,
            root**2 * 10.0 ** rng.uniform(-3, 1.5),
        )[i % 3]
        cases.append((float(snr), float(p_fa)))
    ends = [(snr, p_fa) for p_fa in (1e-17, 1.7e-4, 0.9) for snr in (0.0, 1e4, 1e6)]
    return [*cases, *ends, (-np.log(0.1), 0.1), (np.nextafter(-np.log(0.1), 0), 0.1)]


def slope(tails, snr, p_fa, which):
    """Return |d tail/dS| by a central difference that is exact to double precision."""
    snr = mpf(snr)
    step = (snr + mpf("1e-3")) * mpf("1e-15")
    low = snr - step if snr > step else snr
    high = snr + step if snr > step else snr + mpf("1e-30")
    return abs(tails(high, p_fa)[which] - tails(low, p_fa)[which]) / (high - low)


@pytest.mark.parametrize("detector", EXACT)
def test_value_slope_and_probit_in_both_tails(detector):
    found, tails = detector(), ORACLES[detector]
    for snr, p_fa in random_cases(np.random.default_rng(31), 27):
        with mp.workdps(60):
            exact = tails(snr, p_fa)
            which = int(exact[1] < exact[0])
            exact_slope = slope(tails, snr, p_fa, which)
            tiny = exact[which] < mpf("1e-300")
            p_d = found.p_d(np.array([snr]), p_fa)
            from_z, by_snr = linearize(found, np.array([snr]), p_fa)
            z, z_by_snr = (mpf(float(v[0])) for v in found.linearize_probit(np.array([snr]), p_fa))
            case = f"S = {snr!r}, P_fa = {p_fa!r}"
            assert abs(p_d[0] - exact[0]) <= mpf(EXACT[detector]) * exact[0], case
            assert_allclose(from_z, p_d, rtol=0, atol=1.1e-14)
            if not tiny:
                assert abs(by_snr[0] - exact_slope) <= mpf("2e-11") * exact_slope, case
            # Newton's step from z to the exact one
            density = mp.npdf(z)
            error = (mp.ncdf(-z if which else z) - exact[which]) / density
            assert abs(error) <= mpf("1e-12") * max(1, abs(z)), case
            exact_z_slope = exact_slope / mp.npdf(z + (error if which else -error))
            assert abs(z_by_snr - exact_z_slope) <= mpf("2e-11") * exact_z_slope, case


@pytest.mark.parametrize(("snr", "p_fa"), [(0.3, 0.1), (5.0, 1e-3), (40.0, 1e-6), (15.0, 1e-12)])
def test_swerling_is_the_mean_over_a_fluctuating_cross_section(snr, p_fa):
    """The oracles above have the same closed form; here Marcum's P_D is averaged."""
    nodes, weights = np.polynomial.legendre.leggauss(300)
    for fluctuating, density in (
        (Swerling1(), lambda t: np.exp(-t / snr) / snr),
        (Swerling3(), lambda t: 4 * t / snr**2 * np.exp(-2 * t / snr)),
    ):
        ends = np.sort([0, snr, 4 * snr, -np.log(p_fa), 15 * snr, 45 * snr])
        half = 0.5 * np.diff(ends)[:, np.newaxis]
        t = ends[:-1, np.newaxis] + half * (1 + nodes)
        mean = np.sum(half * weights * density(t) * Marcum().p_d(t, p_fa))
        assert_allclose(fluctuating.p_d(np.array(snr), p_fa), mean, rtol=1e-10)


class Own:
    """A detector of one's own, of the closed form of `Swerling1`."""

    def p_d(self, snr, p_fa):
        return p_fa ** (1.0 / (1.0 + snr))

    def linearize_probit(self, snr, p_fa):
        p_d = Own.p_d(self, snr, p_fa)
        z = ndtri(p_d)
        return z, -np.log(p_fa) * p_d / (1.0 + snr) ** 2 / norm.pdf(z)


def own(name, p_d=lambda p_d, snr: p_d, probit=lambda z, slope, snr: (z, slope)):
    """Return a detector of this name, by functions of P_D and of the probit of `Own`."""

    class Made(Own):
        def p_d(self, snr, p_fa):
            return p_d(super().p_d(snr, p_fa), snr)

        def linearize_probit(self, snr, p_fa):
            return probit(*super().linearize_probit(snr, p_fa), snr)

    Made.__name__ = name
    return Made()


def beyond(snr, value, other):
    return np.where(snr > 100, value, other)


#: Its z is infinite, and its slope NaN, where P_D rounds to 1.
SATURATED = own(
    "Saturated",
    lambda p_d, snr: beyond(snr, 1.0, p_d),
    lambda z, slope, snr: (beyond(snr, np.inf, z), beyond(snr, np.nan, slope)),
)
#: Detectors, and what is wrong with them.
WRONG = [
    (own("Steep", probit=lambda z, slope, snr: (z, 1.05 * slope)),
     "dz/dS of Steep.linearize_probit is not the slope of its z"),
    (own("Unknown", probit=lambda z, slope, snr: (beyond(snr, np.nan, z), slope)),
     "z of Unknown.linearize_probit must be a number, it is NaN at S = 1"),
    (own("Falling", lambda p_d, snr: ndtr(-ndtri(p_d)), lambda z, slope, snr: (-z, -slope)),
     "P_D of Falling must rise with the signal-to-noise ratio S"),
    (own("Halved", lambda p_d, snr: 0.5 * p_d),
     "z of Halved.linearize_probit is not the probit of Halved.p_d: P_D differs by 0."),
    (own("Bare", probit=lambda z, slope, snr: z),
     "Bare.linearize_probit must return a pair, a value and a slope, got array"),
    (own("One", lambda p_d, snr: 0.5), r"One.p_d must have the shape of S, \(26,\), got \(\)"),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "words"), WRONG)
def test_a_detector_of_ones_own_is_checked(wrong, words):
    rcs = ConstantRCS(0.1)
    for allowed in (Own(), SATURATED):
        model = DetectionModel(rcs, p_fa=1e-4, detector=allowed)
        own_z = model.linearize_probit(np.zeros(6), [1e4, 0, 0, 1e-6])[0]
        exact = DetectionModel(rcs, p_fa=1e-4, detector=Swerling1())
        assert own_z == pytest.approx(exact.linearize_probit(np.zeros(6), [1e4, 0, 0, 1e-6])[0])
    with pytest.raises(InputError, match=words):
        DetectionModel(rcs, p_fa=1e-4, detector=wrong)
