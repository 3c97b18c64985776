"""The reference pages are made from the declarations."""

import importlib.util
import re

import pytest
from helpers import EXPLAINED, ROOT, few_draws, small_batches

import radar_sense as rs
from radar_sense import cli
from radar_sense.scenario_file.declare import keys_of
from radar_sense.scenario_file.place import parse

_SPEC = importlib.util.spec_from_file_location("make_reference", ROOT / "docs/make_reference.py")
make_reference = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(make_reference)


@pytest.mark.usefixtures("few_judge")
def test_the_committed_files_are_what_is_made(monkeypatch):
    """Names, units and meanings of columns are on the pages, and no numbers."""
    small_batches(monkeypatch)
    few_draws(monkeypatch)
    for path, text in make_reference.pages().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run `make reference`"


def test_every_warning_that_is_explained_exists():
    """The other way, a result with a warning that is not explained fails in every test."""
    code = "".join(path.read_text() for path in (ROOT / "radar_sense").rglob("*.py"))
    assert [name for name in EXPLAINED if f'"{name}"' not in code] == []


def committed(page):
    return (ROOT / "docs/reference" / page).read_text(encoding="utf-8")


def rows(page):
    """Return the cells of all rows of the tables of a page."""
    text = committed(page)
    lines = re.findall(r"^\| (`.*) \|$", text, re.MULTILINE)
    return [re.split(r"(?<!\\\\) \| ", line) for line in lines]


def test_every_key_has_meaning_limits_and_an_example():
    count = 0
    for name, meaning, unit, allowed, need, example in rows("scenario.md"):
        count += 1
        assert meaning, name
        assert "[" not in meaning, "the unit has a column of its own"
        assert allowed, name
        assert need, name
        assert example or allowed.startswith("see ["), name
        is_number = not allowed.startswith("see [")
        if re.search(r"_(deg|m|km|s|k|w)`$", name) and is_number:
            assert unit, name
    assert count == sum(len(keys_of(section)) for section in make_reference.TITLES)


def test_examples_are_allowed():
    """The reader accepts each example."""
    for section, title in make_reference.TITLES.items():
        for key in keys_of(section):
            if key.name != "covariance" and not key.kind.sections():
                example = make_reference.example_of(title, keys_of(section), key)
                key.kind.read(parse(make_reference._yaml(example), "example"))


def test_every_public_name_and_command_is_there():
    text = committed("python.md")
    for name in rs.__all__:
        public = f"### `{name}`", f"### `analyses.{name}`", f"`{name}` is `", f"`rs.{name}`"
        assert name.startswith("__") or any(words in text for words in public), name
    commands = committed("commands.md")
    for name in cli.cli.list_commands(None):
        assert f"## `{name}`" in commands
    tables = len(set(cli.commands()) - {"report", "check"})
    assert commands.count("| column | unit | meaning |") == tables
