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
_LOSS = (
    "Look at their `time`, its `unit`, `offset` and `step_s`: signals of one record last about equally long. "
    "`from_s` and `to_s` of the run keep a part on purpose."
)
_LOOK = (
    "Look at this column with `tendonrepro inspect`. "
    "`where` takes the rows of one run from a table that holds several; "
    "`time: {step_s: 0.001}` beside the column, with the record's own step, does without its times."
)
_CLOCKS = (
    "Two clocks? `offset` in a column's `time` is taken off its times, in the file's unit: "
    "give each the first time of its own clock."
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
    """A time to read, to the millisecond where it counts from long ago.

    Examples
    --------
    >>> in_seconds(0.25), in_seconds(1773300045.5)
    ('0.25', '1773300045.5')
    """
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
        raise TimeProblem(f"the time of {signal.name} does not increase {step}", _LOOK)
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
    same = SAME_TIME * first.step
    for other in signals[1:]:
        if len(other.time) != len(first.time):
            _refuse_apart((first, other))
            message = f"{first.name} has {len(first.time)} samples, {other.name} has {len(other.time)}"
            raise TimeProblem(message, _resample(signals))
        late = other.time - first.time
        apart = float(np.abs(late).max())
        if apart > same:
            message = f"the times of {first.name} and {other.name} differ by up to {in_seconds(apart)} s"
            if not _overlap(first, other):
                raise TimeProblem(message, _CLOCKS)
            clocks = f"{_CLOCKS} " if np.ptp(late) <= same else ""
            raise TimeProblem(message, clocks + _resample(signals))
    return first.time


def _refuse_apart(signals: Sequence[Timed]) -> None:
    """Refuse signals that were never recorded at the same time, as far as their clocks say."""
    late = max(signals, key=lambda signal: signal.time[0])
    early = min(signals, key=lambda signal: signal.time[-1])
    if not _overlap(early, late):
        both = f"{early.name} {early.extent}, {late.name} {late.extent}"
        raise TimeProblem(f"signals have only 0 s in common: {both}", _CLOCKS)


def _overlap(one: Timed, other: Timed) -> bool:
    return bool(one.time[0] <= other.time[-1] and other.time[0] <= one.time[-1])


def _common(signals: Sequence[Timed]) -> tuple[float, float]:
    """From the latest start to the earliest end, s."""
    return max(float(each.time[0]) for each in signals), min(float(each.time[-1]) for each in signals)


def _loss(signals: Sequence[Timed]) -> str:
    """What common times would lose of the signals, in words, where it is most of one; else nothing."""
    start, end = _common(signals)
    short, *_, long = sorted((*signals, *signals), key=lambda each: each.time[-1] - each.time[0])
    if end - start >= _KEPT * (long.time[-1] - long.time[0]):
        return ""
    both = f"{short.name} {short.extent}, {long.name} {long.extent}"
    return f"signals have only {end - start:.6g} s in common: {both}"


def resampled(signals: Sequence[Timed], time: Array) -> str:
    """How many samples a signal had and has on common times, and what lies outside of these, in words."""
    lost = {each.name: int(((each.time < time[0]) | (each.time > time[-1])).sum()) for each in signals}
    name, most = max(lost.items(), key=lambda item: item[1])
    counts = f"{len(time)} samples of up to {max(len(each.time) for each in signals)}"
    return f"{counts}; {most} of {name} lie outside and are dropped" if most else counts


def _resample(signals: Sequence[Timed]) -> str:
    """The way to common times, at a step that invents no samples."""
    if _loss(signals):
        return _LOSS
    step = max(signal.step for signal in signals)
    return f"`resample: {{step_s: {step:.3g}}}` at the top of the mapping puts all signals on common times."


def even(signals: Sequence[Timed], step: float) -> Array:
    """Even times by `step`, s, from the latest start to the earliest end, as far as memory is for them."""
    _refuse_apart(signals)
    start, end = _common(signals)
    steps = (end - start) / step
    if steps >= MOST_SAMPLES:
        raise TimeProblem(f"a step of {step:g} s makes {steps:.3g} samples", "Take a larger step_s.")
    # The margin keeps an end that rounding put just before its step.
    count = int(np.floor(steps + 1e-6)) + 1
    if count < 2:
        message = f"signals have only {end - start:.3g} s in common, less than a step of {step:g} s"
        hint = "Take another step_s, or leave out a signal that starts late or ends early."
        raise TimeProblem(message, hint)
    if loss := _loss(signals):
        raise TimeProblem(loss, _LOSS)
    return np.asarray(start + step * np.arange(count))
