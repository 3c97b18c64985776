"""A wrong option in Python is an InputError of one line, before any model is evaluated."""

import numpy as np
import pytest
from helpers import CONFIGS, no_physics

import radar_sense as rs
from radar_sense import cli
from radar_sense.options import LEVEL, NUMBER_OF_RUNS, ONE_RADAR, SEED_OF_DRAWS

NETWORK = rs.load_scenario(CONFIGS / "network.yaml")
ALL = {name: cli.load(name) for name in cli.commands()}
SHARED = [LEVEL, ONE_RADAR, NUMBER_OF_RUNS, SEED_OF_DRAWS]
#: Each command with the options that are its own, and the options that all commands have. `dask`
#: is an option of the command line only.
CASES = {
    f"{name}-{option.name}": (command, option)
    for name, command in ALL.items()
    for option in (*SHARED, *command.options)
    if option.name != "dask"
}
#: What is required besides.
REQUIRED = {"sweep": {"key": "name", "start": 1, "stop": 2, "step": 1}}


def beyond(limit):
    """Yield numbers out of a limit, and values that are no number."""
    yield from ("a", "1", True, np.nan, np.inf, 1j, None)
    if limit.above is not None:
        yield limit.above
    if limit.at_least is not None:
        yield limit.at_least - 1
    if limit.below is not None:
        yield limit.below
    if limit.at_most is not None:
        yield 2 * limit.at_most
    if limit.whole:
        yield 2.5


def wrong_values(option):
    """Yield wrong values of an option: other types, out of the limit, and unknown words."""
    if option.flag:
        yield from ("yes", 1, [True], None)
    elif option.limit is None:
        yield from ("nonsense",) * (not option.positional)
        yield from (3, b"linear", ["linear"], np.array(["linear", "form"]))
    elif option.count > 1:
        yield from (5, (1.0,) * (option.count + 1))
        yield from ((0.5,) * (option.count - 1) + (number,) for number in beyond(option.limit))
    elif option.multiple:
        yield from beyond(option.limit)
        yield from ((0.5, number) for number in beyond(option.limit))
    else:
        yield from (*(n for n in beyond(option.limit) if n is not None), (1,), np.ones(2))


@pytest.mark.parametrize("case", CASES)
def test_a_wrong_option_is_refused_before_anything_is_computed(case):
    command, option = CASES[case]
    for value in wrong_values(option):
        with no_physics(), pytest.raises(rs.InputError) as error:
            command(NETWORK, **{**REQUIRED.get(command.name, {}), option.name: value})
        message = str(error.value)
        assert message.startswith(f"{option.name} must be "), message
        assert len(message) < 200
        if isinstance(value, str):
            assert repr(value) in message


def test_one_number_is_one_value_where_several_are_allowed():
    few = NETWORK.at_poses(slice(0, 1))
    for p_d in (0.5, np.float64(0.5), [0.5], (0.5,), np.array([0.5])):
        found = rs.analyses.detection_range(
            few, radar="ridge", p_d=p_d, step_deg=90, method="linear"
        )
        assert found.summary["p_d"] == [0.5]
    area = {"north_km": np.array([0, 100]), "east_km": [0, 100], "step_km": np.array(50)}
    assert rs.analyses.coverage_map(few, p_d=0.3, **area).summary["contours"] == [0.3]


def test_what_computes_is_checked_too():
    with no_physics(), pytest.raises(rs.InputError, match=r"^executor must be an? \w+, got 'a'$"):
        rs.analyses.compare(NETWORK, executor="a")


def test_a_whole_number_may_be_a_float():
    found = rs.analyses.convergence(NETWORK.at_poses(slice(0, 1)), runs=2.0)
    assert found.table["runs"].tolist() == [2]
