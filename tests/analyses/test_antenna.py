"""The gain of an antenna over elevation and a mask of terrain, against formulas of their own."""

import dataclasses
import itertools
import math

import chain_rule
import numpy as np
import pytest
from helpers import csv_text, document, one_line, scenario, slopes, yaml_text
from numpy.testing import assert_allclose
from routes import GEO
from scenario_file.earth import to_ned
from scipy.constants import Boltzmann
from scipy.interpolate import PchipInterpolator
from scipy.stats import norm

import radar_sense as rs
from radar_sense.analyses.check import overview
from radar_sense.errors import InputError
from radar_sense.model.geometry import radar_from_aircraft
from radar_sense.model.radar import ALWAYS, NEVER, Vicinity
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import load_scenario
from radar_sense.sources import error_budget

P_FA, C_R, AREA, DISTANCE = 1e-6, 40.0, 0.09, 300e3
SPHERE = {"model": "constant", "rcs_m2": AREA}
GAIN = [(-4, -12), (-1, -2), (1, 0), (2, -1), (4, -8), (9, -20)]
AT_10 = {"start": 10, "stop": 10, "step": 1}
MASK = [(0, 0.2), (40, 1.5), (90, 0.4), (200, 3.0), (300, -1.0), (360, 0.2)]


def files(folder, gain=GAIN, mask=MASK):
    (folder / "gain.csv").write_text(csv_text("elevation_deg,gain_db", gain))
    (folder / "mask.csv").write_text(csv_text("azimuth_deg,elevation_deg", mask))


def made(folder, **changes):
    """The paper's scenario with a sphere, at few poses, with changes; files are in the folder."""
    radar = {"position_m": [0, 0, 0], "constant": C_R, "p_fa": P_FA}
    given = document(aircraft__rcs=SPHERE, radar=radar, geometry__azimuth_from="north")
    given["geometry"] |= {"range_km": DISTANCE / 1e3, "down_km": -8}
    given["geometry"]["azimuth_deg"] = {"start": 0, "stop": 340, "step": 20}
    return loaded(folder, document(given, **changes))


def loaded(folder, content):
    (folder / "my.yaml").write_text(yaml_text(content))
    return load_scenario(folder / "my.yaml")


def curve(x, elevation, gain_db):
    """SciPy's monotone cubic, flat beyond the first node and the last."""
    first, *_, last = elevation
    nodes = np.array([2 * first - elevation[1], *elevation, 2 * last - elevation[-2]])
    return PchipInterpolator(nodes, np.pad(gain_db, 1, mode="edge"))(np.clip(x, first, last))


def cubic(x, nodes):
    """The gain [dB] at an elevation."""
    return float(curve(x, *np.array(nodes, dtype=float).T))


def p_d_at(place, tilt_deg=0.0):
    """P_D at north, east, down of the aircraft, of a radar at the origin, by formulas."""
    north, east, down = place
    level = math.hypot(north, east)
    decibels = cubic(math.degrees(math.atan2(-down, level)) - tilt_deg, GAIN)
    snr = C_R * AREA / (Boltzmann * (level**2 + down**2) ** 2) * 10 ** (2 * decibels / 10)
    return chain_rule.north(snr, P_FA)


@pytest.mark.parametrize("tilt", [0.0, 1.5])
def test_the_gain_counts_there_and_back(tmp_path, tilt):
    files(tmp_path)
    for down in (-1, -8, -20, -60, 6):
        at = {"geometry__down_km": down, "geometry__azimuth_deg": AT_10}
        s = made(tmp_path, radar__elevation_gain="gain.csv", radar__tilt_deg=tilt, **at)
        expected = p_d_at(s.aircraft[0, :3], tilt_deg=tilt)
        assert_allclose(s.model.p_d(s.aircraft, s.radar), expected, rtol=1e-9, atol=1e-15)
        plain = made(tmp_path, **at).model
        ratio = s.model.snr(s.aircraft, s.radar) / plain.snr(s.aircraft, s.radar)
        elevation = math.degrees(math.atan2(-down, DISTANCE / 1e3)) - tilt
        assert_allclose(ratio, 10 ** (2 * cubic(elevation, GAIN) / 10), rtol=1e-12)


