"""One time base for the signals of a run: the one they share, or one that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array

SAME_TIME = 1e-3
"""Largest difference of times that count as equal, as a share of the step."""
MOST_SAMPLES = 2**27
"""Most samples of a run; every column of so many takes 1 GiB."""


class TimeProblem(Exception):
    """Times that cannot be used as they are: which and why, and what to change in the mapping."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


_KEPT = 0.5
"""Least part of the longest signal that common times keep."""
_SEVERAL = (
    "It starts over: several runs below each other? `where` takes the rows of one from a table that holds "
    "several; without a column that tells them apart save each in a file of its own."
)
_LOOK = (
    "Look at this column with `tendonrepro inspect`. "
    "`where` takes the rows of one run from a table that holds several; "
    "`time: {step_s: 0.001}` beside the column, with the record's own step, does without its times."
)
_CLOCKS = (
    "Look at `unit` and `step_s` of their `time`. Two clocks? `offset` there is taken off the times, in the "
    "file's unit: give each the first time of its own clock."
)


@dataclass(frozen=True, eq=False)
class Timed:
    """A signal by its name in messages, its sampling times (N,) in s, and its values (N,) in SI."""

    name: str
    time: Array
    values: Array

    @property
    def step(self) -> float:
        """Median step, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def extent(self) -> str:
        """From when to when it lasts."""
        first, last = float(self.time[0]), float(self.time[-1])
        return f"lasts from {in_seconds(first)} to {in_seconds(last)} s ({last - first:.6g} s)"


def in_seconds(time: float) -> str:
    """A time to read, to the millisecond where it counts from long ago."""
    return f"{time:.6g}" if abs(time) < 1e3 else f"{time:.3f}".rstrip("0").rstrip(".")


def checked(signal: Timed) -> tuple[Timed, int]:
    """Leave out samples without a time, and count them; refuse times that do not fit or do not increase."""
    if len(signal.time) != len(signal.values):
        message = f"{signal.name} has {len(signal.values)} samples, its time has {len(signal.time)}"
        raise TimeProblem(message, "Give it the time it was recorded with, as `time` beside its `signal`.")
    known = np.isfinite(signal.time)
    time, values = signal.time[known], signal.values[known]
    if len(time) < 2:
        raise TimeProblem(f"{signal.name} has fewer than two samples with a time", _LOOK)
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if late.size:
        k = int(late[0])
        step = f"from sample {k + 1} to {k + 2}: {in_seconds(time[k])} s, {in_seconds(time[k + 1])} s"
        starts_over = k > 0 and time[k + 1] - time[0] < 0.1 * (time[k] - time[0])
        message = f"the time of {signal.name} does not increase {step}"
        raise TimeProblem(message, _SEVERAL if starts_over else _LOOK)
    return Timed(signal.name, time, values), len(known) - len(time)


def within(signal: Timed, first: float | None, last: float | None) -> Timed:
    """Samples from `first` to `last`, s, both ends included; None leaves an end as it is."""
    start, end = -np.inf if first is None else first, np.inf if last is None else last
    kept = (signal.time >= start) & (signal.time <= end)
    if kept.sum() < 2:
        message = f"{signal.name} has {kept.sum()} samples between from_s and to_s; it {signal.extent}"
        raise TimeProblem(message, "Change from_s or to_s of the run.")
    return Timed(signal.name, signal.time[kept], signal.values[kept])


def shared(signals: Sequence[Timed]) -> Array:
    """Times of the first signal (N,), s, when those of all others are the same to a thousandth of a step."""
    first = signals[0]
    for other in signals[1:]:
        if len(other.time) != len(first.time):
            apart = f"{first.name} has {len(first.time)} samples, {other.name} has {len(other.time)}"
        elif (most := float(np.abs(other.time - first.time).max())) > SAME_TIME * first.step:
            apart = f"the times of {first.name} and {other.name} differ by up to {in_seconds(most)} s"
        else:
            continue
        step = f"{{step_s: {max(signal.step for signal in signals):.3g}}}"
        way = f"`resample: {step}` at the top of the mapping puts all signals on common times."
        raise TimeProblem(f"{apart}: one {first.extent}, the other {other.extent}", f"{way} {_CLOCKS}")
    return first.time


def resampled(signals: Sequence[Timed], time: Array) -> str:
    """How many samples a signal had and has on common times, and what lies outside of these, in words."""
    lost = {each.name: int(((each.time < time[0]) | (each.time > time[-1])).sum()) for each in signals}
    name, most = max(lost.items(), key=lambda item: item[1])
    counts = f"{len(time)} samples of up to {max(len(each.time) for each in signals)}"
    return f"{counts}; {most} of {name} lie outside and are dropped" if most else counts


def even(signals: Sequence[Timed], step: float) -> Array:
    """Even times by `step`, s, from the latest start to the earliest end, as far as memory is for them."""
    start, end = (float(f(one.time[k] for one in signals)) for f, k in ((max, 0), (min, -1)))
    short, *_, long = sorted((*signals, *signals), key=lambda one: one.time[-1] - one.time[0])
    if end - start < max(step, _KEPT * (long.time[-1] - long.time[0])):
        both = f"{short.name} {short.extent}, {long.name} {long.extent}"
        message = f"signals have only {max(end - start, 0.0):.6g} s in common: {both}"
        raise TimeProblem(message, f"{_CLOCKS} `from_s` and `to_s` of the run keep a part on purpose.")
    steps = (end - start) / step
    if steps >= MOST_SAMPLES:
        raise TimeProblem(f"a step of {step:g} s makes {steps:.3g} samples", "Take a larger step_s.")
    # The margin keeps an end that rounding put just before its step.
    return np.asarray(start + step * np.arange(int(np.floor(steps + 1e-6)) + 1))
