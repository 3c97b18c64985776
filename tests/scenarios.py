"""The paper's scenario with changes, for tests: `change("geometry.range_km", 400)` and the like."""

import copy

import yaml

from radar_sense.scenario import default_text, parse_scenario

PAPER = yaml.safe_load(default_text().replace("1.7e-4", "1.7e-04"))
PAPER["radar"]["p_fa"] = 1.7e-4  # PyYAML reads 1.7e-4 as text; the package's reader does not


# Level and heading north at 500 km north of the origin, with the radar straight below.
OVERHEAD = {
    "aircraft__attitude_deg": [0, 0, 0],
    "radar__position_m": [500e3, 0, 10e3],
    "geometry__azimuth_deg": {"start": 0, "stop": 0, "step": 1},
    "geometry__azimuth_from": "north",
}


def document(**changes):
    """The paper's document with other values at key paths, `__` between the keys."""
    changed = copy.deepcopy(PAPER)
    for path, value in changes.items():
        *parents, key = path.split("__")
        where = changed
        for parent in parents:
            where = where[parent]
        where[key] = value
    return changed


def scenario(**changes):
    """The paper's scenario with other values at key paths, `__` between the keys."""
    return parse_scenario(yaml.safe_dump(document(**changes), sort_keys=False))
