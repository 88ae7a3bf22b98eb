"""Code for many experiments at once, on arrays (rows, lanes).

A row is ``LANES`` neighbouring numbers, one of each experiment: of a variable, such as the angle of joint 2,
or of a parameter. A function of physics gets symbols for rows, so it writes its operations on a tape:
``k * (q - r)`` becomes ``x3 = x1 - x2``, ``x4 = x0 * x3``. The tape becomes machine code that works on whole
rows. What depends on parameters alone is worked out once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import TypeAlias, TypeVar, TypeVarTuple

import numpy as np

from tendonrepro.arrays import Array, Numeric
from tendonrepro.simulation.codegen import elementary, machine
from tendonrepro.simulation.codegen.machine import ALIGNED, LANES
from tendonrepro.simulation.codegen.symbols import Line, Operand, Symbol, Tape, Term, is_number, needed

EXPANDED = {
    np.sin: elementary.sin,
    np.cos: elementary.cos,
    np.tanh: elementary.tanh,
    np.exp: elementary.exp,
}
"""Functions replaced by arithmetic."""

Record: TypeAlias = "tuple[Numeric | Record, ...]"
"""A named tuple of numbers and of other records, such as a plant; or a tuple of records.

Its fields say what they are for one experiment. Stacked, a number is an array, and traced, a symbol.
"""

Kind = TypeVar("Kind", bound=Record)
Options = TypeVarTuple("Options")


@dataclass
class LaneRows:
    """Rows as handed out: the first of each name, and the values (N,) of parameters' rows."""

    count: int = 0
    named: dict[str, int] = field(default_factory=dict)
    constants: dict[int, Array] = field(default_factory=dict)

    def known(self, name: str, size: int) -> range:
        """Rows of a name, new when first asked for."""
        if name not in self.named:
            self.named[name] = self.count
            self.count += size
        return range(self.named[name], self.named[name] + size)

    def holding(self, record: Record) -> LaneRows:
        """The same rows for another record of one :func:`signature`."""
        return replace(self, constants=dict(zip(self.constants, _varying(record), strict=True)))


class LaneTape(Tape):
    """Tape of one function on lanes: what it reads from rows, and what it leaves in them.

    Divisions by one number share its reciprocal.
    """

    def __init__(self, rows: LaneRows) -> None:
        super().__init__()
        self.rows = rows
        self.parameters: set[str] = set()
        self.results: dict[int, Numeric] = {}

    def write(self, operation: str, *operands: Operand) -> Symbol:
        """As of any tape; an operation on parameters alone is a parameter."""
        symbol = super().write(operation, *operands)
        names = {operand.name for operand in operands if isinstance(operand, Symbol)}
        if names and self.parameters.issuperset(names):
            self.parameters.add(symbol.name)
        return symbol

    def function(self, ufunc: np.ufunc, x: Symbol) -> Numeric | tuple[Symbol, ...]:
        """As of any tape, from arithmetic."""
        if ufunc in EXPANDED:
            return EXPANDED[ufunc](x)
        if ufunc is np.frexp:
            return self.write("mantissa", x), self.write("exponent", x)
        return super().function(ufunc, x)

    def binary(self, operator: str, left: Term, right: Term) -> Numeric:
        """As of any tape; minus one has whole exponents."""
        if operator == "**" and is_number(left, -1.0):
            return self.write("alternating", right)
        if operator == "**":
            return elementary.power(left, right)
        if operator == "/" and isinstance(right, Symbol) and not is_number(left, 1.0):
            return left * super().binary("/", 1.0, right)
        return super().binary(operator, left, right)

    def read(self, name: str, size: int) -> Array:
        """Rows of a name, (size,), as they are now."""
        values = np.empty(size, dtype=object)
        for k, row in enumerate(self.rows.known(name, size)):
            values[k] = self.results.get(row, self.write("row", float(row)))
        return values

    def number(self, name: str) -> Numeric:
        """The only row of a name."""
        value: Numeric = self.read(name, 1)[0]
        return value

    def leave(self, name: str, values: Array | Sequence[Numeric]) -> None:
        """New values of the rows of a name."""
        self.results.update(zip(self.rows.known(name, len(values)), values, strict=True))

    def symbols(self, record: Kind) -> Kind:
        """Replace numbers of a stacked record by symbols of parameters.

        Zero or one in every experiment stays a number. So do integers and booleans, which choose branches.
        """

        def of_leaf(leaf: Numeric) -> Numeric:
            if not isinstance(leaf, np.ndarray):
                return leaf
            cells = np.empty(leaf.shape[:-1], dtype=object)
            for index in np.ndindex(cells.shape):
                cells[index] = _plain(leaf[index])
                if cells[index] is None:
                    (row,) = self.rows.known(f"parameter {self.rows.count}", 1)
                    self.rows.constants[row] = leaf[index]
                    cells[index] = symbol = self.write("row", float(row))
                    self.parameters.add(symbol.name)
            return cells if cells.shape else cells[()]

        return mapped(of_leaf, record)

    def source(self, name: str) -> str:
        """Source of ``<name>(rows, k, t)``, and of ``prepare`` for what depends on parameters alone.

        The latter has to run first.
        """
        fixed = {x for x in self.parameters if self.lines[x][0] != "row"}
        kept = [x for x in needed(self.lines, self.results.values(), fixed) if x in fixed]
        places = {self.rows.known(f"{name}:{x}", 1)[0]: x for x in kept}
        read: dict[str, Line] = {x: ("row", (float(row),)) for row, x in places.items()}
        run = machine.vector_code(name, self.lines | read, self.results)
        return "\n".join((run, machine.vector_code("prepare", self.lines, places)))


