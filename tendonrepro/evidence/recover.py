"""Which controller made a log.

1. ``log.py`` puts each run on the controller's samples, takes the rounding of encoders off, and finds the
   desired motion with its derivatives.
2. ``hypotheses.py`` writes Eqs. (15) to (18), under every surface and reading that a log can tell, as a
   linear regression of one joint's torque.
3. ``fit.py`` tries all of them by least squares on the fastest stretch: a fit to even blocks of samples has
   to predict odd ones. The best few are fitted to all samples with the controller's own five parameters, with
   intervals by the jackknife, and ranked by the Bayesian information criterion. If none is exact, low-pass
   filters are tried, too.
4. `RecoveredController` judges the best: does it leave no more than rounding, and are its weights and
   gains the paper's?
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.published import published
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import UsageError
from tendonrepro.evidence.fit import Fit, equally_good, ranked
from tendonrepro.evidence.hypotheses import LINEAR
from tendonrepro.evidence.log import Log, expected_of, read_logs, torque_rounding
from tendonrepro.parallel import Start, counted
from tendonrepro.physics.control import DEGREES_PER_RADIAN, estimator_weights
from tendonrepro.results.records import PlantRecord, TraceFile

RECOVERED, NONE, UNTOLD = "recovered", "none of these", "cannot tell"
FAITHFUL = 1e-3
"""Share of the torque's step that a controller may leave unexplained, beside three times the rounding."""
FOREIGN = 0.2
"""Share above which it was another controller, if the log is fine enough."""
COARSE = 0.1
"""Share of the torque's step that rounding may make up before a log is too coarse."""
CLOSE = 0.01
"""How close recovered weights come to those of an interpretation, beside their interval."""
NEAR = 2.001
"""Factor to which gains are the published ones, and a little, so that twice is inside."""
SAME_NUMBER = 0.02
"""How close M_bar comes to the published one times a unit of the torque."""
OTHER = 0.1
"""Difference of the error's gain from the published one from which gains count as others."""
_WEIGHTS = {
    "interpolating": "as published",
    "extrapolating": "extrapolated (1 + α and −α)",
    "swapped": "exchanged (α and 1 − α)",
}


