"""Files of a run: each is whole, the record is last and has the digests, and nothing is deleted."""

import hashlib
import io
import json
import os
import shutil
import signal
import stat
import tracemalloc
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from helpers import CONFIGS, one_line, read_record

import radar_sense as rs
from radar_sense import cli as command_line
from radar_sense import files, plotting
from radar_sense.progress import listening
from radar_sense.scenario_file.load import default_text

pytestmark = pytest.mark.usefixtures("quick")


OLD = {"a.csv": b"old a", "a.json": b"old json", "a.pdf": b"old pdf", "other": b"mine"}
NEW = {"a.csv": b"new a", "a.png": b"new png", "a.json": b"new json"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, content in OLD.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


@pytest.fixture(autouse=True)
def default_signals() -> Iterator[None]:
    """Children of a shell in the background ignore SIGINT."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def content(folder: Path | str) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in Path(folder).iterdir() if p.is_file()}


def raising(error: BaseException) -> Callable[..., None]:
    def fail(*args: object) -> None:
        raise error

    return fail


def test_each_write_may_fail(folder, monkeypatch):
    """A full disk at any step: the error names the file, and no file is half written."""
    real = os.fsync
    for at, name in enumerate(NEW):
        steps = iter([False] * at + [True])

        def fsync(descriptor: int, steps=steps) -> None:
            if next(steps):
                raise OSError(28, "No space left on device")
            real(descriptor)

        monkeypatch.setattr(os, "fsync", fsync)
        with pytest.raises(OSError, match=rf"\[Errno 28\].*{name}"):
            files.write(folder, NEW)
        assert content(folder) == OLD


def test_a_rename_may_fail(folder, monkeypatch):
    """The record is renamed last: that of a run stands beside its own files, or is an old one."""
    real = Path.replace

    def replace(path: Path, target: Path) -> None:
        if target.name == "a.png":
            raise KeyboardInterrupt
        real(path, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(KeyboardInterrupt):
        files.write(folder, NEW)
    assert content(folder) == {**OLD, "a.csv": b"new a"}


def test_no_empty_folder_stays_after_a_failure(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", raising(OSError(28, "No space left on device")))
    with pytest.raises(OSError, match="No space"):
        files.write(tmp_path / "a" / "b", NEW)
    assert list(tmp_path.iterdir()) == []


def test_the_record_has_the_digests_of_its_files_and_no_figure_is_ever_deleted(tool, fake):
    fake(lambda: None)
    assert tool("fake", "--format", "png", "--format", "pdf").code == 0
    before = content("figures")
    record = json.loads(before.pop("paper_fake.json"))
    assert record["files"] == {n: hashlib.sha256(c).hexdigest() for n, c in before.items()}
    out = tool("fake", "--no-plot").out
    found = content("figures")
    assert sorted(found) == [f"paper_fake.{e}" for e in ("csv", "json", "pdf", "png")]
    assert found["paper_fake.pdf"] == before["paper_fake.pdf"]
    assert list(json.loads(found["paper_fake.json"])["files"]) == ["paper_fake.csv"]
    assert "removed" not in out
    assert "replaced" not in out


def test_files_replace_those_of_their_names_and_follow_no_link(folder, tmp_path_factory):
    target = tmp_path_factory.mktemp("elsewhere") / "precious"
    target.write_bytes(b"precious")
    (folder / "a.png").symlink_to(target)
    assert files.write(folder, NEW) == [folder / name for name in NEW]
    assert target.read_bytes() == b"precious"
    assert content(folder) == OLD | NEW


@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_files_are_replaced_and_follow_the_umask(folder, mask):
    kept = folder / "kept"
    os.link(folder / "a.csv", kept)  # a reader that has the old file open keeps it whole
    before = os.umask(mask)
    try:
        files.write(folder, NEW)
    finally:
        os.umask(before)
    assert kept.read_bytes() == b"old a"
    for name in NEW:
        assert stat.S_IMODE((folder / name).stat().st_mode) == 0o666 & ~mask


def test_a_package_without_metadata_does_not_lose_a_run(tool, monkeypatch):
    monkeypatch.setattr(metadata, "version", raising(metadata.PackageNotFoundError("any")))
    monkeypatch.setattr(files, "versions", files.versions.__wrapped__)  # without those known
    assert tool("variance", "--no-plot").code == 0
    record = read_record("figures/paper_variance.json")
    assert record["versions"]["numpy"] == "unknown"


# The command line.


def test_an_interrupt_before_the_files_writes_nothing(tool, fake):
    fake(lambda: signal.raise_signal(signal.SIGINT))
    assert tool("fake") == (130, "", "\nInterrupted; nothing was written.\n")
    assert list(Path().iterdir()) == []


def test_an_interrupt_while_printing_reports_the_written_files(tool, fake, monkeypatch):
    fake(lambda: None)
    real = command_line.printable
    monkeypatch.setattr(
        command_line,
        "printable",
        lambda text: signal.raise_signal(signal.SIGINT) if "paper_fake" in text else real(text),
    )
    assert tool("fake", "--no-plot").err == "\nInterrupted; all files were written.\n"
    assert sorted(content("figures")) == ["paper_fake.csv", "paper_fake.json"]


def test_threads_at_work_are_interrupted(tool, fake):
    """The signal arrives while threads compute draws; all of them end."""

    def run() -> None:
        with listening(lambda what, done, total: done and signal.raise_signal(signal.SIGINT)):
            rs.analyses.montecarlo(rs.load_scenario().with_analysis(runs=2000), workers=2)

    fake(run)
    assert tool("fake").err == "\nInterrupted; nothing was written.\n"


@pytest.mark.parametrize(
    ("error", "words"),
    [(MemoryError(), "out of memory"), (OSError(5, "Input/output error"), "Input/output error")],
)
def test_running_out_of_memory_is_one_line(tool, fake, error, words):
    fake(raising(error))
    code, out, err = tool("fake")
    assert (code, out) == (1, "")
    assert err.startswith("Error: ")
    assert words in err
    assert len(err.splitlines()) == 1
    assert list(Path().iterdir()) == []


def test_other_errors_are_not_hidden(tool, fake):
    fake(raising(KeyError("a bug")))
    with pytest.raises(KeyError, match="a bug"):
        tool("fake")


def test_a_figure_that_fails_loses_no_numbers(tool, fake, monkeypatch):
    fake(lambda: None)

    error = RuntimeError("latex could not\nbe found")
    monkeypatch.setattr(plotting, "render", raising(error))
    code, out, err = tool("fake", "--format", "png")
    assert code == 1
    assert "figures/paper_fake.csv" in out.splitlines()
    assert len(err.splitlines()) == 1
    assert err.startswith("Error: the figure of fake could not be drawn (RuntimeError: latex ")
    assert sorted(content("figures")) == ["paper_fake.csv", "paper_fake.json"]
    assert content("figures")["paper_fake.csv"].startswith(b"x\n")


# Before anything is computed.


def never() -> None:
    pytest.fail("computed")


def test_a_folder_in_the_way_of_a_file(tool, fake):
    fake(never)
    for ending in ("png", "json", "csv"):
        Path(f"figures/paper_fake.{ending}").mkdir(parents=True)
        assert f"paper_fake.{ending} is a folder" in one_line(tool, "fake")


def test_a_full_disk(tool, fake, monkeypatch):
    fake(never)

    class Full(io.BytesIO):
        def write(self, data: bytes) -> int:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.tempfile, "TemporaryFile", lambda **options: Full())
    error = one_line(tool, "fake")
    assert error == "Error: --out: cannot write to figures: No space left on device\n"


def test_a_working_folder_that_is_gone(tool, fake):
    fake(never)
    Path("gone").mkdir()
    os.chdir("gone")
    shutil.rmtree("../gone")
    assert one_line(tool, "fake").startswith("Error: --out: cannot write to figures: ")


@pytest.mark.parametrize("which", ["table", "mask", "scenario"])
def test_an_input_is_never_overwritten(tool, which):
    """An input file is protected under every spelling of its name."""
    Path("figures").mkdir()
    output, config = Path("figures/paper_budget.csv"), Path("my.yaml")
    if which == "table":
        shutil.copy(CONFIGS / "synthetic_aircraft.csv", output)
        text = (CONFIGS / "table.yaml").read_text().replace("name: table", "name: paper")
        text = text.replace("synthetic_aircraft.csv", f"figures/../{output}")
    elif which == "mask":
        output.write_text("azimuth_deg,elevation_deg\n0,0\n360,0\n")
        text = (CONFIGS / "network.yaml").read_text().replace("name: network", "name: paper")
        text = text.replace("    p_fa:", f"    mask: {output}\n    p_fa:", 1)
    else:
        output = config = output.with_suffix(".json")
        text = default_text()
    config.write_text(text)
    before = content("figures")
    error = one_line(tool, "budget", config, "--out", "./figures")
    assert f"{output} is an input of this run" in error
    assert content("figures") == before


def test_a_level_may_have_the_name_of_a_key(tool):
    text = default_text().replace("    high:", "    file:").replace("level: high", "level: file")
    Path("my.yaml").write_text(text)
    assert tool("sensitivity", "my.yaml", "--no-plot", "--set", "analysis.level=file").code == 0


def test_paths_that_are_not_utf_8(tool):
    """29.3: a name of any bytes is read, recorded and printed."""
    name = os.fsdecode(b"\xff.yaml")
    Path(name).write_text(default_text())
    for command in ("variance --no-plot", "check", "variance --json --no-plot"):
        words = command.split()
        assert tool(words[0], name, *words[1:], *(["--out", name[:1]] * (len(words) > 1))).code == 0
    record = json.loads(Path(name[:1], "paper_variance.json").read_text(encoding="utf-8"))
    assert record["command"][2] == "\\udcff.yaml"


def test_a_long_table_has_every_row_and_is_read_back_to_the_last_bit():
    values = np.arange(40_000) / 7
    rows = "".join(f"{x!r},{-x!r}\n" for x in values.tolist())
    assert files.csv({"a": values, "b": -values}) == f"a,b\n{rows}".encode()


def test_a_long_record_takes_little_more_memory_than_its_text():
    numbers = [number / 7 for number in range(30_000)]
    files.record({}, {})
    tracemalloc.start()
    text = files.record({"numbers": numbers}, {})
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * len(text)
