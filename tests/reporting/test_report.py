"""The report: one HTML page with the results of the analyses, accessible to every reader."""

from __future__ import annotations

import ast
import itertools
import math
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from helpers import OVERHEAD, document, scenario, yaml_text

import radar_sense as rs
from radar_sense import plotting
from radar_sense.reading.parse import default_text, parse_scenario
from radar_sense.reporting import figure, html_elements, results

ROOT = Path(__file__).parents[2]
VOID = {"meta", "br", "hr", "img", "link", "input"}
FEW = {"start": 30, "stop": 150, "step": 30}
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
    """An element of a page."""

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
        parts = (c if isinstance(c, str) else c.text for c in self.children)
        return re.sub(r"\s+", " ", "".join(parts))


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


def shown(line: str) -> str:
    """Return the text of a line as the page shows it."""
    return Tree(html_elements.prose(line)).root.text


def write_flight(folder: Path) -> Path:
    rows = [(t, 250e3 - 250 * t, -160e3 + 100 * t, -9000) for t in range(0, 601, 60)]
    lines = ["time_s,north_m,east_m,down_m", *(",".join(map(str, row)) for row in rows)]
    (folder / ROUTE).write_text("\n".join(lines), encoding="utf-8")
    (folder / "flight.yaml").write_text(FLIGHT, encoding="utf-8")
    return folder / "flight.yaml"


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(results, "DRAWS", 2000)
        patch.setattr(results, "POSES", 5)
        yield


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """Draw no figures, which take most of the time."""
    monkeypatch.setattr(figure.Drawing, "draw", lambda drawing: html_elements.Html(""))


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


def test_every_answer_and_every_warning_is_on_the_page(flight, page):
    sources = flight.results
    results = (sources.variance, sources.budget, sources.comparison, sources.mission, sources.map)
    given = {w for r in results for w in sources.warnings_of(r)} | {*sources.implausible}
    assert given == set(flight.warnings)
    assert given
    for line in (*flight.report, *given):
        assert shown(line) in page.text, line
    keys = [node.attributes["id"] for node in page.all("section")]
    assert keys == [
        "scenario", "p-d", "sources", "methods", "threshold", "mission", "map", "again"
    ]  # fmt: skip


def test_warnings_stand_in_the_section_they_are_about(flight, page):
    sections = {node.attributes["id"]: node for node in page.all("section")}
    seen: set[str] = set()
    for section in flight.sections:
        text = sections[section.key].text
        for warning in section.warnings:
            assert (shown(warning) in text) == (warning not in seen), warning
        assert ("The same as under" in text) == bool(seen & set(section.warnings))
        seen |= set(section.warnings)
    assert len(seen) < sum(len(section.warnings) for section in flight.sections)


def test_numbers_are_those_of_the_analyses(flight, page):
    s = flight.results.scenario
    along, sources = rs.variance(s, threshold=0.5, method="linear"), rs.budget(s)
    text = page.text
    for worst in ("p_d", "sigma_pd", "upper_3sigma"):
        pose = np.argmax(along.table[worst])
        for column in ("p_d", "lower_3sigma", "upper_3sigma"):
            assert f"{along.table[column][pose]:.4f}" in text
        assert printed(3 * along.table["sigma_pd"][pose]) in text
    pose = int(np.argmax(sources.table["three_sigma_total"]))
    for name in ("P_D", "far", "aircraft_position", "aircraft_orientation"):
        assert printed(sources.table[f"three_sigma_{name}"][pose]) in text
        assert f"{sources.summary['shares_at_largest'][name]:.1%}" in text
    looks = rs.analyses.mission(s)
    assert f"{looks.summary['detection']['at_end']['p']:.4f}" in text
    assert flight.passed == along.passed


def printed(value: float) -> str:
    return f"{value:.0e}" if 0 < value < 5e-5 else f"{value:.4f}"


def test_half_the_deviation_of_the_largest_source_of_the_paper():
    """The sources of the paper are independent, so their variances add up."""
    answers = rs.report(scenario(geometry__azimuth_deg={"start": 40, "stop": 50, "step": 5}))
    table = answers.results.budget.table
    for name in ("radar_constant", "aircraft_orientation"):
        total, part = table["three_sigma_total"][1], table[f"three_sigma_{name}"][1]
        expected = math.sqrt(total**2 - 0.75 * part**2)
        assert answers.results.halved[name] == pytest.approx(expected, rel=1e-9)
    assert any("from the radar constant. Measure the radar" in line for line in answers.report)
    assert answers.passed


