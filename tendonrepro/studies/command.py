"""A public function becomes a command: of the shell and of Python, with one signature and one docstring.

Nothing heavy is imported here, nor by files that hold such functions: ``tendonrepro --help`` reads them all.
"""

from __future__ import annotations

import inspect
import json
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from types import SimpleNamespace, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from tendonrepro.console import Talk
from tendonrepro.errors import did_you_mean
from tendonrepro.studies.study import ON_PLANTS, Answer, Study, Word

if TYPE_CHECKING:
    from tendonrepro.studies.result import Result

P = ParamSpec("P")
V = TypeVar("V")
Prepared = TypeVar("Prepared", bound="Answer[object] | Study")

PANELS = ONE_ARM, MANY_ARMS, PAGES, FILES = "One arm", "Many plausible arms", "Pages", "Files"
"""Panels of the first screen, in their order; the last one has the groups."""

DATA, RESULT, CONFIG = "data", "result", "config"
GROUPS = {
    DATA: "Measured data: fetch, inspect, ingest, validate, recover.",
    RESULT: "Stored results: redraw, animate, export, diff.",
    CONFIG: "Configurations: list, show, init, check, schema.",
}
"""Groups of commands, and what is in them."""


class Example:
    """Arguments of a call that shows a command; as words of the shell and as Python."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        self.args, self.kwargs = args, kwargs


@dataclass(frozen=True)
class Command:
    """An entry of the registry.

    `name` is the words that call it, such as ``compare`` or ``result diff``; `under` is its panel on the
    first screen, or its group. `example` is a call of it. `function` gives an `Answer`, or a `Study`, which
    the lifecycle carries out.
    """

    name: str
    under: str
    example: Example
    function: Callable[..., Answer[object] | Study]
    has_dry_run: bool = False

    def prepare(self, *args: object, **kwargs: object) -> Answer[object] | Study:
        """Call the function; a study then knows of which command it is."""
        given = self._bound(*args, **kwargs)
        prepared = self.function(*given.args, **given.kwargs)
        if not isinstance(prepared, Study):
            return prepared
        return replace(prepared, command=self.word, again=self.words(*given.args, **given.kwargs))

    @property
    def word(self) -> str:
        """Last word of its name, by which a study's results are known."""
        return self.name.rpartition(" ")[2]

    def words(self, *args: object, **kwargs: object) -> str | None:
        """What a shell says to call it with these arguments.

        None where no words can: a function of Python's or standard input is among them. Whom to tell, what
        may be overwritten, and what holds by default are left out.
        """
        said = ["tendonrepro", *self.name.split()]
        for name, value in self.signature.bind(*args, **kwargs).arguments.items():
            parameter = self.signature.parameters[name]
            if isinstance(value, Talk) or name == "force" or value is None or value == parameter.default:
                continue
            is_function = isinstance(value, Mapping) and any(map(callable, value.values()))
            if is_function or (name == "config" and value == "-"):
                return None
            said += _said(parameter, value)
        return shlex.join(said)

    @cached_property
    def signature(self) -> inspect.Signature:
        """Every parameter with its evaluated annotation, the shared ones spelled out."""
        return signature_of(self.function)

    def _bound(self, *args: object, **kwargs: object) -> inspect.BoundArguments:
        """Arguments by parameter: one of several becomes a list, a list of names a text with commas."""
        for name in kwargs.keys() - self.signature.parameters.keys():
            meant = did_you_mean(name, self.signature.parameters)
            message = f"{self.function.__name__}() has no argument {name!r}{meant}"
            raise TypeError(message)
        given = self.signature.bind(*args, **kwargs)
        for name, value in given.arguments.items():
            parameter = self.signature.parameters[name]
            if parameter.kind is not parameter.VAR_POSITIONAL:
                given.arguments[name] = _as_taken(parameter.annotation, value)
        return given

    @property
    def about(self) -> str:
        """What it does: the docstring up to its first section."""
        return _SECTION.split(inspect.getdoc(self.function) or "", maxsplit=1)[0]

    @property
    def sections(self) -> dict[str, str]:
        """Sections of the docstring by their titles."""
        _, *parts = _SECTION.split(inspect.getdoc(self.function) or "")
        return dict(zip(parts[::2], parts[1::2], strict=True))

    @property
    def python_example(self) -> str:
        """The example as a call of Python."""
        given = [repr(value) for value in self.example.args]
        given += [f"{name}={value!r}" for name, value in self.example.kwargs.items()]
        return f"tr.{self.word}({', '.join(given)})"

    @cached_property
    def help(self) -> dict[str, str]:
        """What each parameter means, as the docstring or a shared annotation says."""
        annotations = {name: parameter.annotation for name, parameter in self.signature.parameters.items()}
        return {name: word_of(annotation).help for name, annotation in annotations.items()} | dict(
            _described(self.sections.get("Parameters", ""))
        )


_SECTION = re.compile(r"\n\n(Parameters|Returns|Raises)\n-+\n")
"""Head of a section of a numpydoc docstring."""

_RETURNS = """Result
    Numbers, tables and figures; of an experiment its runs, too."""

_RAISES = """UsageError, ConfigError
    For arguments or a configuration that cannot be used.
DataMissingError
    For a file that is missing or cannot be read.
TendonreproError
    For anything else that stops it. Each message says where, and what to do."""

COMMANDS: dict[str, Command] = {}
"""Commands by name, in the order in which their files are imported."""


def study(
    under: str, example: Example, *, has_dry_run: bool = True
) -> Callable[[Callable[P, Study]], Callable[P, Result]]:
    """Make a function that checks and prepares a study a command; for Python it gives a result."""

    def register(function: Callable[P, Study]) -> Callable[P, Result]:
        return _public(
            Command(_name(function, under), under, example, function, has_dry_run), function, _result
        )

    return register


