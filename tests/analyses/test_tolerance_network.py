"""Budgets of radars and networks whose constants are uncertain by their tolerances."""

import re
from pathlib import Path

import numpy as np
import pytest
from helpers import (
    MIXED_NUMBER,
    MIXED_SEARCH_STD,
    MIXED_TRACK_STD,
    TOLERANCES,
    mixed_document,
    mixed_network,
    mixed_radars,
    one_line,
    part_shares,
    read_record,
    shares_of,
    sheet_scenario,
    stds_of,
    write,
    yaml_text,
)
from numpy.testing import assert_allclose, assert_array_equal

from radar_sense import analyses
from radar_sense.acceptance.accuracy import required_accuracies
from radar_sense.acceptance.requirement import Requirement
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import parse_scenario
from radar_sense.source_names import name_problem
from radar_sense.sources import error_budget, value_function

# The budget.

ROWS = [
    *(f"a_constant_{key}" for key in MIXED_SEARCH_STD),
    *(f"b_constant_{key}" for key in MIXED_TRACK_STD),
]


@pytest.mark.parametrize("method", ["linear", "probit", "form"])
def test_rows_of_parts(method):
    s = mixed_network()
    found = error_budget(s, method)
    assert list(found.parts) == ROWS
    assert list(found.sources) == ["aircraft_position", "aircraft_orientation", "a", "b", "c"]
    for name in "ab":
        mine = [std for row, std in stds_of(found.parts).items() if row.startswith(f"{name}_")]
        together = np.sqrt(np.sum(np.square(mine), axis=0))
        within = {"linear": 1e-12, "probit": 0.05, "form": 0.15}[method]
        assert_allclose(together, found.finer[f"{name}_constant"].std, rtol=within)
    # a part alone is the network with nothing else uncertain, and the other radars as they are
    nothing = {"position_m": 0, "attitude_deg": 0}
    for name, keys in (("a", MIXED_SEARCH_STD), ("b", MIXED_TRACK_STD)):
        for key, std in keys.items():
            of = [{"loss_db": 0}, {"loss_db": 0}]
            of["ab".index(name)] = {key: std}
            several = mixed_radars(*of, position_m=0)
            several[2]["uncertainty"]["sheet"]["constant"] = 0
            expected = propagate_scenario(
                mixed_network(several, aircraft=nothing), method=method
            ).std
            assert_allclose(found.parts[f"{name}_constant_{key}"].std, expected, rtol=1e-4)


def test_indices_of_parts():
    """With a quarter of the tolerances P_D is nearly linear, and indices are linear shares."""
    quarter = [
        {k: std / 4 for k, std in stds.items()} for stds in (MIXED_SEARCH_STD, MIXED_TRACK_STD)
    ]
    s = mixed_network(mixed_radars(*quarter), sweep=(60, 60, 1), runs=2**14)
    found, linear = error_budget(s, "montecarlo"), error_budget(s)
    assert list(found.parts) == list(linear.parts) == ROWS
    assert found.total.std[0] == pytest.approx(linear.total.std[0], rel=0.02)
    errors = {c.name: c.share_error for c in (*found.sources.values(), *found.parts.values())}
    for mine, theirs in (
        (part_shares(found), part_shares(linear)),
        (shares_of(found), shares_of(linear)),
    ):
        assert list(mine) == list(theirs)
        for name, share in mine.items():
            assert errors.get(name, found.interaction.share_error)[0] < 0.02
            assert share[0] == pytest.approx(theirs[name][0], abs=0.03)
    assert max(share[0] for share in part_shares(linear).values()) > 0.2
    assert sum(share[0] for share in shares_of(found).values()) == pytest.approx(1)
    # errors of the sources, not of their parts, cancel in the interaction
    of_sources = [c.share_error[0] for c in found.sources.values()]
    assert found.interaction.share_error[0] < 0.6 * np.linalg.norm(of_sources)


