"""Cycles of a recorded motion, and the simulator's shapes as curves of their parameters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import Recorded
from tendonrepro.physics.trajectory import (
    Motion,
    Shape,
    at_rest,
    minimum_jerk,
    motion,
    raised_cosine,
    smooth_sine,
    trapezoid_times,
    trapezoidal,
)

PER_JOINT = ("amplitude", "offset", "start")
"""Parameters that each joint has its own value of, (n,)."""

Values: TypeAlias = dict[str, Any]
"""Times in s, angles (n,) in rad. ``delay`` is the rest before the motion, ``start`` the angle of that rest,
and ``share`` the part of a ramp's rise in which it speeds up."""

_AWAY = 0.02
"""Share of a joint's amplitude beyond which it has left its start."""
_STILL = 0.05
"""Share of the largest amplitude below which a joint counts as at rest."""


@dataclass(frozen=True)
class Turns:
    """Cycles of a motion that goes out and comes back: the columns that move in each, in order; times in s.

    The first excursion passes 2 % of the amplitude at `begin` on its way out and at `end` on its way back;
    `cycle` is from one excursion to the next, 0 when there is only one; `rise` from 2 % to 98 % of the
    amplitude.
    """

    joints: tuple[tuple[int, ...], ...]
    begin: float
    end: float
    cycle: float
    rise: float

    def pattern(self) -> tuple[tuple[tuple[int, ...], ...], int]:
        """Return the shortest list of turns that repeats, and how often it does."""
        count = len(self.joints)
        lengths = [k for k in range(1, count + 1) if self.joints[:k] * (count // k) == self.joints]
        return self.joints[: lengths[0]], count // lengths[0]


def turns_of(record: Recorded) -> Turns | None:
    """Cycles of a motion that leaves its start and returns; None if it is none."""
    amplitude = amplitude_of(record)
    trips = [trip for i in movers(amplitude) for trip in _trips(record, i, amplitude[i])]
    if not trips or any(np.ptp(np.sign(record.q[a:b, i])) > 0.0 for a, b, i in trips):
        return None
    groups: list[list[tuple[int, int, int]]] = []
    for trip in sorted(trips):
        if groups and trip[0] < max(end for _, end, _ in groups[-1]):
            groups[-1].append(trip)
        else:
            groups.append([trip])
    starts = record.time[[group[0][0] for group in groups]]
    cycle = float(np.median(np.diff(starts))) if len(groups) > 1 else 0.0
    a, b, i = max(groups[0], key=lambda trip: trip[1] - trip[0])
    top = a + int(np.argmax(np.abs(record.q[a:b, i]) >= (1.0 - _AWAY) * abs(amplitude[i])))
    joints = tuple(tuple(sorted({i for _, _, i in group})) for group in groups)
    begin, end, high = (float(record.time[k]) for k in (a, b - 1, top))
    return Turns(joints, begin, end, cycle, max(high - begin, 2.0 * record.step))


def amplitude_of(record: Recorded) -> Array:
    """Signed angle farthest from the start, (n,)."""
    far = np.abs(record.q).argmax(axis=0)
    return np.asarray(record.q[far, np.arange(record.q.shape[1])])


def movers(amplitude: Array) -> list[int]:
    """Joints, by column, that move far enough to count."""
    return [i for i, size in enumerate(np.abs(amplitude)) if size > _STILL * np.abs(amplitude).max() > 0.0]


def _trips(record: Recorded, i: int, amplitude: float) -> Iterator[tuple[int, int, int]]:
    """First sample, last sample + 1 and joint of each stay away from the start."""
    away = np.abs(record.q[:, i]) > _AWAY * abs(amplitude)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], away, [False]])))
    yield from ((int(a), int(b), i) for a, b in zip(edges[::2], edges[1::2], strict=True))


def curve(kind: str, values: Values, turns: Turns | None, time: Array) -> Array:
    """Angles of a shape, rad, (T, n); a sine has no turns."""
    shapes = [_shape(kind, values, i) for i in range(len(values["amplitude"]))]
    if turns is None or kind == "sine":
        motions = [Motion((shape,), 2.0 * float(time[-1]) + 1.0) for shape in shapes]
    else:
        motions = [
            Motion(tuple(shape if i in turn else at_rest for turn in turns.joints), cycle_of(values))
            for i, shape in enumerate(shapes)
        ]
    return np.asarray(motion(time - values["delay"], motions)[0] + values.get("start", 0.0))


def _shape(kind: str, values: Values, i: int) -> Shape:
    amplitude = float(values["amplitude"][i])
    if kind == "raised_cosine":
        return raised_cosine(amplitude, values["period"])
    if kind == "minimum_jerk":
        return minimum_jerk(amplitude, values["rise"], values["hold"])
    if kind == "sine":
        return smooth_sine(amplitude, float(values["offset"][i]), values["period"], values["blend"])
    limits = ramp_limits(values)
    return trapezoidal(amplitude, *limits, cycle_of(values) / 2.0 - trapezoid_times(amplitude, *limits)[1])


def cycle_of(values: Values) -> float:
    """Duration of one turn, s."""
    return float(values["period"] if "period" in values else 2.0 * (values["rise"] + values["hold"]))


def ramp_limits(values: Values) -> tuple[float, float]:
    """Velocity and acceleration, rad/s and rad/s², at which the longest ramp has its rise and share."""
    velocity = float(np.abs(values["amplitude"]).max()) / (values["rise"] * (1.0 - values["share"]))
    return velocity, velocity / (values["share"] * values["rise"])
