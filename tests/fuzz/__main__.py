"""Run random cases for some seconds, and print a reproducer of each failure: `make fuzz`."""

from __future__ import annotations

import argparse
import functools
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import NoReturn

sys.path.insert(0, str(Path(__file__).parent.parent))

from fuzz.properties import BrokenError, failures, reproducer

from radar_sense.montecarlo import adaptive
from radar_sense.reporting import evidence

#: Seconds after which a case hangs.
TOO_LONG = 120


def _hangs(number: int, frame: object) -> NoReturn:
    raise BrokenError(f"is not done after {TOO_LONG} s")


def _draw_few() -> None:
    """Let `validate` and `report` draw less, because their draws take most of the time."""
    adaptive.LEAST_DRAWS, adaptive.LEAST_OUTSIDE = 100, 1
    adaptive.validate = functools.partial(adaptive.validate, max_runs=5000)
    evidence.DRAWS = 200


def main() -> int:
    """Return 1 if a property is broken, and 0 otherwise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 1_000_000)
    parser.add_argument("--analyses", type=float, default=0.3, help="part that is not `check`")
    parser.add_argument("--slow", type=float, default=0.1, help="part of these that is slow")
    parser.add_argument("--case", type=int, help="only the case of this number")
    given = parser.parse_args()
    signal.signal(signal.SIGALRM, _hangs)
    _draw_few()
    end, number, broken = time.monotonic() + given.seconds, given.case or 0, 0
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        while given.case in (None, number) and (number == given.case or time.monotonic() < end):
            signal.alarm(TOO_LONG)
            shares = {"analyses": given.analyses, "slow": given.slow}
            for _, case, error in failures(given.seed, [number], **shares):
                broken += 1
                print(f"--- seed {given.seed}, case {number}\n{error}\n{reproducer(case)}\n")
            number += 1
        signal.alarm(0)
        os.chdir("/")
    print(f"seed {given.seed}: {number} cases, {broken} broken")
    return 1 if broken else 0


sys.exit(main())
