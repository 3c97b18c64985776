"""Figures: no overlaps, nothing cut off, units on all axes, lines of different dashes."""

import re
from functools import cache, partial
from importlib import import_module

import numpy as np
import pytest
from helpers import (
    dashes,
    lay_out,
    legend_off_data,
    network_document,
    radar_entry,
    scenario,
    small_batches,
    yaml_text,
)
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from radar_sense import analyses, limits, plotting
from radar_sense.command import Result
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.propagation import Band
from radar_sense.scenario_file.load import load_scenario, parse_scenario

pytestmark = pytest.mark.usefixtures("quick")

ALL = {
    "variance": analyses.variance,
    "sensitivity": analyses.sensitivity,
    "budget": analyses.budget,
    "montecarlo": analyses.montecarlo,
    "compare": analyses.compare,
    "validate": partial(analyses.validate, digits=1),
}
POLAR = {"range": (analyses.range, ["polar"]), "rcs": (analyses.rcs, ["polar", None])}
AZIMUTHS = {"start": 0, "stop": 180, "step": 15}
LONG = "a-level-name-of-forty-letters-0123456789"


def levels(**sizes):
    """Changes of the scenario: levels with deviations of these sizes, the last in use."""
    sizes = {name: {"position_m": size, "constant": size} for name, size in sizes.items()}
    return {"uncertainty__radar": sizes, "analysis": {"level": [*sizes][-1]}}


SCENARIOS = {
    "paper": {},
    "one pose": {"geometry__azimuth_deg": {"start": 45, "stop": 45, "step": 1}},
    "backwards": {"geometry__azimuth_deg": {"start": 90, "stop": -90, "step": -60}},
    "long names": levels(**{LONG: 1}),
    "many levels": levels(**{f"level{i}": i for i in range(9)}),
    "no uncertainty": {
        "uncertainty__aircraft": {"position_m": 0, "attitude_deg": 0},
        **levels(none=0),
    },
}


#: Names and number of the levels change the figure of `sensitivity`, and the footer of all others.
#: An axis that runs backwards is the same in all figures.
OF_ONE = {"long names": "sensitivity", "many levels": "sensitivity", "backwards": "variance"}
LAYOUTS = [(analysis, kind) for analysis in ALL for kind in ("paper", "one pose")]
LAYOUTS += [(analysis, kind) for kind, analysis in OF_ONE.items()]
LAYOUTS += [(analysis, "no uncertainty") for analysis in ("budget", "montecarlo", "validate")]


@pytest.mark.parametrize(("analysis", "kind"), LAYOUTS)
def test_layout(analysis, kind, monkeypatch):
    small_batches(monkeypatch)
    # A few poses will do for a figure.
    few = {"geometry__azimuth_deg": {"start": 0, "stop": 90, "step": 45}}
    changes = {**few, **SCENARIOS[kind]}
    figure = lay_out(ALL[analysis](scenario(**changes)).plot())
    legend_off_data(figure)
    for axes in figure.axes:
        assert axes.get_ylabel()
        low, high = axes.get_ylim()
        assert low < high
    assert re.search(r"\[deg\]|at azimuth 45 deg", figure.axes[-1].get_xlabel())
    assert not figure.get_suptitle()
    footer_off_all(figure)


def footer_off_all(figure):
    """Insist that the footer of a figure that is laid out is on the page, clear of all else."""
    if plotting.style_of(figure).ieee:
        assert not figure.get_supxlabel()
        return
    (footer,) = (text for text in figure.texts if text.get_text() == figure.get_supxlabel())
    box, page = footer.get_window_extent(), figure.bbox
    assert page.x0 <= box.x0 < box.x1 <= page.x1
    assert page.y0 <= box.y0
    for other in [*figure.axes, *figure.legends]:
        # clipped artists can have a larger box
        assert not box.overlaps(other.get_tightbbox())
    assert footer.get_fontsize() == pytest.approx(5.5 * plotting.style_of(figure).scale)


