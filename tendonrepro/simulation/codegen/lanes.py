"""Code for many experiments at once: one flat array, and experiments as its innermost axis.

A row is ``LANES`` neighbouring numbers, one of each experiment of a bundle. The pure functions of the plant
and of the loop are run on symbols (`symbols`) that stand for rows; what they write down
becomes the body of one loop over the lanes, which a compiler turns into vector instructions. To that end no
library is called in it, and what depends on parameters alone is worked out once in a loop of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.simulation.codegen import elementary
from tendonrepro.simulation.codegen.symbols import Symbol, Tape

LANES = 8
"""Experiments in a bundle: one vector of the widest registers there are."""

EXPANDED = {
    np.sin: elementary.sin,
    np.cos: elementary.cos,
    np.tanh: elementary.tanh,
    np.exp: elementary.exp,
}
"""Functions replaced by arithmetic."""


class LaneTape(Tape):
    """Tape for code on lanes.

    A quotient becomes a product with the divisor's reciprocal, so that divisions by one number share it.
    """

    def __init__(self) -> None:
        super().__init__()
        self.parameters: set[str] = set()

    def write(self, expression: str, operands: tuple[str, ...]) -> Symbol:
        """Symbol of an expression; one of parameters alone is a parameter itself."""
        symbol = super().write(expression, operands)
        if operands and self.parameters.issuperset(operands):
            self.parameters.add(symbol.name)
        return symbol

    def function(self, ufunc: Any, x: Symbol) -> Any:
        """Elementary function of a symbol, from arithmetic where a library would be called."""
        if ufunc in EXPANDED:
            return EXPANDED[ufunc](x)
        if ufunc is np.frexp:
            return self.write(f"mantissa({x.name})", (x.name,)), self.write(f"exponent({x.name})", (x.name,))
        if ufunc is np.exp2:
            return self.write(f"power_of_two({x.name})", (x.name,))
        return super().function(ufunc, x)

    def binary(self, operator: str, left: Any, right: Any) -> Any:
        """Operation on two numbers of which at least one is a symbol."""
        if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
            return NotImplemented
        if operator == "**":
            return elementary.power(left, right)
        if operator == "/" and isinstance(right, Symbol) and not _is_one(left):
            return left * super().binary("/", 1.0, right)
        return super().binary(operator, left, right)

    def row(self, index: int, *, parameter: bool = False) -> Symbol:
        """Symbol of a row."""
        symbol = self.write(_place(index), ())
        if parameter:
            self.parameters.add(symbol.name)
        return symbol


def _is_one(operand: Any) -> bool:
    return not isinstance(operand, Symbol) and operand == 1.0


@dataclass
class LaneRows:
    """Rows of the flat array, handed out one after the other.

    ``named`` holds the first row of what was asked for by name, ``constants`` the values (N,) of the rows
    that hold parameters, one of each experiment.
    """

    count: int = 0
    named: dict[str, int] = field(default_factory=dict)
    constants: dict[int, Array] = field(default_factory=dict)

    def take(self, name: str, size: int) -> list[int]:
        """Rows of the given name."""
        self.named[name] = self.count
        self.count += size
        return list(range(self.named[name], self.count))

    def variables(self, tape: LaneTape, name: str, size: int) -> Array:
        """Symbols of rows that change, (size,); the same rows when asked for again."""
        rows = self.known(name, size)
        cells = np.empty(size, dtype=object)
        cells[:] = [tape.row(row) for row in rows]
        return cells

    def known(self, name: str, size: int) -> list[int]:
        """Rows of the given name, taken when first asked for."""
        if name not in self.named:
            return self.take(name, size)
        return list(range(self.named[name], self.named[name] + size))

    def parameters(self, tape: LaneTape, name: str, record: Any) -> Any:
        """Replace the numbers of a stacked record, lanes last, by symbols.

        Numbers that are exactly zero, or exactly one, in every experiment stay numbers, and so do whole
        numbers and booleans, which choose between branches and are the same for all. A named tuple may hold
        others.
        """
        if isinstance(record, tuple):
            parts = [
                self.parameters(tape, f"{name}.{key}", part)
                for key, part in zip(_keys(record), record, strict=True)
            ]
            return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)
        if isinstance(record, bool | int):
            return record
        return self._leaf(tape, name, np.asarray(record))

    def _leaf(self, tape: LaneTape, name: str, leaf: Array) -> Any:
        cells = np.empty(leaf.shape[:-1], dtype=object)
        for index in np.ndindex(cells.shape):
            values = leaf[index]
            if (plain := _plain(values)) is not None:
                cells[index] = plain
                continue
            (row,) = self.known(f"{name}{list(index)}", 1)
            self.constants[row] = values
            cells[index] = tape.row(row, parameter=True)
        return cells if cells.shape else cells[()]

    def holding(self, record: Any) -> LaneRows:
        """Return the same rows for another record of the same :func:`signature`."""
        return replace(self, constants=dict(zip(self.constants, _varying(record), strict=True)))


def _plain(values: Array) -> float | None:
    """Zero or one where all values are, else None."""
    first = float(values[0])
    return first if first in (0.0, 1.0) and (values == first).all() else None


def _leaves(record: Any) -> Iterator[Any]:
    """Leaves of nested tuples in the order in which they become rows."""
    if isinstance(record, tuple):
        for part in record:
            yield from _leaves(part)
    else:
        yield record


def _varying(record: Any) -> Iterator[Array]:
    """Numbers of a stacked record that become rows, each (N,)."""
    for leaf in _leaves(record):
        if not isinstance(leaf, bool | int):
            yield from (values for values in leaf.reshape(-1, leaf.shape[-1]) if _plain(values) is None)


def signature(record: Any) -> tuple[Any, ...]:
    """What the code made from a stacked record depends on: its shape, and what is zero or one throughout."""
    return tuple(
        leaf
        if isinstance(leaf, bool | int)
        else (leaf.shape[:-1], *map(_plain, leaf.reshape(-1, leaf.shape[-1])))
        for leaf in _leaves(record)
    )


Writer: TypeAlias = Callable[[Any], tuple[str, LaneRows]]


def remembered(write: Writer) -> Writer:
    """Write code once for all records of one :func:`signature`."""
    known: dict[tuple[Any, ...], tuple[str, LaneRows]] = {}

    @wraps(write)
    def code(record: Any) -> tuple[str, LaneRows]:
        key = signature(record)
        if key not in known:
            known[key] = write(record)
        source, rows = known[key]
        return source, rows.holding(record)

    return code


def _keys(record: tuple[Any, ...]) -> Iterable[str]:
    return getattr(record, "_fields", None) or map(str, range(len(record)))


def stacked(records: list[Any]) -> Any:
    """Records of one structure as one, experiments as its leaves' last axis; whole numbers must agree."""
    first = records[0]
    if isinstance(first, tuple):
        parts = [stacked([record[k] for record in records]) for k in range(len(first))]
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    if isinstance(first, bool | int):
        return first
    return np.stack([np.asarray(record, dtype=np.float64) for record in records], axis=-1)


