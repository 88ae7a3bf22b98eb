"""Where a search looks, what it simulates there, and how far that is from the numbers that are fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.readings import Reading, under
from tendonrepro.configuration.published import METRICS
from tendonrepro.identification.goal import Goal, Window
from tendonrepro.identification.optimisers import Evaluated
from tendonrepro.monte_carlo.kept import Simulate, stub_of
from tendonrepro.monte_carlo.population import Population, holding_base, population_of
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop

SUFFIX: Mapping[Window, str] = {"whole": "", "late": "_late", "settled": "_settled"}
"""Ends of the names of `simulation.streaming.STATISTICS` by what errors average."""

# A run that did not end well is worse than any that did, and the worse the earlier it ended.
_RINGING, _DIVERGED, _UNRESOLVED, _WORST_FIT = 10.0, 20.0, 40.0, 5.0
# A plant's reference takes about a megabyte.
PLANTS_AT_ONCE = 256

MOVED = 1e-6
"""Relative size of what moves the masses of a repeat: no bench knows them as well."""


class Simulated(NamedTuple):
    """What N plants give on R runs.

    `sizes` (N, R, 2, n): MAE and RMSE, deg, of a diverged run up to its end; `status` (N, R) indexes
    `STATUSES`; `lasted` (N, R): share of the run done.
    """

    sizes: Array
    status: NDArray[np.int8]
    lasted: Array

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Runs that ended well, (N, R)."""
        return np.asarray(self.status == STATUSES.index("ok"))


class Repeats(NamedTuple):
    """Of plants whose runs were repeated with masses moved by `MOVED`, (N, repeats).

    Their misfits, and whether they have the order of the goal in every column. Encoder steps and friction
    make some runs chaotic: there one run's misfit is as much luck as the plant.
    """

    misfits: Array
    ordered: NDArray[np.bool_]

    @property
    def median(self) -> Array:
        """Misfit of each plant, (N,)."""
        return np.asarray(np.median(self.misfits, axis=1))


@dataclass(frozen=True)
class Bench:
    """Points of the unit cube to numbers.

    The rows of the `box` are the paper's ranges, or factors on the values of an arm of one's own. Those that
    are not searched keep what its base has.
    """

    box: Population
    window: Window
    simulate: Simulate

    def searching(self, rows: NDArray[np.bool_]) -> Bench:
        """With some rows (P,) free and the others held."""
        return replace(self, box=self.box.freeing(rows))

    def config(self, unit: Array, reading: Reading) -> CompareConfig:
        """Of one point (P,) under a reading."""
        values = self.box.values(unit[np.newaxis])[0]
        return under(reading, self.box.configured(values), self.box.asked_by_readings(values))

    def measure(self, values: Array, reading: Reading, runs: Sequence[str]) -> Simulated:
        """Simulate values (N, P) of the rows, in batches."""
        pieces = np.split(values, range(PLANTS_AT_ONCE, len(values), PLANTS_AT_ONCE))
        found = [self._measure(piece, reading, runs) for piece in pieces]
        return Simulated(*map(np.concatenate, zip(*found, strict=True)))

    def evaluated(self, units: Array, reading: Reading, goal: Goal) -> Evaluated:
        """Misfits of points (N, P) to a goal."""
        ours = self.measure(self.box.values(units), reading, goal.runs)
        return Evaluated(log_misfit(ours, goal), log_residuals(ours, goal)[:, goal.fitted])

    def repeated(
        self, values: Array, reading: Reading, goal: Goal, count: int, seed: Sequence[int]
    ) -> Repeats:
        """Misfits of values (N, P) of the rows with their masses moved by `MOVED`, so many times."""
        moved = np.repeat(values, count, axis=0)
        masses = [row.name.startswith("link_mass") or row.key == "links.mass" for row in self.box.rows]
        normal = np.random.default_rng(seed).standard_normal((len(moved), sum(masses)))
        moved[:, masses] *= 1.0 + MOVED * normal
        ours, shape = self.measure(moved, reading, goal.runs), (len(values), count)
        return Repeats(log_misfit(ours, goal).reshape(shape), in_order(ours, goal).reshape(shape))

    def _measure(self, values: Array, reading: Reading, runs: Sequence[str]) -> Simulated:
        loops = self._loops(values, reading, runs)
        count, shape = len(loops), (len(values), len(runs))
        batch = self.simulate([*loops, *self._stubs(reading, runs)])
        sizes = [batch.statistics[metric + SUFFIX[self.window]][:count] for metric in METRICS]
        ends = np.array([loop.reference.time[-1] for loop in loops])
        return Simulated(
            np.rad2deg(np.stack(sizes, axis=1)).reshape(*shape, len(METRICS), -1),
            batch.status[:count].reshape(shape),
            (batch.status_time[:count] / ends).reshape(shape),
        )

    def _loops(self, values: Array, reading: Reading, runs: Sequence[str]) -> list[Loop]:
        return [*chain.from_iterable(self.box.loops(values, [(run, reading) for run in runs]))]

    def _stubs(self, reading: Reading, runs: Sequence[str]) -> list[Loop]:
        """Short runs in which everything acts, for each branch of the code.

        Code is compiled for what acts in a batch, so uniform populations need none. Around an arm of one's
        own what is off stays off, and all plants share their code.
        """
        if self.box.around:
            return []
        return [stub_of(loop) for loop in self._loops(self.box.values(acting(self.box)), reading, runs)]


