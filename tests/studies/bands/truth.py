"""The truth of problems of one pose, by plain draws.

Draws come in batches until both bounds have a standard error below 0.001, or up to the most. The
standard error of a quantile is half the distance of two order statistics, one deviation of the
binomial count below and above it. The interval of four deviations stands beside it, because it also
holds where the distribution has a jump.
"""

import time
from dataclasses import dataclass, fields

import numpy as np
from scipy.special import ndtr

from .model import Oracle
from .populations import POPULATIONS, problem, problems

BATCH, CHUNK, MOST = 200_000, 20_000, 1_200_000
ENOUGH = 0.001


@dataclass(frozen=True, eq=False)
class Truth:
    """The distribution of P_D at one pose.

    Attributes:
        nominal: P_D of the nominal states.
        mean, mean_se, std, std_se: Moments and their standard errors.
        lower, lower_se, upper, upper_se: Quantiles at Φ(−k) and Φ(k) and their standard errors.
        lower_between, upper_between: Intervals (2,) of four standard errors of the quantiles.
        beside: P(P_D > p) at p 0.02 below and above the upper bound (2,).
        draws: Number of draws.
    """

    nominal: float
    mean: float
    mean_se: float
    std: float
    std_se: float
    lower: float
    lower_se: float
    lower_between: np.ndarray
    upper: float
    upper_se: float
    upper_between: np.ndarray
    beside: np.ndarray
    draws: int

    def beside_se(self):
        """Return the standard errors of `beside`."""
        return probability_se(self.beside, self.draws)


def probability_se(p, draws):
    """Return the standard error of a share of draws. No draw at all counts as one."""
    return np.sqrt(np.clip(p * (1 - p), 1 / draws, None) / draws)


def drawn(oracle, rng, count):
    """Return P_D (n,) at drawn states, chunk by chunk."""
    return np.concatenate([
        oracle.p_d(*oracle.draw(rng, min(CHUNK, count - start))) for start in range(0, count, CHUNK)
    ])  # fmt: skip


def ends(p_d, level):
    """Return the quantile at a level, its standard error and its interval (2,) of four."""
    n = len(p_d)
    error = np.sqrt(n * level * (1 - level))
    ranks = n * level + error * np.array([-4, -1, 0, 1, 4]) - 0.5
    ranks = np.clip(np.rint(ranks), 0, n - 1).astype(int)
    low4, low, middle, high, high4 = np.partition(p_d, ranks)[ranks]
    return middle, 0.5 * (high - low), np.array([low4, high4])


def truth(case, seed, *, most=MOST, enough=ENOUGH):
    """Return the truth of a problem by plain draws."""
    oracle = Oracle(case)
    rng = np.random.Generator(
        np.random.SFC64([seed, 7, list(POPULATIONS).index(case.population), case.number])
    )
    p_d = np.empty(0)
    while len(p_d) < most:
        p_d = np.append(p_d, drawn(oracle, rng, min(BATCH, most - len(p_d))))
        lower, upper = ends(p_d, ndtr(-case.k)), ends(p_d, ndtr(case.k))
        if max(lower[1], upper[1]) < enough:
            break
    n = len(p_d)
    centred = p_d - p_d.mean()
    std = p_d.std()
    fourth = np.mean(centred**4)
    return Truth(
        nominal=oracle.nominal(),
        mean=p_d.mean(),
        mean_se=std / np.sqrt(n),
        std=std,
        std_se=np.sqrt(max(fourth - std**4, 0.0) / n) / (2 * std) if std > 0 else 0.0,
        lower=lower[0],
        lower_se=lower[1],
        lower_between=lower[2],
        upper=upper[0],
        upper_se=upper[1],
        upper_between=upper[2],
        beside=np.mean(p_d > upper[0] + np.array([[-0.02], [0.02]]), axis=1),
        draws=n,
    )


def save(path, seed, rows):
    """Write the truths of problems to a file, one array for each field."""
    columns = {f.name: [getattr(truth, f.name) for _, truth in rows] for f in fields(Truth)}
    columns |= {
        name: [getattr(case, name) for case, _ in rows] for name in ("population", "number")
    }
    np.savez_compressed(path, seed=seed, **columns)


def load(path):
    """Return problems and their truths from a file.

    Raises:
        ValueError: If the file was made of other problems.
    """
    data, rows = dict(np.load(path)), []
    for row, (population, number) in enumerate(
        zip(data["population"], data["number"], strict=True)
    ):
        case = problem(str(population), int(data["seed"]), int(number))
        rows.append((case, Truth(**{f.name: data[f.name][row] for f in fields(Truth)})))
        if abs(Oracle(case).nominal() - rows[-1][1].nominal) > 1e-9:
            raise ValueError(f"{path} is of another version of {population} {number}: make it")
    return rows


def make(path, poses, seed):
    """Compute the truth of this many poses of all populations together, and write it to a file."""
    rows, start = [], time.process_time()
    for case in problems(poses // len(POPULATIONS), seed):
        rows.append((case, truth(case, seed)))
        if len(rows) % 100 == 0:
            save(path, seed, rows)
            print(f"{len(rows)} poses, {time.process_time() - start:.0f} s of CPU", flush=True)
    save(path, seed, rows)
