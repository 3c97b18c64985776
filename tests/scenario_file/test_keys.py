"""Scenario files, allowed and refused, by way of the command line.

A refusal is one line that names file, line, key path, value and allowed values. The exit code is 2
and nothing is written. The cases are made from the embedded scenario. `LINES` holds one key per
line, so the line that an error must name is known here without the reader.
"""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import cov_by_level, one_line, read_record, refusal, write
from scenario_file.refused import place_of_error, refused

import radar_sense as rs
from radar_sense.propagation import METHODS
from radar_sense.scenario_file.load import MAX_BYTES, default_text

Lines = list[tuple[str, str]]


def flattened(document: dict, above: str = "") -> Lines:
    """List (key path, YAML text of the value) in order; the text is empty for a mapping."""
    found: Lines = []
    for key, value in document.items():
        path = f"{above}.{key}".lstrip(".")
        if isinstance(value, dict):
            found += [(path, ""), *flattened(value, path)]
        else:
            found.append((path, str(value)))
    return found


LINES = flattened(yaml.safe_load(default_text()))
PATHS = [path for path, _ in LINES]
#: Keys whose default is the paper's value.
OPTIONAL = ["radar.detector", "geometry.azimuth_from", "analysis.runs", "analysis.seed"]


def yaml_text(lines: Lines) -> str:
    return "".join(f"{'  ' * p.count('.')}{p.split('.')[-1]}: {v}\n" for p, v in lines)


def is_within(path: str, top: str) -> bool:
    return path == top or path.startswith(top + ".")


def without(path: str) -> Lines:
    return [(p, v) for p, v in LINES if not is_within(p, path)]


def replaced(changes: dict[str, str]) -> Lines:
    """Give keys other values, and remove the keys below them."""
    return [
        (p, changes.get(p, v))
        for p, v in LINES
        if not any(p != top and is_within(p, top) for top in changes)
    ]


def line_of(path: str, lines: Lines) -> int:
    return [p for p, _ in lines].index(path) + 1


def accepted(lines: Lines) -> rs.Scenario:
    return rs.parse_scenario(yaml_text(lines), "my.yaml")


def with_changes(**changes: str) -> rs.Scenario:
    return accepted(replaced({path.replace("__", "."): v for path, v in changes.items()}))


def test_optional_keys_have_the_papers_values():
    assert yaml.safe_load(yaml_text(LINES)) == yaml.safe_load(default_text())
    paper = rs.load_scenario().resolved()
    for path in OPTIONAL:
        assert accepted(without(path)).resolved() == paper
    for method in METHODS:
        scenario = with_changes(analysis__method=method)
        assert scenario.method == scenario.resolved()["analysis"]["method"] == method
    assert accepted(without("analysis.method")).method == "automatic"


# Values out of range.

RADAR = "uncertainty.radar.medium"
AIRCRAFT = "uncertainty.aircraft"
#: Values that are refused for a reason of their own; `test_declare` has the others.
WRONG = [
    ("name", "a" * 101, "100"),
    ("radar.constant", "1e-30", "1e-20 to 1e+20"),
    ("aircraft.attitude_deg[3]", "[0, 0, 361]", "360"),
    ("geometry.azimuth_deg.step", "-0.5", "from 0 to 180, got -0.5"),
    ("geometry.azimuth_deg.step", "1.8e-7", "1,000,000"),  # a billion poses
    ("analysis.level", "medum", "low, medium, high, got 'medum'; did you mean 'medium'?"),
    # Covariances.
    (f"{RADAR}.position_m", "[[1, 0], [0, 1]]", "a list of 3 rows of 3 numbers, got a list of 2"),
    (f"{RADAR}.position_m[2]", "[[1, 0, 0], 1, [0, 0, 1]]", "a list of 3 numbers"),
    (f"{RADAR}.position_m[2][1]", "[[1, 0, 0], [.inf, 1, 0], [0, 0, 1]]", ".inf"),
    (f"{RADAR}.position_m", "[[1, 0.5, 0], [0.4, 1, 0], [0, 0, 1]]", "not symmetric"),
]


