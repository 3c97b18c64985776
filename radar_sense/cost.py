"""What a computation costs. A long one says so before it starts, and one too large is refused.

A size that a scenario or an option asks for ends as a number of evaluations of P_D and a number of
bytes: poses times runs, cells times radars, looks times histories. `foresee` is called with both,
where the arrays are about to be made.
"""

from __future__ import annotations

import logging

from radar_sense.errors import InputError

#: Evaluations of P_D of one radar in a second on one thread (docs/benchmarks.md: 60 to 150 ns).
RATE = 1e7
#: Evaluations that a pose takes by a method of first order, and by any other (docs/benchmarks.md).
FIRST_ORDER = {"linear": 30.0, "probit": 30.0}
OTHER = 350.0
#: Evaluations that a draw with emphasis on the tails takes, with its part of the statistics: on one
#: machine a radar had 1.2e6 to 4.6e6 such draws in a second, and 1.1e7 to 2e7 plain evaluations.
EMPHASIS = 6.0
#: Seconds and bytes above which a computation says what it takes.
SECONDS, BYTES = 10.0, 1e9
#: Most seconds, a day, and most bytes.
MOST_SECONDS, MOST_BYTES = 86_400.0, 4e9

_log = logging.getLogger("radar_sense")


def foresee(
    what: str, evaluations: float, memory: float = 0.0, *, less: str, workers: int = 1
) -> None:
    """Say what a computation takes if it is long or large.

    Args:
        what: The sizes in words, such as "361 poses x 1,000,000 runs".
        evaluations: Evaluations of P_D of one radar.
        memory: Bytes in use at once.
        less: What makes it less, such as "fewer --runs".
        workers: Threads.

    Raises:
        InputError: If it takes more than MOST_SECONDS or MOST_BYTES.
    """
    seconds = evaluations / RATE / max(workers, 1)  # 0 is refused by its own check
    if seconds > MOST_SECONDS:
        raise InputError(f"{what} take {duration(seconds)}, allowed is a day; choose {less}")
    if memory > MOST_BYTES:
        raise InputError(
            f"{what} take {memory / 1e9:,.1f} GB of memory, allowed are {MOST_BYTES / 1e9:g} GB; "
            f"choose {less}"
        )
    if seconds > SECONDS:
        _log.warning("%s take some %s; %s take less", what, duration(seconds), less)
    elif memory > BYTES:
        _log.warning("%s take %.1f GB of memory; %s take less", what, memory / 1e9, less)


def duration(seconds: float) -> str:
    """Return a duration in one unit."""
    for size, unit in ((86_400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:,.0f} {unit}"
    return f"{seconds:.0f} seconds"
