"""Along a mission: probability that some look, or m of n looks in a row, has detected the aircraft.

A look is one pulse, or one scan, at one time; those of several radars are one sequence. Given the
states, looks are independent, and the probability of detection by look k is

    P_c(k) = 1 − Π_{j≤k} (1 − P_j) = 1 − exp(−H_k), H_k = Σ_{j≤k} h_j, h_j = −ln(1 − P_j).

The states are not known, and what is wrong with them is not independent from look to look. The
radar's errors are constant during a mission. The aircraft's are a first-order Gauss–Markov process
(A. Gelb, *Applied Optimal Estimation*, 1974, ch. 3): the pose at look i is x̄_i + F_i u_i with unit
normals u of covariance exp(−|t_i − t_j|/τ) I, and F_i the symmetric factor of C_i, F_i F_iᵀ = C_i.
At τ = 0 looks at different times have independent errors; at τ = ∞ all have the same. Two looks at
one time see one pose, and share its error whatever τ is.

H is the sum of functions of one look each. So to first order its variance is a double sum over the
looks whose terms do not depend on k, and an exponential kernel needs but one pass over them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfcx, log_ndtr, ndtr, ndtri, ndtri_exp

from radar_sense.covariance import draws, factor, symmetric_factor, variance_along
from radar_sense.montecarlo import SAMPLES_PER_BLOCK, in_order
from radar_sense.propagation import Spread, probit_moments
from radar_sense.sampling import random_stream
from radar_sense.states import AIRCRAFT, CONSTANTS, RADAR, FloatArray
from radar_sense.statistics import RunningMoments, Tails

#: Largest n of m-of-n, which keeps track of 2^(n−1) histories.
MAX_WINDOW = 12

#: Farther out in the tails than this nothing is left of a normal density.
_FAR = 37.5
_SQRT_2 = math.sqrt(2.0)
_ROOT_2_OVER_PI = math.sqrt(2.0 / math.pi)


class Model(Protocol):
    """What is asked of a model: `DetectionModel`, a network, or `Interleaved`.

    K looks are the first axis of the aircraft states, and m radars have 4m states.
    """

    def p_d(self, aircraft: FloatArray, radar: FloatArray, /) -> FloatArray:
        """P_D (K, ...) for aircraft (K, ..., 6) and radar (..., 4m)."""
        ...

    def linearize_probit(
        self, aircraft: FloatArray, radar: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Probits z (K,) and partials (K, 6) and (K, 4m) for aircraft (K, 6) and radar (4m,)."""
        ...


class RadarDraws(Protocol):
    """How radars are drawn that are not just Gaussian, as `montecarlo.Sampler` does it."""

    @property
    def radar_normals(self) -> int:
        """Unit normals that a draw takes."""
        ...

    def draw_radar(self, white: FloatArray, /) -> tuple[FloatArray, NDArray[np.bool_]]:
        """States (runs, 4m) from unit normals, and where a c_r below 0 was set to 0 (runs,)."""
        ...


