"""Statistics of a run gathered sample by sample; per joint, SI."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tendonrepro.arrays import Array, Numeric, choose
from tendonrepro.physics.metrics import START

MOVING = 0.05
"""Share of the peak speed beyond which a joint counts as moving up or down."""
RESTING = 0.01
"""Share of the peak speed up to which a joint rests; with 0.05 the lag at the start of a stroke would count
as overshoot of the last."""
RAPID = 0.5
"""Share of the peak acceleration above which a motion counts as rapid."""
AT_LIMIT = 1.0 - 1e-12
"""Share of the largest torque from which a motor gives all it can: rounding keeps it from the whole."""
SLOW = 3.0
"""Frequency below which a signal is the course that a plot shows through its noise, Hz.

Twice the fastest pole of the printed error dynamics (lambda = 8 rad/s, 1.3 Hz) and ten times the fastest
motion of the box; what is faster the error hardly follows, and the shipped ``status`` calls it ringing.
"""


class Thresholds(NamedTuple):
    """What tells the phases of a reference apart.

    Joints move up or down from a speed, and rapidly from an acceleration, (n,), SI. `newest` is the weight in
    a low-pass at `SLOW`, `period` the samples of the first period, `start` those of the first `START` s.
    """

    speed: Array
    acceleration: Array
    newest: float
    period: float
    start: float


Signals: TypeAlias = Mapping[str, Array]
"""What one sample contributes, each (n,): ``e``, ``de``, ``s``, ``tau``, ``H``, ``epsilon``, ``saturated``.

Beside them ``dq_d`` and ``ddq_d``, and ``tau_before`` of the sample before. Of that is ``epsilon``, too, for
it needs the acceleration that follows. At the first sample it is zero: before a run there is no estimate that
could err.
"""

How: TypeAlias = Literal["mean", "rms", "peak"]
"""Mean magnitude of a signal, its RMS, or its largest magnitude."""


class Measure(NamedTuple):
    """How a statistic comes from a signal during a phase; without one, of the whole run."""

    how: How
    of: str
    during: str = ""


MEASURES: Mapping[str, Measure] = {
    "mae": Measure("mean", "e"),
    "rmse": Measure("rms", "e"),
    "max_error": Measure("peak", "e"),
    "mae_late": Measure("mean", "e", "_late"),
    "rmse_late": Measure("rms", "e", "_late"),
    "mae_settled": Measure("mean", "e", "_settled"),
    "rmse_settled": Measure("rms", "e", "_settled"),
    "mae_rapid": Measure("mean", "e", "_rapid"),
    "mae_calm": Measure("mean", "e", "_calm"),
    "overshoot": Measure("peak", "past"),
    "s_rms": Measure("rms", "s"),
    "s_slow_rms": Measure("rms", "slow_s"),
    "s_max": Measure("peak", "s"),
    "rate_max": Measure("peak", "de"),
    **{
        f"{words}_{size}{phase}": measure
        for words, signal in (("torque", "tau"), ("H_hat", "H"))
        for phase in ("", "_up", "_down")
        for size, measure in (
            ("rms", Measure("rms", signal, phase)),
            ("peak", Measure("peak", signal, phase)),
            ("slow", Measure("mean", f"slow_{signal}", phase)),
        )
    },
    "torque_step_rms": Measure("rms", "change"),
    "epsilon_rms": Measure("rms", "epsilon"),
    "epsilon_slow_rms": Measure("rms", "slow_epsilon"),
    "epsilon_max": Measure("peak", "epsilon"),
    "saturated": Measure("mean", "saturated"),
}
"""Statistics by name, those of many runs and those of a trace; ``fast_share`` is beside them.

``_late`` is after the first period, ``_settled`` after `START`. ``_rapid`` is where the size of ddq_d is
above half its peak and ``_calm`` elsewhere; ``_up`` and ``_down`` where dq_d is beyond 5 % of its peak.
``past`` is the error past the target, in the direction of the last stroke, while dq_d is within 1 % of its
peak.
``change`` is from sample to sample, ``saturated`` 1 at the torque limit.

``slow_`` is a signal after a first-order low-pass at `SLOW`. It begins with the first sample, but with zero
for epsilon, Eq. (19): from a cold start the first epsilon is a pulse of one sample, no slow course. The last
sample's epsilon is not known.
"""

STATISTICS = (*MEASURES, "fast_share")
"""Names of the statistics of a run; the last is the share of the error's power that rings."""

SLOWED = ("s", "epsilon", "tau", "H")
"""Signals that are low-passed."""
COUNTED = ("_up", "_down", "_late", "_settled", "_rapid")
"""Phases whose samples are counted."""
SUMMED = {name: measure for name, measure in MEASURES.items() if measure.during != "_calm"}
"""Statistics with a sum of their own; what is calm is what is not rapid."""
SUMS = ("direction", *(f"slow_{name}" for name in SLOWED), *COUNTED, *SUMMED)
"""Names of the sums of a run."""

Sums: TypeAlias = dict[str, Array]
"""Sums over the samples so far, each (n,), by the names of `SUMS`.

``direction`` is that of the last stroke, ``slow_`` a low-passed signal. The sum of a statistic is of
magnitudes or squares, or the largest magnitude.
"""


