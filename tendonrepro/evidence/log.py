"""Logs: runs on the controller's samples, without rounding, with the desired motion.

Second differences of rounded angles are mostly rounding: 0.001 deg at 1 kHz makes 7 rad/s². A spline through
the motion has a thousandth of that. Where the motion bends faster than the spline can, nothing is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.ndimage import binary_dilation, binary_opening

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.experiment import MOST_SAMPLES
from tendonrepro.configuration.strict_yaml import load
from tendonrepro.console import count_of
from tendonrepro.dataset.motion import RecordedMotion, rounding_step, smoothed
from tendonrepro.errors import DataMissingError
from tendonrepro.experiments.rig import coupling
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.records import DECOUPLING_RUNS, Trace, TraceFile


@dataclass(frozen=True, eq=False)
class Log:
    """One run as a recorder kept it, T samples of n joints, arrays (T, n), SI.

    Attributes
    ----------
    run, joints
        Its name, and the numbers of its joints.
    L
        Time between samples, s.
    q, q_motor
        Joint encoders, and ``S q_motor`` of the motors' encoders if known.
    command, applied
        Torque in joint coordinates: the one commanded if known, else the one applied; and that applied
        if both are known.
    S : array (n, n)
        Coupling matrix.
    expected
        Configuration with the gains that the log is compared with, see `expected_of`.
    angle_rounding, torque_rounding : array (n,)
        Rounding that is left, of the joint encoders, rad, and of the commanded torque, N m.
    """

    run: str
    joints: tuple[int, ...]
    L: float
    q: Array
    q_motor: Array | None
    q_d: Array
    dq_d: Array
    ddq_d: Array
    command: Array
    applied: Array | None
    S: Array
    expected: CompareConfig
    angle_rounding: Array
    torque_rounding: Array


_SIGNALS = ("q", "q_motor", "q_d", "dq_d", "ddq_d", "command", "applied")


def expected_of(file: TraceFile, paper: CompareConfig) -> CompareConfig:
    """Configuration with the gains that a log is compared with.

    They are the paper's. It has none for other joints or another arm than its own, and a simulated log of
    these is compared with the configuration that made it.
    """
    if (file.source, file.experiment) != ("simulated", "compare"):
        return paper
    own = CompareConfig.model_validate(load(file.config_yaml, "config_yaml"))
    joints = {joint for trace in file.runs.values() for joint in trace.joint}
    return paper if joints <= set(paper.joints) and is_arm_of_paper(own.manipulator) else own


def read_logs(file: TraceFile, expected: CompareConfig) -> tuple[list[Log], list[DataMissingError]]:
    """Logs of runs with torque, desired and encoder angles; and why other such runs have none."""
    logs, refused = [], []
    for name, recorded in file.runs.items():
        torque = "tau_cmd" if "tau_cmd" in recorded else "tau_m"
        if name in DECOUPLING_RUNS or not all(key in recorded for key in (torque, "q_encoder", "q_d")):
            continue
        try:
            logs.append(_log_of(*on_its_samples(recorded), torque, file, expected))
        except DataMissingError as error:
            refused.append(error)
    return logs, refused


def _log_of(trace: Trace, L: float, torque: str, file: TraceFile, expected: CompareConfig) -> Log:
    q_d, dq_d, ddq_d = desired_motion(trace, L)
    step = expected.manipulator.encoders.joint.resolution.si
    q, rounding = zip(*(without_rounding(column, step) for column in trace["q_encoder"].T), strict=True)
    S = file.plant.matrix("S", trace.joint) if "S" in file.plant.values else _coupling(expected, trace.joint)
    return Log(
        run=trace.name,
        joints=trace.joint,
        L=L,
        q=np.column_stack(q),
        q_motor=trace["q_motor_encoder"] @ S.T if "q_motor_encoder" in trace else None,
        q_d=q_d,
        dq_d=dq_d,
        ddq_d=ddq_d,
        command=trace[torque],
        applied=trace["tau_m"] if torque == "tau_cmd" and "tau_m" in trace else None,
        S=S,
        expected=expected,
        angle_rounding=np.array(rounding),
        torque_rounding=torque_rounding(trace[torque], S),
    )


def _coupling(config: CompareConfig, joints: Sequence[int]) -> Array:
    """Coupling of the joints of a record; one that the configuration does not move stands alone."""
    S, matrix = coupling(config)[0], np.eye(len(joints))
    for i, j in product(range(len(joints)), repeat=2):
        if {joints[i], joints[j]} <= {*config.joints}:
            matrix[i, j] = S[config.joints.index(joints[i]), config.joints.index(joints[j])]
    return matrix


def liveliest(log: Log, samples: int) -> Log:
    """Samples in which the desired motion is fastest."""
    speed = np.cumsum(np.nan_to_num(log.dq_d**2).sum(axis=1))
    if len(speed) <= samples:
        return log
    start = int(np.argmax(speed[samples:] - speed[:-samples]))
    signals = {name: getattr(log, name) for name in _SIGNALS}
    return replace(log, **{name: x[start : start + samples] for name, x in signals.items() if x is not None})


def without_rounding(q: Array, encoder_step: float, noise: float = 0.0) -> tuple[Array, float]:
    """Angles (T,) on the grid of encoder steps that they evidently stood on, and the rounding that is left.

    Without such a grid the angles stay. One coarser than `encoder_step`, rad, may be the recorder's. Changes
    up to `noise` are of a record that rounds once more, and no step of the grid.
    """
    known = np.isfinite(q)
    angles = q[known]
    steps = np.abs(np.diff(angles))
    steps = steps[steps > max(1e-7, noise)]
    if steps.size < 20:
        return q, resolution(angles)
    step, start = float(np.median(steps[steps < 1.5 * np.quantile(steps, 0.05)])), float(angles[0])
    # A step between neighbours is rough; over longer ways it is told better and better.
    for reach in (10, 100, 1000, np.inf):
        counts = np.round((angles - start) / step)
        near = np.abs(counts) <= reach
        if np.ptp(counts[near]) == 0:
            return q, resolution(angles)
        step, start = map(float, np.polyfit(counts[near], angles[near], 1))
    on_grid = start + step * np.round((angles - start) / step)
    if np.abs(on_grid - angles).max() > 0.25 * step:
        return q, resolution(angles)
    freed = np.full_like(q, np.nan)
    freed[known] = on_grid
    return freed, 0.0 if step < 1.1 * encoder_step else step


def resolution(values: Array) -> float:
    """Smallest difference between any two values, but for what arithmetic leaves."""
    gaps = np.diff(np.unique(values[np.isfinite(values)]))
    gaps = gaps[gaps > 1e-9 * np.ptp(values)] if gaps.size else gaps
    return float(gaps.min()) if gaps.size else 0.0


def torque_rounding(torque: Array, S: Array) -> Array:
    """Rounding of each joint's torque (T, n), N m, by the record, or by drives at the winches; (n,)."""
    # Of a grid that values evidently stood on the step, else the smallest difference of any two.
    of_joints = np.array([without_rounding(column, 0.0)[1] for column in torque.T])
    # A record may round once more what a drive has rounded. At a winch it mixes the joints' digits, at most
    # one of each, and a little for arithmetic. Larger changes may tell the drive's steps, or all.
    digits = 1.2 * min(resolution(column) for column in torque.T) * np.abs(S).sum(axis=0)
    at_winches = zip((torque @ S).T, digits, strict=True)
    of_winches = [
        max(without_rounding(column, 0.0, noise)[1] for noise in (0.0, mixed)) for column, mixed in at_winches
    ]
    mapped = np.sqrt(np.linalg.inv(S.T) ** 2 @ np.square(of_winches))
    return np.asarray(np.maximum(of_joints, mapped))


