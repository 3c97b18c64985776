"""Contributions of the sources to the uncertainty of P_D.

A source of the budget is a block of a state's covariance, see `source_names`. A radar constant with
tolerances has parts, one for each parameter with a tolerance.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radar_sense import covariance
from radar_sense.axis import reached
from radar_sense.cost import EVALUATIONS, foresee
from radar_sense.errors import InputError
from radar_sense.model.radar_constant import Tolerance
from radar_sense.montecarlo.sobol import sobol_indices
from radar_sense.progress import report
from radar_sense.propagation import (
    AUTOMATIC,
    MONTE_CARLO,
    STD_CHANGE,
    distribution,
    mean_and_std,
)
from radar_sense.propagation.automatic import ERRORS
from radar_sense.propagation.looks import FIRST
from radar_sense.scenario import Scenario
from radar_sense.source_names import (
    AIRCRAFT_RCS,
    Source,
    constant_names,
    finer_sources,
    sources,
    type_name,
)
from radar_sense.states import AIRCRAFT, ATTITUDE, CONSTANT, POSITION, FloatArray, component
from radar_sense.uncertain_states import UncertainStates

#: The gradient for a source counts as zero where the share of the source is below VANISHING times
#: its largest share.
VANISHING = 1e-3
#: Sources within this part of the largest are equal, as they are printed.
TIE = 1e-3
#: The least share that is shown, as 0.1 %.
SHOWN = 5e-4


@dataclass(frozen=True, eq=False)
class Budget:
    """The standard deviation of P_D and the contributions of the sources, at each of n poses.

    Attributes:
        mean: Mean of P_D (n,).
        std: Standard deviation of P_D from all sources together (n,).
        alone: Standard deviation from each source with the others certain (n,). Sobol' indices
            average over the other sources.
        finer: As `alone`, for the whole aircraft, and for position, constant and attenuation of
            each radar of a network (n,). Empty for a single radar, and for Sobol' indices.
        total_index: Total Sobol' index of each source (n,); None for other methods.
        share_error: Standard errors of the shares of sources, interaction and parts (n,), for
            Sobol' indices; None for other methods.
        parts: Standard deviation from each part of a radar constant alone (n,), by `parts_of`.
    """

    mean: FloatArray
    std: FloatArray
    alone: Mapping[str, FloatArray]
    finer: Mapping[str, FloatArray] = field(default_factory=dict)
    total_index: Mapping[str, FloatArray] | None = None
    share_error: Mapping[str, FloatArray] | None = None
    parts: Mapping[str, FloatArray] = field(default_factory=dict)

    def shares(self) -> dict[str, FloatArray]:
        """Return the share of the variance from each source, and `interaction` (n,).

        The interaction is 1 minus the other shares. Correlations and nonlinearity of P_D cause an
        interaction, which can be negative. All shares are NaN where nothing is uncertain.
        """
        variance = np.where(self.std > 0, self.std**2, np.nan)
        shares = {source: std**2 / variance for source, std in self.alone.items()}
        shares["interaction"] = 1.0 - np.sum(list(shares.values()), axis=0)
        return shares


def error_budget(scenario: Scenario, method: str = "linear") -> Budget:
    """Return the error budget of a scenario at its level.

    Args:
        scenario: The scenario, with runs and seed for Sobol' indices.
        method: A method of propagation, or "montecarlo" for Sobol' indices.

    Raises:
        InputError: If there is no such method, or sources are correlated, for Sobol' indices.
    """
    if method == MONTE_CARLO:
        return _by_sobol_indices(scenario)
    names = scenario.model.names
    finer_names = finer_sources(names, scenario.uncertain_parameters)
    groups = (sources_of(scenario), finer_names, parts_of(scenario))
    count = sum(len(group) for group in groups)
    at_pose = EVALUATIONS.get(method, EVALUATIONS["form"] + FIRST)  # FORM, and draws that judge it
    evaluations = len(scenario.aircraft) * len(scenario.radars) * at_pose
    what = f"{count:,} sources at {len(scenario.aircraft):,} poses"
    foresee(what, count * evaluations, less="fewer poses")
    whole = distribution(scenario, method)
    mean, std = mean_and_std(whole)
    std_by_name: dict[str, FloatArray] = {}
    for name in itertools.chain(*groups):
        std_by_name[name] = whole.with_covariances(_alone(scenario, name)).std
        report("sources of the budget", len(std_by_name), count)
    alone, finer, parts = ({name: std_by_name[name] for name in group} for group in groups)
    return Budget(mean, std, alone, finer, parts=parts)


def sources_of(scenario: Scenario) -> dict[str, Source]:
    """Return the sources of the error budget of a scenario by name."""
    found = sources(
        scenario.model.names,
        scenario.bands,
        scenario.types,
        scenario.uncertain_parameters,
    )
    std = np.diagonal(scenario.states().cov_radar[0])
    return {
        name: source
        for name, source in found.items()
        if not name.startswith(AIRCRAFT_RCS) or std[list(source.components)].any()
    }


@dataclass(frozen=True)
class ConstantPart:
    """A part of a radar constant, and its place in a budget.

    Attributes:
        tolerance: The tolerance of one parameter of the radar constant.
        radar: Number of the radar, from 0.
        source: Name of the source that has the part, from `sources_of`.
        constant: Name of the radar constant, of `finer_sources` in a network; the name of the
            source for a part that radars share.
    """

    tolerance: Tolerance
    radar: int
    source: str
    constant: str

    @property
    def name(self) -> str:
        """Name of the part in a budget; `name_problem` keeps the name unique."""
        return f"{self.constant}_{self.tolerance.name}"


def parts_of(scenario: Scenario) -> dict[str, ConstantPart]:
    """Return the parts of all radar constants at the scenario's level, by their names."""
    names, several = scenario.model.names, len(scenario.radars) > 1
    constants = constant_names(names)
    found: dict[str, ConstantPart] = {}
    for i, tolerances in enumerate(scenario.tolerances):
        for tolerance in tolerances:
            constant = constants[i]
            source = names[i] if several else constant
            if several and tolerance.shared:
                source = constant = type_name(tolerance.shared)
            part = ConstantPart(tolerance, i, source, constant)
            found.setdefault(part.name, part)
    return found