def lane_code(name: str, arguments: str, tape: LaneTape, results: Mapping[int, Any], rows: LaneRows) -> str:
    """Source of ``<name>(w, ...)``, a loop over the lanes, and of ``prepare_<name>(w)``, to be run first.

    Results say what each row becomes; rows gain one for each value that depends on parameters alone.
    """
    ends = {row: _text(value) for row, value in results.items()}
    body, fixed = _split(tape, list(ends.values()))
    kept = {value: rows.take(f"{name}:{value}", 1)[0] for value in fixed}
    lines = [f"{x} = {_place(kept[x]) if x in kept else tape.lines[x][0]}" for x in body]
    stores = [f"{_place(row)} = {end}" for row, end in ends.items()]
    prepared = [*tape.needed(fixed), *(f"{_place(row)} = {value}" for value, row in kept.items())]
    return _loop(name, f"w, {arguments}", [*lines, *stores]) + _loop(f"prepare_{name}", "w", prepared)


def _text(value: Any) -> str:
    return value.name if isinstance(value, Symbol) else repr(float(value))


def _place(row: int) -> str:
    return f"w[{row * LANES} + l]"


def _split(tape: LaneTape, results: list[str]) -> tuple[list[str], list[str]]:
    """Names the results need, in order, and those among them that parameters alone determine."""
    wanted = set(results)
    fixed: list[str] = []
    for name in reversed(tape.lines):
        if name not in wanted:
            continue
        operands = tape.lines[name][1]
        if operands and name in tape.parameters:
            fixed.append(name)
        else:
            wanted.update(operands)
    order = [name for name in tape.lines if name in wanted]
    return order, fixed[::-1]


def _loop(name: str, arguments: str, lines: list[str]) -> str:
    body = "".join(f"        {line}\n" for line in lines or ["pass"])
    return f"def {name}({arguments}):\n    for l in range({LANES}):\n{body}\n\n"
