"""Peers of the benchmarks: the same model in NumPy, Numba and JAX, and FORM of OpenTURNS.

An RCS is an ellipsoid with the axes a, b, c [m]. Peers that may be missing are imported where used.
"""

import math
import os

import numpy as np
from chain_rule import BOLTZMANN, cross_section
from scipy.special import erfc


def jax_linearize(axes, p_fa):
    """P_D and its ten partials by reverse-mode automatic differentiation, compiled over poses.

    The model has direction cosines where the paper has λ and φ. With λ and φ, JAX takes 1.4 times
    as long.
    """
    # One thread even where processes cannot be pinned to one core; read when JAX is imported.
    os.environ.setdefault(
        "XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    )
    import jax
    import jax.numpy as jnp
    from jax.scipy import special

    jax.config.update("jax_enable_x64", True)
    a, b, c = axes

    def sigma_r(x, y, z):
        hh = x * x + y * y
        rr = hh + z * z
        denominator = a**2 * y * y / rr + b**2 * (y * y / hh) * (z * z / rr) + c**2 * x * x / hh
        return math.pi * (a * b * c) ** 2 / denominator**2

    def p_d(aircraft, radar):
        line = radar[:3] - aircraft[:3]
        roll, pitch, yaw = aircraft[3:]
        x, y, z = line
        x, y = x * jnp.cos(yaw) + y * jnp.sin(yaw), y * jnp.cos(yaw) - x * jnp.sin(yaw)
        z, x = z * jnp.cos(pitch) + x * jnp.sin(pitch), x * jnp.cos(pitch) - z * jnp.sin(pitch)
        y, z = y * jnp.cos(roll) + z * jnp.sin(roll), z * jnp.cos(roll) - y * jnp.sin(roll)
        snr = radar[3] * sigma_r(x, y, z) / (BOLTZMANN * (line @ line) ** 2)
        return 0.5 * special.erfc(math.sqrt(-math.log(p_fa)) - jnp.sqrt(snr + 0.5))

    compiled = jax.jit(jax.vmap(jax.value_and_grad(p_d, argnums=(0, 1))))
    return lambda aircraft, radar: jax.block_until_ready(compiled(aircraft, radar)), jnp.asarray


def numba_monte_carlo(axes, p_fa):
    """Draws, P_D and statistics in one compiled loop, a sample at a time.

    The normals of one run are drawn together, which takes 6 % less time than one by one; half-angle
    tangents in place of sines and cosines would take 4 % more. The statistics are all that the
    package gives: mean, standard deviation, draws within a band, and both quantiles, for which the
    few smallest and largest draws of each pose are kept in order. Standard deviations are taken as
    independent, which the package does not take for granted.
    """
    from numba import njit

    aa, bb, cc = (axis**2 for axis in axes)
    numerator = math.pi * aa * bb * cc

    @njit
    def sigma_r(x, y, z):
        xx, yy, zz = x * x, y * y, z * z
        hh = xx + yy
        rr = hh + zz
        # D as one fraction over h² r²
        denominator = (aa * yy * hh + bb * yy * zz + cc * xx * rr) / (hh * rr)
        return numerator / (denominator * denominator)

    threshold = math.sqrt(-math.log(p_fa))

    @njit
    def insert(ordered, value):
        """Put a value into its place among the smallest so far; the largest of them falls out."""
        i = len(ordered) - 1
        while i > 0 and ordered[i - 1] > value:
            ordered[i] = ordered[i - 1]
            i -= 1
        ordered[i] = value

    @njit(error_model="numpy", nogil=True)
    def loop(generator, runs, aircraft, radar, std_aircraft, std_radar, p_d, lower, upper, keep):
        poses = len(aircraft)
        total, squares = np.zeros(poses), np.zeros(poses)
        inside = np.zeros(poses, dtype=np.int64)
        low, high = np.full((2, poses, keep), np.inf)
        for _ in range(runs):
            radar_north = radar[0] + std_radar[0] * generator.standard_normal()
            radar_east = radar[1] + std_radar[1] * generator.standard_normal()
            radar_down = radar[2] + std_radar[2] * generator.standard_normal()
            power = radar[3] + std_radar[3] * generator.standard_normal()
            power = max(power, 0.0) / BOLTZMANN
            white = generator.standard_normal((poses, 6))
            for j in range(poses):
                north = aircraft[j, 0] + std_aircraft[0] * white[j, 0]
                east = aircraft[j, 1] + std_aircraft[1] * white[j, 1]
                down = aircraft[j, 2] + std_aircraft[2] * white[j, 2]
                roll = aircraft[j, 3] + std_aircraft[3] * white[j, 3]
                pitch = aircraft[j, 4] + std_aircraft[4] * white[j, 4]
                yaw = aircraft[j, 5] + std_aircraft[5] * white[j, 5]
                x, y, z = radar_north - north, radar_east - east, radar_down - down
                rr = x * x + y * y + z * z
                cos, sin = math.cos(yaw), math.sin(yaw)
                x, y = cos * x + sin * y, cos * y - sin * x
                cos, sin = math.cos(pitch), math.sin(pitch)
                z, x = cos * z + sin * x, cos * x - sin * z
                cos, sin = math.cos(roll), math.sin(roll)
                y, z = cos * y + sin * z, cos * z - sin * y
                snr = power * sigma_r(x, y, z) / (rr * rr)
                value = 0.5 * math.erfc(threshold - math.sqrt(snr + 0.5))
                # Sums of deviations from the nominal P_D: as exact as Welford's, and no division.
                deviation = value - p_d[j]
                total[j] += deviation
                squares[j] += deviation * deviation
                inside[j] += lower[j] <= value <= upper[j]
                if value < low[j, keep - 1]:
                    insert(low[j], value)
                if -value < high[j, keep - 1]:
                    insert(high[j], -value)
        return total, squares, inside, low, high

    def monte_carlo(generator, runs, nominal, std, band, tail):
        aircraft, radar = nominal
        below, part = divmod((runs - 1) * tail, 1.0)
        below = int(below)
        total, squares, inside, low, high = loop(
            generator, runs, aircraft, radar, *std, *band, below + 2
        )
        lower, upper = (
            rows[:, below] + part * (rows[:, below + 1] - rows[:, below]) for rows in (low, high)
        )
        deviation = np.sqrt((squares - total**2 / runs) / (runs - 1))
        return band[0] + total / runs, deviation, inside / runs, lower, -upper

    return monte_carlo


def numpy_monte_carlo(generator, runs, nominal, covariances, axes, p_fa, band, tail):
    """The equations of the paper over arrays of all draws, as one writes them down first.

    Args:
        generator: Random generator.
        runs: Number of runs.
        nominal: Aircraft states (n, 6) and radar state (4,).
        covariances: C_aa (6, 6) and C_rr (4, 4).
        axes: a, b, c of the ellipsoid [m].
        p_fa: Probability of false alarm.
        band: Nominal P_D, and the ends of the band to count in, each (n,).
        tail: Probability of the lower quantile.

    Returns:
        Mean, standard deviation, coverage of the band and both quantiles, each (n,).
    """
    aircraft, radar = nominal
    cov_aircraft, cov_radar = covariances
    w_a = generator.multivariate_normal(np.zeros(6), cov_aircraft, (runs, len(aircraft)))
    w_r = generator.multivariate_normal(np.zeros(4), cov_radar, runs)
    x_a = aircraft + w_a
    x_r = (radar + w_r)[:, np.newaxis]
    c_r = np.maximum(x_r[..., 3], 0.0)

    rho = np.einsum("...ij,...j->...i", body_from_ned(x_a), x_r[..., :3] - x_a[..., :3])
    lam = np.arctan2(rho[..., 1], rho[..., 0])
    phi = np.arctan2(rho[..., 2], np.sqrt(rho[..., 0] ** 2 + rho[..., 1] ** 2))
    sigma = cross_section(("ellipsoid", *axes), lam, phi)
    distance = np.linalg.norm(x_r[..., :3] - x_a[..., :3], axis=-1)
    snr = c_r * sigma / (BOLTZMANN * distance**4)
    p_d = 0.5 * erfc(np.sqrt(-np.log(p_fa)) - np.sqrt(snr + 0.5))

    inside = np.mean((p_d >= band[1]) & (p_d <= band[2]), axis=0)
    lower, upper = np.quantile(p_d, [tail, 1 - tail], axis=0)
    return np.mean(p_d, axis=0), np.std(p_d, axis=0, ddof=1), inside, lower, upper


def body_from_ned(aircraft):
    """R_n^b (..., 3, 3), its nine elements written out as eq. (12) prints them."""
    roll, pitch, yaw = (aircraft[..., i] for i in (3, 4, 5))
    cr, cp, cy = np.cos(roll), np.cos(pitch), np.cos(yaw)
    sr, sp, sy = np.sin(roll), np.sin(pitch), np.sin(yaw)
    matrix = np.empty((*roll.shape, 3, 3))
    matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 2] = cp * cy, cp * sy, -sp
    matrix[..., 1, 0] = sr * sp * cy - cr * sy
    matrix[..., 1, 1] = sr * sp * sy + cr * cy
    matrix[..., 1, 2] = sr * cp
    matrix[..., 2, 0] = cr * sp * cy + sr * sy
    matrix[..., 2, 1] = cr * sp * sy - sr * cy
    matrix[..., 2, 2] = cr * cp
    return matrix


def openturns_form(case, limit):
    """P(P_D > limit) of the only pose of a scenario, by FORM as OpenTURNS has it.

    The detection model is the package's: the search is compared.
    """
    import openturns as ot

    def p_d(states):
        found = case.model.p_d(np.asarray(states)[:, :6], np.asarray(states)[:, 6:])
        return found[:, np.newaxis]

    covariance = np.zeros((10, 10))
    covariance[:6, :6], covariance[6:, 6:] = case.cov_aircraft, case.cov_radar
    mean = np.concatenate([case.aircraft[0], case.radar])
    states = ot.RandomVector(ot.Normal(mean, ot.CovarianceMatrix(covariance)))
    function = ot.PythonFunction(10, 1, func_sample=p_d)
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, states), ot.Greater(), limit)
    solver = ot.AbdoRackwitz()
    solver.setStartingPoint(mean)
    search = ot.FORM(solver, event)
    search.run()
    return search.getResult().getEventProbability()
