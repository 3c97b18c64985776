"""Bounds of a mission from few draws: those of each radar are recombined with those of the others.

Given the path of the aircraft, radars are independent. The states of each radar are drawn several
times for each drawn path. The draws of different radars are combined at random, and a combination
takes no evaluation of the detection model.

The draws of a radar are often in the tails. They are chosen from candidates, half of which are
widened. Half of the draws are chosen as the errors are distributed, a quarter from the widened
candidates, and a quarter evenly in the logarithm of the rank of P_D, which is computed at a few
looks of the nominal path (double sampling: J. Neyman, "Contribution to the theory of sampling human
populations", J. Amer. Statist. Assoc. 33, 1938). The weight of a draw is the density of the errors
divided by the density that they were drawn from. The density of the errors is half of the latter,
which bounds all weights by 2 (a defensive mixture: T. Hesterberg, "Weighted average importance
sampling and defensive mixture distributions", Technometrics 37(2), 1995). Weights change the
standard error of a bound, and not what it is a bound of.

All is done in independent replicates, see `bounds`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense.cost import foresee
from radar_sense.covariance import block_diagonal
from radar_sense.mission.bounds import (
    PARTS,
    Cumulative,
    Weighted,
    pooled,
    ranks_about,
    weighted_statistics,
)
from radar_sense.mission.looks import Looks
from radar_sense.mission.tracks import event_probabilities, m_of_n_track
from radar_sense.model.fusion import either
from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.statistics import REPLICATES
from radar_sense.progress import report
from radar_sense.states import AIRCRAFT, FloatArray, of_each
from radar_sense.streams import Stream, random_stream
from radar_sense.uncertain_states import UncertainStates

#: Share of the widened candidates, of the draws in the tails, and of the combinations with an
#: emphasis on all radars.
SHARE = 0.5
#: Standard deviation of the widened unit normals. This and the next numbers are those with small
#: standard errors in `tests/studies/mission_bounds.py`.
WIDTH = 1.6
#: Candidates for each draw, and looks of the nominal path that their P_D is computed at.
CANDIDATES, SCREENING_LOOKS = 8, 8
#: Draws of each radar in a replicate: LOOKS divided by all looks, within limits. The Markov chain
#: of HISTORIES histories takes as long as P_D of a look.
LOOKS, MIN_DRAWS, MAX_DRAWS, HISTORIES = 4_000_000, 256, 8192, 256
#: Draws of each radar for one path, and combinations for each of them, if there are several radars.
DRAWS_PER_PATH, COMBINATIONS_PER_DRAW = 8, 2
#: With fewer draws than the first in all, a path has so few of them that there are as many paths as
#: the second: two paths of all replicates are then beyond 3σ.
FEW_DRAWS, LEAST_PATHS = 900, 180


def recombined_missions(
    looks: Looks,
    m_of_n: tuple[int, int] | None = None,
    *,
    k: float = 3.0,
    workers: int = 1,
) -> list[list[Cumulative]]:
    """Return the probability of detection, and of a track, by each time.

    The first entry is the network's. The entries of its single radars follow. A scenario of one
    radar has one entry. Tracks are m detections of n looks. Bounds are at kσ, with k at most 3: the
    draws reach no farther. The result does not depend on the number of workers.
    """
    p_d, plan = looks.nominal_p_d, _Plan.of(looks, m_of_n, ranks_about(k))
    plan.foresee(workers)
    replicates = []
    for replicate in in_order(plan.replicate, REPLICATES, workers):
        replicates.append(replicate)
        report("replicates", len(replicates), REPLICATES)
    nominal = [event_probabilities(looks.schedule, p_d, m_of_n)]
    for i in range(len(p_d) if len(p_d) > 1 else 0):
        nominal.append(event_probabilities(looks.schedule.of_radar(i), [p_d[i]], m_of_n))
    return [
        [pooled(plan.ranks, *event) for event in zip(*source, strict=True)]
        for source in zip(nominal, *replicates, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Plan:
    """What all replicates share.

    Attributes:
        looks: The looks.
        m_of_n: m and n of a track; None for detection alone.
        states: Those of each radar, or of all radars together if their errors are correlated.
        screening: Times of some looks of each radar, where P_D of candidates is computed.
        work: Work of a look, in evaluations of P_D, rounded down.
        paths: Number of paths of a replicate.
        draws: Number of draws of each radar for one path.
        ranks: Ranks (q,) of the quantiles of a replicate.
    """

    looks: Looks
    m_of_n: tuple[int, int] | None
    states: list[UncertainStates]
    screening: list[NDArray[np.intp]]
    work: int
    paths: int
    draws: int
    ranks: FloatArray

    @classmethod
    def of(cls, looks: Looks, m_of_n: tuple[int, int] | None, ranks: FloatArray) -> _Plan:
        """Choose the numbers of draws, and the looks at which P_D of candidates is computed."""
        scenario = looks.scenario
        # an error that radars share, of the RCS or of their type, keeps them together
        whole = scenario.states()
        states = [whole.of_radars([i]) for i in range(len(scenario.radars))]
        apart = block_diagonal([own.cov_radar[0] for own in states])
        states = states if np.array_equal(whole.cov_radar[0], apart) else [whole]
        screening = []
        for p_d, times in zip(looks.nominal_p_d, looks.times, strict=True):
            total = np.cumsum(p_d)
            level = (np.arange(SCREENING_LOOKS) + 0.5) / SCREENING_LOOKS * total[-1]
            screening.append(times[np.searchsorted(total, level)])
        # a whole number: a short window leaves the draws of the detection as they are
        work = 1 if m_of_n is None else 1 + 2 ** (m_of_n[1] - 1) // HISTORIES
        all_draws = int(np.clip(LOOKS / work / sum(map(len, looks.times)), MIN_DRAWS, MAX_DRAWS))
        draws = 1
        if len(states) > 1:
            draws = DRAWS_PER_PATH if all_draws >= FEW_DRAWS else max(1, all_draws // LEAST_PATHS)
        return cls(looks, m_of_n, states, screening, work, all_draws // draws, draws, ranks)

    def foresee(self, workers: int) -> None:
        """Say what the replicates take if that is much, and refuse it if it is too much."""
        looks, draws = sum(map(len, self.looks.times)), self.paths * self.draws
        evaluations = REPLICATES * draws * looks * self.work
        # P_D and tracks of all draws and of all combinations
        memory = 8.0 * looks * draws * 2 * (1 + COMBINATIONS_PER_DRAW)
        less = "a longer scan_period_s, or a shorter window"
        foresee(f"{looks:,} looks", evaluations, memory * workers, less=less, workers=workers)

    def replicate(self, number: int) -> list[list[Weighted]]:
        """Return statistics of the events, for all radars and for each radar by itself."""
        looks, shape = self.looks, (self.paths, self.draws)
        generator = random_stream(looks.scenario.seed, Stream.RECOMBINED, number)
        normals = generator.standard_normal((len(looks.schedule.time), len(AIRCRAFT), self.paths))
        poses = looks.poses(normals)
        p_d: list[FloatArray] = []
        weights: list[FloatArray] = []
        for states in self.states:
            by_radar, weight = self._draw(generator, states, first=len(p_d))
            for state in by_radar:
                p_d.append(looks.p_d(len(p_d), poses, state.reshape(*shape, -1)))
                weights.append(weight)
        if len(self.states) > 1:
            combinations = COMBINATIONS_PER_DRAW * self.draws
            picks, weight = combine(generator, weights, shape, combinations)
        else:
            picks, weight = [np.arange(len(weight))] * len(p_d), weights[0]
        each = [self._events(p) for p in p_d]
        seen = [times[p.any(axis=1)] for times, p in zip(looks.times, p_d, strict=True)]
        of_groups = []
        for group in looks.schedule.radars:
            if len(group) > 1:
                fused = reduce(either, (p_d[radar][:, picks[radar]] for radar in group))
                of_groups.append(self._events(fused))
            else:  # its tracks are known
                (radar,) = group
                of_groups.append([event[:, picks[radar]] for event in each[radar]])
        whole = reduce(np.union1d, seen)
        results = [weighted_statistics(looks.schedule, of_groups, whole, weight, self.ranks)]
        for i in range(len(p_d) if len(p_d) > 1 else 0):
            own = looks.schedule.of_radar(i)
            results.append(weighted_statistics(own, [each[i]], seen[i], weights[i], self.ranks))
        return results

    def _events(self, p_d: FloatArray) -> list[FloatArray]:
        """Return P_D (L, n) of the looks of a scan group, and the probability of a track by each.

        Without tracks it is P_D alone.
        """
        return [p_d] if self.m_of_n is None else [p_d, m_of_n_track(p_d, *self.m_of_n)]

    def _draw(
        self, generator: np.random.Generator, states: UncertainStates, first: int
    ) -> tuple[list[FloatArray], FloatArray]:
        """Return states (draws, 7) of radars, the first of which has this number, and weights."""
        draws = self.paths * self.draws
        normals, weight = widened_normals(generator, CANDIDATES * draws, states.radar_normals)
        by_radar = of_each(states.radars_at(normals), len(states.model.radars))
        p_d, poses = np.zeros(len(weight)), self.looks.scenario.aircraft[:, np.newaxis]
        for i, own in enumerate(by_radar, start=first):
            p_d += self.looks.p_d(i, poses, own[np.newaxis], self.screening[i]).sum(axis=0)
        chosen, weight = choose(generator, p_d, weight, draws)
        return [own[chosen] for own in by_radar], weight


def widened_normals(
    generator: np.random.Generator, draws: int, normals: int
) -> tuple[FloatArray, FloatArray]:
    """Return unit normals (draws, normals), some of them widened, and their weights (draws,).

    The normals are a Latin hypercube: each is evenly distributed (M. D. McKay, R. J. Beckman and W.
    J. Conover, Technometrics 21(2), 1979).
    """
    order = generator.permuted(np.tile(np.arange(draws), (normals, 1)), axis=1)
    values = ndtri((order.T + generator.random((draws, normals))) / draws)
    values[generator.permutation(draws) < SHARE * draws] *= WIDTH
    squares = np.sum(values * values, axis=1)
    ratio = np.exp(0.5 * (1.0 - WIDTH**-2) * squares) / WIDTH**normals
    return values, 1.0 / (1.0 - SHARE + SHARE * ratio)


def choose(
    generator: np.random.Generator, value: FloatArray, weight: FloatArray, draws: int
) -> tuple[NDArray[np.intp], FloatArray]:
    """Choose draws from candidates that are ranked by a value, more of them in the tails.

    The weights of the candidates are those of `widened_normals`. Returned are the places of the
    chosen candidates (draws,), in a random order, and their weights (draws,).
    """
    order, share, rank = np.argsort(value), weight / weight.sum(), np.empty(len(value))
    rank[order] = np.cumsum(share[order]) - 0.5 * share[order]
    # the densities of widened errors, and of even logarithms of ranks from either end, down to the
    # least rank of a bound at 3σ
    widened = 1.0 / weight - 1.0 + SHARE
    extreme = 1.0 / np.maximum(np.minimum(rank, 1.0 - rank), PARTS[0] * TAIL)
    tails = (widened / np.sum(share * widened) + extreme / np.sum(share * extreme)) / 2.0
    ratio = 1.0 - SHARE + SHARE * tails
    total = np.cumsum(share * ratio)
    level = (np.arange(draws) + generator.random()) / draws * total[-1]
    chosen = generator.permutation(np.searchsorted(total, level))
    return chosen, 1.0 / ratio[chosen]


def combine(
    generator: np.random.Generator,
    weights: Sequence[FloatArray],
    shape: tuple[int, int],
    combinations: int,
) -> tuple[list[NDArray[np.intp]], FloatArray]:
    """Combine the draws of independent radars at random, for each path.

    A combination has an emphasis on all radars, or on one of them. A radar with emphasis is drawn
    evenly, as its draws are distributed. Another is drawn in proportion to its weights, as its
    errors are distributed. The weight of a combination is the ratio of the densities for the
    mixture of all emphases (the balance heuristic: E. Veach and L. J. Guibas, "Optimally combining
    sampling techniques for Monte Carlo rendering", SIGGRAPH 1995).

    The draws have the shape (paths, draws), and each radar has weights (paths * draws,) of them.
    Returned are the places of the draws of each radar, and weights, both (paths * combinations,).
    """
    (paths, draws), radars = shape, len(weights)
    emphasis = generator.integers(radars, size=(paths, combinations))
    emphasis[generator.random(emphasis.shape) < SHARE] = radars
    even = np.broadcast_to(np.arange(combinations) % draws, emphasis.shape)
    mass, one, every = np.ones((paths, 1)), np.zeros(emphasis.shape), np.ones(emphasis.shape)
    picks = []
    for radar, weight in enumerate(w.reshape(shape) for w in weights):
        total = np.cumsum(weight, axis=1)
        level = generator.random(emphasis.shape) * total[:, -1:]
        natural = np.sum(total[:, np.newaxis] <= level[..., np.newaxis], axis=-1)
        emphasized = (emphasis == radar) | (emphasis == radars)
        pick = np.where(emphasized, generator.permuted(even, axis=1), natural)
        mean = total[:, -1:] / draws
        ratio = mean / np.take_along_axis(weight, pick, axis=1)
        mass, one, every = mass * mean, one + ratio / radars, every * ratio
        picks.append(np.ravel(pick + draws * np.arange(paths)[:, np.newaxis]))
    return picks, np.ravel(mass / ((1.0 - SHARE) * one + SHARE * every))
