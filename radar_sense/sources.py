"""Contributions of the sources to the uncertainty of P_D.

A source of the budget is a block of a state's covariance. A radar constant with tolerances has
parts, one for each parameter with a tolerance.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from radar_sense import covariance
from radar_sense.axis import reached
from radar_sense.cost import EMPHASIS, FIRST_ORDER, OTHER, foresee
from radar_sense.errors import InputError
from radar_sense.model.radar import NEVER
from radar_sense.model.radar_constant import ErrorKey
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sobol import jackknife_error, sobol_indices
from radar_sense.progress import report
from radar_sense.propagation import AUTOMATIC, MONTE_CARLO, STD_CHANGE, distribution
from radar_sense.propagation.automatic import ERRORS
from radar_sense.propagation.staged import draws_at_first
from radar_sense.scenario import Scenario
from radar_sense.source_names import AIRCRAFT_RCS, type_name
from radar_sense.states import (
    AIRCRAFT,
    ATTITUDE,
    CONSTANT,
    FACTOR_ERRORS,
    POSITION,
    RCS_ERROR,
    FloatArray,
    of_radar,
)
from radar_sense.uncertain_states import UncertainStates

#: Kinds of sources: those that together have all errors; in a network the whole aircraft, and
#: position, constant and further parameters of each radar; and parts of c_r, one a tolerance.
SOURCE, FINER, PART = "source", "finer", "part"
#: The gradient for a source counts as zero where the share of the source is below VANISHING times
#: its largest share.
VANISHING = 1e-3
#: What differs by less than this part of the total is equal, as it is printed. A share is printed
#: to this part, too, and the least that shows is half of it.
TIE = 1e-3


@dataclass(frozen=True)
class Source:
    """A source of uncertainty: components of a state, and errors of tolerances of c_r.

    Attributes:
        kind: `SOURCE`, `FINER` or `PART`.
        owner: Whose state has the components, "aircraft" or "radar".
        components: Their places in the state of the aircraft (6,) or of all radars (7m,).
        errors: The errors of tolerances, see `Tolerance.error_key`.
        part_of: Name of the source below which a budget has a finer one or a part.
    """

    kind: str
    owner: str
    components: tuple[int, ...] = ()
    errors: frozenset[ErrorKey] = frozenset()
    part_of: str = ""

    def overlaps(self, other: Source) -> bool:
        """Return whether both have a component or an error."""
        same = self.owner == other.owner and not {*self.components}.isdisjoint(other.components)
        return same or not self.errors.isdisjoint(other.errors)


@dataclass(frozen=True, eq=False)
class Contribution:
    """What a source adds to the uncertainty of P_D, at each of n poses.

    Attributes:
        name: Name in the columns.
        std: Standard deviation of P_D from the source with the others certain (n,), NaN for the
            interaction. Sobol' indices average over the other sources.
        share: Share of the variance of P_D (n,), NaN where nothing is uncertain.
        share_error: Standard error of the share (n,), by Sobol' indices.
        total_index: Total Sobol' index (n,) of a source, by Sobol' indices.
        total_index_error: Standard error of the total index (n,).
        three_sigma_error: Standard error of 3σ (n,) of all sources together, by Sobol' indices.
        part_of: Name of the source that it is a part of; "" for a source.
    """

    name: str
    std: FloatArray
    share: FloatArray
    share_error: FloatArray | None = None
    total_index: FloatArray | None = None
    total_index_error: FloatArray | None = None
    three_sigma_error: FloatArray | None = None
    part_of: str = ""

    @property
    def three_sigma(self) -> FloatArray:
        """3σ of P_D (n,)."""
        return 3.0 * self.std

    @property
    def label(self) -> str:
        """The name, of a part without the name of its source."""
        return self.name.removeprefix(f"{self.part_of}_")

    @property
    def meaning(self) -> str:
        """The source in the meaning of a column."""
        named = {
            "total": "all sources together",
            "interaction": "interactions of sources",
            "aircraft": "position and orientation of the aircraft alone",
        }
        return named.get(self.name, f"{self.name} alone")


@dataclass(frozen=True, eq=False)
class Budget:
    """All that adds to the uncertainty of P_D at n poses, and what is the largest.

    Attributes:
        mean: Mean of P_D (n,).
        sources: The sources by name.
        parts: Parts of radar constants by name.
        finer: Those of `FINER` by name. Empty for a single radar, and for Sobol' indices.
        total: All sources together.
        interaction: What is left of the variance, by correlations and nonlinearity of P_D. Its
            share is 1 minus the shares of the sources. The share can be negative.
        chosen: The pose looked at; None for that with the largest total.
    """

    mean: FloatArray
    sources: Mapping[str, Contribution]
    parts: Mapping[str, Contribution]
    finer: Mapping[str, Contribution]
    total: Contribution
    interaction: Contribution
    chosen: int | None = None

    @cached_property
    def pose(self) -> int:
        """The pose looked at: the first with the largest total, but for rounding, or the chosen."""
        if self.chosen is not None:
            return self.chosen
        return int(np.argmax(reached(self.total.three_sigma)))

    @property
    def dominates(self) -> dict[str, NDArray[np.bool_]]:
        """Where (n,) each source alone is the largest, and all have a value."""
        std = np.array([c.std for c in self.sources.values()])
        largest = std >= (1.0 - TIE) * std.max(axis=0)
        alone = (largest.sum(axis=0) == 1) & (self.total.std > 0)  # NaN is not the largest
        return {name: mask & alone for name, mask in zip(self.sources, largest, strict=True)}

    @cached_property
    def dominant(self) -> Contribution | None:
        """The largest source at the pose; None of equals, or if any has no value."""
        alone = (self.sources[n] for n, mask in self.dominates.items() if mask[self.pose])
        return next(alone, None)

    def interaction_is_noise(self, method: str) -> bool:
        """Return whether the interaction at the pose is within two standard errors, or rounding."""
        noise = 0.5 * TIE
        if method == AUTOMATIC:
            # σ by draws may have a standard error of STD_CHANGE / ERRORS, its variance twice as
            # much, and the total and each source have errors of their own
            shares = [c.share[self.pose] for c in (self.total, *self.sources.values())]
            noise = 2.0 * (2.0 * STD_CHANGE / ERRORS) * float(np.linalg.norm(shares))
        elif self.interaction.share_error is not None:
            noise = 2.0 * self.interaction.share_error[self.pose] or noise
        return not abs(self.interaction.share[self.pose]) >= noise

    def vanishes(self, scenario: Scenario) -> dict[str, NDArray[np.bool_]]:
        """Return where (n,) the gradient for each source vanishes, of a budget by `linear`."""
        # A radar that does not see the aircraft has no effect of second order either.
        visible = scenario.model.visible(scenario.aircraft, scenario.radar)
        visible_by = dict(zip(scenario.model.names, np.moveaxis(visible, -1, 0), strict=False))
        masks, whole = {}, self.total.std
        for name, source in self.sources.items():
            share = np.divide(source.std, whole, out=np.zeros_like(whole), where=whole > 0)
            vanishes = (share < VANISHING * share.max()) & (whole > 0)
            masks[name] = vanishes & visible_by.get(name, True)
        return masks


def error_budget(scenario: Scenario, method: str = "linear") -> Budget:
    """Return the error budget of a scenario at its level, by a method of propagation.

    By "montecarlo" it is by Sobol' indices, with runs and seed of the scenario.
    """
    if method == MONTE_CARLO:
        return _by_sobol_indices(scenario)
    names = sources_of(scenario)
    count = len(names)
    at_pose, states = FIRST_ORDER.get(method, OTHER), scenario.states()
    if method == AUTOMATIC:  # FORM, and draws that judge it
        at_pose += EMPHASIS * float(draws_at_first(states).mean())
    evaluations = count * at_pose * np.count_nonzero(states.sight() != NEVER)
    what = f"{count:,} sources at {len(states):,} poses"
    foresee(what, evaluations, less="fewer poses")
    whole = distribution(scenario, method)
    std_by_name: dict[str, FloatArray] = {}
    for name in names:
        std_by_name[name] = whole.with_covariances(scaled(scenario, [name], 1.0, 0.0)).std
        report("sources of the budget", len(std_by_name), count)
    return _budget(scenario, whole.mean, whole.std, std_by_name, {})


def _budget(
    scenario: Scenario,
    mean: FloatArray,
    std: FloatArray,
    std_by_name: Mapping[str, FloatArray],
    by_indices: Mapping[str, Mapping[str, FloatArray]],
) -> Budget:
    """Return the budget with shares, from the standard deviations of sources, parts and finer.

    Fields that only Sobol' indices have are by name of the contribution.
    """
    every = sources_of(scenario)
    variance = np.where(std > 0, std**2, np.nan)
    shares = {name: values**2 / variance for name, values in std_by_name.items()}
    left = 1.0 - np.sum([s for name, s in shares.items() if every[name].kind == SOURCE], axis=0)

    def contribution(name: str, std: FloatArray, share: FloatArray) -> Contribution:
        part_of = every[name].part_of if name in every else ""
        return Contribution(name, std, share, part_of=part_of, **by_indices.get(name, {}))

    each = {name: contribution(name, std_by_name[name], share) for name, share in shares.items()}
    by_kind = {
        kind: {name: c for name, c in each.items() if every[name].kind == kind}
        for kind in (SOURCE, FINER, PART)
    }
    return Budget(
        mean,
        sources=by_kind[SOURCE],
        parts=by_kind[PART],
        finer=by_kind[FINER],
        total=contribution("total", std, std**2 / variance),
        interaction=contribution("interaction", np.full_like(std, np.nan), left),
    )


def sources_of(scenario: Scenario, *kinds: str) -> dict[str, Source]:
    """Return the sources of a scenario by name, of all kinds or of some, in the order of the kinds.

    Each radar of a network is one source, and so are the errors that radars of a type share. The
    sources of a single radar are the paper's. A certain RCS is no source.
    """
    names, bands = scenario.model.names, scenario.bands
    several = len(bands) > 1
    constants = [f"{name}_constant" for name in names] if several else ["radar_constant"]
    parts: dict[str, Source] = {}
    errors: defaultdict[str, frozenset[ErrorKey]] = defaultdict(frozenset)
    for i, of_constant in enumerate(scenario.tolerances):
        for t in of_constant:
            constant = type_name(t.shared) if several and t.shared else constants[i]
            source = names[i] if several and not t.shared else constant
            error = frozenset({t.error_key(i)})
            parts[f"{constant}_{t.name}"] = Source(PART, "radar", errors=error, part_of=source)
            errors[source] |= error

    of_aircraft = tuple(range(len(AIRCRAFT)))
    of_radars = [tuple(range(r.start, r.stop)) for r in map(of_radar, range(len(bands)))]
    found = {
        "aircraft_position": Source(SOURCE, "aircraft", of_aircraft[POSITION]),
        "aircraft_orientation": Source(SOURCE, "aircraft", of_aircraft[ATTITUDE]),
    }
    if several:
        for name, own in zip(names, of_radars, strict=True):
            without_rcs = (*own[:RCS_ERROR], *own[RCS_ERROR + 1 :])
            found[name] = Source(SOURCE, "radar", without_rcs, errors[name])
        for name in map(type_name, scenario.types):
            found[name] = Source(SOURCE, "radar", errors=errors[name])
    else:
        found["radar_position"] = Source(SOURCE, "radar", of_radars[0][POSITION])
        for name in constants:
            found[name] = Source(SOURCE, "radar", (CONSTANT,), errors[name])
    std_of_band = dict(zip(bands, scenario.rcs_std, strict=True))
    for band in (band for band, std in std_of_band.items() if std > 0):
        name = AIRCRAFT_RCS if len(std_of_band) == 1 else f"{AIRCRAFT_RCS}_{band}"
        own = tuple(at[RCS_ERROR] for at, b in zip(of_radars, bands, strict=True) if b == band)
        found[name] = Source(SOURCE, "radar", own)
    if several:
        found["aircraft"] = Source(FINER, "aircraft", of_aircraft)
        for name, constant, own in zip(names, constants, of_radars, strict=True):
            found[f"{name}_position"] = Source(FINER, "radar", own[POSITION], part_of=name)
            found[constant] = Source(FINER, "radar", (own[CONSTANT],), errors[name], name)
        for parameter in scenario.uncertain_parameters:
            for name, own in zip(names, of_radars, strict=True):
                at = own[FACTOR_ERRORS[parameter]]
                found[f"{name}_{parameter}"] = Source(FINER, "radar", (at,), part_of=name)
    else:
        for parameter in scenario.uncertain_parameters:
            found[f"radar_{parameter}"] = Source(SOURCE, "radar", (FACTOR_ERRORS[parameter],))
    return {n: s for n, s in (found | parts).items() if s.kind in kinds or not kinds}


def value_function(
    scenario: Scenario, method: str, k: float | None = None, *, of_miss: bool = False
) -> Callable[[Collection[str], float], FloatArray]:
    """Return a function of names of sources and of a factor on the σ of these sources.

    The value (n,) of the function is the upper bound of P_D at Φ(k), or of a miss, 1 − P_D; or 3σ
    of P_D if k is None. The names are names of `sources_of`.
    """
    whole = distribution(scenario, method)

    def value(names: Collection[str], factor: float) -> FloatArray:
        changed = whole.with_covariances(scaled(scenario, names, factor))
        if k is None:
            return 3.0 * changed.std
        return 1.0 - changed.quantile(-k) if of_miss else changed.quantile(k)

    return value


def worth_most(scenario: Scenario, budget: Budget) -> tuple[list[Contribution], float]:
    """Return what leaves the least 3σ at the pose if its deviation is halved, and what it leaves.

    It is several contributions if what they leave is the same in print, or to the draws of
    `automatic`, and none if the method does not know what one leaves. Sobol' indices do not know
    what a halved deviation leaves: the sources with the largest share are returned, and NaN.
    """
    pose, total = budget.pose, float(budget.total.three_sigma[budget.pose])
    if scenario.method == MONTE_CARLO:
        candidates = budget.sources
        left = {name: -float(c.std[pose]) for name, c in candidates.items()}
    else:
        candidates = _measurable(scenario, budget)
        largest = np.fmax.reduce([c.three_sigma[pose] for c in candidates.values()])
        # what shows nothing beside the largest shows nothing if it is halved
        candidates = {
            name: c for name, c in candidates.items() if not c.three_sigma[pose] < TIE * largest
        }
        value = value_function(scenario.at_poses(np.array([pose])), scenario.method)
        left = {name: float(value([name], 0.5)[0]) for name in candidates}
    least = float(np.min([*left.values()]))  # NaN if any is
    # σ by draws may have this standard error
    alike = STD_CHANGE / ERRORS if scenario.method == AUTOMATIC else TIE
    first = [candidates[name] for name, value in left.items() if value <= least + alike * total]
    return first, np.nan if scenario.method == MONTE_CARLO else least


def _measurable(scenario: Scenario, budget: Budget) -> dict[str, Contribution]:
    """Return the sources by name, or their pieces if any source has parts.

    A whole radar halved would win against the single parts of another one.
    """
    if not budget.parts:
        return {**budget.sources}
    every = sources_of(scenario)
    finer = {
        name: c
        for name, c in budget.finer.items()
        if c.part_of and not any(every[name].overlaps(every[part]) for part in budget.parts)
    }
    pieces = {**finer, **budget.parts}
    whole = {c.part_of for c in pieces.values()}
    return {n: c for n, c in budget.sources.items() if n not in whole} | pieces


def scaled(
    scenario: Scenario, names: Collection[str], factor: float, others: float = 1.0
) -> UncertainStates:
    """Return the states with σ of some of `sources_of` times a factor, and σ of the others too.

    A factor of 0 makes a source certain.
    """
    every = sources_of(scenario)
    chosen = [every[name] for name in names]
    covariances = _covariances(scenario)
    for owner, matrix in covariances.items():
        scale = np.full(matrix.shape[-1], others)
        for source in chosen:
            if source.owner == owner:
                scale[list(source.components)] = factor
        certain = np.zeros(matrix.shape[-2:])  # one matrix for all poses
        covariances[owner] = matrix * np.outer(scale, scale) if scale.any() else certain
    errors = frozenset().union(*(source.errors for source in chosen))
    tolerances = []
    for i, own in enumerate(scenario.tolerances):
        each = ((t, factor if t.error_key(i) in errors else others) for t in own)
        tolerances.append([dataclasses.replace(t, std=by * t.std) for t, by in each if by])
    return scenario.states().with_covariances(
        covariances["aircraft"], covariances["radar"], tolerances
    )


def _covariances(scenario: Scenario) -> dict[str, FloatArray]:
    """Return C_aa, and C_rr (7m, 7m) without variances of tolerances of c_r, by owner."""
    states = scenario.states()
    of_radars = covariance.without_components(states.cov_radar[0], states.log_constants)
    return {"aircraft": scenario.cov_aircraft, "radar": of_radars}


def _by_sobol_indices(scenario: Scenario) -> Budget:
    states, every = scenario.states(), sources_of(scenario, SOURCE, PART)
    shown = sources_of(scenario, SOURCE)
    # with an attenuation in a network ε is an input too, even if the RCS is certain
    for whose, matrix in _covariances(scenario).items():
        between = matrix.copy()
        for source in shown.values():
            if source.owner == whose:
                rows, columns = np.ix_(source.components, source.components)
                between[..., rows, columns] = 0.0
        if between.any():
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
    roots = np.broadcast_to(sqrt_cov, (len(states), *sqrt_cov.shape[-2:]))
    first, tolerances = len(AIRCRAFT), len(AIRCRAFT) + len(states.columns)
    numbers = {
        t.error_key(i): tolerances + number
        for i, own in enumerate(scenario.tolerances)
        for t, number in zip(own, states.tolerance_normals[i], strict=True)
    }
    groups = {}
    for name, source in every.items():
        inputs = list(source.components)
        if source.owner == "radar":
            inputs = (first + np.flatnonzero(np.isin(states.columns, inputs))).tolist()
        groups[name] = inputs + sorted(numbers[error] for error in source.errors)

    @cache  # which radars are in sight is found once for each block of poses
    def sampler(start: int, stop: int) -> Sampler:
        return Sampler(states.at(slice(start, stop)), roots[start:stop])

    def p_d(normals: FloatArray, poses: slice) -> FloatArray:
        shape = len(normals), poses.stop - poses.start, first
        of_aircraft = np.broadcast_to(normals[:, np.newaxis, :first], shape)
        radar = states.radars_at(normals[:, first:])
        drawn = sampler(poses.start, poses.stop).draw_p_d(of_aircraft, radar)
        return np.ascontiguousarray(drawn.T)  # pairwise sums, without rounding of equal values

    evaluations = 2.0 * (len(groups) + 1) * scenario.runs * len(states) * len(scenario.radars)
    what = f"Sobol' indices of {scenario.runs:,} runs at {len(states):,} poses"
    foresee(what, evaluations, less="fewer --runs")
    indices = sobol_indices(
        p_d,
        list(groups.values()),
        outputs=len(scenario.aircraft),
        samples=scenario.runs,
        seed=scenario.seed,
    )
    std = np.sqrt(indices.variance)
    # The estimate of a small share can be negative.
    shares = np.maximum(np.nan_to_num(indices.first), 0.0)
    alone = dict(zip(groups, std * np.sqrt(shares), strict=True))
    fields = {name: {"share_error": indices.first_error[i]} for i, name in enumerate(groups)}
    for i, name in enumerate(shown):
        fields[name] |= {
            "total_index": indices.total[i],
            "total_index_error": indices.total_error[i],
        }
    of_sources = np.sum(indices.first_without_one[:, : len(shown)], axis=1)
    fields["interaction"] = {"share_error": jackknife_error(of_sources)}
    # dσ = dσ²/(2σ)
    of_variance = indices.variance_error
    error = np.divide(of_variance, 2.0 * std, out=np.zeros_like(std), where=std > 0)
    fields["total"] = {"three_sigma_error": 3.0 * error}
    return _budget(scenario, indices.mean, std, alone, fields)
