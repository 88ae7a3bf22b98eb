"""Which controller made a log.

1. ``log.py`` puts each run on the controller's samples, takes the rounding of encoders off, and finds the
   desired motion with its derivatives.
2. ``hypotheses.py`` writes Eqs. (15) to (18), under every surface and reading that a log can tell, as a
   linear regression of one joint's torque.
3. ``fit.py`` tries all of them by least squares on the fastest stretch: a fit to even blocks of samples has
   to predict odd ones. The best few are fitted to all samples, at most the fastest `MOST`, with the
   controller's own five parameters, with intervals by the jackknife, and ranked by the Bayesian information
   criterion. If none is exact, low-pass filters are tried, too.
4. `RecoveredController` judges the best: does it leave no more than rounding, and are its weights and
   gains the paper's?
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tendonrepro.configuration.load import CompareConfig, LoadedConfig, load_config
from tendonrepro.configuration.published import published
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.evidence.fit import Fit, equally_good, ranked
from tendonrepro.evidence.hypotheses import LINEAR
from tendonrepro.evidence.log import Log, expected_of, liveliest, read_logs
from tendonrepro.files import Json
from tendonrepro.parallel import Start, counted
from tendonrepro.physics.control import DEGREES_PER_RADIAN, estimator_weights
from tendonrepro.results.records import PlantRecord, TraceFile
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site

MOST = 100_000
"""Samples that are fitted, those of the fastest motion: more take minutes, and tell little."""
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
OWN_GAINS = "The paper has no gains of this arm. The log is compared with its own configuration."
SHOWN = 5
"""Hypotheses that the table lists for each joint."""
NESTED = ("parameters", "equally_good", "pid")
"""What ``--json`` says of a joint, and its row does not."""


@dataclass(frozen=True, eq=False)
class RecoveredController:
    """What the log of one joint, by the paper's number, says.

    ``fits`` has the best fit first, if any. The gains that it is compared with are the paper's if
    ``of_paper``.
    """

    joint: int
    fits: list[Fit]
    log: Log
    of_paper: bool

    @property
    def expected(self) -> CompareConfig:
        """Configuration with the gains that it is compared with."""
        return self.log.expected

    @property
    def recorded(self) -> tuple[float, float]:
        """Rounding of the joint's recorded angle, rad, and torque, N m."""
        i = self.log.joints.index(self.joint)
        return float(self.log.angle_rounding[i]), float(self.log.torque_rounding[i])

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
        M_bar, (angle, torque) = self.expected.control.gains.M_bar.si[self.place], self.recorded
        of_angles = M_bar * angle * np.sqrt(6.0) / self.log.L**2
        both = np.hypot(of_angles, np.sqrt(2.0) * torque) / np.sqrt(12.0)
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
        fine, weights = self.rounding <= COARSE, self._weights_of(self.best)
        allowed = max(FAITHFUL, 3.0 * self.rounding) if fine else FAITHFUL
        # Rounding is in the intervals: where these leave one interpretation, it does not matter.
        if self.best.bias > CLOSE and not weights:
            return UNTOLD
        if balanced and self.unexplained <= allowed:
            # Weights that no interpretation has come from noise, unless the log is exact.
            return self.by_gains if weights or self.unexplained <= FAITHFUL else UNTOLD
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
    def by_gains(self) -> str:
        """`RECOVERED` if M_bar and the error's gain are the expected ones to a factor of two, `NONE` if not.

        `UNTOLD` where a 90 % interval reaches across a bound. A PID is time-delay control with its own M_bar,
        and feedback with gravity one without a gain of the error. In degrees M_bar is 180/pi times as large.
        """
        expected, (gain, gain_half) = self.expected.control.gains.M_bar.si[self.place], self.position_gain
        M_bar = self.best.parameters[2] / expected
        unit = 1.0 if M_bar < np.sqrt(DEGREES_PER_RADIAN) else DEGREES_PER_RADIAN
        # In another unit of the torque, N m at motor shafts, percent of the rated one or volts, only the
        # published number itself tells.
        reduction = self.expected.manipulator.winches.reduction.si
        rated = published().number("hardware.rated_torque")
        units = np.array([reduction, 0.01 * reduction * rated, reduction * rated / 3.0])
        others = np.outer((1.0, DEGREES_PER_RADIAN), units).ravel()
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
        return self._weights_of(self.best) if self.answer == RECOVERED else ""

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
        where = f"{self.log.run}, joint {self.joint}"
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

    @property
    def parameters(self) -> dict[str, dict[str, float | None]]:
        """By name the value, half its 90 % interval and the expected value; none of a log that is untold.

        A terminal surface has no gains here: lambda and its slope can be exchanged.
        """
        if self.answer != RECOVERED:
            return {}
        gains, i = self.expected.control.gains, self.place
        expected = {"w_1": None, "w_2": None, "M_bar": float(gains.M_bar.si[i])}
        if self.best.hypothesis.surface == LINEAR:
            beta, lam = gains.beta.si[i], gains.lam.si[i]
            expected |= {"K_d": float(beta + lam), "K_p": float(beta * lam)}
        told = zip(expected.items(), self.best.parameters, self.best.half, strict=False)
        return {
            name: {"value": value, "half_90": half, "published": number}
            for (name, number), value, half in told
        }


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
    return RecoveredController(joint, ranked(liveliest(log, MOST), log.joints.index(joint)), log, of_paper)


