"""Ctrl-C and SIGTERM at any moment: one line, exit code 130, and whole files or none."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT

#: What a run says when it is interrupted: before, among and after its files.
LINES = (
    "Interrupted; nothing was written.",
    "Interrupted; files of two runs may stand side by side, the record tells.",
    "Interrupted; all files were written.",
)
#: A run of the tool that tells when the handlers are set: no program handles a signal before.
STARTED = """
import os, signal
from radar_sense.__main__ import end_at_once, main
signal.signal(signal.SIGINT, end_at_once)
signal.signal(signal.SIGTERM, end_at_once)
os.write(1, b".")
main()
"""
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
NAMES = {"paper_variance.csv", "paper_variance.json"}


def interrupted(folder: Path, number: int, seconds: float) -> tuple[int, str]:
    """Return exit code and standard error of a run with a signal after some seconds."""
    run = [sys.executable, "-c", STARTED, "variance", "--no-plot"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(run, cwd=folder, env=ENVIRONMENT, text=True, **pipes)
    process.stdout.read(1)
    time.sleep(seconds)
    process.send_signal(number)
    _, err = process.communicate()
    return process.returncode, err


def test_nothing_is_imported_before_signals_are_handled():
    lines = "import sys; before = {*sys.modules}; import radar_sense.__main__; "
    lines += "print(*sorted({*sys.modules} - before))"
    run = [sys.executable, "-c", lines]
    done = subprocess.run(run, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["radar_sense", "radar_sense.__main__"]


@pytest.mark.parametrize(("number", "times"), [(signal.SIGINT, 2), (signal.SIGTERM, 1)])
def test_a_signal_at_a_random_moment(tmp_path, number, times):
    (tmp_path / "figures").mkdir()
    for seconds in np.random.default_rng(number).uniform(0.0, 1.0, times):
        code, err = interrupted(tmp_path, number, seconds)
        lines = [line for line in err.splitlines() if line and not line.startswith("Warning: ")]
        assert (code, lines) == (0, []) or (code == 130 and lines[0] in LINES), (seconds, err)
        assert {path.name for path in (tmp_path / "figures").iterdir()} in (set(), NAMES)
