"""Rows and times of a run in a table: clocks, times that start again, gaps; curves read off figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.mapping import RunMapping, Use
from tendonrepro.dataset.tables import Columns
from tendonrepro.errors import ConfigError
from tendonrepro.results.records import median_step

_GAP = 1.5
"""Steps beyond this many median ones are gaps."""
_EVEN = 0.1
"""Share of the median step by which a step of a recorder may differ."""
_MOST_POINTS = 5000
"""Points of a curve that somebody may have read off a figure."""
_FINEST = 0.02
"""Step of the grid on which curves are put, at most, s."""


def by_clock(table: Columns, uses: Mapping[str, Use]) -> dict[str | None, list[str]]:
    """Columns of signals by the column of their times: the nearest to the left, else the first.

    Of columns of times that stand side by side the first counts.
    """
    columns_of: dict[str | None, list[str]] = {}
    clock, first, before_is_time = None, None, False
    waiting: list[str] = []
    for column in table:
        is_time = column in uses and uses[column].variable == "time"
        if is_time and not before_is_time:
            clock = column
            first = column if first is None else first
        elif column in uses and not is_time:
            (waiting if clock is None else columns_of.setdefault(clock, [])).append(column)
        before_is_time = is_time
    if waiting:
        columns_of[first] = waiting + columns_of.get(first, [])
    return columns_of


def by_rows(table: Columns, columns: Sequence[str]) -> list[tuple[NDArray[np.bool_], list[str]]]:
    """Columns of one clock by the rows that hold them: all of them together, or some where others have gaps.

    A union of logs has a row for each time of each.
    """
    count = len(next(iter(table.values())))
    every = np.ones(count, dtype=bool)
    groups: list[tuple[NDArray[np.bool_], list[str]]] = []
    for column in columns:
        values = table[column]
        rows = np.isfinite(values) if values.dtype.kind == "f" else every
        beside = next((group for group in groups if not _alternate(group[0], rows)), None)
        if beside is None:
            groups.append((rows, [column]))
        else:
            beside[1].append(column)
    return groups if len(groups) > 1 else [(every, list(columns))]


def _alternate(rows: NDArray[np.bool_], others: NDArray[np.bool_]) -> bool:
    """Whether rows lie among others, but are seldom the same."""
    least = min(rows.sum(), others.sum())
    if not least or 2 * (rows & others).sum() >= least:
        return False
    ends = [np.flatnonzero(these)[[0, -1]] for these in (rows, others)]
    shared = min(end[1] for end in ends) - max(end[0] for end in ends)
    return bool(2 * shared > min(end[1] - end[0] for end in ends))


def starts_again(time: Array) -> NDArray[np.int64]:
    """Places at which the time goes back, among samples that have one."""
    return np.flatnonzero(np.diff(time[np.isfinite(time)]) < 0.0) + 1


def even_step(time: Array) -> float:
    """Step of samples whose rounded times repeat, s; 0 if they do not."""
    known = time[np.isfinite(time)]
    steps = np.diff(known)
    if len(known) < 3 or (steps < 0.0).any() or (steps > 0.0).all() or not steps.any():
        return 0.0
    numbers = np.arange(len(known))
    slope = float(np.polyfit(numbers, known, 1)[0])
    # The simplest number that keeps every sample within the rounding.
    for digits in range(1, 9):
        step = float(f"{slope:.{digits - 1}e}")
        if abs(step - slope) * len(known) <= steps[steps > 0.0].min():
            return step
    return slope


def rows_of(table: Columns, run: RunMapping) -> NDArray[np.bool_]:
    """Rows that a run takes by `where`.

    Raises
    ------
    ConfigError
        If a column of `where` is not there.
    """
    rows = np.ones(len(next(iter(table.values()))), dtype=bool)
    for column, wanted in run.where.items():
        if column not in table:
            raise ConfigError(f"{table.name} has no column {column!r}")
        rows &= table[column] == wanted
    return rows


def times_of(
    table: Columns, rows: NDArray[np.bool_], clock: str | None, uses: Mapping[str, Use], run: RunMapping
) -> tuple[Array, list[str]]:
    """Times of the rows that a run takes, s, NaN where it takes none, and notes.

    Raises
    ------
    ConfigError
        If there are no times, they go back or repeat, or fewer than two samples are left.
    """
    if clock is None and run.step_s is None:
        hint = "give its column of times the line 'NAME: time s', or the run 'step_s: 0.001'"
        raise ConfigError(f"{table.name} has no times", hint=hint)
    notes: list[str] = []
    time = np.arange(float(rows.sum())) if clock is None else uses[clock].in_si(table[clock][rows])
    time[~np.isfinite(time)] = np.nan
    if run.part is not None:
        places = np.flatnonzero(np.isfinite(time))
        edges = [0, *starts_again(time).tolist(), len(places)]
        if run.part >= len(edges):
            message = (
                f"the time of {table.name} starts again {len(edges) - 2} times: there is no part {run.part}"
            )
            raise ConfigError(message, hint=f"parts are counted from 1 to {len(edges) - 1}")
        time[places[: edges[run.part - 1]]] = time[places[edges[run.part] :]] = np.nan
    if run.step_s is not None:
        known = np.isfinite(time)
        time = np.where(known, run.step_s * (np.cumsum(known) - 1.0), np.nan)
        notes += [f"times are made from step_s, not from {clock!r}"] if clock is not None else []
    time[(time < run.from_s) | (time > run.to_s)] = np.nan
    return time, notes + _checked(time, table.name, run)


def _checked(time: Array, table: str, run: RunMapping) -> list[str]:
    """Notes on gaps; a ConfigError where times go back, repeat, or are fewer than two."""
    kept = time[np.isfinite(time)]
    if len(kept) < 2:
        raise ConfigError(f"{table} has fewer than two samples that the run takes")
    if run.reading_error_deg:
        return []
    steps = np.diff(kept)
    if back := len(starts_again(kept)):
        message = (
            f"the time of {table} starts again {back} times, first after {kept[np.argmax(steps < 0.0)]:.6g} s"
        )
        hint = "runs below each other? 'part: 1' takes the first, `where` those of a column"
        raise ConfigError(message, hint=hint)
    if repeats := int((steps == 0.0).sum()):
        message = f"the time of {table} repeats {repeats} times, first at {kept[np.argmin(steps)]:.6g} s"
        hint = f"rounded times? 'step_s: {even_step(kept):.6g}' makes them from the numbers of the samples"
        raise ConfigError(message, hint=hint)
    gaps = int((steps > _GAP * np.median(steps)).sum())
    longest = np.argmax(steps)
    told = f"{gaps} gaps in the times, the longest of {steps[longest]:.4g} s at {kept[longest]:.6g} s"
    return [told] if gaps else []


def is_digitised(time: Array) -> bool:
    """Whether times are as uneven as those of points read off a figure.

    A recorder that loses samples still has most steps alike.
    """
    steps = np.diff(time[np.isfinite(time)])
    if not 2 < len(steps) < _MOST_POINTS:
        return False
    middle = np.median(np.abs(steps))
    return bool((np.abs(steps - middle) > _EVEN * middle).mean() > 0.5)


def in_order(time: Array, values: Array) -> tuple[Array, Array]:
    """Points of a curve by time; of points at one time the mean."""
    known = np.isfinite(time) & np.isfinite(values)
    places, index = np.unique(time[known], return_inverse=True)
    return places, np.bincount(index, values[known]) / np.bincount(index)


def read_off(series: Mapping[Use, tuple[Array, Array]]) -> tuple[Array, dict[Use, Array]]:
    """Curves, each times (s) and values, on one even grid, smoothed as cross-validation finds best.

    Raises
    ------
    ConfigError
        If curves have no time in common or too few points.
    """
    from scipy.interpolate import make_smoothing_spline

    if few := [use for use, (time, _) in series.items() if len(time) < 5]:
        raise ConfigError(f"the curve of {few[0]} has fewer than five points")
    times = [time for time, _ in series.values()]
    start, end = max(float(time[0]) for time in times), min(float(time[-1]) for time in times)
    if end <= start:
        raise ConfigError("its curves have no time in common")
    densest = min(median_step(time) for time in times)
    count = max(int(np.ceil((end - start) / min(0.5 * densest, _FINEST))), 1)
    grid = np.linspace(start, end, count + 1)
    # Smoothed to the stated error, a motion would lose its corners to a careful reader.
    return grid, {use: make_smoothing_spline(time, values)(grid) for use, (time, values) in series.items()}
