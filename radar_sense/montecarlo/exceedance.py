"""Runs of a path: how often P_D is beyond a limit at each pose, at any pose, and for how long.

The errors of the radars are common to all poses of a run. The errors of the aircraft are a
first-order Gauss–Markov process with the correlation time of the scenario. All numbers are from the
same runs, so that P at a pose ≤ P at some pose of all ≤ the sum over poses. Between two poses the
errors of the aircraft can be larger than at both poses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.montecarlo.gauss_markov import correlate
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.progress import report
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, FloatArray
from radar_sense.streams import Stream, random_stream

#: Largest number of draws of P_D: poses times runs times radars, some minutes.
MAX_DRAWS = 1e9
#: Least and largest number of runs.
LEAST_RUNS, MAX_RUNS = 4096, 2**18
#: Values of P_D in memory at a time.
_BLOCK = 2**20


@dataclass(frozen=True, eq=False)
class Exceedance:
    """How often P_D is beyond a limit on a path of n poses, in runs of the whole path.

    Attributes:
        counts: Number of runs that are beyond the limit at each pose (n,).
        anywhere: Number of runs that are beyond the limit at any pose; None where the number would
            depend on the step of the poses, because the errors at two poses are independent.
        time: Mean time beyond the limit [s]; None for poses without times.
        time_error: Standard error of `time` [s].
        runs: Number of runs.
    """

    counts: NDArray[np.intp]
    anywhere: int | None
    time: float | None
    time_error: float | None
    runs: int

    @property
    def probability(self) -> FloatArray:
        """Probability of P_D beyond the limit at each pose (n,)."""
        return self.counts / self.runs

    def error(self, count: int | NDArray[np.intp]) -> FloatArray:
        """Return the standard error (...) of the share of a count of runs (...).

        One more run of each kind keeps the error above 0 if all runs agree.
        """
        share = (count + 1) / (self.runs + 2)
        return np.asarray(np.sqrt(share * (1.0 - share) / self.runs))


def exceedance(
    scenario: Scenario, margin: Callable[[FloatArray], FloatArray], runs: int
) -> Exceedance:
    """Draw runs of the whole path, and count where P_D has a negative margin to a limit.

    Fewer runs are made where they would be more than `MAX_DRAWS` draws, but never fewer than
    `LEAST_RUNS`: the printed digits of a probability need them.
    """
    poses = len(scenario.aircraft)
    affordable = int(MAX_DRAWS / (poses * len(scenario.model.radars)))
    runs = max(min(runs, MAX_RUNS, affordable), LEAST_RUNS)
    step = None if scenario.time_s is None else np.diff(scenario.time_s)
    # P_D of a run is nearly linear between two poses only if its errors are the same at both
    common = math.isinf(scenario.correlation_s) or not scenario.cov_aircraft.any()
    counts, hits, done = np.zeros(poses, dtype=np.intp), 0, 0
    total = squares = 0.0
    for p_d in _along_path(scenario, runs):
        margins = margin(p_d)
        beyond = margins < 0.0
        counts += np.count_nonzero(beyond, axis=0)
        hits += int(np.count_nonzero(beyond.any(axis=1)))
        if step is not None:
            halves = 0.5 * beyond  # a pose stands for half of the steps beside it
            share = share_beyond(margins) if common else halves[:, 1:] + halves[:, :-1]
            time = share @ step
            total, squares = total + float(time.sum()), squares + float(np.sum(time * time))
        done += len(p_d)
        report("runs along the path", done, runs)
    correlated = scenario.time_s is not None and scenario.correlation_s > 0
    has_anywhere = correlated or not (scenario.geometry.continuous and scenario.cov_aircraft.any())
    mean = None if step is None else total / runs
    error = None if mean is None else math.sqrt(max(squares / runs - mean**2, 0.0) / runs)
    return Exceedance(counts, hits if has_anywhere else None, mean, error, runs)


def share_beyond(margin: FloatArray) -> FloatArray:
    """Return the share (..., n − 1) of each step with a negative margin (..., n).

    The margin is linear between poses. A step to or from a pose without a margin is beyond.
    """
    known = np.isfinite(margin)
    margin = np.where(known, margin, 0.0)
    beyond, within = np.maximum(-margin, 0.0), np.maximum(margin, 0.0)
    negative = beyond[..., :-1] + beyond[..., 1:]
    whole = negative + within[..., :-1] + within[..., 1:]
    # On a line from −b to a, b/(a + b) of the step is negative.
    share = np.divide(negative, whole, out=np.zeros_like(negative), where=negative > 0)
    return np.where(known[..., :-1] & known[..., 1:], share, 1.0)


def _along_path(path: Scenario, runs: int) -> Iterator[FloatArray]:
    """Yield P_D (runs, n) with aircraft errors that are correlated along the path."""
    poses, time = len(path.aircraft), path.time_s if path.correlation_s else None
    states = path.states()
    sampler = Sampler(states, None if time is None else path.geometry.square_root)
    size = max(1, _BLOCK // (poses * len(path.model.radars)))
    for block, start in enumerate(range(0, runs, size)):
        count = min(size, runs - start)
        generator = random_stream(path.seed, Stream.PATH, block)
        radar = states.radars_at(generator.standard_normal((count, states.radar_normals)))
        normals = generator.standard_normal((poses, count, len(AIRCRAFT)))
        if time is not None:
            correlate(normals, time, path.correlation_s)
        yield sampler.draw_p_d(normals.swapaxes(0, 1), radar)
