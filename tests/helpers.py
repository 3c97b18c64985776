"""Helpers of the tests: scenarios, networks, refusals and figures."""

import copy
import csv
import dataclasses
import hashlib
import json
import pickle
import re
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml

from radar_sense import axis as axes
from radar_sense.acceptance import accuracy
from radar_sense.acceptance.requirement import Requirement
from radar_sense.flight import Path as Flight
from radar_sense.flight import States
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.geometry import orbit
from radar_sense.model.network import NetworkModel, as_network
from radar_sense.model.radar import Level, Radar
from radar_sense.propagation import propagate_scenario, unreliable_in_scenario
from radar_sense.propagation.draws import estimate
from radar_sense.scenario import Scenario
from radar_sense.scenario_file.load import default_text, load_scenario, parse_scenario
from radar_sense.sources import error_budget

# The paper's scenario with changes: `scenario(geometry__range_km=400)` and the like.

ROOT = Path(__file__).parents[1]
#: Names of the warnings that the documentation explains.
EXPLAINED = yaml.safe_load((ROOT / "docs/warnings.yaml").read_text())
CONFIGS = ROOT / "configs"

#: Sources of the error budget of a single radar whose RCS and attenuation are certain.
SOURCES = ("aircraft_position", "aircraft_orientation", "radar_position", "radar_constant")

PAPER = yaml.safe_load(default_text().replace("1.7e-4", "1.7e-04"))
PAPER["radar"]["p_fa"] = 1.7e-4  # PyYAML reads 1.7e-4 as text; the package's reader does not


# Level and heading north at 500 km north of the origin, with the radar straight below.
OVERHEAD = {
    "aircraft__attitude_deg": [0, 0, 0],
    "radar__position_m": [500e3, 0, 10e3],
    "geometry__azimuth_deg": {"start": 0, "stop": 0, "step": 1},
    "geometry__azimuth_from": "north",
}


#: Documents as text, 1e-06 as 1.0e-06, which is a number to YAML. PyYAML's C library takes a fifth
#: of the time.
yaml_text = partial(
    yaml.dump, sort_keys=False, Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper)
)


def document(of=PAPER, /, **changes):
    """The paper's document, or another, with other values at key paths, `__` between the keys.

    Radars in the changes take the place of the only radar, each with its own uncertainty.
    """
    changed = copy.deepcopy(of)
    if "radars" in changes and "radar" in changed:
        del changed["radar"], changed["uncertainty"]["radar"]
    for path, value in changes.items():
        *parents, key = path.split("__")
        where = changed
        for parent in parents:
            where = where[parent]
        where[key] = value
    return changed


def scenario(**changes):
    """The paper's scenario with other values at key paths, `__` between the keys."""
    text = yaml_text(document(**changes))
    return parse_scenario(text) if "file:" in text else _parsed(text)


def known_to(metres=0, degrees=0, rcs_db=0, **of_radar):
    """Changes of a scenario: standard deviations of aircraft and radar, 0 where none is given.

    They leave the method out, so it is `automatic` in place of the paper's.
    """
    aircraft = {"position_m": metres, "attitude_deg": degrees, "rcs_db": rcs_db}
    radar = {"medium": {"position_m": 0, "constant": 0, **of_radar}}
    return {"uncertainty": {"aircraft": aircraft, "radar": radar}, "analysis": {"level": "medium"}}


@cache
def _parsed(text):
    """The scenario of a text that names no file: many tests have the same immutable scenario."""
    return parse_scenario(text)


def paper_aircraft(azimuth_deg, azimuth_from="east"):
    """States (..., 6) on the paper's orbit: 500 km out, 3 km up, heading east."""
    states, angle = np.zeros((*np.shape(azimuth_deg), 6)), np.radians(azimuth_deg)
    states[..., :3] = orbit(angle, radius=500e3, down=-3e3, azimuth_from=azimuth_from)
    states[..., 5] = np.radians(90)
    return states


def csv_text(head, rows):
    """Return a CSV file of a line of names and some rows."""
    return "\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n"


def write_path(folder, text, name="scenario.yaml", /, **changes):
    """Write a route and a scenario that flies it, with changes; return the scenario's path."""
    (folder / "route.csv").write_text(text)
    content = document(geometry={"type": "path", "file": "route.csv"}, radar__constant=50)
    del content["aircraft"]["attitude_deg"]
    if "std_" in text or "cov_" in text:
        del content["uncertainty"]["aircraft"]
    file = folder / name
    file.write_text(yaml_text(document(content, **changes)))
    return file


