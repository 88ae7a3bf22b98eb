"""Every small change of a recorded law, by rule, each with its equation, its place and a name."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from itertools import combinations, pairwise
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
from tendonrepro.physics.control import ANGLES_BACK, DEGREES_PER_RADIAN, TORQUES_BACK, Surface
from tendonrepro.simulation.codegen.symbols import Line, Operand, as_operand, needed

SURFACES = {Surface.NTSM: "Eq. (11)", Surface.TSM: "surface of Controller 3", Surface.PD: "Eq. (9)"}
FEEDBACKS = {Surface.NTSM: "Eq. (18)", Surface.TSM: "u of Controller 3", Surface.PD: "Eq. (9)"}

NAMES: Mapping[str, str] = {
    "law.M_bar": "M̄", "law.lam": "λ", "law.eta": "η", "law.b": "b", "law.Delta": "Δ", "law.beta": "β",
    "law.K_d": "K_d", "law.K_p": "K_p", "law.L": "L", "law.power_floor": "least |e|", ALPHA: "α",
    "q_d": "q_d", "dq_d": "q̇_d", "ddq_d": "q̈_d",
    "memory.q_d": "q_d(t−L)", "memory.de": "ė(t−L)", "memory.H_hat": "Ĥ(t−L)",
}  # fmt: skip
"""Inputs of a tape in the letters of the paper; those of several times have theirs in `_courses`."""

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

Key: TypeAlias = tuple[object, ...]


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
        self.ddq = [*law.outputs.get("ddq", ())]
        self.times: dict[New | None, str] = {}
        self.moved: dict[tuple[New | None, int], New | None] = {}
        for course in _courses(law):
            self.times |= course
            for newer, older in pairwise(course):
                self.moved |= {(newer, 1): older, (older, -1): newer}
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

    def words(self, operand: New, inside: str | None = None) -> str:
        """An operand in letters; what has a label is not spelled out, unless it is `inside` that."""
        if isinstance(operand, str):
            if operand in self.labels and operand != inside:
                return self.labels[operand]
            operand = self.lines[operand]
        if not isinstance(operand, tuple):
            return f"{operand:g}"
        if operand in self.times:
            return self.times[operand]
        operation, operands = operand
        if operation in APPLIED:
            return self._spelled(operation, operands)
        places = "".join(f"[{place:g}]" for place in operands[:-1])
        return NAMES.get(operation, operation.removeprefix("law.")) + places

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

    def shifted(self, operand: str | float, step: int) -> New | None:
        """The same quantity a delay time older (1) or newer (-1), if the law has it."""
        is_input = isinstance(operand, str) and self.is_input(operand)
        return self.moved.get((self.lines[str(operand)] if is_input else operand, step))

    def uses(self, wanted: Callable[[str, str], bool]) -> Iterator[Place]:
        """Places of operands that are wanted, by their line and name."""
        for line in self.used:
            for k, operand in enumerate(self.lines[line][1]):
                if isinstance(operand, str) and wanted(line, operand):
                    yield line, k

    def leaves(self, line: str, inside: Callable[[str], bool]) -> Iterator[tuple[Place, str | float]]:
        """Operands of a line and of what is inside it, each with its place."""
        for k, operand in enumerate(self.lines[line][1]):
            if isinstance(operand, str) and not self.is_input(operand) and inside(operand):
                yield from self.leaves(operand, inside)
            else:
                yield (line, k), operand

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


def _courses(law: RecordedLaw) -> Iterator[dict[New | None, str]]:
    """Quantities of several times, with their letters, the newest first, as far as the law has them.

    The memory has a place for each sampling period.
    """
    for i in range(law.law.M_bar.size):

        def held(name: str, letter: str, periods: int, first: int = 1, i: int = i) -> dict[New | None, str]:
            """What the memory has, from so many delay times ago on."""
            places = [
                (f"memory.{name}", (float(k * law.law.lag - 1), float(i))) for k in range(1, periods + 1)
            ]
            return {place: f"{letter}(t−{k}L)".replace("1L", "L") for k, place in enumerate(places, first)}

        yield {("q", (float(i),)): "q(t)"} | held("q", "q", ANGLES_BACK)
        yield held("tau", "τ", TORQUES_BACK)
        newest: New | None = law.outputs["ddq"][i] if "ddq" in law.outputs else None
        yield {newest: "q̈(t−L)"} | held("ddq", "q̈", 1, 2)


class _At(NamedTuple):
    """An operand, the `k`-th of a line, as rules look at it."""

    of: Anatomy
    line: str
    k: int

    @property
    def operation(self) -> str:
        return self.of.lines[self.line][0]

    @property
    def operands(self) -> Sequence[str | float]:
        return self.of.lines[self.line][1]

    @property
    def operand(self) -> str | float:
        return self.operands[self.k]

    @property
    def made_by(self) -> Line:
        """The operand's own line."""
        return self.of.lines[self.operand] if isinstance(self.operand, str) else ("", ())

    @property
    def is_term(self) -> bool:
        return self.operation in "+-" and not self.of.is_part(self.operand, self.line, "+-")


