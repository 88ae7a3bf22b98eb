"""What is fitted to what, and how far the simulated numbers of a plant are from the printed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import Reading, case_of, reading, under
from tendonrepro.configuration.published import Published
from tendonrepro.experiments.loops import build_loops
from tendonrepro.files import digest_of
from tendonrepro.identification.search import Effort
from tendonrepro.monte_carlo.block import Simulate
from tendonrepro.monte_carlo.box import Box, configured, scrambled_sobol
from tendonrepro.monte_carlo.plan import code_digest
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.stepper import DesiredMotion, Loop

SCHEMA_VERSION = 2

Target: TypeAlias = Literal["controller_2", "all"]
FITTED: Mapping[Target, tuple[str, ...]] = {"controller_2": ("controller_2",), "all": RUNS}
"""Runs whose numbers are fitted."""

NEAR = 0.02
"""Misfit in log ratio, about 2 %, up to which a plant is near-optimal; twice the best where that is more."""

Window: TypeAlias = Literal["whole", "late"]
"""What the printed numbers average: the whole run, or all after its first period."""

METRICS = ("mae", "rmse")

_SUFFIX: Mapping[Window, str] = {"whole": "", "late": "_late"}
_TABLE = {run: f"table2.{run}" for run in RUNS} | {"controller_1_payload": "table3.with_load"}
# A run that did not end well is worse than any that did, and the worse the earlier it ended.
_RINGING, _DIVERGED, _UNRESOLVED, _WORST_FIT = 10.0, 20.0, 40.0, 5.0
_STUB = 64
# A plant's reference takes about a megabyte.
_PLANTS_AT_ONCE = 256


@dataclass(frozen=True)
class Printed:
    """The sixteen printed errors, deg, and half a unit of their last digit, each (R, 2, n).

    Runs in the order of `RUNS`, MAE and RMSE, joints.
    """

    values: Array
    half: Array
    joints: tuple[int, ...]


def printed_numbers(paper: Published, joints: Sequence[int]) -> Printed:
    """Tables 2 and 3."""
    numbers = [
        [[paper.digits(f"{_TABLE[run]}.{metric}.joint_{joint}") for joint in joints] for metric in METRICS]
        for run in RUNS
    ]
    values = [[[number.value for number in row] for row in rows] for rows in numbers]
    half = [[[0.5 * 10.0**-number.decimals for number in row] for row in rows] for rows in numbers]
    return Printed(np.array(values), np.array(half), tuple(joints))


@dataclass(frozen=True)
class Outcome:
    """What N plants give on R runs.

    `sizes` (N, R, 2, n) are MAE and RMSE, deg, up to its end of a diverged run, NaN where there is nothing;
    `status` (N, R) indexes `STATUSES`; `lasted` (N, R) is the share of the run that was done.
    """

    sizes: Array
    status: NDArray[np.int8]
    lasted: Array

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Runs that ended well, (N, R)."""
        return np.asarray(self.status == STATUSES.index("ok"))

    def part(self, plants: slice) -> Outcome:
        """Some of the plants."""
        return Outcome(self.sizes[plants], self.status[plants], self.lasted[plants])


