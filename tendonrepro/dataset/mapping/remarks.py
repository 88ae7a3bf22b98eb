"""What a user has to decide about a suggested mapping, in one line for all that is in the same doubt."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.mapping.timebase import SAME_TIME
from tendonrepro.dataset.meaning.assignment import REPEAT, RUNS, places
from tendonrepro.dataset.meaning.columns import Address, Column
from tendonrepro.dataset.meaning.evidence import same_curve
from tendonrepro.dataset.readers.units import FACTORS

_MOST_LISTED = 6


def listed(names: Sequence[str]) -> str:
    """Names in one line, the first few of many.

    Examples
    --------
    >>> listed(["a", "b"]), listed([str(number) for number in range(9)])
    ('a, b', '0, 1, 2, 3, 4, 5 and 3 more')
    """
    more = len(names) - _MOST_LISTED
    return ", ".join(names[:_MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


def remarks_on(runs: Mapping[str, Sequence[Column]], chosen: Mapping[str, Sequence[Column]]) -> Iterator[str]:
    """Runs whose name nobody knows, repetitions, and columns that claim the same place.

    Parameters
    ----------
    runs : mapping
        Columns by run, as `assignment.runs_among` finds them.
    chosen : mapping
        Those that are taken.

    Yields
    ------
    str
    """
    unknown = [name for name in runs if name.partition(REPEAT)[0] not in RUNS]
    if unknown:
        names = listed([repr(name) for name in unknown])
        yield f"{names}: no name says which controller that is: rename it"
    repeated: dict[str, list[str]] = defaultdict(list)
    for name in runs:
        repeated[name.partition(REPEAT)[0]].append(name)
    for first, several in repeated.items():
        if len(several) > 1:
            files = {name: _files(chosen[name]) for name in several}
            alike = len(set(files.values())) < len(several)
            claims = listed(
                [f"{name}: {_tables(chosen[name]) if alike else files[name]}" for name in several]
            )
            yield f"{len(several)} recordings claim to be {first}, the most complete one is taken ({claims})"
    for name, members in runs.items():
        rivals = [
            f"{variable} {joint}: {listed([str(column.address) for column in several])}"
            for (variable, joint), several in places(members).items()
            if any(not same_curve(several[0].values, column.values) for column in several[1:])
        ]
        if rivals:
            yield f"{name}: several columns claim the same place, the first is taken ({'; '.join(rivals)})"


def _files(columns: Sequence[Column]) -> str:
    return listed(list(dict.fromkeys(column.source.name for column in columns)))


def _tables(columns: Sequence[Column]) -> str:
    return listed(list(dict.fromkeys(column.group[1] for column in columns)))


def doubts_of(
    chosen: Mapping[str, Sequence[Column]], left: Sequence[Column], clocks: Mapping[Address, Column]
) -> Iterator[str]:
    """Doubts of the columns in runs, of their times, and of columns that could not be understood.

    Parameters
    ----------
    chosen : mapping
        Columns by run.
    left : sequence of Column
        Those in no run.
    clocks : mapping
        Columns of times by their address.

    Yields
    ------
    str
    """
    where: dict[str, dict[str, None]] = defaultdict(dict)
    for name, columns in chosen.items():
        for column in columns:
            for doubt in (*column.doubts, *(clocks[column.time].doubts if column.time else ())):
                where[doubt][name] = None
    for column in left:
        for doubt in column.doubts if column.quantity in {None, "other"} else ():
            where[doubt][column.source.name] = None
    for doubt, names in where.items():
        yield f"{listed(list(names))}: {doubt}"


def common_step(
    chosen: Mapping[str, Sequence[Column]], clocks: Mapping[Address, Column]
) -> tuple[float | None, list[str], list[str]]:
    """Step at which runs must be resampled, for their columns have times of their own.

    Parameters
    ----------
    chosen : mapping
        Columns by run.
    clocks : mapping
        Columns of times by their address.

    Returns
    -------
    step : float or None
        s; None where no run needs it.
    apart : list of str
        Runs whose clocks do not meet, and must be taken to start together.
    remarks : list of str
    """
    steps: list[float] = []
    apart, resampled = [], []
    for name, columns in chosen.items():
        axes = [axis for axis in _times(columns, clocks) if len(axis) > 1]
        if all(_same(axes[0], axis) for axis in axes[1:]):
            continue
        if max(axis[0] for axis in axes) >= min(axis[-1] for axis in axes):
            apart.append(name)
            axes = [axis - axis[0] for axis in axes]
        if not all(_same(axes[0], axis) for axis in axes[1:]):
            rises = [np.diff(axis)[np.diff(axis) > 0.0] for axis in axes]
            found = [float(np.median(rise)) for rise in rises if rise.size]
            # A clock that stands still all the time has no step; ingest says so.
            if found:
                resampled.append(name)
                steps.append(min(found))
    remarks = []
    if apart:
        remarks.append(f"{listed(apart)}: clocks of columns do not meet, they are taken to start together")
    step = float(f"{min(steps):.4g}") if steps else None
    if step is not None:
        told = f"columns have times of their own, so all runs are resampled every {step:g} s"
        remarks.append(f"{listed(resampled)}: {told}")
    return step, apart, remarks


def _same(a: Array, b: Array) -> bool:
    return len(a) == len(b) and bool(np.abs(a - b).max() <= SAME_TIME * np.median(np.diff(a)))


def _times(columns: Sequence[Column], clocks: Mapping[Address, Column]) -> list[Array]:
    """Different times of columns, s, as far as they are numbers."""
    found: dict[object, Array] = {}
    for column in columns:
        if column.signal.time is not None:
            found[id(column.signal.time)] = column.signal.time
        elif column.time is not None and column.time not in found:
            clock = clocks[column.time]
            found[column.time] = clock.values * FACTORS["time"][clock.unit or "s"]
    return [times[np.isfinite(times)] for times in found.values()]
