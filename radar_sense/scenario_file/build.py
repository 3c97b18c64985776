"""From a scenario file to a `Scenario`: SI, frames, levels, and the checks across sections."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from radar_sense import axis
from radar_sense.errors import InputError
from radar_sense.flight import CERTAIN, Geometry, Orbit, Path, Radial
from radar_sense.limits import DEG
from radar_sense.model.geometry import body_vector, elevation_of
from radar_sense.model.radar import Radar
from radar_sense.model.rcs import RCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.model.trajectory import MAX_ROWS, distance_flown, resample
from radar_sense.scenario import Scenario
from radar_sense.scenario_file import sections
from radar_sense.scenario_file.build_radar import radars_of, refuse_unused_types
from radar_sense.scenario_file.conversion import KM, covariance_of, on_earth, read_named
from radar_sense.scenario_file.declare import read_word
from radar_sense.scenario_file.place import Place
from radar_sense.scenario_file.rcs_file import read_rcs_table
from radar_sense.scenario_file.route_file import ROUTE_FILE, read_route
from radar_sense.states import FloatArray


def build(file: sections.File, again: Callable[[Mapping[str, Any]], Scenario]) -> Scenario:
    """Return the scenario of a file, which `again` reads with other values of some keys.

    Raises:
        InputError: If sections contradict each other, or a file that is named is not allowed.
    """
    stated = file.aircraft.rcs
    by_band = stated.bands if isinstance(stated, sections.Bands) else {"": stated}
    rcs = {band: _rcs(own) for band, own in by_band.items()}
    geometry = _geometry(file)
    radars = radars_of(file, rcs, geometry)
    refuse_unused_types(file)
    place, whole = file.geometry.place, geometry.whole
    for radar in radars:
        if text := whole.collision(radar, f"{whole.axis.name} "):
            raise place.error(text)
        _refuse_uncovered(place, whole, radar)
    geometry = _with_covariance(file.uncertainty, geometry)
    try:
        geometry.covariance_in_frame  # noqa: B018 - kept, or refused with its place in the file
    except InputError as error:
        raise place.error(f"{error}") from error
    scenario = Scenario(
        name=file.name,
        radars=radars,
        geometry=geometry,
        level=read_word(file.analysis.place["level"], radars[0].levels),
        runs=file.analysis.runs,
        seed=file.analysis.seed,
        method=file.analysis.method,
        rcs_db=_rcs_db(file.uncertainty.aircraft, rcs),
        correlation_s=float(file.uncertainty.aircraft_correlation_s),
    )
    return scenario.of_file(file, again)


# The aircraft and its flight.


def _rcs(stated: Any) -> RCS:
    if not isinstance(stated, sections.Table):
        return stated
    mirror, degrees = stated.mirror, stated.envelope_deg
    envelope = None if degrees is None else degrees * DEG
    return read_named(stated, "an RCS table", lambda file: read_rcs_table(file, mirror, envelope))


def _geometry(file: sections.File) -> Geometry:
    """Return the poses and the flight."""
    attitude = file.aircraft.attitude_deg
    if isinstance(file.geometry, sections.Path):
        if attitude is not None:
            raise file.aircraft.place["attitude_deg"].error(
                "must be left out with a path: attitude is from the route file or from its track"
            )
        return _path(file.geometry)
    if attitude is None:
        kind = "a radial" if isinstance(file.geometry, sections.Radial) else "an orbit"
        raise file.aircraft.place.error(f"missing key 'attitude_deg', required on {kind}")
    stated, level = file.geometry, np.array(attitude) * DEG
    of_both: dict[str, Any] = {"down": stated.down_km * KM, "azimuth_from": stated.azimuth_from}
    if isinstance(stated, sections.Radial):
        along = axis.ground_range(_steps(stated.range_km))
        return Radial.of(along, level, azimuth=float(stated.azimuth_deg), **of_both)
    around = axis.azimuth(_steps(stated.azimuth_deg))
    return Orbit.of(around, level, radius=stated.range_km * KM, **of_both)


def _steps(stated: sections.Sweep | sections.Ranges) -> FloatArray:
    """Return azimuths (n,) [deg] or ground ranges (n,) [km]."""
    try:
        return axis.steps(float(stated.start), float(stated.stop), float(stated.step), MAX_ROWS)
    except InputError as error:
        raise stated.place["step"].error(f"{error}") from error


def _path(stated: sections.Path) -> Path:
    origin = None if stated.origin is None else on_earth(stated.origin)
    flight = read_named(stated, ROUTE_FILE, lambda file: read_route(file, stated, origin))
    route, between = flight, stated.interpolate
    if between is not None:
        try:
            route = resample(flight, float(between.step_s), between.method)
        except InputError as error:
            raise between.place.error(f"{error}") from error
    method = between.method if between else "legs"
    along = axis.time(route.time_s)
    if stated.axis == "distance":
        along = axis.distance(distance_flown(flight, route.time_s, method))
    return Path(
        along,
        route.aircraft,
        CERTAIN if route.covariance is None else route.covariance,
        time_s=route.time_s,
        origin=route.origin,
        flight=flight if between else None,
        method=method,
        sea_level=stated.geoid_height_m or 0.0,
    )


def _with_covariance(stated: sections.Uncertainty, geometry: Geometry) -> Geometry:
    """Return the poses with C_aa (6, 6), or with C_aa of each pose (n, 6, 6)."""
    own = stated.aircraft
    if geometry.covariance.ndim == 3:
        if own is not None and {*own.place.items()} != {"rcs_db"}:
            raise own.place.error(
                "must be left out here, or the columns std_... and cov_... in the route file: "
                "both state the uncertainty of the aircraft"
            )
        return geometry
    if own is None:
        raise stated.place.error(
            "missing key 'aircraft', required unless the route file has std_..."
        )
    matrix = covariance_of(own, {"position_m": (3, 1.0), "attitude_deg": (3, DEG)})
    return dataclasses.replace(geometry, covariance=matrix)


def _rcs_db(stated: sections.PoseUncertainty | None, rcs: Mapping[str, RCS]) -> float:
    """Return the standard deviation of the RCS [dB]."""
    if stated is None or not stated.rcs_db:
        return 0.0
    if any(getattr(own, "spread", None) is not None for own in rcs.values()):
        raise stated.place["rcs_db"].error(
            "stands beside the column std_db of the RCS table; give only one of the two: both are "
            "the uncertainty of the RCS"
        )
    return float(stated.rcs_db)


def _refuse_uncovered(place: Place, geometry: Geometry, radar: Radar) -> None:
    rcs = radar.model.rcs
    if not isinstance(rcs, TableRCS) or rcs.elevation is None:
        return
    body = body_vector(geometry.aircraft, np.asarray(radar.state))
    outside = np.flatnonzero(rcs.uncovered(body))
    if len(outside):
        raise place.error(
            f"at {geometry.axis.name} {geometry.axis.at(outside[0])} the aircraft sees "
            f"{radar.called} at elevation {elevation_of(body[outside[0]]) / DEG:.3g} deg, the "
            f"RCS table covers {rcs.elevation[0] / DEG:g} to {rcs.elevation[-1] / DEG:g} deg: "
            "add rows to the table, or change the path"
        )
