"""Fixtures: the command line in this process (a new process takes a second), and a fake command."""

from __future__ import annotations

import gc
import os
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

# One process a core runs the tests. Threads of the linear algebra would take a quarter of all CPU
# time to wait for each other. The library reads the variable when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from click.testing import CliRunner
from helpers import EXPLAINED, few_judging_draws

from radar_sense import analyses
from radar_sense import cli as command_line
from radar_sense.cli import cli
from radar_sense.command import Command, Result, command
from radar_sense.scenario import Scenario
from radar_sense.scenario_file import place
from radar_sense.scenario_file.load import default_text

# The same scenarios are read again and again, and PyYAML takes 20 ms for one of a hundred lines.
# Each reader gets nodes of its own.
_compose = place.compose
_composed = cache(lambda text, file: pickle.dumps(_compose(text, file), pickle.HIGHEST_PROTOCOL))
place.compose = lambda text, file: pickle.loads(_composed(text, file))

#: Folders whose claims are about the judgement of methods by draws, or about printed numbers.
JUDGING = ("acceptance", "docs", "montecarlo", "propagation", "reference", "studies")


def pytest_collection_finish() -> None:
    """Take modules and tests, which stay to the end, out of the garbage collection."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)  # a twentieth of all CPU time


class Outcome(NamedTuple):
    """Exit code and output of a run of the tool."""

    code: int
    out: str
    err: str


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def tool(here: Path) -> Callable[..., Outcome]:
    """Run the tool with the given arguments in an empty folder, which is the current one."""

    def run(*args: object) -> Outcome:
        result = CliRunner().invoke(cli, [str(arg) for arg in args])
        # Anything but SystemExit would have been a traceback, a Python warning among them.
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return Outcome(result.exit_code, result.stdout, result.stderr)

    return run


@pytest.fixture(autouse=True)
def every_result_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a result fail that has a column without a meaning, or a warning without a known name."""
    call = Command.__call__

    def checked(self: Command, scenario: Scenario, **options: Any) -> Any:
        result = call(self, scenario, **options)
        for warning in result.warnings:
            name = warning.rpartition(" [")[2]
            assert name.endswith("]"), warning
            assert name[:-1] in EXPLAINED, warning
        if isinstance(result, Result):
            assert list(result.columns) == list(result.table)
        return result

    monkeypatch.setattr(Command, "__call__", checked)


@pytest.fixture
def few_judge(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let few draws judge a method: how they judge is tested in `tests/propagation`.

    The mark `all_draws` is for a test whose claim is about the judgement.
    """
    if not request.node.get_closest_marker("all_draws"):
        few_judging_draws(monkeypatch)


@pytest.fixture(autouse=True)
def few_judge_elsewhere(request: pytest.FixtureRequest) -> None:
    """Let few draws judge a method in tests whose claim is another."""
    if request.path.parent.name not in JUDGING:
        request.getfixturevalue("few_judge")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, few_judge: None) -> None:
    """Let the embedded scenario have 13 poses in place of 361, for tests whose claim is another."""
    text = default_text().replace("step: 0.5", "step: 15")
    monkeypatch.setattr("radar_sense.scenario_file.load.default_text", lambda: text)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], None]:
    """Let the command `fake` compute by calling a function."""
    known = command_line.commands()

    def register(function: Callable[[], object]) -> None:
        def run(scenario):
            """Fake."""
            function()
            result = Result(scenario)
            result.table.add("x", scenario.axis.values, "A place.")
            result.draw = lambda figure: figure.subplots()
            return result

        fake = command(examples=("radar-sense fake",), name="fake")(run)
        monkeypatch.setattr(analyses, "fake", fake, raising=False)
        monkeypatch.setattr(command_line, "commands", lambda: {**known, "fake": known["budget"]})

    return register