@pytest.mark.parametrize(("path", "value", "says"), WRONG)
def test_value_that_is_not_allowed(path, value, says):
    key = path.split("[")[0]
    line, where, complaint = place_of_error(yaml_text(replaced({key: value})))
    assert (line, where) == (line_of(key, LINES), path)
    assert says in complaint


def test_a_whole_covariance_that_is_none():
    rows = "[[1, 2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
    line, where, complaint = place_of_error(yaml_text(replaced({RADAR: f"{{covariance: {rows}}}"})))
    assert (where, "not symmetric" in complaint) == (f"{RADAR}.covariance", True)
    assert line == line_of(RADAR, LINES)


@pytest.mark.parametrize("above", [0, 0.5])
def test_aircraft_on_top_of_the_radar(above):
    """The cosine of 90° is 6e-17, so the poses miss a radar at their height by 3e-11 m."""
    lines = replaced({"radar.position_m": f"[5e5, 0, {above - 3e3}]"})
    line, where, complaint = place_of_error(yaml_text(lines))
    assert where == "geometry"
    assert line_of("geometry", lines) <= line <= line_of("geometry.type", lines)
    assert "on top of the radar at azimuth" in complaint


# Files that are no scenario at all.

LAUGHS = "a: &a [ha, ha, ha, ha, ha, ha, ha, ha, ha]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join([f'*{chr(97 + i)}'] * 9)}]\n" for i in range(20)
)
#: Two aliases of the line before on each line: 2⁶⁰ of them at the end, by way of merges too.
DOUBLED = "d0: &d0 {k: 1}\n" + "".join(
    f"d{i}: &d{i} {{a: *d{i - 1}, b: *d{i - 1}}}\n" for i in range(1, 61)
)
MERGED = "d0: &d0 {k: 1}\n" + "".join(
    f"d{i}: &d{i} {{<<: [*d{i - 1}, *d{i - 1}]}}\n" for i in range(1, 61)
)

#: Levels of nesting, of two or more calls each: more than Python's recursion limit.
DEEP = 600
FILES = {
    "empty": (b"", "is empty"),
    "comments": (b"# a comment\n# another\n", "is empty"),
    "byte order mark alone": (b"\xef\xbb\xbf", "is empty"),
    "word": (b"paper\n", "must be a mapping (key: value), got 'paper'"),
    "NUL bytes": (b"name: x\n\0\0\0\0", ":2: is not a text file"),
    "Latin-1": ("name: x\n# R\xe4der\n".encode("latin-1"), ":2: is not UTF-8 text: byte 0xe4"),
    "enormous and good": ((default_text() + "#" * MAX_BYTES).encode(), "is larger than 64 KiB"),
    "two documents": (f"{default_text()}---\n{default_text()}".encode(), "another one begins"),
    "unclosed bracket": (
        b"name: x\nradar: [1, 2\ngeometry: 3\n",
        ":2: is not valid YAML: the bracket [",
    ),
    "unclosed brace": (b"radar: {p_fa: 1e-6\ngeometry: 3\n", ":1: is not valid YAML: the brace {"),
    "unclosed quote": (b'name: "x\nradar: 1\n', ":1: is not valid YAML: the quote is not closed"),
    "no space": (
        b"name: x\np_fa:1e-6\nradar: 1\n",
        ":2: is not valid YAML: a key needs a colon, and",
    ),
    "no space at first": (b"radar:\n  p_fa:1e-6\n  mask: x\n", ":3: is not valid YAML: no key may"),
    "indented more": (
        b"radar:\n  p_fa: {}\n   mask: x\n",
        ":3: is not valid YAML: this does not fit",
    ),
    "tab": (b"radar:\n\tconstant: 1\n", ":2: has a tab where YAML allows spaces only"),
    "unknown alias": (b"name: *x\n", ":1: is not valid YAML"),
    "merge key": (b"<<: {name: x}\n", "unknown key '<<'"),
    "deep block": (b"- " * DEEP, "nested too deeply"),
    "closed deep list": (b"[" * DEEP + b"]" * DEEP, "nested too deeply"),
    "mapping in itself": (b"&a\nname: *a\n", "missing key"),
}


