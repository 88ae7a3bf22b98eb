"""Find usable draws, tune every law on each, and compare the laws."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import partial
from itertools import chain, islice
from operator import itemgetter
from pathlib import Path

import numpy as np

from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError, did_you_mean
from tendonrepro.experiments import user_law
from tendonrepro.monte_carlo.kept import identity_of, refuse_on_lanes, study_on_plants
from tendonrepro.parallel import as_ready, check_jobs, counted
from tendonrepro.studies.parameters import Folder
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site, Study, cost_of
from tendonrepro.tuning.bench import PUBLISHED, Candidate, loops_of, usable
from tendonrepro.tuning.laws import LAWS, TunedLaw, tuned_user_law
from tendonrepro.tuning.report import tuning_result
from tendonrepro.tuning.search import TunedRow, TuningEffort, TuningTask

MOST_DRAWS_PER_PLANT = 64  # looked at for each plant that is asked for; about one in four is usable

SECONDS_PER_EXPERIMENT = 8e-4
"""Time of a run of two joints on a fast processor; it grows with the square of their number."""

# The scatter of a law is that of two searches at least.
LEAST = {"plants": 1, "searches": 2, "generations": 2, "population": 4}


def tuning_study(
    loaded: LoadedEnsemble,
    users: Sequence[user_law.UserLaw],
    plants: int,
    effort: TuningEffort,
    *,
    any_plant: bool,
    seed: int,
    jobs: int,
    only: str,
    folder: Folder,
) -> Study:
    """Check and prepare a tuning of every law, or `only` of some, and of a user's.

    Raises
    ------
    UsageError
        For too little effort, impossible jobs, or a law that has no bounds or cannot run on lanes.
    """
    asked = {"plants": plants, **asdict(effort)}
    for name, least in LEAST.items():
        if asked[name] < least:
            raise UsageError(f"must be at least {least}, found {asked[name]}", where=f"--{name}")
    check_jobs(jobs)
    own = [tuned_user_law(user) for user in users]
    if taken := [law.name for law in own if law.name in LAWS]:
        message = f"there is a law {taken[0]!r} already"
        raise UsageError(message, where="--law", hint="give it another name")
    task = TuningTask(loaded, _chosen(only, own), effort, seed, any_plant)
    for user, law in zip(users, own, strict=True):
        drawn = task.draw(0)
        n = drawn.alpha.size
        middle = Candidate(law, PUBLISHED, law.values(np.full(sum(law.sizes(n)), 0.5), n))
        refuse_on_lanes(user, loops_of(drawn, middle, 1)[0])
    loaded = replace(loaded, base=user_law.with_user_laws(loaded.base, users))
    identity = identity_of(
        loaded, "tuning", effort=asdict(effort), seed=seed, any_plant=any_plant, laws=sorted(task.laws)
    )
    experiments = plants * task.experiments
    cost = cost_of(experiments, SECONDS_PER_EXPERIMENT * (len(loaded.compare.joints) / 2) ** 2)

    def run(site: Site, states: Path) -> Result:
        return tuning_result(task, _tuned(task, _usable(task, plants), states, jobs, site.talk))

    why = "a tuning has motions of its own"
    study = study_on_plants("tune", loaded, identity, run, folder, cost=cost, seed=seed, averages=why)
    return replace(study, decided_by={"plants": plants})


def _chosen(only: str, own: Sequence[TunedLaw]) -> dict[str, TunedLaw]:
    """Laws of the package by the names that were asked for, and all of the user's."""
    users = {law.name: law for law in own}
    laws = LAWS | users
    names = [name.strip() for name in only.split(",") if name.strip()] or list(LAWS)
    for name in names:
        if name not in laws:
            message = f"there is no controller {name!r}{did_you_mean(name, laws)}"
            raise UsageError(message, where="--only", hint=f"There are: {', '.join(laws)}")
    return {name: law for name, law in LAWS.items() if name in names} | users


def _usable(task: TuningTask, wanted: int) -> list[int]:
    """Numbers of the first usable draws, or of every one."""
    numbers = range(MOST_DRAWS_PER_PLANT * wanted)
    found = [*islice((k for k in numbers if task.any_plant or usable(task.draw(k))), wanted)]
    if len(found) < wanted:
        message = f"stable with {task.gains_told} gains are only {len(found)} of {len(numbers)} plants drawn"
        narrower = ", or a smaller --spread" if task.loaded.around else ""
        raise UsageError(message, where="--plants", hint=f"ask for fewer, or say --any-plant{narrower}")
    return found


def _tuned(task: TuningTask, numbers: Sequence[int], states: Path, jobs: int, talk: Talk) -> list[TunedRow]:
    """Rows of draws, from what is on disk already; in the order of their numbers."""
    stream = as_ready(partial(task.tuned, states), numbers, jobs)
    with talk.bar("tuning on plants", len(numbers)) as progress, closing(stream):
        return sorted(chain.from_iterable(counted(stream, progress)), key=itemgetter("draw"))
