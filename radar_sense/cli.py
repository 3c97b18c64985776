"""The command line: read, analyse, write; nothing else.

Whatever is slow to import is imported by the command that needs it.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import click

from radar_sense import __version__
from radar_sense.limits import (
    ANY,
    MAP_KM,
    MAP_STEP_KM,
    RUNS,
    SEED,
    SIGMAS,
    TARGET,
    THRESHOLD,
    WINDOW,
    Limit,
)

if TYPE_CHECKING:
    from radar_sense.analyses import Result
    from radar_sense.scenario import Scenario

F = TypeVar("F", bound=Callable[..., Any])

FORMATS = ("png", "pdf", "svg")
MAX_WORKERS = 256
#: More threads than this mostly wait for the interpreter, and each takes some 25 MB.
MOST_THREADS = 8
#: Exit code that says: all was done as asked, and the answer is no.
ANSWER_IS_NO = 3


class BadInput(click.ClickException):
    """Input that the user can put right; one line and exit code 2."""

    exit_code = 2


class Cli(click.Group):
    """The group of commands, with every error in one line on standard error."""

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


def _stacked(*decorators: Callable[[F], F]) -> Callable[[F], F]:
    def apply(function: F) -> F:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return apply


_config = click.argument("config", required=False, type=click.Path(path_type=Path))
_level = click.option("--level", metavar="NAME", help="Level of radar uncertainty.")
_radar = click.option(
    "--radar", metavar="NAME", help="Only this radar of a network, as if there were no other."
)
_method = click.option(
    "--method",
    metavar="NAME",
    help="Method of propagation: linear (the paper's), probit, or form.",
)
_runs = click.option("--runs", type=Number(RUNS), help="Number of runs.")
_seed = click.option("--seed", type=Number(SEED), help="Seed of the random draws.")
_sampler = click.option(
    "--sampler",
    metavar="NAME",
    default="random",
    show_default=True,
    help="random, or sobol: quasi-random points, fewer for the same accuracy of mean and sigma.",
)
_dask = click.option(
    "--dask",
    metavar="ADDRESS",
    help="Compute on the Dask cluster whose scheduler listens there, such as tcp://host:8786.",
)
_workers = click.option(
    "--workers",
    type=Number(Limit(at_least=1, at_most=MAX_WORKERS, whole=True)),
    help="Threads to compute with; the numbers do not depend on it.  "
    "[default: all cores, at most 8]",
)
_quiet = click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
_output = _stacked(
    click.option(
        "--out",
        metavar="DIR",
        default="figures",
        show_default=True,
        type=click.Path(path_type=Path),
        help="Folder to write to.",
    ),
    click.option(
        "--format",
        "formats",
        multiple=True,
        default=["pdf"],
        show_default=True,
        type=click.Choice(FORMATS),
        help="Format of the figure; may be given several times.",
    ),
    click.option("--no-plot", is_flag=True, help="Write no figure."),
    _quiet,
)


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


@cli.command()
@_config
@_level
@_radar
@_method
@click.option(
    "--threshold",
    metavar="P_MAX",
    type=Number(THRESHOLD),
    help="Test P_D + K sigma <= P_MAX at every pose; exit code 3 if a pose violates it.",
)
@click.option(
    "--k", metavar="K", type=Number(SIGMAS), help="K of the threshold test.  [default: 3]"
)
@_output
@click.pass_obj
def variance(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    method: str | None,
    threshold: float | None,
    k: float | None,
    **output: Any,
) -> None:
    """Standard deviation of P_D along the geometry.

    With --threshold also whether the upper bound, that of the method at K sigma, stays low enough
    all along, as path planners ask. Exit code 3 says that it does not.

    \b
    Examples:
      radar-sense variance
      radar-sense variance my.yaml --level high --method form
      radar-sense variance my.yaml --threshold 0.1 --k 2
      radar-sense variance network.yaml --radar ridge
    """
    from radar_sense import analyses, planning

    if k is not None and threshold is None:
        raise BadInput("--k belongs to --threshold, which is not given")
    scenario = _scenario(config, radar=radar, level=level)

    def analyse() -> Result:
        result = analyses.variance(scenario, method=method)
        if threshold is None:
            return result
        return planning.require_threshold(result, threshold, 3.0 if k is None else k)

    _run(command, analyse, **output)


@cli.command()
@_config
@_level
@_radar
@_method
@_runs
@_seed
@_sampler
@_workers
@_dask
@_output
@click.pass_obj
def montecarlo(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    method: str | None,
    runs: int | None,
    seed: int | None,
    sampler: str,
    workers: int | None,
    dask: str | None,
    **output: Any,
) -> None:
    """Monte Carlo draws of P_D against the band of a method.

    \b
    Examples:
      radar-sense montecarlo
      radar-sense montecarlo my.yaml --runs 1e6 --seed 7
      radar-sense montecarlo --sampler sobol --runs 4096
      radar-sense montecarlo network.yaml --radar ridge
    """
    from radar_sense import analyses

    scenario = _scenario(config, radar=radar, level=level, runs=runs, seed=seed)

    def analyse() -> Result:
        with _computing(workers, dask) as computing, _progress(scenario.runs) as advance:
            return analyses.montecarlo(
                scenario, method=method, sampler=sampler, progress=advance, **computing
            )

    _run(command, analyse, **output)


@cli.command()
@_config
@_radar
@_method
@_output
@click.pass_obj
def sensitivity(
    command: list[str], /, config: Path | None, radar: str | None, method: str | None, **output: Any
) -> None:
    """3 sigma of P_D for every level of radar uncertainty.

    \b
    Examples:
      radar-sense sensitivity
      radar-sense sensitivity my.yaml --out results
      radar-sense sensitivity network.yaml --radar ridge
    """
    from radar_sense import analyses

    scenario = _scenario(config, radar=radar)
    _run(command, lambda: analyses.sensitivity(scenario, method=method), **output)


@cli.command()
@_config
@_level
@_radar
@click.option(
    "--method",
    metavar="NAME",
    help="linear (the paper's), probit, form; or montecarlo, for Sobol' indices.",
)
@click.option(
    "--target",
    metavar="X",
    type=Number(TARGET),
    help="Say how small each source must be for 3 sigma to stay within X.",
)
@click.option(
    "--at",
    metavar="X",
    type=Number(ANY),
    help="Azimuth [deg], time [s] or distance [m] that --target is for.  [default: all]",
)
@_runs
@_seed
@_output
@click.pass_obj
def budget(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    method: str | None,
    target: float | None,
    at: float | None,
    runs: int | None,
    seed: int | None,
    **output: Any,
) -> None:
    """Error budget: 3 sigma of P_D from each source alone.

    \b
    Examples:
      radar-sense budget
      radar-sense budget my.yaml --level low --no-plot
      radar-sense budget my.yaml --target 0.05
      radar-sense budget my.yaml --method montecarlo --runs 4096
      radar-sense budget network.yaml --radar ridge
    """
    from radar_sense import analyses

    scenario = _scenario(config, radar=radar, level=level, runs=runs, seed=seed)
    _run(
        command,
        lambda: analyses.budget(scenario, method=method, target=target, only_at=at),
        **output,
    )


@cli.command()
@_config
@_level
@_radar
@_runs
@_seed
@_sampler
@_workers
@_dask
@_output
@click.pass_obj
def compare(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    runs: int | None,
    seed: int | None,
    sampler: str,
    workers: int | None,
    dask: str | None,
    **output: Any,
) -> None:
    """Bounds of P_D by every method against Monte Carlo.

    Many runs are needed for smooth Monte Carlo bounds: try --runs 100000.

    \b
    Examples:
      radar-sense compare
      radar-sense compare my.yaml --level high --runs 1e4
      radar-sense compare network.yaml --radar ridge
    """
    from radar_sense import analyses

    scenario = _scenario(config, radar=radar, level=level, runs=runs, seed=seed)

    def analyse() -> Result:
        with _computing(workers, dask) as computing, _progress(scenario.runs) as advance:
            return analyses.compare(scenario, sampler=sampler, progress=advance, **computing)

    _run(command, analyse, **output)


@cli.command()
@_config
@_level
@_radar
@_method
@click.option(
    "--digits",
    type=Number(Limit(at_least=1, at_most=4, whole=True)),
    default=2,
    show_default=True,
    help="Significant digits of the standard deviation that matter.",
)
@_seed
@_workers
@_output
@click.pass_obj
def validate(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    method: str | None,
    digits: int,
    seed: int | None,
    workers: int | None,
    **output: Any,
) -> None:
    """May a method be trusted here? A verdict by adaptive Monte Carlo.

    Draws until mean, deviation and 3-sigma interval are stable to the digits that matter, and
    compares the interval of the method with that of the draws (JCGM 101, clauses 7.9 and 8).
    Ends with exit code 3 if the method is not validated at every pose.

    \b
    Examples:
      radar-sense validate --digits 1
      radar-sense validate my.yaml --method form --digits 1
    """
    from radar_sense import analyses

    scenario = _scenario(config, radar=radar, level=level, seed=seed)

    def analyse() -> Result:
        with _progress(len(scenario.aircraft), "poses") as advance:
            return analyses.validate(
                scenario,
                method=method,
                digits=digits,
                workers=_threads(workers),
                progress=advance,
            )

    _run(command, analyse, **output)


@cli.command()
@_config
@_level
@_radar
@click.option(
    "--runs",
    type=Number(RUNS),
    help="Largest number of runs; a power of two is taken.  [default: 16384]",
)
@_seed
@_workers
@_output
@click.pass_obj
def convergence(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    runs: int | None,
    seed: int | None,
    workers: int | None,
    **output: Any,
) -> None:
    """Error of Monte Carlo by number of runs, for random and Sobol' draws.

    Also with the linear model as a control variate for both. Sobol' points are best for mean and
    sigma, whose error falls nearly as 1/runs; for 3-sigma quantiles they win less. Random draws are
    the only ones whose coverage has a binomial confidence interval.

    \b
    Examples:
      radar-sense convergence --runs 4096
      radar-sense convergence my.yaml --level high --runs 65536
    """
    from radar_sense.convergence import REFERENCES, REPLICATIONS
    from radar_sense.convergence import convergence as analyse

    scenario = _scenario(config, radar=radar, level=level, seed=seed)

    def run() -> Result:
        with _progress(REPLICATIONS + REFERENCES, "repetitions") as advance:
            return analyse(scenario, runs=runs, workers=_threads(workers), progress=advance)

    _run(command, run, **output)


@cli.command()
@_config
@_level
@_radar
@click.option(
    "--method",
    metavar="NAME",
    help="importance: importance sampling (the default); or first order, probit or linear.",
)
@click.option("--m", type=Number(WINDOW), help="With --n: detections that start a track.")
@click.option(
    "--n",
    type=Number(WINDOW),
    help="Looks in a row that they must be within; of radars with one period.",
)
@click.option("--runs", type=Number(RUNS), help="Also make so many plain draws.  [default: none]")
@_seed
@_workers
@_output
@click.pass_obj
def mission(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    method: str | None,
    m: int | None,
    n: int | None,
    runs: int | None,
    seed: int | None,
    workers: int | None,
    **output: Any,
) -> None:
    """Cumulative P_D over the looks along a path.

    The scenario must have a path, whose poses have times. A radar looks every
    radar.scan_period_s. The pose errors are correlated over uncertainty.aircraft_correlation_s, the
    radar errors the same at all looks. The last columns are the standard errors of the bounds.

    A track is M detections in N looks in a row. Radars of a network that have the same period look
    together, as one; a track that the radars of any one period have started is the network's.

    \b
    Examples:
      radar-sense mission my.yaml
      radar-sense mission my.yaml --m 3 --n 5 --runs 10000
    """
    from radar_sense.mission_analysis import mission as analyse

    if (m is None) != (n is None):
        raise BadInput("--m and --n belong together, as in --m 3 --n 5")
    scenario = _scenario(config, radar=radar, level=level, seed=seed)

    def run() -> Result:
        with nullcontext() if runs is None else _progress(runs) as advance:
            return analyse(
                scenario,
                method=method,
                m_of_n=None if m is None or n is None else (m, n),
                runs=runs,
                workers=_threads(workers),
                progress=advance,
            )

    _run(command, run, **output)


@cli.command()
@_config
@_output
@click.pass_obj
def detectors(command: list[str], /, config: Path | None, **output: Any) -> None:
    """P_D of every detector, and the error of North's approximation.

    \b
    Examples:
      radar-sense detectors
      radar-sense detectors my.yaml --format png
    """
    from radar_sense import analyses

    scenario = _scenario(config)
    _run(command, lambda: analyses.detectors(scenario), **output)


@cli.command()
@_config
@_output
@click.pass_obj
def rcs(command: list[str], /, config: Path | None, **output: Any) -> None:
    """The radar cross section by aspect: a polar cut and a map.

    The table that it writes can be read as `rcs: {model: table, file: ...}` again.

    \b
    Examples:
      radar-sense rcs
      radar-sense rcs my.yaml --format png
    """
    from radar_sense.rcs_pattern import rcs as analyse

    scenario = _scenario(config)
    _run(command, lambda: analyse(scenario), **output)


@cli.command("map")
@_config
@_level
@_radar
@click.option("--upper", is_flag=True, help="Show the upper 3-sigma bound in place of P_D.")
@click.option(
    "--method",
    metavar="NAME",
    help="Method for --upper: linear (the default), probit, or form, which takes minutes.",
)
@click.option(
    "--north-km",
    nargs=2,
    type=Number(MAP_KM),
    help="South and north end.  [default: around radars and path]",
)
@click.option("--east-km", nargs=2, type=Number(MAP_KM), help="West and east end.")
@click.option(
    "--step-km", type=Number(MAP_STEP_KM), help="Distance of cells.  [default: 1/500 of a side]"
)
@click.option(
    "--down-km", type=Number(MAP_KM), help="Down coordinate.  [default: the first pose's]"
)
@click.option(
    "--course-deg",
    type=Number(Limit(at_least=-360, at_most=360)),
    help="Yaw of the aircraft.  [default: the first pose's]",
)
@_output
@click.pass_obj
def area_map(
    command: list[str],
    /,
    config: Path | None,
    level: str | None,
    radar: str | None,
    upper: bool,
    method: str | None,
    north_km: tuple[float, float] | None,
    east_km: tuple[float, float] | None,
    step_km: float | None,
    down_km: float | None,
    course_deg: float | None,
    **output: Any,
) -> None:
    """P_D over an area at one height and course.

    The numbers are written as NPZ, for numpy.load, in single precision: north_m, east_m, p_d, and
    upper_3sigma with --upper. A million cells with the bound by linear or probit take a second; by
    form, which searches for an extreme of P_D in every cell, most of a minute, and with three
    radars three minutes.

    \b
    Examples:
      radar-sense map
      radar-sense map my.yaml --upper --method probit --step-km 5
      radar-sense map --north-km -400 400 --east-km 0 800 --course-deg 45
      radar-sense map network.yaml --radar ridge
    """
    from radar_sense import area

    scenario = _scenario(config, radar=radar, level=level)
    with _refusals():
        cells = area.grid(scenario, north_km=north_km, east_km=east_km, step_km=step_km)

    def analyse() -> Result:
        with _progress(math.prod(cells.shape), "cells") as advance:
            return area.area_map(
                scenario,
                cells,
                down_km=down_km,
                course_deg=course_deg,
                upper=upper,
                method=method,
                progress=advance,
            )

    _run(command, analyse, **output)


@cli.command()
@_config
@_quiet
def check(config: Path | None, quiet: bool) -> None:
    """Read and validate a scenario and print it in full; compute nothing.

    What is printed is a scenario file itself, with every default filled in.

    \b
    Examples:
      radar-sense check
      radar-sense check my.yaml
    """
    import yaml

    from radar_sense.radar_constant import describe
    from radar_sense.states import CONSTANTS

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
        for level, of_radars in scenario.constant_parts.items():
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
@_quiet
def init(file: Path, quiet: bool) -> None:
    """Write a commented scenario to start from.

    FILE is scenario.yaml if left out; - writes to the terminal.

    \b
    Examples:
      radar-sense init
      radar-sense init my.yaml
    """
    from radar_sense.output import write
    from radar_sense.scenario import default_text

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


def _scenario(config: Path | None, *, radar: str | None = None, **choices: Any) -> Scenario:
    from radar_sense.network import only
    from radar_sense.scenario import load_scenario

    with _refusals():
        scenario = load_scenario(config).with_analysis(**choices)
        return scenario if radar is None else only(scenario, radar)


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn what the package refuses into an error of the command line."""
    from radar_sense.reader import ScenarioError

    try:
        yield
    except ScenarioError as error:
        raise BadInput(str(error)) from error


