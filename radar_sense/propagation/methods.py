"""The methods of propagation by name: from uncertain states to a distribution of P_D.

To add a method, write a file with its class and add a row to `limits.METHODS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense import limits
from radar_sense.cost import EMPHASIS, foresee
from radar_sense.errors import InputError, check_choice, counted
from radar_sense.limits import SIGMAS, Limit, check_number
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import NEVER
from radar_sense.progress import report
from radar_sense.propagation.automatic import BOUND_CHANGE, Automatic, judged, of_bounds, of_moments
from radar_sense.propagation.draws import Estimate
from radar_sense.propagation.moments import BETA, Distribution
from radar_sense.propagation.staged import StagedDraws, draws_at_first
from radar_sense.scenario import Scenario, check_scenario
from radar_sense.states import BLOCK, FloatArray
from radar_sense.uncertain_states import UncertainStates, uncertain_states

if TYPE_CHECKING:
    from typing_extensions import Self

#: The method that is right, and the default; and the method of plain draws.
AUTOMATIC, MONTE_CARLO = "automatic", "montecarlo"
#: Numbers in memory for each draw at one pose.
NUMBERS = 12


METHODS: Mapping[str, Callable[[UncertainStates], Distribution]] = {
    name: resolve_name(f"radar_sense.propagation.{place}") for name, place in limits.METHODS.items()
}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Band:
    """Bounds of P_D at each pose, which cost less than `Moments`.

    Attributes:
        p_d, lower, upper, error, drawn: As of `Moments`.
    """

    p_d: FloatArray
    lower: FloatArray
    upper: FloatArray
    error: FloatArray
    drawn: Estimate | None = None

    @classmethod
    def of(cls, found: Distribution, beta: float) -> Self:
        """Return the values of a distribution, with bounds at Φ(−β) and Φ(β)."""
        lower, upper = found.quantile(-beta), found.quantile(beta)
        error, drawn = found.error(beta), found.drawn(beta)
        return cls(p_d=found.p_d, lower=lower, upper=upper, error=error, drawn=drawn)

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the values at the poses of all parts, one part after the other."""
        names = [f.name for f in fields(cls) if f.name != "drawn"]  # a part may be `Moments`
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        drawn = [part.drawn for part in parts if part.drawn is not None]
        known = len(drawn) == len(parts)
        return cls(**arrays, drawn=Estimate.join(drawn) if known else None)

    @property
    def arrays(self) -> dict[str, Any]:
        """The arrays with a value for each pose, by name."""
        return {name: values for name, values in vars(self).items() if name != "drawn"}

    def at(self, rows: NDArray[np.intp]) -> Self:
        """Return the values at some poses (k,)."""
        arrays = {name: values[rows] for name, values in self.arrays.items()}
        return type(self)(**arrays, drawn=None if self.drawn is None else self.drawn.at(rows))

    def __repr__(self) -> str:
        names = ", ".join(self.arrays)
        return f"<{type(self).__name__} of P_D at {counted(np.size(self.p_d), 'pose')}: {names}>"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Moments(Band):
    """Mean, standard deviation and bounds of P_D at each pose.

    Attributes:
        p_d: P_D of the nominal states (...).
        mean: Mean of P_D (...).
        std: Standard deviation of P_D (...).
        lower: Bound that P_D falls below with probability Φ(−β) (...).
        upper: Bound that P_D stays below with probability Φ(β) (...).
        error: Standard error of the bounds (...), 0 where they are not by draws.
        drawn: What the draws say that judge the bounds by `automatic`, also of P(P_D > p_max);
            None of another method, or without p_max.
    """

    mean: FloatArray
    std: FloatArray

    @classmethod
    def of(cls, found: Distribution, beta: float) -> Moments:
        """Return the values of a distribution, with bounds at Φ(−β) and Φ(β)."""
        mean, std = found.mean, found.std  # first, because these may have the bounds by the way
        return cls(**vars(Band.of(found, beta)), mean=mean, std=std)


def propagate(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = AUTOMATIC,
    beta: float = BETA,
) -> Moments:
    """Return mean, standard deviation and bounds of P_D by a method named in `METHODS`.

    `unreliable` returns where the moments are off. For a scenario use `propagate_scenario`: it
    has tolerances of c_r and errors of the RCS, which no covariance of states has. The method
    "montecarlo" draws 500 times with the seed 1: at a β above 3 its bounds are its extreme draws,
    and `error` does not tell how far off they are.

    Args:
        model: The detection model, of a radar or of a network.
        aircraft: Nominal aircraft states (..., 6).
        radar: Nominal radar states (..., 4), or (..., 4m) of a network of m. The errors of further
            parameters may follow, nominally 0; see `states`.
        cov_aircraft: C_aa (..., 6, 6), which may be singular.
        cov_radar: C_rr (..., 4, 4), or (..., 4m, 4m), which may be singular. The four broadcast
            against each other.
        method: Name of the method.
        beta: β, above 0 and 10 at most; the bounds are at Φ(−β) and Φ(β).

    Raises:
        InputError: If there is no such method, β is not allowed or a shape does not fit.
    """
    shape, states = uncertain_states(model, aircraft, radar, cov_aircraft, cov_radar)
    moments = _moments(states, method, beta)
    return Moments(**{name: v.reshape(shape)[()] for name, v in moments.arrays.items()})


