"""The walk through what a MATLAB variable holds, down to its signals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.readers.matlab.values import (
    EXPORT,
    Lost,
    Plain,
    Series,
    Table,
    flat_samples,
    members,
    text_of,
)
from tendonrepro.dataset.readers.signals import Found, is_full, seconds

_DEEPEST = 24
_MOST_NODES = 100_000
_MOST_LINES = 20
# First number of what stands in a file for an object whose properties lie elsewhere.
_REFERENCE = 0xDD000000
# Member of what stands for the samples of a streamed log.
_STREAMED = "DataR2"


class Walk:
    """A walk that fills a `Found`; one for each file, so that its bounds hold for the file."""

    def __init__(self, found: Found, translate: Callable[[Any], Plain]) -> None:
        self._found = found
        self._translate = translate
        self._objects: dict[int, tuple[str, object]] = {}
        self._nodes = 0
        self._left_out = 0

    def visit(self, path: str, value: Any, group: str = "", depth: int = 0) -> None:
        """Note every signal in a value at a path; `group` is the path of what it was recorded in."""
        self._nodes += 1
        if self._nodes > _MOST_NODES or depth > _DEEPEST:
            self._left_out += 1
            return
        plain = value if type(value) is np.ndarray else self._plain(path, value)
        match plain:
            case Lost(reason, advice):
                self._found.skip(path, reason, advice)
            case Series():
                self._series(path, plain, group)
            case Table():
                self._table(path, plain)
            case str():
                self._found.text(path, plain)
            case Mapping():
                self._members(path, plain, depth)
            case np.ndarray():
                self._array(path, plain, group, depth)
            case _:
                self._found.skip(path, f"{type(value).__name__} is not understood", EXPORT)

    def finish(self) -> None:
        """Note how much the bounds have left out."""
        if self._left_out:
            self._found.skip(
                "", f"{self._left_out} more values are left out", "split the file into smaller ones"
            )

    def _plain(self, path: str, value: Any) -> Plain:
        if hasattr(value, "toarray"):
            return Lost("a sparse matrix", "save it with full()")
        if isinstance(value, (str, Series, Table, Lost)):
            return value
        plain = value if type(value) is dict else self._translate(value)
        if not isinstance(plain, Mapping):
            return plain
        # Handle objects are shared and may hold each other.
        first, _ = self._objects.setdefault(id(value), (path, value))
        return plain if first == path else Lost(f"the same object as {first}")

    def _series(self, path: str, series: Series, group: str) -> None:
        if is_full(self._found):
            self._left_out += 1
            return
        values, note = flat_samples(series.values, None if series.time is None else len(series.time))
        notes = "; ".join(text for text in (series.note, note) if text)
        self._found.text(f"{path}/block", series.block)
        self._found.add(
            path, values, label=series.label, unit=series.unit, group=group, time=series.time, note=notes
        )

    def _table(self, path: str, table: Table) -> None:
        for name, column in table.columns.items():
            where = f"{path}/{name}"
            if column.dtype.kind in "mM":
                values, note = seconds(column)
                self._series(where, Series(values, table.time, name, "s", note), path)
            elif column.dtype.kind in "biufc":
                series = Series(column, table.time, name, table.units.get(name) or None, table.note)
                self._series(where, series, path)
            else:
                self._found.skip(where, "not a column of numbers")

    def _array(self, path: str, array: NDArray[Any], group: str, depth: int) -> None:
        if array.dtype.names is not None:
            self._records(path, array, depth)
        elif array.dtype.kind == "O":
            self._cells(path, array, depth)
        elif array.dtype.kind in "UST":
            self._found.text(path, " | ".join(str(line).rstrip() for line in array.ravel()[:_MOST_LINES]))
        elif array.dtype.kind in "mM":
            values, note = seconds(array)
            self._series(path, Series(values, unit="s", note=note), group)
        elif array.dtype == np.uint32 and array.size > 2 and array.flat[0] == _REFERENCE:
            self._found.skip(path, "an object whose properties cannot be read", EXPORT)
        else:
            self._series(path, Series(array), group)

    def _records(self, path: str, array: NDArray[Any], depth: int) -> None:
        if array.size == 1 and array.dtype.hasobject:
            self._members(path, members(array), depth)
            return
        if not array.dtype.hasobject:
            self._found.skip(path, "calendar durations" if array.dtype.names else "empty")
            return
        flat = array.ravel(order="F")
        columns = {name: _numbers(flat[name]) for name in array.dtype.names or ()}
        for name, column in columns.items():
            if column is not None:
                self._series(f"{path}/{name}", Series(column, note="one number per element"), path)
        for number, record in enumerate(self._bounded(flat), start=1):
            where = f"{path}[{number}]"
            for name in (name for name, column in columns.items() if column is None):
                self.visit(f"{where}/{name}", record[name], where, depth + 1)

    def _cells(self, path: str, array: NDArray[Any], depth: int) -> None:
        for number, cell in enumerate(self._bounded(array.ravel(order="F")), start=1):
            self.visit(f"{path}[{number}]", cell, "", depth + 1)

    def _bounded(self, items: NDArray[Any]) -> NDArray[Any]:
        """As many items as may still be visited."""
        left = max(0, _MOST_NODES - self._nodes)
        self._left_out += max(0, len(items) - left)
        return items[:left]

    def _members(self, path: str, values: Mapping[str, Any], depth: int) -> None:
        if _STREAMED in values:
            self._found.skip(path, f"its samples are #sigstream#/{np.ravel(values[_STREAMED])[0]:g}")
            return
        logged = list(_logged(values))
        for where, series in logged:
            self._series(f"{path}/{where}/values", series, path)
        for where, record in _signals(values) if logged else ():
            for name, value in record.items():
                self._found.text(f"{path}/{where}/{name}", text_of(value))
        for name, value in values.items():
            if not (logged and name == "signals"):
                self.visit(f"{path}/{name}", value, path, depth + 1)


def _signals(values: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Places and members of the signals in a struct that Simulink has logged."""
    signals = values.get("signals")
    if (
        "time" not in values
        or not isinstance(signals, np.ndarray)
        or "values" not in (signals.dtype.names or ())
    ):
        return
    for number, record in enumerate(signals.ravel(order="F"), start=1):
        yield "signals" if signals.size == 1 else f"signals[{number}]", members(record)


def _logged(values: Mapping[str, Any]) -> Iterator[tuple[str, Series]]:
    time = np.ravel(values.get("time", ()))
    clock = np.asarray(time, np.float64) if time.size and time.dtype.kind in "iuf" else None
    for where, own in _signals(values):
        if isinstance(own["values"], np.ndarray) and own["values"].dtype.kind in "biufc":
            label = text_of(own.get("label")) or text_of(own.get("blockName"))
            yield where, Series(own["values"], clock, label)


def _numbers(items: Iterable[Any]) -> NDArray[Any] | None:
    """Items as one array if each is a single number."""
    found = []
    for item in items:
        if not isinstance(item, np.ndarray) or item.size != 1 or item.dtype.kind not in "biuf":
            return None
        found.append(item.flat[0])
    return np.array(found) if len(found) > 1 else None
