"""The contract of an analysis: its options, its result, and what makes a function a command.

    @analysis(plot=plot, options=["level", "radar"], examples=["radar-sense rcs"])
    def rcs(scenario, *, step_deg=1.0): ...

`rcs` is then an `Analysis`. Python code calls `rcs` with a scenario. The command line makes a
command of each analysis.
"""

from __future__ import annotations

import dataclasses
import html
import inspect
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from radar_sense import files
from radar_sense.analyses.columns import Column, find
from radar_sense.analyses.verdicts.plausibility import plausibility_warnings
from radar_sense.errors import FigureError as FigureError
from radar_sense.errors import InputError, check_choice, describe, did_you_mean, shorten_list
from radar_sense.limits import (
    FORMATS,
    MAP_KM,
    RUNS,
    SEED,
    STYLES,
    WORKERS,
    Limit,
    check_number,
    plain_number,
)
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.progress import steps
from radar_sense.propagation import METHODS
from radar_sense.scenario import Scenario, check_scenario, for_radar
from radar_sense.states import FloatArray

if TYPE_CHECKING:
    from radar_sense.plotting import Figure


class Progress(Protocol):
    """Starts to report steps: called with their number and name."""

    def __call__(self, total: int, what: str) -> AbstractContextManager[Callable[[int], None]]:
        """Return a context, with a function that is called with the number of new steps."""
        ...


silent: Progress = steps


@dataclass(frozen=True)
class Option:
    """A keyword of an analysis, which is an option of the command.

    Attributes:
        name: The keyword; `step_km` is --step-km on the command line.
        help: Line in the help of the command.
        limit: Limit of a number; None for a word.
        metavar: Placeholder of the value in the help.
        default: The default value.
        default_text: The default in words, if the value is None.
        count: Number of values of the option.
        choices: The words allowed, if they do not depend on the scenario.
        also: Words allowed besides the choices.
        flag: Whether the option takes no value.
        multiple: Whether the option may be given several times.
    """

    name: str
    help: str
    limit: Limit | None = None
    metavar: str = "N"
    default: Any = None
    default_text: str = ""
    count: int = 1
    choices: Collection[str] = ()
    also: tuple[str, ...] = ()
    flag: bool = False
    multiple: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """All words allowed; () for any text or a number."""
        return (*self.choices, *self.also)

    def checked(self, value: Any) -> Any:
        """Return a value as the analysis takes it: numbers of Python, several in a tuple.

        Raises:
            InputError: If the value has another type, is out of the limit, or is another word.
        """
        if not self.multiple and self.count == 1:
            return self._checked(value)
        several = isinstance(value, Iterable) and not isinstance(value, str)
        values = tuple(value) if several else (value,)
        if not self.multiple and len(values) != self.count:
            raise InputError(f"{self.name} must be {self.count} values, got {describe(value)}")
        return tuple(map(self._checked, values))

    def _checked(self, value: Any) -> Any:
        if self.limit is not None:
            return check_number(self.name, value, self.limit)
        if self.words:
            check_choice(self.name, value, self.words)
        value = plain_number(value) if self.flag else value
        kind, allowed = (bool, "True or False") if self.flag else (str, "text")
        if not isinstance(value, kind):
            raise InputError(f"{self.name} must be {allowed}, got {describe(value)}")
        return value


#: The options that mean the same everywhere.
OPTIONS: Mapping[str, Option] = {
    option.name: option
    for option in (
        Option("level", "Level of radar uncertainty.", metavar="NAME"),
        Option("radar", "Only this radar of a network; the others are left out.", metavar="NAME"),
        Option(
            "method",
            f"Method of propagation: {', '.join(METHODS)}.",
            metavar="NAME",
            default="linear",
            choices=METHODS,
        ),
        Option("runs", "Number of runs.", RUNS, default_text="the scenario's"),
        Option("seed", "Seed of the random draws.", SEED, default_text="the scenario's"),
        Option(
            "sampler",
            "random; or sobol, quasi-random points that need fewer runs for mean and sigma.",
            metavar="NAME",
            default="random",
            choices=SAMPLERS,
        ),
        Option(
            "workers",
            "Threads to compute with; the numbers do not depend on the number of threads.",
            WORKERS,
            default_text="all cores, at most 8",
        ),
        Option(
            "dask",
            "Compute on a Dask cluster, given by its scheduler, such as tcp://host:8786.",
            metavar="ADDRESS",
        ),
        Option("down_km", "Down coordinate.", MAP_KM, default_text="as at the first pose"),
        Option(
            "course_deg",
            "Yaw of the aircraft.",
            Limit(at_least=-360, at_most=360),
            default_text="as at the first pose",
        ),
    )
}