def on_route(folder, content, rows):
    """Return the scenario of a document that flies a route of times and poses."""
    file = folder / "route.csv"
    file.write_text(csv_text("time_s,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg", rows))
    content = document(content, geometry={"type": "path", "file": str(file)})
    content["aircraft"].pop("attitude_deg", None)
    return parse_scenario(yaml_text(content))


@cache
def corridor():
    """Return the scenario of the corridor, which takes a third of a second to read."""
    return load_scenario(CONFIGS / "corridor.yaml")


def lay_out(figure):
    """Lay a figure out as rendering does, without drawing, which takes longer."""
    from radar_sense import plotting

    with plotting.apply_style(plotting.style_of(figure)):
        figure.get_layout_engine().execute(figure)
    return figure


def without_pixels(patch, then=lambda figure: figure):
    """Draw figures, but write an empty picture: rendering takes longer than analyses.

    `then` is called with each figure.
    """
    svg = b'<svg xmlns="http://www.w3.org/2000/svg" width="1pt" height="1pt" viewBox="0 0 1 1"/>'
    patch.setattr("radar_sense.plotting.render", lambda figure, kind: then(figure) and svg)


def some_poses(patch):
    """Let scenarios be read at some five of their poses."""

    def few(path=None, changes=None):
        read = load_scenario(path, changes)
        return read.at_poses(slice(0, None, max(1, len(read.axis) // 4)))

    # the public name first, because it is looked up in the module that has it
    for name in ("radar_sense.load_scenario", "radar_sense.scenario_file.load.load_scenario"):
        patch.setattr(name, few)


def required(s, goal, *names, k=None, method="automatic"):
    """Return the accuracy of some of the sources, which takes less than that of all.

    The goal is what is required of P_D, or a limit of 3σ, or with k of the upper bound.
    """
    if not isinstance(goal, Requirement):
        goal = Requirement(goal, k or 3.0, width=k is None)
    search = accuracy._Search(s, goal, method)
    every = tuple(error_budget(s).sources)
    return {name: search.required(every if name == "all" else (name,)) for name in names}


def stds_of(contributions):
    """Return σ of P_D (n,) from each of some contributions, by name."""
    return {name: c.std for name, c in contributions.items()}


def shares_of(budget):
    """Return the shares of the variance (n,) of the sources and of their interaction, by name."""
    shares = {name: c.share for name, c in budget.sources.items()}
    return {**shares, "interaction": budget.interaction.share}


def drawn_states(s, runs, seed=1):
    """Draw states of aircraft (runs, n, 6) and radars (runs, 1, 7m) from the covariances by NumPy.

    Errors of poses are independent here, and no tolerance makes c_r other than Gaussian.
    """
    rng, states = np.random.default_rng(seed), s.states()
    assert not any(s.tolerances)
    covariances = np.broadcast_to(s.cov_aircraft, (len(s.aircraft), 6, 6))
    errors = np.stack([rng.multivariate_normal(np.zeros(6), c, runs) for c in covariances], axis=1)
    radars = rng.multivariate_normal(states.radar[0], states.cov_radar[0], runs)
    radars[:, 3::7] = np.maximum(radars[:, 3::7], 0)  # a c_r below 0 counts as 0
    return s.aircraft + errors, radars[:, np.newaxis]


def drawn_p_d(s, runs, seed=1):
    """P_D (runs, n) of drawn states."""
    return s.model.unchecked_p_d(*drawn_states(s, runs, seed))


def part_shares(budget):
    """Return the share of the variance from each part of a radar constant alone (n,)."""
    return {name: c.share for name, c in budget.parts.items()}


def small_batches(patch):
    """Let `validate` and `compare` draw few draws, whose accuracy has tests of its own."""
    patch.setattr(import_module("radar_sense.analyses.compare"), "TOGETHER", 1e4)
    patch.setattr(import_module("radar_sense.analyses.validate"), "RUNS", 2000)
    patch.setattr("radar_sense.montecarlo.adaptive.PRECISE", 2048)
    patch.setattr("radar_sense.montecarlo.adaptive.MOST_DRAWS", 8192)


@contextmanager
def no_physics():
    """Let every evaluation of a model fail the test."""

    def forbidden(*args, **options):
        pytest.fail("a model is evaluated")

    with pytest.MonkeyPatch.context() as patch:
        for cls in (DetectionModel, NetworkModel):
            for name in ("p_d", "snr", "linearize", "linearize_probit"):
                patch.setattr(cls, name, forbidden)
        yield


def legend_off_data(figure):
    """Insist that the legend of a figure that is laid out is on the page, and on no axes."""
    if not figure.legends:  # all labels are on the lines
        assert figure.axes[0].texts
        return None
    (legend,) = figure.legends
    box, page = legend.get_window_extent(), figure.bbox
    assert page.x0 <= box.x0 < box.x1 <= page.x1
    assert box.y1 <= page.y1
    for each in figure.axes:
        assert not box.overlaps(each.get_window_extent())
    return legend


def single(scenario):
    """Return the detection model of the only radar of a scenario."""
    (radar,) = scenario.model.radars
    return radar.model


def write(text: str | bytes, name: str = "my.yaml") -> str:
    """Write a file and return its name."""
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


def refusal(tool: Callable, text: str | bytes | None, *options: str, name: str = "my.yaml") -> str:
    """Insist that a scenario (None: no file) is refused in one line, and return that line."""
    if text is not None:
        write(text, name)
    before = sorted(Path().rglob("*"))
    error = one_line(tool, "montecarlo", *options, "--no-plot", "--out", "out", "--", name)
    assert sorted(Path().rglob("*")) == before  # nothing written, not even the folder
    return error.rstrip("\n")


def one_line(tool: Callable, *args: object) -> str:
    """Insist that a command is refused in one line with exit code 2, and return that line."""
    code, out, err = tool(*args)
    assert (code, out) == (2, "")
    assert re.fullmatch(r"Error: [^\n]+\n", err), err
    return err


def place(error: str) -> tuple[int, str, str]:
    """Split an error of `my.yaml` into line number, key path and message."""
    match = re.fullmatch(r"Error: my\.yaml:(\d+): (?:([\w.\[\]-]+): )?(.*)", error)
    assert match, error
    return int(match[1]), match[2] or "", match[3]


def read_table(path):
    """Return the columns of a CSV file by name."""
    with Path(path).open(newline="") as file:
        rows = list(csv.reader(file))
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))


def read_record(path):
    """Return a JSON record; NaN and infinity, which Python would read, are refused."""

    def refuse(word):
        raise ValueError(f"{word} is not JSON")

    return json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=refuse)