TOLERANCES = {"constant": {"gain_dbi": 1.0, "loss_db": 0.2}, "position_m": 1}


def test_the_part_to_measure_and_shares_above_one_are_reported():
    sheet = rs.load_scenario(ROOT / "configs/x_band_tracking.yaml").resolved()
    sheet["geometry"]["azimuth_deg"] = {"start": 10, "stop": 90, "step": 40}
    sheet["uncertainty"]["radar"] = {"data_sheet": TOLERANCES}
    answers = rs.report(parse_scenario(yaml_text(sheet)), method="form")
    result = answers.results.budget
    (sources,) = (section for section in answers.sections if section.key == "sources")
    halved = answers.results.halved["radar_constant_gain_dbi"]
    assert "The most important part is gain_dbi" in sources.answer
    assert f"3 sigma would be {printed(halved)}" in sources.answer
    interaction = result.summary["shares_at_largest"]["interaction"]
    assert ("shares add up to" in sources.answer) == (interaction < -0.005)
    assert interaction < -0.005


@pytest.mark.usefixtures("undrawn")
def test_sources_without_uncertainty_are_in_the_order_of_the_budget():
    certain = scenario(
        uncertainty__aircraft={"position_m": 0, "attitude_deg": 0},
        uncertainty__radar={"medium": {"position_m": 0, "constant": 0}},
        geometry__azimuth_deg=FEW,
    )
    answers = rs.report(certain)
    text = Tree(answers.html()).root.text.partition("by source")[2]
    names = [name.replace("_", " ") for name in answers.results.budget.summary["at_largest"]]
    places = [text.index(name) for name in names]
    assert places == sorted(places)


def test_a_constant_p_d_is_one_number_in_the_report():
    sphere = scenario(aircraft__rcs={"model": "constant", "rcs_m2": 0.1})
    report = rs.variance(sphere).report
    assert report[0].startswith("P_D is 0.")
    assert report[0].endswith(" at every pose")
    one = rs.variance(sphere.at_poses(slice(0, 1))).report
    assert re.fullmatch(r"P_D is 0\.\d{4} at 0 deg", one[0])


def test_the_scenario_on_the_page_is_the_scenario(flight, html, tmp_path, monkeypatch):
    write_flight(tmp_path)
    monkeypatch.chdir(tmp_path)
    raw = re.search(r"<pre><code>(.*?)</code></pre>", html, re.S).group(1)
    again = parse_scenario(unescape(raw))
    assert again.resolved() == flight.results.scenario.resolved()


def test_nothing_of_a_scenario_becomes_html(page, html):
    assert "<b onload" not in html
    assert not list(page.all("b", "script", "iframe", "object", "embed", "link", "img"))
    assert any(ROUTE in cell.text for cell in page.all("td"))
    assert "'<my file>.yaml'" in page.text


def test_escaping():
    text = """<&>"'"""
    for function in (html_elements.escaped, html_elements.prose, html_elements.code):
        assert "<&" not in function(text)
    one = html_elements.element("p", text, title=text, class_="a")
    (node,) = Tree(one).root.all("p")
    assert (node.text, node.attributes) == (text, {"title": text, "class": "a"})
    assert html_elements.prose("P_D + 3 sigma, P_DX") == "<i>P</i><sub>D</sub> + 3σ, P_DX"
    assert html_elements.prose(one) is one


def test_the_columns_of_numbers_are_aligned():
    node = Tree(
        html_elements.table("c", ("", "x", "y"), [("a", "1.5", "2 km"), ("b", "3e-05", "")])
    )
    cells = [cell.attributes.get("class") for cell in node.root.all("td")]
    assert cells == ["number", None, "number", None]


# To every reader.


