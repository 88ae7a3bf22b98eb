"""From guesses to a mapping file that a user can read, confirm and mend."""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.columns import Address, Column, Group
from tendonrepro.dataset.timebase import SAME_TIME
from tendonrepro.dataset.units import FACTORS, kind_of_variable
from tendonrepro.dataset.words import printable
from tendonrepro.records import VARIABLES
from tendonrepro.strict_yaml import Node

PAYLOAD = 0.2
"""The paper's payload, kg, where a name says that there is one but not how heavy."""
SAMPLING = 0.001
"""The paper's sampling period, s, where the files hold no times."""
DECOUPLE = "decouple"
RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload", DECOUPLE)
MOST_LISTED = 100
"""Columns in no run that are written out; more would bury the rest."""

_VARIABLE = {
    "measured": "q_encoder",
    "desired": "q_d",
    "error": "e",
    "motor": "q_motor_encoder",
    "calculated": "q_calculated",
    "torque": "tau_m",
    "estimate": "H_hat",
    "surface": "s",
    "rate": "dq",
    "acceleration": "ddq",
}
_OF_DESIRED = {"rate": "dq_d", "acceleration": "ddq_d"}
_NO_TIME: Node = {"step_s": SAMPLING, "because": "the files hold no times; the paper samples every 1 ms"}
_PLAIN = {"variable", "unit"}
_UNWRITABLE = re.compile("[\0\ud800-\udfff]")
"""What no mapping can hold: NUL, and halves of a pair that stand for bytes of no known encoding."""
_SHIFTED = "only joints 1 and 2 appear, so they are taken for 2 and 3, as in section 5.4"


@dataclass(frozen=True)
class Suggestion:
    """A mapping to begin with.

    Attributes
    ----------
    text : str
        YAML with comments.
    runs : dict
        Run name -> how many columns it has.
    left : tuple of Column
        Columns that are in no run.
    remarks : tuple of str
        What a user has to decide: two columns for one place, runs without a name, missing times.
    """

    text: str
    runs: Mapping[str, int]
    left: tuple[Column, ...]
    remarks: tuple[str, ...]


def variable_of(column: Column) -> str | None:
    """Variable of a run that a column holds; None when it is none, or nothing is known."""
    if column.quantity not in _VARIABLE:
        return None
    about_motor = column.own.of_motor and column.quantity != "motor"
    # Motor angles from the desired joint angles are computed again, they are no measurement.
    if about_motor and column.quantity != "torque":
        return None
    if column.quantity == "motor" and column.own.desired:
        return None
    if column.own.desired:
        return _OF_DESIRED.get(column.quantity, _VARIABLE[column.quantity])
    return _VARIABLE[column.quantity]


def runs_among(columns: Sequence[Column]) -> dict[str, list[Column]]:
    """Columns that are variables of a run, by its name.

    A column without a controller is shared by the runs of its own table.
    """
    columns = [column for column in columns if variable_of(column) and column.joint]
    groups: dict[Group, list[Column]] = defaultdict(list)
    for column in columns:
        groups[column.group].append(column)
    found: dict[str, list[Column]] = {}
    for group in groups.values():
        decoupling = _is_decoupling(group)
        names = {column: _run_of(column, decoupling=decoupling) for column in group}
        told = {column: column.controller is not None or column.payload_mass is not None for column in group}
        of_runs = list(dict.fromkeys(names[column] for column in group if told[column]))
        for column in group:
            for name in [names[column]] if told[column] else of_runs or [names[column]]:
                found.setdefault(name, []).append(column)
    return {name: found[name] for name in sorted(found, key=lambda name: (name == DECOUPLE, name))}


def _is_decoupling(group: Sequence[Column]) -> bool:
    """Whether columns recorded together are of the decoupling experiment, by what they are.

    Motors or calculated angles alone do not tell, Figure 13 has some too; joint 1 does, where joint 3 is
    there to show that joints are not counted from 2.
    """
    joints = {column.joint for column in group}
    return 1 in joints and (3 in joints or any(c.quantity in {"motor", "calculated"} for c in group))


def _run_of(column: Column, *, decoupling: bool) -> str:
    payload, controller, figure = column.payload_mass, column.controller, column.figure
    if controller is None and (column.decoupling or decoupling):
        return DECOUPLE
    if controller is None and (payload is not None or (figure is not None and figure[0] == 16)):
        # Table 3 and Figure 16 are of Controller 1.
        controller = 1
    if controller is None:
        return _slug(PurePosixPath(column.source.name).stem)
    loaded = payload is not None and payload != 0.0
    return f"controller_{controller}{'_payload' if loaded else ''}"


