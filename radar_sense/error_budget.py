"""What the uncertainty of P_D is made of, and how small its sources would have to be.

A source of the budget is a block of a state's covariance, see `states.sources`. Where the scenario
says what makes the constant of a single radar uncertain, that source has parts, one for each
parameter.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from radar_sense import covariance
from radar_sense.propagation import Moments, check_method, propagate_scenario
from radar_sense.radar_constant import draw, normals, relative_std
from radar_sense.reader import ScenarioError
from radar_sense.scenario import Scenario
from radar_sense.sobol import REPLICATES, sobol_indices
from radar_sense.states import (
    AIRCRAFT,
    CONSTANT,
    CONSTANTS,
    SOURCES,
    FloatArray,
    Source,
    finer_sources,
    sources,
)
from radar_sense.wording import reached

#: Begins the names of the parts of the radar constant, before their keys; itself the source.
OF_CONSTANT = "radar_constant"

#: The name of the budget by Sobol' indices, beside the methods of propagation.
MONTE_CARLO = "montecarlo"

#: Scaling a source by a million is as good as any scaling, by a millionth as good as removing it.
LARGEST_LOG_FACTOR = float(np.log(1e6))

#: Numbers that the Sobol' indices may take at a time (4 GB).
MAX_NUMBERS = 500_000_000


@dataclass(frozen=True, eq=False)
class Budget:
    """The standard deviation of P_D and what it is made of, at each of n poses.

    Attributes:
        mean: Mean of P_D (n,).
        std: Standard deviation of P_D from all sources together (n,).
        alone: Standard deviation from each source with the others certain (n,); by Sobol' indices,
            from each source with the others averaged out.
        moments: What the method says of the total; None by Sobol' indices.
        finer: As `alone`, from the aircraft as a whole and from parts of the radars of a network,
            which are in `alone` already in another grouping (n,); none by Sobol' indices.
        total_index: Share of the variance that each source takes part in (n,), by Sobol' indices.
        share_error: Standard errors of the shares, of the interaction, and of the shares of the
            parts by `part_name` (n,), by Sobol' indices.
        parts: Standard deviation from each part of the radar constant alone (n,), by its key.
    """

    mean: FloatArray
    std: FloatArray
    alone: Mapping[str, FloatArray]
    moments: Moments | None = None
    finer: Mapping[str, FloatArray] = field(default_factory=dict)
    total_index: Mapping[str, FloatArray] | None = None
    share_error: Mapping[str, FloatArray] | None = None
    parts: Mapping[str, FloatArray] = field(default_factory=dict)

    def part_shares(self) -> dict[str, FloatArray]:
        """Shares of the variance by part of the radar constant alone (n,), NaN as `shares`."""
        variance = np.where(self.std > 0, self.std**2, np.nan)
        return {key: std**2 / variance for key, std in self.parts.items()}

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
        ScenarioError: If there is no such method, or Sobol' indices are asked for and sources are
            correlated.
    """
    check_method(method, [MONTE_CARLO])
    if method == MONTE_CARLO:
        return _by_sobol_indices(scenario)
    total = propagate_scenario(scenario, method=method)
    names = scenario.model.names
    wanted = (sources(names), finer_sources(names), [part_name(p.key) for p in scenario.parts])
    alone, finer, parts = (
        {name: _alone(scenario, method, name).std for name in group} for group in wanted
    )
    return Budget(
        mean=total.mean,
        std=total.std,
        alone=alone,
        moments=total,
        finer=finer,
        parts={part.key: parts[part_name(part.key)] for part in scenario.parts},
    )


def part_name(key: str) -> str:
    """Name of a part of the radar constant among the sources."""
    return f"{OF_CONSTANT}_{key}"


@dataclass(frozen=True)
class Allowance:
    """How large a source may be for 3σ of P_D to stay within a target.

    Attributes:
        factor: What to multiply its standard deviations by; below 1 it has to shrink. None if not
            even 0 is small enough, 0 if a millionth is not; infinite if a million is.
        remains: 3σ of P_D that remains with the source at `factor`, or at 0 if there is none.
        place: Where it remains, on the scenario's axis.
        remains_from: The largest of the other sources there; none if all are scaled together.
        known: False if the method has no answer, at no factor or beyond the one given.
    """

    factor: float | None
    remains: float
    place: float
    remains_from: str | None
    known: bool = True


