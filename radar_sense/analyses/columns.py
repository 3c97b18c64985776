"""The columns of tables: name, unit and meaning, declared once for the record and the reference.

Each analysis declares its columns with `@analysis(columns=...)`. A name may have a placeholder for
a word, as in `three_sigma_<level>`. This file has the columns common to several analyses.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from radar_sense.keys import unit_name

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


AXIS = (
    quantity("theta_r_deg", "Azimuth of the pose on an orbit."),
    quantity("time_s", "Time of the pose on a path."),
    quantity("distance_m", "Distance flown to the pose on a path."),
    quantity("pose", "Number of the pose, from 0, of states given in Python."),
)
P_D = quantity("p_d", "P_D at the nominal states, of all radars together.")
LINK = (
    quantity("range_m", "Slant range to the radar."),
    quantity("rcs_m2", "Radar cross section towards the radar."),
    quantity("snr_db", "Signal-to-noise ratio of a single pulse."),
)
BAND = (
    P_D,
    quantity("sigma_pd", "Standard deviation of P_D."),
    quantity("lower_3sigma", "Lower 3-sigma bound of P_D."),
    quantity("upper_3sigma", "Upper 3-sigma bound of P_D."),
)
MEAN = quantity("mean_pd", "Mean of P_D; for linear the mean is p_d.")
DRAWS = (
    quantity("mc_mean", "Mean of the draws of P_D."),
    quantity("mc_std", "Standard deviation of the draws of P_D."),
    quantity("mc_lower", "Quantile of the draws at 0.00135, as -3 sigma of a normal distribution."),
    quantity("mc_upper", "Quantile of the draws at 0.99865, as +3 sigma of a normal distribution."),
)
COVERAGE = quantity("coverage_3sigma", "Share of the draws within the 3-sigma band of the method.")
PLACES = (
    quantity("north_m", "North of the aircraft from the origin, on a path."),
    quantity("east_m", "East of the aircraft from the origin, on a path."),
    quantity("down_m", "Down of the aircraft from the origin, on a path."),
    quantity("latitude_deg", "WGS-84 latitude of the aircraft, on a path with an origin."),
    quantity("longitude_deg", "WGS-84 longitude of the aircraft, on a path with an origin."),
    quantity("altitude_m", "Height of the aircraft above the ellipsoid, on a path with an origin."),
)
OF_THRESHOLD = (
    quantity("upper_<k>sigma", "With --threshold and --k: upper bound of P_D at <k> sigma."),
    quantity("margin", "With --threshold: P_MAX minus the upper bound of P_D."),
    quantity("violated", "With --threshold: 1 where the bound is above P_MAX, else 0."),
    quantity("not_known", "With --threshold: 1 where the test has no answer, else 0."),
    quantity("probability_above", "With --threshold: probability that P_D is above P_MAX."),
)
