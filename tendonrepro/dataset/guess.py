"""What columns of tables are, by their names and numbers; their runs; and the text of a mapping."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import PAYLOAD
from tendonrepro.configuration.models.manipulator import MOST_JOINTS
from tendonrepro.configuration.published import published
from tendonrepro.console import without_controls
from tendonrepro.dataset import words
from tendonrepro.dataset.mapping import CHECK, LOOP_STEPS, SCHEMA_VERSION, UNIT, VARIABLE, Use, kind_of
from tendonrepro.dataset.runs import by_clock, by_rows, even_step, is_digitised, starts_again
from tendonrepro.dataset.tables import BY_JOINT, Column, Columns

_OF_JOINTS = {"q_d", "q_encoder", "q_calculated", "e"}
_MOST_RADIANS = 3.2
"""Angles beyond are degrees; no joint turns by more than half a turn."""
_PLACE = re.compile(r"\[\d+(,\d+)*\]| #\d+$")
_OF_ARRAY = re.compile(r"(.*)\[(\d+(?:,\d+)*)\]")
_QUANTITIES = frozenset({"torque", "motor", "rate", "other"})
"""What a name around a column may say of its quantity."""
_DERIVATIVE = re.compile(r"(.*?(?<![a-z]))(q|theta|θ)_?d_?(\d)(?!\d)", re.IGNORECASE)
_READING_ERROR = 0.005
"""Share of a curve's range by which it is taken to be misread."""


@dataclass(eq=False)
class Guess:
    """A column: what its name says, what it is taken for, and what is to be checked.

    `says` are the groups of its name and of the names around it. `runs` are those that it belongs to, with
    the payload of each. `numbered` and `sized` tell how its joint and `unit` were found, if not by its name.
    `asked` says why the column is not guessed.
    """

    table: Columns
    column: str
    said: words.Meaning
    says: frozenset[str]
    joint: int | None
    variable: str | None
    runs: dict[str, float | None]
    unit: str = ""
    numbered: str = ""
    sized: str = ""
    checks: list[str] = field(default_factory=list)
    asked: str = ""

    @property
    def use(self) -> Use:
        """What it is in the mapping; where it is asked, capitals stand for what a person has to fill in."""
        said = self.said
        if not self.asked:
            return Use(
                self.variable or VARIABLE, 0 if self.variable == "time" else self.joint or 0, self.unit
            )
        # Beside an unknown word only an angle or a role is sure.
        is_sure = not said.unknown or said.says & (words.KINDS | words.ROLES | {"angle"})
        variable = self.variable if is_sure and _fits(said.unit, self.variable) else None
        is_joint = said.joint is not None and 1 <= said.joint <= MOST_JOINTS
        unit = said.unit if said.unit and words.plain_unit(said.unit) else UNIT
        return Use(variable or VARIABLE, self.joint or 0 if is_joint else 0, unit)

    @property
    def values(self) -> Column:
        """Its numbers or words."""
        return self.table[self.column]

    @property
    def is_numbers(self) -> bool:
        """Whether it holds numbers, not words."""
        return self.values.dtype.kind == "f"

    @property
    def is_known(self) -> bool:
        """Whether it holds numbers, and every word of its name is known."""
        return self.is_numbers and self.variable is not None and not self.said.unknown


def _quoted(text: str) -> str:
    """A text in quotation marks, as YAML reads it."""
    return json.dumps(text, ensure_ascii=False)


def _around_of(name: str) -> list[str]:
    """Names around a column, nearest first: sheet or struct, file, folders."""
    file, _, inner = name.partition(":")
    *folders, last = file.split("/")
    stem = re.sub(r"(\.[A-Za-z][A-Za-z0-9]{0,4})+$", "", last)
    parts = [part for part in re.split(r"\.(?!\d)", inner) if part]
    return [*reversed(parts), stem, *reversed(folders)]


def _with_loads_inside(tables: Sequence[Columns]) -> set[tuple[str, ...]]:
    """Tables, files and folders in which a nearer name tells a load, so that their own tells none."""
    deciding: set[tuple[str, ...]] = set()
    for table in tables:
        places = tuple(_around_of(table.name))
        loads = [any(words.meaning_of(_PLACE.sub("", name)).payload for name in table)]
        loads += [bool(words.meaning_of(place, around=True).payload) for place in places]
        deciding |= {places[depth:] for depth in range(len(places) + 1) if any(loads[: depth + 1])}
    return deciding


