"""A mapping guessed from the names of tables and columns."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.from_base import MOST_JOINTS
from tendonrepro.configuration.models.control import PAYLOAD
from tendonrepro.dataset.clocks import by_clock, by_rows, even_step, is_digitised, starts_again
from tendonrepro.dataset.mapping import CHECK, JOINT, LOOP_STEPS, UNIT, VARIABLE, Use, kind_of
from tendonrepro.dataset.suggestion import ColumnGuess, RunGuess, around_of, quoted, written
from tendonrepro.dataset.tables import BY_JOINT, Column, SourceTable
from tendonrepro.dataset.words import FACTORS, KINDS, ROLES, Meaning, is_other_unit, meaning_of, variable_of

_OTHER = {"s": "ms", "deg": "rad", "rad": "deg", "deg/s": "rad/s", "rad/s": "deg/s", "N m": "mN m"}
_OF_JOINTS = {"q_d", "q_encoder", "q_calculated", "e"}
_MOST_RADIANS = 3.2
"""Angles beyond are degrees; no joint turns by more than half a turn."""
_READING_ERROR = 0.005
"""Share of a curve's range by which it is taken to be misread."""
_PLACE = re.compile(r"\[\d+(,\d+)*\]| #\d+$")
_OF_ARRAY = re.compile(r"(.*)\[(\d+(?:,\d+)*)\]")
_QUANTITIES = frozenset({"torque", "motor", "rate", "other"})
"""What a name around a column may say of its quantity."""
_DERIVATIVE = re.compile(r"(.*?(?<![a-z]))(q|theta|θ)_?d_?(\d)(?!\d)", re.IGNORECASE)


@dataclass
class _Column:
    """A column while it is guessed: what its name says, what it is taken for, and what to check.

    `says` are the groups of its name and of the names around it; `doubt` is why it is not guessed after all.
    """

    name: str
    values: Column
    said: Meaning
    variable: str | None
    joint: int | None
    says: frozenset[str]
    check: str = ""
    doubt: str = ""

    @property
    def is_numbers(self) -> bool:
        """Whether it holds numbers, not words."""
        return self.values.dtype.kind == "f"

    @property
    def is_known(self) -> bool:
        """Whether it holds numbers, and every word of its name is known."""
        return self.is_numbers and self.variable is not None and not self.said.unknown


@dataclass(frozen=True)
class _Traits:
    """What columns of a table share.

    `most` is the largest angle of no unit; `stated`, the unit of angles that the file states for all of them;
    `of_angles`, theirs as rates beside them have it. `shift` leads from joints of the file, which are counted
    from `first`, to those of the paper.
    """

    most: float
    stated: str
    of_angles: str
    shift: int
    first: int


@dataclass(frozen=True)
class Suggestion:
    """A guessed mapping: its text; of its runs the number of columns; lines for other columns, and why."""

    text: str
    runs: dict[str, int]
    left: list[str]


def guess_mapping(tables: Sequence[SourceTable], title: str) -> Suggestion:
    """Guess which column is which variable."""
    runs: dict[str, RunGuess] = {}
    asked: list[ColumnGuess] = []
    left: list[str] = []
    names = {table.name for table in tables}
    tables = [table for table in tables if not names & {f"{table.name}{mark}{BY_JOINT}" for mark in ":."}]
    deciding = _with_loads_inside(tables)
    for guess in chain.from_iterable(_of_table(table, deciding) for table in tables):
        if guess.asked:
            asked.append(guess)
            continue
        run = runs.setdefault(guess.run, RunGuess(guess.run, guess.payload))
        twin = next((other for other in run.columns if other.use.signal == guess.use.signal), None)
        if twin is None or guess.use.variable == "time":
            run.columns.append(guess)
        else:
            left.append(f"{quoted(guess.column)}: {guess.use}  # taken from {twin.column}")
            _doubt_twin(run, twin, guess)
    for guess in asked:
        run = runs.setdefault(guess.run, RunGuess(guess.run, None))
        if run.signals:
            left.append(f"{quoted(guess.column)}: {guess.use}  # {guess.asked}")
        else:
            run.asked.append(guess)
    runs = _with_desired({name: run for name, run in runs.items() if run.asked or run.signals})
    parts = [part for run in runs.values() for part in _parts(run)]
    left = list(dict.fromkeys(left))
    text = "\n".join(written(parts, left, title)) + "\n"
    return Suggestion(text, {part.name: part.signals for part in parts}, left)


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