def thresholds(dq_d: Array, ddq_d: Array, L: float, period: float = 0.0) -> Thresholds:
    """Thresholds of a reference (T, n); the period is in samples, 0 for the whole motion."""
    speed, acceleration = MOVING * peak(dq_d), RAPID * peak(ddq_d)
    newest = np.float64(-np.expm1(-2.0 * np.pi * SLOW * L))
    start = np.float64(round(START / L)) if np.isfinite(L) else np.float64(0.0)
    return Thresholds(speed, acceleration, newest, np.float64(period or dq_d.shape[0]), start)


def peak(signal: Array) -> Array:
    """Largest magnitude, (n,), of a signal (T, n)."""
    # Along short rows NumPy takes ten times as long.
    return np.asarray(np.abs(signal.T, order="C").max(axis=1))


def add_sample(
    sums: Mapping[str, Array], signals: Signals, live: Numeric, k: Numeric, phases: Thresholds
) -> Sums:
    """Sums after sample ``k``, from 0; unless ``live`` is 1 they stay."""
    joints = []
    for i in range(len(phases.speed)):
        before, of_joint = ({name: each[i] for name, each in part.items()} for part in (sums, signals))
        of_rates = phases._replace(speed=phases.speed[i], acceleration=phases.acceleration[i])
        joints.append(_add_joint(before, of_joint, live, k, of_rates))
    kind = float if isinstance(joints[0]["mae"], float) else object
    return {name: np.array([joint[name] for joint in joints], dtype=kind) for name in sums}


def phases_of(dq_d: Numeric, ddq_d: Numeric, phases: Thresholds) -> dict[str, Numeric]:
    """Whether a desired motion is in each phase that its rates tell; of one sample, or arrays (T, n)."""
    return {
        "_up": dq_d > phases.speed,
        "_down": dq_d < -phases.speed,
        "_rapid": abs(ddq_d) > phases.acceleration,
        "still": abs(dq_d) <= RESTING / MOVING * phases.speed,
    }


def _add_joint(
    sums: Mapping[str, Numeric],
    given: Mapping[str, Numeric],
    live: Numeric,
    k: Numeric,
    phases: Thresholds,
) -> dict[str, Numeric]:
    inside = phases_of(given["dq_d"], given["ddq_d"], phases)
    inside |= {"_late": k >= phases.period, "_settled": k >= phases.start}
    during = {"": live} | {name: choose(live > 0.0, phase, 0.0) for name, phase in inside.items()}
    up, down, still = (during[name] > 0.0 for name in ("_up", "_down", "still"))
    direction = choose(up, 1.0, choose(down, -1.0, sums["direction"]))
    signals = dict(given)
    signals["change"] = choose(k > 0.0, given["tau"] - given["tau_before"], 0.0)
    signals["past"] = past(given["e"], direction, still)
    for name in SLOWED:
        slow = f"slow_{name}"
        # It begins with its first sample.
        course = choose(k > 0.0, slowed(sums[slow], signals[name], phases.newest), signals[name])
        signals[slow] = choose(live > 0.0, course, sums[slow])
    after = {"direction": direction} | {name: signals[name] for name in SUMS if name in signals}
    after |= {name: sums[name] + during[name] for name in COUNTED}
    for name, (how, of, phase) in SUMMED.items():
        value, counts, before = signals[of], during[phase] > 0.0, sums[name]
        if how == "peak":
            after[name] = np.maximum(before, choose(counts, abs(value), before))
        else:
            size = value * value if how == "rms" else abs(value)
            after[name] = before + choose(counts, size, 0.0)
    return after


def past(e: Numeric, direction: Numeric, still: Numeric) -> Numeric:
    """Error past the target, in the direction of the last stroke, while the reference rests; else zero."""
    return choose(still, np.maximum(-direction * e, 0.0), 0.0)


def slowed(before: Numeric, value: Numeric, newest: Numeric) -> Numeric:
    """A signal after the low-pass at `SLOW`, from what it was after it, and its newest value."""
    return before + newest * (value - before)


def finished(sums: Mapping[str, Array], count: ArrayLike, fast_share: Array) -> dict[str, Array]:
    """Statistics by name, (n, ...), from ``count`` samples; NaN where a phase has none."""
    count = np.asarray(count, dtype=np.float64)
    numbers: dict[str, Array] = {"": count} | {phase: sums[phase] for phase in COUNTED}

    def mean(total: Array, number: Array) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(number > 0.0, total / number, np.nan)

    statistics = {"mae_calm": mean(sums["mae"] - sums["mae_rapid"], count - sums["_rapid"])}
    for name, (how, of, phase) in SUMMED.items():
        # The first sample has no change and no epsilon: that comes one sample late.
        late = of in ("change", "epsilon", "slow_epsilon")
        average = mean(sums[name], np.maximum(count - 1.0, 0.0) if late else numbers[phase])
        largest = np.where(numbers[phase] > 0.0, sums[name], np.nan)
        statistics[name] = {"mean": average, "rms": np.sqrt(average), "peak": largest}[how]
    return {name: statistics[name] for name in MEASURES} | {"fast_share": fast_share}
