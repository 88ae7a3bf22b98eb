"""Check and prepare a study of every small change of the equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.control import unloaded_run
from tendonrepro.configuration.models.experiment import errors_from
from tendonrepro.configuration.published import published
from tendonrepro.errors import UsageError
from tendonrepro.experiments.user_law import UserLaw, with_user_laws
from tendonrepro.files import digest_of
from tendonrepro.identification.edits.report import SCHEMA_VERSION, edits_result
from tendonrepro.identification.edits.runs import EditStudy
from tendonrepro.identification.goal import Goal, own_numbers, printed_numbers
from tendonrepro.parallel import check_jobs
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE
from tendonrepro.studies.parameters import Folder
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site, Study

KEPT = "plants"
"""Folder of what an interrupted study goes on with."""


def edits_study(
    loaded: LoadedEnsemble,
    laws: Sequence[UserLaw],
    plants: int,
    errors: Path | None,
    *,
    jobs: int,
    folder: Folder,
) -> Study:
    """Check and prepare every edit of the paper's laws, or of a user's `laws`.

    Raises
    ------
    UsageError
        For too few plants, impossible jobs, a law that cannot run on many plants together, or no errors of
        it.
    """
    if plants < 1:
        raise UsageError(f"must be at least 1, found {plants}", where="--plants")
    check_jobs(jobs)
    goal = goal_of(loaded, laws, errors)
    task = EditStudy(loaded, tuple(laws), goal, plants)

    def run(site: Site) -> Result:
        if seconds := errors_from(loaded.compare):
            site.talk.note(f"errors_from, {seconds:g} s, is left aside: errors are of whole runs")
        solver = {"name": COMPILED_STEPPER, "tolerance": TOLERANCE}
        head = {"experiment": "edits", "solver": solver, "ensemble_sha256": loaded.sha256}
        return replace(edits_result(task, task.run(site, jobs, KEPT)), manifest=head)

    base = with_user_laws(loaded.base, laws)
    inputs = (*base.inputs, *([errors] if errors else []))
    numbers = [goal.runs, goal.values.tolist(), goal.half.tolist()]
    decided_by = {"edits": task.identity, "plants": plants, "errors": numbers}
    base = replace(base, sha256=digest_of(decided_by), origin=loaded.origin, inputs=inputs)
    told = f"edits: {len(task.variants.edits)} edits on {plants} plants"
    plan = {"schema_version": SCHEMA_VERSION, "experiment": "edits", "text": told}
    return Study(base, run, folder, keep=KEPT, stays=True, stored=True, plan=plan, cost=task.cost)


def goal_of(loaded: LoadedEnsemble, laws: Sequence[UserLaw], errors: Path | None) -> Goal:
    """Errors to explain, of runs without payload: those of a user's table, or else of Table 2."""
    if errors is None and (laws or loaded.around):
        whose = "a law" if laws else "an arm"
        message = f"there are no published errors of {whose} of your own"
        raise UsageError(message, where="--errors", hint="name a table of errors that you measured")
    names = [law.name for law in laws]
    if errors is None:
        goal = printed_numbers(published(), loaded.compare.joints)
    else:
        goal = own_numbers(errors, loaded, "whole", names)
    for name in names:
        if name not in goal.runs:
            message = f"has no errors of the run {name}, which is edited"
            raise UsageError(message, where=str(errors), hint=f"name it in the column run: {name}")
    kept = np.array([not unloaded_run(run) for run in goal.runs])
    runs = tuple(run for run in goal.runs if not unloaded_run(run))
    return replace(goal, runs=runs, values=goal.values[kept], half=goal.half[kept], fitted=goal.fitted[kept])
