"""Words to the user: notes and a progress bar on standard error, counts, and columns."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff]")
"""All but tabs and ends of lines, and what else YAML takes for an end of a line or refuses."""


@dataclass(frozen=True)
class Talk:
    """How much to say: nothing but errors where `quiet`, the details too where `verbose`."""

    quiet: bool = False
    verbose: bool = False

    def note(self, text: str) -> None:
        """Say something every user wants to know."""
        if not self.quiet:
            sys.stderr.write(f"{without_controls(text)}\n")

    def detail(self, text: str) -> None:
        """Say something only a curious user wants to know."""
        if self.verbose:
            self.note(text)

    @contextmanager
    def bar(self, label: str, total: int) -> Iterator[Callable[[int], None]]:
        """Show a progress bar while the block runs, if standard error is a terminal.

        Yields
        ------
        callable
            To be called with the number of steps just done, `total` of them in all.
        """
        if self.quiet or not sys.stderr.isatty():
            yield lambda _: None
            return
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task(label, total=total)
            yield lambda steps: progress.advance(task, steps)


QUIET = Talk(quiet=True)
"""Says nothing but errors."""


def without_controls(text: str) -> str:
    r"""A text in which names cannot speak to a terminal: control characters as in JSON, which stays JSON.

    >>> without_controls("q2 \x1b[31m")
    'q2 \\u001b[31m'
    """
    return _CONTROLS.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def count_of(number: int, noun: str, plural: str | None = None) -> str:
    """A number and its noun, "1 reading" or "2 readings"; `plural` where that has more than an s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def columns(rows: Iterable[Sequence[str]]) -> str:
    """Rows as columns, all flush left."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)
