"""HTML from strings. Text is escaped, HTML is left unchanged."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence

#: Printed form of symbols.
_TERMS = (
    (re.compile(r"\bP_(D|FA)\b"), r"<i>P</i><sub>\1</sub>"),
    (re.compile(r"\bc_r\b"), "<i>c</i><sub>r</sub>"),
    (re.compile(r"(\d)[ -]sigma\b"), r"\1σ"),
)
_NUMBER = re.compile(r"[-+−]?[\d.,]*\d(e[-+]?\d+)?( ?%)?$")


class Html(str):
    """Text that is HTML. A plain `str` is text to escape."""

    __slots__ = ()


def escaped(text: str) -> Html:
    """Return text as HTML with the same letters; HTML is returned unchanged."""
    return text if isinstance(text, Html) else Html(html.escape(text))


def prose(text: str) -> Html:
    """Return a sentence as HTML, with the printed form of its symbols."""
    if isinstance(text, Html):
        return text
    words = html.escape(text)
    for pattern, printed in _TERMS:
        words = pattern.sub(printed, words)
    return Html(words)


def element(tag: str, *content: str, **attributes: str) -> Html:
    """Return an HTML element. Text in the content is escaped.

    Args:
        tag: Name of the element.
        content: Text or HTML inside.
        attributes: Attributes; `class_` is class, `aria_label` is aria-label.
    """
    pairs = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
        for name, value in attributes.items()
    )
    return Html(f"<{tag}{pairs}>{''.join(map(prose, content))}</{tag}>")


def joined(*parts: str) -> Html:
    """Return text and HTML one after the other."""
    return Html("\n".join(map(prose, parts)))


def code(text: str) -> Html:
    """Return a word of the program: a name, a key, a command."""
    return element("code", escaped(text))


def items(lines: Iterable[str]) -> Html:
    """Return a list."""
    return element("ul", *(element("li", line) for line in lines))


def scrolling(content: Html, label: str) -> Html:
    """Return a region that scrolls sideways, also by the keyboard."""
    return element("div", content, class_="scroll", role="region", tabindex="0", aria_label=label)


def table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> Html:
    """Return a table whose first column names the rows.

    Args:
        caption: What the table shows.
        head: Headings of the columns; empty for a table of names and values.
        rows: Cells of each row. A column of numbers is aligned to the right.
    """
    numbers = [bool(head) and all(map(_is_number, column)) for column in zip(*rows, strict=True)]
    top = [_cell("th", *cell, scope="col") for cell in zip(head, numbers, strict=False)]
    body = [
        element(
            "tr",
            element("th", row[0], scope="row"),
            *(_cell("td", *cell) for cell in zip(row[1:], numbers[1:], strict=True)),
        )
        for row in rows
    ]
    return scrolling(
        element(
            "table",
            element("caption", caption),
            *([element("thead", element("tr", *top))] if head else []),
            element("tbody", *body),
        ),
        caption,
    )


def _is_number(text: str) -> bool:
    return not text or text == "undefined" or bool(_NUMBER.match(text))


def _cell(tag: str, text: str, number: bool, **attributes: str) -> Html:
    return element(tag, text, **attributes, **({"class_": "number"} if number else {}))
