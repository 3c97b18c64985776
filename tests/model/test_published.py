"""Numbers that other tools print in their documentation and in their tests.

Each is cited with its address, and compared to the last digit that is printed. Where the print is
off, the test says by how much and why.
"""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import erfc, gammainccinv

from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import (
    BinaryIntegration,
    Marcum,
    North,
    Swerling1,
    Swerling2,
    Swerling3,
    Swerling4,
    required_snr,
)
from radar_sense.model.radar_equation import SEARCH_FACTORS, SurveillanceRadar, TrackingRadar
from radar_sense.model.rcs import ConstantRCS

C = 299792458.0


def db(ratio):
    return 10 * math.log10(ratio)


def snr_db(radar, rcs, distance):
    """SNR of a radar at a distance [dB]."""
    model = DetectionModel(ConstantRCS(rcs), p_fa=1e-6)
    return db(model.snr(np.zeros(6), [distance, 0, 0, radar.constant()]))


# MATLAB Radar Toolbox, https://www.mathworks.com/help/radar/ref/<function>.html, with B = 1/tau.


#: A radar, m², m, the SNR [dB] that is printed, and what its last digit is worth.
PRINTED_SNR = {
    # 10 GHz, 1 MW, 10 us, 290 K: the range for 6 dB
    "radareqrng": (TrackingRadar(1e6, 20, C / 10e9, 1e5, 290, 0, 0), 1.0, 4.1057e4, 6, 2.2e-4),
    "radareqrng, 40 dB": (TrackingRadar(1e6, 40, C / 10e9, 1e5, 290, 3, 0), 0.1, 1.9426e5, 6, 5e-4),
    "radareqsnr": (TrackingRadar(1e6, 40, C / 10e9, 1e6, 300, 3, 0), 0.5, 1e5, 14.3778, 5e-5),
    "radareqsnr, 1 GHz": (TrackingRadar(1e6, 20, C / 1e9, 5e6, 290, 0, 0), 1, 5e4, 5.5868, 5e-5),
    # the peak power for 6 and 10 dB
    "radareqpow": (TrackingRadar(2.1996e5, 20, C / 1e9, 1e6, 290, 0, 0), 1.0, 50e3, 6, 1e-4),
    "radareqpow, 10 GHz": (
        TrackingRadar(2.2809e6, 30, C / 10e9, 1e6, 300, 3, 0), 0.5, 5e4, 10, 1e-4),
    # Mahafza (2000), section 1.4, with k = 1.38e-23
    "C band": (TrackingRadar(1.5e6, 45, 3e8 / 5.6e9, 5e6, 290, 0, 3), 0.1, 10**4.933775, 20, 0.01),
    # Stone Soup, test_target_rcs: 10 pulses of 10 kW, duty 0.18, printed as 8.197 and 2.125
    "X band": (TrackingRadar(1.8e4, 36, C / 10e9, 24591.9, 290, 0, 5), 10, 15e4, db(8.197), 3e-4),
    "X band, far": (
        TrackingRadar(18e3, 36, C / 1e10, 24591.9, 290, 0, 5), 20, 25e4, db(2.125), 1e-3),
}  # fmt: skip


@pytest.mark.parametrize("name", PRINTED_SNR)
def test_snr(name):
    radar, rcs, distance, printed, digit = PRINTED_SNR[name]
    assert snr_db(radar, rcs, distance) == pytest.approx(printed, abs=digit)


def test_search_radar_of_radareqsearchpap_and_radareqsearchsnr():
    """The solid angle of ranges of azimuth and elevation is Δaz (sin el₂ − sin el₁).

    radareqsearchpap.html: 2.3689e4 W m² for 13 dB of 1 m² at 111 km, 12.5 turns a minute, 487 K,
    20 dB. radareqsearchsnr.html: 13.8182 dB from 3e6 W m², 10 s, −10 dBsm at 1000 km, 6 dB. Both
    have 4π where the paper's c_r has 16, 1.05 dB apart.
    """
    four_pi = SEARCH_FACTORS["4pi"]
    volume = 2 * np.pi * np.sin(np.pi / 4)
    radar = SurveillanceRadar(1, 1, 487, 60 / 12.5, volume, 20, 0, four_pi)
    assert 10 ** ((13 - snr_db(radar, 1.0, 111e3)) / 10) == pytest.approx(2.3689e4, abs=0.5)
    volume = np.radians(30) * np.sin(np.pi / 4)
    radar = SurveillanceRadar(3e6, 1, 487, 10, volume, 6, 0, four_pi)
    assert snr_db(radar, 0.1, 1000e3) == pytest.approx(13.8182, abs=0.00005)
    assert db(16 / four_pi) == pytest.approx(1.05, abs=0.005)


