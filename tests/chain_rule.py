"""The paper's own derivation of the gradient, by λ and φ, as corrected: straight into NumPy.

This module shares neither code nor method with `radar_sense`. The package carries a gradient by the
body-frame vector back through the rotations. This module goes forward through λ, φ and the
derivatives of whole rotation matrices, equation by equation. Tests use the module as an oracle for
many poses, and benchmarks as the plain transcription.

Aircraft states are (m, 6), radar states (m, 4) or (1, 4). An RCS is a tuple: ("constant", σ),
("ellipsoid", a, b, c), ("spikeball", n, A, σ_min).
"""

import numpy as np
from scipy.special import erfc

BOLTZMANN = 1.380649e-23


def elementary_turns(aircraft):
    """Rotations by roll, pitch and yaw, and their derivatives: two lists of (m, 3, 3)."""
    turns, slopes = [], []
    for i, (u, v) in enumerate(((1, 2), (2, 0), (0, 1))):
        angle = aircraft[:, 3 + i]
        cos, sin = np.cos(angle), np.sin(angle)
        turn, slope = np.zeros((2, len(aircraft), 3, 3))
        turn[:, i, i] = 1.0
        turn[:, u, u] = turn[:, v, v] = cos
        turn[:, u, v] = sin
        turn[:, v, u] = -sin
        slope[:, u, u] = slope[:, v, v] = -sin
        slope[:, u, v] = cos
        slope[:, v, u] = -cos
        turns.append(turn)
        slopes.append(slope)
    return turns, slopes


def cross_section(rcs, lam, phi):
    """σ_r as a function of λ and φ."""
    kind, *parameters = rcs
    if kind == "constant":
        return np.full_like(lam, parameters[0])
    if kind == "ellipsoid":
        a, b, c = parameters
        return np.pi * (a * b * c) ** 2 / ellipsoid_denominator(a, b, c, lam, phi) ** 2
    lobes, amplitude, floor = parameters
    return np.abs(amplitude * np.sin(lobes * lam / 2)) + floor


def cross_section_partials(rcs, lam, phi):
    """∂σ_r/∂λ and ∂σ_r/∂φ: eq. (21) and eq. (22), as corrected, for the ellipsoid."""
    kind, *parameters = rcs
    if kind == "constant":
        return np.zeros_like(lam), np.zeros_like(lam)
    if kind == "ellipsoid":
        a, b, c = parameters
        kappa = (a * np.cos(phi)) ** 2 + (b * np.sin(phi)) ** 2 - c**2
        denominator = ellipsoid_denominator(a, b, c, lam, phi)
        outer = -2 * np.pi * (a * b * c) ** 2 / denominator**3
        return (
            outer * np.sin(2 * lam) * kappa,
            outer * (b**2 - a**2) * np.sin(lam) ** 2 * np.sin(2 * phi),
        )
    lobes, amplitude, _ = parameters
    wave = amplitude * np.sin(lobes * lam / 2)
    return np.sign(wave) * amplitude * lobes / 2 * np.cos(lobes * lam / 2), np.zeros_like(lam)


def ellipsoid_denominator(a, b, c, lam, phi):
    """D, the root of the denominator of eq. (13)."""
    return (
        (a * np.sin(lam) * np.cos(phi)) ** 2
        + (b * np.sin(lam) * np.sin(phi)) ** 2
        + (c * np.cos(lam)) ** 2
    )


def north(snr, p_fa):
    """P_D of eq. (1)."""
    return 0.5 * erfc(np.sqrt(-np.log(p_fa)) - np.sqrt(snr + 0.5))


def p_d(aircraft, radar, rcs, p_fa, matrices=None):
    """P_D (m), without partials. Tests put misprinted matrices (m, 3, 3) in the place of R_n^b."""
    (roll, pitch, yaw), _ = elementary_turns(aircraft)
    matrices = roll @ pitch @ yaw if matrices is None else matrices
    line = radar[:, :3] - aircraft[:, :3]
    x, y, z = np.einsum("mij,mj->im", matrices, line)
    sigma = cross_section(rcs, np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))
    return north(radar[:, 3] * sigma / (BOLTZMANN * np.sum(line**2, axis=1) ** 2), p_fa)


def linearize(aircraft, radar, rcs, p_fa, rcs_partials=cross_section_partials):
    """P_D (m), A_Pa (m, 6) and A_Pr (m, 4) of eq. (17).

    Tests put misprinted partials in the place of `rcs_partials`.
    """
    position, constant = radar[:, :3], radar[:, 3]
    (roll, pitch, yaw), (d_roll, d_pitch, d_yaw) = elementary_turns(aircraft)
    matrix = roll @ pitch @ yaw  # R_n^b

    # eq. (11), and ∂ρ/∂(φ_a, θ_a, ψ_a)
    line = (position - aircraft[:, :3])[:, :, np.newaxis]
    rho = (matrix @ line)[:, :, 0]
    drho_dattitude = np.concatenate(
        (d_roll @ pitch @ yaw @ line, roll @ d_pitch @ yaw @ line, roll @ pitch @ d_yaw @ line),
        axis=2,
    )

    # eq. (8), eq. (9) and their partials
    x, y, z = rho.T
    flat = np.sqrt(x**2 + y**2)
    lam = np.arctan2(y, x)
    phi = np.arctan2(z, flat)
    alpha = (x**2 + y**2 + z**2) * flat
    dlam_drho = np.stack((-y / (x**2 + y**2), x / (x**2 + y**2), np.zeros_like(x)), axis=1)
    dphi_drho = np.stack((-x * z / alpha, -y * z / alpha, flat / (x**2 + y**2 + z**2)), axis=1)

    # eq. (20); ∂ρ/∂p_r is R_n^b, ∂ρ/∂p_a its negative
    sigma = cross_section(rcs, lam, phi)
    dsigma_dlam, dsigma_dphi = rcs_partials(rcs, lam, phi)
    dsigma_drho = dsigma_dlam[:, np.newaxis] * dlam_drho + dsigma_dphi[:, np.newaxis] * dphi_drho
    dsigma_dposition = (dsigma_drho[:, np.newaxis, :] @ matrix)[:, 0, :]
    dsigma_dattitude = (dsigma_drho[:, np.newaxis, :] @ drho_dattitude)[:, 0, :]

    # eq. (3) and eq. (1)
    distance = np.sqrt(np.sum((aircraft[:, :3] - position) ** 2, axis=1))
    snr = constant * sigma / (BOLTZMANN * distance**4)
    p_d = north(snr, p_fa)

    # A_Pr as printed; A_Pa has the same partials by position, with the other sign
    slope = np.exp(-((np.sqrt(-np.log(p_fa)) - np.sqrt(snr + 0.5)) ** 2))
    slope = (slope / (2 * np.sqrt(np.pi) * np.sqrt(snr + 0.5)))[:, np.newaxis]
    per_sigma = (constant / (BOLTZMANN * distance**4))[:, np.newaxis]
    by_range = (4 * constant * sigma / (BOLTZMANN * distance**5 * distance))[:, np.newaxis]
    ds_dposition = by_range * (aircraft[:, :3] - position) + per_sigma * dsigma_dposition
    ds_dconstant = (sigma / (BOLTZMANN * distance**4))[:, np.newaxis]
    jac_aircraft = slope * np.concatenate((-ds_dposition, per_sigma * dsigma_dattitude), axis=1)
    jac_radar = slope * np.concatenate((ds_dposition, ds_dconstant), axis=1)
    return p_d, jac_aircraft, jac_radar