def test_structure(page):
    (root,) = page.all("html")
    assert root.attributes["lang"] == "en"
    (title,) = (node for node in page.all("head") for node in node.all("title"))
    assert "flight" in title.text
    for landmark in ("header", "nav", "main", "footer", "h1"):
        assert len(list(page.all(landmark))) == 1, landmark
    levels = [int(node.tag[1]) for node in page.all("h1", "h2", "h3", "h4")]
    assert levels[0] == 1
    assert all(b <= a + 1 for a, b in itertools.pairwise(levels))
    (body,) = page.all("body")
    first = next(iter(body.all()))
    assert (first.tag, first.attributes["href"]) == ("a", "#answers")
    nodes = list(page.all())
    ids = [node.attributes["id"] for node in nodes if "id" in node.attributes]
    assert len(ids) == len(set(ids))
    for node in nodes:
        for name in ("aria-labelledby", "aria-describedby"):
            assert set(node.attributes.get(name, "").split()) <= set(ids)
        if node.tag in ("a", "use"):
            assert node.attributes["href"].removeprefix("#") in ids
        for reference in re.findall(r"url\(#([^)]*)\)", " ".join(node.attributes.values())):
            assert reference in ids


def test_tables_have_captions_and_scopes(page):
    tables = list(page.all("table"))
    assert len(tables) > 6
    for node in tables:
        assert len(list(node.all("caption"))) == 1
        assert all(h.attributes.get("scope") in ("col", "row") for h in node.all("th"))
        widths = {len(list(row.all("th", "td"))) for row in node.all("tr")}
        assert len(widths) == 1
        for row in node.all("tbody"):
            assert all(next(iter(r.all())).attributes["scope"] == "row" for r in row.all("tr"))
    for region in page.all("div"):
        if region.attributes.get("class") == "scroll":
            assert region.attributes["tabindex"] == "0"
            assert region.attributes["aria-label"]


def test_figures_have_a_title_and_a_description(page):
    figures = list(page.all("svg"))
    assert len(figures) == 5
    for node in figures:
        assert node.attributes["role"] == "img"
        title, seen, *_ = node.all()
        assert (title.tag, seen.tag) == ("title", "desc")
        assert len(title.text) > 15
        assert len(seen.text) > 60
        labels = node.attributes["aria-labelledby"].split()
        assert labels == [title.attributes["id"], seen.attributes["id"]]
        assert not list(node.all("style", "metadata"))


def test_nothing_is_fetched(page, html):
    for node in page.all():
        assert not any(name.startswith("on") for name in node.attributes)
        for name in ("src", "href", "action", "data"):
            assert node.attributes.get(name, "#").startswith(("#", "data:image/png"))
    assert "@import" not in html
    assert not re.search(r"url\((?!#)", html)
    assert "http" not in re.sub(r'xmlns="http://www.w3.org/2000/svg"|http-equiv', "", html)


# The command and its files.


@pytest.mark.usefixtures("undrawn")
def test_the_same_bytes_whatever_the_number_of_workers(tool, flight, tmp_path):
    write_flight(tmp_path)
    options = ("--threshold", "0.5", "--method", "linear", "--level", "one", "--workers", "2")
    names = ("report", "flight.yaml", *options)
    code, out, err = tool(*names)
    assert code == (0 if flight.passed else 3)
    assert out.splitlines() == [*flight.report, "figures/flight_report.html"]
    assert err.splitlines() == [f"Warning: {w}" for w in flight.warnings]
    assert out.isascii()
    written = Path("figures/flight_report.html").read_text(encoding="utf-8")
    assert written == flight.html(("radar-sense", *names))


def test_a_figure_is_the_same_bytes_again(flight):
    one, two = (s.body[1].draw() for s in (flight.sections[1], flight.sections[1]))
    assert one == two


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--k", "2"], 2, "k belongs to threshold"),
        (["--method", "monte"], 2, "method must be one of"),
        (["--level", "hi"], 2, "level must be one of"),
        (["--radar", "x"], 2, "single radar"),
        (["--threshold", "0"], 2, "must be"),
        (["--threshold", "0.1", "-q"], 3, ""),
        (["--threshold", "0.6", "-q"], 0, ""),
    ],
)
@pytest.mark.usefixtures("undrawn")
def test_exit_codes(tool, options, code, words):
    text = yaml_text(document(geometry__azimuth_deg={"start": 0, "stop": 20, "step": 10}))
    Path("my.yaml").write_text(text, encoding="utf-8")
    outcome = tool("report", "my.yaml", *options)
    assert (outcome.code, outcome.out) == (code, "")
    assert words in outcome.err
    assert outcome.err.count("\n") == (1 if code == 2 else 0)
    assert Path("figures/paper_report.html").exists() == (code != 2)


