"""Plain draws of whole missions: one draw of the radars a run, pose errors correlated in time."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from radar_sense.mission.looks import Looks
from radar_sense.mission.tracks import event_probabilities
from radar_sense.montecarlo.montecarlo import SAMPLES_PER_BLOCK
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.sampler import clipped
from radar_sense.montecarlo.statistics import DrawStatistics, Statistics
from radar_sense.progress import report
from radar_sense.states import AIRCRAFT, of_each
from radar_sense.streams import Stream, random_stream


def draw_missions(
    looks: Looks,
    m_of_n: tuple[int, int] | None = None,
    *,
    k: float = 3.0,
    workers: int = 1,
) -> tuple[list[DrawStatistics], int]:
    """Draw whole missions, as many as the runs of the scenario, and return statistics of events.

    They are by each time (K,), of detection, and of a track if m and n are given: m detections of n
    looks. The quantiles are at Φ(−k) and Φ(k). Also returned is in how many runs a radar constant
    was drawn below zero and set to zero. The result does not depend on the number of workers.
    """
    scenario, times, tail = looks.scenario, len(looks.schedule.time), float(ndtr(-k))
    states, runs = scenario.states(), scenario.runs
    runs_per_block = max(1, SAMPLES_PER_BLOCK // times)

    def draw(block: int) -> tuple[list[Statistics], int]:
        generator = random_stream(scenario.seed, Stream.MISSION, block)
        # A whole block is drawn, because a longer computation must begin with the same runs.
        radar_normals = generator.standard_normal((runs_per_block, states.radar_normals))
        normals = generator.standard_normal((times, len(AIRCRAFT), runs_per_block))
        rows = slice(min(runs_per_block, runs - block * runs_per_block))
        radar = states.radars_at(radar_normals[rows])
        poses, each = looks.poses(normals[..., rows]), of_each(radar, len(scenario.radars))
        p_d = [looks.p_d(i, poses, own[:, np.newaxis]) for i, own in enumerate(each)]
        statistics = []
        for probability in event_probabilities(looks.schedule, p_d, m_of_n):
            statistics.append(Statistics(times, runs, tail))
            statistics[-1].add(probability.T)
        return statistics, clipped(radar)

    totals = [Statistics(times, runs, tail) for _ in range(2 if m_of_n else 1)]
    all_clipped = 0
    for statistics, of_block in in_order(draw, math.ceil(runs / runs_per_block), workers):
        for total, more in zip(totals, statistics, strict=True):
            total.merge(more)
        all_clipped += of_block
        report("runs", totals[0].count, runs)
    return [total.result() for total in totals], all_clipped