@dataclass(frozen=True, eq=False)
class RecoveredController:
    """What the log of one joint, by the paper's number, says.

    ``fits`` has the best fit first, if any. ``torque_rounding``, N m, is the record's. The gains that it is
    compared with are the paper's if ``of_paper``.
    """

    joint: int
    fits: list[Fit]
    log: Log
    torque_rounding: float
    of_paper: bool

    @property
    def expected(self) -> CompareConfig:
        """Configuration with the gains that it is compared with."""
        return self.log.expected

    @property
    def run(self) -> str:
        """Name of the run."""
        return self.log.run

    @property
    def angle_rounding(self) -> float:
        """Rounding of the joint's recorded angle, rad."""
        return float(self.log.angle_rounding[self.log.joints.index(self.joint)])

    @property
    def place(self) -> int:
        """Place of the joint among those with expected gains."""
        return self.expected.joints.index(self.joint)

    @property
    def best(self) -> Fit:
        """Simplest of the fits that are equally good."""
        return self.fits[0]

    @property
    def rounding(self) -> float:
        """RMS of the torque from rounding of the record, as a share of the torque's step."""
        M_bar = self.expected.control.gains.M_bar.si[self.place]
        of_angles = M_bar * self.angle_rounding * np.sqrt(6.0) / self.log.L**2
        both = np.hypot(of_angles, np.sqrt(2.0) * self.torque_rounding) / np.sqrt(12.0)
        return float(both / self.best.step)

    @property
    def equal(self) -> list[Fit]:
        """Fits that the log does not tell apart, the one that is named first before the others."""
        return equally_good(self.fits) if self.fits else []

    @property
    def unexplained(self) -> float:
        """RMS of the torque that the best fit does not foretell, as such a share."""
        return self.best.residual / self.best.step

    @property
    def answer(self) -> str:
        """`RECOVERED`, `NONE` or `UNTOLD`."""
        if not self.fits:
            return UNTOLD
        # Of a time-delay estimate the weights sum to one; feedback without an estimate fits with none.
        balance = abs(self.best.parameters[:2].sum() - 1.0)
        balanced = balance <= CLOSE + self.best.half[:2].sum()
        fine = self.rounding <= COARSE
        allowed = max(FAITHFUL, 3.0 * self.rounding) if fine else FAITHFUL
        # Rounding is in the intervals: where these leave one interpretation, it does not matter.
        if self.best.bias > CLOSE and not self.nearest_weights:
            return UNTOLD
        if balanced and self.unexplained <= allowed:
            # Weights that no interpretation has come from noise, unless the log is exact.
            is_named = bool(self.nearest_weights) or self.unexplained <= FAITHFUL
            return self.by_gains if is_named else UNTOLD
        if not fine or not self.sampled_as_run:
            return UNTOLD
        return NONE if self.unexplained > FOREIGN or not balanced else UNTOLD

    @property
    def position_gain(self) -> tuple[float, float]:
        """Gain of the error over the expected one, and half its 90 % interval."""
        gains, i = self.expected.control.gains, self.place
        linear = self.best.hypothesis.surface == LINEAR
        expected = gains.lam.si[i] * (gains.beta if linear else gains.eta).si[i]
        return float(self.best.error_gain / expected), float(self.best.error_gain_half / expected)

    @property
    def torque_units(self) -> Array:
        """Factors on M_bar by units of the torque: N m at motor shafts, percent of the rated one, volts."""
        config, rated = self.expected, published().number("hardware.rated_torque")
        reduction = config.manipulator.winches.reduction.si
        return np.array([reduction, 0.01 * reduction * rated, reduction * rated / 3.0])

    @property
    def by_gains(self) -> str:
        """`RECOVERED` if M_bar and the error's gain are the expected ones to a factor of two, `NONE` if not.

        `UNTOLD` where a 90 % interval reaches across a bound. A PID is time-delay control with its own M_bar,
        and feedback with gravity one without a gain of the error. In degrees M_bar is 180/pi times as large.
        """
        expected, (gain, gain_half) = self.expected.control.gains.M_bar.si[self.place], self.position_gain
        M_bar = self.best.parameters[2] / expected
        unit = 1.0 if M_bar < np.sqrt(DEGREES_PER_RADIAN) else DEGREES_PER_RADIAN
        # In another unit of the torque only the published number itself tells.
        others = np.outer((1.0, DEGREES_PER_RADIAN), self.torque_units).ravel()
        nearest = float(others[np.argmin(np.abs(np.log(np.abs(M_bar) / others)))])
        if abs(M_bar / nearest - 1.0) <= SAME_NUMBER and not 1.0 / NEAR <= M_bar / unit <= NEAR:
            unit = nearest
        ratios = np.array([M_bar / unit, gain])
        half = np.array([self.best.half[2] / expected / unit, gain_half])
        low, high = ratios - half, ratios + half
        if ((high < 1.0 / NEAR) | (low > NEAR)).any():
            return NONE
        return RECOVERED if ((low >= 1.0 / NEAR) & (high <= NEAR)).all() else UNTOLD

    @property
    def sampled_as_run(self) -> bool:
        """Whether every sample of the controller was recorded."""
        return bool(np.isclose(self.log.L, self.expected.sampling_period.si, rtol=0.05))

    @property
    def advice(self) -> str:
        """What to record instead."""
        if not self.sampled_as_run:
            return f"Record every sample of the controller. This log has one in {1e3 * self.log.L:.4g} ms."
        if not self.fits:
            return "Too few samples inside the motors' limits. Record a longer run."
        if self.rounding > COARSE or self.best.bias > CLOSE:
            return "Record torque and angles with more digits: encoder steps if you can."
        if self.answer == UNTOLD:
            return (
                "The log has noise, or another filter. Record what the controller computed, with all digits."
            )
        if self.by_gains == NONE:
            M_bar, (gain, _) = self.best.parameters[2], self.position_gain
            whose = "published" if self.of_paper else "configured"
            told = f"M_bar is {M_bar:.2g} kg m², and the gain of the error {gain:.2g} of the {whose} one."
            return f"{told} Check unit and coordinates of the torque."
        return ""

    @property
    def weights(self) -> str:
        """Interpretation of Eq. (15) that alone has the weights of a recovered log."""
        # Noise of the record makes light weights fit best, whatever the true ones.
        return self.nearest_weights if self.answer == RECOVERED else ""

    @property
    def nearest_weights(self) -> str:
        """Interpretation of Eq. (15) that alone has the weights of the best fit."""
        return self._weights_of(self.best)

    def _weights_of(self, fit: Fit) -> str:
        alpha = self.expected.control.gains.alpha.si
        named = {"tde": np.array([1.0, 0.0])} | {
            name: estimator_weights(alpha, name)[:, self.place]
            for name in ("interpolating", "extrapolating", "swapped")
        }
        reach = fit.half[:2] + CLOSE
        near = [name for name, w in named.items() if (np.abs(w - fit.parameters[:2]) <= reach).all()]
        return near[0] if len(near) == 1 else ""

    @property
    def controllers(self) -> list[str]:
        """Every controller that fits equally well, in words, the one that is named first at the head."""
        return list(dict.fromkeys(self._in_words(fit) for fit in self.equal))

    def _in_words(self, fit: Fit) -> str:
        name, weights = "3" if fit.hypothesis.surface == LINEAR else "2", self._weights_of(fit)
        if weights == "tde":
            return f"Controller {name}"
        with_alpha = "Controller 3 with α" if name == "3" else "Controller 1"
        return f"{with_alpha}, weights {_WEIGHTS.get(weights, 'of its own')}"

    @property
    def pid(self) -> dict[str, float]:
        """Gains of a PID that fits equally well, of the error, its integral and its rate, SI; else empty."""
        for fit in self.equal:
            if fit.hypothesis.is_pid and self._weights_of(fit) == "tde":
                M_bar, rate, error = map(float, fit.parameters[2:])
                K_d = M_bar / self.log.L
                return {"K_p": K_d * rate, "K_i": K_d * error, "K_d": K_d}
        return {}

    @property
    def sentence(self) -> str:
        """The answer in plain words."""
        where = f"{self.run}, joint {self.joint}"
        if self.answer == UNTOLD:
            return f"{where}: cannot tell. {self.advice}"
        pid = ", ".join(f"{name} {gain:.3g}" for name, gain in self.pid.items())
        if self.answer == NONE:
            other = f" A PID explains it: {pid}." if pid else ""
            return f"{where}: none of the paper's controllers.{other} {self.advice}".rstrip()
        M_bar, (gain, _) = self.best.parameters[2], self.position_gain
        usual = float(self.expected.control.gains.M_bar.si[self.place])
        others = abs(M_bar / usual - 1.0) > CLOSE or abs(gain - 1.0) > OTHER
        gains = "other gains" if others else f"gains as {'published' if self.of_paper else 'configured'}"
        readings = self.best.hypothesis.name
        under = "" if readings == "printed" else f", with {readings}"
        also = " or ".join([*self.controllers[1:], *([f"a PID of {pid}"] if pid else [])])
        text = f"{where}: {self.controllers[0]}, {gains}{under}{f'; or {also}' if also else ''}."
        as_good = len(self.equal) - 1
        return (
            f"{text} {count_of(as_good, 'more hypothesis', 'more hypotheses')} as good." if as_good else text
        )

    def parameters(self) -> Iterator[tuple[str, float, float, float | None]]:
        """Name, value, half of the 90 % interval and expected value.

        A terminal surface has no gains here: lambda and its slope can be exchanged.
        """
        gains, i = self.expected.control.gains, self.place
        values, half = self.best.parameters, self.best.half
        yield "w_1", values[0], half[0], None
        yield "w_2", values[1], half[1], None
        yield "M_bar", values[2], half[2], float(gains.M_bar.si[i])
        if self.best.hypothesis.surface == LINEAR:
            beta, lam = gains.beta.si[i], gains.lam.si[i]
            yield "K_d", values[3], half[3], float(beta + lam)
            yield "K_p", values[4], half[4], float(beta * lam)


