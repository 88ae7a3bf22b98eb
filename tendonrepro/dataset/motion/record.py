"""The desired motion as it was recorded, on an even grid: gaps, rounding, noise, and where it moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError
from tendonrepro.results.records import Trace

FEWEST = 20
"""Samples below which nothing is told of a motion."""
_SPARSE = 10.0
"""Time that a record may last, over that of its samples in a row: more is a pause and not a gap."""
_GAP = 1.9
"""Distance of two samples, over that of most, from which on something is missing between them."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """Desired joint angles of a run on an even time grid.

    `time` (T,), s, is 0 at the run's first sample; `q` (T, n), rad, the displacement from the first angles,
    `start_angle` (n,), with gaps bridged; `known` (T,) is False in a gap. `rounding` is the step to which
    the record itself is rounded, rad, 0 if it is not.
    """

    time: Array
    q: Array
    joint: tuple[int, ...]
    start_angle: Array
    rounding: float
    known: NDArray[np.bool_]

    @property
    def step(self) -> float:
        """Sampling step, s."""
        return float(self.time[1] - self.time[0])

    @property
    def range(self) -> float:
        """Largest range of a joint, rad."""
        return float(np.ptp(self.q, axis=0).max())

    @property
    def missing(self) -> int:
        """Samples in gaps."""
        return int((~self.known).sum())

    def samples(self) -> tuple[Array, Array]:
        """Return times and angles of the samples in no gap, (N,) and (N, n)."""
        return self.time[self.known], self.q[self.known]

    def of(self, column: int) -> Recorded:
        """Record of one joint, by column."""
        one = slice(column, column + 1)
        return replace(self, q=self.q[:, one], joint=self.joint[one], start_angle=self.start_angle[one])

    def moving(self) -> tuple[int, int]:
        """First and last sample of the motion: rest before it and after it are left out."""
        tolerance = max(1.5 * self.rounding, noise_peak(self), 1e-3 * self.range)
        left = (np.abs(self.q - self.q[0]) > tolerance).any(axis=1)
        ahead = (np.abs(self.q - self.q[-1]) > tolerance).any(axis=1)
        if not left.any():
            return 0, len(self.time) - 1
        last = len(ahead) - int(np.argmax(ahead[::-1])) if ahead.any() else len(ahead) - 1
        return max(int(np.argmax(left)) - 1, 0), min(last, len(ahead) - 1)


def recorded(trace: Trace, name: str = "q_d") -> Recorded:
    """Put a recorded angle on an even grid.

    Raise DataMissingError if there are too few samples of it, or it pauses for most of its time.
    """
    values = trace[name]
    there = np.isfinite(values).all(axis=1)
    if there.sum() < FEWEST:
        message = f"run {trace.name!r} holds {int(there.sum())} samples of {name}, {FEWEST} are needed"
        raise DataMissingError(message)
    time, kept = trace.time[there] - trace.time[0], values[there]
    step = float(np.median(np.diff(time)))
    lasts = float(trace.time[-1] - trace.time[0])
    if lasts > _SPARSE * step * len(time):
        message = (
            f"run {trace.name!r} holds {len(time)} samples of {name} in {lasts:.4g} s, {step:.4g} s apart"
        )
        raise DataMissingError(message, hint="cut pauses off with from_s and to_s in the mapping")
    even = step * np.arange(round(lasts / step) + 1.0)
    filled, known = kept, np.ones(len(even), dtype=bool)
    if len(even) != len(time) or np.abs(even - time).max() > 1e-6 * step:
        filled, known = _even(even, time, kept)
    start = filled[0]
    return Recorded(even, filled - start, trace.joint, start, rounding_step(kept), known)


def _even(even: Array, time: Array, kept: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Samples interpolated on an even grid, (T, n), and which of them lie in no gap."""
    filled = np.column_stack([np.interp(even, time, column) for column in kept.T])
    near = np.clip(np.searchsorted(time, even), 1, len(time) - 1)
    step = even[1] - even[0]
    between = (np.abs(even - time[near - 1]) > 0.5 * step) & (np.abs(even - time[near]) > 0.5 * step)
    wide = (time[near] - time[near - 1] > _GAP * step) | (even > time[-1])
    return filled, ~(between & wide)


def rounding_step(angles: Array) -> float:
    """Step to which angles are rounded, rad; 0 if they are not."""
    values = np.unique(angles)
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-7]
    if len(gaps) < FEWEST or gaps.min() > 0.02 * np.ptp(values):
        return 0.0
    whole = np.round((values - values[0]) / gaps.min())
    step = float(whole @ (values - values[0]) / (whole @ whole))
    apart = np.abs(values - values[0] - step * whole).max()
    return step if apart < 1e-3 * step else 0.0


def noise(record: Recorded) -> float:
    """Standard deviation of white noise, from the median fourth difference, rad; 0 where it is rounding."""
    fourth = np.median(np.abs(np.diff(record.q[record.known], 4, axis=0)), axis=0)
    found = float(fourth.max() / (0.6745 * np.sqrt(70.0)))
    return found if found > 0.6 * record.rounding else 0.0


def noise_peak(record: Recorded) -> float:
    """Largest deviation that noise is expected to cause among all samples, that of the first added, rad."""
    return float(noise(record) * (1.0 + np.sqrt(2.0 * np.log(record.q.size))))
