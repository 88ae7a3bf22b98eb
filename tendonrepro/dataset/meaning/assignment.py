"""Which columns are which variables of which runs."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath
from typing import TypeAlias

from tendonrepro.dataset.meaning.columns import Column, Group
from tendonrepro.dataset.meaning.evidence import same_curve
from tendonrepro.dataset.meaning.joints import is_decoupling

DECOUPLE = "decouple"
RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload", DECOUPLE)
REPEAT = "_repeat_"
"""Stands between the name of a run and the number of a repetition."""
MOST_REPEATS = 20
"""Recordings of one run that become runs; the columns of further ones are in none."""

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
_Places: TypeAlias = dict[tuple[str, int], list[Column]]
_OF_DESIRED = {"rate": "dq_d", "acceleration": "ddq_d"}


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

    A column without a controller is shared by the runs of its own table. Where files or tables are rivals, as
    repeated trials are, the most complete one is the run and the others are runs of their own beside it.

    Parameters
    ----------
    columns : sequence of Column
        As `meaning.understand` leaves them.

    Returns
    -------
    dict
        Name -> columns; the names of repetitions end with `REPEAT` and a number.
    """
    columns = [column for column in columns if variable_of(column) and column.joint]
    groups: dict[Group, list[Column]] = defaultdict(list)
    for column in columns:
        groups[column.group].append(column)
    found: dict[str, list[Column]] = {}
    for group in groups.values():
        decoupling = is_decoupling(group)
        of = {column: _run_of(column, decoupling=decoupling) for column in group}
        told = {column: column.controller is not None or column.payload_mass is not None for column in group}
        of_runs = list(dict.fromkeys(of[column] for column in group if told[column]))
        for column in group:
            for name in [of[column]] if told[column] else of_runs or [of[column]]:
                found.setdefault(name, []).append(column)
    names = sorted(found, key=lambda name: (name == DECOUPLE, name))
    return {
        f"{name}{REPEAT}{number}" if number > 1 else name: members
        for name in names
        for number, members in enumerate(_recordings(found[name]), start=1)
    }


def _recordings(members: Sequence[Column]) -> list[list[Column]]:
    """Columns of one run apart by recording: tables that contradict each other are of different ones."""
    tables: dict[tuple[str, str], list[Column]] = defaultdict(list)
    for column in members:
        tables[column.group[:2]].append(column)
    recordings: list[_Places] = []
    for table in sorted(map(places, tables.values()), key=lambda table: -len(table)):
        own = next((recording for recording in recordings if not _contradict(recording, table)), None)
        if own is None:
            recordings.append(table)
            continue
        for place, columns in table.items():
            own[place] = own.get(place, []) + columns
    return [
        [column for columns in recording.values() for column in columns]
        for recording in recordings[:MOST_REPEATS]
    ]


def _contradict(ours: _Places, others: _Places) -> bool:
    """Whether both have a variable of a joint, with other numbers; a curve in two figures has the same."""
    return any(
        not same_curve(ours[place][0].values, others[place][0].values)
        for place in ours.keys() & others.keys()
    )


def places(columns: Iterable[Column]) -> _Places:
    """Columns by variable and joint, as many as claim to be it.

    Parameters
    ----------
    columns : iterable of Column
        With a variable and a joint.
    """
    found: _Places = defaultdict(list)
    for column in columns:
        found[variable_of(column) or "", column.joint or 0].append(column)
    return found


def _run_of(column: Column, *, decoupling: bool) -> str:
    payload, controller, figure = column.payload_mass, column.controller, column.figure
    if controller is None and (column.decoupling or decoupling):
        return DECOUPLE
    if controller is None and (payload is not None or (figure is not None and figure[0] == 16)):
        # Table 3 and Figure 16 are of Controller 1.
        controller = 1
    if controller is None:
        of_file = PurePosixPath(column.source.name).stem
        return _slug(column.group[1].rpartition("/")[2] if column.tabular else of_file)
    loaded = payload is not None and payload != 0.0
    return f"controller_{controller}{'_payload' if loaded else ''}"


def _slug(text: str) -> str:
    words = "_".join(re.findall(r"[a-z0-9]+", text.lower()))
    return words if re.match(r"[a-z]", words) and words != "plant" else f"run_{words}".rstrip("_")
