"""The columns of tables: name, unit and meaning, declared once for the record and the reference.

Each analysis declares its columns with `@analysis(columns=...)`. A name may have a placeholder for
a word, as in `three_sigma_<level>`. Columns of several analyses are in this file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from radar_sense.units import unit_name

_PLACEHOLDER = re.compile(r"<\w+>")


@dataclass(frozen=True)
class Column:
    """A column of a table, or several columns with a placeholder in the name.

    Attributes:
        name: The name in the first row of the file.
        meaning: Meaning of the numbers. The text may have the placeholder too.
        unit: The unit; "" for a pure number.
    """

    name: str
    meaning: str
    unit: str

    def named(self, name: str) -> Column | None:
        """Return the column with the placeholders filled by a name, or None if there is no fit."""
        words = _PLACEHOLDER.findall(self.name)
        pattern = "(.+)".join(map(re.escape, _PLACEHOLDER.sub("\0", self.name).split("\0")))
        fits = re.fullmatch(pattern, name)
        if not fits:
            return None
        meaning = self.meaning
        for word, filling in zip(words, fits.groups(), strict=True):
            meaning = meaning.replace(word, filling)
        return Column(name, meaning, self.unit)


def quantity(name: str, meaning: str) -> Column:
    """Return a column with the unit at the end of its name, before a placeholder."""
    return Column(name, meaning, unit_name(name.partition("_<")[0]))


def quantities(meanings: Mapping[str, str]) -> tuple[Column, ...]:
    """Return columns as `quantity` does, from their meanings by name."""
    return tuple(quantity(name, meaning) for name, meaning in meanings.items())


def of_radars(columns: Iterable[Column]) -> tuple[Column, ...]:
    """Return the columns of each radar of a network."""
    return tuple(
        Column(f"{c.name}_<radar>", f"For radar <radar> alone: {c.meaning}", c.unit)
        for c in columns
    )


def find(columns: Sequence[Column], name: str) -> Column | None:
    """Return the declared column of a name, with the placeholder filled, or None."""
    # The longest name first, because `lower_3sigma_<radar>` fits `lower_3sigma_se_<radar>` too.
    longest_first = sorted(columns, key=lambda c: ("<" in c.name, -len(c.name)))
    return next((column for c in longest_first if (column := c.named(name))), None)


AXIS = quantities(
    {
        "theta_r_deg": "Azimuth of the pose on an orbit.",
        "time_s": "Time of the pose on a path.",
        "distance_m": "Distance flown to the pose on a path.",
        "pose": "Number of the pose, from 0, of states given in Python.",
    }
)
P_D = quantity("p_d", "P_D at the nominal states, of all radars together.")
BAND = (
    P_D,
    *quantities(
        {
            "sigma_pd": "Standard deviation of P_D.",
            "lower_3sigma": "Lower 3-sigma bound of P_D.",
            "upper_3sigma": "Upper 3-sigma bound of P_D.",
        }
    ),
)
MEAN = quantity("mean_pd", "Mean of P_D; for linear the mean is p_d.")
DRAWS = quantities(
    {
        "mc_mean": "Mean of the draws of P_D.",
        "mc_std": "Standard deviation of the draws of P_D.",
        "mc_lower": "Quantile of the draws at 0.00135, as -3 sigma of a normal distribution.",
        "mc_upper": "Quantile of the draws at 0.99865, as +3 sigma of a normal distribution.",
    }
)
COVERAGE = quantity("coverage_3sigma", "Share of the draws within the 3-sigma band of the method.")
