"""Contributions of the sources to the uncertainty of P_D, and how small the sources must be.

A source of the budget is a block of a state's covariance, see `states.sources`. Where the scenario
says what makes a radar constant uncertain, there are parts of it, one for each parameter.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from radar_sense import covariance
from radar_sense.analyses.report import reached
from radar_sense.errors import InputError
from radar_sense.model.radar_constant import Tolerance, relative_std
from radar_sense.montecarlo.sampler import Sampler, columns, made_of_parts
from radar_sense.montecarlo.sobol import sobol_indices
from radar_sense.propagation import (
    Moments,
    check_method,
    propagate_scenario,
    std_function,
    upper_bound,
)
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, FloatArray, Source, constant_names, finer_sources, sources

#: The name of the budget by Sobol' indices, beside the methods of propagation.
MONTE_CARLO = "montecarlo"

#: Scaling a source by a million is as good as any scaling, by a millionth as good as removing it.
LARGEST_LOG_FACTOR = float(np.log(1e6))


@dataclass(frozen=True, eq=False)
class Budget:
    """The standard deviation of P_D and the contributions of the sources, at each of n poses.

    Attributes:
        mean: Mean of P_D (n,).
        std: Standard deviation of P_D from all sources together (n,).
        alone: Standard deviation from each source with the others certain (n,); by Sobol' indices,
            from each source with the others averaged out.
        moments: Moments of P_D with all sources; None by Sobol' indices.
        finer: As `alone`, from the aircraft as a whole and from parts of the radars of a network,
            which are in `alone` already in another grouping (n,); none by Sobol' indices.
        total_index: Share of the variance that each source takes part in (n,), by Sobol' indices.
        share_error: Standard errors of the shares, of the interaction, and of the shares of the
            parts (n,), by Sobol' indices.
        parts: Standard deviation from each part of a radar constant alone (n,), by `parts_of`.
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
        """Shares of the variance by part of a radar constant alone (n,), NaN as `shares`."""
        variance = np.where(self.std > 0, self.std**2, np.nan)
        return {name: std**2 / variance for name, std in self.parts.items()}

    def shares(self) -> dict[str, FloatArray]:
        """Shares of the variance by source, and `interaction`, which makes them add up to 1 (n,).

        The interaction is the share that no single source has: from correlations, or because P_D is
        not linear. It can be negative. All shares are NaN where nothing is uncertain.
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
        InputError: If there is no such method, or Sobol' indices are asked for and sources are
            correlated.
    """
    check_method(method, [MONTE_CARLO])
    if method == MONTE_CARLO:
        return _by_sobol_indices(scenario)
    total = propagate_scenario(scenario, method=method)
    names = scenario.model.names
    wanted = (sources_of(scenario), finer_sources(names), parts_of(scenario))
    std = std_function(scenario, method=method)
    alone, finer, parts = (
        {name: std(*_alone(scenario, name)) for name in group} for group in wanted
    )
    return Budget(
        mean=total.mean,
        std=total.std,
        alone=alone,
        moments=total,
        finer=finer,
        parts=parts,
    )


def sources_of(scenario: Scenario) -> dict[str, Source]:
    """Return the sources of the error budget of a scenario by name."""
    return sources(scenario.model.names, rcs=scenario.rcs_std > 0)


@dataclass(frozen=True)
class OfConstant:
    """A part of a radar constant, and where in a budget it belongs.

    Attributes:
        part: The part.
        radar: Number of the radar, from 0.
        source: Name of the source, one of `states.sources`, that it is a part of.
        constant: Name of the radar constant, in a network one of `states.finer_sources`.
    """

    part: Tolerance
    radar: int
    source: str
    constant: str

    @property
    def name(self) -> str:
        """Its name in a budget, which `network.name_problem` keeps from meaning anything else."""
        return f"{self.constant}_{self.part.key}"


def parts_of(scenario: Scenario) -> dict[str, OfConstant]:
    """Return the parts of all radar constants at the scenario's level, by their names."""
    names = scenario.model.names
    constants = constant_names(names)
    members = [
        OfConstant(part, i, names[i] if len(names) > 1 else constants[i], constants[i])
        for i, parts in enumerate(scenario.tolerances_at_level)
        for part in parts
    ]
    return {of.name: of for of in members}