#: Options that select from the scenario, unless the analysis has a keyword of the same name.
_OF_SCENARIO = ("level", "radar", "runs", "seed")


@dataclass(frozen=True, eq=False)
class Result:
    """Result of an analysis: numbers, lines for the terminal, and what the figure needs.

    Attributes:
        scenario: The scenario, with level, runs and seed as they were used.
        table: Columns of the table by name, all of one length (n,). A map has axes and planes.
        summary: Numbers for the JSON record.
        report: Lines for the terminal.
        warnings: Where the numbers are unreliable, one sentence each.
        method: Method of propagation of the numbers.
        arrays: Arrays that only the figure shows, by name.
        passed: Whether the test of the analysis passed; True if there is no test.
        by: The analysis.
    """

    scenario: Scenario
    table: Mapping[str, FloatArray]
    summary: Mapping[str, Any] = field(default_factory=dict)
    report: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    method: str = "linear"
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)
    passed: bool = True
    by: Analysis | None = None

    @property
    def analysis(self) -> str:
        """Name of the analysis."""
        return self.by.name if self.by else "result"

    @property
    def stem(self) -> str:
        """Name of the files of the result, without folder and ending."""
        return self.by.stem(self.scenario) if self.by else f"{self.scenario.name}_result"

    @property
    def columns(self) -> dict[str, Column]:
        """Declared columns of the table by name, each with unit and meaning."""
        declared = self.by.columns if self.by else ()
        columns = {name: find(declared, name) for name in self.table}
        return {name: column for name, column in columns.items() if column}

    @property
    def band_label(self) -> str:
        """Label of the 3σ band in the figure."""
        linear = self.method == "linear"
        band = r"$\pm 3\,\sigma$" if linear else rf"$\pm 3\,\sigma$ by {self.method}"
        return f"{band} ({self.scenario.level})"

    @property
    def small_print(self) -> str:
        """Scenario, level and method, for the figure. Numbers without a σ have no level."""
        options = {option.name for option in self.by.options} if self.by else set()
        words = [f"scenario {self.scenario.name}"]
        if any("sigma" in name for name in self.table):
            words += [f"level {self.scenario.level}"] if "level" in options else []
            words += [f"method {self.method}"] if "method" in options else []
        return ", ".join(words)

    def plot(self, style: str = STYLES[0]) -> Figure:
        """Draw the figure.

        Args:
            style: Size of the figure: one-column, two-columns, slides.

        Raises:
            ValueError: If the result does not come from an analysis, or there is no such style.
        """
        from radar_sense.plotting import draw

        if self.by is None:
            raise ValueError("only the result of an analysis has a figure")
        return draw(self.by.plot, self, self.small_print, style)

    def save(
        self,
        folder: str | Path = ".",
        formats: Sequence[str] = ("png",),
        *,
        style: str = STYLES[0],
        command: Sequence[str] = (),
    ) -> list[Path]:
        """Write table, figures and record; the record is the last, with the digests of the others.

        Args:
            folder: Folder of the files; made if missing.
            formats: Formats of the figure: png, pdf, svg; of a map also geojson. ()
                writes no figure.
            style: Size of the figure: one-column, two-columns, slides.
            command: The command line, for the record.

        Returns:
            The files: the table, the figures, the record.

        Raises:
            FigureError: If the figure could not be drawn. Table and record are written.
            OSError: If a file cannot be written.
            ValueError: If there is no such format or style.
            InputError: If the result cannot have a format. No file is written then.
        """
        allowed = self.by.formats if self.by else FORMATS
        for name in formats:
            if name not in allowed:
                raise ValueError(f"format must be one of {', '.join(allowed)}, got {name!r}")
        functions = self.by.exports if self.by else {}
        exports = {name: functions[name](self) for name in formats if name in functions}
        if style not in STYLES:
            raise ValueError(f"style must be one of {', '.join(STYLES)}, got {style!r}")
        ending, table = files.table(self.table)
        figures, error = self._figures([name for name in formats if name in FORMATS], style)
        named = {ending: table, **figures, **exports}
        contents = {f"{self.stem}.{name}": content for name, content in named.items()}
        record = files.record(self.record(command), contents)
        paths = files.write(Path(folder), {**contents, f"{self.stem}.json": record})
        if error is not None:
            error.paths = paths
            raise error
        return paths

    def record(self, command: Sequence[str] = ()) -> dict[str, Any]:
        """Return the inputs, the warnings, the summary and the columns, for the JSON record."""
        return {
            "analysis": self.analysis,
            "command": list(command),
            "seed": self.scenario.seed,
            "scenario": self.scenario.resolved(),
            "warnings": self.warnings,
            "summary": self.summary,
            "columns": {
                name: {"unit": column.unit, "meaning": column.meaning}
                for name, column in self.columns.items()
            },
        }

    def _figures(
        self, formats: Sequence[str], style: str
    ) -> tuple[dict[str, bytes], FigureError | None]:
        """Return the figure in each format, or the error of a figure that cannot be drawn."""
        if not formats:
            return {}, None
        try:
            from radar_sense.plotting import render

            figure = self.plot(style)
            return {name: render(figure, name) for name in formats}, None
        except Exception as error:
            failure = FigureError(
                f"the figure could not be drawn ({type(error).__name__}: {error}); "
                "table and record are written"
            )
            failure.__cause__ = error
            return {}, failure

    def __repr__(self) -> str:
        rows = max((len(column) for column in self.table.values()), default=0)
        return (
            f"<Result of {self.analysis}: {self.scenario.name}, {rows} rows of "
            f"{shorten_list(list(self.table))}; .report, .warnings, .table, .plot(), .save(folder)>"
        )

    def _repr_html_(self) -> str:
        def lines(items: Sequence[str]) -> str:
            return html.escape("\n".join(items))

        warnings = f"<pre><b>Warnings</b>\n{lines(self.warnings)}</pre>" if self.warnings else ""
        title = f"{self.analysis}: {self.scenario.name}"
        return f"<b>{html.escape(title)}</b><pre>{lines(self.report)}</pre>{warnings}"


