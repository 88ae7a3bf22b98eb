"""The arm of a measurement, as the rules see it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import COMPARED, METRICS
from tendonrepro.dataset.motion import derivatives
from tendonrepro.errors import DataMissingError
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.control import surface_and_feedback
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.records import Trace
from tendonrepro.results.statistics import statistics
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.formulas import ErrorOf
from tendonrepro.verdicts.measurement import Measurement
from tendonrepro.verdicts.plants import Plants, Run

RATE_WINDOW = 0.05
"""Time over which the rate of a measured error is taken, s."""

_SIGNALS = dict.fromkeys((*METRICS, "max"), ("e", "deg")) | {
    "s": ("s or e", "deg_per_s"),
    "torque": ("tau_m", "N_m"),
    "H": ("H_hat", "N_m"),
}
"""What a statistic is of and its unit as evidence, by the first word of its name."""


class MeasuredArm(Plants):
    """The one arm that was measured; `looked_up` are the statistics that were asked for, by run."""

    joints = COMPARED
    reading = PRINTED

    def __init__(self, measurement: Measurement) -> None:
        self._measurement = measurement
        self._kept: dict[str, dict[str, Array]] = {}
        self.looked_up: dict[str, dict[str, list[float]]] = {}

    def has(self, run: Run) -> bool:
        """Whether a run was measured."""
        return run in self._measurement.compare.runs

    def status(self, run: Run) -> NDArray[np.int8]:
        """Status code of a run, (1,)."""
        return np.array([STATUSES.index(self._trace(run).status)], dtype=np.int8)

    def statistic(self, run: Run, name: str) -> Array:
        """One statistic, SI, (1, 2)."""
        trace = self._trace(run)
        sizes = self._of_the_tables(trace, name) if name in METRICS else self._of_the_run(trace, name)
        _, unit = _signal(name)
        shown = sizes if unit == "N_m" else np.rad2deg(sizes)
        self.looked_up.setdefault(trace.name, {})[f"{name}_{unit}"] = shown.tolist()
        return sizes[np.newaxis]

    def _of_the_tables(self, trace: Trace, metric: str) -> Array:
        """An error over the window that decides, (2,)."""
        sizes = self._measurement.tables.deciding.sizes
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
                what = f"{_signal(name)[0]} of the run {trace.name}, joint {joint}"
                raise DataMissingError(f"{what}, or its desired motion q_d")
        return values

    def _trace(self, run: Run) -> Trace:
        measured = self._measurement.compare.runs.get(str(run))
        if measured is None:
            raise DataMissingError(f"a measured run {run}")
        trace = measured.of_joints(self.joints)
        if trace.joint != self.joints:
            raise DataMissingError(f"joints 2 and 3 of the run {run}")
        return trace

    def _check_alike(self, name: str) -> None:
        """Refuse to compare what was recorded differently."""
        if name == "torque_step_rms":
            steps = [float(np.median(np.diff(self._trace(run).time))) for run in CONTROLLERS]
            if max(steps) > 1.01 * min(steps):
                raise DataMissingError("runs sampled alike: steps of the torque cannot be compared otherwise")
        runs = self._measurement.compare.runs
        if name.startswith("s_") and len({"s" in runs[run] for run in CONTROLLERS if run in runs}) > 1:
            raise DataMissingError("s of all controllers: recorded and computed ones cannot be compared")


def _signal(statistic: str) -> tuple[str, str]:
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
