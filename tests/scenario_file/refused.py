"""Refusals, as the tests of this folder insist on them."""

import re
from contextlib import contextmanager

import pytest
from helpers import place

from radar_sense.errors import InputError
from radar_sense.scenario_file.load import parse_scenario


@contextmanager
def refused(says):
    """Insist on an error of one line with some words: `...` is any letters, a last `$` the end."""
    with pytest.raises(InputError) as caught:
        yield caught
    message, ends = str(caught.value), says.endswith("$")
    pattern = ".*".join(map(re.escape, says.removesuffix("$").split("..."))) + "$" * ends
    assert "\n" not in message
    assert re.search(pattern, message), message


def place_of_error(text):
    """Insist that a scenario is refused; return number of the line, path of the key and message."""
    with refused("my.yaml:") as caught:
        parse_scenario(text, "my.yaml")
    return place(f"Error: {caught.value}")
