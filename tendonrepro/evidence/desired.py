"""The desired motion of a log, with its derivatives, where the recorder kept few digits.

Second differences of rounded angles are mostly rounding: 0.001 deg at 1 kHz makes 7 rad/s². A spline through
the motion has a thousandth of that. Where the motion bends faster than the spline can, nothing is said.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.experiment import MOST_SAMPLES
from tendonrepro.console import count_of
from tendonrepro.dataset.motion import RecordedMotion, rounding_step, smoothed
from tendonrepro.errors import DataMissingError
from tendonrepro.results.records import Trace

_BEYOND = 0.75
"""Steps of rounding by which a record may be off its spline."""
_NEAR = 2.0
"""Spacings of knots around such a place that are left out."""
LEAST = 16
"""Samples below which a run has none with all that a controller remembers."""


def desired_motion(trace: Trace, L: float) -> tuple[Array, Array, Array]:
    """Desired angle, velocity and acceleration, (T, n), NaN where they cannot be told.

    Recorded derivatives are taken as they are. Of an angle with all digits they are differences, and of a
    rounded one those of a spline.
    """
    q_d = trace["q_d"]
    if "dq_d" in trace and "ddq_d" in trace:
        return q_d, trace["dq_d"], trace["ddq_d"]
    motions = [_of_one(column, trace.time, L) for column in q_d.T]
    angle, rate, acceleration = (np.column_stack(parts) for parts in zip(*motions, strict=True))
    return angle, trace.variables.get("dq_d", rate), acceleration


def _of_one(q_d: Array, time: Array, L: float) -> tuple[Array, Array, Array]:
    known = np.isfinite(q_d)
    rounding = rounding_step(q_d[known]) if known.sum() > 1 else 0.0
    if not rounding:
        rate = np.gradient(q_d, L)
        return q_d, rate, np.gradient(rate, L)
    # Before the first motion and after the last the angle stands; there the spline would swing.
    even = time[0] + L * np.arange(round(float(time[-1] - time[0]) / L) + 1)
    filled = np.interp(even, time[known], q_d[known])
    record = RecordedMotion(even - even[0], (filled - filled[0])[:, np.newaxis], (0,), filled[:1], rounding)
    spline, spacing = smoothed(record, least=0.0)
    at = time - even[0]
    angle, rate, acceleration = (spline(at, k)[:, 0] for k in range(3))
    off = np.abs(angle + filled[0] - q_d) > _BEYOND * rounding
    unknown = _around(off | ~known, round(_NEAR * spacing / L))
    rate, acceleration = (np.where(unknown, np.nan, values) for values in (rate, acceleration))
    return np.where(off, q_d, angle + filled[0]), rate, acceleration


def _around(places: NDArray[np.bool_], samples: int) -> NDArray[np.bool_]:
    counts = np.convolve(places.astype(float), np.ones(2 * samples + 1), mode="same")
    return np.asarray(counts[: len(places)] > 0.5)


def on_its_samples(trace: Trace) -> tuple[Trace, float]:
    """The run on the controller's even samples, NaN where one was lost, and their period, s.

    A recorder's clock may jitter; the controller's is taken as even.

    Raises
    ------
    DataMissingError
        If the run has fewer than `LEAST` samples, or a pause in which more are lost than a run can have.
    """
    if len(trace.time) < LEAST:
        message = f"run {trace.name!r} is too short to tell: {count_of(len(trace.time), 'sample')}"
        raise DataMissingError(message, hint="record a longer run")
    steps = np.diff(trace.time)
    L = float(np.median(steps))
    place = np.concatenate([[0], np.cumsum(np.maximum(np.round(steps / L), 1.0))]).astype(np.int64)
    if place[-1] + 1 - len(trace.time) > MOST_SAMPLES:
        longest = int(np.argmax(steps))
        pause = f"a pause of {steps[longest]:.0f} s after {trace.time[longest]:.3f} s"
        hint = "take one side of it: from_s or to_s of the run in the mapping, then ingest again"
        raise DataMissingError(f"run {trace.name!r} has {pause}, too long to fill", hint=hint)
    # Of many samples the mean tells the period better than one step does.
    L = float((trace.time[-1] - trace.time[0]) / place[-1])
    if place[-1] + 1 == len(trace.time):
        return trace, L
    variables = {}
    for name, values in trace.variables.items():
        variables[name] = np.full((place[-1] + 1, values.shape[1]), np.nan)
        variables[name][place] = values
    time = trace.time[0] + L * np.arange(place[-1] + 1.0)
    return replace(trace, time=time, variables=variables), L