@pytest.mark.parametrize("kind", FILES)
def test_file_that_is_no_scenario(tool, kind):
    content, says = FILES[kind]
    error = refusal(tool, content)
    assert re.match(r"Error: my\.yaml(:\d+)?: ", error)
    assert says in error


@pytest.mark.parametrize("bomb", [LAUGHS, DOUBLED, MERGED], ids=["laughs", "doubled", "merged"])
def test_alias_bomb_where_a_value_belongs(bomb):
    # The bomb is the first level of uncertainty, its last line the value of the key.
    alias = "*" + re.findall(r"&(\w+)", bomb)[-1]
    fuse = "".join("    " + line + "\n" for line in bomb.splitlines())
    for path in ("radar.constant", "aircraft.rcs", RADAR):
        *_, message = place_of_error(f"junk:\n{fuse}" + yaml_text(replaced({path: alias})))
        assert "junk" in message
        # Where keys are free (names of levels) the reader gets as far as the value.
        kept = [(p, alias if p == path else v) for p, v in LINES if not is_within(p, "uncertainty")]
        place_of_error(f"uncertainty:\n  radar:\n{fuse}" + yaml_text(kept))


def test_mapping_inside_itself():
    for path in ("radar", "uncertainty.radar", "uncertainty.radar.low"):
        keys = [p.split(".")[-1] for p in PATHS if p.rpartition(".")[0] == path]
        loop = ", ".join(f"{key}: *loop" for key in keys)
        place_of_error(yaml_text(replaced({path: f"&loop {{{loop}}}"})))
    for rows in ("&m [*m, *m, *m, *m]", "&m [&r [*r, *r, *r, *r], *r, *r, *r]"):
        place_of_error(yaml_text(replaced({RADAR: f"{{covariance: {rows}}}"})))


@pytest.mark.parametrize("unit", ["a,", "- - - a\n", "'"])
def test_much_nonsense_is_refused(unit):
    with refused("my.yaml:"):
        rs.parse_scenario("{" * (unit == "a,") + unit * (MAX_BYTES // 8 // len(unit)), "my.yaml")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nowhere.yaml", "nowhere.yaml: cannot be read: No such file"),
        ("no/where.yaml", "no/where.yaml: cannot be read"),
        (".", "is a directory"),
        ("/dev/zero", "/dev/zero: is not a regular file, a scenario file must be one"),
        ("x" * 300, "cannot be read"),
    ],
)
def test_path_that_is_no_scenario(tool, name, says):
    assert says in refusal(tool, None, name=name)


@pytest.mark.parametrize("name", ["räder 日本.yaml", "--help", "a\nb.yaml", "100%s{}.yaml"])
def test_unusual_file_names(tool, name):
    write(default_text(), name)
    code, out, err = tool("check", "-q", "--", name)
    assert (code, out, err) == (0, "", "")
    shown = name.replace("\n", "\\n")
    error = refusal(tool, "name: x\nbogus: 1\n", name=name)
    assert error.startswith(f"Error: {shown}:2: unknown key 'bogus'")


# Options.


@pytest.mark.parametrize("out", ["file", "file/below", "/proc/nope", "x" * 300, "loop"])
def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_computed(tool, fake, out):
    fake(lambda: pytest.fail("computed"))
    Path("file").write_text("mine")
    Path("loop").symlink_to("loop")
    assert one_line(tool, "fake", "--out", out).startswith(f"Error: --out: cannot write to {out}: ")
    assert sorted(p.name for p in Path().iterdir()) == ["file", "loop"]
    assert Path("file").read_text() == "mine"


@pytest.mark.parametrize("name", ["", "/proc/nope.yaml", "x" * 300, "."])
def test_init_that_cannot_write(tool, name):
    one_line(tool, "init", name)
    assert not list(Path().iterdir())


# Accepted texts.


@pytest.mark.parametrize("name", ["NO", "123", "yes", "1e-6", "null", "a-b_c.d", "'123'"])
def test_names_are_text(tool, name):
    """Also as `check` prints them, for every reader of YAML."""
    write(yaml_text(replaced({"name": name})))
    assert yaml.safe_load(tool("check", "my.yaml").out)["name"] == name.strip("'")


