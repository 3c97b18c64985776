"""Whether the distribution of P_D covers what it says, over random scenarios.

    make study

In a random scenario the true states are drawn by a program without code of the package, and give
the true P_D. Its rank among the quantiles that the package states is uniform if they are right
(simulation-based calibration: S. Talts et al., arXiv 1804.06788). Standard errors are those between
scenarios. A bound may be off by 0.005: a distribution that is narrower than NARROW is no test.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.special import ndtr, ndtri
from studies.bands import package
from studies.bands.judging import markdown
from studies.bands.model import Oracle
from studies.bands.populations import POPULATIONS, problem

from radar_sense import plotting
from radar_sense.propagation.methods import distribution

SEED, DRAWS = 2029, 4000
KS = (1.0, 2.0, 3.0)
BINS = 10
#: Numbers of standard deviations of the edges between bins, and of the bands.
EDGES = ndtri(np.arange(1, BINS) / BINS)
BOUNDS = np.array([-k for k in reversed(KS)] + list(KS))
#: A value that so large a share of the draws has is an atom: P_D is 0 beyond a limit.
ATOM = 0.001
#: Ten times what a bound may be off by.
NARROW = 0.05


def shares(values, quantiles, levels):
    """Return the share (n + 1,) of true values below, between and above quantiles (n,).

    A quantile may be an atom of P_D: then the rank of a value is random between the true shares
    below and up to the atom, as far as the quantiles at the atom allow.
    """
    count = np.bincount(np.searchsorted(quantiles, values), minlength=len(levels) + 1)
    count = count.astype(float)
    atoms, numbers = np.unique(values, return_counts=True)
    for atom in atoms[numbers > ATOM * len(values)]:
        at = np.isclose(quantiles, atom, rtol=0, atol=1e-9)
        if not at.any():
            continue
        below, upto = np.sum(values < atom), np.sum(values <= atom)
        place = np.searchsorted(quantiles, atom)
        count[place] -= upto - below
        rank = (np.arange(below, upto) + 0.5) / len(values)
        first, last = np.flatnonzero(at)[[0, -1]]
        bins = np.clip(np.searchsorted(levels, rank), first, last + 1)
        count += np.bincount(bins, minlength=len(levels) + 1)
    return count / len(values)


def of_scenario(case, method):
    """Return the shares in the bins, those below, between and above the bounds, and σ."""
    oracle = Oracle(case)
    values = oracle.p_d(*oracle.draw(np.random.default_rng([SEED, case.number]), DRAWS))
    stated = distribution(package.scenario(case), method)
    found = []
    for betas in (EDGES, BOUNDS):
        quantiles = np.array([stated.quantile(float(beta))[0] for beta in betas])
        found.append(shares(values, np.maximum.accumulate(quantiles), ndtr(betas)))
    return [*found, values.std()]


def calibrate(method, population, count):
    """Return shares (count, bins) and (count, bounds + 1), and σ (count,) of random scenarios.

    Scenarios in which the method has no distribution are left out.
    """
    found = []
    for number in range(count):
        rows = of_scenario(problem(population, SEED, number), method)
        if not any(np.isnan(row).any() for row in rows):
            found.append(rows)
    return tuple(np.array(rows) for rows in zip(*found, strict=True))


def mean_and_error(rows):
    """Return the mean of rows (n, ...), and its standard error."""
    return rows.mean(axis=0), rows.std(axis=0, ddof=1) / np.sqrt(len(rows))


def covered(rows):
    """Return the share (n,) inside the bands at each k (n, 3)."""
    size = rows.shape[1]
    return np.stack([rows[:, i : size - i].sum(axis=1) for i in range(len(KS), 0, -1)], axis=1)


def table(results, least):
    """Return the table of the coverage of the scenarios with at least this σ."""
    lines = []
    for (method, population), (_, rows, std) in results.items():
        rows = rows[std >= least]
        line = [f"`{method}`", population, len(rows)]
        for mean, error in zip(*mean_and_error(100 * covered(rows)), strict=True):
            line.append(f"{mean:.2f} ± {error:.2f}")
        lines.append(line)
    said = [f"{k:.0f}σ: {100 * (1 - 2 * ndtr(-k)):.2f} %" for k in KS]
    return markdown(["method", "population", "scenarios", *said], lines)


def histogram(result):
    """Return mean and standard error of the shares in the bins, where σ is not narrow."""
    bins, _, std = result
    return mean_and_error(BINS * bins[std >= NARROW])


def draw(results, count):
    """Return the rank histograms."""

    def plot(figure):
        plotting.set_height(figure, 3.6)
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        edges = np.arange(BINS + 1) / BINS
        for panel, population in zip(panels.ravel(), POPULATIONS, strict=True):
            mean, error = histogram(results["automatic", population])
            label, thin = "automatic, and ±2 standard errors", {"elinewidth": 0.8}
            style = {"align": "edge", "alpha": 0.6, "error_kw": thin, "label": label}
            panel.bar(edges[:-1], mean, 1 / BINS, yerr=2 * error, **style)
            mean, _ = histogram(results["linear", population])
            panel.stairs(mean, edges, color="C1", label="linear")
            panel.axhline(1.0, color="0.3", lw=0.8)
            panel.set_title(population)
        for panel in panels[1]:
            panel.set_xlabel("rank of the true P_D")
        for panel in panels[:, 0]:
            panel.set_ylabel("share × 10")
        plotting.draw_legend(figure, panels[0, 0])

    return plotting.draw(plot, f"{count} random scenarios each; those with σ of P_D above {NARROW}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenarios", type=int, default=250, help="of each population")
    parser.add_argument("--out", type=Path, help="folder of the figure")
    options = parser.parse_args()
    results = {
        (method, population): calibrate(method, population, options.scenarios)
        for method in ("automatic", "linear")
        for population in POPULATIONS
    }
    for least in (0.0, NARROW):
        print(f"σ of P_D at least {least}\n\n{table(results, least)}\n", flush=True)
    for population in POPULATIONS:
        mean, error = histogram(results["automatic", population])
        print(population, " ".join(f"{m:.3f}±{e:.3f}" for m, e in zip(mean, error, strict=True)))
    if options.out:
        picture = plotting.render(draw(results, options.scenarios), "png")
        (options.out / "calibration.png").write_bytes(picture)


if __name__ == "__main__":
    main()
