"""RCS tables: the file, the interpolation, the envelope, and the chain that uses them."""

import dataclasses
import runpy

import numpy as np
import pytest
from helpers import CONFIGS, OVERHEAD, csv_text, direction, read_record, scenario
from studies.bands import model as independent

import radar_sense as rs
from radar_sense import analyses
from radar_sense.analyses.rcs import directions, pattern
from radar_sense.model.geometry import body_vector
from radar_sense.words import describe_poses, table_warnings

DEG = np.pi / 180


def uneven(rng, count):
    """Azimuths once around with steps that differ, none of them a gap."""
    steps = rng.uniform(1, 1.4, count)
    turns = np.concatenate([[0], np.cumsum(steps)])
    return -np.pi + rng.uniform(0, 3.2) + turns[:-1] / turns[-1] * 2 * np.pi


def cut(rng, count=36, **options):
    return rs.TableRCS(uneven(rng, count), 10 ** rng.uniform(-3, 1, count), **options)


def grid(rng, low=-40, high=60, count=24, **options):
    elevation = np.linspace(low, high, 11) * DEG
    values = 10 ** rng.uniform(-3, 1, (count, 11))
    values[:, elevation <= -np.pi / 2] = 0.2
    values[:, elevation >= np.pi / 2] = 0.3
    return rs.TableRCS(uneven(rng, count), values, elevation, **options)


def whole(rng, **options):
    return grid(rng, -90, 90, **options)


def difference_quotient(function, body, step):
    """Gradient by central differences of fourth order."""
    slopes = []
    for i in range(3):
        e = step * np.eye(3)[i]
        near, far = (function(body + k * e) - function(body - k * e) for k in (1, 2))
        slopes.append((8 * near - far) / (12 * np.squeeze(step, -1)))
    return np.stack(slopes, axis=-1)


def own_spline(table):
    """Return σ_r of azimuth and elevation by SciPy's splines."""
    nodes = (table.azimuth, table.rcs, table.elevation)  # SciPy's of two dimensions writes to them
    return independent.table(*(None if x is None else x.copy() for x in nodes))


def test_a_table_is_a_product_of_splines_and_exact_at_its_nodes():
    rng = np.random.default_rng(2)
    grids = [grid(rng, *ends) for ends in ((-40, 60), (-90, 90), (-90, 10), (5, 90))]
    for table in (cut(rng, 7), cut(rng, 333), *grids):
        nodes = rng.uniform(-1.5, 1.5, 1) if table.elevation is None else table.elevation
        body = direction(table.azimuth[:, np.newaxis], nodes) * 10 ** rng.uniform(-3, 6)
        found = table.cross_section(body)
        np.testing.assert_allclose(found, table.rcs.reshape(found.shape), rtol=1e-10)
        between = rng.uniform(-np.pi, np.pi, 200), rng.uniform(-89, 89, 200) * DEG
        expected = own_spline(table)(*between)
        np.testing.assert_allclose(table.cross_section(direction(*between)), expected, rtol=1e-11)


@pytest.mark.parametrize(
    ("make", "envelope"), [(cut, None), (grid, None), (whole, None), (cut, 0.2), (whole, 0.2)]
)
def test_the_gradient_is_that_of_the_cross_section(make, envelope):
    rng = np.random.default_rng(5)
    table = make(rng, envelope=envelope)
    # Elevations beyond the table and every azimuth; not where a step would cross straight above.
    body = direction(rng.uniform(-np.pi, np.pi, 500), rng.uniform(-1.45, 1.45, 500))
    body *= 10 ** rng.uniform(0, 5, (500, 1))
    sigma, gradient = table.linearize(body)
    np.testing.assert_array_equal(sigma, table.cross_section(body))
    reach = np.linalg.norm(body, axis=-1, keepdims=True)
    slopes = difference_quotient(table.cross_section, body, 1e-5 * reach)
    # The third derivative jumps at the nodes: at a handful of them the quotient is less exact.
    error = np.max(abs(gradient - slopes), axis=-1) * reach[:, 0] / sigma
    assert np.quantile(error, 0.95) < 1e-6
    assert error.max() < 1e-3
    across = np.sum(gradient * body, axis=-1) / sigma
    np.testing.assert_allclose(across, 0, atol=1e-10)


