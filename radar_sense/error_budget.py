"""What the uncertainty of P_D is made of, and how small its sources would have to be.

A source of the budget is a block of a state's covariance, see `states.SOURCES`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from radar_sense import covariance
from radar_sense.propagation import Moments, propagate
from radar_sense.reader import ScenarioError
from radar_sense.scenario import Scenario
from radar_sense.sobol import sobol_indices
from radar_sense.states import SOURCES, FloatArray
from radar_sense.wording import reached

#: The name of the budget by Sobol' indices, beside the methods of propagation.
MONTE_CARLO = "montecarlo"

#: Scaling a source by more than this is as good as any scaling.
LARGEST_FACTOR = 1e6


@dataclass(frozen=True, eq=False)
class Budget:
    """The standard deviation of P_D and what it is made of, at each of n poses.

    Attributes:
        mean: Mean of P_D (n,).
        std: Standard deviation of P_D from all sources together (n,).
        alone: Standard deviation from each source with the others certain (n,); by Sobol' indices,
            from each source with the others averaged out.
        moments: What the method says of the total; None by Sobol' indices.
        total_index: Share of the variance that each source takes part in (n,), by Sobol' indices.
        share_error: Standard errors of the shares (n,), by Sobol' indices.
    """

    mean: FloatArray
    std: FloatArray
    alone: Mapping[str, FloatArray]
    moments: Moments | None = None
    total_index: Mapping[str, FloatArray] | None = None
    share_error: Mapping[str, FloatArray] | None = None

    def shares(self) -> dict[str, FloatArray]:
        """Shares of the variance by source, and `interaction`, which makes them add up to 1 (n,).

        Interaction is what only several sources together bring about: by their correlation, or
        because P_D is not linear. It is negative where they make up for each other. All shares are
        NaN where nothing is uncertain.
        """
        variance = np.where(self.std > 0, self.std**2, np.nan)
        shares = {source: std**2 / variance for source, std in self.alone.items()}
        shares["interaction"] = 1.0 - np.sum(list(shares.values()), axis=0)
        return shares


def error_budget(scenario: Scenario, method: str = "linear") -> Budget:
    """Error budget of a scenario at its level.

    Args:
        scenario: The scenario; runs and seed are those of the Sobol' indices.
        method: A method of propagation, or "montecarlo" for Sobol' indices.

    Raises:
        ScenarioError: If Sobol' indices are asked for and sources are correlated.
    """
    if method == MONTE_CARLO:
        return _by_sobol_indices(scenario)
    total = _moments(scenario, method, {})
    alone = {
        source: _moments(scenario, method, dict.fromkeys(set(SOURCES) - {source}, 0.0)).std
        for source in SOURCES
    }
    return Budget(mean=total.mean, std=total.std, alone=alone, moments=total)


@dataclass(frozen=True)
class Allowance:
    """How large a source may be for 3σ of P_D to stay within a target.

    Attributes:
        factor: What to multiply its standard deviations by; below 1 it has to shrink. None if not
            even 0 is small enough; infinite if no size is too large.
        remains: 3σ of P_D that remains with the source at `factor`, or at 0 if there is none.
        theta_r_deg: Where it remains.
        remains_from: The largest of the other sources there; none if all are scaled together.
    """

    factor: float | None
    remains: float
    theta_r_deg: float
    remains_from: str | None


def allowances(
    scenario: Scenario, target: float, *, method: str = "linear", at: float | None = None
) -> dict[str, Allowance]:
    """Answer the inverse question: how small must each source be for 3σ of P_D ≤ target?

    Args:
        scenario: The scenario, at its level.
        target: What 3σ of P_D is to stay within, positive.
        method: Method of propagation that says what 3σ is.
        at: Azimuth of the only pose that counts [deg]; every pose if None.

    Returns:
        An allowance for each source with the others as they are, and for "all" scaled together.

    Raises:
        ScenarioError: If there is no pose at that azimuth.
    """
    poses = _poses_at(scenario, at)
    theta = scenario.theta_r_deg[poses]
    alone = {s: std[poses] for s, std in error_budget(scenario, method).alone.items()}

    def three_sigma(sources: Collection[str], factor: float) -> FloatArray:
        std = _moments(scenario, method, dict.fromkeys(sources, factor), poses).std
        # what a method cannot say is not within any target
        return np.where(np.isfinite(std), 3 * std, np.inf)

    def excess(factor: float, sources: Collection[str]) -> float:
        return min(float(three_sigma(sources, factor).max()), 1e300) - target

    def largest_factor(sources: Collection[str]) -> float | None:
        if excess(0.0, sources) > 0:
            return None
        high = 1.0
        while excess(high, sources) <= 0:
            high *= 4.0
            if high > LARGEST_FACTOR:
                return float("inf")
        factor = float(brentq(excess, 0.0, high, args=(sources,), xtol=1e-9))
        # of the two ends of the last bracket take the one that is within the target
        while factor > 0 and excess(factor, sources) > 0:
            factor *= 1 - 1e-8
        return factor

    def allowance(sources: Collection[str]) -> Allowance:
        factor = largest_factor(sources)
        remains = three_sigma(sources, LARGEST_FACTOR if factor == np.inf else factor or 0.0)
        pose = int(np.argmax(reached(remains)))
        others = {s: std[pose] for s, std in alone.items() if s not in sources}
        return Allowance(
            factor=factor,
            remains=float(remains[pose]),
            theta_r_deg=float(theta[pose]),
            remains_from=max(others, key=others.__getitem__) if others else None,
        )

    return {**{source: allowance([source]) for source in SOURCES}, "all": allowance(list(SOURCES))}


def _poses_at(scenario: Scenario, at: float | None) -> slice:
    if at is None:
        return slice(None)
    theta = scenario.theta_r_deg
    nearest = int(np.argmin(abs(theta - at)))
    if abs(theta[nearest] - at) > 1e-9:
        raise ScenarioError(
            f"there is no pose at {at:g} deg, the nearest of {len(theta)} is at "
            f"{theta[nearest]:g} deg"
        )
    return slice(nearest, nearest + 1)


def _moments(
    scenario: Scenario, method: str, factors: Mapping[str, float], poses: slice = slice(None)
) -> Moments:
    """Propagate with the standard deviations of some sources multiplied by a factor."""
    covariances = {
        "aircraft": scenario.cov_aircraft,
        "radar": scenario.cov_radar[scenario.level],
    }
    for source, factor in factors.items():
        whose, components = SOURCES[source]
        covariances[whose] = covariance.scaled(covariances[whose], components, factor)
    return propagate(
        scenario.model,
        scenario.aircraft[poses],
        scenario.radar,
        covariances["aircraft"],
        covariances["radar"],
        method=method,
    )


def _by_sobol_indices(scenario: Scenario) -> Budget:
    cov_radar = scenario.cov_radar[scenario.level]
    for whose, matrix in (("aircraft", scenario.cov_aircraft), ("radar", cov_radar)):
        blocks = [components for owner, components in SOURCES.values() if owner == whose]
        apart = sum(covariance.only(matrix, components) for components in blocks)
        if not np.array_equal(matrix, apart):
            raise ScenarioError(
                f"level {scenario.level}: {whose} position and the rest of its state are "
                "correlated; Sobol' indices need independent sources, use another method"
            )
    factor_aircraft, factor_radar = np.zeros((6, 6)), np.zeros((4, 4))
    for whose, components in SOURCES.values():
        # each source on its own, so that no input serves two of them
        matrix, root = {
            "aircraft": (scenario.cov_aircraft, factor_aircraft),
            "radar": (cov_radar, factor_radar),
        }[whose]
        root[components, components] = covariance.factor(matrix[components, components])
    aircraft_inputs, radar_inputs = len(factor_aircraft), len(factor_radar)
    groups = [
        list(range(aircraft_inputs)[components])
        if whose == "aircraft"
        else list(range(aircraft_inputs, aircraft_inputs + radar_inputs)[components])
        for whose, components in SOURCES.values()
    ]

    def p_d(white: FloatArray) -> FloatArray:
        aircraft = covariance.draws(np.zeros(6), factor_aircraft, white[:, :aircraft_inputs])
        radar = covariance.draws(scenario.radar, factor_radar, white[:, aircraft_inputs:])
        radar[:, -1] = np.maximum(radar[:, -1], 0.0)
        return np.stack([scenario.model.p_d(pose + aircraft, radar) for pose in scenario.aircraft])

    indices = sobol_indices(p_d, groups, samples=scenario.runs, seed=scenario.seed)
    std = np.sqrt(indices.variance)
    first = np.nan_to_num(indices.first)
    return Budget(
        mean=indices.mean,
        std=std,
        # an estimate of a share can come out below zero
        alone={s: std * np.sqrt(np.maximum(first[i], 0.0)) for i, s in enumerate(SOURCES)},
        total_index={s: indices.total[i] for i, s in enumerate(SOURCES)},
        share_error={s: indices.first_error[i] for i, s in enumerate(SOURCES)},
    )
