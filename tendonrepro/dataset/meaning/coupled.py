"""Motor angles told from joint angles by the coupling between them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.angle_units import in_radians
from tendonrepro.dataset.meaning.columns import Column
from tendonrepro.dataset.meaning.evidence import COUPLED, counted_in, distance
from tendonrepro.dataset.readers.units import FACTORS

REDUCER = 100.0
"""Turns of a motor for one of its winch."""
JOINTS = (1, 2, 3)
_OFF = 0.01
"""Least angle that is taken off where a motor starts, as a share of its range."""


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
    named = [column for column in group if column.quantity == "motor"]
    unnamed = [column for column in group if column.quantity is None and len(joints) > 1]
    for column in (*named, *unnamed):
        column.unit = column.unit or next(iter(joints.values())).unit
    matched = [column for column in (*named, *unnamed) if _match(column, expected)]
    _share_gear([column for column in named if column not in matched], matched)


def _share_gear(motors: Sequence[Column], matched: Sequence[Column]) -> None:
    """Give motors that prove nothing, for their joints rest, gear and zero of those beside them."""
    scales = {column.scale for column in matched}
    if len({abs(scale) for scale in scales}) > 1:
        matched[0].doubts.append(
            "some motors of this run are before the reducer, others are not: look at `scale`"
        )
    for column in (motor for motor in motors if matched and np.isfinite(motor.values).any()):
        column.scale = scales.copy().pop() if len(scales) == 1 else max(map(abs, scales))
        if column.scale != 1.0:
            column.because.append(f"scale {column.scale:g}, as of the motors beside it")
        values = column.values[np.isfinite(column.values)]
        if np.ptp(values) > 0.0:
            column.doubts.append(
                "a motor angle is not S_inv times the joint angles: look at its unit and scale"
            )
        elif any(other.offset for other in matched):
            column.offset = float(values[0])
            column.because.append("it rests; what it stands at is taken off, as of the motors beside it")


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
        if _moved_apart(column.values, other.values) <= COUPLED and told[0] != told[1]:
            encoder, calculated = (column, other) if told[0] else (other, column)
            calculated.call("calculated", f"it follows {encoder.address}, which has an encoder's steps")
            first[joint] = encoder
    return first


def _winches(joints: Mapping[int, Column], S_inv: Array) -> Array:
    """Winch angles that joint angles ask for, rad, (N, 3); a joint that is not there is held."""
    q = np.zeros((len(next(iter(joints.values())).values), len(S_inv)))
    for joint, column in joints.items():
        q[:, joint - 1] = in_radians(column)
    return q @ S_inv.T


def _match(column: Column, expected: Array, motor: int | None = None) -> bool:
    """Name a column after the motor it fits, if it does; what it starts at does not matter."""
    named = column.joint - 1 if column.quantity == "motor" and column.joint else motor
    tries = [
        (_moved_apart(expected[:, motor], sign * in_radians(column) / ratio), motor, sign, ratio)
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
    _set_zero(column, expected[:, motor])
    return True


def _set_zero(column: Column, expected: Array) -> None:
    """Take off what a motor starts at where the joint angles ask for something else."""
    ours = in_radians(column) * column.scale
    first = _first_of_both(expected, ours)
    surplus = ours[first] - expected[first]
    if abs(surplus) > _OFF * np.ptp(expected[np.isfinite(expected)]):
        column.offset = float(f"{surplus / (column.scale * _factor(column)):.6g}")
        column.because.append(f"it starts at {column.values[first]:.6g}, so {column.offset:g} is taken off")


def _moved_apart(a: Array, b: Array) -> float:
    """`distance` of two signals from where they start."""
    first = _first_of_both(a, b)
    return np.inf if first is None else distance(a - a[first], b - b[first])


def _first_of_both(a: Array, b: Array) -> int | None:
    """First sample that both signals have."""
    known = np.isfinite(a) & np.isfinite(b)
    return int(np.argmax(known)) if known.any() else None


def _factor(column: Column) -> float:
    return FACTORS["angle"].get(column.unit or "rad", 1.0)