def _guesses_of(table: Columns, deciding: set[tuple[str, ...]]) -> list[Guess]:
    """Guess every column of a table.

    A name around the table does not tell the load of its run where a nearer one of `deciding` does.
    """
    places = _around_of(table.name)
    around = [words.meaning_of(part, around=True) for part in places]
    around = [
        replace(said, payload=None) if tuple(places[depth:]) in deciding else said
        for depth, said in enumerate(around)
    ]
    columns = [_named(table, name, around) for name in table]
    # A column that names no controller belongs to each that another names.
    shared: dict[str, float | None] = {}
    for column in columns:
        shared |= {} if not column.said.controller else column.runs | shared
    _take_times(columns)
    _number_joints(columns, around)
    _take_rates(columns)
    _find_units(columns, table.angle_unit)
    _doubt_arrays(columns)
    for column in columns:
        if shared and not column.said.controller:
            column.runs = shared
        if not column.checks:
            column.asked = column.asked or _problem(column)
        if not column.asked:
            column.checks += _checks(column)
    for pair in pairwise(columns):
        if all(column.variable == "time" and not column.asked for column in pair):
            pair[1].checks.append("other times stand to its left, and count; else delete their line")
    return columns


def _named(table: Columns, name: str, around: Sequence[words.Meaning]) -> Guess:
    """What the name of a column says, and where it says nothing those around it."""
    said = words.meaning_of(_PLACE.sub("", name))
    place = re.search(r"\[(\d+)\]", name)
    joint = next((near.joint for near in (said, *around) if near.joint is not None), None)
    if joint is None and place:
        joint = int(place[1])
    inside = len(around) - len(table.name.partition(":")[0].split("/"))
    says = _with_context(said, around, inside)
    return Guess(
        table, name, said, says, joint, words.variable_of(says), _runs_named(table.name, [said, *around])
    )


def _number_joints(columns: Sequence[Guess], around: Sequence[words.Meaning]) -> None:
    """Number joints as the paper does, whose 2 and 3 a lab may count from 1 or 0, and tell of it."""
    counted = {column.joint for column in columns if column.is_known and column.variable != "time"}
    is_compared = any(said.controller for said in (*(column.said for column in columns), *around))
    first = 0 if 0 in counted else 1
    shift = 1 - first + (is_compared and counted == {first, first + 1})
    for column in columns:
        if column.joint is not None:
            if shift or column.said.joint is None:
                how = "" if first else ", counted from 0"
                column.numbered = f"joint {column.joint} of the file{how}, taken as {column.joint + shift}"
            column.joint += shift


def _find_units(columns: Sequence[Guess], stated: str) -> None:
    """Find the units that columns' names say, else by the size of their numbers, which is told.

    Angles of joints share a unit, since a small error alone would pass for radians; rates go with it.
    """
    angles = [column for column in columns if column.is_known and column.variable in _OF_JOINTS]
    most = max((_largest(column.values) for column in angles if not column.said.unit), default=0.0)
    told = {column.said.unit for column in angles} - {None}
    is_small = not told and 0.0 < most <= _MOST_RADIANS
    of_angles = stated or ("rad" if is_small or (told and "deg" not in told) else "deg")
    for column in columns:
        if column.variable is None or not column.is_numbers:
            continue
        kind = kind_of(column.variable)
        if kind is None or column.said.unit in words.FACTORS[kind]:
            column.unit = words.plain_unit(column.said.unit or "") or ""
        elif kind == "time":
            column.unit, column.sized = _unit_of_times(column.values)
        elif kind == "angle":
            size = most if column.variable in _OF_JOINTS else _largest(column.values)
            column.unit = stated or ("deg" if size > _MOST_RADIANS else "rad")
            column.sized = "" if stated else f"no unit, up to {size:.3g}"
        else:
            column.unit = f"{of_angles}/s" if kind == "rate" else "N m"
            column.sized = "" if kind == "rate" and stated else "no unit"


