"""Options that do not fit each other or the scenario are refused in one line, and write nothing.

`analyses/test_options.py` has each option by itself, with values of another type or size.
"""

import shlex
from pathlib import Path

import pytest
from helpers import CONFIGS, one_line

#: What one line refuses, by command. A file is one of `configs`.
REFUSED = {
    # words, and numbers as people write them
    "varience": "varience",
    "variance --method FORM": "method must be one of linear, probit, form",
    "range --by aspects": "did you mean 'aspect'",
    "variance --threshold 0,1": "got '0,1'; write 0.1 for 0,1",
    "variance --threshold 10%": "got '10%'; write 0.1 for 10%",
    "range --down-km=-3km": "got '-3km'; leave out the unit, it is in the name",
    "variance --level low --k 3 --level high": "Error: --level is given twice; give it once\n",
    "montecarlo --level medum": "low, medium, high, got 'medum'; did you mean 'medium'?",
    "montecarlo --runs 2.5": "got '2.5'",
    "montecarlo --seed ²": "got '²'",
    "montecarlo --workers 1000000": "--workers",
    "montecarlo one.yaml two.yaml": "two.yaml",
    "mission --method form": "mission has no option --method",
    "sweep radar.constant 5": "sweep needs [CONFIG] KEY START STOP STEP\n",
    "sweep radar.constant a 5 1": "START': must be a number, got 'a'\n",
    "init --from paperr": "did you mean 'paper'?",
    "mine.yaml": "no command 'mine.yaml'; the command comes first, such as radar-sense check",
    "variance corridor.yaml --set radars.norht.p_fa=1e-6": "mobile; did you mean 'north'?",
    # options that need or exclude each other
    "variance --threshold 0.6 --at-least 0.2": "--threshold and --at-least exclude each other",
    "variance --probability 0.05": "Error: --probability needs --threshold or --at-least\n",
    "variance --threshold 0.6 --probability 0.05 --k 2": "--k and --probability exclude each other",
    "budget --k 2": "--k needs --threshold",
    "budget --target 0.1 --threshold 0.5": "exclude each other; give one",
    "budget --target 0.5 --at-least 0.5": "--target and --at-least exclude each other; give one",
    "variance --at-least 1": "must be a number not less than 0.01 and less than 1, got '1'",
    "budget --method montecarlo --threshold 0.5": "--threshold needs one of the methods",
    "budget --method montecarlo --target 0.05": "--target needs one of the methods",
    "budget --threshold 0.5 --k 11": "not greater than 10",
    "map --k 2": "Error: --k needs --upper or --lower\n",
    "map --method form": "Error: --method needs --upper or --lower\n",
    "map --level low": "Error: --level needs --upper or --lower\n",
    "map --worst-heading --upper": "--worst-heading and --upper exclude each other",
    "map --lower --upper": "--lower and --upper exclude each other",
    "map --worst-heading --course-deg 3": "give one of them",
    "map --upper --method montecarlo": "must be one of linear, probit, form, automatic here",
    "range --by aspect --course-deg 10": "use one of them",
    "range --p-d 0.5 --p-d 0.5": "each once",
    "detectors --pulses 4": "--pulses needs --p-d",
    "detectors --level low": "Error: --level needs --p-d\n",
    "detectors network.yaml --p-d 0.9": "--p-d needs one radar: search, ridge or mobile",
    "mission mission.yaml --m 3": "Error: --m needs --n\n",
    "mission mission.yaml --n 3": "Error: --n needs --m\n",
    "mission mission.yaml --m 3 --n 2": "m not greater than n",
    "mission mission.yaml --track 2 3 --m 2 --n 3": "--track and --m exclude each other; give one",
    "init --route --network": "exclude each other",
    "init --route -": "give a name",
    # what the scenario or the area does not allow
    "range --p-d 1e-5": "P_D without a signal",
    "detectors --p-d 1.7e-4": "--p-d must be above 0.0007715, P_D without a signal; got 0.00017",
    "detectors --set radar.detector=marcum --p-d 1.7e-4": "--p-d must be above 0.00017, P_D wi",
    "detectors surveillance.yaml --p-d 0.9 --pulses 2": "--pulses must be 1 with surveillance, a",
    "map --north-km 5 1": "lesser to a greater",
    "map --east-km 1e9 2e9": "--east-km",
    "map --north-km 10 --step-km 50": "'--north-km': needs 2 numbers; '--step-km' is none\n",
    "budget --at --json": "'--at': needs 1 number; '--json' is none\n",
    "map --step-km 0.001": "allowed are 25,000,000",
    "map --step-km 5000": "longer than a side",
    "map --north-km -1e-9 1e-9 --east-km -1e-9 1e-9": "step must be",
    "sweep radar.p_fa 1e-6 2e-6 1e-6 --set radar.p_fa=1e-5": "--set radar.p_fa: sweep sets thi",
    "variance --set radar.constant": "Error: --set radar.constant: must be KEY=VALUE\n",
    "variance --set radar.constant=x": "Error: radar.constant=x: radar.constant: must be a number",
    "variance --set name=a --set name=b": "Error: --set name=b: is given twice; give it once\n",
    "sweep radar.constnt 100 200 50": "unknown key 'constnt'",
    "sweep radar.constant 0 200 50": "radar.constant=0: radar.constant: must be",
    "sweep radar.constant 100 200 500": "must be a step other than 0 that leads from 100 to 200",
    "sweep radar.constant 100 200 0": "step must be a step other than 0 that leads from 100 to 200",
    "sweep radar.constant 100 200 50 --k -5": "and not greater than 10, got '-5'\n",
    "sweep radar.constant 200 100 25": "from 200 to 100, got 25; did you mean -25?",
    "variance --set radar.gain_dbi=30": "; it is a key of tracking\n",
    "variance --set p_fa=1e-5": "; it is a key of radar, radars\n",
    "variance --set aircraft.p_fa=1e-5": "; it is a key of radar, radars[]\n",
    "variance --set geometry.correlation_s=1": "azimuth_deg, azimuth_from\n",
    "sweep radar.constant 100 200 0.01": "step makes 10,001 values, allowed are 1,000",
    "variance --radar a": "radar 'a' cannot be chosen: this scenario has a single radar, not a net",
    "variance corridor.yaml --radar nort": "got 'nort'; did you mean 'north'?",
}


@pytest.mark.parametrize("line", REFUSED)
def test_refused(tool, line):
    words = [str(CONFIGS / w) if (CONFIGS / w).is_file() else w for w in shlex.split(line)]
    assert REFUSED[line] in one_line(tool, *words)
    assert not list(Path().iterdir())
