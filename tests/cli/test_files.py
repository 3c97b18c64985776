"""Files of a run: all or none, at a failure or an interrupt of each step."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import stat
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from radar_sense import cli as command_line
from radar_sense import files

ROOT = Path(__file__).parents[2]
fcntl = pytest.importorskip("fcntl")

OLD = {"a.csv": b"old a", "a.json": b"old json", "a.pdf": b"old pdf", "other": b"mine"}
#: One file is new, two are replaced, one is removed.
CONTENTS = {"a.csv": b"new a", "a.png": b"new png", "a.json": b"new json", "a.pdf": None}
NEW = {"a.csv": b"new a", "a.png": b"new png", "a.json": b"new json", "other": b"mine"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with old files."""
    for name, content in OLD.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


@pytest.fixture(autouse=True)
def default_signals() -> Iterator[None]:
    """Children of a shell in the background ignore SIGINT."""
    handlers = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
    }
    before = {number: signal.signal(number, new) for number, new in handlers.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def content(folder: Path | str) -> dict[str, bytes]:
    """Return all files of a folder, hidden ones included."""
    return {p.name: p.read_bytes() for p in Path(folder).iterdir() if p.is_file()}


class Steps:
    """Counts the calls of `files` that touch the disk, and injects a fault at the n-th call."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...]) -> None:
        self.calls, self.at = 0, 0
        self.before: Callable[[], None] = lambda: None
        self.after: Callable[[], None] = lambda: None
        self.seen: list[str] = []
        targets = {
            "sync": (os, "fsync"),
            "link": (os, "link"),
            "rename": (Path, "replace"),
            "unlink": (Path, "unlink"),
            "lock": (fcntl, "flock"),
        }
        for name in names:
            if name != "write":
                monkeypatch.setattr(*targets[name], self.wrapped(name, getattr(*targets[name])))
        real_open = Path.open

        def opened(path: Path, *args: object, **options: object) -> object:
            file = real_open(path, *args, **options)
            if "write" in names and "xb" in args:
                return Wrapped(file, self.wrapped("write", file.write))
            return file

        monkeypatch.setattr(Path, "open", opened)

    def wrapped(self, name: str, function: Callable) -> Callable:
        def call(*args: object, **options: object) -> object:
            self.calls += 1
            self.seen.append(name)
            if self.calls != self.at:
                return function(*args, **options)
            self.before()
            result = function(*args, **options)
            self.after()
            return result

        return call

    def start(self, at: int) -> None:
        self.calls, self.at, self.seen = 0, at, []


class Wrapped:
    """A file whose `write` is another function."""

    def __init__(self, file: object, write: Callable) -> None:
        self.file, self.write = file, write

    def __enter__(self) -> Wrapped:
        return self

    def __exit__(self, *args: object) -> None:
        self.file.close()

    def __getattr__(self, name: str) -> object:
        return getattr(self.file, name)


class DiskFullError(OSError):
    """Raise the error of a full disk."""


def disk_full() -> None:
    raise DiskFullError(28, "No space left on device")


@pytest.mark.parametrize("when", ["before", "after"])
def test_each_write_sync_rename_and_removal_fails_once(folder, monkeypatch, when):
    steps = Steps(monkeypatch, ("write", "sync", "rename"))
    setattr(steps, when, disk_full)
    at = 0
    while True:
        at += 1
        steps.start(at)
        with contextlib.suppress(DiskFullError):
            files.write(folder, CONTENTS, "a.json")
            break
        assert content(folder) == OLD, at
    assert content(folder) == NEW
    assert at == 1 + 3 * 3  # three files, three steps each
    assert set(steps.seen) == {"write", "sync", "rename"}


def test_a_removal_that_fails_undoes_the_renames(folder, monkeypatch):
    real = Path.unlink

    def unlink(path: Path, *args: object, **options: object) -> None:
        if path.name == "a.pdf":
            raise PermissionError(13, "Permission denied")
        real(path, *args, **options)

    monkeypatch.setattr(Path, "unlink", unlink)
    with pytest.raises(PermissionError):
        files.write(folder, CONTENTS, "a.json")
    assert content(folder) == OLD


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("when", ["before", "after"])
def test_each_step_is_interrupted_once(folder, monkeypatch, when, number):
    """InterruptedAfterWriting: all files are new. Another interrupt: all are old.

    An interrupt while temporary files are removed may come after the renames.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as in the command line
    steps = Steps(monkeypatch, ("write", "sync", "link", "rename", "unlink", "lock"))
    setattr(steps, when, lambda: signal.raise_signal(number))
    ends = []
    for at in range(1, 100):
        steps.start(at)
        try:
            files.write(folder, CONTENTS, "a.json")
        except files.InterruptedAfterWriting:
            ends.append("new")
        except KeyboardInterrupt:
            ends.append("old")
        else:
            if steps.calls < at:
                break
        found = content(folder)
        if ends[-1] == "old":
            assert {k: v for k, v in found.items() if "radar-sense" not in k} in (OLD, NEW)
            if "rename" not in steps.seen:  # an interrupt during the cleaning comes too late
                assert {k: v for k, v in found.items() if "radar-sense" not in k} == OLD
        else:
            assert {k: v for k, v in found.items() if "radar-sense" not in k} == NEW
        steps.start(0)
        for path in folder.iterdir():
            if "radar-sense" not in path.name:
                path.unlink()
        for name, old in OLD.items():
            (folder / name).write_bytes(old)
    assert "old" in ends
    assert "new" in ends
    steps.start(0)
    # the next run removes temporary files that an interrupt has left
    files.write(folder, CONTENTS, "a.json")
    assert content(folder) == NEW
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def no_links(*args: object, **options: object) -> None:
    raise OSError(1, "Operation not permitted")


def test_without_hard_links_old_files_are_copied(folder, monkeypatch):
    monkeypatch.setattr(os, "link", no_links)
    steps = Steps(monkeypatch, ("rename",))
    steps.before = disk_full
    steps.start(2)
    with pytest.raises(OSError, match="No space"):
        files.write(folder, CONTENTS, "a.json")
    assert content(folder) == OLD
    steps.start(0)
    files.write(folder, CONTENTS, "a.json")
    assert content(folder) == NEW


def test_two_runs_in_one_folder_never_mix(folder, monkeypatch):
    """The lock is held at every write, sync and rename, and free afterwards."""
    other = os.open(folder, os.O_RDONLY)
    attempts = []

    def attempt() -> None:
        with pytest.raises(BlockingIOError):
            real_flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        attempts.append(1)

    real_flock = fcntl.flock
    steps = Steps(monkeypatch, ("write", "sync", "rename"))
    steps.before = attempt
    for at in range(1, 10):
        steps.start(at)
        files.write(folder, CONTENTS, "a.json")
    assert len(attempts) == 9
    real_flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(other)


@pytest.mark.parametrize("locks", [True, False])
def test_leftovers_of_killed_runs_are_removed(folder, monkeypatch, locks):
    """Without locks another run may be active. Only files of the same names are then removed."""
    if not locks:
        monkeypatch.setattr(files, "fcntl", None)
    for name in (".a.csv.radar-sense-new", ".a.csv.radar-sense-old", ".b.csv.radar-sense-new"):
        (folder / name).write_bytes(b"half")
    mine = {".notes.radar-sense-backup": b"mine", ".a.csv.new": b"mine"}
    for name, text in mine.items():
        (folder / name).write_bytes(text)
    files.write(folder, CONTENTS, "a.json")
    other = {} if locks else {".b.csv.radar-sense-new": b"half"}
    assert content(folder) == {**NEW, **mine, **other}


class KilledError(BaseException):
    """The end of a process: no handler catches it, and no later step is done."""


class Process(Steps):
    """A process that is killed at the n-th step."""

    def wrapped(self, name: str, function: Callable) -> Callable:
        def call(*args: object, **options: object) -> object:
            self.calls += 1
            if 0 < self.at <= self.calls:
                raise KilledError
            return function(*args, **options)

        return call


@pytest.mark.parametrize("old", [OLD, {"other": b"mine"}], ids=["a run before", "no run before"])
@pytest.mark.parametrize("links", [True, False])
def test_after_a_kill_files_beside_a_record_are_of_its_run(folder, monkeypatch, old, links):
    """At whichever step the process ends. The next run leaves nothing of both."""
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    process = Process(monkeypatch, ("write", "sync", "rename", "unlink"))
    states, at = set(), 0
    while "new" not in states or at < 20:
        at += 1
        process.start(0)
        for path in folder.iterdir():
            path.unlink()
        for name, text in old.items():
            (folder / name).write_bytes(text)
        process.start(at)
        with contextlib.suppress(KilledError):
            files.write(folder, CONTENTS, "a.json")
        process.start(0)
        found = {k: v for k, v in content(folder).items() if "radar-sense" not in k}
        if found == NEW:
            states.add("new")
        elif found == old:
            states.add("old")
        else:
            states.add("without a record")
            assert "a.json" not in found
        files.write(folder, CONTENTS, "a.json")
        assert content(folder) == NEW
    assert states == {"old", "without a record", "new"}


def test_a_replaced_table_without_a_record_is_reported(tool):
    tool("variance", "--no-plot")
    Path("figures/paper_variance.json").unlink()
    out = tool("variance", "--no-plot").out
    assert "replaced the files of: a run without a record" in out
    assert "replaced" not in tool("variance", "--no-plot").out


KILLED = """
import os, signal, sys
from pathlib import Path
from radar_sense import files
count, real = 0, Path.replace
def replace(*args):
    global count
    count += 1
    if count == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return real(*args)
Path.replace = replace
files.write(Path(), {"a.csv": b"new a", "a.png": b"new png", "a.json": b"new json"})
"""


def test_the_next_run_removes_the_files_of_a_killed_run(folder):
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", KILLED], cwd=folder, env=env, check=False)
    assert done.returncode == -signal.SIGKILL
    assert any(name.endswith("radar-sense-new") for name in content(folder))
    files.write(folder, CONTENTS, "a.json")
    assert content(folder) == NEW


def test_a_link_in_the_way_of_a_temporary_file_is_not_followed(folder, tmp_path_factory):
    target = tmp_path_factory.mktemp("elsewhere") / "precious"
    target.write_bytes(b"precious")
    (folder / ".a.csv.radar-sense-new").symlink_to(target)
    files.write(folder, CONTENTS, "a.json")
    assert target.read_bytes() == b"precious"
    assert content(folder) == NEW


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_files_are_replaced_and_follow_the_umask(folder, mask):
    kept = folder / "kept"
    os.link(folder / "a.csv", kept)  # a reader that has the old file open keeps it whole
    before = os.umask(mask)
    try:
        files.write(folder, CONTENTS, "a.json")
    finally:
        os.umask(before)
    assert kept.read_bytes() == b"old a"
    for name in ("a.csv", "a.png", "a.json"):
        assert stat.S_IMODE((folder / name).stat().st_mode) == 0o666 & ~mask


# The command line.


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_before_the_files_writes_nothing(tool, fake, number):
    fake(lambda: signal.raise_signal(number))
    assert tool("fake") == (130, "", "\nInterrupted; nothing was written.\n")
    assert list(Path().iterdir()) == []
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_among_the_renames_writes_all(tool, fake, monkeypatch, number):
    fake(lambda: None)
    steps = Steps(monkeypatch, ("rename",))
    steps.before = lambda: signal.raise_signal(number)
    steps.start(2)
    code, out, err = tool("fake")
    assert (code, out, err) == (130, "", "\nInterrupted; all files were written.\n")
    names = ["paper_fake.csv", "paper_fake.json", "paper_fake.png"]
    assert sorted(content("figures")) == names


def test_an_interrupt_while_printing_reports_the_written_files(tool, fake, monkeypatch):
    fake(lambda: None)
    real = command_line.click.format_filename
    monkeypatch.setattr(
        command_line.click,
        "format_filename",
        lambda path: real(path) if signal.raise_signal(signal.SIGINT) else "",
    )
    assert tool("fake", "--no-plot").err == "\nInterrupted; all files were written.\n"
    assert sorted(content("figures")) == ["paper_fake.csv", "paper_fake.json"]


def test_a_full_disk_while_printing_reports_the_written_files(tool, fake, monkeypatch):
    fake(lambda: None)
    monkeypatch.setattr(command_line.click, "format_filename", lambda path: disk_full())
    assert tool("fake", "--no-plot").err.endswith("space left on device; all files were written\n")
    assert sorted(content("figures")) == ["paper_fake.csv", "paper_fake.json"]


def test_threads_at_work_are_interrupted(tool, fake):
    """The signal arrives while threads compute draws; all of them end."""
    import radar_sense as rs

    @contextlib.contextmanager
    def progress(total, what):
        yield lambda steps: signal.raise_signal(signal.SIGINT)

    s = rs.load_scenario()
    fake(lambda: rs.analyses.montecarlo(s.with_analysis(runs=2000), workers=2, progress=progress))
    assert tool("fake").err == "\nInterrupted; nothing was written.\n"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "out of memory"),
        (RuntimeError("can't start new thread"), "threads"),
        (OSError(5, "Input/output error"), "Input/output error"),
    ],
)
def test_running_out_of_memory_or_threads_is_one_line(tool, fake, error, words):
    def fail() -> None:
        raise error

    fake(fail)
    code, out, err = tool("fake")
    assert (code, out) == (1, "")
    assert err.startswith("Error: ")
    assert words in err
    assert len(err.splitlines()) == 1
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("error", [KeyError("a bug"), RuntimeError("a bug")])
def test_other_errors_are_not_hidden(tool, fake, error):
    def fail() -> None:
        raise error

    fake(fail)
    with pytest.raises(type(error), match="a bug"):
        tool("fake")


