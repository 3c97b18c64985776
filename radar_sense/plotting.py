"""Style and helpers of the figures; the only module that imports Matplotlib.

Figures fit a column of a journal, its page or a slide. Lines differ by dashes as well as by colour.
The legend is outside the axes. Matplotlib is imported in functions, because numbers need no figure,
and without pyplot, which has global state and a slow import.
"""

from __future__ import annotations

import io
import itertools
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from radar_sense.axis import Axis, runs_of
from radar_sense.errors import check_choice
from radar_sense.states import FloatArray
from radar_sense.units import ascii_unit, split_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure as Figure
    from matplotlib.text import Annotation
    from matplotlib.transforms import Bbox


class Style(NamedTuple):
    """The size of a figure.

    Attributes:
        width: Width [in].
        height: Largest height [in].
        scale: Scale of letters, lines and heights; 1 is 8 pt.
        ieee: Whether the figure is as IEEE asks: STIX, units in parentheses, no small print.
    """

    width: float
    height: float
    scale: float
    ieee: bool = False


#: By the names of `limits.STYLES`.
STYLES = {
    "one-column": Style(3.5, 9.0, 1.0),
    "two-columns": Style(7.16, 9.0, 1.0),
    "slides": Style(13.33, 7.5, 1.75),
    "paper": Style(3.5, 9.0, 1.125, ieee=True),
}
DEFAULT_STYLE = "one-column"
_STYLE_OF: WeakKeyDictionary[Figure, Style] = WeakKeyDictionary()
#: Matplotlib's own sizes of ticks.
_MAJOR = (("size", 3.5), ("width", 0.8), ("pad", 3.5))
_MINOR = (("size", 2.0), ("width", 0.6), ("pad", 3.4))
_SETTINGS: dict[Any, Any] = {
    "mathtext.fontset": "dejavusans",
    "axes.grid": True,
    "grid.color": "0.88",
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.frameon": False,
    "legend.handlelength": 2.8,
    "pdf.fonttype": 42,  # TrueType, which keeps text in a PDF searchable
    "svg.hashsalt": "radar-sense",  # the same figure must give the same bytes
    "savefig.dpi": 300,
}
#: Settings in points, for a scale of 1.
_POINTS: dict[Any, float] = {
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 7.5,
    "legend.fontsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.labelpad": 4,
    "axes.titlepad": 6,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 6,
    "patch.linewidth": 1,
    **{f"{axis}tick.major.{name}": size for axis in "xy" for name, size in _MAJOR},
    **{f"{axis}tick.minor.{name}": size for axis in "xy" for name, size in _MINOR},
}
#: Heights of a row of the legend and of the footer [in], for letters of 8 pt.
_LEGEND_ROW, _FOOTER_ROW = 0.16, 0.12
#: Most labels in a legend with letters of 7.5 pt. More have letters of 6 pt.
MOST_LARGE = 12
#: Letters of the footer in a line of a figure that is one column wide, if they are wide.
_FOOTER_LETTERS = 68
#: Colours of differing lightness (Okabe and Ito's set) with a dash pattern each.
LINES: tuple[tuple[str, Any], ...] = (
    ("#0072B2", "-"),
    ("#D55E00", (0, (5, 1.5))),
    ("#009E73", (0, (1.2, 1.2))),
    ("#CC79A7", (0, (5, 1.5, 1.2, 1.5))),
    ("#56B4E9", (0, (8, 2))),
    ("#E69F00", (0, (3, 1, 1.2, 1, 1.2, 1))),
)
BAND = LINES[1]
#: Of what radars share, neighbours in the legend.
GREYS = "0.6", "0.3"
#: Colours where one run passes, and where most do.
SAMPLE_PATH_COLOURS = "0.85", "0.55"
#: Columns and rows of the picture of runs; a column of a journal has some 900 pixels.
_PICTURE = 800, 400
#: Names of the angles of `set_compass`: bearings, and azimuths in the body frame.
BEARINGS = ("N", "45", "E", "135", "S", "225", "W", "315")
ASPECTS = ("nose 0", "45", "90", "135", "tail 180", "-135", "-90", "-45")
#: A line this near to the number of a ring, in parts of the radius, would run through it.
_BESIDE = 0.12
#: The number of a ring this near to the rim would lie on it, in parts of the radius.
_BESIDE_RIM = 0.06
#: Lines of more points are pixels in a PDF or SVG, where a million points take 10 MB.
MOST_POINTS = 10_000


