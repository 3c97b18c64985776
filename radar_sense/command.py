"""What makes a function a command: its options, its table and its result.

    @command(options.LEVEL, options.METHOD, examples=("radar-sense budget",))
    def budget(scenario: Scenario) -> Result: ...

`budget` is then a `Command`. Python calls it with a scenario, and the command line finds it by the
name of its file.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from numpy.typing import NDArray

from radar_sense import files, plotting
from radar_sense.differences import RECORD
from radar_sense.errors import (
    FigureError,
    InputError,
    check_choice,
    describe,
    did_you_mean,
    shorten_list,
)
from radar_sense.limits import FORMATS, STYLES, Limit, check_flag, check_number, plain_number
from radar_sense.scenario import Scenario, check_scenario, for_radar
from radar_sense.states import FloatArray

if TYPE_CHECKING:
    from radar_sense.plotting import Axes as Axes
    from radar_sense.plotting import Figure as Figure
else:  # Matplotlib is imported where a figure is drawn
    Axes = Figure = Any


@dataclass(frozen=True)
class Option:
    """A keyword of a command, which is an option of the command line.

    Attributes:
        name: The keyword; `step_km` is --step-km on the command line.
        help: Line in the help of the command.
        limit: Limit of a number; None for a word.
        metavar: Placeholder of the value in the help.
        default_text: The default in words, if the function has None or a list of numbers.
        count: Number of values of the option.
        choices: The words allowed; () for a number, or if they depend on the scenario.
        flag: Whether the option takes no value.
        multiple: Whether the option may be given several times.
        positional: Whether the command line has the value without the name, after CONFIG.
        needs: Names of options, of which one must be given with this one.
        excludes: Names of options that cannot be given with this one.
    """

    name: str
    help: str
    limit: Limit | None = None
    metavar: str = "N"
    default_text: str = ""
    count: int = 1
    choices: Collection[str] = ()
    flag: bool = False
    multiple: bool = False
    positional: bool = False
    needs: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()

    @property
    def meaning(self) -> str:
        """The line in the help, with the options that this one needs."""
        needed = " or ".join(f"--{name.replace('_', '-')}" for name in self.needs)
        return f"{self.help} Needs {needed}." if needed else self.help

    def checked(self, value: Any) -> Any:
        """Return a value as the command takes it: numbers of Python, several in a tuple.

        Raises:
            InputError: If the value has another type, is out of the limit, or is another word.
        """
        value = plain_number(value)
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
        if self.choices:
            check_choice(self.name, value, self.choices)
        if self.flag:
            check_flag(self.name, value)
        elif not isinstance(value, str):
            raise InputError(f"{self.name} must be text, got {describe(value)}")
        return value


#: Keywords of every command, which choose what the scenario states.
_OF_SCENARIO = ("level", "radar", "method", "runs", "seed")
#: The errors of every command, for its docstring.
_RAISES = (
    "\nRaises:\n    InputError: If the scenario or an option is not one that the command takes.\n"
)
#: Beginning of the meaning of a column of one radar alone.
OF_RADAR = "For radar "


class Column(NamedTuple):
    """What a column of a table is: its unit ("" for a pure number) and its meaning."""

    unit: str
    meaning: str


class Table(dict[str, FloatArray]):
    """Columns of one length (n,) by name; a map has axes and planes.

    Attributes:
        columns: Unit and meaning of each column.
    """

    def __init__(self) -> None:
        self.columns: dict[str, Column] = {}

    def add(self, name: str, values: NDArray[Any], meaning: str, unit: str = "") -> None:
        """Append a column."""
        self[name] = values
        self.columns[name] = Column(unit, meaning)


@dataclass(eq=False)
class Result:
    """What a command returns: numbers, lines for the terminal, and how to draw them.

    Attributes:
        scenario: The scenario, with level, method, runs and seed as they were used.
        table: The columns.
        summary: Numbers for the JSON record.
        report: Lines for the terminal, the answer first.
        warnings: Where the numbers are unreliable, one sentence each.
        draw: Draws into an empty figure. A `partial` of a function of a module, for pickle.
        passed: Whether the test of the command passed; True if there is no test.
        exports: Functions of the result that return a file, by format besides figures.
        analysis: Name of the command.
        shown: Names of the options that the small print of the figure shows.
    """

    scenario: Scenario
    table: Table = field(default_factory=Table)
    summary: dict[str, Any] = field(default_factory=dict)
    report: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    draw: Callable[[Figure], object] | None = None
    passed: bool = True
    exports: Mapping[str, Callable[[Result], bytes]] = field(default_factory=dict)
    analysis: str = "result"
    shown: tuple[str, ...] = ()

    @property
    def stem(self) -> str:
        """Name of the files of the result, without folder and ending."""
        return f"{self.scenario.name}_{self.analysis}"

    @property
    def small_print(self) -> str:
        """Scenario, level and method, for the figure. Numbers without a σ have no level."""
        words = [f"scenario {self.scenario.name}"]
        if any("sigma" in name for name in self.table):
            chosen = {"level": self.scenario.level, "method": self.scenario.method}
            words += [f"{name} {word}" for name, word in chosen.items() if name in self.shown]
        return ", ".join(words)

    def plot(self, style: str = STYLES[0], *, ax: Axes | Sequence[Axes] | None = None) -> Figure:
        """Draw the figure.

        Args:
            style: Size of the figure: one-column, two-columns, slides, paper (IEEE).
            ax: One's own axes to draw on, one for each panel; None makes a figure.

        Raises:
            ValueError: If the result has no figure, there is no such style, or the axes do not fit.
        """
        if self.draw is None:
            raise ValueError("this result has no figure")
        if ax is not None:
            return plotting.draw_on(self.draw, ax)
        return plotting.draw(self.draw, self.small_print, style)

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
            formats: Formats of the figure, if there is one: png, pdf, svg; of a map also geojson.
                () writes no figure.
            style: Size of the figure: one-column, two-columns, slides, paper (IEEE).
            command: The command line, for the record.

        Returns:
            The files: the table, the figures, the record.

        Raises:
            FigureError: If the figure could not be drawn. Table and record are written.
            OSError: If a file cannot be written.
            ValueError: If there is no such format or style.
            InputError: If the result cannot have a format. No file is written then.
        """
        allowed = (*FORMATS, *self.exports)
        formats = (formats,) if isinstance(formats, str) else tuple(formats)
        for name in formats:
            check_choice("format", name, allowed)
        check_choice("style", style, STYLES)
        contents: dict[str, bytes] = {}
        if self.table:
            ending, contents[ending] = files.table(self.table)
        error = None
        try:
            contents |= self.figures([name for name in formats if name in FORMATS], style)
        except FigureError as failure:
            error = FigureError(f"{failure}; table and record are written")
        contents |= {n: self.exports[n](self) for n in formats if n in self.exports}
        contents = {f"{self.stem}.{name}": content for name, content in contents.items()}
        record = files.record(self.record(command), contents)
        paths = files.write(Path(folder), {**contents, f"{self.stem}.json": record})
        if error is not None:
            error.paths = paths
            raise error
        return paths

    def figures(self, formats: Sequence[str], style: str = STYLES[0]) -> dict[str, bytes]:
        """Return the figure in each format, if there is one, or raise FigureError."""
        if not formats or self.draw is None:
            return {}
        try:
            figure = self.plot(style)
            return {name: plotting.render(figure, name) for name in formats}
        except Exception as error:
            about = f"the figure of {self.analysis} could not be drawn"
            raise FigureError(f"{about} ({type(error).__name__}: {error})") from error

    def record(self, command: Sequence[str] = ()) -> dict[str, Any]:
        """Return the inputs, the warnings, the summary and the columns, for the JSON record."""
        return {
            "record": RECORD,
            "analysis": self.analysis,
            "command": [command] if isinstance(command, str) else list(command),
            "seed": self.scenario.seed,
            "scenario": self.scenario.resolved(),
            "warnings": self.warnings,
            "summary": self.summary,
            "columns": {name: column._asdict() for name, column in self.columns.items()},
        }

    @property
    def columns(self) -> Mapping[str, Column]:
        """Unit and meaning of each column of the table."""
        return self.table.columns

    def __repr__(self) -> str:
        about, has = f"{self.analysis}: {self.scenario.name}", ".report, .warnings"
        if self.table:
            rows = max(map(len, self.table.values()))
            about += f", {rows} rows of {shorten_list(list(self.table))}"
            has += ", .table"
        has += ", .plot()" if self.draw else ""
        return f"<Result of {about}; {has}, .save(folder)>"


