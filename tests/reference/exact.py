"""P_D, its gradient and σ to first order with a proven error, by ball arithmetic.

A ball is a midpoint and a radius, and each operation returns a ball that contains every possible
result (F. Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval arithmetic", IEEE
Trans. Computers 66(8), 2017; python-flint). The doubles of the files are taken as exact. The
formulas are the paper's, corrected where the paper has a misprint (docs/paper.md).

A derivative is the second coefficient of a power series: S at x + t is S + t ∂S/∂x + O(t²).
"""

from itertools import pairwise
from math import comb

from flint import arb, arb_mat, arb_series, ctx
from scipy.optimize import brentq
from scipy.special import bdtrc, gammainccinv, nbdtr

ctx.prec = 256
#: Radius of a threshold, and the most that is left out of a sum.
LEAST = arb(2) ** -200
BOLTZMANN = arb("1.380649e-23")
EFFECTIVE_RADIUS = arb(4) / 3 * 6_371_000
#: Derivatives are by six states of the aircraft, four of the radar, and the error of the RCS.
STATES = 11


# Geometry and the radar equation, for one state at a time as x + t.


def snr(scenario, rcs, states, i=None):
    """Return S as a series in state i, or its value only."""
    x = [arb_series([s, 1] if j == i else [s], 2) for j, s in enumerate(states)]
    line = [r - a for a, r in zip(x[:3], x[6:9], strict=True)]  # eq. (11) without its rotation
    distance = (line[0] * line[0] + line[1] * line[1] + line[2] * line[2]).sqrt()  # eq. (5)
    body = [sum_of(m * d for m, d in zip(row, line, strict=True)) for row in ned_to_body(*x[3:6])]
    sigma = rcs(azimuth(body), elevation(body))
    error = x[10] * rcs.spread(azimuth(body), elevation(body)) * (arb(10).log() / 10)
    attenuation = arb(scenario["attenuation_db_per_m"]) * (arb(10).log() / 5)
    gain = (error - attenuation * distance).exp()
    far = distance * distance
    return x[9] * sigma * gain / (BOLTZMANN * (far * far))  # eq. (3)


def sum_of(terms):
    first, *rest = terms
    for term in rest:
        first = first + term
    return first


def ned_to_body(roll, pitch, yaw):
    """Return the matrix that is printed as eq. (12), transposed."""
    (sf, cf), (st, ct), (sp, cp) = (angle.sin_cos() for angle in (roll, pitch, yaw))
    return (
        (cp * ct, ct * sp, -st),
        (cp * sf * st - cf * sp, cf * cp + sf * sp * st, ct * sf),
        (sf * sp + cf * cp * st, cf * sp * st - cp * sf, cf * ct),
    )


def azimuth(body):
    """Return λ of eq. (8) with four quadrants."""
    x, y, _ = body
    if abs(x[0]) > abs(y[0]):
        turn = arb.pi() * (0 if x[0] > 0 else 1 if y[0] > 0 else -1)
        return (y / x).atan() + turn
    return (1 if y[0] > 0 else -1) * arb.pi() / 2 - (x / y).atan()


def elevation(body):
    """Return φ of eq. (9), positive below the aircraft."""
    x, y, z = body
    return (z / (x * x + y * y).sqrt()).atan()


def visible(scenario, states):
    """Return whether the aircraft is within range, and above the horizon."""
    distance = sum_of((states[6 + i] - states[i]) ** 2 for i in range(3)).sqrt()
    limits = []
    if scenario["max_range_m"]:
        limits.append(arb(scenario["max_range_m"]) - distance)
    if scenario["min_range_m"]:
        limits.append(distance - arb(scenario["min_range_m"]))
    if scenario["horizon"]:
        roots = (-states[8]).sqrt() + (-states[2]).sqrt()
        limits.append((2 * EFFECTIVE_RADIUS).sqrt() * roots - distance)
    assert not any(limit.contains(0) for limit in limits)
    return all(limit > 0 for limit in limits)


# Cross sections: functions of λ and φ as series. The spread is in dB for one unit of the error.