def mission(scenario, *, m_of_n=None, **options):
    """Call the analysis with m and n as a pair."""
    from radar_sense import analyses

    m, n = m_of_n or (None, None)
    return analyses.mission(scenario, m=m, n=n, **options)


def direction(azimuth, elevation):
    """Unit vectors to azimuth and elevation [rad], positive above (body z is down)."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    h = np.cos(elevation)
    return np.stack([h * np.cos(azimuth), h * np.sin(azimuth), -np.sin(elevation)], axis=-1)


def slopes(function, states, steps):
    """Return central differences (n, k) of a function (n,) of states (n, k), by steps (k,)."""
    moved = zip(np.diag(steps), steps, strict=True)
    ends = [(function(states + e) - function(states - e)) / (2 * step) for e, step in moved]
    return np.stack(ends, axis=-1)


def dashes(line):
    """Return the dash pattern of a line, for which Matplotlib has no public name."""
    return str(line._unscaled_dash_pattern)


# A radar by its data sheet.

SURVEILLANCE = yaml.safe_load("""
{average_power_kw: 10, aperture_m2: 15, temperature_k: 290, rotation_rpm: 10, search_volume_sr: 2,
 loss_db: 8, noise_figure_db: 3}
""")
TRACKING = yaml.safe_load("""
{peak_power_kw: 250, gain_dbi: 40, frequency_ghz: 9.4, pulse_width_us: 0.8, temperature_k: 290,
 loss_db: 6, noise_figure_db: 4}
