"""Whether a band or a verdict is right, and the counts of the tables."""

from collections import Counter
from dataclasses import dataclass

from scipy.special import ndtr

#: A bound may differ from the truth by this, or by four standard errors.
OFF, ERRORS = 0.005, 4.0
#: Distance of a threshold from the true bound.
BESIDE = 0.02


@dataclass(frozen=True)
class Judged:
    """A band against the truth: the larger error of its two bounds, and whether it is off."""

    error: float
    off: bool
    warned: bool


def judge(truth, band):
    """Return the verdict on a band: off by more than 0.005 and by four standard errors.

    Four standard errors of the truth are an interval, and four of the bound widen it. A bound that
    is NaN is off.
    """
    errors, off = [], False
    for end in ("lower", "upper"):
        bound, error = getattr(band, end), ERRORS * getattr(band, f"{end}_se")
        low, high = getattr(truth, f"{end}_between")
        errors.append(abs(bound - getattr(truth, end)))
        off |= not (errors[-1] <= OFF or low - error <= bound <= high + error)
    return Judged(max(errors), off, band.warned)


def counts(judged):
    """Return poses, bands off unwarned, off with a warning, and right with a warning."""
    return (
        len(judged),
        sum(j.off and not j.warned for j in judged),
        sum(j.off and j.warned for j in judged),
        sum(j.warned and not j.off for j in judged),
    )


def thresholds(rows):
    """Yield problems, thresholds 0.02 below or above the true bound, and the true verdict.

    The two sides take turns in each population. A threshold is left out where it is no probability,
    or where the truth is not known to four standard errors: the distribution has a jump there.
    """
    for case, truth in rows:
        side = case.number % 2
        threshold = float(truth.upper) + (BESIDE if side else -BESIDE)
        above, error = truth.beside[side], ERRORS * truth.beside_se()[side]
        if not 0 < threshold <= 1 or abs(above - ndtr(-case.k)) <= error:
            continue
        violated = above > ndtr(-case.k) or truth.nominal > threshold
        yield case, threshold, "violated" if violated else "holds"


def verdict_counts(pairs):
    """Return thresholds, false "holds", false "violated", and "not known" of (true, found)."""
    found = Counter(pairs)
    return (
        sum(found.values()),
        found["violated", "holds"],
        found["holds", "violated"],
        found["violated", "not known"] + found["holds", "not known"],
    )


def markdown(heads, rows):
    """Return a table in Markdown."""
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
