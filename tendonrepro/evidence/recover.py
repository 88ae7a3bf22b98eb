"""Read off a log which controller made it: logs from runs, and the controller of every joint."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.strict_yaml import load
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.evidence.desired import desired_motion, on_its_samples
from tendonrepro.evidence.fit import ranked
from tendonrepro.evidence.hypotheses import Log, torque_rounding, without_rounding
from tendonrepro.evidence.recovered import Recovered
from tendonrepro.experiments.rig import coupling
from tendonrepro.parallel import Start, counted
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.records import DECOUPLING_RUNS, Trace, TraceFile


def expected_of(file: TraceFile, paper: CompareConfig) -> CompareConfig:
    """Configuration with the gains that a log is compared with.

    They are the paper's. It has none for other joints or another arm than its own, and a simulated log of
    these is compared with the configuration that made it.
    """
    if (file.source, file.experiment) != ("simulated", "compare"):
        return paper
    own = CompareConfig.model_validate(load(file.config_yaml, "config_yaml").tree)
    joints = {joint for trace in file.runs.values() for joint in trace.joint}
    return paper if joints <= set(paper.joints) and is_arm_of_paper(own.manipulator) else own


def read_logs(
    file: TraceFile, expected: CompareConfig
) -> tuple[list[tuple[Trace, Log, Array]], list[DataMissingError]]:
    """Logs, with their runs and the rounding of angles (n,); and why other runs with torque have none."""
    logs, refused = [], []
    for name, recorded in file.runs.items():
        torque = "tau_cmd" if "tau_cmd" in recorded else "tau_m"
        if name in DECOUPLING_RUNS or not all(
            variable in recorded for variable in (torque, "q_encoder", "q_d")
        ):
            continue
        try:
            logs.append(_log_of(*on_its_samples(recorded), torque, file, expected))
        except DataMissingError as error:
            refused.append(error)
    return logs, refused


def _log_of(
    trace: Trace, L: float, torque: str, file: TraceFile, expected: CompareConfig
) -> tuple[Trace, Log, Array]:
    q_d, dq_d, ddq_d = desired_motion(trace, L)
    step = expected.manipulator.encoders.joint.resolution.si
    freed = [without_rounding(column, step) for column in trace["q_encoder"].T]
    S = file.plant.matrix("S", trace.joint) if "S" in file.plant.values else coupling(expected)[0]
    gains = expected.control.gains
    log = Log(
        L=L,
        q=np.column_stack([q for q, _ in freed]),
        q_motor=trace["q_motor_encoder"] @ S.T if "q_motor_encoder" in trace else None,
        q_d=q_d,
        dq_d=dq_d,
        ddq_d=ddq_d,
        command=trace[torque],
        applied=trace["tau_m"] if torque == "tau_cmd" and "tau_m" in trace else None,
        S=S,
        b=_of_joints(gains.b.si, expected, trace.joint),
        Delta=_of_joints(gains.Delta.si, expected, trace.joint),
        encoder_step=step,
    )
    return trace, log, np.array([rounding for _, rounding in freed])


def _of_joints(values: Array, config: CompareConfig, joints: Sequence[int]) -> Array:
    """A gain by joint; NaN of a joint that the configuration does not move."""
    known = dict(zip(config.joints, values, strict=True))
    return np.array([known.get(joint, np.nan) for joint in joints])


def recovered(file: TraceFile, loaded: LoadedConfig, talk: Talk, start: Start = map) -> list[Recovered]:
    """Read the controller off every run and joint; `start` works at several at once.

    Raises
    ------
    UsageError
        If no run has what it takes, or none of its joints has expected gains.
    DataMissingError
        If every run that has it is too short, or has too long a pause.
    """
    assert isinstance(loaded.config, CompareConfig)
    expected = expected_of(file, loaded.config)
    logs, refused = read_logs(file, expected)
    if refused and not logs:
        raise refused[0]
    for error in refused:
        talk.note(f"left out: {error.message}; {error.hint}")
    if not logs:
        message = "no run has desired angles, encoder angles and torques"
        raise UsageError(message, hint="name the columns of torque in the mapping, then ingest again")
    tasks = [
        (trace.name, joint, log, i, float(rounding[i]))
        for trace, log, rounding in logs
        for i, joint in enumerate(trace.joint)
        if joint in expected.joints
    ]
    if not tasks:
        joints = " and ".join(map(str, expected.joints))
        raise UsageError(f"the paper gives gains of joints {joints}, and no run has one of these")
    # A bar has a thread, and a process with threads cannot be copied: the work begins before it.
    begun = start(partial(_recovered, expected, expected is loaded.config), tasks)
    with talk.bar("fitting controllers", len(tasks)) as progress:
        return list(counted(begun, progress))


def _recovered(expected: CompareConfig, of_paper: bool, task: tuple[str, int, Log, int, float]) -> Recovered:
    """Read the controller off one joint of one run."""
    run, joint, log, i, angle = task
    torque = float(torque_rounding(log)[i])
    fits = ranked(log, i, (torque, angle))
    place = expected.joints.index(joint)
    return Recovered(run, joint, fits, log, torque, angle, expected, place, of_paper)