def test_straight_above_and_below():
    rng = np.random.default_rng(7)
    ends = np.array([[0, 0, -2.0], [0, 0, 2.0]])
    table = whole(rng)
    sigma, gradient = table.linearize(ends)
    np.testing.assert_allclose(sigma, [0.3, 0.2], rtol=1e-12)
    assert np.all(gradient == 0)
    nearly = ends + np.array([[1e-6, 2e-6, 0], [-3e-6, 1e-6, 0]])
    np.testing.assert_allclose(table.linearize(nearly)[1], 0, atol=1e-4)
    above_only = grid(rng, -40, 90)
    assert np.isnan(above_only.linearize(ends)[1]).any(axis=-1).tolist() == [False, True]
    for part in (cut(rng), above_only):
        assert np.all(np.isfinite(part.cross_section(ends)))
        assert np.isnan(part.linearize(ends[1])[1]).all()
    assert np.isnan(table.linearize(np.zeros(3))[1]).all()


def test_a_table_with_jumps_is_positive_everywhere():
    rng = np.random.default_rng(8)
    values = np.where(rng.random((36, 13)) > 0.5, 1e-12, 1e12)
    table = rs.TableRCS(np.arange(36) * 10 * DEG, values, np.linspace(-60, 60, 13) * DEG)
    sigma = table.cross_section(rng.normal(size=(20_000, 3)))
    assert np.all(sigma > 0)
    assert np.all(np.isfinite(sigma))


def test_shapes_and_nan():
    rng = np.random.default_rng(10)
    for table in (cut(rng), grid(rng)):
        for shape in ((), (0,), (2, 3)):
            sigma, gradient = table.linearize(rng.normal(size=(*shape, 3)))
            assert (np.shape(sigma), np.shape(gradient)) == (shape, (*shape, 3))
        sigma = table.cross_section(np.array([[np.nan, 1, 1], [1.0, 1, 1]]))
        assert np.isnan(sigma).tolist() == [True, False]


def lobes(rng):
    """A few smooth lobes, not much wider than the steps of 5 degrees."""
    azimuth, elevation = np.arange(-180, 180, 5) * DEG, np.arange(-90, 91, 5) * DEG
    body = direction(azimuth[:, np.newaxis], elevation)
    decibels = np.full((72, 37), -12.0)
    for axis in direction(rng.uniform(-3, 3, 12), rng.uniform(-1, 1, 12)):
        apart = np.arccos(np.clip(body @ axis, -1, 1)) / (rng.uniform(4, 12) * DEG)
        decibels += rng.uniform(10, 30) * np.exp(-0.5 * apart**2)
    decibels[:, [0, -1]] = decibels[0, [0, -1]]
    return rs.TableRCS(azimuth, 10 ** (decibels / 10), elevation)


def within(rng, azimuth, elevation, width):
    """Azimuths and elevations within an angle of others, half of them at its very end."""
    angle = width * np.where(rng.random(len(azimuth)) < 0.5, 1.0, np.sqrt(rng.random(len(azimuth))))
    side = rng.uniform(-np.pi, np.pi, len(azimuth))
    # spherical triangle of the pole, the direction and the new direction
    sine = np.sin(elevation) * np.cos(angle) + np.cos(elevation) * np.sin(angle) * np.cos(side)
    over = np.arctan2(
        np.sin(side) * np.sin(angle) * np.cos(elevation), np.cos(angle) - np.sin(elevation) * sine
    )
    return azimuth + over, np.arcsin(np.clip(sine, -1, 1))


@pytest.mark.parametrize(("make", "narrow"), [(cut, 1e-3), (grid, 1e-3), (whole, 4 * DEG)])
def test_the_envelope_is_never_below_the_table_within_its_angle(make, narrow):
    """At random directions, of which some are at nodes of the table."""
    rng = np.random.default_rng(11)
    for width in (narrow, 1.2):
        plain = make(rng)
        table, sigma = dataclasses.replace(plain, envelope=width), own_spline(plain)
        azimuth = rng.uniform(-np.pi, np.pi, 20_000)
        elevation = np.arcsin(rng.uniform(-1, 1, 20_000))
        if plain.elevation is not None:
            elevation[::2] = rng.choice(plain.elevation, 10_000)
        azimuth[::3] = rng.choice(plain.azimuth, len(azimuth[::3]))
        found = table.cross_section(direction(azimuth, elevation))
        assert np.all(found >= sigma(*within(rng, azimuth, elevation, width)))
        corner = azimuth + width, np.clip(elevation - width, -np.pi / 2, np.pi / 2)
        assert np.all(found >= sigma(*corner))


