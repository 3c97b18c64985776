"""The output shown in the README is the output of the commands."""

import re

import pytest
from click.testing import CliRunner
from helpers import ROOT

from radar_sense.cli import cli
from radar_sense.scenario_file.load import load_scenario, parse_scenario

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_scenario_shown_is_the_papers():
    (text,) = blocks("yaml")
    assert parse_scenario(text).resolved() == load_scenario().resolved()


def test_the_python_shown_runs():
    (code,) = blocks("python")
    names = {}
    exec(code, names)
    assert 3 * names["sigma_pd"][90] == pytest.approx(0.0912, abs=5e-5)
    assert names["mc"].runs == 500


def test_the_output_shown_is_printed(tmp_path, monkeypatch):
    shown = re.search(r"    \$ radar-sense budget\n((?:    .*\n)+)", README).group(1)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli, ["budget"])
    lines = [line.removeprefix("    ") for line in shown.splitlines()]
    warnings = [line for line in lines if line.startswith("Warning: ")]
    assert [line for line in lines if line not in warnings] == result.stdout.splitlines()
    assert warnings == result.stderr.splitlines()


def test_every_command_is_named():
    for command in cli.list_commands(None):
        assert f"radar-sense {command}" in README or f"| `{command}` |" in README


def test_the_text_of_the_package_has_no_link_that_leads_nowhere():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (text,) = re.findall(r'^readme = .*text = """(.*?)"""', project, re.S | re.M)
    links = re.findall(r"\]\(([^)]*)\)", text)
    assert links
    assert all(link.startswith("https://") for link in links)
