"""A mapping guessed from the names of tables and columns, to be checked by a person."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.mapping import CHECK, SCHEMA_VERSION, Use, kind_of
from tendonrepro.dataset.source import Source
from tendonrepro.dataset.words import FACTORS, ROLES, Meaning, meaning_of, variable_of

_DEFAULT = {"time": "s", "angle": "deg", "rate": "deg/s", "torque": "N m"}
_MOST_RADIANS = 3.2
"""Angles beyond are degrees; no joint turns by more than half a turn."""
_LOOP_STEPS = 5e-5, 0.1
"""Sampling steps of a control loop, s."""


@dataclass(frozen=True)
class Guess:
    """What one column is taken for, in which run, and what a person is to check about it."""

    source: Source
    column: str
    use: Use
    run: str
    payload: float | None
    check: str


@dataclass(frozen=True)
class Guessed:
    """A guessed mapping.

    Attributes
    ----------
    text : str
        Of the mapping file.
    runs : mapping
        Number of columns by run.
    left : list of str
        Columns that nobody could tell, each with its reason.
    """

    text: str
    runs: Mapping[str, int]
    left: list[str]


def guess_mapping(sources: Sequence[Source], title: str) -> Guessed:
    """Guess which column is which variable; what the table of words does not tell is left to the reader."""
    guesses: list[Guess] = []
    left: list[str] = []
    for source in sources:
        for column in source.columns:
            found = _guess(source, column)
            if isinstance(found, Guess):
                guesses.append(found)
            else:
                left.append(f"{source.name}: {column}: {found}")
    guesses = _numbered(guesses, sources)
    runs: dict[str, dict[str, list[Guess]]] = {}
    for guess in guesses:
        runs.setdefault(guess.run, {}).setdefault(guess.source.name, []).append(guess)
    runs = {run: tables for run, tables in runs.items() if _has_signal(tables)}
    text = "\n".join(_lines(runs, left, title)) + "\n"
    counts = {
        run: sum(g.use.variable != "time" for gs in tables.values() for g in gs)
        for run, tables in runs.items()
    }
    return Guessed(text, counts, left)


def _has_signal(tables: Mapping[str, Sequence[Guess]]) -> bool:
    return any(guess.use.variable != "time" for guesses in tables.values() for guess in guesses)


def _guess(source: Source, column: str) -> Guess | str:
    """What a column is; a reason where that is not told."""
    values = source.columns[column]
    if values.dtype.kind != "f":
        return "words, not numbers"
    name = re.sub(r"(\[\d+\])|( #\d+$)", "", column)
    said, around = meaning_of(name), [meaning_of(part) for part in _around(source.name)]
    if said.unknown:
        return f"not known: {', '.join(said.unknown)}"
    variable, check = variable_of(_with_context(said, around))
    if variable is None:
        return check or "no word says what it is"
    checks = [check] if check else []
    joint = next((m.joint for m in (said, *around) if m.joint is not None), None)
    index = re.search(r"\[(\d+)\]", column)
    if joint is None and index and variable != "time":
        joint = -int(index[1])
    if joint is None and variable != "time":
        return "no number says which joint"
    unit, why = _unit(variable, said.unit, values)
    checks += [why] if why else []
    run, payload, doubt = _run_of(source.name, said, around)
    checks += [doubt] if doubt and variable != "time" else []
    return Guess(source, column, Use(variable, joint or 0, unit), run, payload, "; ".join(checks))


def _around(name: str) -> list[str]:
    """Names around a column, the nearest first: sheet or struct, file, folders."""
    file, _, inner = name.partition(":")
    *folders, last = file.split("/")
    stem = re.sub(r"(\.[A-Za-z][A-Za-z0-9]{0,4})+$", "", last)
    parts = [part for part in re.split(r"\.(?!\d)", inner) if part]
    return [*reversed(parts), stem, *reversed(folders)]


def _with_context(said: Meaning, around: Sequence[Meaning]) -> frozenset[str]:
    """What a name says, with role and quantity of the names around it where it has none of its own."""
    says = said.says
    if says & {"time", "torque", "surface", "estimate", "rate"} or says & ROLES:
        return says
    for meaning in around:
        if not meaning.unknown and meaning.says & (ROLES | {"torque", "motor"}):
            return says | (meaning.says & (ROLES | {"torque", "motor", "angle"}))
    return says


def _unit(variable: str, said: str | None, values: Array) -> tuple[str, str]:
    """Unit of a column, and what to check about it: as its name says, else by the size of its numbers."""
    kind = kind_of(variable)
    if kind is None:
        return "", ""
    if said in FACTORS[kind]:
        return str(said), ""
    if kind == "time":
        step = float(np.nanmedian(np.diff(values)))
        fitting = [
            u
            for u in ("s", "ms", "us", "ns")
            if _LOOP_STEPS[0] <= step * FACTORS["time"][u] <= _LOOP_STEPS[1]
        ]
        return (fitting[0], "" if fitting[0] == "s" else "unit by its step") if fitting else ("s", "unit")
    if kind == "angle":
        most = float(np.nanmax(np.abs(values), initial=0.0))
        return ("deg" if most > _MOST_RADIANS else "rad"), f"unit by its range, up to {most:.3g}"
    return _DEFAULT[kind], "unit"


def _run_of(name: str, said: Meaning, around: Sequence[Meaning]) -> tuple[str, float | None, str]:
    """Name of a column's run, its payload and what to check: from the nearest name that says it."""
    telling = [said, *around]
    controller = next((m.controller for m in telling if m.controller is not None), None)
    payload = next((m.payload for m in telling if m.payload is not None), None)
    unknown = [word for m in around if m.controller is not None for word in m.unknown]
    doubt = f"controller? {', '.join(unknown)} is not known" if unknown else ""
    if controller in (1, 2, 3):
        loaded = payload is not None and payload != 0.0
        return f"controller_{controller}{'_payload' if loaded else ''}", payload, doubt
    if any("decouple" in m.says for m in telling):
        return "decouple", payload, ""
    plain = re.sub(r"\W+", "_", name).strip("_") or "run"
    return plain, payload, "which controller? rename the run"