def _result(study: Study) -> Result:
    from tendonrepro.studies.lifecycle import result_of

    return result_of(study)


def command(under: str, example: Example) -> Callable[[Callable[P, Answer[V]]], Callable[P, V]]:
    """Make a function that answers a command."""

    def register(function: Callable[P, Answer[V]]) -> Callable[P, V]:
        entry = Command(_name(function, under), under, example, function)
        return _public(entry, function, lambda answer: answer.value)

    return register


def _name(function: Callable[P, object], under: str) -> str:
    """Words that call a function: its name, behind that of its group."""
    word = function.__name__.removeprefix(f"{under}_")
    return f"{under} {word}" if under in GROUPS else word


def _public(
    entry: Command, function: Callable[P, Prepared], value: Callable[[Prepared], V]
) -> Callable[P, V]:
    """Register a command; for Python a function with all parameters, their types, and what each means."""
    COMMANDS[entry.name] = entry

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> V:
        return value(cast("Prepared", entry.prepare(*args, **kwargs)))

    parameters = [
        parameter.replace(annotation=_plain(parameter.annotation))
        for parameter in entry.signature.parameters.values()
    ]
    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    lines = []
    for parameter in parameters:
        kind = re.sub(r"[a-z.]+\.(?=[A-Z])", "", inspect.formatannotation(parameter.annotation))
        # The words are those of an option, which takes away what holds by default: --no-figures.
        flag = "False: " if parameter.default is True else ""
        lines += [f"{parameter.name} : {kind}", f"    {flag}{entry.help[parameter.name]}"]
    sections = {"Parameters": "\n".join(lines), "Returns": _RETURNS, "Raises": _RAISES}
    sections |= {title: text for title, text in entry.sections.items() if title != "Parameters"}
    sections |= {"Examples": f"``{entry.python_example}``"}
    told = [f"{title}\n{'-' * len(title)}\n{text}" for title, text in sections.items() if text]
    call.__doc__ = "\n\n".join([entry.about, *told])
    return call


def _as_taken(annotation: object, value: object) -> object:
    """``[value]`` where that alone fits, since Python would take a text for a sequence of letters.

    And names with commas between, as on the command line, where several stand for a text.
    """
    choices = kinds_of(annotation)
    items = [get_args(choice)[0] for choice in choices if get_origin(choice) is Sequence]
    if isinstance(value, list | tuple) and value and str in choices and not items:
        return ",".join(value)
    is_one = type(value) in items and type(value) not in choices
    return [value] if is_one else value


def signature_of(function: Callable[..., object]) -> inspect.Signature:
    """Signature with evaluated annotations; keywords of a `Folder` and its like stand for themselves."""
    # What it returns may be a type that only a type checker sees.
    own = {name: text for name, text in function.__annotations__.items() if name != "return"}
    hints = get_type_hints(SimpleNamespace(__annotations__=own), function.__globals__, include_extras=True)
    parameters = []
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            kind = inspect.Parameter.KEYWORD_ONLY
            (options,) = get_args(hints[name])
            shared = get_type_hints(options, include_extras=True)
            parameters += [
                inspect.Parameter(key, kind, default=default, annotation=shared[key])
                for key, default in ON_PLANTS.items()
                if key in shared
            ]
        else:
            parameters.append(parameter.replace(annotation=hints[name]))
    return inspect.Signature(parameters)


def option_of(parameter: inspect.Parameter) -> str:
    """Its option; the flag of what holds by default says that it shall not."""
    negated = "no-" if parameter.default is True else ""
    return word_of(parameter.annotation).option or f"--{negated}{parameter.name.replace('_', '-')}"


def _said(parameter: inspect.Parameter, value: object) -> Iterator[str]:
    """Words of a shell for an argument."""
    if parameter.kind is parameter.VAR_POSITIONAL or word_of(parameter.annotation).positional:
        yield from map(str, value if isinstance(value, list | tuple) else (value,))
        return
    if isinstance(value, Mapping):
        compact = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), default=str)
        texts = {key: compact.encode(entry) for key, entry in value.items()}
        # Several values of a key stand without brackets: KEY=A,B,C.
        is_list = "," in word_of(parameter.annotation).metavar
        value = [f"{key}={text[1:-1] if is_list else text}" for key, text in texts.items()]
    elif isinstance(value, list | tuple) and str in kinds_of(parameter.annotation):
        value = ",".join(map(str, value))
    for item in value if isinstance(value, list | tuple) else (value,):
        yield option_of(parameter)
        if not isinstance(item, bool):
            yield str(item)


def kinds_of(annotation: object) -> tuple[object, ...]:
    """Types that a parameter may have: those of a union, or the one."""
    plain = _plain(annotation)
    return get_args(plain) if get_origin(plain) in {Union, UnionType} else (plain,)


def _plain(annotation: object) -> object:
    """The type alone, without how it stands on the command line."""
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def word_of(annotation: object) -> Word:
    """How an annotation says that a parameter stands on the command line."""
    return next((part for part in getattr(annotation, "__metadata__", ()) if isinstance(part, Word)), Word())


def _described(section: str) -> Iterator[tuple[str, str]]:
    """Parameters that a section of a numpydoc docstring describes, and what it says of each."""
    name, words = "", []
    for line in [*section.splitlines(), "end"]:
        if line.startswith(" "):
            words.append(line.strip())
            continue
        for parameter in filter(None, name.split(", ")):
            yield parameter, " ".join(words)
        name, words = line.partition(" : ")[0], []
