"""Make the synthetic route of corridor.yaml: 1100 km through an air defence that does not exist.

It is over the open Pacific, where there is no land, let alone a radar. The aircraft flies at
230 m/s by inertial navigation, with four fixes on the way. Between fixes the errors of position
grow with the 1.5th power of time, those of heading in proportion to it. Turns are coordinated, with
a bank of 25 deg, and are rolled into and out of at 5 deg/s. Rows are 20 s apart, 1 s in a turn.

    python configs/make_corridor_route.py > configs/corridor_route.csv
"""

from __future__ import annotations

import math

SPEED = 230.0
BANK = math.radians(25.0)
ROLL_RATE = math.radians(5.0)
GRAVITY = 9.80665
START = (33.0, -154.0, 9000.0, 62.0)  # latitude, longitude [deg], altitude [m], heading [deg]
FIXES = (0, 1440, 2620, 3760)
#: What is flown: "to" a heading [deg], or on for so many seconds, at a rate of climb [m/s].
LEGS: tuple[tuple[str, float, float], ...] = (
    ("on", 780, 0.0),
    ("to", 108, 0.0),
    ("on", 420, -10.0),
    ("on", 480, 0.0),
    ("to", 48, 0.0),
    ("on", 900, 0.0),
    ("to", 95, 0.0),
    ("on", 300, 10.0),
    ("on", 480, 0.0),
    ("to", 40, 0.0),
    ("on", 1000, 0.0),
)

#: WGS-84: semi-major axis [m] and first eccentricity squared.
A, E2 = 6378137.0, 6.69437999014e-3


def flown() -> list[tuple[float, ...]]:
    """Second by second: time [s], latitude, longitude [deg], altitude [m], attitude [deg]."""
    latitude, longitude, altitude, heading = START
    latitude, longitude, heading = map(math.radians, (latitude, longitude, heading))
    roll, time, rows = 0.0, 0, []
    for kind, value, climb in LEGS:
        left = math.radians(value) - heading if kind == "to" else 0.0
        side = math.copysign(1.0, left)
        until = time + value
        while True:
            if kind == "on" and time >= until:
                break
            if kind == "to":
                # What the turn goes on while the wings are levelled, at half the rate on average.
                rest = 0.5 * abs(roll) / ROLL_RATE * GRAVITY * math.tan(abs(roll)) / SPEED
                rolling = BANK if side * (math.radians(value) - heading) > rest else 0.0
                roll += max(-ROLL_RATE, min(ROLL_RATE, side * rolling - roll))
                if rolling == 0.0 and roll == 0.0:
                    break
            pitch = math.asin(climb / SPEED)
            rows.append(
                (
                    time,
                    math.degrees(latitude),
                    math.degrees(longitude),
                    altitude,
                    *map(math.degrees, (roll, pitch, heading)),
                )
            )
            across = math.sqrt(1.0 - E2 * math.sin(latitude) ** 2)
            level = SPEED * math.cos(pitch)
            turned = heading + 0.5 * GRAVITY * math.tan(roll) / SPEED
            heading += GRAVITY * math.tan(roll) / SPEED
            latitude += level * math.cos(turned) / (A * (1.0 - E2) / across**3 + altitude)
            longitude += level * math.sin(turned) / ((A / across + altitude) * math.cos(latitude))
            altitude += climb
            time += 1
        if kind == "to":
            heading = math.radians(value)
    return rows


def text() -> str:
    """Return the content of the file."""
    lines = [
        "# SYNTHETIC, made by make_corridor_route.py; there is nothing but water here",
        "time_s,latitude_deg,longitude_deg,altitude_m,roll_deg,pitch_deg,yaw_deg,"
        "std_north_m,std_east_m,std_down_m,std_roll_deg,std_pitch_deg,std_yaw_deg",
    ]
    rows = flown()
    for i, (time, latitude, longitude, altitude, *attitude) in enumerate(rows):
        turns = any(row[4] != 0.0 for row in rows[max(0, i - 2) : i + 3])
        fix = any(time in (t - 1, t) for t in FIXES)
        if not (turns or fix or time % 20 == 0 or i == len(rows) - 1):
            continue
        drift = time - max(t for t in FIXES if t <= time)
        position = f"{15.0 + 500.0 * (drift / 1200.0) ** 1.5:.1f}"
        heading = f"{0.2 + 1.5 * drift / 1200.0:.3f}"
        lines.append(
            f"{time},{latitude:.8f},{longitude:.8f},{altitude:.2f},"
            + "".join(f"{angle:.3f}," for angle in attitude)
            + f"{position},{position},20,0.3,0.3,{heading}"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    print(text(), end="")
