"""The numbers that a search fits: errors that the paper prints, or those of a user's table or log."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.control import RUNS, unloaded_run
from tendonrepro.configuration.published import METRICS, Published, published, row_of
from tendonrepro.configuration.strict_yaml import read_text
from tendonrepro.errors import DataMissingError, UsageError, did_you_mean
from tendonrepro.physics.metrics import START
from tendonrepro.results.paper_tables import COLUMNS
from tendonrepro.results.summary import tracking_errors, without_start_name
from tendonrepro.results.traces import TRACES, read_traces

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