@dataclass(frozen=True, eq=False, repr=False)
class Command:
    """A command: a function of a scenario, and its options.

    Attributes:
        name: Name of the command.
        run: Function that computes the result.
        options: Options of the command.
        examples: Command lines for the help.
        endings: Endings of the files besides figures.
        has_figures: Whether the command writes figures as separate files.
    """

    name: str
    run: Callable[..., Any]
    options: tuple[Option, ...]
    examples: tuple[str, ...]
    endings: ClassVar[tuple[str, ...]]
    has_figures: ClassVar[bool]

    def __post_init__(self) -> None:
        # For `help`, `inspect.signature` and the `?` of IPython, as `functools.wraps` does.
        vars(self).update(
            __name__=self.run.__name__.lstrip("_"),
            __module__=self.run.__module__,
            __wrapped__=self.run,
            __signature__=self._signature(),
            __doc__=self._doc(),
        )

    def __call__(self, scenario: Scenario, **options: Any) -> Any:
        """Return the result of the command.

        Args:
            scenario: The scenario.
            options: Options of the command. `level`, `radar`, `runs` and `seed` are always allowed.

        Raises:
            InputError: If the scenario is no `Scenario`, or an option is not allowed.
            TypeError: If the command has no such option.
        """
        check_scenario(scenario)
        of_run = self._of_run(options)
        return self.run(self.selected(scenario, **options), **of_run)

    @property
    def _shared(self) -> tuple[Option, ...]:
        """The options that select from the scenario."""
        return tuple(OPTIONS[name] for name in _OF_SCENARIO if name not in self.keywords)

    def _signature(self) -> inspect.Signature:
        """Return the signature with the options that select from the scenario."""
        signature = inspect.signature(self.run)
        shared = [
            inspect.Parameter(
                option.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=None,
                annotation="str | None" if option.limit is None else "int | None",
            )
            for option in self._shared
        ]
        return signature.replace(parameters=[*signature.parameters.values(), *shared])

    def _doc(self) -> str:
        """Return the docstring with the options that select from the scenario."""
        doc = inspect.getdoc(self.run) or ""
        if "\nArgs:\n" not in doc:
            doc = f"{doc}\n\nArgs:\n    scenario: The scenario."
        before, _, args = doc.partition("\nArgs:\n")
        args, *others = args.split("\n\n", 1)
        lines = (f"    {o.name}: {o.help} By default as in the scenario." for o in self._shared)
        return "\n\n".join(["\n".join([f"{before}\nArgs:", args, *lines]), *others])

    def _of_run(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of the function that computes the result, checked.

        None is allowed where None is the default.
        """
        parameters = inspect.signature(self.run).parameters
        declared = {option.name: option for option in self.options}
        if not callable(options.get("progress", silent)):
            raise InputError(f"progress must be a function, got {describe(options['progress'])}")
        if not isinstance(options.get("executor"), Executor | None):
            raise InputError(f"executor must be an Executor, got {describe(options['executor'])}")
        of_run = {}
        for name, value in options.items():
            if name in self.keywords:
                is_default = value is None and parameters[name].default is None
                unchecked = is_default or name not in declared
                of_run[name] = value if unchecked else declared[name].checked(value)
            elif name not in _OF_SCENARIO:
                allowed = sorted({*self.keywords, *_OF_SCENARIO})
                raise TypeError(
                    f"{self.name}() has no option {name!r}, allowed: {', '.join(allowed)}"
                    + did_you_mean(name, allowed)
                )
        return of_run

    def selected(self, scenario: Scenario, **options: Any) -> Scenario:
        """Return the scenario with the chosen level, runs, seed and radar.

        Raises:
            InputError: If there is no such level or radar, or a number is out of range.
        """
        chosen = {
            name: options[name]
            for name in _OF_SCENARIO
            if name in options and name not in self.keywords
        }
        radar = chosen.pop("radar", None)
        scenario = scenario.with_analysis(**chosen)
        return scenario if radar is None else for_radar(scenario, radar)

    def stem(self, scenario: Scenario) -> str:
        """Return the name of the files of a result, without folder and ending."""
        return f"{scenario.name}_{self.name}"

    @property
    def formats(self) -> tuple[str, ...]:
        """Formats that the command can write besides its table and record."""
        return FORMATS

    @property
    def keywords(self) -> tuple[str, ...]:
        """Keywords of the function that computes the result."""
        return tuple(inspect.signature(self.run).parameters)[1:]

    @property
    def help(self) -> str:
        """Return the help of the command: the docstring up to the arguments."""
        text = inspect.getdoc(self.run) or ""
        return text.partition("\nArgs:")[0].partition("\nRaises:")[0].strip()

    def __repr__(self) -> str:
        kind = type(self).__name__.lower()
        return f"<{kind} {self.name}: {self.help.partition(chr(10))[0]}>"


@dataclass(frozen=True, eq=False, repr=False)
class Analysis(Command):
    """An analysis, called with a scenario.

    Attributes:
        plot: Function that draws a result into an empty figure, from the result alone.
        columns: Columns that the table may have.
        exports: Functions that return a file, by format. These are formats besides figures.
    """

    plot: Callable[[Result, Figure], None]
    columns: tuple[Column, ...] = ()
    exports: Mapping[str, Callable[[Result], bytes]] = field(default_factory=dict)
    endings: ClassVar[tuple[str, ...]] = ("csv", "npz", "json")
    has_figures: ClassVar[bool] = True

    @property
    def formats(self) -> tuple[str, ...]:
        """Formats of figures, and formats that only this analysis has."""
        return (*FORMATS, *self.exports)

    def __call__(self, scenario: Scenario, **options: Any) -> Result:
        """Return the result of the analysis, as `Command.__call__` does."""
        result: Result = super().__call__(scenario, **options)
        warnings = (
            *plausibility_warnings(self.selected(scenario, **options)),
            *result.warnings,
        )
        return dataclasses.replace(result, warnings=warnings, by=self)


def analysis(
    *,
    plot: Callable[[Result, Figure], None],
    options: Sequence[str | Option] = (),
    examples: Sequence[str] = (),
    columns: Sequence[Column] = (),
    exports: Mapping[str, Callable[[Result], bytes]] | None = None,
    name: str = "",
) -> Callable[[Callable[..., Result]], Analysis]:
    """Make an analysis of a function from a scenario to a result.

    Args:
        plot: Function that draws the figure.
        options: Names in `OPTIONS`, or options that only this analysis has.
        examples: Command lines for the help.
        columns: Columns that the table may have.
        exports: Functions that return a file, by format.
        name: Name of the command; the name of the function by default.
    """

    def decorate(run: Callable[..., Result]) -> Analysis:
        chosen = tuple(OPTIONS[o] if isinstance(o, str) else o for o in options)
        return Analysis(
            name or run.__name__,
            run,
            chosen,
            tuple(examples),
            plot,
            tuple(columns),
            exports or {},
        )

    return decorate
