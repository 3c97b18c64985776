"""The public names: `rs.__all__`, and the help of the analyses."""

import inspect
import pydoc

import pytest

import radar_sense as rs
from radar_sense import cli
from radar_sense.command import Command

ANALYSES = {
    name: value
    for name, value in vars(rs.analyses).items()
    if isinstance(value, Command) and value.__name__ == name
}


def test_each_public_object_has_one_name():
    values = [getattr(rs, name) for name in rs.__all__]
    assert len({id(value) for value in values}) == len(values)
    assert rs.__all__ == sorted(set(rs.__all__))
    for name in ("Axis", "ComputationError", "FigureError", "Result", "Route", "Tolerance"):
        assert name in rs.__all__
    assert set(rs.__all__) <= set(dir(rs))


def test_every_analysis_is_in_analyses_alone():
    assert not any(
        isinstance(getattr(rs, name), Command) for name in rs.__all__ if name != "report"
    )
    assert {value.name for value in ANALYSES.values()} == set(cli.commands())
    assert rs.analyses.map is rs.analyses.coverage_map  # the command, and its name in Python


def test_only_the_listed_names_can_be_imported():
    with pytest.raises(AttributeError, match="has no attribute 'mission_of'"):
        _ = rs.mission_of


@pytest.mark.parametrize("name", ANALYSES)
def test_help_and_signature_have_all_options(name):
    command = ANALYSES[name]
    assert command.__name__ == name
    parameters = inspect.signature(command).parameters
    shared = {"level", "radar", "method", "runs", "seed"}
    assert set(parameters) == {"scenario", *command.defaults} | shared
    shown = pydoc.render_doc(command, renderer=pydoc.plaintext)
    assert command.help.splitlines()[0] in shown
    assert {option.name for option in command.options} <= set(parameters) | {"dask"}