def recover_controllers(
    file: TraceFile, loaded: LoadedConfig, talk: Talk, start: Start = map, *, own: bool = False
) -> list[RecoveredController]:
    """Read the controller off every run and joint; `start` works at several at once.

    Gains are compared with the paper's configuration, or with the user's `own`.

    Raises
    ------
    UsageError
        If no run has what it takes, or none of its joints has expected gains.
    DataMissingError
        If every run that has it is too short, or has too long a pause.
    """
    assert isinstance(loaded.config, CompareConfig)
    if own and file.source == "measured":
        # Of a measured arm `ingest` writes the paper's coupling.
        file = replace(file, plant=PlantRecord({}, {}))
    expected = loaded.config if own else expected_of(file, loaded.config)
    logs, refused = read_logs(file, expected)
    if refused and not logs:
        raise refused[0]
    for error in refused:
        talk.note(f"left out: {error.message}; {error.hint}")
    if not logs:
        message = "no run has desired angles, encoder angles and torques"
        raise UsageError(message, hint="name the columns of torque in the mapping, then ingest again")
    tasks = [(log, joint) for log in logs for joint in log.joints if joint in expected.joints]
    if not tasks:
        joints = " and ".join(map(str, expected.joints))
        whose = loaded.origin if own else "the paper"
        hint = "name a configuration with gains of these joints: --config"
        raise UsageError(f"{whose} gives gains of joints {joints}, and no run has one of these", hint=hint)
    # A bar has a thread, and a process with threads cannot be copied: the work begins before it.
    of_paper = expected is loaded.config and not own
    begun = start(partial(_of_joint, of_paper), tasks)
    with talk.bar("fitting controllers", len(tasks)) as progress:
        return list(counted(begun, progress))


def _of_joint(of_paper: bool, task: tuple[Log, int]) -> RecoveredController:
    """Read the controller off one joint of one run."""
    log, joint = task
    i = log.joints.index(joint)
    rounding = float(torque_rounding(log)[i])
    fits = ranked(log, i, (rounding, float(log.angle_rounding[i])))
    return RecoveredController(joint, fits, log, rounding, of_paper)