def _unit_of_times(time: Array) -> tuple[str, str]:
    """Unit by which times step as a control loop does; and by how much, if that is not plain seconds."""
    low, high = LOOP_STEPS
    steps = np.abs(np.diff(time))
    # Rounded times repeat; times of curves that were read off go back.
    step = float(np.nanmedian(steps)) or float(np.nanmean(steps))
    unit = next((u for u in ("s", "ms", "us", "ns") if low <= step * words.FACTORS["time"][u] <= high), "s")
    return unit, "" if unit == "s" and low <= step <= high else f"no unit, step {step:.3g}"


def _take_times(columns: Sequence[Guess]) -> None:
    """Take a first column without a name for the times if it increases evenly."""
    first = columns[0]
    is_free = first.is_numbers and first.variable is None and _fits(first.said.unit, "time")
    if is_free and all(other.variable != "time" for other in columns):
        steps = np.diff(first.values)
        if len(steps) > 1 and (steps > 0.0).all() and np.ptp(steps) < 0.01 * steps.mean():
            first.variable = "time"
            first.checks = ["the first column, whose numbers increase evenly, taken as times"]


def _take_rates(columns: Sequence[Guess]) -> None:
    """Take qd2 for a velocity where a word says measured, or beside qdd2 or a reference of joint 2."""
    for column in columns:
        match = _DERIVATIVE.search(_PLACE.sub("", column.column))
        if not match or "desired" not in column.says or column.said.unit in words.FACTORS["angle"]:
            continue
        head, symbol, number = match.groups()
        angle = words.meaning_of(f"{head}{symbol}{number}")
        second = re.compile(rf"{re.escape(head)}{symbol}dd_?{number}", re.IGNORECASE)
        beside = [other.column for other in columns if second.match(other.column)]
        for other in columns:
            is_desired = (other.variable, other.joint) == ("q_d", column.joint)
            beside += [other.column] if is_desired and not _DERIVATIVE.search(other.column) else []
        if beside or "measured" in angle.says:
            why = f"stands beside {_quoted(beside[0])}" if beside else "is of what was measured"
            column.variable = "dq_d" if words.variable_of(angle.says) == "q_d" else "dq"
            column.checks = [f"{why}, taken as a velocity; else q_d {column.joint} deg"]


def _doubt_arrays(columns: Sequence[Guess]) -> None:
    """Guess no columns of an array that outnumber the joints, or would be the same."""
    arrays: dict[str, list[Guess]] = {}
    for column in columns:
        if match := _OF_ARRAY.fullmatch(column.column):
            arrays.setdefault(match[1], []).append(column)
    for array in arrays.values():
        taken = [column for column in array if column.variable not in (None, "time")]
        if len(taken) > 3 or len({(column.variable, column.joint) for column in taken}) < len(taken):
            for column in taken:
                column.variable = None
                column.asked = f"one of {len(array)} columns of an array; nothing says which is which"


def _with_context(said: words.Meaning, around: Sequence[words.Meaning], inside: int) -> frozenset[str]:
    """What a name says, with role and quantity of the names around if it has none.

    The first `inside` of these are of sheets and structs, which tell the quantity of a column with a role,
    and whether it is of motors. A file's name tells of joints' or motors' quantities alone.
    """
    own = said.says
    wanted = words.ROLES | _QUANTITIES
    if own & (words.KINDS - {"rate", "torque"}):
        return own
    if own & (words.KINDS | words.ROLES):
        around = around[:inside]
        wanted = frozenset({"motor"} if own & words.KINDS else _QUANTITIES)
    telling = (m.says for place, m in enumerate(around) if not m.unknown and _tells(m.says, place < inside))
    near = next((says for says in telling if says & wanted), frozenset())
    if "joint" in own | near and own & (words.KINDS | words.ROLES):
        wanted -= {"motor"}
    if said.unit in words.FACTORS["angle"]:
        wanted -= {"rate", "torque", "other"}
    return own | (near & (wanted if own & words.KINDS else wanted | {"angle"}))


def _tells(says: frozenset[str], is_inside: bool) -> bool:
    """Whether a name around columns tells what they are: a speed or force may be that of an experiment."""
    return bool(says & (words.ROLES | {"torque", "motor"})) or is_inside or "joint" in says


def _problem(column: Guess) -> str:
    """Why a column is asked, or an empty text."""
    said, variable = column.said, column.variable
    if not column.is_numbers:
        return "words, by which `where` of a run can choose rows"
    if said.unit and words.is_other_unit(said.unit):
        return f"no variable is in {said.unit}"
    if said.unknown:
        return f"not known: {', '.join(said.unknown)}"
    if variable is None:
        return "its words are those of no variable"
    if not _fits(said.unit, variable):
        return f"its name says {variable}, its unit {said.unit}"
    is_joint = variable == "time" or 1 <= (column.joint or 0) <= MOST_JOINTS
    return "" if is_joint else f"its name has no joint from 1 to {MOST_JOINTS}"