def random_model(rng):
    elevation = np.sort(rng.uniform(-0.3, 1.2, 9))
    axes, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    gain = rs.ElevationGain(elevation, -rng.uniform(0, 30, 9), 0.02, axes=axes)
    rcs = rs.EllipsoidRCS(0.2, 0.3, 0.25) if rng.random() < 0.5 else rs.ConstantRCS(0.1)
    attenuation = rs.Attenuation(rng.choice([0.0, 1e-5]))
    return rs.DetectionModel(rcs, P_FA, factors=(attenuation, gain))


@pytest.mark.parametrize("seed", range(4))
def test_the_partials_are_those_of_differences(seed):
    rng = np.random.default_rng(seed)
    model, n = random_model(rng), 60
    aircraft = np.hstack([rng.uniform(-1e5, 1e5, (n, 3)), rng.uniform(-3, 3, (n, 3))])
    place, constant = rng.uniform(-2e3, 2e3, (n, 3)), rng.uniform(30, 300, (n, 1))
    radar = np.hstack([place, constant, 0.05 * rng.standard_normal((n, 3))])
    whole, steps = np.hstack([aircraft, radar]), [1.0] * 3 + [1e-6] * 3 + [1.0] * 3 + [1e-6] * 4
    _, *gradients = model.linearize_probit(aircraft, radar)
    found = slopes(lambda s: model.linearize_probit(s[:, :6], s[:, 6:])[0], whole, steps)
    assert_allclose(np.hstack(gradients), found, rtol=1e-4, atol=2e-9)


def test_a_tilt_is_a_source_of_the_budget(tmp_path):
    files(tmp_path)
    std, certain = 0.5, {"position_m": 0, "attitude_deg": 0}
    low = {"position_m": 0, "constant": 2, "tilt_deg": std}
    uncertain = {"aircraft": certain, "radar": {"low": low}}
    few = {"geometry__azimuth_deg": AT_10, "analysis": {"level": "low"}}
    s = made(tmp_path, radar__elevation_gain="gain.csv", uncertainty=uncertain, **few)
    place, step = s.aircraft[0, :3], 1e-4
    budget = error_budget(s)
    slope = (p_d_at(place, tilt_deg=step) - p_d_at(place, tilt_deg=-step)) / (2 * step)
    by_tilt, by_constant = (budget.sources[f"radar_{n}"].std[0] for n in ("tilt", "constant"))
    assert by_tilt == pytest.approx(abs(slope) * std, rel=1e-6)
    assert budget.total.std[0] == pytest.approx(math.hypot(by_tilt, by_constant), rel=1e-12)


def test_the_gain_is_a_term_of_the_snr(tmp_path):
    files(tmp_path)
    tilt, std = 1.5, 0.5
    low = {"low": {"position_m": 5, "constant": 2, "tilt_deg": std}}
    tilted = {"radar__elevation_gain": "gain.csv", "radar__tilt_deg": tilt}
    s = made(tmp_path, **tilted, uncertainty__radar=low, analysis={"level": "low"})
    table = rs.analyses.detectors(s, p_d=0.9, method="linear").table
    elevation = math.degrees(math.atan2(8e3, DISTANCE))
    gain_db = 2 * cubic(elevation - tilt, GAIN)
    assert gain_db < -1
    assert_allclose(table["term_elevation_gain"], gain_db, rtol=1e-9)
    up, down = (2 * cubic(elevation - tilt - e, GAIN) for e in (1e-4, -1e-4))
    assert_allclose(table["sigma_term_elevation_gain"], abs(up - down) / 2e-4 * std, rtol=1e-5)
    of_sphere = 10 * math.log10(AREA)  # the gain is in no other term
    assert_allclose(table["term_aircraft_rcs"], of_sphere, atol=1e-9)


