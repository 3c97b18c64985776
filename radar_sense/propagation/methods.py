"""The methods of propagation by name: from uncertain states to a distribution of P_D.

To add a method, write a file with its class and add a row to `METHODS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.cost import foresee
from radar_sense.errors import InputError, check_choice
from radar_sense.limits import POSITIVE, check_number
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel
from radar_sense.progress import report
from radar_sense.propagation.automatic import (
    BOUND_CHANGE,
    Automatic,
    judged,
    of_bounds,
    of_moments,
)
from radar_sense.propagation.draws import Estimate
from radar_sense.propagation.form import Form
from radar_sense.propagation.linear import Linear
from radar_sense.propagation.looks import FIRST, first_look
from radar_sense.propagation.plain import PlainDraws
from radar_sense.propagation.probit import Probit
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates, uncertain_states

#: The method that is right, and the default; and the method of plain draws.
AUTOMATIC, MONTE_CARLO = "automatic", "montecarlo"
#: Numbers in memory for each draw at one pose.
NUMBERS = 12
#: β of the draws that judge mean and σ.
JUDGED = 3.0
#: Poses between two reports of progress.
REPORTED = 16_384


class Distribution(Protocol):
    """The distribution of P_D at each of k poses, by a method.

    A value is NaN where the method has none.
    """

    @property
    def p_d(self) -> FloatArray:
        """P_D of the nominal states (k,)."""

    @property
    def mean(self) -> FloatArray:
        """Mean of P_D (k,)."""

    @property
    def std(self) -> FloatArray:
        """Standard deviation of P_D (k,)."""

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""

    def error(self, beta: float) -> FloatArray | float:
        """Return the standard error of the quantiles at ±β (k,), 0 without draws."""

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,)."""

    def with_covariances(self, changed: UncertainStates) -> Distribution:
        """Return the distribution for the same states with other covariances."""


METHODS: Mapping[str, Callable[[UncertainStates], Distribution]] = {
    "linear": Linear,
    "probit": Probit,
    "form": Form,
    MONTE_CARLO: PlainDraws,
    AUTOMATIC: Automatic,
}


@dataclass(frozen=True, eq=False, repr=False)
class Moments:
    """Mean, standard deviation and bounds of a probability at each pose.

    Attributes:
        p_d: P_D of the nominal states (...).
        mean: Mean of P_D (...).
        std: Standard deviation of P_D (...).
        lower: Bound that P_D falls below with probability Φ(−β) (...).
        upper: Bound that P_D stays below with probability Φ(β) (...).
        error: Standard error of the bounds (...), 0 where they are not by draws.
    """

    p_d: FloatArray
    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    error: FloatArray

    def __repr__(self) -> str:
        names = ", ".join(f.name for f in fields(self))
        return f"<Moments of P_D at {np.size(self.p_d)} poses: {names}>"


@dataclass(frozen=True, eq=False)
class Band:
    """Bounds of P_D at each of k poses, which cost less than `Moments`.

    Attributes:
        p_d: P_D of the nominal states (k,).
        lower: Bound that P_D falls below with probability Φ(−β) (k,).
        upper: Bound that P_D stays below with probability Φ(β) (k,).
        error: Standard error of the bounds (k,), 0 where they are not by draws.
        drawn: What the draws say that judge the bounds by `automatic`, also of P(P_D > p_max);
            None of another method, or without p_max.
    """

    p_d: FloatArray
    lower: FloatArray
    upper: FloatArray
    error: FloatArray
    drawn: Estimate | None = None

    @classmethod
    def join(cls, parts: Sequence[Band]) -> Band:
        """Return the band at the poses of all parts, one part after the other."""
        if len(parts) == 1:
            return parts[0]
        p_d, lower, upper, error = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("p_d", "lower", "upper", "error")
        )
        drawn = [part.drawn for part in parts if part.drawn is not None]
        known = len(drawn) == len(parts)
        return cls(p_d, lower, upper, error, Estimate.join(drawn) if known else None)

    def at(self, rows: NDArray[np.intp]) -> Band:
        """Return the band at some poses."""
        drawn = None if self.drawn is None else self.drawn.at(rows)
        return Band(self.p_d[rows], self.lower[rows], self.upper[rows], self.error[rows], drawn)


