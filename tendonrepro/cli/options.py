"""What the commands share: their options, and how they print."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

Config = Annotated[
    str | None, typer.Option("--config", help="Configuration file, - for standard input, or a shipped name.")
]
Out = Annotated[Path | None, typer.Option("--out", help="Results folder [default: reports/<experiment>].")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a value of the configuration; repeatable."),
]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of all noise.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Check everything, run nothing.")]
Force = Annotated[
    bool, typer.Option("--force", help="Overwrite results of another configuration or version.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say more on standard error.")]
Controllers = Annotated[
    str | None, typer.Option("--controllers", metavar="1,3", help="Run only these controllers.")
]
UserLaw = Annotated[
    str | None,
    typer.Option("--law", metavar="FILE:NAME", help="Run a law of your own beside them; FILE is executed."),
]


def numbers(text: str | None) -> list[int] | None:
    """Numbers of controllers, from text such as ``1,3``."""
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError as error:
        message = f"must be numbers like 1,3, found {text!r}"
        raise typer.BadParameter(message, param_hint="--controllers") from error


def list_files(paths: Sequence[Path], *, as_json: bool, quiet: bool, verbose: bool) -> None:
    """Print the files a command wrote."""
    names = [str(path) for path in paths]
    detail(f"{len(names)} files", quiet, verbose)
    show({"schema_version": 1, "files": names} if as_json else "\n".join(names), as_json=as_json, quiet=quiet)


def detail(text: str, quiet: bool, verbose: bool) -> None:
    """Say something only a curious user wants to know."""
    from tendonrepro.console import Talk

    Talk(quiet=quiet, verbose=verbose).detail(text)


def show(content: Any, *, as_json: bool, quiet: bool) -> None:
    """Print a result as text, or as JSON even where words are not wanted."""
    if as_json:
        from tendonrepro.files import to_json

        typer.echo(to_json(content), nl=False)
    elif not quiet:
        typer.echo(content)
