"""The command line: finds the commands, reads the scenario, runs, writes, exit codes; no numbers.

`--help` and `init` need no NumPy: the analyses are imported, all together, for the options or the
run of one of them.
"""

from __future__ import annotations

import logging
import math
import os
import re
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from radar_sense import __version__
from radar_sense.errors import (
    ComputationError,
    FigureError,
    InputError,
    counted,
    describe,
    did_you_mean,
    printable,
    reason,
)
from radar_sense.limits import FORMATS, STYLES, Limit

if TYPE_CHECKING:
    from radar_sense.command import Command, Option
    from radar_sense.scenario import Scenario

#: Groups of commands in the help, and the commands in the order of their use.
GROUPS = {
    "Start": ("init", "check", "variance", "budget", "report"),
    "Trust": ("validate", "compare"),
    "Flight": ("mission", "map", "range"),
}
#: The group of all other commands.
STUDY = "Study"
#: Default limit of threads. More threads are no faster, and each takes some 25 MB.
MOST_THREADS = 8
#: Seconds before a computation shows its progress, and between two displays.
PATIENCE, INTERVAL = 1.0, 0.1
#: A word of the command line that an error quotes in part.
_LONG_WORD = re.compile(r"(\S{1000})\S+")
#: A word that is a number, and no option.
_NEGATIVE = re.compile(r"-\.?[0-9].*")
#: Largest record that is read [bytes].
MOST_RECORD = 2**26
#: Exit code of a complete run with a failed test.
ANSWER_IS_NO = 3


#: Options of several commands.
SET = click.Option(
    ["--set", "changes"],
    multiple=True,
    metavar="KEY=VALUE",
    help="Another value of a key of CONFIG, such as radar.p_fa=1e-8; may be given several times.",
)
OUT = click.Option(
    ["--out"],
    metavar="DIR",
    default="figures",
    show_default=True,
    type=click.Path(path_type=Path),
    help="Folder to write to.",
)
STYLE = click.Option(
    ["--style"],
    default=STYLES[0],
    show_default=True,
    type=click.Choice(STYLES),
    help="Figure of 3.5, 7.16 or 13.33 in, or of 3.5 in as IEEE asks, without small print.",
)
NO_PLOT = click.Option(["--no-plot"], is_flag=True, help="Write no figure.")
JSON = click.Option(["--json"], is_flag=True, help="Print the record in place of the words.")
QUIET = click.Option(["-q", "--quiet"], is_flag=True, help="Print nothing but errors.")


@dataclass
class Run:
    """A run of the tool.

    Attributes:
        command: The command line.
        written: What an interrupt at this moment leaves behind.
    """

    command: tuple[str, ...]
    written: str = "nothing was written"


@cache
def commands() -> Mapping[str, str]:
    """Return the first line of each analysis by the name of its command, which the file has.

    The files are read and not imported. Other files of the folder are shared by commands.
    """
    folder = Path(__file__).parent / "analyses"
    texts = {path.stem: path.read_text("utf-8") for path in sorted(folder.glob("*.py"))}
    return {
        name: text.partition("\n")[0].strip('"')
        for name, text in texts.items()
        if "\n@command(" in text
    }


def load(name: str) -> Command:
    """Import a command."""
    return getattr(import_module("radar_sense.analyses"), name)


