"""Straight-line code from pure functions: run on symbols, they write down every operation.

Products with zero vanish, and with them every feature that is switched off.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Numeric, Unknown

FUNCTIONS: Mapping[np.ufunc, str] = {
    np.sin: "sin",
    np.cos: "cos",
    np.tanh: "tanh",
    np.exp: "exp",
    np.sqrt: "sqrt",
    np.absolute: "abs",
    np.floor: "floor",
    np.exp2: "exp2",
    np.negative: "negative",
}
OPERATORS: Mapping[np.ufunc, str] = {
    np.add: "+",
    np.subtract: "-",
    np.multiply: "*",
    np.divide: "/",
    np.power: "**",
    np.greater_equal: ">=",
    np.greater: ">",
    np.less_equal: "<=",
    np.less: "<",
}
COMPARISONS = (">=", ">", "<=", "<")

Line: TypeAlias = tuple[str, tuple[str | float, ...]]
"""An operation and its operands: numbers, and names of earlier lines."""

Term: TypeAlias = float | Unknown
"""A number or a symbol, not an array of them."""

Operand: TypeAlias = Numeric | str
"""A number, a symbol, or a symbol's name."""


class Tape:
    """Operations in order; one asked for twice is written once."""

    def __init__(self) -> None:
        self.lines: dict[str, Line] = {}
        self._known: dict[Line, Symbol] = {}

    def write(self, operation: str, *operands: Operand) -> Symbol:
        """Symbol of an operation, new or known."""
        line = operation, tuple(as_operand(operand) for operand in operands)
        if line not in self._known:
            name = f"x{len(self.lines)}"
            self.lines[name] = line
            self._known[line] = Symbol(self, name)
        return self._known[line]

    def function(self, ufunc: np.ufunc, x: Symbol) -> Numeric | tuple[Symbol, ...]:
        """Elementary function of a symbol; some give two numbers."""
        return self.write(FUNCTIONS[ufunc], x)

    def binary(self, operator: str, left: Term, right: Term) -> Numeric:
        """Arithmetic or comparison; a comparison is 1 or 0."""
        if short := _simplified(operator, left, right):
            return short[0]
        return self.write(operator, left, right)


def needed(lines: Mapping[str, Line], results: Iterable[Operand], given: Set[str] = frozenset()) -> list[str]:
    """Names that results depend on, their own included, but not what is behind those that are given."""
    wanted = {as_operand(result) for result in results}
    for name in reversed(list(lines)):
        if name in wanted and name not in given:
            wanted.update(lines[name][1])
    return [name for name in lines if name in wanted]


class UnknownValueError(TypeError):
    """Code was to branch on a number that differs between the experiments that share it."""


class Symbol(Unknown):
    """A number not known yet; what is done with it goes on its tape."""

    def __init__(self, tape: Tape, name: str) -> None:
        self.tape = tape
        self.name = name

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        """NumPy functions, also beside a NumPy number."""
        # ``x += y`` names x as output; it becomes a new symbol.
        if method != "__call__" or kwargs.get("out", (self,))[0] is not self:
            return NotImplemented
        # A NumPy number compares itself as an array without axes.
        inputs = tuple(operand[()] if isinstance(operand, np.ndarray) else operand for operand in inputs)
        if any(isinstance(operand, np.ndarray) for operand in inputs):
            plain = [
                operand if isinstance(operand, np.ndarray) else _as_object(operand) for operand in inputs
            ]
            return ufunc(*plain)
        if ufunc is np.bitwise_and:
            # Comparisons are 1 or 0.
            return inputs[0] * inputs[1]
        if ufunc in (np.maximum, np.minimum):
            left, right = inputs
            return np.where(left >= right if ufunc is np.maximum else left <= right, left, right)
        if ufunc in OPERATORS:
            return self.tape.binary(OPERATORS[ufunc], *inputs)
        return self.tape.function(ufunc, self)

    def __array_function__(self, function: object, types: object, args: Any, kwargs: object) -> Any:
        """``np.where``, ``np.clip`` and ``np.zeros_like`` of symbols; one condition may choose arrays."""
        del types
        if function is np.zeros_like:
            return 0.0
        if function is np.clip and not kwargs:
            x, lowest, highest = args
            return np.minimum(np.maximum(x, lowest), highest)
        if function is not np.where or kwargs:
            return NotImplemented
        condition, then, otherwise = args
        if not isinstance(condition, Symbol):
            return _as_object(then if condition else otherwise)
        if isinstance(then, np.ndarray) or isinstance(otherwise, np.ndarray):
            return np.frompyfunc(lambda *pair: self.tape.write("choose", condition, *pair), 2, 1)(
                then, otherwise
            )
        return self.tape.write("choose", condition, then, otherwise)

    def __getitem__(self, key: tuple[()]) -> Symbol:
        """The only key of a scalar is the empty one."""
        return self

    def __eq__(self, other: object) -> bool:
        """Whether it is the same line: an operation asked for twice is written once."""
        return self is other

    __hash__ = object.__hash__

    def __bool__(self) -> bool:
        """Refuse: code takes one branch for all numbers."""
        message = "a number that is not known yet is neither true nor false"
        raise UnknownValueError(message)


def as_operand(value: Operand) -> str | float:
    """Name of a symbol, or a number."""
    if isinstance(value, Unknown):
        return value.name
    return value if isinstance(value, str) else float(value)


def _as_object(operand: object) -> NDArray[np.object_]:
    cell = np.empty((), dtype=object)
    cell[()] = operand
    return cell


def _simplified(operator: str, left: Term, right: Term) -> tuple[Term] | None:
    """Result that needs no operation, as a 1-tuple."""
    if operator == "*" and (is_number(left, 0.0) or is_number(right, 0.0)):
        return (0.0,)
    if operator == "/" and is_number(left, 0.0):
        return (0.0,)
    if operator == "-" and left is right:
        return (0.0,)
    if (operator in "+-" and is_number(right, 0.0)) or (operator in "*/" and is_number(right, 1.0)):
        return (left,)
    if (operator == "+" and is_number(left, 0.0)) or (operator == "*" and is_number(left, 1.0)):
        return (right,)
    return None


def is_number(operand: Term, number: float) -> bool:
    """Whether an operand is known to be the number."""
    return not isinstance(operand, Symbol) and operand == number
