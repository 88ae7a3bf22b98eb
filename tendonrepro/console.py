"""Words to the user: notes and a progress bar on standard error, counts, and columns."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff]")
"""All but tabs and ends of lines, and what else YAML takes for an end of a line or refuses."""

SHORT_SECONDS = 10.0
"""Work that takes less leaves no line in a log, and no two lines are closer."""


@dataclass(frozen=True)
class Talk:
    """How much to say: nothing but errors where `quiet`, the details too where `verbose`."""

    quiet: bool = False
    verbose: bool = False
    _told: set[str] = field(default_factory=set, repr=False, compare=False)

    def note(self, text: str) -> None:
        """Say something every user wants to know, once."""
        if not self.quiet and text not in self._told:
            self._told.add(text)
            sys.stderr.write(f"{without_controls(text)}\n")

    def detail(self, text: str) -> None:
        """Say something only a curious user wants to know."""
        if self.verbose:
            self.note(text)

    @contextmanager
    def bar(self, label: str, total: int) -> Iterator[Callable[[int], None]]:
        """Show progress while the block runs: a bar in a terminal, else lines of a log.

        Yields
        ------
        callable
            To be called with the number of steps just done, `total` of them in all.
        """
        if self.quiet or total < 1:
            yield lambda _: None
            return
        if not sys.stderr.isatty():
            yield _Log(self, label, total)
            return
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task(label, total=total)
            yield lambda steps: progress.advance(task, steps)


QUIET = Talk(quiet=True)
"""Says nothing but errors."""


class _Log:
    """Tells steps as lines: one each tenth or each minute, and none of what takes a few seconds."""

    def __init__(self, talk: Talk, label: str, total: int) -> None:
        self._talk, self._label, self._total, self._done = talk, label, total, 0
        self._began, self._told = time.monotonic(), (0.0, 0.0)

    def __call__(self, steps: int) -> None:
        self._done += steps
        share, seconds = self._done / self._total, time.monotonic() - self._began
        since, later = share - self._told[0], seconds - self._told[1]
        # Shares are sums of steps, and 0.3 - 0.2 is less than 0.1.
        if share < 1.0 and later >= SHORT_SECONDS and (since > 0.1 - 1e-9 or later >= 60.0):
            self._told = share, seconds
            left = lasting(seconds * (1.0 - share) / share)
            self._talk.note(f"{self._label}: {share:.0%} after {lasting(seconds)}, about {left} to go")


def without_controls(text: str) -> str:
    r"""A text in which names cannot speak to a terminal: control characters as in JSON, which stays JSON.

    >>> without_controls("q2 \x1b[31m")
    'q2 \\u001b[31m'
    """
    return _CONTROLS.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def lasting(seconds: float) -> str:
    """A time in words.

    >>> [lasting(seconds) for seconds in (3.2, 1000, 1e7)]
    ['3 s', '17 minutes', '2,778 hours']
    """
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} minutes" if seconds < 7200.0 else f"{seconds / 3600.0:,.0f} hours"


def count_of(number: int, noun: str, plural: str | None = None) -> str:
    """A number and its noun, "1 reading" or "2 readings"; `plural` where that has more than an s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def columns(rows: Iterable[Sequence[str]]) -> str:
    """Rows as columns, all flush left."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)
