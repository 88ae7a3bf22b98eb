"""Words to the user on standard error: notes, and a progress bar for long work."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(frozen=True)
class Talk:
    """How much to say.

    Attributes
    ----------
    quiet : bool
        Say nothing but errors.
    verbose : bool
        Say the details too.
    """

    quiet: bool = False
    verbose: bool = False

    def note(self, text: str) -> None:
        """Say something every user wants to know."""
        if not self.quiet:
            sys.stderr.write(f"{text}\n")

    def detail(self, text: str) -> None:
        """Say something only a curious user wants to know."""
        if self.verbose and not self.quiet:
            sys.stderr.write(f"{text}\n")

    @contextmanager
    def resumable(self) -> Iterator[None]:
        """Say, where the block is interrupted, that its work is not lost."""
        try:
            yield
        except KeyboardInterrupt:
            self.note("what is finished is kept: the same command goes on from there")
            raise

    @contextmanager
    def bar(self, label: str, total: int) -> Iterator[Callable[[int], None]]:
        """Show a progress bar while the block runs, if standard error is a terminal.

        Parameters
        ----------
        label : str
        total : int
            Steps of the whole work.

        Yields
        ------
        callable
            To be called with the number of steps just done.
        """
        if self.quiet or not sys.stderr.isatty():
            yield lambda _: None
            return
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task(label, total=total)
            yield lambda steps: progress.advance(task, steps)


def columns(rows: Iterable[Sequence[str]], *, left: bool = False) -> str:
    """Rows as columns, the first flush left and the others flush right, or all of them `left`."""
    cells = [list(row) for row in rows]
    widths = [max(len(cell) for cell in column) for column in zip(*cells, strict=True)]
    lines = (
        "  ".join(
            cell.ljust(w) if left or k == 0 else cell.rjust(w)
            for k, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    )
    return "\n".join(line.rstrip() if left else line for line in lines)
