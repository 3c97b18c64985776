"""The command line: one command an analysis, and `check` and `init`; no numbers.

`--help` needs no NumPy: an analysis is imported only for its own command.
"""

from __future__ import annotations

import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click
from click.shell_completion import CompletionItem

from radar_sense import __version__
from radar_sense.limits import FORMATS, STYLES, Limit

if TYPE_CHECKING:
    from radar_sense.analyses.contract import Command, Option
    from radar_sense.scenario import Scenario

#: Module of each analysis, and the first line of its docstring for `--help`.
ANALYSES: dict[str, tuple[str, str]] = {
    "budget": (
        "radar_sense.analyses.budget:budget",
        "Error budget: 3 sigma of P_D from each source alone.",
    ),
    "compare": (
        "radar_sense.analyses.compare:compare",
        "Bounds of P_D by every method against Monte Carlo.",
    ),
    "convergence": (
        "radar_sense.analyses.convergence:convergence",
        "Error of Monte Carlo by number of runs, for random and Sobol' draws.",
    ),
    "detectors": (
        "radar_sense.analyses.detectors:detectors",
        "P_D of every detector, the error of North's approximation, and the integration of pulses.",
    ),
    "map": (
        "radar_sense.analyses.coverage_map:coverage_map",
        "P_D over an area at one height and course.",
    ),
    "mission": (
        "radar_sense.analyses.mission:mission",
        "Cumulative P_D over the looks along a path.",
    ),
    "montecarlo": (
        "radar_sense.analyses.montecarlo:montecarlo",
        "Monte Carlo draws of P_D against the band of a method.",
    ),
    "range": (
        "radar_sense.analyses.detection_range:detection_range",
        "How far each radar detects the aircraft, by bearing or by aspect.",
    ),
    "rcs": (
        "radar_sense.analyses.rcs:rcs",
        "The radar cross section by aspect: a polar cut and a map.",
    ),
    "sensitivity": (
        "radar_sense.analyses.sensitivity:sensitivity",
        "3 sigma of P_D for every level of radar uncertainty.",
    ),
    "validate": (
        "radar_sense.analyses.validate:validate",
        "May a method be trusted here? A verdict by adaptive Monte Carlo.",
    ),
    "variance": (
        "radar_sense.analyses.variance:variance",
        "Standard deviation of P_D along the geometry.",
    ),
}

#: Likewise the commands that gather several analyses.
REPORTS: dict[str, tuple[str, str]] = {
    "report": (
        "radar_sense.reporting.command:report",
        "One HTML page: the questions about a scenario, and the answers.",
    ),
}
#: Default limit of threads. More threads are no faster, and each takes some 25 MB.
MOST_THREADS = 8
#: Seconds before a computation shows its progress.
PATIENCE = 1.0
#: Exit code of a complete run with a failed test.
ANSWER_IS_NO = 3


class BadInput(click.ClickException):
    """Input that the user can correct; one line and exit code 2."""

    exit_code = 2


@dataclass
class Run:
    """A run of the tool.

    Attributes:
        command: The command line.
        written: Whether the files of the run are in place.
    """

    command: tuple[str, ...]
    written: bool = False


