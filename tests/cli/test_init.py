"""`init`: scenarios to start from, with nothing overwritten."""

from pathlib import Path

import pytest
import yaml
from helpers import CONFIGS, ROOT, one_line

from radar_sense.scenario_file import starters
from radar_sense.scenario_file.load import default_text

pytestmark = pytest.mark.usefixtures("quick")

#: What each starter is for, by its option.
ANALYSES = {
    "": "sensitivity",
    "--network": "variance --radar ridge",
    "--route": "variance",
    "--data-sheet": "budget --method form",
}


def contents():
    return {path.name: path.read_bytes() for path in Path().iterdir() if path.is_file()}


def test_the_scenario_of_the_paper(tool):
    code, out, err = tool("init", "my.yaml")
    assert (code, err) == (0, "")
    assert out == "my.yaml written\nnext: radar-sense check my.yaml\n"
    (name, text), *_ = contents().items()
    assert name == "my.yaml"
    assert "\nname: my    " in text.decode()
    assert text.decode().replace("name: my   ", "name: paper") == default_text()
    assert tool("init", "-") == (0, default_text(), "")
    assert tool("variance", "my.yaml", "--no-plot").code == 0
    assert Path("figures/my_variance.csv").is_file()


@pytest.mark.parametrize("option", ANALYSES)
def test_every_starter_runs(tool, option):
    code, out, err = tool("init", *option.split(), "sub/my.yaml")
    assert (code, err) == (0, "")
    assert "the folder sub is new" in out
    route = {"my_route.csv"} if option == "--route" else set()
    assert {path.name for path in Path("sub").iterdir()} == {"my.yaml", *route}
    assert all(str(Path("sub") / name) in out for name in ("my.yaml", *route))
    assert tool("check", "sub/my.yaml").code == 0
    assert tool(*ANALYSES[option].split(), "sub/my.yaml", "--no-plot").code == 0
    # over a third of the lines have a comment
    text = Path("sub/my.yaml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.strip()]
    assert sum("#" in line for line in lines) > len(lines) / 3


@pytest.mark.parametrize("name", [path.stem for path in sorted(CONFIGS.glob("*.yaml"))])
def test_every_example_is_a_start(tool, name):
    assert tool("init", "--from", name, "my.yaml").code == 0
    assert tool("check", "my.yaml").code == 0
    assert "\nname: my" in Path("my.yaml").read_text(encoding="utf-8")


def test_the_examples_are_in_the_wheel():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'force-include = { "configs" = "radar_sense/configs" }' in text
    assert len(starters.examples()) == len(list(CONFIGS.glob("*.yaml")))


@pytest.mark.parametrize("make", ["file", "folder", "dangling link"])
def test_nothing_is_overwritten(tool, make):
    path = Path("my.yaml")
    if make == "file":
        path.write_text("mine")
    elif make == "folder":
        path.mkdir()
    else:
        path.symlink_to("elsewhere.yaml")
    assert one_line(tool, "init", "my.yaml").startswith("Error: my.yaml: exists")
    assert [p.name for p in Path().iterdir()] == ["my.yaml"]
    assert make != "file" or path.read_text() == "mine"


def test_all_files_or_none(tool):
    Path("my_route.csv").write_text("mine")
    error = one_line(tool, "init", "--route", "my.yaml")
    assert error.startswith("Error: my_route.csv: exists already")
    assert contents() == {"my_route.csv": b"mine"}


@pytest.mark.parametrize("stem", ["x'y", 'x"y', "ä: #", "-"])
def test_the_route_of_any_name(tool, stem):
    assert tool("init", "--route", "--", f"{stem}.yaml").code == 0
    assert Path(f"{stem}_route.csv").is_file()
    assert yaml.safe_load(Path(f"{stem}.yaml").read_text(encoding="utf-8"))
    assert tool("check", "--", f"{stem}.yaml").code == 0
