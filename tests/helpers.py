"""How tests write scenarios and insist on refusals."""

import re
from collections.abc import Callable
from pathlib import Path


def single(scenario):
    """Return the detection model of the only radar of a scenario."""
    (radar,) = scenario.model.radars
    return radar.model


def write(text: str | bytes, name: str = "my.yaml") -> str:
    """Write a file and return its name."""
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


def refusal(tool: Callable, text: str | bytes | None, *options: str, name: str = "my.yaml") -> str:
    """Insist that a scenario (None: no file) is refused in one line, and return that line."""
    if text is not None:
        write(text, name)
    before = sorted(Path().rglob("*"))
    code, out, err = tool("montecarlo", *options, "--no-plot", "--out", "out", "--", name)
    assert_refused(code, out, err)
    assert sorted(Path().rglob("*")) == before  # nothing written, not even the folder
    return err.rstrip("\n")


def assert_refused(code: int, out: str, err: str) -> None:
    """Insist on exit code 2 and one line of error."""
    assert (code, out) == (2, "")
    assert re.fullmatch(r"Error: [^\n]+\n", err), err
    assert "Traceback" not in err


def place(error: str, name: str = "my.yaml") -> tuple[int, str, str]:
    """Take the line apart into line number, key path and complaint."""
    match = re.fullmatch(rf"Error: {re.escape(name)}:(\d+): (?:([\w.\[\]-]+): )?(.*)", error)
    assert match, error
    return int(match[1]), match[2] or "", match[3]
