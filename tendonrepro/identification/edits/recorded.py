"""A control law as the operations that it makes, each with its equation, and the law with some changed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array, Numeric, choose
from tendonrepro.physics import control
from tendonrepro.physics.control import Law, Memory, Surface, start_memory
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

GAINS = ("M_bar", "lam", "eta", "b", "Delta", "beta", "K_d", "K_p", "L", "angle_scale", "power_floor")
"""Fields of `Law` that are inputs of a tape; the estimator's weights come from `ALPHA`."""
ALPHA = "law.alpha"
"""The weight of the older estimate, ``weights[1]``, from which Eq. (15) has the other one."""

ANSWER = ("tau", "H_hat", "s", "de")
"""What a law gives, as `physics.control.command` does."""

OLD = "@"
"""In a change, the operand that it replaces."""

SURFACES = {Surface.NTSM: "Eq. (11)", Surface.TSM: "surface of Controller 3", Surface.PD: "Eq. (9)"}
FEEDBACKS = {Surface.NTSM: "Eq. (18)", Surface.TSM: "u of Controller 3", Surface.PD: "Eq. (9)"}
UNPRINTED = "no equation"
"""Where what is no equation of the paper stands: the error, and how its rate is measured."""

_INSIDE = str(Path(__file__).parents[2]), str(Path(np.__file__).parent)

Place: TypeAlias = tuple[str, int]
"""An operand, by the name of its line and its number in it."""
New: TypeAlias = float | str | Line
"""What stands in place of an operand: a number, an earlier line, or a line of its own."""
Changes: TypeAlias = Mapping[Place, New]


@dataclass(frozen=True, eq=False)
class RecordedLaw:
    """Operations of a law, in the order in which they were written.

    Attributes
    ----------
    lines
        By name; what is in no table of operations is an input, with its place in its array.
    outputs
        `ANSWER`, and ``ddq`` of Eq. (16) where the law is the paper's, by joint.
    labels
        Letters of the lines that are a quantity of the paper.
    equations
        Equation of a line, or the line of the user's file that wrote it.
    law
        From which it was recorded; its whole numbers and truths chose branches.
    """

    lines: dict[str, Line]
    outputs: Mapping[str, Sequence[str | float]]
    labels: Mapping[str, str]
    equations: Mapping[str, str]
    law: Law

    @property
    def of_paper(self) -> bool:
        """Whether it is the paper's, not a user's."""
        return "ddq" in self.outputs


class _Recorder(Tape):
    """A tape that knows which line of a user's file wrote an operation, and which equation it belongs to."""

    def __init__(self) -> None:
        super().__init__()
        self.written: dict[str, str] = {}
        self.labels: dict[str, str] = {}
        self.equations: dict[str, str] = {}

    def write(self, operation: str, *operands: Operand) -> Symbol:
        symbol = super().write(operation, *operands)
        self.written.setdefault(symbol.name, f"line {_line_outside()}")
        return symbol

    def claim(self, value: Operand, equation: str, label: str) -> None:
        """Give a line its label, and its equation to all that it needs and that have none."""
        name = as_operand(value)
        if isinstance(name, str) and self.lines[name][0] in APPLIED:
            self.labels.setdefault(name, label)
        waiting = [name]
        while waiting:
            line = waiting.pop()
            if isinstance(line, str) and self.lines[line][0] in APPLIED and line not in self.equations:
                self.equations[line] = equation
                waiting += self.lines[line][1]


def _line_outside() -> int:
    """Line of the innermost code that is neither the package's nor NumPy's."""
    frame: FrameType | None = sys._getframe(1)
    while frame and frame.f_code.co_filename.startswith(_INSIDE):
        frame = frame.f_back
    return frame.f_lineno if frame else 0


def _inputs(memory: Memory, law: Law, **angles: Array) -> dict[str, Array]:
    """What a law calculates with, by the names of a tape's inputs."""
    gains = {f"law.{name}": getattr(law, name) for name in GAINS}
    remembered = {f"memory.{name}": part for name, part in memory._asdict().items()}
    return {**gains, ALPHA: law.weights[1], **remembered, **angles}


def _symbols(tape: Tape, name: str, like: Array) -> Array:
    """Symbols of an input."""
    cells = np.empty(np.shape(like), dtype=object)
    for index in np.ndindex(cells.shape):
        cells[index] = tape.write(name, *map(float, index))
    symbols: Array = cells[()]
    return symbols


