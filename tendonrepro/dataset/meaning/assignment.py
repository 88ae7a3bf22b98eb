"""Which columns are which variables of which runs."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath
from typing import TypeAlias

from tendonrepro.dataset.meaning.columns import Column, Group
from tendonrepro.dataset.meaning.joints import is_decoupling

DECOUPLE = "decouple"
RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload", DECOUPLE)

_VARIABLE = {
    "measured": "q_encoder", "desired": "q_d", "error": "e", "motor": "q_motor_encoder", "surface": "s",
    "calculated": "q_calculated", "torque": "tau_m", "estimate": "H_hat", "rate": "dq", "acceleration": "ddq",
}  # fmt: skip
_OF_DESIRED = {"rate": "dq_d", "acceleration": "ddq_d"}
Places: TypeAlias = dict[tuple[str, int], list[Column]]
"""Columns by variable and joint, as many as claim to be it."""


def variable_of(column: Column) -> str | None:
    """Variable of a run that a column holds; None when it is none, or nothing is known."""
    if column.quantity not in _VARIABLE:
        return None
    # Motor angles from the desired joint angles are computed again, they are no measurement.
    if column.quantity == "motor":
        return None if column.own.desired else _VARIABLE["motor"]
    if column.own.of_motor and column.quantity != "torque":
        return None
    variable = _VARIABLE[column.quantity]
    return _OF_DESIRED.get(column.quantity, variable) if column.own.desired else variable


def runs_among(columns: Sequence[Column]) -> dict[str, list[Column]]:
    """Columns that are variables of a run, by its name.

    A column without a controller is shared by the runs of its own table.
    """
    groups: dict[Group, list[Column]] = defaultdict(list)
    for column in columns:
        if variable_of(column) and column.joint:
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
    return dict(sorted(found.items(), key=lambda run: (run[0] == DECOUPLE, run[0])))


def places(columns: Iterable[Column]) -> Places:
    """Columns with a variable and a joint by these."""
    found: Places = defaultdict(list)
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