def propagate(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = AUTOMATIC,
    beta: float = 3.0,
) -> Moments:
    """Return mean, standard deviation and bounds of P_D by a method named in `METHODS`.

    `unreliable` returns where the moments are off.

    Args:
        model: The detection model, of a radar or of a network.
        aircraft: Nominal aircraft states (..., 6).
        radar: Nominal radar states (..., 4), or (..., 4m) of a network of m. The errors of further
            parameters may follow, nominally 0; see `states`.
        cov_aircraft: C_aa (..., 6, 6), which may be singular.
        cov_radar: C_rr (..., 4, 4), or (..., 4m, 4m), which may be singular. The four broadcast
            against each other.
        method: Name of the method.
        beta: β > 0; the bounds are at Φ(−β) and Φ(β).

    Raises:
        ValueError: If there is no such method, β is not positive or a shape does not fit.
    """
    check_method(method)
    beta = check_number("beta", beta, POSITIVE)
    shape, states = uncertain_states(model, aircraft, radar, cov_aircraft, cov_radar)
    moments, _ = _moments_and_band(states, method, beta)
    return Moments(*(values.reshape(shape)[()] for values in vars(moments).values()))


def unreliable(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = AUTOMATIC,
    beta: float = 3.0,
) -> NDArray[np.bool_]:
    """Return where (...) draws say that mean, σ or a bound of a method is off, or not precise.

    Mean and bounds are off by more than 0.005, or by more than a tenth of themselves below 0.05.
    σ is off by more than 5 %. The arguments are those of `propagate`.
    """
    check_method(method)
    beta = check_number("beta", beta, POSITIVE)
    shape, states = uncertain_states(model, aircraft, radar, cov_aircraft, cov_radar)
    moments, _ = _moments_and_band(states, method, beta)
    result: NDArray[np.bool_] = _unreliable(states, moments, method, beta).reshape(shape)[()]
    return result


def propagate_scenario(
    scenario: Scenario, *, method: str = AUTOMATIC, beta: float = 3.0
) -> Moments:
    """Return the moments of P_D (n,) at every pose of a scenario, at its level.

    Raises:
        InputError: If there is no such method.
    """
    return moments_and_band(scenario, method=method, beta=beta)[0]


def moments_and_band(
    scenario: Scenario, *, method: str, beta: float = 3.0, p_max: float | None = None
) -> tuple[Moments, Band]:
    """Return the moments and the band of P_D at every pose of a scenario, from the same draws.

    Raises:
        InputError: If there is no such method.
    """
    check_method(method)
    beta = check_number("beta", beta, POSITIVE)
    return _moments_and_band(scenario.states(), method, beta, p_max)


def band_of_scenario(
    scenario: Scenario, *, method: str, beta: float = 3.0, p_max: float | None = None
) -> Band:
    """Return the band of P_D at every pose of a scenario, without mean and σ.

    Raises:
        InputError: If there is no such method.
    """
    check_method(method)
    parts = _distributions(scenario.states(), method, p_max)
    return Band.join([_band(found, beta, p_max) for found in parts])


def unreliable_in_scenario(
    scenario: Scenario, moments: Moments, *, method: str = AUTOMATIC, beta: float = 3.0
) -> NDArray[np.bool_]:
    """Return where (n,) the moments of a scenario by a method are off, as `unreliable` does."""
    return _unreliable(scenario.states(), moments, method, beta)


def distribution(scenario: Scenario, method: str) -> Distribution:
    """Return the distribution of P_D at every pose of a scenario, at its level."""
    check_method(method)
    return METHODS[method](scenario.states())


def mean_and_std(found: Distribution) -> tuple[FloatArray, FloatArray]:
    """Return mean and σ (k,). Where nothing is uncertain, the mean is P_D without rounding."""
    std = found.std
    return np.where(std == 0, found.p_d, found.mean), std


