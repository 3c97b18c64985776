"""Tables in CSV: read once, refused in one line, and confidential text is not repeated."""

import hashlib
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers import assert_same_scenario, document, read_back, write_path, yaml_text
from scenario_file.refused import refused

import radar_sense as rs
from radar_sense.scenario_file.route_file import load_route
from radar_sense.scenario_file.text_file import TextFile

ROUTE = "time_s,north_m,east_m,down_m\n" + "".join(f"{i},{100 * i},0,-1000\n" for i in range(9))
TABLE = "azimuth_deg,rcs_m2\n" + "".join(f"{a},0.5\n" for a in range(-180, 180, 30))
LOADERS = {"route": (load_route, ROUTE), "table": (rs.load_rcs_table, TABLE)}


@pytest.fixture(params=LOADERS)
def kind(request, here):
    return LOADERS[request.param]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_refused_and_not_waited_for(kind):
    load, _ = kind
    os.mkfifo("pipe.csv")
    for read in (load, rs.load_scenario):
        with refused("pipe.csv: is not a regular file"):
            read("pipe.csv")


def same(one, other):
    for name, values in vars(one).items():
        if isinstance(values, np.ndarray):
            np.testing.assert_array_equal(values, vars(other)[name])


SPREADSHEETS = {
    "quoted cells": lambda text: re.sub(r"([^,\n]+)", r' "\1"', text),
    "spaces": lambda text: text.replace(",", " ,  "),
    "no last newline": lambda text: text.rstrip("\n"),
    "empty lines": lambda text: text.replace("\n", "\n  \n\n"),
    "semicolons": lambda text: text.replace(",", ";"),
    "decimal commas": lambda text: text.replace(",", ";").replace(".", ","),
    "quoted decimal commas": lambda text: re.sub(
        r"[^;\n]+", r'"\g<0>"', text.replace(",", ";").replace(".", ",")
    ),
    "empty cells behind": lambda text: text.replace("\n", ",\n").replace(",\n", "\n", 1),
    "empty columns": lambda text: text.replace(",", ";").replace("\n", ";;;\n"),
    "empty quoted columns": lambda text: text.replace("\n", ',"", ,\n'),
    "empty rows": lambda text: text.replace("\n", "\n,,,,,\n") + ",,,,,\n" * 9,
    "byte order mark": lambda text: "\ufeff" + text.replace(",", ";").replace("\n", "\r\n"),
    "comments": lambda text: "# größer;b\n\n  # b\n" + text.replace("\n", "# 1;2\n"),
    "exponents": lambda text: text.replace(",", ";").replace("5;", "5E0;").replace("0.5", "5,e-1"),
}


@pytest.mark.parametrize("spreadsheet", SPREADSHEETS)
def test_a_spreadsheet_writes_the_same_numbers(kind, spreadsheet):
    load, text = kind
    text = text.replace(",100,", ",100.25,")
    Path("a.csv").write_text(text)
    expected = load("a.csv")
    Path("a.csv").write_text(SPREADSHEETS[spreadsheet](text), encoding="utf-8", newline="")
    same(load("a.csv"), expected)