def _slug(text: str) -> str:
    words = "_".join(re.findall(r"[a-z0-9]+", text.lower()))
    return words if re.match(r"[a-z]", words) and words != "plant" else f"run_{words}".rstrip("_")


def suggest(columns: Sequence[Column], title: str) -> Suggestion:
    """Write a mapping from guesses.

    Parameters
    ----------
    columns : sequence of Column
        As `meaning.understand` leaves them.
    title : str
        For the mapping.

    Returns
    -------
    Suggestion
        Without runs when no column could be understood; its text is then a list to begin with.
    """
    runs = runs_among(columns)
    shifted = _counted_from_one(runs)
    for column in shifted:
        column.because.append(_SHIFTED)
    chosen = {name: _chosen(members) for name, members in runs.items()}
    axes = {column.address: _axis(column) for column in columns if column.quantity == "time"}
    body = ["schema_version: 1", f"title: {_quoted(title)}", "runs:"]
    for name, picked in chosen.items():
        run = _described_run(name, runs[name], picked, axes, shifted)
        body += [f"  {name}:", *_lines(run, 4)]
    taken = {column for picked in chosen.values() for column in picked}
    left = tuple(c for c in columns if c not in taken and c.quantity not in {"time", "index"})
    remarks = tuple(_remarks(runs, chosen, axes))
    text = "\n".join([*_head(remarks), *body, *_rest(left, axes, shifted), ""])
    return Suggestion(text, {name: len(picked) for name, picked in chosen.items()}, left, remarks)


def _counted_from_one(runs: Mapping[str, Sequence[Column]]) -> set[Column]:
    """Columns of comparisons that call joints 2 and 3 by 1 and 2, as the paper's section 5.4 does."""
    files: dict[str, list[Column]] = defaultdict(list)
    for name, members in runs.items():
        if name != DECOUPLE:
            for column in members:
                files[column.source.name].append(column)
    everywhere = {column.joint for members in files.values() for column in members}
    return {
        column
        for members in files.values()
        if everywhere <= {1, 2} or {column.joint for column in members} == {1, 2}
        for column in members
    }


def _chosen(members: Sequence[Column]) -> list[Column]:
    """One column for each variable and joint: the first."""
    found: dict[tuple[str | None, int | None], Column] = {}
    for column in members:
        found.setdefault((variable_of(column), column.joint), column)
    return sorted(found.values(), key=lambda column: (variable_of(column) or "", column.joint or 0))


def _remarks(
    runs: Mapping[str, Sequence[Column]], chosen: Mapping[str, Sequence[Column]], axes: Mapping[Address, Node]
) -> Iterator[str]:
    """What a user has to decide."""
    for name, members in runs.items():
        if name not in RUNS:
            yield f"no name says which controller the run {name!r} is: rename it"
        rivals: dict[tuple[str | None, int | None], list[Column]] = defaultdict(list)
        for column in members:
            rivals[variable_of(column), column.joint].append(column)
        for (variable, joint), several in rivals.items():
            # The same curve in two figures is no question.
            if any(not np.array_equal(several[0].values, other.values) for other in several[1:]):
                places = ", ".join(f"{column.address.file}: {column.address}" for column in several)
                claim = f"{len(several)} columns claim to be {variable} {joint} of {name}"
                yield f"{claim}, the first is taken: {places}"
        untimed = [column for column in chosen[name] if _time_of(column, chosen[name], axes) is _NO_TIME]
        beside = {column: _timed_beside(column, chosen[name]) for column in untimed}
        if not all(beside.values()):
            yield f"{name} has columns without a time: every {SAMPLING:g} s is the paper's, check it"
        for column, others in beside.items():
            if others:
                places = f"{column.address} has no times, and those of {others[0].address} beside it"
                way_out = f"save them as a signal and name it as `time` of {column.address}"
                yield f"{name}: {places} are not one even step from 0: {way_out}"


def _axis(column: Column) -> Node:
    return {**column.address._asdict(), "unit": column.unit or "s"}


def _time_of(column: Column, beside: Sequence[Column], axes: Mapping[Address, Node]) -> Node:
    """Times of a column as the mapping names them; None where its signal brings them along."""
    if column.signal.time is not None:
        return None
    return _step_beside(column, beside) if column.time is None else axes[column.time]


def _step_beside(column: Column, beside: Sequence[Column]) -> Node:
    """Step of what stands beside a column and brings its times along; the paper's where there is none."""
    others = _timed_beside(column, beside)
    steps = {_even_step(other.signal.time) for other in others if other.signal.time is not None}
    step = steps.pop() if len(steps) == 1 else None
    if step is None:
        return _NO_TIME
    return {"step_s": step, "because": f"{others[0].address} beside it, of the same length, has this step"}