@dataclass(frozen=True, eq=False)
class Interleaved:
    """Several radars that look at times of their own, as the model of one sequence of looks.

    Attributes:
        models: The model of each of m radars, or of each of some networks.
        which: The model of each look (K,).
        radars: The radars of each model, as places among all of them; None for one each.
    """

    models: tuple[Model, ...]
    which: NDArray[np.intp]
    radars: tuple[tuple[int, ...], ...] | None = None

    def p_d(self, aircraft: FloatArray, radar: FloatArray, /) -> FloatArray:
        """P_D (K, ...) for aircraft (K, ..., 6) and radar (..., 4m)."""
        found = np.empty(np.broadcast_shapes(aircraft.shape[:-1], radar.shape[:-1]))
        for i, model in enumerate(self.models):
            looks = self.which == i
            # component first, as memory has it
            states = np.moveaxis(np.moveaxis(aircraft, -1, 0)[:, looks], 0, -1)
            found[looks] = model.p_d(states, radar[..., self._states(i)])
        return found

    def linearize_probit(
        self, aircraft: FloatArray, radar: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Probits z (K,) and partials (K, 6) and (K, 4m) for aircraft (K, 6) and radar (4m,)."""
        z, by_aircraft = np.empty(len(aircraft)), np.empty(aircraft.shape)
        by_radar = np.zeros((len(aircraft), len(radar)))
        for i, model in enumerate(self.models):
            looks, part = self.which == i, self._states(i)
            z[looks], by_aircraft[looks], by_radar[np.ix_(looks, part)] = model.linearize_probit(
                aircraft[looks], radar[part]
            )
        return z, by_aircraft, by_radar

    def _states(self, model: int) -> NDArray[np.intp]:
        """Where the states of a model's radars are among those of all."""
        radars = (model,) if self.radars is None else self.radars[model]
        return np.concatenate([len(RADAR) * i + np.arange(len(RADAR)) for i in radars])


@dataclass(frozen=True, eq=False)
class Looks:
    """A sequence of K looks, each linearized in its probit z = Φ⁻¹(P_D).

    Attributes:
        time: Times (K,) [s], which do not decrease.
        probit: z (K,).
        by_aircraft: Partials of z for the pose at that look (K, 6).
        by_radar: Partials of z for the states of all radars (K, 4m).
    """

    time: FloatArray
    probit: FloatArray
    by_aircraft: FloatArray
    by_radar: FloatArray

    @property
    def p_d(self) -> FloatArray:
        """P_D of each look (K,)."""
        p_d: FloatArray = ndtr(self.probit)
        return p_d

    @property
    def hazard(self) -> FloatArray:
        """Hazard h = −ln(1 − P_D) of each look (K,), to its own digits in both tails."""
        hazard: FloatArray = -log_ndtr(-self.probit)
        return hazard


@dataclass(frozen=True, eq=False)
class Cumulative:
    """Probability of an event up to each look (K,), and its uncertainty.

    Attributes:
        p: Its probability with the nominal states.
        mean: Mean of it over the errors of the states.
        std: Standard deviation of it.
        lower: Bound that it falls below with probability Φ(−β).
        upper: Bound that it stays below with probability Φ(β).
    """

    p: FloatArray
    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray


def linearize_looks(model: Model, time: ArrayLike, aircraft: ArrayLike, radar: ArrayLike) -> Looks:
    """Linearize every look of a sequence.

    Args:
        model: The model.
        time: Times of the looks (K,) [s], which do not decrease.
        aircraft: Nominal aircraft states (K, 6).
        radar: Nominal states of the radars (4m,).

    Raises:
        ValueError: If a shape does not fit or the times decrease.
    """
    time, aircraft = _times(time), np.asarray(aircraft, dtype=float)
    if aircraft.shape != (len(time), len(AIRCRAFT)):
        raise ValueError(
            f"aircraft states must have shape ({len(time)}, 6), one a look, got {aircraft.shape}"
        )
    return Looks(time, *model.linearize_probit(aircraft, np.asarray(radar, dtype=float)))


def cumulative_p_d(p_d: ArrayLike) -> FloatArray:
    """P_c (..., K) from P_D (..., K) of each look.

    Small probabilities are right to their own digits. Where P_D rounds to 1, so does P_c; what is
    left of 1 − P_c then is only to be had from probits, as `Looks.hazard`.
    """
    with np.errstate(divide="ignore"):  # ln(1 − 1) = −inf, and P_c is 1 from there on
        log_miss = np.log1p(-np.asarray(p_d, dtype=float))
    found: FloatArray = -np.expm1(np.cumsum(log_miss, axis=-1))
    return found


def cumulative_detection(
    looks: Looks,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    correlation_time: float,
    method: str = "probit",
    beta: float = 3.0,
) -> Cumulative:
    """P_c up to each look, with its uncertainty to first order, in time proportional to K.

    Args:
        looks: The looks.
        cov_aircraft: C_aa (6, 6), or (K, 6, 6) with one for each look.
        cov_radar: C_rr (4m, 4m) of the radars' errors, constant during the mission.
        correlation_time: τ [s] of the pose errors, from 0 to infinity.
        method: Name of the method, one of `METHODS`.
        beta: β > 0; the bounds are at Φ(−β) and Φ(β).

    Raises:
        ValueError: If there is no such method, a shape does not fit or a number is out of range.
    """
    hazard = np.cumsum(looks.hazard)
    # dh/dz = φ(z)/Φ(−z), the inverse of Mills' ratio, which is finite where 1 − P_D rounds to 0
    slope = _inverse_mills(looks.probit)
    variance = _pose_variance(looks, slope, cov_aircraft, correlation_time)
    by_radar = np.cumsum(slope[:, np.newaxis] * looks.by_radar, axis=0)
    std = np.sqrt(variance + variance_along(by_radar, cov_radar))
    # nothing has been seen yet: z is as low as any, and certain
    z = np.where(hazard == 0, -_FAR, -ndtri_exp(-hazard))
    found = _method(method, beta)(z, std * np.exp(-hazard), std / _inverse_mills(z), beta)
    return _certain(-np.expm1(-hazard), found, std)


def track_initiation(
    looks: Looks,
    m: int,
    n: int,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    correlation_time: float,
    sequence: NDArray[np.intp] | None = None,
    method: str = "probit",
    beta: float = 3.0,
) -> Cumulative:
    """Probability that m of n looks in a row have detected, with its uncertainty to first order.

    Where looks are of several sequences, it is that of m of n in one or more of them: a track that
    one radar has started is one of the network's, and looks of others that see nothing do not
    break it.

    Time and memory grow with K², since this is no sum over looks; 2000 looks take some 0.6 s.

    Args:
        looks: The looks.
        m: Detections needed.
        n: Looks in a row that they must be within, at most `MAX_WINDOW`.
        cov_aircraft: C_aa (6, 6), or (K, 6, 6) with one for each look.
        cov_radar: C_rr (4m, 4m) of the radars' errors, constant during the mission.
        correlation_time: τ [s] of the pose errors, from 0 to infinity.
        sequence: The sequence that each look is of (K,); None if all are of one.
        method: Name of the method, one of `METHODS`.
        beta: β > 0; the bounds are at Φ(−β) and Φ(β).

    Raises:
        ValueError: If there is no such method, a shape does not fit or a number is out of range.
    """
    p_d, miss = looks.p_d, ndtr(-looks.probit)
    p, left = _in_some(p_d, miss, m, n, sequence)
    # dP_D/dz = φ(z)
    slope = _by_each(p_d, miss, m, n, sequence) * _density(looks.probit)
    variance = _pose_variance(looks, slope, cov_aircraft, correlation_time)
    # Rows end with their own look: the partials for later ones are 0.
    std = np.sqrt(variance[..., -1] + variance_along(_sum_over(slope, looks.by_radar), cov_radar))
    # Before look m no track is possible, and later it may be so sure that nothing is left of φ(z).
    z = np.clip(np.where(p < 0.5, ndtri(p), -ndtri(left)), -_FAR, _FAR)
    std_z = np.where(abs(z) < _FAR, std / _density(z), 0.0)
    found = _method(method, beta)(z, std, std_z, beta)
    return _certain(p, found, std)


def _sum_over(slope: FloatArray, by_radar: FloatArray) -> FloatArray:
    """Sum slope (k, K) times partials (K, 4m) over the looks; 0 · NaN is 0, a look to come."""
    total: FloatArray = np.einsum("kj,ji->ki", slope, np.nan_to_num(by_radar))
    unknown = np.maximum.accumulate(np.isnan(by_radar), axis=0)
    return np.where(unknown, np.nan, total)


def linear(z: FloatArray, std: FloatArray, std_z: FloatArray, beta: float) -> Spread:
    """First order in the probability itself. Its bounds may leave [0, 1].

    On the flight that `probit` is judged by, σ of P_c is wrong by 3, 7 and 19 % at most, its bounds
    by 0.004, 0.010 and 0.036; for 3 of 5 by 2, 11 and 30 %, and by 0.007, 0.020 and 0.066.

    Args:
        z: Probit of the probability (K,).
        std: Standard deviation of the probability to first order (K,).
        std_z: Standard deviation of z to first order (K,).
        beta: β.
    """
    p = ndtr(z)
    return Spread(p, std, p - beta * std, p + beta * std)


def probit(z: FloatArray, std: FloatArray, std_z: FloatArray, beta: float) -> Spread:
    """First order in the probit of the probability: for one look the method of that name.

    Judged by 100,000 runs of 60 looks on a flight past the radar (as in the tests), with the levels
    Low, Medium and High of the paper and τ of 0, 100 s and infinity: σ of P_c, where above 0.001,
    is wrong by 0.7 % at most, the bounds by 0.004; for 3 of 5 looks σ by 1.0, 0.9 and 4.5 %, the
    bounds by 0.002, 0.004 and 0.014. The runs' own noise is some 0.2 % of σ, and 0.03 σ in a bound.
    """
    mean, deviation = probit_moments(z, std_z)
    return Spread(mean, deviation, ndtr(z - beta * std_z), ndtr(z + beta * std_z))


#: Methods: from z, σ, σ_z and β to mean, deviation and bounds.
METHODS: Mapping[str, Callable[[FloatArray, FloatArray, FloatArray, float], Spread]] = {
    "linear": linear,
    "probit": probit,
}


def m_of_n(p_d: ArrayLike, m: int, n: int) -> FloatArray:
    """Probability that some n looks in a row up to each look have had m detections or more.

    Given P_D the looks are independent, and the outcomes of the last n − 1 are the state of a
    Markov chain that success absorbs (J. C. Fu and M. V. Koutras, "Distribution theory
    of runs: a Markov chain approach", J. Amer. Statist. Assoc. 89, 1994); so this is exact. Before
    look n the window is what there has been.

    Args:
        p_d: P_D of each look (..., K).
        m: Detections needed, 1 to n.
        n: Looks in a row that they must be within, at most `MAX_WINDOW`.

    Returns:
        (..., K).

    Raises:
        ValueError: If m or n is out of range.
    """
    p_d = np.asarray(p_d, dtype=float)
    return _forwards(p_d, 1.0 - p_d, m, n)[0]


def m_of_n_gradient(p_d: ArrayLike, m: int, n: int) -> FloatArray:
    """Partials of `m_of_n` up to look k for P_D of look j, (K, K) by k and j.

    Args:
        p_d: P_D of each look (K,).
        m: Detections needed, 1 to n.
        n: Looks in a row that they must be within, at most `MAX_WINDOW`.

    Raises:
        ValueError: If m or n is out of range.
    """
    p_d = np.asarray(p_d, dtype=float)
    return _backwards(p_d, 1.0 - p_d, m, n)


def _forwards(p_d: FloatArray, miss: FloatArray, m: int, n: int) -> tuple[FloatArray, FloatArray]:
    """Probability of m of n up to each look, and what is left to 1, from P_D and 1 − P_D (..., K).

    Both are sums of what is not negative, so that each is right to its own digits.
    """
    detections = _histories(m, n)
    weight = np.zeros((len(detections), *p_d.shape[:-1]))
    weight[0] = 1.0
    found, left = np.empty(p_d.shape), np.empty(p_d.shape)
    total = np.zeros(p_d.shape[:-1])
    for k in range(p_d.shape[-1]):
        total = total + p_d[..., k] * weight[detections == m - 1].sum(axis=0)
        weight = _advanced(weight, p_d[..., k], miss[..., k], detections, m)
        found[..., k], left[..., k] = total, weight.sum(axis=0)
    return found, left


def _backwards(p_d: FloatArray, miss: FloatArray, m: int, n: int) -> FloatArray:
    """Partials (K, K) of `m_of_n`, from P_D and 1 − P_D (K,).

    Forwards goes the probability of every history before look j, backwards that of success by look
    k from every history after it; the partial is the difference that a detection at j makes to it.
    Where success is likely, it is the probability of failure that goes backwards, lest the
    difference be one of two numbers near 1.
    """
    detections = _histories(m, n)
    looks, states = len(p_d), len(detections)
    before = np.zeros((looks, states))
    weight = np.zeros(states)
    weight[0] = 1.0
    found = np.zeros(looks)
    for j in range(looks):
        before[j] = weight
        found[j] = found[j - 1] + p_d[j] * weight[detections == m - 1].sum()
        weight = _advanced(weight, p_d[j], miss[j], detections, m)
    likely = found > 0.5
    after_miss = (2 * np.arange(states)) % states
    after_hit = (after_miss + 1) % states
    gradient = np.zeros((looks, looks))
    later = np.repeat(np.where(likely, 1.0, 0.0)[:, np.newaxis], states, axis=1)
    on_success = np.where(likely, 0.0, 1.0)[:, np.newaxis]
    sign = np.where(likely, -1.0, 1.0)
    for j in range(looks - 1, -1, -1):
        hit = np.where(detections == m - 1, on_success[j:], later[j:, after_hit])
        missed = later[j:, after_miss]
        gradient[j:, j] = sign[j:] * np.sum((hit - missed) * before[j], axis=1)
        later[j:] = p_d[j] * hit + miss[j] * missed
    return gradient


def _in_some(
    p_d: FloatArray, miss: FloatArray, m: int, n: int, sequence: NDArray[np.intp] | None
) -> tuple[FloatArray, FloatArray]:
    """As `_forwards`, the probability of m of n in one sequence of looks or more.

    Given the states the sequences are independent: 1 − T = Π (1 − T_s), with each T_s that of the
    last look of its sequence.
    """
    if sequence is None:
        return _forwards(p_d, miss, m, n)
    found, left = np.zeros(p_d.shape), np.ones(p_d.shape)
    for mine, latest in _sequences(sequence):
        own, rest = _forwards(p_d[..., mine], miss[..., mine], m, n)
        begun = latest >= 0
        found += left * np.where(begun, own[..., latest], 0.0)
        left *= np.where(begun, rest[..., latest], 1.0)
    return found, left


def _by_each(
    p_d: FloatArray, miss: FloatArray, m: int, n: int, sequence: NDArray[np.intp] | None
) -> FloatArray:
    """Partials (K, K) of `_in_some`: ∂T/∂P_j = ∂T_s/∂P_j Π (1 − T_r) over the other sequences r."""
    if sequence is None:
        return _backwards(p_d, miss, m, n)
    every = _sequences(sequence)
    lefts = [
        np.where(latest >= 0, _forwards(p_d[mine], miss[mine], m, n)[1][latest], 1.0)
        for mine, latest in every
    ]
    gradient = np.zeros((len(p_d), len(p_d)))
    for i, (mine, latest) in enumerate(every):
        others = np.prod([left for j, left in enumerate(lefts) if j != i], axis=0)
        own = _backwards(p_d[mine], miss[mine], m, n)
        gradient[:, mine] = np.where(
            latest[:, np.newaxis] >= 0, np.reshape(others, (-1, 1)) * own[latest], 0.0
        )
    return gradient


def _sequences(
    sequence: NDArray[np.intp],
) -> list[tuple[NDArray[np.bool_], NDArray[np.intp]]]:
    """Of each sequence: which looks are its own (K,), and its latest by each look (K,), or −1."""
    return [(mine, np.cumsum(mine) - 1) for mine in (sequence == s for s in np.unique(sequence))]


def _histories(m: int, n: int) -> NDArray[np.intp]:
    """Number of detections in each history of the last n − 1 looks, the latest the lowest bit."""
    if not 1 <= m <= n <= MAX_WINDOW:
        raise ValueError(f"m of n must have 1 <= m <= n <= {MAX_WINDOW}, got {m} of {n}")
    return np.array([state.bit_count() for state in range(2 ** (n - 1))])


def _advanced(
    weight: FloatArray, p_d: FloatArray, miss: FloatArray, detections: NDArray[np.intp], m: int
) -> FloatArray:
    """Probability of each history (states, ...) one look later, without success so far."""
    states = len(detections)
    if states == 1:  # m = n = 1: there is nothing to remember, and any detection is success
        return weight * miss
    going_on = weight.copy()
    going_on[detections >= m - 1] = 0.0
    later = np.empty_like(weight)
    # The oldest outcome, the highest bit, is forgotten; the new one becomes the lowest.
    later[0::2] = (weight[: states // 2] + weight[states // 2 :]) * miss
    later[1::2] = (going_on[: states // 2] + going_on[states // 2 :]) * p_d
    return later


class Drawn(NamedTuple):
    """Statistics of draws at each look, each (K,); the bounds are quantiles."""

    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True, eq=False)
class Mission:
    """What draws of a whole mission show.

    Attributes:
        runs: Number of runs.
        seed: Seed of the draws.
        detection: P_c up to each look.
        track: Probability of m-of-n up to each look, if it was asked for.
        clipped: Number of radar constants that were drawn below zero and set to zero.
        rank_error: By how many of the sorted draws the bounds are off at most; 0 where exact.
    """

    runs: int
    seed: int
    detection: Drawn
    track: Drawn | None
    clipped: int
    rank_error: int


@dataclass(frozen=True, eq=False)
class _Runs:
    """The runs of a mission, a block at a time."""

    model: Model
    aircraft: FloatArray
    radar: FloatArray
    factors: FloatArray
    factor_radar: FloatArray
    decay: FloatArray
    fresh: FloatArray
    m_of_n: tuple[int, int] | None
    runs: int
    runs_per_block: int
    seed: int
    tail: float
    draws: RadarDraws | None = None
    sequence: NDArray[np.intp] | None = None

    def statistics(self, index: int) -> tuple[list[tuple[RunningMoments, Tails]], int]:
        """Draw a block of runs and keep what is needed of it."""
        generator = random_stream(self.seed, index)
        looks, width = len(self.aircraft), self.runs_per_block
        # All of the block is drawn, so that more runs begin with the same ones.
        normals = _radar_normals(self.radar, self.draws)
        white_radar = generator.standard_normal((width, normals))
        white = generator.standard_normal((looks, len(AIRCRAFT), width))
        runs = min(width, self.runs - index * width)
        radar, clipped = _drawn(self.radar, self.factor_radar, self.draws, white_radar[:runs])
        p_d = self.model.p_d(self._poses(white[..., :runs]), radar).T
        parts = []
        tracks = [_in_some(p_d, 1.0 - p_d, *self.m_of_n, self.sequence)[0]] if self.m_of_n else []
        for rows in (_accumulated(p_d), *tracks):
            moments, tails = RunningMoments(looks), Tails(looks, self.runs, self.tail)
            moments.add(rows)
            tails.add(rows)
            parts.append((moments, tails))
        return parts, clipped

    def _poses(self, white: FloatArray) -> FloatArray:
        """Aircraft states (K, runs, 6) from independent unit normals (K, 6, runs), overwritten."""
        for k in range(1, len(white)):
            white[k] *= self.fresh[k - 1]
            white[k] += self.decay[k - 1] * white[k - 1]
        states = np.empty((len(AIRCRAFT), len(white), white.shape[-1]))
        for i, state in enumerate(states):
            state[:] = self.aircraft[:, i, np.newaxis]
            for j in range(len(AIRCRAFT)):
                weight = self.factors[:, i, j, np.newaxis]
                if weight.any():
                    state += weight * white[:, j]
        return np.moveaxis(states, 0, -1)


def mission_monte_carlo(
    model: Model,
    time: ArrayLike,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    correlation_time: float,
    runs: int,
    seed: int,
    m_of_n: tuple[int, int] | None = None,
    sequence: NDArray[np.intp] | None = None,
    beta: float = 3.0,
    radar_draws: RadarDraws | None = None,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> Mission:
    """Draw whole missions: the radars once a run, poses whose errors are correlated in time.

    Args:
        model: The model.
        time: Times of the looks (K,) [s], which do not decrease.
        aircraft: Nominal aircraft states (K, 6).
        radar: Nominal states of the radars (4m,).
        cov_aircraft: C_aa (6, 6), or (K, 6, 6) with one for each look.
        cov_radar: C_rr (4m, 4m).
        correlation_time: τ [s] of the pose errors, from 0 to infinity.
        runs: Number of runs, two or more.
        seed: Seed of the draws.
        m_of_n: m and n, to have the probability of m-of-n too.
        sequence: The sequence that each look is of (K,), as `track_initiation` has it.
        beta: β > 0; the quantiles are at Φ(−β) and Φ(β).
        radar_draws: Draws the radars in place of a Gaussian with C_rr.
        workers: Threads to compute with; of no influence on the result.
        executor: Computes in place of threads; of no influence on the result.
        progress: Called with the number of runs that have come in since the last call.

    Raises:
        ValueError: If a shape does not fit or a number is out of range.
    """
    time, aircraft, radar = _times(time), np.asarray(aircraft, float), np.asarray(radar, float)
    if aircraft.shape != (len(time), len(AIRCRAFT)) or radar.ndim != 1:
        raise ValueError(
            f"aircraft and radar states must have shapes ({len(time)}, 6) and (4m,), "
            f"got {aircraft.shape} and {radar.shape}"
        )
    if runs < 2 or not 0 < beta < math.inf:
        raise ValueError(f"needs 2 runs or more and beta > 0, got {runs} and {beta}")
    if m_of_n is not None:
        _histories(*m_of_n)
    decay, fresh = _correlation(time, correlation_time)
    poses = len(time)
    blocks = _Runs(
        model=model,
        aircraft=aircraft,
        radar=radar,
        factors=_factors(cov_aircraft, poses),
        factor_radar=factor(np.asarray(cov_radar, dtype=float)),
        decay=decay,
        fresh=fresh,
        m_of_n=m_of_n,
        runs=runs,
        runs_per_block=max(1, SAMPLES_PER_BLOCK // poses),
        seed=seed,
        tail=float(ndtr(-beta)),
        draws=radar_draws,
        sequence=sequence,
    )
    events = 1 if m_of_n is None else 2
    total = [(RunningMoments(poses), Tails(poses, runs, blocks.tail)) for _ in range(events)]
    clipped = 0
    count = -(-runs // blocks.runs_per_block)
    for parts, negative in in_order(blocks.statistics, count, workers, executor):
        for (moments, tails), (more, ends) in zip(total, parts, strict=True):
            moments.merge(more)
            tails.merge(ends)
        clipped += negative
        if progress:
            progress(parts[0][0].count)
    found = [Drawn(moments.mean, moments.std(), *tails.quantiles()) for moments, tails in total]
    return Mission(
        runs=runs,
        seed=seed,
        detection=found[0],
        track=found[1] if m_of_n else None,
        clipped=clipped,
        rank_error=max(tails.rank_error for _, tails in total),
    )


def extremes(
    model: Model,
    aircraft: FloatArray,
    radar: FloatArray,
    cov_radar: FloatArray,
    *,
    m_of_n: tuple[int, int] | None = None,
    sequence: NDArray[np.intp] | None = None,
    beta: float = 3.0,
    radar_draws: RadarDraws | None = None,
) -> list[tuple[FloatArray, FloatArray]]:
    """Least and greatest P when one error of the radars alone is β of its deviations off.

    An error is a column of F, F Fᵀ = C_rr: a component of a radar's state where these are
    independent. With probability Φ(−β) it is larger yet. So a bound at Φ(β) should not be within
    them where P only grows with the error, and the other errors move it up as well as down. They
    need no gradient.

    Args:
        model: The model.
        aircraft: Nominal aircraft states (K, 6).
        radar: Nominal states of the radars (4m,).
        cov_radar: C_rr (4m, 4m).
        m_of_n: m and n, to have those of m-of-n too.
        sequence: The sequence that each look is of (K,), as `track_initiation` has it.
        beta: β.
        radar_draws: Makes the radars of their unit normals, as it draws them, in place of a
            Gaussian with C_rr; each normal is then an error.

    Returns:
        For P_c, and for m-of-n if asked for: least and greatest (K,) up to each look.
    """
    found: list[tuple[FloatArray, FloatArray]] = []
    white, root = beta * np.eye(_radar_normals(radar, radar_draws)), factor(cov_radar)
    every = np.stack([_drawn(radar, root, radar_draws, u)[0] for u in (-white, white)], axis=1)
    for states in every:
        p_d = model.p_d(aircraft[:, np.newaxis], states).T
        events = [cumulative_p_d(p_d)]
        if m_of_n is not None:
            events.append(_in_some(p_d, 1.0 - p_d, *m_of_n, sequence)[0])
        ends = [(rows.min(axis=0), rows.max(axis=0)) for rows in events]
        found = found or ends
        found = [
            (np.minimum(low, a), np.maximum(high, b))
            for (low, high), (a, b) in zip(found, ends, strict=True)
        ]
    return found


def _radar_normals(radar: FloatArray, radar_draws: RadarDraws | None) -> int:
    """Unit normals that a draw of the radars takes."""
    return radar_draws.radar_normals if radar_draws else len(radar)


def _drawn(
    radar: FloatArray, root: FloatArray, radar_draws: RadarDraws | None, white: FloatArray
) -> tuple[FloatArray, int]:
    """Radar states (runs, 4m) from unit normals, and how many constants were set to zero."""
    if radar_draws:
        states, negative = radar_draws.draw_radar(white)
        return states, int(np.count_nonzero(negative))
    states = draws(radar, root, white)
    constants = states[:, CONSTANTS]
    clipped = int(np.count_nonzero(constants < 0))
    constants[constants < 0] = 0.0
    return states, clipped


def _accumulated(p_d: FloatArray) -> FloatArray:
    """P_c (runs, K) from P_D (runs, K), as sums of what is not negative: no digits are lost."""
    found = np.empty(p_d.shape)
    total = np.zeros(len(p_d))
    for k in range(p_d.shape[1]):
        total += (1.0 - total) * p_d[:, k]
        found[:, k] = total
    return found


def _pose_variance(
    looks: Looks, slope: FloatArray, cov_aircraft: ArrayLike, correlation_time: float
) -> FloatArray:
    """Variance (..., K), up to each look, of Σ slope_j z_j from the errors of the poses.

    With a_j = slope_j F_jᵀ ∂z_j/∂x and ρ_ij the correlation of looks i and j it is the double sum
    V_k = Σ_{i,j≤k} a_i·a_j ρ_ij. As ρ_ik = ρ_ij ρ_jk for times i, j, k in order,
    A_k = Σ_{i≤k} ρ_ik a_i = ρ_{k−1,k} A_{k−1} + a_k and V_k = V_{k−1} + a_k·(2 A_k − a_k).
    """
    factors = _factors(cov_aircraft, len(looks.time))
    # A gradient may be undefined where nothing is uncertain: 0 · NaN is no uncertainty here.
    partials = np.where(np.any(factors != 0, axis=-1), looks.by_aircraft, 0.0)
    weights = np.einsum("kij,ki->kj", factors, partials)
    decay, _ = _correlation(looks.time, correlation_time)
    variance = np.zeros(slope.shape)
    along, total = np.zeros((*slope.shape[:-1], len(AIRCRAFT))), np.zeros(slope.shape[:-1])
    for k, weight in enumerate(weights):
        if k:
            along = decay[k - 1] * along
        step = slope[..., k, np.newaxis] * weight
        if slope.ndim > 1:  # a look to come has no part in what is before it, be it undefined
            step[:k] = 0.0
        along = along + step
        total = total + np.sum(step * (2.0 * along - step), axis=-1)
        variance[..., k] = total
    # a double sum of a semidefinite kernel can round to just below zero
    return np.maximum(variance, 0.0)


def _correlation(time: FloatArray, correlation_time: float) -> tuple[FloatArray, FloatArray]:
    """Correlation ρ (K − 1,) of each look's pose error with the next, and √(1 − ρ²)."""
    if not correlation_time >= 0:
        raise ValueError(f"correlation time must not be negative, got {correlation_time}")
    step = np.diff(time)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x = np.where(step > 0, step / correlation_time, 0.0)  # one time, one pose: also at τ = 0
    return np.exp(-x), np.sqrt(-np.expm1(-2.0 * x))


def _factors(cov_aircraft: ArrayLike, looks: int) -> FloatArray:
    """Symmetric factors (K, 6, 6) of C_aa."""
    covariance = np.asarray(cov_aircraft, dtype=float)
    n = len(AIRCRAFT)
    if covariance.shape not in ((n, n), (looks, n, n)):
        raise ValueError(
            f"aircraft covariance must have shape (6, 6) or ({looks}, 6, 6), got {covariance.shape}"
        )
    return np.broadcast_to(symmetric_factor(covariance), (looks, n, n))


def _times(time: ArrayLike) -> FloatArray:
    time = np.asarray(time, dtype=float)
    if time.ndim != 1 or not time.size or not np.isfinite(time).all() or np.any(np.diff(time) < 0):
        raise ValueError("times of looks must be finite numbers (K,) that do not decrease")
    return time


def _method(
    name: str, beta: float
) -> Callable[[FloatArray, FloatArray, FloatArray, float], Spread]:
    if name not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {name!r}")
    if not 0 < beta < math.inf:
        raise ValueError(f"beta must be positive, got {beta}")
    return METHODS[name]


def _certain(p: FloatArray, found: Spread, std: FloatArray) -> Cumulative:
    """Return the moments with exact values where no state is uncertain, in time order.

    P never decreases along a mission, whatever the states are. So a lower bound holds at all later
    looks too, and an upper bound at all earlier ones. Neither do mean and nominal P decrease.
    """
    mean, deviation, lower, upper = found
    known = std == 0
    mean, lower, upper = (np.where(known, p, values) for values in (mean, lower, upper))
    earlier = np.fmin.accumulate(upper[::-1])[::-1]
    return Cumulative(
        p=np.maximum.accumulate(p),
        mean=np.maximum.accumulate(mean),
        std=np.where(known, 0.0, deviation),
        lower=np.maximum.accumulate(lower),
        upper=np.where(np.isnan(upper), np.nan, earlier),
    )


def _inverse_mills(z: FloatArray) -> FloatArray:
    """φ(z)/Φ(−z) (...), finite in both tails."""
    found: FloatArray = _ROOT_2_OVER_PI / erfcx(z / _SQRT_2)
    return found


def _density(z: FloatArray) -> FloatArray:
    """φ(z) (...)."""
    found: FloatArray = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return found
