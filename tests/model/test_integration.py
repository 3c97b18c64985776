"""N pulses, CFAR and m of n pulses: against mpmath, draws of pulses, and print."""

import math
from functools import partial

import numpy as np
import oracle
import pytest
from mpmath import mp, mpf
from numpy.testing import assert_allclose, assert_array_equal

from radar_sense.errors import InputError
from radar_sense.model.detectors import (
    BinaryIntegration,
    CellAveraging,
    Marcum,
    North,
    OrderedStatistics,
    Swerling1,
    Swerling2,
    Swerling3,
    Swerling4,
    linearize,
    probit_of_tail,
    required_snr,
)
from radar_sense.model.integration import PulseSum
from radar_sense.model.probit_table import HIGHEST

#: Shape K of the signal's count by N pulses.
SHAPES = {
    Marcum: lambda n: None,
    Swerling1: lambda n: 1,
    Swerling2: lambda n: n,
    Swerling3: lambda n: 2,
    Swerling4: lambda n: 2 * n,
}


def exact(detector, snr, p_fa):
    """z and dz/dS without the table."""
    return probit_of_tail(*detector.tails(p_fa).tail(np.atleast_1d(np.asarray(snr, dtype=float))))


def agrees(z, by_snr, tails, snr, case):
    """Insist on z and dz/dS to 1e-12, from tails (S) in mpmath."""
    snr = mpf(snr)
    step = snr * mpf(10) ** (-mp.dps // 3)
    low, middle, high = (tails(s) for s in (snr - step, snr, snr + step))
    which = int(middle[1] < middle[0])
    slope = abs(high[which] - low[which]) / (2 * step)
    z, by_snr = mpf(float(z)), mpf(float(by_snr))
    error = (mp.ncdf(-z if which else z) - middle[which]) / mp.npdf(z)
    assert abs(error) <= mpf("1e-12") * max(1, abs(z)), case
    exact_slope = slope / mp.npdf(z + (error if which else -error))
    assert abs(by_snr / exact_slope - 1) <= mpf("1e-12"), case


@pytest.mark.parametrize("cells", [None, 12])
@pytest.mark.parametrize("cls", SHAPES)
def test_value_and_slope_in_both_tails(cls, cells):
    """P_fa from 1e-15 to 0.9, N from 2 to 300, S from far below the threshold to far above."""
    rng = np.random.default_rng([11, cells or 0, len(cls.__name__), int(cls is Swerling4)])
    few, many = int(rng.integers(2, 30)), int(rng.integers(30, 300 if cells is None else 90))
    for number in (few, many) if cells is None else (1, few, many):
        p_fa = float(10 ** rng.uniform(-15 if number > 1 else -9, -0.05))
        detector = cls(pulses=number, cfar=cells and CellAveraging(cells))
        pulses = PulseSum.of(number, detector.shape, number * (cells or math.inf), p_fa)
        grid = 10 ** np.linspace(-4, 6, 400)
        z, _ = probit_of_tail(*pulses.tail(grid))
        for target in (rng.uniform(z[0], 0), rng.uniform(0, 9))[: 1 + (number < 30)]:
            snr = float(np.interp(target, z, grid))
            with mp.workdps(40):
                reference = cells and number * cells
                t = oracle.threshold(number, reference, mpf(p_fa), mpf(pulses.threshold))
                agrees(
                    *(v[0] for v in exact(detector, snr, p_fa)[:2]),
                    lambda s, n=number, b=reference, t=t: oracle.pulses(s, n, SHAPES[cls](n), b, t),
                    snr,
                    f"{detector}, S = {snr!r}, P_fa = {p_fa!r}",
                )


@pytest.mark.parametrize(
    ("cls", "number", "cells", "decibels"),
    [(Swerling4, 100, None, 60), (Swerling1, 1000, None, 60), (Swerling2, 300, 24, -40),
     (Marcum, 10, 24, 30), (Marcum, 1000, None, -40), (Marcum, 2, None, 40),
     (Marcum, 1, 4, 26), (Marcum, 1, 4, 30)],
)  # fmt: skip
def test_far_tails(cls, number, cells, decibels):
    """With Swerling 4 and N = 100 an alternating sum would give P_D = −79.7."""
    detector, p_fa = cls(pulses=number, cfar=cells and CellAveraging(cells)), 1e-6
    snr = 10.0 ** (decibels / 10)
    pulses = detector.tails(p_fa)
    z, by_snr = (v[0] for v in exact(detector, snr, p_fa))
    with mp.workdps(60):
        reference = cells and number * cells
        t = oracle.threshold(number, reference, mpf(p_fa), mpf(pulses.threshold))
        shape = SHAPES[cls](number)
        step = mpf(snr) * mpf("1e-20")
        tails = [oracle.pulses(mpf(snr) + h, number, shape, reference, t) for h in (-step, 0, step)]
        which = int(tails[1][1] < tails[1][0])
        log_tail = mp.log(tails[1][which])
        rate = abs(mp.log(tails[2][which]) - mp.log(tails[0][which])) / (2 * step)
        tail = pulses.tail(np.array([snr]))
        assert abs(mpf(float(tail.log[0])) / log_tail - 1) < mpf("1e-14")
        assert abs(mpf(float(tail.rate[0])) / rate - 1) < mpf("1e-12")
        # z of a tail that mpmath has no inverse for, by its logarithm
        side = -abs(mpf(float(z)))
        log_phi = mp.log(mp.erfc(-side / mp.sqrt(2)) / 2)
        assert abs(log_phi / log_tail - 1) < mpf("2e-12")
        slope = rate * mp.exp(log_phi) / mp.npdf(side)
        assert abs(mpf(float(by_snr)) / slope - 1) < mpf("1e-12")


@pytest.mark.parametrize("number", [1, 10, 1000])
def test_a_strong_steady_target_by_bessel_functions(number):
    """1 − P_D = exp(−m − T) Σ_{j≥N} (T/m)^(j/2) I_j(2√(mT)); the package has it as an integral."""
    pulses = PulseSum.of(number, math.inf, math.inf, 1e-6)
    for snr in (300.0, 1e4, 1e6):
        tail = pulses.tail(np.array([snr]))
        with mp.workdps(30):
            m, t = number * mpf(snr), mpf(pulses.threshold)
            total, first, j = mpf(0), None, number
            while True:
                term = (t / m) ** (mpf(j) / 2) * mp.besseli(j, 2 * mp.sqrt(m * t))
                first = first or term
                total += term
                if term < mpf("1e-25") * total:
                    break
                j += 1
            assert abs(mpf(float(tail.log[0])) / (mp.log(total) - m - t) - 1) < mpf("1e-14")
            assert abs(mpf(float(tail.rate[0])) / (number * first / total) - 1) < mpf("1e-12")


@pytest.mark.parametrize(("number", "p_fa"), [(280, 1.1e-12), (249, 1.7e-9), (102, 3e-6)])
def test_thresholds_keep_p_fa(number, p_fa):
    """SciPy's inverse of the incomplete gamma function is off by 4e-13 of P_fa here."""
    t = PulseSum.of(number, 1.0, math.inf, p_fa).threshold
    with mp.workdps(30):
        noise = oracle.counts(mpf(t), None)
        false = sum(next(noise) for _ in range(number))
        assert abs(false / mpf(p_fa) - 1) < mpf("5e-14")


@pytest.mark.parametrize("cells", [None, 8])
@pytest.mark.parametrize("cls", SHAPES)
def test_draws_of_pulses(cls, cells):
    """Amplitudes in complex noise, squared, added, compared: nothing is known of counts."""
    rng = np.random.default_rng([5, cells or 0])
    number, snr, runs = 3, 4.0, 100_000
    size = (runs, 1 if cls in (Swerling1, Swerling3) else number)
    power = {
        Marcum: lambda: np.ones((runs, number)),
        Swerling1: lambda: rng.exponential(1.0, size),
        Swerling2: lambda: rng.exponential(1.0, size),
        Swerling3: lambda: rng.gamma(2.0, 0.5, size),
        Swerling4: lambda: rng.gamma(2.0, 0.5, size),
    }[cls]()
    noise = rng.normal(0, np.sqrt(0.5), (2, runs, number))
    output = (np.sqrt(snr * power) + noise[0]) ** 2 + noise[1] ** 2
    p_fa = 1e-2
    pulses = PulseSum.of(number, 1.0, number * (cells or math.inf), p_fa)
    threshold = pulses.threshold
    if cells:
        reference = rng.exponential(1.0, (runs, cells * number)).sum(axis=1)
        threshold = threshold / (cells * number) * reference
    detector = cls(pulses=number, cfar=cells and CellAveraging(cells))
    agrees_with_draws(output.sum(axis=1) > threshold, detector.p_d(np.array(snr), p_fa))
    noise = rng.exponential(1.0, (runs, number)).sum(axis=1)
    agrees_with_draws(noise > threshold, p_fa)


def agrees_with_draws(hits, probability):
    """Insist on a probability within 4.5 standard errors of the share of the draws that hit."""
    error = np.sqrt(probability * (1 - probability) / len(hits))
    assert np.mean(hits) == pytest.approx(float(probability), abs=4.5 * error)


def test_draws_of_ordered_cells_and_of_looks():
    rng = np.random.default_rng(8)
    runs, snr, p_fa, cells, rank, m, n = 100_000, 12.0, 1e-2, 16, 12, 2, 4
    single = Swerling1(cfar=OrderedStatistics(cells, rank))
    factor = single.tails(p_fa).factor
    output = rng.exponential(1.0 + snr, runs)
    reference = np.sort(rng.exponential(1.0, (runs, cells)), axis=1)[:, rank - 1]
    agrees_with_draws(output > factor * reference, single.p_d(np.array(snr), p_fa))

    looks = Swerling2(pulses=2, binary=BinaryIntegration(m, n))
    snr, threshold = 2.0, looks.tails(p_fa).look.threshold
    for s, probability in ((snr, looks.p_d(np.array(snr), p_fa)), (0.0, p_fa)):
        output = rng.exponential(1.0 + s, (runs, n, 2)).sum(axis=2)
        agrees_with_draws((output > threshold).sum(axis=1) >= m, probability)


def test_ordered_cells_against_mpmath():
    rng = np.random.default_rng(2)
    for _ in range(20):
        cells = int(rng.integers(2, 60))
        rank, p_fa = int(rng.integers(1, cells + 1)), float(10 ** rng.uniform(-12, -2))
        snr = float(10 ** rng.uniform(-4, 6))
        detector = Swerling2(cfar=OrderedStatistics(cells, rank))
        z, by_snr = exact(detector, snr, p_fa)
        with mp.workdps(40):

            def p_d(factor, s, cells=cells, rank=rank):
                left = range(cells, cells - rank, -1)
                return mp.fprod(i / (i + factor / (1 + mpf(s))) for i in left)

            factor = mp.findroot(
                lambda a, p_fa=p_fa, p_d=p_d: mp.log(p_d(a, 0)) - mp.log(mpf(p_fa)),
                mpf(detector.tails(p_fa).factor),
            )
            agrees(z[0], by_snr[0], lambda s: ((p := p_d(factor, s)), 1 - p), snr, str(detector))  # noqa: B023


def test_m_of_n_against_mpmath():
    rng = np.random.default_rng(4)
    for _ in range(12):
        n = int(rng.integers(1, 20))
        m, p_fa = int(rng.integers(1, n + 1)), float(10 ** rng.uniform(-12, -2))
        snr = float(10 ** rng.uniform(-2, 2))
        z, by_snr = exact(Swerling2(binary=BinaryIntegration(m, n)), snr, p_fa)
        with mp.workdps(60):

            def of_looks(p, q, m=m, n=n):
                terms = [mp.binomial(n, j) * p**j * q ** (n - j) for j in range(n + 1)]
                return sum(terms[m:]), sum(terms[:m])

            one = mp.findroot(
                lambda log_p, p_fa=p_fa, f=of_looks: (
                    mp.log(f(mp.exp(log_p), -mp.expm1(log_p))[0]) - mp.log(mpf(p_fa))
                ),
                mp.log(mpf(p_fa)) / m - 1,
            )
            agrees(
                z[0],
                by_snr[0],
                lambda s, one=one, f=of_looks: f(mp.exp(one / (1 + s)), -mp.expm1(one / (1 + s))),
                snr,
                f"{m} of {n}, S = {snr!r}, P_fa = {p_fa!r}",
            )


# The table.

TABLED = [
    Marcum(),
    Swerling1(),
    Swerling3(),
    Marcum(pulses=10),
    Swerling1(pulses=1000),
    Swerling2(pulses=100, cfar=CellAveraging(24)),
    Swerling3(cfar=CellAveraging(8)),
    Swerling4(pulses=7),
    Swerling1(cfar=OrderedStatistics(24, 18)),
    Swerling2(pulses=3, binary=BinaryIntegration(3, 5)),
]


@pytest.mark.parametrize("detector", TABLED, ids=str)
def test_error_of_the_table(detector):
    """Below 2e-13 of z, and 2e-11 of its slope; of a slow target with 1000 pulses more."""
    rng = np.random.default_rng(6)
    for p_fa in (1e-12, 1e-6, 0.5):
        snr = 10 ** rng.uniform(-4, 6, 200)
        z, by_snr = detector.linearize_probit(snr, p_fa)
        z_exact, slope = exact(detector, snr, p_fa)
        many = detector == Swerling1(pulses=1000)
        z_error, slope_error = (2e-11, 5e-9) if many else (2e-13, 2e-11)
        assert (abs(z - z_exact) <= z_error * np.maximum(1, abs(z_exact))).all()
        assert_allclose(by_snr, slope, rtol=slope_error)
        p_d, by_p_d = linearize(detector, snr, p_fa)
        assert_array_equal(p_d, detector.p_d(snr, p_fa))
        density = np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
        assert_allclose(by_p_d, by_snr * density, rtol=1e-12)
    # Beyond 80 dB, up to where the exact slope of a steady target is itself wrong by 1e-8.
    snr = 10 ** rng.uniform(8, 60, 100)
    z, by_snr = detector.linearize_probit(snr, 1e-6)
    z_exact, slope = exact(detector, snr, 1e-6)
    near = snr * getattr(detector, "pulses", 1) <= 1e17
    for where, of_z, of_slope in ((slice(None), 2e-10, 2e-8), (near, 1e-12, 1e-11)):
        assert_allclose(z[where], z_exact[where], rtol=of_z)
        assert_allclose(by_snr[where], slope[where], rtol=of_slope)


@pytest.mark.parametrize("detector", [North(), *TABLED], ids=str)
def test_more_signal_is_detected_more_often(detector):
    """From P_fa up, and on both sides of where the tail that is summed changes."""
    snr = np.linspace(0, 60, 20001)
    for p_fa in (1e-12, 1.7e-4, 0.5):
        p_d, by_snr = linearize(detector, snr, p_fa)
        z, z_by_snr = detector.linearize_probit(snr, p_fa)
        assert (np.diff(z) > 0).all()
        assert (by_snr > 0).all()
        assert (z_by_snr > 0).all()
        if detector != North():
            assert_allclose(p_d[0], p_fa, rtol=1e-12 if detector in TABLED else 1e-13)


@pytest.mark.parametrize("detector", [North(), *TABLED], ids=str)
def test_any_shape_and_any_size(detector):
    """Where S is NaN, all values are NaN. Beyond the table, values are the exact ones."""
    snr = np.array([0, 1e-300, 1e-20, 1, 744, 1e6, HIGHEST, 1e20, 1e160, np.nan])
    one_pulse = detector in (North(), *TABLED[:3])
    nearly_one = 1 - (1e-13 if detector == Marcum() else 2.0**-53)  # its table would take 3 s
    for p_fa in (1e-6, *(1e-300, 0.9, nearly_one) * one_pulse):
        for function in (detector.p_d, partial(linearize, detector), detector.linearize_probit):
            found = np.array(function(snr, p_fa))
            assert np.isfinite(found[..., :-1]).all()
            assert np.isnan(found[..., -1]).all()
            grid = np.array(function(snr.reshape(2, 5), p_fa))
            assert_array_equal(grid.reshape(found.shape), found)
            for i in (0, 3, 7):
                assert_array_equal(np.array(function(np.asarray(snr[i]), p_fa)), found[..., i])
    if detector == North():  # which has no table
        return
    beyond = snr[8:9]
    assert_array_equal(detector.linearize_probit(beyond, 1e-6), exact(detector, beyond, 1e-6))
    below, above = (detector.linearize_probit(HIGHEST * f, 1e-6) for f in (1 - 1e-9, 1 + 1e-9))
    assert_allclose(below, above, rtol=2e-8)


def test_the_slope_of_p_d_per_decibel_grows_with_integration():
    """One pulse with the gain of integration in c_r has a σ that is 2.7 to 4.3 times too small."""
    slopes = []
    for number, expected in ((1, 0.076), (10, 0.202), (100, 0.327)):
        detector = Swerling2(pulses=number)
        snr = required_snr(detector, 1e-6, 0.5)
        p_d, by_snr = linearize(detector, np.asarray(snr), 1e-6)
        assert p_d == pytest.approx(0.5, abs=1e-12)
        slopes.append(float(by_snr) * snr * math.log(10) / 10)
        assert slopes[-1] == pytest.approx(expected, abs=5e-4)
    assert slopes[1] / slopes[0] == pytest.approx(2.7, abs=0.05)
    assert slopes[2] / slopes[0] == pytest.approx(4.3, abs=0.05)


def albersheim(p_d, p_fa, number):
    """W. J. Albersheim (Proc. IEEE 69, 1981) [dB]: steady target, P_fa 1e-7 to 1e-3."""
    a, b = math.log(0.62 / p_fa), math.log(p_d / (1 - p_d))
    return -5 * math.log10(number) + (6.2 + 4.54 / math.sqrt(number + 0.44)) * math.log10(
        a + 0.12 * a * b + 1.7 * b
    )


def shnidman(p_d, p_fa, number, shape):
    """D. A. Shnidman (IEEE Trans. AES-38(3), 2002) [dB]: P_fa 1e-9 to 1e-3, to 100 pulses."""
    alpha = 0.0 if number < 40 else 0.25
    eta = math.sqrt(-0.8 * math.log(4 * p_fa * (1 - p_fa))) + math.copysign(
        math.sqrt(-0.8 * math.log(4 * p_d * (1 - p_d))), p_d - 0.5
    )
    steady = eta * (eta + 2 * math.sqrt(number / 2 + alpha - 0.25))
    decibels = (((17.7006 * p_d - 18.4496) * p_d + 14.5339) * p_d - 3.525) / shape
    if p_d > 0.872:
        decibels += (
            math.exp(27.31 * p_d - 25.14)
            + (p_d - 0.8) * (0.7 * math.log(1e-5 / p_fa) + (2 * number - 20) / 80)
        ) / shape
    return 10 * math.log10(10 ** (decibels / 10) * steady / number)


def test_albersheim_and_shnidman_within_their_stated_errors():
    """As docs/questions/scenario.md says; a linear detector is worth up to 0.1 dB."""
    for number, p_fa in ((1, 1e-7), (10, 1e-3), (100, 1e-7)):
        for cls in SHAPES:
            detector = cls(pulses=number)
            for p_d, of_albersheim in ((0.5, 0.2), (0.9, 0.3)):
                needed = 10 * math.log10(required_snr(detector, p_fa, p_d))
                expected = shnidman(p_d, p_fa, number, detector.shape)
                assert needed == pytest.approx(expected, abs=0.5), (detector, p_fa)
                if cls is Marcum:
                    assert needed == pytest.approx(albersheim(p_d, p_fa, number), abs=of_albersheim)


def test_required_snr():
    assert required_snr(Marcum(), 1e-6, 1e-7) == 0.0
    with pytest.raises(InputError, match="p_d must be"):
        required_snr(Marcum(), 1e-6, 1.0)
    # the least of two cells: P_D = 1/(1 + α/(2(1 + S))), which is P_fa at S = 0
    worst = Swerling1(cfar=OrderedStatistics(2, 1))
    for p_d, decibels in ((0.5, 300.0), (0.9, 309.542425), (1 - 1e-6, 360.0)):
        assert 10 * math.log10(required_snr(worst, 1e-30, p_d)) == pytest.approx(decibels, abs=1e-5)
