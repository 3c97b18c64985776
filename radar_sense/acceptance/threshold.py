"""The threshold test of path planning: does P_D, with its uncertainty, stay within a limit?

A path is accepted where P_D + kσ ≤ P_max at every pose (A. Costley, G. Droge, R. Christensen,
R. C. Leishman and J. Swedeen, "Path planning with uncertainty for aircraft under threat of
detection from ground-based radar", 2022). The linear bound P_D + kσ can exceed 1. The quantile of
P_D at Φ(k) is a bound for any distribution. Whoever is to detect asks for P_D − kσ ≥ P_min, which
is the same test of a miss: 1 − P_D + kσ ≤ 1 − P_min.

"Holds" rests on two legs at every pose:

- draws with emphasis on the tails find the probability of P_D beyond the limit below 1 − Φ(k), by
  so many standard errors that chance makes a false "holds" with a probability of `CHANCE` at most;
- plain runs of the whole path are beyond the limit no more often than these draws predict. They are
  so many that a tail of 1 − Φ(k) which the draws had missed would show with a probability of
  1 − `CHANCE`.

A path with a violated pose is said to hold only if this pose is said to hold. The probability of a
false "holds" of a path is therefore that of one pose. A path is said to violate the test if any
pose is, so "violated" at a pose needs more standard errors on a path of more poses.

A path is also tested between its rows. What the draws do not decide is not known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, pdtrc

from radar_sense.acceptance import refinement
from radar_sense.acceptance.frames import attitude_off
from radar_sense.acceptance.requirement import Requirement
from radar_sense.montecarlo.exceedance import Exceedance, exceedance, share_beyond
from radar_sense.propagation import AUTOMATIC, BOUND_CHANGE, Band, band_of_scenario
from radar_sense.propagation.draws import Estimate
from radar_sense.propagation.staged import LADDER, LAST, StagedDraws
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Probability of a false "holds" of a path by each of the two legs: 0.1 % together.
CHANCE = 0.0005
#: Standard errors by which draws of a stage must meet a limit to hold.
TO_HOLD = float(ndtri(1.0 - CHANCE / len(LADDER)))
#: Probability at one pose that plain runs contradict draws that are right. More draws are then made
#: at the pose.
ALARM = 1e-4
#: Margins are alike within this distance, and within this part of the least of them: draws tell
#: bounds near 0 or 1 apart no better.
ALIKE, ALIKE_PART = 1e-4, 0.002


@dataclass(frozen=True, eq=False)
class Decision:
    """What draws say at each of n poses of the probability of P_D beyond a limit.

    Attributes:
        holds: Where both legs say that it holds (n,).
        violated: Where the draws say that it does not (n,).
        bound: Bound of P_D by the draws, on the side of the limit (n,).
        probability: Probability of P_D beyond the limit (n,), by the draws or by the runs: by which
            the standard error is less.
        error: Its standard error (n,).
        runs: The runs of the path.
        wanted: Number of runs that "holds" needs.
    """

    holds: NDArray[np.bool_]
    violated: NDArray[np.bool_]
    bound: FloatArray
    probability: FloatArray
    error: FloatArray
    runs: Exceedance
    wanted: int

    @property
    def highest(self) -> int:
        """The first pose with the highest probability of P_D beyond the limit."""
        return int(np.argmax(self.probability))

    @property
    def at_some_pose(self) -> tuple[float, float] | None:
        """Probability of P_D beyond the limit at some pose, and its standard error.

        It is by the runs, but no less than the highest at a pose, which draws may know better. It
        is None where the runs do not know it.
        """
        if self.runs.anywhere is None:
            return None
        by_runs = self.runs.anywhere / self.runs.runs, float(self.runs.error(self.runs.anywhere))
        of_pose = float(self.probability[self.highest]), float(self.error[self.highest])
        return max(by_runs, of_pose)


def decide(scenario: Scenario, requirement: Requirement, first: Estimate | None = None) -> Decision:
    """Return what draws say of a requirement at each pose of a path.

    The chance of a false decision counts every stage of draws that there may be at a pose. It is
    therefore the same where the first stages are skipped, because their draws are given.
    """
    tail, poses = requirement.tail, len(scenario.aircraft)
    wanted = math.ceil(math.log(CHANCE) / math.log1p(-tail))
    runs = exceedance(scenario, requirement.margin, wanted)
    every = np.arange(poses)
    to_violate = ndtri(1.0 - CHANCE / (len(LADDER) * poses))

    def decided(
        some: NDArray[np.intp], found: Estimate
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return where the test holds and where it is violated."""
        beyond, error = requirement.beyond(found)
        below = tail - beyond
        # as many runs or more are beyond the limit with this probability, if the draws are right
        counts, most = runs.counts[some], runs.runs * (beyond + 3.0 * error)
        consistent = (counts == 0) | (pdtrc(counts - 1.0, most) > ALARM)
        return (TO_HOLD * error <= below) & consistent, to_violate * error < -below

    staged = StagedDraws.of_p_d(scenario.states(), requirement.k, requirement.limit, first)
    drawn = staged.until(lambda some, found: np.logical_or(*decided(some, found)), LAST)
    holds, violated = decided(every, drawn)
    lower, upper = drawn.bounds[0]
    bound = lower if requirement.at_least else upper
    (probability, error), of_runs = requirement.beyond(drawn), runs.error(runs.counts)
    better = (error > 0) & (error < of_runs)  # by chance, all draws may agree
    probability = np.where(better, probability, runs.probability)
    error, holds = np.where(better, error, of_runs), holds & (runs.runs >= wanted)
    return Decision(holds, violated, bound, probability, error, runs, wanted)


