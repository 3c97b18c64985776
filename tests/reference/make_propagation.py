"""Write propagation.npz, the distribution of P_D on the paper's scenario, in some eight minutes.

    python tests/reference/make_propagation.py

Two independent estimates for θ_r = 0, 0.5, ..., 180° and the three levels, each of quantiles at
Φ(β), mean and standard deviation, with standard errors.

By randomised quasi-Monte Carlo (scrambled Sobol' points) at every pose, from a model of its own.
Aircraft and radar position enter by their difference only, so one draw of three stands for both.
S = c_r g with g = σ_r/(k R⁴), so c_r is integrated out in closed form (conditional Monte Carlo):

    P(S < s) = E Φ((s/g − c)/σ_c), which Newton's method solves for s.

By plain Monte Carlo in all ten dimensions at every fourth pose, from the model of the package:
order statistics without these formulas.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.constants import Boltzmann
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.rcs import EllipsoidRCS

SEED = 20240607
SCRAMBLES, LOG2_POINTS = 16, 15
PLAIN_DRAWS, PLAIN_STEP = 4_000_000, 4

THETA_DEG = np.arange(361) * 0.5
BETAS = np.arange(-3.0, 4.0)
LEVELS = {"low": (10.0, 1.0), "medium": (100.0, 5.0), "high": (1000.0, 10.0)}  # metres, J m²/K
POSITION, ATTITUDE = 10.0, np.radians(1.0)  # standard deviations of the aircraft's state
A, B, C = 0.15, 0.13, 0.21
P_FA, CONSTANT, RADIUS, DOWN, YAW = 1.7e-4, 167.0, 500e3, -3e3, np.radians(90.0)


def position(theta_deg):
    theta = np.radians(theta_deg)
    return np.array([RADIUS * np.sin(theta), RADIUS * np.cos(theta), DOWN])


def gain(theta_deg, shift, attitude):
    """S/c_r; shift (3, n) of the aircraft from the radar [m], attitude (3, n) from the nominal."""
    x, y, z = -position(theta_deg)[:, np.newaxis] - shift
    (sr, sp, sy), (cr, cp, cy) = (f(attitude + np.c_[[0.0, 0.0, YAW]]) for f in (np.sin, np.cos))
    bx = cp * cy * x + cp * sy * y - sp * z
    by = (sr * sp * cy - cr * sy) * x + (sr * sp * sy + cr * cy) * y + sr * cp * z
    bz = (cr * sp * cy + sr * sy) * x + (cr * sp * sy - sr * cy) * y + cr * cp * z
    hh = bx * bx + by * by
    rr = hh + bz * bz
    denominator = A**2 * by**2 / rr + B**2 * by**2 / hh * bz**2 / rr + C**2 * bx**2 / hh
    return np.pi * (A * B * C / denominator) ** 2 / (Boltzmann * rr * rr)


def north(snr):
    return ndtr(np.sqrt(2.0) * (np.sqrt(snr + 0.5) - np.sqrt(-np.log(P_FA))))


def conditional_quantiles(g, std, start):
    """The s with E Φ((s/g − c)/std) = Φ(β) for each β, by Newton's method from `start`."""
    quantiles = np.array(start)
    for i, target in enumerate(ndtr(BETAS)):
        for _ in range(8):
            v = (quantiles[i] / g - CONSTANT) / std
            density = np.mean(np.exp(-0.5 * v * v) / g) / (std * np.sqrt(2.0 * np.pi))
            step = (ndtr(v).mean() - target) / density
            quantiles[i] -= step
            if abs(step) < 1e-5 * quantiles[i]:
                break
        else:
            raise RuntimeError("a quantile has not converged")
    return quantiles


def quasi_monte_carlo(std_position, std_constant):
    """Quantiles (n, 7), means (n,) and standard deviations (n,), and the errors of the three."""
    draws = []
    for seed in np.random.SeedSequence(SEED).spawn(SCRAMBLES):
        sobol = qmc.Sobol(7, scramble=True, seed=np.random.default_rng(seed))
        draws.append(ndtri(sobol.random_base2(LOG2_POINTS)).T.copy())
    shape = (len(THETA_DEG), SCRAMBLES)
    quantiles, mean, square = np.empty((*shape, len(BETAS))), np.empty(shape), np.empty(shape)
    for i, theta in enumerate(THETA_DEG):
        for k, u in enumerate(draws):
            g = gain(theta, np.hypot(POSITION, std_position) * u[:3], ATTITUDE * u[3:6])
            snr = (CONSTANT + std_constant * u[6]) * g
            p_d = north(snr)
            mean[i, k], square[i, k] = p_d.mean(), np.mean(p_d * p_d)
            start = np.quantile(snr, ndtr(BETAS)) if k == 0 else quantiles[i, k - 1]
            quantiles[i, k] = conditional_quantiles(g, std_constant, start)
    quantiles = north(quantiles)
    stds = np.sqrt(square - mean**2)
    std = np.sqrt(square.mean(axis=1) - mean.mean(axis=1) ** 2)
    errors = (a.std(axis=1, ddof=1) / np.sqrt(SCRAMBLES) for a in (quantiles, mean, stds))
    return quantiles.mean(axis=1), mean.mean(axis=1), std, *errors


def plain_monte_carlo(std_position, std_constant):
    """The same from draws, at every fourth pose."""
    model = DetectionModel(rcs=EllipsoidRCS(a=A, b=B, c=C), p_fa=P_FA)
    rng, n = np.random.default_rng(SEED), PLAIN_DRAWS
    from_aircraft = rng.standard_normal((n, 6)) * np.repeat([POSITION, ATTITUDE], 3)
    from_radar = rng.standard_normal((n, 4)) * [*[std_position] * 3, std_constant]
    # A quantile's error: half the distance of the order statistics one deviation of the rank away.
    probability = ndtr(BETAS)
    half = np.sqrt(probability * (1.0 - probability) * n)
    ranks = np.clip([probability * n - half, probability * n, probability * n + half], 0, n - 1)
    ranks = ranks.astype(int)
    rows = []
    for theta in THETA_DEG[::PLAIN_STEP]:
        aircraft = np.array([*position(theta), 0.0, 0.0, YAW]) + from_aircraft
        p_d = model.p_d(aircraft, np.array([0.0, 0.0, 0.0, CONSTANT]) + from_radar)
        mean, std = p_d.mean(), p_d.std()
        fourth = np.mean((p_d - mean) ** 4)
        p_d.partition(np.unique(ranks))
        low, quantiles, high = p_d[ranks]
        std_error = np.sqrt((fourth - std**4) / n) / (2.0 * std)
        rows.append((quantiles, mean, std, (high - low) / 2, std / np.sqrt(n), std_error))
    return [np.array(column) for column in zip(*rows, strict=True)]


def main():
    data = {}
    for level, deviations in LEVELS.items():
        for kind, estimate in (("", quasi_monte_carlo), ("plain_", plain_monte_carlo)):
            quantiles, mean, std, *errors = estimate(*deviations)
            data |= {f"{kind}{level}_quantiles": quantiles}
            data |= {f"{kind}{level}_mean": mean, f"{kind}{level}_std": std}
            for name, error in zip(("quantiles", "mean", "std"), errors, strict=True):
                data[f"{kind}{level}_{name}_error"] = error.astype(np.float32)
            print(kind, level, *(f"{error.max():.1e}" for error in errors), flush=True)
    path = Path(__file__).with_name("propagation.npz")
    np.savez_compressed(path, theta_deg=THETA_DEG, betas=BETAS, plain_step=PLAIN_STEP, **data)


if __name__ == "__main__":
    main()
