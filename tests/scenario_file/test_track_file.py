"""GPX, ADS-B state vectors and waypoints with a speed give the route of an equal CSV file."""

import hashlib
import math
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers import read_back, write_path
from scenario_file.earth import ecef
from scenario_file.refused import refused

import radar_sense as rs
from radar_sense.scenario_file import table_file, track_file
from radar_sense.scenario_file.route_file import load_route

ORIGIN = (math.radians(47), math.radians(8), 400.0)
#: Seconds after 07:00:00, latitude, longitude [deg], altitude [m].
POINTS = [
    (0.0, 47.1, 8.1, 1000.0),
    (10.25, 47.12, 8.1, 1010.5),
    (20.5, 47.13, 8.13, 1100.0),
    (50.0, 47.1, 8.16, 1050.0),
]
TIMES = [f"2026-11-22T07:00:{t:07.4f}Z" for t, *_ in POINTS]
GPX = '<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1"><{0}>{1}</{0}></gpx>'


def gpx(points=POINTS, times=TIMES):
    def point(where, time):
        _, lat, lon, alt = where
        when = f"<time>{time}</time>" if time else ""
        return f'<trkpt lat="{lat}" lon="{lon}">\n<ele>{alt}</ele>{when}<sat>9</sat></trkpt>\n'

    body = [point(*pair) for pair in zip(points, times, strict=True)]
    segments = (f"<trkseg>{''.join(part)}</trkseg>" for part in (body[:2], body[2:]))
    return GPX.format("trk", "<name>a</name>" + "".join(segments))


def opensky(others=()):
    lines = [
        "time,icao24,lat,lon,velocity,heading,vertrate,callsign,onground,alert,spi,squawk,"
        "baroaltitude,geoaltitude,lastposupdate,lastcontact"
    ]
    for t, lat, lon, alt in POINTS:
        for row in ((lat, lon, alt, t), (lat, lon, "", t), (lat, lon, alt, t), ("", "", alt, t)):
            *place, alt_, moment = row
            place = ",".join(map(str, place))
            lines.append(
                f"{1.7e9 + t + 3},4b1812,{place},90,45,0,SWR 1 ,False,False,False,1000,"
                f"{alt - 40},{alt_},{1.7e9 + moment!r},{1.7e9 + t}"
            )
        lines += [f"{1.7e9},{other},47,8,,,,,,,,,,1000,{1.7e9}," for other in others]
    return "\n".join(lines) + "\n"


def csv(points=POINTS, extra="", values=("", "", "", "")):
    head = f"time_s,latitude_deg,longitude_deg,altitude_m{extra}\n"
    rows = zip(points, values, strict=True)
    return head + "".join(f"{','.join(map(repr, p))}{v}\n" for p, v in rows)


@pytest.fixture
def load(here):
    def load(name, text, origin=ORIGIN, **options):
        Path(name).write_text(text)
        return load_route(name, origin=origin, **options)

    return load


def higher(by):
    return [(t, lat, lon, alt + by) for t, lat, lon, alt in POINTS]


def same(one, other, atol=1e-6):
    np.testing.assert_allclose(one.time_s, other.time_s, rtol=0, atol=atol)
    np.testing.assert_allclose(one.aircraft, other.aircraft, rtol=0, atol=atol)


SEA = {"geoid_height_m": 47.5}


