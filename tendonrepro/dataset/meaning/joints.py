"""The paper's numbers of joints: by place where names have none, moved where a lab counts otherwise."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from tendonrepro.dataset.meaning.columns import Column, Group

_FROM_ZERO = "joints are counted from 0 here, so 1 is added"
_FROM_ONE = "only joints 1 and 2 appear, so they are taken for 2 and 3, as in section 5.4"


def place_joints(group: Sequence[Column]) -> None:
    """Number columns without a joint in their name by their order: two are joints 2 and 3, three are all.

    Parameters
    ----------
    group : sequence of Column
        Recorded together.
    """
    kinds: dict[tuple[object, ...], list[Column]] = defaultdict(list)
    for column in group:
        if column.quantity not in {None, "time", "index", "other"}:
            of = (column.quantity, column.own.of_motor, column.own.desired)
            kinds[*of, column.controller, str(column.payload_mass)].append(column)
    for alike in kinds.values():
        # The columns of one matrix have one name, so a number in it is nobody's joint in particular.
        numbers, paths = {column.number for column in alike}, {column.signal.path for column in alike}
        of_matrix = len(numbers) > len(paths) == 1
        if len(alike) not in {2, 3} or not (of_matrix or all(column.joint is None for column in alike)):
            continue
        for joint, column in enumerate(alike, start=4 - len(alike)):
            column.joint = joint
            column.because.append(f"joint {joint} by its place among {len(alike)} like it")


def count_as_paper(files: Mapping[str, Sequence[Column]]) -> None:
    """Move the numbers of joints in files that count from 0, or that call joints 2 and 3 by 1 and 2.

    Parameters
    ----------
    files : mapping
        Columns by file, all files of a record.
    """
    joints = {name: _joints(columns) for name, columns in files.items()}
    everywhere = set().union(*joints.values())
    of_record = _from_zero(everywhere)
    for name, columns in files.items():
        if of_record or _from_zero(joints[name]):
            _move(columns, _FROM_ZERO, doubtful=True)
        for column in columns:
            column.joint = column.joint or None
    if not of_record:
        _move_from_one(files)


def _from_zero(joints: set[int]) -> bool:
    """Whether numbers are counts from 0; a nought alone may stand for what a joint starts at."""
    return {0, 1} <= joints and 3 not in joints


def _move_from_one(files: Mapping[str, Sequence[Column]]) -> None:
    """Move joints 1 and 2 to 2 and 3, where 1 is not the first joint of the decoupling experiment."""
    groups: dict[Group, list[Column]] = defaultdict(list)
    for column in (column for columns in files.values() for column in columns):
        groups[column.group].append(column)
    apart = {name for name, group in groups.items() if is_decoupling(group)}
    compared = {
        name: [c for c in columns if c.controller or not (c.decoupling or c.group in apart)]
        for name, columns in files.items()
    }
    counted = {name: _joints(columns) for name, columns in compared.items()}
    everywhere = set().union(*counted.values())
    for name, columns in compared.items():
        if everywhere in ({1}, {1, 2}) or counted[name] == {1, 2}:
            _move(columns, _FROM_ONE, doubtful=False)


def is_decoupling(group: Sequence[Column]) -> bool:
    """Whether columns recorded together are of the decoupling experiment, by what they are.

    Motors or calculated angles alone do not tell, Figure 13 has some too; joint 1 does, where joint 3 is
    there to show that joints are not counted from 2.
    """
    joints = _joints(group)
    return 1 in joints and (3 in joints or any(c.quantity in {"motor", "calculated"} for c in group))


def _joints(columns: Iterable[Column]) -> set[int]:
    known = {None, "time", "index", "other"}
    return {c.joint for c in columns if c.joint is not None and c.quantity not in known}


def _move(columns: Sequence[Column], reason: str, *, doubtful: bool) -> None:
    """Add one to the number of every joint, as far as that is a joint."""
    for column in columns:
        if column.joint is not None and column.joint < 3 and column.quantity not in {"time", "index"}:
            column.joint += 1
            column.because.append(reason)
            column.doubts += [reason] if doubtful else []