def styles(*taken: tuple[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield styles of lines, without the colours of the styles that are taken.

    Each round gives a colour another dash pattern. With two styles taken, 24 lines differ.
    """
    places = [place for place, style in enumerate(LINES) if style not in taken]
    for turn in itertools.count():
        for place in places:
            yield LINES[place][0], LINES[(place + 2 * turn + turn // 3) % len(LINES)][1]


def radar_styles(names: Sequence[str]) -> dict[str, tuple[str, Any]]:
    """Return the style of each radar, which is the same in every figure of a scenario."""
    return dict(zip(names, styles(BAND), strict=False))


def source_styles(sources: Sequence[str], radars: Sequence[str]) -> dict[str, tuple[str, Any]]:
    """Return the style of each source. In a network radars have colours, all others are greys."""
    if not radars:
        return dict(zip(sources, styles(), strict=False))
    others = [name for name in sources if name not in radars]
    dashes = [LINES[(i + i // len(LINES)) % len(LINES)][1] for i in range(len(others))]
    greys = zip(itertools.cycle(GREYS), dashes, strict=False)
    return dict(zip(others, greys, strict=True)) | radar_styles(radars)


def draw(plot: Callable[[Figure], object], footer: str, style: str = DEFAULT_STYLE) -> Figure:
    """Return a new figure, with a footer of small print, or raise ValueError for no such style."""
    from matplotlib.figure import Figure

    check_choice("style", style, STYLES)
    page = STYLES[style]
    with apply_style(page):
        figure = Figure(figsize=(page.width, page.width), layout="constrained")
        _STYLE_OF[figure] = page
        # The layout keeps a label of the figure clear of the axes and their labels.
        _small_print(figure, "" if page.ieee else footer)
        plot(figure)
        if page.ieee:
            of_axes = [label for a in figure.axes for label in (a.xaxis.label, a.yaxis.label)]
            of_legends = [text for legend in figure.legends for text in legend.get_texts()]
            for text in (*of_axes, *of_legends):
                text.set_text(re.sub(r" \[([^]]+)\]", r" (\1)", text.get_text()))
    return figure


class Given:
    """One's own axes in place of the panels of a new figure.

    Sizes, titles and the legend above a figure have no meaning there: the legend is on the first
    axes.
    """

    def __init__(self, axes: Sequence[Axes]) -> None:
        self.axes = list(axes)

    def subplots(self, rows: int = 1, columns: int = 1, **options: Any) -> Any:
        """Return the axes in the place of new ones, or raise ValueError if they do not fit."""
        polar = options.get("subplot_kw", {})
        panels = [self.add_subplot(place, **polar) for place in self.add_gridspec(rows, columns)]
        return panels[0] if options.get("squeeze", True) else np.array(panels).reshape(rows, -1)

    def add_gridspec(self, rows: int, columns: int, **_: Any) -> range:
        """Return the numbers of the panels."""
        panels = rows * columns
        if len(self.axes) != panels:
            raise ValueError(
                f"this figure has {panels} panels, got {len(self.axes)} axes: ax needs one each"
            )
        return range(panels)

    def add_subplot(self, panel: int, projection: str | None = None) -> Axes:
        """Return the axes of a panel."""
        axes = self.axes[panel]
        if projection == "polar" and axes.name != "polar":
            raise ValueError(f"panel {panel + 1} of this figure needs axes of projection='polar'")
        return axes

    def legend(self, handles: Any, labels: Any, **_: Any) -> Any:
        """Put the legend on the first axes."""
        return self.axes[0].legend(handles, labels)

    def get_supxlabel(self) -> str:
        """Return no small print."""
        return ""

    def set_figheight(self, _: object) -> None:
        """Leave the figure as it is."""

    set_layout_engine = set_figheight

    def __getattr__(self, name: str) -> Any:
        return getattr(self.figure, name)

    @property
    def figure(self) -> Figure:
        """One's own figure; of a subfigure the whole."""
        return self.axes[0].figure.figure


def draw_on(plot: Callable[[Any], object], axes: Axes | Sequence[Axes]) -> Figure:
    """Draw on one's own axes, and return their figure."""
    given = Given(np.ravel(np.asarray(axes, dtype=object)).tolist())
    plot(given)
    return given.figure


def points(size: float) -> float:
    """Return a size, in points or inches, in the scale of the style."""
    from matplotlib import rcParams

    return size * float(rcParams["font.size"]) / _POINTS["font.size"]


def nominal_width(figure: Figure) -> float:
    """Return the width of a figure [in] for letters of 8 pt."""
    return figure.get_figwidth() / points(1.0)


def colours_of_p_d() -> Colormap:
    """Return the colours of P_D on a map, and a red where there is no value.

    Their lightness grows with P_D, also in a grey print.
    """
    from matplotlib import colormaps

    return colormaps["cividis"].with_extremes(bad="lightcoral")


def add_small_print(figure: Figure, text: str) -> None:
    """Add words to the small print of a figure, on a line of their own."""
    if figure.get_supxlabel():
        _small_print(figure, f"{text}\n{figure.get_supxlabel()}")


def _small_print(figure: Figure, text: str) -> None:
    page = style_of(figure)
    letters = int(_FOOTER_LETTERS * page.width / page.scale / STYLES[DEFAULT_STYLE].width)
    wrapped = "\n".join(textwrap.fill(line, letters) for line in text.splitlines())
    label = figure.supxlabel(
        wrapped, x=0.995, ha="right", fontsize=points(5.5), color="0.45", linespacing=1.0
    )
    label.set_parse_math(False)


def set_height(figure: Figure, inches: float) -> None:
    """Set the height of the axes and their labels, for letters of 8 pt."""
    rows = figure.get_supxlabel().count("\n") + 1
    _set_height(figure, points(inches + _FOOTER_ROW * rows))


def _set_height(figure: Figure, inches: float) -> None:
    """Set the height of a figure, up to the largest of its style."""
    figure.set_figheight(min(inches, style_of(figure).height))


def style_of(figure: Figure) -> Style:
    """Return the style that a figure was drawn in."""
    return _STYLE_OF.get(figure, STYLES[DEFAULT_STYLE])


def render(figure: Figure, kind: str) -> bytes:
    """Return a figure as png, pdf or svg; the same figure gives the same bytes."""
    undated: Mapping[str, Any] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    buffer = io.BytesIO()
    with apply_style(style_of(figure)):
        figure.savefig(buffer, format=kind, metadata=undated.get(kind))
    return buffer.getvalue()


@contextmanager
def apply_style(style: Style) -> Iterator[None]:
    """Apply a style to Matplotlib's defaults, without the user's settings."""
    import matplotlib as mpl

    scaled = {key: style.scale * size for key, size in _POINTS.items()}
    font: dict[Any, Any] = (
        {"font.family": "STIXGeneral", "mathtext.fontset": "stix"} if style.ieee else {}
    )
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({**_SETTINGS, **scaled, **font})
        yield


def contour_lines(
    x: FloatArray, y: FloatArray, values: NDArray[np.floating[Any]], level: float
) -> list[FloatArray]:
    """Return the lines, each x and y (k, 2), where values (n, m) at x (m,) and y (n,) have a level.

    Values are NaN where there is none.
    """
    from contourpy import contour_generator  # Matplotlib's own generator

    lines = contour_generator(x, y, np.ma.masked_invalid(values)).lines(level)
    return [np.asarray(line, dtype=float) for line in lines]


def hex_colour(p_d: float) -> str:
    """Return the colour of P_D on a map as #rrggbb; a bound above 1 has the colour of 1."""
    from matplotlib.colors import to_hex

    return to_hex(colours_of_p_d()(p_d))


def panels(figure: Figure, count: int) -> list[Axes]:
    """Add panels below each other that share an axis."""
    set_height(figure, 0.6 + 1.7 * count)
    return list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def in_lines(name: str, letters: int) -> str:
    """Return a name, broken behind "_" and "-" into lines of at most this many letters."""
    lines = textwrap.wrap(name.replace("_", "_ "), letters)
    return "\n".join(line.replace("_ ", "_") for line in lines)


def set_compass(axes: Any, names: Sequence[str], label: str) -> None:
    """Turn polar axes with lines to 0 at the top and clockwise angles.

    The angles 0, 45, ... 315 deg have names, and the radius a label. The numbers of the rings are
    where most of them are off the lines. A ring beside a line has no number, if others have one.
    There is no ring right beside the rim.
    """
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator

    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4))
    low, high = axes.get_ylim()
    most = high - _BESIDE_RIM * (high - low)
    rings = np.array([ring for ring in axes.get_yticks() if low < ring <= most])
    circle = np.linspace(0.0, 2.0 * np.pi, 721)
    drawn = np.array([np.inf])  # for a figure without lines
    for line in axes.lines:
        angles, distances = line.get_xydata().T
        radii = np.interp(circle, angles, distances, period=2.0 * np.pi)
        drawn = np.append(drawn, (radii - low) * np.exp(1j * circle))

    def free(angle: float) -> NDArray[np.bool_]:
        places = (rings - low) * np.exp(1j * np.deg2rad(angle))
        gap = np.nanmin(abs(places[:, np.newaxis] - drawn), axis=1)
        return gap > _BESIDE * (high - low)

    shown_at = {angle: free(angle) for angle in np.arange(22.5, 360.0, 45.0)}
    angle, shown = max(shown_at.items(), key=lambda at: int(at[1].sum()))
    axes.set_rlabel_position(angle)
    texts = [f"{ring:g}".replace("-", "\N{MINUS SIGN}") for ring in rings]
    numbers = np.where(shown | ~shown.any(), texts, "").tolist()
    rim = withStroke(linewidth=points(2.0), foreground="white")
    size = points(8 if names else 6)
    axes.set_yticks(rings, numbers, ha="center", va="center", fontsize=size, path_effects=[rim])
    axes.set_xticks(np.deg2rad(np.arange(0, 360, 45)))
    axes.set_xticklabels(names)
    axes.set_ylabel(label, labelpad=points(24))


