"""Plants to draw: rows with ranges, points of their unit cube, and a comparison for each point."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import ROWS, Around, LoadedEnsemble, drawn_config
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.box import PER_JOINT, WORDS, BoxRange, BoxRow, Draw, Words
from tendonrepro.configuration.models.readings import UNDER_READINGS
from tendonrepro.configuration.quantity import UNITS, to_si
from tendonrepro.configuration.rows import drawn_comparison, held_values, scaled_comparison, values_of
from tendonrepro.experiments.loops import Case, Once, case_loops
from tendonrepro.experiments.user_law import UserLaw
from tendonrepro.simulation.loop import Loop

if TYPE_CHECKING:
    from cma import CMAEvolutionStrategy


@dataclass(frozen=True)
class RowRange:
    """What a row may be, SI: from `low` to `high`, or one of `choices`.

    A word counts as its place in `words`. `scale` is ``linear``, ``log`` or ``choice``. A row that is not
    `free` keeps `nominal`. Around an arm of a user's own a row is a factor on the value of its `key`, of one
    `joint` or of all (None).
    """

    name: str
    unit: str
    low: float
    nominal: float
    high: float
    scale: str
    confidence: str = ""
    choices: tuple[float, ...] = ()
    words: tuple[str, ...] = ()
    free: bool = True
    key: str = ""
    joint: int | None = None

    def values(self, unit: Array) -> Array:
        """At places of the unit cube; choices take equal slices."""
        if not self.free:
            return np.full_like(unit, self.nominal)
        if self.choices:
            place = np.minimum(unit * len(self.choices), len(self.choices) - 1.0).astype(int)
            return np.asarray(np.array(self.choices)[place])
        low, high = self.low, self.high
        value = low * (high / low) ** unit if self.scale == "log" else low + (high - low) * unit
        return np.asarray(np.clip(value, low, high), dtype=np.float64)


@dataclass(frozen=True)
class Population:
    """Plants within ranges: those of the box, or factors on the values of an arm of a user's own.

    Around such an arm the motion, and where runs start, are its comparison's.
    """

    loaded: LoadedEnsemble
    rows: tuple[RowRange, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the rows."""
        return tuple(row.name for row in self.rows)

    @property
    def around(self) -> Around | None:
        """The arm of a user's own, if it is one."""
        return self.loaded.around

    @property
    def nominal(self) -> Array:
        """Values (P,) of rows that are not free."""
        return np.array([row.nominal for row in self.rows])

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which rows vary, (P,)."""
        return np.array([row.free for row in self.rows])

    def freeing(self, free: NDArray[np.bool_]) -> Population:
        """With some rows (P,) free, and the others held."""
        pairs = zip(self.rows, free.tolist(), strict=True)
        return replace(self, rows=tuple(replace(row, free=is_free) for row, is_free in pairs))

    def only(self, confidences: Collection[str]) -> Population:
        """In which only rows of these confidences vary."""
        return self.freeing(self.free & [row.confidence in confidences for row in self.rows])

    def named(self, values: Array) -> dict[str, float]:
        """One draw (P,) by the names of the rows."""
        return dict(zip(self.names, values.tolist(), strict=True))

    def points(self, seed: int, replicate: int, first: int, count: int) -> Array:
        """Points (count, P) of a scrambled Sobol sequence in the unit cube, from number `first` on, from 0.

        Each depends on its number, seed and replicate alone. Rows that act under some readings alone are
        scrambled after the others, and so do not move them.
        """
        rows = len(self.rows)
        always = rows if self.around else rows - len(UNDER_READINGS)
        points = sobol(always, [seed, replicate], first, count)
        if always == rows:
            return points
        under_readings = sobol(rows, [seed, replicate, 1], first, count)[:, always:]
        return np.concatenate([points, under_readings], axis=1)

    def values(self, unit: Array) -> Array:
        """Values of points of the unit cube, both (N, P)."""
        return np.stack([row.values(unit[:, i]) for i, row in enumerate(self.rows)], axis=1)

    def sample(self, seed: int, replicate: int, first: int, count: int) -> Array:
        """Draws (count, P) of one scrambling from number `first` on; see `points`."""
        return self.values(self.points(seed, replicate, first, count))

    def configured(self, values: Array) -> CompareConfig:
        """Validated comparison of one draw (P,); that of the box has every axis of readings as printed.

        Raises
        ------
        ConfigError
            Where a value around an arm leaves what is possible, such as a loss above all of the tension.
        """
        draw, base = self.named(values), self.loaded.base.tree
        if not self.around:
            return drawn_comparison(base, draw, self.loaded.config.shortest_run.si)
        factors = {
            ROWS[row.key] + (f"_{row.joint}" if row.joint else ""): draw[row.name] for row in self.rows
        }
        tree = scaled_comparison(base, factors, f"assumed: draw {self.around.told}")
        return drawn_config(tree, self.around)

    def asked_by_readings(self, values: Array) -> Draw:
        """What readings may ask of one draw (P,): all rows of the box, nothing of another arm."""
        return {} if self.around else self.named(values)

    def loops(
        self, values: Array, cases: Sequence[Case], laws: Sequence[UserLaw] = ()
    ) -> Iterator[list[Loop]]:
        """Yield closed loops of each draw (N, P), by case: runs, each under a reading.

        What readings leave alone is shared, and draws share motions that are the same. Around an arm a user's
        `laws` run too.

        Raises
        ------
        ConfigError
            If a draw makes no sound configuration, or leaves the workspace.
        """
        motions, folder = Once(), self.loaded.base.folder
        for row in values:
            config, draw = self.configured(row), self.asked_by_readings(row)
            yield case_loops(config, cases, draw, folder, motions, laws)


def population_of(loaded: LoadedEnsemble) -> Population:
    """The box, all rows free, or factors around an arm; free of these is what can vary and is not off."""
    box = dict(loaded.config.box)
    if not loaded.around:
        return Population(loaded, tuple(_range(name, row) for name, row in box.items()))
    joints = loaded.compare.joints
    rows = []
    for key, name in ROWS.items():
        if name not in PER_JOINT:
            rows.append(_factor(loaded, key, None, box[name]))
            continue
        for joint in joints:  # the box has ranges of joints 2 and 3
            rows.append(_factor(loaded, key, joint, box[f"{name}_{3 if joint == joints[-1] else 2}"]))
    return Population(loaded, tuple(rows))


def _range(name: str, row: BoxRow) -> RowRange:
    """Row of the box in SI."""
    if isinstance(row, BoxRange):
        low, nominal, high = (float(to_si(value, row.unit)) for value in (row.low, row.nominal, row.high))
        return RowRange(name, UNITS[row.unit].si, low, nominal, high, row.scale, row.confidence)
    if isinstance(row, Words):
        unit, words = "1", WORDS[name]
        nominal, *choices = (float(words.index(word)) for word in (row.nominal, *row.choices))
    else:
        unit, words = UNITS[row.unit].si, ()
        nominal, *choices = (float(to_si(value, row.unit)) for value in (row.nominal, *row.choices))
    ends = min(choices), nominal, max(choices)
    return RowRange(name, unit, *ends, "choice", row.confidence, tuple(choices), words)


def _factor(loaded: LoadedEnsemble, key: str, joint: int | None, shipped: object) -> RowRange:
    """Factor on the value of a key: the user's ends, within the spread, or as far as the shipped ranges."""
    around = loaded.around
    assert around is not None
    assert isinstance(shipped, BoxRange)
    if key in around.ranges:
        low, high, scale = *around.ranges[key], "log"
    elif around.spread is not None:
        low, high, scale = 1.0 / (1.0 + around.spread), 1.0 + around.spread, "log"
    else:
        low, high, scale = shipped.low / shipped.nominal, shipped.high / shipped.nominal, shipped.scale
    values = held_values(loaded.compare.manipulator, key)
    acts = np.any(values if joint is None else values[joint - 1])
    name = key if joint is None else f"{key}_{joint}"
    nominal = float(np.clip(1.0, low, high))
    return RowRange(
        name, "1", low, nominal, high, scale, free=bool(low < high and acts), key=key, joint=joint
    )


def holding_base(population: Population) -> Population:
    """The box whose rows keep what its base has, where they are not free; around an arm as it is."""
    if population.around:
        return population
    values = values_of(population.loaded.compare, population.named(population.nominal))
    pairs = zip(population.rows, values.values(), strict=True)
    return replace(population, rows=tuple(replace(row, nominal=float(value)) for row, value in pairs))


def sobol(dimensions: int, key: Sequence[int], first: int, count: int) -> Array:
    """Points (count, P) of a scrambled Sobol sequence in the unit cube, from number `first` on, from 0."""
    from scipy.stats import qmc

    engine = qmc.Sobol(dimensions, scramble=True, seed=np.random.default_rng(key))
    if first > 0:
        engine.fast_forward(first)
    with warnings.catch_warnings():
        # A block is a part of a power of two, not one itself.
        warnings.filterwarnings("ignore", message="The balance properties", category=UserWarning)
        return np.asarray(engine.random(count))


def evolution(
    start: Array, width: float, population: int, generator: np.random.Generator
) -> CMAEvolutionStrategy:
    """CMA-ES in the unit cube, from a point (P,) with a first standard deviation.

    Its random numbers are its own.
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
