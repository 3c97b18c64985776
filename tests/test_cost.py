"""Whatever is long says so before it starts, and whatever is too large is refused in one line."""

import logging

import numpy as np
import pytest
from helpers import scenario

import radar_sense as rs
from radar_sense import cost, sources
from radar_sense.coverage import grid
from radar_sense.montecarlo import montecarlo
from radar_sense.propagation import draws as judging


@pytest.fixture(autouse=True)
def warnings_are_heard(caplog: pytest.LogCaptureFixture) -> None:
    """A run of the command line with -q sets the level of the process."""
    caplog.set_level(logging.WARNING, "radar_sense")


@pytest.mark.parametrize(
    ("evaluations", "memory", "workers", "said"),
    [
        (9 * cost.RATE, 1e9, 1, ""),
        (11 * cost.RATE, 0, 1, "sizes take some 11 seconds; fewer take less"),
        (11 * cost.RATE, 0, 2, ""),
        (600 * cost.RATE, 2e9, 1, "sizes take some 10 minutes; fewer take less"),
        (9 * cost.RATE, 2e9, 1, "sizes take 2.0 GB of memory; fewer take less"),
    ],
)
def test_what_is_said(caplog, evaluations, memory, workers, said):
    cost.foresee("sizes", evaluations, memory, less="fewer", workers=workers)
    assert caplog.text.count("take") == 2 * bool(said)
    assert said in caplog.text


@pytest.mark.parametrize(
    ("evaluations", "memory", "words"),
    [(1e6 * cost.RATE, 0, "12 days, allowed is a day"), (0, 5e9, "5.0 GB of memory, allowed")],
)
def test_what_is_refused(evaluations, memory, words):
    with pytest.raises(rs.InputError, match=f"sizes take .*{words}.*; choose fewer"):
        cost.foresee("sizes", evaluations, memory, less="fewer")


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(12, "12 seconds"), (119, "119 seconds"), (600, "10 minutes"), (7200, "2 hours")],
)
def test_durations(seconds, words):
    assert cost.duration(seconds) == words


def stop(*args, **options):
    raise KeyboardInterrupt


def test_draws_are_announced_before_the_first(caplog, monkeypatch):
    monkeypatch.setattr(montecarlo, "Sampler", stop)
    with pytest.raises(KeyboardInterrupt):
        rs.monte_carlo(scenario(), runs=10_000_000)
    assert "10,000,000 runs of 361 poses and 1 radar take some 6 minutes" in caplog.text
    monkeypatch.setattr(sources, "sobol_indices", stop)
    with pytest.raises(KeyboardInterrupt):
        sources.error_budget(scenario().with_analysis(runs=1_000_000), "montecarlo")
    assert "Sobol' indices of 1,000,000 runs at 361 poses take some 6 minutes" in caplog.text


LOBES = {"aircraft.rcs": "{model: spikeball, lobes: 400, amplitude_m2: 0.18, floor_m2: 0.1}"}


@pytest.mark.parametrize(("changes", "poses"), [({}, 1200), (LOBES, 75)])
@pytest.mark.all_draws
def test_draws_that_judge_are_announced_before_the_first(caplog, monkeypatch, changes, poses):
    """A cross section with narrow lobes needs more of them."""
    monkeypatch.setattr(judging, "_draw", stop)
    monkeypatch.setattr(cost, "SECONDS", 0.5)
    s = rs.load_scenario(None, changes).with_analysis(method="automatic")
    with pytest.raises(KeyboardInterrupt):
        rs.analyses.variance(s.at_poses(np.resize(np.arange(361), poses)))
    assert f"1,228,800 draws at {poses:,} poses take some 1 seconds; fewer poses" in caplog.text


def test_plain_draws_that_do_not_fit_in_memory_are_refused():
    s = scenario().with_analysis(method="montecarlo", runs=10**8)
    with pytest.raises(rs.InputError, match=r"36,100,000,000 draws at 361 poses .* fewer --runs"):
        rs.analyses.variance(s)


def test_a_map_is_announced_before_the_first_cell(caplog, monkeypatch):
    monkeypatch.setattr(grid, "_in_cells", stop)
    ends = {"north_km": (-600, 600), "east_km": (-600, 600)}
    with pytest.raises(KeyboardInterrupt):
        rs.analyses.coverage_map(scenario(), step_km=1.0, upper=True, method="form", **ends)
    assert "1,201 x 1,201 cells of 1 radar take some 50 seconds" in caplog.text


@pytest.mark.parametrize("options", [{"runs": 10**9}, {"runs": 3 * 10**8, "workers": 1}])
def test_what_would_take_days_is_refused_before_anything_is_drawn(options, monkeypatch):
    monkeypatch.setattr(montecarlo, "Sampler", stop)
    many = scenario(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 0.001})
    with pytest.raises(rs.InputError, match=r"GB of memory|allowed is a day"):
        rs.monte_carlo(many, **options)


@pytest.mark.parametrize("quiet", [False, True])
def test_the_command_line_says_it_on_standard_error(tool, monkeypatch, quiet):
    monkeypatch.setattr(cost, "SECONDS", 0.0)
    monkeypatch.setattr(logging.getLogger("radar_sense"), "propagate", False)
    runs = ["montecarlo", "--runs", "2", "--no-plot", *(["-q"] if quiet else [])]
    code, out, err = tool(*runs)
    assert code == 0
    assert "take some" not in out
    assert ("2 runs of 361 poses and 1 radar take some 0 seconds" in err) != quiet