LIMIT = "a number not less than 1e-20 and not greater than 1e+20"
SEMICOLONS = "azimuth_deg;rcs_m2;\n-180;0,5;\n"
NO_GUESS = {
    "azimuth_deg,rcs_m2\n-180,0,5\n": "2: must have 2 values, one for each column, got 3; "
    "a decimal comma needs semicolons between the cells",
    'azimuth_deg,rcs_m2\n-180,"0,5"\n': "2: rcs_m2: must be LIMIT, got '0,5'; write 0.5 for 0,5",
    SEMICOLONS + "-90;0.5\n": "3: rcs_m2: must have no decimal point, because numbers before "
    "have a decimal comma, got '0.5'",
    SEMICOLONS.replace(",", ".") + "-90,0;1\n": "3: azimuth_deg: must have no decimal comma, "
    "because numbers before have a decimal point, got '-90,0'",
    SEMICOLONS + "-90;1.234,5\n": "3: rcs_m2: must have no decimal point, because numbers before "
    "have a decimal comma, got '1.234,5'",
    SEMICOLONS + "-90;1,234,5\n": "3: rcs_m2: must be LIMIT, got '1.234.5'",
    SEMICOLONS + "-90;1 234,5\n": "3: rcs_m2: must be LIMIT, got '1 234.5'",
    SEMICOLONS + "-90;;\n": "3: rcs_m2: must be LIMIT, got nothing",
    SEMICOLONS + "-90\n": "3: must have 2 values, one for each column, got 1",
    SEMICOLONS + "-90;1,0;x;\n": "3: must have 2 values, one for each column, got 3",
    SEMICOLONS + "-90;-1,5\n": "3: rcs_m2: must be LIMIT, got -1.5",
    "azimuth_deg;rcs_m2,std_db\n": "1: unknown column 'rcs_m2,std_db', allowed: azimuth_deg, ",
    "azimuth_deg;;rcs_m2\n": "1: unknown column '', allowed: azimuth_deg, ",
}


@pytest.mark.parametrize("text", NO_GUESS)
def test_a_comma_is_never_guessed(text, here):
    Path("a.csv").write_text(text)
    with refused(f"a.csv:{NO_GUESS[text].replace('LIMIT', LIMIT)}"):
        rs.load_rcs_table("a.csv")


def test_the_text_of_a_confidential_file_is_not_shown(kind):
    load, text = kind
    for secret in ("root:$6$abcdef:19000:0\n", "-----BEGIN KEY-----\nx\n", "hunter2, swordfish\n"):
        Path("secret").write_text(secret)
        with refused("secret:1: names none of the columns") as error:
            load("secret")
        assert secret[:7] not in str(error.value)
    Path("a.csv").write_text(text.replace("_", "-", 1))
    with refused("unknown column '...-...', ... did you mean"):
        load("a.csv")


def test_control_characters_are_escaped(kind):
    load, text = kind
    name = "a\x1b[31m\n\u202e.csv"
    first = text.split(",")[0]
    Path(name).write_text(text.replace(first, f"{first},x\x1b[2J\x07", 1))
    with refused(r"a\x1b[31m\n\u202e.csv:1: unknown column 'x\x1b[2J\x07'") as error:
        load(name)
    assert str(error.value).isprintable()
    with refused(r"no\x1b.csv: cannot be read: No such file or directory"):
        load("no\x1b.csv")


def scenario_with(loader):
    """Write a scenario that names `route.csv` or `table.csv`; return its path and the file."""
    if loader is load_route:
        return write_path(Path(), ROUTE), Path("route.csv")
    Path("table.csv").write_text(TABLE)
    content = document(aircraft__rcs={"model": "table", "file": "table.csv"})
    Path("scenario.yaml").write_text(yaml_text(content))
    return Path("scenario.yaml"), Path("table.csv")


def block_of(scenario):
    """Return the part of the record that names the file."""
    resolved = scenario.resolved()
    return next(b for b in (resolved["aircraft"]["rcs"], resolved["geometry"]) if "file" in b)


def test_a_file_is_looked_for_beside_the_scenario_and_recorded_as_seen_from_here(
    kind, tmp_path, monkeypatch
):
    load, _ = kind
    for folder in ("below", "elsewhere"):
        (tmp_path / folder).mkdir()
    monkeypatch.chdir("below")
    _, file = scenario_with(load)
    for at, named, seen in (
        ("", "below", "below/"),
        ("", tmp_path / "below", "below/"),
        ("elsewhere", "../below", "../below/"),
    ):
        monkeypatch.chdir(tmp_path / at)
        s = rs.load_scenario(Path(named) / "scenario.yaml")
        assert block_of(s)["file"] == f"{seen}{file}"  # no folder of this machine's
        read_back(s)