def test_every_format_has_the_route_of_a_csv_file(load):
    on_ellipsoid, on_sea = load("a.csv", csv()), load("b.csv", csv(higher(47.5)))
    assert not np.allclose(on_ellipsoid.aircraft[:, 2], on_sea.aircraft[:, 2], atol=40)
    for text in (gpx(), f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- a -->{gpx()}'):
        same(load("a.GPX", text, **SEA), on_sea)
        same(load("a.gpx", text, altitude_above="sea", **SEA), on_sea)
        same(load("a.gpx", text, altitude_above="ellipsoid"), on_ellipsoid)
    beside = gpx().replace("<trk>", "<rte><rtept lat='x'/></rte><rte/><trk>")
    same(load("a.gpx", beside, **SEA), on_sea)  # a track is used, whatever the routes beside it
    same(load("a.csv", csv(), altitude_above="sea", **SEA), on_sea)
    same(load("a.csv", opensky()), on_ellipsoid)
    same(load("a.csv", opensky(others=["abc123"]), icao24="4B1812"), on_ellipsoid)
    same(load("a.csv", opensky(), altitude_above="pressure", geoid_height_m=40.0), on_ellipsoid)
    # without the time of the position, rows of later times repeat latitude and longitude
    rows = (f"{t + later},abc123,{lat},{lon},{alt + later}\n"
            for t, lat, lon, alt in POINTS for later in (0, 1, 5))  # fmt: skip
    same(load("a.csv", "time,icao24,lat,lon,geoaltitude\n" + "".join(rows)), on_ellipsoid)


def test_a_place_at_two_times_of_its_position_is_two_places(load):
    rows = [f"{t},abc123,47.{p},8,900,{t}" for t, p in ((5, 1), (10, 2), (15, 2), (20, 3))]
    text = "\n".join(["time,icao24,lat,lon,geoaltitude,lastposupdate", *rows])
    assert load("a.csv", text).time_s.tolist() == [0, 5, 10, 15]


def test_waypoints_with_a_speed(load):
    places = [ecef(*place) for _, *place in POINTS]
    legs = [math.dist(*ends) for ends in pairwise(places)]  # as good as arcs, to 1e-8
    speeds = [80.0, 120.0, 100.0, 1.0]
    for speed, expected in (([100.0] * 4, np.cumsum([0, *legs]) / 100),
                            (speeds, np.cumsum([0, *np.divide(legs, speeds[:3])]))):  # fmt: skip
        text = csv(extra=",speed_m_s", values=[f",{v}" for v in speed]).split("\n")
        text = "\n".join(line.partition(",")[2] for line in text)
        found = load("a.csv", text)
        np.testing.assert_allclose(found.time_s, expected, rtol=1e-6, atol=0)
    steady = load("a.gpx", gpx(times=[""] * 4), speed_m_s=100.0, altitude_above="ellipsoid")
    np.testing.assert_allclose(steady.time_s, np.cumsum([0, *legs]) / 100, rtol=1e-6)
    route = gpx(times=[""] * 4).replace("trkpt", "rtept")
    route = route.replace("<trk>", "<rte>").replace("</trk>", "</rte>")
    route = route.replace("<trkseg>", "").replace("</trkseg>", "")
    same(load("a.gpx", route, speed_m_s=100, altitude_above="ellipsoid"), steady)
    flat = load(
        "a.csv", "north_km,east_m,down_m\n0,0,0\n3,4000,0\n3,4000,-100\n", None, speed_m_s=10
    )
    np.testing.assert_allclose(flat.time_s, [0, 500, 510])


DOCTYPE = '<!DOCTYPE a [<!ENTITY b "c">]>'
NED = "time_s,north_m,east_m,down_m\n0,0,0,0\n1,9,0,0\n"
REFUSED = {
    "sea without geoid": ("a.gpx", gpx(), {}, "a.gpx:1: altitudes above the sea need geoid_heigh"),
    "unused geoid": ("a.csv", csv(), SEA, "a.csv:1: geoid_height_m needs altitude_above: sea"),
    "no altitudes": ("a.csv", NED, {**SEA, "origin": None}, "are not used with north, east"),
    "pressure in gpx": ("a.gpx", gpx(), {**SEA, "altitude_above": "pressure"},
                        "altitude_above: must be sea or ellipsoid for this file, got pressure"),
    "unused geoid in opensky": ("a.csv", opensky(), SEA,
                                "geoid_height_m needs altitude_above: pressure for such alt"),
    "pressure only": ("a.csv", opensky().replace("geoaltitude", "other"), {},
                      "a.csv:1: missing column 'geoaltitude' of ADS-B state vectors; baroaltitud"),
    "two aircraft": ("a.csv", opensky(others=["abc123"]), {}, "a.csv:6: icao24: must be one airc"),
    "a column twice": ("a.csv", opensky().replace("icao24", "icao24,lat", 1), {},
                       "a.csv:1: duplicate column 'lat'"),
    "no such aircraft": ("a.csv", opensky(), {"icao24": "ffffff"}, "no position of the aircraft"),
    "a bad latitude": ("a.csv", opensky().replace(",47.12,", ",99,"), {},
                       "a.csv:6: lat: must be a number not less than -90 and not greater than 90"),
    "icao24 in gpx": ("a.gpx", gpx(), {"icao24": "ffffff"}, "icao24 is for files of ADS-B"),
    "times and speed": ("a.gpx", gpx(), {**SEA, "speed_m_s": 9}, "a.gpx:1: has times; speed_m_s"),
    "some times": ("a.gpx", gpx(times=[*TIMES[:3], ""]), SEA, "a.gpx:7: has no time, but other"),
    "times twice": ("a.gpx", gpx(times=[TIMES[0], *TIMES[:3]]), SEA,
                    "a.gpx:3: time: must be later than the time of the row before, got the same"),
    "a gap": ("a.gpx", gpx(), {**SEA, "max_gap_s": 20}, "a.gpx:7: time: must be within 20 s"),
    "no zone": ("a.gpx", gpx(times=["2026-11-22T07:00:00"] * 4), SEA,
                "a.gpx:1: time: must be a date and time with its zone"),
    "no elevation": ("a.gpx", gpx().replace("<ele>1100.0</ele>", ""), SEA,
                     "a.gpx:5: missing 'ele', the elevation of the point"),
    "a leap second": ("a.gpx", gpx(times=[*TIMES[:2], "2026-12-31T23:59:60Z", TIMES[3]]), SEA,
                      "a.gpx:5: time: is a leap second, which seconds since 1970 do not have, got "
                      "'2026-12-31T23:59:60Z'; leave the point out"),
    "a long number": ("a.gpx", gpx().replace("8.13", "8" * 60_000 + "x"), SEA,
                      "not greater than 360, got more than 100 letters"),
    "a long text": ("a.gpx", gpx().replace("1100.0", "1" * 60_000), SEA, "got more than 100 le"),
    "the same place": ("a.gpx", gpx(times=[""] * 4).replace('lat="47.12"', 'lat="47.1"')
                       .replace("1010.5", "1000.0"), {**SEA, "speed_m_s": 9},
                       "a.gpx:3: is the same place as the point before"),
    "kml": ("a.kml", "<kml/>", SEA, "a.kml:1: names none of the columns, allowed: time_s or speed"
            "...; the name of a GPX file ends in .gpx"),
    "no gpx": ("a.gpx", "<a/>", SEA, "a.gpx:1: must be GPX 1.1, with the root gpx of its namesp"),
    "no track": ("a.gpx", GPX.format("a", ""), SEA, "must have one track or one route, got 0 tra"),
    "no points": ("a.gpx", GPX.format("trk", ""), SEA, "a.gpx: has no points"),
    "an odd encoding": ("a.gpx", f'<?xml version="1.0" encoding="unicode_escape"?>{gpx()}', SEA,
                        "a.gpx:1: encoding: must be one of utf-8, utf-16, us-ascii, iso-8859-1, "
                        "got 'unicode_esc"),
    "deep": ("a.gpx", GPX.format("a", "<a>" * 99), SEA, "more than 100 elements inside each other"),
    "a long comment": ("a.gpx", GPX.format("a", f"<!--{'a' * 2**20}-->"), SEA,
                       "a.gpx:1: has an element, an attribute or a comment over 262144 bytes"),
    "two tracks": ("a.gpx", gpx().replace("</trk>", "</trk><trk/>"), SEA,
                   "a.gpx:1: must have one track or one route, got 2 tracks and 0 routes"),
    "no xml": ("a.gpx", csv(), SEA, "a.gpx:1: is not valid XML: syntax error"),
    "open": ("a.gpx", gpx()[:-3], SEA, "is not valid XML: unclosed token"),
    "a document type": ("a.gpx", "\n" + DOCTYPE + gpx(), SEA, "a.gpx:2: has a DOCTYPE, which is"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line(load, case):
    name, text, options, says = REFUSED[case]
    with refused(says):
        load(name, text, **({"origin": None} if "north_m" in text else {}) | options)


def test_a_scenario_and_its_record_read_the_same_route(here):
    origin = {"latitude_deg": 47, "longitude_deg": 8, "altitude_m": 400}
    files = {
        "a.gpx": (gpx(), {"geoid_height_m": 47.5}),
        "b.csv": (
            opensky(others=["abc123"]),
            {"icao24": "4b1812", "altitude_above": "pressure", "geoid_height_m": 87.5},
        ),
        "c.gpx": (gpx(times=[""] * 4), {"geoid_height_m": 47.5, "speed_m_s": 90.0}),
    }
    for name, (text, conventions) in files.items():
        Path(name).write_text(text)
        keys = {"type": "path", "file": name, "origin": origin, **conventions}
        scenario = rs.load_scenario(write_path(here, NED, geometry=keys))
        block = scenario.resolved()["geometry"]
        assert block.items() >= conventions.items()
        assert block["sha256"] == hashlib.sha256(text.encode()).hexdigest()
        read_back(scenario)
        Path("d.csv").write_text(csv(higher(47.5)))
        expected = load_route("d.csv", origin=ORIGIN).aircraft
        np.testing.assert_allclose(scenario.aircraft[:, :3], expected[:, :3], atol=1e-6)


def test_a_file_has_at_most_a_million_points(load, monkeypatch):
    assert table_file.MAX_ROWS == track_file.MAX_ROWS == 1_000_000
    for module in (table_file, track_file):
        monkeypatch.setattr(module, "MAX_ROWS", 3)
    few = POINTS[:3]
    same(
        load("a.gpx", gpx(few, TIMES[:3]), **SEA),
        load("a.csv", csv(higher(47.5)[:3], values=[""] * 3)),
    )
    for name, text, says in (
        ("a.csv", "\n" + csv(), "a.csv:6: has more than 3 rows"),
        ("a.gpx", gpx(), "a.gpx:7: has more than 3 points"),
        ("a.csv", opensky(), "a.csv:14: has more than 3 rows"),
    ):
        with refused(says):
            load(name, text, **(SEA if name == "a.gpx" else {}))


def test_the_memory_of_a_file_that_is_no_track_is_bounded(tmp_path):
    """A tree of `<a/>` takes 150 bytes for each byte of the file."""
    for text in ("<a/>" * 2**15, "a" * 2**22, "<a/>\n<!--a-->" * 2**13):
        path = tmp_path / "a.gpx"
        path.write_text(GPX.format("a", text))
        tracemalloc.start()
        with refused("must have one track or one route"):
            load_route(path)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 2**21


def test_encodings_of_text_are_read(load):
    expected = load("a.gpx", gpx(), **SEA)
    for encoding in ("utf-16", "iso-8859-1", "us-ascii", "utf-8"):
        text = f'<?xml version="1.0" encoding="{encoding}"?>\n{gpx()}'
        Path("b.gpx").write_bytes(text.encode(encoding))
        same(load_route("b.gpx", origin=ORIGIN, **SEA), expected, atol=0)
