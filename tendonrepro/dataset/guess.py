"""A mapping guessed from the names of tables and columns."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.arrays import Source
from tendonrepro.dataset.mapping import CHECK, LOOP_STEPS, SCHEMA_VERSION, Use, kind_of
from tendonrepro.dataset.words import FACTORS, KINDS, ROLES, Meaning, meaning_of, variable_of

Lines: TypeAlias = dict[str, tuple[str, str]]
"""Column -> what it is, and what to check about that."""

_USUAL = {"rate": "deg/s", "torque": "N m"}
_OTHER = {"s": "ms", "deg": "rad", "rad": "deg", "deg/s": "rad/s", "N m": "mN m"}
_OF_JOINTS = {"q_d", "q_encoder", "q_calculated", "e"}
_MOST_RADIANS = 3.2
"""Angles beyond are degrees; no joint turns by more than half a turn."""
_PAPERS_PAYLOAD = 0.2


@dataclass(frozen=True)
class Guess:
    """What a column is taken for, in which run, and what to check."""

    source: Source
    column: str
    use: Use
    run: str
    payload: float | None
    check: str


def guess_mapping(sources: Sequence[Source], title: str) -> dict[str, Any]:
    """Guess which column is which variable.

    Returns
    -------
    dict
        ``suggestion``, the text of a mapping; ``runs``, their numbers of columns; and ``left``, lines for the
        other columns, and why.
    """
    runs: dict[str, list[Guess]] = {}
    left: list[str] = []
    for source in sources:
        for found in _of_table(source):
            if isinstance(found, str):
                left.append(found)
                continue
            run = runs.setdefault(found.run, [])
            same = [one.column for one in run if one.use.signal == found.use.signal and found.use.joint]
            if same:
                left.append(f"{_scalar(found.column)}: {found.use}  # taken from {same[0]}")
            else:
                run.append(found)
    left = list(dict.fromkeys(left))
    counts = {run: sum(one.use.joint > 0 for one in guesses) for run, guesses in runs.items()}
    runs = {run: guesses for run, guesses in runs.items() if counts[run]}
    text = "\n".join(_lines(runs, left, title)) + "\n"
    return {"suggestion": text, "runs": {run: counts[run] for run in runs}, "left": left}


def _of_table(source: Source) -> Iterator[Guess | str]:
    """Guess every column, or give the line to write, and why."""
    around = [meaning_of(part) for part in _around(source.name)]
    said = {column: meaning_of(re.sub(r"\[\d+\]| #\d+$", "", column)) for column in source.columns}
    variables = {column: variable_of(_with_context(one, around)) for column, one in said.items()}
    numbers = {column: _number_of(column, [one, *around]) for column, one in said.items()}
    counted = {numbers[column] for column, variable in variables.items() if variable not in (None, "time")}
    is_compared = any(one.controller for one in (*said.values(), *around))
    # Angles of joints in one table share a unit: a small error alone would pass for radians.
    joints = [column for column, name in variables.items() if name in _OF_JOINTS and not said[column].unit]
    sizes = [source.columns[column] for column in joints if source.columns[column].dtype.kind == "f"]
    most = max((_largest(values) for values in sizes), default=0.0)
    # The comparison moves the paper's joints 2 and 3, which a lab may count from 1.
    shift = int(is_compared and counted == {1, 2})
    for column, values in source.columns.items():
        variable, one, joint = variables[column], said[column], numbers[column] + shift
        problem = _problem(one, variable, joint, values.dtype.kind)
        if problem or variable is None:
            number = joint if joint in (1, 2, 3) else "JOINT"
            yield f"{_scalar(column)}: {variable or 'VARIABLE'} {number} {one.unit or 'UNIT'}  # {problem}"
            continue
        unit, sized = _unit(variable, one.unit, values, most)
        use = Use(variable, 0 if variable == "time" else joint, unit)
        checks = list(_checks(one, use, sized))
        if use.joint and (shift or one.joint is None):
            checks.append(f"joint {numbers[column]} of the file, taken as {joint}; else {variable} N {unit}")
        run, payload = _run_of(source.name, one, around)
        yield Guess(source, column, use, run, payload, "; ".join(checks))


def _number_of(column: str, telling: Sequence[Meaning]) -> int:
    """Joint by the nearest name that has one, else the place in an array."""
    place = re.search(r"\[(\d+)\]", column)
    said = next((meaning.joint for meaning in telling if meaning.joint is not None), None)
    return said if said is not None else int(place[1]) if place else 0


def _around(name: str) -> list[str]:
    """Names around a column, nearest first: sheet or struct, file, folders."""
    file, _, inner = name.partition(":")
    *folders, last = file.split("/")
    stem = re.sub(r"(\.[A-Za-z][A-Za-z0-9]{0,4})+$", "", last)
    parts = [part for part in re.split(r"\.(?!\d)", inner) if part]
    return [*reversed(parts), stem, *reversed(folders)]


def _with_context(said: Meaning, around: Sequence[Meaning]) -> frozenset[str]:
    """What a name says, with role and quantity of the names around if it has none."""
    if said.says & (KINDS | ROLES):
        return said.says
    wanted = ROLES | {"torque", "motor"}
    near = next((m.says for m in around if not m.unknown and m.says & wanted), frozenset())
    return said.says | (near & (wanted | {"angle"}))


def _problem(said: Meaning, variable: str | None, joint: int, kind: str) -> str:
    if kind != "f":
        return "words, by which `where` of a run can choose rows"
    if said.unknown:
        return f"not known: {', '.join(said.unknown)}"
    if variable is None:
        return "its words do not go together" if said.says & (KINDS | ROLES) else "no word says what it is"
    if said.unit and said.unit not in FACTORS.get(kind_of(variable) or "", {said.unit}):
        return f"a {variable} in {said.unit}"
    is_joint = variable == "time" or joint in (1, 2, 3)
    return "" if is_joint else "its name has no joint from 1 to 3"


def _largest(values: Array) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


def _unit(variable: str, said: str | None, values: Array, most: float) -> tuple[str, str]:
    """Unit that its name says, else by the size of its numbers, which is told.

    ``most`` is the table's largest angle.
    """
    kind = kind_of(variable)
    if kind is None or said in FACTORS[kind]:
        return said or "", ""
    if kind == "time":
        low, high = LOOP_STEPS
        step = float(np.nanmedian(np.diff(values)))
        unit = next((u for u in ("s", "ms", "us", "ns") if low <= step * FACTORS["time"][u] <= high), "s")
        return unit, "" if unit == "s" and low <= step <= high else f"no unit, step {step:.3g}"
    if kind == "angle":
        most = most if variable in _OF_JOINTS else _largest(values)
        return "deg" if most > _MOST_RADIANS else "rad", f"no unit, up to {most:.3g}"
    return _USUAL[kind], "no unit"


def _checks(said: Meaning, use: Use, sized: str) -> Iterator[str]:
    """What was assumed, and the line to write if that is wrong."""
    if sized:
        yield f"{sized}, taken as {use.unit}; else {replace(use, unit=_OTHER.get(use.unit, 's'))}"
    if use.variable == "q_motor_encoder":
        yield f"motor, taken as the winch's angle; before the reducer {use} * 0.01"
    if use.variable == "e":
        yield f"error, taken as desired less measured; else {use} * -1"
    if use.variable == "tau_m" and "motor" in said.says:
        yield "torque of a motor, taken as at the joint; else delete this line"
    if use.variable == "q_encoder" and not said.says & {"angle", "measured"}:
        yield f"neither desired nor measured, taken as measured; else {replace(use, variable='q_d')}"


def _run_of(name: str, said: Meaning, around: Sequence[Meaning]) -> tuple[str, float | None]:
    """Run and payload by the nearest name that says it, else by the table."""
    telling = [said, *around]
    controller = next((m.controller for m in telling if m.controller is not None), None)
    payload = next((m.payload for m in telling if m.payload is not None), None)
    if controller in (1, 2, 3):
        return f"controller_{controller}{'_payload' if payload else ''}", payload
    if any("decouple" in m.says for m in telling):
        return "decouple", payload
    return re.sub(r"\W+", "_", name).strip("_") or "run", payload


def _lines(runs: Mapping[str, Sequence[Guess]], left: Sequence[str], title: str) -> Iterator[str]:
    shared: Lines = {}
    apart: dict[str, Lines] = {}
    seen: set[str] = set()
    for run, guesses in runs.items():
        own = _columns_of(guesses)
        held = own.keys() | {name for guess in guesses for name in guess.source.columns}
        # What is shared would be taken from every table that holds it.
        if all(shared.get(name, ("",))[0] == own.get(name, ("",))[0] for name in held & seen):
            shared = own | shared
            seen |= held
        else:
            apart[run] = own
    yield f"schema_version: {SCHEMA_VERSION}"
    yield f"title: {_scalar(title)}"
    if shared:
        yield "columns:"
        yield from _column_lines(shared, "  ")
    yield "runs:" if runs else "runs: {}"
    for run, guesses in runs.items():
        yield from _run_lines(run, guesses, apart.get(run))
    if left:
        yield "# Left out, and why. To use a column, move its line under columns."
        yield from (f"#   {line}" for line in left)


def _columns_of(guesses: Sequence[Guess]) -> Lines:
    """Lines of a run, with the table where two share a column's name."""
    found: Lines = {}
    for guess in guesses:
        others = [one for one in guesses if one.column == guess.column and one.use != guess.use]
        table = f"{guess.source.last}:" if others else ""
        found.setdefault(f"{table}{guess.column}", (str(guess.use), guess.check))
    return found