def pose_panels(figure: Figure, count: int, axis: Axis) -> tuple[list[Axes], FloatArray]:
    """Add panels that share the axis of the poses, and return the places (n,) of the poses too."""
    axes = panels(figure, count)
    shown = display_unit(axis)
    coordinates = axis.values / shown.unit
    axes[-1].set_xlabel(shown.label)
    if len(axis) == 1:
        axes[-1].set_xticks(coordinates)
    else:
        span, largest = np.ptp(coordinates), np.max(abs(coordinates))
        steps = shown.steps if span > 10 else DECIMAL  # parts of a degree or second are decimal
        ticks = 7 if span > 0.001 * largest else 3  # of numbers with many digits
        axes[-1].locator_params(axis="x", nbins=ticks, steps=steps)
        axes[-1].ticklabel_format(axis="x", scilimits=(-3, 6))
    for ax in axes:
        ax.margins(x=0)
    return axes, coordinates


def finish(figure: Figure, axes: Axes, label: str) -> None:
    """Finish a figure of one panel that starts at zero, with the legend above."""
    axes.set_ylabel(label)
    from_zero(axes)
    draw_legend(figure, axes)


def key_in_words(key: str) -> str:
    """Return the name of a key in words, with its unit if the name ends with one."""
    words, unit = split_unit(key)[0].replace("_", " "), ascii_unit(key)
    return f"{words} [{unit}]" if unit else words


