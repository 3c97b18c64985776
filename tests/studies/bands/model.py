"""P_D of a network at given states, written a second time in plain NumPy without `radar_sense`.

The geometry, the radar equation, the limits and the horizon are a few lines each. The detectors
are closed forms of SciPy. A test compares all of it with the package, and other tests compare the
package with the fifty digits of `tests/oracle.py`. An RCS is a tuple: ("constant", σ),
("ellipsoid", a, b, c), ("ellipsoid_exact", x, y, z), ("spikeball", n, A, σ_min), or
("table", azimuth, rcs, elevation, std_db) in radians, m² and dB with None for what a table does not
have. States are in SI units and radians, components first.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, NdPPoly
from scipy.special import chndtr, erfc, gammaincc, gammainccinv

BOLTZMANN = 1.380649e-23
EFFECTIVE_RADIUS = 4 / 3 * 6_371_000.0
#: Width of a cell of the spline of Marcum's P_D over √S. Its error is of the order 1e-11.
CELL = 0.005


@dataclass(frozen=True, eq=False)
class Radar:
    """One radar: nominal state (4,), detector by name, limits [m], attenuation [dB/m].

    A tolerance is (key, value, standard deviation, power, whether in decibels).
    """

    state: np.ndarray
    detector: str
    p_fa: float
    max_range: float = np.inf
    min_range: float = 0.0
    horizon: bool = False
    attenuation: float = 0.0
    attenuation_std: float = 0.0
    tolerances: tuple = ()
    pulses: int = 1


@dataclass(frozen=True, eq=False)
class Problem:
    """One pose: nominal states, covariances, and what else is uncertain.

    `rcs_db` is the standard deviation of the RCS; a table with `std_db` has its own. C_rr (4m, 4m)
    has the variance of c_r to first order where c_r has tolerances, without correlations.
    """

    population: str
    number: int
    aircraft: np.ndarray
    radars: tuple
    rcs: tuple
    cov_aircraft: np.ndarray
    cov_radar: np.ndarray
    rcs_db: float = 0.0
    k: float = 3.0


def table(azimuth, values, elevation=None):
    """Return the cubic spline of ln values as a function of azimuth and elevation [rad]."""
    nodes = np.append(azimuth, azimuth[0] + 2 * np.pi)
    logs = np.log(np.concatenate([values, values[:1]]))
    around = CubicSpline(nodes, logs, bc_type="periodic")
    if elevation is None:
        return lambda az, el: np.exp(around(az))
    coefficients = np.moveaxis(around.c, 2, 0)  # (elevations, 4, cells)
    both = CubicSpline(elevation, coefficients, bc_type="clamped").c  # (4, cells, 4, cells)
    spline = NdPPoly(np.ascontiguousarray(both.transpose(2, 0, 3, 1)), (nodes, elevation))

    def evaluate(az, el):
        turned = nodes[0] + np.mod(az - nodes[0], 2 * np.pi)
        held = np.clip(el, elevation[0], elevation[-1])
        return np.exp(spline(np.stack([turned, held], axis=-1)))

    return evaluate


def cross_section(rcs):
    """Return σ_r [m²] as a function of the vector to the radar in the body frame."""
    kind, *p = rcs
    if kind == "constant":
        return lambda x, y, z: p[0]
    if kind == "ellipsoid":
        a, b, c = p

        def ellipsoid(x, y, z):
            hh, zz = x * x + y * y, z * z
            d = (a * a * hh + b * b * zz) * y * y / (hh * (hh + zz)) + c * c * x * x / hh
            return np.pi * (a * b * c) ** 2 / d**2

        return ellipsoid
    if kind == "ellipsoid_exact":
        a, b, c = p

        def exact(x, y, z):
            xx, yy, zz = x * x, y * y, z * z
            d = (a * a * xx + b * b * yy + c * c * zz) / (xx + yy + zz)
            return np.pi * (a * b * c) ** 2 / d**2

        return exact
    if kind == "spikeball":
        lobes, amplitude, floor = p
        return lambda x, y, z: abs(amplitude * np.sin(lobes * np.arctan2(y, x) / 2)) + floor
    if kind == "table":
        spline = table(p[0], p[1], p[2])
        return lambda x, y, z: spline(np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y)))
    raise ValueError(kind)


def spread(rcs):
    """Return the standard deviation of the RCS [dB] by the body-frame vector; None if not given."""
    if rcs[0] != "table" or rcs[4] is None:
        return None
    return cross_section(("table", rcs[1], rcs[4], rcs[3], None))


def marcum(snr, p_fa):
    """Return P_D of a steady target, the noncentral chi-square with two degrees."""
    return 1 - chndtr(-2 * np.log(p_fa), 2, 2 * np.asarray(snr))


def detector(name, p_fa, pulses=1):
    """Return P_D as a function of S; only swerling2 has several pulses."""
    if name == "swerling2":  # the sum of N exponential powers has a gamma distribution
        t = gammainccinv(pulses, p_fa)
        return lambda s: gammaincc(pulses, t / (1 + s))
    threshold = -np.log(p_fa)
    if name == "north":
        return lambda s: 0.5 * erfc(np.sqrt(threshold) - np.sqrt(s + 0.5))
    if name == "swerling1":
        return lambda s: np.exp(-threshold / (1 + s))
    if name == "swerling3":
        return lambda s: (
            (1 + threshold * 0.5 * s / (1 + 0.5 * s) ** 2) * np.exp(-threshold / (1 + 0.5 * s))
        )
    if name != "marcum":
        raise ValueError(name)
    # a spline over √S, because `chndtr` takes a microsecond
    cells = int((np.sqrt(threshold) + 7) / CELL)  # 1 − P_D is below 1e-20 beyond
    root = CELL * np.arange(cells + 1)
    spline = CubicSpline(root, marcum(root**2, p_fa), bc_type=((1, 0.0), "not-a-knot"))
    c3, c2, c1, c0 = spline.c

    def steady(s):
        x = np.minimum(np.sqrt(s), root[-1] - 1e-9) / CELL
        cell = x.astype(np.intp)
        t = (x - cell) * CELL
        return ((c3[cell] * t + c2[cell]) * t + c1[cell]) * t + c0[cell]

    return steady


def body_vector(line, attitude):
    """Return a north-east-down vector (3, ...) in the body frame, by roll, pitch and yaw (3, ...).

    Each turn is a rotation of the axes by one angle: yaw about z, pitch about y, roll about x.
    """
    x, y, z = line
    (cf, ct, cp), (sf, st, sp) = np.cos(attitude), np.sin(attitude)
    x, y = cp * x + sp * y, cp * y - sp * x
    x, z = ct * x - st * z, st * x + ct * z
    return x, cf * y + sf * z, cf * z - sf * y


class Oracle:
    """P_D of the network of a problem at any states, and states drawn with its covariances."""

    def __init__(self, problem):
        self.problem = problem
        self.detectors = [detector(r.detector, r.p_fa, r.pulses) for r in problem.radars]
        self.cross_section, self.spread = cross_section(problem.rcs), spread(problem.rcs)
        self.nominal_radars = np.concatenate([radar.state for radar in problem.radars])

    def snr(self, i, aircraft, radar, rcs_error=0.0, attenuation_error=0.0):
        """Return S (...) of radar i, without its limits."""
        line = radar[:3] - aircraft[:3]
        range_squared = line[0] ** 2 + line[1] ** 2 + line[2] ** 2
        if self.problem.rcs[0] == "constant":
            sigma = self.problem.rcs[1] * 10 ** (rcs_error / 10)
        else:
            body = body_vector(line, aircraft[3:])
            sigma = self.cross_section(*body)
            if self.spread is not None:
                sigma = sigma * 10 ** (rcs_error * self.spread(*body) / 10)
            elif np.any(rcs_error):
                sigma = sigma * 10 ** (rcs_error / 10)
        snr = radar[3] * sigma / (BOLTZMANN * range_squared**2)
        alpha = self.problem.radars[i].attenuation
        if alpha:
            alpha = alpha * np.exp(attenuation_error)
            snr = snr * 10 ** (-2 * alpha * np.sqrt(range_squared) / 10)
        return snr

    def visible(self, i, aircraft, radar):
        """Return whether (...) the aircraft is within the limits of radar i."""
        limits = self.problem.radars[i]
        distance = np.sqrt(np.sum((radar[:3] - aircraft[:3]) ** 2, axis=0))
        seen = (distance <= limits.max_range) & (distance >= limits.min_range)
        if limits.horizon:
            roots = np.sqrt(np.maximum(-radar[2], 0)) + np.sqrt(np.maximum(-aircraft[2], 0))
            seen &= distance <= np.sqrt(2 * EFFECTIVE_RADIUS) * roots
        return seen

    def p_d(self, aircraft, radars, rcs_error=0.0, attenuation_errors=None):
        """Return P_D (...) by at least one radar.

        Args:
            aircraft: States (6, ...).
            radars: States of all radars (4m, ...).
            rcs_error: Error of the RCS (...) [dB], or in units of the spread of a table.
            attenuation_errors: Errors of ln α (m, ...), or None.
        """
        missed = 1.0
        for i, radar in enumerate(self.problem.radars):
            state = radars[4 * i : 4 * i + 4]
            error = 0.0 if attenuation_errors is None else attenuation_errors[i]
            p = self.detectors[i](self.snr(i, aircraft, state, rcs_error, error))
            if radar.max_range < np.inf or radar.min_range > 0 or radar.horizon:
                p = np.where(self.visible(i, aircraft, state), p, 0.0)
            missed = missed * (1 - p)
        return 1 - missed

    def nominal(self):
        """Return P_D of the nominal states."""
        return float(self.p_d(self.problem.aircraft[:, None], self.nominal_radars[:, None])[0])

    def draw(self, rng, count):
        """Return drawn states: aircraft (6, n), radars (4m, n), error of the RCS, of each ln α."""
        problem, radars = self.problem, self.problem.radars
        aircraft = problem.aircraft[:, None] + root(problem.cov_aircraft) @ rng.standard_normal(
            (6, count)
        )
        errors = root(problem.cov_radar) @ rng.standard_normal((4 * len(radars), count))
        states = self.nominal_radars[:, None] + errors
        for i, radar in enumerate(radars):
            if radar.tolerances:
                states[4 * i + 3] = radar.state[3]
                for _, value, std, power, decibels in radar.tolerances:
                    states[4 * i + 3] *= factor(
                        rng.standard_normal(count), value, std, power, decibels
                    )
            else:
                states[4 * i + 3] = np.maximum(states[4 * i + 3], 0)
        rcs_error, attenuation_errors = 0.0, None
        if self.spread is not None:
            rcs_error = rng.standard_normal(count)
        elif problem.rcs_db:
            rcs_error = problem.rcs_db * rng.standard_normal(count)
        if any(radar.attenuation_std for radar in radars):
            relative = [r.attenuation_std / r.attenuation if r.attenuation else 0 for r in radars]
            attenuation_errors = [
                r * rng.standard_normal(count) if r else np.zeros(count) for r in relative
            ]
        return aircraft, states, rcs_error, attenuation_errors


def factor(u, value, std, power, decibels):
    """Return the factor of c_r where a parameter is value + std · u.

    A parameter in linear units is at least 0, or at least five standard deviations below its value
    where c_r is divided by it.
    """
    if decibels:
        return 10 ** (power * std * u / 10)
    relative = 1 + std / value * u
    return np.maximum(relative, 0 if power > 0 else 1 - 5 * std / value) ** power


def root(covariance):
    """Return F with F Fᵀ equal to a covariance (n, n), which may be singular."""
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0))