def _doubt_twin(run: RunGuess, taken: ColumnGuess, twin: ColumnGuess) -> None:
    """Ask where another column of a table says the same of other numbers."""
    if twin.table is not taken.table or np.array_equal(
        twin.table.columns[twin.column], taken.table.columns[taken.column], equal_nan=True
    ):
        return
    variable = taken.use.variable
    other = {"q_encoder": "q_d", "q_d": "q_encoder"}.get(variable, variable)
    check = f"{quoted(twin.column)} says the same; one of the two may be {replace(taken.use, variable=other)}"
    place = run.columns.index(taken)
    run.columns[place] = replace(taken, check="; ".join(filter(None, [taken.check, check])))


def _parts(run: RunGuess) -> Iterator[RunGuess]:
    """Runs below each other in one table, where its time starts again; else the run, and what it needs."""
    tables = {id(guess.table): guess.table for guess in run.columns}
    for table in tables.values():
        uses = {guess.column: guess.use for guess in run.columns if guess.table is table}
        by_time = by_clock(table.columns, uses)
        for clock, columns in by_time.items():
            if clock is None:
                said = f"no times in {table.name}: write the step in s, as 0.001"
                run.extras.setdefault("step_s", f"STEP  # FILL IN: {said}")
                continue
            (rows, _), *_ = by_rows(table.columns, columns)
            time = uses[clock].to_si * table.columns[clock][rows]
            if is_digitised(time) or len(by_time) > 2:
                _ask_reading_error(run, table, uses, columns)
            elif step := even_step(time):
                check = (
                    "the times repeat, so they are rounded; this makes them from the numbers of the samples"
                )
                run.extras["step_s"] = f"{step:.6g}  {CHECK} {check}"
            elif len(tables) == len(by_time) == 1 and (again := len(starts_again(time))):
                for part in range(1, again + 2):
                    yield run.part(part, again + 1)
                return
    yield run


def _ask_reading_error(
    run: RunGuess, table: SourceTable, uses: dict[str, Use], columns: Sequence[str]
) -> None:
    """Take a run for read off a figure, with an error by the range of its curves."""
    for column in columns:
        use = uses[column]
        if kind_of(use.variable) == "angle":
            values = table.columns[column]
            size = float(np.ptp(values[np.isfinite(values)]))
            error = math.degrees(use.to_si) * _READING_ERROR * size
            run.reading_error[use.variable] = max(run.reading_error.get(use.variable, 0.0), error)


def _with_loads_inside(tables: Sequence[SourceTable]) -> set[tuple[str, ...]]:
    """Tables, files and folders in which a nearer name tells a load, so that their own tells none."""
    deciding: set[tuple[str, ...]] = set()
    for table in tables:
        places = around_of(table.name)
        if any(meaning_of(_PLACE.sub("", name)).payload for name in table.columns):
            deciding.add(tuple(places))
        for depth, place in enumerate(places):
            if meaning_of(place, around=True).payload or tuple(places[depth:]) in deciding:
                deciding.add(tuple(places[depth + 1 :]))
    return deciding


def _of_table(table: SourceTable, deciding: set[tuple[str, ...]]) -> Iterator[ColumnGuess]:
    """Guess every column, in each of the runs that it belongs to.

    A name around the table does not tell the load of its run where a nearer one of `deciding` does.
    """
    places = around_of(table.name)
    around = [meaning_of(part, around=True) for part in places]
    around = [
        replace(said, payload=None) if tuple(places[depth:]) in deciding else said
        for depth, said in enumerate(around)
    ]
    inside = len(around) - len(table.name.partition(":")[0].split("/"))
    columns = [_column(name, values, around, inside) for name, values in table.columns.items()]
    _take_times(columns)
    # The comparison moves the paper's joints 2 and 3, which a lab may count from 1 or 0.
    counted = {column.joint for column in columns if column.is_known and column.variable != "time"}
    is_compared = any(said.controller for said in (*(column.said for column in columns), *around))
    first = 0 if 0 in counted else 1
    shift = 1 - first + (is_compared and counted == {first, first + 1})
    _take_rates(columns, shift)
    _doubt_arrays(columns)
    # Angles of joints in one table share a unit: a small error alone would pass for radians.
    angles = [column for column in columns if column.is_known and column.variable in _OF_JOINTS]
    most = max((_largest(column.values) for column in angles if not column.said.unit), default=0.0)
    sized = {"rad"} if 0.0 < most <= _MOST_RADIANS else set()
    in_radians = ({column.said.unit for column in angles} - {None}) or sized
    stated = table.columns.angle_unit
    of_angles = stated or ("rad" if in_radians and "deg" not in in_radians else "deg")
    traits = _Traits(most, stated, of_angles, shift, first)
    # A column that names no controller belongs to each that another names.
    named = [_run_of(table.name, column.said, around) for column in columns if column.said.controller]
    for column in columns:
        own = [_run_of(table.name, column.said, around)]
        for run, payload in own if column.said.controller else dict.fromkeys(named or own):
            use, check, asked = _guessed(column, traits)
            yield ColumnGuess(table, column.name, use, run, payload, check, asked)


