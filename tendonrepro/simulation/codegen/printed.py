"""Recorded operations as source of JavaScript, for a browser.

A function reads numbers from arrays, whose places are lines ``input`` of a tape, and writes its results to
others. A page is sent, so a long number stands once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Numeric
from tendonrepro.simulation.codegen.symbols import (
    COMPARISONS,
    Line,
    Operand,
    Symbol,
    Tape,
    as_operand,
    needed,
)

Place: TypeAlias = tuple[str, int]
"""An array's name and an index."""

LONG_NUMBER = 5
"""Characters of a number from which it gets a name where it stands more than twice."""

LONGEST = 300
"""Characters of an expression after which its value gets a name."""

RANKS = {"+": 1, "-": 1, "*": 2, "/": 2}
"""How tightly an operator binds; those of one rank are carried out from left to right."""

ALPHABET = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"


class PlacesTape(Tape):
    """Tape whose symbols begin as places of arrays."""

    def function(self, ufunc: np.ufunc, x: Symbol) -> Numeric | tuple[Symbol, ...]:
        """As of any tape; ``tanh`` by ``exp``, within 3e-16: in browsers that takes a third of the time."""
        if ufunc is np.tanh:
            grown: Numeric = np.exp(2.0 * x)
            return 1.0 - 2.0 / (grown + 1.0)
        return super().function(ufunc, x)

    def places(self, array: str, count: int, first: int = 0) -> list[Symbol]:
        """Symbols of places that follow each other."""
        return [self.write("input", array, float(first + k)) for k in range(count)]


def function_source(
    name: str,
    lines: Mapping[str, Line],
    results: Mapping[Place, Operand],
    arrays: Sequence[str],
) -> str:
    """Source of a function that computes results from places of arrays.

    Parameters
    ----------
    results
        Values by the place they are written to. All is read before anything is written.
    arrays
        The function's parameters, in order; names of two letters or more.
    """
    values = {place: as_operand(value) for place, value in results.items()}
    order = needed(lines, values.values())
    uses = Counter(part for x in order for part in lines[x][1] if isinstance(part, str))
    uses.update(value for value in values.values() if isinstance(value, str))
    printer = _Printer(lines)
    used = [part for x in order if lines[x][0] != "input" for part in lines[x][1]]
    printer.name_numbers([*used, *values.values()])
    for x in order:
        operation, operands = lines[x]
        overwritten = operation == "input" and (operands[0], operands[1]) in values
        printer.add(x, shared=uses[x] > 1 or overwritten)
    constants = ",".join(printer.definitions)
    return "\n".join(
        (
            f"function {name}({','.join(arrays)}){{",
            *([f"const {constants};"] if constants else []),
            *(f"{array}[{place}]={_bare(printer.value(value))};" for (array, place), value in values.items()),
            "}",
        )
    )


class _Printer:
    """Expressions of lines; what is used once stands where it is used."""

    def __init__(self, lines: Mapping[str, Line]) -> None:
        self._lines = lines
        self._names: dict[str, str] = {}
        self._texts: dict[str, str] = {}
        self._numbers: dict[str, str] = {}
        self.definitions: list[str] = []

    def name_numbers(self, operands: Iterable[str | float]) -> None:
        """Give names to long numbers that are used often."""
        texts = Counter(self._plain(abs(x)) for x in operands if not isinstance(x, str))
        for text, uses in texts.items():
            if uses > 2 and len(text) >= LONG_NUMBER:
                self._numbers[text] = self._define(text)

    def _define(self, text: str) -> str:
        """A new name for an expression."""
        name = _short_name(len(self.definitions))
        self.definitions.append(f"{name}={_bare(text)}")
        return name

    def add(self, x: str, *, shared: bool) -> None:
        """Print a line whose operands were added before; its value gets a name if shared, or if long."""
        text = self._expression(*self._lines[x])
        self._texts[x] = text
        if shared or len(text) > LONGEST:
            self._names[x] = self._define(text)

    def value(self, operand: str | float) -> str:
        """Text of an operand."""
        if isinstance(operand, str):
            return self._names.get(operand) or self._texts[operand]
        return self._number(operand)

    def _number(self, number: float) -> str:
        text = self._plain(abs(number))
        text = self._numbers.get(text, text)
        return f"(-{text})" if number < 0.0 else text

    def _plain(self, size: float) -> str:
        """Digits of a number that is not negative."""
        if size == float("inf"):
            return "Infinity"
        return repr(size).removesuffix(".0")

    def _expression(self, operation: str, operands: tuple[str | float, ...]) -> str:
        if operation == "input":
            array, place = operands
            return f"{array}[{int(place)}]"
        if operation == "choose":
            condition, then, otherwise = operands
            return f"({self._condition(condition)}?{self._part(then, 1)}:{self._part(otherwise, 1)})"
        if operation in COMPARISONS:
            return f"(+{self._compared(operation, operands)})"
        if operation in RANKS:
            first, second = operands
            rank = RANKS[operation]
            return f"({self._part(first, rank)}{operation}{self._part(second, rank + 1)})"
        if operation == "negative":
            return f"(-{self.value(*operands)})"
        words = [self._part(operand, 1) for operand in operands]
        if operation == "exp2":
            operation, words = "**", [self._number(2.0), *words]
        return f"Math.{'pow' if operation == '**' else operation}({','.join(words)})"

    def _part(self, operand: str | float, rank: int) -> str:
        """Text of an operand, without parentheses where it binds as tightly as a rank: pages are sent."""
        text = self.value(operand)
        if isinstance(operand, str) and operand not in self._names:
            operation, _ = self._lines[operand]
            if RANKS.get(operation, 0) >= rank:
                return text[1:-1]
        return text

    def _compared(self, operation: str, operands: tuple[str | float, ...]) -> str:
        left, right = (self._part(operand, 1) for operand in operands)
        return f"({left}{operation}{right})"

    def _condition(self, operand: str | float) -> str:
        """A number that is true unless it is zero; a comparison used here alone stays one."""
        if isinstance(operand, str) and operand not in self._names:
            operation, operands = self._lines[operand]
            if operation in COMPARISONS:
                return self._compared(operation, operands)
        return f"{self.value(operand)}!=0"


def _bare(text: str) -> str:
    """An expression without the parentheses around all of it."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if text[0] == "(" and k == len(text) - 1 else text
    return text


def _short_name(number: int) -> str:
    """A letter, or a letter and a number, which no language keeps for itself."""
    turn, letter = divmod(number, len(ALPHABET))
    return f"{ALPHABET[letter]}{turn or ''}"


def split_by_input(
    lines: Mapping[str, Line], results: Iterable[Operand], arrays: Collection[str], kept: str
) -> tuple[dict[Place, str], dict[str, Line]]:
    """Part what depends on some arrays alone from the rest, so that it is computed once.

    Returns
    -------
    once : dict
        Lines whose values the rest needs, by their places in a new array `kept`.
    lines : dict
        The tape that reads them there.
    """
    fixed: set[str] = set()
    for name, (operation, operands) in lines.items():
        inner = [part for part in operands if isinstance(part, str)]
        if operands[0] in arrays if operation == "input" else fixed.issuperset(inner):
            fixed.add(name)
    edge = [name for name in needed(lines, results, fixed) if name in fixed]
    once = {(kept, place): name for place, name in enumerate(edge)}
    read: dict[str, Line] = {name: ("input", place) for place, name in once.items()}
    return once, {**lines, **read}
