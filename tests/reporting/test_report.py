"""The report: one HTML page with the results of the analyses, accessible to every reader."""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import (
    OVERHEAD,
    csv_text,
    document,
    few_draws,
    few_judging_draws,
    known_to,
    scenario,
    without_pixels,
    yaml_text,
)
from routes import HEAD

import radar_sense as rs
from radar_sense import files, plotting
from radar_sense import page as page_module
from radar_sense.scenario_file.load import parse_scenario

#: The module; `analyses.report` is the command.
command = import_module("radar_sense.analyses.report")
VOID = {"meta", "br", "hr", "img", "link", "input"}
FEW = {"start": 30, "stop": 90, "step": 60}
#: Without escapes this file name would be a tag.
ROUTE = 'a <b onload="x">&amp;.csv'

FLIGHT = """
name: flight
radars:
  - name: P_D
    position_m: [0, 0, 0]
    constant: 4
    p_fa: 1.0e-6
    scan_period_s: 60
    uncertainty: {one: {position_m: 100, constant: 0.2}, two: {position_m: 10, constant: 0.01}}
  - name: far
    position_m: [100e3, 50e3, 0]
    constant: 1.3
    p_fa: 1.0e-6
    max_range_km: 400
    scan_period_s: 60
    uncertainty: {one: {position_m: 500, constant: 0.1}, two: {position_m: 10, constant: 0.01}}
aircraft:
  rcs: {model: ellipsoid, a_m: 0.15, b_m: 0.13, c_m: 0.21}
geometry:
  type: path
  file: 'a <b onload="x">&amp;.csv'
  interpolate: {step_s: 60}
uncertainty: {aircraft: {position_m: 50, attitude_deg: 1}, aircraft_correlation_s: 300}
analysis: {level: one, seed: 3}
"""


@dataclass
class Node:
    tag: str
    attributes: dict[str, str]
    children: list[Node | str] = field(default_factory=list)

    def all(self, *tags: str) -> Iterator[Node]:
        for child in self.children:
            if isinstance(child, Node):
                if not tags or child.tag in tags:
                    yield child
                yield from child.all(*tags)

    @property
    def text(self) -> str:
        return "".join(c if isinstance(c, str) else c.text for c in self.children)


class Tree(HTMLParser):
    """Parses a page, and insists that every element is closed in its turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.root = Node("", {})
        self.open = [self.root]
        self.feed(text)
        self.close()
        assert self.open == [self.root]

    def handle_starttag(self, tag, attrs):
        node = Node(tag, {name: value or "" for name, value in attrs})
        assert len(node.attributes) == len(attrs)
        self.open[-1].children.append(node)
        if tag not in VOID:
            self.open.append(node)

    def handle_startendtag(self, tag, attrs):
        self.open[-1].children.append(Node(tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop().tag == tag

    def handle_data(self, data):
        self.open[-1].children.append(data)


def write_flight(folder: Path) -> Path:
    rows = [(t, 250e3 - 250 * t, -160e3 + 100 * t, -9000) for t in range(0, 601, 60)]
    (folder / ROUTE).write_text(csv_text(HEAD, rows), encoding="utf-8")
    (folder / "flight.yaml").write_text(FLIGHT, encoding="utf-8")
    return folder / "flight.yaml"


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """Few draws, bearings and cells: the tests of the commands have their numbers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("radar_sense.analyses.compare"), "TOGETHER", 1e4)
        patch.setattr(command, "POSES", 5)
        patch.setattr(command, "BEARINGS_DEG", 30.0)
        patch.setattr("radar_sense.coverage.grid.CELLS", 40)
        few_judging_draws(patch)
        few_draws(patch)
        yield


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """Draw no figures, which take most of the time."""
    monkeypatch.setattr(page_module, "_figure", lambda result, words: "")


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)  # the base of relative file names
        read = rs.load_scenario(write_flight(folder))
        return rs.report(read, threshold=0.5, method="linear")


@pytest.fixture(scope="module")
def html(flight) -> str:
    return flight.html(["radar-sense", "report", "<my file>.yaml"])


