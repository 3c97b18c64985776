"""`--radar`: one radar of a network by itself, and the results of a network for each radar."""

import json
import re
from pathlib import Path

import pytest
import yaml
from helpers import (
    mixed_document,
    mixed_network,
    mixed_radars,
    one_line,
    small_batches,
    write,
    yaml_text,
)

from radar_sense import analyses
from radar_sense.errors import InputError
from radar_sense.model.network import NetworkModel
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario import for_radar, single_radar_scenarios
from radar_sense.scenario_file.load import load_scenario

pytestmark = pytest.mark.usefixtures("quick")

POSE = (60, 60, 1)


@pytest.mark.parametrize(
    "line",
    [
        "variance",
        "validate --digits 1 --method form",
        "map --step-km 40",
        "sweep geometry.down_km -4 -3 1",
    ],
)
def test_one_radar_by_itself(tool, line, monkeypatch):
    small_batches(monkeypatch)
    write(yaml_text(mixed_document(sweep=POSE)))
    command, *options = [*line.split(), "--no-plot", "--out"]
    code, out, err = tool(command, "my.yaml", *options, "out", "--radar", "b")
    assert code == 0, err
    (record_path,) = Path("out").glob("*.json")
    (table,) = set(Path("out").iterdir()) - {record_path}
    assert record_path.stem == table.stem == f"paper_b_{command}"
    record = json.loads(record_path.read_text())
    assert record["command"][-2:] == ["--radar", "b"]
    assert record["scenario"]["name"] == "paper_b"
    assert [entry["name"] for entry in record["scenario"]["radars"]] == ["b"]
    # the record has a scenario of that radar alone, with the same results
    write(yaml.safe_dump(record["scenario"]), "again.yaml")
    again, expected, _ = tool(command, "again.yaml", *options, "again")
    assert again == code
    assert table.read_bytes() == (Path("again") / table.name).read_bytes()
    assert expected.replace("again/", "out/") == out
    if command == "variance":  # `--radar` may name the only radar
        tool(command, "again.yaml", *options, "twice", "--radar", "b")
        twice = Path("twice/paper_b_b_variance.csv")
        assert table.read_bytes() == twice.read_bytes()
        error = one_line(tool, command, "again.yaml", "--radar", "a", "--out", "new")
        assert "radar must be one of b, got 'a'" in error
    # the network has another table
    tool(command, "my.yaml", *options, "out")
    assert (Path("out") / f"paper_{command}.json").exists()
    assert (Path("out") / f"paper_{command}{table.suffix}").read_bytes() != table.read_bytes()


def test_for_radar_is_the_scenario_of_one_radar_with_its_name():
    s = mixed_network()
    one = for_radar(s, "c")
    assert isinstance(one.model, NetworkModel)
    assert one.model.names == ("c",)
    assert (one.name, single_radar_scenarios(s)["c"].name) == ("paper_c", "paper")
    with pytest.raises(InputError, match="single radar"):
        for_radar(load_scenario(), "radar")
    with pytest.raises(InputError, match="more than 100 letters"):
        for_radar(mixed_network(name="x" * 99), "c")


#: What the heading of the radars says.
HEADING = re.compile("by itself|alone:")


@pytest.mark.parametrize("method", ["linear", "form"])
def test_a_network_reports_the_largest_three_sigma_of_each_radar_by_itself(method):
    s = mixed_network(runs=64)
    for analyse in (analyses.variance, analyses.sensitivity):
        result = analyse(s, method=method)
        found = result.summary["largest_three_sigma_by_itself"]
        (start,) = [i for i, line in enumerate(result.report) if HEADING.search(line)]
        lines = result.report[start + 1 : start + 4]
        for name, line in zip("abc", lines, strict=True):
            assert line.split()[0] == name
            for level in s.levels if analyse is analyses.sensitivity else ["sheet"]:
                one = single_radar_scenarios(s)[name].with_analysis(level=level)
                most = 3 * propagate_scenario(one, method=method or "linear").std.max()
                largest = found[level][name] if analyse is analyses.sensitivity else found[name]
                assert largest["value"] == pytest.approx(most, rel=1e-12)
                where = line.index(level) if analyse is analyses.sensitivity else 0
                shown = re.search(r"(\d\.\d{4}) at \d+", line[where:])
                assert float(shown[1]) == pytest.approx(most, abs=5.1e-5)
    for result in (analyses.sensitivity(load_scenario()), analyses.variance(for_radar(s, "a"))):
        assert "largest_three_sigma_by_itself" not in result.summary
        assert not any(map(HEADING.search, result.report))


def test_a_radar_that_sees_nothing_has_a_verdict(tool):
    """Beyond the range σ and δ are 0, and their ratio must not raise an error."""
    several = mixed_radars(max_range_km=60)
    write(yaml_text(mixed_document(several, sweep=POSE)))
    options = ["--radar", "a", "--digits", "1", "--method", "form", "--format", "svg"]
    code, out, err = tool("validate", "my.yaml", *options)
    assert code == 0, err
    assert "worst: mean off by 0 +/- 0 at 60 deg" in out
