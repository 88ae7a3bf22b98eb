"""What a search fits, the paper's errors or a user's; what plants give; and how far that is from these."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from itertools import chain
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.control import RUNS, unloaded_run
from tendonrepro.configuration.models.readings import Reading, under
from tendonrepro.configuration.published import METRICS, Published, published, row_of
from tendonrepro.configuration.strict_yaml import read_text
from tendonrepro.errors import DataMissingError, UsageError, did_you_mean
from tendonrepro.identification.optimisers import Evaluated
from tendonrepro.monte_carlo.kept import Simulate, stub_of
from tendonrepro.monte_carlo.population import Population, holding_base, population_of
from tendonrepro.physics.metrics import START, STATUSES
from tendonrepro.results.paper_tables import COLUMNS
from tendonrepro.results.summary import tracking_errors, without_start_name
from tendonrepro.results.traces import TRACES, read_traces
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop

Target: TypeAlias = Literal["controller_2", "all"]
"""Runs whose published numbers are fitted."""

Window: TypeAlias = Literal["whole", "late", "settled"]
"""What errors average: the whole run, all after its first period, or all after `metrics.START`."""

_ROUNDED = 6
"""Digits behind the point up to which a number of a table counts as rounded; longer ones are exact."""
_Numbers: TypeAlias = dict[tuple[str, str, int], tuple[float, float]]
"""Errors and their reading errors, deg, NaN where unknown, by run, metric and joint."""
_HINT = "A table begins with run,joint,mae_deg,rmse_deg, as tables/table2.csv of compare does."


@dataclass(frozen=True)
class Goal:
    """Errors of R runs, deg, and half a unit of their last digit, (R, 2, n); NaN where there is none.

    Those that are `fitted`, (R, 2, n), decide; the others only stand beside. `name` says where they come
    from, `named` what results are labelled with.
    """

    name: str
    named: Mapping[str, str]
    runs: tuple[str, ...]
    joints: tuple[int, ...]
    values: Array
    half: Array
    fitted: NDArray[np.bool_]
    of_paper: bool = False

    @property
    def word(self) -> str:
        """What the numbers are called in columns and pictures."""
        return "printed" if self.of_paper else "given"

    @property
    def origin(self) -> str:
        """What a plant that was fitted to them cannot be evidence for."""
        return "the print" if self.of_paper else self.name

    @property
    def numbers(self) -> int:
        """How many decide."""
        return int(self.fitted.sum())

    @property
    def compared(self) -> list[int]:
        """Places of the runs that have an order: those without payload."""
        return [r for r, run in enumerate(self.runs) if not unloaded_run(run)]

    @property
    def sought(self) -> Goal:
        """The runs alone that have a number to fit."""
        return self.of_runs(np.flatnonzero(self.fitted.any(axis=(1, 2))).tolist())

    def of_runs(self, places: list[int]) -> Goal:
        """Some of the runs alone, by their places."""
        return replace(
            self,
            runs=tuple(self.runs[r] for r in places),
            values=self.values[places],
            half=self.half[places],
            fitted=self.fitted[places],
        )

    def same_order(self, sizes: Array) -> NDArray[np.bool_]:
        """Whether errors (N, R, 2, n) rank runs as these do, (N, 2, n); of a column the runs that it has."""

        def ranks(values: Array) -> NDArray[np.int64]:
            known = np.where(self.fitted, values, np.inf)
            return np.argsort(np.argsort(known, axis=-3, kind="stable"), axis=-3)

        return np.asarray((ranks(sizes) == ranks(self.values)).all(axis=-3))


def printed_numbers(paper: Published, joints: Sequence[int], fit: Target = "all") -> Goal:
    """Tables 2 and 3 of the paper; of them all numbers or those of Controller 2 are fitted."""
    names = [
        f"{row_of(run)}.{metric}.joint_{joint}" for run in RUNS for metric in METRICS for joint in joints
    ]
    numbers, shape = [paper.digits(name) for name in names], (len(RUNS), len(METRICS), len(joints))
    fitted = np.array([fit in (run, "all") for run in RUNS])
    return Goal(
        name="Tables 2 and 3" if fit == "all" else "Controller 2 of Table 2",
        named={"fit": fit},
        runs=RUNS,
        joints=tuple(joints),
        values=np.reshape([number.value for number in numbers], shape),
        half=np.reshape([0.5 * 10.0**-number.decimals for number in numbers], shape),
        fitted=np.broadcast_to(fitted[:, np.newaxis, np.newaxis], shape),
        of_paper=True,
    )


def goal_of(
    loaded: LoadedEnsemble,
    errors: Path | None,
    window: Window = "whole",
    fit: Target = "all",
    laws: Sequence[str] = (),
) -> Goal:
    """Numbers of a user, or else of the paper, which has none of an own arm or of own `laws`."""
    if errors is not None:
        return own_numbers(errors, loaded, window, laws)
    if laws or loaded.around:
        message = f"there are no published errors of {'a law' if laws else 'an arm'} of your own"
        raise UsageError(message, where="--errors", hint="name a table of errors that you measured")
    return printed_numbers(published(), loaded.compare.joints, fit)


def with_input(loaded: LoadedEnsemble, errors: Path | None) -> LoadedEnsemble:
    """Plants whose manifest tells the file of a user's numbers, too."""
    if errors is None:
        return loaded
    file = errors / TRACES if errors.is_dir() else errors
    return replace(loaded, base=replace(loaded.base, inputs=(*loaded.base.inputs, file)))


