"""What new keys, commands, methods, sources and warnings cost, all added to a copy of the package.

The test reads in the copy what a user would: command line, record, schema and reference. It counts
the files and the lines that differ.
"""

import difflib
import json
import math
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
import yaml
from helpers import ROOT, document, read_record, read_table

import radar_sense as rs
from radar_sense.options import ONE_RADAR

SECTIONS, BUILD = "scenario_file/sections.py", "scenario_file/build_radar.py"
BEFORE_KEY = "    eclipsing: bool = key(\n"
KEY = '    deaf_us: float = key("Time after a pulse without echoes.", POSITIVE, default=0.0)\n'
LOSS = '    radome_db: float = key("Loss of the radome.", NOT_NEGATIVE, default=0.0)\n'
OLD_MIN_RANGE = "        min_range=_min_range(stated, sheet),\n"
IMPORT = "from radar_sense.model.radar import Level, Radar\n"
GAIN = "    if stated.elevation_gain is not None:\n        curve"
ERRORS = "    place, errors = stated.place, {}\n"
CHECK = "def _height(scenario: Scenario) -> Iterator[str]:\n"
#: What is edited, as a file, text in it, and what comes in its place.
EDITS = (
    # a key
    (SECTIONS, BEFORE_KEY, KEY + BEFORE_KEY),
    (BUILD, OLD_MIN_RANGE,
     "        min_range=max(_min_range(stated, sheet), 150.0 * stated.deaf_us),\n"),
    # a method
    ("limits.py", '    "linear": "linear:Linear",\n',
     '    "linear": "linear:Linear",\n    "doubled": "doubled:Doubled",\n'),
    # a source of uncertainty: its parameter, and a key for its value and for its deviation
    ("states.py", '("attenuation", "tilt")', '("attenuation", "tilt", "radome")'),
    (SECTIONS, KEY, KEY + LOSS),
    (SECTIONS, "\n\nLevels = Mapping", LOSS + "\n\nLevels = Mapping"),
    (BUILD, IMPORT, IMPORT + "from radar_sense.model.radome import Radome\n"),
    (BUILD, GAIN, "    if stated.radome_db:\n        yield Radome(stated.radome_db)\n" + GAIN),
    (BUILD, ERRORS, "    place, errors = stated.place, {'radome': stated.radome_db}\n"),
    # a warning
    ("plausibility.py", CHECK,
     "def _pitch(scenario: Scenario) -> Iterator[str]:\n"
     "    steep = scenario.aircraft[:, 4] > np.deg2rad(60.0)\n"
     '    yield from placed("steep", steep, scenario.axis, "the aircraft climbs steeply")\n\n\n'
     + CHECK),
    ("plausibility.py", "(_speed, _steep, _height", "(_speed, _pitch, _steep, _height"),
)  # fmt: skip
CLOSEST = '''"""How close the aircraft comes to each radar."""

from functools import partial

from radar_sense import options, plotting, words
from radar_sense.command import Result, command
from radar_sense.model.geometry import slant_range


@command(options.ONE_RADAR, examples=("radar-sense closest",))
def closest(scenario):
    """How close the aircraft comes to each radar."""
    axis, result = scenario.axis, Result(scenario)
    names = scenario.model.names or ("radar",)
    states = scenario.radar_states
    ranges = {n: slant_range(scenario.aircraft, r) for n, r in zip(names, states, strict=True)}

    words.add_axis(result.table, axis)
    for name, distance in ranges.items():
        result.table.add(f"range_m_{name}", distance, f"Slant range from {name}.", "m")

    for name, distance in ranges.items():
        pose = int(distance.argmin())
        result.report += [f"{name}: {distance[pose] / 1e3:.4g} km at {axis.at(pose)}"]
    result.summary["closest_m"] = {name: float(d.min()) for name, d in ranges.items()}
    result.draw = partial(_draw, axis=axis, ranges=ranges)
    return result


def _draw(figure, axis, ranges):
    (axes,), x = plotting.pose_panels(figure, 1, axis)
    for (name, distance), style in zip(ranges.items(), plotting.styles(), strict=False):
        plotting.draw_line(axes, x, distance / 1e3, style, label=name)
    plotting.finish(figure, axes, "Slant range [km]")
'''
DOUBLED = '''"""First order with twice the deviation."""

from radar_sense.propagation.linear import Linear


class Doubled(Linear):
    """P_D of uncertain states, taken to be normal with twice the σ of `linear`."""

    def __init__(self, states, gradient=None):
        super().__init__(states, gradient)
        mean, std = self.moments
        self.moments = mean, 2.0 * std
'''
EXPLAINED = """steep: >-
  The aircraft looks up by more than 60 deg: is down positive downwards?
"""
RADOME = '''"""The loss of the signal in a radome."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from radar_sense.limits import NOT_NEGATIVE
from radar_sense.model.geometry import Vector
from radar_sense.model.radar_equation import NEPERS


@dataclass(frozen=True)
class Radome:
    """A loss [dB], there and back together. Its error is in decibels, too."""

    loss: float
    term: ClassVar = "radome"
    parameter: ClassVar = "radome"
    std_limit: ClassVar = NOT_NEGATIVE
    detail: ClassVar = math.inf

    def nepers(self, line, error):
        return -NEPERS * (self.loss + error) + 0.0 * line.x

    def linearize(self, line, error):
        nepers = self.nepers(line, error)
        return nepers, Vector(*(0.0 * x for x in line)), np.full(np.shape(nepers), -NEPERS)

    def rise(self, line, error, part):
        return 0.0 * line.x
'''
FILES = {
    "analyses/closest.py": CLOSEST,
    "propagation/doubled.py": DOUBLED,
    "model/radome.py": RADOME,
}


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Return a copy of the package with the additions, and what its documentation is made from."""
    folder = tmp_path_factory.mktemp("copy")
    for name in ("radar_sense", "configs"):
        shutil.copytree(ROOT / name, folder / name)  # with what Python has compiled
    (folder / "docs").mkdir()
    shutil.copy(ROOT / "docs/make_reference.py", folder / "docs")
    explained = (ROOT / "docs/warnings.yaml").read_text() + EXPLAINED
    (folder / "docs/warnings.yaml").write_text(explained)
    for name, text in FILES.items():
        (folder / "radar_sense" / name).write_text(text)
    for name, old, new in EDITS:
        path = folder / "radar_sense" / name
        text = path.read_text()
        assert text.count(old) == 1, (name, old)
        path.write_text(text.replace(old, new))
    return folder


@pytest.fixture(scope="module")
def outcomes(copy):
    """Return what `LINES` end with, all in one process: exit codes and outputs."""
    write(copy, radar__deaf_us=4000)  # 600 km
    write(copy, "negative.yaml", radar__deaf_us=-1)
    write(copy, "misspelt.yaml", radar__def_us=1)
    write(copy, "steep.yaml", aircraft__attitude_deg=[0, 70, 0])
    write(copy, "level.yaml")
    radome = {"radar__radome_db": 1.5, "uncertainty__radar__medium__radome_db": 0.4}
    write(copy, "radome.yaml", name="radome", geometry__azimuth_deg__step=30, **radome)
    write(copy, "doubled.yaml", name="doubled", geometry__azimuth_deg__step=60)
    return dict(zip(LINES, run(copy, *LINES), strict=True))


def cost(copy):
    """Return the lines that are new or changed, by file of the package."""
    lines = {}
    for path in sorted((copy / "radar_sense").rglob("*.py")):
        name = path.relative_to(copy).as_posix()
        before = (ROOT / name).read_text().splitlines() if (ROOT / name).exists() else []
        after = path.read_text().splitlines()
        new = [d for d in difflib.ndiff(before, after) if d.startswith("+ ") and d.strip() != "+"]
        if before != after:
            lines[name.removeprefix("radar_sense/")] = len(new)
    return lines


#: Runs command lines, and evaluates Python, in one process.
RUN = """
import json, sys
import make_reference
import radar_sense as rs
from click.testing import CliRunner
from radar_sense.cli import cli
for line in json.loads(sys.argv[1]):
    if isinstance(line, str):
        ended = 0, str(eval(line))
    else:
        done = CliRunner().invoke(cli, line)
        ended = done.exit_code, done.output
    print(json.dumps(ended))
