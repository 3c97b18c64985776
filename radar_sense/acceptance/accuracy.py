"""The accuracy of each source at which a limit of the uncertainty of P_D is met.

A method says how far the standard deviations of a source may grow, or must shrink. Draws verify it
at the deviations that this leads to.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import TO_HOLD
from radar_sense.axis import reached
from radar_sense.cost import FIRST_ORDER
from radar_sense.progress import report
from radar_sense.propagation import AUTOMATIC, BOUND_CHANGE, STD_CHANGE
from radar_sense.propagation.automatic import PART_OF_BOUND
from radar_sense.propagation.draws import Estimate, estimate
from radar_sense.propagation.staged import LAST, MANY, PRECISE, StagedDraws
from radar_sense.scenario import Scenario
from radar_sense.sources import (
    FINER,
    PART,
    SOURCE,
    error_budget,
    scaled,
    sources_of,
    value_function,
)
from radar_sense.states import FloatArray

#: Draws at a pose of a look at all poses. `PRECISE` draws verify a factor, `MANY` find one.
LOOK = 256
#: Poses at which draws verify a factor: as many with the largest values by the method, and as many
#: with the largest values by few draws at all poses.
VERIFIED = 16
#: Step in ln of a factor by a method, outwards to bracket it.
STEP = float(np.log(4.0))
#: Step in ln of the factors that draws judge on the way to a last one, half a decade, and the width
#: in ln of the bracket that ends their search. Beside a limit in reach σ is large over more than a
#: decade: from errors of a third of the distance to the limit to errors of several ranges.
WAY, NEAR = float(np.log(10.0)) / 2.0, 0.005
#: Standard errors by which draws are sure that a limit is exceeded.
SURE = 5.0
#: `RequiredAccuracy.residual_from` where P_D at the nominal states is beyond the limit.
P_D_ITSELF = "P_D itself"
#: Factors are searched from a millionth to a million. A larger factor counts as infinite, and a
#: smaller factor as 0.
LARGEST_LOG_FACTOR = float(np.log(1e6))


@dataclass(frozen=True)
class RequiredAccuracy:
    """Accuracy of a source at which 3σ of P_D, or a bound of P_D, is within a limit.

    Attributes:
        factor: Largest factor on the standard deviations of the source. Below 1 the source has to
            shrink. None if the limit is exceeded at factor 0, or no factor is known, and 0 if
            exceeded at a millionth. Infinite if a million is within the limit.
        residual: Value at `factor`, or at factor 0 if `factor` is None.
        place: Place of the residual on the scenario's axis.
        residual_from: Largest of the other sources at the place. None if all sources are scaled
            together, or the method knows of no other. `P_D_ITSELF` if P_D exceeds the limit.
        known: False if a larger factor may do: beyond `factor` there is no value, or draws alone
            have found it.
        exceeded_at_0: Whether draws find the limit exceeded where the source is certain, of a
            factor below 1 or infinite. Errors may take P_D away from the limit.
    """

    factor: float | None
    residual: float
    place: float
    residual_from: str | None
    known: bool = True
    exceeded_at_0: bool = False


def required_accuracies(
    scenario: Scenario, goal: Requirement, *, method: str = "linear"
) -> dict[str, RequiredAccuracy]:
    """Return the accuracy of each source at which a goal is met at all poses.

    The search by the method assumes that the value grows with the source. Correlations and limits
    of a radar can violate this. Draws therefore judge every factor at the deviations that it leads
    to, and a factor above 1 also on the way there. Where they disagree, they find a smaller factor
    that they are sure of. Where P_D itself must be within the limit and is not, no accuracy is
    enough. Where it need not be, and is not, a smaller σ may lead beyond the limit: a source that
    no factor is found for is not known.

    What is returned is the accuracy required of each source and of each part of a radar constant,
    and in a network of position, constant and further parameters of each radar that is enough
    alone. The other sources are unchanged. "all" scales all sources together.
    """
    if not goal.width and (goal.probability is None or scenario.states().certain):
        p_d = scenario.p_d()
        if np.any(goal.margin(p_d) < 0):
            pose = int(np.argmax(reached(-p_d if goal.at_least else p_d)))
            place = float(scenario.axis.values[pose])
            impossible = RequiredAccuracy(None, float(p_d[pose]), place, P_D_ITSELF)
            return dict.fromkeys((*sources_of(scenario, SOURCE, PART), "all"), impossible)
    search = _Search(scenario, goal, method)
    every, by_name = sources_of(scenario), dict[str, RequiredAccuracy]()
    for done, (name, source) in enumerate(every.items()):
        report("sources", done, len(every))
        # a part of what is not enough alone is not enough
        if source.kind != FINER or (source.part_of and by_name[source.part_of].factor is not None):
            by_name[name] = search.required((name,))
    by_name["all"] = search.required(tuple(sources_of(scenario, SOURCE)))
    report("sources", len(every), len(every))
    return by_name


class _Search:
    """The search for the factors at which 3σ of P_D, or its upper bound, is within a limit.

    A limit of 3σ has no k. That P_D is at least a limit is a limit of a miss, 1 − P_D, and all
    values are then of a miss.

    `names` are names of `sources_of`. A factor is one on their standard deviations. P_D itself may
    be `beyond` the limit.
    """

    def __init__(self, scenario: Scenario, goal: Requirement, method: str) -> None:
        k, of_miss = None if goal.width else goal.k, goal.at_least
        limit = 1.0 - goal.limit if of_miss else goal.limit
        self.scenario, self.limit, self.k, self.method = scenario, limit, k, method
        self.of_miss = of_miss
        self.beyond = not goal.width and bool(np.any(goal.margin(scenario.p_d()) < 0))
        self.budget_at = cache(
            lambda pose: error_budget(scenario.at_poses(slice(pose, pose + 1)), method)
        )
        # 3σ of P_D, or its upper bound, at each pose, as a function of names and factor
        by = "form" if method == AUTOMATIC else method
        self.values = self.critical_values = value_function(scenario, by, k, of_miss=of_miss)
        self.rows, self.holds = cache(self._rows), cache(self._holds)
        # If poses are above the limit, the factor depends on these poses alone.
        above = ~(self.values((), 1.0) <= limit)
        if above.any():
            critical = scenario.at_poses(np.flatnonzero(above))
            self.critical_values = value_function(critical, by, k, of_miss=of_miss)

    def required(self, names: tuple[str, ...]) -> RequiredAccuracy:
        """Return the largest factor by the method, or by draws where they disagree."""
        factor, known = self._confirmed(names, *self._largest(names, self.limit))
        finite_factor = np.exp(LARGEST_LOG_FACTOR) if factor == np.inf else factor or 0.0
        values = self.values(names, finite_factor)
        pose = int(np.argmax(reached(np.nan_to_num(values, nan=np.inf))))
        residual = values[pose]
        if self.method == AUTOMATIC or (factor is None and not residual > self.limit):
            rows = self.rows(names, finite_factor)
            drawn, errors = self._value(self._drawn(names, finite_factor, PRECISE, rows))
            agrees = abs(values[rows] - drawn) <= SURE * errors
            found = np.where(agrees, values[rows], drawn)
            largest = int(np.argmax(reached(found)))
            pose, residual = int(rows[largest]), found[largest]
            if factor and factor < np.inf:
                # where little room is left for the source, FORM may be off by as much
                room = self.limit - float(np.max(self.critical_values(names, 0.0)))
                known &= room > self._off
        return RequiredAccuracy(
            factor=factor,
            residual=float(1.0 - residual if self.of_miss else residual),
            place=float(self.scenario.axis.values[pose]),
            residual_from=self._largest_other(names, pose),
            known=known,
            exceeded_at_0=bool(
                factor and not 1.0 <= factor < np.inf and self.holds(names, -np.inf) is False
            ),
        )

    def _largest(self, names: tuple[str, ...], limit: float) -> tuple[float | None, bool]:
        """Return the largest factor by the method, and whether larger factors have a value."""
        from scipy.optimize import brentq  # slow to import

        undefined: list[float] = []

        @cache
        def excess(log_factor: float) -> float:
            """Return by how much the limit is exceeded at any pose, 1 where there is no value."""
            value = float(np.max(self.critical_values(names, float(np.exp(log_factor)))))
            if np.isnan(value):
                undefined.append(log_factor)
                return 1.0
            return value - limit

        low = high = 0.0
        if excess(-np.inf) > 0.0 and excess(0.0) > 0.0:
            return None, not (undefined or self.beyond)
        if excess(0.0) <= 0.0:
            while excess(high) <= 0.0:
                if high == LARGEST_LOG_FACTOR:
                    return np.inf, True
                low, high = high, min(high + STEP, LARGEST_LOG_FACTOR)
        else:
            while excess(low) > 0.0:
                if low == -LARGEST_LOG_FACTOR:
                    return 0.0, low not in undefined
                low, high = max(low - STEP, -LARGEST_LOG_FACTOR), low
        if excess(low) == 0.0:
            return float(np.exp(low)), True
        root = brentq(excess, low, high, xtol=1e-10, rtol=1e-15)
        known = min(undefined, default=np.inf) > root + 1e-9
        return float(np.exp(root - 1e-9)), known  # the side within the limit

    def _confirmed(
        self, names: tuple[str, ...], factor: float | None, known: bool
    ) -> tuple[float | None, bool]:
        """Return the factor if draws agree with it, else the largest one that they prove.

        σ falls again where a factor scatters the states beyond a limit of a radar. A factor above 1
        is therefore judged on the way there, too.
        """
        smaller = factor and factor < 1.0 and self.method == AUTOMATIC
        if smaller and self._agrees(names, 0.0, self.limit):
            factor = None  # FORM asks for more than the draws of the threshold test do
        if not factor:
            if known and self.method != AUTOMATIC:
                return factor, known
            certain = self.holds(names, -np.inf)
            if not (certain or self.beyond or self.holds(names, 0.0)):
                return None, certain is False and not self._relieves(names)
            return self._proven(names, 0.0, LARGEST_LOG_FACTOR)
        last = min(float(np.log(factor)), LARGEST_LOG_FACTOR)
        # beside its greatest values P_D hardly changes where its probability changes much
        agree = not self.beyond and all(
            self._agrees(names, at, self._allowed) for at in _on_the_way(0.0, last)
        )
        # FORM may be within the limit where the draws of the threshold test do not find it
        doubted = self.method == AUTOMATIC and self.k is not None and not smaller
        if not agree or (doubted and not self.holds(names, 0.0)):
            return self._proven(names, 0.0, last, -self._off)
        final = factor == np.inf or (known and self.method != AUTOMATIC)
        more = not final and (
            self._strict(names, last) if self.k is None else self.holds(names, last)
        )
        if more:
            return self._proven(names, last, LARGEST_LOG_FACTOR, self._off)
        return factor, known

    def _proven(
        self, names: tuple[str, ...], start: float, last: float, off: float = 0.0
    ) -> tuple[float | None, bool]:
        """Return the largest factor up to a last one that draws prove, and whether it is known.

        The search begins at ln `start`, and is faster by a guess: the factor at which the method
        has the limit and `off`.
        """
        low, judged = None, _on_the_way(start, last)
        guess, _ = self._largest(names, self.limit + off) if off else (None, False)
        if guess:
            judged = sorted([*judged, min(float(np.log(guess)), last)])
        for high in judged:
            if not self.holds(names, high):
                break
            low = high
        else:
            return (np.inf, True) if last == LARGEST_LOG_FACTOR else (float(np.exp(last)), False)
        if low is None:
            low = high - WAY
            while not (at_low := self.holds(names, low)):
                if low == -LARGEST_LOG_FACTOR:
                    certain = self.holds(names, -np.inf)
                    if certain:
                        return 0.0, at_low is False
                    return None, certain is False and not self.beyond
                low, high = max(low - 2.0 * (high - low), -LARGEST_LOG_FACTOR), low
        confirmed = low
        rows = np.union1d(*(self.rows(names, float(np.exp(end))) for end in (low, high)))
        while high - low > NEAR:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._holds(names, middle, rows) else (low, middle)
        if self.holds(names, low):  # at its own poses too
            confirmed = low
        return float(np.exp(confirmed)), False

    def _agrees(self, names: tuple[str, ...], log_factor: float, limit: float) -> bool:
        """Return whether draws have no pose above a limit at a factor."""
        return bool(np.all(self._excess(names, log_factor, limit, PRECISE)[0] <= 0.0))

    def _strict(self, names: tuple[str, ...], log_factor: float) -> bool:
        """Return whether 3σ by draws is below the limit, where FORM finds it at the limit.

        σ by FORM is too large where c_r may come near 0.
        """
        excess, errors = self._excess(names, log_factor, (1.0 - NEAR) * self.limit, PRECISE)
        return bool(np.all(excess < -SURE * errors))

    def _holds(
        self, names: tuple[str, ...], log_factor: float, rows: NDArray[np.intp] | None = None
    ) -> bool | None:
        """Return whether draws prove that the limit is met at a factor; None if they are not sure.

        Without rows, the poses of `_rows` are judged. The factor 1 has the draws of a verdict.
        """
        if log_factor == 0.0 and rows is None:
            excess, errors = self._present
        else:
            excess, errors = self._excess(names, log_factor, self.limit, MANY, rows)
        if np.any(excess > SURE * errors):
            return False
        return True if np.all(excess <= -TO_HOLD * errors) else None

    @cached_property
    def _present(self) -> tuple[FloatArray, FloatArray]:
        return self._excess((), 0.0, self.limit, LAST)

    def _relieves(self, names: tuple[str, ...]) -> bool:
        """Return whether draws find the limit exceeded by less with sources than without.

        One pose that is surely beyond the limit without the sources, and not surely less so with
        them, is enough to say no: no factor helps there.
        """
        rows = self.rows(names, 0.0)
        without, of_it = self._excess(names, -np.inf, self.limit, MANY, rows)
        present, error = self._excess((), 0.0, self.limit, MANY, rows)
        relieved = present < without - SURE * np.hypot(error, of_it)
        return not np.any((without > SURE * of_it) & ~relieved)

    def _excess(
        self,
        names: tuple[str, ...],
        log_factor: float,
        limit: float,
        draws: int,
        rows: NDArray[np.intp] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return by how much (j,) a limit is exceeded at a factor, and the standard error.

        A bound is exceeded where P_D exceeds the limit with more than the probability of the bound.
        """
        factor, k = float(np.exp(log_factor)), self.k
        rows = self.rows(names, factor) if rows is None else rows
        states = scaled(self.scenario, names, factor).at(rows)
        if k is None:
            staged = StagedDraws.of_p_d(states, 3.0)
        elif self.of_miss:
            staged = StagedDraws.of_tail(states, -k, 1.0 - limit)
        else:
            staged = StagedDraws.of_tail(states, k, limit)

        def compared(found: Estimate) -> tuple[FloatArray, FloatArray]:
            if k is None:
                values, errors = self._value(found)
                return values - limit, errors
            tail, errors = found.above
            return tail - float(ndtr(-k)), errors

        def settled(_: NDArray[np.intp], found: Estimate) -> NDArray[np.bool_]:
            excess, errors = compared(found)
            return (abs(excess) >= SURE * errors) | np.any(excess > SURE * errors)

        return compared(staged.until(settled, draws))

    def _rows(self, names: tuple[str, ...], factor: float) -> NDArray[np.intp]:
        """Return the poses with the largest values by the method, and by few draws at all poses."""
        looked, _ = self._value(self._drawn(names, factor, LOOK))
        both = self.values(names, factor), looked
        largest = [np.argsort(-np.nan_to_num(values, nan=np.inf))[:VERIFIED] for values in both]
        return np.union1d(*largest)

    def _drawn(
        self,
        names: tuple[str, ...],
        factor: float,
        draws: int,
        rows: NDArray[np.intp] | slice = slice(None),
    ) -> Estimate:
        """Return what draws say at some poses, at the deviations of a factor."""
        return estimate(scaled(self.scenario, names, factor).at(rows), draws, self.k or 3.0)

    def _value(self, found: Estimate) -> tuple[FloatArray, FloatArray]:
        """Return 3σ of P_D, or its upper bound, by draws (k,), and the standard error."""
        if self.k is None:
            (_, std), (_, error) = found.moments
            return 3.0 * std, 3.0 * error
        (lower, upper), (lower_error, upper_error) = found.bounds
        return (1.0 - lower, lower_error) if self.of_miss else (upper, upper_error)

    @property
    def _off(self) -> float:
        """By how much the value by a method may be off at the limit."""
        if self.k is None:
            return STD_CHANGE * self.limit
        return min(BOUND_CHANGE, PART_OF_BOUND * min(self.limit, 1.0 - self.limit))

    @property
    def _allowed(self) -> float:
        """The limit, and by how much draws may exceed it that confirm a factor by a method.

        Their 3σ may exceed it by `STD_CHANGE` of it of a method of first order, as elsewhere, and
        of others by `NEAR` of it, the standard error of the draws. A bound by `automatic` may not:
        the threshold test would not hold at the factor.
        """
        if self.method == AUTOMATIC and self.k is not None:
            return self.limit
        exact = self.k is None and self.method not in FIRST_ORDER
        return self.limit + (NEAR * self.limit if exact else self._off)

    def _largest_other(self, names: tuple[str, ...], pose: int) -> str | None:
        """Return the largest of the other sources, None if none is, or if any has no value."""
        budget, every = self.budget_at(pose), sources_of(self.scenario)
        pieces = {**budget.finer, **budget.parts}.items()
        shown = {**budget.sources, **{name: c for name, c in pieces if c.part_of}}
        at_pose = {
            name: c.std[0]
            for name, c in shown.items()
            if not any(every[name].overlaps(every[own]) for own in names)
        }
        if np.isnan([*at_pose.values()]).any():
            return None
        largest = max(at_pose, key=at_pose.__getitem__, default="")
        return largest if at_pose.get(largest, 0.0) > 0 else None


def _on_the_way(start: float, last: float) -> list[float]:
    """Return ln of the factors to judge up to a last one: of a growth, steps of `WAY` too."""
    return [*np.arange(start, last, WAY).tolist(), last]
