"""`diff`: what two records say differently."""

import json
from pathlib import Path

import pytest
from helpers import one_line, read_record

from radar_sense.differences import compared

pytestmark = pytest.mark.usefixtures("quick")


def write(tool, folder, *options):
    assert tool("budget", "--no-plot", "--out", folder, *options).code == 0
    return f"{folder}/paper_budget.json"


def test_the_scenario_and_the_numbers(tool):
    old, new = write(tool, "a"), write(tool, "b", "--set", "radar.constant=150", "--level", "high")
    code, out, err = tool("diff", old, new)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    changes = ["radar.constant: 167 -> 150 (-17)", 'analysis.level: "medium" -> "high"']
    assert lines[:4] == ["scenario:", *(f"  {change}" for change in changes), "numbers:"]
    key = "largest_three_sigma_total"
    one, other = (read_record(path)["summary"][key]["value"] for path in (old, new))
    assert f"  {key}.value: {one:.6g} -> {other:.6g} ({other - one:+.3g})" in lines


def test_a_small_number_of_a_scenario_is_no_rounding(tool):
    records = []
    for p_fa in ("1e-13", "2e-13"):
        records.append(write(tool, p_fa, "--set", f"radar.p_fa={p_fa}"))
    assert "  radar.p_fa: 1e-13 -> 2e-13 (+1e-13)" in tool("diff", *records).out.splitlines()


def test_tables_that_differ_alone(tool):
    """The summary of `variance` has no bounds."""
    records = [f"{k}/paper_variance.json" for k in (1, 3)]
    for k in (1, 3):
        few = ("--set", "geometry.azimuth_deg.step=90", "--no-plot", "--out", f"{k}")
        assert tool("variance", "--method", "form", "--k", f"{k}", *few).code == 0
    said = "the two records of variance say the same, but their tables differ\n"
    assert tool("diff", *records).out == said


def test_equal_records_and_warnings(tool):
    old = write(tool, "a")
    assert tool("diff", old, old).out == "the two records of budget say the same\n"
    record = read_record(old)
    record["warnings"] = ["a \x1b[31m word [new-name]"]
    Path("new.json").write_text(json.dumps(record))
    out = tool("diff", old, "new.json").out
    assert "  new: a \\x1b[31m word [new-name]" in out
    assert "\x1b" not in out


def test_what_is_no_record_is_refused_in_one_line(tool):
    old = write(tool, "a")
    for text, message in (
        *((text, "is not JSON") for text in ("", "[" * 100_000, "\xff")),
        *((text, "is not the JSON record of an analysis") for text in ("[]", '{"scenario": 3}')),
    ):
        Path("other.json").write_text(text)
        assert one_line(tool, "diff", old, "other.json").startswith(f"Error: other.json: {message}")
    Path("other.json").write_text(json.dumps({**read_record(old), "record": 2}))
    error = one_line(tool, "diff", old, "other.json")
    assert error == "Error: other.json: record must be 1, the version of the keys, got 2\n"
    one_line(tool, "diff", old, "missing.json")


def test_records_of_two_commands_are_refused(tool):
    old = write(tool, "a")
    assert tool("sensitivity", "--no-plot", "--out", "a").code == 0
    error = one_line(tool, "diff", old, "a/paper_sensitivity.json")
    assert error == "Error: records of budget and sensitivity have no common numbers\n"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ({"seed": 10**12 + 1}, {"seed": 10**12 + 2}, "seed: 1000000000001 -> 1000000000002 (+1)"),
        ({"x": 0.1 + 0.2}, {"x": 0.3}, "say the same"),
        ({"x": 0.3}, {"x": 0.3 + 1e-11}, "x: 0.3 -> 0.3 (+1e-11)"),
        ({"passed": True}, {"passed": False}, "passed: true -> false"),
        ({"x": [1, 2]}, {"x": [1, 2, 3]}, "x: [1, 2] -> [1, 2, 3]"),
        ({"shares": {"interaction": 0.0}}, {"shares": {"interaction": -4.44e-16}}, "say the same"),
    ],
)
def test_records_differ_but_for_rounding(old, new, says):
    one, other = ({"analysis": "budget", "summary": x, "warnings": []} for x in (old, new))
    assert "".join(compared(one, other)).endswith(says)