@pytest.mark.parametrize("method", ["linear", "probit"])
def test_how_much_a_part_of_one_radar_must_be_reduced(method):
    def known_to(gain):
        several = mixed_radars(
            {**MIXED_SEARCH_STD, "loss_db": 0.2}, {**MIXED_TRACK_STD, "gain_dbi": gain}
        )
        several[1]["uncertainty"]["sheet"]["position_m"] = 6000
        return mixed_network(several, sweep=(60, 60, 1))

    s, half = known_to(0.5), known_to(0.25)
    target = 3 * propagate_scenario(half, method=method).std.max()
    three_sigma = value_function(s, method)
    assert three_sigma(["b_constant_gain_dbi"], 0.5) == pytest.approx(target, rel=1e-12)
    allowed = required_accuracies(s, Requirement(target, width=True), method=method)
    assert list(allowed) == [*error_budget(s).sources, "b_position", "b_constant", *ROWS, "all"]
    assert allowed["b_constant_gain_dbi"].factor == pytest.approx(0.5, rel=1e-6)
    report = analyses.budget(s, method=method, target=target).report
    assert any(re.fullmatch(r" +constant_gain_dbi +50 %", line) for line in report)
    if method == "probit":
        return
    found = error_budget(s)
    rest = stds_of({**found.sources, **found.parts, "b_position": found.finer["b_position"]})
    for name in ("b", "a_constant_average_power_kw", "a_constant_temperature_k",
                 "a_constant_loss_db", "b_constant_gain_dbi"):  # fmt: skip
        del rest[name]
    # the residual counts the rest of the same radar, not the whole radar
    assert max(rest, key=lambda n: rest[n][0]) == "b_position"
    assert allowed["b_constant_gain_dbi"].residual_from == "b_position"
    both = three_sigma(["a_constant_loss_db", "b_constant_gain_dbi"], 0.0) ** 2 / 9
    gone = found.parts["a_constant_loss_db"].std ** 2 + found.parts["b_constant_gain_dbi"].std ** 2
    assert_allclose(both, found.total.std**2 - gone, rtol=1e-12)


def test_the_command_shows_the_parts(tool):
    write(yaml_text(mixed_document(sweep=(60, 60, 1))))
    options = ["--target", "0.1", "--method=linear", "--no-plot", "--out=out"]
    code, out, err = tool("budget", "my.yaml", *options)
    assert code == 0, err
    lines = out.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("3 sigma of P_D")) + 1
    rows = [line.split()[0] for line in lines[first : first + 16]]
    at = {row: i for i, row in enumerate(rows)}
    # under the radar that they are of, largest first
    for name, keys in (("a", MIXED_SEARCH_STD), ("b", MIXED_TRACK_STD)):
        mine = rows[at[name] + 1 : at[name] + 6]
        assert set(mine) == {"position", "constant", *(f"constant_{key}" for key in keys)}
    shown = [re.search(r" (\d\.\d{4}|0|\de-\d+) ", line).start() for line in lines[first:][:15]]
    assert len(set(shown)) == 1  # in one column
    header = Path("out/paper_budget.csv").read_text().splitlines()[0].split(",")
    assert header[-6:] == [f"three_sigma_{row}" for row in ROWS]
    summary = read_record("out/paper_budget.json")["summary"]
    at_largest = summary["radar_constant_parts_at_largest"]
    shares = summary["shares_of_radar_constant_parts_at_largest"]
    assert list(at_largest) == list(shares) == ROWS
    (values,) = np.loadtxt("out/paper_budget.csv", delimiter=",", skiprows=1, ndmin=2)
    assert list(at_largest.values()) == pytest.approx(values[-6:])
    total = values[header.index("three_sigma_total")]
    assert list(shares.values()) == pytest.approx((values[-6:] / total) ** 2)


