"""Statistics of one run, SI, as `tendonrepro.simulation.streaming` has them of many."""

from __future__ import annotations

from itertools import accumulate
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae, max_abs, rmse
from tendonrepro.results.records import Trace
from tendonrepro.simulation import streaming

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
    during: dict[str, NDArray[np.bool_] | bool] = {"": True}
    if rates is not None:
        rapid = np.abs(rates[1]) > phases.acceleration
        during |= {"_up": rates[0] > phases.speed, "_down": rates[0] < -phases.speed}
        during |= {"_rapid": rapid, "_calm": ~rapid}
    signals = _signals(trace, rates, phases)
    return {
        name: _SIZES[how](signals[of], during[phase])
        for name, (how, of, phase) in streaming.MEASURES.items()
        if of in signals and phase in during
    }


_SIZES = {"mean": mae, "rms": rmse, "peak": max_abs}


def _signals(trace: Trace, rates: _Rates | None, phases: streaming.Thresholds) -> dict[str, Array]:
    """What `streaming.MEASURES` are of, as far as the run has it."""
    variables = {"e": "e", "s": "s", "epsilon": "epsilon", "tau": "tau_m", "H": "H_hat"}
    signals = {name: trace[variable] for name, variable in variables.items() if variable in trace}
    for name in streaming.SLOWED:
        if name in signals:
            signals[f"slow_{name}"] = _slow(signals[name], float(phases.newest))
    if "epsilon" in signals:
        # The last sample's is not known yet. Before the first there is no estimate that could err.
        known = np.vstack([np.zeros_like(trace["epsilon"][:1]), trace["epsilon"][:-1]])
        signals |= {"epsilon": known[1:], "slow_epsilon": _slow(known, float(phases.newest))[1:]}
    if "tau" in signals:
        signals["change"] = np.diff(signals["tau"], axis=0)
    if "e" in signals and rates is not None:
        signals["past"] = _past(signals["e"], rates[0], phases.speed / streaming.MOVING)
    return signals


def step_rms(torque: Array) -> Array:
    """RMS of a torque's steps from sample to sample, (n,)."""
    return rmse(np.diff(torque, axis=0))


def saturated(trace: Trace, S: Array, limit: Array) -> Array:
    """Share of the samples in which a motor gives its largest torque, (n,).

    `S` (n, n) is the coupling of the run's joints, `limit` the largest torque of each winch, N m.
    """
    return np.asarray((np.abs(trace["tau_m"] @ S) >= streaming.AT_LIMIT * limit).mean(axis=0))


def _past(e: Array, dq_d: Array, fastest: Array) -> Array:
    """Error past the target, in the direction of the last stroke, while the reference rests; else zero."""
    samples = np.arange(len(e))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(np.abs(dq_d) > streaming.MOVING * fastest, samples, 0), axis=0)
    direction = np.sign(np.take_along_axis(dq_d, last, axis=0))
    return np.where(np.abs(dq_d) <= streaming.RESTING * fastest, np.maximum(-direction * e, 0.0), 0.0)


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
