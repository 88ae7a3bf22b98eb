"""Code for many experiments at once, on arrays (rows, lanes).

A row is ``LANES`` neighbouring numbers, one of each experiment: of a variable, such as the angle of joint 2,
or of a parameter. A function of physics gets symbols for rows, so it writes its operations on a tape:
``k * (q - r)`` becomes ``x3 = x1 - x2``, ``x4 = x0 * x3``. The tape becomes machine code that works on whole
rows. What depends on parameters alone is worked out once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.simulation.codegen import elementary, machine
from tendonrepro.simulation.codegen.machine import ALIGNED, LANES
from tendonrepro.simulation.codegen.symbols import Line, Symbol, Tape, as_operand, is_number

EXPANDED = {
    np.sin: elementary.sin,
    np.cos: elementary.cos,
    np.tanh: elementary.tanh,
    np.exp: elementary.exp,
}
"""Functions replaced by arithmetic."""


class LaneTape(Tape):
    """Tape for code on lanes; divisions by one number share its reciprocal."""

    def __init__(self) -> None:
        super().__init__()
        self.parameters: set[str] = set()

    def write(self, operation: str, *operands: Any) -> Symbol:
        """As of any tape; an operation on parameters alone is a parameter."""
        symbol = super().write(operation, *operands)
        names = {operand.name for operand in operands if isinstance(operand, Symbol)}
        if names and self.parameters.issuperset(names):
            self.parameters.add(symbol.name)
        return symbol

    def function(self, ufunc: Any, x: Symbol) -> Any:
        """As of any tape, from arithmetic."""
        if ufunc in EXPANDED:
            return EXPANDED[ufunc](x)
        if ufunc is np.frexp:
            return self.write("mantissa", x), self.write("exponent", x)
        return super().function(ufunc, x)

    def binary(self, operator: str, left: Any, right: Any) -> Any:
        """As of any tape."""
        if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
            return NotImplemented
        if operator == "**":
            return elementary.power(left, right)
        if operator == "/" and isinstance(right, Symbol) and not is_number(left, 1.0):
            return left * super().binary("/", 1.0, right)
        return super().binary(operator, left, right)

    def row(self, index: int, *, parameter: bool = False) -> Symbol:
        """Symbol of a row."""
        symbol = self.write("row", float(index))
        if parameter:
            self.parameters.add(symbol.name)
        return symbol


@dataclass
class LaneRows:
    """Rows as handed out: the first of each name, and the values (N,) of parameters' rows."""

    count: int = 0
    named: dict[str, int] = field(default_factory=dict)
    constants: dict[int, Array] = field(default_factory=dict)

    def take(self, name: str, size: int) -> list[int]:
        """New rows."""
        self.named[name] = self.count
        self.count += size
        return list(range(self.named[name], self.count))

    def variables(self, tape: LaneTape, name: str, size: int) -> Array:
        """Symbols of rows that change, (size,)."""
        return np.array([tape.row(row) for row in self.known(name, size)], dtype=object)

    def known(self, name: str, size: int) -> list[int]:
        """Rows of a name, new when first asked for."""
        if name not in self.named:
            return self.take(name, size)
        return list(range(self.named[name], self.named[name] + size))

    def parameters(self, tape: LaneTape, record: Any) -> Any:
        """Replace numbers of a stacked record by symbols.

        Zero or one in every experiment stays a number. So do integers and booleans, which choose branches.
        """

        def symbols(leaf: Any) -> Any:
            if isinstance(leaf, bool | int):
                return leaf
            cells = np.empty(leaf.shape[:-1], dtype=object)
            for index in np.ndindex(cells.shape):
                cells[index] = _plain(leaf[index])
                if cells[index] is None:
                    (row,) = self.take(f"parameter {self.count}", 1)
                    self.constants[row] = leaf[index]
                    cells[index] = tape.row(row, parameter=True)
            return cells if cells.shape else cells[()]

        return mapped(symbols, record)

    def holding(self, record: Any) -> LaneRows:
        """The same rows for another record of one :func:`signature`."""
        return replace(self, constants=dict(zip(self.constants, _varying(record), strict=True)))


def _plain(values: Array) -> float | None:
    """Zero or one where all values are, else None."""
    first = float(values[0])
    return first if first in (0.0, 1.0) and (values == first).all() else None


