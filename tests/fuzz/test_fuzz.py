"""A few random cases of each kind, the same in every run; `make fuzz` runs many others."""

from __future__ import annotations

import contextlib
from collections import Counter
from pathlib import Path

import pytest
from editor import judged
from fuzz.drawing import CONFIG, FAST, broken, calls, checked, commands, each
from fuzz.properties import check, check_call, reproducer
from hypothesis import note


def ends(strategy, tens, judge=lambda case: None):
    """Insist on the properties of cases, and return how many ended with each exit code."""
    codes = Counter()

    def count(case):
        note(reproducer(case))
        codes[check(case).code] += 1
        judge(case)

    for seed in range(tens):
        each(strategy, seed, count)
    return codes


@pytest.fixture
def judge(tmp_path, monkeypatch):
    """Return a function that lets reader and schema judge a scenario, and its count of verdicts."""
    monkeypatch.chdir(tmp_path)
    verdicts = Counter()

    def judge(case):
        for name, content in case.files.items():
            Path(name).write_bytes(content)
        with contextlib.suppress(UnicodeDecodeError):
            verdicts[judged(case.files[CONFIG].decode())] += 1

    return judge, verdicts


def test_scenarios_of_the_schema_are_read_back_or_refused(judge):
    codes = ends(checked(), 1, judge[0])
    assert codes[0] > 3
    assert codes[2] > 0
    assert judge[1][False, False] > 3


@pytest.mark.parametrize("ending", [".yaml", ".csv", ".gpx"])
def test_broken_files_are_read_or_refused(ending, judge):
    codes = ends(broken(ending), 1, *judge[:1] * (ending == ".yaml"))
    assert codes[0] > 0
    assert codes[2] > 3
    assert judge[1][True, True] > 3 or ending != ".yaml"


def test_command_lines_end_in_numbers_or_one_line():
    codes = ends(commands(FAST), 1)
    assert codes[0] + codes[3] > 1


def test_calls_end_in_a_result_or_one_line():
    for seed in range(6):
        each(calls(), seed, lambda call: check_call(*call))
