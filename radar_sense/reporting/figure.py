"""A figure as SVG inside an HTML page."""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.etree import ElementTree

from radar_sense.analyses.contract import FigureError, Result
from radar_sense.reporting.html_elements import Html, element

_SVG = "{http://www.w3.org/2000/svg}"
_HREF = "{http://www.w3.org/1999/xlink}href"
#: Pixels of a page for one point of a figure, which gives page and figure letters of one size.
_SCALE = 2
#: References inside the values of attributes and styles.
_REFERENCE = re.compile(r"url\(#([^)]+)\)")


@dataclass(frozen=True, eq=False)
class Drawing:
    """The figure of a result, still to be drawn.

    Attributes:
        key: Start of all ids of the figure, which makes the ids unique on the page.
        result: The result.
        title: Title of the figure.
        seen: Description of the figure, for readers who cannot see the figure.
        caption: Caption below the figure.
    """

    key: str
    result: Result
    title: str
    seen: str
    caption: str

    def draw(self) -> Html:
        """Return the figure as SVG with its caption.

        Raises:
            FigureError: If the figure cannot be drawn.
        """
        try:
            from radar_sense.plotting import render

            drawn = render(self.result.plot(), "svg")
        except Exception as error:
            raise FigureError(
                f"the figure of {self.result.analysis} could not be drawn "
                f"({type(error).__name__}: {error}); nothing is written"
            ) from error
        svg = inline_svg(drawn, self.key, self.title, self.seen)
        card = element("div", svg, class_="card")
        return element("figure", card, element("figcaption", self.caption))


def inline_svg(drawn: bytes, key: str, title: str, seen: str) -> Html:
    """Return an SVG file as an element of a page, with a title, a description and unique ids.

    Args:
        drawn: The file.
        key: Start of all ids.
        title: Title of the image.
        seen: Description of the image.
    """
    root = ElementTree.fromstring(drawn)
    for tag in ("metadata", "defs"):  # a style in the first <defs> would hold for the page
        for node in root.findall(f"{_SVG}{tag}")[:1]:
            root.remove(node)
    for node in root.iter():
        node.tag = node.tag.removeprefix(_SVG)
        for name, value in list(node.attrib.items()):
            del node.attrib[name]
            if name == "id":
                value = f"{key}-{value}"
            elif name == _HREF:  # SVG 2 has href without a namespace
                name, value = "href", re.sub("^#", f"#{key}-", value)
            node.attrib[name] = _REFERENCE.sub(rf"url(#{key}-\1)", value)
    width, height = (float(number) for number in root.attrib["viewBox"].split()[2:])
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.attrib |= {
        "role": "img",
        "style": "stroke-linejoin: round; stroke-linecap: butt",
        "aria-labelledby": f"{key}-title {key}-seen",
        "width": f"{width * _SCALE:.0f}",
        "height": f"{height * _SCALE:.0f}",
    }
    for ending, tag, text in (("seen", "desc", seen), ("title", "title", title)):
        node = ElementTree.Element(tag, {"id": f"{key}-{ending}"})
        node.text = text
        root.insert(0, node)
    return Html(ElementTree.tostring(root, encoding="unicode"))
