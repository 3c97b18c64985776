"""Some hundred random cases; `make fuzz` runs more of them."""

from __future__ import annotations

import pytest
from fuzz.grammar import ANALYSES
from fuzz.properties import check, failures, numbered_case, reproducer

#: Another seed is as good. A failure prints a reproducer.
SEED = 1


def insist(seed, numbers, *, analyses):
    for _, case, error in failures(seed, numbers, analyses=analyses):
        pytest.fail(f"{error}\n{reproducer(case)}", pytrace=False)


@pytest.mark.parametrize("part", range(2))
def test_random_scenarios_are_read_or_refused(tmp_path, monkeypatch, part):
    monkeypatch.chdir(tmp_path)
    insist(SEED, range(part * 80, (part + 1) * 80), analyses=0.0)


def test_random_analyses_end_in_numbers_or_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    insist(SEED + 1, range(20), analyses=1.0)


def test_the_cases_are_neither_all_good_nor_all_bad(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    codes = [check(numbered_case(SEED, n, analyses=0.0)).code for n in range(24)]
    assert 3 < codes.count(0) < 21
    commands = {numbered_case(SEED, n, analyses=1.0).args[0] for n in range(200)}
    assert commands == set(ANALYSES)