FOOTERS = {
    "variance": "scenario paper, level high, method form",
    "sensitivity": "scenario paper, method form",
    "montecarlo": "scenario paper, level high, method form",
    "compare": "scenario paper, level high",
    "rcs": "scenario paper",
}


def test_the_footer_names_what_the_numbers_depend_on():
    s = load_scenario().at_poses(slice(0, 1))
    s = s.with_analysis(level="high", runs=50, method="form")
    for analysis, footer in FOOTERS.items():
        assert getattr(analyses, analysis)(s).small_print == footer
    area = {"north_km": (0, 90), "east_km": (0, 90), "step_km": 90}
    assert analyses.coverage_map(s, **area).small_print == "scenario paper"
    bound = analyses.coverage_map(s, **area, upper=True)
    assert bound.small_print == FOOTERS["variance"]


def test_a_long_footer_is_on_several_lines():
    result = analyses.variance(scenario(**levels(**{LONG: 1}), name="scenario-" * 6))
    figure = lay_out(result.plot())
    footer_off_all(figure)
    assert figure.get_supxlabel().count("\n") == 1
    assert "\n" not in result.plot("slides").get_supxlabel()


@pytest.mark.parametrize("taken", [(), (plotting.BAND,), (plotting.BAND, plotting.LINES[0])])
def test_no_two_of_24_styles_are_alike(taken):
    drawn = [s for s, _ in zip(plotting.styles(*taken), range(24), strict=False)]
    assert len({*drawn, *taken}) == 24 + len(taken)
    assert not {colour for colour, _ in drawn} & {colour for colour, _ in taken}


def test_what_many_radars_share_is_told_apart():
    shared = [f"type_{i}" for i in range(10)]
    styles = plotting.source_styles(["aircraft_position", *shared, "a", "b"], ["a", "b"])
    assert len({*styles.values()}) == len(styles) == 13


@pytest.mark.parametrize(
    ("start", "stop", "wanted"),
    [
        (0, 180, [0, 30, 60, 90, 120, 150, 180]),
        (40, 41, [40, 40.2, 40.4, 40.6, 40.8, 41]),
        (40, 40.01, [40, 40.005, 40.01]),
    ],
)
def test_ticks_of_azimuth(start, stop, wanted):
    azimuths = {"start": start, "stop": stop, "step": (stop - start) / 10}
    s = scenario(geometry__azimuth_deg=azimuths, analysis__method="linear")
    figure = lay_out(analyses.variance(s).plot())
    ticks = figure.axes[0].get_xticks()
    inside = ticks[(ticks > start - 1e-9) & (ticks < stop + 1e-9)]
    assert inside.tolist() == pytest.approx(wanted)


def many_radars():
    """A network of 12 radars around the aircraft, the last ones at its edges."""
    angle = 2 * np.pi * np.arange(12) / 12
    places = 250e3 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    alike = {"constant": 2.0, "uncertainty": {"low": {"position_m": 100, "constant": 0.1}}}
    radars = [
        radar_entry(f"site{i:02d}", position_m=[*place.tolist(), -30.0], p_fa=1.7e-4, **alike)
        for i, place in enumerate(places)
    ]
    content = network_document(*radars)
    content["geometry"] |= {"range_km": 150, "azimuth_deg": AZIMUTHS}
    content["uncertainty"] = {"aircraft": {"position_m": 50, "attitude_deg": 1}}
    return parse_scenario(yaml_text(content))


def overlapping(boxes):
    return [(i, j) for i, a in enumerate(boxes) for j, b in enumerate(boxes[:i]) if a.overlaps(b)]


@cache
def many_lines(of):
    """Return a result whose figure has a line for each name, and the names."""
    if of == "radars":
        result = analyses.variance(many_radars(), method="linear")
        return result, result.scenario.model.names
    names = tuple(f"level{i}" for i in range(8))
    s = scenario(**levels(**{n: 2 * i + 1 for i, n in enumerate(names)})).at_poses(
        slice(0, None, 6)
    )
    return analyses.sensitivity(s), names