def _numbered(guesses: Sequence[Guess], sources: Sequence[Source]) -> list[Guess]:
    """Put joints that count from 0, from the first moving one, or by place, on the paper's numbers."""
    found = []
    for source in sources:
        own = [guess for guess in guesses if guess.source is source]
        joints = {guess.use.joint for guess in own if guess.use.variable != "time"}
        places = {joint for joint in joints if joint < 0}
        compared = any(guess.run.startswith("controller_") for guess in own)
        shift, check = 0, ""
        if 0 in joints:
            shift, check = 1, "joint counted from 0?"
        elif joints and max(map(abs, joints)) == 2 and 1 in set(map(abs, joints)) and compared:
            shift, check = 1, "the file's joint 1 is taken for 2"
        elif places:
            check = "joint by the place of the column"
        for guess in own:
            if guess.use.variable != "time" and (shift or guess.use.joint in places):
                use = replace(guess.use, joint=abs(guess.use.joint) + shift)
                found.append(replace(guess, use=use, check="; ".join(filter(None, [guess.check, check]))))
            else:
                found.append(guess)
    return [guess for guess in found if guess.use.variable == "time" or 1 <= guess.use.joint <= 3]


def _lines(
    runs: Mapping[str, Mapping[str, Sequence[Guess]]], left: Sequence[str], title: str
) -> Iterator[str]:
    """Lines of the mapping file: columns that all runs share, runs, and what was left."""
    described = {run: _columns_of(tables) for run, tables in runs.items()}
    shared: dict[str, tuple[str, str]] = {}
    apart = set()
    for run, columns in described.items():
        if any(name in shared and shared[name][0] != use for name, (use, _) in columns.items()):
            apart.add(run)
        else:
            shared |= {name: entry for name, entry in columns.items() if name not in shared}
    # A column that only some runs should take must not be shared with tables that hold it as well.
    apart |= {run for run, tables in runs.items() if _holds_more(tables, described[run], shared)}
    shared = {
        name: entry
        for run, columns in described.items()
        if run not in apart
        for name, entry in columns.items()
    }
    yield f"schema_version: {SCHEMA_VERSION}"
    yield f"title: {_scalar(title)}"
    if shared:
        yield "columns:"
        yield from _column_lines(shared, "  ")
    yield "runs:" if runs else "runs: {}"
    for run, tables in runs.items():
        yield from _run_lines(run, tables, described[run] if run in apart else None)
    if left:
        yield "# Not guessed. To use one, give it a line under columns, as in 'name: q_d 2 deg'."
        yield from (f"#   {_printable(line)}" for line in left)


