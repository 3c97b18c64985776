"""The command line: output, files and exit codes."""

import contextlib
import io
import json
import platform
import re
import shlex
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from helpers import (
    CONFIGS,
    SOURCES,
    few_draws,
    read_record,
    read_table,
    small_batches,
    some_poses,
    without_pixels,
)

import radar_sense as rs
from radar_sense import cli as command_line
from radar_sense.cli import cli
from radar_sense.progress import report
from radar_sense.scenario_file.load import default_text

pytestmark = pytest.mark.usefixtures("quick")

SCENARIOS = sorted(CONFIGS.glob("*.yaml"))
ROUTE = CONFIGS / "path_route.csv"
COMMANDS = cli.list_commands(None)
#: Commands whose table has the deviation of P_D at each pose of an orbit.
AT_POSES = ("budget", "compare", "montecarlo", "sensitivity", "sweep", "variance")

#: The first columns of each table. Their names and order are fixed, because others read them.
COLUMNS = {
    "variance": "range_m,rcs_m2,snr_db,p_d,sigma_pd,lower_3sigma,upper_3sigma",
    "montecarlo": "p_d,sigma_pd,lower_3sigma,upper_3sigma,"
    "mc_mean,mc_std,mc_lower,mc_upper,coverage_3sigma",
    "sensitivity": "three_sigma_low,three_sigma_medium,three_sigma_high",
    "budget": ",".join(f"three_sigma_{source}" for source in (*SOURCES, "total")),
}


def few(command: str) -> list[str]:
    if command == "map":
        return ["--step-km", "50"]
    if command == "range":
        return ["--step-deg", "90"]
    if command == "sweep":
        return ["radar.p_fa", "1e-9", "1e-9", "1"]
    runs = {"montecarlo": "40", "compare": "40", "convergence": "8"}
    return ["--runs", runs[command]] if command in runs else []