class Cli(click.Group):
    """The group of commands. Every error is one line on standard error."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return sorted({*ANALYSES, *REPORTS, *self.commands})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command. Commands of analyses are made from the analyses."""
        if cmd_name not in {*ANALYSES, *REPORTS}:
            return super().get_command(ctx, cmd_name)
        return command_of(load(cmd_name))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing an analysis."""
        with formatter.section("Commands"):
            formatter.write_dl(self._lines())

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return the matching commands and options without importing an analysis."""
        return [
            *(
                CompletionItem(n, help=text)
                for n, text in self._lines()
                if n.startswith(incomplete)
            ),
            *click.Command.shell_complete(self, ctx, incomplete),
        ]

    def _lines(self) -> list[tuple[str, str]]:
        """Return the commands, each with the first line of its help."""
        lines = {name: text for name, (_, text) in {**ANALYSES, **REPORTS}.items()}
        lines |= {name: c.get_short_help_str(100) for name, c in self.commands.items()}
        return sorted(lines.items())

    def main(self, args: Any = None, *rest: Any, **options: Any) -> NoReturn:
        """Run a command and exit with its code."""
        args = list(sys.argv[1:] if args is None else args) or ["--help"]
        run = Run(("radar-sense", *args))
        options.update(standalone_mode=False, obj=run)
        try:
            with _sigterm_interrupts():
                code = super().main(args, *rest, **options)
        except click.ClickException as error:
            _complain(f"Error: {error.format_message()}")
            code = error.exit_code
        except (click.Abort, KeyboardInterrupt):
            _complain(f"Interrupted; {'all files were' if run.written else 'nothing was'} written.")
            code = 130
        except BrokenPipeError:
            # The output is closed. The null device avoids a second error when Python flushes.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        except OSError as error:
            _complain(f"Error: {error}{'; all files were written' if run.written else ''}")
            code = 1
        except MemoryError:
            _complain("Error: out of memory; use fewer poses, runs, cells or --workers")
            code = 1
        except RuntimeError as error:
            if "start new thread" not in str(error):
                raise
            _complain("Error: no more threads can be started; use fewer --workers")
            code = 1
        sys.exit(code)


def _complain(message: str) -> None:
    """Print one line on standard error, if standard error is open."""
    from radar_sense.errors import printable

    with suppress(OSError, ValueError):
        click.echo(printable(" ".join(message.split())), err=True)


@contextmanager
def _sigterm_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at SIGTERM, as Ctrl-C does."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


