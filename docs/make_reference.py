"""Make the reference pages from what the program declares.

    python docs/make_reference.py

writes docs/reference/*.md. `make reference` does the same.
A test compares the files with what this makes.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import click
import yaml

import radar_sense
from radar_sense import cli
from radar_sense.command import Command
from radar_sense.limits import METHODS
from radar_sense.scenario_file import declare
from radar_sense.scenario_file.declare import Key, keys_of
from radar_sense.scenario_file.sections import File, Tolerances
from radar_sense.sources import PART, SOURCE, sources_of

ROOT = Path(__file__).parents[1]
MADE = (
    "<!-- Made by docs/make_reference.py: change the declarations, then `make reference`. -->\n\n"
)
#: Examples of keys that no file in configs/ or radar_sense/templates/ uses.
EXAMPLES = {
    "elevation_gain": "gain.csv",
    "mask": "mask.csv",
    "tilt_deg": 1.5,
    "radar.mask.file": "mask.csv",
    "min_range_km": 3,
    "m": 3,
    "n": 5,
    "radar.type": "gap_filler",
    "band": "s",
    "eclipsing": "true",
    "losses_db": {"beam_shape": 1.6},
    "coherent_pulses": 8,
    "cfar": {"type": "cell_averaging", "cells": 24},
    "binary": {"m": 3, "n": 5},
    "rank": 18,
    "cells": 24,
    "pulses": 10,
    "peak_power_w": 2000,
    "wavelength_m": 0.0333,
    "bandwidth_mhz": 0.05,
    "envelope_deg": 3,
    "altitude_above": "sea",
    "down_km": -0.5,
    "altitude_m": 300,
    "half_width": 1,
    "geoid_height_m": 47.5,
    "speed_m_s": 200,
    "icao24": "4b1812",
    "sha256": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
}


def pages() -> dict[Path, str]:
    """Return the text of each file that is made."""
    folder = ROOT / "docs/reference"
    return {
        folder / "scenario.md": scenario_page(),
        folder / "commands.md": commands_page(),
        folder / "python.md": python_page(),
    }


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    cells = (" | ".join(cell.replace("|", "\\|") for cell in line) for line in lines)
    return "".join(f"| {line} |\n" for line in cells)


def anchor(title: str) -> str:
    """Return the anchor that a forge and the site give to a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


# The scenario file.


def scenario_page() -> str:
    """Return the reference of the scenario file."""
    text = (
        "# The scenario file\n\n"
        + MADE
        + "A scenario is a YAML file. These are all keys, by section. The name of a key ends with "
        "the unit of the number. An unknown key is an error, with a suggestion. `radar-sense "
        "schema` prints the same as a JSON Schema. [An editor]"
        "(../questions/use.md#an-editor-that-knows-the-scenario-file) completes the keys with it."
        "\n\n"
        "Examples are from the files that come with the program, where a file has the key.\n"
    )
    for cls, name in TITLES.items():
        keys = keys_of(cls)
        text += f"\n## {title(name)}\n\n{inspect.getdoc(cls).partition(chr(10))[0]}\n"
        if keys:
            head = ["key", "meaning", "unit", "allowed", "default or need", "example"]
            text += "\n" + table(head, [_key_row(name, keys, key) for key in keys])
        if any("covariance" in key.unless for key in keys):
            text += (
                "\nA part with three components may be one standard deviation for all, a list of "
                "three, or a 3 × 3 covariance as three rows.\n"
            )
    return text


def _titles() -> dict[type, str]:
    """Return the title of each section, which is described where it stands first.

    The keys of `Tolerances` are those of the data sheets.
    """
    titles: dict[type, str] = {}
    for name, cls in declare.sections(File):
        if cls is not Tolerances:
            titles.setdefault(cls, name)
    return titles


TITLES = _titles()


def title(section: str) -> str:
    """Return the heading of a section."""
    return f"`{section}`" if section else "The file"


def _key_row(name: str, keys: Sequence[Key], key: Key) -> list[str]:
    allowed = key.kind.allowed
    if allowed.startswith("one of "):
        words = allowed.removeprefix("one of ").split(", ")
        allowed = ", ".join(f"`{word}`" for word in words)
    headings = [title(TITLES[cls]) for cls in key.kind.sections().values() if cls in TITLES]
    links = " or ".join(f"[{heading}](#{anchor(heading)})" for heading in headings)
    example = f"`{_yaml(example_of(name, keys, key))}`"
    if key.name == "covariance":
        example = "[covariance.yaml](../../configs/covariance.yaml)"
    elif links and not allowed:
        example = ""
    return [
        f"`{key.name}`",
        key.meaning,
        key.unit,
        "; ".join(filter(None, [f"{allowed[:1].upper()}{allowed[1:]}", links and f"see {links}"])),
        _needed(keys, key),
        example,
    ]


