"""Inputs that broke a property once, as the fuzzer found them, with fewer digits."""

from __future__ import annotations

import pytest
from fuzz.drawing import CONFIG, Case
from fuzz.properties import check

from radar_sense.propagation import form

pytestmark = pytest.mark.usefixtures("quick")

ROUTE = """\
time_s,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg
0.4434383581784298,283353.6025474385,1e+08,-8443.032979733716,0.6019,2.26275,2.10198
43.31149939656868,283778.93275520107,310338.53500715655,-9891.134020292988,-1,3,4.56351
43.31186661869347,324596.69494980504,302556.8528025414,-8424.328962554786,3.96936,1.55517,4.3038
43.72153997086076,292228.14495040366,277319.140926962,-9824.233859599015,218.9972,0.0966,4.6430850
"""
#: `budget --threshold` searched for a factor between two that form has an answer for; in between
#: form had none, and SciPy's root finder raised ValueError.
NO_ANSWER_BETWEEN = """\
radar:
  position_m: [252.8, 189.52674142364836, 1414.2107533362171]
  p_fa: 9.661974233168612e-09
  tracking: {peak_power_w: 1.81014, gain_dbi: 2.79951901489752863, wavelength_m: 5.319,
    pulse_width_us: 0.2782933, temperature_k: 0.1625, loss_db: 0.20245028513338131,
    noise_figure_db: 0.1975736}
aircraft: {rcs: {model: spikeball, floor_m2: 0.2034, lobes: 8, amplitude_m2: 0.5319001089962548}}
geometry: {type: path, file: route.csv}
uncertainty:
  aircraft: {position_m: 3.554989373360175, attitude_deg: 1.992765}
  radar: {low: {position_m: 48.85541, constant: 9.18474174065536175}}
"""

ORBIT = """\
radar: {{position_m: [{position}], p_fa: 1e-8, {constant}}}
aircraft: {{rcs: {rcs}, attitude_deg: [0.3, 3e-11, 32.4]}}
geometry:
  {{type: orbit, range_km: 10, down_km: {down}, azimuth_deg: {{start: 0, stop: 180, step: 90}}}}
uncertainty:
  aircraft: {{position_m: 100, attitude_deg: 30}}
  radar: {{low: {{position_m: 200, constant: {std}}}}}
"""
#: The variance of z was so small that its power 3/2 was 0: a RuntimeWarning.
TINY_VARIANCE = ORBIT.format(
    position="1700, 16000, 2400",
    constant="constant: 52.5",
    rcs="{model: ellipsoid_exact, x_m: 9.56e-15, y_m: 7.049e+18, z_m: 1.4e-16}",
    down="-6.6e17",
    std="0.0777",
)
#: A tolerance of 1e10 times the parameter: the moments of a log-normal c_r overflowed.
HUGE_TOLERANCE = ORBIT.format(
    position="0, 0, 0",
    constant="surveillance: {average_power_w: 4e-14, aperture_m2: 983, temperature_k: 5.8e-20, "
    "scan_time_s: 10, search_volume_sr: 12, loss_db: 51, noise_figure_db: 48}",
    rcs="{model: constant, rcs_m2: 5e7}",
    down="-3",
    std="{average_power_w: 1.4e-4, loss_db: 0.1}",
)
#: Both ends of a short step along a ray had one slant range: 0 / 0.
FAR_BELOW = ORBIT.format(
    position="0, 0, -1.2e14",
    constant="surveillance: {average_power_w: 25e3, aperture_m2: 22, temperature_k: 1.35e-7, "
    "scan_time_s: 9, search_volume_sr: 1.6, loss_db: 0, noise_figure_db: 200}",
    rcs="{model: ellipsoid_exact, x_m: 1.655e+07, y_m: 7e+16, z_m: 58804}",
    down="-1.78",
    std="1e-3",
)

#: `form` had no value for the position of r1, but a value for r1 as a whole: NaN without a word.
NAN_OF_A_POSITION = """\
radars:
  - {name: r0, position_m: [55195, 4, 108], p_fa: 4e-8, horizon: false, constant: 136,
     uncertainty: {low: {position_m: 100, constant: 0.165}}}
  - {name: r1, position_m: [33.8, 24.7, 2.2], p_fa: 6.1e-6, detector: swerling4, constant: 1.97,
     uncertainty: {low: {position_m: 284.68, constant: 0.693}}}
aircraft:
  rcs: {model: spikeball, amplitude_m2: 0.332, lobes: 7, floor_m2: 0.764}
  attitude_deg: [0.412429, 31.4, 0.3341899]
geometry: {type: orbit, range_km: 12.9899, down_km: -14.03,
  azimuth_deg: {start: -75.03, stop: -254.399, step: -179.3671}}
uncertainty: {aircraft: {position_m: [302, 0.183, 349], attitude_deg: 0.043}}
"""

