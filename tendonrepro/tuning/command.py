"""What ``tendonrepro tune`` does: find usable draws, tune every law on each, and compare the laws."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from tendonrepro import __version__
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.experiments.user_law import UserLaw, laws_of, with_user_laws
from tendonrepro.files import digest_of, to_json, write_atomically
from tendonrepro.monte_carlo.cluster import on_cluster
from tendonrepro.monte_carlo.plan import code_digest
from tendonrepro.parallel import as_ready
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.store import MANIFEST, replaced
from tendonrepro.results.study import Outcome, foretell
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE
from tendonrepro.tuning.bench import Candidate, measure, usable
from tendonrepro.tuning.laws import LAWS, TunedLaw, user_law
from tendonrepro.tuning.report import QUESTIONS, comparisons, law_rows, question_rows, tables
from tendonrepro.tuning.search import Effort
from tendonrepro.tuning.study import Task

SCHEMA_VERSION = 1

MOST_DRAWS_PER_PLANT = 64
"""Draws looked at for each plant that is asked for; about one in four is usable."""


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
    dask: str | None = None,
) -> dict[str, Any]:
    """Tune every law on the same plants, and write numbers, tables and the figure.

    Parameters
    ----------
    request : Request
        Its configuration is that of an ensemble, from whose box plants are drawn.
    talk : Talk
    plants : int
        Draws on which laws are tuned.
    searches : int
        Of each law under each condition; at least two, so that their scatter is known.
    generations, population : int
        Of each search and cap.
    laws : sequence of str
        Further laws, ``FILE:NAME``.
    given : mapping, optional
        Further laws by name.
    any_plant : bool
        Take every draw, not only those on which Controllers 1 to 3 as published are stable.
    jobs : int
        Processes; -1 is one for each processor.
    dask : str, optional
        Address of a scheduler that the work is sent to.

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    UsageError
        For too little effort, or a law without bounds or that cannot run on lanes.
    """
    least = {"plants": 1, "searches": 2, "generations": 2, "population": 4}
    effort = Effort(searches, generations, population)
    for name, value in {"plants": plants, **effort._asdict()}.items():
        if value < least[name]:
            raise UsageError(f"must be at least {least[name]}, found {value}", where=f"--{name}")
    loaded = load_ensemble(request.config, overrides=request.overrides)
    own = laws_of(laws, given)
    task = Task(loaded, (*LAWS, *map(user_law, own)), effort, request.seed or 0)
    for law in task.laws[len(LAWS) :]:
        _try(task, law)
    identity = _identity(task, own, plants, any_plant=any_plant)
    folder = request.folder("tune")
    if request.dry_run:
        foretell(folder, identity, "tune", request, talk)
        text = f"tune: {len(task.laws)} laws on {plants} plants\nwould write to {folder}"
        return {"schema_version": SCHEMA_VERSION, "dry_run": True, "out": str(folder), "text": text}
    states = f"plants-{identity[:16]}"
    with replaced(folder, identity, command="tune", force=request.force, keep=states) as result:
        numbers = _usable(task, plants, talk, every=any_plant)
        drawn = _tuned(task, numbers, result.path / states, jobs, dask, talk)
        told = outcome(task, drawn, [law.name for law in own])
        told.save(result, "tune")
        shutil.rmtree(result.path / states)
        result.manifest = make_manifest(loaded.base, result.seconds, "tune")
        result.manifest |= {"experiment": "tune", "seed": task.seed}
        result.manifest["solver"] = {"name": COMPILED_STEPPER, "tolerance": TOLERANCE}
        result.manifest["config"] |= {"sha256": identity, "ensemble_sha256": loaded.sha256}
    text = f"{told.text()}\n\nResults are in {folder}"
    return {**told.data, "text": text, "out": str(folder), "manifest": str(folder / MANIFEST)}


def _try(task: Task, law: TunedLaw) -> None:
    """Refuse a user's law that does not become code on lanes, before hours of work."""
    plants = task.draw(0)
    start = law.values(law.start(plants.alpha.size), plants.alpha.size)
    try:
        measure(plants, [Candidate(law, "none", False, start)])
    except Exception as error:
        message = f"the law {law.name} cannot run on many plants together: {type(error).__name__}: {error}"
        hint = "return tau, H_hat, s and de, and choose by tendonrepro.arrays.choose instead of if"
        raise UsageError(message, where="--law", hint=hint) from error


