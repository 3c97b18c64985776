"""Six hundred random cases; `make fuzz` runs more, with figures and slow commands."""

from __future__ import annotations

import pytest
import yaml
from fuzz.grammar import ANALYSES
from fuzz.properties import check, failures, numbered_case, reproducer

#: Another seed is as good. A failure prints a reproducer.
SEED = 1

compose = yaml.compose


@pytest.fixture
def fast_yaml(monkeypatch):
    """Parse YAML in C, which takes a tenth of the time.

    A text that the parser in C refuses is parsed again by the package's own parser, which accepts
    fewer tabs. `make fuzz` uses the package's own parser only.
    """
    if not hasattr(yaml, "CBaseLoader"):
        pytest.skip("PyYAML is without libyaml")

    def compose_in_c(text, Loader):  # noqa: N803
        try:
            return compose(text, Loader=yaml.CBaseLoader)
        except yaml.YAMLError:
            return compose(text, Loader=Loader)

    monkeypatch.setattr(yaml, "compose", compose_in_c)


def insist(seed, numbers, *, analyses):
    for _, case, error in failures(seed, numbers, analyses=analyses):
        pytest.fail(f"{error}\n{reproducer(case)}", pytrace=False)


def test_random_scenarios_are_read_or_refused(tmp_path, monkeypatch, fast_yaml):
    monkeypatch.chdir(tmp_path)
    insist(SEED, range(480), analyses=0.0)


def test_random_scenarios_in_the_parser_of_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    insist(SEED + 2, range(60), analyses=0.0)


@pytest.mark.usefixtures("few_judge")
def test_random_analyses_end_in_numbers_or_one_line(tmp_path, monkeypatch, fast_yaml):
    monkeypatch.chdir(tmp_path)
    insist(SEED + 1, range(30), analyses=1.0)


def test_the_cases_are_neither_all_good_nor_all_bad(tmp_path, monkeypatch, fast_yaml):
    monkeypatch.chdir(tmp_path)
    codes = [check(numbered_case(SEED, n, analyses=0.0)).code for n in range(24)]
    assert 3 < codes.count(0) < 21
    commands = {numbered_case(SEED, n, analyses=1.0).args[0] for n in range(200)}
    assert commands == set(ANALYSES)
