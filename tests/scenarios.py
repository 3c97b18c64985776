"""The paper's scenario with changes, for tests: `change("geometry.range_km", 400)` and the like."""

import copy

import yaml

from radar_sense.reading.parse import default_text, parse_scenario

PAPER = yaml.safe_load(default_text().replace("1.7e-4", "1.7e-04"))
PAPER["radar"]["p_fa"] = 1.7e-4  # PyYAML reads 1.7e-4 as text; the package's reader does not


# Level and heading north at 500 km north of the origin, with the radar straight below.
OVERHEAD = {
    "aircraft__attitude_deg": [0, 0, 0],
    "radar__position_m": [500e3, 0, 10e3],
    "geometry__azimuth_deg": {"start": 0, "stop": 0, "step": 1},
    "geometry__azimuth_from": "north",
}


def document(of=PAPER, /, **changes):
    """The paper's document, or another, with other values at key paths, `__` between the keys."""
    changed = copy.deepcopy(of)
    for path, value in changes.items():
        *parents, key = path.split("__")
        where = changed
        for parent in parents:
            where = where[parent]
        where[key] = value
    return changed


def scenario(**changes):
    """The paper's scenario with other values at key paths, `__` between the keys."""
    return parse_scenario(yaml.safe_dump(document(**changes), sort_keys=False))


def write_path(folder, text, name="scenario.yaml", /, **changes):
    """Write a route and a scenario that flies it, with changes; return the scenario's path."""
    (folder / "route.csv").write_text(text)
    content = document(geometry={"type": "path", "file": "route.csv"}, radar__constant=50)
    del content["aircraft"]["attitude_deg"]
    if "std_" in text or "cov_" in text:
        del content["uncertainty"]["aircraft"]
    file = folder / name
    file.write_text(yaml.safe_dump(document(content, **changes), sort_keys=False))
    return file


def legend_off_data(figure):
    """Insist that the legend of a figure that is laid out is on the page, and on no axes."""
    (legend,) = figure.legends
    box, page = legend.get_window_extent(), figure.bbox
    assert box.x0 >= page.x0
    assert box.x1 <= page.x1
    assert box.y1 <= page.y1
    for axes in figure.axes:
        assert not box.overlaps(axes.get_window_extent())
    return legend