def test_a_figure_that_fails_loses_no_numbers(tool, fake, monkeypatch):
    from radar_sense import plotting

    fake(lambda: None)
    assert tool("fake", "--format", "png").code == 0

    def fail(*args: object) -> None:
        raise RuntimeError("latex could not\nbe found")

    monkeypatch.setattr(plotting, "render", fail)
    Path("figures/paper_fake.csv").write_text("of another run")
    code, out, err = tool("fake", "--format", "png")
    assert code == 1
    assert "figures/paper_fake.csv" in out.splitlines()
    assert len(err.splitlines()) == 1
    assert err.startswith("Error: the figure could not be drawn (RuntimeError: latex could not be")
    # the figure of the other run is gone
    assert sorted(content("figures")) == ["paper_fake.csv", "paper_fake.json"]
    assert content("figures")["paper_fake.csv"].startswith(b"x\n")


# Before anything is computed.


def never() -> None:
    pytest.fail("computed")


@pytest.mark.parametrize("ending", ["csv", "png", "json"])
def test_a_folder_in_the_way_of_a_file(tool, fake, ending):
    fake(never)
    Path(f"figures/paper_fake.{ending}").mkdir(parents=True)
    code, out, err = tool("fake")
    assert (code, out) == (2, "")
    assert f"paper_fake.{ending} is a folder" in err
    assert len(err.splitlines()) == 1