_BEYOND = 0.75
"""Steps of rounding by which a record may be off its spline."""
_NEAR = 2.0
"""Spacings of knots around such a place that are left out."""
_BRIDGED = 5
"""Samples that may be lost in a row before the spline says nothing near them."""
LEAST = 16
"""Samples below which a run has none with all that a controller remembers."""


def desired_motion(trace: Trace, L: float) -> tuple[Array, Array, Array]:
    """Desired angle, velocity and acceleration, (T, n), NaN where they cannot be told.

    Recorded derivatives are taken as they are. Of an angle with all digits they are differences, and of a
    rounded one those of a spline.
    """
    q_d = trace["q_d"]
    if "dq_d" in trace and "ddq_d" in trace:
        return q_d, trace["dq_d"], trace["ddq_d"]
    motions = [_of_one(column, trace.time, L) for column in q_d.T]
    angle, rate, acceleration = (np.column_stack(parts) for parts in zip(*motions, strict=True))
    return angle, trace.variables.get("dq_d", rate), acceleration


def _of_one(q_d: Array, time: Array, L: float) -> tuple[Array, Array, Array]:
    known = np.isfinite(q_d)
    rounding = rounding_step(q_d[known]) if known.sum() > 1 else 0.0
    if not rounding:
        rate = np.gradient(q_d, L)
        return q_d, rate, np.gradient(rate, L)
    # Before the first motion and after the last the angle stands; there the spline would swing.
    even = time[0] + L * np.arange(round(float(time[-1] - time[0]) / L) + 1)
    filled = np.interp(even, time[known], q_d[known])
    record = RecordedMotion(even - even[0], (filled - filled[0])[:, np.newaxis], (0,), filled[:1], rounding)
    spline, spacing = smoothed(record, least=0.0)
    at = time - even[0]
    angle, rate, acceleration = (spline(at, k)[:, 0] for k in range(3))
    off = np.abs(angle + filled[0] - q_d) > _BEYOND * rounding
    near = round(_NEAR * spacing / L)
    pauses = binary_opening(~known, np.ones(_BRIDGED + 1, dtype=bool))
    unknown = binary_dilation(off | pauses, np.ones(2 * near + 1, dtype=bool)) | ~known
    rate, acceleration = (np.where(unknown, np.nan, values) for values in (rate, acceleration))
    return np.where(off, q_d, angle + filled[0]), rate, acceleration


