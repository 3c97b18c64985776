"""How sure can you be of a radar's probability of detection?

The public names are in `__init__.pyi`, for type checkers and for Python. A module is imported at
the first use of a name. The command line can therefore answer `--help` without NumPy and SciPy.
"""

# No import here takes time: Ctrl-C would print a traceback until the entry point handles it.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.2.0"


def _homes() -> dict[str, str]:
    """Return the module of each public name."""
    import re
    from importlib import resources  # both take time that an interrupt may fall into

    stub = resources.files("radar_sense").joinpath("__init__.pyi").read_text(encoding="utf-8")
    return {name: home for home, name in re.findall(r"^from (\S+) import (\w+)", stub, re.M)}


def __getattr__(name: str) -> "Any":
    from importlib import import_module

    homes = {} if name.startswith("__") else _homes()
    if name == "__all__":
        return sorted(["__version__", *_homes()])
    if name not in homes:
        raise AttributeError(f"module 'radar_sense' has no attribute {name!r}")
    if homes[name] == __name__:
        value: Any = import_module(f"{__name__}.{name}")
    else:
        value = getattr(import_module(homes[name]), name)
    globals()[name] = value  # the next use needs no call of this function
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_homes()})
