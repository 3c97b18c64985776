"""Methods of propagation: from Gaussian states to mean, deviation and bounds of P_D."""

from radar_sense.propagation.methods import (
    LARGEST_PROBIT,
    METHODS,
    Method,
    check_method,
    exceedance_probability,
    nonlinear,
    nonlinear_in_scenario,
    propagate,
    propagate_scenario,
    std_function,
    upper_bound,
    upper_bound_in_scenario,
)
from radar_sense.propagation.moments import (
    BOUND_CHANGE,
    STD_CHANGE,
    Moments,
    probit_moments,
)

__all__ = [
    "BOUND_CHANGE",
    "LARGEST_PROBIT",
    "METHODS",
    "STD_CHANGE",
    "Method",
    "Moments",
    "check_method",
    "exceedance_probability",
    "nonlinear",
    "nonlinear_in_scenario",
    "probit_moments",
    "propagate",
    "propagate_scenario",
    "std_function",
    "upper_bound",
    "upper_bound_in_scenario",
]