#: Steps of ticks in the decimal system.
DECIMAL = (1, 2, 2.5, 5, 10)


class DisplayUnit(NamedTuple):
    """The label of an axis, the unit in units of `Axis`, and the steps of the ticks."""

    label: str
    unit: float = 1.0
    steps: Sequence[float] = DECIMAL


#: Time is in seconds, as in all sentences and tables.
_UNITS = {
    "time_s": DisplayUnit("Time [s]", steps=(1, 1.5, 2, 3, 5, 6, 10)),
    "theta_r_deg": DisplayUnit(
        r"Radar azimuth $\theta_r$ [deg]", steps=(1, 1.5, 2, 3, 4.5, 6, 9, 10)
    ),
    "range_km": DisplayUnit("Ground range [km]"),
    "distance_m": DisplayUnit("Distance flown [m]"),
    "pose": DisplayUnit("Number of the pose"),
}


def display_unit(axis: Axis) -> DisplayUnit:
    """Choose the unit of an axis. A long distance is in km."""
    if axis.key == "distance_m" and float(np.ptp(axis.values)) >= 4e3:
        return DisplayUnit("Distance flown [km]", 1e3)
    name, unit = split_unit(axis.name)[0], ascii_unit(axis.name)
    return _UNITS.get(axis.key) or DisplayUnit(f"{name} [{unit}]" if unit else name)