def _column(name: str, values: Column, around: Sequence[Meaning], inside: int) -> _Column:
    """What the name of a column says, and where it says nothing those around it."""
    said = meaning_of(_PLACE.sub("", name))
    place = re.search(r"\[(\d+)\]", name)
    joint = next((words.joint for words in (said, *around) if words.joint is not None), None)
    if joint is None:
        joint = int(place[1]) if place else None
    says = _with_context(said, around, inside)
    return _Column(name, values, said, variable_of(says), joint, says)


def _guessed(column: _Column, traits: _Traits) -> tuple[Use, str, str]:
    """What a column is and what to check; or its line with capitals to fill in, and why it is asked."""
    said, variable = column.said, column.variable
    joint = 0 if column.joint is None else column.joint + traits.shift
    problem = "" if column.check else _problem(column, joint)
    if problem or variable is None:
        return _to_fill(column, joint, traits), "", problem
    unit, sized = _unit(variable, said.unit, column.values, traits)
    use = Use(variable, 0 if variable == "time" else joint, unit)
    checks = [*filter(None, [column.check]), *_checks(column, use, sized)]
    if use.joint and (traits.shift or said.joint is None):
        counted = "" if traits.first else ", counted from 0"
        checks.append(
            f"joint {column.joint} of the file{counted}, taken as {joint}; else {variable} {JOINT} {unit}"
        )
    return use, "; ".join(checks), ""


def _to_fill(column: _Column, joint: int, traits: _Traits) -> Use:
    """Line of a column that is asked: what is sure, and capitals for the rest."""
    said, variable = column.said, column.variable
    # An unknown word may say another quantity of a joint or motor, unless it stands beside an angle or role.
    is_bare = bool(said.unknown) and not said.says & (KINDS | ROLES | {"angle"})
    if column.doubt or is_bare or not _fits(said.unit, variable):
        variable = None
    # A place in an array tells a joint only where the array is known.
    is_told = 1 <= joint <= MOST_JOINTS and (variable is not None or said.joint is not None)
    unit = None if is_other_unit(said.unit or "") else said.unit
    if unit is None and variable is not None and not said.unknown and column.is_numbers:
        unit = _unit(variable, None, column.values, traits)[0]
    return Use(variable or VARIABLE, joint if is_told else 0, unit or UNIT)


def _take_times(columns: Sequence[_Column]) -> None:
    """Take a first column without a name for the times if it increases evenly; ask of times side by side."""
    first = columns[0]
    is_free = first.is_numbers and first.variable is None and _fits(first.said.unit, "time")
    if is_free and all(other.variable != "time" for other in columns):
        steps = np.diff(first.values)
        if len(steps) > 1 and (steps > 0.0).all() and np.ptp(steps) < 0.01 * steps.mean():
            first.variable = "time"
            first.check = "the first column, whose numbers increase evenly, taken as times"
    for before, column in pairwise(columns):
        if before.variable == column.variable == "time":
            column.check = f"times of {quoted(before.name)} are used; to use these delete the line of those"


def _take_rates(columns: Sequence[_Column], shift: int) -> None:
    """Take qd2 for a velocity where a word says measured, or beside qdd2 or a reference of joint 2."""
    for column in columns:
        match = _DERIVATIVE.search(_PLACE.sub("", column.name))
        if not match or "desired" not in column.says or column.said.unit in FACTORS["angle"]:
            continue
        head, symbol, number = match.groups()
        angle = meaning_of(f"{head}{symbol}{number}")
        second = re.compile(rf"{re.escape(head)}{symbol}dd_?{number}", re.IGNORECASE)
        beside = [other.name for other in columns if second.match(other.name)] + [
            other.name
            for other in columns
            if (other.variable, other.joint) == ("q_d", column.joint) and not _DERIVATIVE.search(other.name)
        ]
        if beside or "measured" in angle.says:
            why = f"stands beside {quoted(beside[0])}" if beside else "is of what was measured"
            column.variable = "dq_d" if variable_of(angle.says) == "q_d" else "dq"
            column.check = f"{why}, taken as a velocity; else q_d {int(number) + shift} deg"


