"""The errors of the package at all poses of the reference set, by method.

    make study

The table has the errors of the 3σ bounds, and of P(P_D > p). A bound is off by more than 0.005 and
four standard errors. The figure has the share of poses with an error above a value.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from reference import reading
from reference.judging import exact_errors, judge
from studies.bands.judging import markdown

from radar_sense import plotting
from radar_sense.propagation import METHODS
from radar_sense.propagation.methods import distribution

#: Errors below this are not shown.
LEAST = 1e-7


def probability_errors(method):
    """Return errors of P(P_D > p) at all poses, less four standard errors of the set."""
    found = []
    for block, c in reading.read():
        stated = np.empty(len(c["p_d"]))
        for i, p_max in enumerate(c["p_max"]):
            alone = reading.as_scenario(block, c, slice(i, i + 1))
            stated[i] = distribution(alone, method).exceedance(float(p_max))[0]
        found.append(abs(stated - c["exceedance"]) - 4 * c["exceedance_se"])
    return np.maximum(np.concatenate(found), 0.0)


def row(method, judged, probability):
    """Return the line of a method in the table."""
    error, off, warned = (
        np.concatenate([getattr(j, name) for j in judged]) for name in ("error", "off", "warned")
    )
    quiet = error[~warned]
    return [
        f"`{method}`",
        *(f"{np.quantile(error[~np.isnan(error)], q):.1g}" for q in (0.5, 0.95)),
        f"{quiet.max():.2g}" if quiet.size else "",
        int(warned.sum()),
        int((off & ~warned).sum()),
        *(f"{np.nanquantile(probability, q):.1g}" for q in (0.5, 0.99)),
    ]


def draw(errors, exact):
    """Return the figure: shares of poses with a larger error, exact numbers and bounds."""

    def plot(figure):
        plotting.set_height(figure, 4.4)
        above, below = figure.subplots(2, 1, sharey=True)
        names = ("P_D, relative", "σ to first order, relative", "gradient, over σ")
        for name, values in zip(names, exact, strict=True):
            curve(above, values, 1e-17, name)
        above.axvline(2.0**-53, color="0.4", lw=0.8, ls=":")
        above.set_xlabel("error of exact numbers; dotted: rounding")
        for method, values in errors.items():
            curve(below, values, LEAST, method)
        below.axvline(0.005, color="0.4", lw=0.8, ls=":")
        below.set_xlabel("error of the worse 3σ bound; dotted: allowed")
        for panel in (above, below):
            panel.set_xscale("log")
            panel.set_ylabel("poses above [%]")
            panel.legend(fontsize="small")

    return plotting.draw(plot, "2019 poses of tests/reference")


def curve(panel, values, least, label):
    """Draw the share of values above a value; NaN is above all."""
    ordered = np.sort(np.where(np.isnan(values), np.inf, np.maximum(values, least)))
    share = 100 * (1 - np.arange(len(ordered)) / len(ordered))
    panel.step(ordered, share, where="pre", label=label)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder of the figure")
    options = parser.parse_args()
    every = [exact_errors(*one)[:, one[1]["std_linear"] > 0] for one in reading.read()]
    exact = np.concatenate(every, axis=1)
    print("largest errors of P_D, σ and gradient:", *(f"{e.max():.1e}" for e in exact))
    lines, errors = [], {}
    for method in METHODS:
        start = time.process_time()
        judged = [judge(block, columns, method) for block, columns in reading.read()]
        lines.append(row(method, judged, probability_errors(method)))
        errors[method] = np.concatenate([j.error for j in judged])
        print(f"{method}: {time.process_time() - start:.0f} s of CPU", flush=True)
    heads = ["method", "median", "95 % below", "worst unwarned", "warned", "off unwarned"]
    print(markdown([*heads, "P: median", "P: 99 % below"], lines))
    if options.out:
        (options.out / "reference_errors.png").write_bytes(
            plotting.render(draw(errors, exact), "png")
        )


if __name__ == "__main__":
    main()