def _run_lines(run: str, guesses: Sequence[Guess], columns: Lines | None) -> Iterator[str]:
    names = list(dict.fromkeys(guess.source.name for guess in guesses))
    sources = _scalar(names[0]) if len(names) == 1 else f"[{', '.join(map(_scalar, names))}]"
    check = _check_of_run(run, guesses)
    mark = f"  {CHECK} {check}" if check else ""
    mass = guesses[0].payload or math.nan
    is_usual = math.isnan(mass) or mass == _PAPERS_PAYLOAD
    if columns is None and is_usual:
        yield f"  {run}: {sources}{mark}"
        return
    yield f"  {run}:{mark}"
    yield f"    sources: {sources}"
    if not is_usual:
        yield f"    payload_mass_kg: {mass:g}"
    if columns is not None:
        yield "    columns:"
        yield from _column_lines(columns, "      ")


def _check_of_run(run: str, guesses: Sequence[Guess]) -> str:
    if not re.fullmatch(r"controller_[123](_payload)?|decouple", run):
        return "no controller named; if it is one, write controller_1, _2 or _3 before the colon"
    telling = [meaning_of(part) for part in _around(guesses[0].source.name)]
    unknown = [word for meaning in telling if meaning.controller for word in meaning.unknown]
    return f"not known: {', '.join(unknown)}; taken as {run}, else rename it" if unknown else ""


def _column_lines(columns: Lines, indent: str) -> Iterator[str]:
    for name, (use, check) in columns.items():
        yield f"{indent}{_scalar(name)}: {use}" + (f"  {CHECK} {check}" if check else "")


def _scalar(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