def test_names_that_are_refused():
    """Names stand in file names, in columns and in figures, whose font has no 日."""
    for name in ("_x", "räder", "日本", "a/b", "two words", ".hidden", "..", "~"):
        for key in ("name: paper", "    medium:"):
            text = default_text().replace(key, key.replace("paper", name).replace("medium", name))
            *_, message = place_of_error(text)
            assert "letters A to Z" in message


def test_names_of_levels_are_text(tool):
    """Levels are labels in figures, too."""
    text = default_text().replace("step: 0.5", "step: 45").replace("level: medium", "level: 1")
    names = {"low": "NO", "medium": "1", "high": "a" * 40}
    for old, new in names.items():
        text = text.replace(f"    {old}:", f"    {new}:")
    scenario = rs.parse_scenario(text)
    assert (scenario.levels, scenario.level) == (tuple(names.values()), "1")
    code, _, err = tool("sensitivity", write(text), "--format", "svg")
    assert code == 0
    assert all(line.startswith("Warning: ") for line in err.splitlines())


FEW = {"geometry.azimuth_deg.step": "45"}


@pytest.mark.parametrize("encode", [
    lambda s: b"\xef\xbb\xbf" + s.encode(),
    lambda s: s.replace("\n", "\r\n").encode(),
    lambda s: s.rstrip("\n").encode(),
    lambda s: b"---\n" + s.encode() + b"...\n",
], ids=["byte order mark", "CRLF", "no last newline", "document markers"])  # fmt: skip
def test_harmless_variations_of_a_file(tool, encode):
    write(encode(default_text()))
    assert tool("check", "my.yaml") == tool("check")


def test_an_alias_is_only_a_shorthand():
    lines = replaced({"radar.position_m": "&zero [0, 0, 0]", "aircraft.attitude_deg": "*zero"})
    plain = with_changes(radar__position_m="[0, 0, 0]", aircraft__attitude_deg="[0, 0, 0]")
    assert accepted(lines).resolved() == plain.resolved()


def draws(tool: Callable, seed: str, *options: str) -> tuple[bytes, int]:
    """CSV and recorded seed of a small Monte Carlo with a seed in the file."""
    write(yaml_text(replaced({**FEW, "analysis.seed": seed})))
    code, out, err = tool("montecarlo", "my.yaml", "--runs", "3", "--no-plot", "-q", *options)
    assert (code, out) == (0, "")
    assert all(line.startswith("Warning: ") for line in err.splitlines())
    record = read_record("figures/paper_montecarlo.json")
    assert record["scenario"]["analysis"]["seed"] == record["seed"]
    return Path("figures/paper_montecarlo.csv").read_bytes(), record["seed"]


@pytest.mark.parametrize("seed", ["1e3", "9" * 400])
def test_seed_in_file_and_as_option(tool, seed):
    """The option is heard in place of the file."""
    by_option, by_file = draws(tool, "1", "--seed", seed), draws(tool, seed)
    assert by_option == by_file
    assert by_file[1] == (int(seed) if seed.isdigit() else int(float(seed)))
    assert draws(tool, seed, "--seed", "2") != by_file


def test_a_seed_of_more_digits_than_python_reads(tool):
    write(yaml_text(replaced({**FEW, "analysis.seed": "9" * 5000})))
    for args in (["my.yaml"], ["--seed", "9" * 5000]):
        one_line(tool, "montecarlo", *args, "--runs", "2", "--no-plot")


@pytest.mark.parametrize(
    ("start", "stop", "step", "expected"),
    [
        ("0", "180", "0.1", [k / 10 for k in range(1801)]),
        ("0", "0.3", "0.1", [0, 0.1, 0.2, 0.3]),
        ("180", "0", "-60", [180, 120, 60, 0]),
        ("-10", "10", "7", [-10, -3, 4]),
    ],
)
def test_sweep(start, stop, step, expected):
    sweep = f"{{start: {start}, stop: {stop}, step: {step}}}"
    assert with_changes(geometry__azimuth_deg=sweep).axis.values.tolist() == expected


