"""Methods of propagation: from Gaussian states to mean, deviation and bounds of P_D."""

from radar_sense.propagation.methods import LARGEST_PROBIT as LARGEST_PROBIT
from radar_sense.propagation.methods import METHODS as METHODS
from radar_sense.propagation.methods import Method as Method
from radar_sense.propagation.methods import check_method as check_method
from radar_sense.propagation.methods import exceedance_probability as exceedance_probability
from radar_sense.propagation.methods import nonlinear as nonlinear
from radar_sense.propagation.methods import nonlinear_in_scenario as nonlinear_in_scenario
from radar_sense.propagation.methods import propagate as propagate
from radar_sense.propagation.methods import propagate_scenario as propagate_scenario
from radar_sense.propagation.methods import std_function as std_function
from radar_sense.propagation.methods import upper_bound as upper_bound
from radar_sense.propagation.methods import upper_bound_in_scenario as upper_bound_in_scenario
from radar_sense.propagation.moments import BOUND_CHANGE as BOUND_CHANGE
from radar_sense.propagation.moments import STD_CHANGE as STD_CHANGE
from radar_sense.propagation.moments import Moments as Moments
from radar_sense.propagation.moments import probit_moments as probit_moments
