"""The threshold test of path planning: does P_D, with its uncertainty, stay below a threshold?

A path is accepted where P_D + kσ ≤ P_max at every pose (A. Costley, G. Droge, R. Christensen,
R. C. Leishman and J. Swedeen, "Path planning with uncertainty for aircraft under threat of
detection from ground-based radar", 2022). The linear bound P_D + kσ can exceed 1. The quantile of
P_D at Φ(k) is a bound for any distribution.

"Holds" rests on two legs at every pose:

- draws with emphasis on the tails find P(P_D > P_max) below 1 − Φ(k), by so many standard errors
  that chance makes a false "holds" with a probability of `CHANCE` at most;
- plain runs of the whole path exceed P_max no more often than these draws predict. They are so many
  that a tail of 1 − Φ(k) which the draws had missed would show with a probability of 1 − `CHANCE`.

A path with a violated pose is said to hold only if this pose is said to hold. The probability of a
false "holds" of a path is therefore that of one pose. A path is said to violate the test if any
pose is, so "violated" at a pose needs more standard errors on a path of more poses.

A path is also tested between its rows. What the draws do not decide is not known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, pdtrc

from radar_sense.acceptance import refinement
from radar_sense.acceptance.frames import attitude_off
from radar_sense.montecarlo.exceedance import Exceedance, exceedance, share_above
from radar_sense.propagation import AUTOMATIC, BOUND_CHANGE, Band, band_of_scenario
from radar_sense.propagation.draws import Estimate
from radar_sense.propagation.staged import LADDER, LAST, StagedDraws
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Probability of a false "holds" of a path by each of the two legs: 0.1 % together.
CHANCE = 0.0005
#: Probability at one pose that plain runs contradict draws that are right. More draws are then made
#: at the pose.
ALARM = 1e-4
#: Decimals of margins that are alike: those that are shown.
ALIKE = 6


@dataclass(frozen=True, eq=False)
class ThresholdTest:
    """The threshold test of an upper bound of P_D, pose by pose.

    Attributes:
        p_max: P_max.
        upper: The bound (n,), NaN without a bound.
        violated: Where P_max is exceeded (n,).
        unknown: Where the test has no answer (n,).
        coordinate: Time [s] of each pose (n,), azimuth [deg] on an orbit or range [km], in order.
    """

    p_max: float
    upper: FloatArray
    violated: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    coordinate: FloatArray

    @property
    def above(self) -> float:
        """Length of the path with the bound above P_max, in the unit of the coordinate.

        The bound is taken to be linear between poses. Steps to and from a pose without a bound are
        counted.
        """
        return math.fsum(abs(np.diff(self.coordinate)) * share_above(self.margin))

    @property
    def total(self) -> float:
        """Length of the path, in the unit of the coordinate."""
        return abs(float(self.coordinate[-1] - self.coordinate[0]))

    @property
    def margin(self) -> FloatArray:
        """P_max minus the bound (n,): negative above P_max, NaN without a bound."""
        return self.p_max - self.upper

    @property
    def verdict(self) -> str:
        """Verdict on all poses: "violated" or "not known" at a pose, or "holds"."""
        if self.violated.any():
            return "violated"
        return "not known" if self.unknown.any() else "holds"

    @property
    def passed(self) -> bool:
        """Whether the test holds at every pose."""
        return self.verdict == "holds"

    @property
    def first(self) -> int | None:
        """First violated pose, or else the first pose that is not known; None if the test holds."""
        for mask in (self.violated, self.unknown):
            if mask.any():
                return int(np.argmax(mask))
        return None

    @property
    def first_above(self) -> float:
        """Where the bound is first above P_max: 2.5 is the middle of poses 2 and 3, NaN is nowhere.

        The bound is taken to be linear between poses. A pose without a bound is above.
        """
        above = ~(self.margin >= 0)
        if not above.any():
            return np.nan
        pose = int(np.argmax(above))
        before = pose > 0 and np.isfinite(self.margin[pose])
        return pose - float(share_above(self.margin[pose - 1 : pose + 1])[0] if before else 0.0)


@dataclass(frozen=True, eq=False)
class Decision:
    """What draws say of P(P_D > p_max) ≤ 1 − Φ(k) at each of n poses.

    Attributes:
        holds: Where both legs say that it holds (n,).
        violated: Where the draws say that it does not (n,).
        upper: Upper bound of P_D by the draws (n,).
        runs: The runs of the path.
        wanted: Number of runs that "holds" needs.
    """

    holds: NDArray[np.bool_]
    violated: NDArray[np.bool_]
    upper: FloatArray
    runs: Exceedance
    wanted: int


def decide(
    scenario: Scenario,
    p_max: float,
    k: float,
    first: Estimate | None = None,
    rows: NDArray[np.intp] | None = None,
) -> Decision:
    """Return what draws say of P(P_D > p_max) ≤ 1 − Φ(k) at each pose of a path, or at some rows.

    The chance of a false decision counts every stage of draws that there may be at a pose. It is
    therefore the same where the first stages are skipped, because their draws are given.
    """
    tail, poses = float(ndtr(-k)), len(scenario.aircraft)
    wanted = math.ceil(math.log(CHANCE) / math.log1p(-tail))
    runs = exceedance(scenario, p_max, wanted)
    every = np.arange(poses)
    chance = CHANCE / len(LADDER)  # of every stage
    to_hold, to_violate = ndtri(1.0 - chance), ndtri(1.0 - chance / poses)

    def decided(
        some: NDArray[np.intp], found: Estimate
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return where the test holds and where it is violated."""
        above, error = found.above
        below = tail - above
        # as many runs or more exceed the limit with this probability, if the draws are right
        counts, most = runs.counts[some], runs.runs * (above + 3.0 * error)
        consistent = (counts == 0) | (pdtrc(counts - 1.0, most) > ALARM)
        return (to_hold * error <= below) & consistent, to_violate * error < -below

    staged = StagedDraws(scenario.states(), k, p_max, first)
    drawn = staged.until(lambda some, found: np.logical_or(*decided(some, found)), LAST, rows)
    holds, violated = decided(every, drawn)
    return Decision(holds & (runs.runs >= wanted), violated, drawn.bounds[0][1], runs, wanted)


