"""How far numbers of a plant are from the printed ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import Reading, under
from tendonrepro.configuration.published import Published
from tendonrepro.identification.search import Evaluated
from tendonrepro.monte_carlo.block import Simulate
from tendonrepro.monte_carlo.box import Box, configured
from tendonrepro.monte_carlo.plants import Draws
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.loop import DesiredMotion, Loop

Window: TypeAlias = Literal["whole", "late"]
"""What the printed numbers average: the whole run, or all after its first period."""

METRICS = ("mae", "rmse")

_SUFFIX = {"whole": "", "late": "_late"}
_TABLE = {run: f"table2.{run}" for run in RUNS} | {"controller_1_payload": "table3.with_load"}
# A run that did not end well is worse than any that did, and the worse the earlier it ended.
_RINGING, _DIVERGED, _UNRESOLVED, _WORST_FIT = 10.0, 20.0, 40.0, 5.0
_STUB = 64
# A plant's reference takes about a megabyte.
_PLANTS_AT_ONCE = 256


@dataclass(frozen=True)
class Printed:
    """The printed errors, deg, and half a unit of their last digit, (R, 2, n)."""

    values: Array
    half: Array
    joints: tuple[int, ...]


def printed_numbers(paper: Published, joints: Sequence[int]) -> Printed:
    """Tables 2 and 3."""
    names = [
        f"{_TABLE[run]}.{metric}.joint_{joint}" for run in RUNS for metric in METRICS for joint in joints
    ]
    numbers, shape = [paper.digits(name) for name in names], (len(RUNS), len(METRICS), len(joints))
    values = np.reshape([number.value for number in numbers], shape)
    half = np.reshape([0.5 * 10.0**-number.decimals for number in numbers], shape)
    return Printed(values, half, tuple(joints))


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


@dataclass(frozen=True)
class Bench:
    """Points of the unit cube to numbers."""

    base: LoadedConfig
    box: Box
    window: Window
    simulate: Simulate

    def searching(self, rows: NDArray[np.bool_]) -> Bench:
        """With some rows (P,) free and the others held."""
        return replace(self, box=replace(self.box, free=rows))

    def config(self, unit: Array, reading: Reading) -> CompareConfig:
        """Of one point (P,) under a reading."""
        values = self.box.values(unit[np.newaxis])[0]
        return under(reading, configured(self.base, self.box, values), self.box.named(values))

    def measure(self, units: Array, reading: Reading, runs: Sequence[str]) -> Simulated:
        """Simulate points (N, P), in batches."""
        pieces = np.split(units, range(_PLANTS_AT_ONCE, len(units), _PLANTS_AT_ONCE))
        found = [self._measure(piece, reading, runs) for piece in pieces]
        sizes, status, lasted = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Simulated(sizes, status, lasted)

    def evaluated(self, units: Array, reading: Reading, runs: Sequence[str], goal: Array) -> Evaluated:
        """Misfits of points (N, P) to numbers (R, 2, n), deg."""
        ours = self.measure(units, reading, runs)
        return Evaluated(log_misfit(ours, goal), log_residuals(ours, goal).reshape(len(units), -1))

    def _measure(self, units: Array, reading: Reading, runs: Sequence[str]) -> Simulated:
        loops = self._loops(units, reading, runs)
        count, shape = len(loops), (len(units), len(runs))
        batch = self.simulate([*loops, *self._stubs(reading, runs)], self.base.config.status)
        sizes = [batch.statistics[metric + _SUFFIX[self.window]][:count] for metric in METRICS]
        ends = np.array([loop.reference.time[-1] for loop in loops])
        return Simulated(
            np.rad2deg(np.stack(sizes, axis=1)).reshape(*shape, len(METRICS), -1),
            batch.status[:count].reshape(shape),
            (batch.status_time[:count] / ends).reshape(shape),
        )

    def _loops(self, units: Array, reading: Reading, runs: Sequence[str]) -> list[Loop]:
        cases = [(run, reading) for run in runs]
        draws = Draws(self.base, self.box, self.box.values(units), cases)
        return [loop for k in range(len(units)) for loop in draws.loops(k)]

    def _stubs(self, reading: Reading, runs: Sequence[str]) -> list[Loop]:
        """Short runs in which everything acts, for each branch of the code.

        Code is compiled for what acts in a batch, so uniform populations need none.
        """
        loops = self._loops(acting_units(self.box), reading, runs)
        return [replace(loop, reference=_start_of(loop.reference)) for loop in loops]


def _start_of(reference: DesiredMotion) -> DesiredMotion:
    names = ("time", "q_d", "dq_d", "ddq_d")
    return replace(reference, **{name: getattr(reference, name)[:_STUB] for name in names})


def acting_units(box: Box) -> Array:
    """Points at which every effect acts, for each disturbance, with and without torque steps."""
    disturbance, steps = (box.names.index(name) for name in ("disturbance", "torque_resolution_acts"))
    kinds = box.choices[disturbance].size
    # Off the middle, where a value might be exactly one.
    units = np.full((2 * kinds, len(box.names)), 0.4142)
    # The last of the sides of friction are the most.
    units[:, [name.endswith("_acts") or name == "friction_sides" for name in box.names]] = 0.999
    units[:, disturbance] = np.tile((np.arange(kinds) + 0.5) / kinds, 2)
    units[kinds:, steps] = 0.001
    return units


def log_misfit(ours: Simulated, printed: Array) -> Array:
    """Root mean square over R runs of log(ours / printed), (N,); a run that is not ok counts by its end."""
    fit = np.sqrt(np.mean(log_residuals(ours, printed) ** 2, axis=(2, 3)))
    diverged = _DIVERGED + 10.0 * (1.0 - ours.lasted)
    per_run = np.choose(ours.status, [fit, _RINGING + fit, diverged, np.full_like(fit, _UNRESOLVED)])
    return np.asarray(np.sqrt(np.mean(per_run**2, axis=1)))


def log_residuals(ours: Simulated, printed: Array) -> Array:
    """log(ours / printed), bounded, (N, R, 2, n); the bound without a number."""
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(ours.sizes / printed)
    return np.asarray(np.clip(np.nan_to_num(logs, nan=_WORST_FIT), -_WORST_FIT, _WORST_FIT))


def rounding_misfit(sizes: Array, printed: Array, half: Array) -> float:
    """Root mean square of ours - printed in half units of the last digit."""
    return float(np.sqrt(np.mean(((sizes - printed) / half) ** 2)))
