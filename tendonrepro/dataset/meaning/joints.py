"""The paper's numbers of joints and motors: by names, by place, by the coupling between them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.angle_units import in_radians
from tendonrepro.dataset.meaning.columns import Column
from tendonrepro.dataset.meaning.evidence import distance
from tendonrepro.dataset.meaning.words import tokens
from tendonrepro.dataset.readers.units import plain_unit

REDUCER = 100.0
"""Turns of a motor for one of its winch."""
COUPLED = 0.05
"""Largest RMS of what the coupling leaves of a motor angle, as a share of its range."""
_OFF = 0.01  # least difference that matters where a motor starts, as a share of its range
_NO_JOINTS = (None, "time", "index", "other")
_FROM_ZERO = "joints are counted from 0 here, so 1 is added"
_FROM_ONE = "only joints 1 and 2 appear, so they are taken for 2 and 3, as in section 5.4"
_MIXED = "only joints 1 and 2 appear, but not everywhere: are they the paper's 2 and 3? `joint`"
_UNTIED = "a motor angle is not S_inv times the joint angles: look at its `unit`, `scale` and `offset`"
_STARTS = "a motor does not start where S_inv puts it: `offset` takes off what it starts at"


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
        if len(alike) not in {2, 3} or not unnumbered or _cartesian(alike):
            continue
        for joint, column in enumerate(alike, start=4 - len(alike)):
            column.joint = joint
            column.because.append(f"joint {joint} by its place among {len(alike)} like it")


def _cartesian(alike: Sequence[Column]) -> bool:
    """Whether columns can be axes of space: called x, y, z, or accelerations without a unit of rotation."""
    axes = {tokens(column.label)[-1:] == [axis] for column, axis in zip(alike, "xyz", strict=False)}
    return axes == {True} or (alike[0].quantity == "acceleration" and not plain_unit(alike[0].signal.unit))


def count_as_paper(groups: Iterable[Sequence[Column]]) -> None:
    """Add 1 to the numbers of a record that counts joints from 0, or calls joints 2 and 3 by 1 and 2.

    Where its parts count differently nothing is moved, and the user is asked.
    """
    numbered = [
        [c for c in group if c.joint is not None and c.quantity not in _NO_JOINTS] for group in groups
    ]
    counted = {column.joint for group in numbered for column in group}
    from_zero = {0, 1} <= counted and 3 not in counted
    from_one = counted == {1, 2} and not any(map(_is_apart, numbered))
    for group in numbered:
        for column in group:
            if from_zero or from_one:
                column.joint = (column.joint or 0) + 1
                column.because.append(_FROM_ZERO if from_zero else _FROM_ONE)
                column.doubts += [_FROM_ZERO] if from_zero else []
            elif {c.joint for c in group} == {1, 2} and not _is_apart(group):
                column.doubts.append(_MIXED)
            column.joint = column.joint or None


def _is_apart(group: Sequence[Column]) -> bool:
    """Whether joint 1 may appear: in the decoupling experiment, by its name or by what it is."""
    return is_decoupling(group) or any(column.decoupling for column in group)


def is_decoupling(group: Sequence[Column]) -> bool:
    """Whether columns recorded together are of the decoupling experiment, by what they are.

    Motors or calculated angles alone do not tell, Figure 13 has some too; joint 1 does, where joint 3 is
    there to show that joints are not counted from 2.
    """
    joints = {column.joint for column in group if column.quantity not in _NO_JOINTS}
    return 1 in joints and (3 in joints or any(c.quantity in {"motor", "calculated"} for c in group))


def find_motors(group: Sequence[Column], S_inv: Array) -> None:
    """Tell motor angles at the winch from those before the reducer, by `S_inv` (3, 3) times joint angles."""
    runs: dict[tuple[int | None, str], list[Column]] = defaultdict(list)
    for column in group:
        runs[column.controller, str(column.payload_mass)].append(column)
    for run in runs.values():
        measured = (c for c in reversed(run) if c.quantity == "measured" and not c.own.of_motor)
        joints = {column.joint: column for column in measured if column.joint}
        for column in (c for c in run if joints and c.quantity == "motor" and c.joint):
            # A joint that is not there is held.
            q = np.zeros((len(column.values), len(S_inv)))
            for joint, angle in joints.items():
                q[:, joint - 1] = in_radians(angle)
            _match(column, q @ S_inv[(column.joint or 0) - 1])


def _match(column: Column, expected: Array) -> None:
    """Settle sign and gear of a motor by the angle that the coupling gives it, (N,), rad."""
    tries = [
        (*_apart(expected, sign * in_radians(column) / ratio), sign, ratio)
        for sign, ratio in product((1.0, -1.0), (1.0, REDUCER))
    ]
    rest, surplus, sign, ratio = min(tries, key=lambda each: each[0])
    if rest <= COUPLED:
        where = "before the reducer" if ratio == REDUCER else "at the winch"
        column.scale = sign / ratio
        column.because.append(f"it is {where} by S_inv times the joint angles, to {rest:.1%}")
        column.doubts += [_STARTS] if surplus > _OFF else []
    elif np.nan_to_num(column.values).any():
        column.doubts.append(_UNTIED)


def _apart(expected: Array, angle: Array) -> tuple[float, float]:
    """`distance` of two angles from where they start, and how far apart that is over the range."""
    known = np.isfinite(expected) & np.isfinite(angle)
    extent = float(np.ptp(expected[known])) if known.any() else 0.0
    if extent == 0.0:
        return np.inf, 0.0
    surplus = float((angle - expected)[np.argmax(known)])
    return distance(expected, angle - surplus), abs(surplus) / extent
