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
from tendonrepro.dataset.guess import Guess, around_of, guesses_of, quoted, with_loads_inside
from tendonrepro.dataset.mapping import CHECK, SCHEMA_VERSION, kind_of
from tendonrepro.dataset.runs import by_clock, by_rows, even_step, is_digitised, starts_again
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
    further keys and their text; `check`, what to look at beside its name.
    """

    name: str
    columns: list[Guess] = field(default_factory=list)
    extras: dict[str, str] = field(default_factory=dict)
    check: str = ""

    @property
    def known(self) -> list[Guess]:
        """Its columns that are not asked."""
        return [guess for guess in self.columns if not guess.asked]

    @property
    def signals(self) -> int:
        """Number of its guessed columns that are no times."""
        return sum(guess.use.variable != "time" for guess in self.known)

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
            run = runs.setdefault(name, RunGuess(name))
            mass = payload or math.nan
            if not run.columns and not math.isnan(mass) and mass != published().number("hardware.payload"):
                run.extras["payload_mass_kg"] = f"{mass:g}"
            if why := _left_out(run, guess):
                left.append(f"{quoted(guess.column)}: {guess.use}  # {why}")
            else:
                run.columns.append(guess)
    runs = {name: run for name, run in runs.items() if run.signals or len(run.known) < len(run.columns)}
    parts = [part for run in _with_desired(runs) for part in _parts(run)]
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


def _with_desired(runs: Mapping[str, RunGuess]) -> list[RunGuess]:
    """Runs, where desired angles that lie apart and name no controller are given to controllers without."""
    variables = {name: {guess.use.variable for guess in run.known} for name, run in runs.items()}
    named = [name for name in runs if name.startswith("controller_")]
    apart = [run for name, run in runs.items() if name not in named and variables[name] == {"time", "q_d"}]
    lacking = [runs[name] for name in named if "q_d" not in variables[name]]
    if not named and len(apart) > 1:
        lacking = [RunGuess("desired")]
    columns = [guess for run in apart for guess in run.columns]
    signals = [guess.use.signal for guess in columns if guess.use.joint]
    if not apart or not lacking or len({*signals}) < len(signals):
        return [*runs.values()]
    for run in lacking:
        run.columns += columns
        run.check = f"desired angles from {', '.join(other.name for other in apart)}"
    return lacking + [run for run in runs.values() if run not in lacking + apart]


def _parts(run: RunGuess) -> Iterator[RunGuess]:
    """Runs below each other in one table, where its time starts again; else the run, and what it needs."""
    errors: dict[str, float] = {}
    for table in list({id(guess.table): guess.table for guess in run.known}.values()):
        uses = {guess.column: guess.use for guess in run.known if guess.table is table}
        by_time = by_clock(table, uses)
        for clock, columns in by_time.items():
            if clock is None:
                said = f"no times in {table.name}: write the step in s, as 0.001"
                run.extras.setdefault("step_s", f"STEP  # FILL IN: {said}")
                continue
            (rows, _), *_ = by_rows(table, columns)
            time = uses[clock].to_si * table[clock][rows]
            if is_digitised(time) or len(by_time) > 2:
                for column in columns:
                    use, values = uses[column], table[column]
                    if kind_of(use.variable) == "angle":
                        size = math.degrees(use.to_si) * float(np.ptp(values[np.isfinite(values)]))
                        errors[use.variable] = max(errors.get(use.variable, 0.0), _READING_ERROR * size)
            elif step := even_step(time):
                said = (
                    "the times repeat, so they are rounded; this makes them from the numbers of the samples"
                )
                run.extras["step_s"] = f"{step:.6g}  {CHECK} {said}"
            elif len(run.tables) == len(by_time) == 1 and (again := len(starts_again(time))):
                for part in range(1, again + 2):
                    check = f"the time starts again: stretch {part} of {again + 1}"
                    extras = run.extras | {"part": str(part)}
                    yield replace(run, name=f"{run.name}_{part}", extras=extras, check=check)
                return
    if errors:
        told = ", ".join(f"{name}: {error:.2g}" for name, error in errors.items())
        said = "its times are uneven, so it was read off a figure, to half a percent of each curve's range"
        run.extras["reading_error_deg"] = f"{{{told}}}  {CHECK} {said}; else delete this line"
    yield run


def _written(runs: Sequence[RunGuess], left: Sequence[str], title: str) -> Iterator[str]:
    """Lines of a mapping; those of `left` are comments."""
    shared: Lines = {}
    sharing: list[RunGuess] = []
    for run in runs:
        # What is shared is taken from every table that holds it.
        together = _lines_of(run) | shared
        if all(_taken(together, other) == _taken(_lines_of(other), other) for other in (*sharing, run)):
            shared = together
            sharing.append(run)
    yield f"schema_version: {SCHEMA_VERSION}"
    yield f"title: {quoted(title)}"
    if shared:
        yield "columns:"
        yield from _column_lines(shared, "  ")
    yield "runs:" if runs else "runs: {}  # FILL IN: no column was known; write controller_1 and its file"
    for run in runs:
        names = [quoted(table.name) for table in run.tables]
        sources = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
        check = _check_of_run(run)
        mark = f"  {CHECK} {check}" if check else ""
        inner = [f"    {key}: {text}" for key, text in run.extras.items()]
        if run not in sharing:
            inner += ["    columns:", *_column_lines(_lines_of(run), "      ")]
        yield from (
            [f"  {run.name}:{mark}", f"    sources: {sources}", *inner]
            if inner
            else [f"  {run.name}: {sources}{mark}"]
        )
    if left:
        yield "# Left out, and why. To use a column, move its line under columns."
        yield from (f"#   {line}" for line in left)


def _lines_of(run: RunGuess) -> Lines:
    """Columns of a run, with the table where two share a column's name."""
    lines: Lines = {}
    for guess in run.columns:
        others = (other for other in run.known if other.column == guess.column)
        is_shared = not guess.asked and any(other.use != guess.use for other in others)
        lines.setdefault(f"{guess.table.last}:{guess.column}" if is_shared else guess.column, guess)
    return lines


def _taken(lines: Lines, run: RunGuess) -> dict[str, str]:
    """What a run would take by lines, from any of its tables."""
    names = {name for table in run.tables for name in table.named(lines)}
    return {name: str(guess.use) for name, guess in lines.items() if name in names}


def _check_of_run(run: RunGuess) -> str:
    checks = [run.check] if run.check else []
    if not re.fullmatch(r"controller_[123](_payload)?|decouple", run.name):
        checks.append("no controller named; if it is one, write controller_1, _2 or _3 before the colon")
    else:
        telling = [meaning_of(part, around=True) for part in around_of(run.tables[0].name)]
        unknown = [word for meaning in telling if meaning.controller for word in meaning.unknown]
        checks += [f"not known: {', '.join(unknown)}; taken as {run.name}, else rename it"] if unknown else []
    return "; ".join(checks)


def _column_lines(columns: Lines, indent: str) -> Iterator[str]:
    for name, guess in columns.items():
        check = f"  {CHECK} {guess.check}" if guess.check else ""
        mark = f"  # FILL IN, or delete: {guess.asked}" if guess.asked else check
        yield f"{indent}{quoted(name)}: {guess.use}{mark}"
