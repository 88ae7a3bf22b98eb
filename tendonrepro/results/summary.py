"""Numbers of a trace file: errors in degrees, torques, tensions, rankings; a run's statistics and noise."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate, pairwise
from typing import Any, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST, LOADED, SECOND, THIRD
from tendonrepro.configuration.published import METRICS
from tendonrepro.physics.metrics import START, mae, max_abs, rmse, windows, without_start
from tendonrepro.physics.statics import slack_time, tendon_tension
from tendonrepro.results.records import Trace, TraceFile, median_step
from tendonrepro.simulation import streaming

CONTROLLERS = (FIRST, SECOND, THIRD)
"""The compared runs, in the order in which the paper ranks them."""
PAIRS = {"c1_c2": CONTROLLERS[:2], "c2_c3": CONTROLLERS[1:]}
"""Ratios by their keys, and the runs whose errors they compare."""
LOADS: Mapping[str, str] = {"no_load": FIRST, "with_load": LOADED}
"""The rows of Table 3 and their runs."""

USER_LAW = "user law "
"""Begins a run's ``law`` where that is a user's."""

NOISE = 0.02
"""Relative noise of a run's errors on a joint, one standard deviation.

Assumed, as the paper shows no repeated run. Simulated runs as published scatter about as much, root mean
square, when masses move by a millionth (docs/results/repeats.json).
"""

NOISE_OF_SHAPE = 0.25
"""Noise of RMSE/MAE over `NOISE`, assumed; in those repeats it is about a third."""

Sizes: TypeAlias = dict[str, Array]
_Rates: TypeAlias = tuple[Array, Array]
"""Desired velocity and acceleration, (T, n) each."""

ERRORS = ("mae_deg", "rmse_deg", "max_deg")


def sizes_deg(e: Array) -> Sizes:
    """``mae_deg``, ``rmse_deg`` and ``max_deg`` of each joint, (n,) each; missing samples are left out.

    `e` is the error, rad, (T, n).
    """
    degrees = np.rad2deg(e)
    return {"mae_deg": mae(degrees), "rmse_deg": rmse(degrees), "max_deg": max_abs(degrees)}


def errors_from(trace: Trace) -> float:
    """Seconds at the start of a run that its errors in tables leave out."""
    return float(trace.attributes.get("errors_from", 0.0))


def without_start_name(seconds: float) -> str:
    """Name of the window that leaves out so many seconds; ``whole`` for none."""
    return f"after_{seconds:g}_s" if seconds > 0.0 else "whole"


def tracking_errors(trace: Trace) -> dict[str, Sizes]:
    """Sizes of `e`, as `sizes_deg`, by every window of `metrics.windows`, and without the start.

    Left out are the seconds that the configuration says, and `metrics.START`. A diverged run has NaN in
    windows that go on to its end.
    """
    spans = windows(trace.time, trace.attributes["reference_period"])
    for seconds in (START, errors_from(trace)):
        span = without_start(trace.time, seconds)
        if seconds > 0.0 and span.start < span.stop:
            spans[without_start_name(seconds)] = span
    errors = {name: sizes_deg(trace["e"][span]) for name, span in spans.items()}
    if trace.status == "diverged":
        errors |= {name: _unknown(trace) for name in spans if not name.startswith("period")}
    return errors


def table_errors(trace: Trace) -> Sizes:
    """Sizes of `e` in the window of the tables; NaN of a run that ended before it."""
    return tracking_errors(trace).get(without_start_name(errors_from(trace)), _unknown(trace))


def _unknown(trace: Trace) -> Sizes:
    return dict.fromkeys(ERRORS, np.full(len(trace.joint), np.nan))


def decoupling_errors(trace: Trace) -> Sizes:
    """Sizes of ``q_calculated - q_encoder``, Figs 10 to 12, as `sizes_deg`."""
    return sizes_deg(trace["q_calculated"] - trace["q_encoder"])


def tensions(file: TraceFile, trace: Trace) -> Array:
    """Tension of each moving joint's tendon, N, (T, n); NaN where torque or routing is unknown.

    The compliance torque holds what tendon 4 adds.
    """
    if "tau_s" not in trace or not {"S", "winch_diameter"} <= file.plant.values.keys():
        return np.full((len(trace.time), len(trace.joint)), np.nan)
    S = file.plant.matrix("S", trace.joint)
    winch = file.plant.values["winch_diameter"].value[np.array(trace.joint) - 1]
    return tendon_tension(trace["tau_s"].T, S, winch).T


def tension_sizes(file: TraceFile, trace: Trace) -> Sizes:
    """``least_N``, the smallest tension of each tendon, ``at_s`` its time, ``slack_s`` how long it is slack.

    Empty where tensions are unknown.
    """
    whole = tensions(file, trace)
    kept = np.isfinite(whole).all(axis=1)
    if not kept.any():
        return {}
    time, tension = trace.time[kept], whole[kept]
    return {
        "least_N": tension.min(axis=0),
        "at_s": time[tension.argmin(axis=0)],
        "slack_s": slack_time(time, tension.T),
    }


def torque_sizes(file: TraceFile, trace: Trace) -> Sizes:
    """``rms_Nm``, ``peak_Nm`` and ``step_rms_Nm`` of the applied torque, (n,) each, as far as known.

    ``at_limit`` is the share of samples at the motor's limit.
    """
    if "tau_m" not in trace:
        return {}
    torque = trace["tau_m"]
    sizes = {"rms_Nm": rmse(torque), "peak_Nm": max_abs(torque), "step_rms_Nm": rmse(np.diff(torque, axis=0))}
    limit = file.plant.values.get("actuator_torque_limit")
    if limit is not None:
        S = file.plant.matrix("S", trace.joint)
        sizes["at_limit"] = saturated(trace, S, limit.value[np.array(trace.joint) - 1])
    return sizes


def loaded_runs(file: TraceFile) -> dict[str, Trace]:
    """Runs of Table 3 by the names of its rows; rows of a user's law begin with the law's name."""
    rows = {load: file.runs[run] for load, run in LOADS.items() if run in file.runs}
    for trace in file.runs.values():
        unloaded = trace.attributes.get("unloaded_run", "")
        if unloaded in file.runs and trace.name != LOADED:
            rows |= {f"{unloaded}_no_load": file.runs[unloaded], f"{unloaded}_with_load": trace}
    return rows


def compared_runs(file: TraceFile) -> dict[str, Trace]:
    """Runs of Table 2: all but those with payload."""
    return {name: trace for name, trace in file.runs.items() if not trace.attributes.get("unloaded_run")}


def is_user_law(trace: Trace) -> bool:
    """Whether a run's law is a user's."""
    return str(trace.attributes["law"]).startswith(USER_LAW)


def run_title(trace: Trace) -> str:
    """Name of a run for a reader; a user's law keeps the user's."""
    return trace.name if is_user_law(trace) else trace.name.replace("_", " ").capitalize()


class RunOrder(TypedDict):
    """An order of runs by size of error.

    ``order`` has their names, best first and diverged ones last. ``agrees`` says whether that is the printed
    order; None of another experiment than the paper's.
    """

    order: list[str]
    agrees: bool | None


def ranking(file: TraceFile) -> dict[str, dict[str, RunOrder]]:
    """Order of all laws by size of error, and whether the printed order 1 < 2 < 3 holds.

    Returns
    -------
    dict
        By joint and metric.
    """
    known = [file.runs[name] for name in CONTROLLERS if name in file.runs]
    runs = known + [trace for trace in compared_runs(file).values() if is_user_law(trace)]
    papers = len(known) > 1 and all(trace.attributes.get("printed_row") for trace in known)
    result: dict[str, dict[str, RunOrder]] = {}
    for metric in METRICS if len(runs) > 1 else ():
        sizes = np.array([table_errors(trace)[f"{metric}_deg"] for trace in runs])
        for joint, column in zip(runs[0].joint, np.where(np.isnan(sizes), np.inf, sizes).T, strict=True):
            order = [runs[place].name for place in np.argsort(column, kind="stable")]
            rising = all(bool(better < worse) for better, worse in pairwise(column[: len(known)]))
            agrees = rising if papers else None
            result.setdefault(f"joint_{joint}", {})[metric] = {"order": order, "agrees": agrees}
    return result


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
    L = median_step(trace.time) if len(trace.time) > 1 else np.inf
    phases = streaming.thresholds(*(rates or (np.zeros((1, 1)), np.zeros((1, 1)))), L)
    during, signals = {"": np.array(True)}, _signals(trace, phases)
    if rates is not None:
        during |= {name: np.asarray(inside) for name, inside in streaming.phases_of(*rates, phases).items()}
        during["_calm"] = ~during["_rapid"]
    if rates is not None and "e" in signals:
        direction = _last_direction(during["_up"], during["_down"])
        signals["past"] = np.asarray(streaming.past(signals["e"], direction, during["still"]))
    return {
        name: _SIZES[how](signals[of], during[phase])
        for name, (how, of, phase) in streaming.MEASURES.items()
        if of in signals and phase in during
    }


_SIZES = {"mean": mae, "rms": rmse, "peak": max_abs}


def _signals(trace: Trace, phases: streaming.Thresholds) -> dict[str, Array]:
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
    return signals


def saturated(trace: Trace, S: Array, limit: Array) -> Array:
    """Share of the samples in which a motor gives its largest torque, (n,).

    `S` (n, n) is the coupling of the run's joints, `limit` the largest torque of each winch, N m.
    """
    return np.asarray((np.abs(trace["tau_m"] @ S) >= streaming.AT_LIMIT * limit).mean(axis=0))


def _last_direction(up: Array, down: Array) -> Array:
    """Direction in which a joint moved last, (T, n); zero before its first stroke."""
    direction = np.where(up, 1.0, np.where(down, -1.0, 0.0))
    samples = np.arange(len(direction))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(direction != 0.0, samples, 0), axis=0)
    return np.take_along_axis(direction, last, axis=0)


def _slow(values: Array, newest: float) -> Array:
    """Columns (T, n) after the low-pass of `streaming.SLOW`; over missing samples it waits.

    `newest` is the weight of the newest sample.
    """
    filtered = np.full_like(values, np.nan)
    for i, column in enumerate(values.T):
        there = np.isfinite(column)
        known = column[there].tolist()
        # scipy.signal would do the same, but takes 30 MB.
        course: Any = accumulate([*known[:1], *known], lambda old, new: streaming.slowed(old, new, newest))
        filtered[there, i] = [*course][1:]
    return filtered


def with_noise(errors: Array, noise: float, rng: np.random.Generator) -> Array:
    """Errors (N, runs, metrics, n) with the noise of a run on each joint, much alike in MAE and RMSE."""
    of_size, of_shape = noise * rng.standard_normal((2, *errors[:, :, 0].shape))
    return np.asarray(errors * np.exp(np.stack([of_size, of_size + NOISE_OF_SHAPE * of_shape], axis=2)))


def noise_covariance(kept: NDArray[np.bool_]) -> Array:
    """Covariance (K, K) of the logs of K errors kept of (runs, metrics, n) that :func:`with_noise` gives."""
    run, metric, joint = np.nonzero(kept)
    same_run = (run[:, np.newaxis] == run) & (joint[:, np.newaxis] == joint)
    of_shape = NOISE_OF_SHAPE**2 * np.diag(metric.astype(float))
    return np.asarray(NOISE**2 * (same_run + of_shape))
