"""RCS tables from files: what is read, and what is refused with file and line."""

import numpy as np
import pytest
from helpers import direction
from scenario_file.refused import refused

import radar_sense as rs


def write(path, *rows):
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")
    return path


def full(step=30, start=-180, stop=180):
    return [f"{a},0.5" for a in range(start, stop, step)]


G = ["azimuth_deg,elevation_deg,rcs_m2"]
A = ["azimuth_deg,rcs_m2"]


def test_units_and_order(here):
    """`test_table_file` has other ways to write the same numbers."""
    rng = np.random.default_rng(13)
    azimuth, elevation = range(-180, 180, 20), range(-30, 60, 15)
    level = rng.integers(-300, 100, (18, 6)) / 10
    decibels = ["azimuth_deg,elevation_deg,rcs_dbsm"]
    decibels += [
        f"{a},{e},{level[i, j]}" for i, a in enumerate(azimuth) for j, e in enumerate(elevation)
    ]
    square = ["rcs_m2,elevation_deg,azimuth_deg"]
    square += [
        f"{10 ** (level[i, j] / 10)},{e},{a}"
        for j, e in enumerate(elevation)
        for i, a in enumerate(azimuth)
    ]
    for rows in (decibels, square):
        table = rs.load_rcs_table(write(here / "a.csv", *rows))
        np.testing.assert_allclose(table.rcs, 10 ** (level / 10), rtol=1e-14)
        np.testing.assert_allclose(table.azimuth, np.deg2rad(azimuth), rtol=1e-15)
        np.testing.assert_allclose(table.elevation, np.deg2rad(elevation), rtol=1e-15)


@pytest.mark.parametrize(
    "azimuth",
    [range(0, 181, 10), range(-180, 1, 10), range(5, 180, 10), range(-175, 0, 10)],
    ids=["right", "left", "between", "left between"],
)
def test_halves_are_mirrored(here, azimuth):
    rows = [f"{a},{1 + abs(a) / 90}" for a in azimuth]
    file = write(here / "half.csv", "azimuth_deg,rcs_m2", *rows)
    table = rs.load_rcs_table(file, mirror=True)
    assert len(table.azimuth) == 36
    angle = np.linspace(0, np.pi, 500)
    right, left = (table.cross_section(direction(s * angle, 0 * angle)) for s in (1, -1))
    np.testing.assert_allclose(left, right, rtol=1e-12)
    nodes = np.deg2rad(np.array(azimuth))
    found = table.cross_section(direction(nodes, 0 * nodes))
    np.testing.assert_allclose(found, 1 + abs(np.rad2deg(nodes)) / 90, rtol=1e-12)
    with refused("once around...mirror: true completes"):
        rs.load_rcs_table(file)


def test_both_ends_of_the_circle_may_be_given(here):
    for start in (-180, 0):
        rows = full(30, start, start + 360)
        both = (rs.load_rcs_table(write(here / "a.csv", *A, *some))
                for some in (rows, [*rows, f"{start + 360},0.5"]))  # fmt: skip
        np.testing.assert_array_equal(*(table.azimuth for table in both))


def test_a_finer_sector_and_coarser_ends_are_no_gaps(here):
    angles = [*range(-180, -30, 10), *np.arange(-30, 30, 0.5), *range(30, 180, 10)]
    table = rs.load_rcs_table(write(here / "a.csv", *A, *(f"{a},1" for a in angles)))
    assert len(table.azimuth) == len(angles)
    elevations = (-30, -10, 0, 10, 30)
    rows = [f"{a},{e},{1 + abs(e)}" for a in range(0, 360, 30) for e in elevations]
    table = rs.load_rcs_table(write(here / "a.csv", *G, *rows))
    nodes = direction(np.zeros(5), np.deg2rad(elevations))
    np.testing.assert_allclose(table.cross_section(nodes), [31, 11, 1, 11, 31], rtol=1e-12)


BOX = [f"{a},{e},1" for a in range(-180, 180, 30) for e in (-10, 0, 10)]

