"""Statistics of one run, SI, as `tendonrepro.simulation.streaming` has them of many."""

from __future__ import annotations

from itertools import accumulate
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae, max_abs, mean, rmse
from tendonrepro.results.records import Trace
from tendonrepro.simulation import streaming

_SIGNALS = {"torque": "tau_m", "H_hat": "H_hat"}
"""Recorded variables of `streaming.SIGNALS`."""

_Rates: TypeAlias = tuple[Array, Array]
"""Desired velocity and acceleration, (T, n) each."""


def statistics(trace: Trace, rates: _Rates | None = None) -> dict[str, Array]:
    """Statistics that the signals of a run allow, SI, (n,) each; NaN where a phase has no sample.

    `tendonrepro.simulation.streaming` says what each means. Missing samples are left out one by one.

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
    numbers: dict[str, Array] = {}
    if "e" in trace:
        numbers |= _of_the_error(trace["e"], rates, phases)
    if "s" in trace:
        numbers |= {"s_rms": rmse(trace["s"]), "s_slow_rms": rmse(_slow(trace["s"], float(phases.newest)))}
    if "epsilon" in trace:
        # The last sample's is not known yet. Before the first there is no estimate that could err.
        known = trace["epsilon"][:-1]
        course = _slow(np.vstack([np.zeros_like(known[:1]), known]), float(phases.newest))[1:]
        numbers |= {"epsilon_rms": rmse(known), "epsilon_slow_rms": rmse(course)}
    if "tau_m" in trace:
        numbers["torque_step_rms"] = step_rms(trace["tau_m"])
    for name, variable in _SIGNALS.items():
        if variable in trace:
            numbers |= _sizes(name, trace[variable], rates, phases)
    return numbers


def step_rms(torque: Array) -> Array:
    """RMS of a torque's steps from sample to sample, (n,)."""
    return rmse(np.diff(torque, axis=0))


def saturated(trace: Trace, S: Array, limit: Array) -> Array:
    """Share of the samples in which a motor gives its largest torque, (n,).

    `S` (n, n) is the coupling of the run's joints, `limit` the largest torque of each winch, N m.
    """
    return np.asarray((np.abs(trace["tau_m"] @ S) >= streaming.AT_LIMIT * limit).mean(axis=0))


def _of_the_error(e: Array, rates: _Rates | None, phases: streaming.Thresholds) -> dict[str, Array]:
    numbers = {"mae": mae(e), "rmse": rmse(e), "max_error": max_abs(e)}
    if rates is not None:
        rapid = np.abs(rates[1]) > phases.acceleration
        numbers |= {"mae_rapid": mae(e, rapid), "mae_calm": mae(e, ~rapid)}
        numbers["overshoot"] = _overshoot(e, rates[0], phases.speed / streaming.MOVING)
    return numbers


def _overshoot(e: Array, dq_d: Array, fastest: Array) -> Array:
    """Largest error past the target, in the direction of the last stroke, while the reference rests."""
    samples = np.arange(len(e))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(np.abs(dq_d) > streaming.MOVING * fastest, samples, 0), axis=0)
    direction = np.sign(np.take_along_axis(dq_d, last, axis=0))
    resting = (np.abs(dq_d) <= streaming.RESTING * fastest) & np.isfinite(e)
    return np.asarray(np.where(resting, -direction * e, 0.0).max(axis=0))


def _sizes(name: str, values: Array, rates: _Rates | None, phases: streaming.Thresholds) -> dict[str, Array]:
    """RMS, peak and mean magnitude of the low-passed course in every phase, see `streaming.PHASES`."""
    samples = {"": np.ones(values.shape, dtype=bool)}
    if rates is not None:
        samples |= {"_up": rates[0] > phases.speed, "_down": rates[0] < -phases.speed}
    course = np.abs(_slow(values, float(phases.newest)))
    numbers: dict[str, Array] = {}
    for phase, inside in samples.items():
        numbers |= {
            f"{name}_rms{phase}": rmse(values, inside),
            f"{name}_peak{phase}": max_abs(values, inside),
            f"{name}_slow{phase}": mean(course, inside),
        }
    return numbers


def _slow(values: Array, newest: float) -> Array:
    """Columns (T, n) after the low-pass of `streaming.SLOW`; over missing samples it waits.

    `newest` is the weight of the newest sample.
    """
    filtered = np.full_like(values, np.nan)
    for i, column in enumerate(values.T):
        there = np.isfinite(column)
        known = column[there].tolist()
        # scipy.signal would do the same, but takes 30 MB.
        course = accumulate([*known[:1], *known], lambda old, new: newest * new + (1.0 - newest) * old)
        filtered[there, i] = [*course][1:]
    return filtered
