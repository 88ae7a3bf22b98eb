"""From guesses to a mapping file that a user can read, confirm and mend."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.fields.strict_yaml import Node
from tendonrepro.dataset.mapping.mapping_text import head_lines, quoted, skeleton_lines, yaml_lines
from tendonrepro.dataset.mapping.remarks import common_step, doubts_of, listed, remarks_on
from tendonrepro.dataset.mapping.timebase import SAME_TIME
from tendonrepro.dataset.meaning.assignment import REPEAT, places, runs_among, variable_of
from tendonrepro.dataset.meaning.columns import Address, Column
from tendonrepro.dataset.meaning.times import SAMPLING
from tendonrepro.dataset.readers.units import FACTORS, kind_of_variable
from tendonrepro.results.records import VARIABLES

PAYLOAD = 0.2
"""The paper's payload, kg, where a name says that there is one but not how heavy."""
MOST_LISTED = 100
"""Columns in no run that are written out; more would bury the rest."""

_EXAMPLE: dict[str, Node] = {
    "variable": "q_encoder",
    "joint": 2,
    "file": "FILE",
    "signal": "SIGNAL",
    "unit": "deg",
}
_NO_TIME: Node = {"step_s": SAMPLING, "because": "the files hold no times; the paper samples every 1 ms"}


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
    chosen = {name: _chosen(members) for name, members in runs.items()}
    clocks = {column.address: column for column in columns if column.quantity == "time"}
    axes = {address: _axis(clock) for address, clock in clocks.items()}
    taken = {column for picked in chosen.values() for column in picked}
    left = tuple(c for c in columns if c not in taken and c.quantity not in {"time", "index"})
    step, apart, of_times = common_step(chosen, clocks)
    from_start = {address: _axis(clock, from_start=True) for address, clock in clocks.items()}
    remarks = (
        *remarks_on(runs, chosen),
        *_untimed(chosen, axes),
        *of_times,
        *doubts_of(chosen, left, clocks),
    )
    body = ["schema_version: 1", f"title: {quoted(title)}"]
    if step is not None:
        body += yaml_lines({"resample": {"step_s": step, "method": "linear"}}, 0)
    body.append("runs:")
    for name, picked in chosen.items():
        run = _described_run(name, runs[name], picked, from_start if name in apart else axes)
        body += [f"  {name}:", *yaml_lines(run, 4)]
    if not runs:
        body += skeleton_lines({**_EXAMPLE, **(left[0].address.node() if left else {})})
    text = "\n".join([*head_lines(remarks), *body, *_rest(left, axes), ""])
    return Suggestion(text, {name: len(picked) for name, picked in chosen.items()}, left, remarks)


def _chosen(members: Sequence[Column]) -> list[Column]:
    """One column for each variable and joint: the first."""
    found = places(members)
    return [found[place][0] for place in sorted(found)]


def _untimed(chosen: Mapping[str, Sequence[Column]], axes: Mapping[Address, Node]) -> Iterator[str]:
    """Runs with columns that have no times, and what is to be done."""
    without = []
    for name, columns in chosen.items():
        untimed = [column for column in columns if _time_of(column, columns, axes) is _NO_TIME]
        beside = {column: _timed_beside(column, columns) for column in untimed}
        without += [] if all(beside.values()) else [name]
        for column, others in beside.items():
            if others:
                where = f"{column.address} has no times, and those of {others[0].address} beside it"
                way_out = f"save them as a signal and name it as `time` of {column.address}"
                yield f"{name}: {where} are not one even step from 0: {way_out}"
    if without:
        yield f"{listed(without)}: columns without a time: every {SAMPLING:g} s is the paper's, check it"


def _axis(clock: Column, *, from_start: bool = False) -> Node:
    node: dict[str, Node] = {**clock.address.node(), "unit": clock.unit or "s"}
    known = clock.values[np.isfinite(clock.values)]
    if from_start and known.size and known[0]:
        node["offset"] = float(known[0])
    return node


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
) -> dict[str, Node]:
    masses = [column.payload_mass for column in members if column.payload_mass is not None]
    mass = (
        next((mass for mass in masses if mass), 0.0)
        if name.partition(REPEAT)[0].endswith("_payload")
        else 0.0
    )
    run: dict[str, Node] = {"payload_mass_kg": PAYLOAD if math.isnan(mass) else mass}
    times = [_time_of(column, chosen, axes) for column in chosen]
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
    entry |= {**column.address.node(), "unit": unit or "rad"}
    if column.scale < 0.0:
        entry["sign"] = -1
    if abs(column.scale) != 1.0:
        entry["scale"] = abs(column.scale)
    if column.offset != 0.0:
        entry["offset"] = column.offset
    if column.address.rows:
        entry["where"] = [_condition(*label) for label in column.address.rows]
    if time is not None:
        entry["time"] = time
    return entry | {"because": "; ".join(column.because) or "nothing is known of it"}


def _condition(signal: str, number: int, value: float) -> Node:
    return {"signal": signal, "column": number, "equals": value}


def _rest(left: Sequence[Column], axes: Mapping[Address, Node]) -> list[str]:
    """Columns in no run as entries that need only be uncommented."""
    if not left:
        return []
    lines = ["", "# In no run. To use one, copy its lines under `signals` of a run, without the #."]
    for column in left[:MOST_LISTED]:
        first, *rest = yaml_lines(_described(column, _time_of(column, (), axes)), 6)
        lines += [f"#    - {first.strip()}", *(f"#{line}" for line in rest)]
    if len(left) > MOST_LISTED:
        lines.append(f"# and {len(left) - MOST_LISTED} more; inspect lists them all")
    return lines