@pytest.mark.parametrize(
    ("of", "style"), [("radars", "one-column"), ("radars", "slides"), ("levels", "one-column")]
)
def test_many_lines_are_told_apart(of, style):
    """Every line has a style of its own, and its name in a legend of a quarter of the height."""
    result, names = many_lines(of)
    figure = lay_out(result.plot(style))
    (axes,), (legend,) = figure.axes, figure.legends
    others = ("black", plotting.BAND[0] if of == "radars" else "")
    named = [line for line in axes.lines if line.get_color() not in others]
    pairs = [(line.get_color(), dashes(line)) for line in named]
    assert len(set(pairs)) == len(pairs) == len(names)
    assert set(names) <= {text.get_text() for text in legend.get_texts()}
    assert legend.get_window_extent().height < 0.25 * figure.bbox.height
    footer_off_all(figure)


@cache
def map_of_many_radars():
    return analyses.coverage_map(
        many_radars(), step_km=20, north_km=(-260, 260), east_km=(-255, 255)
    )


@pytest.mark.parametrize("style", ["one-column", "slides"])
def test_names_on_a_map_are_on_the_map(style):
    figure = lay_out(map_of_many_radars().plot(style))
    axes, bar = figure.axes
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) == 12
    assert not overlapping([*boxes, bar.get_tightbbox()])
    for box in boxes:
        assert axes.bbox.contains(box.x0, box.y0)
        assert axes.bbox.contains(box.x1, box.y1)
    footer_off_all(figure)


def test_one_pose_shows_its_draws():
    s = load_scenario().at_poses(slice(3, 4)).with_analysis(runs=300)
    result = analyses.montecarlo(s)
    (axes,) = result.plot().axes
    edges = np.array([[bar.get_x(), bar.get_x() + bar.get_width()] for bar in axes.patches])
    draws = monte_carlo(s).sample_paths
    assert sum(bar.get_height() for bar in axes.patches) == 300
    assert edges.min() == pytest.approx(draws.min())
    assert edges.max() == pytest.approx(draws.max())
    marks = [line.get_xdata()[0] for line in axes.lines]
    assert marks == [result.table[n][0] for n in ("p_d", "lower_3sigma", "upper_3sigma")]


@cache
def at_few_poses(analysis):
    s = load_scenario().at_poses(slice(0, None, 3)).with_analysis(runs=50)
    return getattr(analyses, analysis)(s)


@pytest.mark.parametrize(
    ("analysis", "style"),
    [
        *(("budget", style) for style in plotting.STYLES),
        ("rcs", "two-columns"),
        ("montecarlo", "slides"),
        ("detection_range", "slides"),
    ],
)
def test_a_figure_fits_its_style(analysis, style):
    figure = lay_out(at_few_poses(analysis).plot(style))
    width, height, scale, ieee = plotting.STYLES[style]
    assert figure.get_figwidth() == width
    assert 0.2 * width < figure.get_figheight() <= height
    assert figure.axes[0].yaxis.label.get_fontsize() == 8 * scale
    words = [axes.get_xlabel() + axes.get_ylabel() for axes in figure.axes]
    assert any("[" in label for label in words) == (not ieee)
    assert {text.get_fontsize() for text in figure.legends[0].get_texts()} == {7.5 * scale}
    labels = [axes.yaxis.label.get_window_extent() for axes in figure.axes]
    assert not overlapping([box for box in labels if box.width])
    legend_off_data(figure)
    footer_off_all(figure)


def test_styles_are_those_of_the_option():
    assert tuple(plotting.STYLES) == limits.STYLES
    assert limits.STYLES[0] == plotting.DEFAULT_STYLE


