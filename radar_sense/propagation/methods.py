"""The methods of propagation by name: from Gaussian states to mean, deviation and bounds of P_D.

To add a method, write a file with its function and add a row to `METHODS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from radar_sense.errors import check_choice
from radar_sense.limits import POSITIVE, check_number
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel
from radar_sense.progress import report
from radar_sense.propagation import checks
from radar_sense.propagation.form import (
    EXCEEDANCE_NODES,
    exceedance,
    form,
    form_exceedance,
    form_std,
    form_upper,
)
from radar_sense.propagation.gaussian_states import StdFunction, UncertainStates, uncertain_states
from radar_sense.propagation.linear import linear, linear_exceedance, linear_std, linear_upper
from radar_sense.propagation.moments import Moments
from radar_sense.propagation.probit import probit, probit_exceedance, probit_std, probit_upper
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: |z| of a P_D that is 0 or 1 to rounding.
LARGEST_PROBIT = 40.0
#: Poses between two reports of progress, divided by the number of radars; at least 1024.
REPORTED = 16_384

#: From uncertain states of k poses and β to the moments of P_D (k,).
MomentsFunction: TypeAlias = Callable[[UncertainStates, float], Moments]
#: From uncertain states and β to the upper bound of P_D (k,).
UpperFunction: TypeAlias = Callable[[UncertainStates, float], FloatArray]
#: From uncertain states and p_max to P(P_D > p_max) (k,).
ExceedanceFunction: TypeAlias = Callable[[UncertainStates, float], FloatArray]
#: From uncertain states, moments and β to where (k,) the moments are unreliable.
Check: TypeAlias = Callable[[UncertainStates, Moments, float], NDArray[np.bool_]]


@dataclass(frozen=True)
class Method:
    """A method of propagation and its properties.

    Attributes:
        name: Name of the method in options and arguments.
        moments: Function of the moments.
        nonlinear: Check of the moments.
        log_normal: Whether the method assumes that a radar constant with tolerances is log-normal,
            and not Gaussian.
        upper: Function of the upper bound alone, which costs less than all moments.
        std: Makes a function from covariances to σ. For many covariances of the same states, the
            function costs less than all moments.
        exceedance: Function of P(P_D > p_max). If None, bounds at several β give the probability.
    """

    name: str
    moments: MomentsFunction
    nonlinear: Check
    log_normal: bool
    upper: UpperFunction | None = None
    std: Callable[[UncertainStates], StdFunction] | None = None
    exceedance: ExceedanceFunction | None = None


METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method(
            "linear",
            linear,
            checks.second_order_matters,
            log_normal=False,
            upper=linear_upper,
            std=linear_std,
            exceedance=linear_exceedance,
        ),
        Method(
            "probit",
            probit,
            checks.second_order_matters,
            log_normal=True,
            upper=probit_upper,
            std=probit_std,
            exceedance=probit_exceedance,
        ),
        Method(
            "form",
            form,
            checks.form_is_off,
            log_normal=True,
            upper=form_upper,
            std=form_std,
            exceedance=form_exceedance,
        ),
    )
}


def propagate(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = "linear",
    beta: float = 3.0,
    log_constant: ArrayLike = False,
) -> Moments:
    """Return mean, standard deviation and bounds of P_D by a method named in `METHODS`.

    `nonlinear` returns where the moments are unreliable.

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
        log_constant: Whether ln c_r is Gaussian rather than c_r, of all radars or of each (m,). σ
            of ln c_r is the relative deviation in C_rr. To first order both choices agree.

    Raises:
        ValueError: If there is no such method, β is not positive or a shape does not fit.
    """
    shape, states = _checked(
        model, aircraft, radar, cov_aircraft, cov_radar, method, beta, log_constant
    )
    return _moments(shape, states, method, beta)


def upper_bound(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = "linear",
    beta: float = 3.0,
    log_constant: ArrayLike = False,
) -> FloatArray:
    """Return `upper` of `propagate` (...) at less cost. The arguments are the same.

    `form` need converge at this β only. A bound may exist where `propagate` has NaN.
    """
    shape, states = _checked(
        model, aircraft, radar, cov_aircraft, cov_radar, method, beta, log_constant
    )
    chosen = METHODS[method]
    upper = chosen.upper or (lambda states, beta: chosen.moments(states, beta).upper)
    bound: FloatArray = upper(states, beta).reshape(shape)[()]
    return bound


def nonlinear(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = "linear",
    beta: float = 3.0,
    log_constant: ArrayLike = False,
    moments: Moments | None = None,
) -> NDArray[np.bool_]:
    """Return where (...) the moments of a method are unreliable.

    Moments are unreliable where higher orders would change σ by more than 2 %, or a bound by more
    than 0.005. No method accounts for the edge of P_D at a limit of a radar. Moments are unreliable
    too where a limit is within reach of the states.

    Args:
        model: As in `propagate`, with all other arguments but the last.
        aircraft: Nominal aircraft states.
        radar: Nominal radar states.
        cov_aircraft: C_aa.
        cov_radar: C_rr.
        method: Name of the method.
        beta: β.
        log_constant: Whether ln c_r is Gaussian.
        moments: The result of `propagate`; computed if None.
    """
    shape, states = _checked(
        model, aircraft, radar, cov_aircraft, cov_radar, method, beta, log_constant
    )
    chosen = METHODS[method]
    if moments is None:
        moments = chosen.moments(states, beta)
    flat, unreliable, done = moments.reshaped((len(states),)), [], 0
    for part in _reported(states):
        rows = slice(done, done + len(part))
        unreliable.append(chosen.nonlinear(part, flat.at(rows), beta))
        done += len(part)
        report(f"poses checked by {method}", done, len(states))
    result: NDArray[np.bool_] = np.concatenate(unreliable).reshape(shape)[()]
    return result


def propagate_scenario(scenario: Scenario, *, method: str = "linear", beta: float = 3.0) -> Moments:
    """Return the moments of P_D (n,) at every pose of a scenario, at its level.

    Raises:
        InputError: If there is no such method.
    """
    _check_choices(method, beta)
    shape, states = _states_of(scenario)
    return _moments(shape, states, method, beta)


def upper_bound_in_scenario(
    scenario: Scenario, *, method: str = "linear", beta: float = 3.0
) -> FloatArray:
    """Return the upper bound of P_D (n,) at every pose of a scenario, at its level."""
    return upper_bound(*_of(scenario), method=method, beta=beta, log_constant=scenario.log_constant)


def nonlinear_in_scenario(
    scenario: Scenario,
    moments: Moments | None = None,
    *,
    method: str = "linear",
    beta: float = 3.0,
) -> NDArray[np.bool_]:
    """Return where (n,) the moments of a scenario are unreliable. None computes the moments."""
    return nonlinear(
        *_of(scenario),
        method=method,
        beta=beta,
        log_constant=scenario.log_constant,
        moments=moments,
    )


def exceedance_probability(
    scenario: Scenario, p_max: float, *, method: str = "linear"
) -> FloatArray:
    """Return P(P_D > p_max) (n,) at every pose of a scenario, at its level of radar uncertainty.

    One minus P(P_D > p_max) is the conformance probability of JCGM 106:2012, clause 7. The
    probability is NaN where the method has no value.
    """
    _, states = _states_of(scenario)
    chosen = METHODS[method]
    if chosen.exceedance is not None:
        return chosen.exceedance(states, p_max)
    ends = [chosen.moments(states, beta) for beta in EXCEEDANCE_NODES if beta > 0]
    bounds = [*(m.lower for m in reversed(ends)), ends[0].p_d, *(m.upper for m in ends)]
    with np.errstate(invalid="ignore"):
        z = np.clip(ndtri(np.clip(bounds, 0.0, 1.0)), -LARGEST_PROBIT, LARGEST_PROBIT)
    return exceedance(EXCEEDANCE_NODES, z, float(ndtri(p_max)))


def std_function(scenario: Scenario, *, method: str = "linear") -> StdFunction:
    """Return a function from C_aa and C_rr to σ of P_D (n,) at every pose of a scenario.

    All calls of the function share the derivatives, which costs less than calls of `propagate`. An
    iterative method starts from its solution for the covariances of the scenario.
    """
    _, states = _states_of(scenario)
    chosen = METHODS[method]
    if chosen.std is not None:
        return chosen.std(states)
    return lambda *covariances: chosen.moments(states.with_covariances(*covariances), 3.0).std


def check_method(method: str) -> None:
    """Raise InputError, which is a ValueError, unless there is such a method."""
    check_choice("method", method, METHODS)


def _moments(shape: tuple[int, ...], states: UncertainStates, method: str, beta: float) -> Moments:
    parts, done = [], 0
    for part in _reported(states):
        parts.append(METHODS[method].moments(part, beta).certain_where_std_is_zero())
        done += len(part)
        report(f"poses propagated by {method}", done, len(states))
    return Moments.concatenated(parts).reshaped(shape)


def _reported(states: UncertainStates) -> Iterator[UncertainStates]:
    """Cut states into the parts after which progress is reported."""
    return states.cut(max(1024, REPORTED // len(states.log_constant)))


def _check_choices(method: str, beta: float) -> None:
    check_method(method)
    check_number("beta", beta, POSITIVE)


def _states_of(scenario: Scenario) -> tuple[tuple[int, ...], UncertainStates]:
    """Return the uncertain states of a scenario, whose arrays are checked already."""
    return uncertain_states(*_of(scenario), log_constant=scenario.log_constant, check=False)


def _of(scenario: Scenario) -> tuple[NetworkModel, FloatArray, FloatArray, FloatArray, FloatArray]:
    return (
        scenario.model,
        scenario.aircraft,
        scenario.shared,
        scenario.cov_aircraft,
        scenario.cov_shared,
    )


def _checked(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    method: str,
    beta: float,
    log_constant: ArrayLike,
) -> tuple[tuple[int, ...], UncertainStates]:
    _check_choices(method, beta)
    return uncertain_states(
        model, aircraft, radar, cov_aircraft, cov_radar, log_constant=log_constant
    )
