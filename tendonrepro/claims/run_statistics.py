"""Statistics of a whole recorded run, by the definitions of the streamed ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tendonrepro.arrays import Array
from tendonrepro.config.published import COMPARED
from tendonrepro.physics.control import Law, surface_and_feedback
from tendonrepro.results.records import Trace
from tendonrepro.simulation.streaming import PHASES, Thresholds, thresholds

RATE_WINDOW = 0.05
"""Time over which the rate of a measured error is taken, s."""


def statistics_of(trace: Trace, rates: tuple[Array, Array] | None) -> dict[str, Array]:
    """Statistics that rest on e, s, H_hat, tau_m and the phases of the desired motion, (n,) each, SI.

    By the names of `streaming.STATISTICS`, those that the recorded signals allow; NaN where a phase has no
    sample. Samples that are missing are left out one by one. Without `rates`, the desired velocity and
    acceleration (T, n), there are no phases.
    """
    found: dict[str, Array] = {}
    s = sliding_variable(trace)
    if s is not None:
        found["s_rms"] = _rms(s)
    if "tau_m" in trace:
        found["torque_step_rms"] = _rms(np.diff(trace["tau_m"], axis=0))
    L = _step(trace.time)
    phases = thresholds(*(rates or (np.zeros((1, 1)), np.zeros((1, 1)))), L)
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
    for column, place in _printed_places(trace).items():
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
    from tendonrepro.config.load import CompareConfig, load_config
    from tendonrepro.experiments.loops import build_law

    config = load_config(None, "compare").config
    if not isinstance(config, CompareConfig) or run not in config.runs:
        return None
    return build_law(config, config.runs[run].law)


def _printed_places(trace: Trace) -> dict[int, int]:
    """Columns of a run that have printed gains, and their place among joints 2 and 3."""
    return {column: COMPARED.index(joint) for column, joint in enumerate(trace.joint) if joint in COMPARED}


def _rms(values: Array) -> Array:
    return np.sqrt(_mean(np.square(values), np.ones(values.shape, dtype=bool)))


def _mean(values: Array, inside: NDArray[np.bool_]) -> Array:
    """Mean over the samples of a phase that are there, (n,)."""
    kept = inside & np.isfinite(values)
    count = kept.sum(axis=0)
    total = np.where(kept, values, 0.0).sum(axis=0)
    mean: Array = np.divide(total, count, out=np.full(values.shape[1], np.nan), where=count > 0)
    return mean
