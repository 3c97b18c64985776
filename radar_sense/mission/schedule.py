"""Times of the looks of all radars: from the first pose on, once every scan period.

The radars that have one scan period are a scan group. They look together, and their looks at one
time count as one look with a fused P_D. Scan groups may have a look time in common. Each group then
has its own look, and the looks have one pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError
from radar_sense.model.network import NetworkModel
from radar_sense.model.trajectory import MAX_ROWS, MIN_STEP, even_times
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class Schedule:
    """The looks of g scan groups at K times.

    Attributes:
        time: Times with a look (K,) [s], increasing.
        radars: The radars of each group, as places in the network.
        looks: Whether each group looks at each time (K, g).
    """

    time: FloatArray
    radars: tuple[tuple[int, ...], ...]
    looks: NDArray[np.bool_]

    def of_radar(self, radar: int) -> Schedule:
        """Return the looks of one radar by itself, at the same K times."""
        return Schedule(self.time, ((0,),), self.looks[:, [self.group_of(radar)]])

    def group_of(self, radar: int) -> int:
        """Return the scan group of a radar."""
        return next(g for g, radars in enumerate(self.radars) if radar in radars)

    def times_of(self, radar: int) -> NDArray[np.intp]:
        """Return the times, 0 to K − 1, of the looks of a radar."""
        return np.flatnonzero(self.looks[:, self.group_of(radar)])

    def latest(self, group: int) -> NDArray[np.intp]:
        """Return the latest look of a scan group by each time (K,); all look at the first time."""
        return np.cumsum(self.looks[:, group]) - 1


def schedule_looks(model: NetworkModel, time_s: FloatArray) -> Schedule:
    """Return the looks of radars along a path, from its first time [s] to its last."""
    period_by_radar = {radar.name: radar.scan_period for radar in model.radars}
    missing = [repr(name) for name, value in period_by_radar.items() if value is None]
    if missing:
        # Rows of a file must not count as looks, because more rows would give a greater P_c.
        radars = f"radar {', '.join(missing)} needs" if model.names else "a mission needs"
        raise InputError(
            f"{radars} a scan_period_s, the time [s] from one look to the next: "
            f"add scan_period_s to {'that radar' if model.names else 'radar'}, such as "
            "scan_period_s: 10, in Python Radar(scan_period=10)"
        )
    periods = tuple(dict.fromkeys(p for p in period_by_radar.values() if p is not None))
    radars_of = tuple(
        tuple(i for i, p in enumerate(period_by_radar.values()) if p == one) for one in periods
    )
    time, looks = _together([even_times(time_s, p, "radar.scan_period_s") for p in periods])
    return Schedule(time, radars_of, looks)


def _together(times_of_groups: Sequence[FloatArray]) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return all times (K,) of some scan groups, and whether each group looks (K, g).

    Times that are equal to rounding, such as 3 · 0.1 and 0.3, become one time.
    """
    if sum(map(len, times_of_groups)) > MAX_ROWS:
        raise InputError(
            f"the periods radar.scan_period_s make more than {MAX_ROWS:,} looks together"
        )
    times = np.concatenate(times_of_groups)
    number = np.repeat(np.arange(len(times_of_groups)), [len(s) for s in times_of_groups])
    order = np.argsort(times, kind="stable")
    times, number = times[order], number[order]
    rounding = 0.5 * max(MIN_STEP, 1e-15 * float(np.max(abs(times))))
    new = np.diff(times, prepend=-np.inf) > rounding
    looks = np.zeros((np.count_nonzero(new), len(times_of_groups)), dtype=bool)
    looks[np.cumsum(new) - 1, number] = True
    return times[new], looks