def _run(
    command: list[str],
    analyse: Callable[[], Result],
    *,
    out: Path,
    formats: tuple[str, ...],
    no_plot: bool,
    quiet: bool,
) -> None:
    """Analyse, then write all files, then say what was found and written."""
    from radar_sense import output

    try:
        output.require_folder(out)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInput(f"--out: cannot write to {out}: {reason}") from error
    with _refusals():
        result = analyse()
    stem = output.stem(result)
    ending, content = output.data(result)
    files = {out / f"{stem}.{ending}": content}
    if not no_plot:
        from radar_sense import figures

        figure = figures.draw(result)
        for name in dict.fromkeys(formats):
            files[out / f"{stem}.{name}"] = figures.render(figure, name)
    files[out / f"{stem}.json"] = output.record(result, command)
    output.write(files)
    if not quiet:
        for line in result.report:
            click.echo(line)
        for warning in result.warnings:
            click.echo(f"Warning: {warning}", err=True)
        for path in files:
            click.echo(click.format_filename(path))
    if not result.passed:
        raise click.exceptions.Exit(ANSWER_IS_NO)


def _threads(workers: int | None) -> int:
    return workers or min(os.cpu_count() or 1, MOST_THREADS)


@contextmanager
def _computing(workers: int | None, dask: str | None) -> Iterator[dict[str, Any]]:
    """Say who computes: threads of this process, or a cluster."""
    if dask is None:
        yield {"workers": _threads(workers)}
        return
    from radar_sense.cluster import cluster

    with cluster(dask) as (executor, threads):
        yield {"workers": workers or threads, "executor": executor}


@contextmanager
def _progress(length: int, what: str = "runs") -> Iterator[Callable[[int], None] | None]:
    """Show progress on standard error, if that is a terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    started = time.monotonic()

    def rate(_: object) -> str:
        return f"{bar.pos / max(time.monotonic() - started, 1e-3):,.0f} {what}/s"

    bar: Any = click.progressbar(
        length=length, label=what, show_pos=True, item_show_func=rate, file=sys.stderr
    )
    with bar:
        yield bar.update
