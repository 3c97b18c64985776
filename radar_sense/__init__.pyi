"""The public names. `__init__.py` reads the modules of the names from this file."""

from radar_sense import analyses as analyses
from radar_sense.analyses.report import report as report
from radar_sense.axis import Axis as Axis
from radar_sense.command import Result as Result
from radar_sense.errors import ComputationError as ComputationError
from radar_sense.errors import FigureError as FigureError
from radar_sense.errors import InputError as InputError
from radar_sense.flight import Path as Path
from radar_sense.flight import States as States
from radar_sense.model.antenna import ElevationGain as ElevationGain
from radar_sense.model.antenna import Mask as Mask
from radar_sense.model.attenuation import Attenuation as Attenuation
from radar_sense.model.detection_model import DetectionModel as DetectionModel
from radar_sense.model.detection_model import Linearization as Linearization
from radar_sense.model.detectors import BinaryIntegration as BinaryIntegration
from radar_sense.model.detectors import CellAveraging as CellAveraging
from radar_sense.model.detectors import Detector as Detector
from radar_sense.model.detectors import Marcum as Marcum
from radar_sense.model.detectors import North as North
from radar_sense.model.detectors import OrderedStatistics as OrderedStatistics
from radar_sense.model.detectors import Swerling1 as Swerling1
from radar_sense.model.detectors import Swerling2 as Swerling2
from radar_sense.model.detectors import Swerling3 as Swerling3
from radar_sense.model.detectors import Swerling4 as Swerling4
from radar_sense.model.horizon import Horizon as Horizon
from radar_sense.model.network import NetworkModel as NetworkModel
from radar_sense.model.radar import Level as Level
from radar_sense.model.radar import Radar as Radar
from radar_sense.model.radar_constant import Tolerance as Tolerance
from radar_sense.model.radar_equation import SurveillanceRadar as SurveillanceRadar
from radar_sense.model.radar_equation import TrackingRadar as TrackingRadar
from radar_sense.model.rcs import RCS as RCS
from radar_sense.model.rcs import ConstantRCS as ConstantRCS
from radar_sense.model.rcs import EllipsoidRCS as EllipsoidRCS
from radar_sense.model.rcs import ExactEllipsoidRCS as ExactEllipsoidRCS
from radar_sense.model.rcs import SpikeballRCS as SpikeballRCS
from radar_sense.model.rcs_table import TableRCS as TableRCS
from radar_sense.model.trajectory import Route as Route
from radar_sense.montecarlo.montecarlo import MonteCarlo as MonteCarlo
from radar_sense.montecarlo.montecarlo import monte_carlo as monte_carlo
from radar_sense.propagation import Moments as Moments
from radar_sense.propagation import propagate as propagate
from radar_sense.propagation import propagate_scenario as propagate_scenario
from radar_sense.propagation import unreliable as unreliable
from radar_sense.scenario import Scenario as Scenario
from radar_sense.scenario_file.load import load_scenario as load_scenario
from radar_sense.scenario_file.load import parse_scenario as parse_scenario
from radar_sense.scenario_file.rcs_file import load_rcs_table as load_rcs_table
from radar_sense.scenario_file.route_file import load_route as load_route

__version__: str
__all__: list[str]
