"""From guesses to a mapping file that a user can read, confirm and mend.

What was not guessed is told at the head of the file, each with the line that settles it.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from tendonrepro.config.fields.strict_yaml import Node, dump
from tendonrepro.dataset.meaning.assignment import RUNS, places, runs_among, variable_of
from tendonrepro.dataset.meaning.columns import SHORTEST, Address, Column, same_curve
from tendonrepro.dataset.meaning.times import SAMPLING
from tendonrepro.dataset.meaning.words import few, printable
from tendonrepro.dataset.readers.signals import WORDS
from tendonrepro.dataset.readers.units import FACTORS, kind_of_variable
from tendonrepro.results.records import VARIABLES

PAYLOAD = 0.2
"""The paper's payload, kg, where a name says that there is one but not how heavy."""
_MOST_WRITTEN = 100  # columns in no run that are written out; more would bury the rest
_UNWRITABLE = re.compile("[\0\ud800-\udfff]")
"""What no mapping can hold: NUL, and halves of a pair that stand for bytes of no known encoding."""

_NO_TIME: Node = {"step_s": SAMPLING, "because": "the files hold no times; the paper samples every 1 ms"}

_NOT_GUESSED = (
    "what some columns are is not guessed; their lines stand at the end, take them under `signals` of a run "
    "with `variable` and `joint`"
)


_NO_RUN = "no column was taken for a variable of a run: write runs, or give columns and files plainer names"


@dataclass(frozen=True)
class Suggestion:
    """A mapping to begin with, YAML with comments: how many columns each run has, and which are in none.

    A remark is what a user has to decide, in one line for all that is in the same doubt.
    """

    text: str
    runs: Mapping[str, int]
    left: tuple[Column, ...]
    remarks: tuple[str, ...]


def suggest(columns: Sequence[Column], title: str) -> Suggestion:
    """Write a mapping from what `understand` has found; one without runs is a list to begin with."""
    picked = {name: _picked(members) for name, members in runs_among(columns).items()}
    runs = {name: chosen for name, (chosen, _) in picked.items()}
    clocks = {column.address: column for column in columns if column.quantity == "time"}
    axes: dict[Address, Node] = {
        at: {**_place(clock), "unit": clock.unit or "s"} for at, clock in clocks.items()
    }
    taken = {column for chosen in runs.values() for column in chosen}
    left = tuple(c for c in columns if c not in taken and c.quantity not in {"time", "index"})
    asked: dict[str, dict[str, None]] = defaultdict(dict)
    if not runs:
        asked[_NO_RUN]["no run"] = None
    for name, remark in (*_claimed(picked), *_asked(runs, clocks), *_not_guessed(left, taken)):
        asked[remark][name] = None
    remarks = tuple(f"{few(list(names))}: {remark}" for remark, names in asked.items())
    head = [
        "Which column is which variable of which run. Guessed by `tendonrepro inspect --suggest`.",
        "Check every entry: variable, joint, unit. Delete its line `because` when you have, or let",
        "`tendonrepro ingest --confirm` delete them all; what is left is listed in the result as guessed.",
        f"Runs are {', '.join(RUNS[:-1])} and {RUNS[-1]}.",
        *(f"DECIDE: {printable(remark)}" for remark in remarks),
    ]
    described: Node = {name: _described_run(name, chosen, axes) for name, chosen in runs.items()}
    body = _yaml_lines({"schema_version": 1, "title": _writable(title), "runs": described or None})
    if not runs:
        body[-1] = "runs:"
    text = "\n".join([*(f"# {line}" for line in head), "", *body, *_rest(left, axes), ""])
    return Suggestion(text, {name: len(chosen) for name, chosen in runs.items()}, left, remarks)


def _picked(members: Sequence[Column]) -> tuple[list[Column], list[Column]]:
    """One column for each variable and joint, the first; and its rivals.

    Tables that contradict each other are of different recordings, and a run is of one.
    """
    tables: dict[tuple[str, str], list[Column]] = defaultdict(list)
    for column in members:
        tables[column.group[:2]].append(column)
    taken: dict[tuple[str, int], Column] = {}
    rivals: list[Column] = []
    for table in tables.values():
        found = places(table)
        if any(
            not same_curve(taken[place].values, found[place][0].values)
            for place in taken.keys() & found.keys()
        ):
            rivals += table
            continue
        for place, several in found.items():
            first = taken.setdefault(place, several[0])
            rivals += [column for column in several if not same_curve(first.values, column.values)]
    return [taken[place] for place in sorted(taken)], rivals


def _claimed(picked: Mapping[str, tuple[Sequence[Column], Sequence[Column]]]) -> Iterator[tuple[str, str]]:
    """Runs whose name nobody knows, and columns that claim the same place."""
    for name, (_, rivals) in picked.items():
        if name not in RUNS:
            yield repr(name), "no name says which controller that is: rename it"
        if rivals:
            others = few([f"{column.source.name}: {column.address}" for column in rivals])
            way = "a desired angle is `variable: q_d`; another recording is a run with a name of your own"
            yield name, f"several columns claim the same place, the first are taken, not {others}; {way}"


