"""Properties that hold for every input; a broken one is a `BrokenError`."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import re
import shlex
import tempfile
import traceback
import warnings
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from click.testing import CliRunner
from fuzz.drawing import CALLED, Case
from helpers import assert_same_scenario

import radar_sense as rs
from radar_sense import cli as command_line
from radar_sense.scenario_file.load import parse_scenario

#: Problems of a file as a whole, which are on no line.
_WHOLE_FILE = re.compile(
    r"is empty|is nested too deeply|has no rows|cannot be read|is larger than|is a directory"
    r"|is not a regular file|has \d+ row"
)


class BrokenError(AssertionError):
    """A property that does not hold."""


class Outcome(NamedTuple):
    """Exit code, both outputs, and the scenario that was read; None if it was refused."""

    code: int
    out: str
    err: str
    scenario: rs.Scenario | None = None


def check(case: Case, *, again: bool = False) -> Outcome:
    """Run a case in a folder of its own, and insist on all properties.

    A case that is run again must write the same numbers.
    """
    back = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            return _check(case, again)
        finally:
            os.chdir(back)


def _check(case: Case, again: bool) -> Outcome:
    for name, content in case.files.items():
        Path(name).write_bytes(content)
    outcome = run(case)
    written = sorted({*Path().rglob("*")} - {*map(Path, case.files)})
    _require(outcome.code in (0, 2, 3), f"exit code {outcome.code}", outcome)
    if outcome.code == 2:
        _check_refusal(case, outcome, written)
        return outcome
    for line in outcome.err.splitlines():
        _require(line.startswith("Warning: "), f"on standard error: {line!r}", outcome)
    if "--quiet" in case.args and "--json" not in case.args:
        _require(not outcome.out and not outcome.err, "words in spite of -q", outcome)
    elif case.args[0] == "check":
        _check_reads_back(outcome)
    _check_files(outcome, written)
    if again:
        tables = [path for path in written if path.suffix in (".csv", ".npz")]
        first = [path.read_bytes() for path in tables]
        run(case)
        _require(first == [path.read_bytes() for path in tables], "other numbers", outcome)
    return outcome


def run(case: Case) -> Outcome:
    """Run a case in the working folder; every Python warning is an error."""
    read: list[rs.Scenario] = []

    def scenario(path: Path | None, changes: tuple[str, ...]) -> rs.Scenario:
        read.append(original(path, changes))
        return read[-1]

    original = command_line._scenario

    with warnings.catch_warnings(), mock.patch.object(command_line, "_scenario", scenario):
        warnings.simplefilter("error")
        result = CliRunner().invoke(command_line.cli, list(case.args))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise BrokenError("".join(traceback.format_exception(result.exception)))
    return Outcome(result.exit_code, result.stdout, result.stderr, *read)


def _check_refusal(case: Case, outcome: Outcome, written: list[Path]) -> None:
    _require(re.fullmatch(r"Error: [^\n]+\n", outcome.err), "not one line of error", outcome)
    _require(outcome.err.rstrip("\n").isprintable(), "control characters", outcome)
    _require(not outcome.out, "something on standard output", outcome)
    _require(not written, f"wrote {written}", outcome)
    _require(len(outcome.err) < 2000, "an error of more than 2000 characters", outcome)
    if case.args[0] == "check" and "must be KEY=VALUE" not in outcome.err:
        place = re.match(r"Error: ([\w./ -]+?):(\d+)?:? ", outcome.err)
        _require(place, "no file named", outcome)
        assert place
        lines = len(re.findall(rb"\r\n?|\n", case.files.get(place[1], b""))) + 1
        _require(
            _WHOLE_FILE.search(outcome.err)
            if place[2] is None
            else 1 <= int(place[2]) <= lines + 9,
            "no line named",
            outcome,
        )


def _check_reads_back(outcome: Outcome) -> None:
    """Insist that a resolved scenario reads back to the same scenario."""
    try:
        again = parse_scenario(outcome.out, "resolved.yaml")
        assert_same_scenario(again, outcome.scenario)
        assert again.resolved() == outcome.scenario.resolved(), "resolved again to another text"
    except (rs.InputError, AssertionError) as error:
        raise BrokenError(f"read back: {error}\n{outcome.out}") from error


def _check_files(outcome: Outcome, written: list[Path]) -> None:
    """Insist on numbers, on probabilities within 0 and 1, and on a record beside each table."""
    no_number = re.search(r"(?<![\w.-])(nan|None|inf)(?![\w.-])", outcome.out)
    _require(not no_number, "no number in the report", outcome)
    for path in written:
        if path.suffix == ".csv":
            rows = list(csv.reader(io.StringIO(path.read_text())))
            names, numbers = rows[0], np.array(rows[1:], dtype=float)
            columns = dict(zip(names, numbers.T, strict=True))
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                columns = {name: arrays[name] for name in arrays.files}
        elif path.suffix == ".json":
            json.loads(path.read_text(), parse_constant=lambda text: _not_json(text, outcome))
            continue
        else:
            continue
        _require(path.with_suffix(".json") in written, f"{path} without a record", outcome)
        for name, values in columns.items():
            _require(len(values), f"{name} is empty", outcome)
            # a radar that cannot see the aircraft has no SNR, -inf dB; at the radar it is inf
            in_decibels = name.startswith("snr_db") or name.endswith("3sigma_margin_db")
            shown = values[~np.isinf(values)] if in_decibels else values
            _require(not np.isinf(shown).any(), f"{name} has infinity", outcome)
            # a share of no variance is NaN
            if np.isnan(values).any() and not name.startswith("share_"):
                told = "Warning: " in outcome.err or "has no value" in outcome.out
                told |= not outcome.out or '"no_value"' in outcome.out  # -q, also with --json
                _require(told, f"{name} has NaN without a word", outcome)
            finite = values[~np.isnan(values)]
            if re.fullmatch(r"p_d(_\w+)?|mc_mean|mc_lower|mc_upper|coverage_3sigma", name):
                ok = np.all((finite >= 0) & (finite <= 1))
                _require(ok, f"{name} is no probability: {finite}", outcome)
            if re.match(r"sigma|mc_std|three_sigma", name):
                _require(np.all(finite >= 0), f"{name} is negative: {finite}", outcome)


def _not_json(text: str, outcome: Outcome) -> None:
    _require(False, f"{text} in the record", outcome)


def _require(holds: object, what: str, outcome: Outcome) -> None:
    if not holds:
        shown = f"exit code {outcome.code}\n{outcome.out[:2000]}\n{outcome.err[:2000]}"
        raise BrokenError(f"{what}\n{shown}")


def reproducer(case: Case) -> str:
    """Return shell commands that make the files of a case and run the command."""
    lines = []
    for name, content in case.files.items():
        with contextlib.suppress(UnicodeDecodeError):
            lines.append(f"# {name}:\n" + content.decode())
        lines.append(f"python3 -c \"open('{name}', 'wb').write({content!r})\"")
    lines.append(shlex.join(["radar-sense", *case.args]))
    return "\n".join(lines)


def check_call(name: str, given: dict[str, Any]) -> bool:
    """Call a function of Python, insist on a result or one line of error, and return which."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            CALLED[name](**given)
        except ValueError as error:
            if not str(error).isprintable():
                raise BrokenError(f"rs.{name}(**{given!r}): not one line: {error}") from error
            return False
        except Exception as error:
            trace = "".join(traceback.format_exception(error))
            raise BrokenError(f"rs.{name}(**{given!r})\n{trace}") from error
    return True
