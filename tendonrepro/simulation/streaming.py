"""Statistics of a run gathered sample by sample, so that no trace has to be kept.

:func:`add_sample` is a pure function of sums and one sample; it runs on numbers, lanes and symbols alike.
:func:`finished` turns sums into statistics. All are per joint, in SI units.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose

MOVING = 0.05
"""Share of the peak speed beyond which a joint counts as moving up or down."""
RAPID = 0.5
"""Share of the peak acceleration above which a motion counts as rapid."""


class Thresholds(NamedTuple):
    """What tells the phases of a reference apart.

    Speed from which a joint moves up or down, (n,), rad s⁻¹, acceleration from which it moves rapidly, (n,),
    rad s⁻², and samples of the first period.
    """

    speed: Array
    acceleration: Array
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

    Those named ``max_`` are maxima, ``overshoot`` too; ``direction`` is that of the last stroke.
    """

    abs_e: Array
    sq_e: Array
    max_e: Array
    abs_e_late: Array
    sq_e_late: Array
    abs_e_rapid: Array
    rapid: Array
    abs_e_up: Array
    up: Array
    abs_e_down: Array
    down: Array
    direction: Array
    overshoot: Array
    sq_s: Array
    max_s: Array
    max_rate: Array
    sq_tau: Array
    max_tau: Array
    sq_change: Array
    tau_up: Array
    tau_down: Array
    sq_H: Array
    H_up: Array
    H_down: Array
    sq_epsilon: Array
    max_epsilon: Array
    saturated: Array


STATISTICS = (
    "mae",
    "rmse",
    "max_error",
    "mae_late",
    "rmse_late",
    "mae_rapid",
    "mae_calm",
    "mae_up",
    "mae_down",
    "overshoot",
    "s_rms",
    "s_max",
    "rate_max",
    "torque_rms",
    "torque_max",
    "torque_step_rms",
    "torque_up",
    "torque_down",
    "H_hat_rms",
    "H_hat_up",
    "H_hat_down",
    "epsilon_rms",
    "epsilon_max",
    "saturated",
    "fast_share",
)
"""Names of the statistics of a run.

``late`` is after the first period; ``rapid`` where the size of ddq_d is above half its peak and ``calm``
elsewhere; ``up`` and ``down`` where dq_d is beyond 5 % of its peak. ``overshoot`` is the largest error past
the target, seen in the direction of the last stroke, while the reference rests. ``torque_step_rms`` is of the
change from sample to sample, ``epsilon`` of Eq. (19), ``saturated`` the share of samples at the torque limit,
``fast_share`` the share of the error's power above the ringing frequency.
"""


def thresholds(dq_d: Array, ddq_d: Array, period: float) -> Thresholds:
    """Thresholds of a reference.

    Parameters
    ----------
    dq_d, ddq_d : array (T, n)
        Desired velocity and acceleration.
    period : float
        Samples of a period; 0 where there is none, and then the whole motion is its first.
    """
    whole = float(dq_d.shape[0])
    return Thresholds(
        MOVING * np.abs(dq_d).max(axis=0), RAPID * np.abs(ddq_d).max(axis=0), np.float64(period or whole)
    )


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
    late = live * (k >= phases.period)
    up, down = live * (x.dq_d > phases.speed[i]), live * (x.dq_d < -phases.speed[i])
    rapid = live * (abs(x.ddq_d) > phases.acceleration[i])
    still = live * (abs(x.dq_d) <= phases.speed[i])
    direction = choose(up > 0.0, 1.0, choose(down > 0.0, -1.0, sums.direction))
    change = choose(k > 0.0, x.tau - x.tau_before, 0.0)

    def plus(total: Any, value: Any, when: Any) -> Any:
        return total + choose(when > 0.0, value, 0.0)

    def top(total: Any, value: Any, when: Any) -> Any:
        return np.maximum(total, choose(when > 0.0, value, total))

    return Sums(
        abs_e=plus(sums.abs_e, size, live),
        sq_e=plus(sums.sq_e, square, live),
        max_e=top(sums.max_e, size, live),
        abs_e_late=plus(sums.abs_e_late, size, late),
        sq_e_late=plus(sums.sq_e_late, square, late),
        abs_e_rapid=plus(sums.abs_e_rapid, size, rapid),
        rapid=sums.rapid + rapid,
        abs_e_up=plus(sums.abs_e_up, size, up),
        up=sums.up + up,
        abs_e_down=plus(sums.abs_e_down, size, down),
        down=sums.down + down,
        direction=direction,
        overshoot=top(sums.overshoot, -direction * x.e, still),
        sq_s=plus(sums.sq_s, x.s * x.s, live),
        max_s=top(sums.max_s, abs(x.s), live),
        max_rate=top(sums.max_rate, abs(x.de), live),
        sq_tau=plus(sums.sq_tau, x.tau * x.tau, live),
        max_tau=top(sums.max_tau, abs(x.tau), live),
        sq_change=plus(sums.sq_change, change * change, live),
        tau_up=plus(sums.tau_up, x.tau, up),
        tau_down=plus(sums.tau_down, x.tau, down),
        sq_H=plus(sums.sq_H, x.H_hat * x.H_hat, live),
        H_up=plus(sums.H_up, x.H_hat, up),
        H_down=plus(sums.H_down, x.H_hat, down),
        sq_epsilon=plus(sums.sq_epsilon, x.epsilon * x.epsilon, live),
        max_epsilon=top(sums.max_epsilon, abs(x.epsilon), live),
        saturated=sums.saturated + live * x.saturated,
    )


def finished(sums: Sums, count: Any, period: Any, fast_share: Array) -> dict[str, Array]:
    """Statistics by name, (n, ...), from sums over ``count`` samples; NaN where a phase has no sample."""
    count = np.asarray(count, dtype=np.float64)
    late = np.maximum(count - period, 0.0)
    calm = count - sums.rapid

    def mean(total: Array, number: Any) -> Array:
        number = np.asarray(number, dtype=np.float64)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(number > 0.0, total / number, np.nan)

    return {
        "mae": mean(sums.abs_e, count),
        "rmse": np.sqrt(mean(sums.sq_e, count)),
        "max_error": sums.max_e,
        "mae_late": mean(sums.abs_e_late, late),
        "rmse_late": np.sqrt(mean(sums.sq_e_late, late)),
        "mae_rapid": mean(sums.abs_e_rapid, sums.rapid),
        "mae_calm": mean(sums.abs_e - sums.abs_e_rapid, calm),
        "mae_up": mean(sums.abs_e_up, sums.up),
        "mae_down": mean(sums.abs_e_down, sums.down),
        "overshoot": sums.overshoot,
        "s_rms": np.sqrt(mean(sums.sq_s, count)),
        "s_max": sums.max_s,
        "rate_max": sums.max_rate,
        "torque_rms": np.sqrt(mean(sums.sq_tau, count)),
        "torque_max": sums.max_tau,
        "torque_step_rms": np.sqrt(mean(sums.sq_change, np.maximum(count - 1.0, 0.0))),
        "torque_up": mean(sums.tau_up, sums.up),
        "torque_down": mean(sums.tau_down, sums.down),
        "H_hat_rms": np.sqrt(mean(sums.sq_H, count)),
        "H_hat_up": mean(sums.H_up, sums.up),
        "H_hat_down": mean(sums.H_down, sums.down),
        "epsilon_rms": np.sqrt(mean(sums.sq_epsilon, np.maximum(count - 1.0, 0.0))),
        "epsilon_max": sums.max_epsilon,
        "saturated": mean(sums.saturated, count),
        "fast_share": fast_share,
    }