@dataclass(frozen=True, eq=False)
class PathTest:
    """A threshold test of a scenario, at the poses of its refined path.

    Attributes:
        path: The scenario of the poses tested (n,), and which poses are rows of the path.
        test: The test.
        decision: What draws say.
        by_draws: Where the bound is by draws (n,).
        far: Where the origin is too far for errors of the attitude (n,): there is no answer.
    """

    path: refinement.Refined
    test: ThresholdTest
    decision: Decision
    by_draws: NDArray[np.bool_]
    far: NDArray[np.bool_]

    @property
    def worst(self) -> int:
        """A pose without a bound, or with the least margin; of several the one of largest P_D."""
        margin = np.nan_to_num(np.round(self.test.margin, ALIKE), nan=-np.inf)
        return int(np.lexsort((-self.path.band.p_d, margin))[0])


def path_test(
    scenario: Scenario, method: str, p_max: float, k: float, band: Band, nominal: bool
) -> PathTest:
    """Test P_D + kσ ≤ P_max at every pose of a scenario, and on a path also between the poses.

    The band is by the method, with bounds at Φ(k), and with p_max so that no draws are made twice.
    P_D of the nominal states must be at most P_max too if it is part of the test, as it is of
    P_D + kσ. It is no part of a test of P(P_D > P_max).
    """

    def propagate(path_scenario: Scenario) -> Band:
        return band_of_scenario(path_scenario, method=method, beta=k, p_max=p_max)

    path = refinement.resolve(scenario, propagate, p_max, band)
    certain = (path.band.p_d > p_max) & nominal
    # Draws change no verdict where P_D itself is above, but they may be the bound of `automatic`.
    rows = None if method == AUTOMATIC else np.flatnonzero(~certain)
    decision = decide(path.scenario, p_max, k, path.band.drawn, rows)
    upper, by_draws = path.band.upper.copy(), path.band.error > 0
    if method == AUTOMATIC:
        # FORM may be on the other side of the limit within its tolerance
        sides = (decision.holds & (upper > p_max)) | (decision.violated & ~(upper > p_max))
        upper[sides], by_draws = decision.upper[sides], by_draws | sides
        violated, unknown = decision.violated, ~(decision.holds | decision.violated)
    else:
        exceeds = upper > p_max
        violated, unknown = exceeds & decision.violated, ~exceeds & ~decision.holds
        unknown |= (exceeds & ~decision.violated) | np.isnan(upper)
    far = attitude_off(path.scenario) > BOUND_CHANGE
    violated, unknown = (violated & ~far) | certain, unknown | far | (not path.resolved)
    place = path.scenario.geometry.coordinate
    test = ThresholdTest(p_max, upper, violated, unknown & ~violated, place)
    return PathTest(path, test, decision, by_draws, far)
