"""Measurement less simulation: what a rerun of the model on the measured motion leaves unexplained."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae, max_abs, rmse, start_level
from tendonrepro.results.records import PlantRecord, Trace

Row: TypeAlias = dict[str, Any]
"""A table row by column name; angles in degrees."""

_LEAST = 2
"""Fewest samples that can be compared."""
_SMOOTH = 0.05
"""Half the stretch of an encoder's signal whose ends tell its rate, s."""


def comparison_rows(measured: Trace, simulated: Trace) -> Iterator[Row]:
    """Put a measured run beside its simulation on the measured axes, joint by joint.

    The simulation is interpolated on the measured times. Nothing is shifted to fit: the lag is an estimate of
    its own, positive where the measurement is late.

    Rows hold ``run``, ``joint``, ``status`` of the simulation, MAE of both tracking errors and their ratio,
    ``e_*`` and ``q_*`` of measured less simulated with the samples they rest on, ``e_correlation``,
    ``lag_s``, ``q_d_max_deg``; of the decoupling run the MAE of calculated less encoder, measured and
    simulated. What cannot be told is None or left out.
    """
    # Places of the measured samples that the simulation reaches.
    edge = 1e-9 + 1e-6 * (simulated.time[1] - simulated.time[0])
    first, last = simulated.time[0] - edge, simulated.time[-1] + edge
    inside = np.flatnonzero((measured.time >= first) & (measured.time <= last))
    for joint in (joint for joint in measured.joint if joint in simulated.joint):
        pairs = {
            name: _pair(measured, simulated, name, joint, inside)
            for name in ("e", "q_encoder", "q_d")
            if name in measured and name in simulated
        }
        row: Row = {"run": measured.name, "joint": joint, "status": simulated.status}
        if "e" in pairs:
            row |= _errors(*pairs["e"])
        if "q_encoder" in pairs:
            row["q_samples"] = len(pairs["q_encoder"][0])
            row |= _sizes("q_", np.subtract(*pairs["q_encoder"][:2]))
            row["lag_s"] = _lag(*pairs["q_encoder"][:2], _rate(simulated, joint, pairs["q_encoder"][2]))
        if "q_d" in pairs:
            row["q_d_max_deg"] = _sizes("q_d_", np.subtract(*pairs["q_d"][:2]))["q_d_max_deg"]
        if all("q_calculated" in trace and "q_encoder" in trace for trace in (measured, simulated)):
            row["measured_calculated_mae_deg"] = _coupling_error(measured, joint)
            row["simulated_calculated_mae_deg"] = _coupling_error(simulated, joint)
        yield row


def _coupling_error(trace: Trace, joint: int) -> float | None:
    """MAE of the angle calculated from the motors less the encoder, deg."""
    difference = (trace["q_calculated"] - trace["q_encoder"])[:, trace.joint.index(joint)]
    difference = difference[np.isfinite(difference)]
    return float(np.rad2deg(mae(difference))) if len(difference) else None


def _pair(
    measured: Trace, simulated: Trace, name: str, joint: int, inside: NDArray[np.intp]
) -> tuple[Array, Array, Array]:
    """Measured and simulated values at the same times, and these; missing samples are left out."""
    time = measured.time[inside]
    ours = measured[name][inside, measured.joint.index(joint)]
    model = np.interp(time, simulated.time, simulated[name][:, simulated.joint.index(joint)])
    known = np.isfinite(ours)
    return ours[known], model[known], time[known]


def _errors(ours: Array, model: Array, _time: Array) -> Row:
    if len(ours) < _LEAST:
        return {}
    sizes = [float(np.rad2deg(mae(values))) for values in (ours, model)]
    return {
        "e_samples": len(ours),
        "measured_mae_deg": sizes[0],
        "simulated_mae_deg": sizes[1],
        "mae_ratio": sizes[0] / sizes[1] if sizes[1] > 0.0 else None,
        **_sizes("e_", ours - model),
        "e_correlation": _correlation(ours, model),
    }


def _sizes(prefix: str, difference: Array) -> Row:
    if not len(difference):
        return {f"{prefix}{metric}_deg": None for metric in ("mae", "rms", "max")}
    found = {"mae": mae(difference), "rms": rmse(difference), "max": max_abs(difference)}
    return {f"{prefix}{metric}_deg": float(np.rad2deg(size)) for metric, size in found.items()}


def _correlation(first: Array, second: Array) -> float | None:
    first, second = first - first.mean(), second - second.mean()
    size = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / size if size > 0.0 else None


def _rate(trace: Trace, joint: int, time: Array) -> Array:
    """Velocity of a simulated joint, rad/s.

    The gradient of an encoder's steps will not do: its spikes would count as motion, and the lag as shorter.
    """
    column = trace.joint.index(joint)
    ends = np.clip([time - _SMOOTH, time + _SMOOTH], trace.time[0], trace.time[-1])
    before, after = np.interp(ends, trace.time, trace["q_encoder"][:, column])
    return np.asarray((after - before) / (ends[1] - ends[0]))


def _lag(ours: Array, model: Array, rate: Array) -> float | None:
    """Shift of the simulation that, with an offset, explains most of the difference to first order, s."""
    if len(rate) < _LEAST:
        return None
    difference, rate = model - ours - (model - ours).mean(), rate - rate.mean()
    power = float(rate @ rate)
    return float(difference @ rate) / power if power > 0.0 else None


def coupling_rows(trace: Trace, plant: PlantRecord) -> Iterator[Row]:
    """Compare measured joint and motor angles of the decoupling run through the plant's ``S`` and ``S_inv``.

    Rows hold ``what`` (joint or motor angle), ``number``, and MAE, RMS and largest difference, deg, as they
    are and with the difference at the start taken off. There are none unless the motors were recorded too.
    """
    if not {"q_motor_encoder", "q_encoder"} <= set(trace.variables):
        return
    motor, encoder = trace["q_motor_encoder"], trace["q_encoder"]
    S, S_inv = (plant.matrix(name, trace.joint) for name in ("S", "S_inv"))
    differences = {
        "joint angle, S q_motor less encoder": motor @ S.T - encoder,
        "motor angle, S_inv q_encoder less motor": encoder @ S_inv.T - motor,
    }
    for what, difference in differences.items():
        known = np.isfinite(difference).all(axis=1)
        for column, number in enumerate(trace.joint) if known.any() else ():
            values = difference[known, column]
            shifted = values - start_level(trace.time[known], values)
            yield {"what": what, "number": number} | _sizes("", values) | _sizes("shifted_", shifted)
