"""Figures: nothing overlaps, nothing is cut off, axes have units, lines differ in their dashes."""

import re
from functools import partial

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scenarios import scenario

from radar_sense import analyses, figures
from radar_sense.scenario import load_scenario

ALL = {
    "variance": analyses.variance,
    "sensitivity": analyses.sensitivity,
    "budget": analyses.budget,
    "montecarlo": analyses.montecarlo,
    "compare": analyses.compare,
    "validate": partial(analyses.validate, digits=1),
}
LONG = "a-level-name-of-forty-letters-0123456789"
SCENARIOS = {
    "paper": {},
    "one pose": {"geometry__azimuth_deg": {"start": 45, "stop": 45, "step": 1}},
    "backwards": {"geometry__azimuth_deg": {"start": 180, "stop": -90, "step": -1}},
    "long names": {
        "uncertainty__radar": {LONG: {"position_m": 1, "constant": 1}},
        "analysis": {"level": LONG},
    },
    "many levels": {
        "uncertainty__radar": {f"level{i}": {"position_m": i, "constant": i} for i in range(9)},
        "analysis": {"level": "level8"},
    },
    "no uncertainty": {
        "uncertainty": {
            "aircraft": {"position_m": 0, "attitude_deg": 0},
            "radar": {"none": {"position_m": 0, "constant": 0}},
        },
        "analysis": {"level": "none"},
    },
}


@pytest.mark.parametrize("changes", SCENARIOS.values(), ids=SCENARIOS.keys())
@pytest.mark.parametrize("analysis", ALL)
def test_layout(analysis, changes):
    if analysis == "validate":  # its draws are many: a few poses will do for a figure
        changes = {"geometry__azimuth_deg": {"start": 0, "stop": 90, "step": 45}, **changes}
    if analysis == "validate" and changes["geometry__azimuth_deg"]["stop"] == -90:
        changes = {**changes, "geometry__azimuth_deg": {"start": 90, "stop": 0, "step": -30}}
    figure = figures.draw(ALL[analysis](scenario(**changes)))
    figures.render(figure, "png")  # lays it out
    page = figure.bbox
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= page.x0
    assert box.x1 <= page.x1
    assert box.y1 <= page.y1
    for axes in figure.axes:
        assert not box.overlaps(axes.get_window_extent())
        assert axes.get_ylabel()
        low, high = axes.get_ylim()
        assert low < high
    assert "[deg]" in figure.axes[-1].get_xlabel()
    assert not figure.get_suptitle()


@pytest.mark.parametrize("p_fa", [0.99, 1e-2, 1.7e-4, 2e-12, 1e-100])
def test_layout_of_detectors(p_fa):
    """Labels lie on the axes, not on each other, and not on the data."""
    figure = figures.draw(analyses.detectors(scenario(radar__p_fa=p_fa)))
    FigureCanvasAgg(figure).draw()  # where text is as large as the axes say
    top, bottom = figure.axes
    (legend,) = figure.legends
    assert not legend.get_window_extent().overlaps(top.get_window_extent())
    boxes = [text.get_window_extent() for text in top.texts]
    for i, box in enumerate(boxes):
        inside = top.get_window_extent()
        assert inside.x0 < box.x0 < box.x1 < inside.x1
        assert box.y1 < inside.y1
        assert box.y0 > top.transData.transform((0, 1.0))[1]
        assert not any(box.overlaps(other) for other in boxes[:i])
    assert "[dB]" in bottom.get_xlabel()
    assert len(top.lines) == 4 * len(boxes)
    # told apart without colour: two solid lines of very different width, and dashes
    for axes in figure.axes:
        lines = axes.lines[:4] if axes is top else axes.lines
        styles = {
            (str(line._unscaled_dash_pattern), line.get_linewidth(), line.get_color() == "black")
            for line in lines
        }
        assert len(styles) == len(lines)


@pytest.mark.parametrize("analysis", ["budget", "sensitivity"])
def test_lines_differ_in_dashes_and_not_only_in_colour(analysis):
    (axes,) = figures.draw(ALL[analysis](load_scenario())).axes
    styles = [(line.get_linestyle(), line._unscaled_dash_pattern) for line in axes.lines]
    solid_black = [line for line in axes.lines if line.get_color() == "black"]
    # the total is solid like the first source and is told from it by being black
    assert len({str(style) for style in styles}) >= len(styles) - len(solid_black)


def test_ten_thousand_runs_make_a_small_file_that_says_so():
    s = load_scenario().with_analysis(runs=10_000)
    figure = figures.draw(analyses.montecarlo(s, workers=2))
    assert any("500 of 10000 runs" in text.get_text() for text in figure.legends[0].get_texts())
    for kind in ("pdf", "svg", "png"):
        assert len(figures.render(figure, kind)) < 1_000_000


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_the_same_figure_is_the_same_bytes(kind):
    one, other = (
        figures.render(figures.draw(analyses.budget(load_scenario())), kind) for _ in range(2)
    )
    assert one == other
    assert not re.search(rb"CreationDate|<dc:date>", one)


def test_two_panels_of_the_monte_carlo_figure():
    figure = figures.draw(analyses.montecarlo(load_scenario()))
    top, bottom = figure.axes
    assert "Error" in bottom.get_ylabel()
    assert len(top.collections[0].get_segments()) == 500
    low, high = bottom.get_ylim()
    assert low < -0.09
    assert high > 0.09