def test_the_envelope_is_not_loose():
    rng = np.random.default_rng(12)
    width = 4 * DEG
    azimuth, elevation = rng.uniform(-np.pi, np.pi, 2000), np.arcsin(rng.uniform(-1, 1, 2000))
    plain = lobes(np.random.default_rng(1))
    table, sigma = dataclasses.replace(plain, envelope=width), own_spline(plain)
    largest = np.max([sigma(*within(rng, azimuth, elevation, width)) for _ in range(60)], axis=0)
    found = table.cross_section(direction(azimuth, elevation))
    # Measured: 1.0 dB.
    assert np.mean(10 * np.log10(found / largest)) < 1.2
    # That of a constant is the constant.
    values, elevation = np.full((36, 7), 0.25), np.linspace(-90, 90, 7) * DEG
    constant = rs.TableRCS(np.arange(36) * 10 * DEG, values, elevation, 0.3)
    sigma, gradient = constant.linearize(rng.normal(size=(200, 3)))
    np.testing.assert_allclose(sigma, 0.25, rtol=2e-12)  # the margin for rounding
    np.testing.assert_allclose(gradient, 0, atol=1e-10)


def test_the_envelope_has_one_value_straight_above_and_below():
    rng = np.random.default_rng(14)
    table = whole(rng, envelope=1 * DEG)
    azimuth = np.linspace(-np.pi, np.pi, 50)
    for pole in (-np.pi / 2, np.pi / 2):
        near = direction(azimuth, pole * (1 - 1e-5))
        np.testing.assert_allclose(
            table.cross_section(near), table.cross_section(near[0]), rtol=1e-7
        )
        # 1.6e-5 rad away, where the slope is some 1e3 as large
        assert np.max(abs(table.linearize(near)[1])) < 0.1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0, 1], [1, 1]), "once around; none from 57.2958 to 360 deg"),
        ((np.arange(4) * np.pi / 2, [1, 1, 1]), "shape"),
        ((np.arange(4) * np.pi / 2, [1, 1, 1, 0]), "rcs must be from"),
        ((np.arange(4) * np.pi / 2 - 4, [1, 1, 1, 1]), "between -pi and 2 pi"),
        (([[0, 1]], [1, 1]), "shape"),
        (([0, 1, np.nan, 3], [1] * 4), "finite"),
        ((np.arange(4) * np.pi / 2, np.ones((4, 2)), [0, 2]), "a gap in elevation, from 0 to"),
        ((np.arange(4) * np.pi / 2, np.ones(4), None, -1), "envelope"),
        ((np.arange(4) * np.pi / 2, np.ones(4), None, 1.6), "envelope in degrees"),
        ((np.arange(4) * np.pi / 2, [[1, 1], [2, 1], [1, 1], [1, 1]], [-np.pi / 2, 0]), "below"),
    ],
)
def test_bad_arrays_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        rs.TableRCS(*arguments)


A = ["azimuth_deg,rcs_m2"]
#: A cut of 0.5 m².
CUT = [*A, *(f"{a},0.5" for a in range(-180, 180, 30))]


def flat(low, high, step=2):
    """Rows of a table of 1 m² between two elevations [deg]."""
    rows = [f"{a},{e},1" for a in range(0, 360, 30) for e in range(low, high + 1, step)]
    return ["azimuth_deg,elevation_deg,rcs_m2", *rows]


def write(path, *rows):
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")


#: The RCS of a scenario by a table.
ENTRY = {"model": "table", "file": "t.csv"}


def test_mirror_and_envelope_are_read(here):
    write(here / "t.csv", *A, *(f"{a},{1 + (a == 90)}" for a in range(0, 181, 5)))
    s = scenario(aircraft__rcs={**ENTRY, "mirror": True, "envelope_deg": 15})
    rcs, recorded = s.radars[0].model.rcs, s.resolved()["aircraft"]["rcs"]
    assert rcs.envelope == pytest.approx(15 * DEG)
    assert (recorded["mirror"], recorded["envelope_deg"]) == (True, 15)
    wings = pattern(rcs, np.array([75.0, 90, 105, -75, -90, -105]), np.zeros(1))
    np.testing.assert_allclose(wings, 2, rtol=2e-12)