def _asked(
    runs: Mapping[str, Sequence[Column]], clocks: Mapping[Address, Column]
) -> Iterator[tuple[str, str]]:
    """What the columns of runs leave open: doubts, times, and the sign of an error."""
    for name, columns in runs.items():
        if any(column.time is None and column.signal.time is None for column in columns):
            way = "`step_s` is the record's"
            yield name, f"columns without a time: every {SAMPLING:g} s is the paper's, {way}"
        variables = {variable_of(column) for column in columns}
        if "e" in variables and not {"q_d", "q_encoder"} <= variables:
            yield name, "an error is taken for desired less measured; if it is the other way, `sign: -1`"
        if "q_motor_encoder" in variables:
            way = "before the reducer `scale: 0.01`, `sign` and `offset` where it counts otherwise"
            yield name, f"motor angles are taken for those of the winch; {way}"
        if any(column.quantity == "torque" and column.own.of_motor for column in columns):
            yield (
                name,
                "torques of motors are taken for those of joints; leave them out if they are at the winch",
            )
        unread = {
            hint.name: ", ".join(hint.unread) for column in columns for hint in column.names if hint.unread
        }
        if unread:
            said = few([f"{words} in {name!r}" for name, words in unread.items()])
            yield (
                name,
                f"words that say nothing known: {said}; does one change a variable, joint, unit or run?",
            )
        for column in columns:
            for doubt in (*column.doubts, *(clocks[column.time].doubts if column.time else ())):
                yield name, doubt


def _not_guessed(left: Sequence[Column], taken: Iterable[Column]) -> Iterator[tuple[str, str]]:
    """Doubts of columns in no run, and files with columns that nothing tells or of words."""
    for source in dict.fromkeys(column.source for column in (*left, *taken)):
        reasons = {one.path: one.reason for one in source.skipped if WORDS in one.reason}
        words = [repr(path) for path, reason in reasons.items() if not reason.endswith(", 1 different")]
        if words:
            yield source.name, f"columns of words are no numbers and are left out: {few(words)}"
    for column in left:
        if column.joint is None or column.quantity is None:
            yield from ((column.source.name, doubt) for doubt in column.doubts)
            if column.quantity != "other" and len(column.values) >= SHORTEST:
                yield column.source.name, _NOT_GUESSED


def _place(column: Column) -> dict[str, Node]:
    file, signal, number = column.address
    return {"file": _writable(file), "signal": _writable(signal), "column": number}


def _time_of(column: Column, axes: Mapping[Address, Node]) -> Node:
    """Times of a column as the mapping names them; None where its signal brings them along."""
    if column.signal.time is not None:
        return None
    return _NO_TIME if column.time is None else axes[column.time]


def _described_run(name: str, chosen: Sequence[Column], axes: Mapping[Address, Node]) -> dict[str, Node]:
    masses = (column.payload_mass for column in chosen if name.endswith("_payload"))
    mass = next((mass for mass in masses if mass), 0.0)
    run: dict[str, Node] = {"payload_mass_kg": PAYLOAD if math.isnan(mass) else mass}
    times = [_time_of(column, axes) for column in chosen]
    different = [time for place, time in enumerate(times) if time and time not in times[:place]]
    # One time serves all; where there are several, each column has its own.
    if len(different) == 1:
        run["time"] = different[0]
        times = [None] * len(chosen)
    run["signals"] = [_described(column, time) for column, time in zip(chosen, times, strict=True)]
    return run


def _described(column: Column, time: Node) -> dict[str, Node]:
    variable = variable_of(column) or "CHOOSE"
    known = FACTORS.get(kind_of_variable(VARIABLES[variable][0]) or "", {}) if variable in VARIABLES else {}
    unit = column.unit if column.unit in known or not known else next(iter(known))
    entry: dict[str, Node] = {"variable": variable, "joint": column.joint or 0}
    entry |= {**_place(column), "unit": unit or "rad"}
    if time is not None:
        entry["time"] = time
    return entry | {"because": _writable("; ".join(column.because)) or "nothing is known of it"}


def _rest(left: Sequence[Column], axes: Mapping[Address, Node]) -> list[str]:
    """Columns in no run as entries that need only be uncommented."""
    lines = ["", "# In no run. To use one, copy its lines under `signals` of a run, without the #."]
    described: Node = [_described(column, _time_of(column, axes)) for column in left[:_MOST_WRITTEN]]
    lines += [f"#    {line}" for line in _yaml_lines(described)]
    if len(left) > _MOST_WRITTEN:
        lines.append(f"# and {len(left) - _MOST_WRITTEN} more; inspect lists them all")
    return lines if left else []


def _yaml_lines(tree: Node) -> list[str]:
    """A tree one key a line, so that a line can be deleted; what steers a terminal is in quotes, escaped."""
    lines = dump(tree, line_by_line=True).removesuffix("\n").split("\n")
    return [
        "".join(letter if letter.isprintable() else f"\\u{ord(letter):04x}" for letter in line)
        for line in lines
    ]


def _writable(text: str) -> str:
    return _UNWRITABLE.sub("\ufffd", text)
