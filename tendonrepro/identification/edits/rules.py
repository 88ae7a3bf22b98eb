"""Every small change of recorded laws, by rule, each with its equation, its place and a name.

Those of equal effect stand once.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain, combinations, islice, pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import run_in_words
from tendonrepro.identification.edits.recorded import (
    ALPHA,
    APPLIED,
    OLD,
    UNPRINTED,
    Changes,
    EditedLaw,
    New,
    Place,
    RecordedLaw,
    recorded,
)
from tendonrepro.physics.control import ANGLES_BACK, DEGREES_PER_RADIAN, TORQUES_BACK, Memory
from tendonrepro.simulation.codegen.symbols import needed
from tendonrepro.simulation.loop import Loop, TimeDelayController

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
IN_DEGREES: New = ("*", (OLD, DEGREES_PER_RADIAN))
NOT_PRINTED = ("law.angle_scale", "law.power_floor")
"""Inputs that are no symbol of the paper."""
STEPS = {"older": 1, "newer": -1}
"""Delay times by which a quantity is moved."""

EVERYWHERE = "everywhere"
"""Where an edit is that changes all uses of a symbol."""

LAGS = {2: "L of two sampling periods", 4: "L of four sampling periods"}
"""Delay times that are edits of the paper's law, which takes one sampling period."""

POINTS, SAME = 100, 1e-9
"""Test points, and the relative difference of torques up to which two laws are equal."""

Key: TypeAlias = tuple[object, ...]


class Anatomy:
    """What the operations of a recorded law are: their words, what they are parts of, and which are alike.

    Lines that differ in the joint alone are alike: an edit changes them together.
    """

    def __init__(self, law: RecordedLaw) -> None:
        self.lines, self.labels, self.equations = law.lines, law.labels, law.equations
        self.ddq, self.joints = law.outputs.get("ddq", ()), law.law.M_bar.size
        self.used = [
            name for name in needed(law.lines, chain(*law.outputs.values())) if not self.is_input(name)
        ]
        self.times: dict[New | None, str] = {}
        self.moved: dict[tuple[New | None, int], New | None] = {}
        for letters, course in _courses(law):
            self.times |= zip(course, letters, strict=False)
            for newer, older in pairwise(course):
                self.moved |= {(newer, 1): older, (older, -1): newer}
        sums = [name for name in self.used if self.lines[name][0] in "+-"]
        self.inner = {part for name in sums for part in self.lines[name][1] if self.is_part(part, name, "+-")}
        self.alike: dict[Key, list[str]] = defaultdict(list)
        for name in self.used:
            self.alike[self.key(name)].append(name)
        self.of_gains: set[str] = set()
        for name, (operation, operands) in self.lines.items():
            parts = [each for each in operands if isinstance(each, str)]
            is_gain = operation.startswith("law.") and operation not in NOT_PRINTED
            if is_gain or (operation in APPLIED and parts and self.of_gains.issuperset(parts)):
                self.of_gains.add(name)

    def is_input(self, name: str) -> bool:
        """Whether a line is an input."""
        return self.lines[name][0] not in APPLIED

    def key(self, operand: str | float) -> Key:
        """The same for operands that differ in the joint alone."""
        if not isinstance(operand, str):
            return (operand,)
        operation, operands = self.lines[operand]
        if self.is_input(operand):
            return (operation, *operands[:-1])
        return (operation, *(self.key(each) for each in operands))

    def words(self, operand: New, inside: str = "") -> str:
        """An operand in letters; what has a label is not spelled out, unless it is `inside` that."""
        if isinstance(operand, str):
            if operand in self.labels and operand != inside:
                return self.labels[operand]
            operand = self.lines[operand]
        if not isinstance(operand, tuple):
            return f"{operand:g}"
        operation, operands = operand
        if operation in APPLIED:
            return self._spelled(operation, operands)
        places = "".join(f"[{place:g}]" for place in operands[:-1])
        return self.times.get(operand) or NAMES.get(operation, operation.removeprefix("law.")) + places

    def _spelled(self, operation: str, operands: Sequence[str | float]) -> str:
        """An operation in letters."""
        parts = [self.words(each) for each in operands]
        if operation == "choose":
            return f"[{parts[1]} or {parts[2]}]"
        if operation == "abs":
            return f"|{parts[0]}|"
        if len(parts) == 1:
            return f"{'−' if operation == 'negative' else operation}({parts[0]})"
        for k, each in enumerate(operands):
            if each in self.labels:
                bracketed = " " in parts[k]
            else:
                bracketed = isinstance(each, str) and self.lines[each][0] in "+-" and operation not in "+-"
            parts[k] = f"({parts[k]})" if bracketed else parts[k]
        return {"*": " ", "-": " − ", "/": "/", "**": "^"}.get(operation, f" {operation} ").join(parts)

    def is_part(self, operand: str | float, of: str, operations: str) -> bool:
        """Whether an operand is a sum or product inside a longer one of the same equation, no quantity."""
        return (
            isinstance(operand, str)
            and operand not in self.labels
            and not self.is_input(operand)
            and self.lines[operand][0] in operations
            and self.equations[operand] == self.equations[of]
        )

    def leaves(self, line: str, inside: Callable[[str], bool]) -> Iterator[tuple[Place, str | float]]:
        """Operands of a line and of what is inside it, each with its place."""
        for k, operand in enumerate(self.lines[line][1]):
            if isinstance(operand, str) and not self.is_input(operand) and inside(operand):
                yield from self.leaves(operand, inside)
            else:
                yield (line, k), operand

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


