"""Every small change of a recorded law, by rule, each with its equation, its place and a name."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import combinations
from typing import NamedTuple, TypeAlias

from tendonrepro.identification.edits.recorded import (
    ALPHA,
    APPLIED,
    OLD,
    Changes,
    New,
    Place,
    RecordedLaw,
)
from tendonrepro.physics import control
from tendonrepro.physics.control import DEGREES_PER_RADIAN, Surface
from tendonrepro.simulation.codegen.symbols import Operand, as_operand, needed

SURFACES = {Surface.NTSM: "Eq. (11)", Surface.TSM: "surface of Controller 3", Surface.PD: "Eq. (9)"}
FEEDBACKS = {Surface.NTSM: "Eq. (18)", Surface.TSM: "u of Controller 3", Surface.PD: "Eq. (9)"}

NAMES: Mapping[str, str] = {
    "law.M_bar": "M̄", "law.lam": "λ", "law.eta": "η", "law.b": "b", "law.Delta": "Δ", "law.beta": "β",
    "law.K_d": "K_d", "law.K_p": "K_p", "law.L": "L", "law.power_floor": "least |e|", ALPHA: "α",
    "q": "q(t)", "q_d": "q_d", "dq_d": "q̇_d", "ddq_d": "q̈_d",
    "memory.q[0]": "q(t−L)", "memory.q[1]": "q(t−2L)", "memory.q[2]": "q(t−3L)",
    "memory.tau[0]": "τ(t−L)", "memory.tau[1]": "τ(t−2L)", "memory.ddq[0]": "q̈(t−2L)",
    "memory.q_d": "q_d(t−L)", "memory.de": "ė(t−L)", "memory.H_hat": "Ĥ(t−L)",
}  # fmt: skip
"""Inputs of a tape in the letters of the paper."""

ANGLES = ("q", "q_d", "dq_d", "ddq_d", "memory.q", "memory.ddq", "memory.q_d", "memory.de")
"""Inputs that are angles, or their rates."""
UNITS = {"law.Delta": 1.0 / DEGREES_PER_RADIAN, "law.M_bar": DEGREES_PER_RADIAN}
"""Factor on a gain whose number is given in degrees, or per degree."""
NOT_PRINTED = ("law.angle_scale", "law.power_floor")
"""Inputs that are no symbol of the paper."""
UNPRINTED = "no equation"
"""Where what is no equation of the paper stands: the error, and how its rate is measured."""

EVERYWHERE = "everywhere"
"""Where an edit is that changes all uses of a symbol."""

INPUTS = frozenset(name.partition("[")[0] for name in NAMES)
"""Inputs of a tape, without their place."""
DELAYED = {"q": ("q", 0), "memory.q": ("q", 1), "memory.tau": ("τ", 1), "memory.ddq": ("q̈", 2)}
"""Inputs that Eqs. (8), (15) and (16) have of several times, and how many delay times ago the newest is."""

Key: TypeAlias = tuple[object, ...]
Changed: TypeAlias = Callable[[str | float], New]
"""What stands in place of an operand, which differs from joint to joint."""


@dataclass(frozen=True)
class Edit:
    """A change of a law.

    `equation` is its equation, or the line of a user's file, and `words` what is changed there. `places` are
    operands, and what stands in their place; none where another law was recorded, with so many sampling
    periods as delay time `lag`.
    """

    equation: str
    words: str
    changes: Changes
    lag: int = 1

    @property
    def name(self) -> str:
        """As an engineer reads it."""
        return f"{self.equation}: {self.words}"


class Anatomy:
    """What the operations of a recorded law are: their equation, their words, and which are alike.

    Lines that differ in the joint alone are alike: an edit changes them together.
    """

    def __init__(self, law: RecordedLaw) -> None:
        self.lines, self.n = law.lines, law.law.M_bar.size
        outputs = [as_operand(value) for values in law.outputs.values() for value in values]
        self.used = [name for name in needed(law.lines, outputs) if not self.is_input(name)]
        self.labels: dict[str, str] = {}
        self.equations: dict[str, str] = {}
        for name, equation, label in _parts(law):
            self._claim(name, equation, label)
        for name in self.used:
            self.equations.setdefault(name, f"line {law.written[name]}")
        self.inner = {
            operand
            for name in self.used
            if self.lines[name][0] in "+-"
            for operand in self.lines[name][1]
            if self.is_part(operand, name, "+-")
        }
        self.alike: dict[Key, list[str]] = defaultdict(list)
        for name in self.used:
            self.alike[self.key(name)].append(name)

    def is_input(self, name: str) -> bool:
        """Whether a line is an input."""
        return self.lines[name][0] not in APPLIED

    def _claim(self, name: Operand, equation: str, label: str) -> None:
        """Give a line its label, and its equation to all that it needs and that have none."""
        waiting = [as_operand(name)]
        if isinstance(waiting[0], str) and not self.is_input(waiting[0]):
            self.labels.setdefault(waiting[0], label)
        while waiting:
            line = waiting.pop()
            if isinstance(line, str) and not self.is_input(line) and line not in self.equations:
                self.equations[line] = equation
                waiting += self.lines[line][1]

    def key(self, operand: str | float) -> Key:
        """The same for operands that differ in the joint alone."""
        if not isinstance(operand, str):
            return (operand,)
        operation, operands = self.lines[operand]
        if self.is_input(operand):
            return (operation, *operands[:-1])
        return (operation, *(self.key(each) for each in operands))

    def words(self, operand: str | float, inside: str | None = None) -> str:
        """An operand in letters; what has a label is not spelled out, unless it is `inside` that."""
        if not isinstance(operand, str):
            return f"{operand:g}"
        operation, operands = self.lines[operand]
        if self.is_input(operand):
            place = "".join(f"[{index:g}]" for index in operands[:-1])
            return NAMES.get(operation + place, operation.removeprefix("law.") + place)
        if operand in self.labels and operand != inside:
            return self.labels[operand]
        return self._spelled(operation, operands)

    def _spelled(self, operation: str, operands: Sequence[str | float]) -> str:
        """An operation in letters."""
        parts = [self.words(each) for each in operands]
        if operation == "choose":
            return f"[{parts[1]} or {parts[2]}]"
        if operation == "abs":
            return f"|{parts[0]}|"
        if len(parts) == 1:
            return f"{'−' if operation == 'negative' else operation}({parts[0]})"
        bound = [self._bracketed(text, each, operation) for text, each in zip(parts, operands, strict=True)]
        sign = {"*": " ", "-": " − ", "/": "/", "**": "^"}.get(operation, f" {operation} ")
        return sign.join(bound)

    def _bracketed(self, text: str, operand: str | float, outer: str) -> str:
        loose = isinstance(operand, str) and operand not in self.labels and self.lines[operand][0] in "+-"
        long = isinstance(operand, str) and operand in self.labels and " " in text
        return f"({text})" if (loose and outer not in "+-") or long else text

    def is_part(self, operand: str | float, of: str, operations: str) -> bool:
        """Whether an operand is a sum or product inside a longer one of the same equation, no quantity."""
        return (
            isinstance(operand, str)
            and not self.is_input(operand)
            and self.lines[operand][0] in operations
            and operand not in self.labels
            and self.equations[operand] == self.equations[of]
        )

    @cached_property
    def of_gains(self) -> frozenset[str]:
        """Lines that depend on gains alone."""
        kept: set[str] = set()
        for name, (operation, operands) in self.lines.items():
            parts = [each for each in operands if isinstance(each, str)]
            is_gain = operation.startswith("law.") and operation not in NOT_PRINTED
            if is_gain or (not self.is_input(name) and parts and kept.issuperset(parts)):
                kept.add(name)
        return frozenset(kept)


def _parts(law: RecordedLaw) -> Iterator[tuple[Operand, str, str]]:
    """Quantities of the paper's equations with their equation and letters, the innermost first.

    The functions of `physics.control` write each of them on the tape again, which gives the same lines.
    """
    if law.command is not control.command:
        return
    symbols, q, q_d, ddq_d = law.symbols
    surface = Surface(law.law.surface)
    estimate = "Eq. (15)" if law.law.weights[1].any() else "Eq. (8)"
    for i in range(q.size):
        e, de = q_d[i] - q[i], law.outputs["de"][i]
        yield e, UNPRINTED, "e"
        yield de, UNPRINTED, "ė"
        yield law.outputs["ddq"][i], "Eq. (16)", "q̈(t−L)"
        yield symbols.weights[0][i], estimate, "1 − α"
        if surface is Surface.NTSM:
            x, b = e * symbols.angle_scale, symbols.b[i]
            yield x, "Eq. (12)", "e"
            for gamma, label in zip(control.polynomial(b, symbols.Delta[i]), "₁₂", strict=True):
                yield gamma, "Eq. (13)", f"γ{label}"
            yield control.sig(x, b), "Eq. (12)", "sig(e)^b"
            yield control.phi(e, symbols, i), "Eq. (12)", "φ"
            yield control.phi_slope(e, symbols, i), "φ̇ of Eq. (18)", "∂φ/∂e"
        s, feedback = control.surface_and_feedback(e, de, symbols, i)
        yield s, SURFACES[surface], "s"
        yield ddq_d[i] + feedback, FEEDBACKS[surface], "u"
        yield law.outputs["H_hat"][i], estimate, "Ĥ"
        yield law.outputs["tau"][i], "Eq. (17)", "τ"


def _delayed(quantity: str, back: int, lag: int, joint: float) -> New | None:
    """A quantity so many delay times ago, if the memory of a law holds it."""
    if (quantity, back) == ("q", 0):
        return "q", (joint,)
    reach = {"q": ("memory.q", 1, 3), "τ": ("memory.tau", 1, 2), "q̈": ("memory.ddq", 2, 2)}
    name, newest, oldest = reach[quantity]
    # The memory has the newest first, and a place for each sampling period.
    at = float((back - newest + 1) * lag - 1)
    return (name, (at, joint)) if newest <= back <= oldest else None


class OperandChange(NamedTuple):
    """A change of one operand in lines that are alike.

    `kind` and `operand` say which changes of other lines belong together, `line` and `words` name it.
    """

    kind: str
    operand: Key
    line: str
    words: str
    changes: dict[Place, New]


class Rules:
    """All edits of one recorded law."""

    def __init__(self, law: RecordedLaw) -> None:
        self.law, self.of = law, Anatomy(law)
        self.ddq = {str(as_operand(value)): i for i, value in enumerate(law.outputs.get("ddq", ()))}

    def edits(self) -> list[Edit]:
        """Each under a name of its own."""
        named: dict[tuple[str, str], list[OperandChange]] = defaultdict(list)
        together: dict[tuple[str, Key], list[OperandChange]] = defaultdict(list)
        for group in self.of.alike.values():
            equation = self.of.equations[group[0]]
            for use in self._uses(group) if equation != UNPRINTED else ():
                named[equation, use.words].append(use)
                together[use.kind, use.operand].append(use)
        edits = []
        for (equation, words), own in named.items():
            for use in own:
                context = f", in {self.of.words(use.line, inside=use.line)}" if len(own) > 1 else ""
                edits.append(Edit(equation, words + context, use.changes))
        for (_, operand), own in together.items():
            # An input may stand in equations of other laws, too.
            is_input = operand[0] in INPUTS
            if is_input or (len(own) > 1 and not isinstance(operand[0], float)):
                changes = {place: new for use in own for place, new in use.changes.items()}
                edits.append(Edit(EVERYWHERE, own[0].words, changes))
        # The plainer name of what also a turned sign in a condition does.
        edits.sort(key=lambda edit: not edit.words.startswith("always"))
        unique: dict[str, Edit] = {}
        for edit in (*edits, *self._angles()):
            unique.setdefault(edit.name, edit)
        return [*unique.values()]

    def _uses(self, group: Sequence[str]) -> Iterator[OperandChange]:
        line, of = group[0], self.of
        operation, operands = of.lines[line]
        inputs = {of.lines[each][0] for each in operands if isinstance(each, str)}
        if inputs.intersection(NOT_PRINTED):
            yield from self._scaled(line) if operation == "*" else ()
            return
        for k, operand in enumerate(operands):
            words = of.words(operand)

            def use(kind: str, text: str, new: New | Changed, k: int = k) -> OperandChange:
                changes: dict[Place, New] = {
                    (name, k): new(of.lines[name][1][k]) if callable(new) else new for name in group
                }
                return OperandChange(kind, of.key(of.lines[line][1][k]), line, text, changes)

            is_gain = isinstance(operand, str) and of.lines[operand][0].startswith("law.")
            is_term = operation in "+-" and not of.is_part(operand, line, "+-")
            if is_term or is_gain or operation == "negative":
                yield use("sign", f"{words} with the other sign", ("*", (OLD, -1.0)))
            if is_term:
                yield use("term", f"{words} left out", 0.0)
            is_factor = operation == "*" and not of.is_part(operand, line, "*")
            is_fixed = not isinstance(operand, str) or operand in of.of_gains
            if is_fixed and (is_factor or (operation, k) == ("/", 1)):
                yield use("factor", f"factor {words} left out", 1.0)
            if operation == "**" and k == 1:
                yield use("exponent", f"exponent {words} left out", 1.0)
            if operation == "choose" and k == 0:
                for value, branch in ((1.0, operands[1]), (0.0, operands[2])):
                    yield use(f"branch {value}", f"always {of.words(branch)}", value)
            if isinstance(operand, str) and of.lines[operand][0] == "abs":
                inner = of.words(of.lines[operand][1][0])
                yield use(f"sign in {operation}", f"{inner} for {words}", self._without_sign)
            if isinstance(operand, str):
                yield from self._of_symbol(operand, words, use)
        if operation in "+-" and line not in of.inner:
            yield from self._exchanges(group)
            yield from self._shifts(group)

    def _scaled(self, line: str) -> Iterator[OperandChange]:
        """All of φ in degrees, its argument and its value."""
        changes: dict[Place, New] = {
            (name, k): ("*", (OLD, DEGREES_PER_RADIAN))
            for name in self.of.used
            for k, operand in enumerate(self.of.lines[name][1])
            if isinstance(operand, str) and self.of.lines[operand][0] == "law.angle_scale"
        }
        yield OperandChange("degrees", ("e",), line, "e in degrees", changes)

    def _of_symbol(
        self, operand: str, words: str, use: Callable[..., OperandChange]
    ) -> Iterator[OperandChange]:
        """Changes of an input, or of a quantity that is an angle."""
        operation, place = self.of.lines[operand]
        is_input = self.of.is_input(operand)
        if is_input and place and self.of.n > 1:
            yield use("joint", f"{words} of the other joint", self._other_joint)
        for shift, told in ((1, "older"), (-1, "newer")):
            if (new := self._shifted(operand, shift)) is not None:
                text = self._told(new)
                yield use(told, f"{text} for {words}", partial(self._moved, shift))
        if operation in UNITS:
            yield use("degrees", f"{words} in degrees", ("*", (OLD, UNITS[operation])))
        elif (is_input and operation in ANGLES) or operand in self.ddq or self._is_error(operand):
            yield use("degrees", f"{words} in degrees", ("*", (OLD, DEGREES_PER_RADIAN)))

    def _is_error(self, operand: str) -> bool:
        """Whether an operand is the error or its rate."""
        return operand in self.of.labels and self.of.equations[operand] == UNPRINTED

    def _without_sign(self, operand: str | float) -> New:
        """What a magnitude is of."""
        return self.of.lines[str(operand)][1][0]

    def _other_joint(self, operand: str | float) -> New:
        operation, place = self.of.lines[str(operand)]
        return operation, (*place[:-1], float((int(place[-1]) + 1) % self.of.n))

    def _moved(self, shift: int, operand: str | float) -> New:
        new = self._shifted(operand, shift)
        assert new is not None  # what a law has of one joint it has of all
        return new

    def _shifted(self, operand: str | float, shift: int) -> New | None:
        """The same quantity a delay time older (1) or newer (-1), if the law has it."""
        lag = self.law.law.lag
        if operand in self.ddq:
            quantity, back, joint = "q̈", 1, float(self.ddq[operand])
        elif isinstance(operand, str) and self.of.lines[operand][0] in DELAYED:
            operation, place = self.of.lines[operand]
            quantity, newest = DELAYED[operation]
            back, joint = newest + (int(place[0]) // lag if len(place) > 1 else 0), float(place[-1])
        else:
            return None
        newest_ddq = {float(i): name for name, i in self.ddq.items()}
        if (quantity, back + shift) == ("q̈", 1):
            return newest_ddq.get(joint)
        return _delayed(quantity, back + shift, lag, joint)

    def _told(self, new: New) -> str:
        if not isinstance(new, tuple):
            return self.of.words(new)
        operation, place = new
        return NAMES.get(operation + "".join(f"[{index:g}]" for index in place[:-1]), operation)

    def _leaves(self, line: str, inside: Callable[[str], bool]) -> Iterator[tuple[Place, str | float]]:
        """Operands of a line and of what is inside it, each with its place."""
        for k, operand in enumerate(self.of.lines[line][1]):
            if isinstance(operand, str) and not self.of.is_input(operand) and inside(operand):
                yield from self._leaves(operand, inside)
            else:
                yield (line, k), operand

    def _shifts(self, group: Sequence[str]) -> Iterator[OperandChange]:
        """All delayed quantities of a sum, one delay time older or newer."""
        of = self.of
        for shift, told in ((1, "older"), (-1, "newer")):
            changes: dict[Place, New] = {}
            for line in group:
                delayed = {
                    place: operand
                    for place, operand in self._leaves(line, lambda name: name not in of.labels)
                    if self._shifted(operand, 1) or self._shifted(operand, -1)
                }
                new = {place: self._shifted(operand, shift) for place, operand in delayed.items()}
                if len(new) < 2 or None in new.values():
                    break
                changes |= {place: each for place, each in new.items() if each is not None}
            else:
                text = f"{of.words(group[0], group[0])} one L {told}"
                yield OperandChange(f"all {told}", of.key(group[0]), group[0], text, changes)

    def _exchanges(self, group: Sequence[str]) -> Iterator[OperandChange]:
        """Weights of two terms of a sum, exchanged."""
        of = self.of
        per_joint = [self._weights(line) for line in group]
        for a, b in combinations(range(len(per_joint[0])), 2):
            changes: dict[Place, New] = {}
            for of_joint in per_joint:
                (place_a, weight_a), (place_b, weight_b) = of_joint[a], of_joint[b]
                changes |= {place_a: weight_b, place_b: weight_a}
            first, second = per_joint[0][a][1], per_joint[0][b][1]
            text = f"{of.words(first)} and {of.words(second)} exchanged"
            yield OperandChange("exchange", (of.key(first), of.key(second)), group[0], text, changes)

    def _weights(self, line: str) -> list[tuple[Place, str]]:
        """The first gain in each term of a sum, with its place."""
        of, weights = self.of, []
        for place, term in self._leaves(line, partial(of.is_part, of=line, operations="+-")):
            if not isinstance(term, str):
                continue
            factors: list[tuple[Place, str | float]] = [(place, term)]
            if term not in of.of_gains and not of.is_input(term) and term not in of.labels:
                factors = [*self._leaves(term, partial(of.is_part, of=term, operations="*"))]
            gains = [(at, factor) for at, factor in factors if factor in of.of_gains]
            weights += [(at, str(factor)) for at, factor in gains[:1]]
        return weights

    def _angles(self) -> Iterator[Edit]:
        """All angles and their rates in degrees, as if the whole law were written for them.

        Accelerations are remembered as Eq. (16) gives them, and count in degrees where they are used.
        """
        of = self.of
        remembered = {*needed(of.lines, self.ddq)}
        changes: dict[Place, New] = {
            (name, k): ("*", (OLD, DEGREES_PER_RADIAN))
            for name in of.used
            for k, operand in enumerate(of.lines[name][1])
            if isinstance(operand, str) and name not in remembered
            if operand in self.ddq or of.lines[operand][0] in ANGLES
        }
        if changes:
            yield Edit(EVERYWHERE, "all angles in degrees", changes)
