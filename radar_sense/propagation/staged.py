"""Draws in stages: few at each pose at first, and more where they do not settle a question."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import largest_variance
from radar_sense.progress import report
from radar_sense.propagation.draws import DRAWS, Estimate, estimate, tail_probability
from radar_sense.states import ATTITUDE, FACTOR_ERRORS, POSITION, of_radar
from radar_sense.uncertain_states import UncertainStates

#: Numbers of draws at a pose, from the first stage to the last, each GROWTH times the one before.
#: Where the RCS has lobes the first stage is PRECISE: a lobe that weighs 0.13 % has five at least.
GROWTH = 4
LADDER = FIRST, FURTHER, PRECISE, MANY, LAST = [DRAWS * GROWTH**i for i in range(5)]


class StagedDraws:
    """Draws at poses, few at first and more where they do not settle a question.

    What a pose gets depends on this pose alone. Another question does not draw the same again.

    Args:
        draw: From poses (j,) of k, and a number of draws, to what these say of each pose.
        at_first: Number of draws (k,) of the first stage.
    """

    def __init__(
        self, draw: Callable[[NDArray[np.intp], int], Estimate], at_first: NDArray[np.intp]
    ) -> None:
        self._estimate, self._at_first = draw, at_first
        self._drawn: dict[int, Estimate] = {}

    @classmethod
    def of_p_d(
        cls,
        states: UncertainStates,
        beta: float,
        p_max: float = np.nan,
        first: Estimate | None = None,
    ) -> StagedDraws:
        """Return draws of P_D, see `estimate`, whose first stage may be known."""

        def draw(rows: NDArray[np.intp], draws: int) -> Estimate:
            return estimate(states.at(rows), draws, beta, p_max)

        return cls(draw, draws_at_first(states)) if first is None else cls.after(first, draw)

    @classmethod
    def of_tail(cls, states: UncertainStates, beta: float, value: float) -> StagedDraws:
        """Return draws of the probability of a tail alone, see `tail_probability`."""

        def draw(rows: NDArray[np.intp], draws: int) -> Estimate:
            tail, error = tail_probability(states.at(rows), draws, beta, value)
            return Estimate.of_tail(tail, error, draws)

        return cls(draw, draws_at_first(states))

    @classmethod
    def after(
        cls, first: Estimate, draw: Callable[[NDArray[np.intp], int], Estimate]
    ) -> StagedDraws:
        """Return draws whose first stage is known at all poses."""
        staged = cls(draw, first.draws.astype(int))
        for number in np.unique(staged._at_first).tolist():
            rows = np.flatnonzero(first.draws == number)
            staged._known(number).put(rows, first.at(rows))
        return staged

    def until(
        self,
        settled: Callable[[NDArray[np.intp], Estimate], NDArray[np.bool_]],
        most: int | NDArray[np.intp],
    ) -> Estimate:
        """Return what draws say of P_D at each pose.

        More draws, but no more than `most` (k,), are made at poses (j,) where their estimate is not
        `settled` (j,).
        """
        k = len(self._at_first)
        rows = np.arange(k)
        drawn = Estimate.constant(k, np.nan)
        self._draw(drawn, rows, self._at_first)
        while rows.size:
            rows = rows[~settled(rows, drawn.at(rows))]
            report("poses looked at by draws", k - rows.size, k)
            rows = rows[drawn.draws[rows] * GROWTH <= np.broadcast_to(most, k)[rows]]
            self._draw(drawn, rows, GROWTH * drawn.draws[rows].astype(int))
        report("poses looked at by draws", k, k)
        return drawn

    def _draw(self, drawn: Estimate, rows: NDArray[np.intp], draws: NDArray[np.intp]) -> None:
        """Overwrite what is drawn at some poses (j,) by these numbers of draws (j,)."""
        for number in np.unique(draws).tolist():
            some = rows[draws == number]
            drawn.put(some, self._at(some, number))

    def _at(self, rows: NDArray[np.intp], draws: int) -> Estimate:
        """Return what this number of draws says at some poses, from before where it is known."""
        known = self._known(draws)
        new = rows[np.isnan(known.draws[rows])]
        if new.size:
            known.put(new, self._estimate(new, draws))
        return known.at(rows)

    def _known(self, draws: int) -> Estimate:
        """Return what is known from this number of draws, NaN where nothing is, to be filled."""
        return self._drawn.setdefault(draws, Estimate.constant(len(self._at_first), np.nan))


def draws_at_first(states: UncertainStates) -> NDArray[np.intp]:
    """Return the number of draws (k,) of the first stage at each of k poses.

    It is `FIRST`, and `PRECISE` where ±3σ of the aspect of a radar are wider than a lobe of RCS or
    antenna. Few draws may then miss a lobe that weighs as much as a tail. σ is at most this.
    """
    with_lobes = np.zeros(len(states), dtype=bool)
    attitude = largest_variance(states.cov_aircraft[:, ATTITUDE, ATTITUDE])
    for i, radar in enumerate(states.model.radars):
        position = of_radar(i, POSITION)
        line = states.aircraft[:, POSITION] - states.radar[:, position]
        across = largest_variance(states.cov_aircraft[:, POSITION, POSITION])
        across = across + largest_variance(states.cov_radar[:, position, position])
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = across / np.sum(line * line, axis=1)
        with_lobes |= ~(radar.model.rcs.detail >= 6.0 * np.sqrt(attitude + turned))
        for factor in radar.model.factors:
            error = of_radar(i).start + FACTOR_ERRORS[factor.parameter]
            own = states.cov_radar[:, error, error]
            with_lobes |= ~(factor.detail >= 6.0 * np.sqrt(own + turned))
    return np.where(with_lobes, np.intp(PRECISE), np.intp(FIRST))
