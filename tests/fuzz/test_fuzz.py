"""A few random cases of each kind, the same in every run; `make fuzz` runs many others."""

from __future__ import annotations

from collections import Counter

import pytest
from fuzz.drawing import FAST, FEW, broken, calls, checked, commands
from fuzz.properties import check, check_call, reproducer
from hypothesis import given, note, settings


def codes(strategy, cases):
    """Insist on the properties of some cases, and return how many ended with each exit code."""
    counts = Counter()

    @settings(FEW, max_examples=cases)
    @given(strategy)
    def run(case):
        note(reproducer(case))
        counts[check(case).code] += 1

    run()
    return counts


def test_scenarios_of_the_schema_are_read_back_or_refused():
    ended = codes(checked(), 80)
    assert ended[0] > 40
    assert ended[2] > 1


@pytest.mark.parametrize("ending", [".yaml", ".csv", ".gpx"])
def test_broken_files_are_read_or_refused(ending):
    ended = codes(broken(ending), 40)
    assert ended[2] > 20


@pytest.mark.usefixtures("few_judge")
def test_command_lines_end_in_numbers_or_one_line():
    ended = codes(commands(FAST), 25)
    assert ended[0] + ended[3] > 5


@settings(FEW, max_examples=200)
@given(calls())
def test_calls_end_in_a_result_or_one_line(call):
    check_call(*call)
