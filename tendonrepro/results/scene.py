"""What a film shows of a stored run, in numbers: joints, tendons and their tensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.physics.statics import sign_of_side, tensioner_side
from tendonrepro.physics.tendon_path import TendonPath, joint_positions, tendon_path
from tendonrepro.results.records import PlantRecord, Trace, TraceFile
from tendonrepro.results.summary import tensions

_PLACES = (0.07, 0.055), -0.13
"""x of the first motor winch and of each further one, and y of all, m; nothing is published of them."""


@dataclass(frozen=True, eq=False)
class Scene:
    """One run of an arm of N joints, at its T samples with all angles known.

    `joints` are places of joints and tip, m, (T, N + 1, 2). `paths` are of the N + 1 tendons, the tensioner
    last; `tension` is theirs, N, (T, N + 1), NaN where unknown.
    """

    trace: Trace
    joints: Array
    paths: Sequence[TendonPath]
    tension: Array


def scene_of(file: TraceFile, name: str | None = None) -> Scene:
    """What a film shows of a run, by default the first.

    Raises
    ------
    UsageError
        If there is no such run.
    DataMissingError
        If the file does not say where the tendons go.
    """
    name = name or next(iter(file.runs))
    if name not in file.runs:
        message = f"there is no run {name!r} in this file"
        raise UsageError(message, where="--run", hint=f"runs: {', '.join(file.runs)}")
    if "tensioner_side" not in file.plant.attributes:
        message = "this file does not say where the tendons go, so no arm can be drawn"
        raise DataMissingError(message, hint="animate a simulated run")
    trace = _known(file.runs[name])
    length, start = (file.plant.values[key].value for key in ("length", "posture"))
    q = np.zeros((len(trace.time), len(length)))
    q[:, np.array(trace.joint) - 1] = trace["q_encoder"]
    angle = np.cumsum(start + q, axis=1)
    joints = joint_positions(length, angle)
    return Scene(trace, joints, _paths(file.plant, joints, angle), _tension(file, trace, len(length)))


def _known(trace: Trace) -> Trace:
    known = np.isfinite(trace["q_encoder"]).all(axis=1)
    variables = {key: values[known] for key, values in trace.variables.items()}
    return replace(trace, time=trace.time[known], variables=variables)


def _paths(plant: PlantRecord, joints: Array, angle: Array) -> list[TendonPath]:
    """Tendons from their motors' winches, below joint 1, to the joints they turn."""
    keys = ("winch_diameter", "pulley_diameter", "tensioner_diameter", "sign")
    winch, pulley, tensioner, sign = (plant.values[key].value for key in keys)
    n = len(winch)
    # The tensioner's winch is not published; that of the last motor stands for it.
    winch = np.append(winch, winch[-1])
    side = np.column_stack(
        [np.triu(sign_of_side(sign)), tensioner_side(plant.attributes["tensioner_side"], n)]
    )
    diameter = side * np.column_stack([pulley, tensioner])
    (first, step), height = _PLACES
    paths = []
    for tendon in range(n + 1):
        last = min(tendon, n - 1)
        base = np.broadcast_to([first + step * tendon, height], (len(joints), 1, 2))
        centre = np.concatenate([base, joints[:, : last + 1]], axis=1)
        radius = np.append(winch[tendon], diameter[: last + 1, tendon]) / 2.0
        # It is fixed where the axis of its link leaves its circle.
        paths.append(tendon_path(centre, radius, -np.pi / 2.0 - angle[:, last]))
    return paths


def _tension(file: TraceFile, trace: Trace, n: int) -> Array:
    """Tensions of the tendons; those of held joints are not known."""
    tension = np.full((len(trace.time), n + 1), np.nan)
    tension[:, np.array(trace.joint) - 1] = tensions(file, trace)
    tension[:, -1] = file.plant.values["tensioner_force"].value
    return tension
