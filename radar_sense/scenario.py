"""The scenario: who flies where, which radar looks, and how uncertain each of them is.

A scenario file has degrees, kilometres and decibels in it. They become radians, metres and ratios
here and nowhere else.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.axis import Axis
from radar_sense.errors import ScenarioError, did_you_mean
from radar_sense.limits import MAX_NAME, RUNS, SEED
from radar_sense.model.detection_model import Model
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar_constant import Part
from radar_sense.states import RADAR, FloatArray


@dataclass(frozen=True, eq=False)
class Scenario:
    """A scenario, checked, in SI units and radians.

    Attributes:
        name: Stem of the names of the files written.
        model: RCS, P_fa and detector; a `NetworkModel` if the file has `radars`.
        axis: What the poses are laid out along: azimuth, time or distance (n,).
        aircraft: Nominal aircraft states (n, 6).
        radar: Nominal radar state (4,), or (4m,) of a network of m.
        cov_aircraft: C_aa (6, 6), or one for each pose (n, 6, 6).
        cov_radar: C_rr (4, 4), or (4m, 4m), for each level of radar uncertainty, in the file's
            order.
        level: The level that an analysis of a single one uses.
        runs: Monte Carlo runs.
        seed: Seed of the Monte Carlo draws.
        document: The file's content, checked and with defaults filled in, in the file's units.
        constant_parts: What makes the c_r of each radar (m,) uncertain, for the levels that say so;
            C_rr has it to first order.
        time_s: Time of each pose (n,) [s] of a path; None on an orbit, which has no times.
        scan_period_s: Time from look to look of the radar [s]; None if the file does not say.
        correlation_s: Correlation time [s] of the errors of the pose, a first-order Gauss–Markov
            process: 0 for independent errors at every pose, infinity for the same at all.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the frame's origin,
            of a route in latitude and longitude; else None.
    """

    name: str
    model: Model
    axis: Axis
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: Mapping[str, FloatArray]
    level: str
    runs: int
    seed: int
    document: Mapping[str, Any]
    constant_parts: Mapping[str, tuple[tuple[Part, ...], ...]] = field(default_factory=dict)
    time_s: FloatArray | None = None
    scan_period_s: float | None = None
    correlation_s: float = 0.0
    origin: tuple[float, float, float] | None = None

    @property
    def parts(self) -> tuple[tuple[Part, ...], ...]:
        """What makes the c_r of each radar (m,) uncertain at the level; nothing if one number."""
        return self.constant_parts.get(self.level, ((),) * (len(self.radar) // len(RADAR)))

    @property
    def log_constant(self) -> NDArray[np.bool_]:
        """Which radars (m,) have a c_r to take for log-normal, as parts in decibels make it."""
        return np.array([bool(parts) for parts in self.parts])

    @property
    def theta_r_deg(self) -> FloatArray:
        """The place of each pose on the axis (n,): on an orbit θ_r [deg]."""
        return self.axis.values

    def part(self, poses: slice | NDArray[np.intp]) -> Scenario:
        """Return the scenario with some of its poses."""
        return dataclasses.replace(
            self,
            axis=self.axis.part(poses),
            aircraft=self.aircraft[poses],
            cov_aircraft=self.cov_aircraft
            if self.cov_aircraft.ndim == 2
            else self.cov_aircraft[poses],
            time_s=None if self.time_s is None else self.time_s[poses],
        )

    def resolved(self) -> dict[str, Any]:
        """Return the scenario as a document that reads back as this scenario."""
        chosen = {"level": self.level, "runs": self.runs, "seed": self.seed}
        return {**self.document, "analysis": chosen}

    def with_analysis(
        self, *, level: str | None = None, runs: int | None = None, seed: int | None = None
    ) -> Scenario:
        """Return the scenario with other choices of analysis; None leaves one as it is.

        Raises:
            ScenarioError: If there is no such level, or runs or seed are out of range.
        """
        if level is not None and level not in self.cov_radar:
            raise ScenarioError(
                f"level must be one of {', '.join(self.cov_radar)}, got {level!r}"
                + did_you_mean(level, self.cov_radar)
            )
        for name, value, limit in (("runs", runs, RUNS), ("seed", seed, SEED)):
            if value is not None and not limit.allows(value):
                raise ScenarioError(f"{name} must be {limit}, got {value}")
        return dataclasses.replace(
            self,
            level=self.level if level is None else level,
            runs=self.runs if runs is None else int(runs),
            seed=self.seed if seed is None else int(seed),
        )


def alone(scenario: Scenario) -> dict[str, Scenario]:
    """Return the scenario of each radar of a network by itself, by name; none for a single radar.

    It has the limits, the state and the uncertainty of that radar. What correlates it with the
    others is of no meaning then.
    """
    model, size = scenario.model, len(RADAR)
    if not isinstance(model, NetworkModel) or len(model.stations) < 2:
        return {}
    parts = {s.name: slice(size * i, size * (i + 1)) for i, s in enumerate(model.stations)}
    return {
        station.name: dataclasses.replace(
            scenario,
            model=NetworkModel((station,)),
            radar=scenario.radar[..., parts[station.name]],
            cov_radar={
                level: covariance[..., parts[station.name], parts[station.name]]
                for level, covariance in scenario.cov_radar.items()
            },
            constant_parts={
                level: (of_radars[i],) for level, of_radars in scenario.constant_parts.items()
            },
            scan_period_s=station.scan_period,
        )
        for i, station in enumerate(model.stations)
    }


def only(scenario: Scenario, name: str) -> Scenario:
    """Return the scenario of one radar of a network by itself, under a name of its own.

    Raises:
        ScenarioError: If there is no such radar, or a single one that has no name.
    """
    entries = {entry["name"]: entry for entry in scenario.document.get("radars", ())}
    radars = alone(scenario) or dict.fromkeys(entries, scenario)
    if not radars:
        raise ScenarioError(
            f"radar {name!r} cannot be chosen: this scenario has a single radar, not a network"
        )
    if name not in radars:
        raise ScenarioError(
            f"radar must be one of {', '.join(radars)}, got {name!r}" + did_you_mean(name, radars)
        )
    own = f"{scenario.name}_{name}"
    if len(own) > MAX_NAME:
        raise ScenarioError(
            f"the name {own} has more than {MAX_NAME} letters; give the scenario a shorter one"
        )
    document = {**scenario.document, "name": own, "radars": [entries[name]]}
    return dataclasses.replace(radars[name], name=own, document=document)
