"""Which columns are times, in which unit, and of what."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from tendonrepro.dataset.meaning.columns import Column, same_curve, sampling_step
from tendonrepro.dataset.meaning.words import tokens
from tendonrepro.dataset.readers.units import FACTORS

SAMPLING = 0.001
"""The paper's sampling period, s, where the files hold no times."""
# Longest step of a control loop, s; a hundred milliseconds to the last bit are still that.
_SLOWEST = 0.1 * (1.0 + 1e-6)
_SHORTEST = 0.5  # record of a motion, s


def find_times(group: Sequence[Column]) -> None:
    """Name the time axis of columns recorded together, and hand it to the others."""
    for column in group:
        unnamed = {column.own.quantity, column.unit} == {None} and column.values[0] in {0.0, 1.0}
        if column.quantity == "index" or (unnamed and (np.diff(column.values) == 1.0).all()):
            column.call("index", "it counts samples")
    steps = {column: sampling_step(column.values) for column in group if column.quantity in {None, "time"}}
    named = [column for column in steps if column.quantity == "time"]
    even = [column for column in steps if steps[column]]
    axis = next(iter([*(column for column in named if steps[column]), *named, *even]), None)
    if axis is None:
        return
    rivals = [column for column in steps if not same_curve(column.values, axis.values)]
    clocks = [axis, *(column for column in rivals if column in (named or even))]
    if {*rivals} & {*named, *even}:
        each = "each is taken for those that end with it, on its right first"
        axis.doubts.append(f"several columns can be times, {each}; `time` beside an entry names another")
    for clock in clocks:
        _accept(clock, steps[clock])
    clock = before = axis
    for column in group:
        # Tables side by side begin each with its times; of times side by side the first serve.
        if column in clocks and before not in clocks:
            clock = column
        if column not in clocks and column.quantity != "index" and column.signal.time is None:
            # Of another length are tables of another run.
            fitting = [one for one in clocks if _end_together(column, one)]
            column.time = next(iter([clock] * (clock in fitting) + fitting), clock).address
            if not fitting:
                column.doubts.append(
                    "ends on another row than its times; `time` beside its entry names others"
                )
        before = column


def _accept(clock: Column, step: float | None) -> None:
    """Call a column times, which increase evenly by a step, and ask where they go back."""
    if step is None:
        clock.because.append("although it does not increase evenly")
        back = np.flatnonzero(np.diff(clock.values[np.isfinite(clock.values)]) < 0.0)
        if back.size:
            clock.doubts.append(
                f"times go back after sample {back[0] + 1}: are several runs below each other? "
                "`where` takes the rows of one, or save each in a file of its own"
            )
    elif clock.quantity != "time":
        clock.call("time", f"it increases evenly, by {step:g}")
    if clock.unit not in FACTORS["time"]:
        _settle_unit(clock)


def _end_together(column: Column, clock: Column) -> bool:
    """Whether two columns end on the same row, but for a sample in a hundred."""
    rows = [int(np.flatnonzero(np.isfinite(one.values))[-1:].sum()) for one in (column, clock)]
    return abs(rows[0] - rows[1]) <= 0.01 * max(rows)


def _settle_unit(axis: Column) -> None:
    """Take Simulink's second, else the unit in which it steps as control loops do, and ask."""
    if "tout" in tokens(axis.label):
        axis.unit = "s"
        axis.because.append("Simulink's tout is in s")
        return
    times = axis.values[np.isfinite(axis.values)]
    steps = np.diff(times) if len(times) > 1 else np.zeros(1)
    step, length = float(np.median(steps)), float(np.abs(steps.sum()))
    units = ("s", "ms", "us", "ns")
    place = next((k for k, unit in enumerate(units) if step * FACTORS["time"][unit] <= _SLOWEST), 3)
    # A solver's steps may be longer than a control loop's, but no motion is over at once.
    if place and length * FACTORS["time"][units[place]] < _SHORTEST:
        place -= 1
    axis.unit = units[place]
    reason = f"which makes their step {step * FACTORS['time'][axis.unit] * 1e3:.3g} ms"
    axis.because.append(f"taken to be in {axis.unit}, {reason}")
    axis.doubts.append(f"no unit of the times is stated, {axis.unit} is taken, {reason}; `unit` of `time`")


def share_times(file: Sequence[Column]) -> None:
    """Give columns without a time the only one of their file that is as long; of another table, and ask."""
    axes: dict[int, list[Column]] = defaultdict(list)
    for column in file:
        if column.quantity == "time":
            axes[len(column.values)].append(column)
    for column in file:
        fitting = axes[len(column.values)]
        if len(fitting) == 1 and column.time is None and column.signal.time is None and column not in fitting:
            column.time = fitting[0].address
            # Times beside or above a table are for all below; those of a sheet or struct are its own.
            above = column.time.signal.rpartition("/")[0]
            if above and not column.signal.path.startswith(f"{above}/"):
                column.doubts.append(
                    f"has no times of its own, those of {above!r} are as long and taken; "
                    "`time` beside its entry names others, `step_s` there an even step"
                )