def _other_sign(at: _At) -> New | None:
    turns = at.is_term or at.made_by[0].startswith("law.") or at.operation == "negative"
    return ("*", (OLD, -1.0)) if turns else None


def _no_term(at: _At) -> New | None:
    return 0.0 if at.is_term else None


def _no_factor(at: _At) -> New | None:
    """A factor that depends on gains alone."""
    is_fixed = not isinstance(at.operand, str) or at.operand in at.of.of_gains
    is_factor = at.operation == "*" and not at.of.is_part(at.operand, at.line, "*")
    return 1.0 if is_fixed and (is_factor or (at.operation, at.k) == ("/", 1)) else None


def _no_exponent(at: _At) -> New | None:
    return 1.0 if (at.operation, at.k) == ("**", 1) else None


def _branch(at: _At, value: float) -> New | None:
    return value if (at.operation, at.k) == ("choose", 0) else None


def _no_magnitude(at: _At) -> New | None:
    operation, operands = at.made_by
    return operands[0] if operation == "abs" else None


def _other_joint(at: _At) -> New | None:
    operation, place = at.made_by
    if operation in APPLIED or not place or at.of.n == 1:
        return None
    return operation, (*place[:-1], (float(place[-1]) + 1.0) % at.of.n)


def _other_time(at: _At, step: int) -> New | None:
    return at.of.shifted(at.operand, step)


def _in_degrees(at: _At) -> New | None:
    """Of an angle, the error, or a gain whose number has a unit."""
    of, (operation, _) = at.of, at.made_by
    is_error = at.operand in of.labels and of.equations[str(at.operand)] == UNPRINTED
    is_angle = operation in ANGLES or at.operand in of.ddq or is_error or operation in UNITS
    return ("*", (OLD, UNITS.get(operation, DEGREES_PER_RADIAN))) if is_angle else None


STEPS = {"older": 1, "newer": -1}
"""Delay times by which a quantity is moved."""

RULES: Sequence[tuple[str, str, Callable[[_At], New | None]]] = (
    ("sign", "{old} with the other sign", _other_sign),
    ("term", "{old} left out", _no_term),
    ("factor", "factor {old} left out", _no_factor),
    ("exponent", "exponent {old} left out", _no_exponent),
    ("branch 1.0", "always {then}", partial(_branch, value=1.0)),
    ("branch 0.0", "always {otherwise}", partial(_branch, value=0.0)),
    ("sign in {operation}", "{new} for {old}", _no_magnitude),
    ("joint", "{old} of the other joint", _other_joint),
    *((told, "{new} for {old}", partial(_other_time, step=step)) for told, step in STEPS.items()),
    ("degrees", "{old} in degrees", _in_degrees),
)
"""Changes of one operand: their kind, words, and what stands there instead, or None where there is no such.

Changes of one kind and operand are also made together, wherever it stands.
"""


class _Use(NamedTuple):
    """A change in lines that are alike.

    `kind` and `operand` say which changes of other lines belong together, `line` and `words` name it.
    """

    kind: str
    operand: Key
    line: str
    words: str
    changes: dict[Place, New]


def _changed(of: Anatomy, group: Sequence[str], k: int) -> Iterator[_Use]:
    """What the rules change of an operand of lines that are alike."""
    first = _At(of, group[0], k)
    parts = zip(("condition", "then", "otherwise"), map(of.words, first.operands), strict=False)
    told = {"old": of.words(first.operand), "operation": first.operation, **dict(parts)}
    for kind, words, rule in RULES:
        changes = {(line, k): new for line in group if (new := rule(_At(of, line, k))) is not None}
        if changes:
            told["new"] = of.words(changes[group[0], k]) if "{new}" in words else ""
            key = of.key(first.operand)
            yield _Use(kind.format_map(told), key, group[0], words.format_map(told), changes)


