"""Bounds of `mission` against plain draws: the worked missions, and twenty random ones.

    python tests/studies/mission_bounds.py [RUNS] [NAME ...]

RUNS plain draws of each mission are made, 20 000 unless given. The drawn 3-sigma bound is the draw
of a certain rank. The draws of a lower and a higher rank are the ends of its interval. These ranks
are three standard errors away: 3 √n for n draws beyond the bound. A bound fails at a time if it is
outside this interval and more than 0.01 from the drawn bound. The table has a row for each event
and bound. Four bounds of some 6 000 times are outside by chance.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

import radar_sense as rs
from radar_sense.mission.looks import Looks
from radar_sense.mission.recombined import recombined_missions
from radar_sense.mission.tracks import event_probabilities
from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.states import of_each

CONFIGS = Path(__file__).parents[2] / "configs"
WINDOWS = [(1, 2), (2, 3), (2, 4), (3, 5), (3, 6), (4, 6), (5, 8)]
BLOCK = 500
SEED = 987_654
NAMES = ["mission", "corridor", *(f"random{i}" for i in range(20))]


def random_mission(number: int, folder: Path) -> tuple[rs.Scenario, tuple[int, int]]:
    """Return a mission of one to eight radars with errors of kilometres and of 1 to 3 dB."""
    rng = np.random.default_rng([2026, number])
    count = 1 + number % 8
    length, duration = rng.uniform(80e3, 250e3), rng.uniform(500, 1500)
    rows = ["time_s,north_m,east_m,down_m"]
    for x in np.linspace(0, 1, 12):
        weave = 15e3 * math.sin(rng.uniform(2, 8) * x)
        rows.append(f"{x * duration},{weave},{(x - 0.5) * length},-6000")
    (folder / "route.csv").write_text("\n".join(rows) + "\n")
    periods = rng.choice([4, 5, 6, 8, 10, 12], size=rng.integers(1, count + 1))
    radars = []
    for i in range(count):
        spread = rng.uniform(500, 4000)
        radars.append({
            "name": f"r{i}",
            "position_m": [rng.uniform(-60e3, 60e3), rng.uniform(-0.6, 0.6) * length, -50.0],
            "tracking": {
                "peak_power_kw": 10.0, "gain_dbi": 38, "frequency_ghz": 9, "pulse_width_us": 10,
                "temperature_k": 290, "loss_db": 8, "noise_figure_db": 5,
            },
            "p_fa": 1e-6,
            "detector": str(rng.choice(["north", "swerling1", "marcum", "swerling3"])),
            "scan_period_s": float(rng.choice(periods)),
            "uncertainty": {"one": {
                "position_m": [spread, spread, 20.0],
                "constant": {"loss_db": float(rng.uniform(1, 3))},
            }},
        })  # fmt: skip
        if rng.random() < 0.3:
            radars[-1]["max_range_km"] = float(rng.uniform(60, 150))
    document = {
        "name": f"random{number}",
        "radars": radars,
        "aircraft": {"rcs": {"model": "ellipsoid_exact", "x_m": 0.3, "y_m": 0.2, "z_m": 0.1}},
        "geometry": {
            "type": "path", "file": "route.csv", "axis": "time",
            "interpolate": {"step_s": 2, "method": "smooth"},
        },
        "uncertainty": {
            "aircraft": {
                "position_m": float(rng.uniform(50, 1000)),
                "attitude_deg": float(rng.uniform(0.5, 3)),
            },
            "aircraft_correlation_s": [0, 300, ".inf"][number % 3],
        },
        "analysis": {"level": "one", "seed": number},
    }  # fmt: skip

    def load() -> rs.Scenario:
        (folder / "mission.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
        return rs.load_scenario(folder / "mission.yaml")

    # the power that gives a radar the wanted greatest P_D
    for i, radar in enumerate(radars):
        wanted, low, high = 10 ** rng.uniform(-1.7, -0.3), -8.0, 8.0
        scenario = load()
        state = scenario.radar[4 * i : 4 * i + 4].copy()
        constant = state[3]
        model = scenario.model.models[i]
        for _ in range(40):
            middle = 0.5 * (low + high)
            state[3] = constant * 10**middle
            low, high = (
                (middle, high) if model.p_d(scenario.aircraft, state).max() < wanted else
                (low, middle)
            )  # fmt: skip
        radar["tracking"]["peak_power_kw"] = float(10.0 * 10**low)
    return load(), WINDOWS[number % len(WINDOWS)]


def plain_draws(
    looks: Looks, window: tuple[int, int], runs: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the least and the greatest draws (keep, K) of P for each event, from the extreme."""
    drawn, times = looks.scenario.states(), len(looks.schedule.time)
    rng = np.random.default_rng(SEED)
    keep = math.ceil(TAIL * runs + 4.0 * math.sqrt(TAIL * runs)) + 2
    extremes = [(np.empty((0, times)),) * 2 for _ in range(2)]
    for _ in range(runs // BLOCK):
        radars = drawn.radars_at(rng.standard_normal((BLOCK, drawn.radar_normals)))
        poses = looks.poses(rng.standard_normal((times, 6, BLOCK)))
        states = of_each(radars, len(looks.scenario.radars))
        p_d = [looks.p_d(i, poses, s[:, np.newaxis]) for i, s in enumerate(states)]
        for event, p in enumerate(event_probabilities(looks.schedule, p_d, window)):
            least, greatest = extremes[event]
            extremes[event] = (
                np.sort(np.concatenate([least, p.T]), axis=0)[:keep],
                np.sort(np.concatenate([greatest, p.T]), axis=0)[::-1][:keep],
            )
    return extremes


def drawn_bound(extreme: np.ndarray, runs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a bound (K,), and the ends of its interval of three standard errors."""
    rank, error = TAIL * runs, math.sqrt(TAIL * runs)

    def at(position: float) -> np.ndarray:
        below = math.floor(position)
        return extreme[below] + (position - below) * (extreme[below + 1] - extreme[below])

    ends = at(max(rank - 3.0 * error - 0.5, 0.0)), at(rank + 3.0 * error - 0.5)
    return at(rank - 0.5), np.minimum(*ends), np.maximum(*ends)


def compare(name: str, scenario: rs.Scenario, window: tuple[int, int], runs: int) -> None:
    """Print a row of the table for each bound of each event."""
    looks = Looks.of(scenario)
    start = time.process_time()
    bounds = recombined_missions(looks, window)[0]
    seconds = time.process_time() - start
    print(
        f"{name}: {len(looks.times)} radars, {sum(map(len, looks.times))} looks of radars, "
        f"{window[0]} of {window[1]}, {scenario.correlation_s:g} s; {seconds:.1f} s of CPU"
    )
    extremes = plain_draws(looks, window, runs)
    for event, found, extreme in zip(("detection", "track"), bounds, extremes, strict=True):
        for end, drawn in zip(("lower", "upper"), extreme, strict=True):
            expected, low, high = drawn_bound(drawn, runs)
            bound, error = getattr(found, end), getattr(found, f"{end}_se")
            off = abs(bound - expected)
            fails = (off > 0.01) & ((bound < low) | (bound > high))
            worst = int(np.argmax(np.where(fails, 1.0 + off, off)))
            print(
                f"  {event:9} {end}: fails at {np.count_nonzero(fails):3} of {len(off)} times; "
                f"worst {bound[worst]:.4f} +/- {error[worst]:.4f} for {expected[worst]:.4f} "
                f"[{low[worst]:.4f}, {high[worst]:.4f}]; largest standard error {error.max():.4f}",
                flush=True,
            )


def main() -> None:
    runs = int(float(sys.argv[1])) if len(sys.argv) > 1 else 20_000
    for name in sys.argv[2:] or NAMES:
        with tempfile.TemporaryDirectory() as folder:
            if name.startswith("random"):
                problem = random_mission(int(name[6:]), Path(folder))
            else:
                problem = rs.load_scenario(CONFIGS / f"{name}.yaml"), (3, 5)
            compare(name, *problem, runs)


if __name__ == "__main__":
    main()