def test_a_table_that_the_geometry_leaves_is_refused(here):
    write(here / "t.csv", *flat(-10, 30, 10))
    scenario(aircraft__rcs=ENTRY)
    says = "at azimuth 0 deg the aircraft sees the radar at elevation -31 deg, the RCS table covers"
    with pytest.raises(rs.InputError, match=f"geometry: {says} -10 to 30 deg"):
        scenario(aircraft__rcs=ENTRY, geometry__down_km=-300)
    # Banked by 20 degrees the right wing's side of the orbit is too low.
    with pytest.raises(rs.InputError, match="covers -10 to 30 deg"):
        scenario(aircraft__rcs=ENTRY, aircraft__attitude_deg=[-20, 0, 90])
    write(here / "t.csv", *CUT)
    scenario(aircraft__rcs=ENTRY, geometry__down_km=-300)  # a cut is for all elevations


def test_the_script_makes_the_synthetic_table(here):
    made = runpy.run_path(str(CONFIGS / "make_synthetic_aircraft.py"))["text"]()
    there = (CONFIGS / "synthetic_aircraft.csv").read_text(encoding="utf-8")
    # What is printed is rounded to 0.01 dB: another library of sines could turn a last digit.
    old, new = (text.splitlines() for text in (there, made))
    assert old[:3] == new[:3]
    assert "SYNTHETIC" in old[0]
    values = [np.array([row.split(",") for row in rows[3:]], dtype=float) for rows in (old, new)]
    np.testing.assert_allclose(*values, atol=0.0101)


def test_the_numbers_in_the_comment_of_the_table_scenario():
    """The numbers in the comment of configs/table.yaml, by first order."""
    s = rs.load_scenario(CONFIGS / "table.yaml")
    budget = rs.analyses.budget(s, method="linear")
    assert budget.summary["largest_three_sigma_total"]["theta_r_deg"] == [147.5]
    assert budget.summary["largest_three_sigma_total"]["value"] == pytest.approx(1.65, abs=5e-3)
    shares = budget.summary["shares_at_largest"]
    assert shares["aircraft_orientation"] == pytest.approx(0.998, abs=5e-4)
    mc = analyses.montecarlo(s, method="linear")
    assert mc.summary["coverage_lowest"]["theta_r_deg"] == 145
    assert mc.summary["coverage_lowest"]["value"] == pytest.approx(0.43, abs=0.08)
    pose = 290
    assert 3 * mc.table["sigma_pd"][pose] == pytest.approx(0.003, abs=5e-4)
    assert [w for w in mc.warnings if w.startswith("the linear band is off at ")]
    table = rs.load_rcs_table(CONFIGS / "synthetic_aircraft.csv", mirror=True, envelope=3 * DEG)
    enveloped = rs.DetectionModel(rcs=table, p_fa=s.model.radars[0].model.p_fa)
    assert s.model.p_d(s.aircraft, s.radar).mean() == pytest.approx(0.31, abs=5e-3)
    assert enveloped.p_d(s.aircraft, s.radar).mean() == pytest.approx(0.42, abs=5e-3)


def test_the_command_writes_a_table_that_can_be_read_again(tool, tmp_path):
    code, out, _ = tool("rcs", "--no-plot")
    assert code == 0
    assert "RCS in the geometry" in out
    table = rs.load_rcs_table("figures/paper_rcs.csv")
    model = rs.load_scenario().radars[0].model.rcs
    azimuth = np.arange(-180.0, 180, 0.5)
    for elevation in (0.0, -12.5, 40):
        direct = pattern(model, azimuth, np.array(elevation))
        found = pattern(table, azimuth, np.array(elevation))
        np.testing.assert_allclose(found, direct, rtol=1e-4)
    record = read_record("figures/paper_rcs.json")
    assert record["summary"]["geometry"]["elevation_deg"] == pytest.approx([-0.344] * 2, abs=1e-3)
    nose = np.pi * (0.15 * 0.13 / 0.21) ** 2
    assert record["summary"]["smallest"]["rcs_m2"] == pytest.approx(nose, rel=1e-12)