def test_style_of_the_saved_figure_and_only_of_the_figure(tmp_path):
    result = at_few_poses("budget")
    for style in plotting.STYLES:
        result.save(tmp_path / style, ["svg"], style=style)
        (width,) = re.findall(
            r'svg .*width="([0-9.]+)pt"', (tmp_path / style / "paper_budget.svg").read_text()
        )
        assert float(width) == pytest.approx(72 * plotting.STYLES[style].width)
    tables = {(tmp_path / style / "paper_budget.csv").read_bytes() for style in plotting.STYLES}
    assert len(tables) == 1
    with pytest.raises(ValueError, match="style must be one of one-column, two-columns, slides"):
        result.save(tmp_path, style="poster")
    assert not (tmp_path / "paper_budget.csv").exists()


@pytest.mark.parametrize("p_fa", [0.99, 1e-100])
def test_layout_of_detectors(p_fa, monkeypatch):
    """Labels lie on the axes, not on each other, and not on the data."""
    # The figure has no required signal-to-noise ratios, which take most of the time.
    monkeypatch.setattr(import_module("radar_sense.analyses.detectors"), "INTEGRATING", ())
    figure = analyses.detectors(scenario(radar__p_fa=p_fa)).plot()
    FigureCanvasAgg(figure).draw()  # where text is as large as the axes say
    top, bottom, slope = figure.axes
    (legend,) = figure.legends
    assert not legend.get_window_extent().overlaps(top.get_window_extent())
    boxes = [text.get_window_extent() for text in top.texts]
    floors = top.transData.transform((0, 1.0))[1], slope.get_window_extent().y0
    for axes, floor in zip((top, slope), floors, strict=True):
        words, inside = [text.get_window_extent() for text in axes.texts], axes.get_window_extent()
        assert not overlapping(words)
        for box in words:
            assert inside.x0 < box.x0 < box.x1 < inside.x1
            assert floor < box.y0 < box.y1 < inside.y1
    assert "[dB]" in slope.get_xlabel()
    assert len(top.lines) == 4 * len(boxes)
    # distinct without colour: two solid lines of different width, and dashes
    for axes in (top, bottom):
        lines = axes.lines[:4] if axes is top else axes.lines
        styles = {
            (dashes(line), line.get_linewidth(), line.get_color() == "black") for line in lines
        }
        assert len(styles) == len(lines)


def test_of_many_runs_some_are_drawn():
    figure = analyses.montecarlo(load_scenario().with_analysis(runs=600)).plot()
    top, bottom = figure.axes
    assert "Error" in bottom.get_ylabel()
    passes = np.exp(top.images[0].get_array().filled(-np.inf))
    assert passes.sum(axis=0).min() >= 500  # each run passes each column
    assert any("500 of 600 runs" in text.get_text() for text in figure.legends[0].get_texts())


def test_very_many_poses_make_a_small_file():
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 0.0175})
    few = s.at_poses(slice(0, None, 400))
    result = analyses.variance(few, threshold=0.9, method="linear")
    x, noise = s.axis.values, 0.1 * np.random.default_rng(1).standard_normal(len(s.axis))
    drawn = result.draw.keywords
    names = ("p_d", "lower", "upper", "error")
    rows = {name: np.interp(x, few.axis.values, getattr(drawn["band"], name)) for name in names}
    band = Band(**{name: row + noise for name, row in rows.items()})
    many = Result(s)
    many.table.add("violated", (noise > 0).astype(float), "")
    figure = plotting.draw(partial(result.draw, result=many, band=band), "")
    (axes,) = figure.axes
    assert len(axes.patches) + len(axes.collections) == 2  # the band and all that is violated
    assert len(plotting.render(figure, "pdf")) < 300_000


@pytest.mark.parametrize("count", [10_000, 10_001])
def test_a_line_of_many_points_is_a_picture(count):
    """A million points of a vector are 10 MB and a minute."""
    axes = Figure().subplots()
    x = np.linspace(0, 1, count)
    plotting.draw_line(axes, x, x**2, ("black", "-"))
    plotting.coloured_line(axes, x, x**2, x, "viridis", "route")
    assert len(axes.lines[0].get_xdata()) == count
    assert {bool(line.get_rasterized()) for line in (axes.lines[0], *axes.collections)} == {
        count > 10_000
    }


