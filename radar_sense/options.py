"""The options that mean the same in every command."""

from __future__ import annotations

from dataclasses import replace

from radar_sense import limits
from radar_sense.command import Option
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.propagation import METHODS, MONTE_CARLO

LEVEL = Option("level", "Level of radar uncertainty.", metavar="NAME")
ONE_RADAR = Option("radar", "Only this radar of a network.", metavar="NAME")
METHOD = Option(
    "method",
    f"Method of propagation: {', '.join(METHODS)}.",
    metavar="NAME",
    choices=METHODS,
    default_text="the scenario's",
)
#: Of commands that compare with draws, or need a bound at too many poses for plain draws.
METHOD_BUT_DRAWS = replace(
    METHOD, help=f"Method of propagation: {', '.join(m for m in METHODS if m != MONTE_CARLO)}."
)
NUMBER_OF_RUNS = Option("runs", "Number of runs.", limits.RUNS, default_text="the scenario's")
SEED_OF_DRAWS = Option(
    "seed", "Seed of the random draws.", limits.SEED, default_text="the scenario's"
)
SAMPLER = Option(
    "sampler",
    "random; or sobol, quasi-random points that need fewer runs for mean and sigma.",
    metavar="NAME",
    choices=SAMPLERS,
)
WORKER_THREADS = Option(
    "workers",
    "Threads to compute with; the numbers do not depend on the number of threads.",
    limits.WORKERS,
    default_text="all cores, at most 8",
)
DASK = Option(
    "dask",
    "Compute on a Dask cluster, given by its scheduler, such as tcp://host:8786.",
    metavar="ADDRESS",
)
DOWN_KM = Option(
    "down_km",
    "Minus the height above the origin.",
    limits.MAP_KM,
    "KM",
    default_text="the first pose's",
)
COURSE_DEG = Option(
    "course_deg",
    "Heading of the aircraft.",
    limits.Limit(at_least=-360, at_most=360),
    "DEG",
    default_text="the first pose's",
)
THRESHOLD = Option(
    "threshold",
    "Test P_D + K sigma <= P_MAX at every pose, on a path between poses too; exit code 3 if the "
    "test is violated or not known.",
    limits.THRESHOLD,
    metavar="P_MAX",
    excludes=("at_least",),
)
AT_LEAST = Option(
    "at_least",
    "Test P_D - K sigma >= P_MIN, of radars that are to detect, at every pose, on a path between "
    "poses too; exit code 3 if the test is violated or not known.",
    limits.P_MIN,
    metavar="P_MIN",
)
K = Option(
    "k",
    "Number of sigma of the band.",
    limits.SIGMAS,
    metavar="K",
    default_text="3",
    excludes=("probability",),
)
PROBABILITY = Option(
    "probability",
    "Largest P(P_D > P_MAX), or P(P_D < P_MIN), that passes the test at a pose, in place of K: "
    "0.01 corresponds to K 2.326. Unlike with K, P_D itself may be beyond the limit.",
    limits.ABOVE,
    metavar="P",
    needs=("threshold", "at_least"),
)
