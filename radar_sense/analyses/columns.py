"""The columns of tables: name, unit and meaning, declared once for the record and the reference.

Each analysis declares its columns with `@analysis(columns=...)`. A name may have a placeholder, as
in `three_sigma_<level>`, which stands for any word in its place. Groups of columns that several
analyses have are here.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from radar_sense.keys import unit_name


@dataclass(frozen=True)
class Column:
    """A column of a table, or several columns with a placeholder in the name.

    Attributes:
        name: The name, as in the first row of the file.
        meaning: What the numbers are. The placeholder may stand here too.
        unit: The unit; "" for a pure number.
    """

    name: str
    meaning: str
    unit: str

    def named(self, name: str) -> Column | None:
        """Return the column with a word in place of the placeholder; None if none fits a name."""
        before, opening, rest = self.name.partition("<")
        word, _, after = rest.partition(">")
        filling = name[len(before) : len(name) - len(after)]
        if name != before + filling + after or bool(filling) != bool(opening):
            return None
        return Column(name, self.meaning.replace(f"<{word}>", filling), self.unit)


def quantity(name: str, meaning: str) -> Column:
    """Return a column whose name ends with its unit, before a placeholder."""
    return Column(name, meaning, unit_name(name.partition("_<")[0]))


def of_radars(columns: Iterable[Column]) -> tuple[Column, ...]:
    """Return the columns of each radar of a network."""
    return tuple(
        Column(f"{c.name}_<radar>", f"For radar <radar> alone: {c.meaning}", c.unit)
        for c in columns
    )


def find(columns: Sequence[Column], name: str) -> Column | None:
    """Return the declared column of a name, with its placeholder filled; None if there is none."""
    # the longest name first, as `lower_3sigma_<radar>` fits `lower_3sigma_se_<radar>` too
    longest_first = sorted(columns, key=lambda c: ("<" in c.name, -len(c.name)))
    return next((found for c in longest_first if (found := c.named(name))), None)


AXIS = (
    quantity("theta_r_deg", "Azimuth of the pose on an orbit."),
    quantity("time_s", "Time of the pose on a path."),
    quantity("distance_m", "Distance flown to the pose on a path."),
    quantity("pose", "Number of the pose, from 0, of states given in Python."),
)
P_D = quantity("p_d", "P_D at the nominal states; of a network that of all radars together.")
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
MEAN = quantity("mean_pd", "Mean of P_D; not by linear, for which it is p_d.")
DRAWS = (
    quantity("mc_mean", "Mean of the draws of P_D."),
    quantity("mc_std", "Standard deviation of the draws of P_D."),
    quantity("mc_lower", "Quantile 0.00135 of the draws, which is at -3 sigma of a normal."),
    quantity("mc_upper", "Quantile 0.99865 of the draws, which is at +3 sigma of a normal."),
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
    quantity("margin", "With --threshold: P_MAX less the upper bound of P_D."),
    quantity("violated", "With --threshold: 1 where the bound is above P_MAX, else 0."),
    quantity("not_known", "With --threshold: 1 where no method at hand can tell, else 0."),
    quantity("probability_above", "With --threshold: probability that P_D is above P_MAX."),
)
