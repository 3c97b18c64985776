"""The notebooks of docs/ run, and print what they show."""

import contextlib
import io
import json

import pytest
from helpers import ROOT, without_pixels

NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_it_shows(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    without_pixels(monkeypatch)
    names = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        shown = "".join(line for output in cell["outputs"] for line in output["text"])
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
        assert printed.getvalue() == shown, cell["id"]


def test_the_notebooks_are_small_and_linked():
    assert [path.stem for path in NOTEBOOKS] == ["paper", "planner"]
    docs = NOTEBOOKS[0].parents[1]
    for path in NOTEBOOKS:
        assert path.stat().st_size < 20_000
        index = (docs / "index.md").read_text(encoding="utf-8")
        assert f"(notebooks/{path.name})" in index
        assert f"\nnotebooks/{path.stem}\n" in index