def _doubt_arrays(columns: Sequence[_Column]) -> None:
    """Guess no column of an array where its columns outnumber the joints, or would be the same."""
    arrays: dict[str, list[_Column]] = {}
    for column in columns:
        if match := _OF_ARRAY.fullmatch(column.name):
            arrays.setdefault(match[1], []).append(column)
    for array in arrays.values():
        taken = [column for column in array if column.variable not in (None, "time")]
        if len(taken) > 3 or len({(column.variable, column.joint) for column in taken}) < len(taken):
            for column in taken:
                column.doubt = f"one of {len(array)} columns of an array; nothing says which is which"


def _with_context(said: Meaning, around: Sequence[Meaning], inside: int) -> frozenset[str]:
    """What a name says, with role and quantity of the names around if it has none.

    The first `inside` of these are of sheets and structs, which tell the quantity of a column with a role,
    and whether it is of motors. A file's name tells of joints' or motors' quantities alone.
    """
    own = said.says
    wanted = ROLES | _QUANTITIES
    if own & (KINDS - {"rate", "torque"}):
        return own
    if own & (KINDS | ROLES):
        around = around[:inside]
        wanted = frozenset({"motor"} if own & KINDS else _QUANTITIES)
    telling = (m.says for place, m in enumerate(around) if not m.unknown and _tells(m.says, place < inside))
    near = next((says for says in telling if says & wanted), frozenset())
    if "joint" in own | near and own & (KINDS | ROLES):
        wanted -= {"motor"}
    if said.unit in FACTORS["angle"]:
        wanted -= {"rate", "torque", "other"}
    return own | (near & (wanted if own & KINDS else wanted | {"angle"}))


def _tells(says: frozenset[str], is_inside: bool) -> bool:
    """Whether a name around columns tells what they are: a speed or force may be that of an experiment."""
    return bool(says & (ROLES | {"torque", "motor"})) or is_inside or "joint" in says


def _problem(column: _Column, joint: int) -> str:
    """Why a column is asked, or an empty text."""
    said, variable = column.said, column.variable
    if not column.is_numbers:
        return "words, by which `where` of a run can choose rows"
    if said.unit and is_other_unit(said.unit):
        return f"no variable is in {said.unit}"
    if said.unknown:
        return f"not known: {', '.join(said.unknown)}"
    if variable is None:
        return _unsaid(column)
    if not _fits(said.unit, variable):
        return f"its name says {variable}, its unit {said.unit}"
    is_joint = variable == "time" or 1 <= joint <= MOST_JOINTS
    return column.doubt or ("" if is_joint else f"its name has no joint from 1 to {MOST_JOINTS}")


def _unsaid(column: _Column) -> str:
    """Why known words are no variable."""
    if "other" in column.says:
        return "a quantity that is not guessed, as a voltage or an acceleration"
    if column.says >= {"motor", "rate"}:
        return "a motor's velocity, which no variable holds"
    return "its words do not go together" if column.says & (KINDS | ROLES) else "no word says what it is"


def _fits(unit: str | None, variable: str | None) -> bool:
    """Whether a variable may have a unit, or a column of no known one any variable."""
    kind = None if variable is None else kind_of(variable)
    return unit is None or kind is None or unit in FACTORS[kind]


def _largest(values: Array) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


def _unit(variable: str, said: str | None, values: Array, traits: _Traits) -> tuple[str, str]:
    """Unit that its name or table says, else by the size of its numbers, which is told."""
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
        most = traits.most if variable in _OF_JOINTS else _largest(values)
        by_size = "deg" if most > _MOST_RADIANS else "rad"
        return traits.stated or by_size, "" if traits.stated else f"no unit, up to {most:.3g}"
    if kind == "rate":
        return f"{traits.of_angles}/s", "" if traits.stated else "no unit"
    return "N m", "no unit"


def _checks(column: _Column, use: Use, sized: str) -> Iterator[str]:
    """What was assumed, and the line to write if that is wrong."""
    if sized:
        yield f"{sized}, taken as {use.unit}; else {replace(use, unit=_OTHER.get(use.unit, 's'))}"
    if use.variable == "q_motor_encoder":
        yield f"motor, taken as the winch's angle; before the reducer {use} * 0.01"
    if use.variable == "e":
        yield f"error, taken as desired less measured; else {use} * -1"
    if use.variable == "tau_m" and "motor" in column.says:
        yield "torque of a motor, taken as at the joint; else delete this line"
    if use.variable == "q_encoder" and not column.said.says & {"angle", "measured"}:
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