def draw_shade(axes: Axes, mask: NDArray[np.bool_], x: FloatArray, label: str | None) -> None:
    """Shade from half way to the pose before up to half way to the next, where a mask holds."""
    ends = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    if len(x) == 1:
        ends += np.array([-0.5, 0.5])
    spans = [(ends[first], ends[last + 1] - ends[first]) for first, last in runs_of(mask)]
    if spans:
        axes.broken_barh(
            spans,
            (0, 1),
            transform=axes.get_xaxis_transform(),
            color="0.9",
            lw=points(0.6),  # a span of a pose shows
            rasterized=len(spans) > MOST_POINTS,
            zorder=0.9,  # over the grid, under all data
            label=label,
        )


def from_zero(axes: Axes) -> None:
    """Start the vertical axis slightly below zero, to keep a line at zero visible."""
    axes.set_ylim(bottom=-0.02 * axes.get_ylim()[1])


def draw_line(
    axes: Axes, x: FloatArray, y: FloatArray, style: tuple[str, Any], **line: Any
) -> None:
    """Draw a line in a style of `LINES`, and as Matplotlib's `plot`; a single pose as a dot."""
    dot = "o" if len(x) == 1 else None  # a line of one point is invisible
    shown = {"color": style[0], "ls": style[1], "marker": dot, "ms": points(3), **line}
    axes.plot(x, y, rasterized=len(x) > MOST_POINTS, **shown)


def coloured_line(
    axes: Axes,
    x: FloatArray,
    y: FloatArray,
    values: FloatArray,
    colours: Colormap,
    label: str,
) -> None:
    """Draw a line with the colour of a value from 0 to 1 at each point; a single point as a dot.

    A black edge with a white rim keeps the line visible on a map of the same colours.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.patheffects import withStroke

    if len(x) == 1:
        axes.scatter(
            x, y, c=values, cmap=colours, vmin=0, vmax=1, s=points(4) ** 2, ec="black", label=label
        )
        return
    corners = np.column_stack([x, y])
    rims = [
        withStroke(linewidth=points(w), foreground=c) for w, c in ((4.2, "white"), (3.2, "black"))
    ]
    line = LineCollection(
        list(np.stack([corners[:-1], corners[1:]], axis=1)),
        array=0.5 * (values[1:] + values[:-1]),
        cmap=colours,
        clim=(0, 1),
        linewidths=points(1.8),
        capstyle="round",
        rasterized=len(x) > MOST_POINTS,
    )
    # with a butt nothing stands out behind the marks of start and end
    edge: dict[str, Any] = {"path_effects": rims, "solid_capstyle": "butt"}
    axes.plot(x, y, color="black", lw=points(1.8), label=label, **edge)
    axes.add_collection(line)


def mark(axes: Axes, places: FloatArray, marker: str, size: float, label: str) -> None:
    """Mark places north and east (n, 2 or more) on a map, white with a black edge."""
    edge: dict[str, Any] = {"mec": "black", "mew": points(0.7), "ms": points(size)}
    axes.plot(places[:, 1], places[:, 0], marker, color="white", label=label, **edge)


def draw_fill(
    axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, **style: Any
) -> None:
    """Fill between two lines; at a single pose a bar."""
    if len(x) == 1:
        axes.vlines(x, lower, upper, **(style | {"lw": points(6.0), "zorder": 1.5}))
        return
    axes.fill_between(x, lower, upper, rasterized=len(x) > MOST_POINTS, **style)


def draw_band(axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, label: str) -> None:
    """Draw the ends of a band."""
    draw_line(axes, x, upper, BAND, label=label)
    draw_line(axes, x, lower, BAND)


def draw_sample_paths(axes: Axes, x: FloatArray, rows: FloatArray, label: str) -> None:
    """Draw runs (runs, n) as a picture: the more of them pass a pixel, the darker it is.

    Hundreds of lines over each other would be one grey area, and take most of the time of a figure.
    The coordinates x (n,) of the poses rise or fall.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.lines import Line2D

    columns, height = _PICTURE
    order, low, high = np.argsort(x), rows.min(), rows.max()
    if low == high:  # nothing is uncertain
        low, high = low - 0.01, high + 0.01
    # Pieces of the lines between poses and edges of pixels, so that no peak is cut off.
    edges = np.linspace(x.min(), x.max(), columns + 1)
    ends = np.union1d(x, edges)
    column = np.searchsorted(edges, 0.5 * (ends[1:] + ends[:-1])) - 1
    start = column * (height + 1)  # of the column in the changes, which are flat: faster
    changes = np.zeros(columns * (height + 1), dtype=int)
    for row in rows:
        at = np.interp(ends, x[order], row[order])
        pixel = np.minimum((at - low) / (high - low) * height, height - 1).astype(int)
        np.add.at(changes, start + np.minimum(pixel[1:], pixel[:-1]), 1)
        np.add.at(changes, start + np.maximum(pixel[1:], pixel[:-1]) + 1, -1)
    passes = np.cumsum(changes.reshape(columns, height + 1), axis=1)[:, :-1].T
    picture = axes.imshow(
        np.log(np.where(passes > 0, passes, np.nan)),
        cmap=LinearSegmentedColormap.from_list("runs", SAMPLE_PATH_COLOURS, 12),
        extent=(edges[0], edges[-1], low, high),
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        zorder=1,  # over the grid
    )
    picture.sticky_edges.y.clear()  # which leaves a margin above and below
    axes.add_line(Line2D([], [], color=SAMPLE_PATH_COLOURS[1], label=label))


