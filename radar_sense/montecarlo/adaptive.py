"""Adaptive Monte Carlo, and the verdict on a method of propagation, pose by pose.

The procedure follows JCGM 101:2008 (Supplement 1 to the "Guide to the expression of uncertainty in
measurement"). By clause 7.9, batches are drawn until mean, standard deviation and both ends of the
coverage interval are stable to a numerical tolerance. The tolerance δ follows from the number of
significant digits of the standard deviation. By clause 8, the method is validated where both ends
of its interval are within δ of the ends by Monte Carlo.

Every pose has its own δ and its own number of batches. Each batch at a pose has its own random
stream. The radar states of a batch, shared by all poses, have another stream. The result at a pose
therefore does not depend on the other poses, or on the number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from radar_sense.limits import Limit, check_number
from radar_sense.montecarlo.montecarlo import BETA, ROUNDING
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.statistics import (
    DrawStatistics,
    binomial_interval,
    tail_quantiles,
    tail_share,
)
from radar_sense.propagation import Moments, check_method, propagate_scenario
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, FloatArray
from radar_sense.streams import Stream, random_stream

#: 7.9.4 b): least number of draws of a batch, and least expected number outside the interval.
LEAST_DRAWS = 10_000
LEAST_OUTSIDE = 100
#: Limit of the numbers kept for the quantiles (256 MB), which limits the poses drawn together.
MAX_KEPT = 32_000_000
DIGITS = Limit(at_least=1, at_most=4, whole=True)
#: Tolerance of the stability, as a part of δ.
FRACTION = 1.0
#: Draws after which a pose is undecided. Stability needs two batches or more, 7.9.4 f).
MAX_RUNS = 20_000_000


@dataclass(frozen=True, eq=False, repr=False)
class Validation:
    """Moments of P_D at each of n poses by a method and by Monte Carlo, with the verdict.

    Attributes:
        method: Name of the method.
        digits: Significant digits of the standard deviation, n_dig of 7.9.2.
        seed: Seed of the draws.
        runs: Draws used (n,).
        delta: Numerical tolerance δ of P_D (n,).
        moments: Moments by the method.
        draws: Statistics of the draws, with quantiles at Φ(−3) and Φ(3).
        distance_lower: Distance between the lower bounds by the method and the draws (n,).
        distance_upper: Distance between the upper bounds by the method and the draws (n,).
        stable: Where the draws became stable within the runs allowed (n,).
        validated: Where the draws are stable and both distances are within δ (n,).
        refuted: Where the draws are stable and a distance exceeds δ significantly (n,).
        inside: Number of draws within the method's bounds (n,); NaN without bounds.
        clipped: Number of runs with a radar constant drawn below zero and set to zero, at the
            pose with the most runs.
    """

    method: str
    digits: int
    seed: int
    runs: NDArray[np.int64]
    delta: FloatArray
    moments: Moments
    draws: DrawStatistics
    distance_lower: FloatArray
    distance_upper: FloatArray
    stable: NDArray[np.bool_]
    validated: NDArray[np.bool_]
    refuted: NDArray[np.bool_]
    inside: FloatArray
    clipped: int

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """Where the allowed runs were too few for a verdict (n,)."""
        return ~self.validated & ~self.refuted

    @property
    def verdict(self) -> str:
        """Verdict for all poses: refuted or undecided at any pose, or validated."""
        if np.any(self.refuted):
            return "refuted"
        return "undecided" if np.any(self.undecided) else "validated"

    @property
    def coverage(self) -> FloatArray:
        """Share of the draws within the method's bounds (n,)."""
        return self.inside / self.runs

    def coverage_interval(self, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the binomial confidence interval of the coverage, lower and upper ends (n,)."""
        return binomial_interval(self.inside, self.runs, confidence)

    def __repr__(self) -> str:
        return (
            f"Validation({self.method}, {self.digits} digits: {self.verdict}; "
            f"{np.count_nonzero(self.validated)} of {len(self.runs)} poses validated)"
        )


def validate_method(
    scenario: Scenario,
    *,
    method: str = "linear",
    digits: int = 2,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Validation:
    """Compare the interval of a method with the interval by Monte Carlo, drawn until stable.

    Stable means that twice the standard error of mean, standard deviation and interval ends is
    within δ (7.9.4). The draws can be off by more than δ. Clause 8.2 therefore requires δ/5 to
    validate a method, which takes 25 times the draws.

    δ is enough here. Where a distance exceeds δ, but not significantly, the pose is neither
    validated nor refuted, and more batches are drawn. With a smaller tolerance a method with an
    error just above δ would less often be validated by chance.

    Args:
        scenario: The scenario, at its level and with its seed.
        method: A name in `propagation.METHODS`.
        digits: Significant digits of the standard deviation, 1 to 4. One more digit takes 100 times
            the draws.
        workers: Threads to compute with; the result does not depend on their number.
        progress: Called after every batch with the number of new poses with a verdict.

    Raises:
        InputError: If there is no such method or a number is not allowed.
        ComputationError: If memory or threads run out.
    """
    check_method(method)
    digits = check_number("digits", digits, DIGITS)
    batches = Batches.of(scenario)
    moments = propagate_scenario(scenario, method=method, beta=BETA)
    most = MAX_RUNS // batches.draws
    together = max(1, MAX_KEPT // (2 * batches.kept * most))
    results = np.zeros(len(scenario.aircraft), dtype=_RESULT)
    clipped: dict[int, int] = {}
    for first in range(0, len(results), together):
        active = [_Pose(i, moments) for i in range(first, min(first + together, len(results)))]
        for number in range(most):
            radar, clipped[number] = batches.radar(number)
            drawn = in_order(_drawing(batches, number, radar, active), len(active), workers)
            for pose, batch in zip(active, drawn, strict=True):
                pose.batches.append(batch)
            undecided = []
            for pose in active:
                result = pose.result(batches, digits, last=number == most - 1)
                if result is None:
                    undecided.append(pose)
                else:
                    results[pose.index] = result
            if progress:
                progress(len(active) - len(undecided))
            active = undecided
            if not active:
                break
    return Validation(
        method=method,
        digits=digits,
        seed=scenario.seed,
        runs=results["runs"],
        delta=results["delta"],
        moments=moments,
        draws=DrawStatistics(*(results[name] for name in ("mean", "std", "lower", "upper"))),
        distance_lower=abs(moments.lower - results["lower"]),
        distance_upper=abs(moments.upper - results["upper"]),
        stable=results["stable"],
        validated=results["verdict"] == VALIDATED,
        refuted=results["verdict"] == REFUTED,
        inside=np.where(np.isnan(moments.lower + moments.upper), np.nan, results["inside"]),
        clipped=sum(clipped.values()),
    )


def numerical_tolerance(std: float, digits: int) -> float:
    """Return δ of 7.9.2, half a unit in the last significant digit of a standard deviation.

    The deviation, rounded to n_dig digits, is c · 10^l with a whole number c of n_dig digits. Then
    δ is ½ · 10^l. A deviation of 0 gives 0, and NaN gives NaN.
    """
    if std == 0 or math.isnan(std):
        return std
    # The exponent after rounding: 0.0996 to two digits is 0.10, with l = −2.
    exponent = int(f"{std:.{digits - 1}e}".partition("e")[2])
    return float(f"5e{exponent - digits}")


@dataclass(frozen=True, eq=False)
class _Batch:
    """Statistics of a batch of draws at one pose.

    Attributes:
        estimates: Mean, standard deviation, lower and upper quantile (4,).
        ends: The smallest and the largest draws, for the quantiles of all batches.
        inside: Number of draws within the method's bounds.
    """

    estimates: FloatArray
    ends: FloatArray
    inside: int


@dataclass(frozen=True, eq=False)
class Batches:
    """Draws of batches.

    Attributes:
        sampler: Draws states and computes P_D.
        seed: Seed of all batches.
        tail: Probability beyond either end of the interval.
        draws: Draws of a batch, M of 7.9.4.
        kept: Number of the smallest draws of a batch to keep, and of the largest draws.
    """

    sampler: Sampler
    seed: int
    tail: float
    draws: int
    kept: int

    @classmethod
    def of(cls, scenario: Scenario) -> Batches:
        """Return the batches of a scenario, of a size for the bounds at Φ(−β) and Φ(β)."""
        tail = float(ndtr(-BETA))
        # 7.9.4 b): 1 − p is the probability of both tails together.
        draws = max(LEAST_DRAWS, math.ceil(LEAST_OUTSIDE / (2 * tail)))
        return cls(Sampler.of(scenario), scenario.seed, tail, draws, tail_share(draws, tail))

    def radar(self, number: int) -> tuple[FloatArray, int]:
        """Return radar states (draws, 4m), and the number of draws with a c_r set to zero."""
        normals = self._stream(number, 0).standard_normal((self.draws, self.sampler.radar_normals))
        radar, negative = self.sampler.draw_radar(normals)
        return radar, int(np.count_nonzero(negative))

    def p_d(self, number: int, radar: FloatArray, pose: int) -> FloatArray:
        """Return P_D of a batch at a pose (draws,)."""
        normals = self._stream(number, 1 + pose).standard_normal((len(AIRCRAFT), self.draws, 1))
        poses = slice(pose, pose + 1)
        return self.sampler.draw_p_d(np.moveaxis(normals, 0, -1), radar, poses, overwrite=True)[
            :, 0
        ]

    def draw(self, number: int, radar: FloatArray, pose: _Pose) -> _Batch:
        """Draw a batch at a pose and return its statistics."""
        p_d = self.p_d(number, radar, pose.index)
        ends = p_d
        if 2 * self.kept < self.draws:
            parts = np.partition(p_d, [self.kept - 1, self.draws - self.kept])
            ends = np.concatenate([parts[: self.kept], parts[-self.kept :]])
        inside = np.count_nonzero((p_d >= pose.lower) & (p_d <= pose.upper))
        low, high = self.quantiles([ends])
        return _Batch(np.array([p_d.mean(), p_d.std(ddof=1), low, high]), ends, int(inside))

    def quantiles(self, ends: list[FloatArray]) -> tuple[float, float]:
        """Return the quantiles of all draws of some batches, from the ends of each batch."""
        values = np.concatenate(ends)[:, np.newaxis]
        lower, upper = tail_quantiles(values, len(ends) * self.draws, self.tail)
        return float(lower[0]), float(upper[0])

    def _stream(self, *key: int) -> np.random.Generator:
        return random_stream(self.seed, Stream.BATCHES, *key)


#: Confidence that a distance exceeds δ, for a method to be refuted: 3 standard errors.
CONFIDENCE = float(ndtr(3.0))
UNDECIDED, VALIDATED, REFUTED = range(3)
#: Result at a pose, in the order of `_Pose.summary`, δ, stability and verdict.
_RESULT = np.dtype(
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
        # Method and draws may round the same value differently in the last digit.
        self.bounds = np.array([moments.lower[index], moments.upper[index]])
        slack = ROUNDING * abs(moments.p_d[index])
        self.lower = moments.lower[index] - slack
        self.upper = moments.upper[index] + slack
        self.batches: list[_Batch] = []

    def result(self, batches: Batches, digits: int, *, last: bool) -> tuple[float, ...] | None:
        """Return the result, a row of `_RESULT`; None if more batches are needed."""
        delta, errors, stable = self.stability(batches.draws, digits)
        if not stable and not last:
            return None
        summary = self.summary(batches)
        verdict = self.verdict(summary[3:5], delta, errors[2:]) if stable else UNDECIDED
        if verdict == UNDECIDED and not last:
            return None
        return (*summary, delta, stable, verdict)

    def stability(self, draws: int, digits: int) -> tuple[float, FloatArray, bool]:
        """Return δ, errors of mean, deviation and quantiles, and whether all are stable."""
        mean, std = self._moments(draws)
        # 7.9.4 i), j): u(y) from all draws, and δ from u(y)
        delta = np.maximum(numerical_tolerance(std, digits), ROUNDING * abs(mean))
        if len(self.batches) < 2:
            return delta, np.full(4, np.nan), False
        # 7.9.4 g), h): standard deviations of the averages over the batches
        estimates = np.array([batch.estimates for batch in self.batches])
        errors = estimates.std(axis=0, ddof=1) / math.sqrt(len(estimates))
        # 7.9.4 k); a fraction of 1/5 gives the δ/5 of 8.2
        return delta, errors, bool(np.all(2 * errors <= FRACTION * delta))

    def verdict(self, ends: tuple[float, float], delta: float, errors: FloatArray) -> int:
        """Compare the method's bounds with the quantiles of stable draws, 8.1."""
        distances = abs(self.bounds - ends)
        if np.all(distances <= delta):
            return VALIDATED
        # Two batches can agree by chance. Student's t accounts for the chance at one pose, but not
        # at hundreds of poses. A method is therefore refuted by three batches or more.
        if len(self.batches) < 3 and np.isfinite(distances).all():
            return UNDECIDED
        margin = stdtrit(len(self.batches) - 1, CONFIDENCE) * errors
        # NaN, from a method without a result, compares as false and gives REFUTED.
        return UNDECIDED if np.all(distances <= delta + margin) else REFUTED

    def summary(self, batches: Batches) -> tuple[int, float, float, float, float, int]:
        """Return runs, mean, deviation, quantiles and count inside of all draws, 7.9.4 l).

        The average of the batches' quantiles would have a bias of some 0.003 standard deviations.
        The quantiles of all draws have this bias divided by the number of batches.
        """
        return (
            len(self.batches) * batches.draws,
            *self._moments(batches.draws),
            *batches.quantiles([batch.ends for batch in self.batches]),
            sum(batch.inside for batch in self.batches),
        )

    def _moments(self, draws: int) -> tuple[float, float]:
        """Return mean and standard deviation of all draws of all batches."""
        means, stds = np.array([batch.estimates[:2] for batch in self.batches]).T
        mean = float(means.mean())
        squares = (draws - 1) * np.sum(stds**2) + draws * np.sum((means - mean) ** 2)
        return mean, math.sqrt(squares / (draws * len(means) - 1))


def _drawing(
    batches: Batches, number: int, radar: FloatArray, poses: list[_Pose]
) -> Callable[[int], _Batch]:
    """Return the function that draws batch `number` at the pose with an index in `poses`."""
    return lambda index: batches.draw(number, radar, poses[index])
