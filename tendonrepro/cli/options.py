"""What the commands share: their options, and how they print."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import typer
from typer import Argument, Option

from tendonrepro.configuration.request import Request, formats_of
from tendonrepro.console import Talk, count_of

_TERMINAL = {
    "as_json": Annotated[bool, Option("--json", help="Print one JSON object.")],
    "quiet": Annotated[bool, Option("--quiet", "-q", help="Print nothing but errors.")],
    "verbose": Annotated[bool, Option("--verbose", "-v", help="Say more on standard error.")],
}
_CONFIG = "Configuration file, - for standard input, or a shipped name."
_CHANGE = "Change a value of the configuration; repeatable."
_FORMATS = "Formats of figures [default: all three]."
_REQUEST = {
    "config": Annotated[str | None, Option("--config", help=_CONFIG)],
    "out": Annotated[Path | None, Option("--out", help="Results folder [default: its own below reports].")],
    "overrides": Annotated[list[str] | None, Option("--set", metavar="KEY=VALUE", help=_CHANGE)],
    "seed": Annotated[int | None, Option("--seed", help="Seed of all noise.")],
    "controllers": Annotated[
        str | None, Option("--controllers", metavar="1,3", help="Run only these controllers.")
    ],
    "dry_run": Annotated[bool, Option("--dry-run", help="Check everything, run nothing.")],
    "force": Annotated[bool, Option("--force", help="Overwrite other results, and files changed since.")],
    "formats": Annotated[str | None, Option("--formats", metavar="png,pdf,svg", help=_FORMATS)],
    "no_figures": Annotated[bool, Option("--no-figures", help="Draw no figures.")],
}
# What stands for the value, and the help, of own parameters whose docstring does not tell.
_TOLD = {
    "config": ("", _CONFIG),
    "set": ("KEY=VALUE", _CHANGE),
    "file": ("", "Trace file, or a results folder with one."),
    "mapping": ("", "Mapping file: which column is which variable."),
    "jobs": ("", "Processes; -1 is one for each processor."),
    "device": ("", "What runs the simulations; gpu needs one of NVIDIA's, and CuPy."),
    "force": ("", "Overwrite a file that is there."),
    "formats": ("png,pdf,svg", _FORMATS),
    "no_figures": ("", "Draw no figures."),
}


@dataclass(frozen=True)
class Terminal:
    """How a command prints: words on standard error, results on standard output."""

    as_json: bool
    quiet: bool
    verbose: bool

    @property
    def talk(self) -> Talk:
        """Notes and progress."""
        return Talk(quiet=self.quiet, verbose=self.verbose)

    def show(self, data: dict[str, Any], text: str | None = None) -> int:
        """Print a result as JSON or words, its own by default; return the exit code."""
        if self.as_json:
            from tendonrepro.files import to_json

            typer.echo(to_json(data), nl=False)
        elif not self.quiet:
            typer.echo(data["text"] if text is None else text)
        return 5 if data.get("diverged") else 0

    def list_files(self, paths: list[Path]) -> None:
        """Print files that were written."""
        names = [str(path) for path in paths]
        self.talk.detail(count_of(len(names), "file"))
        self.show({"schema_version": 1, "files": names}, "\n".join(names))


def options_of(given: dict[str, Any], *others: str) -> dict[str, Any]:
    """A command's own arguments, of its `locals`."""
    return {key: value for key, value in given.items() if key not in {"request", "terminal", *others}}


def command(
    app: typer.Typer, example: str, name: str | None = None, without: tuple[str, ...] = ("controllers",)
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a function a command.

    Its parameters `terminal` and `request` stand for options that all commands, and all that run something,
    share, those in `without` left out. Its keyword-only parameters are options, the others arguments. Its
    docstring tells of each, or `_TOLD` does.
    """

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        own, hints = inspect.signature(function).parameters, get_type_hints(function)
        head, _, section = (inspect.getdoc(function) or "").partition("\n\nParameters\n----------\n")
        told = _TOLD | {key: (metavar, text) for key, metavar, text in _PARAMETER.findall(section)}
        asked = {key: kind for key, kind in _REQUEST.items() if "request" in own and key not in without}

        def run(**given: Any) -> Any:
            terminal = Terminal(**{key: given.pop(key) for key in _TERMINAL})
            if "request" in own:
                given["request"] = _request({key: given.pop(key) for key in asked})
            return function(terminal=terminal, **given)

        keyword = inspect.Parameter.KEYWORD_ONLY
        shared = {}
        for key, kind in (asked | _TERMINAL).items():
            default = False if get_args(kind)[0] is bool else None
            shared[key] = inspect.Parameter(key, keyword, default=default, annotation=kind)
        kept = {}
        for key, parameter in own.items():
            if key not in {"request", "terminal"}:
                # Under -OO there is no docstring, and so no help.
                described = _described(parameter, hints[key], *told.get(key, ("", "")))
                kept[key] = parameter.replace(annotation=described, kind=keyword)
        run.__signature__ = inspect.Signature([*kept.values(), *shared.values()])  # type: ignore[attr-defined]
        run.__annotations__ = {key: parameter.annotation for key, parameter in (kept | shared).items()}
        run.__doc__ = head
        panel = app.rich_help_panel
        app.command(name or function.__name__, epilog=f"Example: {example}", rich_help_panel=panel)(run)
        return function

    return register


_PARAMETER = re.compile(r"^(\w+)(?: : (.+))?\n    (.+)", re.M)


def _described(parameter: inspect.Parameter, hint: Any, metavar: str, text: str) -> Any:
    """Type and help, as Typer wants them."""
    told: dict[str, Any] = {"help": text, "metavar": metavar or None}
    if parameter.kind is parameter.KEYWORD_ONLY:
        return Annotated[hint, Option(f"--{parameter.name.replace('_', '-')}", **told)]
    return Annotated[hint, Argument(**told)]


def _request(given: dict[str, Any]) -> Request:
    text = given.get("controllers")
    try:
        numbers = None if text is None else [int(part) for part in text.split(",")]
    except ValueError as error:
        message = f"must be numbers like 1,3, found {text!r}"
        raise typer.BadParameter(message, param_hint="--controllers") from error
    if "formats" in given:
        given["formats"] = formats_of(given["formats"], figures=not given.pop("no_figures"))
    return Request(**given | {"overrides": given.get("overrides") or (), "controllers": numbers})