@pytest.fixture(scope="module")
def page(html) -> Node:
    return Tree(html).root


# Content.


def test_a_section_is_what_its_command_prints_draws_and_writes(flight, page):
    s, of = flight.scenario, rs.analyses
    answers = {
        "variance": of.variance(s, method="linear", threshold=0.5),
        "budget": of.budget(s, method="linear", threshold=0.5),
        "compare": of.compare(s.at_poses(command.compared_poses(s))),
        "mission": of.mission(s),
        "range": of.detection_range(s, p_d=0.5, method="linear", step_deg=30.0),
        "map": of.coverage_map(s, p_d=0.5),
    }
    nodes = {node.attributes["id"]: node for node in page.all("section")}
    assert list(nodes) == ["check", *answers, "again"]
    given = {item.text for node in nodes["check"].all("ul") for item in node.all("li")}
    for key, result in answers.items():
        assert [line.text for line in nodes[key].all("span")] == list(result.report)
        shown = [item.text for node in nodes[key].all("ul") for item in node.all("li")]
        assert shown == [warning for warning in result.warnings if warning not in given]
        given |= set(shown)
        (table,) = nodes[key].all("table")
        rows = [[cell.text for cell in row.all("th", "td")] for row in table.all("tr")][1:]
        assert len(rows) == min(len(result.table), page_module.MOST_COLUMNS)
        common = [n for n, c in result.columns.items() if not c.meaning.startswith("For radar")]
        alone = [name for name in result.columns if name not in common]
        axis = next(iter(result.table))
        for (name, *ends), column in zip(rows, [*common, *alone], strict=False):
            assert name.startswith(column)
            known = result.table[column][np.isfinite(result.table[column])]
            for shown_end, end in zip(ends, (known.min(), known.max()), strict=True):
                number = f"{end:.10g}" if column == axis else page_module.number(end)
                assert shown_end.startswith(number)
        assert len(list(nodes[key].all("img"))) == 1
    counted = [section for section in flight.sections if section.warnings]
    (contents,) = page.all("nav")
    assert re.findall(r"Warnings: (\d+)", contents.text) == [str(len(s.warnings)) for s in counted]
    assert 0 < len(counted) < len(flight.sections)
    assert flight.passed == answers["variance"].passed
    assert len(flight.warnings) == len(set(flight.warnings)) > 1


def test_places_of_the_extremes():
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 45})
    along = rs.analyses.variance(s, method="linear")
    cells, p_d = [*page_module._cells(along, "p_d")], along.table["p_d"]
    assert cells[1] == f"<td>{p_d[0]:.4g} at 0 and 180 °</td>"
    assert cells[2] == f"<td>{p_d[2]:.4g} at 90 °</td>"
    # The east of a map has no place in the north of its rows, of which there are as many.
    over = rs.analyses.coverage_map(s)
    assert all(" at " not in cell for cell in page_module._cells(over, "east_m"))


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (2e-17, "0"), (0.07217, "0.07217"), (268540.4, "268,540"), (np.nan, "no value")],
)
def test_numbers(value, text):
    assert page_module.number(value) == text


def test_the_scenario_on_the_page_is_the_scenario(flight, page, tmp_path, monkeypatch):
    write_flight(tmp_path)
    monkeypatch.chdir(tmp_path)
    (made,) = (node for node in page.all("section") if node.attributes["id"] == "again")
    lines = [node.text for node in made.all("span")]
    assert lines[0] == "radar-sense report '<my file>.yaml'"
    again = parse_scenario("\n".join(lines[2:]))
    assert again.resolved() == flight.scenario.resolved()


# Hostile names.


def test_nothing_of_a_scenario_becomes_html(page, html):
    assert "<b onload" not in html
    assert not list(page.all("b", "script", "iframe", "object", "embed", "link"))
    assert ROUTE in page.text
    assert "'<my file>.yaml'" in page.text


