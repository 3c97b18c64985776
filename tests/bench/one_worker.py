"""Print the time of a number of runs of the default scenario with one worker [s]."""

import sys
import time

import radar_sense as rs

scenario = rs.load_scenario()
for runs in (2_000, int(sys.argv[1])):  # the first is to have everything imported and in memory
    start = time.perf_counter()
    rs.monte_carlo(scenario, runs=runs, seed=1, workers=1)
print(time.perf_counter() - start)