def _identity(task: Task, own: Sequence[UserLaw], plants: int, *, any_plant: bool) -> str:
    """SHA-256 of all that the numbers depend on."""
    content = {
        "schema": SCHEMA_VERSION,
        "version": __version__,
        "code": code_digest("physics", "simulation", "tuning"),
        "config": task.loaded.sha256,
        "laws": with_user_laws(task.loaded.base, own).sha256,
        "effort": list(task.effort),
        "seed": task.seed,
        "plants": [plants, any_plant],
    }
    return digest_of(content)


def _usable(task: Task, wanted: int, talk: Talk, *, every: bool) -> list[int]:
    """Numbers of the first draws on which Controllers 1 to 3 as published are stable, or of every draw."""
    found: list[int] = []
    with talk.bar("looking for plants", wanted) as progress:
        for number in range(MOST_DRAWS_PER_PLANT * wanted):
            if every or usable(task.draw(number)):
                found.append(number)
                progress(1)
            if len(found) == wanted:
                return found
    message = (
        f"only {len(found)} of {MOST_DRAWS_PER_PLANT * wanted} draws are stable with the published gains"
    )
    raise UsageError(message, where="--plants", hint="ask for fewer, or say --any-plant")


def _tuned(
    task: Task, numbers: Sequence[int], states: Path, jobs: int, dask: str | None, talk: Talk
) -> list[dict[str, Any]]:
    """Tune on every draw; what is on disk already is not done again."""
    states.mkdir(exist_ok=True)
    missing = [number for number in numbers if not (states / f"{number}.json").exists()]
    if len(missing) < len(numbers):
        talk.note(f"{len(numbers) - len(missing)} of {len(numbers)} plants are on disk already")
    processes = jobs if jobs > 0 else os.cpu_count() or 1
    stream = on_cluster(task.tuned, missing, dask) if dask else as_ready(task.tuned, missing, processes)
    with talk.resumable(), talk.bar("tuning on plants", len(missing)) as progress, closing(stream):
        for one in stream:
            write_atomically(states / f"{one['draw']}.json", to_json(one))
            progress(1)
    return [json.loads((states / f"{number}.json").read_text("utf-8")) for number in numbers]


def outcome(task: Task, drawn: Sequence[dict[str, Any]], own: Sequence[str]) -> Outcome:
    """Numbers, tables and the figure."""
    from tendonrepro.tuning.figure import draw_tuning

    titles = {law.name: law.title for law in task.laws}
    pairs = [*QUESTIONS, *((name, over) for name in own for over in ("ntsm", "pid"))]
    rows, lost = (
        [{"draw": one["draw"], **row} for one in drawn for row in one[part]] for part in ("rows", "lost")
    )
    found, joints = list(comparisons(rows, pairs, task.seed)), task.loaded.compare.joints
    laws, questions = list(law_rows(rows, joints)), question_rows(found, titles)
    data = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "tune",
        "effort": task.effort._asdict(),
        "seed": task.seed,
        "physics_sha256": code_digest("physics"),
        "draws_looked_at": drawn[-1]["draw"] + 1,
        "plants": len(drawn),
        "joints": list(joints),
        "questions": questions,
        "comparisons": [one._asdict() for one in found],
        "laws": laws,
        "lost_to_special_case": lost,
        "by_plant": rows,
    }
    parts = tables(questions, found, laws, len(drawn))
    warning = [f"NOT TO BE TRUSTED: in {len(lost)} cases a law lost to its own special case; search longer."]
    return Outcome(data, [*(warning if lost else []), *parts], {"tune": lambda: draw_tuning(laws, titles)})
