"""The box of plausible plants: draws from its unit cube, a search in it, and configurations of points."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import EnsembleConfig
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.box import WORDS, BoxRange, BoxRow, Words
from tendonrepro.configuration.models.readings import as_printed
from tendonrepro.configuration.quantity import UNITS, to_si
from tendonrepro.monte_carlo.draw import drawn_tree


@dataclass(frozen=True)
class Box:
    """The unknowns, (P,); SI units and radians.

    A word counts as its place in `words`, from 0; `scale` is ``linear``, ``log`` or ``choice``. Rows that
    are not `free` keep `nominal`. `shortest_run` is in s, see `drawn_tree`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Array
    nominal: Array
    high: Array
    scale: tuple[str, ...]
    confidence: tuple[str, ...]
    choices: tuple[Array, ...]
    words: tuple[tuple[str, ...], ...]
    free: NDArray[np.bool_]
    shortest_run: float

    def values(self, unit: Array) -> Array:
        """Map points of the unit cube to values, both (N, P); choices take equal slices."""
        return np.stack([self._column(i, unit[:, i]) for i in range(len(self.names))], axis=1)

    def _column(self, i: int, unit: Array) -> Array:
        if not self.free[i]:
            return np.full_like(unit, self.nominal[i])
        if self.choices[i].size:
            place = np.minimum(unit * self.choices[i].size, self.choices[i].size - 1.0).astype(int)
            return np.asarray(self.choices[i][place])
        low, high = self.low[i], self.high[i]
        value = low * (high / low) ** unit if self.scale[i] == "log" else low + (high - low) * unit
        return np.asarray(np.clip(value, low, high), dtype=np.float64)

    def only(self, confidences: Collection[str]) -> Box:
        """Box in which only rows of these confidences vary."""
        return replace(self, free=self.free & [one in confidences for one in self.confidence])

    def named(self, values: Array) -> dict[str, float]:
        """One draw (P,) by row name."""
        return dict(zip(self.names, values.tolist(), strict=True))


def make_box(config: EnsembleConfig) -> Box:
    """Box of a configuration, all rows free."""
    items = dict(config.box)
    numbers = [_si_numbers(name, row) for name, row in items.items()]
    low, nominal, high, choices = zip(*numbers, strict=True)
    return Box(
        names=tuple(items),
        units=tuple("1" if isinstance(row, Words) else UNITS[row.unit].si for row in items.values()),
        low=np.array(low),
        nominal=np.array(nominal),
        high=np.array(high),
        scale=tuple(row.scale if isinstance(row, BoxRange) else "choice" for row in items.values()),
        confidence=tuple(row.confidence for row in items.values()),
        choices=choices,
        words=tuple(WORDS.get(name, ()) for name in items),
        free=np.ones(len(items), dtype=np.bool_),
        shortest_run=config.shortest_run.si,
    )


def _si_numbers(name: str, row: BoxRow) -> tuple[float, float, float, Array]:
    """Low, nominal, high and choices of a row in SI; a word counts as its place."""
    if isinstance(row, BoxRange):
        low, nominal, high = (to_si(value, row.unit) for value in (row.low, row.nominal, row.high))
        return low, nominal, high, np.zeros(0)
    if isinstance(row, Words):
        nominal, *choices = (float(WORDS[name].index(word)) for word in (row.nominal, *row.choices))
    else:
        nominal, *choices = (to_si(value, row.unit) for value in (row.nominal, *row.choices))
    return min(choices), nominal, max(choices), np.array(choices)


def scrambled_sobol(box: Box, seed: int, replicate: int, first: int, count: int) -> Array:
    """Points (count, P) of a scrambled Sobol sequence in the unit cube, from number `first` on, from 0.

    Each depends on its number, seed and replicate alone.
    """
    from scipy.stats import qmc

    rng = np.random.default_rng([seed, replicate])
    engine = qmc.Sobol(len(box.names), scramble=True, seed=rng)
    if first > 0:
        engine.fast_forward(first)
    with warnings.catch_warnings():
        # A block is a part of a power of two, not one itself.
        warnings.filterwarnings("ignore", message="The balance properties", category=UserWarning)
        return np.asarray(engine.random(count), dtype=np.float64)


def evolution(start: Array, width: float, population: int, generator: np.random.Generator) -> Any:
    """CMA-ES in the unit cube, from a point (P,) with a first standard deviation.

    A ``cma.CMAEvolutionStrategy`` with random numbers of its own.
    """
    import cma

    options = {
        "bounds": [0.0, 1.0],
        "popsize": population,
        "randn": lambda *shape: generator.standard_normal(shape),
        "seed": np.nan,  # else it would seed a generator that all of NumPy shares
        "verbose": -9,
    }
    return cma.CMAEvolutionStrategy(start, width, options)


def configured(base: LoadedConfig, box: Box, values: Array) -> CompareConfig:
    """Validated configuration of one draw (P,), every axis of readings as printed."""
    tree = drawn_tree(base.tree, box.named(values), box.shortest_run)
    return as_printed(CompareConfig.model_validate(tree))
