"""Cycles of a recorded motion that goes out and comes back, and which joints move in each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import Recorded

_AWAY = 0.02
"""Share of a joint's amplitude beyond which it has left its start."""
_STILL = 0.05
"""Share of the largest amplitude below which a joint counts as at rest."""


@dataclass(frozen=True)
class Turns:
    """Cycles of a motion that goes out and comes back.

    Parameters
    ----------
    joints : tuple of tuple of int
        Columns that move in each cycle, in order.
    begin, end : float
        When the first excursion passes 2 % of the amplitude on its way out and back, s.
    cycle : float
        From one excursion to the next, s; 0 when there is only one.
    rise : float
        From 2 % to 98 % of the amplitude, s.
    """

    joints: tuple[tuple[int, ...], ...]
    begin: float
    end: float
    cycle: float
    rise: float

    def pattern(self) -> tuple[tuple[tuple[int, ...], ...], int]:
        """Return the shortest list of turns that repeats, and how often it does."""
        count = len(self.joints)
        for length in range(1, count + 1):
            if count % length == 0 and self.joints == self.joints[:length] * (count // length):
                return self.joints[:length], count // length
        return self.joints, 1


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
    longest = max(groups[0], key=lambda trip: trip[1] - trip[0])
    a, b, i = longest
    top = a + int(np.argmax(np.abs(record.q[a:b, i]) >= (1.0 - _AWAY) * abs(amplitude[i])))
    joints = tuple(tuple(sorted({i for _, _, i in group})) for group in groups)
    times = [float(record.time[k]) for k in (a, b - 1, top)]
    return Turns(joints, times[0], times[1], cycle, max(times[2] - times[0], 2.0 * record.step))


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
