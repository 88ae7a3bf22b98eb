"""Statistics of a run gathered sample by sample, so that no trace has to be kept.

:func:`add_sample` is a pure function of sums and one sample; it runs on numbers, lanes and symbols alike.
:func:`finished` turns sums into statistics. All are per joint, in SI units.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose

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

    Speed from which a joint moves up or down, (n,), rad s⁻¹, acceleration from which it moves rapidly, (n,),
    rad s⁻², the weight of the newest sample in a low-pass at `SLOW`, and the samples of the first period.
    """

    speed: Array
    acceleration: Array
    newest: Any
    period: Any


class Sample(NamedTuple):
    """What one sample contributes, each (n,); ``epsilon`` is that of the sample before."""

    e: Array
    de: Array
    dq_d: Array
    ddq_d: Array
    s: Array
    tau: Array
    tau_before: Array
    H_hat: Array
    epsilon: Array
    saturated: Array


class Sums(NamedTuple):
    """Sums over the samples so far, each (n,).

    Those named ``max_`` are maxima, ``overshoot`` too; ``direction`` is that of the last stroke. Those named
    ``slow_`` are low-passed signals as they stand, ``abs_slow_`` sums of their magnitudes.
    """

    abs_e: Array
    sq_e: Array
    max_e: Array
    abs_e_late: Array
    sq_e_late: Array
    late: Array
    abs_e_rapid: Array
    rapid: Array
    up: Array
    down: Array
    direction: Array
    overshoot: Array
    sq_s: Array
    slow_s: Array
    sq_slow_s: Array
    max_s: Array
    max_rate: Array
    sq_tau: Array
    sq_tau_up: Array
    sq_tau_down: Array
    max_tau: Array
    max_tau_up: Array
    max_tau_down: Array
    slow_tau: Array
    abs_slow_tau: Array
    abs_slow_tau_up: Array
    abs_slow_tau_down: Array
    sq_H: Array
    sq_H_up: Array
    sq_H_down: Array
    max_H: Array
    max_H_up: Array
    max_H_down: Array
    slow_H: Array
    abs_slow_H: Array
    abs_slow_H_up: Array
    abs_slow_H_down: Array
    sq_change: Array
    sq_epsilon: Array
    slow_epsilon: Array
    sq_slow_epsilon: Array
    max_epsilon: Array
    saturated: Array


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

