"""The scenario in words and as tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from radar_sense.reporting.html_elements import Html, table
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANTS, FloatArray

#: Names of the RCS models in a sentence. Other models have the name in the scenario file.
_RCS = {
    "constant": "the same RCS in all directions",
    "ellipsoid": "the RCS of an ellipsoid",
    "ellipsoid_exact": "the RCS of an ellipsoid",
    "spikeball": "an RCS with lobes",
    "table": "an RCS from a table",
}
#: Most radars that are columns of the table. More radars are rows.
SIDE_BY_SIDE = 3


def scenario_sentence(scenario: Scenario) -> str:
    """Return radars, target and flight in a sentence or two."""
    document, names = scenario.resolved(), scenario.model.names
    count = len(scenario.model.radars)
    who = f"{count} radars" if count > 1 else "One radar"
    who += f" ({', '.join(names)})" if names else ""
    looks = "look" if count > 1 else "looks"
    model = document["aircraft"]["rcs"]["model"]
    target = _RCS.get(model, f"the RCS model {model}")
    return f"{who} {looks} at an aircraft with {target}. {_flight(document['geometry'], scenario)}"


def levels_sentence(scenario: Scenario) -> str:
    """Return the level of radar uncertainty of the report, and the other levels of the file."""
    others = [level for level in scenario.cov_radar if level != scenario.level]
    words = f"The level of radar uncertainty is {scenario.level}"
    return f"{words}; the file also has {', '.join(others)}." if others else f"{words}."


def _flight(geometry: Mapping[str, Any], scenario: Scenario) -> str:
    axis = scenario.axis
    poses = f"{len(axis)} poses" if len(axis) > 1 else "1 pose"
    span = f"from {axis.name} {axis.number(float(axis.values[0]))} to {axis.at(-1)}"
    if geometry["type"] == "orbit":
        return (
            f"The aircraft is on a level circle of {geometry['range_km']:g} km, at {poses} {span}."
        )
    if geometry["type"] == "path":
        return f"The aircraft flies the path of {geometry['file']}, with {poses} {span}."
    return f"The aircraft has {poses} {span}."


def radar_table(scenario: Scenario, columns: Mapping[str, FloatArray]) -> Html:
    """Return the table of the radars.

    Args:
        scenario: The scenario.
        columns: Table of `variance`, which has range and SNR.
    """
    document = scenario.resolved()
    blocks = document.get("radars") or [document["radar"]]
    columns_of_radars = []
    for block, constant in zip(blocks, scenario.radar[CONSTANTS], strict=True):
        name = block.get("name", "The radar")
        ending = f"_{name}" if len(blocks) > 1 else ""
        levels = block.get("uncertainty") or document["uncertainty"]["radar"]
        position, std = _deviations(levels[scenario.level], "position_m", "constant")
        columns_of_radars.append(
            {
                "Radar": name,
                "Place": _place(block),
                "σ of place [m]": position,
                "c_r [J m²/K]": f"{constant:g}",
                "σ of c_r": std,
                "P_FA": f"{block['p_fa']:g}",
                "Detector": _detector(block["detector"]),
                "Attenuation [dB/km]": _value(block.get("attenuation_db_per_km", "")),
                "σ of attenuation [dB/km]": _value(
                    levels[scenario.level].get("attenuation_db_per_km", "")
                ),
                "Limits": _limits(block),
                "Looks every [s]": f"{block['scan_period_s']:g}"
                if "scan_period_s" in block
                else "",
                "Range [km]": _span(columns.get(f"range_m{ending}"), 1e-3),
                "SNR [dB]": _span(columns.get(f"snr_db{ending}"), 1.0),
            }
        )
    known = [key for key in columns_of_radars[0] if any(c[key] for c in columns_of_radars)]
    rows = [[radar[key] for key in known] for radar in columns_of_radars]
    head = known
    if len(rows) <= SIDE_BY_SIDE:
        head, *rows = map(list, zip(known, *rows, strict=True))
    return table(f"The radars, with standard deviations at level {scenario.level}", head, rows)


def flight_table(scenario: Scenario) -> Html:
    """Return the table of the aircraft, its flight, and the choices of the analyses."""
    document = scenario.resolved()
    uncertainty = document["uncertainty"]
    of_aircraft = dict(uncertainty.get("aircraft", {}))
    rcs_db = of_aircraft.pop("rcs_db", None)
    if of_aircraft:
        position, attitude = _deviations(of_aircraft, "position_m", "attitude_deg")
    else:
        position = attitude = "in the route file, by pose"
    rows = [("RCS", _pairs(document["aircraft"]["rcs"]))]
    if rcs_db is not None:
        rows.append(("σ of RCS [dB]", _value(rcs_db)))
    if "attitude_deg" in document["aircraft"]:
        angles = _value(document["aircraft"]["attitude_deg"])
        rows.append(("Roll, pitch, yaw [deg]", angles))
    rows.append(("Geometry", _pairs(document["geometry"])))
    rows += [("σ of position [m]", position), ("σ of attitude [deg]", attitude)]
    if "aircraft_correlation_s" in uncertainty:
        rows.append(("Correlation time of errors [s]", f"{uncertainty['aircraft_correlation_s']}"))
    return table("The aircraft and its flight", (), rows)


def _deviations(block: Mapping[str, Any], *keys: str) -> list[str]:
    if "covariance" in block:
        return ["full covariance, see the YAML"] * len(keys)
    if "poses" in block:
        return ["one covariance for each pose"] * len(keys)
    return [_value(block.get(key, block.get(f"{key}_tolerances", ""))) for key in keys]


def _place(block: Mapping[str, Any]) -> str:
    if "position_geodetic" in block:
        place = block["position_geodetic"]
        latitude, longitude = place["latitude_deg"], place["longitude_deg"]
        return (
            f"{abs(latitude):.8g}° {'S' if latitude < 0 else 'N'}, "
            f"{abs(longitude):.8g}° {'W' if longitude < 0 else 'E'}, {place['altitude_m']:g} m"
        )
    return f"{_value(block['position_m'])} m north, east, down"


def _detector(detector: str | Mapping[str, Any]) -> str:
    """Return a detector in words: the model, and the other keys with their values."""
    if isinstance(detector, str):
        return detector

    def words(key: str, value: object) -> str:
        if isinstance(value, Mapping):
            return f"{key}: " + " ".join(words(k, v) for k, v in value.items())
        return f"{value}" if key in ("model", "type") else f"{key.replace('_', ' ')} {value}"

    return ", ".join(words(key, value) for key, value in detector.items())


def _limits(block: Mapping[str, Any]) -> str:
    limits = []
    if block.get("min_range_km"):
        limits.append(f"from {block['min_range_km']:g} km")
    if "max_range_km" in block:
        limits.append(f"up to {block['max_range_km']:g} km")
    if block.get("horizon"):
        limits.append("horizon")
    return ", ".join(limits) or "none"


def _span(values: FloatArray | None, unit: float) -> str:
    """Return the least and the largest of finite values."""
    if values is None or not np.isfinite(values).any():
        return ""
    finite = values[np.isfinite(values)] * unit
    low, high = (f"{value:.4g}" for value in (finite.min(), finite.max()))
    return low if low == high else f"{low} to {high}"


def _pairs(block: Mapping[str, Any]) -> str:
    hidden = ("sha256",)  # the YAML at the end of the page has the digest
    return ", ".join(f"{key} {_value(value)}" for key, value in block.items() if key not in hidden)


def _value(value: Any) -> str:
    """Return a value of a scenario file in words."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return f"{value:.10g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_value(item)}" for key, item in value.items())
    if isinstance(value, list):
        if value and isinstance(value[0], list):
            return "; ".join(_value(row) for row in value)
        return ", ".join(_value(item) for item in value)
    return str(value)