class Formula:
    def __init__(self, rcs):
        self.rcs = rcs

    def spread(self, lam, phi):
        return arb(1)

    def __call__(self, lam, phi):
        rcs = self.rcs
        if rcs["model"] == "constant":
            return arb_series([arb(rcs["rcs_m2"])], 2)
        if rcs["model"] == "spikeball":
            wave = (lam * arb(rcs["lobes"]) / 2).sin()
            assert not wave[0].contains(0)
            sign = 1 if wave[0] > 0 else -1
            return wave * sign * arb(rcs["amplitude_m2"]) + arb(rcs["floor_m2"])
        (sl, cl), (sp, cp) = lam.sin_cos(), phi.sin_cos()
        if rcs["model"] == "ellipsoid":  # eq. (13)
            a, b, c = (arb(rcs[key]) for key in ("a_m", "b_m", "c_m"))
            d = square(sl * cp * a) + square(sl * sp * b) + square(cl * c)
        else:  # the exact ellipsoid: semi-axes along nose, wing and down
            a, b, c = (arb(rcs[key]) for key in ("x_m", "y_m", "z_m"))
            d = square(cl * cp * a) + square(sl * cp * b) + square(sp * c)
        return arb.pi() * square(a * b * c) / square(d)


class Table:
    """A spline of ln σ_r; elevations are positive above the aircraft."""

    def __init__(self, rcs):
        self.value = Spline(rcs["azimuth_rad"], rcs["elevation_rad"], rcs["rcs_m2"])
        std = rcs.get("std_db")
        self.std = std and Spline(rcs["azimuth_rad"], rcs["elevation_rad"], std)

    def spread(self, lam, phi):
        return self.std(lam, -phi) if self.std else arb(1)

    def __call__(self, lam, phi):
        return self.value(lam, -phi)


def square(x):
    return x * x


class Spline:
    """A spline through logarithms (n, m): periodic in azimuth, flat at its ends in elevation."""

    def __init__(self, around, upward, values):
        self.around = [arb(x) for x in around] + [arb(around[0]) + 2 * arb.pi()]
        self.upward = upward and [arb(x) for x in upward]
        rows = values if upward else [[v] for v in values]
        self.logs = [[arb(v).log() for v in row] for row in rows]
        self.logs.append(self.logs[0])
        self.moments = periodic_moments(self.around, self.logs)
        if upward:
            self.flat = flat_matrix(self.upward).inv()

    def __call__(self, lam, eps):
        first = self.around[0]
        at = lam[0] if lam[0] >= first else lam[0] + 2 * arb.pi()
        i = cell(self.around, at)
        columns = [
            piece(self.around, i, at, [r[j] for r in self.logs], [r[j] for r in self.moments])
            for j in range(len(self.logs[0]))
        ]
        if not self.upward:
            ((value, by_az),) = columns
            by_el = arb(0)
        elif eps[0] < self.upward[0] or eps[0] > self.upward[-1]:
            (value, by_az), by_el = columns[0 if eps[0] < self.upward[0] else -1], arb(0)
        else:
            values, slopes = zip(*columns, strict=True)
            j = cell(self.upward, eps[0])
            value, by_el = piece(self.upward, j, eps[0], values, flat_moments(self, values))
            by_az, _ = piece(self.upward, j, eps[0], slopes, flat_moments(self, slopes))
        return arb_series([value, by_az * lam[1] + by_el * eps[1]], 2).exp()


def cell(nodes, at):
    """Return the cell of a place, which is surely not at a node."""
    (found,) = [i for i, (low, high) in enumerate(pairwise(nodes)) if low < at and at < high]
    return found


def piece(nodes, i, at, values, moments):
    """Return value and slope of a spline in a cell from its second derivatives at the nodes."""
    h = nodes[i + 1] - nodes[i]
    p, q = nodes[i + 1] - at, at - nodes[i]
    value = (moments[i] * p**3 + moments[i + 1] * q**3) / (6 * h)
    value += (values[i] / h - moments[i] * h / 6) * p + (
        values[i + 1] / h - moments[i + 1] * h / 6
    ) * q
    slope = (moments[i + 1] * q**2 - moments[i] * p**2) / (2 * h)
    slope += (values[i + 1] - values[i]) / h - (moments[i + 1] - moments[i]) * h / 6
    return value, slope


def periodic_moments(nodes, values):
    """Return second derivatives (n + 1, m) of periodic splines: the slopes agree at each node."""
    n = len(nodes) - 1
    h = [b - a for a, b in pairwise(nodes)]
    matrix = arb_mat(n, n)
    right = arb_mat(n, len(values[0]))
    for i in range(n):
        matrix[i, (i - 1) % n] += h[i - 1]
        matrix[i, i] += 2 * (h[i - 1] + h[i])
        matrix[i, (i + 1) % n] += h[i]
        for j in range(len(values[0])):
            after = (values[i + 1][j] - values[i][j]) / h[i]
            before = (values[i][j] - values[(i - 1) % n][j]) / h[i - 1]
            right[i, j] = 6 * (after - before)
    moments = matrix.solve(right).table()
    return [*moments, moments[0]]


