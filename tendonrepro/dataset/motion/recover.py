"""The desired motion of a measured comparison: recovered, named, and written for the simulator to run."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.published import COMPARED
from tendonrepro.dataset.motion.fit import Fit, fits, limit
from tendonrepro.dataset.motion.knots import Knots, smoothed, thinned
from tendonrepro.dataset.motion.period import refined_shift, repeat_after, roundest
from tendonrepro.dataset.motion.record import Recorded, recorded
from tendonrepro.dataset.motion.shapes import Turns, amplitude_of, cycle_of, movers, turns_of
from tendonrepro.dataset.motion.windows import Timing
from tendonrepro.errors import DataMissingError
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS

_SAME_TIME = 0.05
"""Share of a sample by which two runs' motions may be apart and still begin at one time."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A recovered reference.

    Parameters
    ----------
    run : str
        Run it was read from.
    record : Recorded
        The desired angles.
    knots : Knots
        What a trajectory file holds.
    period : float
        s; 0 where it does not repeat and has no named shape.
    begin, end : float
        First and last instant of the motion, s after the first sample.
    fitted : tuple of Fit
        Shapes that were tried, best first.
    turns : Turns or None
        Cycles of a motion with a named shape that comes back to its start.
    """

    run: str
    record: Recorded
    knots: Knots
    period: float
    begin: float
    end: float
    fitted: tuple[Fit, ...] = ()
    turns: Turns | None = None

    @property
    def shape(self) -> Fit | None:
        """The shape, where the best one's residual is small enough to name it."""
        best = self.fitted[0] if self.fitted else None
        return best if best is not None and best.largest <= limit(self.record) else None

    @property
    def delay(self) -> float:
        """Rest before a named motion, s; a sampled one is written with its rest."""
        return _delay(self.shape) if self.shape else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Plain data, angles in degrees."""
        record, shape = self.record, self.shape
        periods = None
        if self.turns:
            periods = self.turns.pattern()[1]
        elif self.period:
            periods = max(int(np.ceil((self.end - self.begin) / self.period - 0.02)), 1)
        return {
            "run": self.run,
            "joints": list(record.joint),
            "kind": shape.kind if shape else "sampled",
            "parameters": shape.parameters() if shape else {},
            "period_s": round(self.period, 9) or None,
            "periods": periods,
            "begin_s": round(self.begin, 9),
            "end_s": self.end,
            "start_angle_deg": np.rad2deg(record.start_angle).tolist(),
            "amplitude_deg": np.rad2deg(np.ptp(record.q, axis=0)).tolist(),
            "rounding_deg": math.degrees(record.rounding),
            "missing_samples": record.missing,
            "residual_limit_deg": math.degrees(limit(record)),
            "shapes": [
                {
                    "kind": fit.kind,
                    "largest_residual_deg": math.degrees(fit.largest),
                    "rms_residual_deg": math.degrees(fit.rms),
                }
                for fit in self.fitted
            ],
            "spacing_s": self.knots.spacing,
            "deviation_deg": math.degrees(self.knots.deviation),
            "tolerance_deg": math.degrees(self.knots.tolerance),
            "faded_in_s": self.knots.faded,
            "brought_to_rest": self.knots.braked,
        }


def _delay(shape: Fit) -> float:
    return max(float(shape.values["delay"]), 0.0)


def recover(file: TraceFile) -> Reference:
    """Recover the reference of a measured comparison from the first run that recorded it for both joints.

    Raises
    ------
    DataMissingError
        If no run holds the desired angles, or they do not move.
    """
    holding = [trace for trace in file.part("compare").runs.values() if "q_d" in trace]
    if not holding:
        message = "no run of the comparison holds the desired joint angles q_d"
        raise DataMissingError(message)
    problems = []
    for trace in sorted(holding, key=lambda trace: (not _complete(trace), trace.name not in CONTROLLERS)):
        try:
            return recover_run(trace.of_joints(COMPARED))
        except DataMissingError as problem:
            problems.append(problem)
    raise problems[0]


def _complete(trace: Trace) -> bool:
    """Whether a run recorded the desired angles of both joints of the comparison."""
    columns = zip(trace.joint, trace["q_d"].T, strict=True)
    return {*COMPARED} <= {joint for joint, values in columns if np.isfinite(values).any()}


def recover_run(trace: Trace, variable: str = "q_d") -> Reference:
    """Recover the motion of one run; see `recover`."""
    record = recorded_motion(trace, variable)
    first, last = record.moving()
    begin, end = float(record.time[first]), float(record.time[last])
    repeats = repeat_after(record)
    found = Reference(trace.name, record, thinned(record), repeats, begin, end, tuple(fits(record, repeats)))
    if found.shape is None:
        return replace(found, begin=_begin_of(record), period=roundest(repeats, 0.5 * record.step))
    turns = None if found.shape.kind == "sine" else turns_of(record)
    period = cycle_of(found.shape.values) * (len(turns.pattern()[0]) if turns else 1)
    return replace(found, begin=found.delay, period=period, turns=turns)


def _begin_of(record: Recorded) -> float:
    """When a motion begins whose joints have no common shape: told by those that have one of their own."""
    joints = [record.of(column) for column in movers(amplitude_of(record))]
    best = [(joint, fit) for joint in joints for fit in fits(joint, repeat_after(joint))[:1]]
    delays = [_delay(fit) for joint, fit in best if fit.largest <= limit(joint)]
    return min(delays) if delays else float(record.time[record.moving()[0]])


def recorded_motion(trace: Trace, variable: str) -> Recorded:
    """Put a recorded variable on an even grid, and refuse one at rest; see `recorded`."""
    record = recorded(trace, variable)
    if record.range == 0.0:
        message = f"run {trace.name!r}: {variable} does not move"
        raise DataMissingError(message)
    return record


def timing_of(file: TraceFile, reference: Reference | None) -> dict[str, Timing]:
    """Start and period of the motion of every run of a comparison.

    A run's own start is told by when its desired angles first move, against the run of the reference. The
    period is the one a run states, else that of the reference.
    """
    found = {}
    for name, trace in file.part("compare").runs.items():
        stated = float(trace.attributes["reference_period"])
        start, period = float(trace.time[0]), stated
        if reference is not None:
            period = stated or reference.period
            start += reference.begin + _later(trace, reference)
        found[name] = Timing(start, period)
    return found


def zero_of(trace: Trace, reference: Reference) -> float:
    """Time on a run's own axis at which a rerun on the recovered reference begins, s."""
    return float(trace.time[0]) + reference.delay + _later(trace, reference)


def _later(trace: Trace, reference: Reference) -> float:
    """How much later than in the reference's run a run's desired angles move, s.

    When they first leave their start is a first guess; rounding hides that, so all of the motion refines it.
    """
    if "q_d" not in trace or trace.name == reference.run:
        return 0.0
    try:
        record = recorded(trace.of_joints(COMPARED))
    except DataMissingError:
        return 0.0
    if record.joint != reference.record.joint:
        return 0.0
    guess = float(record.time[record.moving()[0]] - reference.record.time[reference.record.moving()[0]])
    late = refined_shift(record, reference.record, guess)
    return late if abs(late) > _SAME_TIME * record.step else 0.0


def derivatives(trace: Trace) -> tuple[Array, Array]:
    """Desired velocity and acceleration at a run's samples, (T, n): recorded, else of the smoothed motion.

    Raises
    ------
    DataMissingError
        If the run holds no desired angles.
    """
    if all(name in trace and np.isfinite(trace[name]).all() for name in ("dq_d", "ddq_d")):
        return trace["dq_d"], trace["ddq_d"]
    spline = smoothed(recorded(trace)).spline
    time = trace.time - trace.time[0]
    return spline(time, 1), spline(time, 2)