def mapped(function: Callable[..., Any], *records: Any) -> Any:
    """Apply a function to the leaves of nested tuples of one structure."""
    first = records[0]
    if not isinstance(first, tuple):
        return function(*records)
    parts = [mapped(function, *leaves) for leaves in zip(*records, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)


def _leaves(record: Any) -> list[Any]:
    found: list[Any] = []
    mapped(found.append, record)
    return found


def _varying(record: Any) -> Iterator[Array]:
    """Numbers of a stacked record that become rows, each (N,)."""
    for leaf in _leaves(record):
        if not isinstance(leaf, bool | int):
            yield from (values for values in leaf.reshape(-1, leaf.shape[-1]) if _plain(values) is None)


def signature(record: Any) -> tuple[Any, ...]:
    """What a stacked record's code depends on: shape, and what is zero or one throughout."""
    return tuple(
        leaf
        if isinstance(leaf, bool | int)
        else (leaf.shape[:-1], *map(_plain, leaf.reshape(-1, leaf.shape[-1])))
        for leaf in _leaves(record)
    )


Written: TypeAlias = tuple[Mapping[str, str], LaneRows]
"""Sources by the names of their functions, and the rows that these work on."""


def remembered(write: Callable[..., Written]) -> Callable[..., Written]:
    """Write code once per :func:`signature`."""
    known: dict[tuple[Any, ...], Written] = {}

    @wraps(write)
    def code(record: Any, *options: Any) -> Written:
        key = signature(record) + options
        if key not in known:
            known[key] = write(record, *options)
        sources, rows = known[key]
        return sources, rows.holding(record)

    return code


def stacked(records: list[Any]) -> Any:
    """One record of many, experiments as last axis.

    Whole numbers and truths on which all agree stay what they are, and may choose branches.
    """

    def stack(*leaves: Any) -> Any:
        if isinstance(leaves[0], bool | int) and len({*leaves}) == 1:
            return leaves[0]
        return np.ascontiguousarray(np.moveaxis(np.array(leaves, dtype=np.float64), 0, -1))

    return mapped(stack, *records)


def part_of(record: Any, chosen: slice) -> Any:
    """Some experiments of a stacked record."""
    return mapped(lambda leaf: leaf[..., chosen] if isinstance(leaf, np.ndarray) else leaf, record)


def bundled(values: NDArray[Any]) -> NDArray[Any]:
    """Columns (rows, M) as bundles (B, rows, LANES); lanes to spare repeat the last column."""
    filled = np.hstack([values, np.repeat(values[:, -1:], -values.shape[1] % LANES, axis=1)])
    return aligned(filled.reshape(len(values), -1, LANES).swapaxes(0, 1))


def aligned(values: NDArray[Any]) -> NDArray[Any]:
    """Copy to where machine code may load a row at once."""
    size = values.size * values.itemsize
    room = np.empty(size + ALIGNED, dtype=np.uint8)
    first = -room.ctypes.data % ALIGNED
    copy = room[first : first + size].view(values.dtype).reshape(values.shape)
    copy[...] = values
    return copy


def columns(bundles: NDArray[Any]) -> NDArray[Any]:
    """Bundles (B, rows, LANES) as columns (rows, B LANES)."""
    return bundles.swapaxes(0, 1).reshape(bundles.shape[1], -1)


def lane_code(name: str, tape: LaneTape, results: Mapping[int, Any], rows: LaneRows) -> str:
    """Source of ``<name>(rows, k, t)``, and of ``prepare`` for what depends on parameters alone.

    The latter has to run first. Results are by row.
    """
    read, prepared = prepared_rows(name, tape, results, rows)
    body = {row: as_operand(value) for row, value in results.items()}
    return "\n".join(
        (
            machine.vector_code(name, read, body),
            machine.vector_code("prepare", tape.lines, prepared),
        )
    )


def prepared_rows(
    name: str, tape: LaneTape, results: Mapping[int, Any], rows: LaneRows
) -> tuple[dict[str, Line], dict[int, str]]:
    """Lines that read what depends on parameters alone from new rows, and its names by row."""
    kept = {value: rows.take(f"{name}:{value}", 1)[0] for value in _fixed(tape, results.values())}
    read: dict[str, Line] = {value: ("row", (float(row),)) for value, row in kept.items()}
    return tape.lines | read, {row: value for value, row in kept.items()}


def _fixed(tape: LaneTape, results: Iterable[Any]) -> list[str]:
    """Names that results need and that depend on parameters alone."""
    wanted = {value.name for value in results if isinstance(value, Symbol)}
    fixed: list[str] = []
    for name in reversed(tape.lines):
        operation, operands = tape.lines[name]
        if name not in wanted:
            continue
        if name in tape.parameters and operation != "row":
            fixed.append(name)
        else:
            wanted.update(operand for operand in operands if isinstance(operand, str))
    return fixed[::-1]
