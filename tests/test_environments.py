"""Environments of users: settings of Matplotlib and Python, locales, closed streams."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest
from helpers import document, yaml_text

TINY = yaml_text(
    document(
        name="tiny",
        geometry__azimuth_deg={"start": 0, "stop": 90, "step": 30},
        uncertainty__radar={"low": {"position_m": 10, "constant": 1}},
        analysis={"level": "low", "runs": 20},
    )
)


def process(folder: Path, *args: str, shell: str = "", variables: str = ""):
    """Run the tool in another process, with some variables of the environment set or unset."""
    (folder / "tiny.yaml").write_text(TINY)
    given = [word.partition("=") for word in variables.split()]
    env = {**os.environ, **{name: value for name, _, value in given}}
    for name in [name for name, is_set, _ in given if not is_set]:
        env.pop(name, None)
    command = [sys.executable, "-m", "radar_sense", *args]
    if shell:
        command = ["sh", "-c", f'"$@" {shell}', "sh", *command]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, check=False)


#: Environment variables and their values; one without a value is unset.
ENVIRONMENTS = {
    "a notebook's backend, warnings as errors, no home": "PYTHONWARNINGS=error "
    "HOME=/nonexistent MPLCONFIGDIR XDG_CACHE_HOME XDG_CONFIG_HOME NO_COLOR=1 "
    "OPENBLAS_NUM_THREADS=2 PYTHONHASHSEED=7 TZ=Asia/Tokyo "
    "MPLBACKEND=module://matplotlib_inline.backend_inline",
    # the settings have TeX for all text
    "the C locale, no UTF-8": "LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 MPLCONFIGDIR=settings "
    "MATPLOTLIBRC=broken TERM=dumb COLUMNS=0",
}


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.all_draws
def test_the_environment_changes_no_byte(tool, tmp_path, name):
    folder = tmp_path / "elsewhere"
    settings = folder / "settings"
    settings.mkdir(parents=True)
    (settings / "matplotlibrc").write_text("text.usetex: True\nbackend: nonsense\n")
    for fonts in Path(mpl.get_cachedir()).glob("fontlist-*.json"):
        shutil.copy(fonts, settings)  # a new list of fonts takes a second
    (folder / "matplotlibrc").write_text("text.usetex: True\nnonsense: 1\n")
    (folder / "broken").write_bytes(b"figure.dpi: 20\nno setting: \xff\n")
    kind = "svg" if "home" in name else "pdf"
    args = ["variance", "tiny.yaml", f"--format={kind}"]
    done = process(folder, *args, variables=ENVIRONMENTS[name])
    assert done.returncode == 0, done.stderr
    assert done.stderr == b""
    Path("tiny.yaml").write_text(TINY)
    assert tool(*args).code == 0
    found, expected = (
        {path.name: path.read_bytes() for path in (where / "figures").iterdir()}
        for where in (folder, tmp_path)
    )
    assert sorted(found) == sorted(f"tiny_variance.{ending}" for ending in ("csv", "json", kind))
    assert found == expected


#: Help and numbers in one process, because Python compiles every module anew without docstrings.
TWO_COMMANDS = """\
from radar_sense.cli import cli
try:
    cli.main(["variance", "--help"])
except SystemExit as end:
    assert not end.code
cli.main(["variance", "tiny.yaml", "--no-plot"])
"""


def test_without_docstrings(tool):
    Path("tiny.yaml").write_text(TINY)
    assert tool("variance", "tiny.yaml", "--no-plot", "--out", "here").code == 0
    env = {**os.environ, "PYTHONOPTIMIZE": "2", "LC_ALL": "C", "PYTHONUTF8": "0"}
    command = [sys.executable, "-c", TWO_COMMANDS]
    done = subprocess.run(command, env=env, capture_output=True, check=False)
    assert done.returncode == 0
    assert b"--threshold" in done.stdout
    assert b"Traceback" not in done.stderr
    table = "tiny_variance.csv"
    assert Path("figures", table).read_bytes() == Path("here", table).read_bytes()


@pytest.mark.parametrize(
    ("words", "shell", "code", "says"),
    [
        ("variance tiny.yaml --level none", "2>&- <&-", 2, b""),
        ("schema", ">&-", 0, b""),
        ("schema", "| true", 0, b""),  # which has ended, so the pipe is broken
        ("schema", ">/dev/full", 1, b"No space left"),
    ],
)
def test_streams_that_take_nothing(tmp_path, words, shell, code, says):
    done = process(tmp_path, *words.split(), shell=shell)
    assert done.returncode == code, done.stderr
    assert len(done.stderr.splitlines()) == bool(says)
    assert says in done.stderr