@dataclass(frozen=True, eq=False)
class PathTest:
    """The threshold test of a bound of P_D, pose by pose, at the n poses of a refined path.

    Attributes:
        requirement: What is required of P_D.
        path: The scenario of the poses tested, and which poses are rows of the path.
        decision: What draws say.
        bound: The bound on the side of the limit (n,), NaN without a bound.
        violated: Where the bound is beyond the limit (n,).
        unknown: Where the test has no answer (n,).
        by_draws: Where the bound is by draws (n,).
        far: Where the origin is too far for errors of the attitude (n,): there is no answer.
    """

    requirement: Requirement
    path: refinement.Refined
    decision: Decision
    bound: FloatArray
    violated: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    by_draws: NDArray[np.bool_]
    far: NDArray[np.bool_]

    @property
    def coordinate(self) -> FloatArray | None:
        """Time [s] of each pose (n,), azimuth [deg] on an orbit or range [km], in order.

        It is None without a flight from pose to pose.
        """
        geometry = self.path.scenario.geometry
        return geometry.coordinate if geometry.continuous else None

    @property
    def beyond(self) -> float:
        """Length of the path with the bound beyond the limit, in the unit of the coordinate.

        The bound is taken to be linear between poses. Steps to and from a pose without a bound are
        counted. Without a flight it is the number of poses beyond the limit, or without a bound.
        """
        if self.coordinate is None:
            return float(np.count_nonzero(~(self.margin >= 0)))
        return math.fsum(abs(np.diff(self.coordinate)) * share_beyond(self.margin))

    @property
    def total(self) -> float:
        """Length of the path, in the unit of the coordinate; or the number of poses."""
        if self.coordinate is None:
            return float(len(self.bound))
        return abs(float(self.coordinate[-1] - self.coordinate[0]))

    @property
    def margin(self) -> FloatArray:
        """How far the bound is within the limit (n,), negative beyond it, NaN without a bound."""
        return self.requirement.margin(self.bound)

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
        """First violated pose; None if there is none."""
        return int(np.argmax(self.violated)) if self.violated.any() else None

    @property
    def band(self) -> Band:
        """The band of P_D (n,), with the bound that is tested."""
        if self.requirement.at_least:
            return replace(self.path.band, lower=self.bound)
        return replace(self.path.band, upper=self.bound)

    @property
    def worst(self) -> int:
        """A pose without a bound, or with the least margin.

        Of poses with alike margins it is the one where P_D itself has the least margin.
        """
        margin = np.nan_to_num(self.margin, nan=-np.inf)
        alike = margin <= margin.min() + min(ALIKE, ALIKE_PART * abs(margin.min()))
        return int(np.lexsort((self.requirement.margin(self.path.band.p_d), ~alike))[0])


def path_test(scenario: Scenario, requirement: Requirement, band: Band) -> PathTest:
    """Test a requirement at every pose of a scenario, and on a path also between the poses.

    The band is by the scenario's method, with bounds at Φ(±k), and with the limit so that no draws
    are made twice. P_D of the nominal states must be within the limit too if it is part of the
    test, as it is of P_D + kσ. It is no part of a test of a probability.
    """
    method, k, limit = scenario.method, requirement.k, requirement.limit
    propagate = partial(band_of_scenario, method=method, beta=k, p_max=limit)
    path = refinement.resolve(scenario, propagate, requirement, band)
    certain = (requirement.margin(path.band.p_d) < 0) & (requirement.probability is None)
    decision = decide(path.scenario, requirement, path.band.drawn)
    bound, by_draws = requirement.bound(path.band).copy(), path.band.error > 0
    beyond = requirement.margin(bound) < 0
    if method == AUTOMATIC:
        # FORM may be on the other side of the limit within its tolerance
        sides = (decision.holds & beyond) | (decision.violated & ~beyond)
        bound[sides], by_draws = decision.bound[sides], by_draws | sides
        violated, unknown = decision.violated, ~(decision.holds | decision.violated)
    else:
        violated, unknown = beyond & decision.violated, ~beyond & ~decision.holds
        unknown |= (beyond & ~decision.violated) | np.isnan(bound)
    far = attitude_off(path.scenario) > BOUND_CHANGE
    violated, unknown = (violated & ~far) | certain, unknown | far | (not path.resolved)
    masks = violated, unknown & ~violated, by_draws, far
    return PathTest(requirement, path, decision, bound, *masks)
