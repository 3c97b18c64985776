"""What the study asks of `radar_sense`: the one place that changes with the package."""

from dataclasses import dataclass

import radar_sense as rs
from radar_sense import axis
from radar_sense.flight import Path, States
from radar_sense.model.detectors import Marcum, North, Swerling1, Swerling3
from radar_sense.model.horizon import Horizon
from radar_sense.model.radar import Level, Radar
from radar_sense.model.radar_constant import Tolerance
from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS, ExactEllipsoidRCS, SpikeballRCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.propagation import METHODS, propagate_scenario, unreliable_in_scenario

DETECTORS = {
    "north": North(), "swerling1": Swerling1(), "swerling3": Swerling3(), "marcum": Marcum()
}  # fmt: skip
LEVEL = "a"


@dataclass(frozen=True)
class Band:
    """The bounds of one pose, their standard errors, and whether the package warns."""

    lower: float
    upper: float
    lower_se: float
    upper_se: float
    warned: bool


def methods():
    """Return the names of the methods to judge."""
    return tuple(METHODS)


def band(scenario, method, k):
    """Return the band of the first pose by a method."""
    moments = propagate_scenario(scenario, method=method, beta=k)
    warned = unreliable_in_scenario(scenario.with_analysis(method=method), moments, beta=k)
    error = float(moments.error[0])
    return Band(float(moments.lower[0]), float(moments.upper[0]), error, error, bool(warned[0]))


def verdict(scenario, threshold, k, **options):
    """Return "holds", "violated" or "not known" of the threshold test."""
    result = rs.analyses.variance(scenario, threshold=threshold, k=k, **options)
    return result.summary["threshold"]["verdict"]


def scenario(problem, aircraft=None, time_s=None):
    """Return the scenario of a problem, at its poses or along a path.

    A detector may be one of the package, which the independent model does not know.
    """
    rcs = model_of(problem.rcs)
    radars = tuple(
        Radar(
            model=rs.DetectionModel(
                rcs=rcs,
                p_fa=r.p_fa,
                detector=DETECTORS.get(r.detector, r.detector),
                factors=(rs.Attenuation(r.attenuation),) if r.attenuation else (),
            ),
            name=f"r{i}",
            state=r.state,
            levels={
                LEVEL: Level(
                    problem.cov_radar[4 * i : 4 * i + 4, 4 * i : 4 * i + 4],
                    tuple(Tolerance(*t) for t in r.tolerances),
                    {"attenuation": r.attenuation_std / r.attenuation} if r.attenuation else {},
                )
            },
            max_range=r.max_range,
            min_range=r.min_range,
            horizon=Horizon() if r.horizon else None,
        )
        for i, r in enumerate(problem.radars)
    )
    geometry = States.of(problem.aircraft if aircraft is None else aircraft, problem.cov_aircraft)
    if time_s is not None:
        arrays = geometry.aircraft, geometry.covariance
        geometry = Path(axis.time(time_s), *arrays, time_s=time_s)
    name = f"{problem.population.replace(' ', '_')}_{problem.number}"
    return rs.Scenario(radars=radars, geometry=geometry, name=name, rcs_db=problem.rcs_db)


def model_of(rcs):
    """Return the RCS model of the package for an RCS of `bands.model`."""
    kind, *p = rcs
    if kind == "table":
        azimuth, values, elevation, std_db = p
        return TableRCS(azimuth, values, elevation, std_db=std_db)
    models = {
        "constant": ConstantRCS, "ellipsoid": EllipsoidRCS, "ellipsoid_exact": ExactEllipsoidRCS,
        "spikeball": SpikeballRCS,
    }  # fmt: skip
    return models[kind](*p)