"""


def run(copy, *lines):
    """Return exit code and output of command lines (tuples), or of Python (strings)."""
    env = {**os.environ, "PYTHONPATH": f"{copy}{os.pathsep}{copy / 'docs'}"}
    run = [sys.executable, "-c", RUN, json.dumps(lines)]
    done = subprocess.run(run, capture_output=True, text=True, cwd=copy, env=env)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def write(copy, file="my.yaml", **changes):
    (copy / file).write_text(yaml.safe_dump(document(**changes)))


METHODS = "linear", "doubled"
RADOMES = tuple(
    (*words.split(), "radome.yaml", "--no-plot")
    for words in ("variance --method automatic", "budget", "detectors --p-d 0.5")
)
LINES = (
    ("check", "my.yaml"),
    ("variance", "my.yaml", "--method", "linear", "--no-plot"),
    ("check", "negative.yaml"),
    ("check", "misspelt.yaml"),
    ("schema",),
    "make_reference.scenario_page()",
    ("--help",),
    ("closest", "--help"),
    ("closest", "configs/network.yaml", "--format", "svg"),
    "rs.analyses.closest(rs.load_scenario()).report",
    ("check", "steep.yaml"),
    ("check", "level.yaml"),
    "make_reference.warnings_section()",
    *(f"rs.propagate_scenario(rs.load_scenario(), method={m!r}).std[0]" for m in METHODS),
    ("compare", "doubled.yaml", "--no-plot", "--runs", "100"),
    *(
        (*words.split(), "doubled.yaml", "--method", "doubled")
        for words in (
            *(f"{name} --no-plot" for name in ("variance", "sensitivity", "budget")),
            *("validate --digits 1 --no-plot", "range --step-deg 90 --no-plot", "report"),
            "map --upper --step-km 50 --no-plot",
        )
    ),
    *RADOMES,
)


def test_what_additions_cost(copy):
    """A key costs a line and one where it becomes SI, a command with its figure costs a file, and a
    warning costs a mask with its sentence. A method costs a file and its line in the list, and so
    does a source of uncertainty, with two keys and four lines where they become SI.
    """
    lines = cost(copy)
    assert {name: lines.pop(name) for name in FILES} == {
        "analyses/closest.py": 26, "propagation/doubled.py": 8, "model/radome.py": 23,
    }  # fmt: skip
    key, source, warning = {SECTIONS: 1, BUILD: 1}, {SECTIONS: 2, BUILD: 4}, {"plausibility.py": 4}
    both = {name: key[name] + source[name] for name in key}
    assert lines == {"limits.py": 1, "states.py": 1, **both, **warning}


def test_a_key(copy, outcomes):
    checked, found, negative, misspelt, schema, reference = (outcomes[line] for line in LINES[:6])
    assert [code for code, _ in (checked, found, negative, misspelt)] == [0, 0, 2, 2]
    assert "deaf_us: 4000\n" in checked[1]
    assert "no radar sees the aircraft at a nominal pose" in found[1]
    record = read_record(copy / "figures/paper_variance.json")
    assert record["scenario"]["radar"]["deaf_us"] == 4000
    assert "radar.deaf_us: must be a number greater than 0, got -1" in negative[1]
    assert "did you mean 'deaf_us'?" in misspelt[1]
    radar = json.loads(schema[1])["properties"]["radar"]["properties"]
    assert radar["deaf_us"]["exclusiveMinimum"] == 0
    row = "| `deaf_us` | Time after a pulse without echoes. | µs | A number greater than 0 |"
    assert row in reference[1]


def test_a_command(copy, outcomes):
    commands, options, found, python = (outcomes[line] for line in LINES[6:10])
    assert "closest      How close the aircraft comes to each radar." in commands[1]
    assert ONE_RADAR.help in options[1]
    assert found[1].startswith("search: ")
    assert "radar: " in python[1]
    table = read_table(copy / "figures/network_closest.csv")
    record = read_record(copy / "figures/network_closest.json")
    assert record["summary"]["closest_m"]["ridge"] == table["range_m_ridge"].min()
    assert (copy / "figures/network_closest.svg").read_text().startswith("<?xml")


def test_a_warning(outcomes):
    steep, level, reference = (outcomes[line] for line in LINES[10:13])
    assert "Warning: the aircraft climbs steeply at all 361 poses [steep]\n" in steep[1]
    assert (level[0], "[steep]" in level[1]) == (0, False)
    sentence = "The aircraft looks up by more than 60 deg: is down positive downwards?"
    assert f"### `steep`\n\n{sentence}\n" in reference[1]


def test_a_method(outcomes):
    (_, linear), (_, doubled), compared, *others = (
        outcomes[line] for line in LINES[13 : -len(RADOMES)]
    )
    assert float(doubled) == pytest.approx(2 * float(linear))
    assert "  doubled    " in compared[1]
    for code, text in others:
        assert code in (0, 3), text  # `validate` says that it is off
        assert "doubled" in text


def test_a_source_of_uncertainty(copy, outcomes):
    """A constant loss takes the signal down, and its deviation is one of c_r in decibels."""
    assert [outcomes[line][0] for line in RADOMES] == [0, 0, 0], outcomes
    table = read_table(copy / "figures/radome_budget.csv")
    s = rs.load_scenario(ROOT / "configs/paper.yaml", {"geometry.azimuth_deg.step": 30})
    s = s.with_keys({"radar.constant": s.radar[3] * 10**-0.15})
    lin = s.model.linearize(s.aircraft, s.radar)
    by_db = abs(lin.jac_radar[:, 3]) * s.radar[3] * math.log(10) / 10
    np.testing.assert_allclose(table["three_sigma_radar_radome"], 3 * 0.4 * by_db, rtol=1e-9)
    terms = read_table(copy / "figures/radome_detectors.csv")
    assert set(terms["term_radome"]) == {-1.5}
