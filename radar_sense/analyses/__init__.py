"""The commands, one file each and found by its name: a scenario in, a Result out."""

from __future__ import annotations

import pkgutil
from importlib import import_module

from radar_sense.command import Command
from radar_sense.plausibility import plausibility_warnings

Command.check = staticmethod(plausibility_warnings)

for _info in pkgutil.iter_modules(__path__):
    _module = import_module(f"{__name__}.{_info.name}")
    for _name, _value in list(vars(_module).items()):
        if isinstance(_value, Command) and _value.name == _info.name:
            globals().update({_name: _value, _value.name: _value})
