"""The page of a report: a question, and what the command of the question prints, draws and writes.

Everything is in one file, which uses no script and nothing from outside. Text that is not of the
page itself passes through `escaped`.
"""

from __future__ import annotations

import base64
import html
import itertools
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from string import Template

import numpy as np

from radar_sense import files
from radar_sense.command import OF_RADAR, Result
from radar_sense.errors import printable
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Most columns of a result on the page.
MOST_COLUMNS = 30
#: Most places of a least or largest value. More places are a tie of many equals.
MOST_PLACES = 2


@dataclass(frozen=True, eq=False)
class Section:
    """A question and its answer.

    Attributes:
        key: Name of the command that answers, and id on the page.
        question: Heading.
        lines: Lines of the answer.
        warnings: Warnings about the answer that no earlier section has.
        result: Result with the figure and the table; None without them.
    """

    key: str
    question: str
    lines: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    result: Result | None = None

    @property
    def answer(self) -> str:
        """The lines up to the first that is no heading; a heading ends with a colon."""
        rows = list(itertools.takewhile(lambda line: line.endswith(":"), self.lines))
        return " ".join(line.strip() for line in self.lines[: len(rows) + 1])


def page(scenario: Scenario, sections: Sequence[Section], command: Sequence[str]) -> str:
    """Return the page, with the command line, which is empty if there was none.

    Raises:
        FigureError: If a figure cannot be drawn.
    """
    template = resources.files("radar_sense").joinpath("page.html").read_text("utf-8")
    made = Section(
        "again",
        "How can this report be made again?",
        (
            *([shlex.join(command)] if command else []),
            ", ".join(f"{name} {version}" for name, version in files.versions().items()),
            *files.yaml_text(scenario.resolved()).splitlines(),
        ),
    )
    return Template(template).substitute(
        title=escaped(f"{scenario.name}: how sure is the probability of detection?"),
        summary=escaped(
            f"Level of radar uncertainty {scenario.level}, method {scenario.method}, "
            f"seed {scenario.seed}."
        ),
        contents="\n".join(map(_entry, sections)),
        sections="\n".join(map(_section, [*sections, made])),
    )


def escaped(text: str) -> str:
    """Return text as HTML, with control characters and marks of direction as Python writes them."""
    return html.escape(printable(text))


def _entry(section: Section) -> str:
    count = len(section.warnings)
    warnings = f' <span class="count">Warnings: {count}</span>' if count else ""
    question, answer = escaped(section.question), escaped(section.answer)
    return f'<li><a href="#{section.key}">{question}</a><br>{answer}{warnings}</li>'


def _section(section: Section) -> str:
    lines = "".join(map(_line, section.lines))
    parts = [f"<h2>{escaped(section.question)}</h2>"]
    if section.result:
        by = f"{section.result.analysis}: {section.result.small_print}"
        parts.append(f'<p class="by">{escaped(by)}</p>')
    parts.append(f"<pre>{lines}</pre>")
    if section.warnings:
        items = "".join(f"<li>{escaped(warning)}</li>" for warning in section.warnings)
        parts.append(f'<ul class="warnings" aria-label="Warnings">{items}</ul>')
    if section.result:
        parts += [_figure(section.result, section.lines[0]), _table(section.result)]
    return f'<section id="{section.key}">{"".join(parts)}</section>'


def _line(line: str) -> str:
    """Return a line: an indented one is a row of a table, and is not broken on a screen."""
    kind = "" if line.startswith(" ") else ' class="words"'
    return f"<span{kind}>{escaped(line)}</span>"


def _figure(result: Result, words: str) -> str:
    drawn = base64.b64encode(result.figures(["svg"])["svg"]).decode()
    seen = escaped(f"Figure of {result.analysis}: {words}")
    return f'<img alt="{seen}" src="data:image/svg+xml;base64,{drawn}">'


def _table(result: Result) -> str:
    """Return the least and the largest value of each column, and where they are."""
    columns = result.columns  # those of one radar alone are the last
    ordered = sorted(columns, key=lambda name: columns[name].meaning.startswith(OF_RADAR))
    shown = ordered[:MOST_COLUMNS]
    caption = f"Least and largest values of the table that radar-sense {result.analysis} writes"
    if others := len(result.table) - len(shown):
        caption += f"; it has {others} columns more"
    head = "".join(f'<th scope="col">{name}</th>' for name in ("Column", "Least", "Largest"))
    body = "".join(f"<tr>{''.join(_cells(result, name))}</tr>" for name in shown)
    return (
        f"<table><caption>{escaped(caption)}.</caption>"
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def _cells(result: Result, name: str) -> Iterable[str]:
    unit, meaning = result.columns[name]
    yield f'<th scope="row"><code>{escaped(name)}</code><br>{escaped(meaning)}</th>'
    first, values = next(iter(result.table)), np.asarray(result.table[name], dtype=float)
    known = values[np.isfinite(values)]
    gaps = f"; {values.size - known.size} without a value" if 0 < known.size < values.size else ""
    is_map = any(column.ndim > 1 for column in result.table.values())  # and has two axes
    for extreme in (known.min(), known.max()) if known.size else (np.nan, np.nan):
        words = f"{extreme:.10g}" if name == first else number(extreme)
        words = f"{words} {unit if known.size else ''}".strip()
        if name != first and values.shape == result.table[first].shape and not is_map:
            words += _places(result, first, np.isclose(values, extreme, rtol=1e-9, atol=1e-9))
        yield f"<td>{escaped(words + gaps)}</td>"


def _places(result: Result, axis: str, mask: FloatArray) -> str:
    """Return where a value is reached; "" at many places."""
    places = result.table[axis][mask]
    if not 1 <= len(places) <= MOST_PLACES:
        return ""
    unit = result.columns[axis].unit
    return f" at {' and '.join(f'{place:.10g}' for place in places)} {unit}".rstrip()


def number(value: float) -> str:
    """Return a number in four digits; 0 below 1e-6, which is rounding, and large ones in full."""
    if np.isnan(value):
        return "no value"
    if abs(value) < 1e-6:
        return "0"
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.4g}"