def test_a_full_disk(tool, fake, monkeypatch):
    fake(never)

    class Full:
        def __enter__(self) -> Full:
            return self

        def __exit__(self, *args: object) -> None:
            pass

        def write(self, data: bytes) -> None:
            if data:
                disk_full()

    monkeypatch.setattr(files.tempfile, "TemporaryFile", lambda **options: Full())
    code, _, err = tool("fake")
    assert code == 2
    assert err == "Error: --out: cannot write to figures: No space left on device\n"


def test_a_working_folder_that_is_gone(tool, fake):
    fake(never)
    Path("gone").mkdir()
    os.chdir("gone")
    shutil.rmtree("../gone")
    code, out, err = tool("fake")
    assert (code, out) == (2, "")
    assert err.startswith("Error: --out: cannot write to figures: ")


@pytest.mark.parametrize("command", ["rcs", "budget"])
@pytest.mark.parametrize("which", ["table", "route", "scenario"])
def test_an_input_is_never_overwritten(tool, command, which):
    """An input file is protected under every spelling of its name."""
    from radar_sense.reading.parse import default_text

    root = ROOT / "configs"
    Path("figures").mkdir()
    output = Path(f"figures/paper_{command}.{'json' if which == 'scenario' else 'csv'}")
    config = Path("my.yaml")
    if which == "table":
        shutil.copy(root / "synthetic_aircraft.csv", output)
        text = (root / "table.yaml").read_text().replace("name: table", "name: paper")
        text = text.replace("synthetic_aircraft.csv", f"figures/../{output}")
    elif which == "route":
        shutil.copy(root / "path_route.csv", output)
        text = (root / "path.yaml").read_text().replace("name: path", "name: paper")
        text = text.replace("path_route.csv", f"figures/../{output}")
    else:
        text, config = default_text(), output
    config.write_text(text)
    before = content("figures")
    code, out, err = tool(command, config, "--out", "./figures")
    assert (code, out) == (2, "")
    assert f"{output} is an input of this run" in err
    assert content("figures") == before
    assert tool(command, config, "--out", "elsewhere", "--no-plot").code == 0