def files(folder: str | Path = "figures") -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in Path(folder).iterdir()}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands write no pixels and draw small blocks, which take most of their time."""
    without_pixels(monkeypatch)
    small_batches(monkeypatch)
    few_draws(monkeypatch)
    monkeypatch.setattr("radar_sense.coverage.grid.CELLS", 40)


# Help.


def examples(text: str) -> list[str]:
    """Return the command lines in the examples of a help text, without the remarks."""
    assert "\nExample" in text or "\n  Example" in text
    lines = text.split("Example", 1)[1].splitlines()[1:]
    found = [re.split(r"\s{3,}", line.strip())[0] for line in lines if "radar-sense " in line]
    assert found
    return found


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.usefixtures("short")
def test_every_command_has_examples_that_run(tool, monkeypatch, command):
    monkeypatch.setattr("radar_sense.page._figure", lambda result, words: "")
    code, out, err = tool(command, "--help")
    assert (code, err) == (0, "")
    lines = examples(out)
    assert all(line.startswith(f"radar-sense {command}") for line in lines)
    if command == "mission":
        text = (CONFIGS / "mission.yaml").read_text().replace("path_route.csv", str(ROUTE))
        Path("my.yaml").write_text(text.replace("scan_period_s: 10", "scan_period_s: 60"))
    elif command != "init":
        assert tool("init", "my.yaml").code == 0
        Path("my.yaml").write_text(Path("my.yaml").read_text().replace("step: 0.5", "step: 60"))
        text = (CONFIGS / "network.yaml").read_text()
        Path("network.yaml").write_text(text.replace("step: 0.5", "step: 90"))
    if command == "diff":
        for folder in ("before", "after"):
            assert tool("budget", "my.yaml", "--no-plot", "--out", folder).code == 0
    for line in lines:
        short = re.sub(r"--step-km \S+", "--step-km 50", re.sub(r"--runs \S+", "--runs 64", line))
        words = shlex.split(short)[1:]
        if command == "sweep":  # at the first value and the last
            start = next(i for i, word in enumerate(words) if re.fullmatch(r"-?\d[\d.e-]*", word))
            words[start + 2] = str(float(words[start + 1]) - float(words[start]))
        if command in ("map", "range") and few(command)[0] not in words:
            words += few(command)
        if command not in ("check", "diff", "init", "report", "schema"):
            words.append("--no-plot")  # the tests of the contract draw every figure
        codes = (3 if "--threshold 0.1" in line or "--at-least 0.9" in line else 0,)
        if command == "validate":  # few draws may leave open whether a method agrees
            codes = (0, 3)
        assert tool(*words).code in codes, line


@pytest.mark.usefixtures("short")
def test_help_of_the_tool(tool):
    code, out, err = tool("--help")
    assert (code, err) == (0, "")
    assert all(command in out for command in COMMANDS)
    for line in examples(out):
        words = shlex.split(line)[1:]
        words += [*few(words[0]), *["--no-plot"] * (words[0] != "init")]
        assert tool(*words).code == 0, line
    assert tool() == (0, out, "")
    assert tool("--version") == (0, f"radar-sense, version {rs.__version__}\n", "")


def test_help_errors_init_and_completion_do_not_load_the_slow_packages(tmp_path):
    code = (
        "import sys\n"
        "from click.shell_completion import ShellComplete\n"
        "from radar_sense.cli import cli\n"
        "for args in ('--help', 'bogus', 'init --bogus', 'init --from table a.yaml'):\n"
        "    try: cli.main(args.split())\n"
        "    except SystemExit: pass\n"
        "assert len(ShellComplete(cli, {}, 'radar-sense', '_').get_completions([], '')) > 10\n"
        "print(*sorted({'numpy', 'scipy', 'matplotlib', 'yaml'} & set(sys.modules)))"
    )
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.yaml", "a_synthetic_aircraft.csv"]
    assert "budget" in done.stdout
    assert done.stderr.count("Error: ") == 2
    assert done.stdout.splitlines()[-1] == ""


# Results.


def test_files_their_names_and_formats(tool):
    """An image; `test_environments` has PDF. The same again is the same to the last bit."""
    args = ["map", *few("map"), *(f"--format={kind}" for kind in ("png", "svg", "png"))]
    code, out, _ = tool(*args)
    assert code == 0
    found = files()
    assert sorted(found) == [f"paper_map.{kind}" for kind in ("json", "npz", "png", "svg")]
    assert {str(Path("figures", name)) for name in found} <= {*out.splitlines()}
    assert found["paper_map.png"].startswith(b"\x89PNG\r\n\x1a\n")
    assert ET.fromstring(found["paper_map.svg"]).tag == "{http://www.w3.org/2000/svg}svg"
    assert tool(*args).code == 0
    assert files() == found


def test_detectors(tool):
    code, out, err = tool("detectors", "--no-plot")
    assert (code, err) == (0, "")
    found = read_table("figures/paper_detectors.csv")
    names = ["north", "marcum", "swerling1", "swerling3"]
    before = ["p_fa", "snr_db", *(f"p_d_{n}" for n in names), "north_less_marcum"]
    integrated = [f"{what}_swerling2_{n}" for what in ("p_d", "dp_d_per_db") for n in (1, 10, 100)]
    assert list(found) == [*before, *integrated]
    assert set(found["p_fa"]) == {1e-2, 1.7e-4, 1e-4, 1e-6, 1e-8, 1e-12}
    at = (found["p_fa"] == 1e-4) & (abs(found["snr_db"] - 16) < 1e-9)
    assert found["p_d_swerling1"][at] == pytest.approx(0.7980, abs=5e-5)  # printed, radarsimpy
    assert (found["north_less_marcum"] == found["p_d_north"] - found["p_d_marcum"]).all()
    summary = read_record("figures/paper_detectors.json")["summary"]
    largest = {worst["p_fa"]: worst["error"] for worst in summary["largest_error_of_north"]}
    assert largest[1.7e-4] == pytest.approx(0.0050, abs=5e-5)
    assert "P_fa 0.00017  +0.0050 at 5.7 dB" in out
    assert "largest error at the poses of this scenario: 0.0039 at 0 and 180 deg" in out


@pytest.mark.parametrize("command", COLUMNS)
def test_the_first_columns(tool, command):
    assert tool(command, *few(command), "--no-plot").code == 0
    head, *rows = files()[f"paper_{command}.csv"].decode("ascii").split("\n")
    assert head == f"theta_r_deg,{COLUMNS[command]}"
    assert len(rows) == 13 + 1


def test_json(tool):
    args = ["montecarlo", "--level", "high", "--runs", "40", "--seed", "0", "--no-plot"]
    assert tool(*args).code == 0
    found = read_record("figures/paper_montecarlo.json")
    assert set(found) >= {"scenario", "seed", "versions", "command", "warnings", "summary"}
    assert found["command"] == ["radar-sense", *args]
    assert found["seed"] == 0
    choices = {"level": "high", "runs": 40, "seed": 0, "method": "linear"}
    assert found["scenario"]["analysis"] == choices
    assert found["versions"]["python"] == platform.python_version()
    assert found["versions"]["numpy"] == np.__version__
    assert found["versions"]["radar-sense"] == rs.__version__
    # The scenario in the record is one that makes the same results again.
    Path("again.yaml").write_text(json.dumps(found["scenario"]))
    assert tool("montecarlo", "again.yaml", "--no-plot", "--out", "again").code == 0
    assert files("again")["paper_montecarlo.csv"] == files()["paper_montecarlo.csv"]


OVERHEAD = (
    default_text()
    .replace("range_km: 500", "range_km: 0")
    .replace("step: 0.5", "step: 90")
    .replace("name: paper", "name: overhead")
)


# Straight above the radar P_D and the RCS are defined, and their gradients are not.
@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("command", AT_POSES)
def test_undefined_numbers_are_null_in_json_and_nan_in_csv(tool, command):
    Path("overhead.yaml").write_text(OVERHEAD)
    code, _, err = tool(command, "overhead.yaml", *few(command), "--no-plot")
    assert code == 0
    assert re.search(r"Warning: .* has no value .*at all 3 poses.*\[no-value\]", err)
    found = read_record(f"figures/overhead_{command}.json")
    if command not in ("montecarlo", "compare"):  # all draws of these two are defined
        assert "null" in json.dumps(found["summary"])
    columns = read_table(f"figures/overhead_{command}.csv")
    uncertain = [c for c in columns if "sigma" in c and "coverage" not in c]
    assert any(np.isnan(columns[c]).all() for c in uncertain), uncertain


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("command", ["check", "init", "variance"])
def test_quiet(tool, command):
    code, out, err = tool(command, "-q", *few(command))
    assert (code, out, err) == (0, "", "")


def test_out_is_made_with_the_folders_above_it(tool):
    assert tool("budget", "--no-plot", "--out", "a/b c/d").code == 0
    assert sorted(files("a/b c/d")) == ["paper_budget.csv", "paper_budget.json"]
    assert not Path("figures").exists()


def test_a_long_name_fits_into_a_file_name(tool):
    Path("long.yaml").write_text(default_text().replace("name: paper", f"name: {'a' * 100}"))
    assert tool("budget", "long.yaml").code == 0
    assert sorted(files()) == [f"{'a' * 100}_budget.{e}" for e in ("csv", "json", "png")]


# Scenarios to start from.


@pytest.mark.parametrize("config", SCENARIOS, ids=lambda config: config.stem)
def test_every_scenario_in_configs_runs(tool, monkeypatch, config):
    """At some five poses; `test_init` checks the whole scenarios."""
    some_poses(monkeypatch)
    code, out, err = tool("variance", config, "--no-plot")
    assert code == 0
    assert out
    assert all(line.startswith("Warning: ") for line in err.splitlines())
    assert len(files()) == 2
    assert rs.load_scenario(config).name == config.stem


# Progress, pipes and processes.


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def standard_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Run a command in an empty folder with a stream as standard error, and return its text."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command_line, "INTERVAL", 0.0)

    def run(command: str, stream: io.StringIO | None, patience: float = 0.0) -> str:
        monkeypatch.setattr(command_line, "PATIENCE", patience)
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(stream),
            pytest.raises(SystemExit) as end,
        ):
            cli.main([*command.split(), "--no-plot"])
        assert (end.value.code or 0) == (3 if "--threshold" in command else 0)
        return "" if stream is None else stream.getvalue()

    return run


def test_progress_says_how_long_and_shows_steps_within_a_step(standard_error, fake, monkeypatch):
    now = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: now)

    def three_values() -> None:
        nonlocal now
        for value in range(3):
            report("values", value, 3)
            for done in (0, 300, 600):
                report("runs", done, 600)
                now += 5.0
            report("poses", 1, 2)

    fake(three_values)
    *shown, last, _ = standard_error("fake", Terminal()).split("\r")
    assert last.isspace()  # the line is cleared at the end
    shown = [text.rstrip() for text in shown]
    assert "fake: 0 of 3 values; 300 of 600 runs, 5 s left" in shown
    assert "fake: 0 of 3 values; 1 of 2 poses" in shown
    assert "fake: 1 of 3 values, 30 s left" in shown
    assert "fake: 1 of 3 values, 30 s left; 300 of 600 runs, 5 s left" in shown


@pytest.mark.parametrize(
    ("command", "shown"),
    [
        ("montecarlo --runs 200", r"montecarlo: 200 of 200 runs"),
        ("map --step-km 50", r"map: ([\d,]+) of \1 cells"),
        ("variance --method form", r"variance: 13 of 13 poses"),
        ("budget", r"budget: 4 of 4 sources of the budget"),
        ("variance --threshold 0.5", r"variance: [\d,]+ of [\d,]+ runs along the path"),
    ],
)
def test_a_terminal_shows_progress(standard_error, command, shown):
    assert re.search(shown, standard_error(command, Terminal()))


def test_only_a_patient_terminal_shows_progress_and_not_with_q(standard_error):
    """Standard error is a terminal, a file, or closed, which is None in Python."""
    command = "montecarlo --runs 200"
    assert standard_error(f"{command} -q", Terminal()).strip("\r") == ""
    for stream, patience in ((io.StringIO(), 0.0), (Terminal(), 1e9)):
        lines = standard_error(command, stream, patience).splitlines()
        assert all(line.strip("\r").startswith("Warning: ") for line in lines), lines
    standard_error(command, None)


def test_no_style_of_the_user_changes_a_figure(tool):
    """Of a notebook; `test_environments` has the files of settings."""
    assert tool("budget").code == 0
    found = files()
    with mpl.rc_context({"text.usetex": True, "lines.linewidth": 9, "figure.dpi": 20}):
        assert tool("budget").code == 0
    assert files() == found


def test_control_characters_do_not_reach_the_terminal(tool):
    """Control characters in file names, words of the command line and records are escaped."""
    escape = "\x1b[31m"
    name = f"a{escape}\nb.yaml"
    Path(name).write_text("name: [")
    for args in (
        *(("check", *words) for words in ([name], ["no" + name], ["a", escape], [f"--{escape}"])),
        [escape],
        ["variance", "--no-plot", "--out", escape],
    ):
        _, out, err = tool(*args)
        assert "\x1b" not in out + err
        assert "\\x1b[31m" in out + err, args
    assert tool("init", "new" + name).out == (
        "newa\\x1b[31m\\nb.yaml written\nnext: radar-sense check 'newa\\x1b[31m\\nb.yaml'\n"
    )
