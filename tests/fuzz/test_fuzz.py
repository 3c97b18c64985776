"""A few random cases of each kind, the same in every run; `make fuzz` runs many others."""

from __future__ import annotations

from collections import Counter

import pytest
from fuzz.drawing import FAST, broken, calls, checked, commands, each
from fuzz.properties import check, check_call, reproducer
from hypothesis import note


def ends(strategy, tens):
    """Insist on the properties of cases, and return how many ended with each exit code."""
    codes = Counter()

    def count(case):
        note(reproducer(case))
        codes[check(case).code] += 1

    for seed in range(tens):
        each(strategy, seed, count)
    return codes


def test_scenarios_of_the_schema_are_read_back_or_refused():
    codes = ends(checked(), 6)
    assert codes[0] > 30
    assert codes[2] > 0


@pytest.mark.parametrize("ending", [".yaml", ".csv", ".gpx"])
def test_broken_files_are_read_or_refused(ending):
    codes = ends(broken(ending), 3)
    assert codes[0] > 0
    assert codes[2] > 10


def test_command_lines_end_in_numbers_or_one_line():
    codes = ends(commands(FAST), 2)
    assert codes[0] + codes[3] > 3


def test_calls_end_in_a_result_or_one_line():
    for seed in range(12):
        each(calls(), seed, lambda call: check_call(*call))