class Cli(click.Group):
    """The group of commands. Every error is one line on standard error."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return sorted({*commands(), *self.commands})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command. Commands of analyses are made from the analyses."""
        return command_of(load(cmd_name)) if cmd_name in commands() else self.commands.get(cmd_name)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Find the command; an unknown one is an error with a suggestion."""
        if args[0] not in (known := self.list_commands(ctx)):
            hint = did_you_mean(args[0], known)
            if args[0].endswith((".yaml", ".yml")):
                hint = f"; the command comes first, such as radar-sense check {args[0]}"
            ctx.fail(f"no command {args[0]!r}{hint or ', there are ' + ', '.join(known)}")
        return super().resolve_command(ctx, args)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse options of a command that stand before it."""
        own = {name for option in self.get_params(ctx) for name in option.opts}
        named = [word for word in args if word in self.list_commands(ctx)]
        if args and args[0].startswith("-") and args[0] not in own and named:
            rest = " ".join(word for word in args if word != named[0])
            ctx.fail(f"options follow the command: radar-sense {named[0]} {rest}")
        return super().parse_args(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the groups of commands, each with its first line of help."""
        own = {name: command.get_short_help_str(100) for name, command in self.commands.items()}
        lines = {**commands(), **own}
        grouped = {name for names in GROUPS.values() for name in names}
        groups = {**GROUPS, STUDY: [name for name in sorted(lines) if name not in grouped]}
        for group, names in groups.items():
            with formatter.section(group):
                formatter.write_dl([(name, lines[name]) for name in names])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """Return the matching commands and options without importing an analysis."""
        names = [name for name in self.list_commands(ctx) if name.startswith(incomplete)]
        found = [click.shell_completion.CompletionItem(name) for name in names]
        return [*found, *click.Command.shell_complete(self, ctx, incomplete)]

    def main(self, args: Any = None, *rest: Any, **options: Any) -> NoReturn:
        """Run a command and exit with its code."""
        args = list(sys.argv[1:] if args is None else args) or ["--help"]
        run = Run(tuple(map(printable, ("radar-sense", *args))))
        options.update(standalone_mode=False, obj=run, prog_name="radar-sense")
        try:
            code = super().main(args, *rest, **options)
        except click.ClickException as error:
            _complain(f"Error: {error.format_message()}")
            code = error.exit_code
        except (InputError, ComputationError, FigureError) as error:
            _complain(f"Error: {error}")
            code = 2 if isinstance(error, InputError) else 1
        except (click.Abort, KeyboardInterrupt):
            _complain(f"Interrupted; {run.written}.")
            code = 130
        except OSError as error:
            _complain(f"Error: {error}; {run.written}")
            code = 1
        except MemoryError:
            _complain("Error: out of memory; use fewer poses, runs, cells or --workers")
            code = 1
        sys.exit(code)


class OneCommand(click.Command):
    """A command that refuses a misspelled option, and an option that is given twice."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Check the options before click takes the last of two values."""
        if sum(isinstance(option, click.Argument) for option in self.params) > 1:
            # a space before a negative number, which is no option then
            args = [f" {word}" if _NEGATIVE.fullmatch(word) else word for word in args]
        try:
            _, _, given = self.make_parser(ctx).parse_args(list(args))
        except click.NoSuchOption as error:
            options = [option for option in self.params if isinstance(option, click.Option)]
            known = [option.opts[-1] for option in options]
            # without the dashes, which make all options alike
            hint = did_you_mean(error.option_name[2:], [name[2:] for name in known])
            hint = hint.replace("'", "'--", 1) or f", it has {', '.join(known) or 'none'}"
            ctx.fail(f"{self.name} has no option {error.option_name}{hint}")
        for option in given:
            several = isinstance(option, click.Option) and (option.multiple or option.is_flag)
            if given.count(option) > 1 and not several:
                ctx.fail(f"{option.opts[0]} is given twice; give it once")
        try:
            return super().parse_args(ctx, args)
        except click.MissingParameter:
            _, *usage = self.collect_usage_pieces(ctx)
            ctx.fail(f"{self.name} needs {' '.join(usage)}")


def _complain(message: str) -> None:
    """Print one line on standard error, if standard error is open."""
    line = _LONG_WORD.sub(r"\1...", printable(" ".join(message.split())))
    with suppress(OSError, ValueError):
        click.echo(line, err=True)


class Number(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A number within a limit. `1e6` is a whole number."""

    name = "N"

    def __init__(self, limit: Limit) -> None:
        self.limit = limit

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Turn the text of an option into an int or a float."""
        text = str(value).strip()
        if text.startswith("--"):  # the option behind this one
            needed = counted(param.nargs, "number")
            self.fail(f"needs {needed}; {describe(text)} is none", param, ctx)
        try:
            # An int directly, because a seed may have more digits than a float.
            plain = text.replace("_", "?")  # 1_000 is a number in Python only
            number = int(plain) if plain.lstrip("+-").isdecimal() else float(plain)
        except ValueError:
            number = math.nan
        if not self.limit.allows(number):
            from radar_sense.scenario_file.text_file import advice

            hint = advice(text, self.limit)
            self.fail(f"must be {self.limit}, got {describe(text)}{hint}", param, ctx)
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
      radar-sense montecarlo my.yaml        do draws of the states agree with the band?
    """


def command_of(analysis: Command) -> click.Command:
    """Make the command of an analysis: its options, then the options of the output."""
    examples = "".join(f"\n  {line}" for line in analysis.examples)
    return OneCommand(
        analysis.name,
        callback=click.pass_obj(lambda run, **options: _run(analysis, run, **options)),
        params=[
            *_arguments(analysis),
            *(_option(analysis, option) for option in analysis.options if not option.positional),
            SET,
            *_output(analysis),
        ],
        help=f"{analysis.help}\n\n\b\nExamples:{examples}",
    )


def _option(analysis: Command, option: Option) -> click.Option:
    default = option.default_text and f"  [default: {option.default_text}]"
    # a default in words stands for one that is no single value
    value = None if default else analysis.defaults.get(option.name)
    return click.Option(
        [f"--{option.name.replace('_', '-')}"],
        help=option.meaning + default,
        is_flag=option.flag,
        multiple=option.multiple,
        nargs=option.count,
        metavar=None if option.flag else option.metavar,
        type=option.limit and Number(option.limit),
        default=value,
        show_default=value is not None and not option.flag,
        shell_complete=lambda ctx, _, start: [w for w in option.choices if w.startswith(start)],
    )


def _arguments(analysis: Command) -> Iterator[click.Argument]:
    """Yield the argument CONFIG, and the options that have no name."""

    def one(ctx: click.Context, _: click.Parameter, files: tuple[Path, ...]) -> Path | None:
        if len(files) > 1:
            ctx.fail(f"got an unexpected argument {files[1]}")
        return files[0] if files else None

    # CONFIG may be missing: as words of any number, it is what the arguments behind it leave
    file = click.Path(path_type=Path)
    yield click.Argument(["config"], nargs=-1, type=file, metavar="[CONFIG]", callback=one)
    for option in analysis.options:
        if option.positional:
            yield click.Argument(
                [option.name], metavar=option.metavar, type=option.limit and Number(option.limit)
            )


def _output(analysis: Command) -> list[click.Parameter]:
    """Return the options of the output; a command without files or figures has fewer of them."""
    options: list[click.Parameter] = []
    if analysis.endings:
        options.append(OUT)
    if analysis.formats:
        more = ", or of the map on the earth" if set(analysis.formats) - set(FORMATS) else ""
        formats = click.Option(
            ["--format", "formats"],
            multiple=True,
            default=["png"],
            show_default=True,
            type=click.Choice(analysis.formats),
            help=f"Format of the figure{more}; may be given several times.",
        )
        options += [formats, STYLE, NO_PLOT, JSON]
    return [*options, QUIET]


def _run(
    analysis: Command,
    run: Run,
    *,
    quiet: bool,
    config: Path | None = None,
    changes: tuple[str, ...] = (),
    out: Path = Path(),
    formats: tuple[str, ...] = (),
    style: str = STYLES[0],
    no_plot: bool = False,
    json: bool = False,
    dask: str | None = None,
    workers: int | None = None,
    **options: Any,
) -> None:
    """Read the scenario, compute, write all files, and print the report and the file names."""
    logging.getLogger("radar_sense").setLevel(logging.ERROR if quiet else logging.WARNING)
    logging.getLogger("matplotlib").setLevel(logging.CRITICAL)
    chosen = {name: value for name, value in options.items() if value not in (None, ())}
    formats = tuple(n for n in dict.fromkeys(formats) if not (no_plot and n in FORMATS))
    swept = options.get("key")
    if any(change.partition("=")[0] == swept for change in changes):
        raise click.UsageError(f"--set {swept}: {analysis.name} sets this key itself")
    scenario = _scenario(config, changes)
    selected = analysis.selected(scenario, **chosen)
    on_earth = sorted({*formats}.difference(FORMATS))
    if on_earth and scenario.origin is None:
        raise click.UsageError(
            f"--format {' and '.join(on_earth)}: needs geometry.origin, "
            "which scenarios with a route in latitude and longitude have"
        )
    if analysis.endings:
        stem = f"{selected.name}_{analysis.name}"
        paths = [out / f"{stem}.{ending}" for ending in (*analysis.endings, *formats)]
        _require_writable(out, paths, _inputs(config, scenario))
    with _computing(analysis, workers, dask, quiet) as computing, _options_as_typed(analysis):
        result = analysis(scenario, **chosen, **computing)
    written: list[Path] = []
    failure = None
    if analysis.endings:
        size = {"formats": formats, "style": style} if analysis.formats else {}
        _interrupts_are_exceptions()
        if len(paths) > 1:
            run.written = "files of two runs may stand side by side, the record tells"
        try:
            written = result.save(out, **size, command=run.command)
        except FigureError as error:
            written, failure = list(error.paths), error
        run.written = "all files were written"
    if json:
        click.echo(written[-1].read_text(encoding="utf-8"), nl=False)
    if not quiet:
        for line in () if json else (*result.report, *map(os.fspath, written)):
            click.echo(printable(line))
        for warning in result.warnings:
            _complain(f"Warning: {warning}")
    if failure is not None:
        raise failure
    if not result.passed:
        raise click.exceptions.Exit(ANSWER_IS_NO)


@contextmanager
def _options_as_typed(analysis: Command) -> Iterator[None]:
    """Name options in errors as on the command line: --p-d for 'p_d'."""
    names = "|".join(option.name for option in analysis.options if not option.positional)
    try:
        yield
    except InputError as error:  # 'p_d' behind "got" is a value
        option = re.compile(f"(?<!got )'({names})'")
        text = option.sub(lambda name: f"--{name[1].replace('_', '-')}", str(error))
        raise InputError(text) from error


def _require_writable(out: Path, paths: list[Path], inputs: list[Path]) -> None:
    """Refuse, before anything is computed, a folder or names that cannot be written."""
    from radar_sense.files import require_writable

    try:
        require_writable(paths, inputs)
    except (OSError, ValueError) as error:
        raise click.UsageError(f"--out: cannot write to {out}: {reason(error)}") from error


def _interrupts_are_exceptions() -> None:
    """Let Ctrl-C and SIGTERM clean up among the files, where the entry point ended at once."""
    for number in (signal.SIGINT, signal.SIGTERM):
        with suppress(ValueError):  # only the main thread receives signals
            if getattr(signal.getsignal(number), "__name__", "") == "end_at_once":
                signal.signal(number, signal.default_int_handler)


def _inputs(config: Path | None, scenario: Scenario) -> list[Path]:
    """Return the input files of a run."""

    def named(content: object) -> Iterator[Path]:
        if isinstance(content, Mapping):
            if isinstance(content.get("file"), str):  # and no level or loss of this name
                yield Path(content["file"])
            content = [*content.values()]
        for item in content if isinstance(content, list) else ():
            yield from named(item)

    return [*([] if config is None else [config]), *named(scenario.resolved())]


@cli.command(cls=OneCommand)
@click.argument("file", default="scenario.yaml", type=click.Path(path_type=Path))
@click.option("--network", is_flag=True, help="Start from several radars.")
@click.option("--route", is_flag=True, help="Start from a flight; its route is written as CSV too.")
@click.option("--data-sheet", is_flag=True, help="Start from a radar by its data sheet.")
@click.option("--from", "name", metavar="NAME", help="Start from this file of configs/.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def init(file: Path, name: str | None, quiet: bool, **kinds: bool) -> None:
    """Write a commented scenario to start from.

    FILE is scenario.yaml by default, and gives the scenario its name; - writes to the terminal. No
    file is overwritten.

    \b
    Examples:
      radar-sense init
      radar-sense init my.yaml
      radar-sense init --route flight.yaml
      radar-sense init --network radars.yaml
      radar-sense init --from airport_surveillance airport.yaml
    """
    from radar_sense.files import write
    from radar_sense.scenario_file import starters

    chosen = [kind for kind, flag in kinds.items() if flag]
    if len(chosen) + (name is not None) > 1:
        raise click.UsageError(
            "--network, --route, --data-sheet and --from exclude each other; give one"
        )
    source = starters.template("".join(chosen)) if name is None else starters.example(name)
    contents = starters.files(source, file)
    if str(file) == "-":
        if len(contents) > 1:
            raise click.UsageError(
                "this scenario has files beside it, and - is the terminal; give a name"
            )
        click.echo(source.read_text(encoding="utf-8"), nl=False)
        return
    paths = [file.parent / name for name in contents]
    for path in paths:
        if os.path.lexists(path):
            raise click.UsageError(f"{path}: exists already; choose another name")
    new_folder = not file.parent.exists()
    try:
        write(file.parent, {name: text.encode() for name, text in contents.items()})
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        raise click.UsageError(f"{file}: cannot be written: {reason(error)}") from error
    if not quiet:
        from shlex import quote

        first, *others = map(str, paths)
        beside = f", with {' and '.join(others)}" if others else ""
        folder = f"; the folder {file.parent} is new" if new_folder else ""
        click.echo(printable(f"{first} written{beside}{folder}"))
        click.echo(printable(f"next: radar-sense check {quote(first)}"))


@cli.command(cls=OneCommand)
@click.argument("first", type=click.Path(path_type=Path))
@click.argument("second", type=click.Path(path_type=Path))
def diff(first: Path, second: Path) -> None:
    """Compare two records: what changed in the scenario, and what it did to the numbers.

    FIRST and SECOND are JSON records of one command.

    \b
    Examples:
      radar-sense diff before/my_budget.json after/my_budget.json
    """
    from radar_sense import differences
    from radar_sense.scenario_file.text_file import read_text

    records = [
        differences.parsed(read_text(path, "a record", MOST_RECORD), str(path))
        for path in (first, second)
    ]
    for line in differences.compared(*records):
        click.echo(printable(line))


@cli.command(cls=OneCommand)
def schema() -> None:
    """Print the JSON Schema of the scenario file, for editors.

    \b
    Examples:
      radar-sense schema
    """
    from radar_sense.scenario_file.sections import schema_text

    click.echo(schema_text(), nl=False)


def _scenario(config: Path | None, changes: tuple[str, ...]) -> Scenario:
    """Return the scenario of a file with the values of --set."""
    from radar_sense.scenario_file.load import load_scenario

    values = {}
    for text in changes:
        key, equals, value = text.partition("=")
        if not equals or key in values:
            problem = "is given twice; give it once" if equals else "must be KEY=VALUE"
            raise click.UsageError(f"--set {text}: {problem}")
        values[key] = value
    return load_scenario(config, values)


@contextmanager
def _computing(
    analysis: Command, workers: int | None, dask: str | None, quiet: bool
) -> Iterator[Mapping[str, Any]]:
    """Return the arguments for threads and cluster, and show the progress on a terminal."""
    with ExitStack() as stack:
        if not quiet and sys.stderr is not None and sys.stderr.isatty():
            stack.enter_context(_progress_shown(analysis.name))
        if dask is not None:
            from radar_sense.montecarlo.cluster import cluster

            executor, threads = stack.enter_context(cluster(dask))
            yield {"executor": executor, "workers": workers or threads}
        elif "workers" in analysis.defaults:
            yield {"workers": workers or min(os.cpu_count() or 1, MOST_THREADS)}
        else:
            yield {}


@contextmanager
def _progress_shown(name: str) -> Iterator[None]:
    """Show the steps of a computation on one line of standard error, and clear it at the end.

    Steps within a step, as of each value of a sweep, follow those that they are within.
    """
    from shutil import get_terminal_size

    from radar_sense.progress import listening

    started = shown = time.monotonic()
    width = 0
    steps: dict[str, tuple[float, str]] = {}  # since when and how many, the outer ones first

    def show(what: str, done: int, total: int) -> None:
        nonlocal shown, width
        now = time.monotonic()
        begun, _ = steps.get(what, (now, ""))
        while what in steps:  # with the steps within it
            steps.popitem()
        left = (now - begun) * (total - done) / done if done else math.nan
        words = f", {left:.0f} s left" if left >= 1 else ""
        steps[what] = begun, f"{done:,} of {total:,} {what}{words}"
        if now - started >= PATIENCE and now - shown >= INTERVAL:
            text = f"{name}: {'; '.join(words for _, words in steps.values())}"
            text = text[: get_terminal_size().columns - 1]  # a second line could not be cleared
            click.echo(f"\r{text:{width}}", nl=False, err=True)
            shown, width = now, len(text)
        if done >= total:
            del steps[what]

    try:
        with listening(show):
            yield
    finally:
        if width:
            click.echo(f"\r{'':{width}}\r", nl=False, err=True)