def _plain(values: Array) -> float | None:
    """Zero or one where all values are, else None."""
    first = float(values[0])
    return first if first in (0.0, 1.0) and (values == first).all() else None


def mapped(function: Callable[..., Numeric], *records: Kind) -> Kind:
    """Apply a function to the leaves of nested tuples of one structure."""
    kind: Callable[..., Kind] = type(records[0])
    parts = [
        mapped(function, *entries) if isinstance(entries[0], tuple) else function(*entries)
        for entries in zip(*records, strict=True)
    ]
    return kind(*parts) if hasattr(kind, "_fields") else kind(parts)


def leaves(record: Record) -> Iterator[Numeric]:
    """Leaves of a record, in order."""
    for entry in record:
        if isinstance(entry, tuple):
            yield from leaves(entry)
        else:
            yield entry


def _varying(record: Record) -> Iterator[Array]:
    """Numbers of a stacked record that become rows, each (N,)."""
    for leaf in leaves(record):
        if isinstance(leaf, np.ndarray):
            yield from (values for values in leaf.reshape(-1, leaf.shape[-1]) if _plain(values) is None)


def signature(record: Record) -> tuple[object, ...]:
    """What a stacked record's code depends on: shape, and what is zero or one throughout."""
    return tuple(
        (leaf.shape[:-1], *map(_plain, leaf.reshape(-1, leaf.shape[-1])))
        if isinstance(leaf, np.ndarray)
        else leaf
        for leaf in leaves(record)
    )


Written: TypeAlias = tuple[Mapping[str, str], LaneRows]
"""Sources by the names of their functions, and the rows that these work on."""


def remembered(write: Callable[[Kind, *Options], Written]) -> Callable[[Kind, *Options], Written]:
    """Write code once per :func:`signature`."""
    known: dict[tuple[object, ...], Written] = {}

    @wraps(write)
    def code(record: Kind, *options: *Options) -> Written:
        key = signature(record) + options
        if key not in known:
            known[key] = write(record, *options)
        sources, rows = known[key]
        return sources, rows.holding(record)

    return code


def stacked(records: Sequence[Kind]) -> Kind:
    """One record of many, experiments as last axis.

    Whole numbers and truths on which all agree stay what they are, and may choose branches.
    """

    def stack(*leaves: Numeric) -> Numeric:
        if isinstance(leaves[0], bool | int) and len({*leaves}) == 1:
            return leaves[0]
        return np.ascontiguousarray(np.moveaxis(np.array(leaves, dtype=np.float64), 0, -1))

    return mapped(stack, *records)


def bundled(values: Array, lanes: int = LANES) -> Array:
    """Columns (rows, M) as bundles (B, rows, lanes); lanes to spare repeat the last column."""
    filled = np.hstack([values, np.repeat(values[:, -1:], -values.shape[1] % lanes, axis=1)])
    return aligned(filled.reshape(len(values), -1, lanes).swapaxes(0, 1))


def aligned(values: Array) -> Array:
    """Copy to where machine code may load a row at once."""
    size = values.size * values.itemsize
    room = np.empty(size + ALIGNED, dtype=np.uint8)
    first = -room.ctypes.data % ALIGNED
    copy = room[first : first + size].view(values.dtype).reshape(values.shape)
    copy[...] = values
    return copy


def columns(bundles: Array) -> Array:
    """Bundles (B, rows, LANES) as columns (rows, B LANES)."""
    return bundles.swapaxes(0, 1).reshape(bundles.shape[1], -1)