def test_the_summary_of_the_rcs():
    """Straight above, which has no azimuth, is the end of the longest axis."""
    up = directions(np.arange(-180.0, 180, 30), np.array(90.0))
    np.testing.assert_array_equal(up, np.tile([0, 0, -1], (12, 1)))
    rcs = {"model": "ellipsoid_exact", "x_m": 0.2, "y_m": 0.15, "z_m": 0.3}
    result = analyses.rcs(scenario(aircraft__rcs=rcs))
    smallest, largest = result.summary["smallest"], result.summary["largest"]
    assert smallest["rcs_m2"] == pytest.approx(np.pi * (0.2 * 0.15 / 0.3) ** 2, rel=1e-14)
    assert abs(smallest["elevation_deg"]) == 90
    assert result.report[1].endswith(" dBsm straight below and above")
    assert largest["rcs_m2"] == pytest.approx(np.pi * (0.2 * 0.3 / 0.15) ** 2, rel=1e-14)
    assert (abs(largest["azimuth_deg"]), largest["elevation_deg"]) == (90, 0)
    angle = np.deg2rad(np.arange(0.0, 360, 1))
    support = (0.2 * np.cos(angle)) ** 2 + (0.15 * np.sin(angle)) ** 2
    mean = np.mean(np.pi * (0.2 * 0.15 * 0.3) ** 2 / support**2)
    assert result.summary["horizon_mean_m2"] == pytest.approx(mean, rel=1e-12)


def test_a_written_table_has_one_value_at_each_pole(here):
    """Splines round it by azimuth; an envelope of one last row may have two deviations there."""
    rng, azimuth, elevation = np.random.default_rng(1), np.arange(-180, 180, 30), [-90, -30, 30, 90]
    ends = {-90: -5, 90: 20}
    level = [(a, e, ends.get(e, rng.normal(-10, 2))) for a in azimuth for e in elevation]
    short = [[a, e, -8.0, 1 + (a < 0)] for a in azimuth for e in (-30, 30)]
    for name, lines, end in (
        ("azimuth_deg,elevation_deg,rcs_dbsm", level, 90),
        ("azimuth_deg,elevation_deg,rcs_dbsm,std_db", short, 89.9),
    ):
        (here / "t.csv").write_text(csv_text(name, lines))
        rcs = ENTRY | ({} if end == 90 else {"envelope_deg": 3})
        found = analyses.rcs(scenario(aircraft__rcs=rcs)).table
        assert np.ptp(found["elevation_deg"]) == pytest.approx(2 * end)
        for pole in (-90, 90):
            values = found["rcs_m2"][found["elevation_deg"] == pole]
            assert np.all(values == values[:1])


class Flat:
    """A cross section of one's own, which returns views that cannot be written."""

    isotropic, detail = False, 3.0

    def cross_section(self, v):
        return np.broadcast_to(0.1, np.shape(v)[:-1])

    def linearize(self, v):
        return self.cross_section(v), np.zeros(np.shape(v))


def test_a_cross_section_of_ones_own_may_be_read_only():
    s = scenario()
    own = dataclasses.replace(s.radars[0], model=rs.DetectionModel(Flat(), p_fa=1e-4))
    table = analyses.rcs(dataclasses.replace(s, radars=(own,))).table
    assert np.all(table["rcs_m2"] == 0.1)


def elevations_within_3_sigma(pose, s):
    """Return the least and the greatest elevation [deg] within 3σ, to first order."""
    states = np.concatenate([pose, s.radar])
    deviations = np.sqrt(np.concatenate([np.diag(s.cov_aircraft), np.diag(s.cov_radar)]))

    def elevation(states):
        x, y, z = np.moveaxis(body_vector(states[..., :6], states[..., 6:]), -1, 0)
        return np.arctan2(-z, np.hypot(x, y))

    steps = 1e-4 * np.diag(deviations)
    slopes = (elevation(states + steps) - elevation(states - steps)) / 2e-4
    return (elevation(states) + 3 * np.linalg.norm(slopes) * np.array([-1, 1])) / DEG


