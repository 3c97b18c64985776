"""The entry point of `radar-sense` and of `python -m radar_sense`.

Ctrl-C and SIGTERM are handled before anything is imported that Python has not loaded already. An
exception would not do: an import may swallow it, or Python may print its traceback.
"""

# built in; the module `signal` loads `enum` and makes classes before it handles anything
import _signal as signal  # type: ignore[import-not-found]
import os
import sys

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def end_at_once(number: int, frame: object) -> None:
    """End the process, which has written nothing yet."""
    try:  # noqa: SIM105 - contextlib may be what is being imported
        os.write(2, b"\nInterrupted; nothing was written.\n")
    except OSError:  # standard error may be closed
        pass
    os._exit(130)


def main() -> None:
    """Run the command line and exit with its code."""
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup wants it
            signal.signal(number, end_at_once)
    # Threads of the linear algebra wait for each other: products of small matrices with many draws
    # take up to eight times the CPU time. NumPy reads the variable when it is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Matplotlib opens no window, and reads no settings of the user.
    os.environ.update(MPLBACKEND="agg", MATPLOTLIBRC=os.devnull)
    from radar_sense.cli import cli

    try:
        cli.main()
    finally:
        for number in _SIGNALS:  # the end of Python itself is not interrupted
            signal.signal(number, signal.SIG_IGN)
        from contextlib import suppress

        with suppress(OSError, AttributeError, ValueError):
            sys.stdout.flush()


if __name__ == "__main__":
    main()
