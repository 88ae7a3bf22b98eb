"""A measured comparison, and what the rules of the claims ask of it as of an ensemble of one plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import COMPARED, Published
from tendonrepro.dataset.motion import Reference, derivatives, recover, timing_of
from tendonrepro.dataset.windows import PrintedTables, try_windows
from tendonrepro.errors import DataMissingError
from tendonrepro.physics.control import Law, surface_and_feedback
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.simulation.streaming import PHASES, Thresholds, thresholds
from tendonrepro.verdicts.statements import LOADED

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
            self._kept[run] = statistics_of(trace, rates)
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
        table = "table3.with_load" if run == LOADED else f"table2.{run}"
        names = [f"{table}.{metric}.joint_{joint}" for joint in self.joints]
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


def statistics_of(trace: Trace, rates: tuple[Array, Array] | None) -> dict[str, Array]:
    """Statistics that rest on e, s, H_hat, tau_m and the phases of the desired motion, (n,) each, SI.

    By the names of `streaming.STATISTICS`, those that the recorded signals allow; NaN where a phase has no
    sample. Samples that are missing are left out one by one. Without `rates`, the desired velocity and
    acceleration (T, n), there are no phases.
    """
    found: dict[str, Array] = {}
    L, s = _step(trace.time), sliding_variable(trace)
    phases = thresholds(*(rates or (np.zeros((1, 1)), np.zeros((1, 1)))), L)
    if s is not None:
        found["s_rms"], found["s_slow_rms"] = _rms(s), _rms(_slow(s, float(phases.newest)))
    if "tau_m" in trace:
        found["torque_step_rms"] = _rms(np.diff(trace["tau_m"], axis=0))
    for name, variable in (("torque", "tau_m"), ("H_hat", "H_hat")):
        if variable in trace:
            found |= _sizes(name, trace[variable], _ways(trace[variable], rates, phases), phases)
    if rates is not None and "e" in trace:
        rapid = np.abs(rates[1]) > phases.acceleration
        size = np.abs(trace["e"])
        found |= {"mae_rapid": _mean(size, rapid), "mae_calm": _mean(size, ~rapid)}
    return found


def _ways(
    values: Array, rates: tuple[Array, Array] | None, phases: Thresholds
) -> dict[str, NDArray[np.bool_]]:
    """Samples of the whole run, and those moving up and down where that is known, by end of a name."""
    every = {PHASES[0]: np.ones(values.shape, dtype=bool)}
    if rates is None:
        return every
    return every | dict(zip(PHASES[1:], (rates[0] > phases.speed, rates[0] < -phases.speed), strict=True))


def _sizes(
    name: str, values: Array, ways: Mapping[str, NDArray[np.bool_]], phases: Thresholds
) -> dict[str, Array]:
    """RMS, peak and mean magnitude of the low-passed course in every phase."""
    size, slow = np.abs(values), np.abs(_slow(values, float(phases.newest)))
    found: dict[str, Array] = {}
    for way, inside in ways.items():
        there = np.where(inside & np.isfinite(values), size, -np.inf).max(axis=0)
        found |= {
            f"{name}_rms{way}": np.sqrt(_mean(size**2, inside)),
            f"{name}_peak{way}": np.where(np.isfinite(there), there, np.nan),
            f"{name}_slow{way}": _mean(slow, inside),
        }
    return found


def _slow(values: Array, newest: float) -> Array:
    """Columns after the first-order low-pass, from their first sample on; over missing ones it waits."""
    slow = np.full_like(values, np.nan)
    for i, column in enumerate(values.T):
        there = np.isfinite(column)
        if there.any():
            start = [(1.0 - newest) * column[there][0]]
            slow[there, i], _ = lfilter([newest], [1.0, newest - 1.0], column[there], zi=start)
    return slow


def _step(time: Array) -> float:
    """Time between samples, s; that of a rate's window where there is but one."""
    return float(np.median(np.diff(time))) if len(time) > 1 else RATE_WINDOW


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
    half = max(0.5 * RATE_WINDOW, _step(time))
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


def _rms(values: Array) -> Array:
    return np.sqrt(_mean(np.square(values), np.ones(values.shape, dtype=bool)))


def _mean(values: Array, inside: NDArray[np.bool_]) -> Array:
    """Mean over the samples of a phase that are there, (n,)."""
    kept = inside & np.isfinite(values)
    count = kept.sum(axis=0)
    total = np.where(kept, values, 0.0).sum(axis=0)
    return np.asarray(np.divide(total, count, out=np.full(values.shape[1], np.nan), where=count > 0))