class Number(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A number within a limit. `1e6` is a whole number."""

    name = "N"

    def __init__(self, limit: Limit) -> None:
        self.limit = limit

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Turn the text of an option into an int or a float."""
        try:
            # An int directly, because a seed may have more digits than a float.
            text = str(value).replace("_", "?")  # 1_000 is a number in Python only
            number = int(text) if text.lstrip("+-").isdecimal() else float(text)
        except ValueError:
            number = math.nan
        if not self.limit.allows(number):
            self.fail(f"must be {self.limit}, got {value!r}", param, ctx)
        return int(number) if self.limit.whole else number


@click.group(cls=Cli, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="radar-sense")
def cli() -> None:
    """How sure can you be of a radar's probability of detection?

    CONFIG is a scenario file. Without CONFIG, the scenario of the paper is used.
    Every analysis writes a CSV table (map: NPZ), a figure, and a JSON record of the inputs.

    \b
    Examples:
      radar-sense budget                    the paper's error budget, into figures/
      radar-sense init my.yaml              a scenario of your own to start from
      radar-sense montecarlo my.yaml        is the linearization good enough?
    """


def load(name: str) -> Command:
    """Import an analysis or a report."""
    where, _ = {**ANALYSES, **REPORTS}[name]
    module, _, function = where.partition(":")
    command: Command = getattr(import_module(module), function)
    return command


def command_of(analysis: Command) -> click.Command:
    """Make the command of an analysis: its options, then the options of the output."""
    examples = "".join(f"\n  {line}" for line in analysis.examples)
    return click.Command(
        analysis.name,
        callback=click.pass_obj(lambda run, **options: _run(analysis, run, **options)),
        params=[_config(), *map(_option, analysis.options), *_output(analysis)],
        help=f"{analysis.help}\n\n\b\nExamples:{examples}",
    )


def _option(option: Option) -> click.Option:
    default = option.default_text and f"  [default: {option.default_text}]"
    several: dict[str, Any] = {} if option.count == 1 else {"nargs": option.count}
    return click.Option(
        [f"--{option.name.replace('_', '-')}"],
        help=option.help + default,
        is_flag=option.flag,
        multiple=option.multiple,
        metavar=None if option.flag else option.metavar,
        type=None if option.limit is None else Number(option.limit),
        default=option.default,
        show_default=option.default is not None and not option.flag,
        shell_complete=lambda ctx, _, start: _complete(option, ctx, start),
        **several,
    )


def _complete(option: Option, ctx: click.Context, start: str) -> list[CompletionItem]:
    """Return the matching values of an option, from its choices or from the scenario."""
    from radar_sense.errors import InputError

    words: Iterable[str] = option.words
    if option.name in ("level", "radar"):
        # click puts the arguments before an incomplete option into ctx.args
        config = ctx.params.get("config") or next(iter(ctx.args), None)
        with suppress(InputError):  # an unreadable file has no choices
            scenario = _scenario(Path(config) if config else None)
            words = scenario.cov_radar if option.name == "level" else scenario.model.names
    return [CompletionItem(word) for word in words if word.startswith(start)]


def _config() -> click.Argument:
    return click.Argument(["config"], required=False, type=click.Path(path_type=Path))


def _quiet() -> click.Option:
    return click.Option(["-q", "--quiet"], is_flag=True, help="Print nothing but errors.")


def _output(analysis: Command) -> list[click.Parameter]:
    out = click.Option(
        ["--out"],
        metavar="DIR",
        default="figures",
        show_default=True,
        type=click.Path(path_type=Path),
        help="Folder to write to.",
    )
    if not analysis.has_figures:
        return [out, _quiet()]
    return [
        out,
        click.Option(
            ["--format", "formats"],
            multiple=True,
            default=["png"],
            show_default=True,
            type=click.Choice(analysis.formats),
            help="Format of the figure"
            + (", or of the map on the earth" if "geojson" in analysis.formats else "")
            + "; may be given several times.",
        ),
        click.Option(
            ["--style"],
            default=STYLES[0],
            show_default=True,
            type=click.Choice(STYLES),
            help="Size of the figure.",
        ),
        click.Option(["--no-plot"], is_flag=True, help="Write no figure."),
        _quiet(),
    ]


def _run(
    analysis: Command,
    run: Run,
    *,
    config: Path | None,
    out: Path,
    quiet: bool,
    formats: tuple[str, ...] = (),
    style: str = STYLES[0],
    no_plot: bool = False,
    dask: str | None = None,
    workers: int | None = None,
    **options: Any,
) -> None:
    """Read the scenario, compute, write all files, and print the report and the file names."""
    from radar_sense import files
    from radar_sense.errors import printable

    chosen = {name: value for name, value in options.items() if value not in (None, ())}
    formats = () if no_plot else tuple(dict.fromkeys(formats))
    with _refusals():
        scenario = _scenario(config)
        selected = analysis.selected(scenario, **chosen)
    if scenario.origin is None and set(formats) - set(FORMATS):
        raise BadInput(
            f"--format {' and '.join(sorted(set(formats) - set(FORMATS)))}: needs geometry.origin, "
            "which scenarios with a route in latitude and longitude have"
        )
    stem = analysis.stem(selected)
    paths = [out / f"{stem}.{ending}" for ending in (*analysis.endings, *formats)]
    try:
        files.require_writable(paths, _inputs(config, scenario))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInput(f"--out: cannot write to {out}: {reason}") from error
    with _refusals(), _computing(analysis, workers, dask, quiet) as computing:
        result = analysis(scenario, **chosen, **computing)
    try:
        with _plain_matplotlib():
            size = {"style": style} if analysis.has_figures else {}
            written = result.write(out, formats, command=run.command, **size)
    except files.InterruptedAfterWriting:
        run.written = True
        raise
    run.written = True
    if not quiet:
        for line in result.report:
            click.echo(line)
        for warning in result.warnings:
            _complain(f"Warning: {warning}")
        if written.replaced:
            click.echo(printable(f"replaced the files of: {written.replaced}"))
        for path in written.removed:
            click.echo(printable(f"removed {path}: a figure of other numbers"))
        for path in written.paths:
            click.echo(printable(click.format_filename(path)))
    if written.figure_error is not None:
        raise click.ClickException(str(written.figure_error))
    if not result.passed:
        raise click.exceptions.Exit(ANSWER_IS_NO)


def _inputs(config: Path | None, scenario: Scenario) -> list[Path]:
    """Return the input files of a run."""

    def named(content: object) -> Iterator[Path]:
        if isinstance(content, Mapping):
            for key, value in content.items():
                if key == "file":
                    yield Path(value)
                else:
                    yield from named(value)

    return [*([] if config is None else [config]), *named(scenario.resolved())]


@contextmanager
def _plain_matplotlib() -> Iterator[None]:
    """Load Matplotlib without settings of the user, and without messages."""
    logger, level = logging.getLogger("matplotlib"), logging.getLogger("matplotlib").level
    settings = {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
    before = {name: os.environ.get(name) for name in settings}
    logger.setLevel(logging.CRITICAL)
    os.environ.update(settings)
    try:
        yield
    finally:
        logger.setLevel(level)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@cli.command(params=[_config(), _quiet()])
def check(config: Path | None, quiet: bool) -> None:
    """Read, validate and print a scenario in full; compute nothing.

    The output is a scenario file with every default filled in. Comments at the top summarize the
    radars and the path.

    \b
    Examples:
      radar-sense check
      radar-sense check my.yaml
    """
    from radar_sense.analyses.overview import overview
    from radar_sense.analyses.verdicts.plausibility import plausibility_warnings
    from radar_sense.files import yaml_text

    with _refusals():
        scenario = _scenario(config)
    if not quiet:
        for line in overview(scenario):
            click.echo(f"# {line}")
        click.echo(yaml_text(scenario.resolved()), nl=False)
        for warning in plausibility_warnings(scenario):
            click.echo(f"Warning: {warning}", err=True)


@cli.command()
@click.argument("file", default="scenario.yaml", type=click.Path(path_type=Path))
@click.option("--network", is_flag=True, help="Start from several radars.")
@click.option("--route", is_flag=True, help="Start from a flight; its route is written as CSV too.")
@click.option("--data-sheet", is_flag=True, help="Start from a radar by its data sheet.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def init(file: Path, quiet: bool, **kinds: bool) -> None:
    """Write a commented scenario to start from.

    FILE is scenario.yaml by default; - writes to the terminal. The JSON Schema of the file is
    written into the same folder, for editors with the YAML language server. No file is overwritten,
    except for the schema of another version.

    \b
    Examples:
      radar-sense init
      radar-sense init my.yaml
      radar-sense init --route flight.yaml
      radar-sense init --network radars.yaml
    """
    from radar_sense.errors import printable
    from radar_sense.files import write
    from radar_sense.reading.starters import is_old_schema, starter_files, starter_text

    chosen = [kind for kind, flag in kinds.items() if flag]
    if len(chosen) > 1:
        options = " and ".join(f"--{kind.replace('_', '-')}" for kind in chosen)
        raise BadInput(f"{options} exclude each other; give one of them")
    kind = "".join(chosen)
    if str(file) == "-":
        if kind == "route":
            raise BadInput("--route writes two files, and - is the terminal; give a name")
        click.echo(starter_text(kind), nl=False)
        return
    try:
        contents = starter_files(kind, file)
        paths = [file.parent / name for name in contents]
        for path in paths:
            if (path.exists() or path.is_symlink()) and not is_old_schema(path):
                raise BadInput(f"{path}: exists already; choose another name")
        new_folder = not file.parent.exists()
        write(file.parent, contents)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        reason = getattr(error, "strerror", None) or error
        raise BadInput(f"{file}: cannot be written: {reason}") from error
    if not quiet:
        first, *others = map(str, paths)
        folder = f"; the folder {file.parent} is new" if new_folder else ""
        click.echo(printable(f"{first} written, with {' and '.join(others)}{folder}"))
        click.echo(printable(f"next: radar-sense check {first}"))


@cli.command()
def schema() -> None:
    """Print the JSON Schema of the scenario file, for editors.

    `init` writes the schema into the folder of a scenario. The first line of the scenario names
    the schema for the editor.

    \b
    Examples:
      radar-sense schema
    """
    from radar_sense.schema import text

    click.echo(text(), nl=False)


def _scenario(config: Path | None) -> Scenario:
    from radar_sense.reading.parse import load_scenario

    return load_scenario(config)


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn the errors of the package into errors of the command line."""
    from radar_sense.errors import ComputationError, InputError

    try:
        yield
    except InputError as error:
        raise BadInput(str(error)) from error
    except ComputationError as error:
        raise click.ClickException(str(error)) from error


def _threads(workers: int | None) -> int:
    return workers or min(os.cpu_count() or 1, MOST_THREADS)


@contextmanager
def _computing(
    analysis: Command, workers: int | None, dask: str | None, quiet: bool
) -> Iterator[Mapping[str, Any]]:
    """Return the arguments for threads, cluster and progress."""
    arguments: dict[str, Any] = {}
    with ExitStack() as stack:
        if not quiet and sys.stderr is not None and sys.stderr.isatty():
            if "progress" in analysis.keywords:
                arguments["progress"] = _progress
            else:
                stack.enter_context(_computing_line(analysis.name))
        if dask is not None:
            from radar_sense.montecarlo.cluster import cluster

            arguments["executor"], threads = stack.enter_context(cluster(dask))
            arguments["workers"] = workers or threads
        elif "workers" in analysis.keywords:
            arguments["workers"] = _threads(workers)
        yield arguments


@contextmanager
def _delayed(show: Callable[[], None]) -> Iterator[threading.Timer]:
    """Call a function in a thread after PATIENCE seconds, unless the context ends first."""
    timer = threading.Timer(PATIENCE, show)
    timer.daemon = True
    timer.start()
    try:
        yield timer
    finally:
        timer.cancel()
        timer.join()


@contextmanager
def _computing_line(name: str) -> Iterator[None]:
    """Show the progress of an analysis on the terminal: the steps done, and all steps."""
    from radar_sense.progress import listening

    line, shown = f"{name}: computing ...", False
    lock = threading.Lock()

    def draw(text: str) -> None:
        nonlocal line
        click.echo(f"\r{text:{len(line)}}", nl=False, err=True)
        line = text

    def show() -> None:
        nonlocal shown
        with lock:
            shown = True
            draw(line)

    def update(what: str, done: int, total: int) -> None:
        nonlocal line
        text = f"{name}: {done:,} of {total:,} {what}"
        with lock:
            if shown:
                draw(text)
            else:
                line = text

    with _delayed(show), listening(update):
        try:
            yield
        finally:
            if shown:
                click.echo("\r" + " " * len(line) + "\r", nl=False, err=True)


@contextmanager
def _progress(total: int, what: str) -> Iterator[Callable[[int], None]]:
    """Show progress on standard error after PATIENCE seconds."""
    started = time.monotonic()
    lock = threading.Lock()

    def rate(_: object) -> str:
        return f"{bar.pos / max(time.monotonic() - started, 1e-3):,.0f} {what}/s"

    bar: Any = click.progressbar(
        length=total, label=what, show_pos=True, item_show_func=rate, file=sys.stderr
    )
    shown = False

    def show() -> None:
        nonlocal shown
        with lock:
            shown = True
            bar.render_progress()

    def advance(steps: int) -> None:
        with lock:
            if shown:
                bar.update(steps)
            else:  # the bar is not drawn yet
                bar.make_step(steps)

    with _delayed(show):
        try:
            yield advance
        finally:
            if shown:
                bar.render_finish()
