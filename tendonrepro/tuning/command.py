"""Find usable draws, tune every law on each, and compare the laws."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro import __version__
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.experiments.user_law import laws_of, with_user_laws
from tendonrepro.files import digest_of, to_json, write_atomically
from tendonrepro.monte_carlo.plan import code_digest
from tendonrepro.parallel import as_ready
from tendonrepro.results.study import Outcome, run_study
from tendonrepro.simulation.device import DeviceName, require
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE
from tendonrepro.tuning.bench import Candidate, measure, usable
from tendonrepro.tuning.laws import LAWS, TunedLaw, user_law
from tendonrepro.tuning.report import SCHEMA_VERSION, outcome
from tendonrepro.tuning.search import Task

MOST_DRAWS_PER_PLANT = 64  # looked at for each plant that is asked for; about one in four is usable


def run_tune(
    request: Request,
    talk: Talk,
    *,
    plants: int = 16,
    searches: int = 4,
    generations: int = 4,
    population: int = 6,
    laws: Sequence[str] = (),
    given: Mapping[str, Callable[..., Any]] | None = None,
    any_plant: bool = False,
    jobs: int = -1,
    device: DeviceName = "cpu",
) -> dict[str, Any]:
    """Tune every law on the same plants, and write the results.

    Parameters
    ----------
    request : Request
        Its configuration is that of an ensemble.
    searches, generations, population : int
        Of each law under each condition; of each search; of each generation.
    laws : sequence of str
        A user's, ``FILE:NAME``; more by name in `given`.
    any_plant : bool
        Also draws on which the published gains are unstable.
    jobs : int
        Processes; -1 is one for each processor.
    device : str
        ``gpu`` tunes on one plant after the other, on a GPU.

    Raises
    ------
    TendonreproError
        If no GPU can be used.
    UsageError
        For too little effort, or a law that has no bounds or cannot run on lanes.
    """
    effort = {"searches": searches, "generations": generations, "population": population}
    # The scatter of a law is that of two searches at least.
    least = {"plants": 1, "searches": 2, "generations": 2, "population": 4}
    for name, value in {"plants": plants, **effort}.items():
        if value < least[name]:
            raise UsageError(f"must be at least {least[name]}, found {value}", where=f"--{name}")
    require(device)
    loaded = load_ensemble(request.config, overrides=request.overrides)
    users = laws_of(laws, given)
    own = [user_law(user) for user in users]
    if taken := [law.name for law in own if law.name in LAWS]:
        message = f"there is a law {taken[0]!r} already"
        raise UsageError(message, where="--law", hint="give it another name")
    task = Task(loaded, LAWS | {law.name: law for law in own}, effort, request.seed or 0, device)
    for law in own:
        _try(task, law)
    base = with_user_laws(loaded.base, users)
    made_by = SCHEMA_VERSION, __version__, code_digest("physics", "simulation", "monte_carlo", "tuning")
    inputs = [loaded.sha256, base.sha256, effort, task.seed, plants, any_plant]
    if device != "cpu":
        inputs.append(device)
    identity = digest_of({"made_by": made_by, "inputs": inputs})
    states = f"plants-{identity[:16]}"

    def study(folder: Path) -> Outcome:
        numbers = _usable(task, plants, every=any_plant)
        drawn = _tuned(task, numbers, folder / states, jobs if device == "cpu" else 1, talk)
        solver = {"name": COMPILED_STEPPER, "tolerance": TOLERANCE}
        head = {"experiment": "tune", "seed": task.seed, "solver": solver, "ensemble_sha256": loaded.sha256}
        return replace(outcome(task, drawn), manifest=head)

    return run_study(
        "tune", replace(base, sha256=identity, origin=loaded.origin), request, study, talk, keep=states
    )


def _try(task: Task, law: TunedLaw) -> None:
    """Refuse a user's law that cannot run on lanes, before hours of work."""
    plants = task.draw(0)
    n = plants.alpha.size
    middle = law.values(np.full(sum(law.sizes(n)), 0.5), n)
    try:
        measure(plants, [Candidate(law, "none", False, middle)])
    except Exception as error:
        message = f"the law {law.name} cannot run on many plants together: {type(error).__name__}: {error}"
        hint = "return tau, H_hat, s and de, and choose by tendonrepro.arrays.choose instead of if"
        raise UsageError(message, where="--law", hint=hint) from error


def _usable(task: Task, wanted: int, *, every: bool) -> list[int]:
    """Numbers of the first usable draws, or of every one."""
    numbers = range(MOST_DRAWS_PER_PLANT * wanted)
    found = [*islice((k for k in numbers if every or usable(task.draw(k))), wanted)]
    if len(found) < wanted:
        message = f"with the published gains stable plants are only {len(found)} of {len(numbers)} draws"
        raise UsageError(message, where="--plants", hint="ask for fewer, or say --any-plant")
    return found


def _tuned(task: Task, numbers: Sequence[int], states: Path, jobs: int, talk: Talk) -> list[dict[str, Any]]:
    """Tune on the draws that are not on disk already."""
    states.mkdir(exist_ok=True)
    paths = {number: states / f"{number}.json" for number in numbers}
    missing = [number for number, path in paths.items() if not path.exists()]
    stream = as_ready(task.tuned, missing, jobs)
    with talk.bar("tuning on plants", len(missing)) as progress, closing(stream):
        for one in stream:
            write_atomically(paths[one["draw"]], to_json(one))
            progress(1)
    return [json.loads(path.read_text("utf-8")) for path in paths.values()]
