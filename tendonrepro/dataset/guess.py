"""A mapping guessed from the names of tables and columns."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypedDict

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import PAYLOAD
from tendonrepro.dataset.arrays import Source
from tendonrepro.dataset.clocks import by_clock, even_step, starts_again
from tendonrepro.dataset.digitised import is_digitised
from tendonrepro.dataset.mapping import LOOP_STEPS, Use, kind_of
from tendonrepro.dataset.suggestion import Asked, Guess, RunGuess, around_of, quoted, written
from tendonrepro.dataset.words import FACTORS, KINDS, ROLES, Meaning, meaning_of, variable_of

_USUAL = {"rate": "deg/s", "torque": "N m"}
_OTHER = {"s": "ms", "deg": "rad", "rad": "deg", "deg/s": "rad/s", "N m": "mN m"}
_OF_JOINTS = {"q_d", "q_encoder", "q_calculated", "e"}
_MOST_RADIANS = 3.2
"""Angles beyond are degrees; no joint turns by more than half a turn."""
_READING_ERROR = 0.005
"""Share of a curve's range by which it is taken to be misread."""
_PLACE = re.compile(r"\[\d+(,\d+)*\]| #\d+$")
_DERIVATIVE = re.compile(r"(?:q|theta|θ)_?d_?(\d)(?!\d)", re.IGNORECASE)


@dataclass
class _Table:
    """A table while its columns are guessed."""

    source: Source
    around: list[Meaning]
    said: dict[str, Meaning]
    variables: dict[str, str | None] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)
    checks: dict[str, str] = field(default_factory=dict)

    def values(self, column: str) -> Array:
        """A column's numbers."""
        return self.source.columns[column]

    def is_numbers(self, column: str) -> bool:
        """Whether a column holds numbers."""
        return self.source.columns[column].dtype.kind == "f"


class Guessed(TypedDict):
    """A guessed mapping.

    ``suggestion`` is its text; ``runs`` are their numbers of columns; ``left`` are lines for the other
    columns, and why.
    """

    suggestion: str
    runs: dict[str, int]
    left: list[str]


def guess_mapping(sources: Sequence[Source], title: str) -> Guessed:
    """Guess which column is which variable."""
    runs: dict[str, RunGuess] = {}
    asked: dict[str, list[Asked]] = {}
    left: list[str] = []
    for source in sources:
        for guess in _of_table(source):
            if isinstance(guess, Asked):
                asked.setdefault(guess.run, []).append(guess)
                continue
            run = runs.setdefault(guess.run, RunGuess(guess.run, guess.payload))
            same = next(
                (other for other in run.columns if other.use.signal == guess.use.signal and guess.use.joint),
                None,
            )
            if same is None:
                run.columns.append(guess)
            else:
                left.append(f"{quoted(guess.column)}: {guess.use}  # taken from {same.column}")
                _doubt_twin(run, same, guess)
    for name, columns in asked.items():
        known = runs.setdefault(name, RunGuess(name, None))
        if any(other.use.joint for other in known.columns):
            left += map(str, columns)
        else:
            known.asked += columns
    left = list(dict.fromkeys(left))
    whole = {
        name: run for name, run in runs.items() if run.asked or any(other.use.joint for other in run.columns)
    }
    whole = _with_desired(whole)
    parted = {part.name: part for run in whole.values() for part in _parts(run)}
    text = "\n".join(written(list(parted.values()), left, title)) + "\n"
    counts = {name: sum(other.use.joint > 0 for other in run.columns) for name, run in parted.items()}
    return {"suggestion": text, "runs": counts, "left": left}


def _with_desired(runs: dict[str, RunGuess]) -> dict[str, RunGuess]:
    """Give desired angles that lie apart and name no controller to the runs of controllers that lack them."""
    named = {name: run for name, run in runs.items() if name.startswith("controller_")}
    apart = {
        name: run
        for name, run in runs.items()
        if name not in named
        and not run.asked
        and {guess.use.variable for guess in run.columns} == {"time", "q_d"}
    }
    lacking = [run for run in named.values() if all(guess.use.variable != "q_d" for guess in run.columns)]
    if not apart or (named and not lacking) or (not named and len(apart) < 2):
        return runs
    if not named:
        lacking = [RunGuess("desired", None)]
        named = {"desired": lacking[0]}
    for run in lacking:
        columns = [replace(guess, run=run.name) for other in apart.values() for guess in other.columns]
        signals = {guess.use.signal for guess in columns if guess.use.joint}
        if len(signals) < sum(guess.use.joint > 0 for guess in columns):
            return runs
        run.columns += columns
        run.check = f"desired angles from {', '.join(apart)}"
    return named | {name: run for name, run in runs.items() if name not in apart and name not in named}