""")
TOLERANCES = {
    "surveillance": {"loss_db": 1, "noise_figure_db": 0.5, "average_power_kw": 0.5},
    "tracking": {"gain_dbi": 0.5, "frequency_ghz": 0.05, "pulse_width_us": 0.05, "loss_db": 0.7},
}
#: Geometries at which P_D of the two is neither 0 nor 1.
SHEET_RANGES = {"surveillance": 220, "tracking": 30}
SHEET_AZIMUTHS = {"start": 0, "stop": 90, "step": 15}


def sheet_document(
    kind="surveillance", radar=None, tolerances=None, steps=SHEET_AZIMUTHS, **analysis
):
    """Document of the paper's scenario with a radar given by its parameters."""
    given = radar or {"surveillance": SURVEILLANCE, "tracking": TRACKING}[kind]
    changed = document(
        radar={"position_m": [0, 0, 0], kind: given, "p_fa": 1e-6},
        geometry__range_km=SHEET_RANGES[kind],
        geometry__azimuth_deg=steps,
        analysis={"level": "sheet", "runs": 500, "seed": 1, **analysis},
    )
    std = TOLERANCES[kind] if tolerances is None else tolerances
    changed["uncertainty"]["radar"] = {
        "number": {"position_m": 100, "constant": 0.1},
        "sheet": {"position_m": 100, "constant": std},
    }
    return changed


def sheet_scenario(*args, **kwargs):
    return parse_scenario(yaml_text(sheet_document(*args, **kwargs)))


# Scenarios from arrays.

#: Fields of a scenario that are no arrays.
CHOICES = ("name", "level", "runs", "seed", "method", "rcs_db", "correlation_s")


def scenario_of(
    model,
    radar,
    aircraft,
    cov_aircraft,
    cov_radar,
    *,
    tolerances=None,
    errors=None,
    time_s=None,
    origin=None,
    axis=None,
    **fields,
):
    """Make a scenario from arrays: states (4m,) and C_rr (4m, 4m) by level of all radars.

    Tolerances and errors of factors are tuples over radars by level.
    """
    radars, apart = [], np.kron(np.eye(len(as_network(model).radars)), np.ones((4, 4)))
    for name, matrix in cov_radar.items():
        assert not np.any(matrix * (1 - apart)), f"radars of a scenario are independent: {name}"
    for i, one in enumerate(as_network(model).radars):
        own = slice(4 * i, 4 * i + 4)
        levels = {
            name: Level(
                np.asarray(matrix)[own, own],
                tolerances[name][i] if tolerances and name in tolerances else (),
                errors[name][i] if errors and name in errors else {},
            )
            for name, matrix in cov_radar.items()
        }
        radars.append(dataclasses.replace(one, state=np.asarray(radar)[own], levels=levels))
    geometry = States.of(aircraft, cov_aircraft)
    if time_s is not None:
        time_s = np.asarray(time_s, dtype=float)
        arrays = axis or axes.time(time_s), geometry.aircraft, geometry.covariance
        geometry = Flight(*arrays, time_s=time_s, origin=origin)
    elif axis is not None:
        geometry = dataclasses.replace(geometry, axis=axis)
    return Scenario(radars=tuple(radars), geometry=geometry, **fields)


def cov_by_level(scenario):
    """Return C_rr (4m, 4m) of all radars by level."""
    return {level: scenario.with_analysis(level=level).cov_radar for level in scenario.levels}


def tolerances_by_level(scenario):
    return {level: scenario.with_analysis(level=level).tolerances for level in scenario.levels}


def with_arrays(scenario, **arrays):
    """Return a scenario with other arrays or fields, those of `scenario_of`."""
    states = ("model", "radar", "aircraft", "time_s", "origin", "axis")
    given = {name: getattr(scenario, name) for name in (*states, *CHOICES)}
    given |= {
        "cov_aircraft": scenario.geometry.covariance,
        "cov_radar": cov_by_level(scenario),
        "tolerances": tolerances_by_level(scenario),
        "errors": {
            level: tuple(radar.levels[level].errors for radar in scenario.radars)
            for level in scenario.levels
        },
    } | arrays
    if len(as_network(given["model"]).radars) != len(scenario.radars):
        given |= {"tolerances": None, "errors": None} | arrays
    if given["level"] not in given["cov_radar"]:
        given["level"] = ""
    if len(np.atleast_2d(given["aircraft"])) != len(given["axis"]):
        given["axis"] = None
    return scenario_of(**given)