@dataclass(frozen=True)
class RequiredAccuracy:
    """How large a source may be for 3σ of P_D, or its upper bound, to stay within a limit.

    Attributes:
        factor: Largest factor on its standard deviations; below 1 the source has to shrink. None if
            not even 0 is small enough, 0 if a millionth is not; infinite if a million is.
        residual: Value that remains with the source at `factor`, or at 0 if there is none.
        place: Where the residual is, on the scenario's axis.
        residual_from: The largest of the other sources there, `P_D itself` where P_D exceeds the
            limit, None if all sources are scaled together.
        known: False if the method has no answer, at no factor or beyond the one given.
    """

    factor: float | None
    residual: float
    place: float
    residual_from: str | None
    known: bool = True


def required_accuracies(
    scenario: Scenario,
    limit: float,
    *,
    k: float | None = None,
    method: str = "linear",
    at: float | None = None,
) -> dict[str, RequiredAccuracy]:
    """Return how small each source must be for 3σ of P_D, or its bound, to stay within a limit.

    The value is assumed to grow with the source. Only strong correlations contradict that.

    Args:
        scenario: The scenario, at its level.
        limit: Limit of 3σ of P_D, or of its upper bound; positive.
        k: The upper bound is the one at Φ(k), P_D + kσ by `linear`; None for 3σ.
        method: Method of propagation.
        at: Place on the scenario's axis of the only pose that counts; every pose if None.

    Returns:
        The accuracy required of each source with the others unchanged, of each part of a radar
        constant, as named by `parts_of`, and of "all" sources scaled together.

    Raises:
        InputError: If there is no pose there.
    """
    if at is not None:
        scenario = _only_at(scenario, at)
    budget = error_budget(scenario, method)
    of_parts = parts_of(scenario)
    at_all_poses = value_function(scenario, method, k)
    # A source that has to shrink has to do so at the poses above the limit alone.
    above = ~(at_all_poses((), 1.0) <= limit)
    at_critical_poses = at_all_poses
    if above.any():
        at_critical_poses = value_function(scenario.at_poses(np.flatnonzero(above)), method, k)

    def excess(log_factor: float, names: Collection[str]) -> float:
        """Largest value less the limit; NaN where the method has no answer."""
        return float(np.max(at_critical_poses(names, float(np.exp(log_factor))))) - limit

    def largest_factor(names: Collection[str]) -> tuple[float | None, bool]:
        """Return the factor, and whether the method has an answer beyond it."""
        least = float(np.max(at_critical_poses(names, 0.0)))
        if not least <= limit:
            return None, not np.isnan(least)
        low, high, step = 0.0, 0.0, np.log(4.0)
        # Comparisons are `not <=` because NaN is not within the limit.
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

        unanswered: list[float] = []

        def defined_excess(log_factor: float) -> float:
            value = excess(log_factor, names)
            if np.isnan(value):  # not within the limit, as above
                unanswered.append(log_factor)
                return 1.0
            return value

        root = brentq(defined_excess, low, high, xtol=1e-10, rtol=1e-15)
        known = not unanswered or min(unanswered) > root + 1e-9
        return float(np.exp(root - 1e-9)), known  # on the side that is within the limit

    def required(names: Collection[str]) -> RequiredAccuracy:
        factor, known = largest_factor(names)
        used = np.exp(LARGEST_LOG_FACTOR) if factor == np.inf else factor or 0.0
        residual = at_all_poses(names, used)
        unknown = np.isnan(residual)
        pose = int(np.argmax(unknown if unknown.any() else reached(residual)))
        return RequiredAccuracy(
            factor=factor,
            residual=float(residual[pose]),
            place=float(scenario.axis.values[pose]),
            residual_from=_residual_from(
                scenario, budget, names, pose, None if k is None else limit
            ),
            known=known,
        )

    each = {name: required([name]) for name in (*budget.alone, *of_parts)}
    return {**each, "all": required(list(budget.alone))}


