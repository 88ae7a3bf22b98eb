"""Desired angle, measured angle and error: two give the third, and a third that was recorded is compared."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.evidence import COUNTS_DEG, distance, roughness

CONTRADICTS = 0.5
"""RMS of error less difference, over that of the difference, from which on the error is not believed."""
EXPLAINS = 0.2
"""The same once a factor is applied, where that factor is the reason."""
SMOOTHER = 2.0
"""Ratio of roughness, or of what is left between runs, from which on a sum has the wrong sign."""
ON_COUNTS, OFF_COUNTS = 0.9, 0.7
"""Agreement with an encoder's counts from which on angles lie on them, and below which they do not."""
COARSEST = 0.05
"""Largest step of a rounded record, as a share of its largest number; beyond it the motion itself steps."""

_OF_THE_OTHERS = {"q_d": "q_encoder + e", "q_encoder": "q_d - e", "e": "q_d - q_encoder"}
_EQUAL = 1e-9
_FEWEST = 8
_TURN = 180.0 / np.pi
_REASONS = {
    -1.0: "it is q_encoder - q_d: `sign: -1`?",
    _TURN: "it is 57.3 times smaller than q_d - q_encoder: `unit: rad`?",
    1.0 / _TURN: "it is 57.3 times larger than q_d - q_encoder: `unit: deg`?",
    -_TURN: "it is 57.3 times smaller than q_encoder - q_d: `unit: rad` and `sign: -1`?",
    -1.0 / _TURN: "it is 57.3 times larger than q_encoder - q_d: `unit: deg` and `sign: -1`?",
}
"""Factor that makes a recorded error the difference -> what it is instead."""


@dataclass
class Completion:
    """What came of a run.

    Attributes
    ----------
    notes, doubts : list of str
        What was done, and what looks wrong.
    pairs : dict
        Measured angle and error, each (N,), of every joint without a desired angle whose error has the
        right sign as far as it alone can tell.
    """

    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    pairs: dict[int, tuple[Array, Array]] = field(default_factory=dict)


def complete(variables: dict[str, Array], joints: Sequence[int]) -> Completion:
    """Fill desired angle, measured angle and error from the other two, sample by sample, in place.

    The difference has the last word. An error that contradicts it fills no gaps.

    Parameters
    ----------
    variables : dict
        Name -> (N, joints), rad.
    joints : sequence of int
        Their numbers, for messages.

    Returns
    -------
    Completion
    """
    found = Completion()
    given = {name: variables[name] for name in _OF_THE_OTHERS if name in variables}
    if len(given) < 2:
        return found
    absent = np.full_like(next(iter(given.values())), np.nan)
    q_d, q, e = (given.get(name, absent) for name in _OF_THE_OTHERS)
    e = _believed(found, joints, q_d, q, e)
    difference = q_d - q
    variables["q_d"] = np.where(np.isnan(q_d), q + e, q_d)
    variables["q_encoder"] = np.where(np.isnan(q), q_d - e, q)
    variables["e"] = np.where(np.isnan(difference), e, difference)
    for name, before in (("q_d", q_d), ("q_encoder", q)):
        found.notes += _filled(name, joints, before, variables[name])
    return found


def _believed(found: Completion, joints: Sequence[int], q_d: Array, q: Array, e: Array) -> Array:
    """Leave out errors that contradict the difference, and say what was found of them."""
    kept, off = e.copy(), 0.0
    doubts: dict[str, list[int]] = defaultdict(list)
    for k, joint in enumerate(joints):
        columns = q_d[:, k], q[:, k], e[:, k]
        apart = np.abs(columns[0] - columns[1] - columns[2])
        if np.isnan(apart).all():
            doubt = _sign_doubt(*columns)
            if not doubt and np.isnan(columns[0]).all() and np.isfinite(columns[1] + columns[2]).any():
                found.pairs[joint] = columns[1], columns[2]
        elif np.nanmax(apart) <= _rounding(columns):
            continue
        elif doubt := _contradiction(columns[0] - columns[1], columns[2]):
            kept[:, k] = np.nan
        else:
            off = max(off, float(np.nanmax(apart)))
        if doubt:
            doubts[doubt].append(joint)
    found.doubts += [f"e of joint {', '.join(map(str, where))}: {doubt}" for doubt, where in doubts.items()]
    if off:
        degrees = f"{np.rad2deg(off):.3g} deg off"
        found.notes.append(f"e is q_d - q_encoder; the recorded error is up to {degrees}")
    return kept


