"""A measured trace file as a table of one plant, and what else follows from it: its motion, its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import COMPARED, METRICS, Published
from tendonrepro.dataset.motion import Reference, derivatives, recover_reference, timing_of
from tendonrepro.dataset.windows import NO_TABLES, PrintedTables, Timing, try_windows
from tendonrepro.errors import DataMissingError, UsageError, did_you_mean
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.control import surface_and_feedback
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.statistics import statistics
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.traces import read_traces
from tendonrepro.verdicts.formulas import ErrorOf

_THE_WAY = "make it by tendonrepro fetch, inspect --suggest, and ingest"
RATE_WINDOW = 0.05
"""Time over which the rate of a measured error is taken, s."""

_SIGNALS = dict.fromkeys((*METRICS, "max"), ("e", "deg")) | {
    "s": ("s or e", "deg_per_s"),
    "torque": ("tau_m", "N_m"),
    "H": ("H_hat", "N_m"),
}
"""What a statistic is of and its unit as evidence, by the first word of its name."""


def read_measured(path: Path) -> TraceFile:
    """Read a measured trace file.

    Raises
    ------
    DataMissingError
        If there is none or it cannot be read.
    UsageError
        If it is simulated, or holds no run.
    """
    try:
        file = read_traces(path)
    except DataMissingError as error:
        if path.exists():
            raise
        meant = did_you_mean(path.name, (other.name for other in path.parent.glob("*.h5")))
        raise DataMissingError(
            f"there is no measured trace file{meant}", where=str(path), hint=_THE_WAY
        ) from error
    if file.source != "measured":
        raise UsageError("holds simulated traces, not measured ones", where=str(path), hint=_THE_WAY)
    if not file.runs:
        raise UsageError("holds no runs", where=str(path), hint="name them under runs of the mapping")
    return file


@dataclass(frozen=True)
class Measurement:
    """A measured file and what follows from it: a table of one plant, the arm that was measured.

    `unrecovered` says why there is no `reference`. `timing` is of every run of the comparison.
    """

    file: TraceFile
    tables: PrintedTables
    reference: Reference | None
    unrecovered: str = ""
    timing: Mapping[str, Timing] = field(default_factory=dict)
    joints: ClassVar[tuple[int, ...]] = COMPARED
    replicate: ClassVar[NDArray[np.int64]] = np.zeros(1, np.int64)
    _kept: dict[str, dict[str, Array]] = field(default_factory=dict, repr=False)

    @cached_property
    def compare(self) -> TraceFile:
        """Its runs of the comparison."""
        return self.file.part("compare")

    def has(self, run: str, reading: str) -> bool:
        """Whether a run was measured; nobody measured it under another reading."""
        return reading == PRINTED and run in self.compare.runs

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Status code of a run, (1,)."""
        return np.array([STATUSES.index(self._trace(run, reading).status)], dtype=np.int8)

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One statistic, SI, (1, 2): an error over the window that decides, another over the whole run."""
        trace = self._trace(run, reading)
        sizes = self._of_the_tables(trace, name) if name in METRICS else self._of_the_run(trace, name)
        return sizes[np.newaxis]

    def _of_the_tables(self, trace: Trace, metric: str) -> Array:
        """An error over the window that decides, (2,)."""
        sizes = self.tables.deciding.sizes
        errors = [sizes.get(ErrorOf(trace.name, metric, joint).id, np.nan) for joint in self.joints]
        if not np.isfinite(errors).all():
            raise DataMissingError(f"the tracking error of the run {trace.name}")
        return np.deg2rad(errors)

    def _of_the_run(self, trace: Trace, name: str) -> Array:
        """A statistic over the whole run, (2,)."""
        self._check_alike(name)
        if trace.name not in self._kept:
            rates = None
            with suppress(DataMissingError):
                rates = derivatives(trace)
            self._kept[trace.name] = statistics(with_surface(trace), rates)
        values = self._kept[trace.name].get(name, np.full(len(self.joints), np.nan))
        for joint, value in zip(trace.joint, values, strict=True):
            # NaN is smaller than nothing, so it must not come to a comparison.
            if not np.isfinite(value):
                what = f"{signal_of(name)[0]} of the run {trace.name}, joint {joint}"
                raise DataMissingError(f"{what}, or its desired motion q_d")
        return values

    def _trace(self, run: str, reading: str = PRINTED) -> Trace:
        if not self.has(run, reading):
            raise DataMissingError(f"a measured run {run if reading == PRINTED else f'{run}@{reading}'}")
        trace = self.compare.runs[run].of_joints(self.joints)
        if trace.joint != self.joints:
            raise DataMissingError(f"joints 2 and 3 of the run {run}")
        return trace

    def _check_alike(self, name: str) -> None:
        """Refuse to compare what was recorded differently."""
        if name == "torque_step_rms":
            steps = [float(np.median(np.diff(self._trace(run).time))) for run in CONTROLLERS]
            if max(steps) > 1.01 * min(steps):
                raise DataMissingError("runs sampled alike: steps of the torque cannot be compared otherwise")
        runs = self.compare.runs
        if name.startswith("s_") and len({"s" in runs[run] for run in CONTROLLERS if run in runs}) > 1:
            raise DataMissingError("s of all controllers: recorded and computed ones cannot be compared")


def measurement_of(file: TraceFile, paper: Published | None, joints: Sequence[int] = COMPARED) -> Measurement:
    """Recover the reference of these joints; try every averaging window, where a paper prints errors."""
    reference, unrecovered = None, ""
    try:
        reference = recover_reference(file, joints)
    except DataMissingError as error:
        unrecovered = f"{error.message}; {error.hint}" if error.hint else error.message
    timing = timing_of(file, reference)
    tables = try_windows(file.part("compare"), paper, timing) if paper else NO_TABLES
    return Measurement(file, tables, reference, unrecovered, timing)


def signal_of(statistic: str) -> tuple[str, str]:
    """What a statistic is of, and its unit as evidence."""
    return _SIGNALS[statistic.partition("_")[0]]


def with_surface(trace: Trace) -> Trace:
    """The run of joints 2 and 3 with its sliding variable: recorded, else by Eq. (11) from its error.

    A rate from sample to sample shows the encoder's steps. So it is taken over `RATE_WINDOW`, half of which
    is missing at both ends.
    """
    if "s" in trace or "e" not in trace:
        return trace
    config = load_config(None, "compare").config
    assert isinstance(config, CompareConfig)
    law, e = build_law(config, config.runs[trace.name].law), trace["e"]
    rate = _rate(trace.time, e)
    surfaces = [surface_and_feedback(e[:, i], rate[:, i], law, i)[0] for i in range(len(trace.joint))]
    return replace(trace, variables={**trace.variables, "s": np.stack(surfaces, axis=1)})


def _rate(time: Array, e: Array) -> Array:
    """Difference over `RATE_WINDOW`, or two longer steps, (T, n)."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else RATE_WINDOW
    half = max(0.5 * RATE_WINDOW, step)
    ends = [
        np.stack([np.interp(time + apart, time, column, np.nan, np.nan) for column in e.T], axis=1)
        for apart in (-half, half)
    ]
    return np.asarray((ends[1] - ends[0]) / (2.0 * half))