def value_function(
    scenario: Scenario, method: str, k: float | None = None
) -> Callable[[Collection[str], float], FloatArray]:
    """Return a function from names of sources and a factor on their σ to a value (n,).

    The value is the upper bound of P_D at Φ(k), or 3σ of P_D if k is None. Names are those of
    sources, `states.sources`, and of parts of a radar constant, `parts_of`.
    """
    if k is None:
        std = std_function(scenario, method=method)

        def three_sigma(names: Collection[str], factor: float) -> FloatArray:
            covariances = _scaled(scenario, names, factor)
            return 3.0 * std(covariances["aircraft"], covariances["radar"])

        return three_sigma

    def bound(names: Collection[str], factor: float) -> FloatArray:
        covariances = _scaled(scenario, names, factor)
        return upper_bound(
            scenario.model,
            scenario.aircraft,
            scenario.shared,
            covariances["aircraft"],
            covariances["radar"],
            method=method,
            beta=k,
            log_constant=scenario.log_constant,
        )

    return bound


def _residual_from(
    scenario: Scenario, budget: Budget, names: Collection[str], pose: int, p_max: float | None
) -> str | None:
    """Return the largest source at a pose besides some; "P_D itself" where P_D is above p_max."""
    if p_max is not None:
        p_d = scenario.model.p_d(scenario.aircraft[pose], scenario.radar)
        if p_d > p_max:
            return "P_D itself"
    of_parts, others = parts_of(scenario), dict(budget.alone)
    for of in [of_parts[name] for name in names if name in of_parts]:  # the rest of its radar
        del others[of.source]
        rest = [n for n, other in of_parts.items() if other.source == of.source]
        others.update({name: budget.parts[name] for name in rest})
        if of.source != of.constant:
            others[f"{of.source}_position"] = budget.finer[f"{of.source}_position"]
    at_pose = {name: std[pose] for name, std in others.items() if name not in names}
    return max(at_pose, key=at_pose.__getitem__) if at_pose else None


def _only_at(scenario: Scenario, at: float) -> Scenario:
    """Return the scenario with the pose at one place alone."""
    axis = scenario.axis
    pose = axis.find(at)
    if pose is None:
        raise InputError(
            f"there is no pose at {axis.format(at)}, the nearest of {len(axis)} is at "
            f"{axis.at(axis.nearest(at))}"
        )
    return scenario.at_poses(slice(pose, pose + 1))


def _alone(scenario: Scenario, name: str) -> tuple[FloatArray, FloatArray]:
    """Return C_aa and C_rr with one source, or one part of a radar constant, and nothing else."""
    parts = parts_of(scenario)
    owner, components = _source(scenario, parts[name].constant if name in parts else name)
    others = parts.keys() - {name} if name in parts else ()
    covariances = _scaled(scenario, others, 0.0)
    for whose, matrix in covariances.items():
        if whose != owner:  # one matrix of zeros for all poses
            covariances[whose] = np.zeros(matrix.shape[-2:])
        else:
            covariances[whose] = covariance.keep_components(matrix, components)
    return covariances["aircraft"], covariances["radar"]


def _source(scenario: Scenario, name: str) -> Source:
    names = scenario.model.names
    return {**sources_of(scenario), **finer_sources(names)}[name]


def _scaled(scenario: Scenario, names: Collection[str], factor: float) -> dict[str, FloatArray]:
    """Return C_aa and C_rr with the standard deviations of some sources multiplied."""
    covariances = {"aircraft": scenario.cov_aircraft, "radar": scenario.cov_shared}
    of_parts = parts_of(scenario)
    scaled = [(_source(scenario, name), factor) for name in names if name not in of_parts]
    changed = [of_parts[name] for name in of_parts if name in names]
    for radar, constant in dict.fromkeys((of.radar, of.constant) for of in changed):
        tolerances = scenario.tolerances_at_level[radar]
        parts = [of.part for of in changed if of.radar == radar]
        whole = relative_std(tolerances)
        others = relative_std([part for part in tolerances if part not in parts])
        residual = np.hypot(others, factor * relative_std(parts))
        scaled.append((_source(scenario, constant), residual / whole if whole else 1.0))
    for (whose, components), by in scaled:
        covariances[whose] = covariance.scale_std(covariances[whose], components, by)
    return covariances


