"""The pages of docs/: commands run and print the output shown, and links have targets."""

import re
import shlex
import subprocess
from functools import cache

import click
import pytest
from click.testing import CliRunner
from helpers import CONFIGS, ROOT, few_draws, few_judging_draws, some_poses, without_pixels

from radar_sense.cli import cli

PAGES = sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)
#: Pages whose commands make the committed figures, or run elsewhere in the tests.
PARSED_PAGES = {"commands.md", "benchmarks.md"}
#: Commands that take many seconds are parsed, not run.
SLOW = re.compile(r"validate|compare|--runs|corridor|--upper|--lower|configs/mission.yaml|--target")


def pages_with(pattern):
    return [p for p in PAGES if re.search(pattern, p.read_text(encoding="utf-8"), re.MULTILINE)]


def fenced(page, language):
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(page):
    """Yield every command in the console blocks of a page, with the lines shown below it."""
    for block in fenced(page, "console"):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            line, *shown = part.rstrip("\n").split("\n")
            yield line, shown


def parse(line):
    """Insist that click takes a command line."""
    name, *words = shlex.split(line.partition(" > ")[0])[1:]
    command = cli.get_command(click.Context(cli), name)
    assert command is not None, line
    command.make_context(name, words)


def assert_shown(line, shown, printed):
    """Insist that the lines shown are printed in this order, without a gap except at `...`."""
    printed = printed.splitlines()
    gap, at = False, 0
    for wanted in shown:
        if wanted == "...":
            gap = True
            continue
        assert wanted in printed[at:], f"{line}: {wanted!r} is not printed\n" + "\n".join(printed)
        found = printed.index(wanted, at)
        assert gap or found == at, f"{line}: not shown: {printed[at:found]}"
        gap, at = False, found + 1


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with the scenarios of the project in it, which is the current one."""
    (tmp_path / "configs").symlink_to(CONFIGS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(line, *options):
    return CliRunner().invoke(cli, [*shlex.split(line.partition(" > ")[0])[1:], *options])


#: The outcome of a line about the scenario of the paper is the same on every page.
of_the_paper = cache(run)


@pytest.mark.parametrize("page", pages_with(r"^\$ radar-sense"), ids=lambda page: page.stem)
def test_commands_run_and_print_what_is_shown(page, folder, monkeypatch):
    """A command of which nothing is shown runs at some five poses.

    A mission has a quarter of its draws: bounds of the times that are shown are whole looks.
    """
    without_pixels(monkeypatch)
    few_draws(monkeypatch, 2048, replicates=4)
    for line, shown in commands(page):
        if not line.startswith("radar-sense"):
            continue
        parse(line)
        if page.name in PARSED_PAGES or (SLOW.search(line) and page.name != "tutorial.md"):
            continue
        # a figure takes longer than most analyses
        name = line.split()[1]
        writes = name not in ("init", "check", "diff", "schema")
        options = ["--no-plot"] if writes and not any(".png" in row for row in shown) else []
        runner = run if ".yaml" in line or not shown or not writes else of_the_paper
        with pytest.MonkeyPatch.context() as patch:
            short = not shown and "--out" not in line and writes
            if short or "--method form" in line or "s_band" in line:
                few_judging_draws(patch)
            elif ".yaml" in line:
                few_judging_draws(patch, 2**10, 2**13)
            if short:
                if name == "sweep":  # which reads the file for each value
                    options.append("--set=geometry.azimuth_deg.step=60")
                else:
                    some_poses(patch)
                step = {"map": "--step-km=50", "range": "--step-deg=90"}.get(name, "")
                options += [step] * (step.partition("=")[0] not in line)
            result = runner(line, *options)
        # a sweep answers for each value
        answers = re.search("--threshold|--at-least", line) and name != "sweep"
        assert result.exit_code == (3 if answers else 0), f"{line}\n{result.output}"
        if shown:
            warnings = [row for row in shown if row.startswith("Warning: ")]
            assert_shown(line, [row for row in shown if row not in warnings], result.stdout)
            assert set(warnings) <= set(result.stderr.splitlines()), line


@pytest.mark.parametrize("page", pages_with(r"^```python$"), ids=lambda page: page.stem)
def test_python_runs(page, folder, monkeypatch):
    """At some five poses of each scenario."""
    if page.name == "python.md" and page.parent.name == "reference":
        pytest.skip("signatures")
    without_pixels(monkeypatch)
    some_poses(monkeypatch)
    few_judging_draws(monkeypatch)
    if page.name == "where.md":
        assert run("radar-sense map configs/path.yaml --step-km 100 --no-plot").exit_code == 0
    for code in fenced(page, "python"):
        program = compile(code, page.name, "exec")
        if page.name not in PARSED_PAGES:
            exec(program, {})


def test_commands_in_sentences_exist():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for line in re.findall(r"`(radar-sense [^`]+)`", text):
            if "COMMAND" not in line and "<" not in line:
                parse(line)


@pytest.mark.parametrize("page", [*PAGES, *sorted(ROOT.glob("*.md"))], ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith("https://"):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor and file.suffix == ".md":
            headings = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}
            assert anchor in slugs, f"{page.name}: {target}"


def test_each_picture_is_shown_is_made_by_make_and_is_there_once():
    pictures = sorted((ROOT / "docs/figures").glob("*.png"))
    shown = set()
    for page in [*PAGES, ROOT / "README.md"]:
        targets = re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
        shown.update((page.parent / target).resolve() for target in targets)
    assert shown == set(pictures)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (papers,) = re.findall(r"for analysis in (.*);", makefile)
    made = {f"paper_{name}" for name in papers.split()}
    lines = re.findall(r"radar-sense (\w+) (?:configs/(\w+)\.yaml )?.*--out \$\(OUT\)", makefile)
    made |= {f"{config or 'paper'}_{name}" for name, config in lines}
    made |= set(re.findall(r"tests/studies/(\w+)\.py --out \$\(OUT\)", makefile))
    assert made == {picture.stem for picture in pictures}
    tracked = subprocess.run(
        ["git", "ls-files", "*.png", "*.pdf", "*.svg"], cwd=ROOT, capture_output=True, text=True
    )
    if tracked.returncode == 0:  # not in an unpacked archive
        files = [ROOT / name for name in tracked.stdout.split()]
        assert {file.suffix for file in files} == {".png"}
        assert len({file.read_bytes() for file in files}) == len(files)


def test_every_page_is_in_the_navigation():
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    for page in PAGES:
        name = page.relative_to(ROOT / "docs").with_suffix("").as_posix()
        if name != "index":
            assert f"\n{name}\n" in index, name
            assert f"({name}.md)" in index, name


def test_there_are_few_pages():
    """A newcomer finds the way; a new page takes the place of another."""
    assert len(PAGES) + len([*(ROOT / "docs/notebooks").glob("*.ipynb")]) <= 18


def test_no_page_tells_the_history_of_the_code():
    history = r"no longer|used to |as before|previously|at first\b|\bformerly|s before\b"
    for page in PAGES:
        found = re.findall(history, page.read_text(encoding="utf-8"), re.IGNORECASE)
        assert not found or page.parent.name == "reference", (page.name, found)