def _needed(keys: Sequence[Key], key: Key) -> str:
    """Return whether a key is required, its default, or its alternatives."""

    def listed(names: Sequence[str]) -> str:
        return ", ".join(f"`{other}`" for other in names)

    group = [other.name for other in keys if key.one_of and other.one_of == key.one_of]
    if len(group) > 1:
        return f"one of {listed(group)}"
    if key.unless:
        return f"required without {listed(key.unless)}"
    if key.instead_of:
        return f"in place of {listed(key.instead_of)}"
    if group or key.default is declare.REQUIRED:
        return "required"
    return f"`{key.shown_default}`" if key.shown_default else "none"


@functools.cache
def _mappings() -> list[Mapping[str, Any]]:
    """Return every mapping in the scenario files that come with the program."""
    files = [*sorted(ROOT.glob("configs/*.yaml")), *sorted(ROOT.glob("radar_sense/**/*.yaml"))]
    found = []
    for file in [ROOT / "configs/paper.yaml", *files]:
        # strings, as written: `1e-6` is a number to the reader
        waiting = [yaml.load(file.read_text(encoding="utf-8"), yaml.BaseLoader)]
        while waiting:
            value = waiting.pop(0)
            if isinstance(value, dict):
                found.append(value)
                waiting += value.values()
            elif isinstance(value, list):
                waiting += value
    return found


def example_of(name: str, section: Sequence[Key], key: Key) -> Any:
    """Return an example of a key: from a file, from `EXAMPLES`, or its default."""
    word = re.search(r"\((model|type): (\w+)\)$", name)
    names = {*(k.name for k in section), *(word.groups()[:1] if word else ())}
    for mapping in _mappings():
        is_one = not word or mapping.get(word[1]) == word[2]
        if key.name in mapping and names >= mapping.keys() and is_one:
            return mapping[key.name]
    example = EXAMPLES.get(f"{name}.{key.name}", EXAMPLES.get(key.name, key.shown_default))
    if not example:
        raise KeyError(
            f"{name}.{key.name} has no example: use it in a file in configs/ or add it to EXAMPLES"
        )
    return example