def test_check_shows_the_distribution_of_every_constant(tool):
    write(yaml_text(mixed_document()))
    code, out, _ = tool("check", "my.yaml")
    assert code == 0
    message = [line for line in out.splitlines() if "has mean" in line]
    assert [line[:21] for line in message] == ["# a, sheet: c_r has m", "# b, sheet: c_r has m"]
    assert parse_scenario(out).tolerances == mixed_network().tolerances


@pytest.mark.parametrize(
    "names", [("a", "a_constant_loss_db"), ("error_a_constant_x", "a"), ("a_constant_b", "c", "a")]
)
def test_names_that_a_part_may_have_are_refused(tool, names):
    assert "begins parts of c_r" in name_problem(names)
    several = [{**mixed_radars()[0], "name": name} for name in names]
    write(yaml_text(mixed_document(several)))
    one_line(tool, "variance", "my.yaml")
    assert name_problem(["a", "b", "a_loss_db", "a_constan"]) is None


def test_names_that_a_column_of_the_range_may_have_are_refused():
    """The second sigma_range_m_0.5_a_from_aircraft_position would overwrite the first."""
    assert "'a_from_' begins" in name_problem(["b", "a_from_aircraft_position", "a"])
    assert name_problem(["a_from", "b_from_a", "a"]) is None


def test_the_name_of_a_radar_changes_no_number():
    """A radar may be named like the RCS, which is another source of the budget."""
    content = mixed_document()
    renamed = {**content, "radars": [dict(entry) for entry in content["radars"]]}
    renamed["radars"][1]["name"] = "aircraft_rcs_2"
    before, after = (error_budget(parse_scenario(yaml_text(c))) for c in (content, renamed))
    for kind in ("sources", "parts", "finer"):
        found = {n.replace("aircraft_rcs_2", "b"): c.std for n, c in getattr(after, kind).items()}
        expected = {name: c.std for name, c in getattr(before, kind).items()}
        assert list(found) == list(expected)
        for name, std in expected.items():
            assert_array_equal(found[name], std)


@pytest.mark.parametrize(
    ("radar", "position_m", "constant"),
    [(0, 15_000, MIXED_SEARCH_STD), (2, 2500, 0.2 * MIXED_NUMBER[0])],
)
def test_the_largest_piece_of_all_radars_comes_first(radar, position_m, constant):
    """A badly known place, or a parameter of a though place and c_r of c together make more.

    Half the deviation leaves √(total² − ¾ of its own) by `linear`.
    """
    radars = mixed_radars()
    radars[radar]["uncertainty"]["sheet"] = {"position_m": position_m, "constant": constant}
    s = mixed_network(radars, sweep=(60, 60, 1), runs=2048)
    result = analyses.budget(s, method="linear")
    table = {name: float(values[0]) for name, values in result.table.items()}
    pieces = {
        name.removeprefix("three_sigma_"): value
        for name, value in table.items()
        if re.fullmatch(r"three_sigma_([abc]_(position|constant.*)|aircraft_\w+)", name)
        and name not in ("three_sigma_a_constant", "three_sigma_b_constant")
    }
    largest, total = max(pieces, key=pieces.__getitem__), table["three_sigma_total"]
    assert largest == ("a_position" if radar == 0 else "a_constant_loss_db")
    left = np.sqrt(total**2 - 0.75 * pieces[largest] ** 2)
    assert result.report[0] == (
        f"know better first: {largest}, {(pieces[largest] / total) ** 2:.1%} of the variance of "
        f"P_D at 60 deg; half its deviation leaves {left:.4f} of {total:.4f}"
    )
    if radar == 0:  # Sobol' indices are of whole radars
        first, *_ = analyses.budget(s, method="montecarlo").report
        assert first.startswith("know better first: a, ")
    labels = [line.get_label() for line in result.plot().axes[0].lines]
    assert set(labels) == {"aircraft position", "aircraft orientation", "a", "b", "c", "total"}


# A single radar.

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