def _doubt_twin(run: RunGuess, same: Guess, twin: Guess) -> None:
    """Ask where another column of a table says the same of other numbers."""
    if twin.source is not same.source or np.array_equal(
        twin.source.columns[twin.column], same.source.columns[same.column], equal_nan=True
    ):
        return
    other = "q_d" if same.use.variable == "q_encoder" else "q_encoder"
    line = replace(same.use, variable=other) if same.use.variable in ("q_encoder", "q_d") else same.use
    check = f"{quoted(twin.column)} says the same; one of the two may be {line}"
    place = run.columns.index(same)
    run.columns[place] = replace(same, check="; ".join(filter(None, [same.check, check])))


def _parts(run: RunGuess) -> Iterator[RunGuess]:
    """Runs below each other in one table, where its time starts again; else the run, and what it needs."""
    tables = {id(guess.source): guess.source for guess in run.columns}
    for source in tables.values():
        uses = {guess.column: guess.use for guess in run.columns if guess.source is source}
        clocks = [(clock, columns) for clock, columns in by_clock(source.columns, uses).items()]
        for clock, columns in clocks:
            if clock is None:
                said = f"no times in {source.name}: write the step in s, as 0.001"
                run.extras.setdefault("step_s", f"STEP  # FILL IN: {said}")
                continue
            time = uses[clock].to_si * source.columns[clock]
            if is_digitised(time) or len(clocks) > 2:
                _ask_reading_error(run, source, uses, columns)
            elif step := even_step(time):
                check = (
                    "the times repeat, so they are rounded; this makes them from the numbers of the samples"
                )
                run.extras["step_s"] = f"{step:.6g}  # CHECK: {check}"
            elif len(tables) == 1 and len(clocks) == 1 and (again := len(starts_again(time))):
                for part in range(1, again + 2):
                    yield run.part(part, again + 1)
                return
    yield run


def _ask_reading_error(run: RunGuess, source: Source, uses: dict[str, Use], columns: Sequence[str]) -> None:
    """Take a run for read off a figure, with an error by the range of its curves."""
    for column in columns:
        use = uses[column]
        if kind_of(use.variable) == "angle":
            error = math.degrees(use.to_si) * _READING_ERROR * float(np.ptp(_known(source.columns[column])))
            run.reading_error[use.variable] = max(run.reading_error.get(use.variable, 0.0), error)


def _known(values: Array) -> Array:
    return values[np.isfinite(values)]


def _of_table(source: Source) -> Iterator[Guess | Asked]:
    """Guess every column, or give the line to write, and why."""
    around = [meaning_of(part) for part in around_of(source.name)]
    said = {column: meaning_of(_PLACE.sub("", column)) for column in source.columns}
    table = _Table(source, around, said)
    table.variables = {column: variable_of(_with_context(words, around)) for column, words in said.items()}
    table.numbers = {column: _number_of(column, [words, *around]) for column, words in said.items()}
    _take_times(table)
    _take_rates(table)
    variables, numbers = table.variables, table.numbers
    counted = {numbers[column] for column, variable in variables.items() if variable not in (None, "time")}
    is_compared = any(words.controller for words in (*said.values(), *around))
    # Angles of joints in one table share a unit: a small error alone would pass for radians.
    joints = [column for column, name in variables.items() if name in _OF_JOINTS and not said[column].unit]
    most = max((_largest(table.values(column)) for column in joints if table.is_numbers(column)), default=0.0)
    # The comparison moves the paper's joints 2 and 3, which a lab may count from 1.
    shift = int(is_compared and counted == {1, 2})
    for column, words in said.items():
        for run, payload in _runs_of(table, column):
            yield _guessed(table, column, words, (run, payload), shift, most)


