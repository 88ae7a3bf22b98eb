"""Runs that are suggested, of columns as they were guessed, and the text of their mapping."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from tendonrepro.configuration.published import published
from tendonrepro.console import without_controls
from tendonrepro.dataset.clocks import by_clock, by_rows, even_step, is_digitised, starts_again
from tendonrepro.dataset.guess import Guess, around_of, guesses_of, quoted, with_loads_inside
from tendonrepro.dataset.mapping import CHECK, SCHEMA_VERSION, Use, kind_of
from tendonrepro.dataset.tables import BY_JOINT, Columns
from tendonrepro.dataset.words import meaning_of

_READING_ERROR = 0.005
"""Share of a curve's range by which it is taken to be misread."""

Lines: TypeAlias = dict[str, Guess]
"""Columns by their names in a mapping."""


@dataclass(frozen=True)
class Suggestion:
    """A guessed mapping: its text; of its runs the number of columns; lines for other columns, and why."""

    text: str
    runs: dict[str, int]
    left: list[str]


@dataclass
class RunGuess:
    """A run that is suggested.

    `columns` are its guesses, or columns that a person has to fill in, since there are no others; `extras`,
    further keys and their text; `reading_error`, deg, by variable, if it was read off a figure; `check`, what
    to look at beside its name.
    """

    name: str
    payload: float | None = None
    columns: list[Guess] = field(default_factory=list)
    extras: dict[str, str] = field(default_factory=dict)
    reading_error: dict[str, float] = field(default_factory=dict)
    check: str = ""

    @property
    def signals(self) -> int:
        """Number of its guessed columns that are no times."""
        return sum(not guess.asked and guess.use.variable != "time" for guess in self.columns)

    @property
    def tables(self) -> list[Columns]:
        """Its tables, each once."""
        return list({guess.table.name: guess.table for guess in self.columns}.values())


def guess_mapping(tables: Sequence[Columns], title: str) -> Suggestion:
    """Guess which column is which variable, and which are those of a run."""
    names = {table.name for table in tables}
    tables = [table for table in tables if not names & {f"{table.name}{mark}{BY_JOINT}" for mark in ":."}]
    deciding = with_loads_inside(tables)
    guesses = [guess for table in tables for guess in guesses_of(table, deciding)]
    runs: dict[str, RunGuess] = {}
    left: list[str] = []
    for guess in sorted(guesses, key=lambda guess: bool(guess.asked)):
        for name, payload in guess.runs.items():
            run = runs.setdefault(name, RunGuess(name, None if guess.asked else payload))
            if why := _left_out(run, guess):
                left.append(f"{quoted(guess.column)}: {guess.use}  # {why}")
            else:
                run.columns.append(guess)
    runs = {
        name: run for name, run in runs.items() if run.signals or any(guess.asked for guess in run.columns)
    }
    parts = [part for run in _with_desired(runs).values() for part in _parts(run)]
    left = list(dict.fromkeys(left))
    # YAML takes control characters nowhere, not even in the comments that quote a column's name.
    text = without_controls("\n".join(_written(parts, left, title)) + "\n")
    return Suggestion(text, {part.name: part.signals for part in parts}, left)


def _left_out(run: RunGuess, guess: Guess) -> str:
    """Why a run does without a column, or an empty text."""
    if guess.asked:
        return guess.asked if run.signals else ""
    twin = next((other for other in run.columns if other.use.signal == guess.use.signal), None)
    if twin is None or guess.use.variable == "time":
        return ""
    if guess.table is twin.table and not np.array_equal(guess.values, twin.values, equal_nan=True):
        # Another column of a table says the same of other numbers.
        variable = twin.use.variable
        other = replace(twin.use, variable={"q_encoder": "q_d", "q_d": "q_encoder"}.get(variable, variable))
        check = f"{quoted(guess.column)} says the same; one of the two may be {other}"
        doubted = replace(twin, check="; ".join(filter(None, [twin.check, check])))
        run.columns[run.columns.index(twin)] = doubted
    return f"taken from {twin.column}"


