"""Claims K3 and K5: angles of joints and motors against each other, as measured."""

from __future__ import annotations

from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.claims.from_print import Judged
from tendonrepro.claims.verdicts import of_model
from tendonrepro.config.published import COMPARED
from tendonrepro.errors import DataMissingError
from tendonrepro.physics.metrics import mae, start_level
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS

TINY, AGREES = 0.01, 0.05
"""Largest errors of K3 and K5 as shares of a joint's or motor's range."""
LEAST_RANGE = float(np.deg2rad(1.0))
"""Range below which a joint or motor counts as at rest, rad."""


def decoupling(file: TraceFile) -> Judged:
    """K3: joint angles calculated from the motors against the encoders.

    Raises
    ------
    DataMissingError
        When the run, a joint or a signal is missing, or a joint does not move.
    """
    trace = file.part("decouple").runs.get("decouple")
    if trace is None:
        message = "a measured run decouple"
        raise DataMissingError(message)
    places = [trace.joint.index(joint) for joint in (1, 2, 3) if joint in trace.joint]
    if len(places) < 3:
        message = "all of joints 1 to 3 in the run decouple"
        raise DataMissingError(message)
    encoder = _needed(trace, "q_encoder")[:, places]
    apart = calculated_angles(file, trace)[:, places] - encoder
    known = np.isfinite(apart).all(axis=1)
    time, apart = trace.time[known], apart[known]
    reach = np.nanmax(encoder, axis=0) - np.nanmin(encoder, axis=0)
    if not len(apart) or (reach < LEAST_RANGE).any():
        message = "a run decouple in which joints 1 to 3 all move"
        raise DataMissingError(message)
    ways = {"start_offset_removed": apart - start_level(time, apart), "as_recorded": apart}
    rows = {name: _agreement(mae(difference), reach) for name, difference in ways.items()}
    decided, other = (all(row["holds"] for row in rows[name]["statements"]) for name in ways)
    remarks = [] if decided == other else ["with the start offset left in, the verdict is the other one"]
    return Judged(of_model(decided), None, rows | {"remarks": remarks})


def _agreement(size: Array, reach: Array) -> dict[str, Any]:
    statements = {
        "joint 3's error is the largest": size[2] > size[:2].max(),
        "joint 1's error is the smallest": size[0] < size[1:].min(),
        f"joint 1's error is below {100 * TINY:g} % of its range": size[0] < TINY * reach[0],
        f"every error is below {100 * AGREES:g} % of the joint's range": (size < AGREES * reach).all(),
    }
    return {
        "mae_deg": np.rad2deg(size).tolist(),
        "share_of_range": (size / reach).tolist(),
        "statements": [{"statement": text, "holds": bool(held)} for text, held in statements.items()],
    }


def calculated_angles(file: TraceFile, trace: Trace) -> Array:
    """Joint angles calculated from the motors, (T, n): recorded, else ``S q_motor_encoder``."""
    if "q_calculated" in trace:
        return trace["q_calculated"]
    return np.asarray(_needed(trace, "q_motor_encoder") @ file.plant.matrix("S", trace.joint).T)


def motor_angles(file: TraceFile) -> Judged:
    """K5: motor angles from measured against those from desired joint angles.

    Raises
    ------
    DataMissingError
        When no controller was recorded with both, or no motor moves.
    """
    rows = []
    for name in CONTROLLERS:
        trace = file.part("compare").runs.get(name)
        if trace is None or not {"q_d", "q_encoder"} <= trace.variables.keys():
            continue
        trace = trace.of_joints(_known_joints(trace))
        if not {*COMPARED} <= {*trace.joint}:
            continue
        S_inv = file.plant.matrix("S_inv", trace.joint)
        desired, angles = (trace[variable] @ S_inv.T for variable in ("q_d", "q_encoder"))
        known = np.isfinite(desired + angles).all(axis=1)
        # Motor 3 hardly turns where joints 2 and 3 move alike, so its own range is no measure.
        reach = np.ptp(desired[known], axis=0).max() if known.any() else 0.0
        if reach < LEAST_RANGE:
            continue
        for motor, apart in zip(trace.joint, mae(angles[known] - desired[known]), strict=True):
            text = f"{name}, motor {motor}: MAE is below {100 * AGREES:g} % of the largest range of a motor"
            sizes = {"mae_deg": float(np.rad2deg(apart)), "share_of_range": float(apart / reach)}
            rows.append({"statement": text, "holds": bool(apart < AGREES * reach)} | sizes)
    if not rows:
        message = "q_encoder and q_d of joints 2 and 3 of a controller whose motors move"
        raise DataMissingError(message)
    return Judged(of_model(all(row["holds"] for row in rows)), None, {"statements": rows})


def _known_joints(trace: Trace) -> list[int]:
    """Joints with both angles: an encoder at rest may have been recorded without a desired angle."""
    known = np.asarray(np.isfinite(trace["q_d"] + trace["q_encoder"]).any(axis=0))
    return [joint for joint, there in zip(trace.joint, known, strict=True) if there]


def _needed(trace: Trace, variable: str) -> Array:
    if variable not in trace:
        message = f"{variable} of the run {trace.name}"
        raise DataMissingError(message)
    return trace[variable]
