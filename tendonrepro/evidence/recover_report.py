"""What ``tendonrepro data recover`` shows: JSON, tables and sentences."""

from __future__ import annotations

from dataclasses import replace

from tendonrepro.configuration.load import LoadedConfig, load_config
from tendonrepro.configuration.published import COMPARED
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.evidence.controller import RecoveredController
from tendonrepro.evidence.fit import Fit, equally_good
from tendonrepro.evidence.recover import recover_controllers
from tendonrepro.parallel import Start
from tendonrepro.results.records import TraceFile
from tendonrepro.results.tables import Table
from tendonrepro.studies.outcome import Outcome
from tendonrepro.studies.study import Site

NUMBERS = ("run", "joint", "w_1", "w_1_half_90", "w_2", "w_2_half_90", "M_bar", "M_bar_half_90")
"""Columns of the table of parameters that the terminal shows."""
OWN_GAINS = "The paper has no gains of this arm. The log is compared with its own configuration."
SHOWN = 5
"""Hypotheses that the table lists for each joint."""


def controllers_of(file: TraceFile, talk: Talk, start: Start = map) -> list[dict[str, object]]:
    """Plain values for joints 2 and 3 of each run; empty where no run has what it takes."""
    paper = load_config(None, "compare")
    runs = {name: trace.of_joints(COMPARED) for name, trace in file.runs.items()}
    both = replace(file, runs={name: trace for name, trace in runs.items() if {*trace.joint} & {*COMPARED}})
    try:
        return [controller_data(controller) for controller in recover_controllers(both, paper, talk, start)]
    except (DataMissingError, UsageError):
        return []


def recover_outcome(file: TraceFile, name: str, paper: LoadedConfig, site: Site) -> Outcome:
    """Find which controller made each run of a log that is called `name`.

    Raises
    ------
    UsageError
        If no run has torque, desired and measured angles.
    """
    controllers = recover_controllers(file, paper, site.talk, site.start)
    own = not controllers[0].of_paper
    data = {
        "schema_version": 1,
        "log": name,
        "gains_from": "configuration" if own else "paper",
        "runs": [controller_data(controller) for controller in controllers],
    }
    sentences = "\n".join(controller.sentence for controller in controllers)
    return Outcome(data, [*([OWN_GAINS] if own else []), sentences, *controller_tables(controllers)])


def controller_data(controller: RecoveredController) -> dict[str, object]:
    """What is told of one joint of one run, as plain values."""
    head: dict[str, object] = {
        "run": controller.run,
        "joint": controller.joint,
        "answer": controller.answer,
        "advice": controller.advice,
    }
    head["sentence"] = controller.sentence
    if not controller.fits:
        return head
    return head | {
        "surface": controller.best.hypothesis.surface,
        "readings": controller.best.hypothesis.name,
        "weights": controller.weights,
        "parameters": {
            name: {"value": value, "half_90": half, "published": published}
            for name, value, half, published in (controller.parameters() if controller.prints_weights else ())
        },
        "equally_good": [_named(fit) for fit in equally_good(controller.fits)],
        "unexplained": controller.unexplained,
        "rounding": controller.rounding,
        "torque_rounding": controller.torque_rounding,
        "angle_rounding": controller.angle_rounding,
        "period": controller.log.L,
        "position_gain": controller.position_gain[0] if controller.prints_weights else None,
        "position_gain_half_90": controller.position_gain[1] if controller.prints_weights else None,
        "condition": controller.best.condition,
        "bias": controller.best.bias,
        "samples": controller.best.samples,
    }


def _named(fit: Fit) -> str:
    return f"{fit.hypothesis.surface} {fit.hypothesis.name}"


def controller_tables(controllers: list[RecoveredController]) -> list[Table]:
    """Answers, parameters and hypotheses."""
    fitted = [controller for controller in controllers if controller.fits]
    answers = [
        {
            "run": controller.run,
            "joint": controller.joint,
            "answer": controller.answer,
            "surface": controller.best.hypothesis.surface if controller.prints_weights else None,
            "readings": controller.best.hypothesis.name if controller.prints_weights else None,
            "as_good": len(equally_good(controller.fits)) - 1 if controller.fits else None,
            "weights": controller.weights or None,
            "unexplained": controller.unexplained if controller.fits else None,
            "advice": controller.advice,
        }
        for controller in controllers
    ]
    parameters = [
        {"run": controller.run, "joint": controller.joint}
        | {
            key: number
            for name, value, half, _ in controller.parameters()
            for key, number in ((name, value), (f"{name}_half_90", half))
        }
        for controller in fitted
        if controller.prints_weights
    ]
    tried = [
        {
            "run": controller.run,
            "joint": controller.joint,
            "hypothesis": _named(fit),
            "unexplained": fit.residual / fit.step,
            "information": fit.information - min(other.information for other in controller.fits),
            "condition": fit.condition,
        }
        for controller in fitted
        for fit in controller.fits[:SHOWN]
    ]
    shown = ("run", "joint", "answer", "surface", "readings", "weights", "as_good")
    # Where nothing can be told there are no columns to choose from.
    numbers = NUMBERS if parameters else ()
    return [
        Table("controllers", "Which controller made the log.", answers, terminal=shown),
        Table(
            "parameters", "Its numbers, SI, with half of their 90 % interval.", parameters, terminal=numbers
        ),
        Table(
            "hypotheses",
            "The best hypotheses, with the information criterion above the best.",
            tried,
            terminal=(),
        ),
    ]
