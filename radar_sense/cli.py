"""The command line: one command an analysis, and `check` and `init`; no numbers.

`--help` answers without NumPy: an analysis is imported when its own command is asked for.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from radar_sense import __version__
from radar_sense.limits import FORMATS, Limit

if TYPE_CHECKING:
    from radar_sense.analyses.contract import Analysis, Option
    from radar_sense.scenario import Scenario

#: Where each analysis is, and the first line of its docstring, which `--help` shows.
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
        "P_D of every detector, and the error of North's approximation.",
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

#: More threads than this mostly wait for the interpreter, and each takes some 25 MB.
MOST_THREADS = 8
#: Exit code that says: all was done as asked, and the answer is no.
ANSWER_IS_NO = 3


class BadInput(click.ClickException):
    """Input that the user can put right; one line and exit code 2."""

    exit_code = 2


class Cli(click.Group):
    """The group of commands, with every error in one line on standard error."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return sorted({*ANALYSES, *self.commands})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; that of an analysis is made from the analysis."""
        if cmd_name not in ANALYSES:
            return super().get_command(ctx, cmd_name)
        return command_of(load(cmd_name))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands; no analysis is imported for it."""
        lines = {name: text for name, (_, text) in ANALYSES.items()}
        lines |= {name: c.get_short_help_str(100) for name, c in self.commands.items()}
        with formatter.section("Commands"):
            formatter.write_dl(sorted(lines.items()))

    def main(self, args: Any = None, *rest: Any, **options: Any) -> NoReturn:
        """Run a command and exit with its code."""
        args = list(sys.argv[1:] if args is None else args) or ["--help"]
        options.update(standalone_mode=False, obj=["radar-sense", *args])
        try:
            code = super().main(args, *rest, **options)
        except click.ClickException as error:
            message = " ".join(error.format_message().split())
            click.echo(f"Error: {message}", err=True)
            code = error.exit_code
        except (click.Abort, KeyboardInterrupt):
            click.echo("Interrupted; nothing was written.", err=True)
            code = 130
        except BrokenPipeError:
            # The reader of our output went away; Python must not complain when it flushes.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        except OSError as error:
            click.echo(f"Error: {error}", err=True)
            code = 1
        sys.exit(code)


class Number(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A number within a limit; `1e6` is a whole one."""

    name = "N"

    def __init__(self, limit: Limit) -> None:
        self.limit = limit

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Turn the text of an option into an int or a float."""
        try:
            # not by way of a float: a seed may have more digits than that holds
            text = str(value).replace("_", "?")  # Python's 1_000 is not a number elsewhere
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

    CONFIG is a scenario file; without it, the scenario of the paper is used.
    Every analysis writes a CSV table (map: NPZ), a figure, and a JSON record of how they were made.

    \b
    Examples:
      radar-sense budget                    the paper's error budget, into figures/
      radar-sense init my.yaml              a scenario of your own to start from
      radar-sense montecarlo my.yaml        is the linearization good enough for it?
    """


def load(name: str) -> Analysis:
    """Import an analysis."""
    module, _, function = ANALYSES[name][0].partition(":")
    analysis: Analysis = getattr(import_module(module), function)
    return analysis


def command_of(analysis: Analysis) -> click.Command:
    """Make the command of an analysis: its options, then those of the output."""
    examples = "".join(f"\n  {line}" for line in analysis.examples)
    return click.Command(
        analysis.name,
        callback=click.pass_obj(lambda command, **given: _run(analysis, command, **given)),
        params=[_config(), *map(_option, analysis.options), *_output()],
        help=f"{analysis.help}\n\n\b\nExamples:{examples}",
    )


def _option(option: Option) -> click.Option:
    default = option.default_text and f"  [default: {option.default_text}]"
    several: dict[str, Any] = {} if option.count == 1 else {"nargs": option.count}
    return click.Option(
        [f"--{option.name.replace('_', '-')}"],
        help=option.help + default,
        is_flag=option.flag,
        metavar=None if option.flag else option.metavar,
        type=None if option.limit is None else Number(option.limit),
        default=option.default,
        show_default=option.default is not None and not option.flag,
        **several,
    )


def _config() -> click.Argument:
    return click.Argument(["config"], required=False, type=click.Path(path_type=Path))


def _quiet() -> click.Option:
    return click.Option(["-q", "--quiet"], is_flag=True, help="Print nothing but errors.")


def _output() -> list[click.Parameter]:
    return [
        click.Option(
            ["--out"],
            metavar="DIR",
            default="figures",
            show_default=True,
            type=click.Path(path_type=Path),
            help="Folder to write to.",
        ),
        click.Option(
            ["--format", "formats"],
            multiple=True,
            default=["pdf"],
            show_default=True,
            type=click.Choice(FORMATS),
            help="Format of the figure; may be given several times.",
        ),
        click.Option(["--no-plot"], is_flag=True, help="Write no figure."),
        _quiet(),
    ]


