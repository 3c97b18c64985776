"""Scenario files, allowed and refused, by way of the command line.

A refusal is one line that names file, line, key path, value and allowed values. The exit code is 2
and nothing is written. `test_declare` has the lines.
"""

import math
import re
from functools import reduce
from pathlib import Path
from textwrap import indent

import numpy as np
import pytest
import yaml
from helpers import (
    PAPER,
    cov_by_level,
    document,
    one_line,
    read_record,
    refusal,
    scenario,
    write,
    yaml_text,
)
from scenario_file.refused import place_of_error, refused

import radar_sense as rs
from radar_sense.propagation import METHODS
from radar_sense.scenario_file.load import MAX_BYTES, default_text


def with_text(path, text):
    """The paper's scenario as text, with a text in place of the value of a key."""
    return yaml_text(document(**{path.replace(".", "__"): "TEXT"})).replace("TEXT", text)


def test_optional_keys_have_the_papers_values():
    paper, few = rs.load_scenario().resolved(), document()
    del few["radar"]["detector"], few["geometry"]["azimuth_from"]
    del few["analysis"]["runs"], few["analysis"]["seed"]
    assert rs.parse_scenario(yaml_text(few), "my.yaml").resolved() == paper
    for method in METHODS:
        s = scenario(analysis__method=method)
        assert s.method == s.resolved()["analysis"]["method"] == method
    assert scenario(analysis={"level": "medium"}).method == "automatic"


# Values out of range.

RADAR = "uncertainty.radar.medium"
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
    (RADAR, f"{{covariance: {[[1, 2, 0, 0], *np.eye(4).tolist()[1:]]}}}", "not symmetric"),
]


@pytest.mark.parametrize(("path", "value", "says"), WRONG)
def test_value_that_is_not_allowed(path, value, says):
    _, where, complaint = place_of_error(with_text(path.split("[")[0], value))
    assert where.removesuffix(".covariance") == path
    assert says in complaint


@pytest.mark.parametrize("above", [0, 0.5])
def test_aircraft_on_top_of_the_radar(above):
    """The cosine of 90° is 6e-17, so the poses miss a radar at their height by 3e-11 m."""
    text = yaml_text(document(radar__position_m=[5e5, 0, above - 3e3]))
    line, where, complaint = place_of_error(text)
    assert (where, text.splitlines()[line - 1]) == ("geometry", "  type: orbit")
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
    """Among the names of levels, which are free, the reader gets as far as the value."""
    alias, fuse = "*" + re.findall(r"&(\w+)", bomb)[-1], indent(bomb, "    ")
    for path in ("radar.constant", "aircraft.rcs", RADAR):
        text = with_text(path, alias)
        *_, message = place_of_error(f"junk:\n{fuse}{text}")
        assert "junk" in message
        rest = re.sub("(?ms)^uncertainty:.*(?=^analysis:)", "", text)
        place_of_error(f"uncertainty:\n  radar:\n{fuse}{rest}")


def test_mapping_inside_itself():
    for path in ("radar", "uncertainty.radar", "uncertainty.radar.low"):
        loop = dict.fromkeys(reduce(dict.get, path.split("."), PAPER), "*loop")
        place_of_error(with_text(path, f"&loop {loop}".replace("'", "")))
    for rows in ("&m [*m, *m, *m, *m]", "&m [&r [*r, *r, *r, *r], *r, *r, *r]"):
        place_of_error(with_text(RADAR, f"{{covariance: {rows}}}"))


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
    write(with_text("name", name))
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
    text = yaml_text(document(radar__position_m="&zero [0, 0, 0]", aircraft__attitude_deg="*zero"))
    expected = scenario(aircraft__attitude_deg=[0, 0, 0]).resolved()
    assert rs.parse_scenario(text.replace("'", "")).resolved() == expected


def few_poses(seed: str) -> str:
    """Write the paper's scenario with a seed, and return the name of the file."""
    return write(
        default_text().replace("step: 0.5", "step: 45").replace("seed: 1", f"seed: {seed}")
    )


def draws(tool, seed: str, *options: str) -> tuple[bytes, int]:
    """CSV and recorded seed of a small Monte Carlo with a seed in the file."""
    run = few_poses(seed), "--runs", "3", "--no-plot", "-q", *options
    assert tool("montecarlo", *run)[:2] == (0, "")
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
    for args in ([few_poses("9" * 5000)], ["--seed", "9" * 5000]):
        one_line(tool, "montecarlo", *args, "--runs", "2", "--no-plot")