def lowest(azimuth_deg):
    """The mask at an azimuth, in plain Python."""
    azimuth_deg %= 360.0
    for (a, low), (b, high) in itertools.pairwise(MASK):
        if a <= azimuth_deg <= b:
            return low + (high - low) * (azimuth_deg - a) / (b - a)
    raise AssertionError(azimuth_deg)


def test_a_mask_hides_what_is_below_it(tmp_path):
    files(tmp_path)
    azimuths = {"start": 0, "stop": 359, "step": 1}
    s = made(tmp_path, radar__mask="mask.csv", geometry__azimuth_deg=azimuths)
    assert any(line.endswith(", by mask") for line in overview(s))
    free = made(tmp_path, geometry__azimuth_deg=azimuths)
    elevation = math.degrees(math.atan2(8, DISTANCE / 1e3))
    seen = np.array([elevation >= lowest(a) for a in range(360)])
    assert 100 < seen.sum() < 300
    np.testing.assert_array_equal(s.model.visible(s.aircraft, s.radar)[:, 0], seen)
    p_d = s.model.p_d(s.aircraft, s.radar)
    assert not p_d[~seen].any()
    assert_allclose(p_d[seen], free.model.p_d(s.aircraft, s.radar)[seen], rtol=0)


@pytest.mark.parametrize("origin", [None, (0.8, 0.1, 0.0)])
@pytest.mark.parametrize("masked", [True, False])
def test_sight_is_certain_where_it_says_so(masked, origin):
    """Errors of a standard deviation, which are not alike in all directions."""
    rng = np.random.default_rng(7)
    mask = rs.Mask(np.deg2rad([0.0, 50.0, 180.0, 300.0]), np.deg2rad([1.0, 4.0, -2.0, 0.5]))
    model = rs.DetectionModel(rs.ConstantRCS(1.0), P_FA)
    limits = {"max_range": 8e4, "min_range": 5e3, "horizon": rs.Horizon(origin)}
    radar = rs.Radar(model, mask=mask if masked else None, **limits)
    n = 400
    aircraft = np.zeros((n, 6))
    aircraft[:, :2] = rng.uniform(-7e4, 7e4, (n, 2))
    aircraft[:, 2] = -(10 ** rng.uniform(1, 4.3, n))
    state = np.array([100.0, 50.0, -30.0, 50.0])
    roots = rng.standard_normal((2, n, 3, 3)) * 10 ** rng.uniform(-1, 3, (2, n, 3, 1))
    covariances = roots @ np.swapaxes(roots, -1, -2)
    own = np.tile(state, (n, 1))
    places = zip((aircraft, own), covariances, strict=True)
    sight = radar.sight(*(Vicinity(*place, 1.0) for place in places))
    assert {ALWAYS, NEVER} <= set(sight.tolist())
    for _ in range(400):
        moved = aircraft.copy(), own.copy()
        for states, root in zip(moved, roots, strict=True):
            way = rng.standard_normal((n, 3))
            way *= rng.uniform(0.8, 1.0, (n, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
            states[:, :3] += np.einsum("nij,nj->ni", root, way)
        visible = radar.visible(*moved)
        assert visible[sight == ALWAYS].all()
        assert not visible[sight == NEVER].any()
    # an aircraft that is farther off than away can be in any direction
    below = np.array([0.0, 0.0, 50.0, 0.0, 0.0, 0.0])
    low, high = mask.clearance_within(below, np.zeros(4), *[np.array(100.0)] * 2)
    assert low <= np.deg2rad(-90 - 4)
    assert high >= np.deg2rad(90 + 2)


def towards_the_radar(rng):
    """A level flight over or under a radar at the origin, and the lines; the nearest first."""
    aircraft, bearing = np.zeros((3000, 6)), rng.uniform(0, 2 * math.pi)
    distance = np.geomspace(10, 1e6, len(aircraft))
    aircraft[:, 0], aircraft[:, 1] = distance * np.cos(bearing), distance * np.sin(bearing)
    aircraft[:, 2] = rng.choice([-1, 1]) * 10 ** rng.uniform(2, 4)
    return aircraft, radar_from_aircraft(aircraft, np.zeros(4))


@pytest.mark.parametrize("seed", range(20))
def test_the_gain_rises_no_more_on_the_way_to_the_radar_than_it_says(seed):
    rng = np.random.default_rng(seed)
    elevation = np.unique(np.round(rng.uniform(-60, 80, 12)))
    gain = rs.ElevationGain(np.deg2rad(elevation), rng.uniform(-30, 0, len(elevation)), 0.1)
    aircraft, line = towards_the_radar(rng)
    nepers, rise = gain.nepers(line, np.array(0.02)), gain.rise(line, np.array(0.02), np.zeros(()))
    rises = np.maximum.accumulate(nepers) - nepers
    assert (rises <= rise + 1e-12).all()
    near = aircraft[:, 2] * 6.3e6 > aircraft[:, 0] ** 2 + aircraft[:, 1] ** 2
    assert_allclose(*(x[near | (aircraft[:, 2] < 0)] for x in (rises, rise)), atol=0.01)


@pytest.mark.parametrize("seed", range(8))
def test_a_mask_hides_until_the_line_of_sight_has_turned(seed):
    rng = np.random.default_rng(seed)
    azimuth = np.unique(np.round(rng.uniform(0, 360, 9)))
    mask = rs.Mask(np.deg2rad(azimuth), np.deg2rad(rng.uniform(-60, 70, len(azimuth))))
    aircraft, turned = np.zeros((2, 5000, 6))
    aircraft[:, :3] = rng.standard_normal((len(aircraft), 3))
    clearance = mask.clearance(aircraft, np.zeros(4))
    turn = np.minimum(-0.999 * clearance / mask.steepness, 1.5)
    aside = np.cross(aircraft[:, :3], rng.standard_normal((len(aircraft), 3)))
    aside *= (np.linalg.norm(aircraft, axis=1) / np.linalg.norm(aside, axis=1))[:, np.newaxis]
    turned[:, :3] = aircraft[:, :3] + np.tan(turn)[:, np.newaxis] * aside
    still = mask.clearance(turned, np.zeros(4))[clearance < 0]
    assert still.max() <= 1e-9
    assert still.max() > -0.05


@pytest.mark.parametrize("first_deg", [-180, 0, 30])
def test_a_mask_is_bounded_where_the_azimuth_may_be(first_deg):
    """The bounds are the least and greatest clearance around the aircraft, and no wider."""
    rng = np.random.default_rng(first_deg + 200)
    for _ in range(40):
        last_deg = rng.uniform(first_deg + 20, min(first_deg + 360, 360))
        azimuth = np.sort(rng.uniform(first_deg, last_deg, rng.integers(2, 9)))
        mask = rs.Mask(np.deg2rad(azimuth), np.deg2rad(rng.uniform(-5, 30, len(azimuth))))
        bearing, size = rng.uniform(-np.pi, np.pi), 10 ** rng.uniform(0, 5)
        aircraft = np.zeros((2001, 6))
        aircraft[:, 2] = -(10 ** rng.uniform(0, 4.5))
        level, slant = 1e4, np.hypot(1e4, aircraft[0, 2])
        aside, tilt = (np.arcsin(size / d) if size < d else np.pi for d in (level, slant))
        turn = np.linspace(-1, 1, 2001) * aside
        aircraft[:, 0], aircraft[:, 1] = 1e4 * np.cos(bearing + turn), 1e4 * np.sin(bearing + turn)
        low, high = mask.clearance_within(aircraft[1000], np.zeros(4), *[np.array(size)] * 2)
        around = mask.clearance(aircraft, np.zeros(4))
        elevation = np.arctan2(-aircraft[0, 2], level)
        down = max(-tilt, -np.pi / 2 - elevation)
        up = min(tilt, np.pi / 2 - elevation)
        assert_allclose([low, high], [around.min() + down, around.max() + up], atol=0.02)
        assert low <= around.min() + down + 1e-9
        assert high >= around.max() + up - 1e-9


def test_a_radar_on_earth_has_its_own_vertical(tmp_path):
    """1000 km from the origin the vertical is 9 deg off that of the origin."""
    files(tmp_path)
    place = {"latitude_deg": 50.0, "longitude_deg": 20.0, "altitude_m": 0.0}
    rows = [(0, 50.5, 20.0, 9000), (60, 50.5, 20.1, 9000)]
    (tmp_path / "route.csv").write_text(csv_text(GEO, rows))
    radar = {"position_geodetic": place, "constant": C_R, "p_fa": P_FA}
    origin = {"latitude_deg": 41.0, "longitude_deg": 20.0, "altitude_m": 0}
    s = made(
        tmp_path,
        aircraft={"rcs": SPHERE},
        radar={**radar, "elevation_gain": "gain.csv", "mask": "mask.csv"},
        geometry={"type": "path", "file": "route.csv", "origin": origin},
    )
    north, east, down = to_ned((50.5, 20, 9000), (50, 20, 0))
    elevation = math.atan2(-down, math.hypot(north, east))
    (radar,) = s.radars
    clearance = radar.mask.clearance(s.aircraft[0], radar.state)
    assert clearance == pytest.approx(elevation - math.radians(0.2), abs=1e-9)
    full = dataclasses.replace(radar.model, factors=())
    ratio = radar.model.snr(s.aircraft[0], radar.state) / full.snr(s.aircraft[0], radar.state)
    assert_allclose(ratio, 10 ** (2 * cubic(math.degrees(elevation), GAIN) / 10), rtol=1e-9)


def test_a_file_that_is_another_than_it_was_is_told(tool, tmp_path):
    files(tmp_path)
    made(tmp_path, radar__elevation_gain="gain.csv")
    (tmp_path / "again.yaml").write_text(tool("check", "my.yaml").out)
    files(tmp_path, gain=GAIN[1:])
    error = one_line(tool, "check", "again.yaml")
    assert error.startswith("Error: again.yaml:")
    assert "elevation_gain.sha256: gain.csv is another file than it was" in error


def test_an_antenna_beyond_its_elevations_is_told(tool, tmp_path):
    files(tmp_path, gain=GAIN[:4])
    made(tmp_path, radar__elevation_gain="gain.csv", geometry__down_km=-60)
    done = tool("check", "my.yaml")
    assert done.code == 0
    assert "the gain of an antenna is used up to 9.31 deg beyond its elevations" in done.err
    hidden = tool("check", "my.yaml", "--set", "radar.max_range_km=60")
    assert "no radar sees the aircraft" in hidden.err
    assert "the gain of an antenna" not in hidden.err


@pytest.mark.parametrize(
    ("changes", "given", "message"),
    [
        ({"tilt_deg": 1}, {}, "radar.tilt_deg: needs elevation_gain, the gain that is tilted"),
        ({"mask": "none.csv"}, {}, "none.csv: cannot be read: No such file"),
        ({"mask": {"fill": "x"}}, {}, "radar.mask: unknown key 'fill', allowed: file, sha256"),
        ({"mask": {"file": "my.yaml"}}, {}, "radar.mask.file: "),
        ({"mask": {"file": "my.yaml"}}, {},
         "my.yaml:1: names none of the columns, allowed: azimuth_deg and elevation_deg"),
        ({"elevation_gain": "mask.csv"}, {}, "mask.csv:1: unknown column 'azimuth_deg'"),
        ({"elevation_gain": "gain.csv", "tilt_deg": 100}, {}, "tilt_deg: must be a number not l"),
        ({"elevation_gain": "gain.csv"}, {"gain": [(0, 0), (0, -1)]},
         "gain.csv:3: elevation_deg must ascend from row to row, got 0 after 0"),
        ({"elevation_gain": "gain.csv"}, {"gain": [(0, 0)]}, "gain.csv:1: needs two rows or more"),
        ({"elevation_gain": "gain.csv"}, {"gain": [(0, 33), (1, 30)]},
         "gain.csv:2: gain_db: must be a number not less than -200 and not gre"),
        ({"elevation_gain": "gain.csv"}, {"gain": [(0, 0), (95, -1)]},
         "gain.csv:3: elevation_deg: must be a number not less than -90"),
        ({"mask": "mask.csv"}, {"mask": [(-90, 0), (280, 1)]},
         "mask.csv:3: azimuth_deg must go around: the last row 240 to 360 deg after the first, "
         "got 370"),
        ({"mask": "mask.csv"}, {"mask": [(0, 0), (180, 1)]}, "mask.csv:3: azimuth_deg must go"),
        ({"mask": "mask.csv"}, {"mask": [(0, 0), (10, 2), (20, 4)]}, "mask.csv:4: azimuth_deg m"),
        ({"mask": "mask.csv"}, {"mask": [(0, 0), (90, 2), (360, 1)]},
         "mask.csv:4: must be the same at both ends of a full turn"),
    ],
)  # fmt: skip
def test_keys_and_files_that_are_not_allowed(tmp_path, changes, given, message):
    files(tmp_path, **given)
    with pytest.raises(InputError) as error:
        made(tmp_path, **{f"radar__{key}": value for key, value in changes.items()})
    assert message in str(error.value)


def test_an_uncertain_tilt_needs_a_gain(tmp_path):
    low = {"position_m": 0, "constant": 1, "tilt_deg": 1}
    with pytest.raises(InputError, match="tilt_deg: needs elevation_gain of the radar"):
        made(tmp_path, uncertainty__radar={"low": low}, analysis={"level": "low"})


def test_objects_that_are_not_allowed():
    plain, flat, rain = rs.ConstantRCS(1.0), np.zeros(2), rs.Attenuation(1e-5)
    for gain in ([0.0], [0.0, 3.0], [[0.0, 0.0]]):
        with pytest.raises(InputError, match="gain_db"):
            rs.ElevationGain(np.array([0.0, 0.1]), np.array(gain))
    for wrong, message in (
        (lambda: rs.ElevationGain(np.array([0.1, 0.1]), np.zeros(2)), "elevation must ascend"),
        (lambda: rs.ElevationGain(np.zeros(1), np.zeros(1)), "elevation and gain_db must be two"),
        (lambda: rs.ElevationGain(np.arange(2) / 9, np.zeros(2), 2.0), r"tilt \[deg\] must be"),
        (lambda: rs.Mask(np.array([-3.0, 3.4]), np.zeros(2)), "azimuth must be within one turn"),
        (lambda: rs.Mask(np.array([0, 2 * np.pi]), np.arange(2) / 9), "elevation must be the same"),
        (lambda: rs.Mask(np.arange(2.0), flat, axes=np.ones((3, 3))), "axes must be a rotation"),
        (lambda: rs.DetectionModel(plain, P_FA, factors="a"), "factors must be a tuple, got 'a'"),
        (lambda: rs.DetectionModel(plain, P_FA, factors=(1,)), "each of factors must be a factor"),
        (
            lambda: rs.DetectionModel(plain, P_FA, factors=(rain, rain)),
            "must have a parameter",
        ),
        (lambda: dataclasses.replace(scenario().radars[0], mask=1), "mask must be Mask or None"),
    ):
        with pytest.raises(InputError, match=message):
            wrong()


def random_network(rng):
    """One or two radars with gains, tilts and masks at random, and an aircraft beside them."""
    radars = []
    for name in ("one", "two")[: rng.integers(1, 3)]:
        elevation, gain = np.deg2rad(np.sort(rng.uniform(-8, 30, 8))), -rng.uniform(0, 18, 8)
        antenna = rs.ElevationGain(elevation, gain, np.deg2rad(rng.uniform(-2, 3)))
        azimuth = np.deg2rad(np.sort(rng.uniform(0, 360, 12)))
        mask = rs.Mask(azimuth, np.deg2rad(rng.uniform(-1, 4, 12))) if rng.random() < 0.6 else None
        state = np.array([*rng.uniform(-2e4, 2e4, 2), -50.0, 10 ** rng.uniform(-2.5, 0.0)])
        std = np.array([*[rng.uniform(1, 300)] * 3, state[3] * rng.uniform(0, 0.15)])
        level = rs.Level(np.diag(std**2), errors={"tilt": np.deg2rad(rng.uniform(0, 1))})
        model = rs.DetectionModel(rs.ConstantRCS(AREA), P_FA, factors=(antenna,))
        radars.append(rs.Radar(model, name=name, state=state, levels={"one": level}, mask=mask))
    azimuth, distance = rng.uniform(0, 2 * np.pi), rng.uniform(2e4, 9e4)
    aircraft = np.zeros((1, 6))
    aircraft[0, :2] = distance * np.cos(azimuth), distance * np.sin(azimuth)
    aircraft[0, 2] = -rng.uniform(500, 6000)
    std = [*[rng.uniform(10, 1500)] * 2, rng.uniform(10, 600), 0.01, 0.01, 0.01]
    geometry = rs.States.of(aircraft, np.diag(np.square(std)))
    return rs.Scenario(radars=tuple(radars), geometry=geometry, seed=int(rng.integers(1e6)))


def own_draws(scenario, rng, runs):
    """Draws of P_D of a network by formulas, with SciPy's monotone cubic."""
    aircraft = scenario.aircraft[0, :3] + rng.standard_normal((runs, 3)) * np.sqrt(
        np.diag(scenario.cov_aircraft)[:3]
    )
    missed = np.ones(runs)
    for radar in scenario.radars:
        level, (gain,) = radar.levels["one"], radar.model.factors
        state = radar.state + rng.standard_normal((runs, 4)) * np.sqrt(np.diag(level.covariance))
        north, east, down = (aircraft - state[:, :3]).T
        across = np.hypot(north, east)
        tilt = gain.tilt + level.errors["tilt"] * rng.standard_normal(runs)
        elevation = np.arctan2(-down, across)
        decibels = curve(elevation - tilt, gain.elevation, gain.gain_db)
        snr = np.maximum(state[:, 3], 0) * AREA / (Boltzmann * (across**2 + down**2) ** 2)
        snr = snr * 10 ** (2 * decibels / 10)
        p_d = chain_rule.north(snr, P_FA)
        if radar.mask is not None:
            low = np.interp(
                np.arctan2(east, north), radar.mask.azimuth, radar.mask.elevation, period=2 * np.pi
            )
            p_d = np.where(elevation >= low, p_d, 0.0)
        missed *= 1 - p_d
    return 1 - missed


@pytest.mark.all_draws
@pytest.mark.parametrize("seed", range(5))
def test_bands_of_random_antennas_and_masks_are_those_of_draws(seed):
    rng = np.random.default_rng(seed)
    scenario = random_network(rng)
    draws = own_draws(scenario, rng, 200_000)
    found = propagate_scenario(scenario)
    ranks = norm.cdf([-3, 3])
    error = np.quantile(draws.reshape(8, -1), ranks, axis=1).std(axis=1, ddof=1) / math.sqrt(8)
    allowed = 0.005 + 4 * np.hypot(error, found.error)
    off = abs(np.concatenate([found.lower, found.upper]) - np.quantile(draws, ranks))
    assert np.all(off < allowed)
    assert found.mean[0] == pytest.approx(draws.mean(), abs=0.005)