# Runs that replace others.


def test_replaced_results_of_other_options_are_reported(tool):
    first = tool("variance", "--format", "png").out
    assert "replaced" not in first
    assert tool("variance", "--format", "png").out == first
    # where and how files are written is no other result: the old figure is of the same numbers
    again = tool("variance", "--format=pdf", "--out", "figures").out
    assert "replaced" not in again
    assert {"paper_variance.png", "paper_variance.pdf"} < set(content("figures"))
    # other versions of the packages are no other result
    record = Path("figures/paper_variance.json")
    record.write_text(record.read_text().replace('"numpy": "', '"numpy": "0.'))
    assert "removed" not in tool("variance", "--no-plot").out
    # a figure beside a table that is not whole goes
    table = Path("figures/paper_variance.csv")
    table.write_bytes(table.read_bytes()[:-1])
    out = tool("variance", "--no-plot").out
    assert "removed figures/paper_variance.pdf: a figure of other numbers\n" in out
    for kind in ("png", "pdf"):
        Path(f"figures/paper_variance.{kind}").write_bytes(b"a figure")
    code, out, _ = tool("variance", "--level", "high", "--no-plot")
    assert code == 0
    assert "replaced the files of: radar-sense variance\n" in out
    for kind in ("png", "pdf"):
        assert f"removed figures/paper_variance.{kind}: a figure of other numbers\n" in out
    assert sorted(content("figures")) == ["paper_variance.csv", "paper_variance.json"]
    out = tool("variance", "--method", "probit", "--no-plot").out
    assert "replaced the files of: radar-sense variance --level high\n" in out
    assert tool("variance", "-q", "--no-plot").out == ""


