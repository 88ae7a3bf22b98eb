"""A control law as the operations that it makes, and the law again with some of them changed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array, Numeric, choose
from tendonrepro.physics import control
from tendonrepro.physics.control import Law, Memory, start_memory
from tendonrepro.simulation.codegen.symbols import (
    FUNCTIONS,
    OPERATORS,
    Line,
    Operand,
    Symbol,
    Tape,
    as_operand,
)
from tendonrepro.simulation.loop import CommandFunction

APPLIED: Mapping[str, Callable[..., Numeric]] = {
    **{name: ufunc for ufunc, name in (*FUNCTIONS.items(), *OPERATORS.items())},
    "choose": choose,
}
"""What carries out an operation of a tape, on numbers, arrays and symbols alike; all others are inputs."""

GAINS = ("M_bar", "lam", "eta", "b", "Delta", "beta", "K_d", "K_p")
"""Fields of `Law` that are inputs of a tape, joint by joint; the estimator's weights come from `ALPHA`."""
SCALARS = ("L", "angle_scale", "power_floor")
"""Fields of `Law` that are inputs, one for all joints."""
ALPHA = "law.alpha"
"""The weight of the older estimate, ``weights[1]``, from which Eq. (15) has the other one."""

ANSWER = ("tau", "H_hat", "s", "de")
"""What a law gives, as `physics.control.command` does."""

OLD = "@"
"""In a change, the operand that it replaces."""

_INSIDE = str(Path(__file__).parents[2]), str(Path(np.__file__).parent)

Place: TypeAlias = tuple[str, int]
"""An operand, by the name of its line and its number in it."""
New: TypeAlias = float | str | Line
"""What stands in place of an operand: a number, an earlier line, or a line of its own."""
Changes: TypeAlias = Mapping[Place, New]
Given: TypeAlias = Mapping[str, Any]
"""What a law is called with, by name."""


@dataclass(frozen=True, eq=False)
class RecordedLaw:
    """Operations of a law, in the order in which they were written.

    Attributes
    ----------
    lines
        By name; what is in no table of operations is an input, with its place in its array.
    outputs
        `ANSWER`, and ``ddq`` of Eq. (16) where the law is the paper's, by joint.
    symbols
        The law whose gains are inputs, and ``q``, ``q_d`` and ``ddq_d`` (n,) beside them.
    written
        Line of the user's file that wrote an operation.
    law
        From which it was recorded; its whole numbers and truths chose branches.
    """

    lines: dict[str, Line]
    outputs: Mapping[str, Sequence[str | float]]
    symbols: tuple[Law, Array, Array, Array]
    written: Mapping[str, int]
    law: Law
    command: CommandFunction


class _Recorder(Tape):
    """A tape that knows which line of a user's file wrote an operation."""

    def __init__(self) -> None:
        super().__init__()
        self.written: dict[str, int] = {}

    def write(self, operation: str, *operands: Operand) -> Symbol:
        symbol = super().write(operation, *operands)
        if symbol.name not in self.written:
            self.written[symbol.name] = _line_outside()
        return symbol


def _line_outside() -> int:
    """Line of the innermost code that is neither the package's nor NumPy's."""
    frame: FrameType | None = sys._getframe(1)
    while frame and frame.f_code.co_filename.startswith(_INSIDE):
        frame = frame.f_back
    return frame.f_lineno if frame else 0


def input_of(tape: Tape, name: str, *shape: int) -> Array:
    """Symbols of an input array."""
    cells = np.empty(shape, dtype=object)
    for index in np.ndindex(shape):
        cells[index] = tape.write(name, *map(float, index))
    return cells


def symbolic_law(tape: Tape, law: Law) -> Law:
    """A law whose gains are symbols; whole numbers, truths, and what is 0 or 1 in it stay."""
    n = law.M_bar.size
    own: dict[str, Any] = {name: input_of(tape, f"law.{name}", n) for name in GAINS}
    own |= {name: tape.write(f"law.{name}") for name in SCALARS}
    if law.weights[1].any():
        alpha = input_of(tape, ALPHA, n)
        own["weights"] = np.stack([1.0 - alpha, alpha])
    own["rate_gain"] = own["eta"] if np.array_equal(law.rate_gain, law.eta) else law.rate_gain
    return law._replace(**own)


