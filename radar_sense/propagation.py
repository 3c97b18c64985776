"""Methods of propagation: from Gaussian states to mean, deviation and bounds of P_D.

One function per method, all of one signature, chosen by name in `METHODS`. `linear` is the paper's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.model import DetectionModel
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class Moments:
    """What a method of propagation says of P_D at each pose.

    Attributes:
        p_d: P_D of the nominal states (...).
        mean: Mean of P_D (...).
        std: Standard deviation of P_D (...).
        lower: Bound that P_D falls below with probability Φ(−β) (...).
        upper: Bound that P_D stays below with probability Φ(β) (...).
        curved: Where effects of second order are too large beside those of first order for the
            method to be trusted (...).
        settled: Where the method's iteration has settled; where it has not, mean, std and bounds are
            NaN (...).
    """

    p_d: FloatArray
    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    curved: NDArray[np.bool_]
    settled: NDArray[np.bool_]


#: A method: model, aircraft (..., 6), radar (..., 4), C_aa (..., 6, 6), C_rr (..., 4, 4), β.
Method = Callable[
    [DetectionModel, ArrayLike, ArrayLike, ArrayLike, ArrayLike, float],
    Moments,
]


def propagate(
    model: DetectionModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    method: str = "linear",
    beta: float = 3.0,
) -> Moments:
    """Mean, standard deviation and bounds of P_D by a method named in `METHODS`.

    Raises:
        ValueError: If there is no such method or a shape does not fit.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    return METHODS[method](model, aircraft, radar, cov_aircraft, cov_radar, beta)


def linear(
    model: DetectionModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    beta: float,
) -> Moments:
    """First order in P_D, `eq:pd_var`: the paper's method."""
    lin = model.linearize(aircraft, radar)
    std = lin.std(cov_aircraft, cov_radar)
    known = np.ones(np.shape(std), dtype=bool)
    return Moments(
        p_d=lin.p_d,
        mean=lin.p_d,
        std=std,
        lower=lin.p_d - beta * std,
        upper=lin.p_d + beta * std,
        curved=~known,
        settled=known,
    )


METHODS: Mapping[str, Method] = {"linear": linear}