@dataclass(frozen=True)
class Bench:
    """Points of the unit cube to numbers; every plant starts from the comparison `base`."""

    base: LoadedConfig
    box: Box
    window: Window
    simulate: Simulate

    def searching(self, rows: NDArray[np.bool_]) -> Bench:
        """The same with some rows (P,) free and the others at their nominal value."""
        return replace(self, box=replace(self.box, free=rows))

    def config(self, unit: Array, reading: Reading) -> CompareConfig:
        """Configuration of one point (P,) under a reading."""
        values = self.box.values(unit[np.newaxis])[0]
        return under(reading, configured(self.base, self.box, values), self.box.named(values))

    def measure(self, units: Array, reading: Reading, runs: Sequence[str]) -> Outcome:
        """Simulate runs of many points (N, P), in batches."""
        pieces = np.split(units, range(_PLANTS_AT_ONCE, len(units), _PLANTS_AT_ONCE))
        found = [self._measure(piece, reading, runs) for piece in pieces]
        return Outcome(
            *(np.concatenate([getattr(one, name) for one in found]) for name in ("sizes", "status", "lasted"))
        )

    def _measure(self, units: Array, reading: Reading, runs: Sequence[str]) -> Outcome:
        loops = [loop for unit in units for loop in self._loops(unit, reading, runs)]
        limits = self.base.config.status
        batch = self.simulate([*loops, *self._stubs(reading, runs)], limits)
        count, shape = len(loops), (len(units), len(runs))
        suffix = _SUFFIX[self.window]
        found = [batch.statistics[metric + suffix][:count] for metric in METRICS]
        sizes = np.rad2deg(np.stack(found, axis=1))
        duration = np.array([loop.reference.time[-1] for loop in loops])
        return Outcome(
            sizes.reshape(*shape, *sizes.shape[1:]),
            batch.status[:count].reshape(shape),
            (batch.status_time[:count] / duration).reshape(shape),
        )

    def _loops(self, unit: Array, reading: Reading, runs: Sequence[str]) -> list[Loop]:
        config = self.config(unit, reading)
        chosen = config.model_copy(update={"runs": {run: config.runs[run] for run in runs}})
        found = dict(build_loops(chosen, self.base.folder))
        return [found[run] for run in runs]

    def _stubs(self, reading: Reading, runs: Sequence[str]) -> list[Loop]:
        """Runs of some samples in which everything acts, one for each branch that a row of the box chooses.

        Code is compiled for what acts anywhere in a batch. With these in every batch, a population that comes
        to agree on some row does not need new code.
        """
        loops = [loop for unit in acting_units(self.box) for loop in self._loops(unit, reading, runs)]
        return [replace(loop, reference=_start_of(loop.reference)) for loop in loops]


def _start_of(reference: DesiredMotion) -> DesiredMotion:
    names = ("time", "q_d", "dq_d", "ddq_d")
    return replace(reference, **{name: getattr(reference, name)[:_STUB] for name in names})


def acting_units(box: Box) -> Array:
    """Points at which every effect acts, one for each disturbance and with and without torque steps."""
    columns = {name: place for place, name in enumerate(box.names)}
    disturbance = columns["disturbance"]
    points = []
    for place in range(box.choices[disturbance].size):
        for steps in box.choices[columns["torque_resolution_acts"]]:
            # Off the middle, where a value might be exactly one.
            unit = np.full(len(columns), 0.4142)
            for name in (name for name in columns if name.endswith("_acts")):
                unit[columns[name]] = 0.999
            unit[columns["torque_resolution_acts"]] = 0.999 if steps else 0.001
            unit[disturbance] = (place + 0.5) / box.choices[disturbance].size
            # The last word that is allowed has the most sides.
            unit[columns["friction_sides"]] = 0.999
            points.append(unit)
    return np.array(points)


def log_misfit(measured: Outcome, printed: Array) -> Array:
    """Root mean square over runs and numbers of log(ours / printed), (N,).

    Printed numbers are (R, 2, n), deg. A run that is not ok counts by its end: the result is finite, and
    below `_RINGING` over the root of R only where all runs are ok.
    """
    fit = np.sqrt(np.mean(log_residuals(measured, printed) ** 2, axis=(2, 3)))
    per_run = np.choose(
        measured.status,
        [fit, _RINGING + fit, _DIVERGED + 10.0 * (1.0 - measured.lasted), np.full_like(fit, _UNRESOLVED)],
    )
    return np.asarray(np.sqrt(np.mean(per_run**2, axis=1)))


def log_residuals(measured: Outcome, printed: Array) -> Array:
    """log(ours / printed) of every number, (N, R, 2, n), bounded; the bound where there is no number."""
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(measured.sizes / printed)
    return np.asarray(np.clip(np.nan_to_num(logs, nan=_WORST_FIT), -_WORST_FIT, _WORST_FIT))


def rounding_misfit(sizes: Array, printed: Array, half: Array) -> Array:
    """Root mean square of |ours - printed|, (N, R, 2, n), in half units of the last digit, (N,)."""
    return np.asarray(np.sqrt(np.mean(((sizes - printed) / half) ** 2, axis=(1, 2, 3))))