def _fits(unit: str | None, variable: str | None) -> bool:
    """Whether a variable may have a unit, or a column of no known one any variable."""
    kind = None if variable is None else kind_of(variable)
    return unit is None or kind is None or unit in words.FACTORS[kind]


def _largest(values: Array) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


def _checks(column: Guess) -> Iterator[str]:
    """What was assumed, and the line to write if that is wrong."""
    use = column.use
    if column.sized:
        other = next(unit for unit in words.FACTORS[kind_of(use.variable) or ""] if unit != use.unit)
        yield f"{column.sized}, taken as {use.unit}; else {replace(use, unit=other)}"
    if use.variable == "q_motor_encoder":
        yield f"motor, taken as the winch's angle; before the reducer {use} * 0.01"
    if use.variable == "e":
        yield f"error, taken as desired less measured; else {use} * -1"
    if use.variable == "tau_m" and "motor" in column.says:
        yield "torque of a motor, taken as at the joint; else delete this line"
    if use.variable == "q_encoder" and not column.said.says & {"angle", "measured"}:
        yield f"neither desired nor measured, taken as measured; else {replace(use, variable='q_d')}"
    if column.numbered and use.joint:
        yield f"{column.numbered}; else {replace(use, joint=0)}"


def _runs_named(name: str, telling: Sequence[words.Meaning]) -> dict[str, float | None]:
    """Run, and its payload, by the nearest name that says it, else by the table."""
    controller = next((said.controller for said in telling if said.controller is not None), None)
    payload = next((said.payload for said in telling if said.payload is not None), None)
    if controller in (1, 2, 3):
        return {f"controller_{controller}{PAYLOAD if payload else ''}": payload}
    if any("decouple" in said.says for said in telling):
        return {"decouple": payload}
    return {re.sub(r"\W+", "_", name).strip("_") or "run": payload}


_Lines: TypeAlias = dict[str, Guess]
"""Columns by their names in a mapping."""


@dataclass(frozen=True)
class Suggestion:
    """A guessed mapping: its text; of its runs the number of columns; lines for other columns, and why."""

    text: str
    runs: dict[str, int]
    left: list[str]


@dataclass
class _RunGuess:
    """A run that is suggested.

    `columns` are its guesses, or columns that a person has to fill in, since there are no others; `extras`,
    further keys and their text; `checks`, what to look at beside its name.
    """

    name: str
    columns: list[Guess] = field(default_factory=list)
    extras: dict[str, str] = field(default_factory=dict)
    checks: list[str] = field(default_factory=list)

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
    deciding = _with_loads_inside(tables)
    guesses = [guess for table in tables for guess in _guesses_of(table, deciding)]
    runs: dict[str, _RunGuess] = {}
    left: list[str] = []
    for guess in sorted(guesses, key=lambda guess: bool(guess.asked)):
        for name, payload in guess.runs.items():
            run = runs.setdefault(name, _RunGuess(name))
            if payload and math.isfinite(payload) and payload != published().number("hardware.payload"):
                run.extras.setdefault("payload_mass_kg", f"{payload:g}")
            if why := _left_out(run, guess):
                left.append(f"{_quoted(guess.column)}: {guess.use}  # {why}")
            else:
                run.columns.append(guess)
    runs = {name: run for name, run in runs.items() if run.signals or len(run.known) < len(run.columns)}
    parts = [part for run in _with_desired(runs) for part in _parts(run)]
    left = list(dict.fromkeys(left))
    # YAML takes control characters nowhere, not even in the comments that quote a column's name.
    text = without_controls("\n".join(_written(parts, left, title)) + "\n")
    return Suggestion(text, {part.name: part.signals for part in parts}, left)


def _left_out(run: _RunGuess, guess: Guess) -> str:
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
        check = f"{_quoted(guess.column)} says the same; one of the two may be {other}"
        run.columns[run.columns.index(twin)] = replace(twin, checks=[*twin.checks, check])
    return f"taken from {twin.column}"


