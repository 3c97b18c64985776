"""Sphinx builds the site from the Markdown pages: `make docs`."""

from __future__ import annotations

import functools
import json
from typing import Any

import latex2mathml.converter
from docutils.nodes import SkipNode
from pygments.lexers.special import TextLexer

import radar_sense

project = "radar-sense"
author = project_copyright = "The radar-sense developers"
release = radar_sense.__version__
extensions = ["myst_parser"]
source_suffix = {".md": "markdown", ".ipynb": "markdown"}
exclude_patterns = ["_build"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
highlight_language = "text"
html_theme = "furo"
html_title = f"radar-sense {release}"
html_copy_source = False
html_math_renderer = "mathml"
html_static_path = ["site.css"]
html_css_files = ["site.css"]


def _write_math(translator: Any, node: Any, display: str) -> None:
    """Write a formula as MathML, which needs no script and no network."""
    translator.body.append(latex2mathml.converter.convert(node.astext(), display=display))
    raise SkipNode


def _notebook_as_markdown(app: Any, docname: str, source: list[str]) -> None:
    """Replace the text of a notebook by its cells, with the output below each of them."""
    if not docname.startswith("notebooks/"):
        return
    parts = []
    for cell in json.loads(source[0])["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        shown = "".join(line for output in cell.get("outputs", []) for line in output["text"])
        parts += [f"```text\n{shown}```"] if shown else []
    source[0] = "\n\n".join(parts) + "\n"


def setup(app: Any) -> dict[str, bool]:
    """Register the writer of formulas."""
    inline, block = (functools.partial(_write_math, display=d) for d in ("inline", "block"))
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.connect("source-read", _notebook_as_markdown)
    app.add_lexer("console", TextLexer)  # which would take a line with # for a command
    return {"parallel_read_safe": True, "parallel_write_safe": True}