@pytest.mark.parametrize(
    ("start", "stop", "step", "expected"),
    [
        (0, 180, 0.1, [k / 10 for k in range(1801)]),
        (0, 0.3, 0.1, [0, 0.1, 0.2, 0.3]),
        (180, 0, -60, [180, 120, 60, 0]),
        (-10, 10, 7, [-10, -3, 4]),
    ],
)
def test_sweep(start, stop, step, expected):
    sweep = {"start": start, "stop": stop, "step": step}
    assert scenario(geometry__azimuth_deg=sweep).axis.values.tolist() == expected


# Units: against arithmetic that is not the package's.


def test_units_become_si():
    s = scenario(
        radar__position_m=[100, -200, -30],
        aircraft__attitude_deg=[5, -10, 270],
        geometry__range_km=12.5,
        geometry__down_km=-1.5,
    )
    assert s.radar.tolist() == [100, -200, -30, 167]
    theta, expected = np.radians(s.axis.values), np.empty((361, 6))
    expected[:, :3] = np.stack([12500 * np.sin(theta), 12500 * np.cos(theta), 0 * theta - 1500], 1)
    expected[:, 3:] = [math.radians(a) for a in (5, -10, 270)]
    # A micrometre, and 1e-15 rad: the rounding of these numbers, a few times over.
    np.testing.assert_allclose(s.aircraft[:, :3], expected[:, :3], rtol=0, atol=1e-10)
    np.testing.assert_allclose(s.aircraft[:, 3:], expected[:, 3:], rtol=0, atol=2e-15)


@pytest.mark.parametrize("value", [10, [10, 10.0, 1e1], np.diag([100, 100, 100]).tolist()])
def test_uncertainties_become_si(value):
    """A deviation can be written in three ways."""
    s = scenario(uncertainty__aircraft={"position_m": value, "attitude_deg": [1, 2, 3]})
    variances = [100.0] * 3 + [math.radians(a) ** 2 for a in (1, 2, 3)]
    assert s.cov_aircraft == pytest.approx(np.diag(variances), rel=1e-15, abs=0)
    assert (cov_by_level(s)["medium"] == np.diag([1e4, 1e4, 1e4, 25])).all()
    assert s.levels == ("low", "medium", "high")


def test_full_covariances_are_in_the_units_of_their_keys():
    factor = np.random.default_rng(3).normal(size=(6, 6)).round(3)
    aircraft = (factor @ factor.T + np.eye(6)).round(6)

    def of_aircraft(**uncertainty):
        return scenario(uncertainty__aircraft=uncertainty).cov_aircraft

    unit = np.array([1, 1, 1] + [math.radians(1)] * 3)
    expected = aircraft * np.outer(unit, unit)
    assert of_aircraft(covariance=aircraft.tolist()) == pytest.approx(expected, rel=1e-15)
    of_radar = {"covariance": aircraft[:4, :4].tolist()}
    s = scenario(uncertainty__radar__medium=of_radar)
    assert (cov_by_level(s)["medium"] == aircraft[:4, :4]).all()
    # Blocks on the diagonal are the same as keys of their own.
    blocks = {"position_m": aircraft[:3, :3].tolist(), "attitude_deg": aircraft[3:, 3:].tolist()}
    aircraft[:3, 3:] = aircraft[3:, :3] = 0
    whole = of_aircraft(covariance=aircraft.tolist())
    assert of_aircraft(**blocks) == pytest.approx(whole, rel=1e-15, abs=0)


def test_singular_covariances_are_covariances():
    def read(**level):
        return scenario(uncertainty__radar__medium=level).cov_radar

    assert (read(covariance=np.ones((4, 4)).tolist()) == 1).all()
    assert not read(position_m=0, constant=0).any()
    # Rounded entries become symmetric.
    rounded = read(position_m=[[1, 0.3, 0], [0.30000000000000004, 1, 0], [0, 0, 1]], constant=5)
    assert (rounded == rounded.T).all()
    # Written with six digits, as programs do, a full correlation is off by rounding only.
    read(position_m=[[1, 2, 0], [2, 4, 0], [0, 0, 0]], constant=5)
