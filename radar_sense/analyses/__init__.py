"""The analyses, one file each: a scenario in, a Result and its figure out."""

from radar_sense.analyses.budget import budget as budget
from radar_sense.analyses.compare import compare as compare
from radar_sense.analyses.contract import Analysis as Analysis
from radar_sense.analyses.contract import Result as Result
from radar_sense.analyses.convergence import convergence as convergence
from radar_sense.analyses.coverage_map import coverage_map as coverage_map
from radar_sense.analyses.detection_range import detection_range as detection_range
from radar_sense.analyses.detectors import detectors as detectors
from radar_sense.analyses.mission import mission as mission
from radar_sense.analyses.montecarlo import montecarlo as montecarlo
from radar_sense.analyses.rcs import rcs as rcs
from radar_sense.analyses.sensitivity import sensitivity as sensitivity
from radar_sense.analyses.validate import validate as validate
from radar_sense.analyses.variance import variance as variance
