"""How every command prints: words on standard error, results on standard output."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from typer import Option

from tendonrepro.console import Talk
from tendonrepro.studies.study import Answer

TERMINAL: dict[str, object] = {
    "as_json": Annotated[bool, Option("--json", help="Print one JSON object.")],
    "quiet": Annotated[bool, Option("--quiet", "-q", help="Print nothing but errors.")],
    "verbose": Annotated[bool, Option("--verbose", "-v", help="Say more on standard error.")],
}
"""Options of every command."""


@dataclass(frozen=True)
class Terminal:
    """What a user wants to see."""

    as_json: bool
    quiet: bool
    verbose: bool

    @property
    def talk(self) -> Talk:
        """Notes and progress."""
        return Talk(quiet=self.quiet, verbose=self.verbose)

    def show(self, answer: Answer[object]) -> None:
        """Print an answer as JSON or in words."""
        if self.as_json:
            from tendonrepro.files import to_json

            typer.echo(to_json(dict(answer.data)), nl=False)
        elif not self.quiet:
            typer.echo(answer.text)