def flat_matrix(nodes):
    """Return the matrix of the second derivatives of a spline whose slope is zero at both ends."""
    n = len(nodes)
    matrix = arb_mat(n, n)
    for i, (low, high) in enumerate(pairwise(nodes)):
        for row, other in ((i, i + 1), (i + 1, i)):
            matrix[row, row] += 2 * (high - low)
            matrix[row, other] += high - low
    return matrix


def flat_moments(spline, values):
    """Return the second derivatives (m) of the spline through values (m) in elevation."""
    right = arb_mat(len(values), 1)
    for i, (low, high) in enumerate(pairwise(spline.upward)):
        slope = 6 * (values[i + 1] - values[i]) / (high - low)
        right[i, 0] += slope
        right[i + 1, 0] -= slope
    return [row[0] for row in (spline.flat * right).table()]


def cross_section(rcs):
    return Table(rcs) if rcs["model"] == "table" else Formula(rcs)


# Detectors: from S to P_D and dP_D/dS. The threshold T is in units of the mean noise power.


def detector(block, p_fa):
    """Return P_D and its slope (arb, arb) as a function of S."""
    binary, false = block.get("binary"), arb(p_fa)
    if binary:
        m, n = binary["m"], binary["n"]
        guess = brentq(lambda p: bdtrc(m - 1, n, p) - p_fa, 1e-14, 0.999, xtol=1e-300, rtol=1e-14)
        false = root(lambda p: at_least(m, n, p), guess, false, rising=True)
    look = single_look(block, false)
    if not binary:
        return look

    def of_looks(s):
        p, slope = look(s)
        by_p = n * comb(n - 1, m - 1) * p ** (m - 1) * (1 - p) ** (n - m)
        return at_least(m, n, p), by_p * slope

    return of_looks


def at_least(m, n, p):
    return sum_of(comb(n, j) * p**j * (1 - p) ** (n - j) for j in range(m, n + 1))


def single_look(block, p_fa):
    model, pulses, cfar = block["model"], block.get("pulses", 1), block.get("cfar")
    if cfar and model == "marcum":
        cells = cfar["cells"] * pulses
        # P(j < N) for negative binomial j is the tail of the ratio of two gamma variables
        guess = brentq(
            lambda x: nbdtr(pulses - 1, cells, 1 / (1 + x)) - float(p_fa), 1e-9, 1e6, rtol=1e-14
        )
        alpha = root(
            lambda x: sum_of(negative_binomial(cells, x, j) for j in range(pulses)), guess, p_fa
        )
        return lambda s: steady(s, pulses, lambda j: negative_binomial(cells, alpha, j))
    if cfar:
        assert pulses == 1
        factors = [arb(cfar["cells"] - i) for i in range(cfar.get("rank", 0))]
        if not factors:
            factors = [arb(1)] * cfar["cells"]  # with α over the sum of the cells

        def of(x):
            return product(f / (f + x) for f in factors)

        guess = brentq(lambda x: float(of(arb(x)) - p_fa), 1e-9, 1e6, rtol=1e-14)
        alpha = root(of, guess, p_fa)
        return lambda s: by_series(lambda t: of(alpha / (1 + t)), s)
    t = -p_fa.log()
    if model == "north":  # eq. (1)
        return lambda s: by_series(lambda x: (t.sqrt() - (x + arb(1) / 2).sqrt()).erfc() / 2, s)
    if pulses > 1:
        t = root(
            lambda x: upper(pulses, x),
            gammainccinv(pulses, float(p_fa)),
            p_fa,
        )
    if model == "marcum":
        return lambda s: steady(s, pulses, lambda j: (-t).exp() * t**j / arb(j).fac())
    return lambda s: by_series(lambda x: fluctuating(model, pulses, t, x), s)


def product(factors):
    first, *rest = factors
    for factor in rest:
        first = first * factor
    return first


def by_series(function, s):
    """Return value and slope of a function of a series."""
    found = function(arb_series([s, 1], 2))
    return found[0], found[1]


def upper(shape, x):
    """Return P(gamma variable of an integer shape > x) of a ball or a series: a finite sum."""
    term = total = x * 0 + 1
    for j in range(1, shape):
        term = term * x / j
        total = total + term
    return total * (-x).exp()