def _courses(law: RecordedLaw) -> Iterator[tuple[Sequence[str], list[New | None]]]:
    """Letters of a quantity of several times, and what the law has of it by joint, the newest first."""
    for i in range(law.law.M_bar.size):
        held = partial(_held, law.law.lag, float(i))
        newest = law.outputs["ddq"][i] if law.of_paper else None
        yield ("q(t)", "q(t−L)", "q(t−2L)", "q(t−3L)"), [("q", (float(i),)), *held("q", ANGLES_BACK)]
        yield ("τ(t−L)", "τ(t−2L)"), held("tau", TORQUES_BACK)
        yield ("q̈(t−L)", "q̈(t−2L)"), [newest, *held("ddq", 1)]


def _held(lag: int, joint: float, name: str, periods: int) -> list[New | None]:
    """What the memory, with a place for each sampling period, has from a delay time ago on."""
    return [(f"memory.{name}", (k * lag - 1.0, joint)) for k in range(1, periods + 1)]


def _of_operand(of: Anatomy, line: str, k: int) -> Iterator[tuple[str, str, New]]:
    """Yield every change of one operand: its kind, its words, and what stands there instead.

    Changes of one kind and operand are also made together, wherever it stands.
    """
    operation, operands = of.lines[line]
    old = operands[k]
    words = of.words(old)
    made_by, place = of.lines[old] if isinstance(old, str) else ("", ())
    is_term = operation in "+-" and not of.is_part(old, line, "+-")
    is_factor = operation == "*" and not of.is_part(old, line, "*")
    is_fixed = not isinstance(old, str) or old in of.of_gains
    is_error = old in of.labels and of.equations[str(old)] == UNPRINTED

    if is_term or made_by.startswith("law.") or operation == "negative":
        yield "sign", f"{words} with the other sign", ("*", (OLD, -1.0))
    if is_term:
        yield "term", f"{words} left out", 0.0
    if is_fixed and (is_factor or (operation, k) == ("/", 1)):
        yield "factor", f"factor {words} left out", 1.0
    if (operation, k) == ("**", 1):
        yield "exponent", f"exponent {words} left out", 1.0
    if (operation, k) == ("choose", 0):
        yield "branch 1.0", f"always {of.words(operands[1])}", 1.0
        yield "branch 0.0", f"always {of.words(operands[2])}", 0.0
    if made_by == "abs":
        yield f"sign in {operation}", f"{of.words(place[0])} for {words}", place[0]
    if made_by not in APPLIED and place and of.joints > 1:
        other = (made_by, (*place[:-1], (float(place[-1]) + 1.0) % of.joints))
        yield "joint", f"{words} of the other joint", other
    for kind, step in STEPS.items():
        if (moved := of.shifted(old, step)) is not None:
            yield kind, f"{of.words(moved)} for {words}", moved
    if made_by in ANGLES or old in of.ddq or is_error or made_by in UNITS:
        yield "degrees", f"{words} in degrees", ("*", (OLD, UNITS.get(made_by, DEGREES_PER_RADIAN)))