#: No bearing has an upper bound, and the figure had a radius of NaN.
NO_UPPER_BOUND = """\
radar: {position_m: [7000, 51000, 155000], constant: 158, p_fa: 2.5e-5}
aircraft:
  attitude_deg: [34.1, 50.1, 45.1]
  rcs: {model: ellipsoid, a_m: 0.63, b_m: 0.272, c_m: 1.49}
geometry: {type: orbit, range_km: 182, down_km: -5.12,
  azimuth_deg: {start: -16.4, stop: 359, step: 53.6}}
uncertainty:
  aircraft: {position_m: 79000, attitude_deg: 71.1}
  radar: {low: {position_m: 500, constant: 0.1}}
"""

#: The aircraft may be at the radar, and the margin had no upper end but "inf".
AT_THE_RADAR = """\
radar: {position_m: [1.03e5, 1.53e5, 2.28e5], constant: 167, p_fa: 1.7e-4}
aircraft:
  attitude_deg: [124, 145, 66]
  rcs: {model: ellipsoid_exact, x_m: 0.3, y_m: 0.25, z_m: 0.07}
geometry:
  {type: radial, range_km: {start: 1.57, stop: 198, step: 28}, azimuth_deg: 0, down_km: -5.11}
uncertainty:
  aircraft: {position_m: 52000, attitude_deg: [8, 12, 17]}
  radar: {low: {position_m: 2000, constant: 2243}}
"""

#: With lobes this narrow, P(P_D < 0.5) is above 0.00135 at every range: there is no lower bound.
NO_LOWER_BOUND = """\
radar: {position_m: [0, 0, -20], constant: 20, p_fa: 1.0e-6}
aircraft:
  attitude_deg: [0, 0, 90]
  rcs: {model: spikeball, lobes: 60, amplitude_m2: 1, floor_m2: 0.01}
geometry:
  {type: orbit, range_km: 100, down_km: -3, azimuth_deg: {start: 0, stop: 10, step: 5}}
uncertainty:
  aircraft: {position_m: 20, attitude_deg: 1}
  radar: {low: {position_m: 50, constant: 8}}
"""

FOUND = {
    "at the radar": (AT_THE_RADAR, "detectors --method probit --p-d 0.67 --no-plot"),
    "no answer between": (
        NO_ANSWER_BETWEEN,
        "budget --threshold 0.999999 --at 0.4434383581784298 --no-plot",
    ),
    "tiny variance": (TINY_VARIANCE, "sensitivity --no-plot"),
    "huge tolerance": (HUGE_TOLERANCE, "sensitivity --method form --no-plot"),
    "far below": (FAR_BELOW, "range --step-deg 30 --no-plot"),
    "no upper bound": (NO_UPPER_BOUND, "range --step-deg 81 --format svg"),
    "no lower bound": (NO_LOWER_BOUND, "range --step-deg 90 --no-plot"),
    "NaN of a position": (NAN_OF_A_POSITION, "budget --method form --no-plot"),
}


def end_of(text, *args):
    """Return the exit code of a command with the scenario of a text, whose level is low."""
    text = f"name: found\nanalysis: {{level: low}}\n{text}"
    files = {CONFIG: text.encode(), "route.csv": ROUTE.encode()}
    return check(Case(files, (*args, "--out", "out", CONFIG))).code


@pytest.mark.parametrize("option", ["--runs", "--format", "--level", "--seed", "--nonsense"])
def test_errors_quote_a_part_of_a_long_value(option):
    assert end_of(HUGE_TOLERANCE, "montecarlo", option, "9" * 5000) == 2


@pytest.mark.parametrize("name", FOUND)
def test_found(name, monkeypatch):
    monkeypatch.setattr(form, "ITERATIONS", 8)  # a search that fails takes all of them
    text, line = FOUND[name]
    assert end_of(text, *line.split()) == 0