def _with_desired(runs: dict[str, RunGuess]) -> dict[str, RunGuess]:
    """Give desired angles that lie apart and name no controller to the runs of controllers that lack them."""
    variables = {
        name: {guess.use.variable for guess in run.columns if not guess.asked} for name, run in runs.items()
    }
    named = {name: run for name, run in runs.items() if name.startswith("controller_")}
    apart = {
        name: run
        for name, run in runs.items()
        if name not in named and variables[name] == {"time", "q_d"} and run.signals
    }
    lacking = [run for name, run in named.items() if "q_d" not in variables[name]]
    if not apart or (named and not lacking) or (not named and len(apart) < 2):
        return runs
    columns = [guess for run in apart.values() for guess in run.columns]
    signals = [guess.use.signal for guess in columns if guess.use.joint]
    if len({*signals}) < len(signals):
        return runs
    named = named or {"desired": RunGuess("desired")}
    for run in lacking or named.values():
        run.columns += columns
        run.check = f"desired angles from {', '.join(apart)}"
    return named | {name: run for name, run in runs.items() if name not in apart and name not in named}


def _parts(run: RunGuess) -> Iterator[RunGuess]:
    """Runs below each other in one table, where its time starts again; else the run, and what it needs."""
    tables = {id(guess.table): guess.table for guess in run.columns if not guess.asked}
    for table in tables.values():
        uses = {guess.column: guess.use for guess in run.columns if guess.table is table and not guess.asked}
        by_time = by_clock(table, uses)
        for clock, columns in by_time.items():
            if clock is None:
                said = f"no times in {table.name}: write the step in s, as 0.001"
                run.extras.setdefault("step_s", f"STEP  # FILL IN: {said}")
                continue
            (rows, _), *_ = by_rows(table, columns)
            time = uses[clock].to_si * table[clock][rows]
            if is_digitised(time) or len(by_time) > 2:
                _ask_reading_error(run, table, {column: uses[column] for column in columns})
            elif step := even_step(time):
                check = (
                    "the times repeat, so they are rounded; this makes them from the numbers of the samples"
                )
                run.extras["step_s"] = f"{step:.6g}  {CHECK} {check}"
            elif len(tables) == len(by_time) == 1 and (again := len(starts_again(time))):
                for part in range(1, again + 2):
                    extras = run.extras | {"part": str(part)}
                    check = f"the time starts again: stretch {part} of {again + 1}"
                    yield replace(run, name=f"{run.name}_{part}", extras=extras, check=check)
                return
    yield run


def _ask_reading_error(run: RunGuess, table: Columns, uses: Mapping[str, Use]) -> None:
    """Take a run for read off a figure, with an error by the range of its curves."""
    for column, use in uses.items():
        if kind_of(use.variable) == "angle":
            values = table[column]
            size = float(np.ptp(values[np.isfinite(values)]))
            error = math.degrees(use.to_si) * _READING_ERROR * size
            run.reading_error[use.variable] = max(run.reading_error.get(use.variable, 0.0), error)


def _written(runs: Sequence[RunGuess], left: Sequence[str], title: str) -> Iterator[str]:
    """Lines of a mapping; those of `left` are comments."""
    shared: Lines = {}
    apart: dict[str, Lines] = {}
    sharing: list[RunGuess] = []
    for run in runs:
        own = _lines_of(run)
        # What is shared is taken from every table that holds it.
        together = own | shared
        if all(_matching(together, other) == _uses(_lines_of(other)) for other in (*sharing, run)):
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


def _lines_of(run: RunGuess) -> Lines:
    """Columns of a run, with the table where two share a column's name."""
    lines: Lines = {}
    for guess in run.columns:
        others = (other for other in run.columns if other.column == guess.column and not other.asked)
        is_shared = not guess.asked and any(other.use != guess.use for other in others)
        lines.setdefault(f"{guess.table.last}:{guess.column}" if is_shared else guess.column, guess)
    return lines


def _uses(lines: Lines) -> dict[str, str]:
    return {name: str(guess.use) for name, guess in lines.items()}


def _matching(lines: Lines, run: RunGuess) -> dict[str, str]:
    """Lines that a run would take, from any of its tables."""
    names = {name for table in run.tables for name in table.named(lines)}
    return {name: use for name, use in _uses(lines).items() if name in names}


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
    for name, guess in columns.items():
        check = f"  {CHECK} {guess.check}" if guess.check else ""
        mark = f"  # FILL IN, or delete: {guess.asked}" if guess.asked else check
        yield f"{indent}{quoted(name)}: {guess.use}{mark}"
