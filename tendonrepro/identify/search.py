"""Differential evolution of several populations in step, kept on disk after every generation.

The first phase spreads: a member whose misfit is below the tolerance is as good as it needs to be, and walks
at random among plants that are. The second phase refines the best. Half of the trials are no differences of
members but follow the regression of the population on its residuals, which finds a few numbers among many
unknowns far sooner and leaves what they do not depend on as spread as it was.

Tried once on the same number of plants (docs/ensemble.md) it came closer than CMA-ES, to which a point is one
misfit, and than least squares from many starts, which stop at choices and where the misfit is rough.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError
from tendonrepro.files import sealed, unsealed, write_atomically


class Evaluated(NamedTuple):
    """What N points give.

    Attributes
    ----------
    misfits : array (N,)
    residuals : array (N, K)
        Deviation of each fitted number; smooth in the unknowns where the misfit is small.
    """

    misfits: Array
    residuals: Array


Misfit: TypeAlias = Callable[[Array], Evaluated]
"""Misfit of many points of the unit cube at once, (N, F); finite."""

AGREED = 1.05
"""Largest ratio of the seeds' best misfits that counts as the same."""

REFINING = 0.25
"""Share of the generations that refine."""

_FACTOR = (0.1, 0.7)
# Shares of the rows that a trial takes from the mutant: few rows find what a thin valley allows, many what
# needs several rows at once.
_CROSSED = (0.1, 0.3, 0.9)
_REGRESSED = 0.5
_STEP = (0.5, 1.0)


@dataclass(frozen=True)
class Effort:
    """How hard to search.

    Attributes
    ----------
    generations : int
    population : int
        Members per seed, at least 5.
    seeds : int
        Populations that know nothing of each other.
    tolerance : float
        Misfit that is good enough while spreading.
    smooth : tuple of bool
        Unknowns that the residuals depend on smoothly, of all F; choices are none.
    """

    generations: int
    population: int
    seeds: int
    tolerance: float
    smooth: tuple[bool, ...]

    @property
    def spreading(self) -> int:
        """Generations of the first phase."""
        return self.generations - int(REFINING * self.generations)

    @property
    def evaluations(self) -> int:
        """Points looked at in all."""
        return (self.generations + 1) * self.population * self.seeds


@dataclass(frozen=True)
class State:
    """Where a search stands.

    Attributes
    ----------
    generation : int
        Generations done.
    units : array (S, M, F)
        Members of each seed's population in the unit cube.
    misfits : array (S, M)
    residuals : array (S, M, K)
    spread_units, spread_misfits : array
        The same at the end of the first phase, or so far.
    history : array (generation + 1, S)
        Best misfit.
    random : tuple of str
        State of each seed's generator, as JSON.
    """

    generation: int
    units: Array
    misfits: Array
    residuals: Array
    spread_units: Array
    spread_misfits: Array
    history: Array
    random: tuple[str, ...]

    def is_whole(self) -> bool:
        """Whether its arrays fit each other; ValueError or TypeError where the generators are none."""
        shape = self.units.shape
        seeds = shape[0]
        _generators(self.random)
        return (
            self.spread_units.shape == shape
            and self.misfits.shape == self.spread_misfits.shape == self.residuals.shape[:2] == shape[:2]
            and self.residuals.ndim == 3
            and self.history.shape == (self.generation + 1, seeds)
            and len(self.random) == seeds
        )

    def best(self) -> tuple[Array, float]:
        """Best point (F,) and its misfit."""
        seed, member = np.unravel_index(int(np.argmin(self.misfits)), self.misfits.shape)
        return self.units[seed, member], float(self.misfits[seed, member])

    def near(self, limit: float) -> Array:
        """Members of the first phase's last population with a misfit up to a limit, (N, F)."""
        return self.spread_units[self.spread_misfits <= limit]

    def agree(self, tolerance: float) -> bool:
        """Whether all seeds have come to the same misfit, or all below a tolerance."""
        best = self.history[-1]
        return bool(best.max() <= max(AGREED * best.min(), tolerance))


def search(
    initial: Array,
    misfit: Misfit,
    effort: Effort,
    seed: int,
    path: Path,
    identity: str,
    talk: Talk,
    progress: Callable[[int], None] = lambda _: None,
) -> State:
    """Search to the end, from first members (S, M, F) or from where an interrupted search stopped.

    The state is written to `path` after every generation, and taken up only where `identity`, a digest of
    all that the search depends on, is the same. However often interrupted, it ends the same to the last bit.
    """
    state = load_state(path, identity, talk)
    if state is None or state.units.shape != initial.shape:
        state = _first(initial, misfit, seed)
        save_state(path, state, identity)
    progress((state.generation + 1) * state.misfits.size)
    while state.generation < effort.generations:
        state = step(state, misfit, effort)
        save_state(path, state, identity)
        progress(state.misfits.size)
    return state


def _first(initial: Array, misfit: Misfit, seed: int) -> State:
    seeds, members, rows = initial.shape
    found = misfit(initial.reshape(-1, rows))
    misfits = found.misfits.reshape(seeds, members)
    residuals = found.residuals.reshape(seeds, members, -1)
    generators = [np.random.default_rng([seed, place]) for place in range(seeds)]
    best = misfits.min(axis=1)[np.newaxis]
    return State(0, initial, misfits, residuals, initial, misfits, best, _states(generators))