``late`` is after the first period; ``rapid`` is where the size of ddq_d is above half its peak and ``calm``
elsewhere; ``up`` and ``down`` where dq_d is beyond 5 % of its peak. ``overshoot`` is the largest error past
the target, seen in the direction of the last stroke, while dq_d is within 1 % of its peak. ``peak`` is the
largest magnitude, ``slow`` the mean magnitude of a signal after a first-order low-pass at `SLOW`,
``s_slow_rms`` and ``epsilon_slow_rms`` the RMS of s and of epsilon, Eq. (19), after the same low-pass.
``torque_step_rms`` is of the change from sample to sample, ``saturated`` the share of samples at the torque
limit, ``fast_share`` the share of the error's power above the ringing frequency.
"""


def thresholds(dq_d: Array, ddq_d: Array, L: float, period: float = 0.0) -> Thresholds:
    """Thresholds of a reference.

    Parameters
    ----------
    dq_d, ddq_d : array (T, n)
        Desired velocity and acceleration.
    L : float
        Time between samples, s.
    period : float
        Samples of a period; 0 where there is none, and then the whole motion is its first.
    """
    speed, acceleration = MOVING * np.abs(dq_d).max(axis=0), RAPID * np.abs(ddq_d).max(axis=0)
    newest = np.float64(-np.expm1(-2.0 * np.pi * SLOW * L))
    return Thresholds(speed, acceleration, newest, np.float64(period or dq_d.shape[0]))


def add_sample(sums: Sums, sample: Sample, live: Any, k: Any, phases: Thresholds) -> Sums:
    """Sums after sample ``k``, from 0; unless ``live`` is 1 they stay, whatever the sample holds."""
    columns = [
        _add_joint(*(Sums(*(f[i] for f in sums)), Sample(*(f[i] for f in sample))), live, k, phases, i)
        for i in range(sample.e.shape[0])
    ]
    return Sums(*(_column(values) for values in zip(*columns, strict=True)))


def _column(values: tuple[Any, ...]) -> Array:
    column = np.empty(len(values), dtype=object if not isinstance(values[0], float) else float)
    for i, value in enumerate(values):
        column[i] = value
    return column


def _add_joint(sums: Any, x: Any, live: Any, k: Any, phases: Thresholds, i: int) -> Sums:
    size, square = abs(x.e), x.e * x.e
    up, down = live * (x.dq_d > phases.speed[i]), live * (x.dq_d < -phases.speed[i])
    late, rapid = live * (k >= phases.period), live * (abs(x.ddq_d) > phases.acceleration[i])
    still = live * (abs(x.dq_d) <= RESTING / MOVING * phases.speed[i])
    direction = choose(up > 0.0, 1.0, choose(down > 0.0, -1.0, sums.direction))
    change = choose(k > 0.0, x.tau - x.tau_before, 0.0)

    def plus(total: Any, value: Any, when: Any) -> Any:
        return total + choose(when > 0.0, value, 0.0)

    def top(total: Any, value: Any, when: Any) -> Any:
        return np.maximum(total, choose(when > 0.0, value, total))

    def slowed(before: Any, value: Any) -> Any:
        moved = before + phases.newest * (value - before)
        return choose(live > 0.0, choose(k > 0.0, moved, value), before)

    def sizes(name: str, value: Any) -> dict[str, Any]:
        slow = slowed(getattr(sums, f"slow_{name}"), value)
        found = {f"slow_{name}": slow}
        for phase, when in zip(PHASES, (live, up, down), strict=True):
            found |= {
                f"sq_{name}{phase}": plus(getattr(sums, f"sq_{name}{phase}"), value * value, when),
                f"max_{name}{phase}": top(getattr(sums, f"max_{name}{phase}"), abs(value), when),
                f"abs_slow_{name}{phase}": plus(getattr(sums, f"abs_slow_{name}{phase}"), abs(slow), when),
            }
        return found

    s, epsilon = slowed(sums.slow_s, x.s), slowed(sums.slow_epsilon, x.epsilon)
    return Sums(
        abs_e=plus(sums.abs_e, size, live),
        sq_e=plus(sums.sq_e, square, live),
        max_e=top(sums.max_e, size, live),
        abs_e_late=plus(sums.abs_e_late, size, late),
        sq_e_late=plus(sums.sq_e_late, square, late),
        late=sums.late + late,
        abs_e_rapid=plus(sums.abs_e_rapid, size, rapid),
        rapid=sums.rapid + rapid,
        up=sums.up + up,
        down=sums.down + down,
        direction=direction,
        overshoot=top(sums.overshoot, -direction * x.e, still),
        sq_s=plus(sums.sq_s, x.s * x.s, live),
        slow_s=s,
        sq_slow_s=plus(sums.sq_slow_s, s * s, live),
        max_s=top(sums.max_s, abs(x.s), live),
        max_rate=top(sums.max_rate, abs(x.de), live),
        **sizes("tau", x.tau),
        **sizes("H", x.H_hat),
        sq_change=plus(sums.sq_change, change * change, live),
        sq_epsilon=plus(sums.sq_epsilon, x.epsilon * x.epsilon, live),
        slow_epsilon=epsilon,
        sq_slow_epsilon=plus(sums.sq_slow_epsilon, epsilon * epsilon, live),
        max_epsilon=top(sums.max_epsilon, abs(x.epsilon), live),
        saturated=sums.saturated + live * x.saturated,
    )


def finished(sums: Sums, count: Any, fast_share: Array) -> dict[str, Array]:
    """Statistics by name, (n, ...), from sums over ``count`` samples; NaN where a phase has no sample."""
    count = np.asarray(count, dtype=np.float64)
    # The first sample has no change and no epsilon: that comes one sample late.
    pairs = np.maximum(count - 1.0, 0.0)

    def mean(total: Array, number: Any) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(number > 0.0, total / number, np.nan)

    found = {
        "mae": mean(sums.abs_e, count),
        "rmse": np.sqrt(mean(sums.sq_e, count)),
        "max_error": sums.max_e,
        "mae_late": mean(sums.abs_e_late, sums.late),
        "rmse_late": np.sqrt(mean(sums.sq_e_late, sums.late)),
        "mae_rapid": mean(sums.abs_e_rapid, sums.rapid),
        "mae_calm": mean(sums.abs_e - sums.abs_e_rapid, count - sums.rapid),
        "overshoot": sums.overshoot,
        "s_rms": np.sqrt(mean(sums.sq_s, count)),
        "s_slow_rms": np.sqrt(mean(sums.sq_slow_s, count)),
        "s_max": sums.max_s,
        "rate_max": sums.max_rate,
        "torque_step_rms": np.sqrt(mean(sums.sq_change, pairs)),
        "epsilon_rms": np.sqrt(mean(sums.sq_epsilon, pairs)),
        "epsilon_slow_rms": np.sqrt(mean(sums.sq_slow_epsilon, pairs)),
        "epsilon_max": sums.max_epsilon,
        "saturated": mean(sums.saturated, count),
        "fast_share": fast_share,
    }
    for (signal, name), (phase, number) in product(
        SIGNALS.items(), zip(PHASES, (count, sums.up, sums.down), strict=True)
    ):
        peak = getattr(sums, f"max_{name}{phase}")
        found |= {
            f"{signal}_rms{phase}": np.sqrt(mean(getattr(sums, f"sq_{name}{phase}"), number)),
            f"{signal}_peak{phase}": np.where(np.asarray(number) > 0.0, peak, np.nan),
            f"{signal}_slow{phase}": mean(getattr(sums, f"abs_slow_{name}{phase}"), number),
        }
    return {name: found[name] for name in STATISTICS}
