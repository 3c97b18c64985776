"""Budgets and warnings where tolerances of a data sheet make the radar constant uncertain."""

import numpy as np
import pytest
from helpers import SOURCES, TOLERANCES, part_name, shares_of, sheet_scenario, stds_of

from radar_sense import analyses
from radar_sense.propagation import propagate_scenario
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


def test_certain_parts_bring_nothing():
    s = sheet_scenario(tolerances={"loss_db": 0.0, "average_power_kw": 0})
    found = error_budget(s)
    assert not found.sources["radar_constant"].std.any()
    assert not np.any(list(stds_of(found.parts).values()))
    assert analyses.budget(s, method="montecarlo").report