def step(state: State, misfit: Misfit, effort: Effort) -> State:
    """One generation of every population, looked at together."""
    refine = state.generation >= effort.spreading
    tolerance = 0.0 if refine else effort.tolerance
    generators = _generators(state.random)
    populations = zip(state.units, state.misfits, state.residuals, generators, strict=True)
    trials = np.stack([_trials(*held, effort.smooth, tolerance, refine=refine) for held in populations])
    found = misfit(trials.reshape(-1, trials.shape[2]))
    found_misfits = found.misfits.reshape(state.misfits.shape)
    taken = found_misfits <= np.maximum(state.misfits, tolerance)

    def chosen(new: Array, old: Array) -> Array:
        return np.where(taken.reshape(taken.shape + (1,) * (old.ndim - 2)), new.reshape(old.shape), old)

    units, misfits = chosen(trials, state.units), chosen(found_misfits, state.misfits)
    return State(
        generation=state.generation + 1,
        units=units,
        misfits=misfits,
        residuals=chosen(found.residuals, state.residuals),
        spread_units=state.spread_units if refine else units,
        spread_misfits=state.spread_misfits if refine else misfits,
        history=np.concatenate([state.history, misfits.min(axis=1)[np.newaxis]]),
        random=_states(generators),
    )


def _trials(
    units: Array,
    misfits: Array,
    residuals: Array,
    generator: np.random.Generator,
    smooth: tuple[bool, ...],
    tolerance: float,
    *,
    refine: bool,
) -> Array:
    """One trial per member of a population, (M, F)."""
    members, rows = units.shape
    # Itself comes last in a member's random order of the others.
    order = np.argsort(generator.random((members, members)) + 2.0 * np.eye(members), axis=1)
    start, plus, minus = (units[order[:, k]] for k in range(3))
    # A step from where it stands is as likely as the step back, so walkers cover what is allowed evenly.
    walks = (misfits <= tolerance)[:, np.newaxis]
    base = units[np.argmin(misfits)] if refine else np.where(walks, units, start)
    mutant = base + generator.uniform(*_FACTOR, (members, 1)) * (plus - minus)
    crossed = generator.random((members, rows)) < generator.choice(_CROSSED, (members, 1))
    crossed[np.arange(members), generator.integers(rows, size=members)] = True
    trials = np.where(crossed, mutant, units)
    regressed = (generator.random((members, 1)) < _REGRESSED) & ~walks
    # From a better member and a step away from it, so that what follows is no copy.
    better = np.flatnonzero(misfits <= np.median(misfits))
    parent = generator.choice(better, members)
    stepped = units[parent] + np.where(crossed, mutant - base, 0.0)
    move = residuals[parent] @ _slope(units[better], residuals[better]) * np.array(smooth)
    towards = stepped - generator.uniform(*_STEP, (members, 1)) * move
    return _reflected(np.where(regressed, towards, trials))


def _slope(units: Array, residuals: Array) -> Array:
    """Regression of points on their residuals, (K, F)."""
    x, y = residuals - residuals.mean(axis=0), units - units.mean(axis=0)
    slope: Array = np.linalg.lstsq(x, y, rcond=1e-3)[0]
    return slope


def _reflected(units: Array) -> Array:
    """Fold what left the cube back into it; what is more than a side away ends at the far bound."""
    inside: Array = 1.0 - np.abs(1.0 - np.minimum(np.abs(units), 2.0))
    return inside


def _states(generators: list[np.random.Generator]) -> tuple[str, ...]:
    return tuple(json.dumps(generator.bit_generator.state) for generator in generators)


def _generators(states: tuple[str, ...]) -> list[np.random.Generator]:
    generators = [np.random.default_rng() for _ in states]
    for generator, state in zip(generators, states, strict=True):
        generator.bit_generator.state = json.loads(state)
    return generators


_NONE = "is of another search; the search starts anew"
_ARRAYS = ("units", "misfits", "residuals", "spread_units", "spread_misfits", "history")


def save_state(path: Path, state: State, identity: str) -> None:
    """Store a state, whole or not at all."""
    arrays = {name: getattr(state, name) for name in _ARRAYS}
    save_arrays(path, identity, generation=state.generation, random=state.random, **arrays)


def load_state(path: Path, identity: str, talk: Talk) -> State | None:
    """Read the state of this search; None when there is none to go on from, and why is told."""
    stored = load_arrays(path, identity, talk)
    if stored is None:
        return None
    with suppress(LookupError, TypeError, ValueError):
        arrays = {name: stored[name].astype(np.float64, casting="safe") for name in _ARRAYS}
        random = tuple(map(str, stored["random"]))
        state = State(generation=int(stored["generation"]), random=random, **arrays)
        if state.is_whole():
            return state
    talk.note(f"{path}: {_NONE}")
    return None


def save_arrays(path: Path, identity: str, **content: Any) -> None:
    """Store arrays, whole or not at all."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, identity=identity, **content)
    write_atomically(path, sealed(stream.getvalue()))


def load_arrays(path: Path, identity: str, talk: Talk) -> dict[str, NDArray[Any]] | None:
    """Read arrays of this search; None when there are none to go on from, and why is told."""
    if not path.exists():
        return None
    try:
        content = unsealed(path)
    except DataMissingError as error:
        talk.note(f"{error}; the search starts anew")
        return None
    # What the library says of something else under our seal is of any type.
    with suppress(Exception), np.load(io.BytesIO(content), allow_pickle=False) as stored:
        if str(stored["identity"]) == identity:
            return {name: stored[name] for name in stored.files}
    talk.note(f"{path}: {_NONE}")
    return None
