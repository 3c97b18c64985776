"""`diff`: what two records say differently."""

import json
from pathlib import Path

import pytest
from helpers import read_record

pytestmark = pytest.mark.usefixtures("quick")


def write(tool, folder, *options):
    assert tool("budget", "--no-plot", "--out", folder, *options).code == 0
    return f"{folder}/paper_budget.json"


def test_the_scenario_and_the_numbers(tool):
    old, new = write(tool, "a"), write(tool, "b", "--set", "radar.constant=150", "--level", "high")
    code, out, err = tool("diff", old, new)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[:4] == [
        "scenario:",
        "  radar.constant: 167 -> 150 (-17)",
        '  analysis.level: "medium" -> "high"',
        "numbers:",
    ]
    one, other = (read_record(path)["summary"]["largest_three_sigma_total"] for path in (old, new))
    total = one["value"], other["value"]
    assert (
        f"  largest_three_sigma_total.value: {total[0]:.6g} -> {total[1]:.6g} "
        f"({total[1] - total[0]:+.3g})"
    ) in lines


def test_equal_records_and_warnings(tool):
    old = write(tool, "a")
    assert tool("diff", old, old).out == "the two records of budget say the same\n"
    record = read_record(old)
    record["warnings"] = ["a \x1b[31m word [new-name]"]
    Path("new.json").write_text(json.dumps(record))
    out = tool("diff", old, "new.json").out
    assert "  new: a \\x1b[31m word [new-name]" in out
    assert "\x1b" not in out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "is not the JSON record of an analysis"),
        ('{"scenario": 3}', "is not the JSON record of an analysis"),
        ("\xff", "is not JSON"),
    ],
)
def test_what_is_no_record_is_refused_in_one_line(tool, text, message):
    old = write(tool, "a")
    Path("other.json").write_text(text)
    code, out, err = tool("diff", old, "other.json")
    assert (code, out) == (2, "")
    assert err.startswith("Error: other.json: ")
    assert message in err
    assert err.count("\n") == 1
    assert tool("diff", old, "missing.json").code == 2


def test_records_of_two_commands_are_refused(tool):
    old = write(tool, "a")
    assert tool("sensitivity", "--no-plot", "--out", "a").code == 0
    code, _, err = tool("diff", old, "a/paper_sensitivity.json")
    assert code == 2
    assert err == "Error: records of budget and sensitivity have no common numbers\n"
