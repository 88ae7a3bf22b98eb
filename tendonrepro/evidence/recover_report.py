"""What ``tendonrepro data recover`` shows: JSON, tables and sentences."""

from __future__ import annotations

from dataclasses import replace

from tendonrepro.configuration.load import LoadedConfig, load_config
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.evidence.fit import Fit
from tendonrepro.evidence.recover import RECOVERED, RecoveredController, recover_controllers
from tendonrepro.parallel import Start
from tendonrepro.results.records import TraceFile
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site

OWN_GAINS = "The paper has no gains of this arm. The log is compared with its own configuration."
SHOWN = 5
"""Hypotheses that the table lists for each joint."""


def controllers_of(
    file: TraceFile, talk: Talk, start: Start = map, own: LoadedConfig | None = None
) -> list[dict[str, object]]:
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


def controller_row(controller: RecoveredController) -> dict[str, object]:
    """What is told of one joint of one run; numbers stand there where the log tells, and are true."""
    row: dict[str, object] = {
        "run": controller.run,
        "joint": controller.joint,
        "answer": controller.answer,
        "controllers": " or ".join(controller.controllers) if controller.answer == RECOVERED else None,
        "surface": None,
        "readings": None,
        "weights": controller.weights or None,
        "as_good": len(controller.equal) - 1 if controller.fits else None,
        "advice": controller.advice,
        "sentence": controller.sentence,
    }
    if not controller.fits:
        return row
    best = controller.best
    if controller.answer == RECOVERED:
        gain, gain_half = controller.position_gain
        row |= {"surface": best.hypothesis.surface, "readings": best.hypothesis.name}
        row |= {"position_gain": gain, "position_gain_half_90": gain_half}
    return row | {
        "unexplained": controller.unexplained,
        "rounding": controller.rounding,
        "torque_rounding": controller.torque_rounding,
        "angle_rounding": controller.angle_rounding,
        "period": controller.log.L,
        "condition": best.condition,
        "bias": best.bias,
        "samples": best.samples,
    }


def controller_data(controller: RecoveredController) -> dict[str, object]:
    """The row of a joint, with its parameters and with all that fits equally well, for ``--json``."""
    told = controller.parameters() if controller.answer == RECOVERED else ()
    return controller_row(controller) | {
        "parameters": {
            name: {"value": value, "half_90": half, "published": published}
            for name, value, half, published in told
        },
        "equally_good": [_named(fit) for fit in controller.equal],
        "pid": controller.pid or None,
    }


def _named(fit: Fit) -> str:
    return f"{fit.hypothesis.surface} {fit.hypothesis.name}"


def controller_tables(controllers: list[RecoveredController]) -> list[Table]:
    """Answers, parameters and hypotheses."""
    told = [controller for controller in controllers if controller.answer == RECOVERED]
    parameters = [
        {"run": controller.run, "joint": controller.joint}
        | {
            key: number
            for name, value, half, _ in controller.parameters()
            for key, number in ((name, value), (f"{name}_half_90", half))
        }
        for controller in told
    ]
    tried = [
        {
            "run": controller.run,
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
    shown = ("run", "joint", "answer", "controllers", "readings", "as_good")
    about = "The best hypotheses, all that fit alike among them, with the criterion above the best."
    return [
        Table(
            "controllers",
            "Which controller made the log.",
            [*map(controller_row, controllers)],
            terminal=shown,
        ),
        Table(
            "parameters",
            "Its numbers, SI, with half of their 90 % interval.",
            parameters,
            terminal=None if parameters else (),
        ),
        Table("hypotheses", about, tried, terminal=()),
    ]