def edits_of(law: RecordedLaw) -> dict[str, Changes]:
    """All edits of a law by name: an equation, or the line of a user's file, and what is changed there."""
    of = Anatomy(law)
    named: dict[tuple[str, str], list[_Use]] = defaultdict(list)
    together: dict[tuple[str, Key], list[_Use]] = defaultdict(list)
    for group in of.alike.values():
        equation = of.equations[group[0]]
        for use in _uses(of, group) if equation != UNPRINTED else ():
            named[equation, use.words].append(use)
            together[use.kind, use.operand].append(use)
    edits: list[tuple[str, str, Changes]] = []
    changes: Changes
    for (equation, words), own in named.items():
        for use in own:
            context = f", in {of.words(use.line, inside=use.line)}" if len(own) > 1 else ""
            edits.append((equation, words + context, use.changes))
    for (_, operand), own in together.items():
        # An input may stand in equations of other laws, too.
        is_input = isinstance(operand[0], str) and operand[0] not in APPLIED
        if is_input or (len(own) > 1 and not isinstance(operand[0], float)):
            changes = {place: new for use in own for place, new in use.changes.items()}
            edits.append((EVERYWHERE, own[0].words, changes))
    # The plainer name of what also a turned sign in a condition does.
    edits.sort(key=lambda edit: not edit[1].startswith("always"))
    edits += [(EVERYWHERE, "all angles in degrees", changes) for changes in _all_angles(of)]
    unique: dict[str, Changes] = {}
    for equation, words, changes in edits:
        unique.setdefault(f"{equation}: {words}", changes)
    return unique


def _uses(of: Anatomy, group: Sequence[str]) -> Iterator[_Use]:
    line = group[0]
    operation, operands = of.lines[line]
    inputs = {of.lines[each][0] for each in operands if isinstance(each, str)}
    if inputs.intersection(NOT_PRINTED):
        if operation == "*":
            # All of φ in degrees, its argument and its value.
            scales = of.uses(lambda _, operand: of.lines[operand][0] == "law.angle_scale")
            yield _Use("degrees", (None,), line, "e in degrees", dict.fromkeys(scales, IN_DEGREES))
        return
    for k in range(len(operands)):
        yield from _changed(of, group, k)
    if operation in "+-" and line not in of.inner:
        yield from _exchanges(of, group)
        yield from _shifts(of, group)


IN_DEGREES: New = ("*", (OLD, DEGREES_PER_RADIAN))


def _exchanges(of: Anatomy, group: Sequence[str]) -> Iterator[_Use]:
    """Weights of two terms of a sum, exchanged."""
    per_joint = [_weights(of, line) for line in group]
    for a, b in combinations(range(len(per_joint[0])), 2):
        changes: dict[Place, New] = {}
        for of_joint in per_joint:
            (place_a, weight_a), (place_b, weight_b) = of_joint[a], of_joint[b]
            changes |= {place_a: weight_b, place_b: weight_a}
        first, second = per_joint[0][a][1], per_joint[0][b][1]
        text = f"{of.words(first)} and {of.words(second)} exchanged"
        yield _Use("exchange", (of.key(first), of.key(second)), group[0], text, changes)


def _weights(of: Anatomy, line: str) -> list[tuple[Place, str]]:
    """The first gain in each term of a sum, with its place."""
    weights = []
    for place, term in of.leaves(line, partial(of.is_part, of=line, operations="+-")):
        if not isinstance(term, str):
            continue
        factors: list[tuple[Place, str | float]] = [(place, term)]
        if term not in of.of_gains and not of.is_input(term) and term not in of.labels:
            factors = [*of.leaves(term, partial(of.is_part, of=term, operations="*"))]
        gains = [(at, str(factor)) for at, factor in factors if factor in of.of_gains]
        weights += gains[:1]
    return weights


def _shifts(of: Anatomy, group: Sequence[str]) -> Iterator[_Use]:
    """All delayed quantities of a sum, one delay time older or newer."""
    delayed = {
        place: operand
        for line in group
        for place, operand in of.leaves(line, lambda name: name not in of.labels)
        if any(of.shifted(operand, step) for step in STEPS.values())
    }
    for told, step in STEPS.items():
        new = {place: of.shifted(operand, step) for place, operand in delayed.items()}
        changes = {place: each for place, each in new.items() if each is not None}
        if len(changes) == len(delayed) >= 2 * len(group):
            text = f"{of.words(group[0], group[0])} one L {told}"
            yield _Use(f"all {told}", of.key(group[0]), group[0], text, changes)


def _all_angles(of: Anatomy) -> Iterator[Changes]:
    """All angles and their rates in degrees, as if the whole law were written for them.

    Accelerations are remembered as Eq. (16) gives them, and count in degrees where they are used.
    """
    remembered = {*needed(of.lines, of.ddq)}
    places = of.uses(
        lambda line, operand: line not in remembered and (operand in of.ddq or of.lines[operand][0] in ANGLES)
    )
    if changes := dict.fromkeys(places, IN_DEGREES):
        yield changes