def _timed_beside(column: Column, beside: Sequence[Column]) -> list[Column]:
    """Columns of the same length with times of their own."""
    size = len(column.values)
    return [other for other in beside if other.signal.time is not None and len(other.values) == size]


def _even_step(time: Array) -> float | None:
    """Step of times that count from 0, s; None where they do not, for a mapping could not say so."""
    if not np.isfinite(time).all():
        return None
    step = float(f"{(time[-1] - time[0]) / (len(time) - 1):.9g}")
    even = step > 0.0 and np.allclose(time, step * np.arange(len(time)), rtol=0.0, atol=SAME_TIME * step)
    return step if even else None


def _described_run(
    name: str,
    members: Sequence[Column],
    chosen: Sequence[Column],
    axes: Mapping[Address, Node],
    shifted: set[Column],
) -> dict[str, Node]:
    masses = [column.payload_mass for column in members if column.payload_mass is not None]
    mass = next((mass for mass in masses if mass), 0.0) if name.endswith("_payload") else 0.0
    run: dict[str, Node] = {"payload_mass_kg": PAYLOAD if math.isnan(mass) else mass}
    times = [_time_of(column, chosen, axes) for column in chosen]
    different = [time for place, time in enumerate(times) if time and time not in times[:place]]
    # One time serves all; where there are several, each column has its own.
    if len(different) == 1:
        run["time"] = different[0]
        times = [None] * len(chosen)
    run["signals"] = [
        _described(column, time, shift=column in shifted) for column, time in zip(chosen, times, strict=True)
    ]
    return run


def _described(column: Column, time: Node, *, shift: bool) -> dict[str, Node]:
    variable = variable_of(column) or "CHOOSE"
    known = FACTORS.get(kind_of_variable(VARIABLES[variable][0]) or "", {}) if variable in VARIABLES else {}
    unit = column.unit if column.unit in known or not known else next(iter(known))
    entry: dict[str, Node] = {"variable": variable, "joint": (column.joint or 0) + int(shift)}
    entry |= {**column.address._asdict(), "unit": unit or "rad"}
    if column.scale != 1.0:
        entry["scale"] = column.scale
    if time is not None:
        entry["time"] = time
    return entry | {"because": "; ".join(column.because) or "nothing is known of it"}


def _lines(tree: Mapping[str, Node], depth: int) -> Iterator[str]:
    """A mapping as YAML with one key a line, so that a line can be deleted."""
    indent = " " * depth
    for key, value in tree.items():
        if isinstance(value, dict):
            yield f"{indent}{key}:"
            yield from _lines(value, depth + 2)
        elif isinstance(value, list):
            yield f"{indent}{key}:"
            for item in value:
                assert isinstance(item, dict)
                first, *rest = _lines(item, depth + 2)
                yield f"{indent}- {first.strip()}"
                yield from rest
        else:
            plain = not isinstance(value, str) or (key in _PLAIN and value.isascii())
            yield f"{indent}{key}: {value if plain else _quoted(str(value))}"


def _quoted(text: str) -> str:
    # A text in JSON is one in YAML too, as far as YAML takes its characters as they are.
    written = json.dumps(_UNWRITABLE.sub("\ufffd", text), ensure_ascii=False)
    return "".join(letter if letter.isprintable() else _escaped(ord(letter)) for letter in written)


def _escaped(code: int) -> str:
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"


def _head(remarks: Iterable[str]) -> list[str]:
    lines = [
        "Which column is which variable of which run. Guessed by `tendonrepro inspect --suggest`.",
        "Check every entry: variable, joint, unit. Delete its line `because` when you have;",
        "what is left is listed in the result as guessed.",
        f"Runs are {', '.join(RUNS[:-1])} and {RUNS[-1]}.",
    ]
    return [*(f"# {line}" for line in [*lines, *(f"DECIDE: {printable(remark)}" for remark in remarks)]), ""]


def _rest(left: Sequence[Column], axes: Mapping[Address, Node], shifted: set[Column]) -> list[str]:
    """Columns in no run as entries that need only be uncommented."""
    if not left:
        return []
    lines = ["", "# In no run. To use one, copy its lines under `signals` of a run, without the #."]
    for column in left[:MOST_LISTED]:
        first, *rest = _lines(_described(column, _time_of(column, (), axes), shift=column in shifted), 6)
        lines += [f"#    - {first.strip()}", *(f"#{line}" for line in rest)]
    if len(left) > MOST_LISTED:
        lines.append(f"# and {len(left) - MOST_LISTED} more; inspect lists them all")
    return lines
