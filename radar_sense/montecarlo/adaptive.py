"""Whether a method of propagation may be trusted: its verdict by Monte Carlo, pose by pose.

The procedure is that of JCGM 101:2008 (Supplement 1 to the "Guide to the expression of uncertainty
in measurement"). Clause 7.9: draw batch after batch until mean, standard deviation and both ends of
the coverage interval are stable to a numerical tolerance δ, which follows from the number of digits
of the standard deviation that matter. Clause 8: the method is validated where both ends of its
interval are within δ of those of the draws.

Every pose has its own δ and stops on its own. A batch at a pose has a random stream of its own, and
the radar states of a batch, which all poses share, have another; so what is found at a pose depends
neither on when the others stop nor on who computes what.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from radar_sense.errors import ScenarioError
from radar_sense.limits import RUNS, Limit
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import random_stream
from radar_sense.montecarlo.statistics import binomial_interval
from radar_sense.propagation import Moments, check_method, propagate_scenario
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, FloatArray

#: Keeps the random streams apart from those of `monte_carlo`. Part of the result's definition.
STREAM = 101
#: 7.9.4 b): a batch has at least so many draws, and so many outside the interval on average.
LEAST_DRAWS = 10_000
LEAST_OUTSIDE = 100
#: Rounding of P_D, as a share of it. No tolerance is finer, and a spread below it is none.
ROUNDING = 1e-13
#: Numbers kept at a time for the quantiles of all draws (256 MB), which limits the poses in work.
MAX_KEPT = 32_000_000
DIGITS = Limit(at_least=1, at_most=4, whole=True)
#: At 4 a batch has 1.6 million draws; at 5 it would have 174 million.
BETA = Limit(above=0, at_most=4)
FRACTION = Limit(above=0, at_most=1)
MAX_RUNS = 20_000_000


@dataclass(frozen=True, eq=False)
class Validation:
    """What a method says of P_D at each of n poses, what the draws say, and whether they agree.

    Attributes:
        method: Name of the method.
        digits: Significant digits of the standard deviation that matter, n_dig of 7.9.2.
        beta: The interval reaches from Φ(−β) to Φ(β).
        fraction: Part of δ that the draws had to be stable to.
        seed: Seed of the draws.
        runs: Draws used (n,).
        delta: Numerical tolerance δ of P_D (n,).
        moments: What the method says.
        mc_mean: Mean of the draws (n,).
        mc_std: Standard deviation of the draws (n,).
        mc_lower: Quantile of the draws at Φ(−β) (n,).
        mc_upper: Quantile of the draws at Φ(β) (n,).
        distance_lower: Distance of the method's lower bound from that of the draws (n,).
        distance_upper: Distance of the method's upper bound from that of the draws (n,).
        stable: Where the draws became stable within the runs allowed (n,).
        validated: Where they did and both distances are within δ (n,).
        refuted: Where they did and a distance is beyond δ by more than the draws can explain (n,).
        inside: Number of draws within the method's bounds (n,); NaN where it has none.
        clipped: Number of runs whose radar constant was drawn below zero and set to zero, of the
            runs of the pose that took the most.
    """

    method: str
    digits: int
    beta: float
    fraction: float
    seed: int
    runs: NDArray[np.int64]
    delta: FloatArray
    moments: Moments
    mc_mean: FloatArray
    mc_std: FloatArray
    mc_lower: FloatArray
    mc_upper: FloatArray
    distance_lower: FloatArray
    distance_upper: FloatArray
    stable: NDArray[np.bool_]
    validated: NDArray[np.bool_]
    refuted: NDArray[np.bool_]
    inside: FloatArray
    clipped: int

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """Where the runs allowed were too few to tell (n,)."""
        return ~self.validated & ~self.refuted

    @property
    def verdict(self) -> str:
        """One word for all poses: refuted if it is anywhere, else undecided, else validated."""
        if np.any(self.refuted):
            return "refuted"
        return "undecided" if np.any(self.undecided) else "validated"

    @property
    def coverage(self) -> FloatArray:
        """Share of the draws within the method's bounds (n,)."""
        return self.inside / self.runs

    def coverage_interval(self, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Ends of the binomial confidence interval of the coverage, each (n,)."""
        return binomial_interval(self.inside, self.runs, confidence)


def validate(
    scenario: Scenario,
    *,
    method: str = "linear",
    digits: int = 2,
    beta: float = 3.0,
    fraction: float = 1.0,
    max_runs: int = MAX_RUNS,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Validation:
    """Compare the interval of a method with that of Monte Carlo, drawn until it is stable.

    Stable means that twice the standard error of mean, standard deviation and interval ends is
    within `fraction` of δ, 7.9.4. With a fraction of 1 the draws themselves may still be off by
    more than δ: at up to 15 % of the poses, by simulation. Clause 8.2 therefore asks for 1/5 where
    a method is to be validated, which takes some 25 times as many draws. Less will do here, because
    a pose where a distance is beyond δ by no more than its standard error can explain is not
    refuted but drawn at until it is one or the other. What is left is that a method that is off by
    a little over δ may be validated by luck; the smaller the fraction, the smaller that little.

    Args:
        scenario: What to draw, at its level and with its seed.
        method: A name in `propagation.METHODS`.
        digits: Significant digits of the standard deviation that matter, 1 to 4. Each one more
            takes some 100 times as many draws.
        beta: The interval reaches from Φ(−β) to Φ(β).
        fraction: Part of δ that the draws are to be stable to, up to 1.
        max_runs: Draws after which a pose is given up as undecided.
        workers: Threads to compute with; of no influence on the result.
        progress: Called after every batch with the number of poses that have come to an end, stable
            or given up, since the last call; together these are all poses.

    Raises:
        ScenarioError: If there is no such method or a number is not allowed.
    """
    check_method(method)
    for name, value, limit in (
        ("digits", digits, DIGITS),
        ("beta", beta, BETA),
        ("fraction", fraction, FRACTION),
        ("max_runs", max_runs, RUNS),
    ):
        if not limit.allows(value):
            raise ScenarioError(f"{name} must be {limit}, got {value}")
    digits, max_runs = int(digits), int(max_runs)  # 2.0 is a whole number too
    batches = _Batches.of(scenario, beta)
    # 7.9.4 f): a single batch does not show how stable it is
    if max_runs < 2 * batches.draws:
        raise ScenarioError(
            f"max_runs must be at least {2 * batches.draws}, two batches for a beta of {beta:g}, "
            f"got {max_runs}"
        )
    moments = propagate_scenario(scenario, method=method, beta=beta)
    most = max_runs // batches.draws
    together = max(1, MAX_KEPT // (2 * batches.kept * most))
    found = np.zeros(len(scenario.aircraft), dtype=_FOUND)
    clipped: dict[int, int] = {}
    with _mapping(workers) as mapping:
        for first in range(0, len(found), together):
            active = [_Pose(i, moments) for i in range(first, min(first + together, len(found)))]
            for number in range(most):
                radar, clipped[number] = batches.radar(number)
                drawn = mapping(partial(batches.draw, number, radar), active)
                for pose, batch in zip(active, drawn, strict=True):
                    pose.batches.append(batch)
                left = []
                for pose in active:
                    delta, errors, stable = pose.stability(batches.draws, digits, fraction)
                    if not stable and number < most - 1:
                        left.append(pose)
                        continue
                    summary = pose.summary(batches)
                    verdict = pose.verdict(summary[3:5], delta, errors[2:]) if stable else UNDECIDED
                    if verdict == UNDECIDED and number < most - 1:
                        left.append(pose)
                    else:
                        found[pose.index] = (*summary, delta, stable, verdict)
                if progress:
                    progress(len(active) - len(left))
                active = left
                if not active:
                    break
    return Validation(
        method=method,
        digits=digits,
        beta=float(beta),
        fraction=float(fraction),
        seed=scenario.seed,
        runs=found["runs"],
        delta=found["delta"],
        moments=moments,
        mc_mean=found["mean"],
        mc_std=found["std"],
        mc_lower=found["lower"],
        mc_upper=found["upper"],
        distance_lower=abs(moments.lower - found["lower"]),
        distance_upper=abs(moments.upper - found["upper"]),
        stable=found["stable"],
        validated=found["verdict"] == VALIDATED,
        refuted=found["verdict"] == REFUTED,
        inside=np.where(np.isnan(moments.lower + moments.upper), np.nan, found["inside"]),
        clipped=sum(clipped.values()),
    )


def numerical_tolerance(std: float, digits: int) -> float:
    """δ of 7.9.2: half a unit in the last of the digits of a standard deviation that matter.

    Rounded to n_dig digits the deviation is c · 10^l with a whole number c of n_dig digits; then
    δ = ½ · 10^l. A deviation of 0 has no digits, and gives 0; NaN gives NaN.
    """
    if std == 0 or math.isnan(std):
        return std
    # Formatting rounds before it takes the exponent: 0.0996 to two digits is 0.10, l = −2.
    exponent = int(f"{std:.{digits - 1}e}".partition("e")[2])
    return float(f"5e{exponent - digits}")


@dataclass(frozen=True, eq=False)
class _Batch:
    """What is kept of a batch of draws at one pose.

    Attributes:
        estimates: Mean, standard deviation, lower and upper quantile (4,).
        ends: The smallest and the largest draws, all that the quantiles depend on.
        inside: Number of draws within the method's bounds.
    """

    estimates: FloatArray
    ends: FloatArray
    inside: int


@dataclass(frozen=True, eq=False)
class _Batches:
    """All that a batch is drawn from.

    Attributes:
        sampler: Draws states, computes P_D.
        seed: Seed of all batches.
        tail: Probability beyond either end of the interval.
        draws: Draws of a batch, M of 7.9.4.
        kept: How many of the smallest draws of a batch are kept, and of the largest.
    """

    sampler: Sampler
    seed: int
    tail: float
    draws: int
    kept: int

    @classmethod
    def of(cls, scenario: Scenario, beta: float) -> _Batches:
        tail = float(ndtr(-beta))
        # 7.9.4 b): 1 − p is the probability of both tails together.
        draws = max(LEAST_DRAWS, math.ceil(LEAST_OUTSIDE / (2 * tail)))
        # Of the draws beyond the quantile of many batches a single one has `expected` on average
        # and by chance this many once in 10^13 times or less.
        expected = draws * tail
        kept = math.ceil(expected + 8 * math.sqrt(expected) + 8)
        return cls(Sampler.of(scenario), scenario.seed, tail, draws, min(kept, draws))

    def radar(self, number: int) -> tuple[FloatArray, int]:
        """Radar states of a batch (draws, 4m), and in how many a constant was set to zero."""
        white = self._stream(number, 0).standard_normal((self.draws, self.sampler.radar_normals))
        radar, negative = self.sampler.draw_radar(white)
        return radar, int(np.count_nonzero(negative))

    def p_d(self, number: int, radar: FloatArray, pose: int) -> FloatArray:
        """P_D of a batch at a pose (draws,)."""
        white = self._stream(number, 1 + pose).standard_normal((len(AIRCRAFT), self.draws, 1))
        return self.sampler.draw_p_d(np.moveaxis(white, 0, -1), radar, slice(pose, pose + 1))[:, 0]

    def draw(self, number: int, radar: FloatArray, pose: _Pose) -> _Batch:
        """Draw a batch at a pose and keep what is needed of it."""
        p_d = self.p_d(number, radar, pose.index)
        ends = p_d
        if 2 * self.kept < self.draws:
            parts = np.partition(p_d, [self.kept - 1, self.draws - self.kept])
            ends = np.concatenate([parts[: self.kept], parts[-self.kept :]])
        inside = np.count_nonzero((p_d >= pose.lower) & (p_d <= pose.upper))
        low, high = self.quantiles([ends])
        return _Batch(np.array([p_d.mean(), p_d.std(ddof=1), low, high]), ends, int(inside))

    def quantiles(self, ends: list[FloatArray]) -> tuple[float, float]:
        """Quantiles of all draws of some batches, from their ends alone."""
        values = np.sort(np.concatenate(ends))
        position = (len(ends) * self.draws - 1) * self.tail
        # the ranks from either end are those among all draws, so far as they are needed here
        low, high = (
            float(np.interp(position, np.arange(len(values)), rising))
            for rising in (values, -values[::-1])
        )
        return low, -high

    def _stream(self, *key: int) -> np.random.Generator:
        return random_stream(self.seed, STREAM, *key)


#: Confidence that a distance is beyond δ for a method to be refuted: that of 3 standard errors.
CONFIDENCE = float(ndtr(3.0))
UNDECIDED, VALIDATED, REFUTED = range(3)
#: What is found at a pose, in the order of `_Pose.summary`, `stability` and `verdict`.
_FOUND = np.dtype(
    [
        ("runs", np.int64),
        ("mean", np.float64),
        ("std", np.float64),
        ("lower", np.float64),
        ("upper", np.float64),
        ("inside", np.float64),
        ("delta", np.float64),
        ("stable", np.bool_),
        ("verdict", np.int8),
    ]
)


class _Pose:
    """The batches drawn so far at one pose."""

    def __init__(self, index: int, moments: Moments) -> None:
        self.index = index
        # A method that comes to the same value by another way may differ in its last digit.
        self.bounds = np.array([moments.lower[index], moments.upper[index]])
        slack = ROUNDING * abs(moments.p_d[index])
        self.lower = moments.lower[index] - slack
        self.upper = moments.upper[index] + slack
        self.batches: list[_Batch] = []

    def stability(self, draws: int, digits: int, fraction: float) -> tuple[float, FloatArray, bool]:
        """δ, the standard errors of mean, deviation and quantiles, and whether they are stable."""
        mean, std = self._moments(draws)
        # 7.9.4 i), j): u(y) from all draws, and δ from it
        delta = np.maximum(numerical_tolerance(std, digits), ROUNDING * abs(mean))
        if len(self.batches) < 2:
            return delta, np.full(4, np.nan), False
        # 7.9.4 g), h): standard deviations of the averages over the batches
        estimates = np.array([batch.estimates for batch in self.batches])
        errors = estimates.std(axis=0, ddof=1) / math.sqrt(len(estimates))
        # 7.9.4 k), with the δ/5 of 8.2 if the fraction is 1/5
        return delta, errors, bool(np.all(2 * errors <= fraction * delta))

    def verdict(self, ends: tuple[float, float], delta: float, errors: FloatArray) -> int:
        """Whether the method's bounds are those of the draws, 8.1, once these are stable."""
        distances = abs(self.bounds - ends)
        if np.all(distances <= delta):
            return VALIDATED
        # Two batches can agree by chance; Student's t knows how little their spread says. But among
        # hundreds of poses there are two that agree so well that even t is taken in: not so three.
        if len(self.batches) < 3 and np.isfinite(distances).all():
            return UNDECIDED
        doubt = stdtrit(len(self.batches) - 1, CONFIDENCE)
        # written so that a method without a result, a NaN, is refuted
        return UNDECIDED if np.all(distances <= delta + doubt * errors) else REFUTED

    def summary(self, batches: _Batches) -> tuple[int, float, float, float, float, int]:
        """Runs, mean, standard deviation, quantiles and draws inside, 7.9.4 l): of all draws.

        The averages of the batches' quantiles would be off by some 0.003 standard deviations, 1/M
        of what a quantile depends on; those of all draws are off by as much less as there are
        batches.
        """
        return (
            len(self.batches) * batches.draws,
            *self._moments(batches.draws),
            *batches.quantiles([batch.ends for batch in self.batches]),
            sum(batch.inside for batch in self.batches),
        )

    def _moments(self, draws: int) -> tuple[float, float]:
        """Mean and standard deviation of all draws of all batches, which are of one size."""
        means, stds = np.array([batch.estimates[:2] for batch in self.batches]).T
        mean = float(means.mean())
        squares = (draws - 1) * np.sum(stds**2) + draws * np.sum((means - mean) ** 2)
        return mean, math.sqrt(squares / (draws * len(means) - 1))


#: Applies a function to many things, in their order.
_Mapping: TypeAlias = Callable[[Callable[["_Pose"], _Batch], Iterable["_Pose"]], Iterable[_Batch]]


@contextmanager
def _mapping(workers: int) -> Iterator[_Mapping]:
    if workers == 1:
        yield map
        return
    with ThreadPoolExecutor(workers) as executor:
        yield executor.map