@dataclass(frozen=True)
class Task:
    """All that an identification depends on."""

    loaded: LoadedEnsemble
    fit: Target
    readings: tuple[Reading, ...]
    effort: Effort
    seed: int
    printed: Printed
    bench: Bench

    @property
    def fitted(self) -> tuple[str, ...]:
        """Runs whose numbers are fitted."""
        return FITTED[self.fit]

    @property
    def goal(self) -> Array:
        """Their printed numbers, (R, 2, n), deg."""
        return self.printed.values[[RUNS.index(run) for run in self.fitted]]

    def case(self, reading_: Reading) -> Reading:
        """What of a reading changes the fitted runs; readings with one case share a search."""
        changing = {axis for run in self.fitted for axis, _ in case_of(reading_, run).settings}
        return reading({axis: value for axis, value in reading_.settings if axis in changing})

    def identity(self, names: Sequence[str]) -> str:
        """SHA-256 of all that the numbers of some readings depend on."""
        effort = self.effort
        content = {
            "schema": SCHEMA_VERSION,
            "version": __version__,
            "code": code_digest(),
            "config": self.loaded.sha256,
            "fit": self.fit,
            "window": self.bench.window,
            "readings": list(names),
            "effort": [effort.generations, effort.population, effort.seeds, effort.tolerance],
            "seed": self.seed,
            "printed": [self.printed.values.tolist(), self.printed.half.tolist()],
        }
        return digest_of(content)


DRAWS, LOOKED_AT = 256, 8

FELT = 0.1
"""Root mean square change in log of the numbers, over plants and numbers, from which on a row is searched.

A choice: what moves them by less than a tenth the others make good, down to misfits well below that.
"""

_SWITCHES = {
    "reducer_loss_acts": {"reducer_efficiency"},
    "disturbance": {"disturbance_torque", "disturbance_frequency"},
}
"""What a row switches where its name does not say it."""


def switched_by(name: str) -> set[str]:
    """Names of the rows that do nothing where a choice is its first word, off or none."""
    return _SWITCHES.get(name, {name.removesuffix("_acts")})


def rows_that_matter(
    bench: Bench, case: Reading, runs: Sequence[str], printed: Array, seed: int
) -> NDArray[np.bool_]:
    """Rows of the bench's box to search under a reading, (P,); all where none is felt.

    `printed` are the numbers (R, 2, n) of the runs that are fitted, deg; `seed` is of the draws.
    """
    box = bench.box
    draws = scrambled_sobol(box, seed, 0, 0, DRAWS)
    measured = bench.measure(draws, case, runs)
    best = np.argsort(log_misfit(measured, printed), kind="stable")[:LOOKED_AT]
    before = log_residuals(measured, printed)[best]
    rows = np.arange(len(box.names))
    moved = np.repeat(draws[best, np.newaxis], rows.size, axis=1)
    moved[:, rows, rows] = nominal_unit(box)
    after = log_residuals(bench.measure(moved.reshape(-1, rows.size), case, runs), printed)
    change = after.reshape(LOOKED_AT, rows.size, -1) - before.reshape(LOOKED_AT, 1, -1)
    felt = with_switches(box.names, np.sqrt(np.mean(change**2, axis=(0, 2))) >= FELT)
    return felt if felt.any() else np.ones_like(felt)


def with_switches(names: Sequence[str], chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows together with those without which they do nothing where these are nominal."""
    sizes = {name for name, is_chosen in zip(names, chosen, strict=True) if is_chosen}
    switches = [not sizes.isdisjoint(switched_by(name)) for name in names]
    return chosen | np.array(switches, dtype=np.bool_)


def nominal_unit(box: Box) -> Array:
    """Point of the unit cube at which every row has its nominal value, (P,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(box.nominal / box.low) / np.log(box.high / box.low)
        shares = (box.nominal - box.low) / (box.high - box.low)
    unit = np.where(np.array(box.scale) == "log", logs, shares)
    for row, choices in enumerate(box.choices):
        if choices.size:
            unit[row] = (int(np.argmin(np.abs(choices - box.nominal[row]))) + 0.5) / choices.size
    return unit
