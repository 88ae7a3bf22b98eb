"""Which columns are times, in which unit, and of what."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.columns import Column
from tendonrepro.dataset.meaning.evidence import sampling_step
from tendonrepro.dataset.meaning.words import tokens
from tendonrepro.dataset.readers.units import FACTORS

SAMPLING = 0.001
"""The paper's sampling period, s, where the files hold no times."""
# Longest step of a control loop, s; a hundred milliseconds to the last bit are still that.
_SLOWEST = 0.1 * (1.0 + 1e-6)
_SHORTEST = 0.5  # record of a motion, s


def find_times(group: Sequence[Column]) -> None:
    """Name the time axes of columns recorded together, and hand each to the columns it is of."""
    for column in group:
        if column.quantity == "index" or (column.own.quantity is None and _counts(column.values)):
            column.call("index", "it counts samples")
    group = [column for column in group if column.quantity != "index"]
    steps = {column: sampling_step(column.values) for column in group}
    axes = _axes(group, steps)
    for axis in axes:
        if steps[axis] is None:
            axis.because.append("although it does not increase evenly")
        elif axis.quantity != "time":
            axis.call("time", f"it increases evenly, by {steps[axis]:g}")
        if axis.unit not in FACTORS["time"]:
            _settle_unit(axis)
    current = axes[0] if axes else None
    for column in group:
        current = column if column in axes else current
        if current is not None and column not in axes and column.signal.time is None:
            column.time = current.address


def _axes(group: Sequence[Column], steps: dict[Column, float | None]) -> list[Column]:
    """Time axes of a group: one, unless each stands before columns of its own, as in ``X1, Y1, X2, Y2``."""
    even = [column for column in group if steps[column]]
    nameless = all(column.quantity in {None, "time"} for column in group[::2])
    alternate = len(group) > 3 and nameless and list(group[::2]) == even
    paired = even if alternate else [c for c in even if c.quantity == "time" or _is_abscissa(c)]
    places = [group.index(column) for column in paired]
    if len(paired) > 1 and places[0] == 0 and np.diff(places).min() > 1:
        return paired
    named = [column for column in group if column.quantity == "time"]
    unnamed = [column for column in even if column.quantity is None]
    return [*(c for c in named if steps[c]), *paired, *named, *unnamed][:1]


def _is_abscissa(column: Column) -> bool:
    """Whether the last word of its name is an x, as in ``X1`` or ``Desired X``."""
    return [word for word in tokens(column.label) if word.isalpha()][-1:] == ["x"]


def _counts(values: Array) -> bool:
    """Whether numbers are 0, 1, 2 or 1, 2, 3 and so on."""
    return bool(values[0] in {0.0, 1.0} and (np.diff(values) == 1.0).all())


def _settle_unit(axis: Column) -> None:
    """Take Simulink's second, else the unit that makes step and length those of a record, and ask."""
    if "tout" in tokens(axis.label):
        axis.unit = "s"
        axis.because.append("Simulink's tout is in s")
        return
    times = axis.values[np.isfinite(axis.values)]
    steps = np.diff(times) if len(times) > 1 else np.zeros(1)
    step, length = float(np.median(steps)), float(np.abs(steps.sum()))
    units = [(unit, FACTORS["time"][unit]) for unit in ("s", "ms", "us", "ns")]
    place = next((k for k, (_, factor) in enumerate(units) if step * factor <= _SLOWEST), len(units) - 1)
    # A solver's steps may be longer than a control loop's, but no motion is over at once.
    if place and length * units[place][1] < _SHORTEST:
        place -= 1
    axis.unit, factor = units[place]
    reason = f"which makes their step {step * factor * 1e3:.3g} ms"
    axis.because.append(f"taken to be in {axis.unit}, {reason}")
    axis.doubts.append(f"no unit of the times is stated, {axis.unit} is taken, {reason}")


def share_times(file: Sequence[Column]) -> None:
    """Give columns without a time that of their rows, else the only one of their file that is as long."""
    axes: dict[int, list[Column]] = defaultdict(list)
    for column in file:
        if column.quantity == "time":
            axes[len(column.values)].append(column)
    for column in file:
        fitting = axes[len(column.values)]
        beside = [axis for axis in fitting if axis.group == column.group]
        timeless = column.time is None and column.signal.time is None and column not in fitting
        if timeless and len(beside or fitting) == 1:
            column.time = (beside or fitting)[0].address
