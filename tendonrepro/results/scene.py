"""What an animation shows of a stored run: postures, tendons and their tensions, two plots; in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.load import load_config
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.physics.kinematics import coupling_inverse, coupling_matrix
from tendonrepro.physics.statics import sign_of_side, tensioner_side
from tendonrepro.physics.tendon_path import TendonPath, joint_positions, path_length, tendon_path
from tendonrepro.results.records import DECOUPLING_RUNS, Trace, TraceFile
from tendonrepro.results.summary import tensions

PULL = "pull_tendon_1"
"""The run of the decoupling experiment in which motor 1 alone turns."""

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
    """A plot beside the arm, over the samples of its scene; without curves nothing was recorded.

    `reference` is the name of all its curves' references.
    """

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
    carried : array (T, 2, 2), optional
        Link 2, were it only translated, m.
    assumed : bool
        Whether the mechanism is the shipped one, for want of one in the file.
    missing : str
        What the file does not hold of all this, one sentence or nothing.
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
    carried: Array | None = None
    assumed: bool = False
    missing: str = ""


def scene_of(file: TraceFile, run: str | None = None, *, coupling: bool = False) -> Scene:
    """Work out what an animation shows of a run, the first one if none is named.

    With `coupling` it is the run in which motor 1 alone turns, in the postures that Eq. (1) gives for its
    motors' angles.
    """
    trace = _known(_run_of(file, PULL if coupling else run), "q_motor_encoder" if coupling else "q_encoder")
    mechanism, assumed = _mechanism_of(file)
    n, moving = len(mechanism.length), np.array(trace.joint) - 1
    if moving.max() >= n:
        message = f"run {trace.name!r} moves joint {max(trace.joint)} of an arm of {n}"
        raise DataMissingError(message)
    q = np.zeros((len(trace.time), n))
    q[:, moving] = trace["q_motor_encoder" if coupling else "q_encoder"]
    if coupling:
        q = q @ _coupling(mechanism).T
    angle = np.cumsum(mechanism.start + q, axis=1)
    joints = joint_positions(mechanism.length, angle)
    paths = _paths(mechanism, joints, angle)
    lengths = np.column_stack([path_length(path) for path in paths])
    plots = _coupling_plots(trace, q) if coupling else _tracking_plots(trace)
    missing = ["link lengths, routing and start posture, for which the shipped ones stand"] * assumed
    missing += ["tau_s, without which no tendon has a colour"] * ("tau_s" not in trace)
    missing += [f"what the plot {plot.title!r} shows" for plot in plots if not plot.curves]
    return Scene(
        name=trace.name,
        time=trace.time,
        joints=joints,
        paths=paths,
        winches=(lengths[0] - lengths) / (mechanism.winch_diameter / 2.0),
        tension=_tension(file, trace, mechanism),
        plots=plots,
        mechanism=mechanism,
        payload=float(trace.attributes["payload_mass"]),
        carried=joints[:, 1:2] + joints[0, 1:3] - joints[0, 1] if coupling and n > 1 else None,
        assumed=assumed,
        missing=f"The run {trace.name} lacks {', and '.join(missing)}." if missing else "",
    )


def _known(trace: Trace, name: str) -> Trace:
    """Keep the samples at which a variable is known of all joints."""
    known = np.isfinite(trace[name]).all(axis=1)
    if not known.any():
        message = f"run {trace.name!r} has no sample at which {name} is known of all its joints"
        raise DataMissingError(message)
    variables = {key: values[known] for key, values in trace.variables.items()}
    return replace(trace, time=trace.time[known], variables=variables)


def _run_of(file: TraceFile, name: str | None) -> Trace:
    if name is None and file.runs:
        return next(iter(file.runs.values()))
    if name is None or name not in file.runs:
        message = f"there is no run {name!r} in this file" if name else "this file holds no run"
        hint = f"runs: {', '.join(file.runs) or 'none'}"
        if name == PULL:
            raise DataMissingError(message, hint=f"{hint}; tendonrepro decouple makes this one")
        raise UsageError(message, where="--run", hint=hint)
    return file.runs[name]


def _mechanism_of(file: TraceFile) -> tuple[Mechanism, bool]:
    """Geometry from the plant, or where a measured file has none the shipped one, and whether it is that."""
    values: dict[str, Array] = {key: held.value for key, held in file.plant.values.items()}
    course = file.plant.attributes.get("tensioner_side", "negative")
    assumed = file.source == "measured" and "length" not in values
    if assumed:
        config = load_config(None, "compare").config
        routing, tensioner = config.manipulator.routing, config.manipulator.tensioner
        found: list[Any] = [config.manipulator.links.length, config.posture, routing.winch_diameter]
        found += [routing.pulley_diameter, routing.sign, tensioner.diameter, tensioner.force]
        values = {key: np.asarray(quantity.si) for key, quantity in zip(_NEEDED, found, strict=True)}
        course = tensioner.side
    absent = [key for key in _NEEDED if key not in values]
    if absent:
        message = f"the plant in this file holds no {absent[0]!r}, so no arm can be drawn"
        raise DataMissingError(message)
    length, start, winch, pulley, sign, diameter, force = (values[key] for key in _NEEDED)
    n = length.size
    try:
        side = np.triu(sign_of_side(sign.reshape(n, n)))
        return Mechanism(
            length=length.reshape(n),
            start=start.reshape(n),
            winch_diameter=np.append(winch.reshape(n), winch[-1]),
            pulley_diameter=np.column_stack([pulley.reshape(n, n), diameter.reshape(n)]),
            side=np.column_stack([side, tensioner_side(course, n)]),
            tensioner_force=float(force),
        ), assumed
    except (ValueError, TypeError, KeyError):
        message = "the plant in this file is not that of one arm: its sizes do not fit each other"
        raise DataMissingError(message) from None


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
        try:
            # It is fixed where the axis of its link leaves its circle.
            paths.append(tendon_path(centre, signed, -np.pi / 2.0 - angle[:, ends]))
        except ValueError:
            message = f"tendon {tendon + 1} cannot be drawn: pulleys of neighbouring joints overlap"
            raise DataMissingError(message, hint="the links are too short for their pulleys") from None
    return paths


def _tension(file: TraceFile, trace: Trace, mechanism: Mechanism) -> Array:
    """Tensions (T, N + 1), N; joints that are held leave those of their tendons open."""
    found = tensions(file, trace)
    tension = np.full((len(trace.time), len(mechanism.length) + 1), np.nan)
    if found is not None:
        tension[:, np.array(trace.joint) - 1] = found
        tension[:, -1] = mechanism.tensioner_force
    return tension


def _coupling(mechanism: Mechanism) -> Array:
    """``S`` of all joints, Eq. (2)."""
    n = len(mechanism.length)
    sizes = mechanism.winch_diameter[:n], mechanism.pulley_diameter[:, :n]
    return coupling_matrix(coupling_inverse(*sizes, sign_of_side(mechanism.side[:, :n])))


def _tracking_plots(trace: Trace) -> tuple[Plot, Plot]:
    """Joint angles on the desired ones; the error that the paper shows of the run."""
    angles = _curves(trace, "Joint", trace["q_encoder"], trace.variables.get("q_d"))
    title, error = "Tracking error", trace.variables.get("e")
    if trace.name in DECOUPLING_RUNS and "q_calculated" in trace:
        title, error = "Calculated − encoder", trace["q_calculated"] - trace["q_encoder"]
    shown = [] if error is None else _curves(trace, "Joint", error)
    return Plot("Joint angle", "Angle (deg)", angles, "Desired"), Plot(title, "Error (deg)", shown)


def _coupling_plots(trace: Trace, q: Array) -> tuple[Plot, Plot]:
    """Motor angles; joint angles by Eq. (1) on those of the encoders."""
    motors = _curves(trace, "Motor/joint", trace["q_motor_encoder"])
    joints = _curves(trace, "Motor/joint", q[:, np.array(trace.joint) - 1], trace.variables.get("q_encoder"))
    return Plot("Motor angle", "Angle (deg)", motors), Plot(
        "Joint angle by Eq. (1)", "Angle (deg)", joints, "Encoder"
    )


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