def own_numbers(path: Path, loaded: LoadedEnsemble, window: Window, laws: Sequence[str] = ()) -> Goal:
    """Errors of a table, or of the runs of a trace file or of a folder with one.

    Runs are those of the comparison, and of a user's `laws`.

    Raises
    ------
    UsageError
        For a column, run, metric, joint or value that cannot be, a number twice, and none at all.
    DataMissingError
        Where the trace file is absent or damaged.
    """
    is_log = path.is_dir() or path.suffix == ".h5"
    known = (*loaded.compare.runs, *laws)
    numbers = _of_traces(path, loaded, window, known) if is_log else _of_table(path, loaded, known)
    if not numbers:
        raise UsageError("holds no errors to fit", where=str(path), hint=_HINT)
    joints = tuple(loaded.compare.joints)
    runs = tuple(run for run in known if any(run == own for own, _, _ in numbers))
    every = [
        [[numbers.get((run, metric, joint), (np.nan, np.nan)) for joint in joints] for metric in METRICS]
        for run in runs
    ]
    values, half = np.moveaxis(np.array(every), -1, 0)
    fitted = np.isfinite(values)
    return Goal(path.name, {"errors": path.name}, runs, joints, values, half, fitted)


def _of_traces(path: Path, loaded: LoadedEnsemble, window: Window, runs: Sequence[str]) -> _Numbers:
    """Errors as `compare` computes them, of runs and joints that the comparison has."""
    numbers: _Numbers = {}
    file = read_traces(path).part("compare")
    seconds = START if window == "settled" else 0.0
    name = "after_first_period" if window == "late" else without_start_name(seconds)
    for run, trace in file.runs.items():
        if run not in runs or "e" not in trace:
            continue
        if trace.status == "diverged":
            raise UsageError(f"the run {run} diverged, and has no errors to fit", where=str(path))
        sizes = tracking_errors(trace).get(name)
        if sizes is None:
            message = f"the run {run} has no errors {name.replace('_', ' ')}"
            raise DataMissingError(message, where=str(path), hint="say --window whole")
        for metric in METRICS:
            for joint, value in zip(trace.joint, sizes[f"{metric}_deg"], strict=True):
                if joint in loaded.compare.joints and value > 0.0:
                    numbers[run, metric, joint] = float(value), np.nan
    return numbers


def _of_table(path: Path, loaded: LoadedEnsemble, runs: Sequence[str]) -> _Numbers:
    """Numbers of a table with a row for each run and joint."""
    lines = csv.DictReader(read_text(path, "name a table of errors, or a folder with traces").splitlines())
    lines.fieldnames = columns = [name.strip() for name in lines.fieldnames or ()]
    joints = [str(number) for number in loaded.compare.joints]
    numbers: _Numbers = {}

    def wrong(message: str, hint: str) -> UsageError:
        return UsageError(message, where=f"{path}:{max(lines.line_num, 1)}", hint=hint)

    def positive(text: str, column: str) -> Decimal:
        try:
            value = Decimal(text)
        except InvalidOperation:
            value = Decimal(0)
        if not (value.is_finite() and value > 0):
            message = f"{column}: must be a number of degrees above 0, found {text!r}"
            raise wrong(message, "leave out what was not measured")
        return value

    allowed = (*COLUMNS, "half_deg")
    if unknown := [name for name in columns if name not in allowed]:
        raise wrong(f"no column is called {unknown[0]!r}{did_you_mean(unknown[0], allowed)}", _HINT)
    for needed in ({"run"}, {"joint"}, {"mae_deg", "rmse_deg"}):
        if not needed & {*columns}:
            raise wrong(f"there is no column {' or '.join(sorted(needed))}", _HINT)
    for row in lines:
        if None in row:
            message = f"has more cells than the {len(columns)} of the heading"
            raise wrong(message, "write 0.25 with a point, and a comma between cells")
        cells = {name: (cell or "").strip() for name, cell in row.items()}
        run, joint = cells["run"], cells["joint"]
        for kind, name, names in (("run", run, runs), ("moving joint", joint, joints)):
            if name not in names:
                message = f"{loaded.base.origin} has no {kind} {name!r}{did_you_mean(name, names)}"
                raise wrong(message, f"There are: {', '.join(names)}")
        half = cells.get("half_deg") and float(positive(cells["half_deg"], "half_deg"))
        for metric in METRICS:
            if text := cells.get(f"{metric}_deg"):
                key, value = (run, metric, int(joint)), positive(text, f"{metric}_deg")
                if key in numbers:
                    raise wrong(f"{metric} of {run}, joint {joint}, stands twice", "delete one of the two")
                numbers[key] = float(value), half or _half_unit(value)
    return numbers


def _half_unit(value: Decimal) -> float:
    """Half a unit of the last digit that is written; NaN of a number that nobody rounded."""
    exponent = value.as_tuple().exponent
    assert isinstance(exponent, int)
    return 0.5 * 10.0**exponent if exponent >= -_ROUNDED else np.nan


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
