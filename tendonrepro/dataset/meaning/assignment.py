"""Which columns are which joints, and which variables of which runs."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath
from typing import TypeAlias

from tendonrepro.dataset.meaning.columns import Column, Group
from tendonrepro.dataset.meaning.words import tokens

DECOUPLE = "decouple"
RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload", DECOUPLE)

_VARIABLE = {
    "measured": "q_encoder", "desired": "q_d", "error": "e", "motor": "q_motor_encoder", "surface": "s",
    "calculated": "q_calculated", "torque": "tau_m", "estimate": "H_hat", "rate": "dq", "acceleration": "ddq",
}  # fmt: skip
_OF_DESIRED = {"rate": "dq_d", "acceleration": "ddq_d"}
Places: TypeAlias = dict[tuple[str, int], list[Column]]
"""Columns by variable and joint, as many as claim to be it."""

_NO_JOINTS = (None, "time", "index", "other")
_FROM_ZERO = "joints are counted from 0 here, so 1 is added"
_FROM_ONE = "only joints 1 and 2 appear, so they are taken for 2 and 3, as in section 5.4"
_BY_PLACE = "no name says which joint, so columns are numbered from left to right: `joint`"
_NOT_ALL = "of columns alike some have a joint in their names, some none: `joint`"
_BY_JOINTS = "taken for the decoupling experiment for what is in it, no name says so: its name, or `joint`"
_MIXED = "only joints 1 and 2 appear, but not everywhere: are they the paper's 2 and 3? `joint`"


def place_joints(group: Sequence[Column]) -> None:
    """Number columns without a joint in their name by their order: two are joints 2 and 3, three are all."""
    kinds: dict[tuple[object, ...], list[Column]] = defaultdict(list)
    for column in group:
        if column.quantity not in _NO_JOINTS:
            of = (column.quantity, column.own.of_motor, column.own.desired)
            kinds[*of, column.controller, str(column.payload_mass)].append(column)
    for alike in kinds.values():
        # The columns of one matrix have one name, so a number in it is nobody's joint in particular.
        numbers, paths = {column.number for column in alike}, {column.signal.path for column in alike}
        of_matrix = len(numbers) > len(paths) == 1
        unnumbered = of_matrix or all(column.joint is None for column in alike)
        of_space = all(tokens(column.label)[-1:] in (["x"], ["y"], ["z"]) for column in alike)
        if len(alike) in {2, 3} and unnumbered and not of_space:
            for joint, column in enumerate(alike, start=4 - len(alike)):
                column.joint = joint
                column.because.append(f"joint {joint} by its place among {len(alike)} like it")
                column.doubts.append(_BY_PLACE)
        elif not of_matrix and len({column.joint is None for column in alike}) > 1:
            for column in alike:
                column.doubts.append(_NOT_ALL)


def count_as_paper(groups: Iterable[Sequence[Column]]) -> None:
    """Add 1 to the numbers of a record that counts joints from 0, or calls joints 2 and 3 by 1 and 2.

    Where its parts count differently nothing is moved, and the user is asked.
    """
    numbered = [
        [c for c in group if c.joint is not None and c.quantity not in _NO_JOINTS] for group in groups
    ]
    counted = {column.joint for group in numbered for column in group}
    from_zero = {0, 1} <= counted and 3 not in counted
    from_one = counted == {1, 2} and not any(map(is_decoupling, numbered))
    for group in numbered:
        for column in group:
            if from_zero or from_one:
                column.joint = (column.joint or 0) + 1
                column.because.append(_FROM_ZERO if from_zero else _FROM_ONE)
                column.doubts += [_FROM_ZERO] if from_zero else []
            elif {c.joint for c in group} == {1, 2} and not is_decoupling(group):
                column.doubts.append(_MIXED)
            column.joint = column.joint or None


def is_decoupling(group: Sequence[Column]) -> bool:
    """Whether columns recorded together are of the decoupling experiment, by name or by what they are.

    Motors or calculated angles alone do not tell, Figure 13 has some too; joint 1 does, where joint 3 is
    there to show that joints are not counted from 2.
    """
    joints = {column.joint for column in group if column.quantity not in _NO_JOINTS}
    of_motors = any(column.quantity in {"motor", "calculated"} for column in group)
    return any(column.decoupling for column in group) or (1 in joints and (3 in joints or of_motors))


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
        if decoupling and not any(column.decoupling for column in group):
            group[0].doubts.append(_BY_JOINTS)
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
    payload, controller = column.payload_mass, column.controller
    if controller is None and decoupling:
        return DECOUPLE
    if controller is None and payload is not None:
        controller = 1  # as in Table 3
    if controller is None:
        of_file = PurePosixPath(column.source.name).stem
        return _slug(column.group[1].rpartition("/")[2] if column.tabular else of_file)
    loaded = payload is not None and payload != 0.0
    return f"controller_{controller}{'_payload' if loaded else ''}"


def _slug(text: str) -> str:
    words = "_".join(re.findall(r"[a-z0-9]+", text.lower()))
    return words if re.match(r"[a-z]", words) and words != "plant" else f"run_{words}".rstrip("_")