def _guessed(
    table: _Table, column: str, said: Meaning, run: tuple[str, float | None], shift: int, most: float
) -> Guess | Asked:
    """What a column is in one of the runs that it belongs to."""
    variable, joint = table.variables[column], table.numbers[column] + shift
    problem = (
        "" if column in table.checks else _problem(said, variable, joint, table.values(column).dtype.kind)
    )
    if problem or variable is None:
        # A place in an array tells a joint only where the array is known.
        is_told = joint in (1, 2, 3) and (variable is not None or said.joint is not None)
        number = str(joint) if is_told else "JOINT"
        unit = said.unit
        if unit is None and variable is not None and not said.unknown and table.is_numbers(column):
            unit = _unit(variable, None, table.values(column), most)[0]
        return Asked(table.source, column, variable or "VARIABLE", number, unit or "UNIT", run[0], problem)
    unit, sized = _unit(variable, said.unit, table.values(column), most)
    use = Use(variable, 0 if variable == "time" else joint, unit)
    checks = [*filter(None, [table.checks.get(column, "")]), *_checks(said, use, sized)]
    if use.joint and (shift or said.joint is None):
        checks.append(
            f"joint {table.numbers[column]} of the file, taken as {joint}; else {variable} N {unit}"
        )
    return Guess(table.source, column, use, *run, "; ".join(checks))


def _take_times(table: _Table) -> None:
    """Take a first column without a name for the times if it increases evenly; ask of times side by side."""
    columns = list(table.source.columns)
    if "time" not in table.variables.values() and table.is_numbers(columns[0]):
        first = columns[0]
        steps = np.diff(table.values(first))
        is_even = len(steps) > 1 and (steps > 0.0).all() and np.ptp(steps) < 0.01 * steps.mean()
        if is_even and table.variables[first] is None:
            table.variables[first] = "time"
            table.checks[first] = "the first column, whose numbers increase evenly, taken as times"
    for before, column in pairwise(columns):
        if table.variables[before] == table.variables[column] == "time":
            table.checks[column] = (
                f"times of {quoted(before)} are used; to use these delete the line of those"
            )


def _take_rates(table: _Table) -> None:
    """Take qd2 for a velocity beside qdd2, or beside a reference of joint 2."""
    for column, said in table.said.items():
        match = _DERIVATIVE.match(_PLACE.sub("", column).strip())
        if not match or table.variables[column] != "q_d" or (said.unit in FACTORS["angle"]):
            continue
        joint = match[1]
        second = next(
            (other for other in table.said if re.match(rf"(?:q|theta|θ)dd_?{joint}", other, re.I)), None
        )
        reference = next((other for other in table.said if _is_reference(table, other, column)), None)
        beside = second or reference
        if beside is not None:
            table.variables[column] = "dq"
            table.checks[column] = (
                f"stands beside {quoted(beside)}, taken as a velocity; else q_d {joint} deg"
            )


def _is_reference(table: _Table, column: str, rate: str) -> bool:
    """Whether a column is the desired angle of the same joint, under another word."""
    is_same = table.numbers[column] == table.numbers[rate] and table.variables[column] == "q_d"
    return is_same and not _DERIVATIVE.match(column.strip())


def _runs_of(table: _Table, column: str) -> list[tuple[str, float | None]]:
    """Runs that a column belongs to: that of its controller, or each whose columns name theirs."""
    said = table.said[column]
    own = [_run_of(table.source.name, one, table.around) for one in table.said.values() if one.controller]
    if said.controller is None and own:
        return list(dict.fromkeys(own))
    return [_run_of(table.source.name, said, table.around)]


def _number_of(column: str, telling: Sequence[Meaning]) -> int:
    """Joint by the nearest name that has one, else the place in an array."""
    place = re.search(r"\[(\d+)\]", column)
    said = next((meaning.joint for meaning in telling if meaning.joint is not None), None)
    return said if said is not None else int(place[1]) if place else 0


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
        steps = np.abs(np.diff(values))
        # Rounded times repeat; times of curves that were read off go back.
        step = float(np.nanmedian(steps)) or float(np.nanmean(steps))
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
        return f"controller_{controller}{PAYLOAD if payload else ''}", payload
    if any("decouple" in m.says for m in telling):
        return "decouple", payload
    return re.sub(r"\W+", "_", name).strip("_") or "run", payload
