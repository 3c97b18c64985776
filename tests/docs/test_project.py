"""What stands twice about the project stands there alike: versions, minimum versions, links."""

import re

import pytest
import yaml
from helpers import ROOT

import radar_sense as rs


def test_the_version_is_the_same_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == rs.__version__
    changes = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert changes[0] == rs.__version__


def test_the_oldest_versions_that_are_tested_are_those_that_are_declared():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (listed,) = re.findall(r"^dependencies = \[(.*?)^\]", project, re.MULTILINE | re.DOTALL)
    declared = dict(re.findall(r'"(\S+)>=([\d.]+)"', listed))
    tested = dict(re.findall(r"^(\w+)==([\d.]+)", (ROOT / ".github/oldest.txt").read_text(), re.M))
    for name, version in declared.items():
        assert f"{tested[name]}.".startswith(f"{version}."), name


def test_the_workflow_runs_every_python_that_is_declared():
    text = (ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8")
    matrix = yaml.safe_load(text)["jobs"]["tests"]["strategy"]["matrix"]
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert matrix["python"] == re.findall(r'Python :: (3\.\d+)"', project)
    assert len(matrix["os"]) == 3


@pytest.mark.parametrize("path", [*ROOT.glob(".github/**/*.yml"), ROOT / ".pre-commit-config.yaml"])
def test_files_of_the_forge_are_yaml(path):
    assert isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)
