"""The text of a suggested mapping."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from tendonrepro.configuration.published import published
from tendonrepro.dataset.mapping import CHECK, SCHEMA_VERSION, Use
from tendonrepro.dataset.tables import SourceTable
from tendonrepro.dataset.words import meaning_of

Lines: TypeAlias = dict[str, tuple[str, str]]
"""Column -> what it is, and what to check about that."""


@dataclass(frozen=True)
class ColumnGuess:
    """What a column is taken for, in which run, and what to check.

    Where `asked` says why it was not guessed, `use` has capitals in place of what a person has to fill in.
    """

    table: SourceTable
    column: str
    use: Use
    run: str
    payload: float | None
    check: str
    asked: str


@dataclass
class RunGuess:
    """A run that is suggested.

    `columns` are its guesses; `asked`, columns that a person has to fill in, since there are no others;
    `extras`, further keys and their text; `reading_error`, deg, by variable, if it was read off a figure;
    `check`, what to look at beside its name.
    """

    name: str
    payload: float | None
    columns: list[ColumnGuess] = field(default_factory=list)
    asked: list[ColumnGuess] = field(default_factory=list)
    extras: dict[str, str] = field(default_factory=dict)
    reading_error: dict[str, float] = field(default_factory=dict)
    check: str = ""

    def part(self, number: int, of: int) -> RunGuess:
        """One of several stretches of a table."""
        check = f"the time starts again: stretch {number} of {of}"
        extras = self.extras | {"part": str(number)}
        return replace(self, name=f"{self.name}_{number}", extras=extras, check=check)

    @property
    def signals(self) -> int:
        """Number of its guessed columns that are no times."""
        return sum(guess.use.variable != "time" for guess in self.columns)

    @property
    def tables(self) -> list[SourceTable]:
        """Its tables, each once."""
        return list({guess.table.name: guess.table for guess in (*self.columns, *self.asked)}.values())


def written(runs: Sequence[RunGuess], left: Sequence[str], title: str) -> Iterator[str]:
    """Lines of a mapping; those of `left` are comments."""
    shared: Lines = {}
    apart: dict[str, Lines] = {}
    sharing: list[RunGuess] = []
    for run in runs:
        own = _columns_of(run)
        # What is shared is taken from every table that holds it.
        together = own | shared
        if all(_matching(together, other) == _uses(_columns_of(other)) for other in (*sharing, run)):
            shared = together
            sharing.append(run)
        else:
            apart[run.name] = own
    yield f"schema_version: {SCHEMA_VERSION}"
    yield f"title: {quoted(title)}"
    if shared:
        yield "columns:"
        yield from _column_lines(shared, "  ")
    yield "runs:" if runs else "runs: {}  # FILL IN: no column was known; write controller_1 and its file"
    for run in runs:
        yield from _run_lines(run, apart.get(run.name))
    if left:
        yield "# Left out, and why. To use a column, move its line under columns."
        yield from (f"#   {line}" for line in left)


def _uses(lines: Lines) -> dict[str, str]:
    return {name: use for name, (use, _) in lines.items()}


def _matching(lines: Lines, run: RunGuess) -> dict[str, str]:
    """Lines that a run would take, from any of its tables."""
    names = {name for table in run.tables for name in table.columns}
    names |= {f"{table.last}:{name}" for table in run.tables for name in table.columns}
    return {name: use for name, use in _uses(lines).items() if name in names}


def quoted(text: str) -> str:
    """A text in quotation marks, as YAML reads it."""
    return json.dumps(text, ensure_ascii=False)


def around_of(name: str) -> list[str]:
    """Names around a column, nearest first: sheet or struct, file, folders."""
    file, _, inner = name.partition(":")
    *folders, last = file.split("/")
    stem = re.sub(r"(\.[A-Za-z][A-Za-z0-9]{0,4})+$", "", last)
    parts = [part for part in re.split(r"\.(?!\d)", inner) if part]
    return [*reversed(parts), stem, *reversed(folders)]


def _columns_of(run: RunGuess) -> Lines:
    """Lines of a run, with the table where two share a column's name."""
    lines: Lines = {}
    for guess in run.columns:
        others = [other for other in run.columns if other.column == guess.column and other.use != guess.use]
        table = f"{guess.table.last}:" if others else ""
        check = f"{CHECK} {guess.check}" if guess.check else ""
        lines.setdefault(f"{table}{guess.column}", (str(guess.use), check))
    for guess in run.asked:
        lines.setdefault(guess.column, (str(guess.use), f"# FILL IN, or delete: {guess.asked}"))
    return lines


def _run_lines(run: RunGuess, columns: Lines | None) -> Iterator[str]:
    names = [quoted(table.name) for table in run.tables]
    sources = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
    check = _check_of_run(run)
    mark = f"  {CHECK} {check}" if check else ""
    mass = run.payload or math.nan
    is_usual = math.isnan(mass) or mass == published().number("hardware.payload")
    if columns is None and is_usual and not run.extras and not run.reading_error:
        yield f"  {run.name}: {sources}{mark}"
        return
    yield f"  {run.name}:{mark}"
    yield f"    sources: {sources}"
    if not is_usual:
        yield f"    payload_mass_kg: {mass:g}"
    yield from (f"    {key}: {text}" for key, text in run.extras.items())
    if run.reading_error:
        errors = ", ".join(f"{name}: {error:.2g}" for name, error in run.reading_error.items())
        said = "its times are uneven, so it was read off a figure, to half a percent of each curve's range"
        yield f"    reading_error_deg: {{{errors}}}  {CHECK} {said}; else delete this line"
    if columns is not None:
        yield "    columns:"
        yield from _column_lines(columns, "      ")


def _check_of_run(run: RunGuess) -> str:
    checks = [run.check] if run.check else []
    if not re.fullmatch(r"controller_[123](_payload)?|decouple", run.name):
        checks.append("no controller named; if it is one, write controller_1, _2 or _3 before the colon")
    else:
        telling = [meaning_of(part, around=True) for part in around_of(run.tables[0].name)]
        unknown = [word for meaning in telling if meaning.controller for word in meaning.unknown]
        if unknown:
            checks.append(f"not known: {', '.join(unknown)}; taken as {run.name}, else rename it")
    return "; ".join(checks)


def _column_lines(columns: Lines, indent: str) -> Iterator[str]:
    for name, (use, mark) in columns.items():
        yield f"{indent}{quoted(name)}: {use}" + (f"  {mark}" if mark else "")