class _Use(NamedTuple):
    """A change in lines that are alike.

    `kind` and `operand` say which changes of other lines belong together, `line` and `words` name it.
    """

    kind: str
    operand: Key
    line: str
    words: str
    changes: dict[Place, New]


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
    edits: dict[str, Changes] = {}
    for (equation, words), own in named.items():
        for use in own:
            context = f", in {of.words(use.line, inside=use.line)}" if len(own) > 1 else ""
            edits.setdefault(f"{equation}: {words}{context}", use.changes)
    for (_, operand), own in together.items():
        # An input may stand in equations of other laws, too.
        is_input = isinstance(operand[0], str) and operand[0] not in APPLIED
        if is_input or (len(own) > 1 and not isinstance(operand[0], float)):
            changes = dict(chain.from_iterable(use.changes.items() for use in own))
            edits.setdefault(f"{EVERYWHERE}: {own[0].words}", changes)
    # The plainer name of what also a turned sign in a condition does.
    edits = dict(sorted(edits.items(), key=lambda edit: ": always " not in edit[0]))
    if changes := dict.fromkeys(_angles(of), IN_DEGREES):
        edits[f"{EVERYWHERE}: all angles in degrees"] = changes
    return edits


def _uses(of: Anatomy, group: Sequence[str]) -> Iterator[_Use]:
    """Yield all changes of lines that are alike."""
    line = group[0]
    operation, operands = of.lines[line]
    if any(of.lines[each][0] in NOT_PRINTED for each in operands if isinstance(each, str)):
        if operation == "*":
            # All of φ in degrees, its argument and its value.
            scales = of.uses(lambda _, operand: of.lines[operand][0] == "law.angle_scale")
            yield _Use("degrees", (None,), line, "e in degrees", dict.fromkeys(scales, IN_DEGREES))
        return
    for k, operand in enumerate(operands):
        of_kind: dict[str, _Use] = {}
        for each in group:
            for kind, words, new in _of_operand(of, each, k):
                use = of_kind.setdefault(kind, _Use(kind, of.key(operand), line, words, {}))
                use.changes[each, k] = new
        yield from of_kind.values()
    if operation in "+-" and line not in of.inner:
        yield from _exchanges(of, group)
        yield from _shifts(of, group)


def _exchanges(of: Anatomy, group: Sequence[str]) -> Iterator[_Use]:
    """Weights of two terms of a sum, exchanged."""
    for pairs in zip(*(combinations(_weights(of, line), 2) for line in group), strict=True):
        changes: dict[Place, New] = {}
        for (place_a, weight_a), (place_b, weight_b) in pairs:
            changes |= {place_a: weight_b, place_b: weight_a}
        (_, first), (_, second) = pairs[0]
        words = f"{of.words(first)} and {of.words(second)} exchanged"
        yield _Use("exchange", (of.key(first), of.key(second)), group[0], words, changes)


def _weights(of: Anatomy, line: str) -> Iterator[tuple[Place, str]]:
    """Yield the first gain in each term of a sum, with its place."""
    for place, term in of.leaves(line, partial(of.is_part, of=line, operations="+-")):
        if isinstance(term, str):
            is_whole = term in of.of_gains or term in of.labels or of.is_input(term)
            inside = partial(of.is_part, of=term, operations="*")
            factors = [(place, term)] if is_whole else of.leaves(term, inside)
            yield from islice(((at, str(factor)) for at, factor in factors if factor in of.of_gains), 1)


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
            words = f"{of.words(group[0], group[0])} one L {told}"
            yield _Use(f"all {told}", of.key(group[0]), group[0], words, changes)


def _angles(of: Anatomy) -> Iterator[Place]:
    """Uses of all angles and their rates, as if the whole law were written for degrees.

    Accelerations are remembered as Eq. (16) gives them, and count in degrees where they are used.
    """
    remembered = {*needed(of.lines, of.ddq)}
    return of.uses(
        lambda line, operand: line not in remembered and (operand in of.ddq or of.lines[operand][0] in ANGLES)
    )


@dataclass(frozen=True)
class Variant:
    """An edit as an engineer reads it, the edited law of each run that has it, and edits of equal torques."""

    name: str
    laws: Mapping[str, EditedLaw]
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class Variants:
    """Edits that change a torque, and names of those that change none, or that give no number anywhere."""

    edits: tuple[Variant, ...]
    unchanged: tuple[str, ...]
    no_number: tuple[str, ...]
    made: int