def _holds_more(
    tables: Mapping[str, Sequence[Guess]], own: Mapping[str, Any], shared: Mapping[str, Any]
) -> bool:
    held = {name for guesses in tables.values() for name in guesses[0].source.columns}
    return bool((held & shared.keys()) - own.keys())


def _columns_of(tables: Mapping[str, Sequence[Guess]]) -> dict[str, tuple[str, str]]:
    """Use and check by column; where two tables of a run have a column of one name, by table and column."""
    uses: dict[str, set[str]] = {}
    for guesses in tables.values():
        for guess in guesses:
            uses.setdefault(guess.column, set()).add(str(guess.use))
    found: dict[str, tuple[str, str]] = {}
    taken: set[tuple[str, int]] = set()
    for source, guesses in tables.items():
        for guess in guesses:
            place = (guess.use.variable, guess.use.joint)
            check = guess.check
            if place in taken and guess.use.variable != "time":
                continue
            taken.add(place)
            name = (
                guess.column
                if len(uses[guess.column]) == 1
                else f"{source.rpartition('/')[2]}:{guess.column}"
            )
            found.setdefault(name, (str(guess.use), check))
    return found


def _run_lines(
    run: str, tables: Mapping[str, Sequence[Guess]], columns: Mapping[str, tuple[str, str]] | None
) -> Iterator[str]:
    names = list(tables)
    first = next(guess for guesses in tables.values() for guess in guesses)
    mass = (
        first.payload
        if run.endswith("_payload") and first.payload and not math.isnan(first.payload)
        else None
    )
    check = "which controller? rename it" if not re.match(r"controller_[123]|decouple$", run) else ""
    mark = f"  {CHECK} {check}" if check else ""
    sources = _scalar(names[0]) if len(names) == 1 else f"[{', '.join(map(_scalar, names))}]"
    if columns is None and mass in (None, 0.2):
        yield f"  {run}: {sources}{mark}"
        return
    yield f"  {run}:{mark}"
    yield f"    sources: {sources}"
    if mass is not None:
        yield f"    payload_mass_kg: {mass:g}"
    if columns is not None:
        yield "    columns:"
        yield from _column_lines(columns, "      ")


def _column_lines(columns: Mapping[str, tuple[str, str]], indent: str) -> Iterator[str]:
    for name, (use, check) in columns.items():
        mark = f"  {CHECK} {_printable(check)}" if check else ""
        yield f"{indent}{_scalar(name)}: {use}{mark}"


def _scalar(text: str) -> str:
    """A text as YAML: in quotes unless it is plainly a text."""
    plain = re.fullmatch(r"[^\W\d_][\w ()./°-]*", text) and not text.endswith((" ", "."))
    words = {"yes", "no", "on", "off", "true", "false", "null", "y", "n", "nan", "inf"}
    return text if plain and text.lower() not in words else json.dumps(text, ensure_ascii=False)


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in text)