def test_binary_integration_of_matlab():
    """binaryintloss.html: 1.0596 dB for 12 of 24 pulses, P_D 0.9, P_fa 1e-6, a steady target.

    Exactly 1.0797. The SNR that it compares with, of the sum of 24 pulses, is by the formula of
    D. A. Shnidman (IEEE Trans. AES-38(3), 2002), which is 0.0201 dB above the exact one.
    """
    binary = Marcum(binary=BinaryIntegration(12, 24))
    looks, of_sum = (db(required_snr(d, 1e-6, 0.9)) for d in (binary, Marcum(24)))
    assert looks - of_sum == pytest.approx(1.0797, abs=0.00005)
    eta = sum(math.sqrt(-0.8 * math.log(4 * p * (1 - p))) for p in (1e-6, 0.9))
    shnidman = db(eta * (eta + 2 * math.sqrt(24 / 2 - 1 / 4)) / 24)
    assert looks - shnidman == pytest.approx(1.0596, abs=0.00005)
    assert shnidman - of_sum == pytest.approx(0.0201, abs=0.00005)


# Stone Soup, https://github.com/dstl/Stone-Soup/blob/710a094faab64c021a161d690cf15dcfa4437489/
# stonesoup/sensor/radar/tests/test_radar.py.


def test_aesa_of_stone_soup():
    """test_aesaradar: 7715.00 W, 29.58 dB, SNR 16.01, P_D 0.688 by North at P_fa 1e-6.

    The beam is Gaussian, and off its broadside wider and weaker by the cosines of both angles. The
    energy is that of `pulses` pulses of `duty` each. Its assertions are `approx(x, 3)`, which is a
    relative tolerance of 300 %; the numbers hold to the digits that they have.
    """
    gain, width, beam = 30, np.radians(10), np.radians([15, 20])
    target = np.array([75e3, 10e3, 20e3])
    azimuth = np.arctan2(target[1], target[0])
    elevation = np.arcsin(target[2] / np.linalg.norm(target))
    cosines = np.cos(beam).prod()
    off = (np.array([azimuth, elevation]) - beam) * cosines / width
    power = 50e3 * np.exp(-0.5 * np.sum((2.35482 * off) ** 2))
    assert power == pytest.approx(7715.00, abs=0.005)
    assert gain + db(cosines) == pytest.approx(29.58, abs=0.005)
    radar = TrackingRadar(power * 5 * 0.1, gain + db(cosines), C / 100e6, 30e6, 290, 0, 3)
    model = DetectionModel(ConstantRCS(10.0), p_fa=1e-6)
    states = np.array([*target, 0, 0, 0]), np.array([0, 0, 0, radar.constant()])
    assert model.snr(*states) == pytest.approx(16.01, abs=0.005)
    assert model.p_d(*states) == pytest.approx(0.688, abs=0.0005)


def test_north_at_the_snr_that_stone_soup_prints():
    assert North().p_d(16.01, 1e-6) == pytest.approx(0.68786, abs=0.000005)


# radarsimpy, https://github.com/radarsimx/radarsimpy/blob/36b21331e2332d82dd2a44b45acbbd5b012a78d1/
# tests/test_module_tools.py: P_fa, SNR [dB], pulses, P_D.

ROC_PD = [
    (Marcum, 1e-8, 13, 1, 0.6287), (Marcum, 1e-8, 11, 1, 0.1683),
    (Marcum, 1e-8, -3.2, 256, 0.8411), (Marcum, 1e-8, -4.8, 256, 0.2249),
    (Swerling1, 1e-4, 16, 1, 0.7980), (Swerling1, 1e-4, 6.8, 1, 0.2036),
    (Swerling1, 1e-4, 3.6, 256, 0.8959), (Swerling1, 1e-4, -7.6, 256, 0.2560),
    (Swerling2, 1e-4, -4.4, 256, 0.9120), (Swerling2, 1e-4, -7.2, 256, 0.2125),
    (Swerling2, 1e-4, 16, 1, 0.7980), (Swerling2, 1e-4, 6.8, 1, 0.2036),
    (Swerling3, 1e-4, 15.2, 1, 0.8846), (Swerling3, 1e-4, 6.8, 1, 0.1931),
    (Swerling3, 1e-4, -0.4, 256, 0.8889), (Swerling3, 1e-4, -8.4, 256, 0.1775),
    (Swerling4, 1e-4, 15.2, 1, 0.8846), (Swerling4, 1e-4, 6.8, 1, 0.1931),
    (Swerling4, 1e-4, -4.8, 256, 0.8413),
]  # fmt: skip