def recorded(law: Law, command: CommandFunction | None = None) -> RecordedLaw:
    """Record a law, the paper's unless a `command` is given; its whole numbers, truths, 0 and 1 stay.

    Raises
    ------
    UnknownValueError
        Where it branches on a number.
    """
    tape, still = _Recorder(), np.zeros(law.M_bar.size)
    like = _inputs(start_memory(still, still, law.lag), law, q=still, q_d=still, dq_d=still, ddq_d=still)
    given = {name: _symbols(tape, name, value) for name, value in like.items()}
    symbols = Law(**(law._asdict() | {name: given[f"law.{name}"] for name in GAINS}))
    if law.weights[1].any():
        symbols = symbols._replace(weights=np.stack([1.0 - given[ALPHA], given[ALPHA]]))
    if np.array_equal(law.rate_gain, law.eta):
        symbols = symbols._replace(rate_gain=symbols.eta)
    memory = Memory(*(given[f"memory.{name}"] for name in Memory._fields))
    q, q_d, dq_d, ddq_d = (given[name] for name in ("q", "q_d", "dq_d", "ddq_d"))
    own = command or control.command
    outputs = dict(zip(ANSWER, own(memory, q, q_d, dq_d, ddq_d, symbols), strict=True))
    if command is None:
        outputs["ddq"] = control.delayed_acceleration(memory, q, symbols)
        for part in _quantities(symbols, q_d - q, ddq_d, outputs):
            tape.claim(*part)
    by_joint = {name: [as_operand(value) for value in values] for name, values in outputs.items()}
    return RecordedLaw(tape.lines, by_joint, tape.labels, tape.written | tape.equations, law)


def _quantities(
    law: Law, error: Array, ddq_d: Array, outputs: Mapping[str, Array]
) -> Iterator[tuple[Operand, str, str]]:
    """Quantities of the paper's equations with their equation and letters, the innermost first.

    The functions of `physics.control` write each of them on the tape again, which gives the same lines.
    """
    surface = Surface(law.surface)
    # α is a symbol, or there is none.
    estimate = "Eq. (15)" if law.weights.dtype == object else "Eq. (8)"
    for i, e in enumerate(error):
        de = outputs["de"][i]
        yield e, UNPRINTED, "e"
        yield de, UNPRINTED, "ė"
        yield outputs["ddq"][i], "Eq. (16)", "q̈(t−L)"
        yield law.weights[0][i], estimate, "1 − α"
        if surface is Surface.NTSM:
            x, b = e * law.angle_scale, law.b[i]
            yield x, "Eq. (12)", "e"
            for gamma, label in zip(control.polynomial(b, law.Delta[i]), "₁₂", strict=True):
                yield gamma, "Eq. (13)", f"γ{label}"
            yield control.sig(x, b), "Eq. (12)", "sig(e)^b"
            yield control.phi(e, law, i), "Eq. (12)", "φ"
            yield control.phi_slope(e, law, i), "φ̇ of Eq. (18)", "∂φ/∂e"
        s, feedback = control.surface_and_feedback(e, de, law, i)
        yield s, SURFACES[surface], "s"
        yield ddq_d[i] + feedback, FEEDBACKS[surface], "u"
        yield outputs["H_hat"][i], estimate, "Ĥ"
        yield outputs["tau"][i], "Eq. (17)", "τ"


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
        given = _inputs(memory, law, q=q, q_d=q_d, dq_d=dq_d, ddq_d=ddq_d)
        tau, H_hat, s, de = self._played(ANSWER, given)
        return tau, H_hat, s, de

    def acceleration(self, memory: Memory, q: Array, law: Law) -> Array:
        """Eq. (16) of the paper's law, as `physics.control.delayed_acceleration`."""
        (ddq,) = self._played(("ddq",), _inputs(memory, law, q=q))
        return ddq

    def remember(
        self, memory: Memory, q: Array, q_d: Array, de: Array, H_hat: Array, tau: Array, law: Law
    ) -> Memory:
        """As `physics.control.remember`, with the accelerations of this law's Eq. (16)."""
        kept = control.remember(memory, q, q_d, de, H_hat, tau, law)
        if not self.base.of_paper:
            return kept
        newest = self.acceleration(memory, q, law)[np.newaxis]
        return kept._replace(ddq=np.concatenate((newest, memory.ddq[:-1])))

    def _played(self, names: Sequence[str], given: Mapping[str, Array]) -> list[Array]:
        """Carry out what some outputs need."""
        values: dict[str, Numeric] = {}

        def value(operand: str | float) -> Numeric:
            if not isinstance(operand, str):
                return operand
            if operand not in values:
                operation, operands = self.lines[operand]
                if operation in APPLIED:
                    values[operand] = APPLIED[operation](*map(value, operands))
                else:
                    place = tuple(int(index) for index in operands)
                    values[operand] = given[operation][place] if place else given[operation]
            return values[operand]

        played = []
        for name in names:
            part = np.empty_like(given["q"])
            for i, output in enumerate(self.base.outputs[name]):
                part[i] = value(output)
            played.append(part)
        return played