def _contradiction(difference: Array, e: Array) -> str:
    """What an error is instead of the difference; empty when it is about that, or too short to tell."""
    known = np.isfinite(difference) & np.isfinite(e)
    d, recorded = difference[known], e[known]
    size = _rms(d)
    if len(d) < _FEWEST or _rms(recorded - d) <= CONTRADICTS * size:
        return ""
    left = {factor: _rms(factor * recorded - d) for factor in _REASONS}
    best = min(left, key=lambda factor: left[factor])
    if left[best] <= EXPLAINS * size:
        return _REASONS[best]
    most = np.rad2deg(np.abs(recorded - d).max())
    return f"it is up to {most:.3g} deg off q_d - q_encoder: check column, unit and run of all three"


def _sign_doubt(q_d: Array, q: Array, e: Array) -> str:
    """Why an error beside one angle alone seems to have the other sign; empty when it does not."""
    # The error is q_d - q_encoder: it is added to one and taken off the other.
    name, known, sign = ("q_encoder", q, 1.0) if np.isnan(q_d).all() else ("q_d", q_d, -1.0)
    plain, opposite = known + sign * e, known - sign * e
    texts = (f"{name} - e", f"{name} + e") if sign > 0.0 else (f"{name} + e", f"{name} - e")
    if SMOOTHER * roughness(opposite) < roughness(plain):
        return f"{texts[0]} is smoother than {texts[1]}: `sign: -1`?"
    if sign < 0.0 and _on_counts(opposite) > ON_COUNTS and _on_counts(plain) < OFF_COUNTS:
        return f"{texts[0]} lies on the encoder's counts, {texts[1]} does not: `sign: -1`?"
    return ""


def _on_counts(angle: Array) -> float:
    """How well angles lie on an encoder's counts: 1 where all do, 0 where they are anywhere."""
    known = np.rad2deg(angle[np.isfinite(angle)])
    if not len(known):
        return 0.0
    return float(max(abs(np.mean(np.exp(2j * np.pi / count * known))) for count in COUNTS_DEG))


def opposed(pairs: Mapping[str, Mapping[int, tuple[Array, Array]]]) -> Iterator[str]:
    """Doubts about runs whose desired angles agree only when the error is taken with the other sign.

    Parameters
    ----------
    pairs : mapping
        `Completion.pairs` of every run, by its name.
    """
    for joint in sorted({joint for of_run in pairs.values() for joint in of_run}):
        runs = {name: of_run[joint] for name, of_run in pairs.items() if joint in of_run}
        lengths = {len(q) for q, _ in runs.values()}
        if len(runs) < 2 or len(lengths) > 1:
            continue
        added, taken = (
            max(distance(a, b) for a, b in pairwise(q + sign * e for q, e in runs.values()))
            for sign in (1.0, -1.0)
        )
        if SMOOTHER * taken < added < np.inf and added > _EQUAL:
            agree = "q_encoder - e agrees between the runs, q_encoder + e does not"
            yield f"{', '.join(runs)}: e of joint {joint}: {agree}: `sign: -1`?"


def _rounding(columns: Sequence[Array]) -> float:
    """How far rounding alone moves a sum of records: half the step of each."""
    return _EQUAL + 0.5 * sum(map(_step, columns))


def _step(values: Array) -> float:
    """Smallest step between the larger half of a record's numbers, where rounded ones are coarsest."""
    size = np.abs(values[np.isfinite(values)])
    most = size.max(initial=0.0)
    steps = np.diff(np.unique(size[size >= 0.5 * most]))
    step = float(steps[steps > _EQUAL].min(initial=np.inf))
    return step if step <= COARSEST * most else 0.0


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _filled(name: str, joints: Sequence[int], before: Array, after: Array) -> Iterator[str]:
    """Notes about what was computed."""
    filled = (np.isnan(before) & ~np.isnan(after)).any(axis=0)
    whole = filled & np.isnan(before).all(axis=0)
    if whole.any():
        of = "" if whole.all() else f" of joint {listed(joints, whole)}"
        yield f"{name}{of} is {_OF_THE_OTHERS[name]}"
    if (filled & ~whole).any():
        yield f"{name} of joint {listed(joints, filled & ~whole)} is {_OF_THE_OTHERS[name]} where it has gaps"


def listed(joints: Sequence[int], chosen: ArrayLike) -> str:
    """Numbers of the chosen joints, separated by commas."""
    return ", ".join(str(joints[place]) for place in np.flatnonzero(chosen).tolist())
