"""WGS-84 and the horizon by formulas that share no code with `radar_sense`, in plain loops.

A place is latitude and longitude [deg], and height [m].
"""

import math

A, F = 6378137.0, 1 / 298.257223563
DEG = math.pi / 180


def ecef(latitude_deg, longitude_deg, height):
    sin, cos = math.sin(latitude_deg * DEG), math.cos(latitude_deg * DEG)
    n = A / math.sqrt(1 - F * (2 - F) * sin * sin)
    lon = longitude_deg * DEG
    across = (n + height) * cos
    return across * math.cos(lon), across * math.sin(lon), ((1 - F) ** 2 * n + height) * sin


def sees(radar, aircraft):
    """Whether the slant range is within the 4/3-earth horizon, and by how much [m]."""
    reach = math.sqrt(2 * 4 / 3 * 6371e3) * (math.sqrt(radar[2]) + math.sqrt(aircraft[2]))
    return reach - math.dist(ecef(*radar), ecef(*aircraft))


def to_ned(place, origin):
    """North, east, down of a place about an origin, both in degrees and metres."""
    lat, lon = origin[0] * DEG, origin[1] * DEG
    x, y, z = (p - o for p, o in zip(ecef(*place), ecef(*origin), strict=True))
    out = math.cos(lon) * x + math.sin(lon) * y
    east = math.cos(lon) * y - math.sin(lon) * x
    return (math.cos(lat) * z - math.sin(lat) * out, east, -math.cos(lat) * out - math.sin(lat) * z)


def height_of(point, origin):
    """Height above the ellipsoid of a point in the frame, by fixed-point iteration on latitude."""
    lat, lon = origin[0] * DEG, origin[1] * DEG
    n, e, d = point
    out = -math.sin(lat) * n - math.cos(lat) * d
    x0, y0, z0 = ecef(*origin)
    x = x0 + math.cos(lon) * out - math.sin(lon) * e
    y = y0 + math.sin(lon) * out + math.cos(lon) * e
    z = z0 + math.cos(lat) * n - math.sin(lat) * d
    p, e2 = math.hypot(x, y), F * (2 - F)
    latitude = math.atan2(z, p * (1 - e2))
    for _ in range(30):
        across = A / math.sqrt(1 - e2 * math.sin(latitude) ** 2)
        latitude = math.atan2(z + e2 * across * math.sin(latitude), p)
    across = A / math.sqrt(1 - e2 * math.sin(latitude) ** 2)
    return p * math.cos(latitude) + z * math.sin(latitude) - A * A / across