def controllers_of(
    file: TraceFile, talk: Talk, start: Start = map, own: LoadedConfig | None = None
) -> list[Json]:
    """Plain values for each run and joint that the paper moves, or a user's `own` configuration.

    They are none where no run has what it takes.
    """
    loaded = own or load_config(None, "compare")
    joints = loaded.config.joints
    runs = {name: trace.of_joints(joints) for name, trace in file.runs.items() if {*trace.joint} & {*joints}}
    of_joints = replace(file, runs=runs)
    try:
        controllers = recover_controllers(of_joints, loaded, talk, start, own=own is not None)
        return [controller_data(controller) for controller in controllers]
    except (DataMissingError, UsageError):
        return []


def recover_result(
    file: TraceFile, name: str, loaded: LoadedConfig, site: Site, *, own: bool = False
) -> Result:
    """Find which controller made each run of a log that is called `name`.

    Raises
    ------
    UsageError
        If no run has torque, desired and measured angles.
    """
    controllers = recover_controllers(file, loaded, site.talk, site.start, own=own)
    of_paper = controllers[0].of_paper
    data = {
        "schema_version": 1,
        "log": name,
        "gains_from": "paper" if of_paper else "configuration",
        "runs": [controller_data(controller) for controller in controllers],
    }
    sentences = "\n".join(controller.sentence for controller in controllers)
    whose = [] if of_paper or own else [OWN_GAINS]
    return Result(data, [*whose, sentences, *controller_tables(controllers)])


def controller_data(controller: RecoveredController) -> Json:
    """What ``--json`` tells of one joint of one run; numbers stand where the log tells, and are true."""
    is_recovered = controller.answer == RECOVERED
    row: Json = {
        "run": controller.log.run,
        "joint": controller.joint,
        "answer": controller.answer,
        "controllers": " or ".join(controller.controllers) if is_recovered else None,
        "surface": controller.best.hypothesis.surface if is_recovered else None,
        "readings": controller.best.hypothesis.name if is_recovered else None,
        "weights": controller.weights or None,
        "as_good": len(controller.equal) - 1 if controller.fits else None,
        "advice": controller.advice,
        "sentence": controller.sentence,
    }
    if is_recovered:
        row["position_gain"], row["position_gain_half_90"] = controller.position_gain
    if controller.fits:
        row |= {
            "unexplained": controller.unexplained,
            "rounding": controller.rounding,
            "torque_rounding": controller.recorded[1],
            "angle_rounding": controller.recorded[0],
            "period": controller.log.L,
            "condition": controller.best.condition,
            "bias": controller.best.bias,
            "samples": controller.best.samples,
        }
    return row | {
        "parameters": controller.parameters,
        "equally_good": [_named(fit) for fit in controller.equal],
        "pid": controller.pid or None,
    }


def _named(fit: Fit) -> str:
    return f"{fit.hypothesis.surface} {fit.hypothesis.name}"


def controller_tables(controllers: list[RecoveredController]) -> list[Table]:
    """Answers, parameters and hypotheses."""
    rows = [controller_data(controller) for controller in controllers]
    parameters: list[Json] = []
    for row in rows:
        told: Json = {"run": row["run"], "joint": row["joint"]}
        for name, parameter in row["parameters"].items():
            told |= {name: parameter["value"], f"{name}_half_90": parameter["half_90"]}
        parameters += [told] if row["parameters"] else []
    tried = [
        {
            "run": controller.log.run,
            "joint": controller.joint,
            "hypothesis": _named(fit),
            "as_good": fit in controller.equal,
            "unexplained": fit.residual / fit.step,
            "information": fit.information - min(other.information for other in controller.fits),
            "condition": fit.condition,
        }
        for controller in controllers
        for fit in controller.fits[: max(SHOWN, len(controller.equal))]
    ]
    answers = [{key: value for key, value in row.items() if key not in NESTED} for row in rows]
    shown = ("run", "joint", "answer", "controllers", "readings", "as_good")
    numbers = "Its numbers, SI, with half of their 90 % interval."
    about = "The best hypotheses, all that fit alike among them, with the criterion above the best."
    return [
        Table("controllers", "Which controller made the log.", answers, terminal=shown),
        Table("parameters", numbers, parameters, terminal=None if parameters else ()),
        Table("hypotheses", about, tried, terminal=()),
    ]