@pytest.mark.parametrize("count", [2, 40, 5_000])
@pytest.mark.parametrize("falling", [False, True])
def test_the_picture_of_runs_counts_the_runs_through_each_pixel(count, falling):
    """Each run is a connected line from its lowest value to its highest; peaks are not cut off."""
    rng = np.random.default_rng(1)
    x, rows = np.linspace(0, 360, count), 0.1 * rng.random((3, count)) + [[0.0], [0.4], [0.8]]
    rows[1, count // 2] = 0.6  # a peak at one pose
    axes = Figure().subplots()
    plotting.draw_sample_paths(axes, x[::-1] if falling else x, rows, "runs")
    (picture,) = axes.images
    passes = np.exp(picture.get_array().filled(-np.inf))
    height = len(passes)
    left, right, low, high = picture.get_extent()
    assert (left, right) == (0, 360)
    assert (low, high) == (rows.min(), rows.max())
    middles = low + (np.arange(height) + 0.5) * (high - low) / height
    for row in rows:
        of_row = abs(middles - np.mean([row.min(), row.max()])) <= np.ptp(row) / 2 + 1 / height
        assert np.all(passes[of_row].max(axis=0) >= 1)  # no gap in any column
        (seen,) = np.nonzero(passes[of_row].max(axis=1) > 0)
        assert np.all(np.diff(seen) == 1)
        assert middles[of_row][seen[-1]] == pytest.approx(row.max(), abs=1 / height)
        assert middles[of_row][seen[0]] == pytest.approx(row.min(), abs=1 / height)
    assert passes.size < 400_000  # however many poses there are
    if count == 40:  # one run passes a pixel once or, at a pose, twice
        assert passes.max() <= 2
    between = (middles > 0.62) & (middles < 0.78)
    assert passes[between].max() == 0


@pytest.mark.parametrize("name", ["montecarlo", "map", *POLAR])
def test_axes_of_ones_own(name):
    """The figure has what `plot()` draws, on these axes and no others but colour bars."""
    analysis, kinds = POLAR.get(name, (ALL.get(name, analyses.map), None))
    coarse = {"map": {"step_km": 50}, "range": {"step_deg": 30}}.get(name, {})
    result = analysis(load_scenario(), **coarse)
    count = len([axes for axes in result.plot().axes if axes.get_label() != "<colorbar>"])
    figure = Figure()
    kinds_of = enumerate(kinds or [None] * count)
    own = [figure.add_subplot(count, 1, i + 1, projection=kind) for i, kind in kinds_of]
    assert result.plot(ax=own) is figure
    assert [a for a in figure.axes if a.get_label() != "<colorbar>"] == own
    for axes, drawn in zip(own, result.plot().axes, strict=False):
        assert len(axes.lines) == len(drawn.lines)
        assert axes.get_ylabel() == drawn.get_ylabel()
    FigureCanvasAgg(figure).draw()
    with pytest.raises(ValueError, match=f"^this figure has {count} panels, got {count + 1} axes"):
        result.plot(ax=[*own, own[0]])
    if kinds:
        with pytest.raises(ValueError, match="panel 1 of this figure needs axes of"):
            result.plot(ax=Figure().subplots(count, squeeze=False)[:, 0])


def test_the_layout_of_ones_own_figure_stays():
    """A layout cannot be changed beside a colour bar, and it is not the map's to change."""
    result = analyses.map(load_scenario(), step_km=50)
    figure = Figure(layout="tight")
    left, right = figure.subplots(1, 2)
    figure.colorbar(left.imshow(np.eye(2)), ax=left)
    engine = figure.get_layout_engine()
    assert result.plot(ax=right) is figure
    assert figure.get_layout_engine() is engine
    axes = Figure().subfigures(1, 2)[0].subplots()
    assert result.plot(ax=axes) is axes.get_figure(root=True)
    assert axes.images
