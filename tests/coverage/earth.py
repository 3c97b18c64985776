"""Scenarios of routes on the round earth."""

from helpers import csv_text, write_path
from routes import ATTITUDE

import radar_sense as rs


def flight(folder, places, origin, attitude=None, **changes):
    """Return the scenario of a route over places: latitude and longitude [deg], and height [m].

    Args:
        folder: Folder of the files.
        places: The places, 600 s apart.
        origin: Place of the origin, likewise.
        attitude: Roll, pitch and yaw [deg] everywhere; by default the route's own.
        changes: Of the document.
    """
    keys = ("latitude_deg", "longitude_deg", "altitude_m")
    head = ["time_s", *keys, *(ATTITUDE if attitude else ())]
    rows = [[600 * i, *map(float, place), *(attitude or ())] for i, place in enumerate(places)]
    geometry = {"type": "path", "file": "route.csv", "origin": dict(zip(keys, origin, strict=True))}
    changes = {"geometry": geometry, "radar__constant": 167, **changes}
    file = write_path(folder, csv_text(",".join(head), rows), "flight.yaml", **changes)
    return rs.load_scenario(file)
