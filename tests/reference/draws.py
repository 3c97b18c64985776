"""The distribution of P_D at one pose by draws, with standard errors.

The draws are scrambled Sobol' points, in several scrambles that are independent of each other.
Their spread is the standard error (A. B. Owen, J. Complexity 14(4), 1998). S is c_r g with
g = σ_r/(k R⁴), and c_r is normal, given the position of the radar. So c_r is integrated out in
closed form:

    P(S ≤ s) = E Φ((s/g − c)/σ_c), where the aircraft is in sight, and 1 where it is not.

A quantile of P_D is P_D of a quantile of S, found by Newton's method within a bracket.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri
from scipy.stats import qmc
from studies.bands import model

BETAS = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
SCRAMBLES = 16
#: Cells of ln(1 + S) in which P_D is interpolated; its error is of the order 1e-9.
CELL, MOST = 0.01, 14.0


class Detector:
    """P_D as a function of S in NumPy, interpolated between exact values."""

    def __init__(self, exact, p_fa):
        nodes = CELL * np.arange(round(MOST / CELL) + 1)
        values = np.ones(len(nodes))
        values[0] = p_fa
        for i, x in enumerate(nodes[1:], start=1):
            values[i] = exact(float(np.expm1(x)))
            if values[i] > 1 - 1e-14:
                break
        self.spline = CubicSpline(nodes, values)
        self.c3, self.c2, self.c1, self.c0 = self.spline.c

    def __call__(self, snr):
        x = np.log1p(snr) / CELL
        assert np.max(x) < MOST / CELL
        cell = x.astype(np.intp)
        t = (x - cell) * CELL
        return ((self.c3[cell] * t + self.c2[cell]) * t + self.c1[cell]) * t + self.c0[cell]

    def snr(self, p_d):
        """Return S at which P_D has a value, 0 if it is above that everywhere."""
        if self.spline(0) >= p_d:
            return 0.0
        return float(np.expm1(brentq(lambda x: self.spline(x) - p_d, 0, MOST, xtol=1e-14)))


def points(seed, log2_points):
    """Return normal numbers (11, scrambles, points)."""
    scrambles = []
    for one in np.random.SeedSequence(seed).spawn(SCRAMBLES):
        sobol = qmc.Sobol(11, scramble=True, seed=np.random.default_rng(one))
        scrambles.append(ndtri(sobol.random_base2(log2_points)).T)
    return np.ascontiguousarray(np.stack(scrambles, axis=1))


class Draws:
    """The distribution at the poses of one scenario."""

    def __init__(self, scenario, detector, normal):
        self.scenario, self.detector = scenario, detector
        self.plain = model.Oracle(problem(scenario, detector="north"))  # which is not asked
        spread = model.root(np.array(scenario["cov_aircraft"]))
        self.of_aircraft = np.tensordot(spread, normal[:6], axes=1)
        factor = np.linalg.cholesky(np.array(scenario["cov_radar"]))
        radar = scenario["radar"]
        self.radar = np.array(radar["position_m"])[:, None, None]
        self.radar = self.radar + np.tensordot(factor[:3, :3], normal[6:9], axes=1)
        self.constant = radar["constant"] + np.tensordot(factor[3, :3], normal[6:9], axes=1)
        self.std, self.of_constant = factor[3, 3], normal[9]
        self.error = scenario["rcs_error_std"] * normal[10]

    def gain(self, aircraft, radar, error):
        """Return S/c_r, and whether the aircraft is in sight."""
        radar = np.concatenate([radar, np.ones_like(radar[:1])])
        gain = self.plain.snr(0, aircraft, radar, error)
        return gain, self.plain.visible(0, aircraft, radar)

    def nominal(self, aircraft):
        """Return P_D without errors."""
        radar = self.scenario["radar"]
        place = np.array(radar["position_m"])
        (gain,), (seen,) = self.gain(aircraft[:, None], place[:, None], np.zeros(1))
        return float(self.detector(radar["constant"] * gain)) if seen else 0.0

    def at(self, aircraft, pick):
        """Return a limit of P_D, and the numbers of a pose with their standard errors.

        Args:
            aircraft: Nominal state (6,).
            pick: Number of standard deviations at which P_D is to be exceeded, roughly.
        """
        gain, seen = self.gain(aircraft[:, None, None] + self.of_aircraft, self.radar, self.error)
        snr = np.maximum(self.constant + self.std * self.of_constant, 0) * gain
        p_d = np.where(seen, self.detector(snr), 0.0)
        snr = np.where(seen, snr, -1.0)
        found = {"mean": value_and_error(p_d.mean(axis=1))}
        square = np.mean(p_d * p_d, axis=1)
        found["std"] = (
            np.sqrt(max(square.mean() - p_d.mean() ** 2, 0.0)),
            value_and_error(p_d.std(axis=1))[1],
        )
        bounds = [self.quantile(gain, seen, snr, beta) for beta in BETAS]
        for beta, bound in zip(BETAS, bounds, strict=True):
            name = f"{'lower' if beta < 0 else 'upper'}_{abs(beta):.0f}"
            found[name] = value_and_error(bound)
        p_max = float(np.clip(float(f"{np.quantile(p_d, ndtr(pick)):.3g}"), 1e-4, 0.999))
        share, _ = self.below(gain, seen, self.detector.snr(p_max))
        found["exceedance"] = value_and_error(1 - share)
        return p_max, found

    def below(self, gain, seen, snr):
        """Return P(S ≤ snr) and its density for each scramble."""
        v = (np.reshape(snr, (-1, 1)) / gain - self.constant) / self.std
        share = np.where(seen, ndtr(v), 1.0).mean(axis=1)
        density = np.where(seen, np.exp(-0.5 * v * v) / gain, 0.0).mean(axis=1)
        return share, density / (self.std * np.sqrt(2 * np.pi))

    def quantile(self, gain, seen, snr, beta):
        """Return the quantile of P_D at Φ(β) for each scramble."""
        target = ndtr(beta)
        rank = min(int(target * snr.shape[1]), snr.shape[1] - 1)
        x = np.maximum(np.partition(snr, rank, axis=1)[:, rank], 1e-9)
        low, high = np.zeros_like(x), np.full_like(x, np.inf)
        nothing = np.mean(~seen, axis=1)
        if np.all(nothing >= target):
            return np.zeros_like(x)
        for _ in range(100):
            share, density = self.below(gain, seen, x)
            low, high = np.where(share < target, x, low), np.where(share < target, high, x)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                new = x - (share - target) / density
            outside = ~((new > low) & (new < high))
            between = np.where(np.isinf(high), 2 * x, 0.5 * (low + high))
            new = np.where(outside, between, new)
            done = np.max(abs(new - x) / new) < 1e-7
            x = new
            if done:
                break
        return np.where(nothing >= target, 0.0, self.detector(x))


def value_and_error(values):
    """Return mean and standard error of independent values."""
    return values.mean(), values.std(ddof=1) / np.sqrt(len(values))


def problem(block, aircraft=None, detector=None):
    """Return a scenario, and an aircraft state, as `studies.bands.model` has them."""
    radar = block["radar"]
    return model.Problem(
        population="general",
        number=block.get("scenario", 0),
        aircraft=aircraft,
        radars=(
            model.Radar(
                state=np.array([*radar["position_m"], radar["constant"]]),
                detector=detector or block["detector"]["model"],
                p_fa=block["p_fa"],
                max_range=block["max_range_m"] or np.inf,
                min_range=block["min_range_m"] or 0.0,
                horizon=block["horizon"],
                attenuation=block["attenuation_db_per_m"],
            ),
        ),
        rcs=as_tuple(block["rcs"]),
        cov_aircraft=np.array(block["cov_aircraft"]),
        cov_radar=np.array(block["cov_radar"]),
        rcs_db=0.0 if "std_db" in block["rcs"] else block["rcs_error_std"],
    )


def as_tuple(rcs):
    """Return an RCS as `studies.bands.model` has it."""
    kind, *values = rcs.values()
    if kind != "table":
        return (kind, *values)
    azimuth, elevation, rcs_m2 = (x if x is None else np.array(x) for x in values[:3])
    std = np.array(rcs["std_db"]) if "std_db" in rcs else None
    return kind, azimuth, rcs_m2, elevation, std
