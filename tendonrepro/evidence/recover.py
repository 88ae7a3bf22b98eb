"""Which controller made a log.

1. ``log.py`` puts each run on the controller's samples, takes the rounding of encoders off, and finds the
   desired motion with its derivatives (``desired.py``).
2. ``hypotheses.py`` writes Eqs. (15) to (18), under every surface and reading that a log can tell, as a
   linear regression of one joint's torque.
3. ``fit.py`` tries all of them by least squares on the fastest stretch: a fit to even blocks of samples has
   to predict odd ones. The best few are fitted to all samples with the controller's own five parameters, with
   intervals by the jackknife, and ranked by the Bayesian information criterion. If none is exact, low-pass
   filters are tried, too.
4. ``controller.py`` judges the best: does it leave no more than rounding, and are its weights and gains the
   paper's?
"""

from __future__ import annotations

from functools import partial

from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.evidence.controller import RecoveredController
from tendonrepro.evidence.fit import ranked
from tendonrepro.evidence.log import Log, expected_of, read_logs, torque_rounding
from tendonrepro.parallel import Start, counted
from tendonrepro.results.records import TraceFile


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
    begun = start(partial(_of_joint, expected, of_paper), tasks)
    with talk.bar("fitting controllers", len(tasks)) as progress:
        return list(counted(begun, progress))


def _of_joint(expected: CompareConfig, of_paper: bool, task: tuple[Log, int]) -> RecoveredController:
    """Read the controller off one joint of one run."""
    log, joint = task
    i = log.joints.index(joint)
    rounding = float(torque_rounding(log)[i])
    fits = ranked(log, i, (rounding, float(log.angle_rounding[i])))
    return RecoveredController(joint, fits, log, rounding, expected, of_paper)
