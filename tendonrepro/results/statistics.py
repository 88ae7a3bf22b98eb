"""Statistics of a recorded run, under the names that the batch stepper sums up.

:mod:`tendonrepro.simulation.streaming` says what each means. Missing samples are left out one by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae, max_abs, mean, rmse
from tendonrepro.results.records import Trace
from tendonrepro.simulation import streaming

VARIABLES = {"torque": "tau_m", "H_hat": "H_hat"}
"""Recorded variables of the signals whose size is asked for in every way."""

Rates = tuple[Array, Array]
"""Desired velocity and acceleration, (T, n) each."""

assert VARIABLES.keys() == streaming.SIGNALS.keys()


def statistics(trace: Trace, rates: Rates | None = None) -> dict[str, Array]:
    """Statistics that the signals of a run allow, SI, (n,) each; NaN where a phase has no sample.

    Parameters
    ----------
    trace : Trace
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
    newest = float(phases.newest)
    found: dict[str, Array] = {}
    if "e" in trace:
        found |= _of_the_error(trace["e"], rates, phases)
    for name in ("s", "epsilon"):
        if name in trace:
            # The estimation error of a sample is known one sample later.
            values = trace[name] if name == "s" else trace[name][:-1]
            found |= {f"{name}_rms": rmse(values), f"{name}_slow_rms": rmse(slow(values, newest))}
    if "tau_m" in trace:
        found["torque_step_rms"] = rmse(np.diff(trace["tau_m"], axis=0))
    for name, variable in VARIABLES.items():
        if variable in trace:
            found |= _sizes(name, trace[variable], _ways(trace[variable], rates, phases), newest)
    return found


def saturated(trace: Trace, S: Array, limit: Array) -> Array:
    """Share of the samples in which a motor gives its largest torque, (n,).

    Parameters
    ----------
    trace : Trace
    S : array (n, n)
        Coupling matrix of the run's joints.
    limit : array (n,)
        Largest torque of each winch, N m.
    """
    return np.asarray((np.abs(trace["tau_m"] @ S) >= streaming.AT_LIMIT * limit).mean(axis=0))


def error_sizes(e: Array) -> dict[str, Array]:
    """Mean absolute, root mean square and largest error of each joint, in the unit of `e`, (T, n).

    Returns
    -------
    dict
        ``mae``, ``rmse`` and ``max``, (n,) each.
    """
    return {"mae": mae(e), "rmse": rmse(e), "max": max_abs(e)}


def _of_the_error(e: Array, rates: Rates | None, phases: streaming.Thresholds) -> dict[str, Array]:
    size = error_sizes(e)
    found = {"mae": size["mae"], "rmse": size["rmse"], "max_error": size["max"]}
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


def _ways(values: Array, rates: Rates | None, phases: streaming.Thresholds) -> dict[str, NDArray[np.bool_]]:
    """Samples of the whole run, and those moving up and down where that is known, by end of a name."""
    every = {streaming.PHASES[0]: np.ones(values.shape, dtype=bool)}
    if rates is None:
        return every
    return every | dict(
        zip(streaming.PHASES[1:], (rates[0] > phases.speed, rates[0] < -phases.speed), strict=True)
    )


def _sizes(
    name: str, values: Array, ways: Mapping[str, NDArray[np.bool_]], newest: float
) -> dict[str, Array]:
    """RMS, peak and mean magnitude of the low-passed course in every phase."""
    course = np.abs(slow(values, newest))
    found: dict[str, Array] = {}
    for way, inside in ways.items():
        found |= {
            f"{name}_rms{way}": rmse(values, inside),
            f"{name}_peak{way}": max_abs(values, inside),
            f"{name}_slow{way}": mean(course, inside),
        }
    return found


def slow(values: Array, newest: float) -> Array:
    """Columns after the first-order low-pass of `streaming.SLOW`; over missing samples it waits.

    Parameters
    ----------
    values : array (T, n)
    newest : float
        Weight of the newest sample.
    """

    # scipy.signal would do the same, but takes 30 MB.
    def follow(before: float, value: float) -> float:
        return newest * value + (1.0 - newest) * before

    found = np.full_like(values, np.nan)
    for i, column in enumerate(values.T):
        there = np.isfinite(column)
        known = column[there].tolist()
        found[there, i] = [*accumulate(known, follow, initial=known[0])][1:] if known else []
    return found