def test_results_saved_from_python_are_named_by_level(tool):
    import radar_sense as rs

    rs.analyses.variance(rs.load_scenario(), level="high").save("figures", [])
    out = tool("variance", "--no-plot").out
    assert "replaced the files of: a run from Python at level high\n" in out


def test_a_long_table_has_every_row():
    values = np.arange(40_000) / 7
    lines = files.csv({"a": values, "b": -values}).decode().splitlines()
    assert lines == ["a,b", *(f"{x!r},{-x!r}" for x in values.tolist())]


def test_a_long_record_takes_little_more_memory_than_its_text():
    nothing = {"analysis": "", "command": [], "seed": 1, "scenario": {}, "warnings": []}
    numbers = [number / 7 for number in range(30_000)]
    files.record(**nothing, summary={}, columns={})
    tracemalloc.start()
    text = files.record(**nothing, summary={"numbers": numbers}, columns={})
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * len(text)


@pytest.mark.parametrize("text", ["", "[1]", '{"command": 7, "scenario": []}', "\x00"])
def test_a_file_that_is_no_record_is_replaced(tool, text):
    Path("figures").mkdir()
    Path("figures/paper_variance.json").write_text(text)
    Path("figures/paper_variance.png").write_text("a figure of whatever")
    assert tool("variance", "--no-plot").code == 0
    assert sorted(content("figures")) == ["paper_variance.csv", "paper_variance.json"]