def value_function(
    scenario: Scenario, method: str, k: float | None = None
) -> Callable[[Collection[str], float], FloatArray]:
    """Return a function of names of sources and of a factor on the σ of these sources.

    The value (n,) of the function is the upper bound of P_D at Φ(k), or 3σ of P_D if k is None. The
    names are names of `states.sources` and of `parts_of`.
    """
    whole = distribution(scenario, method)

    def value(names: Collection[str], factor: float) -> FloatArray:
        changed = whole.with_covariances(scaled(scenario, names, factor))
        return 3.0 * changed.std if k is None else changed.quantile(k)

    return value


def _alone(scenario: Scenario, name: str) -> UncertainStates:
    """Return the states with one source or one part of a radar constant, the others certain."""
    states, parts = scenario.states(), parts_of(scenario)
    source = Source("radar", ()) if name in parts else _source(scenario, name)
    kept = {"aircraft": scenario.cov_aircraft, "radar": _without_tolerances(scenario)}
    for whose, matrix in kept.items():
        if whose != source.owner:  # one matrix of zeros for all poses
            kept[whose] = np.zeros(matrix.shape[-2:])
        else:
            kept[whose] = covariance.keep_components(matrix, source.components)
    tolerances = _chosen(scenario, lambda names: 1.0 if name in names else 0.0)
    return states.with_covariances(kept["aircraft"], kept["radar"], tolerances)


def scaled(scenario: Scenario, names: Collection[str], factor: float) -> UncertainStates:
    """Return the states with the standard deviations of some sources and parts multiplied."""
    covariances = {"aircraft": scenario.cov_aircraft, "radar": _without_tolerances(scenario)}
    parts = parts_of(scenario)
    for name in names:
        if name not in parts:
            source = _source(scenario, name)
            covariances[source.owner] = covariance.scale_std(
                covariances[source.owner], source.components, factor
            )
    tolerances = _chosen(scenario, lambda own: factor if {*own} & {*names} else 1.0)
    return scenario.states().with_covariances(
        covariances["aircraft"], covariances["radar"], tolerances
    )


def _source(scenario: Scenario, name: str) -> Source:
    finer = finer_sources(scenario.model.names, scenario.uncertain_parameters)
    return {**sources_of(scenario), **finer}[name]


def _without_tolerances(scenario: Scenario) -> FloatArray:
    """Return C_rr (7m, 7m) without the variance of c_r that is of tolerances."""
    matrix = scenario.states().cov_radar[0]
    constants = np.arange(len(matrix))[component(CONSTANT, len(scenario.radars))]
    others = np.setdiff1d(np.arange(len(matrix)), constants[scenario.states().log_constant])
    return covariance.keep_components(matrix, others.tolist())


def _chosen(
    scenario: Scenario, factor: Callable[[tuple[str, ...]], float]
) -> list[list[Tolerance]]:
    """Return the tolerances of each radar (m,) with σ multiplied by a factor, without those of 0.

    Args:
        scenario: The scenario.
        factor: Returns the factor of a tolerance by the names of its part, source and constant.
    """
    parts, chosen = parts_of(scenario), []
    by_error = {(p.tolerance.shared or p.radar, p.tolerance.key): p for p in parts.values()}
    for i, tolerances in enumerate(scenario.tolerances):
        scaled = []
        for tolerance in tolerances:
            part = by_error[tolerance.shared or i, tolerance.key]
            by = factor((part.name, part.source, part.constant))
            if by:
                scaled.append(dataclasses.replace(tolerance, std=by * tolerance.std))
        chosen.append(scaled)
    return chosen


