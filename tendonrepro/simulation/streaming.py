"""Statistics of a run gathered sample by sample; per joint, SI."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from itertools import product
from typing import Generic, NamedTuple, TypeAlias, TypeVar

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


Values = TypeVar("Values", Array, Numeric)


class Sample(NamedTuple, Generic[Values]):
    """What one sample contributes, each (n,) or of one joint.

    ``epsilon`` is of the sample before, for it needs the acceleration that follows. At the first sample it is
    zero: before a run there is no estimate that could err.
    """

    e: Values
    de: Values
    dq_d: Values
    ddq_d: Values
    s: Values
    tau: Values
    tau_before: Values
    H_hat: Values
    epsilon: Values
    saturated: Values


Sums: TypeAlias = dict[str, Array]
"""Sums over the samples so far, each (n,), by name."""

SIGNALS = {"torque": "tau", "H_hat": "H"}
"""Signals whose size is asked for in every way, by the first words of their statistics, and their sums."""
SIZES = ("rms", "peak", "slow")
"""Ways to say how large a signal is."""
PHASES = ("", "_up", "_down")
"""The whole run, moving up, moving down, as names of statistics and sums end."""

STATISTICS = (
    "mae",
    "rmse",
    "max_error",
    "mae_late",
    "rmse_late",
    "mae_settled",
    "rmse_settled",
    "mae_rapid",
    "mae_calm",
    "overshoot",
    "s_rms",
    "s_slow_rms",
    "s_max",
    "rate_max",
    *(f"{signal}_{size}{phase}" for signal, size, phase in product(SIGNALS, SIZES, PHASES)),
    "torque_step_rms",
    "epsilon_rms",
    "epsilon_slow_rms",
    "epsilon_max",
    "saturated",
    "fast_share",
)
"""Names of the statistics of a run.

``late`` is after the first period, ``settled`` after `START`. ``rapid`` is where the size of ddq_d is above
half its peak and ``calm`` elsewhere; ``up`` and ``down`` where dq_d is beyond 5 % of its peak. ``overshoot``
is the largest error past the target, seen in the direction of the last stroke, while dq_d is within 1 % of
its peak. ``peak`` is the largest magnitude, ``slow`` the mean magnitude of a signal after a first-order
low-pass at `SLOW`, ``s_slow_rms`` and ``epsilon_slow_rms`` the RMS of s and of epsilon, Eq. (19), after the
same low-pass. It begins with a signal's first sample, but with zero for epsilon: from a cold start the first
epsilon is a pulse of one sample, no slow course. The last sample's epsilon is not known. ``torque_step_rms``
is of the change from sample to sample, ``saturated`` the share of samples at the torque limit, ``fast_share``
the share of the error's power above the ringing frequency.
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
    sums: Mapping[str, Array], sample: Sample[Array], live: Numeric, k: Numeric, phases: Thresholds
) -> Sums:
    """Sums, by the names of `SUMS`, after sample ``k``, from 0; unless ``live`` is 1 they stay.

    ``max_`` and ``overshoot`` are maxima; ``direction`` is the last stroke's; ``slow_`` are low-passed.
    """
    joints = []
    for i in range(sample.e.shape[0]):
        before = {name: total[i] for name, total in sums.items()}
        of_joint: Sample[Numeric] = Sample(*(part[i] for part in sample))
        joints.append(_add_joint(before, of_joint, live, k, phases, i))
    kind = float if isinstance(joints[0]["abs_e"], float) else object
    return {name: np.array([joint[name] for joint in joints], dtype=kind) for name in sums}


