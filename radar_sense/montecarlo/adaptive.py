"""The verdict on a method of propagation, pose by pose, by as many draws as the verdict takes.

The tolerance is that of JCGM 101:2008 (Supplement 1 to the "Guide to the expression of uncertainty
in measurement"). By clause 7.9.2, δ follows from the number of significant digits of the standard
deviation that matter. By clause 8.1, a method agrees where both ends of its interval are within δ
of the ends by draws. Clause 8.2 requires ends by draws that are stable to δ/5 before a method is
called validated, which takes 25 times the draws. Here they are stable to δ, and a method agrees.

The ends are by draws with emphasis on the tails. Mean, deviation and coverage are by plain runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radar_sense.limits import Limit, check_number
from radar_sense.montecarlo.montecarlo import BETA, ROUNDING, MonteCarlo, monte_carlo
from radar_sense.progress import report
from radar_sense.propagation import check_method
from radar_sense.propagation.draws import estimate
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.streams import Stream, random_stream

#: Plain runs: 270 of them are expected outside the interval. 7.9.4 b) asks for 100.
RUNS = 100_000
#: Draws of a batch with emphasis on the tails, and most batches of a pose. The standard error of an
#: end is some 2σ/√n by n of these draws, so all batches decide where δ is above 0.3 % of σ.
DRAWS, MOST_BATCHES = 16_384, 128
DIGITS = Limit(at_least=1, at_most=4, whole=True)
#: Standard errors by which a distance exceeds δ where a method differs.
ERRORS = 4.0


@dataclass(frozen=True, eq=False, repr=False)
class Validation:
    """An interval of P_D at each of n poses by a method and by draws, with the verdict.

    Attributes:
        method: Name of the method.
        digits: Significant digits of the standard deviation, n_dig of 7.9.2.
        plain: Plain runs, with the moments by the method as `band`.
        delta: Numerical tolerance δ of P_D (n,).
        lower: Quantile of the draws at Φ(−3) (n,).
        upper: Quantile of the draws at Φ(3) (n,).
        runs: Draws with emphasis on the tails (n,).
        stable: Where twice the standard errors of both ends are within δ (n,).
        agrees: Where the draws are stable and both distances are within δ (n,).
        differs: Where a distance exceeds δ by `ERRORS` standard errors (n,).
    """

    method: str
    digits: int
    plain: MonteCarlo
    delta: FloatArray
    lower: FloatArray
    upper: FloatArray
    runs: NDArray[np.int64]
    stable: NDArray[np.bool_]
    agrees: NDArray[np.bool_]
    differs: NDArray[np.bool_]

    @property
    def distance_lower(self) -> FloatArray:
        """Distance between the lower bounds by the method and the draws (n,)."""
        return abs(self.plain.band.lower - self.lower)

    @property
    def distance_upper(self) -> FloatArray:
        """Distance between the upper bounds by the method and the draws (n,)."""
        return abs(self.plain.band.upper - self.upper)

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """Where the most draws allowed were too few for a verdict (n,)."""
        return ~self.agrees & ~self.differs

    @property
    def verdict(self) -> str:
        """Verdict for all poses: "differs" or "undecided" at any pose, or "agrees"."""
        if np.any(self.differs):
            return "differs"
        return "undecided" if np.any(self.undecided) else "agrees"

    def __repr__(self) -> str:
        return (
            f"Validation({self.method}, {self.digits} digits: {self.verdict}; "
            f"agrees at {np.count_nonzero(self.agrees)} of {len(self.runs)} poses)"
        )


def validate_method(
    scenario: Scenario, *, method: str | None = None, digits: int = 2, workers: int = 1
) -> Validation:
    """Compare the interval of a method with the interval by draws.

    Batches are drawn until twice the standard error of both ends is within δ (7.9.4), or until a
    distance exceeds δ significantly. Where a distance exceeds δ, but not significantly, a pose is
    undecided and more batches are drawn.

    Args:
        scenario: The scenario, at its level and with its seed.
        method: A name in `propagation.METHODS`; the scenario's by default.
        digits: Significant digits of the standard deviation, 1 to 4. One more digit takes 100 times
            the draws.
        workers: Threads for the plain runs; the result does not depend on their number.

    Raises:
        InputError: If there is no such method or a number is not allowed.
        ComputationError: If memory or threads run out.
    """
    method = scenario.method if method is None else method
    check_method(method)
    digits = check_number("digits", digits, DIGITS)
    plain = monte_carlo(scenario, RUNS, workers=workers, method=method)
    tolerance = np.array([numerical_tolerance(std, digits) for std in plain.std])
    delta = np.maximum(tolerance, ROUNDING * abs(plain.mean))
    states, bounds = scenario.states(), np.stack([plain.band.lower, plain.band.upper])
    n = len(states)
    total, variance, ends = (np.zeros((2, n)) for _ in range(3))
    batches = np.zeros(n, dtype=np.int64)
    stable, agrees, differs = (np.zeros(n, dtype=bool) for _ in range(3))
    seeds = random_stream(scenario.seed, Stream.BATCHES).integers(2**63, size=MOST_BATCHES)
    rows = np.arange(n)
    for seed in seeds:
        batch = estimate(replace(states.at(rows), seed=int(seed)), DRAWS, BETA)
        total[:, rows] += batch.lower, batch.upper
        variance[:, rows] += np.square([batch.lower_error, batch.upper_error])
        batches[rows] += 1
        ends[:, rows] = total[:, rows] / batches[rows]
        error = np.sqrt(variance[:, rows]) / batches[rows]
        distance = abs(bounds - ends)[:, rows]
        stable[rows] = (2.0 * error <= delta[rows]).all(axis=0)
        agrees[rows] = stable[rows] & (distance <= delta[rows]).all(axis=0)
        # also where a method has no result, NaN
        differs[rows] = ~(distance <= delta[rows] + ERRORS * error).all(axis=0)
        rows = rows[~(agrees | differs)[rows]]
        report("poses", n - len(rows), n)
        if not len(rows):
            break
    return Validation(
        method=method,
        digits=digits,
        plain=plain,
        delta=delta,
        lower=ends[0],
        upper=ends[1],
        runs=batches * DRAWS,
        stable=stable,
        agrees=agrees,
        differs=differs,
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
