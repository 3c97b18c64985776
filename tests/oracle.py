"""The whole detection model in fifty digits, written a second time without `radar_sense`.

The formulas are the paper's, corrected where the paper has a misprint: the explicit matrix of
eq. (12) transposed, and λ and φ as arctangents. Inner derivatives are difference quotients.

An RCS is a tuple here: ("constant", σ), ("ellipsoid", a, b, c), ("spikeball", n, A, σ_min).
States are sequences of floats, taken as exact numbers.
"""

from functools import wraps

from mpmath import mp, mpf

DIGITS = 50


def _precisely(function):
    """Compute with fifty digits, or with more if the caller already does."""

    @wraps(function)
    def wrapped(*args):
        with mp.workdps(max(DIGITS, mp.dps)):
            return function(*args)

    return wrapped


@_precisely
def ned_to_body(roll, pitch, yaw):
    """R_n^b: the matrix printed as eq. (12), transposed."""
    roll, pitch, yaw = mpf(roll), mpf(pitch), mpf(yaw)
    cf, ct, cp = mp.cos(roll), mp.cos(pitch), mp.cos(yaw)
    sf, st, sp = mp.sin(roll), mp.sin(pitch), mp.sin(yaw)
    return (
        (cp * ct, ct * sp, -st),
        (-cf * sp + cp * sf * st, cf * cp + sf * sp * st, ct * sf),
        (sf * sp + cf * cp * st, -cp * sf + cf * sp * st, cf * ct),
    )


@_precisely
def slant_range(aircraft, radar):
    """R of eq. (5)."""
    return mp.sqrt(
        sum((mpf(r) - mpf(a)) ** 2 for a, r in zip(aircraft[:3], radar[:3], strict=True))
    )


@_precisely
def body_vector(aircraft, radar):
    """ρ of eq. (11): three components."""
    line = [mpf(r) - mpf(a) for a, r in zip(aircraft[:3], radar[:3], strict=True)]
    return [
        sum(m * d for m, d in zip(row, line, strict=True)) for row in ned_to_body(*aircraft[3:])
    ]


@_precisely
def cross_section(rcs, body):
    """σ_r towards a body-frame vector."""
    kind, *parameters = rcs
    if kind == "constant":
        return mpf(parameters[0])
    x, y, z = (mpf(component) for component in body)
    lam = mp.atan2(y, x)
    phi = mp.atan2(z, mp.sqrt(x**2 + y**2))
    if kind == "ellipsoid":
        a, b, c = (mpf(axis) for axis in parameters)
        denominator = (
            (a * mp.sin(lam) * mp.cos(phi)) ** 2
            + (b * mp.sin(lam) * mp.sin(phi)) ** 2
            + (c * mp.cos(lam)) ** 2
        )
        return mp.pi * (a * b * c) ** 2 / denominator**2
    if kind == "spikeball":
        lobes, amplitude, floor = (mpf(parameter) for parameter in parameters)
        return abs(amplitude * mp.sin(lobes * lam / 2)) + floor
    raise ValueError(kind)


@_precisely
def snr(aircraft, radar, rcs):
    """S of eq. (3), with the k that defines the kelvin."""
    boltzmann = mpf("1.380649e-23")
    sigma = cross_section(rcs, body_vector(aircraft, radar))
    return mpf(radar[3]) * sigma / (boltzmann * slant_range(aircraft, radar) ** 4)


@_precisely
def north(snr, p_fa):
    """P_D of eq. (1)."""
    return mp.erfc(mp.sqrt(-mp.log(mpf(p_fa))) - mp.sqrt(mpf(snr) + mpf("0.5"))) / 2


@_precisely
def north_tails(snr, p_fa):
    """P_D of eq. (1), and 1 − P_D."""
    argument = mp.sqrt(-mp.log(mpf(p_fa))) - mp.sqrt(mpf(snr) + mpf("0.5"))
    return mp.erfc(argument) / 2, mp.erfc(-argument) / 2


@_precisely
def p_d(aircraft, radar, rcs, p_fa):
    """P_D at one pose."""
    return north(snr(aircraft, radar, rcs), p_fa)