@pytest.mark.usefixtures("undrawn")
def test_control_characters_and_marks_of_direction_are_escaped(flight):
    name = "a\x1b[31m\u202egpj\u2066.yaml"
    html = flight.html(["radar-sense", "report", name])
    assert "a\\x1b[31m\\u202egpj\\u2066.yaml" in html
    assert all(character.isprintable() or character == "\n" for character in html)


@pytest.mark.parametrize("name", ["f\u202egpj.csv", "flüge.csv", "a\u2066b\u00a0c.csv"])
def test_a_scenario_with_marks_of_direction_is_printable_and_can_be_read_again(name):
    written = files.yaml_text({"geometry": {"file": name}})
    assert written.replace("\n", "").isprintable()
    assert yaml.safe_load(written) == {"geometry": {"file": name}}
    assert ("ü" in written) == ("ü" in name)


@pytest.mark.skipif(sys.platform != "linux", reason="file names are bytes on Linux only")
@pytest.mark.usefixtures("undrawn")
def test_paths_that_are_not_utf_8(tool):
    folder = Path(os.fsdecode(b"caf\xe9"))
    folder.mkdir()
    content = document(geometry__azimuth_deg=FEW)
    (folder / "my.yaml").write_text(yaml_text(content), encoding="utf-8")
    assert tool("report", str(folder / "my.yaml"), "--out", str(folder)).code == 0
    assert "caf\\udce9" in (folder / "paper_report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_a_scenario_made_in_python():
    """What an RCS of one's own says of itself may hold any characters."""

    class Odd(rs.ConstantRCS):
        def __repr__(self):
            return "<script>"

    few = scenario(geometry__azimuth_deg=FEW)
    (radar,) = few.radars
    model = dataclasses.replace(radar.model, rcs=Odd(1.0))
    odd = dataclasses.replace(radar, model=model)
    html = rs.report(rs.Scenario(radars=[odd], geometry=few.geometry, name="made")).html()
    assert "<script" not in html.lower()
    assert "&lt;script&gt;" in html


# To every reader.


def test_structure(page):
    (root,) = page.all("html")
    assert root.attributes["lang"] == "en"
    (title,) = (node for node in page.all("head") for node in node.all("title"))
    assert "flight" in title.text
    for landmark in ("header", "nav", "main", "h1"):
        assert len(list(page.all(landmark))) == 1, landmark
    levels = [int(node.tag[1]) for node in page.all("h1", "h2", "h3", "h4")]
    assert levels[0] == 1
    assert all(b <= a + 1 for a, b in itertools.pairwise(levels))
    ids = [node.attributes["id"] for node in page.all() if "id" in node.attributes]
    assert len(ids) == len(set(ids))
    assert {node.attributes["href"].removeprefix("#") for node in page.all("a")} <= set(ids)
    for node in page.all("img"):
        assert len(node.attributes["alt"]) > 20


def test_tables_have_captions_and_scopes(page):
    for node in page.all("table"):
        assert len(list(node.all("caption"))) == 1
        assert all(h.attributes.get("scope") in ("col", "row") for h in node.all("th"))
        assert {len(list(row.all("th", "td"))) for row in node.all("tr")} == {3}


def test_nothing_is_fetched(page, html):
    for node in page.all():
        assert not any(name.startswith("on") for name in node.attributes)
        for name in ("src", "href", "action", "data"):
            assert node.attributes.get(name, "#").startswith(("#", "data:image/svg+xml;base64,"))
    assert "@import" not in html
    assert "url(" not in html
    assert "http" not in html.replace("http-equiv", "")


# The command and its files.


def test_the_same_bytes_whatever_the_number_of_workers(tool, flight, tmp_path, monkeypatch):
    without_pixels(monkeypatch)
    write_flight(tmp_path)
    line = "report flight.yaml --threshold 0.5 --method linear --level one --workers 2"
    names = line.split()
    code, out, err = tool(*names)
    assert code == (0 if flight.passed else 3)
    assert out.splitlines() == [*flight.report, "figures/flight_report.html"]
    assert err.splitlines() == [f"Warning: {w}" for w in flight.warnings]
    assert out.isascii()
    written = Path("figures/flight_report.html").read_text(encoding="utf-8")
    assert written == flight.html(["radar-sense", *names])


def test_a_figure_that_cannot_be_drawn_leaves_nothing(tool, monkeypatch):
    Path("my.yaml").write_text(yaml_text(document(geometry__azimuth_deg=FEW)), encoding="utf-8")

    def fail(*args):
        raise ValueError("no ink")

    monkeypatch.setattr(plotting, "render", fail)
    outcome = tool("report", "my.yaml", "-q")
    assert outcome.code == 1
    assert "no ink" in outcome.err
    assert not Path("figures").exists()


@pytest.mark.parametrize(
    ("changes", "options"),
    [
        (OVERHEAD, {"method": "form"}),
        (OVERHEAD, {"threshold": 0.5, "method": "linear"}),
        ({"radar__constant": 1e-9}, {"threshold": 0.5, "method": "linear"}),
        (known_to(), {"method": "form"}),
    ],
    ids=["overhead", "overhead, a threshold", "at its floor", "certain"],
)
@pytest.mark.usefixtures("undrawn")
def test_scenarios_in_which_something_has_no_answer(changes, options, monkeypatch):
    def refuse(scenario, **_):
        raise rs.InputError("no <map>")

    refuse.name = "map"
    monkeypatch.setattr(command, "coverage_map", refuse)
    few = {"geometry__azimuth_deg": {"start": 45, "stop": 45, "step": 1}, **changes}
    text = Tree(rs.report(scenario(**few), **options).html()).root.text
    assert "nan" not in re.findall(r"\w+", text)
    assert "no answer: no <map>" in text


# In a browser.


def browser_path() -> str | None:
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


def test_in_chromium(html, tmp_path):
    """No error, no request, and nothing is cut, whatever the width and the colours.

    The rows of a table of words are not broken, and scroll within their block.
    """
    playwright = pytest.importorskip("playwright.sync_api")
    executable = browser_path()
    if executable is None:
        pytest.skip("there is no Chromium")
    path = tmp_path / "report.html"
    path.write_text(html, encoding="utf-8")
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        backgrounds = set()
        for scheme in ("light", "dark"):
            context = browser.new_context(java_script_enabled=False, color_scheme=scheme)
            page = context.new_page()
            console: list[str] = []
            requests: list[str] = []
            page.on("console", lambda message, console=console: console.append(message.text))
            page.on("pageerror", lambda error, console=console: console.append(str(error)))
            page.on("request", lambda request, urls=requests: urls.append(request.url))
            page.goto(path.as_uri())
            for width in (400, 800, 1400):
                page.set_viewport_size({"width": width, "height": 900})
                found, background, whole, scrolls = page.evaluate(
                    """() => {
                    const all = names => [...document.querySelectorAll(names)];
                    return [document.documentElement.scrollWidth,
                        getComputedStyle(document.body).backgroundColor,
                        all('td, th, pre .words').every(n => n.scrollWidth <= n.clientWidth),
                        all('pre').every(n => getComputedStyle(n).overflowX == 'auto')]}"""
                )
                assert (found, whole, scrolls) == (width, True, True)
                backgrounds.add(background)
                ends = page.evaluate(
                    "() => [...document.querySelectorAll('td, th, pre, pre .words, img')]"
                    ".map(node => node.getBoundingClientRect()).map(box => [box.left, box.right])"
                )
                assert len(ends) > 100
                assert all(0 <= left <= right <= width for left, right in ends)
            assert not console
            assert [url for url in requests if not url.startswith("data:")] == [path.as_uri()]
        assert len(backgrounds) == 2
        printed = page.pdf(prefer_css_page_size=True)
        boxes = {
            tuple(map(float, b.split())) for b in re.findall(rb"/MediaBox \[([^]]*)\]", printed)
        }
        assert [round(v) for v in next(iter(boxes))] == [0, 0, 595, 842]  # A4 in points
        browser.close()
