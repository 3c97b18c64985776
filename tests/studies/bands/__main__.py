"""The study: how often a band, a verdict and a path are wrong.

    make study
    make study STUDY="--poses 400 --thresholds 100 --paths 100 --seed 7"

The truth of the poses is read from a file, which is made if it does not exist. 2000 poses take ten
minutes of CPU.
"""

import argparse
import time
from pathlib import Path

from . import judging, package, paths, truth
from .populations import POPULATIONS

#: Paths that graze, for each path that passes by.
PASSING_SHARE = 5
#: Seed of a truth that is drawn again.
AGAIN = 1


def bands(rows, methods):
    """Return the judged bands by method and population.

    Where a band seems to be off without a warning, the truth is drawn again, with up to sixteen
    times as many draws of another seed: among thousands of bounds, some truths are off themselves.
    """
    judged = {}
    for case, exact in rows:
        scenario = package.scenario(case)
        for method in methods:
            band = package.band(scenario, method, case.k)
            verdict = judging.judge(exact, band)
            if verdict.off and not verdict.warned:
                again = truth.truth(case, AGAIN, most=16 * truth.MOST, enough=0.2 * truth.ENOUGH)
                verdict = judging.judge(again, band)
                if verdict.off:
                    print(f"{method} is off: {case.population} {case.number}", flush=True)
            judged.setdefault((method, case.population), []).append(verdict)
    return judged


def band_table(rows, methods):
    """Return the table of the bounds."""
    judged = bands(rows, methods)
    lines = []
    for method in methods:
        found = [judged[method, population] for population in POPULATIONS]
        each = [judging.counts(verdicts) for verdicts in found]
        total = [sum(column) for column in zip(*each, strict=True)]
        for name, (poses, missed, warned, false) in zip(
            (*POPULATIONS, "all"), (*each, total), strict=True
        ):
            lines.append([f"`{method}`", name, poses, missed, warned, false])
    heads = ["method", "population", "poses", "off unwarned", "off warned", "warned, yet right"]
    return judging.markdown(heads, lines)


def verdict_table(rows, most):
    """Return the table of the thresholds beside the true bound."""
    pairs = {population: [] for population in POPULATIONS}
    for number, (case, threshold, expected) in enumerate(judging.thresholds(rows)):
        if number == most:
            break
        found = package.verdict(package.scenario(case), threshold, case.k)
        pairs[case.population].append((expected, found))
    lines = [[name, *judging.verdict_counts(found)] for name, found in pairs.items()]
    everything = [pair for found in pairs.values() for pair in found]
    lines.append(["all", *judging.verdict_counts(everything)])
    heads = ["population", "thresholds", "false holds", "false VIOLATED", "not known"]
    return judging.markdown(heads, lines)


def path_table(count, seed):
    """Return the table of the paths that graze, and of those that pass by."""
    pairs = {kind: [] for kind in (*paths.KINDS, "pass by")}
    for number in range(count):
        path = paths.grazing(seed, number)
        pairs[path.kind].append(("violated", path_verdict(path)))
    for number in range(count // PASSING_SHARE):
        pairs["pass by"].append(("holds", path_verdict(paths.passing(seed, number))))
    lines = [[name, *judging.verdict_counts(found)] for name, found in pairs.items()]
    heads = ["path", "paths", "missed", "false VIOLATED", "not known"]
    return judging.markdown(heads, lines)


def path_verdict(path):
    """Return the verdict of the package on a path at three deviations."""
    scenario = package.scenario(path.problem, aircraft=path.aircraft, time_s=path.time_s)
    return package.verdict(scenario, path.threshold, 3.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=2000)
    parser.add_argument("--thresholds", type=int, default=1000)
    parser.add_argument("--paths", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2027)
    parser.add_argument("--truth", type=Path, help="default: build/truth_SEED.npz")
    parser.add_argument("--method", action="append", help="a method to judge; default all")
    options = parser.parse_args()
    file = options.truth or Path("build") / f"truth_{options.seed}.npz"
    if not file.exists():
        file.parent.mkdir(exist_ok=True)
        truth.make(file, options.poses, options.seed)
    rows = truth.load(file)[: options.poses]
    if len(rows) < options.poses:
        parser.error(f"{file} has {len(rows)} poses only: remove it, and it is made again")
    methods = options.method or package.methods()
    for title, table, arguments in (
        ("Bounds", band_table, (rows, methods)),
        ("Thresholds 0.02 beside the true bound", verdict_table, (rows, options.thresholds)),
        ("Paths between their rows", path_table, (options.paths, options.seed)),
    ):
        start = time.process_time()
        print(f"{title}\n\n{table(*arguments)}\n", flush=True)
        print(f"({time.process_time() - start:.0f} s of CPU)\n", flush=True)


if __name__ == "__main__":
    main()
