"""A measured comparison, and what the rules of the claims ask of it as of an ensemble of one plant."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import COMPARED, Published
from tendonrepro.dataset.motion import Reference, derivatives, recover, timing_of
from tendonrepro.dataset.windows import PrintedTables, try_windows
from tendonrepro.errors import DataMissingError
from tendonrepro.physics.control import Law, surface_and_feedback
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.statistics import statistics
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.numbers import ErrorOf

_DEG = float(np.rad2deg(1.0))
_UNITS = {"mae": ("deg", _DEG), "rmse": ("deg", _DEG), "s": ("deg_per_s", _DEG)}
_UNITS |= {"torque": ("N_m", 1.0), "H": ("N_m", 1.0)}
"""Unit of a statistic as evidence, by the first word of its name, and its size per SI unit."""

_SIGNALS = {"s": ("s", "e"), "torque": ("tau_m",), "H": ("H_hat",), "mae": ("e",)}
"""Signals of which a statistic needs one, by the first word of its name."""


@dataclass(frozen=True)
class Measured:
    """A measured file with what is derived from it once.

    Parameters
    ----------
    file : TraceFile
    tables : PrintedTables
        Ways of averaging that were tried.
    reference : Reference or None
        None where it could not be recovered.
    unrecovered : str
        Why it could not.
    """

    file: TraceFile
    tables: PrintedTables
    reference: Reference | None
    unrecovered: str = ""

    @cached_property
    def compare(self) -> TraceFile:
        """Runs of the comparison."""
        return self.file.part("compare")


def measured_of(file: TraceFile, paper: Published) -> Measured:
    """Recover the reference of a measured file and try every averaging window."""
    reference, unrecovered = None, ""
    try:
        reference = recover(file)
    except DataMissingError as error:
        unrecovered = f"{error.message}; {error.hint}" if error.hint else error.message
    tables = try_windows(file.part("compare"), paper, timing_of(file, reference))
    return Measured(file, tables, reference, unrecovered)


class OneArm:
    """A measured comparison with the interface of an ensemble of one plant."""

    joints = COMPARED
    alpha = (0.0, 0.0)
    names: tuple[str, ...] = ()
    readings = (PRINTED,)
    draws: Array = np.zeros((1, 0))
    replicate: NDArray[np.int64] = np.zeros(1, dtype=np.int64)

    def __init__(self, measured: Measured) -> None:
        self._measured = measured
        self._kept: dict[str, dict[str, Array]] = {}
        self.asked: dict[str, dict[str, list[float]]] = {}

    def has(self, run: str, reading: str) -> bool:
        """Whatever a rule asks for is looked up, so that what is missing can be named."""
        del run
        return reading == PRINTED

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Status code of a run, (1,)."""
        del reading
        return np.array([STATUSES.index(self._trace(run).status)], dtype=np.int8)

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One statistic, SI, (1, 2)."""
        del reading
        found = self._statistic(run, name)
        unit, factor = _UNITS[name.partition("_")[0]]
        self.asked.setdefault(run, {})[f"{name}_{unit}"] = (factor * found[0]).tolist()
        return found

    def _statistic(self, run: str, name: str) -> Array:
        trace = self._trace(run)
        if name in ("mae", "rmse"):
            return self._of_the_tables(run, name)
        if name == "torque_step_rms":
            self._check_steps()
        if name in ("s_rms", "s_slow_rms"):
            self._check_surfaces()
        if run not in self._kept:
            rates = None
            with suppress(DataMissingError):
                rates = derivatives(trace)
            self._kept[run] = statistics(with_surface(trace), rates)
        needed = _SIGNALS[name.partition("_")[0]]
        if name not in self._kept[run]:
            # A signal that is there lacks the phases of the motion.
            there = any(signal in trace for signal in needed)
            raise DataMissingError(self._absent(("q_d",) if there else needed, run))
        values = self._kept[run][name][[trace.joint.index(joint) for joint in self.joints]]
        for joint, value in zip(self.joints, values, strict=True):
            # What is not there is smaller than nothing, so it must not come to a comparison.
            if not np.isfinite(value):
                what = f"{' or '.join(needed)} of joint {joint} of the run {run}"
                raise DataMissingError(f"{what}, or samples of it in a phase of the motion")
        return values[np.newaxis]

    def _trace(self, run: str) -> Trace:
        runs = self._measured.compare.runs
        if run not in runs:
            raise DataMissingError(f"a measured run {run}")
        absent = [joint for joint in self.joints if joint not in runs[run].joint]
        if absent:
            raise DataMissingError(f"joint {absent[0]} of the run {run}")
        # Another joint may have been recorded at rest, without what the comparison is about.
        return runs[run].of_joints(self.joints)

    def _of_the_tables(self, run: str, metric: str) -> Array:
        deciding = self._measured.tables.deciding
        names = [ErrorOf(run, metric, joint).id for joint in self.joints]
        sizes = deciding.sizes if deciding else {}
        if not all(np.isfinite(sizes.get(name, np.nan)) for name in names):
            raise DataMissingError(f"the tracking error of the run {run}")
        return np.deg2rad([[sizes[name] for name in names]])

    def _absent(self, signals: Sequence[str], run: str) -> str:
        """Name signals of a run, and of all controllers that hold none of them."""
        runs = self._measured.compare.runs
        others = [name for name in CONTROLLERS if name in runs and not {*signals} & {*runs[name].variables}]
        # What was recorded but holds too little is a matter of this run alone.
        lacking = others if run in others else [run]
        return f"{' or '.join(signals)} of the run" + "s" * (len(lacking) > 1) + f" {', '.join(lacking)}"

    def _check_steps(self) -> None:
        steps = [float(np.median(np.diff(self._trace(run).time))) for run in CONTROLLERS]
        if max(steps) > 1.01 * min(steps):
            raise DataMissingError("runs sampled alike: steps of the torque cannot be compared otherwise")

    def _check_surfaces(self) -> None:
        runs = self._measured.compare.runs
        recorded = ["s" in runs[run] for run in CONTROLLERS if run in runs]
        if any(recorded) and not all(recorded):
            message = "s of all controllers: a recorded one cannot be compared with a computed one"
            raise DataMissingError(message)


RATE_WINDOW = 0.05
"""Time over which the rate of a measured error is taken, s."""


def with_surface(trace: Trace) -> Trace:
    """The run with its sliding variable, recorded or computed, where there is one."""
    s = sliding_variable(trace)
    return trace if s is None else replace(trace, variables={**trace.variables, "s": s})


def sliding_variable(trace: Trace) -> Array | None:
    """Recorded sliding variable, (T, n), else that of Eq. (11) with the printed gains; None without e.

    From sample to sample an encoder's steps are all there is of a rate, so that of a computed one is the
    difference over `RATE_WINDOW`; half of it is missing at both ends.
    """
    if "s" in trace:
        return trace["s"]
    law = _law_of(trace.name)
    if law is None or "e" not in trace:
        return None
    e = trace["e"]
    rate = _rate(trace.time, e)
    s = np.full_like(e, np.nan)
    for column, joint in enumerate(trace.joint):
        if joint in COMPARED:
            place = COMPARED.index(joint)
            s[:, column], _ = surface_and_feedback(e[:, column], rate[:, column], law, place)
    return s


def _rate(time: Array, e: Array) -> Array:
    """Difference over `RATE_WINDOW` around each sample, (T, n), or over two steps where these are longer.

    Between samples the error is interpolated, so that runs sampled differently have the same window.
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else RATE_WINDOW
    half = max(0.5 * RATE_WINDOW, step)
    ends = [
        np.stack([np.interp(time + apart, time, column, np.nan, np.nan) for column in e.T], axis=1)
        for apart in (-half, half)
    ]
    return np.asarray((ends[1] - ends[0]) / (2.0 * half))


def _law_of(run: str) -> Law | None:
    """Law of a run of the comparison, with the gains and readings of the shipped configuration."""
    from tendonrepro.configuration.load import CompareConfig, load_config
    from tendonrepro.experiments.loops import build_law

    config = load_config(None, "compare").config
    if not isinstance(config, CompareConfig) or run not in config.runs:
        return None
    return build_law(config, config.runs[run].law)