def on_its_samples(trace: Trace) -> tuple[Trace, float]:
    """The run on the controller's even samples, NaN where one was lost, and their period, s.

    A recorder's clock may jitter; the controller's is taken as even.

    Raises
    ------
    DataMissingError
        If the run has fewer than `LEAST` samples, or a pause in which more are lost than a run can have.
    """
    if len(trace.time) < LEAST:
        message = f"run {trace.name!r} is too short to tell: {count_of(len(trace.time), 'sample')}"
        raise DataMissingError(message, hint="record a longer run")
    steps = np.diff(trace.time)
    L = float(np.median(steps))
    place = np.concatenate([[0], np.cumsum(np.maximum(np.round(steps / L), 1.0))]).astype(np.int64)
    if place[-1] + 1 - len(trace.time) > MOST_SAMPLES:
        longest = int(np.argmax(steps))
        pause = f"a pause of {steps[longest]:.0f} s after {trace.time[longest]:.3f} s"
        hint = "take one side of it: from_s or to_s of the run in the mapping, then ingest again"
        raise DataMissingError(f"run {trace.name!r} has {pause}, too long to fill", hint=hint)
    # Of many samples the mean tells the period better than one step does.
    L = float((trace.time[-1] - trace.time[0]) / place[-1])
    time = trace.time[0] + L * np.arange(place[-1] + 1.0)
    if place[-1] + 1 == len(trace.time):
        return replace(trace, time=time), L
    variables = {}
    for name, values in trace.variables.items():
        variables[name] = np.full((place[-1] + 1, values.shape[1]), np.nan)
        variables[name][place] = values
    return replace(trace, time=time, variables=variables), L