def assert_same_scenario(found, expected):
    """Insist on the same radars, levels, poses and choices, bit by bit."""
    for own, other in zip(found.radars, expected.radars, strict=True):
        for name in ("name", "max_range", "min_range", "horizon", "scan_period", "band", "sheet"):
            assert getattr(own, name) == getattr(other, name), name
        for name in ("p_fa", "detector"):
            assert getattr(own.model, name) == getattr(other.model, name), name
        assert repr(own.model.factors) == repr(other.model.factors)
        np.testing.assert_array_equal(own.state, other.state)
        assert list(own.levels) == list(other.levels)
        for level, wanted in other.levels.items():
            at = own.levels[level]
            np.testing.assert_array_equal(at.covariance, wanted.covariance)
            assert at.tolerances == wanted.tolerances
            assert at.errors == wanted.errors
    assert type(found.geometry) is type(expected.geometry)
    for name in ("aircraft", "cov_aircraft", "time_s", "origin"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(found.axis.values, expected.axis.values)
    p_d = (s.model.p_d(s.aircraft, s.radar) for s in (found, expected))
    np.testing.assert_array_equal(*p_d)
    for name in CHOICES:
        assert getattr(found, name) == getattr(expected, name), name


def read_back(scenario):
    """Insist that the record of a scenario is read as the same scenario, and return that one."""
    again = parse_scenario(yaml_text(scenario.resolved()))
    assert_same_scenario(again, scenario)
    assert again.resolved() == scenario.resolved()
    return again


# Networks.


def paper_network(positions, constants, *, poses=slice(None, None, 60), attitude_deg=1.0, **limits):
    """The paper's aircraft seen by several radars, each with the paper's uncertainty."""
    paper = load_scenario()
    m = len(positions)
    radars = tuple(Radar(single(paper), f"r{i}", **limits) for i in range(m))
    cov_aircraft = paper.cov_aircraft.copy()
    cov_aircraft[3:, 3:] = np.eye(3) * np.radians(attitude_deg) ** 2
    return with_arrays(
        paper.at_poses(poses),
        model=NetworkModel(radars),
        radar=np.concatenate([[*p, c] for p, c in zip(positions, constants, strict=True)]),
        cov_aircraft=cov_aircraft,
        cov_radar={n: np.kron(np.eye(m), c) for n, c in cov_by_level(paper).items()},
        tolerances=None,
        errors=None,
    )


def p_d_each(network, aircraft, radar):
    """P_D (..., m) of each radar of a network by its own model and limits."""
    states = np.split(np.asarray(radar), len(network.radars), axis=-1)
    return np.stack(
        [
            np.where(r.visible(aircraft, state), r.model.p_d(aircraft, state), 0)
            for r, state in zip(network.radars, states, strict=True)
        ],
        axis=-1,
    )


def nonlinear_by_its_own_moments(scenario, method):
    """Return where (n,) a method's own moments of a scenario are unreliable."""
    moments = propagate_scenario(scenario, method=method)
    return unreliable_in_scenario(scenario.with_analysis(method=method), moments)


def radar_entry(name, /, **changes):
    """One of `radars` of a document; a change to None takes a key away."""
    low = {"position_m": 10, "constant": 1}
    high = {"position_m": [100, 200, 10], "constant": 5}
    entry = {"name": name, "position_m": [1e3, 2e3, -30], "constant": 160, "p_fa": 1e-4}
    entry["uncertainty"] = {"low": low, "high": high}
    return {k: v for k, v in {**entry, **changes}.items() if v is not None}


def network_document(*radars, **changes):
    """Document of the embedded scenario, with fewer poses and other radars."""
    few = {"geometry__azimuth_deg__step": 45, "analysis__level": "low"}
    found = document(radars=list(radars), **few)
    return {k: v for k, v in {**found, **changes}.items() if v is not None}


def paper_radar(name, **changes):
    """One of `radars` of a document: the paper's, with its uncertainty."""
    return {"name": name, **PAPER["radar"], "uncertainty": PAPER["uncertainty"]["radar"], **changes}


def parsed_network(*radars, **changes):
    return parse_scenario(yaml_text(network_document(*radars, **changes)))


#: What draws said of some states before, by all that it depends on.
_DRAWN = {}


def remembered(states, draws, *args):
    """Return what `estimate` returns, which has no side effects, from before if it is known."""
    parts = [getattr(states, f.name) for f in dataclasses.fields(states)]
    try:
        key = hashlib.sha256(pickle.dumps((*parts, states.columns, draws, args))).digest()
    except (AttributeError, pickle.PicklingError):  # a class of a test
        return estimate(states, draws, *args)
    if key not in _DRAWN:
        _DRAWN[key] = estimate(states, draws, *args)
    return _DRAWN[key]


def few_judging_draws(patch, first=256, most=1024):
    """Let few draws judge a method at each pose: how they judge is tested in `test_draws`.

    The draws are made once in all tests of a process.
    """
    for name in ("propagation.staged", "acceptance.accuracy"):
        patch.setattr(f"radar_sense.{name}.estimate", remembered)
    patch.setattr("radar_sense.propagation.staged.FIRST", first)
    for name in ("automatic.LAST", "automatic.MANY", "staged.PRECISE"):
        patch.setattr(f"radar_sense.propagation.{name}", most)
    for name in ("PRECISE", "MANY"):
        patch.setattr(f"radar_sense.acceptance.accuracy.{name}", most)
    patch.setattr("radar_sense.coverage.ranges.FIRST", first)
    patch.setattr("radar_sense.coverage.ranges.PRECISE", most)


def few_draws(patch, draws=128, replicates=2):
    """Let missions use few draws: their accuracy is tested in `test_recombined`."""
    from radar_sense.mission import recombined

    for name, value in (("MIN_DRAWS", draws), ("MAX_DRAWS", draws), ("REPLICATES", replicates)):
        patch.setattr(recombined, name, value)


#: Two radars with data sheets and one with a number as c_r, and their uncertainty at level sheet.
MIXED_SEARCH = yaml.safe_load("""
{average_power_kw: 2.1, aperture_m2: 2.874, temperature_k: 487, rotation_rpm: 12.5,
 search_volume_sr: 4.039, loss_db: 22.5, noise_figure_db: 0}
""")
MIXED_TRACK = {**TRACKING, "peak_power_kw": 2000, "gain_dbi": 36}
MIXED_SEARCH_STD = {"average_power_kw": 0.1, "temperature_k": 30, "loss_db": 1.2}
MIXED_TRACK_STD = {"gain_dbi": 0.5, "frequency_ghz": 0.3, "loss_db": 0.8}
MIXED_RANGE, MIXED_DOWN, MIXED_AREA, MIXED_P_FA = 70e3, -3e3, 0.8, 1e-6
MIXED_POSITIONS = {"a": [0, 0, -15], "b": [8e3, -5e3, 0], "c": [-5e3, 8e3, -40]}
MIXED_NUMBER = (0.0045, 0.0004)  # c_r of the third, and its standard deviation


def _mixed_entry(name, data_sheet, std, position_m=20, **more):
    levels = {"plain": 0.0002, "sheet": std}.items()
    uncertainty = {key: {"position_m": position_m, "constant": value} for key, value in levels}
    given = {"name": name, "position_m": MIXED_POSITIONS[name], "p_fa": MIXED_P_FA}
    return {**given, **data_sheet, **more, "uncertainty": uncertainty}


def mixed_radars(search_std=MIXED_SEARCH_STD, track_std=MIXED_TRACK_STD, **more):
    """Radars of a document: two have data sheets, one has a number as c_r."""
    return [
        _mixed_entry("a", {"surveillance": MIXED_SEARCH}, search_std, **more),
        _mixed_entry("b", {"tracking": MIXED_TRACK}, track_std, **more),
        _mixed_entry("c", {"constant": MIXED_NUMBER[0]}, MIXED_NUMBER[1], **more),
    ]


def mixed_document(several=None, sweep=(30, 90, 30), runs=500, aircraft=None, **changes):
    """Document of a scenario with several radars."""
    start, stop, step = sweep
    orbit = {"range_km": MIXED_RANGE / 1e3, "down_km": MIXED_DOWN / 1e3, "azimuth_from": "north"}
    azimuths = {"start": start, "stop": stop, "step": step}
    found = document(
        radars=mixed_radars() if several is None else several,
        aircraft__rcs={"model": "constant", "rcs_m2": MIXED_AREA},
        geometry={"type": "orbit", **orbit, "azimuth_deg": azimuths},
        uncertainty={"aircraft": aircraft or {"position_m": 50, "attitude_deg": 1}},
        analysis={"level": "sheet", "runs": runs, "seed": 1},
    )
    return {**found, **changes}


def mixed_network(*args, **kwargs):
    """Scenario with two radars that have data sheets and one with a number as c_r."""
    return parse_scenario(yaml_text(mixed_document(*args, **kwargs)))