def draw_legend(figure: Figure, *panels: Axes, title: str = "") -> None:
    """Put the labels of panels above them, below a title, in as many columns as there is room."""
    handles, labels = [], []
    for axes in panels:
        of_axes = axes.get_legend_handles_labels()
        handles += of_axes[0]
        labels += of_axes[1]
    size = 7.5 if len(labels) <= MOST_LARGE else 6.0
    letters = (70 if style_of(figure).ieee else 54) * 7.5 / size  # STIX is narrower
    room = int(letters * nominal_width(figure) / STYLES[DEFAULT_STYLE].width)
    width = [7 + len(re.sub(r"\\\w+|[\\${}_^]", "", label)) for label in labels]
    columns = min(max(3, room // 18), max(1, room // max(width)))
    if len(labels) > 6:  # columns of different widths leave room for more columns
        each = range(len(labels), 0, -1)  # the first columns have the most rows
        columns = next(c for c in each if c == 1 or sum(map(max, np.array_split(width, c))) <= room)
    # The figure grows with the legend, to keep the size of the axes.
    rows = -(-len(labels) // columns) + len(title.splitlines())
    _set_height(figure, figure.get_figheight() + points(_LEGEND_ROW * rows * size / 7.5))
    figure.legend(
        handles,
        labels,
        title=title or None,
        title_fontsize=points(7.5),
        fontsize=points(size),
        loc="outside upper center",
        ncols=columns,
        columnspacing=1.2,
    )


def note(
    axes: Axes, text: str, place: tuple[float, float], right: float, up: float, **style: Any
) -> Annotation:
    """Write small letters beside a point, at a distance in points to the right and up."""
    return axes.annotate(
        text,
        place,
        xytext=(points(right), points(up)),
        textcoords="offset points",
        fontsize=points(6.5),
        **{
            "ha": "left" if right > 0 else "right" if right < 0 else "center",
            "va": "bottom" if up > 0 else "top" if up < 0 else "center",
            **style,
        },
    )


def label_points(axes: Axes, places: FloatArray, names: Sequence[str]) -> None:
    """Write names beside points (n, 2) of a panel with a layout.

    A name is to the right of the point, or on the side with the least overlap of axes, points and
    names.
    """
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Bbox

    half = points(2.0) * axes.figure.dpi / 72.0  # of a point, in pixels
    middles = axes.transData.transform(places)
    taken = [Bbox([middle - half, middle + half]) for middle in middles]
    rim = withStroke(linewidth=points(1.6), foreground="black")
    for name, (x, y) in zip(names, places, strict=True):
        options = []
        for right, up in ((4.5, 0.0), (-4.5, 0.0), (0.0, 4.5), (0.0, -4.5)):
            style = {"color": "white", "path_effects": [rim], "clip_on": True}
            text = note(axes, name, (x, y), right, up, **style)
            box = text.get_window_extent()
            outside = box.width * box.height - _common(box, axes.bbox)
            options.append((outside + sum(_common(box, other) for other in taken), text, box))
        best = min(options, key=lambda option: option[0])
        taken.append(best[2])
        for option in options:
            if option is not best:
                option[1].remove()


def _common(box: Bbox, other: Bbox) -> float:
    """Return the area that two boxes have in common."""
    common = box.intersection(box, other)
    return 0.0 if common is None else float(common.width * common.height)