@dataclass(eq=False, repr=False)
class Command:
    """A function of a scenario that returns a result, with its options.

    Attributes:
        run: The function.
        options: Its options.
        examples: Command lines for the help.
        name: Name of the command; of the function by default.
        endings: Endings of its files besides the figure; () if the command line writes none.
        formats: Formats of its figure, or of what else its result can be; () without a figure.
        varies: Whether it checks the scenarios that it makes of the given one itself.
        defaults: Defaults of the function by keyword.
        help: The docstring of the function.
    """

    run: Callable[..., Any]
    options: tuple[Option, ...] = ()
    examples: tuple[str, ...] = ()
    name: str = ""
    endings: tuple[str, ...] = ("csv", "npz", "json")
    formats: tuple[str, ...] = FORMATS
    varies: bool = False
    #: Returns the warnings of a scenario itself, which every result has.
    check: ClassVar[Callable[[Scenario], Iterable[str]]] = staticmethod(lambda scenario: ())

    def __post_init__(self) -> None:
        functools.update_wrapper(self, self.run)  # for `help` and `inspect.signature`
        self.name = self.name or self.run.__name__
        signature = inspect.signature(self.run)
        scenario, *own = signature.parameters.values()
        self.defaults: dict[str, Any] = {p.name: p.default for p in own}
        kind = inspect.Parameter.KEYWORD_ONLY
        others = [name for name in _OF_SCENARIO if name not in self.defaults]
        shared = [inspect.Parameter(name, kind, default=None) for name in others]
        self.__signature__ = signature.replace(parameters=[scenario, *own, *shared])
        self.help = inspect.getdoc(self.run) or ""
        self.__doc__ = f"{self.help}\n\nArgs:\n{self._arguments()}{_RAISES}"

    def __call__(self, scenario: Scenario, *others: Any, **options: Any) -> Any:
        """Return the result of the command.

        The options `level`, `radar`, `method`, `runs` and `seed` are always allowed.

        Raises:
            InputError: If the scenario is no `Scenario`, or an option is not allowed.
            TypeError: If the command has no such option, or an option is not given by name.
        """
        if others:
            given = ", ".join(f"{name}=..." for name in [*self.defaults][: len(others)])
            raise TypeError(f"{self.name}() takes the options by name: {given or 'level=...'}")
        check_scenario(scenario)
        own = self._own(options)
        selected = self.selected(scenario, **options)
        self._check_together(options)
        result = self.run(selected, **own)
        result.analysis = self.name
        result.shown = tuple(option.name for option in self.options)
        checked = () if self.varies else Command.check(selected)
        # the command has appended to lists; from here on nothing is added
        vars(result).update(report=tuple(result.report), warnings=(*checked, *result.warnings))
        return result

    def _own(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of the function, checked. None is allowed where it is the default."""
        declared = {option.name: option for option in self.options}
        own = {}
        for name, value in options.items():
            if name in self.defaults:
                is_default = value is None and self.defaults[name] is None
                unchecked = is_default or name not in declared
                own[name] = value if unchecked else declared[name].checked(value)
            elif name not in _OF_SCENARIO:
                allowed = sorted({*self.defaults, *_OF_SCENARIO})
                raise TypeError(
                    f"{self.name}() has no option {name!r}, allowed: {', '.join(allowed)}"
                    + did_you_mean(name, allowed)
                )
        return own

    def _check_together(self, options: Mapping[str, Any]) -> None:
        """Raise InputError if an option is given without what it needs, or with another one."""
        given = {n for n, value in options.items() if value is not None and value is not False}
        for option in (option for option in self.options if option.name in given):
            if option.needs and given.isdisjoint(option.needs):
                needed = " or ".join(map(repr, option.needs))
                raise InputError(f"{option.name!r} needs {needed}")
            for other in option.excludes:
                if other in given:
                    both = f"{option.name!r} and {other!r}"
                    raise InputError(f"{both} exclude each other; give one of them")

    def selected(self, scenario: Scenario, **options: Any) -> Scenario:
        """Return the scenario with the chosen level, method, runs, seed and radar.

        Raises:
            InputError: If there is no such level, method or radar, or a number is out of range.
        """
        chosen = {n: options[n] for n in _OF_SCENARIO if n in options and n not in self.defaults}
        radar = chosen.pop("radar", None)
        scenario = scenario.with_analysis(**chosen)
        return scenario if radar is None else for_radar(scenario, radar)

    def _arguments(self) -> str:
        """Return the options as in a docstring."""
        own = [option for option in self.options if option.name in self.defaults]
        args = "    scenario: The scenario.\n"
        for option in own:
            # the signature shows a default that is not None
            default = option.default_text if self.defaults[option.name] is None else ""
            meaning = re.sub("--([a-z-]+)", lambda o: o[1].replace("-", "_"), option.meaning)
            args += f"    {option.name}: {meaning}{default and f' Default: {default}.'}\n"
        if "executor" in self.defaults:
            args += "    executor: Computes the blocks of runs in place of threads.\n"
        return args

    def __reduce__(self) -> str:
        return self.run.__qualname__  # pickled by its name in its module, as a function is

    def __repr__(self) -> str:
        return f"<command {self.name}: {self.help.partition(chr(10))[0]}>"


def command(
    *options: Option,
    examples: Sequence[str] = (),
    **others: Any,
) -> Callable[[Callable[..., Any]], Command]:
    """Make a command of a function from a scenario to a result; the rest is as in `Command`."""
    return lambda run: Command(run, options, tuple(examples), **others)