@pytest.mark.parametrize(("cls", "p_fa", "snr", "pulses", "printed"), ROC_PD)
def test_roc_pd_of_radarsimpy(cls, p_fa, snr, pulses, printed):
    """test_roc_pd asserts four decimals, to 1.5 units of the last; one unit is claimed here."""
    found = cls(pulses=pulses).p_d(np.array(10 ** (snr / 10)), p_fa)
    assert found == pytest.approx(printed, abs=1e-4)


def test_swerling_4_of_radarsimpy_has_a_sign():
    """Printed 0.2155 for 256 pulses at −7.2 dB, exactly 0.21110: C₃ of the approximation is minus.

    From 50 pulses on, its pd_swerling4 takes a normal distribution with corrections for skewness
    and kurtosis (B. R. Mahafza, Radar Systems Analysis and Design Using MATLAB). As it stands the
    skewness has the other sign, which its Swerling 0 has right.
    """
    snr, pulses, p_fa = 10**-0.72, 256, 1e-4

    def approximation(sign):
        beta, threshold = 1 + snr / 2, gammainccinv(pulses, p_fa)
        square = 2 * beta**2 - 1
        width = math.sqrt(pulses * square)
        c3 = sign * (2 * beta**3 - 1) / (3 * square * width)
        c4 = (2 * beta**4 - 1) / (4 * pulses * square**2)
        v = (threshold - pulses * (1 + snr)) / width
        hermite = c3 * (v**2 - 1) + c4 * v * (3 - v**2)
        hermite -= c3**2 / 2 * v * (v**4 - 10 * v**2 + 15)
        density = math.exp(-(v**2) / 2) / math.sqrt(2 * math.pi)
        return erfc(v / math.sqrt(2)) / 2 - density * hermite

    exact = float(Swerling4(pulses=pulses).p_d(np.array(snr), p_fa))
    assert exact == pytest.approx(0.21110, abs=5e-6)
    assert approximation(+1) == pytest.approx(0.2155, abs=5e-5)
    assert approximation(-1) == pytest.approx(exact, abs=5e-6)


# sdr, https://github.com/mhostetter/sdr/blob/<commit>/tests/detection/<file>, whose numbers of a
# single pulse are MATLAB's.


def test_p_d_of_sdr():
    """010204b, test_p_d.py, test_complex_square_law: P_fa 1e-3, SNR −10 to 10 dB."""
    printed = [
        0.00177786, 0.0020086, 0.00231693, 0.00273403, 0.00330629, 0.00410404, 0.00523576,
        0.00687179, 0.00928377, 0.01291049, 0.01846703, 0.02712174, 0.0407706, 0.06242657,
        0.09667487, 0.14995286, 0.23001292, 0.34340965, 0.48995306, 0.65552537, 0.81029237,
    ]  # fmt: skip
    assert_allclose(Marcum().p_d(10 ** np.arange(-1, 1.05, 0.1), 1e-3), printed, atol=5e-9)


def test_min_snr_of_sdr():
    """https://mhostetter.github.io/sdr/v0.0.19/api/sdr.min_snr: P_D 0.9, P_fa 1e-6."""
    assert db(required_snr(Marcum(), 1e-6, 0.9)) == pytest.approx(13.183490056794499, abs=1e-11)


@pytest.mark.parametrize(
    ("pulses", "printed"),
    [(2, 2.3760378084124643), (10, 7.367080094838606), (20, 9.296533509663906)],
)
def test_gain_of_integration_of_sdr(pulses, printed):
    """29cbcc3, test_non_coherent_gain.py, test_scalar_snr_out: 10 dB at the output, P_fa 1e-6."""
    p_d = float(Marcum().p_d(np.array(10.0), 1e-6))
    assert 10 - db(required_snr(Marcum(pulses), 1e-6, p_d)) == pytest.approx(printed, abs=1e-11)


@pytest.mark.parametrize(
    ("pulses", "printed", "off"),
    [(2, 2.499445060713011, 0), (10, 8.666092814306324, 2.7e-6), (20, 11.410342926869486, 0.0270)],
)
def test_gain_of_integration_of_sdr_near_one(pulses, printed, off):
    """The same, test_scalar_snr_in: 10 dB at the input.

    P_D is 1 − 2e-12 with 10 pulses and rounds to 1 with 20. A difference from 1 has few digits
    there, and sdr extrapolates the second, as it says. The probit has all digits.
    """
    ten_db = np.array([10.0])
    (z,), _ = Marcum(pulses).linearize_probit(ten_db, 1e-6)

    def excess(gain):
        return float(Marcum().linearize_probit(ten_db * 10 ** (gain / 10), 1e-6)[0][0] - z)

    exact = brentq(excess, 0, 20, xtol=1e-13)
    assert exact - printed == pytest.approx(off, rel=0.01, abs=1e-11)