def allowances(
    scenario: Scenario, target: float, *, method: str = "linear", at: float | None = None
) -> dict[str, Allowance]:
    """Answer the inverse question: how small must each source be for 3σ of P_D ≤ target?

    3σ is taken to grow with the source, as it does but for strong correlations.

    Args:
        scenario: The scenario, at its level.
        target: What 3σ of P_D is to stay within, positive.
        method: Method of propagation that says what 3σ is.
        at: Place on the scenario's axis of the only pose that counts; every pose if None.

    Returns:
        An allowance for each source with the others as they are, for each part of the radar
        constant, as named by `part_name`, and for "all" sources scaled together.

    Raises:
        ScenarioError: If there is no pose there.
    """
    if at is not None:
        scenario = _only_at(scenario, at)
    found = error_budget(scenario, method)
    parts = {part_name(key): std for key, std in found.parts.items()}

    def three_sigma(names: Collection[str], factor: float) -> FloatArray:
        return 3 * scaled_moments(scenario, method, names, factor).std

    def excess(log_factor: float, names: Collection[str]) -> float:
        """Largest 3σ less the target; NaN where the method has no answer."""
        return float(np.max(three_sigma(names, float(np.exp(log_factor))))) - target

    def largest_factor(names: Collection[str]) -> tuple[float | None, bool]:
        """Return the factor, and whether the method has an answer beyond it."""
        nothing = float(np.max(three_sigma(names, 0.0)))
        if not nothing <= target:
            return None, not np.isnan(nothing)
        low, high, step = 0.0, 0.0, np.log(4.0)
        # `not <=` is meant: where there is no answer is not within the target
        if excess(0.0, names) <= 0:
            while excess(high, names) <= 0:
                low, high = high, high + step
                if high > LARGEST_LOG_FACTOR:
                    return np.inf, True
        else:
            while not excess(low, names) <= 0:
                low, high = low - step, low
                if low < -LARGEST_LOG_FACTOR:
                    return 0.0, not np.isnan(excess(low, names))
        while np.isnan(excess(high, names)):
            if high - low < 0.01:
                return float(np.exp(low)), False
            middle = 0.5 * (low + high)
            low, high = (middle, high) if excess(middle, names) <= 0 else (low, middle)
        from scipy.optimize import brentq  # slow to import

        root = brentq(excess, low, high, args=(names,), xtol=1e-10, rtol=1e-15)
        return float(np.exp(root - 1e-9)), True  # on the side that is within the target

    def allowance(names: Collection[str]) -> Allowance:
        factor, known = largest_factor(names)
        used = np.exp(LARGEST_LOG_FACTOR) if factor == np.inf else factor or 0.0
        remains = three_sigma(names, used)
        unknown = np.isnan(remains)
        pose = int(np.argmax(unknown if unknown.any() else reached(remains)))
        others = {s: std[pose] for s, std in found.alone.items() if s not in names}
        if not parts.keys().isdisjoint(names):  # the rest of the radar constant, part by part
            del others[OF_CONSTANT]
            others.update({s: std[pose] for s, std in parts.items() if s not in names})
        return Allowance(
            factor=factor,
            remains=float(remains[pose]),
            place=float(scenario.axis.values[pose]),
            remains_from=max(others, key=others.__getitem__) if others else None,
            known=known,
        )

    each = {name: allowance([name]) for name in (*found.alone, *parts)}
    return {**each, "all": allowance(list(found.alone))}


def _only_at(scenario: Scenario, at: float) -> Scenario:
    """Return the scenario with a single pose of its."""
    axis = scenario.axis
    pose = axis.find(at)
    if pose is None:
        raise ScenarioError(
            f"there is no pose at {axis.say(at)}, the nearest of {len(axis)} is at "
            f"{axis.at(axis.nearest(at))}"
        )
    return scenario.part(slice(pose, pose + 1))


def scaled_moments(
    scenario: Scenario, method: str, names: Collection[str], factor: float
) -> Moments:
    """Propagate with the standard deviations of some sources multiplied by a factor.

    Args:
        scenario: The scenario, at its level.
        method: Method of propagation.
        names: Names of sources, `states.sources`, and of parts of the radar constant as by
            `part_name`.
        factor: What to multiply by, not negative.
    """
    return _propagate(scenario, method, _scaled(scenario, names, factor))


def _alone(scenario: Scenario, method: str, name: str) -> Moments:
    """Propagate with all certain but one source, or one part of the radar constant."""
    parts = {part_name(part.key) for part in scenario.parts}
    owner, components = _source(scenario, OF_CONSTANT if name in parts else name)
    others = parts - {name} if name in parts else ()
    covariances = {
        whose: covariance.only(matrix, components if whose == owner else slice(0, 0))
        for whose, matrix in _scaled(scenario, others, 0.0).items()
    }
    return _propagate(scenario, method, covariances)


def _source(scenario: Scenario, name: str) -> Source:
    names = scenario.model.names
    return {**sources(names), **finer_sources(names)}[name]


