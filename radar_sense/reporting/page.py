"""The page of a report: the sections in order, the style, and how to make the report again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from importlib import resources

from radar_sense.reporting.figure import Drawing
from radar_sense.reporting.html_elements import (
    Html,
    code,
    element,
    escaped,
    items,
    joined,
    scrolling,
    table,
)
from radar_sense.reporting.sections import Section
from radar_sense.scenario import Scenario

#: The page may use nothing outside its file: no script, no font, no request.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_AGAIN = "How can this report be made again?"


def page(
    scenario: Scenario,
    sections: Sequence[Section],
    *,
    command: Sequence[str],
    versions: Mapping[str, str],
    document: str,
) -> str:
    """Return the page.

    Args:
        scenario: The scenario.
        sections: The sections.
        command: The command line; empty if there was none.
        versions: Versions of the packages by name.
        document: The resolved scenario as YAML.
    """
    title = f"{scenario.name}: how sure is the probability of detection?"
    style = resources.files("radar_sense.reporting").joinpath("report.css").read_text("utf-8")
    head = element(
        "head",
        Html('<meta charset="utf-8">'),
        Html('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        Html(f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'),
        Html('<meta name="color-scheme" content="light dark">'),
        element("title", escaped(title)),
        element("style", Html(style)),
    )
    body = element(
        "body",
        element("a", "Skip to the answers", href="#answers", class_="skip"),
        element(
            "header",
            element("p", "Report of radar-sense", class_="kind"),
            element("h1", escaped(title)),
            element(
                "p",
                f"Scenario {scenario.name}, level of radar uncertainty {scenario.level}, seed "
                f"{scenario.seed}, radar-sense {versions['radar-sense']}.",
            ),
        ),
        element("nav", element("h2", "In short"), _contents(sections), aria_label="In short"),
        element(
            "main",
            *_each(sections),
            _made(scenario, command, versions, document),
            id="answers",
            tabindex="-1",
        ),
        element(
            "footer",
            element(
                "p",
                "All numbers hold for the scenario and the models stated here, and for nothing "
                "else.",
            ),
        ),
    )
    return f'<!DOCTYPE html>\n<html lang="en">{head}\n{body}\n</html>\n'


def _contents(sections: Sequence[Section]) -> Html:
    lines = []
    for section in sections:
        count = len(section.warnings)
        words = f"{count} warning{'s' if count > 1 else ''}"
        lines.append(
            element(
                "li",
                element("a", section.question, href=f"#{section.key}"),
                element("p", section.answer),
                *([element("p", words, class_="count")] if count else []),
            )
        )
    lines.append(element("li", element("a", _AGAIN, href="#again")))
    return element("ol", *lines)


def _each(sections: Sequence[Section]) -> list[Html]:
    """Return the sections. A warning of an earlier section is a link, not a repetition."""
    sections_by_warning: dict[str, Section] = {}
    pages = []
    for section in sections:
        heading = f"{section.key}-question"
        pages.append(
            element(
                "section",
                element("h2", section.question, id=heading),
                element("p", section.answer, class_="answer"),
                *_warnings(section, sections_by_warning),
                *(part.draw() if isinstance(part, Drawing) else part for part in section.body),
                *([element("p", f"Analysis: {section.by}.", class_="by")] if section.by else []),
                id=section.key,
                aria_labelledby=heading,
            )
        )
        sections_by_warning = {**dict.fromkeys(section.warnings, section), **sections_by_warning}
    return pages


def _warnings(section: Section, sections_by_warning: Mapping[str, Section]) -> list[Html]:
    if not section.warnings:
        return []
    new: list[str] = [warning for warning in section.warnings if warning not in sections_by_warning]
    earlier = {
        sections_by_warning[w].key: sections_by_warning[w].question
        for w in section.warnings
        if w in sections_by_warning
    }
    new += [
        joined("The same as under ", element("a", question, href=f"#{key}"))
        for key, question in earlier.items()
    ]
    return [element("div", element("h3", "Warnings"), items(new), class_="warnings")]


def _made(
    scenario: Scenario, command: Sequence[str], versions: Mapping[str, str], document: str
) -> Html:
    rows: list[tuple[str, ...]] = [("Seed", str(scenario.seed))]
    if command:
        rows.insert(0, ("Command", code(shlex.join(command))))
    rows.append(("Versions", ", ".join(f"{name} {number}" for name, number in versions.items())))
    yaml = element("pre", element("code", escaped(document)))
    return element(
        "section",
        element("h2", _AGAIN, id="again-question"),
        element(
            "p",
            "Run the command again in the same folder. Or save the scenario below as a file in "
            "that folder: the scenario has the level, the seed and the radars of this report, and "
            "needs the files named in the scenario. The same versions give the same report, byte "
            "for byte.",
            class_="answer",
        ),
        table("How this report was made", (), rows),
        element("h3", "The scenario, with every default filled in"),
        scrolling(yaml, "The scenario as YAML"),
        id="again",
        aria_labelledby="again-question",
    )