def _with_desired(runs: Mapping[str, _RunGuess]) -> list[_RunGuess]:
    """Runs, where desired angles that lie apart and name no controller are given to controllers without."""
    variables = {name: {guess.use.variable for guess in run.known} for name, run in runs.items()}
    named = [name for name in runs if name.startswith("controller_")]
    apart = [run for name, run in runs.items() if name not in named and variables[name] == {"time", "q_d"}]
    lacking = [runs[name] for name in named if "q_d" not in variables[name]]
    if not named and len(apart) > 1:
        lacking = [_RunGuess("desired")]
    columns = [guess for run in apart for guess in run.columns]
    signals = [guess.use.signal for guess in columns if guess.use.joint]
    if not apart or not lacking or len({*signals}) < len(signals):
        return [*runs.values()]
    for run in lacking:
        run.columns += columns
        run.checks = [f"desired angles from {', '.join(other.name for other in apart)}"]
    return lacking + [run for run in runs.values() if run not in lacking + apart]


def _parts(run: _RunGuess) -> Iterator[_RunGuess]:
    """Runs below each other in one table, where its time starts again; else the run, and what it needs."""
    errors: dict[str, float] = {}
    for table in run.tables:
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
                    checks = [f"the time starts again: stretch {part} of {again + 1}"]
                    extras = run.extras | {"part": str(part)}
                    yield replace(run, name=f"{run.name}_{part}", extras=extras, checks=checks)
                return
    if errors:
        told = ", ".join(f"{name}: {error:.2g}" for name, error in errors.items())
        said = "its times are uneven, so it was read off a figure, to half a percent of each curve's range"
        run.extras["reading_error_deg"] = f"{{{told}}}  {CHECK} {said}; else delete this line"
    yield run


def _written(runs: Sequence[_RunGuess], left: Sequence[str], title: str) -> Iterator[str]:
    """Lines of a mapping; those of `left` are comments."""
    shared: _Lines = {}
    sharing: list[_RunGuess] = []
    for run in runs:
        # What is shared is taken from every table that holds it.
        together = _lines_of(run) | shared
        if all(_taken(together, other) == _taken(_lines_of(other), other) for other in (*sharing, run)):
            shared = together
            sharing.append(run)
    yield f"schema_version: {SCHEMA_VERSION}"
    yield f"title: {_quoted(title)}"
    if shared:
        yield "columns:"
        yield from _column_lines(shared, "  ")
    yield "runs:" if runs else "runs: {}  # FILL IN: no column was known; write controller_1 and its file"
    for run in runs:
        names = [_quoted(table.name) for table in run.tables]
        sources = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
        checks = [*run.checks, *_checks_of_name(run)]
        mark = f"  {CHECK} {'; '.join(checks)}" if checks else ""
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


def _lines_of(run: _RunGuess) -> _Lines:
    """Columns of a run, with the table where two share a column's name."""
    lines: _Lines = {}
    for guess in run.columns:
        others = (other for other in run.known if other.column == guess.column)
        is_shared = not guess.asked and any(other.use != guess.use for other in others)
        lines.setdefault(f"{guess.table.last}:{guess.column}" if is_shared else guess.column, guess)
    return lines


def _taken(lines: _Lines, run: _RunGuess) -> dict[str, str]:
    """What a run would take by lines, from any of its tables."""
    names = {name for table in run.tables for name in table.named(lines)}
    return {name: str(guess.use) for name, guess in lines.items() if name in names}


def _checks_of_name(run: _RunGuess) -> Iterator[str]:
    if not re.fullmatch(r"controller_[123](_payload)?|decouple", run.name):
        yield "no controller named; if it is one, write controller_1, _2 or _3 before the colon"
        return
    telling = [words.meaning_of(part, around=True) for part in _around_of(run.tables[0].name)]
    if unknown := [word for meaning in telling if meaning.controller for word in meaning.unknown]:
        yield f"not known: {', '.join(unknown)}; taken as {run.name}, else rename it"


def _column_lines(columns: _Lines, indent: str) -> Iterator[str]:
    for name, guess in columns.items():
        check = f"  {CHECK} {'; '.join(guess.checks)}" if guess.checks else ""
        mark = f"  # FILL IN, or delete: {guess.asked}" if guess.asked else check
        yield f"{indent}{_quoted(name)}: {guess.use}{mark}"
