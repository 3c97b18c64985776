"""Warnings of scenarios that are allowed but implausible, by every analysis and by `check`."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import csv_text, document, scenario, with_arrays, write_path
from routes import GEO, HEAD

import radar_sense as rs
from radar_sense.plausibility import plausibility_warnings
from radar_sense.scenario_file.load import parse_scenario

ROUTE = (
    "time_s,north_m,east_m,down_m\n0,300000,0,-9000\n20,300000,4000,-9000\n40,300000,8000,-9000\n"
)
ORIGIN = {"latitude_deg": 47.3, "longitude_deg": 8.5, "altitude_m": 400}


def of_route(folder, text, **changes):
    return plausibility_warnings(rs.load_scenario(write_path(folder, text, **changes)))


def geodetic(folder, lat=46.5, lon=9.0, alt=9000, middle=None, **changes):
    """Warnings of three rows with latitude and longitude, of which one may be at another height."""
    heights = enumerate((alt, alt if middle is None else middle, alt))
    text = csv_text(GEO, [(20 * i, lat, lon + 0.05 * i, height) for i, height in heights])
    path = {"type": "path", "file": "route.csv", "origin": ORIGIN}
    return of_route(folder, text, geometry=path, **changes)


def test_ordinary_scenarios_have_no_warning(tmp_path):
    assert plausibility_warnings(scenario()) == ()
    assert of_route(tmp_path, ROUTE) == ()
    assert geodetic(tmp_path) == ()
    # a height below its deviation, as of a flight that lands
    assert of_route(tmp_path, ROUTE.replace("-9000", "-8", 1).replace("-9000", "-12")) == ()
    # low flight below a radar on a mountain
    on_mountain = scenario(radar__position_m=[0, 0, -2500], geometry__down_km=-0.3)
    assert plausibility_warnings(on_mountain) == ()


@pytest.mark.parametrize(
    ("second", "third", "starts", "says"),
    [
        ("0.333", "0.667", "the aircraft flies at up to 12", "km/s, after 0 s: is time_s in secon"),
        ("20000", "4e4", "the aircraft flies at 0.2 m/s at most: are times in seconds, speeds", ""),
    ],
    ids=["minutes", "milliseconds"],
)
def test_times_in_another_unit(tmp_path, second, third, starts, says):
    text = ROUTE.replace("\n20,", f"\n{second},").replace("\n40,", f"\n{third},")
    (warning,) = of_route(tmp_path, text)
    assert warning.startswith(starts)
    assert says in warning


@pytest.mark.parametrize("step", [None, 40])
def test_one_row_in_another_place_is_seen_at_any_step(tmp_path, step):
    between = {} if step is None else {"interpolate": {"step_s": step}}
    path = {"type": "path", "file": "route.csv", **between}
    swapped = ROUTE.replace("300000,4000", "4000,3000000")
    fast, *_ = of_route(tmp_path, swapped, geometry=path)
    assert "the aircraft flies at up to 151 km/s, after 0 s:" in fast


@pytest.mark.parametrize(
    ("place", "says"),
    [
        (lambda t: (300000 + 60 * (t % 2), 200 * t, -9000), "banks by up to 88.2 deg"),  # rounded
        (lambda t: (300000 + 0.2 * t, 0, -900 - 2 * t), "climbs or dives by up to 84.3 deg"),
    ],
)
def test_a_steep_bank_or_climb(tmp_path, place, says):
    warnings = of_route(tmp_path, csv_text(HEAD, [(t, *place(t)) for t in range(20)]))
    (steep,) = [text for text in warnings if "-steep]" in text]
    assert steep.startswith(f"the aircraft {says} at all 20 poses: if ")


@pytest.mark.parametrize(("noise", "told"), [(0.3, True), (0.02, False)])
def test_a_recorded_hover_is_noise(tmp_path, noise, told):
    """40 s to the place, 60 s on the spot, and on; the places are off by the noise [m]."""
    rng = np.random.default_rng(4)
    rows = [
        (t, 1e4 + 20 * min(t, 40) + 20 * max(0, t - 100) + noise * rng.normal(), noise * n, -900)
        for t, n in enumerate(rng.normal(size=141))
    ]
    warnings = of_route(tmp_path, csv_text(HEAD, rows))
    found = [text for text in warnings if "[course-noisy]" in text]
    assert bool(found) == told
    if told:
        assert found[0].startswith("the course turns by more than 120 deg in ")


SWAPPED = {"latitude_deg": 8.5, "longitude_deg": 47.3, "altitude_m": 400}


def test_swapped_latitude_and_longitude(tmp_path):
    """Of the route, of the origin, and of the radar."""
    far, _ = geodetic(tmp_path, lat=9.0, lon=46.5)  # so far that there is no signal either
    assert far.endswith("units, and latitude and longitude in their order? [too-far]")
    path = {"type": "path", "file": "route.csv", "origin": SWAPPED}
    radar = {"position_geodetic": ORIGIN, "constant": 1e6, "p_fa": 1e-6}
    text = csv_text(GEO, [(20 * i, 46.5, 9 + 0.05 * i, 9000) for i in range(3)])
    far, *_ = of_route(tmp_path, text, geometry=path, radar=radar)
    assert far.startswith("the aircraft is at least ")
    assert "km from the origin: are positions" in far
    texts = geodetic(tmp_path, radar={**radar, "position_geodetic": SWAPPED})
    assert "km from the radar: are positions in their units, and latitude and" in "".join(texts)


@pytest.mark.parametrize(("km", "far"), [(1190, False), (1210, True)])
def test_a_network_of_which_one_radar_is_elsewhere(km, far):
    """The nearest pose is 500 km east: 1303 km away it is beyond the horizon of any aircraft."""
    s = scenario()
    (radar,) = s.radars
    there = dataclasses.replace(radar, name="there", state=np.array([-1e3 * km, 0, 0, 167]))
    s = dataclasses.replace(s, radars=(dataclasses.replace(radar, name="here"), there))
    assert ("km from radar there: are" in "".join(plausibility_warnings(s))) == far


def test_below_the_ellipsoid(tmp_path):
    """No sea is 108 m below the ellipsoid, but valleys with a radar are."""
    (warning,) = geodetic(tmp_path, alt=-108)
    assert "108 m below the ellipsoid" in warning
    one_row = geodetic(tmp_path, alt=300, middle=-700)
    assert any("700 m below the ellipsoid" in warning for warning in one_row)
    assert geodetic(tmp_path, alt=-106) == ()
    there = {"latitude_deg": 46.4, "longitude_deg": 8.9, "altitude_m": -430}
    radar = {"position_geodetic": there, "constant": 10, "p_fa": 1e-6}
    assert not any("below" in text for text in geodetic(tmp_path, alt=-400, radar=radar))


CERTAIN = {"uncertainty__radar__medium__constant": 0}
#: A line from 10 km, where P_D is 1, to 1000 km, where it is that without a signal.
OUTWARD = {
    "type": "radial",
    "azimuth_deg": 0,
    "down_km": -3,
    "range_km": {"start": 10, "stop": 1000, "step": 990},
}


def away(km):
    return {"geometry__range_km": km, "radar__constant": 1e6}


def sigma(metres):
    return {"uncertainty__aircraft__position_m": metres}


def sigma_of_constant(value, level="medium"):
    return {f"uncertainty__radar__{level}__constant": value}


#: An implausible scenario, its only warning, and one that is still plausible.
IMPLAUSIBLE = [
    (
        {"geometry__down_km": 3},
        "the aircraft is 3000 m below the origin and below every radar at all 361 poses",
        {"geometry__down_km": 3, "radar__position_m": [0, 0, 3100]},
    ),
    (
        {"radar__max_range_km": 100},
        "no radar sees the aircraft at a nominal pose: see max_ra",
        {"geometry": OUTWARD, "radar__constant": 0.01, **CERTAIN},
    ),
    (away(1310), "the aircraft is at least 1310 km from the radar: are positions", away(1300)),
    (
        {"geometry__down_km": -3000, **sigma(1), "radar__constant": 1e6},
        "the aircraft is up to 3000 km above the origin: is the height in its unit? [too-high]",
        {},
    ),
    (
        sigma(3001),
        "sigma of the height, 3001 m, is above the height at all poses, 3000 m above the origin at "
        "most: are both in their units? [uncertainty-large]",
        sigma(2999),
    ),
    (
        {"uncertainty__aircraft__attitude_deg": [1, 1, 104]},
        "sigma of the attitude, 104 deg, is above that of an angle of which nothing is known",
        {"uncertainty__aircraft__attitude_deg": [1, 1, 103]},
    ),
    (
        sigma_of_constant(83.5),
        "c_r of the radar is 167 with sigma 83.5 at the level medium, so it counts as 0 in 2.3% of "
        "the cases, as without a signal: give tolerances in dB, or check the units "
        "[constant-clipped]",
        sigma_of_constant(55),
    ),
    # of the level in use only
    (
        sigma_of_constant(168),
        "c_r of the radar is 167 with sigma 168 at the level medium, so it counts as 0 in 16.0%",
        sigma_of_constant(168, "high"),
    ),
    (  # P_D above its floor by a tenth of it is no reason
        {"radar__constant": 0.01, **CERTAIN},
        "P_D is at its floor at all poses, 0.00",
        {"radar__constant": 10, **CERTAIN},
    ),
    (
        {"radar__position_m": [0, 0, 30], "radar__horizon": True, "geometry__range_km": 200},
        "the radar is 30 m below the origin, which is the ground of the horizon",
        {"radar__position_m": [0, 0, 0], "radar__horizon": True, "geometry__range_km": 200},
    ),
]


@pytest.mark.parametrize(("implausible", "says", "plausible"), IMPLAUSIBLE)
def test_numbers_in_another_unit_are_warned_of(implausible, says, plausible):
    (warning,) = plausibility_warnings(scenario(**implausible))
    assert warning.startswith(says)
    assert plausibility_warnings(scenario(**plausible)) == ()


@pytest.mark.parametrize(
    ("typed", "shown"), [("frequency_ghz: 9000", "9000 GHz"), ("wavelength_m: 3.3e-5", "9085 GHz")]
)
def test_a_frequency_that_no_radar_has(typed, shown):
    text = Path("configs/x_band_tracking.yaml").read_text()
    warnings = plausibility_warnings(parse_scenario(text.replace("frequency_ghz: 9", typed, 1)))
    assert warnings[-1] == (
        f"a radar at {shown}: radars are at 0.003 to 300 GHz, is the unit right? [frequency-odd]"
    )
    assert plausibility_warnings(parse_scenario(text)) == ()


SCANNING = "configs/s_band_surveillance.yaml"


def test_a_surveillance_radar_looks_once_a_scan():
    (radar,) = rs.load_scenario(SCANNING).radars
    assert radar.scan_period == pytest.approx(60 / 12.5)
    (other,) = rs.load_scenario(SCANNING, {"radar.scan_period_s": 10}).radars
    assert other.scan_period == 10


@pytest.mark.parametrize(("period", "warned"), [(4.75, False), (4.85, False), (10, True)])
def test_looks_at_other_intervals_than_the_scans(period, warned):
    warnings = plausibility_warnings(rs.load_scenario(SCANNING, {"radar.scan_period_s": period}))
    assert warnings[:1] == warned * (
        "the radar looks every 10 s, by scan_period_s, and its data sheet has scans of 4.8 s: c_r "
        "has the energy of a scan [scan-differs]",
    )


def test_a_step_longer_than_the_route(tmp_path):
    path = {"type": "path", "file": "route.csv", "interpolate": {"step_s": 41}}
    (warning,) = of_route(tmp_path, ROUTE, geometry=path)
    assert warning == (
        "geometry.interpolate has a step of 41 s, longer than the route of 40 s: no pose is added "
        "[step-long]"
    )
    path["interpolate"] = {"step_s": 40}
    assert of_route(tmp_path, ROUTE, geometry=path) == ()
    alone = rs.load_scenario(tmp_path / "scenario.yaml").at_poses(slice(1))
    assert plausibility_warnings(alone) == ()


def test_the_radar_constant_that_is_known_worst_is_named():
    (radar,) = scenario().radars
    level = dataclasses.replace(radar.levels["medium"], covariance=np.diag([1, 1, 1, 0.25]))
    weak = {"state": np.array([0, 0, 0, 1.0]), "levels": {"medium": level}}
    strong = dataclasses.replace(radar, name="strong", levels={"medium": radar.levels["medium"]})
    radars = (strong, dataclasses.replace(radar, name="weak", **weak))
    (warning,) = plausibility_warnings(dataclasses.replace(scenario(), radars=radars))
    assert warning.startswith("c_r of radar weak is 1 with sigma 0.5 at the level medium")


def test_a_path_in_place_of_the_poses_of_a_file():
    given, path = scenario(), rs.load_scenario("configs/path.yaml")
    assert plausibility_warnings(dataclasses.replace(given, geometry=path.geometry)) == ()


def test_rows_far_apart(tmp_path):
    far = "time_s,north_m,east_m,down_m\n0,-300000,90000,-9000\n3000,300000,90000,-9000\n"
    (warning,) = of_route(tmp_path, far)
    assert warning.startswith("rows of the path are up to 3000 s apart")
    assert "in 1 of 1 steps; add poses between the rows with geometry.interpolate" in warning
    filled = {"type": "path", "file": "route.csv", "interpolate": {"step_s": 1000}}
    assert of_route(tmp_path, far, geometry=filled) == ()


def test_every_analysis_warns_once_and_check_too(tool):
    few = {"start": 40, "stop": 60, "step": 20}
    below = document(geometry__down_km=3, geometry__azimuth_deg=few)
    Path("my.yaml").write_text(yaml.safe_dump(below))
    for command in ("variance", "sensitivity", "budget", "montecarlo --runs 20", "check"):
        options = ["--no-plot"] if command != "check" else []
        done = tool(*command.split(), "my.yaml", *options)
        assert done.code == 0
        assert done.err.count("below every radar") == 1
    assert "below" not in done.out
    assert tool("check").err == ""


def test_a_table_without_elevations_is_used_far_from_the_horizon(tmp_path):
    around = range(-180, 180, 30)
    (tmp_path / "t.csv").write_text(csv_text("azimuth_deg,rcs_m2", [(a, 0.5) for a in around]))
    rcs = {"model": "table", "file": str(tmp_path / "t.csv")}
    level = scenario(aircraft__rcs=rcs)
    assert plausibility_warnings(level) == ()
    high = scenario(aircraft__rcs=rcs, geometry__down_km=-90, geometry__range_km=150)
    steepest = math.degrees(math.atan(90 / 150))
    (warning,) = plausibility_warnings(high)
    assert warning.startswith(
        f"the RCS table has no elevations and is used at up to {steepest:.3g} deg above or below"
    )
    banked = scenario(aircraft__rcs=rcs, aircraft__attitude_deg=[20, 0, 90])
    (warning,) = plausibility_warnings(banked)
    # Banked by 20 deg with the radar abeam, 0.34 deg below, off the upper wing.
    assert "is used at up to 19.7 deg above or below the aircraft at 51 to 129 deg" in warning
    with_elevations = {**rcs, "file": str(tmp_path / "e.csv")}
    rows = [(a, e, 0.5) for a in around for e in range(-90, 91, 30)]
    (tmp_path / "e.csv").write_text(csv_text("azimuth_deg,elevation_deg,rcs_m2", rows))
    assert plausibility_warnings(scenario(aircraft__rcs=with_elevations)) == ()


def test_a_constant_with_tolerances_is_never_below_zero_but_its_parameters_may_be():
    """Its logarithm is normal, and its sigma to first order may be any."""
    for key, value, told in (("loss_db", 5, []), ("average_power_kw", 10, ["average_power_kw of"])):
        large = {f"uncertainty.radar.data_sheet.constant.{key}": value}
        s = rs.load_scenario(SCANNING, {**large, "analysis.level": "data_sheet"})
        assert math.sqrt(s.cov_radar[3, 3]) > s.radar[3]
        texts = [text for text in plausibility_warnings(s) if "[constant-clipped]" in text]
        assert [text.partition(" the radar is ")[0] for text in texts] == told


def test_degrees_in_a_python_scenario_are_warned_of():
    """A file refuses such an angle."""
    s = scenario()
    for yaw, told in ((np.deg2rad(359.0), ""), (90.0, "90 rad, 5157 deg: is it in its unit?")):
        aircraft = s.aircraft.copy()
        aircraft[3, 5] = yaw
        texts = [
            t for t in plausibility_warnings(with_arrays(s, aircraft=aircraft)) if "angle" in t
        ]
        assert len(texts) == bool(told)
        assert all(told in text for text in texts)
