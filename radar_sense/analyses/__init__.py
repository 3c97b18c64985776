"""The analyses, one file each and found by its name: a scenario in, a Result and its figure out."""

from __future__ import annotations

import pkgutil
from importlib import import_module

from radar_sense.analyses.contract import Analysis

for _info in pkgutil.iter_modules(__path__):
    _module = import_module(f"{__name__}.{_info.name}")
    for _name, _value in list(vars(_module).items()):
        if isinstance(_value, Analysis) and _value.name == _info.name:
            globals().update({_name: _value, _value.name: _value})
