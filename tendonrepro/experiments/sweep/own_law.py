"""A law of the user's own at one point of a sweep: by SciPy, measured as the batch measures the others."""

from __future__ import annotations

from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.experiments.loops import all_loops
from tendonrepro.experiments.run import simulate_run
from tendonrepro.experiments.sweep.report import COLUMNS
from tendonrepro.experiments.user_law import UserLaw
from tendonrepro.physics.metrics import mae, max_abs, periodogram, rmse
from tendonrepro.results.records import Trace
from tendonrepro.simulation.stepper import Loop
from tendonrepro.simulation.streaming import AT_LIMIT, MOVING, RESTING


def own_run(piece: tuple[LoadedConfig, UserLaw]) -> dict[str, Any]:
    """Simulate a point's law; return what a sweep keeps of a run."""
    loaded, law = piece
    trace = simulate_run(loaded, law, law.name)
    found = _statistics(trace, all_loops(loaded, law)[law.name], loaded.config.status.ringing_frequency.si)
    head = {
        "status": trace.attributes["status"],
        "status_time_s": trace.attributes["status_time"],
        "steps_per_sample": None,
    }
    return head | {name: (factor * found[key]).tolist() for name, (key, _, factor) in COLUMNS.items()}


def _statistics(trace: Trace, loop: Loop, ringing_frequency: float) -> dict[str, Array]:
    """Those statistics of `tendonrepro.simulation.streaming` that a sweep shows, of a whole trace."""
    e, tau = trace["e"], trace["tau_m"]
    if len(e) < 2:
        return {key: np.full(e.shape[1], np.nan) for key, _, _ in COLUMNS.values()}
    frequency, power = periodogram(e, loop.L)
    limit = AT_LIMIT * loop.actuator.limit
    return {
        "mae": mae(e),
        "rmse": rmse(e),
        "max_error": max_abs(e),
        "overshoot": _overshoot(e, trace["dq_d"], np.abs(loop.reference.dq_d).max(axis=0)),
        "s_rms": rmse(trace["s"]),
        "torque_rms": rmse(tau),
        "torque_step_rms": rmse(np.diff(tau, axis=0)),
        "H_hat_rms": rmse(trace["H_hat"]),
        "epsilon_rms": rmse(trace["epsilon"][:-1]),
        "saturated": (np.abs(tau @ loop.plant.drive.S) >= limit).mean(axis=0),
        "fast_share": power[frequency > ringing_frequency].sum(axis=0) / power.sum(axis=0),
    }


def _overshoot(e: Array, dq_d: Array, peak: Array) -> Array:
    """Largest error past the target, in the direction of the last stroke, while the reference rests."""
    samples = np.arange(len(e))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(np.abs(dq_d) > MOVING * peak, samples, 0), axis=0)
    direction = np.sign(np.take_along_axis(dq_d, last, axis=0))
    resting = np.abs(dq_d) <= RESTING * peak
    return np.asarray(np.where(resting, -direction * e, 0.0).max(axis=0))