def negative_binomial(shape, alpha, j):
    return comb(shape + j - 1, j) * alpha**j / (1 + alpha) ** (shape + j)


def fluctuating(model, n, t, s):
    """Return P_D of Swerling's cases with N pulses from their moment generating functions.

    The sum of the outputs is a sum of exponential variables of mean 1 and of mean β.
    """
    if model == "swerling1":  # N − 1 of mean 1 and one of mean 1 + NS
        beta = 1 + n * s
        if n == 1:
            return (-t / beta).exp()
        q = n * s / beta  # 1 − 1/β
        return upper(n - 1, t) + (-t / beta).exp() / q ** (n - 1) * (1 - upper(n - 1, t * q))
    if model == "swerling2":  # N of mean 1 + S
        return upper(n, t / (1 + s))
    if model == "swerling3":  # N − 2 of mean 1 and two of mean 1 + NS/2
        beta = 1 + n * s / 2
        if n == 1:  # a half and a half of one and two, see swerling4
            return mixed(1, t, beta)
        if n == 2:
            return upper(2, t / beta)
        q = 1 - 1 / beta
        near = (1 + t / beta) / q ** (n - 2) * (1 - upper(n - 2, t * q))
        near = near - (n - 2) / beta / q ** (n - 1) * (1 - upper(n - 1, t * q))
        return upper(n - 2, t) + (-t / beta).exp() * near
    assert model == "swerling4"  # 2N of mean 1 + S/2, less N of mean 1
    return mixed(n, t, 1 + s / 2)


def mixed(n, t, beta):
    """Return the tail of the transform (1 + u)^N/(1 + βu)^2N, with 1 + u = (1 + βu)/β + 1 − 1/β."""
    one, other = 1 / beta, 1 - 1 / beta
    return sum_of(
        comb(n, k) * one**k * other ** (n - k) * upper(2 * n - k, t / beta) for k in range(n + 1)
    )


def steady(s, pulses, noise):
    """Return P_D and its slope of a steady target: Poisson mixtures, with a bound of what is left.

    Given a count k of the signal, P_D is P(j < N + k) for the count j of the noise.
    """
    mean = pulses * s
    weight = (-mean).exp()
    below = sum_of(noise(j) for j in range(pulses))
    value, slope, k = arb(0), arb(0), 0
    while True:
        density = noise(pulses + k)
        value += weight * below
        slope += weight * density
        below += density
        k += 1
        weight = weight * mean / k
        if k > 2 * mean and 2 * weight < LEAST:  # the rest is at most 2 weight
            rest = arb(0).union(2 * weight)
            return value + rest, pulses * (slope + rest)


def root(function, guess, target, *, rising=False):
    """Return a ball that surely has the root of a monotone function, by Newton from a guess."""
    x, sign = arb(guess), 1 if rising else -1
    for _ in range(8):
        found = function(arb_series([x, 1], 2))
        x = (x - (found[0] - target) / found[1]).mid()
    low, high = x - LEAST, x + LEAST
    if rising:
        low, high = x - x * LEAST, x + x * LEAST
    assert sign * (function(low) - target) < 0
    assert sign * (function(high) - target) > 0
    return low.union(high)


# Together.


def first_order(scenario, rcs, p_d_of, aircraft):
    """Return P_D, its gradient (11) and σ to first order at one pose, as balls."""
    radar = scenario["radar"]
    states = [arb(float(x)) for x in (*aircraft, *radar["position_m"], radar["constant"], 0.0)]
    if not visible(scenario, states):
        return arb(0), [arb(0)] * STATES, arb(0)
    p_d, slope = p_d_of(snr(scenario, rcs, states)[0])
    gradient = [slope * snr(scenario, rcs, states, i)[1] for i in range(STATES)]
    variance = quadratic(gradient[:6], scenario["cov_aircraft"])
    variance += quadratic(gradient[6:10], scenario["cov_radar"])
    variance += square(gradient[10] * arb(scenario["rcs_error_std"]))
    return p_d, gradient, variance.sqrt() if variance > 0 else abs(variance).upper().sqrt()


def quadratic(gradient, covariance):
    """Return g C gᵀ."""
    return sum_of(
        gradient[i] * arb(float(c)) * gradient[j]
        for i, row in enumerate(covariance)
        for j, c in enumerate(row)
        if c
    )
