"""The import rule: a module imports only from storeys below its own."""

import ast
import re
from functools import cache
from pathlib import Path

import radar_sense

PACKAGE = Path(radar_sense.__file__).parent
#: From the top to the bottom. A module imports only from lines below its own, or, in a folder, from
#: other files of the folder without a circle.
STOREYS = (
    ("__main__", "__init__"),
    ("cli",),
    ("scenario_file",),
    ("analyses",),
    ("plausibility",),
    ("words", "page", "options"),
    ("command",),
    ("plotting", "files"),
    ("acceptance", "coverage"),
    ("sources",),
    ("mission",),
    ("montecarlo",),
    ("propagation",),
    ("scenario",),
    ("flight", "source_names"),
    ("uncertain_states",),
    ("model",),
    ("axis", "covariance", "search"),
    ("states", "limits", "streams", "cost", "differences"),
    ("errors", "progress"),
    ("units",),
)
STOREY = {name: i for i, names in enumerate(STOREYS) for name in names}


def modules() -> dict[str, Path]:
    """Return all modules of the package by their dotted names below it."""
    paths = sorted(PACKAGE.rglob("*.py"))
    return {".".join(p.relative_to(PACKAGE).with_suffix("").parts): p for p in paths}


@cache
def trees() -> dict[str, ast.Module]:
    return {name: ast.parse(path.read_text("utf-8")) for name, path in modules().items()}


def imports(path: str, known: dict[str, Path]) -> set[str]:
    """Return the modules of the package that a module imports, wherever in the file."""
    found = set()
    for node in ast.walk(trees()[path]):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            assert not any(name.startswith("radar_sense") for name in names), (path, names)
        if not isinstance(node, ast.ImportFrom):
            continue
        assert node.level == 0, f"{path}: a relative import"
        if not (node.module or "").startswith("radar_sense"):
            continue
        home = (node.module or "").partition(".")[2]
        for alias in node.names:
            inner = f"{home}.{alias.name}".strip(".")
            folder = f"{home}.__init__".strip(".")
            module = next(m for m in (inner, f"{inner}.__init__", home, folder) if m in known)
            assert module != "__init__" or alias.name == "__version__", (path, alias.name)
            found.add(module)
    return found


@cache
def arrows() -> dict[str, set[str]]:
    known = modules()
    return {name: imports(name, known) for name in known}


def test_no_arrow_goes_up():
    """`radar_sense` itself is imported for the version only."""
    wrong = []
    for name, targets in arrows().items():
        for target in targets - {"__init__"}:
            own, other = name.split(".")[0], target.split(".")[0]
            if own != other and STOREY[own] >= STOREY[other]:
                wrong.append(f"{name} imports {target}")
    assert not wrong, wrong


def test_no_circle():
    graph = arrows()
    done: set[str] = set()

    def visit(name: str, above: tuple[str, ...]) -> None:
        assert name not in above, " -> ".join((*above, name))
        if name not in done:
            for target in sorted(graph[name] - {"__init__"}):
                visit(target, (*above, name))
            done.add(name)

    for name in graph:
        visit(name, ())


def test_only_the_command_line_imports_scenario_files():
    """The public names do too, by names in a text."""
    importers = {
        name
        for name, targets in arrows().items()
        if not name.startswith("scenario_file")
        and any(target.startswith("scenario_file") for target in targets)
    }
    assert importers == {"cli"}


def test_modules_are_imported_by_name_in_three_places_only():
    """`imports` does not see a module whose name is text."""
    dynamic = {"import_module", "__import__", "exec", "eval"}
    where = {
        name
        for name, tree in trees().items()
        for node in ast.walk(tree)
        if dynamic & {getattr(node, "id", None), getattr(node, "attr", None)}
        or (isinstance(node, ast.ImportFrom) and dynamic & {a.name for a in node.names})
    }
    assert where == {"cli", "__init__", "analyses.__init__"}


def test_matplotlib_is_imported_in_one_place():
    lines = re.compile("(import|from) matplotlib")
    where = {name for name, path in modules().items() if lines.search(path.read_text("utf-8"))}
    assert where == {"plotting"}


def test_slow_modules_of_scipy_are_imported_where_they_are_used():
    """At the top of a module stand `special` and `constants` only: `optimize` takes 0.17 s."""
    found = set()
    for tree in trees().values():
        for node in tree.body:
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found.add(node.module or "")
    scipy = {name for name in found if name.split(".")[0] == "scipy"}
    assert scipy == {"scipy.special", "scipy.constants"}
