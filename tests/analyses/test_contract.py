"""The contract of an analysis. RCS models added from outside work everywhere."""

import dataclasses
import json
import pickle
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import yaml
from helpers import (
    CONFIGS,
    document,
    few_draws,
    lay_out,
    no_physics,
    scenario,
    small_batches,
    without_pixels,
    yaml_text,
)

import radar_sense as rs
from radar_sense import cli as command_line
from radar_sense.command import Result
from radar_sense.limits import POSITIVE, parameter
from radar_sense.model.rcs import RCS_MODELS, EllipsoidRCS

ALL = {
    name: command_line.load(name)
    for name in command_line.commands()
    if name not in ("check", "report")
}
#: What keeps an analysis short.
SHORT = {
    "montecarlo": {"runs": 32},
    "compare": {"runs": 32},
    "convergence": {"runs": 16},
    "validate": {"digits": 1},
    "map": {"step_km": 200},
    "range": {"step_deg": 90, "method": "form"},
    "mission": {"m": 2, "n": 3},
    "sweep": {"key": "analysis.seed", "start": 1, "stop": 2, "step": 1},
}
FEW = {"start": 40, "stop": 60, "step": 20}


def read_config(name):
    return yaml.safe_load((CONFIGS / f"{name}.yaml").read_text(encoding="utf-8"))


def documents(name: str):
    """Yield the documents of a small scenario of a network and of one radar."""
    network = document(read_config("network"), geometry__azimuth_deg__step=60)
    if name != "mission":
        yield network
        yield document(geometry__azimuth_deg=FEW)
        return
    route = str(CONFIGS / "path_route.csv")
    one = document(read_config("mission"), geometry__file=route, radar__scan_period_s=60)
    for radar, period in zip(network["radars"], (60, 60, 90), strict=True):
        radar["scan_period_s"] = period
    del network["aircraft"]["attitude_deg"]
    yield network | {"geometry": one["geometry"], "uncertainty": {}}
    yield one


@pytest.mark.parametrize("name", ALL)
def test_every_analysis_keeps_the_contract(name, tool, monkeypatch):
    """A notebook gets the table that the shell writes."""
    small_batches(monkeypatch)
    few_draws(monkeypatch)
    for number, content in enumerate(documents(name)):
        # Pixels of each figure are drawn by the tests of the command line.
        without_pixels(monkeypatch, then=(lay_out, lambda figure: figure)[number])
        Path("my.yaml").write_text(yaml_text(content), encoding="utf-8")
        s = rs.load_scenario("my.yaml")
        assert len(s.model.radars) == (3, 1)[number]
        result = ALL[name](s, **SHORT.get(name, {}))
        assert isinstance(result, Result)
        if name != "map":
            assert len({column.shape for column in result.table.values()}) == 1
            assert all(column.ndim == 1 for column in result.table.values())
        lines = (*result.report, *result.warnings)
        assert all(isinstance(line, str) and line.isascii() and "\n" not in line for line in lines)
        assert len(repr(result)) < 400
        with no_physics():  # a figure, a table and a record are made from the result alone
            table, figure, record = result.save("notebook", ["png"])
        assert table.stem == figure.stem == record.stem == f"{s.name}_{name}"
        written = json.loads(record.read_text(encoding="utf-8"))
        assert written["analysis"] == name
        assert written["warnings"] == list(result.warnings)
        again = rs.parse_scenario(yaml_text(written["scenario"]))
        assert again.resolved() == written["scenario"]
        # every column is declared with its meaning, and stands in the record
        assert list(written["columns"]) == list(result.table)
        for column in written["columns"].values():
            assert column["meaning"].isascii()
            assert column["meaning"].endswith(".")
            assert "<" not in column["meaning"]
    short = SHORT.get(name, {}).items()
    options = [str(v) if name == "sweep" else f"--{k.replace('_', '-')}={v}" for k, v in short]
    code, out, err = tool(name, "my.yaml", *options, "--out", "shell", "--no-plot")
    assert code == (0 if result.passed else 3)
    written = [str(Path("shell", path.name)) for path in (table, record)]
    assert out.splitlines() == [*result.report, *written]
    assert err.splitlines() == [f"Warning: {text}" for text in result.warnings]
    assert table.read_bytes() == Path(written[0]).read_bytes()


def test_options_of_an_analysis():
    with pytest.raises(
        TypeError, match=r"budget\(\) has no option 'tarket'.*did you mean 'target'"
    ):
        rs.analyses.budget(scenario(), tarket=0.1)
    high = rs.analyses.sensitivity(scenario(geometry__azimuth_deg=FEW), level="high")
    assert high.scenario.level == "high"


# Additions from outside.


def test_a_new_rcs_model(tool, monkeypatch):
    @dataclasses.dataclass(frozen=True)
    class Halved(EllipsoidRCS):
        isotropic: ClassVar[bool] = False
        part: float = parameter("part", "Part of the cross section.", POSITIVE)

        def cross_section(self, body_vector):
            return self.part * super().cross_section(body_vector)

        def linearize(self, body_vector):
            value, slope = super().linearize(body_vector)
            return self.part * value, self.part * slope

    monkeypatch.setitem(RCS_MODELS, "halved", Halved)
    rcs = {"model": "halved", "a_m": 0.15, "b_m": 0.13, "c_m": 0.21, "part": 0.5}
    text = json.dumps(document(aircraft__rcs=rcs, geometry__azimuth_deg=FEW))
    Path("my.yaml").write_text(text, encoding="utf-8")
    for command in ("budget", "map --step-km 200", "rcs", "variance"):
        assert tool(*command.split(), "my.yaml", "--no-plot").code == 0
    half = rs.analyses.variance(rs.load_scenario("my.yaml"))
    assert half.scenario.resolved()["aircraft"]["rcs"] == rcs
    whole = rs.analyses.variance(scenario(geometry__azimuth_deg=FEW))
    ratio = half.table["rcs_m2"] / whole.table["rcs_m2"]
    np.testing.assert_allclose(ratio, 0.5)


def test_a_result_is_pickled_with_its_figure():
    result = rs.analyses.budget(rs.load_scenario().at_poses(slice(0, 3)))
    again = pickle.loads(pickle.dumps(result))
    assert again.report == result.report
    assert {n: c.tolist() for n, c in again.table.items()} == {
        n: c.tolist() for n, c in result.table.items()
    }
    assert again.plot().axes


def test_a_result_without_table_and_figure_has_a_record(tmp_path):
    """The format may be one word, too."""
    result = rs.analyses.check(rs.load_scenario())
    assert [path.name for path in result.save(tmp_path, "pdf")] == ["paper_check.json"]
    assert repr(result) == "<Result of check: paper; .report, .warnings, .save(folder)>"


@pytest.mark.parametrize("name", [*ALL, "check", "report"])
def test_a_command_is_pickled_by_its_name(name):
    command = getattr(rs.analyses, name)
    assert pickle.loads(pickle.dumps(command)) is command
