"""`init`: scenarios to start from, written all or none, and nothing overwritten."""

import re
from pathlib import Path

import pytest
import yaml

from radar_sense import schema
from radar_sense.reading.parse import default_text

SCHEMA = schema.FILE_NAME
OPTIONS = {
    "": [],
    "network": ["--network"],
    "route": ["--route"],
    "data_sheet": ["--data-sheet"],
}
#: What each starter is for.
ANALYSES = {
    "": ["sensitivity"],
    "network": ["variance", "--radar", "ridge"],
    "route": ["mission", "--method", "probit"],
    "data_sheet": ["budget", "--target", "0.5"],
}


def contents():
    return {path.name: path.read_bytes() for path in Path().iterdir() if path.is_file()}


def test_the_scenario_of_the_paper(tool):
    code, out, err = tool("init")
    assert (code, err) == (0, "")
    assert out == (f"scenario.yaml written, with {SCHEMA}\nnext: radar-sense check scenario.yaml\n")
    assert contents() == {
        "scenario.yaml": f"# yaml-language-server: $schema={SCHEMA}\n{default_text()}".encode(),
        SCHEMA: schema.text().encode(),
    }
    assert tool("check", "scenario.yaml") == tool("check")
    assert tool("init", "-") == (0, default_text(), "")


@pytest.mark.parametrize("kind", OPTIONS)
def test_every_starter_runs(tool, kind):
    code, out, err = tool("init", *OPTIONS[kind], "sub/my.yaml")
    assert (code, err) == (0, "")
    assert "the folder sub is new" in out
    text = Path("sub/my.yaml").read_text(encoding="utf-8")
    # an editor finds the schema from the folder of the scenario
    (name,) = re.findall(r"\A# yaml-language-server: \$schema=(\S+)\n", text)
    assert (Path("sub") / name).is_file()
    route = {"my_route.csv"} if kind == "route" else set()
    assert {path.name for path in Path("sub").iterdir()} == {"my.yaml", SCHEMA, *route}
    assert all(str(Path("sub") / name) in out for name in ("my.yaml", SCHEMA, *route))
    assert tool("check", "sub/my.yaml").code == 0
    command, *options = ANALYSES[kind]
    assert tool(command, "sub/my.yaml", *options, "--no-plot").code == 0
    # over a third of the lines have a comment
    lines = [line for line in text.splitlines() if line.strip()]
    assert sum("#" in line for line in lines) > len(lines) / 3


@pytest.mark.parametrize("make", ["file", "folder", "dangling link"])
def test_nothing_is_overwritten(tool, make):
    path = Path("my.yaml")
    if make == "file":
        path.write_text("mine")
    elif make == "folder":
        path.mkdir()
    else:
        path.symlink_to("elsewhere.yaml")
    code, out, err = tool("init", "my.yaml")
    assert (code, out) == (2, "")
    assert re.fullmatch(r"Error: my\.yaml: exists[^\n]*\n", err)
    assert [p.name for p in Path().iterdir()] == ["my.yaml"]
    assert make != "file" or path.read_text() == "mine"


@pytest.mark.parametrize("name", ["my_route.csv", SCHEMA])
def test_all_files_or_none(tool, name):
    Path(name).write_text("mine")
    code, out, err = tool("init", "--route", "my.yaml")
    assert (code, out) == (2, "")
    assert err.startswith(f"Error: {name}: exists already")
    assert contents() == {name: b"mine"}


def test_the_schema_of_another_version_is_replaced(tool):
    assert tool("init", "one.yaml").code == 0
    Path(SCHEMA).write_text(schema.text().replace("ellipsoid", "ball"))
    assert tool("init", "--network", "two.yaml").code == 0
    assert contents()[SCHEMA] == schema.text().encode()
    # a copy of the schema under another name is a file like any other
    Path("three.yaml").write_text(schema.text())
    assert tool("init", "three.yaml").code == 2


@pytest.mark.parametrize("stem", ["a b", "x'y", 'x"y', "ä: #", "-", "1"])
def test_the_route_of_any_name(tool, stem):
    assert tool("init", "--route", "--", f"{stem}.yaml").code == 0
    assert Path(f"{stem}_route.csv").is_file()
    assert yaml.safe_load(Path(f"{stem}.yaml").read_text(encoding="utf-8"))
    assert tool("check", "--", f"{stem}.yaml").code == 0


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--route", "--network"], "exclude each other"),
        (["--route", "-"], "--route writes two files"),
        ([SCHEMA], "the name of the schema"),
    ],
)
def test_refusals(tool, args, words):
    code, out, err = tool("init", *args)
    assert (code, out) == (2, "")
    assert words in err
    assert contents() == {}