def std_off_in_scenario(
    scenario: Scenario, mean: FloatArray, std: FloatArray, *, method: str
) -> NDArray[np.bool_]:
    """Return where (n,) draws say that mean and σ of a scenario by a method are off.

    Few draws say it of σ, where `unreliable_in_scenario` needs many to say it of bounds.
    """
    if method == AUTOMATIC:  # these are by draws where FORM is off
        return np.zeros(len(std), dtype=bool)
    states = scenario.states()
    _foresee(states, FIRST)
    first = first_look(states, JUDGED)
    return judged(states, first, (mean, std), of_moments, JUDGED, to_precision=True)[2]


def check_method(method: str) -> None:
    """Raise InputError, which is a ValueError, unless there is such a method."""
    check_choice("method", method, METHODS)


def no_draws(method: str) -> None:
    """Raise InputError for plain draws, where a command draws itself or needs a smooth method."""
    check_method(method)
    if method == MONTE_CARLO:
        others = ", ".join(name for name in METHODS if name != MONTE_CARLO)
        raise InputError(
            f"method must be one of {others} here, got {MONTE_CARLO}: this command compares with "
            "draws, or needs a bound at too many poses for plain draws"
        )


def _moments_and_band(
    states: UncertainStates, method: str, beta: float, p_max: float | None = None
) -> tuple[Moments, Band]:
    moments, bands = [], []
    for found in _distributions(states, method, p_max):
        mean, std = mean_and_std(found)  # first, because these may have the bounds by the way
        band = _band(found, beta, p_max)
        certain = std == 0
        bounds = (np.where(certain, band.p_d, bound) for bound in (band.lower, band.upper))
        moments.append((band.p_d, mean, std, *bounds, band.error))
        bands.append(band)
    whole = moments[0] if len(moments) == 1 else map(np.concatenate, zip(*moments, strict=True))
    return Moments(*whole), Band.join(bands)


def _distributions(
    states: UncertainStates, method: str, p_max: float | None
) -> Iterator[Distribution]:
    """Yield the distributions of P_D by a method at parts of the poses."""
    if method == MONTE_CARLO:
        _foresee(states, states.runs, "fewer --runs")
    elif method == AUTOMATIC:
        _foresee(states, FIRST)
    done = 0
    for part in states.cut(REPORTED):
        if method == AUTOMATIC and p_max is not None:
            yield Automatic(part, p_max=p_max)
        else:
            yield METHODS[method](part)
        done += len(part)
        report(f"poses propagated by {method}", done, len(states))


def _band(found: Distribution, beta: float, p_max: float | None) -> Band:
    lower, upper = (found.quantile(end) for end in (-beta, beta))
    error = found.error(beta) + np.zeros(lower.shape)
    drawn = found.drawn(beta) if isinstance(found, Automatic) and p_max is not None else None
    return Band(found.p_d, lower, upper, error, drawn)


def _unreliable(
    states: UncertainStates, moments: Moments, method: str, beta: float
) -> NDArray[np.bool_]:
    if method == AUTOMATIC:
        return np.asarray(~(moments.error <= BOUND_CHANGE))
    _foresee(states, FIRST)
    first = first_look(states, beta)
    bounds = moments.lower, moments.upper
    drawn, confirmed, _ = judged(states, first, bounds, of_bounds, beta, to_precision=False)
    off, rows = ~confirmed, np.flatnonzero(confirmed)
    of_rows = moments.mean[rows], moments.std[rows]
    off[rows] = judged(
        states.at(rows), drawn.at(rows), of_rows, of_moments, beta, to_precision=True
    )[2]
    return off


def _foresee(states: UncertainStates, draws: int, less: str = "fewer poses") -> None:
    """Say what the first look of draws at each pose takes if it is long."""
    evaluations = float(len(states)) * draws * len(states.model.radars)
    memory = NUMBERS * 8.0 * draws
    foresee(f"{len(states):,} poses x {draws:,} draws", evaluations, memory, less=less)