def _scaled(scenario: Scenario, names: Collection[str], factor: float) -> dict[str, FloatArray]:
    """Return C_aa and C_rr with the standard deviations of some sources multiplied."""
    covariances = {"aircraft": scenario.cov_aircraft, "radar": scenario.cov_radar[scenario.level]}
    parts = [part for part in scenario.parts if part_name(part.key) in names]
    of_parts = {part_name(part.key) for part in parts}
    scaled = [(_source(scenario, name), factor) for name in names if name not in of_parts]
    if parts:
        whole = relative_std(scenario.parts)
        others = relative_std([part for part in scenario.parts if part not in parts])
        remains = np.hypot(others, factor * relative_std(parts))
        scaled.append((SOURCES[OF_CONSTANT], remains / whole if whole else 1.0))
    for (whose, components), by in scaled:
        covariances[whose] = covariance.scaled(covariances[whose], components, by)
    return covariances


def _propagate(scenario: Scenario, method: str, covariances: Mapping[str, FloatArray]) -> Moments:
    """Propagate with other covariances."""
    changed = dataclasses.replace(
        scenario,
        cov_aircraft=covariances["aircraft"],
        cov_radar={scenario.level: covariances["radar"]},
    )
    return propagate_scenario(changed, method=method)


def _by_sobol_indices(scenario: Scenario) -> Budget:
    parts, every = scenario.parts, sources(scenario.model.names)
    evaluations = (len(every) + len(parts) + 4) * scenario.runs / REPLICATES * 2
    if evaluations * len(scenario.aircraft) > MAX_NUMBERS:
        raise ScenarioError(
            f"{scenario.runs:,} runs of {len(scenario.aircraft):,} poses are more than fit into "
            "memory for Sobol' indices; use fewer runs"
        )
    cov_radar = scenario.cov_radar[scenario.level]
    for whose, matrix in (("aircraft", scenario.cov_aircraft), ("radar", cov_radar)):
        blocks = [components for owner, components in every.values() if owner == whose]
        apart = sum(covariance.only(matrix, components) for components in blocks)
        if not np.array_equal(matrix, apart):
            raise ScenarioError(
                f"level {scenario.level}: {whose} position and the rest of its state are "
                "correlated; Sobol' indices need independent sources, use another method"
            )
    factor_aircraft, factor_radar = np.zeros_like(scenario.cov_aircraft), np.zeros_like(cov_radar)
    for whose, components in every.values():
        # each source on its own, so that no input serves two of them
        matrix, root = {
            "aircraft": (scenario.cov_aircraft, factor_aircraft),
            "radar": (cov_radar, factor_radar),
        }[whose]
        block = (..., components, components)
        root[block] = covariance.factor(matrix[block])
    aircraft_inputs, radar_inputs = len(AIRCRAFT), normals(len(cov_radar), parts)
    inputs = {
        "aircraft": range(aircraft_inputs),
        "radar": range(aircraft_inputs, aircraft_inputs + radar_inputs),
    }
    groups = [list(inputs[whose][components]) for whose, components in every.values()]
    if parts:  # the constant is all of them, and then each of them is a group by itself
        of_constant = list(inputs["radar"][CONSTANT:])
        groups[list(every).index(OF_CONSTANT)] = of_constant
        groups += [[i] for i in of_constant]

    def p_d(white: FloatArray) -> FloatArray:
        errors = _errors(factor_aircraft, white[:, :aircraft_inputs])
        of_radar = white[:, aircraft_inputs:]
        radar = covariance.draws(scenario.radar, factor_radar, of_radar[:, : len(cov_radar)])
        if parts:
            radar[:, CONSTANT] = draw(scenario.radar[CONSTANT], parts, of_radar[:, CONSTANT:])
        radar[:, CONSTANTS] = np.maximum(radar[:, CONSTANTS], 0.0)
        return np.stack(
            [
                scenario.model.p_d(pose + error, radar)
                for pose, error in zip(scenario.aircraft, errors, strict=False)
            ]
        )

    indices = sobol_indices(p_d, groups, samples=scenario.runs, seed=scenario.seed)
    std = np.sqrt(indices.variance)
    first = np.nan_to_num(indices.first)
    return Budget(
        mean=indices.mean,
        std=std,
        # an estimate of a share can come out below zero
        alone={s: std * np.sqrt(np.maximum(first[i], 0.0)) for i, s in enumerate(every)},
        total_index={s: indices.total[i] for i, s in enumerate(every)},
        share_error={
            **{s: indices.first_error[i] for i, s in enumerate(every)},
            "interaction": np.sqrt(np.sum(indices.first_error[: len(every)] ** 2, axis=0)),
            **{
                part_name(part.key): indices.first_error[i]
                for i, part in enumerate(parts, start=len(every))
            },
        },
        parts={
            part.key: std * np.sqrt(np.maximum(first[i], 0.0))
            for i, part in enumerate(parts, start=len(every))
        },
    )


def _errors(factor: FloatArray, white: FloatArray) -> Iterable[FloatArray]:
    """Errors (m, 6) of the aircraft at pose after pose: one and the same, or one for each."""
    mean = np.zeros(len(AIRCRAFT))
    if factor.ndim == 2:
        return itertools.repeat(covariance.draws(mean, factor, white))
    return (covariance.draws(mean, root, white) for root in factor)