def test_poses_beyond_the_table_are_counted(here):
    change = {
        "aircraft__rcs": ENTRY,
        "geometry__azimuth_deg": {"start": 0, "stop": 40, "step": 10},
        "uncertainty__aircraft": {"position_m": 10, "attitude_deg": [3, 1, 1]},
    }
    write(here / "t.csv", *flat(-30, 30))
    s = scenario(**change)
    ends = np.array([elevations_within_3_sigma(pose, s) for pose in s.aircraft])
    least, greatest = np.sort(ends, axis=0).T
    for count in range(1, 5):
        end, other = least[count - 1 : count + 1].mean(), greatest[4 - count : 6 - count].mean()
        for low, high in ((end, 30), (-30, other)):
            rows = [(a, e, 1) for a in range(0, 360, 30) for e in np.linspace(low, high, 9)]
            (here / "t.csv").write_text(csv_text("azimuth_deg,elevation_deg,rcs_m2", rows))
            (line,) = table_warnings(scenario(**change))
            beyond = (ends[:, 0] < low) | (ends[:, 1] > high)
            assert np.count_nonzero(beyond) == count
            reach = f"at {least[0]:.1f} to {greatest[-1]:.1f} deg"
            assert f"are {reach}, beyond it {describe_poses(beyond, s.axis)};" in line
    write(here / "t.csv", *flat(-2, 30))
    s = scenario(**change)
    for analysis in (analyses.variance, analyses.sensitivity, analyses.budget):
        assert any("beyond it at all 5 poses" in warning for warning in analysis(s).warnings)
    write(here / "t.csv", *flat(-10, 30))
    assert not any("RCS table" in w for w in analyses.montecarlo(scenario(**change)).warnings)
    write(here / "t.csv", *flat(-90, 90))  # nothing is beyond straight below
    above = {**change, **OVERHEAD, "aircraft__attitude_deg": [2, 1, 0]}
    assert not [*table_warnings(scenario(**above))]


@pytest.mark.parametrize(("lobes", "warned"), [(4, False), (360, False), (99_999, True)])
def test_fine_lobes_are_in_extremes_mean_and_table(lobes, warned):
    rcs = {"model": "spikeball", "lobes": lobes, "amplitude_m2": 10, "floor_m2": 0.01}
    result = analyses.rcs(scenario(aircraft__rcs=rcs))
    assert any("[rcs-fine]" in text for text in result.warnings) == warned
    if not warned:
        assert result.summary["largest"]["rcs_m2"] == pytest.approx(10.01, rel=1e-3)
        assert result.summary["horizon_mean_m2"] == pytest.approx(0.01 + 20 / np.pi, rel=0.02)
        assert result.table["rcs_m2"].max() == result.summary["largest"]["rcs_m2"]


def test_what_elevations_may_miss_is_warned_of(here):
    """Of an ellipsoid narrow in elevation, not of a spikeball, and not of a flat table."""
    plate = {"model": "ellipsoid_exact", "x_m": 0.1, "y_m": 0.1, "z_m": 0.7}
    (text,) = analyses.rcs(scenario(aircraft__rcs=plate)).warnings
    assert text.startswith("the RCS may have lobes of 8.2 deg, and the table has steps of 5 deg")
    assert text.endswith("in elevation: it may miss lobes, and so may the extremes [rcs-fine]")
    # fine elevations of a table do not cost it its azimuths
    rows = [f"{a},{e},{1 + a % 7}" for a in range(0, 360, 30) for e in (-0.36, -0.35, -0.34, -0.33)]
    write(here / "t.csv", "azimuth_deg,elevation_deg,rcs_m2", *rows)
    result = analyses.rcs(scenario(aircraft__rcs=ENTRY))
    assert len(np.unique(result.table["azimuth_deg"])) == 360


@pytest.mark.parametrize(("step", "top"), [(5, 30), (7, 23), (7, 16)])
def test_the_extremes_of_a_table_are_within_it_and_none_is_missed(here, step, top):
    """Beyond it the outermost values hold, which nobody has measured."""
    nodes = [(a, e) for a in range(0, 360, 30) for e in range(-5, 31, step)]
    rows = (f"{a},{e},{100 if (a, e) == (30, top) else 1}" for a, e in nodes)
    write(here / "t.csv", "azimuth_deg,elevation_deg,rcs_m2", *rows)
    result = analyses.rcs(scenario(aircraft__rcs=ENTRY))
    assert result.report[0] == f"largest RCS 20.0 dBsm at azimuth 30 deg, elevation {top} deg"
    assert result.table["rcs_m2"].max() == pytest.approx(100, rel=1e-9)
    assert result.warnings == ()
