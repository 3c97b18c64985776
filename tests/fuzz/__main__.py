"""Run random cases for some seconds, count them by kind, and print each that breaks a property."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections import Counter
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

sys.path.insert(0, str(Path(__file__).parent.parent))

from fuzz.drawing import FAST, SLOW, Case, broken, calls, checked, commands, each
from fuzz.properties import BrokenError, check, check_call, reproducer

from radar_sense.montecarlo import adaptive

#: Seconds of this process, and of the clock, after which a case hangs.
TOO_LONG = {signal.ITIMER_PROF: 60, signal.ITIMER_REAL: 600}
KINDS = {
    "scenario from the schema": checked(),
    "broken YAML": broken(".yaml"),
    "broken CSV": broken(".csv"),
    "broken GPX": broken(".gpx"),
    "command line": commands((*FAST, *SLOW), figures=True),
    "call from Python": calls(),
}
ENDS = {0: "accepted", 2: "refused", 3: "accepted, and the answer is no"}


def _hangs(number: int, frame: object) -> NoReturn:
    raise BrokenError("is not done after 60 s of computing, or 600 s")


def _draw_few() -> None:
    """Let `validate` and `compare` draw less, because their draws take most of the time."""
    adaptive.PRECISE, adaptive.MOST_DRAWS = 512, 2048
    import_module("radar_sense.analyses.validate").RUNS = 200
    import_module("radar_sense.analyses.compare").TOGETHER = 1e4


def _end_of(case: Any) -> str:
    """Check a case and return how it ended; a broken property is printed."""
    for timer, seconds in TOO_LONG.items():
        signal.setitimer(timer, seconds)
    try:
        if isinstance(case, Case):
            return ENDS[check(case, again=case.args[0] in FAST).code]
        return ENDS[0 if check_call(*case) else 2]
    except BrokenError as error:
        print(f"---\n{error}\n{reproducer(case) if isinstance(case, Case) else ''}", flush=True)
        return "BROKEN"
    finally:
        for timer in TOO_LONG:
            signal.setitimer(timer, 0)


def main() -> int:
    """Return 1 if a property is broken, and 0 otherwise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 1_000_000)
    parser.add_argument("--kind", choices=KINDS, action="append", help="only cases of this kind")
    given = parser.parse_args()
    signal.signal(signal.SIGALRM, _hangs)
    signal.signal(signal.SIGPROF, _hangs)
    _draw_few()
    end, seed, counts = time.monotonic() + given.seconds, given.seed, Counter[tuple[str, str]]()

    def count(case: Any, kind: str) -> None:
        if time.monotonic() < end:
            counts[kind, _end_of(case)] += 1

    while time.monotonic() < end:
        for kind in given.kind or KINDS:
            each(KINDS[kind], seed, partial(count, kind=kind))
        seed += 1
    for (kind, how), number in sorted(counts.items()):
        print(f"{number:8,} {kind}: {how}")
    print(f"{counts.total():8,} cases from seed {given.seed}")
    return 1 if any(how == "BROKEN" for _, how in counts) else 0


sys.exit(main())