def partials(aircraft, radar, rcs, p_fa):
    """∂P_D of the six aircraft and then the four radar states, by central differences.

    At 80 digits and a relative step of 1e-25 the truncation error is of order 1e-50 and the
    rounding error of order 1e-55: exact to double precision.
    """
    with mp.workdps(80):
        states = [mpf(state) for state in (*aircraft, *radar)]
        far = slant_range(aircraft, radar)
        scales = [far] * 3 + [mpf(1)] * 3 + [far] * 3 + [mpf(radar[3]) or mpf(1)]
        slopes = []
        for i, scale in enumerate(scales):
            step = scale * mpf("1e-25")
            ends = []
            for end in (states[i] + step, states[i] - step):
                moved = [*states[:i], end, *states[i + 1 :]]
                ends.append(p_d(moved[:6], moved[6:], rcs, p_fa))
            slopes.append((ends[0] - ends[1]) / (2 * step))
        return slopes


@_precisely
def marcum(snr, p_fa):
    """P_D and 1 − P_D of a steady target; the lesser is a sum, except at very large P_fa.

    The output of the square-law detector is a mixture of gamma distributions, so P_D is P(I ≤ J)
    for Poisson variables I of mean −ln P_fa and J of mean S. No Bessel function is in it.
    """
    threshold, snr = -mp.log(mpf(p_fa)), mpf(snr)
    if snr < threshold:
        p_d = _not_above(threshold, snr)
        return p_d, 1 - p_d
    miss = _not_above(snr, threshold, equal=False)
    return 1 - miss, miss


def _not_above(mean, other, equal=True):
    """P(I ≤ J), or P(I < J), for Poisson I and J of these means."""
    below = mpf(0)  # P(I < j)
    at, weight = mp.exp(-mean), mp.exp(-other)  # P(I = j), P(J = j)
    total, j, least = mpf(0), 0, mpf(10) ** -mp.dps
    enough = max(other, mp.sqrt(mean * other))  # the terms are largest there at the latest
    while True:
        term = weight * (below + at if equal else below)
        total += term
        if j > enough and term < least * total:
            return total
        below += at
        j += 1
        at, weight = at * mean / j, weight * other / j


@_precisely
def swerling1(snr, p_fa):
    """P_D and 1 − P_D of Swerling's case 1."""
    exponent = mp.log(mpf(p_fa)) / (1 + mpf(snr))
    return mp.exp(exponent), -mp.expm1(exponent)


def swerling3(snr, p_fa):
    """P_D and 1 − P_D of Swerling's case 3; 100 digits allow for the difference from 1."""
    with mp.workdps(100):
        s, threshold = mpf(snr) / 2, -mp.log(mpf(p_fa))
        p_d = (1 + threshold * s / (1 + s) ** 2) * mp.exp(-threshold / (1 + s))
        return p_d, 1 - p_d


# N pulses: the signal's count against the noise's, both summed term by term.


def counts(mean, shape):
    """Yield the probabilities of 0, 1, ...: Poisson without a shape, or negative binomial."""
    p = mp.exp(-mean) if shape is None else (1 + mean / shape) ** (-shape)
    k = 0
    while True:
        yield p
        p = (
            p * mean / (k + 1)
            if shape is None
            else p * (shape + k) * (mean / (shape + mean)) / (k + 1)
        )
        k += 1


def threshold(pulses, reference, p_fa, guess):
    """T of a fixed threshold by the incomplete gamma function, of CFAR by the incomplete beta."""
    if reference is None:
        return mp.findroot(lambda t: mp.log(mp.gammainc(pulses, t, regularized=True) / p_fa), guess)
    return mp.findroot(
        lambda t: mp.log(
            mp.betainc(reference, pulses, 0, 1 / (1 + t / reference), regularized=True) / p_fa
        ),
        guess,
    )


def pulses(snr, number, shape, reference, t):
    """P_D and 1 − P_D of N pulses, each without cancellation in its lesser tail."""
    mean, least = number * mpf(snr), mpf(10) ** (8 - mp.dps)
    weights, noise = [], []
    most, signal = mpf(0), counts(mean, shape)
    for j, p in enumerate(counts(t, reference)):
        noise.append(p)
        if j >= number:
            weights.append(next(signal))
            term = weights[-1] * p
            most = max(most, term)
            if j > t and p < mpf(10) ** -40 and 0 < term < least * most:
                break
    beyond, miss = mpf(0), mpf(0)  # P(j ≥ N + k)
    for k in range(len(weights) - 1, -1, -1):
        beyond += noise[number + k]
        miss += weights[k] * beyond
    below, p_d = sum(noise[:number]), mpf(0)
    for k, weight in enumerate(weights):
        p_d += weight * below
        below += noise[number + k]
    return p_d + (1 - sum(weights)), miss
