"""What a measurement has that its rerun by the model does not explain."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mean, start_level
from tendonrepro.results.records import READ_OFF, PlantRecord, Trace
from tendonrepro.results.summary import Sizes, decoupling_errors, sizes_deg

_METRICS = {"mae": "mae", "rms": "rmse", "max": "max"}
_SMOOTH = 0.05
"""Half the stretch of an encoder's signal whose ends tell its rate, s."""


def comparison_rows(measured: Trace, simulated: Trace, start: float = -np.inf) -> Iterator[dict[str, object]]:
    """Put a measured run beside its simulation on the measured axes: a row for each joint.

    The motion begins at `start`, s. The simulation is interpolated, not shifted to fit. ``e_*`` and ``q_*``
    are measured less simulated; ``lag_s`` is positive where the measurement is late. Of curves that were read
    off a figure the RMS has a band, by as much as the reading error.
    """
    joints = [joint for joint in measured.joint if joint in simulated.joint]
    ours, model = measured.of_joints(joints), simulated.of_joints(joints)
    edge = 1e-9 + 1e-6 * (model.time[1] - model.time[0])
    first_time = max(model.time[0] - edge, start - 0.5 * float(np.median(np.diff(ours.time))))
    inside = (ours.time >= first_time) & (ours.time <= model.time[-1] + edge)
    time = ours.time[inside]
    both = [name for name in ("e", "q_encoder", "q_d", "q_calculated") if name in ours and name in model]
    first = {name: ours[name][inside] for name in both}
    # Where the measurement has a gap, the simulation is left out too.
    second = {name: np.where(np.isfinite(first[name]), at(model, name, time), np.nan) for name in both}
    apart = {name: first[name] - second[name] for name in both}
    columns: Sizes = {}
    with np.errstate(divide="ignore", invalid="ignore"):
        if "e" in both:
            sizes = [sizes_deg(errors["e"])["mae"] for errors in (first, second)]
            columns |= {"measured_mae_deg": sizes[0], "simulated_mae_deg": sizes[1]}
            columns |= {"mae_ratio": sizes[0] / sizes[1], "e_samples": np.isfinite(apart["e"]).sum(axis=0)}
            columns |= _differences("e_", apart["e"])
            columns |= _band(columns["e_rms_deg"], reading_error(ours))
            columns["e_correlation"] = _correlation(first["e"], second["e"])
        if "q_encoder" in both:
            columns["q_samples"] = np.isfinite(apart["q_encoder"]).sum(axis=0)
            columns |= _differences("q_", apart["q_encoder"])
            columns["lag_s"] = _lag(-apart["q_encoder"], _rate(model, time))
    if "q_d" in both:
        columns["q_d_max_deg"] = sizes_deg(apart["q_d"])["max"]
    if {"q_calculated", "q_encoder"} <= {*both}:
        columns["measured_calculated_mae_deg"] = decoupling_errors(ours)["mae"]
        columns["simulated_calculated_mae_deg"] = decoupling_errors(model)["mae"]
    for place, joint in enumerate(joints):
        yield {"run": ours.name, "joint": joint, "status": model.status} | _row(columns, place)


def start_rows(trace: Trace, begin: float) -> Iterator[dict[str, object]]:
    """Error of a run where its motion begins, at `begin`, s: a row for each joint.

    It is the last that is known until then. The model has none there.
    """
    if "e" not in trace:
        return
    until = trace.time <= begin + 0.5 * float(np.median(np.diff(trace.time)))
    for joint, errors in zip(trace.joint, trace["e"][until].T, strict=True):
        known = errors[np.isfinite(errors)]
        error = float(np.rad2deg(known[-1])) if known.size else None
        yield {"run": trace.name, "joint": joint, "begin_s": begin, "error_deg": error}


def reading_error(trace: Trace) -> float:
    """Error of a run's tracking error that was read off a figure, rad; 0 if it was recorded."""
    direct = float(trace.attributes.get(f"{READ_OFF}e", 0.0))
    parts = [float(trace.attributes.get(f"{READ_OFF}{name}", 0.0)) for name in ("q_d", "q_encoder")]
    return direct or math.hypot(*parts)


def _band(rms: Array, error: float) -> Sizes:
    """RMS of a residual less and plus the reading error, deg: that of the true one lies between."""
    if not error:
        return {}
    degrees = np.full_like(rms, np.rad2deg(error))
    band = {"e_rms_low_deg": np.maximum(rms - degrees, 0.0), "e_rms_high_deg": rms + degrees}
    return {"reading_error_deg": degrees, **band}


def at(trace: Trace, name: str, time: Array) -> Array:
    """A variable at times (T,), s: (T, n), interpolated, held beyond both ends."""
    return np.column_stack([np.interp(time, trace.time, column) for column in trace[name].T])


def _row(columns: Mapping[str, Array], place: int) -> dict[str, object]:
    """Numbers of a joint, None where one cannot be told."""
    values = {name: column[place] for name, column in columns.items()}
    return {name: value.item() if np.isfinite(value) else None for name, value in values.items()}


def _differences(prefix: str, apart: Array) -> Sizes:
    sizes = sizes_deg(apart)
    return {f"{prefix}{name}_deg": sizes[key] for name, key in _METRICS.items()}


def _correlation(first: Array, second: Array) -> Array:
    first, second = first - mean(first), second - mean(second)
    return np.asarray(mean(first * second) / np.sqrt(mean(first**2) * mean(second**2)))


def _rate(trace: Trace, time: Array) -> Array:
    """Velocity of the simulated joints, rad/s.

    In a gradient the encoder's steps would count as motion, and the lag as shorter.
    """
    before, after = np.clip([time - _SMOOTH, time + _SMOOTH], trace.time[0], trace.time[-1])
    travel = at(trace, "q_encoder", after) - at(trace, "q_encoder", before)
    return np.asarray(travel / (after - before)[:, np.newaxis])


def _lag(behind: Array, rate: Array) -> Array:
    """Shift that, with an offset, explains most of the difference to first order, s."""
    rate = np.where(np.isfinite(behind), rate, np.nan)
    behind, rate = behind - mean(behind), rate - mean(rate)
    return np.asarray(mean(behind * rate) / mean(rate**2))


def coupling_rows(trace: Trace, plant: PlantRecord) -> Iterator[dict[str, object]]:
    """Compare joint and motor angles of the decoupling run by the plant's ``S`` and ``S_inv``.

    Differences are in degrees, as they are and less that at the start.
    """
    if not {"q_motor_encoder", "q_encoder"} <= set(trace.variables):
        return
    motor, encoder = trace["q_motor_encoder"], trace["q_encoder"]
    S, S_inv = (plant.matrix(name, trace.joint) for name in ("S", "S_inv"))
    differences = {
        "joint angle, S q_motor less encoder": motor @ S.T - encoder,
        "motor angle, S_inv q_encoder less motor": encoder @ S_inv.T - motor,
    }
    for what, apart in differences.items():
        known = np.isfinite(apart).all(axis=1)
        if known.any():
            shifted = apart - start_level(trace.time[known], apart[known])
            columns = _differences("", apart[known]) | _differences("shifted_", shifted[known])
            for place, number in enumerate(trace.joint):
                yield {"what": what, "number": number} | _row(columns, place)
