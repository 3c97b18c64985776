"""Make the synthetic route of path.yaml: an eastbound leg, a right turn, and in towards the radar.

The aircraft flies at 200 m/s and 9 km up, 150 km east, a quarter of a circle with a radius of 12 km
(a bank of 19 deg), then 130 km south. Its navigation is without satellites: errors of position grow
with the 1.5th power of time, those of heading in proportion to it. Rows are 50 s apart, 5 s in and
near the turn.

    python configs/make_path_route.py > configs/path_route.csv
"""

from __future__ import annotations

import math

SPEED, RADIUS, UP = 200.0, 12e3, 9e3
EAST, SOUTH = 150e3, 130e3
START = (430e3, -320e3)

TURN = 0.5 * math.pi * RADIUS
LENGTH = EAST + TURN + SOUTH


def position(flown: float) -> tuple[float, float]:
    """North and east [m] after so many metres."""
    north, east = START
    if flown <= EAST:
        return north, east + flown
    course = min(flown - EAST, TURN) / RADIUS
    south = max(0.0, flown - EAST - TURN)
    return (
        north - RADIUS * (1.0 - math.cos(course)) - south,
        east + EAST + RADIUS * math.sin(course),
    )


def main() -> None:
    """Print the route."""
    print("# SYNTHETIC, made by make_path_route.py")
    print("time_s,north_m,east_m,down_m,", end="")
    print("std_north_m,std_east_m,std_down_m,std_roll_deg,std_pitch_deg,std_yaw_deg")
    time = 0
    while SPEED * time <= LENGTH:
        north, east = position(SPEED * time)
        drift = 10.0 + 1000.0 * (time / 1500.0) ** 1.5
        heading = 0.2 + 2.0 * time / 1500.0
        print(f"{time},{north:.3f},{east:.3f},{-UP:g},{drift:.1f},{drift:.1f},15", end="")
        print(f",0.2,0.2,{heading:.3f}")
        time += 5 if EAST - 20e3 <= SPEED * time < EAST + TURN + 20e3 else 50


if __name__ == "__main__":
    main()