def _by_sobol_indices(scenario: Scenario) -> Budget:
    sampler = Sampler.of(scenario)  # refuses what is not a covariance
    parts, blocks_by_name = parts_of(scenario), sources_of(scenario)
    cov_radar = scenario.cov_shared
    for whose, matrix in (("aircraft", scenario.cov_aircraft), ("radar", cov_radar)):
        blocks = [components for owner, components in blocks_by_name.values() if owner == whose]
        apart = sum(covariance.keep_components(matrix, components) for components in blocks)
        if not np.array_equal(matrix, apart):
            raise InputError(
                f"level {scenario.level}: {whose} position and the rest of its state are "
                "correlated; Sobol' indices need independent sources, use another method"
            )
    sqrt_cov = {
        "aircraft": np.zeros_like(scenario.cov_aircraft),
        "radar": np.zeros_like(cov_radar),
    }
    for whose, components in blocks_by_name.values():
        # the square root of each source by itself, so that no input belongs to two of them
        block = (..., components, components)
        if whose == "radar":
            states = range(components.start, components.stop)
            independent = [
                states.index(c) for c in made_of_parts(scenario.tolerances_at_level) if c in states
            ]
            sqrt_cov[whose][block] = covariance.block_square_root(cov_radar[block], independent)
        else:
            sqrt_cov[whose][block] = covariance.square_root(scenario.cov_aircraft[block])
    sampler = dataclasses.replace(
        sampler,
        sqrt_cov_aircraft=sqrt_cov["aircraft"],
        sqrt_cov_radar=sqrt_cov["radar"],
    )
    inputs = {
        "aircraft": list(range(len(AIRCRAFT))),
        "radar": list(range(len(AIRCRAFT), len(AIRCRAFT) + sampler.radar_normals)),
    }
    groups = {
        name: inputs[whose][components] for name, (whose, components) in blocks_by_name.items()
    }
    part_columns = columns(len(cov_radar), scenario.tolerances_at_level)
    for of, column in zip(parts.values(), itertools.chain(*part_columns), strict=True):
        # a constant is all of its parts, and then each of them is a group by itself
        groups[of.name] = [inputs["radar"][column]]
        groups[of.source] = list(dict.fromkeys(groups[of.source] + groups[of.name]))

    def p_d(normals: FloatArray, poses: slice) -> FloatArray:
        errors = _errors(sqrt_cov["aircraft"], normals[:, : len(AIRCRAFT)], poses)
        radar, _ = sampler.draw_radar(normals[:, len(AIRCRAFT) :])
        return np.stack(
            [
                scenario.model.p_d(pose + error, radar)
                for pose, error in zip(scenario.aircraft[poses], errors, strict=False)
            ]
        )

    indices = sobol_indices(
        p_d,
        list(groups.values()),
        outputs=len(scenario.aircraft),
        samples=scenario.runs,
        seed=scenario.seed,
    )
    std = np.sqrt(indices.variance)
    first = dict(zip(groups, np.nan_to_num(indices.first), strict=True))
    error = dict(zip(groups, indices.first_error, strict=True))
    # an estimate of a share can come out below zero
    alone = {name: std * np.sqrt(np.maximum(share, 0.0)) for name, share in first.items()}
    return Budget(
        mean=indices.mean,
        std=std,
        alone={s: alone[s] for s in blocks_by_name},
        total_index={s: indices.total[i] for i, s in enumerate(blocks_by_name)},
        share_error={
            **{s: error[s] for s in blocks_by_name},
            "interaction": np.sqrt(np.sum(indices.first_error[: len(blocks_by_name)] ** 2, axis=0)),
            **{name: error[name] for name in parts},
        },
        parts={name: alone[name] for name in parts},
    )


def _errors(sqrt_cov: FloatArray, normals: FloatArray, poses: slice) -> Iterable[FloatArray]:
    """Errors (m, 6) of the aircraft at each pose: the same at all poses, or one for each."""
    mean = np.zeros(len(AIRCRAFT))
    if sqrt_cov.ndim == 2:
        return itertools.repeat(covariance.draws(mean, sqrt_cov, normals))
    return (covariance.draws(mean, matrix, normals) for matrix in sqrt_cov[poses])
