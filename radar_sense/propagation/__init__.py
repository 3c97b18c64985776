"""Methods of propagation: from uncertain states to mean, deviation and bounds of P_D."""

from radar_sense.propagation.automatic import BOUND_CHANGE as BOUND_CHANGE
from radar_sense.propagation.automatic import STD_CHANGE as STD_CHANGE
from radar_sense.propagation.methods import AUTOMATIC as AUTOMATIC
from radar_sense.propagation.methods import METHODS as METHODS
from radar_sense.propagation.methods import MONTE_CARLO as MONTE_CARLO
from radar_sense.propagation.methods import Band as Band
from radar_sense.propagation.methods import Moments as Moments
from radar_sense.propagation.methods import band_of_scenario as band_of_scenario
from radar_sense.propagation.methods import distribution as distribution
from radar_sense.propagation.methods import no_draws as no_draws
from radar_sense.propagation.methods import propagate as propagate
from radar_sense.propagation.methods import propagate_scenario as propagate_scenario
from radar_sense.propagation.methods import std_off_in_scenario as std_off_in_scenario
from radar_sense.propagation.methods import unreliable as unreliable
from radar_sense.propagation.methods import unreliable_in_scenario as unreliable_in_scenario
from radar_sense.propagation.moments import Distribution as Distribution
