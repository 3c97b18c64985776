"""Scenarios of routes on the round earth."""

from helpers import document, dump_yaml

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
    header = ["time_s", *keys, *(("roll_deg", "pitch_deg", "yaw_deg") if attitude else ())]
    rows = [[600 * i, *map(float, place), *(attitude or ())] for i, place in enumerate(places)]
    text = "\n".join(",".join(map(str, row)) for row in [header, *rows])
    (folder / "route.csv").write_text(text)
    geometry = {"type": "path", "file": "route.csv", "origin": dict(zip(keys, origin, strict=True))}
    content = document(geometry=geometry, **changes)
    del content["aircraft"]["attitude_deg"]
    (folder / "flight.yaml").write_text(dump_yaml(content))
    return rs.load_scenario(folder / "flight.yaml")