def _yaml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: {_yaml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    return f"{value}"


# Commands and their columns.


#: Scenarios and options whose tables have all columns of a command; others run as they are.
RUNS: Mapping[str, Sequence[tuple[str, Mapping[str, Any]]]] = {
    "variance": [
        ("paper", {"method": "probit"}),
        ("path", {}),
        ("corridor", {"threshold": 0.9}),
        ("network", {"at_least": 0.1}),
        ("network", {"method": "montecarlo", "runs": 8}),
    ],
    "budget": [
        ("paper", {"method": "montecarlo", "runs": 8}),
        ("network", {"method": "linear"}),
        ("airport_surveillance", {"method": "linear"}),
    ],
    "sensitivity": [("paper", {"method": "probit"})],
    "compare": [("paper", {})],
    "montecarlo": [("paper", {"runs": 8, "method": "probit"})],
    "validate": [("paper", {"digits": 1, "method": "probit"})],
    "convergence": [("paper", {"runs": 8})],
    "mission": [("mission", {"runs": 8, "m": 2, "n": 3})],
    "map": [
        ("corridor", {"step_km": 100, "upper": True, "method": "probit"}),
        ("path", {"step_km": 400, "worst_heading": True}),
    ],
    "range": [("paper", {"step_deg": 90}), ("paper", {"step_deg": 90, "by": "aspect"})],
    "rcs": [("table", {})],
    "detectors": [("paper", {}), ("airport_surveillance", {"p_d": 0.9, "method": "linear"})],
    "sweep": [
        (
            "paper",
            {"key": "radar.constant", "start": 100, "stop": 100, "step": 1, limit: 0.5},
        )
        for limit in ("threshold", "at_least")
    ],
}
#: Poses of a run; two looks of a mission need more.
POSES = 40


def _with_placeholders(scenario: Any, column: str, meaning: str) -> tuple[str, str]:
    """Return name and meaning of a column with `<radar>` in place of the name of a radar, etc."""
    names = {
        # coverage_low is the lower end of an interval
        "level": () if column.startswith("coverage_") else scenario.levels,
        "radar": scenario.model.names if len(scenario.model.names) > 1 else (),
        "source": [*sources_of(scenario, PART), *sources_of(scenario, SOURCE)],
        "method": METHODS,
        "p_d": ("0.5",),
    }
    for placeholder, known in names.items():
        for word in known:
            changed = re.sub(rf"_{re.escape(word)}(?=_|$)", f"_<{placeholder}>", column)
            if changed != column:
                column = changed
                whole = rf"(?<![a-zA-Z0-9]){re.escape(word)}(?![a-zA-Z0-9])"
                meaning = re.sub(whole, f"*{placeholder}*", meaning)
    return re.sub(r"\bterm_\w+|(?<=sigma_)term_\w+", "term_<term>", column), meaning


def commands_page() -> str:
    """Return the reference of the commands and their options."""
    text = (
        "# The commands\n\n"
        + MADE
        + "`radar-sense COMMAND --help` prints the same. CONFIG is a scenario file. Without CONFIG "
        "the scenario of the paper is used.\n\n"
        "Each analysis writes `<scenario>_<command>.csv` (`map`: `.npz`; `report`: `.html` alone; "
        "`check`: nothing). With `--radar` the name of the radar stands between the two. The "
        "first row has the names of the columns; all other rows are numbers. The columns depend "
        "on the scenario and the options: the poses are in `theta_r_deg` on an orbit, `range_km` "
        "on a radial, `time_s` or `distance_m` on a path, and `pose` for states of Python; in a "
        "network, most columns are there for each radar too, with its name at the end. A word in "
        "angle brackets stands for a name of the scenario. The JSON record beside the table has "
        "unit and meaning of each column, and the SHA-256 digest of each file: a table or a "
        "figure with another digest is of another run.\n"
    )
    context = click.Context(cli.cli, info_name="radar-sense")
    for name in cli.cli.list_commands(context):
        command = cli.cli.get_command(context, name)
        assert command is not None
        about, _, examples = inspect.cleandoc(command.help or "").partition("\b\nExamples:")
        arguments = [p for p in command.params if isinstance(p, click.Argument)]
        places = (p.metavar or f"[{str(p.name).upper()}]" for p in arguments)
        usage = " ".join([name, "[OPTIONS]", *places])
        text += f"\n## `{name}`\n\n{about.strip()}\n\n```text\nradar-sense {usage}\n```\n\n"
        options = [p for p in command.params if isinstance(p, click.Option)]
        if options:
            text += table(
                ["option", "meaning", "allowed", "default"], list(map(_option_row, options))
            )
        lines = [line.strip() for line in examples.strip().splitlines()]
        text += "\n```console\n" + "".join(f"$ {line}\n" for line in lines) + "```\n"
        text += _columns(name)
    return text + warnings_section()


def _columns(command: str) -> str:
    """Return the columns that a command writes, from tables that are really made; "" for none."""
    if command not in set(cli.commands()) - {"report", "check"}:
        return ""
    rows: dict[str, list[str]] = {}
    for config, options in RUNS.get(command, [("paper", {})]):
        scenario = radar_sense.load_scenario(ROOT / f"configs/{config}.yaml")
        if command != "sweep":  # which reads the file again
            scenario = scenario.at_poses(slice(0, POSES if command == "mission" else 3))
        result = cli.load(command)(scenario, **options)
        for column, (unit, meaning) in result.columns.items():
            column, meaning = _with_placeholders(scenario, column, meaning)
            rows.setdefault(column, [f"`{column}`", unit, meaning])
    return "\n" + table(["column", "unit", "meaning"], list(rows.values()))


def _option_row(option: click.Option) -> list[str]:
    metavar = "" if option.is_flag else f" {option.metavar or 'WORD'}"
    about, _, default = (option.help or "").partition("  [default: ")
    if isinstance(option.type, click.Choice):
        metavar = " " + "|".join(map(str, option.type.choices))
    default = default.rstrip("]")
    if option.show_default:
        value = option.default
        default = " ".join(map(str, value)) if isinstance(value, (list, tuple)) else f"{value}"
    allowed = str(option.type.limit) if isinstance(option.type, cli.Number) else ""
    return [
        f"`{', '.join(option.opts)}{metavar}`",
        about,
        f"{allowed[:1].upper()}{allowed[1:]}",
        default,
    ]


def warnings_section() -> str:
    """Return the explanation of each warning under its name."""
    text = (
        "\n## Warnings\n\nA warning is one sentence that ends with its name in brackets. A name "
        "stays; the sentence may change. The record beside a table has the same warnings.\n"
    )
    warnings = yaml.safe_load((ROOT / "docs/warnings.yaml").read_text())
    for name, meaning in warnings.items():
        text += f"\n### `{name}`\n\n{meaning}\n"
    return text


# Python.


def python_page() -> str:
    """Return the reference of the public names, from their docstrings."""
    text = (
        "# From Python\n\n"
        + MADE
        + "`import radar_sense as rs`, then `rs.load_scenario` and so on. Angles are in radians, "
        "all quantities in SI units, unless a name ends with another unit. Every analysis of the "
        "command line is a function in `rs.analyses`.\n"
    )
    names = [name for name in radar_sense.__all__ if not name.startswith("__")]
    groups = {"Functions": [], "Analyses": [], "Classes": []}
    for name in names:
        value = getattr(radar_sense, name)
        if not inspect.ismodule(value):
            groups["Classes" if inspect.isclass(value) else "Functions"].append((name, value))
    groups["Analyses"] = [(f"analyses.{name}", value) for name, value in _analyses().items()]
    for group, members in groups.items():
        text += f"\n## {group}\n"
        for name, value in members:
            text += f"\n### `{name}`\n\n{_documented(name, value)}"
    return text


def _analyses() -> dict[str, Command]:
    """Return the analyses by their names in Python."""
    return {
        name: value
        for name, value in sorted(vars(radar_sense.analyses).items())
        if isinstance(value, Command) and value.__name__ == name
    }


def _documented(name: str, value: Any) -> str:
    text = f"```python\n{_signature(name, value)}\n```\n\n{_markdown(inspect.getdoc(value))}"
    given = dataclasses.fields(value) if dataclasses.is_dataclass(value) else ()
    meanings = {f.name: f.metadata["meaning"] for f in given if "meaning" in f.metadata}
    parameters = [f"- `{name}`: {meaning}\n" for name, meaning in meanings.items()]
    text += ("\n*Parameters*\n\n" if parameters else "") + "".join(parameters)
    lines = [
        f"- `{_signature(member, attribute, width=1000)}`: {summary}\n"
        for member, attribute, summary in (_members(value) if inspect.isclass(value) else ())
    ]
    return text + ("\n*Methods and properties*\n\n" if lines else "") + "".join(lines)


def _members(cls: type) -> Iterator[tuple[str, Any, str]]:
    """Yield the public methods and properties of a class, with the first line of their text."""
    for name, attribute in vars(cls).items():
        if name.startswith("_"):
            continue
        if isinstance(attribute, (classmethod, staticmethod)):
            attribute = attribute.__func__
        is_property = isinstance(attribute, property) or hasattr(attribute, "func")
        if not (is_property or inspect.isfunction(attribute)):
            continue
        doc = inspect.getdoc(attribute)
        if doc:
            yield name, attribute, doc.partition("\n\n")[0].replace("\n", " ")


def _signature(name: str, value: Any, width: int = 96) -> str:
    """Return a call with types and defaults, in lines of a width; else the name."""
    is_class = inspect.isclass(value)
    if not callable(value) or (is_class and issubclass(value, (Exception, Protocol))):
        return name
    parts, keyword_only = [], False
    for p in inspect.signature(value).parameters.values():
        if p.name in ("self", "cls"):
            continue
        if p.kind is p.KEYWORD_ONLY and not keyword_only:
            parts.append("*")
            keyword_only = True
        kind = "" if p.annotation is p.empty else f": {_plain(p.annotation)}"
        parts.append(f"{p.name}{kind}{_default(p)}")
    short = f"{name}({', '.join(parts)})"
    if len(short) <= width:
        return short
    return f"{name}(\n" + "".join(f"    {part},\n" for part in parts) + ")"


def _plain(annotation: Any) -> str:
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
    return text.strip("'\"")


def _default(p: inspect.Parameter) -> str:
    if p.default is p.empty:
        return ""
    value = repr(p.default)
    return f" = {'...' if value.startswith('<') or len(value) > 40 else value}"


def _markdown(doc: str | None) -> str:
    """Return a docstring of Google style as Markdown."""
    text, listed = "", False
    for line in (doc or "").splitlines():
        heading = re.fullmatch(r"(Args|Attributes|Returns|Raises|Yields):", line)
        entry = re.match(r"    (\*{0,2}\w+): (.*)", line)
        if heading:
            listed = heading[1] != "Returns"
            text = text.rstrip("\n") + f"\n\n*{heading[1].replace('Args', 'Arguments')}*\n\n"
        elif entry and listed:
            text += f"- `{entry[1]}`: {entry[2]}\n"
        elif listed and line.startswith("        "):
            text = text.rstrip("\n") + f" {line.strip()}\n"
        elif line.startswith("    ") and not listed and "*Returns*" not in text:
            text += f"{line}\n"  # an indented block: an equation or an example
        else:
            text += f"{line.strip()}\n"
            listed = listed and not line.strip()
    return text.rstrip("\n") + "\n"


if __name__ == "__main__":
    for path, content in pages().items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
        print(path.relative_to(ROOT))