def unreliable(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = AUTOMATIC,
    beta: float = BETA,
) -> NDArray[np.bool_]:
    """Return where (...) draws say that mean, σ or a bound of a method is off, or not precise.

    Mean and bounds are off by more than 0.005, or by more than a tenth of themselves below 0.05.
    σ is off by more than 5 %. Differences below 2e-5 do not count. The arguments are those of
    `propagate`.
    """
    shape, states = uncertain_states(model, aircraft, radar, cov_aircraft, cov_radar)
    moments = _moments(states, method, beta)
    return _unreliable(states, moments, method, beta).reshape(shape)[()]


def propagate_scenario(
    scenario: Scenario,
    *,
    method: str | None = None,
    beta: float = BETA,
    p_max: float | None = None,
) -> Moments:
    """Return the moments of P_D (n,) at every pose of a scenario, at its level.

    The command `variance` has the same numbers. All errors of the scenario are included.

    Args:
        scenario: The scenario.
        method: Name of the method; None for the scenario's.
        beta: β, above 0 and 10 at most; the bounds are at Φ(−β) and Φ(β).
        p_max: Limit of P_D whose exceedance the draws of `automatic` count; None for none.
    """
    check_scenario(scenario)
    if p_max is not None:
        check_number("p_max", p_max, Limit(at_least=0, at_most=1))
    return _moments(scenario.states(), scenario.method if method is None else method, beta, p_max)


def band_of_scenario(
    scenario: Scenario, *, method: str, beta: float = BETA, p_max: float | None = None
) -> Band:
    """Return what `propagate_scenario` returns without mean and σ, which cost more."""
    parts = _distributions(scenario.states(), method, p_max)
    return Band.join([Band.of(found, beta) for found in parts])


def unreliable_in_scenario(
    scenario: Scenario, moments: Moments, *, method: str | None = None, beta: float = BETA
) -> NDArray[np.bool_]:
    """Return where (n,) the moments of a scenario by a method are off, as `unreliable` does."""
    return _unreliable(scenario.states(), moments, method or scenario.method, beta)


def distribution(scenario: Scenario, method: str) -> Distribution:
    """Return the distribution of P_D at every pose of a scenario, at its level."""
    check_choice("method", method, METHODS)
    return METHODS[method](scenario.states())


def std_off_in_scenario(scenario: Scenario, mean: FloatArray, std: FloatArray) -> NDArray[np.bool_]:
    """Return where (n,) draws say that mean and σ of a scenario by its method are off.

    Few draws say it of σ, where `unreliable_in_scenario` needs many to say it of bounds.
    """
    if scenario.method == AUTOMATIC:  # these are by draws where FORM is off
        return np.zeros(len(std), dtype=bool)
    states = scenario.states()
    _foresee(states, draws_at_first(states))
    return judged(StagedDraws.of_p_d(states, BETA), (mean, std), of_moments, to_precision=True)[2]


def no_draws(method: str) -> None:
    """Raise InputError for plain draws, where a command draws itself or needs a smooth method."""
    check_choice("method", method, METHODS)
    if method == MONTE_CARLO:
        others = ", ".join(name for name in METHODS if name != MONTE_CARLO)
        raise InputError(
            f"method must be one of {others} here, got {MONTE_CARLO}: this command compares with "
            "draws, or needs a bound at too many poses for plain draws"
        )


def _moments(
    states: UncertainStates, method: str, beta: float, p_max: float | None = None
) -> Moments:
    beta = check_number("beta", beta, SIGMAS)
    parts = _distributions(states, method, p_max)
    return Moments.join([Moments.of(found, beta) for found in parts])


def _distributions(
    states: UncertainStates, method: str, p_max: float | None
) -> Iterator[Distribution]:
    """Yield the distributions of P_D by a method at parts of the poses."""
    check_choice("method", method, METHODS)
    if method == MONTE_CARLO:
        _foresee(states, np.full(len(states), states.runs), "fewer --runs")
    elif method == AUTOMATIC:
        _foresee(states, draws_at_first(states))
    done, poses = 0, len(states)
    for part in states.cut(BLOCK):
        if method == AUTOMATIC and p_max is not None:
            yield Automatic(part, p_max=p_max)
        else:
            yield METHODS[method](part)
        done += len(part)
        report(f"poses propagated by {method}", done, poses)


def _unreliable(
    states: UncertainStates, moments: Moments, method: str, beta: float
) -> NDArray[np.bool_]:
    if method == AUTOMATIC:
        return ~(moments.error <= BOUND_CHANGE)
    _foresee(states, draws_at_first(states))
    bounds = moments.lower, moments.upper
    drawn, confirmed, _ = judged(
        StagedDraws.of_p_d(states, beta), bounds, of_bounds, to_precision=False
    )
    off, rows = ~confirmed, np.flatnonzero(confirmed)
    further = StagedDraws.of_p_d(states.at(rows), beta, first=drawn.at(rows))
    of_rows = moments.mean[rows], moments.std[rows]
    off[rows] = judged(further, of_rows, of_moments, to_precision=True)[2]
    return off


def _foresee(states: UncertainStates, draws: NDArray[np.intp], less: str = "fewer poses") -> None:
    """Say what draws at each pose (k,) take if it is long. A radar out of sight takes none."""
    radars = np.count_nonzero(states.sight() != NEVER, axis=1)
    evaluations = float(draws @ radars) * EMPHASIS
    memory = NUMBERS * 8.0 * float(draws.max(initial=0))
    what = f"{draws.sum():,} draws at {len(states):,} poses"
    foresee(what, evaluations, memory, less=less)
