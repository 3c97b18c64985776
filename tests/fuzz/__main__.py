"""Run random cases for some seconds, and print a reproducer of each failure: `make fuzz`."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import NoReturn

sys.path.insert(0, str(Path(__file__).parent.parent))

from fuzz.properties import BrokenError, failures, reproducer

from radar_sense.montecarlo import adaptive

#: Seconds of this process, and of the clock, after which a case hangs.
TOO_LONG = {signal.ITIMER_PROF: 60, signal.ITIMER_REAL: 600}


def _hangs(number: int, frame: object) -> NoReturn:
    raise BrokenError("is not done after 60 s of computing, or 600 s")


def _draw_few() -> None:
    """Let `validate` and `compare` draw less, because their draws take most of the time."""
    adaptive.DRAWS, adaptive.MOST_BATCHES = 512, 4
    import_module("radar_sense.analyses.validate").RUNS = 200
    import_module("radar_sense.analyses.compare").TOGETHER = 1e4


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
    signal.signal(signal.SIGPROF, _hangs)
    _draw_few()
    end, number, broken = time.monotonic() + given.seconds, given.case or 0, 0
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        while given.case in (None, number) and (number == given.case or time.monotonic() < end):
            for timer, seconds in TOO_LONG.items():
                signal.setitimer(timer, seconds)
            shares = {"analyses": given.analyses, "slow": given.slow}
            for _, case, error in failures(given.seed, [number], **shares):
                broken += 1
                print(f"--- seed {given.seed}, case {number}\n{error}\n{reproducer(case)}\n")
            number += 1
        for timer in TOO_LONG:
            signal.setitimer(timer, 0)
        os.chdir("/")
    print(f"seed {given.seed}: {number} cases, {broken} broken")
    return 1 if broken else 0


sys.exit(main())