def recorded(law: Law, command: CommandFunction | None = None) -> RecordedLaw:
    """Record a law, the paper's unless a `command` is given.

    Raises
    ------
    UnknownValueError
        Where it branches on a number.
    """
    tape, n = _Recorder(), law.M_bar.size
    symbols = symbolic_law(tape, law)
    shapes = {
        name: part.shape for name, part in start_memory(np.zeros(n), np.zeros(n), law.lag)._asdict().items()
    }
    memory = Memory(**{name: input_of(tape, f"memory.{name}", *shape) for name, shape in shapes.items()})
    q, q_d, dq_d, ddq_d = (input_of(tape, name, n) for name in ("q", "q_d", "dq_d", "ddq_d"))
    own = command or control.command
    outputs = dict(zip(ANSWER, own(memory, q, q_d, dq_d, ddq_d, symbols), strict=True))
    if command is None:
        outputs["ddq"] = control.delayed_acceleration(memory, q, symbols)
    by_joint = {name: [as_operand(value) for value in values] for name, values in outputs.items()}
    return RecordedLaw(tape.lines, by_joint, (symbols, q, q_d, ddq_d), tape.written, law, own)


@dataclass(frozen=True, eq=False)
class EditedLaw:
    """A recorded law with some operands changed, of the signature of `physics.control.command`."""

    base: RecordedLaw
    changes: Changes = field(default_factory=dict)

    @property
    def content(self) -> str:
        """What it does, as text."""
        return f"{self.base.law.lag} {sorted(map(repr, self.changes.items()))}"

    @cached_property
    def lines(self) -> Mapping[str, Line]:
        """Its operations; a line that a change brings is named after the place where it stands."""
        lines = dict(self.base.lines)
        for (name, k), new in self.changes.items():
            operation, operands = lines[name]
            if isinstance(new, tuple):
                brought = f"{name}.{k}"
                lines[brought] = new[0], tuple(operands[k] if each == OLD else each for each in new[1])
                new = brought  # noqa: PLW2901
            lines[name] = operation, (*operands[:k], new, *operands[k + 1 :])
        return lines

    def __call__(
        self, memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, law: Law
    ) -> tuple[Array, Array, Array, Array]:
        """One sample, as `physics.control.command`."""
        given = {"memory": memory, "q": q, "q_d": q_d, "dq_d": dq_d, "ddq_d": ddq_d, "law": law}
        tau, H_hat, s, de = self.played(ANSWER, given)
        return tau, H_hat, s, de

    def played(self, names: Sequence[str], given: Given) -> list[Array]:
        """Carry out what some outputs need."""
        values: dict[str, Numeric] = {}

        def value(operand: str | float) -> Numeric:
            if not isinstance(operand, str):
                return operand
            if operand not in values:
                operation, operands = self.lines[operand]
                is_input = operation not in APPLIED
                values[operand] = (
                    _given(operation, operands, given)
                    if is_input
                    else APPLIED[operation](*map(value, operands))
                )
            return values[operand]

        played = []
        for name in names:
            part = np.empty_like(given["q"])
            for i, output in enumerate(self.base.outputs[name]):
                part[i] = value(output)
            played.append(part)
        return played

    def remember(
        self, memory: Memory, q: Array, q_d: Array, de: Array, H_hat: Array, tau: Array, law: Law
    ) -> Memory:
        """As `physics.control.remember`, with the accelerations of this law's Eq. (16)."""
        kept = control.remember(memory, q, q_d, de, H_hat, tau, law)
        if "ddq" not in self.base.outputs:
            return kept
        (ddq,) = self.played(("ddq",), {"memory": memory, "q": q, "law": law})
        return kept._replace(ddq=np.concatenate((ddq[np.newaxis], memory.ddq[:-1])))


def _given(operation: str, place: Sequence[str | float], given: Given) -> Numeric:
    """An entry of what a law is called with."""
    record, _, name = operation.partition(".")
    array = given[record]
    if operation == ALPHA:
        array = array.weights[1]
    elif name:
        array = getattr(array, name)
    entry: Numeric = array[tuple(int(index) for index in place)] if place else array
    return entry
