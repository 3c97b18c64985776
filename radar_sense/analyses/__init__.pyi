"""The signatures of the analyses. Made by docs/make_reference.py."""

from collections.abc import Sequence
from concurrent.futures import Executor

from radar_sense.analyses.contract import Analysis as Analysis
from radar_sense.analyses.contract import Progress
from radar_sense.analyses.contract import Result as Result
from radar_sense.scenario import Scenario

def budget(
    scenario: Scenario,
    *,
    method: str = "automatic",
    target: float | None = None,
    threshold: float | None = None,
    k: float | None = None,
    at: float | None = None,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def compare(
    scenario: Scenario,
    *,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def convergence(
    scenario: Scenario,
    *,
    runs: int = 16384,
    workers: int = 1,
    level: str | None = None,
    radar: str | None = None,
    seed: int | None = None,
) -> Result: ...
def coverage_map(
    scenario: Scenario,
    *,
    north_km: tuple[float, float] | None = None,
    east_km: tuple[float, float] | None = None,
    step_km: float | None = None,
    down_km: float | None = None,
    course_deg: float | None = None,
    p_d: float | Sequence[float] = (0.1, 0.5, 0.9),
    upper: bool = False,
    worst_heading: bool = False,
    method: str = "linear",
    workers: int = 1,
    progress: Progress = ...,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def detection_range(
    scenario: Scenario,
    *,
    method: str = "linear",
    p_d: float | Sequence[float] = (0.5,),
    by: str = "bearing",
    step_deg: float = 1.0,
    down_km: float | None = None,
    course_deg: float | None = None,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def detectors(
    scenario: Scenario,
    *,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def mission(
    scenario: Scenario,
    *,
    method: str = "importance",
    m: int | None = None,
    n: int | None = None,
    runs: int | None = None,
    workers: int = 1,
    progress: Progress = ...,
    level: str | None = None,
    radar: str | None = None,
    seed: int | None = None,
) -> Result: ...
def montecarlo(
    scenario: Scenario,
    *,
    method: str = "linear",
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def rcs(
    scenario: Scenario,
    *,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def sensitivity(
    scenario: Scenario,
    *,
    method: str = "linear",
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def validate(
    scenario: Scenario,
    *,
    method: str = "linear",
    digits: int = 2,
    workers: int = 1,
    progress: Progress = ...,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
def variance(
    scenario: Scenario,
    *,
    method: str = "automatic",
    threshold: float | None = None,
    k: float | None = None,
    level: str | None = None,
    radar: str | None = None,
    runs: int | None = None,
    seed: int | None = None,
) -> Result: ...
