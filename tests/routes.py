"""Route files of tests: the columns, and files made from arrays."""

from pathlib import Path

import numpy as np

from radar_sense.scenario_file.route_file import load_route

DEG = np.pi / 180
ORIGIN = (40 * DEG, -105 * DEG, 1600.0)
STATES = ["north", "east", "down", "roll", "pitch", "yaw"]
ATTITUDE = ["roll_deg", "pitch_deg", "yaw_deg"]
STD = [f"std_{s}_{'m' if i < 3 else 'deg'}" for i, s in enumerate(STATES)]
UPPER = [(i, j) for i in range(6) for j in range(i, 6)]
COV = [
    f"cov_{STATES[i]}_{STATES[j]}_{'m2' if j < 3 else 'm_deg' if i < 3 else 'deg2'}"
    for i, j in UPPER
]

HEAD = "time_s,north_m,east_m,down_m"
POSE_HEAD = ",".join([HEAD, *ATTITUDE])
GEO = "time_s,latitude_deg,longitude_deg,altitude_m"


#: Past a radar, with a yaw that goes through 180 degrees, and with errors of each pose.
UNCERTAIN = f"""{POSE_HEAD},{",".join(STD)}
100,400e3,-200e3,-8000,0,0,80,10,20,30,1,2,3
500,380e3,-100e3,-8000,2,0,170,100,20,30,1,0,3
1000,350e3,0,-9000,0,1,-170,1000,20,30,1,2,0.1
1500,350e3,100e3,-9000,0,0,-120,0,0,0,0,0,0
"""


def load(content, **options):
    """Write `route.csv`, of text, bytes, or columns by name, to the current folder, and read it."""
    if isinstance(content, dict):
        rows = zip(*content.values(), strict=True)
        lines = [",".join(content), *(",".join(repr(float(x)) for x in row) for row in rows)]
        content = "\n".join(lines) + "\n"
    Path("route.csv").write_bytes(content.encode() if isinstance(content, str) else content)
    return load_route("route.csv", **options)


def ned(time, position):
    return dict(zip(["time_s", "north_m", "east_m", "down_m"], [time, *position.T], strict=True))


def geodetic(time, place):
    names = ["time_s", "latitude_deg", "longitude_deg", "altitude_m"]
    return dict(zip(names, [time, place[:, 0] / DEG, place[:, 1] / DEG, place[:, 2]], strict=True))


def random_covariance(rng, count, rank=6):
    mix = rng.standard_normal((count, 6, rank)) * 10.0 ** rng.uniform(-3, 2, (count, 6, 1))
    return mix @ np.swapaxes(mix, -1, -2)


def triangle(covariance):
    return {name: covariance[:, i, j] for name, (i, j) in zip(COV, UPPER, strict=True)}


def same(a, b):
    for x, y in ((a.time_s, b.time_s), (a.aircraft, b.aircraft)):
        np.testing.assert_array_equal(x, y)