def _by_sobol_indices(scenario: Scenario) -> Budget:
    states, shown, parts = scenario.states(), sources_of(scenario), parts_of(scenario)
    matrices = {"aircraft": scenario.cov_aircraft, "radar": _without_tolerances(scenario)}
    # with an attenuation in a network ε is an input too, even if the RCS is certain
    for whose, matrix in matrices.items():
        blocks = [s.components for s in shown.values() if s.owner == whose]
        apart = sum(covariance.keep_components(matrix, block) for block in blocks)
        if not np.array_equal(matrix, apart):
            raise InputError(
                f"level {scenario.level}: {whose} position and the rest of its state are "
                "correlated; Sobol' indices need independent sources, use another method"
            )
    # One square root for each source, because Sobol' indices need separate inputs.
    sqrt_cov = np.zeros_like(scenario.cov_aircraft)
    for block in (POSITION, ATTITUDE):
        sqrt_cov[..., block, block] = covariance.square_root(
            scenario.cov_aircraft[..., block, block]
        )
    first, tolerances = len(AIRCRAFT), len(AIRCRAFT) + len(states.columns)
    groups = {
        name: list(s.components)
        if s.owner == "aircraft"
        else (first + np.flatnonzero(np.isin(states.columns, s.components))).tolist()
        for name, s in shown.items()
    }
    for part in parts.values():
        keys = [t.key for t in scenario.tolerances[part.radar]]
        number = states.tolerance_normals[part.radar][keys.index(part.tolerance.key)]
        # The group of a source has the inputs of all its parts.
        groups[part.name] = [tolerances + number]
        groups[part.source] = groups[part.source] + groups[part.name]

    def p_d(normals: FloatArray, poses: slice) -> FloatArray:
        errors = _errors(sqrt_cov, normals[:, :first], poses)
        radar = states.radars_at(normals[:, first:])
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
    first_order = dict(zip(groups, np.nan_to_num(indices.first), strict=True))
    error = dict(zip(groups, indices.first_error, strict=True))
    # The estimate of a small share can be negative.
    alone = {name: std * np.sqrt(np.maximum(share, 0.0)) for name, share in first_order.items()}
    return Budget(
        mean=indices.mean,
        std=std,
        alone={s: alone[s] for s in shown},
        total_index={s: indices.total[i] for i, s in enumerate(groups) if s in shown},
        share_error={
            **{s: error[s] for s in shown},
            "interaction": np.sqrt(np.sum(indices.first_error[: len(shown)] ** 2, axis=0)),
            **{name: error[name] for name in parts},
        },
        parts={name: alone[name] for name in parts},
    )


def _errors(sqrt_cov: FloatArray, normals: FloatArray, poses: slice) -> Iterable[FloatArray]:
    """Yield the errors (m, 6) of the aircraft at each pose."""
    mean = np.zeros(len(AIRCRAFT))
    if sqrt_cov.ndim == 2:
        return itertools.repeat(covariance.draws(mean, sqrt_cov, normals))
    return (covariance.draws(mean, matrix, normals) for matrix in sqrt_cov[poses])


@dataclass(frozen=True, eq=False)
class Contribution:
    """What a source adds to the uncertainty of P_D, at each of n poses.

    Attributes:
        name: Name in the columns.
        three_sigma: 3σ of P_D from the source alone (n,); NaN for the interaction.
        share: Share of the variance of P_D (n,).
        share_error: Standard error of the share (n,), by Sobol' indices.
        total_index: Total Sobol' index (n,) of a source, by Sobol' indices.
        part_of: Name of the source that it is a part of; "" for a source.
    """

    name: str
    three_sigma: FloatArray
    share: FloatArray
    share_error: FloatArray | None = None
    total_index: FloatArray | None = None
    part_of: str = ""

    @property
    def label(self) -> str:
        """The name, of a part without the name of its source."""
        return self.name.removeprefix(f"{self.part_of}_")

    @property
    def meaning(self) -> str:
        """The source in the meaning of a column."""
        named = {"total": "all sources together", "interaction": "interactions of sources"}
        return named.get(self.name, f"{self.name} alone")


