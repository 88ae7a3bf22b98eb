"""Which edits there are for the runs of a study: each under one name, those of equal effect once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.shown import run_in_words
from tendonrepro.identification.edits.recorded import EditedLaw, RecordedLaw, recorded
from tendonrepro.identification.edits.rules import EVERYWHERE, edits_of
from tendonrepro.physics import control
from tendonrepro.physics.control import ANGLES_BACK, TORQUES_BACK, Memory
from tendonrepro.simulation.loop import Loop, TimeDelayController

LAGS = {2: "L of two sampling periods", 4: "L of four sampling periods"}
"""Delay times that are edits of the paper's law, which takes one sampling period."""

POINTS, SAME = 100, 1e-9
"""Test points, and the relative difference of torques up to which two laws are equal."""


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
        for lag, words in LAGS.items() if law.command is control.command and law.law.lag == 1 else ():
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
    kept, same = [np.concatenate([*unedited.values()])], [[""]]
    first, no_number = [Variant("", {})], []
    for variant in variants:
        parts = {run: torques(law) for run, law in variant.laws.items()}
        values = np.concatenate([*(unedited | parts).values()])
        alike = np.flatnonzero(_equal(np.array(kept), values))
        if not all(np.isfinite(part).any() for part in parts.values()):
            no_number.append(variant.name)
        elif alike.size:
            same[alike[0]].append(variant.name)
        else:
            kept.append(values)
            same.append([variant.name])
            first.append(variant)
    edits = [replace(variant, others=tuple(names[1:])) for variant, names in zip(first, same, strict=True)]
    return Variants(tuple(edits[1:]), edits[0].others, tuple(no_number), len(variants))


def _equal(laws: Array, law: Array) -> NDArray[np.bool_]:
    """Which laws (K, values) give the values of another."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(laws - law) / (np.abs(laws) + np.abs(law) + 1e-12)
    alike = (laws == law) | (apart < SAME) | (np.isnan(laws) & np.isnan(law))
    return np.asarray(alike.all(axis=1))


def torques(law: EditedLaw) -> Array:
    """Torques and accelerations of a law at test points, in a row."""
    names = ("memory", "q", "q_d", "dq_d", "ddq_d", "law")
    given = dict(zip(names, (*states(law.base.law.M_bar.size), law.base.law), strict=True))
    with np.errstate(all="ignore"):
        parts = law.played([name for name in ("tau", "ddq") if name in law.base.outputs], given)
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