# Units: against arithmetic that is not the package's.


def test_units_become_si():
    scenario = with_changes(
        radar__position_m="[100, -200, -30]",
        aircraft__attitude_deg="[5, -10, 270]",
        geometry__range_km="12.5",
        geometry__down_km="-1.5",
    )
    assert scenario.radar.tolist() == [100, -200, -30, 167]
    angles = [math.radians(a) for a in (5, -10, 270)]
    for theta, pose in zip(scenario.axis.values, scenario.aircraft, strict=True):
        north, east = 12500 * math.sin(math.radians(theta)), 12500 * math.cos(math.radians(theta))
        # A micrometre, and 1e-15 rad: the rounding of these numbers, a few times over.
        assert pose[:3] == pytest.approx([north, east, -1500], rel=0, abs=1e-10)
        assert pose[3:] == pytest.approx(angles, rel=0, abs=2e-15)


def block(rows: Sequence[Sequence[float]]) -> str:
    return str([list(map(float, row)) for row in rows])


@pytest.mark.parametrize(
    "value", ["10", "[10, 10.0, 1e1]", "[[100, 0, 0], [0, 100, 0], [0, 0, 100]]"]
)
def test_uncertainties_become_si(value):
    """A deviation can be written in three ways."""
    scenario = with_changes(
        uncertainty__aircraft__position_m=value, uncertainty__aircraft__attitude_deg="[1, 2, 3]"
    )
    variances = [100.0] * 3 + [math.radians(a) ** 2 for a in (1, 2, 3)]
    assert scenario.cov_aircraft == pytest.approx(np.diag(variances), rel=1e-15, abs=0)
    assert (cov_by_level(scenario)["medium"] == np.diag([1e4, 1e4, 1e4, 25])).all()
    assert scenario.levels == ("low", "medium", "high")


def test_full_covariances_are_in_the_units_of_their_keys():
    factor = np.random.default_rng(3).normal(size=(6, 6)).round(3)
    aircraft = (factor @ factor.T + np.eye(6)).round(6)
    changes = {
        AIRCRAFT: f"{{covariance: {block(aircraft)}}}",
        RADAR: f"{{covariance: {block(aircraft[:4, :4])}}}",
    }
    scenario = accepted(replaced(changes))
    unit = np.array([1, 1, 1] + [math.radians(1)] * 3)
    assert scenario.cov_aircraft == pytest.approx(aircraft * np.outer(unit, unit), rel=1e-15)
    assert (cov_by_level(scenario)["medium"] == aircraft[:4, :4]).all()
    # Blocks on the diagonal are the same as keys of their own.
    parts = np.zeros((6, 6))
    parts[:3, :3], parts[3:, 3:] = aircraft[:3, :3], aircraft[3:, 3:]
    whole = with_changes(uncertainty__aircraft=f"{{covariance: {block(parts)}}}")
    by_key = with_changes(
        uncertainty__aircraft__position_m=block(aircraft[:3, :3]),
        uncertainty__aircraft__attitude_deg=block(aircraft[3:, 3:]),
    )
    assert by_key.cov_aircraft == pytest.approx(whole.cov_aircraft, rel=1e-15, abs=0)


def test_singular_covariances_are_covariances():
    ones = block(np.ones((4, 4)))
    assert (accepted(replaced({RADAR: f"{{covariance: {ones}}}"})).cov_radar == 1).all()
    accepted(replaced({f"{RADAR}.position_m": "0", f"{RADAR}.constant": "0"}))
    # Rounded entries become symmetric.
    rounded = "[[1, 0.3, 0], [0.30000000000000004, 1, 0], [0, 0, 1]]"
    read = accepted(replaced({f"{RADAR}.position_m": rounded})).cov_radar
    assert (read == read.T).all()
    # Written with six digits, as programs do, a full correlation is off by rounding only.
    accepted(replaced({f"{RADAR}.position_m": "[[1, 2, 0], [2, 4, 0], [0, 0, 0]]"}))
