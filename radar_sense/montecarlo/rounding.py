"""A fixed computation whose last digits show the rounding of a process.

NumPy and the C library choose their code by the CPU. The last digit of exponentials and tangents,
and of statistics of P_D, may therefore differ from machine to machine.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np

from radar_sense.covariance import from_std
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.rcs import EllipsoidRCS
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import Random

#: Runs and poses of the fixed computation: enough for rare differences of rounding.
RUNS, POSES = 64, 64


@lru_cache
def rounding_digest() -> str:
    """Return a digest of a fixed block of draws and of P_D, computed once in each process."""
    azimuth = np.linspace(0.0, np.pi, POSES)
    aircraft = np.zeros((POSES, 6))
    aircraft[:, 0], aircraft[:, 1] = 500e3 * np.cos(azimuth), 500e3 * np.sin(azimuth)
    aircraft[:, 2] = -3000.0
    sampler = Sampler.of_states(
        DetectionModel(rcs=EllipsoidRCS(a=0.15, b=0.13, c=0.21), p_fa=1.7e-4),
        aircraft,
        np.array([0.0, 0.0, 0.0, 167.0]),
        from_std([100.0, 100.0, 100.0, 0.02, 0.02, 0.02]),
        from_std([100.0, 100.0, 100.0, 5.0]),
    )
    radar_normals, aircraft_normals = Random(0, RUNS, POSES).block(0)
    radar, _ = sampler.draw_radar(radar_normals)
    p_d = sampler.draw_p_d(aircraft_normals, radar)
    digest = hashlib.sha256()
    for values in (radar, aircraft_normals, p_d):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:16]