def controller_of(loop: Loop) -> TimeDelayController:
    """Controller of a run that is compared."""
    assert isinstance(loop.controller, TimeDelayController)
    return loop.controller


def law_of(loop: Loop) -> RecordedLaw:
    """Record the law of a run."""
    controller = controller_of(loop)
    return recorded(controller.law, controller.command)


def variants_of(loops: Mapping[str, Loop]) -> Variants:
    """All edits of the laws of some runs.

    An edit of an equation that several laws have is one of all of them, and one of each alone.
    """
    laws = {run: law_of(loop) for run, loop in loops.items()}
    by_name: dict[str, dict[str, EditedLaw]] = defaultdict(dict)
    for run, law in laws.items():
        for name, changes in edits_of(law).items():
            by_name[name][run] = EditedLaw(law, changes)
        for lag, words in LAGS.items() if law.of_paper and law.law.lag == 1 else ():
            by_name[f"{EVERYWHERE}: {words}"][run] = EditedLaw(recorded(law.law._replace(lag=lag)))
    made = []
    for name, edited in by_name.items():
        made.append(Variant(name, edited))
        alone = edited if len(edited) > 1 else ()
        made += [Variant(f"{name}, in {run_in_words(run)} alone", {run: edited[run]}) for run in alone]
    return _distinct(made, {run: EditedLaw(law) for run, law in laws.items()})


def _distinct(variants: Sequence[Variant], base: Mapping[str, EditedLaw]) -> Variants:
    """Leave out what changes no torque, and name together what changes it alike."""
    unedited = {run: torques(law) for run, law in base.items()}
    kept, alike, no_number = [np.concatenate([*unedited.values()])], [[Variant("", base)]], []
    for variant in variants:
        own = {run: torques(law) for run, law in variant.laws.items()}
        values = np.concatenate([*(unedited | own).values()])
        equal = np.flatnonzero(_equal(np.array(kept), values))
        if not all(np.isfinite(part).any() for part in own.values()):
            no_number.append(variant.name)
        elif equal.size:
            alike[equal[0]].append(variant)
        else:
            kept.append(values)
            alike.append([variant])
    none, *edits = (replace(first, others=tuple(each.name for each in more)) for first, *more in alike)
    return Variants(tuple(edits), none.others, tuple(no_number), len(variants))


def _equal(laws: Array, law: Array) -> NDArray[np.bool_]:
    """Which laws (K, values) give the values of another."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(laws - law) / (np.abs(laws) + np.abs(law) + 1e-12)
    alike = (laws == law) | (apart < SAME) | (np.isnan(laws) & np.isnan(law))
    return np.asarray(alike.all(axis=1))


def torques(law: EditedLaw) -> Array:
    """Torques of a law at test points, and accelerations of the paper's, in a row."""
    gains, points = law.base.law, states(law.base.law.M_bar.size)
    with np.errstate(all="ignore"):
        parts = [law(*points, gains)[0]]
        if law.base.of_paper:
            parts.append(law.acceleration(*points[:2], gains))
    return np.concatenate([np.ravel(part) for part in parts]).astype(float)


@cache
def states(n: int) -> tuple[Memory, Array, Array, Array, Array]:
    """States at which laws are compared: errors from 0.003° to 30°, moving by some encoder steps a sample."""
    draw = np.random.default_rng(56)
    lag = max(LAGS)

    def normal(*shape: int, size: float = 1.0) -> Array:
        return size * draw.standard_normal((*shape, n, POINTS))

    e = np.exp(draw.uniform(np.log(5e-5), np.log(0.5), (n, POINTS))) * draw.choice([-1.0, 1.0], (n, POINTS))
    q = normal(size=0.5)
    before = q - np.cumsum(normal(ANGLES_BACK * lag, size=1e-3), axis=0)
    memory = Memory(
        q=before,
        tau=normal(TORQUES_BACK * lag, size=5.0),
        de=normal(),
        q_d=q + e - normal(size=1e-3),
        ddq=normal(lag, size=400.0),
        H_hat=normal(size=5.0),
    )
    return memory, q, q + e, normal(), normal(size=3.0)
