"""Motor angles told from joint angles by the coupling between them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.columns import Column
from tendonrepro.dataset.evidence import COUPLED, counted_in, distance
from tendonrepro.dataset.units import FACTORS

REDUCER = 100.0
"""Turns of a motor for one of its winch."""
JOINTS = (1, 2, 3)


def find_motors(group: Sequence[Column], S_inv: Array) -> None:
    """Recognise motor angles, at the winch or before the reducer, among columns recorded together.

    Parameters
    ----------
    group : sequence of Column
        Of the same length. Those that are called joint angles but fit the motors are renamed.
    S_inv : Array
        Inverse coupling of all joints, (3, 3).
    """
    runs: dict[tuple[int | None, str], list[Column]] = defaultdict(list)
    for column in group:
        runs[column.controller, str(column.payload_mass)].append(column)
    for run in runs.values():
        _find_in_run(run, S_inv)


def _find_in_run(group: Sequence[Column], S_inv: Array) -> None:
    claims: dict[int, list[Column]] = defaultdict(list)
    for column in group:
        if column.quantity == "measured" and column.joint in JOINTS and not column.own.of_motor:
            claims[column.joint].append(column)
    if not claims:
        return
    joints = _settled(claims, S_inv)
    expected = _winches(joints, S_inv)
    for column in group:
        if column.quantity == "motor" or (column.quantity is None and len(joints) > 1):
            column.unit = column.unit or next(iter(joints.values())).unit
            _match(column, expected)


def _settled(claims: Mapping[int, Sequence[Column]], S_inv: Array) -> dict[int, Column]:
    """One column for each joint; where two claim to be it, the other one is told by the coupling."""
    first = {joint: columns[0] for joint, columns in claims.items()}
    second = {joint: columns[1] for joint, columns in claims.items() if len(columns) > 1}
    # Motor 3 turns as joint 3 does while the others rest, so one joint alone proves nothing.
    if len(second) < len(first) or len(first) < 2:
        return first
    for joints, others in ((first, second), (second, first)):
        expected = _winches(joints, S_inv)
        if all(_match(column, expected, motor=joint - 1) for joint, column in others.items()):
            return joints
    for joint, column in first.items():
        other = second[joint]
        told = counted_in(column.values) is not None, counted_in(other.values) is not None
        # Two that follow each other are the encoder and what the motors say; only an encoder has steps.
        if distance(column.values, other.values) <= COUPLED and told[0] != told[1]:
            encoder, calculated = (column, other) if told[0] else (other, column)
            calculated.call("calculated", f"it follows {encoder.address}, which has an encoder's steps")
            first[joint] = encoder
    return first


def _winches(joints: Mapping[int, Column], S_inv: Array) -> Array:
    """Winch angles that joint angles ask for, rad, (N, 3); a joint that is not there is held."""
    q = np.zeros((len(next(iter(joints.values())).values), len(S_inv)))
    for joint, column in joints.items():
        q[:, joint - 1] = _radians(column)
    return q @ S_inv.T


def _match(column: Column, expected: Array, motor: int | None = None) -> bool:
    """Name a column after the motor it fits, if it does."""
    named = column.joint - 1 if column.quantity == "motor" and column.joint else motor
    tries = [
        (distance(expected[:, motor], sign * _radians(column) / ratio), motor, sign, ratio)
        for motor in ((0, 1, 2) if named is None else (named,))
        for sign in (1.0, -1.0)
        for ratio in (1.0, REDUCER)
    ]
    rest, motor, sign, ratio = min(tries)
    if rest > COUPLED:
        return False
    where = "before the reducer" if ratio == REDUCER else "at the winch"
    column.joint, column.scale = motor + 1, sign / ratio
    column.call("motor", f"it is motor {motor + 1} {where}: S_inv times the joint angles, to {rest:.1%}")
    return True


def _radians(column: Column) -> Array:
    return column.values * FACTORS["angle"].get(column.unit or "rad", 1.0)