def test_a_figure_that_cannot_be_drawn_leaves_nothing(tool, monkeypatch):
    coarse = default_text().replace("step: 0.5", "step: 60")
    monkeypatch.setattr("radar_sense.reading.parse.default_text", lambda: coarse)

    def fail(*args):
        raise ValueError("no ink")

    monkeypatch.setattr(plotting, "render", fail)
    outcome = tool("report", "-q")
    assert outcome.code == 1
    assert "no ink" in outcome.err
    assert not Path("figures").exists()


@pytest.mark.parametrize(
    "changes",
    [
        OVERHEAD,
        {"radar__constant": 1e-9, "geometry__azimuth_deg": FEW},
        {
            "uncertainty__aircraft": {"position_m": 0, "attitude_deg": 0},
            "uncertainty__radar": {"medium": {"position_m": 0, "constant": 0}},
            "geometry__azimuth_deg": FEW,
        },
    ],
    ids=["overhead", "at its floor", "certain"],
)
@pytest.mark.usefixtures("undrawn")
def test_scenarios_in_which_something_has_no_answer(changes, monkeypatch):
    def refuse(scenario, workers):
        raise rs.InputError("no <map>")

    monkeypatch.setattr(results, "coverage_map", refuse)
    for options in ({"method": "form"}, {"threshold": 0.5, "method": "linear"}):
        answers = rs.report(scenario(**changes), **options)
        text = Tree(answers.html()).root.text
        assert "nan" not in re.findall(r"\w+", text)
        assert "There is no answer: no <map>." in text


@pytest.mark.usefixtures("undrawn")
def test_a_scenario_made_in_python():
    """Names of levels in Python may hold any characters."""
    few = scenario(geometry__azimuth_deg=FEW)
    made = rs.Scenario(
        model=few.model,
        aircraft=few.aircraft,
        radar=few.radar,
        cov_aircraft=few.cov_aircraft,
        cov_radar={"<script>": few.cov_radar["medium"]},
        name="made",
    )
    html = rs.report(made).html()
    assert "<script" not in html.lower()
    assert "&lt;script&gt;" in html


def test_the_report_has_no_physics():
    """No module of the report imports a model; only `results` runs analyses."""
    for path in (ROOT / "radar_sense/reporting").glob("*.py"):
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        homes = {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
        banned = ("radar_sense.model", "radar_sense.montecarlo", "radar_sense.mission")
        assert not any(home.startswith(banned) for home in homes if home), path.name


# In a browser.


def browser_path() -> str | None:
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


def test_in_chromium(html, tmp_path):
    """No error, no request, no sideways scrolling, whatever the width and the colours."""
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
            page.on(
                "console",
                lambda message, console=console: console.append(message.text),
            )
            page.on(
                "pageerror",
                lambda error, console=console: console.append(str(error)),
            )
            page.on("request", lambda request, urls=requests: urls.append(request.url))
            page.goto(path.as_uri())
            for width in (400, 1400):
                page.set_viewport_size({"width": width, "height": 900})
                size = "[document.documentElement.scrollWidth, getComputedStyle(document.body)"
                found, background = page.evaluate(f"() => {size}.backgroundColor]")
                assert found == width
                backgrounds.add(background)
                boxes = [svg.bounding_box() for svg in page.locator("figure svg").all()]
                assert len(boxes) == 5
                assert all(box["width"] > 250 and box["height"] > 150 for box in boxes)
            page.keyboard.press("Tab")
            assert page.evaluate("() => document.activeElement.className") == "skip"
            assert not console
            assert [url for url in requests if not url.startswith("data:")] == [path.as_uri()]
        assert len(backgrounds) == 2
        printed = page.pdf(prefer_css_page_size=True)
        boxes = {
            tuple(map(float, b.split())) for b in re.findall(rb"/MediaBox \[([^]]*)\]", printed)
        }
        assert [round(v) for v in next(iter(boxes))] == [0, 0, 595, 842]  # A4 in points
        browser.close()
