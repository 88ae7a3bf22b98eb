"""Statistics of a recorded run, under the names that the batch stepper sums up.

:mod:`tendonrepro.simulation.streaming` says what each means. Missing samples are left out one by one.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae, max_abs, mean, rmse
from tendonrepro.results.records import Trace
from tendonrepro.simulation import streaming

VARIABLES = {"torque": "tau_m", "H_hat": "H_hat"}
"""Recorded variables of `streaming.SIGNALS`."""

Rates = tuple[Array, Array]
"""Desired velocity and acceleration, (T, n) each."""


def statistics(trace: Trace, rates: Rates | None = None) -> dict[str, Array]:
    """Statistics that the signals of a run allow, SI, (n,) each; NaN where a phase has no sample.

    Parameters
    ----------
    rates : tuple of array (T, n), optional
        Desired velocity and acceleration, else those of the run; without any there are no phases.

    Returns
    -------
    dict
        By names of `streaming.STATISTICS`.
    """
    if rates is None and "dq_d" in trace and "ddq_d" in trace:
        rates = trace["dq_d"], trace["ddq_d"]
    L = float(np.median(np.diff(trace.time))) if len(trace.time) > 1 else np.inf
    phases = streaming.thresholds(*(rates or (np.zeros((1, 1)), np.zeros((1, 1)))), L)
    found: dict[str, Array] = {}
    if "e" in trace:
        found |= _of_the_error(trace["e"], rates, phases)
    for name in ("s", "epsilon"):
        if name in trace:
            # The estimation error of a sample is known one sample later.
            values = trace[name] if name == "s" else trace[name][:-1]
            course = slow(values, float(phases.newest))
            found |= {f"{name}_rms": rmse(values), f"{name}_slow_rms": rmse(course)}
    if "tau_m" in trace:
        found["torque_step_rms"] = rmse(np.diff(trace["tau_m"], axis=0))
    for name, variable in VARIABLES.items():
        if variable in trace:
            found |= _sizes(name, trace[variable], rates, phases)
    return found


def saturated(trace: Trace, S: Array, limit: Array) -> Array:
    """Share of the samples in which a motor gives its largest torque, (n,).

    `S` (n, n) is the coupling of the run's joints, `limit` the largest torque of each winch, N m.
    """
    return np.asarray((np.abs(trace["tau_m"] @ S) >= streaming.AT_LIMIT * limit).mean(axis=0))


def _of_the_error(e: Array, rates: Rates | None, phases: streaming.Thresholds) -> dict[str, Array]:
    found = {"mae": mae(e), "rmse": rmse(e), "max_error": max_abs(e)}
    if rates is not None:
        rapid = np.abs(rates[1]) > phases.acceleration
        found |= {"mae_rapid": mae(e, rapid), "mae_calm": mae(e, ~rapid)}
        found["overshoot"] = _overshoot(e, rates[0], phases.speed / streaming.MOVING)
    return found


def _overshoot(e: Array, dq_d: Array, fastest: Array) -> Array:
    """Largest error past the target, in the direction of the last stroke, while the reference rests."""
    samples = np.arange(len(e))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(np.abs(dq_d) > streaming.MOVING * fastest, samples, 0), axis=0)
    direction = np.sign(np.take_along_axis(dq_d, last, axis=0))
    resting = (np.abs(dq_d) <= streaming.RESTING * fastest) & np.isfinite(e)
    return np.asarray(np.where(resting, -direction * e, 0.0).max(axis=0))


def _sizes(name: str, values: Array, rates: Rates | None, phases: streaming.Thresholds) -> dict[str, Array]:
    """RMS, peak and mean magnitude of the low-passed course in every phase, see `streaming.PHASES`."""
    samples = {"": np.ones(values.shape, dtype=bool)}
    if rates is not None:
        samples |= {"_up": rates[0] > phases.speed, "_down": rates[0] < -phases.speed}
    course = np.abs(slow(values, float(phases.newest)))
    found: dict[str, Array] = {}
    for phase, inside in samples.items():
        found |= {
            f"{name}_rms{phase}": rmse(values, inside),
            f"{name}_peak{phase}": max_abs(values, inside),
            f"{name}_slow{phase}": mean(course, inside),
        }
    return found


def slow(values: Array, newest: float) -> Array:
    """Columns (T, n) after the low-pass of `streaming.SLOW`; over missing samples it waits.

    `newest` is the weight of the newest sample.
    """
    found = np.full_like(values, np.nan)
    for i, column in enumerate(values.T):
        there = np.isfinite(column)
        known = column[there].tolist()
        # scipy.signal would do the same, but takes 30 MB.
        course = accumulate([*known[:1], *known], lambda old, new: newest * new + (1.0 - newest) * old)
        found[there, i] = [*course][1:]
    return found
