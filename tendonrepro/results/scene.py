"""What an animation shows of a stored run: postures, tendons and their tensions, two plots; in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.physics.statics import sign_of_side, tensioner_side
from tendonrepro.physics.tendon_path import TendonPath, joint_positions, path_length, tendon_path
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import tensions

_PLACES = (0.07, 0.055), -0.13
"""x of the first motor winch and of each further one, and y of all, m; nothing is published of them."""

_NEEDED = (
    "length",
    "posture",
    "winch_diameter",
    "pulley_diameter",
    "sign",
    "tensioner_diameter",
    "tensioner_force",
)
"""Values of the plant without which no arm can be drawn."""


class Mechanism(NamedTuple):
    """Geometry of an arm of N joints, its tensioner the last of N + 1 tendons.

    Attributes
    ----------
    length, start : array (N,)
        Of the links, m, and start posture, rad.
    winch_diameter : array (N + 1,)
        Of the motors, m; the tensioner's is not published, the last motor's stands for it.
    pulley_diameter, side : array (N, N + 1)
        Of tendon q at joint p in ``[p, q]``, m; +1, -1 or 0 as in :mod:`tendonrepro.physics.statics`.
    tensioner_force : float
        N.
    """

    length: Array
    start: Array
    winch_diameter: Array
    pulley_diameter: Array
    side: Array
    tensioner_force: float


class Curve(NamedTuple):
    """One curve of a plot; its reference, where there is one, is meant to be covered by it."""

    number: int
    label: str
    values: Array
    reference: Array | None = None


class Plot(NamedTuple):
    """A plot beside the arm, over the samples of its scene; `reference` names its curves' references."""

    title: str
    y_label: str
    curves: Sequence[Curve]
    reference: str = ""


@dataclass(frozen=True, eq=False)
class Scene:
    """One run in T samples.

    Attributes
    ----------
    name : str
        Of the run, for a reader.
    time : array (T,)
        s.
    joints : array (T, N + 1, 2)
        Positions of joints and tip, m.
    paths : list of TendonPath
        Of the N + 1 tendons.
    winches : array (T, N + 1)
        How far the motors have turned by the rope that the joints gave back, rad.
    tension : array (T, N + 1)
        N; NaN where it is not known.
    plots : pair of Plot
    mechanism : Mechanism
    payload : float
        kg.
    """

    name: str
    time: Array
    joints: Array
    paths: Sequence[TendonPath]
    winches: Array
    tension: Array
    plots: tuple[Plot, Plot]
    mechanism: Mechanism
    payload: float


def scene_of(file: TraceFile, run: str | None = None) -> Scene:
    """Work out what an animation shows of a run, the first one if none is named.

    Raises
    ------
    UsageError
        If there is no such run.
    DataMissingError
        If the file does not say where the joints are, as a measured one does not.
    """
    trace = _known(_run_of(file, run))
    mechanism = _mechanism_of(file)
    q = np.zeros((len(trace.time), len(mechanism.length)))
    q[:, np.array(trace.joint) - 1] = trace["q_encoder"]
    angle = np.cumsum(mechanism.start + q, axis=1)
    joints = joint_positions(mechanism.length, angle)
    paths = _paths(mechanism, joints, angle)
    lengths = np.column_stack([path_length(path) for path in paths])
    return Scene(
        name=trace.name,
        time=trace.time,
        joints=joints,
        paths=paths,
        winches=(lengths[0] - lengths) / (mechanism.winch_diameter / 2.0),
        tension=_tension(file, trace, mechanism),
        plots=_plots(trace),
        mechanism=mechanism,
        payload=float(trace.attributes["payload_mass"]),
    )


def _known(trace: Trace) -> Trace:
    """Keep the samples at which all angles are known."""
    known = np.isfinite(trace["q_encoder"]).all(axis=1)
    variables = {key: values[known] for key, values in trace.variables.items()}
    return replace(trace, time=trace.time[known], variables=variables)


def _run_of(file: TraceFile, name: str | None) -> Trace:
    name = name or next(iter(file.runs))
    if name not in file.runs:
        message = f"there is no run {name!r} in this file"
        raise UsageError(message, where="--run", hint=f"runs: {', '.join(file.runs)}")
    return file.runs[name]


def _mechanism_of(file: TraceFile) -> Mechanism:
    absent = [key for key in _NEEDED if key not in file.plant.values]
    if absent:
        message = f"the plant in this file holds no {absent[0]!r}, so no arm can be drawn"
        raise DataMissingError(message, hint="animate a simulated run")
    length, start, winch, pulley, sign, diameter, force = (file.plant.values[key].value for key in _NEEDED)
    side = np.triu(sign_of_side(sign))
    tensioner = tensioner_side(file.plant.attributes["tensioner_side"], len(length))
    return Mechanism(
        length=length,
        start=start,
        winch_diameter=np.append(winch, winch[-1]),
        pulley_diameter=np.column_stack([pulley, diameter]),
        side=np.column_stack([side, tensioner]),
        tensioner_force=float(force),
    )


def _paths(mechanism: Mechanism, joints: Array, angle: Array) -> list[TendonPath]:
    """Every tendon from its motor's winch, which stands below joint 1, to the joint it turns."""
    n = len(mechanism.length)
    (first, step), height = _PLACES
    paths = []
    for tendon in range(n + 1):
        ends = min(tendon, n - 1)
        winch = np.broadcast_to([first + step * tendon, height], (len(joints), 1, 2))
        sizes = mechanism.side[: ends + 1, tendon] * mechanism.pulley_diameter[: ends + 1, tendon]
        signed = np.append(mechanism.winch_diameter[tendon], sizes) / 2.0
        centre = np.concatenate([winch, joints[:, : ends + 1]], axis=1)
        # It is fixed where the axis of its link leaves its circle.
        paths.append(tendon_path(centre, signed, -np.pi / 2.0 - angle[:, ends]))
    return paths


def _tension(file: TraceFile, trace: Trace, mechanism: Mechanism) -> Array:
    """Tensions (T, N + 1), N; joints that are held leave those of their tendons open."""
    found = tensions(file, trace)
    tension = np.full((len(trace.time), len(mechanism.length) + 1), np.nan)
    if found is not None:
        tension[:, np.array(trace.joint) - 1] = found
        tension[:, -1] = mechanism.tensioner_force
    return tension


def _plots(trace: Trace) -> tuple[Plot, Plot]:
    """Joint angles on the desired ones; the error that the paper shows of the run."""
    angles = _curves(trace, "Joint", trace["q_encoder"], trace.variables.get("q_d"))
    title, error = "Tracking error", trace["e"]
    if "q_calculated" in trace:
        title, error = "Calculated − encoder", trace["q_calculated"] - trace["q_encoder"]
    errors = _curves(trace, "Joint", error)
    return Plot("Joint angle", "Angle (deg)", angles, "Desired"), Plot(title, "Error (deg)", errors)


def _curves(trace: Trace, what: str, values: Array, reference: Array | None = None) -> list[Curve]:
    """One curve a joint, in degrees."""
    return [
        Curve(
            joint,
            f"{what} {joint}",
            np.rad2deg(values[:, place]),
            None if reference is None else np.rad2deg(reference[:, place]),
        )
        for place, joint in enumerate(trace.joint)
    ]
