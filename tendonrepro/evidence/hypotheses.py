"""What a controller of the paper would have made of a log, as a linear regression for each hypothesis.

Inside one branch of Eq. (12), Eqs. (15) to (18) are linear in delayed torques, differences of encoder angles,
the desired motion, and ``phi``. A hypothesis says which of each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.signal import lfilter

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import AXES, Reading, under
from tendonrepro.evidence.log import Log
from tendonrepro.experiments.loops import PERIODS, build_law
from tendonrepro.physics.control import Law, phi, phi_slope

FORGOTTEN = 20.0
"""Time constants after which a filter has forgotten its start: to 2e-9 of it."""
LINEAR = "linear"
"""Surface of Controller 3 and of plain time-delay control: feedback of the error and its rate alone."""
NTSM = "ntsm"
PRINTED = {name: axis.printed for name, axis in AXES.items()} | {"logged_torque": "applied"}
"""Axes of readings as the paper has them, and which torque is in a log of one torque alone."""
FILTERS = (
    ("error_rate", "low_pass"),
    ("estimate_filter", "acceleration"),
    ("estimate_filter", "estimate"),
    ("reference_acceleration", "late"),
)
"""Places of a low-pass filter, whose cutoff is free."""
_PHI: tuple[tuple[tuple[str, str], ...], ...] = (
    (),
    (("phi_negative", "even"),),
    (("phi_branch", "power"),),
    (("gain_unit", "phi_in_degrees"),),
    (("Delta_unit", "deg"),),
    (("eta_in_controller_2", "dropped"),),
)


_OF_PHI = ("phi_branch", "phi_negative", "gain_unit", "Delta_unit")
"""Axes on which ``phi`` depends."""


@dataclass(frozen=True)
class Hypothesis:
    """A surface, `NTSM` or `LINEAR`, and the readings under which it ran.

    ``settings`` are the axes that are not as in `PRINTED`; ``newest`` is the low-pass filter's weight of the
    newest value.
    """

    surface: str
    settings: tuple[tuple[str, str], ...] = ()
    newest: float = 1.0

    @property
    def readings(self) -> dict[str, str]:
        """Value of every axis."""
        return {**PRINTED, **dict(self.settings)}

    def beside(self, setting: tuple[str, str], newest: float = 1.0) -> Hypothesis:
        """With another setting, and the newest weight of its filter if it is one of `FILTERS`."""
        return replace(self, settings=(*self.settings, setting), newest=newest)

    @property
    def is_pid(self) -> bool:
        """Whether it is a discrete PID without a filter where its weights are 1 and 0."""
        apart = {axis for axis, _ in self.settings} - {"error_rate", "reference_acceleration"}
        return self.surface == LINEAR and self.newest == 1.0 and apart == {"differencing"}

    @property
    def lag(self) -> int:
        """Samples in the delay time."""
        return PERIODS[self.readings["delay_time"]]

    @property
    def remembers_commands(self) -> bool:
        """Whether the torques that it remembers are those it commanded, neither late nor filtered."""
        return (
            self.readings["output_delay"] == "0"
            and self.readings["estimate_filter"] == PRINTED["estimate_filter"]
        )

    @property
    def name(self) -> str:
        """``printed``, or the settings joined by ``+``."""
        return "+".join(f"{axis}={value}" for axis, value in self.settings) or "printed"

    def coefficients(self, parameters: Array) -> Array:
        """Coefficients of the regressors from the ``parameters`` of a `Fit`."""
        w_1, w_2, M_bar, first, second = parameters
        head = [w_1, w_2, -w_1 * M_bar, -w_2 * M_bar, M_bar]
        if self.surface == LINEAR:
            return np.array([*head, M_bar * first, M_bar * second])
        rate = 1.0 if self.readings["eta_in_controller_2"] == "dropped" else second
        return np.array([*head, M_bar * first, M_bar * rate, M_bar * first * second])

    def coefficient_slopes(self, parameters: Array) -> Array:
        """Derivatives of `coefficients` by the parameters, (8, 5), or (7, 5) if linear."""
        # Each is a product of some parameters, so a difference over one is its slope, however long.
        at = self.coefficients(parameters)
        return np.stack([self.coefficients(parameters + step) - at for step in np.eye(5)], axis=1)

    def error_gain(self, parameters: Array) -> Array:
        """Gain of the error over M_bar: ``lam eta``, or ``K_p`` if linear; parameters are the last axis."""
        first, second = parameters[..., 3], parameters[..., 4]
        return np.asarray(second if self.surface == LINEAR else first * second)

    def remembered(self, parameters: Array) -> Array:
        """Weights (2,) of the torques of one and two samples ago in the fitted equation."""
        weights = parameters[:2].copy()
        if self.readings["estimate_filter"] == "estimate":
            weights *= self.newest
            weights[0] += 1.0 - self.newest
        return weights


PID = Hypothesis(LINEAR, (("differencing", "centred"),))
"""The simplest one that a PID has, too; see `Hypothesis.is_pid`."""


def hypotheses(log: Log) -> Iterator[Hypothesis]:
    """Every hypothesis that a log can hold."""
    axes = {
        "differencing": ("lagging", "centred"),
        "delay_time": tuple(PERIODS),
        "error_rate": ("backward_difference", "difference_of_error"),
        "feedback": ("joint",) if log.q_motor is None else ("joint", "motor"),
        "torque_coordinates": ("joint", "winch"),
    }
    for values in product(*axes.values()):
        for stored, delay, logged in _stored(log):
            readings = dict(zip(axes, values, strict=True)) | {"stored_torque": stored, "output_delay": delay}
            readings["logged_torque"] = logged
            changed = tuple((axis, value) for axis, value in readings.items() if value != PRINTED[axis])
            yield Hypothesis(LINEAR, changed)
            yield from (Hypothesis(NTSM, (*of_phi, *changed)) for of_phi in _PHI)


def _stored(log: Log) -> list[tuple[str, str, str]]:
    """Which torque is stored, how many samples late it acts, and which is logged, as far as a log can tell.

    A lone torque may be the one applied or the one commanded. Without a delay these are the same.
    """
    if log.applied is None:
        late = product(("commanded", "applied"), ("1", "2"), ("applied",))
        return [("commanded", "0", "applied"), *late, *product(("applied",), ("1", "2"), ("commanded",))]
    same = np.allclose(log.applied, log.command, rtol=1e-9, atol=1e-12, equal_nan=True)
    stored = ("commanded",) if same else ("commanded", "applied")
    return [(torque, "0", "applied") for torque in stored]


def regression(log: Log, joint: int, hypothesis: Hypothesis) -> Array:
    """Regressors and torque of a hypothesis, (T, 9), or (T, 8) if linear; NaN where it foretells none.

    They are of one joint, counted from 0, or of a winch under that reading. The columns are the torques of
    ``t - L`` and ``t - 2L``, the accelerations of the same times, ``ddq_d``, and the error's rate with the
    error, or with ``phi_slope`` times the rate and ``phi``; last the torque of ``t``.
    """
    readings, i = hypothesis.readings, joint
    lag, L = hypothesis.lag, log.L
    q = log.q[:, i] if readings["feedback"] == "joint" or log.q_motor is None else log.q_motor[:, i]
    command, stored = _torques(log, readings, i)
    step = lag * L
    ddq = (q - 2.0 * _back(q, lag) + _back(q, 2 * lag)) / (step * step)
    if readings["differencing"] == "lagging":
        ddq = _back(ddq, lag)
    if readings["estimate_filter"] == "acceleration":
        ddq = _low_pass(ddq, hypothesis.newest)
    desired, ddq_d = log.dq_d[:, i], log.ddq_d[:, i]
    if readings["reference_acceleration"] == "absent":
        ddq_d = np.zeros_like(ddq_d)
    elif readings["reference_acceleration"] == "late":
        desired, ddq_d = (_low_pass(rate, hypothesis.newest) for rate in (desired, ddq_d))
    if readings["error_rate"] == "difference_of_error":
        desired = (log.q_d[:, i] - _back(log.q_d[:, i], 1)) / L
    e, de = log.q_d[:, i] - q, desired - (q - _back(q, 1)) / L
    if readings["error_rate"] == "low_pass":
        de = _low_pass(de, hypothesis.newest)
    if hypothesis.surface == LINEAR:
        feedback = [de, e]
    else:
        law = _phi_law(log, tuple((axis, readings[axis]) for axis in _OF_PHI))
        place = log.expected.joints.index(log.joints[i])
        feedback = [de, phi_slope(e, law, place) * de, phi(e, law, place)]
    estimate = [_back(stored, lag), _back(stored, 2 * lag), ddq, _back(ddq, lag)]
    acceleration = [ddq_d, *feedback]
    y = command
    if readings["estimate_filter"] == "estimate":
        # The estimate of before is the torque of before less M_bar u.
        kept = 1.0 - hypothesis.newest
        y = command - kept * _back(command, 1)
        estimate = [hypothesis.newest * column for column in estimate]
        acceleration = [column - kept * _back(column, 1) for column in acceleration]
    columns = np.stack([*estimate, *acceleration, y], axis=1)
    columns[_limited(log, lag)] = np.nan
    return columns


def _torques(log: Log, readings: Mapping[str, str], i: int) -> tuple[Array, Array]:
    """Torque that the law commanded, and that it stores, at each sample."""
    command, applied = log.command, log.command if log.applied is None else log.applied
    if readings["torque_coordinates"] == "winch":
        command, applied = command @ log.S, applied @ log.S
    delay = int(readings["output_delay"])
    if readings["logged_torque"] == "commanded":
        return command[:, i], _back(command[:, i], delay)
    commanded = np.full(len(command), np.nan)
    commanded[: len(command) - delay] = command[delay:, i]
    return commanded, commanded if readings["stored_torque"] == "commanded" else applied[:, i]


@lru_cache(maxsize=len(PERIODS) * 2)
def _limited(log: Log, lag: int) -> NDArray[np.bool_]:
    """Samples near which a torque that enters stands at a motor's limit; the same for every hypothesis."""
    torque = np.abs((log.command if log.applied is None else log.applied) @ log.S)
    at_limit = torque >= (1.0 - 1e-9) * np.fmax.reduce(torque, axis=0)
    # A single largest value is a peak; a limit is met again and again.
    late = (at_limit & (at_limit.sum(axis=0) > 5)).any(axis=1)
    return np.asarray(binary_dilation(late, np.ones(4 * lag + 5, dtype=bool)))


@cache
def _phi_law(log: Log, of_phi: tuple[tuple[str, str], ...]) -> Law:
    """A law of the configuration that the log is compared with, under readings of ``phi``."""
    config = under(Reading("", of_phi), log.expected, {})
    return build_law(config, next(iter(config.control.laws)))


def _low_pass(values: Array, newest: float) -> Array:
    """First-order low-pass; what it was before the log is forgotten first."""
    filtered, known = np.full_like(values, np.nan), np.isfinite(values)
    filtered[known] = lfilter([newest], [1.0, newest - 1.0], values[known])
    filtered[: min(int(FORGOTTEN / newest), len(values) // 2)] = np.nan
    return filtered


def _back(values: Array, samples: int) -> Array:
    """Values some samples earlier; NaN before the first."""
    earlier = np.full_like(values, np.nan)
    earlier[samples:] = values[: len(values) - samples]
    return earlier
