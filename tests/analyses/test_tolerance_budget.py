"""Budgets and warnings where tolerances of a data sheet make the radar constant uncertain."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import (
    SOURCES,
    TOLERANCES,
    part_name,
    part_shares,
    shares_of,
    sheet_document,
    sheet_scenario,
    stds_of,
    yaml_text,
)

from radar_sense import analyses
from radar_sense.accuracy import required_accuracies
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import load_scenario, parse_scenario
from radar_sense.sources import error_budget

#: Any method but the linear one takes the factor of a tolerance in decibels as log-normal.
LARGE = {"loss_db": 2, "noise_figure_db": 1}


@pytest.mark.parametrize(
    "analyse", [analyses.variance, analyses.budget, analyses.montecarlo, analyses.sensitivity]
)
def test_every_analysis_warns_of_a_band_by_first_order(analyse):
    """A c_r known to 2.2 dB has a skewness of 2, and its draws say so."""
    s = sheet_scenario(tolerances=LARGE).at_poses(slice(2, 5))
    words = ("the linear band is off at all 3 poses: ", "sigma by linear is off at all 3 poses: ")
    warnings = [w for w in analyse(s, method="linear").warnings if any(x in w for x in words)]
    assert len(warnings) == 1
    assert not [w for w in analyse(s).warnings if "is off" in w]  # automatic


# The budget.


@pytest.mark.parametrize("kind", TOLERANCES)
def test_parts_add_up_in_quadrature(kind):
    s = sheet_scenario(kind)
    found = error_budget(s)
    assert list(found.parts) == [part_name(part.key) for part in s.tolerances[0]]
    assert {part.key for part in s.tolerances[0]} == set(TOLERANCES[kind])
    together = np.sqrt(np.sum([std**2 for std in stds_of(found.parts).values()], axis=0))
    np.testing.assert_allclose(together, found.sources["radar_constant"].std, rtol=1e-12)
    by_c = s.model.linearize(s.aircraft, s.radar).jac_radar[:, 3]
    for part in s.tolerances[0]:
        expected = abs(by_c * s.radar[3] * part.slope)
        np.testing.assert_allclose(found.parts[part_name(part.key)].std, expected, rtol=1e-10)
    assert list(shares_of(found)) == [*SOURCES, "interaction"]
    np.testing.assert_allclose(np.sum(list(shares_of(found).values()), axis=0), 1, rtol=1e-12)


@pytest.mark.parametrize("method", ["linear", "probit", "form"])
def test_a_part_alone_is_the_scenario_with_nothing_else(method):
    found = error_budget(sheet_scenario(), method)
    for key, std in TOLERANCES["surveillance"].items():
        d = sheet_document(tolerances={key: std})
        d["uncertainty"]["aircraft"] = {"position_m": 0, "attitude_deg": 0}
        d["uncertainty"]["radar"]["sheet"]["position_m"] = 0
        alone = propagate_scenario(parse_scenario(yaml_text(d)), method=method).std
        # by the search for extremes to its tolerance
        np.testing.assert_allclose(found.parts[part_name(key)].std, alone, rtol=1e-4)


def test_indices_of_parts_by_monte_carlo():
    s = sheet_scenario(steps={"start": 40, "stop": 40, "step": 1}, runs=2**14)
    found = error_budget(s, "montecarlo")
    form = error_budget(s, "form")
    assert found.total.std[0] == pytest.approx(form.total.std[0], rel=0.01)
    shares = part_shares(found)
    for key in TOLERANCES["surveillance"]:
        assert found.parts[part_name(key)].share_error[0] < 0.02
        assert shares[part_name(key)][0] == pytest.approx(
            part_shares(form)[part_name(key)][0], rel=0.35
        )
    of_sources = [found.sources[source].share_error[0] for source in SOURCES]
    assert found.interaction.share_error[0] == pytest.approx(np.linalg.norm(of_sources), rel=1e-12)
    # the variance of a part alone differs a little from its mean over the other parts
    together = sum(share[0] for share in shares.values())
    whole = found.sources["radar_constant"].share[0]
    assert 0.9 * whole < together < whole + 0.02
    assert np.sum(list(shares_of(found).values()), axis=0) == pytest.approx(1)
    # the index of the whole does not depend on its parts being listed too
    assert whole == pytest.approx(found.sources["radar_constant"].total_index[0], abs=0.02)


def test_budget_shows_the_parts(tool):
    Path("my.yaml").write_text(yaml_text(sheet_document(method="linear")))
    code, out, _ = tool("budget", "my.yaml", "--out", "out", "--no-plot")
    assert code == 0
    result = analyses.budget(load_scenario("my.yaml"))
    assert out.splitlines()[:-2] == list(result.report)
    rows = re.findall(r"^    (\w+) +([\d.]+) +([\d.]+)%$", out, re.MULTILINE)
    assert [key for key, _, _ in rows] == ["loss_db", "noise_figure_db", "average_power_kw"]
    assert out.index("radar_constant ") < out.index("    loss_db") < out.index("  total")
    columns = (Path("out") / "paper_budget.csv").read_text().splitlines()[0].split(",")
    assert columns == [
        "theta_r_deg",
        *(f"three_sigma_{source}" for source in SOURCES),
        "three_sigma_total",
        *(f"three_sigma_radar_constant_{part.key}" for part in result.scenario.tolerances[0]),
    ]
    summary = json.loads((Path("out") / "paper_budget.json").read_text())["summary"]
    at_largest = summary["radar_constant_parts_at_largest"]
    for key, three_sigma, share in rows:
        assert at_largest[key] == pytest.approx(float(three_sigma), abs=5e-5)
        assert summary["shares_of_radar_constant_parts_at_largest"][key] == pytest.approx(
            float(share) / 100, abs=5e-4
        )
    assert sum(at**2 for at in at_largest.values()) == pytest.approx(
        summary["at_largest"]["radar_constant"] ** 2
    )


def test_the_budget_names_the_part_to_measure_better():
    s = sheet_scenario()
    result = analyses.budget(s, method="form")
    line = result.report[0]
    assert line.startswith("know better first: radar_constant_loss_db, ")
    better = sheet_scenario(tolerances={**TOLERANCES["surveillance"], "loss_db": 0.5})
    pose = s.axis.values.tolist().index(
        result.summary["largest_three_sigma_total"]["theta_r_deg"][0]
    )
    total = 3 * propagate_scenario(better, method="form").std[pose]
    assert f"; half its deviation leaves {total:.4f} of " in line
    small = sheet_scenario(tolerances={"loss_db": 0.004, "average_power_kw": 0.001})
    line = analyses.budget(small, method="form").report[0]
    assert line.startswith("know better first: aircraft_orientation, ")
    plain = analyses.budget(sheet_scenario(level="number"), method="linear")
    assert "radar_constant_" not in plain.report[0]
    assert not [column for column in plain.table if "radar_constant_" in column]
    assert not [key for key in plain.summary if "parts" in key]


@pytest.mark.parametrize("method", ["linear", "probit"])
def test_how_much_a_part_must_be_reduced(method):
    s = sheet_scenario()
    # the 3 sigma with half of the loss's deviation: the factor is 0.5
    half = sheet_scenario(tolerances={**TOLERANCES["surveillance"], "loss_db": 0.5})
    three_sigma = 3 * propagate_scenario(half, method=method).std
    target, worst = three_sigma.max(), half.axis.values[three_sigma.argmax()]
    allowed = required_accuracies(s, target, method=method)
    parts = [part_name(part.key) for part in s.tolerances[0]]
    assert list(allowed) == [*SOURCES, *parts, "all"]
    assert allowed["radar_constant_loss_db"].factor == pytest.approx(0.5, rel=1e-6)
    assert allowed["radar_constant_average_power_kw"].factor is None
    assert allowed["radar_constant_average_power_kw"].residual_from == "radar_constant_loss_db"
    assert allowed["aircraft_position"].residual_from == "radar_constant"
    report = "\n".join(analyses.budget(s, method=method, target=target, at=worst).report)
    assert re.search(r"^    loss_db +50 %$", report, re.MULTILINE)


def test_certain_parts_bring_nothing():
    s = sheet_scenario(tolerances={"loss_db": 0.0, "average_power_kw": 0})
    found = error_budget(s)
    assert not found.sources["radar_constant"].std.any()
    assert not np.any(list(stds_of(found.parts).values()))
    assert analyses.budget(s, method="montecarlo").report
