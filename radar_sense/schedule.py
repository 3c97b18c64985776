"""When the radars of a scenario look: each from the first pose on, once every period of its own.

Radars that have the same period look together, and what they see is one look, as that of one radar
with their fused P_D. So a network whose radars all have one period has one sequence of looks, and
one whose periods differ has one for each period. At times that sequences have in common there is a
look of each, and all of these see one pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.cumulative import Interleaved, Model
from radar_sense.errors import InputError
from radar_sense.model.network import NetworkModel
from radar_sense.model.trajectory import MAX_ROWS, MIN_STEP, Route, even_times, interpolate
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class Schedule:
    """The looks of s sequences at K times, in order L looks.

    Attributes:
        time: Times at which someone looks (K,) [s], increasing.
        period: Period of each sequence [s]; None if it looks at the poses.
        radars: The radars of each sequence, as places in the network.
        looks: Which sequences look at each time (K, s).
    """

    time: FloatArray
    period: tuple[float | None, ...]
    radars: tuple[tuple[int, ...], ...]
    looks: NDArray[np.bool_]

    @property
    def pose(self) -> NDArray[np.intp]:
        """The time, 0 to K − 1, of each look (L,)."""
        return np.nonzero(self.looks)[0]

    @property
    def sequence(self) -> NDArray[np.intp] | None:
        """The sequence of each look (L,), or None where there is but one."""
        return np.nonzero(self.looks)[1] if len(self.radars) > 1 else None

    @property
    def first(self) -> NDArray[np.intp]:
        """The first look at each time (K,)."""
        return np.searchsorted(self.pose, np.arange(len(self.time)))

    @property
    def last(self) -> NDArray[np.intp]:
        """The last look at each time (K,)."""
        return np.searchsorted(self.pose, np.arange(len(self.time)), side="right") - 1

    def model(self, model: Model) -> Model:
        """Return the model of the L looks, given that of the radars."""
        sequence = self.sequence
        if sequence is None or not isinstance(model, NetworkModel):
            return model
        parts = (NetworkModel(tuple(model.radars[i] for i in some)) for some in self.radars)
        return Interleaved(tuple(parts), sequence, self.radars)

    def of_radar(self, radar: int) -> tuple[Schedule, NDArray[np.intp]]:
        """Return the schedule of one radar by itself, and which of the times are its own."""
        (mine,) = (s for s, some in enumerate(self.radars) if radar in some)
        own = np.flatnonzero(self.looks[:, mine])
        looks = np.ones((len(own), 1), dtype=bool)
        return Schedule(self.time[own], (self.period[mine],), ((0,),), looks), own


def schedule(model: NetworkModel, period: float | None, poses: Route) -> tuple[Schedule, Route]:
    """Find when the radars of a model look, and the poses at these times.

    Args:
        model: The model, which has the periods of its radars if it is a `NetworkModel`.
        period: Period of a single radar, None if it looks at the poses.
        poses: The poses.

    Raises:
        InputError: If some radars have a period and others none, or one is not possible.
    """
    every = [radar.scan_period for radar in model.radars]
    if None in every and any(p is not None for p in every):
        missing = model.radars[every.index(None)].name
        raise InputError(
            f"radar {missing!r} needs a scan_period_s, as other radars have one; "
            "only where none has do all look at the poses of the path"
        )
    periods = tuple(dict.fromkeys(every))
    radars = tuple(tuple(i for i, p in enumerate(every) if p == one) for one in periods)
    if None in periods:
        time, looks = poses.time_s, np.ones((len(poses.time_s), 1), dtype=bool)
    else:
        time, looks = _together([_times(poses, p) for p in periods if p is not None])
        poses = interpolate(poses, time)
    return Schedule(time, periods, radars, looks), poses


def _times(poses: Route, period: float) -> FloatArray:
    try:
        return even_times(poses, period)
    except InputError as error:  # it knows the period as its own argument
        raise InputError(str(error).replace("step_s", "radar.scan_period_s")) from error


def _together(sequences: Sequence[FloatArray]) -> tuple[FloatArray, NDArray[np.bool_]]:
    """All times (K,) of some sequences, and which of these have each (K, s).

    Times that differ by rounding alone, as 3 · 0.1 and 0.3, are one.
    """
    if sum(map(len, sequences)) > MAX_ROWS:
        raise InputError(
            f"the periods radar.scan_period_s make more than {MAX_ROWS:,} looks together"
        )
    every = np.concatenate(sequences)
    number = np.repeat(np.arange(len(sequences)), [len(s) for s in sequences])
    order = np.argsort(every, kind="stable")
    every, number = every[order], number[order]
    rounding = 0.5 * max(MIN_STEP, 1e-15 * float(np.max(abs(every))))
    new = np.diff(every, prepend=-np.inf) > rounding
    looks = np.zeros((np.count_nonzero(new), len(sequences)), dtype=bool)
    looks[np.cumsum(new) - 1, number] = True
    return every[new], looks