def bench_of(loaded: LoadedEnsemble, window: Window = "whole", simulate: Simulate = simulate_batch) -> Bench:
    """The bench of an ensemble, or of the ranges around the arm of a comparison."""
    return Bench(holding_base(population_of(loaded)), window, simulate)


def acting(box: Population) -> Array:
    """Points of the paper's ranges where all effects act, for each disturbance, with torque steps or not."""
    disturbance, steps = (box.names.index(name) for name in ("disturbance", "torque_resolution_acts"))
    kinds = len(box.rows[disturbance].choices)
    # Off the middle, where a value might be exactly one.
    units = np.full((2 * kinds, len(box.names)), 0.4142)
    # The last of the sides of friction are the most.
    units[:, [name.endswith("_acts") or name == "friction_sides" for name in box.names]] = 0.999
    units[:, disturbance] = np.tile((np.arange(kinds) + 0.5) / kinds, 2)
    units[kinds:, steps] = 0.001
    return units


def log_misfit(ours: Simulated, goal: Goal) -> Array:
    """Root mean square over the numbers of R runs of log(ours / goal), (N,).

    A run that is not ok counts by its end, and as much as it has numbers.
    """
    numbers = goal.fitted.sum(axis=(1, 2))
    fit = np.sqrt(np.sum(log_residuals(ours, goal) ** 2, axis=(2, 3)) / numbers)
    diverged = _DIVERGED + 10.0 * (1.0 - ours.lasted)
    per_run = np.choose(ours.status, [fit, _RINGING + fit, diverged, np.full_like(fit, _UNRESOLVED)])
    return np.asarray(np.sqrt(np.sum(per_run**2 * numbers, axis=1) / numbers.sum()))


def log_residuals(ours: Simulated, goal: Goal) -> Array:
    """log(ours / goal), bounded, (N, R, 2, n); the bound without a number, 0 where none is fitted."""
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(ours.sizes / goal.values)
    bounded = np.clip(np.nan_to_num(logs, nan=_WORST_FIT), -_WORST_FIT, _WORST_FIT)
    return np.where(goal.fitted, bounded, 0.0)


def in_order(ours: Simulated, goal: Goal) -> NDArray[np.bool_]:
    """Whether the runs without payload end well and rank as in the goal, in every column, (N,)."""
    kept = goal.compared
    alike = goal.of_runs(kept).same_order(ours.sizes[:, kept]).all(axis=(1, 2))
    return np.asarray(alike & ours.ok[:, kept].all(axis=1))