def _run(
    analysis: Analysis,
    command: list[str],
    *,
    config: Path | None,
    out: Path,
    formats: tuple[str, ...],
    no_plot: bool,
    quiet: bool,
    dask: str | None = None,
    workers: int | None = None,
    **options: Any,
) -> None:
    """Read the scenario, analyse, write all files, print what was found and written."""
    from radar_sense import files

    chosen = {name: value for name, value in options.items() if value is not None}
    with _refusals():
        scenario = _scenario(config)
    try:
        files.require_folder(out)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInput(f"--out: cannot write to {out}: {reason}") from error
    with _refusals(), _computing(analysis, workers, dask) as computing:
        result = analysis(scenario, **chosen, **computing)
    paths = result.save(out, () if no_plot else formats, command=command)
    if not quiet:
        for line in result.report:
            click.echo(line)
        for warning in result.warnings:
            click.echo(f"Warning: {warning}", err=True)
        for path in paths:
            click.echo(click.format_filename(path))
    if not result.passed:
        raise click.exceptions.Exit(ANSWER_IS_NO)


@cli.command(params=[_config(), _quiet()])
def check(config: Path | None, quiet: bool) -> None:
    """Read and validate a scenario and print it in full; compute nothing.

    What is printed is a scenario file itself, with every default filled in.

    \b
    Examples:
      radar-sense check
      radar-sense check my.yaml
    """
    import yaml

    from radar_sense.model.radar_constant import describe
    from radar_sense.states import CONSTANTS

    with _refusals():
        scenario = _scenario(config)
    if not quiet:
        names = scenario.model.names
        if names:
            radars = "1 radar" if len(names) == 1 else f"{len(names)} radars"
            click.echo(f"# {len(scenario.aircraft)} poses, {radars}")
            for name, constant in zip(names, scenario.radar[CONSTANTS], strict=True):
                click.echo(f"# {name}: c_r = {constant:g} J m^2/K")
        else:
            click.echo(f"# {len(scenario.aircraft)} poses, c_r = {scenario.radar[3]:g} J m^2/K")
        of_whom = [f"{name}, " for name in names] if len(names) > 1 else [""]
        for level, of_radars in scenario.tolerances.items():
            constants = zip(of_whom, scenario.radar[CONSTANTS], of_radars, strict=True)
            for who, constant, parts in constants:
                if parts:
                    click.echo(f"# {who}{level}: {describe(constant, parts)}")
        # default_flow_style None: lists of numbers on one line, mappings spread out
        resolved = yaml.safe_dump(
            scenario.resolved(), sort_keys=False, default_flow_style=None, allow_unicode=True
        )
        click.echo(resolved, nl=False)


@cli.command()
@click.argument("file", default="scenario.yaml", type=click.Path(path_type=Path))
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def init(file: Path, quiet: bool) -> None:
    """Write a commented scenario to start from.

    FILE is scenario.yaml if left out; - writes to the terminal.

    \b
    Examples:
      radar-sense init
      radar-sense init my.yaml
    """
    from radar_sense.files import write
    from radar_sense.reading.parse import default_text

    if str(file) == "-":
        click.echo(default_text(), nl=False)
        return
    try:
        if file.exists() or file.is_symlink():
            raise BadInput(f"{file}: exists already; choose another name")
        write({file: default_text().encode()})
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte in it
        reason = getattr(error, "strerror", None) or error
        raise BadInput(f"{file}: cannot be written: {reason}") from error
    if not quiet:
        click.echo(f"{file} written; next: radar-sense check {file}")


def _scenario(config: Path | None) -> Scenario:
    from radar_sense.reading.parse import load_scenario

    return load_scenario(config)


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn what the package refuses into an error of the command line."""
    from radar_sense.errors import InputError

    try:
        yield
    except InputError as error:
        raise BadInput(str(error)) from error


def _threads(workers: int | None) -> int:
    return workers or min(os.cpu_count() or 1, MOST_THREADS)


@contextmanager
def _computing(
    analysis: Analysis, workers: int | None, dask: str | None
) -> Iterator[Mapping[str, Any]]:
    """Choose what computes, threads of this process or a cluster, and what shows progress."""
    shown = {"progress": _progress} if "progress" in analysis.keywords else {}
    if dask is not None:
        from radar_sense.montecarlo.cluster import cluster

        with cluster(dask) as (executor, threads):
            yield {**shown, "workers": workers or threads, "executor": executor}
    elif "workers" in analysis.keywords:
        yield {**shown, "workers": _threads(workers)}
    else:
        yield shown


@contextmanager
def _progress(total: int, what: str = "runs") -> Iterator[Callable[[int], None] | None]:
    """Show progress on standard error, if that is a terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    started = time.monotonic()

    def rate(_: object) -> str:
        return f"{bar.pos / max(time.monotonic() - started, 1e-3):,.0f} {what}/s"

    bar: Any = click.progressbar(
        length=total, label=what, show_pos=True, item_show_func=rate, file=sys.stderr
    )
    with bar:
        yield bar.update
