"""From the signature and docstring of a command to arguments and options of Typer, and its answer printed."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Literal, cast, get_args, get_origin

import typer

from tendonrepro.console import Talk, without_controls
from tendonrepro.files import to_json
from tendonrepro.studies.command import Command, kinds_of, option_of, word_of
from tendonrepro.studies.parameters import Telling
from tendonrepro.studies.study import Answer

_DRY_RUN = Annotated[bool, typer.Option("--dry-run", help="Check everything, run nothing.")]

TERMINAL: dict[str, object] = {
    "as_json": Annotated[bool, typer.Option("--json", help="Print one JSON object.")],
    "quiet": Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")],
    "verbose": Annotated[bool, typer.Option("--verbose", "-v", help="Say more; with reproduce, all tables.")],
}
"""Options of every command."""


def add_command(app: typer.Typer, command: Command, *, hidden: bool = False) -> None:
    """Give a command to the command line: parse, call its function, print the answer."""
    own, about = command.signature.parameters, command.help
    options = [_option(given, about.get(name, "")) for name, given in own.items() if not _is_talk(given)]
    options += [_keyword("dry_run", False, _DRY_RUN)] if command.has_dry_run else []
    options += [_keyword(name, False, annotation) for name, annotation in TERMINAL.items()]

    def run(**words: object) -> int:
        as_json, quiet, verbose = (bool(words.pop(name)) for name in TERMINAL)
        answer = _answer(command, words, Talk(quiet=quiet, verbose=verbose))
        show(answer, as_json=as_json, quiet=quiet)
        return answer.exit_code

    run.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in options}
    run.__doc__ = command.about
    epilog = f"Example: {command.words(*command.example.args, **command.example.kwargs)}"
    app.command(command.word, epilog=epilog, rich_help_panel=command.under, hidden=hidden)(run)


def _answer(command: Command, words: Mapping[str, object], talk: Talk) -> Answer[object]:
    """Call the function of a command with what the command line gave."""
    positional: Sequence[object] = ()
    keywords: dict[str, object] = {}
    for name, parameter in command.signature.parameters.items():
        if _is_talk(parameter):
            keywords[name] = talk
        elif parameter.kind is parameter.VAR_POSITIONAL:
            positional = cast("Sequence[object]", words[name] or ())
        elif words[name] is not None:
            # The flag of what holds by default says that it shall not.
            keywords[name] = not words[name] if parameter.default is True else words[name]
    prepared = command.prepare(*positional, **keywords)
    if isinstance(prepared, Answer):
        return prepared
    from tendonrepro.studies.lifecycle import carry_out

    return carry_out(prepared, talk, dry_run=bool(words.get("dry_run")))


def show(answer: Answer[object], *, as_json: bool, quiet: bool) -> None:
    """Print an answer as JSON, or in words; these are on standard output, notes on standard error."""
    if as_json:
        typer.echo(without_controls(to_json(dict(answer.data))), nl=False)
    elif not quiet:
        typer.echo(without_controls(answer.text))


def _is_talk(parameter: inspect.Parameter) -> bool:
    return bool(parameter.annotation == Telling)


def _keyword(name: str, default: object, annotation: object) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _option(parameter: inspect.Parameter, about: str) -> inspect.Parameter:
    """A parameter of a public function as Typer wants it."""
    word, kind, default = word_of(parameter.annotation), _writable(parameter.annotation), parameter.default
    many = parameter.kind is parameter.VAR_POSITIONAL
    if many:
        kind = GenericAlias(list, (kind,))
    if many or default in (None, ()):
        kind, default = kind | None, None
    metavar = word.metavar or None
    if many or word.positional:
        return _keyword(parameter.name, default, Annotated[kind, typer.Argument(help=about, metavar=metavar)])
    if get_origin(_writable(parameter.annotation)) is list:
        about = f"{about.removesuffix('.')}; repeatable."
    option = typer.Option(option_of(parameter), help=about, metavar=metavar)
    # The flag of what holds by default says that it shall not.
    return _keyword(parameter.name, False if default is True else default, Annotated[kind, option])


def _writable(annotation: object) -> Any:
    """The type by which the command line gives a value: of a union, the first that it can write."""
    for kind in kinds_of(annotation):
        if get_origin(kind) is Sequence:
            return GenericAlias(list, get_args(kind))
        if kind in (bool, int, float, str, Path) or get_origin(kind) is Literal:
            return kind
    raise TypeError(annotation)
