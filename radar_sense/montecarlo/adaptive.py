"""The verdict on a method of propagation, pose by pose, by as many draws as the verdict takes.

The tolerance is that of JCGM 101:2008 (Supplement 1 to the "Guide to the expression of uncertainty
in measurement"). By clause 7.9.2, δ follows from the number of significant digits of the standard
deviation that matter. By clause 8.1, both bounds of a method must be within δ of those by draws.
Here mean and σ must be, too. Clause 8.2 asks for draws that are stable to δ/5 before a method is
called validated, which takes 25 times the draws. Here they are stable to δ, and a method agrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radar_sense.cost import EMPHASIS, foresee
from radar_sense.limits import Limit, check_number
from radar_sense.montecarlo.statistics import LEAST_STD
from radar_sense.progress import report
from radar_sense.propagation import Moments
from radar_sense.propagation.draws import estimate
from radar_sense.propagation.moments import BETA
from radar_sense.propagation.staged import GROWTH, PRECISE
from radar_sense.states import FloatArray
from radar_sense.streams import Stream, random_stream
from radar_sense.uncertain_states import UncertainStates

#: Most draws at a pose; `PRECISE` are the first. The standard errors are 0.5 to 2 σ/√n by n of the
#: draws, so the most decide where δ is above 0.3 % of σ. More draws take the place of fewer: where
#: a tail is steep a bound by few draws is biased, and so is the mean of many such bounds.
MOST_DRAWS = 2**21
#: Parts of the draws, each with standard errors of its own. At one pose of hundreds the standard
#: error of one part is too small by chance, up to twenty times; that of four parts is not.
PARTS = 4
DIGITS = Limit(at_least=1, at_most=4, whole=True)
#: Standard errors of the draws by which a method differs from them.
ERRORS = 4.0
#: What is compared: attributes of `Moments`, and the first values of an `Estimate`.
QUANTITIES = ("mean", "std", "lower", "upper")


@dataclass(frozen=True, eq=False, repr=False)
class Verdict:
    """Values of P_D at n poses by a method and by draws, one row for each of `QUANTITIES`.

    Attributes:
        values: Values by the method (4, n), NaN where it has none.
        drawn: Values by the draws (4, n).
        error: Standard errors of `drawn` (4, n).
        delta: Numerical tolerance δ of P_D (n,).
        draws: Number of draws (n,).
    """

    values: FloatArray
    drawn: FloatArray
    error: FloatArray
    delta: FloatArray
    draws: NDArray[np.int64]

    @property
    def distance(self) -> FloatArray:
        """Distances of the values from those by draws (4, n)."""
        return abs(self.values - self.drawn)

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Where twice the standard errors are within δ (n,), the rule of 7.9.4."""
        return np.all(2.0 * self.error <= self.delta, axis=0)

    @property
    def agrees(self) -> NDArray[np.bool_]:
        """Where the draws are stable, and all values within δ of those by draws (n,)."""
        return self.stable & np.all(self.distance <= self.delta, axis=0)

    @property
    def differs(self) -> NDArray[np.bool_]:
        """Where a distance exceeds δ by `ERRORS` standard errors, or has no value (n,)."""
        return ~np.all(self.distance <= self.delta + ERRORS * self.error, axis=0)

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """Where the draws are too few for a verdict (n,)."""
        return ~self.agrees & ~self.differs

    @property
    def word(self) -> str:
        """Verdict for all poses: "differs" or "undecided" at any pose, or "agrees"."""
        if np.any(self.differs):
            return "differs"
        return "undecided" if np.any(self.undecided) else "agrees"

    def __repr__(self) -> str:
        agree = np.count_nonzero(self.agrees)
        return f"Verdict({self.word}; agrees at {agree} of {len(self.delta)} poses)"


def judge(states: UncertainStates, band: Moments, digits: int, beta: float = BETA) -> Verdict:
    """Return the verdict on the values of a method, by draws with emphasis on the tails.

    More draws are made at a pose until the method agrees or differs there. The digits are the
    significant ones of the standard deviation that matter. One more takes 100 times the draws.
    """
    digits = check_number("digits", digits, DIGITS)
    n = len(states)
    values = np.stack([getattr(band, name) for name in QUANTITIES])
    drawn, error = draw_in_parts(states, PRECISE, beta)
    # no output shows a smaller deviation, nor differences as small as its digits
    shown = np.maximum(drawn[1], LEAST_STD)
    delta = np.array([numerical_tolerance(std, digits) for std in shown])
    draws, count = np.full(n, PRECISE), PRECISE
    verdict = Verdict(values, drawn, error, delta, draws)
    rows = np.flatnonzero(verdict.undecided)
    # as many as it takes until the draws are stable
    more = np.square(2.0 * error[:, rows] / delta[rows]).max(axis=0, initial=GROWTH)
    growth = GROWTH ** np.ceil(np.log(more) / np.log(GROWTH))
    most = float(np.minimum(PRECISE * growth, MOST_DRAWS).sum())
    evaluations = most * len(states.model.radars) * EMPHASIS
    less = "fewer --digits" if digits > 1 else "fewer poses"
    foresee(f"{most:,.0f} draws of P_D", evaluations, less=less)
    while rows.size and count < MOST_DRAWS:
        report("poses", n - len(rows), n)
        count = min(GROWTH * count, MOST_DRAWS)
        drawn[:, rows], error[:, rows] = draw_in_parts(states.at(rows), count, beta)
        draws[rows] = count  # the verdict has these arrays
        rows = np.flatnonzero(verdict.undecided)
    report("poses", n, n)
    return verdict


def draw_in_parts(
    states: UncertainStates, draws: int, beta: float = BETA
) -> tuple[FloatArray, FloatArray]:
    """Return `QUANTITIES` by draws (4, k), of all `PARTS` together, and standard errors (4, k).

    No method of propagation makes the same draws.
    """
    seeds = random_stream(states.seed, Stream.PARTS, 0).integers(2**63, size=PARTS)
    parts = [estimate(replace(states, seed=int(x)), draws // PARTS, beta) for x in seeds]
    drawn, error = ([getattr(p, name)[:4] for p in parts] for name in ("values", "errors"))
    return np.mean(drawn, axis=0), np.sqrt(np.sum(np.square(error), axis=0)) / PARTS


def numerical_tolerance(std: float, digits: int) -> float:
    """Return δ of 7.9.2, half a unit in the last significant digit of a standard deviation.

    The deviation, rounded to n_dig digits, is c · 10^l with a whole number c of n_dig digits. Then
    δ is ½ · 10^l. NaN gives NaN.
    """
    if math.isnan(std):
        return std
    # The exponent after rounding: 0.0996 to two digits is 0.10, with l = −2.
    exponent = int(f"{std:.{digits - 1}e}".partition("e")[2])
    return float(f"5e{exponent - digits}")