@dataclass(frozen=True, eq=False)
class Contributions:
    """All that adds to the uncertainty of P_D at n poses, and what is the largest.

    Attributes:
        mean: Mean of P_D (n,).
        std: Standard deviation of P_D from all sources together (n,).
        sources: The sources.
        parts: Parts of radar constants.
        finer: Finer sources of a network.
        total: All sources together.
        interaction: What is left of the variance.
        pose: The first pose with the largest total, but for rounding.
        dominates: Where (n,) each source is the largest, and all have a value.
        dominant: The largest source at the pose; None if one without a value may be larger.
        first: Sources that are equally the largest there. Parts stand for their source.
        interaction_is_noise: Whether the interaction at the pose may be one of draws or rounding.
        vanishes: Where (n,) the gradient for each source vanishes, by `linear`.
    """

    mean: FloatArray
    std: FloatArray
    sources: Sequence[Contribution]
    parts: Sequence[Contribution]
    finer: Sequence[Contribution]
    total: Contribution
    interaction: Contribution
    pose: int
    dominates: Mapping[str, NDArray[np.bool_]]
    dominant: Contribution | None
    first: Sequence[Contribution]
    interaction_is_noise: bool
    vanishes: Mapping[str, NDArray[np.bool_]]


def contributions(scenario: Scenario, method: str) -> Contributions:
    """Return the error budget of a scenario by a method, source by source."""
    found = error_budget(scenario, method)
    by_name = _by_name(scenario, found)
    sources, parts, finer = (
        [by_name[name] for name in group] for group in (found.alone, found.parts, found.finer)
    )
    total, interaction = by_name["total"], by_name["interaction"]
    pose = int(np.argmax(reached(total.three_sigma)))
    three_sigma = np.array([c.three_sigma for c in sources])
    known = np.isfinite(three_sigma).all(axis=0) & (total.three_sigma > 0)
    largest = np.argmax(three_sigma, axis=0)

    squares, of_total = np.square(three_sigma[:, pose]), total.three_sigma[pose] ** 2
    has_value = np.isfinite(squares)
    top = int(np.argmax(np.where(has_value, squares, -1.0)))
    is_largest = has_value.all() or squares[top] > of_total - squares[has_value].sum()
    whole = {part.part_of for part in parts}
    each = [c for c in (*sources, *parts) if c.name not in whole]
    most = max((c.three_sigma[pose] for c in each if np.isfinite(c.three_sigma[pose])), default=0.0)
    error = None if interaction.share_error is None else interaction.share_error[pose]
    # σ by draws may have a standard error of STD_CHANGE / ERRORS, its variance twice as much
    noise = error or (2.0 * STD_CHANGE / ERRORS if method == AUTOMATIC else SHOWN)
    return Contributions(
        found.mean,
        found.std,
        sources,
        parts,
        finer,
        total,
        interaction,
        pose,
        dominates={c.name: (largest == i) & known for i, c in enumerate(sources)},
        dominant=sources[top] if is_largest else None,
        first=[c for c in each if is_largest and c.three_sigma[pose] >= (1.0 - TIE) * most],
        interaction_is_noise=not abs(interaction.share[pose]) >= noise,
        vanishes=_vanishing(scenario, sources, total) if method == "linear" else {},
    )


def _by_name(scenario: Scenario, found: Budget) -> dict[str, Contribution]:
    """Return the sources of an error budget, their parts, finer sources, total and interaction."""
    part_of = {name: part.source for name, part in parts_of(scenario).items()}
    part_of |= {
        name: name.removesuffix(f"_{parameter}")
        for parameter in scenario.uncertain_parameters
        for name in found.finer
        if name.endswith(f"_{parameter}")
    }
    errors, indices = found.share_error or {}, found.total_index or {}
    stds = {**found.alone, **found.parts, **found.finer, "total": found.std}
    stds["interaction"] = np.full_like(found.std, np.nan)
    variance = np.where(found.std > 0, found.std**2, np.nan)
    shares = {name: std**2 / variance for name, std in stds.items()} | found.shares()
    return {
        name: Contribution(
            name, 3 * std, shares[name], errors.get(name), indices.get(name), part_of.get(name, "")
        )
        for name, std in stds.items()
    }


def _vanishing(
    scenario: Scenario, sources: Sequence[Contribution], total: Contribution
) -> dict[str, NDArray[np.bool_]]:
    """Return where (n,) the gradient for each source vanishes."""
    # A radar that does not see the aircraft has no effect of second order either.
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    visible_by = dict(zip(scenario.model.names, np.moveaxis(visible, -1, 0), strict=False))
    masks, whole = {}, total.three_sigma
    for c in sources:
        share = np.divide(c.three_sigma, whole, out=np.zeros_like(whole), where=whole > 0)
        vanishes = (share < VANISHING * share.max()) & (whole > 0)
        masks[c.name] = vanishes & visible_by.get(c.name, True)
    return masks