def _add_joint(
    sums: Mapping[str, Numeric], x: Sample[Numeric], live: Numeric, k: Numeric, phases: Thresholds, i: int
) -> dict[str, Numeric]:
    def during(phase: Numeric) -> Numeric:
        return choose(live > 0.0, phase, 0.0)

    size, square = abs(x.e), x.e * x.e
    up, down = during(x.dq_d > phases.speed[i]), during(x.dq_d < -phases.speed[i])
    late, rapid = during(k >= phases.period), during(abs(x.ddq_d) > phases.acceleration[i])
    settled = during(k >= phases.start)
    still = during(abs(x.dq_d) <= RESTING / MOVING * phases.speed[i])
    direction = choose(up > 0.0, 1.0, choose(down > 0.0, -1.0, sums["direction"]))
    change = choose(k > 0.0, x.tau - x.tau_before, 0.0)

    signals = {"s": x.s, "epsilon": x.epsilon, "tau": x.tau, "H": x.H_hat}
    slow = {
        name: choose(live > 0.0, _slowed(sums[f"slow_{name}"], value, k, phases), sums[f"slow_{name}"])
        for name, value in signals.items()
    }
    # What is added up, and that whose maximum is kept, each with the samples that count.
    added = {
        "abs_e": (size, live),
        "sq_e": (square, live),
        "abs_e_late": (size, late),
        "sq_e_late": (square, late),
        "late": (1.0, late),
        "abs_e_settled": (size, settled),
        "sq_e_settled": (square, settled),
        "settled": (1.0, settled),
        "abs_e_rapid": (size, rapid),
        "rapid": (1.0, rapid),
        "up": (1.0, up),
        "down": (1.0, down),
        "sq_s": (x.s * x.s, live),
        "sq_slow_s": (slow["s"] * slow["s"], live),
        "sq_change": (change * change, live),
        "sq_epsilon": (x.epsilon * x.epsilon, live),
        "sq_slow_epsilon": (slow["epsilon"] * slow["epsilon"], live),
        "saturated": (x.saturated, live),
    }
    largest = {
        "max_e": (size, live),
        "overshoot": (-direction * x.e, still),
        "max_s": (abs(x.s), live),
        "max_rate": (abs(x.de), live),
        "max_epsilon": (abs(x.epsilon), live),
    }
    for name, (phase, when) in product(SIGNALS.values(), zip(PHASES, (live, up, down), strict=True)):
        added[f"sq_{name}{phase}"] = signals[name] * signals[name], when
        added[f"abs_slow_{name}{phase}"] = abs(slow[name]), when
        largest[f"max_{name}{phase}"] = abs(signals[name]), when
    return {
        "direction": direction,
        **{f"slow_{name}": value for name, value in slow.items()},
        **{name: sums[name] + choose(when > 0.0, value, 0.0) for name, (value, when) in added.items()},
        **{
            name: np.maximum(sums[name], choose(when > 0.0, value, sums[name]))
            for name, (value, when) in largest.items()
        },
    }


def _slowed(before: Numeric, value: Numeric, k: Numeric, phases: Thresholds) -> Numeric:
    """A signal after the low-pass at `SLOW`, which begins with its first sample."""
    return choose(k > 0.0, before + phases.newest * (value - before), value)


_NOTHING = Thresholds(np.zeros(1), np.zeros(1), 0.0, 0.0, 0.0)
SUMS = tuple(_add_joint(defaultdict(float), Sample(*np.zeros(len(Sample._fields))), 1.0, 0.0, _NOTHING, 0))
"""Names of the sums of a run."""


def finished(sums: Mapping[str, Array], count: ArrayLike, fast_share: Array) -> dict[str, Array]:
    """Statistics by name, (n, ...), from ``count`` samples; NaN where a phase has none."""
    count = np.asarray(count, dtype=np.float64)
    # The first sample has no change and no epsilon: that comes one sample late.
    pairs = np.maximum(count - 1.0, 0.0)

    def mean(total: Array, number: Array) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(number > 0.0, total / number, np.nan)

    statistics = {
        "mae": mean(sums["abs_e"], count),
        "rmse": np.sqrt(mean(sums["sq_e"], count)),
        "max_error": sums["max_e"],
        "mae_late": mean(sums["abs_e_late"], sums["late"]),
        "rmse_late": np.sqrt(mean(sums["sq_e_late"], sums["late"])),
        "mae_settled": mean(sums["abs_e_settled"], sums["settled"]),
        "rmse_settled": np.sqrt(mean(sums["sq_e_settled"], sums["settled"])),
        "mae_rapid": mean(sums["abs_e_rapid"], sums["rapid"]),
        "mae_calm": mean(sums["abs_e"] - sums["abs_e_rapid"], count - sums["rapid"]),
        "overshoot": sums["overshoot"],
        "s_rms": np.sqrt(mean(sums["sq_s"], count)),
        "s_slow_rms": np.sqrt(mean(sums["sq_slow_s"], count)),
        "s_max": sums["max_s"],
        "rate_max": sums["max_rate"],
        "torque_step_rms": np.sqrt(mean(sums["sq_change"], pairs)),
        "epsilon_rms": np.sqrt(mean(sums["sq_epsilon"], pairs)),
        "epsilon_slow_rms": np.sqrt(mean(sums["sq_slow_epsilon"], pairs)),
        "epsilon_max": sums["max_epsilon"],
        "saturated": mean(sums["saturated"], count),
        "fast_share": fast_share,
    }
    for (signal, name), (phase, number) in product(
        SIGNALS.items(), zip(PHASES, (count, sums["up"], sums["down"]), strict=True)
    ):
        peak = sums[f"max_{name}{phase}"]
        statistics |= {
            f"{signal}_rms{phase}": np.sqrt(mean(sums[f"sq_{name}{phase}"], number)),
            f"{signal}_peak{phase}": np.where(np.asarray(number) > 0.0, peak, np.nan),
            f"{signal}_slow{phase}": mean(sums[f"abs_slow_{name}{phase}"], number),
        }
    return {name: statistics[name] for name in STATISTICS}