def test_the_digest_belongs_to_the_bytes_that_were_used(kind, monkeypatch):
    """The file is replaced before each of the first five lines."""
    load, text = kind
    config, file = scenario_with(load)
    other = text.replace("-180,0.5", "-180,0.25").replace("0,-1000", "5,-1000")
    assert other != text
    numbers = {}
    for content in (text, other):
        file.write_text(content)
        scenario = rs.load_scenario(config)
        numbers[hashlib.sha256(content.encode()).hexdigest()] = scenario
        assert block_of(scenario)["sha256"] in numbers
    lines = TextFile.lines
    for moment in range(1, 6):
        file.write_text(text)

        def replaced(self, moment=moment):
            for number, line in enumerate(lines(self), start=1):
                if number == moment:
                    Path("new.csv").write_text(other)
                    shutil.move("new.csv", file)  # a new file under the old name
                yield line

        monkeypatch.setattr(TextFile, "lines", replaced)
        scenario = rs.load_scenario(config)
        assert file.read_text() == other
        assert_same_scenario(scenario, numbers[block_of(scenario)["sha256"]])


def test_another_file_than_the_recorded_one_is_the_first_error(kind):
    load, text = kind
    config, file = scenario_with(load)
    record = rs.load_scenario(config).resolved()
    for content in (text + "# more\n", "nonsense\n", text + "1,2,3,4,5,6\n"):
        file.write_text(content)
        with refused("sha256: ....csv is another file than it was"):
            rs.parse_scenario(yaml_text(record))


#: A text in place of a number, and what the error says to write.
INSTEAD = {
    "10:00:00": "; write seconds, 36000 for 10:00:00",
    "0:01:30.5": "; write seconds, 90.5 for 0:01:30.5",
    "5 %": "; write the quantity itself, without %",
    '"-1,25"': "; write -1.25 for -1,25",
    "100 km": "; leave out the unit, it is in the name",
    "1e5e5": "",
    "10:99:00": "",
}


@pytest.mark.parametrize("cell", INSTEAD)
def test_an_error_says_what_to_write(kind, cell):
    load, text = kind
    *_, last = text.splitlines()
    Path("a.csv").write_text(text + last.rpartition(",")[0] + f",{cell}\n")
    with refused(f", got {cell.strip(chr(34))!r}{INSTEAD[cell]}$"):
        load("a.csv")


def test_a_long_cell_is_refused_at_once(kind):
    """A search for a number that begins at each digit anew would take minutes."""
    load, text = kind
    for cell in ("1" * 60_000 + "x", "1" * 60_000, "1" * 100 + "." + "1" * 60_000, "x" * 60_000):
        Path("a.csv").write_text(text.replace("\n0,", f"\n{cell},", 1))
        with refused("must be ..., got more than 100 letters$"):
            load("a.csv")
        Path("a.csv").write_text(text.replace(",", f",{cell},", 1))
        with refused("a.csv:1: unknown column ") as error:
            load("a.csv")
        assert re.search("column .{42}, allowed", str(error.value))
    Path("a.csv").write_text(text.replace("\n0,", f"\n{'0' * 100},", 1))
    load("a.csv")


def test_lines_are_counted_below_comments_and_empty_lines(kind):
    load, text = kind
    names, *rows = text.splitlines()
    for row in (0, 3, len(rows) - 1):
        wrong = [*rows[:row], "x" + rows[row], *rows[row + 1 :]]
        Path("a.csv").write_text("\n".join(["# a", "", names, "", "# b", *wrong]))
        with refused(f"a.csv:{row + 6}: ...: must be a number"):
            load("a.csv")


def test_a_quote_ends_on_its_line(kind):
    load, text = kind
    Path("a.csv").write_text(text.replace("\n0,", '\n"0,', 1) + '1",1\n')
    with refused("a.csv:...: is not valid CSV: a quote does not end on"):
        load("a.csv")