#: Rows of a file, the line in the error, and words of the error. `test_table_file` has errors that
#: files of all kinds have.
REFUSED = {
    "empty": ([], None, "is empty; the first line must name the columns: azimuth_deg,"),
    "no unit": (["azimuth_deg,rcs", *full()], 1, "unknown column 'rcs'"),
    "twice": (["azimuth_deg,azimuth_deg,rcs_m2"], 1, "duplicate column 'azimuth_deg'"),
    "no azimuth": (["elevation_deg,rcs_m2"], 1, "missing column 'azimuth_deg'"),
    "no value": (["azimuth_deg,elevation_deg"], 1, "one of the columns rcs_m2 and rcs_dbsm"),
    "two values": (["azimuth_deg,rcs_m2,rcs_dbsm"], 1, "and not both"),
    "zero": ([*A, "-180,1", "-150,0"], 3, "not less than 1e-20 and not greater than 1e+20, got 0"),
    "decibels": (["azimuth_deg,rcs_dbsm", "0,201"], 2, "and not greater than 200, got 201"),
    "azimuth": ([*A, "-181,1"], 2, "azimuth_deg: must be a number not less than -180"),
    "elevation": ([*G, "0,91,1"], 2, "and not greater than 90, got 91"),
    "unsorted": ([*A, "-180,1", "-150,1", "-160,1"], 4, "azimuth must ascend"),
    "repeated": ([*A, "-180,1", "-150,1", "-150,1"], 4, "azimuth -150 deg is repeated"),
    "too near": ([*A, "0,1", "0.0001,1"], 3, "must ascend, by 0.001 deg or more"),
    "gap": ([*A, *full()[:4], *full()[5:]], 6, "a gap in azimuth, from -90 to -30 deg"),
    "half": ([*A, *full(30, 0, 181)], 8, "none from 180 to 360 deg"),
    "too coarse": ([*A, *full(120)], 3, "and 90 deg at most"),
    "one row": ([*A, "0,1"], 2, "once around"),
    "too far around": ([*A, *full(30, -180, 211)], 15, "azimuth 210 is more than a turn from the"),
    "ends differ": ([*A, *full(), "180,0.6"], 14, "azimuth 180 and -180 are the same direction"),
    "hole in the grid": ([*G, *BOX[:7], *BOX[8:]], 9, "elevation must be 0 here, as at the first"),
    "short row": ([*G, *BOX[:8], *BOX[9:]], 9, "azimuth -120 has 2 of the values for elevation"),
    "long row": ([*G, *BOX[:6], "-150,20,1", *BOX[6:]], 8, "has 4 of the values for elevation"),
    "grid unsorted": ([*G, *BOX[3:6], *BOX[:3]], 5, "azimuth must ascend"),
    "grid unsorted within": ([*G, BOX[1], BOX[0]], 3, "elevation must ascend"),
    "one elevation": ([*G, *(f"{a},0,1" for a in range(0, 360, 30))], 2, "two or more"),
    "gap above": (
        [*G, *(f"{a},{e},1" for a in range(0, 360, 30) for e in (-20, -10, 0, 20, 30))],
        5,
        "a gap in elevation, from 0 to 20 deg; allowed are 15 deg here: 1.5 times the wider step",
    ),
    "pole": (
        [*G, *(f"{a},{e},{1 + (a == 90) * (e == 90)}" for e in (70, 80, 90)
               for a in range(0, 360, 30))],
        29,
        "straight above the aircraft azimuth has no meaning",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_file_and_line(here, name):
    rows, line, words = REFUSED[name]
    write(here / "bad.csv", *rows)
    with refused(f"bad.csv:{line}: ...{words}" if line else f"bad.csv: ...{words}"):
        rs.load_rcs_table("bad.csv")


def test_what_is_not_mirrored(here):
    """A whole table; and a gap is named where it stands first."""
    gap = [f"{a},{e},1" for a in range(0, 181, 30) for e in (-20, -10, 0, 20, 30)]
    for rows, says in (
        ([*A, *full(30, 0, 360)], "9: mirror: true is for ... got 210"),
        ([*G, *gap], "5: a gap in elevation, from 0 to 20 deg"),
    ):
        write(here / "a.csv", *rows)
        with refused(f"a.csv:{says}"):
            rs.load_rcs_table("a.csv", mirror=True)


def test_not_a_file(here):
    (here / "table.csv").touch()
    missing = "cannot be read: No such file or directory"
    for name, words in (
        ("tabel.csv", f"tabel.csv: {missing}; did you mean 'table.csv'?$"),
        (".", ".: is a directory, not an RCS table"),
        ("a\0b", r"a\x00b: cannot be read: embedded null byte"),
    ):
        with refused(words):
            rs.load_rcs_table(name)


def test_the_extremes_that_are_allowed(here):
    for column, values in (("rcs_dbsm", (-200, 200)), ("rcs_m2", ("1e-20", "1e20"))):
        rows = [f"{a},{values[a % 60 == 0]}" for a in range(0, 360, 30)]
        rs.load_rcs_table(write(here / "a.csv", f"azimuth_deg,{column}", *rows))
