"""Completion of commands, of options, and of the words that an option allows."""

import pytest
from click.shell_completion import ShellComplete

from radar_sense.cli import cli


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["va"], ["validate", "variance"]),
        (["montecarlo", "--sampler", ""], ["random", "sobol"]),
        (["variance", "--threshold", ""], []),
    ],
)
def test_completions(words, expected):
    *before, last = words
    shell = ShellComplete(cli, {}, "radar-sense", "_RADAR_SENSE_COMPLETE")
    assert [item.value for item in shell.get_completions(before, last)] == expected
