"""Search for plants, motions and readings that give the printed numbers, and judge what was not fitted."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.ensemble import LoadedEnsemble, load_ensemble
from tendonrepro.config.models.readings import AXES, RUNS, Reading, default_readings, parse_reading
from tendonrepro.config.published import Published, published
from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.ensemble.block import Simulate
from tendonrepro.ensemble.box import make_box, scrambled_sobol
from tendonrepro.errors import UsageError
from tendonrepro.files import to_json
from tendonrepro.identify import judge
from tendonrepro.identify.misfit import (
    NEAR,
    SCHEMA_VERSION,
    Bench,
    Target,
    Task,
    Window,
    log_misfit,
    log_residuals,
    printed_numbers,
    rounding_misfit,
)
from tendonrepro.identify.report import CONFIG, conclusions, write_config, write_identify_tables
from tendonrepro.identify.search import Effort, Evaluated, State, search
from tendonrepro.results.folder import HeldFolder, claimed, foretell_refusal
from tendonrepro.results.manifest import make_manifest
from tendonrepro.simulation.batch import simulate_batch

DATA = "identify.json"
STATES = "search"

FEWEST_MEMBERS = 5

_SIMULATE = partial(simulate_batch, threads=os.cpu_count() or 1)

GENERATIONS, POPULATION, SEEDS = 120, 48, 3
"""Effort of each search unless told otherwise; some five minutes of two processors."""


def run_identify(
    request: Request,
    talk: Talk,
    *,
    fit: Target = "controller_2",
    readings: str = "printed",
    window: Window = "whole",
    generations: int = GENERATIONS,
    population: int = POPULATION,
    seeds: int = SEEDS,
    simulate: Simulate = _SIMULATE,
    paper: Published | None = None,
) -> dict[str, Any]:
    """Search, judge, and write numbers, tables, figures and the best plant's configuration.

    Parameters
    ----------
    request : Request
        Its configuration is that of an ensemble, whose box is searched.
    talk : Talk
    fit : {'controller_2', 'all'}
        Fit Controller 2's four numbers and judge the others by them; or all sixteen and judge nothing.
    readings : str
        ``printed``, ``default``, or names joined by commas.
    window : {'whole', 'late'}
        What the printed numbers average.
    generations, population, seeds : int
        Effort of each search; the population is that of one seed.
    simulate : callable
        The batch stepper.
    paper : Published, optional
        Other printed numbers than the shipped ones.

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    UsageError
        For an unknown reading, too small an effort, or a folder with other results.
    TendonreproError
        When results cannot be written; searches are taken up again from their last generation.
    """
    folder = request.folder("identify")
    _check(fit, window, generations, population, seeds)
    loaded = load_ensemble(request.config, overrides=request.overrides, seed=request.seed)
    joints, box = loaded.compare.joints, make_box(loaded.config)
    smooth = tuple(choices.size == 0 for choices in box.choices)
    task = Task(
        loaded=loaded,
        fit=fit,
        readings=_readings(readings, loaded),
        effort=Effort(generations, population, seeds, NEAR, smooth),
        seed=int(loaded.config.seed.si),
        printed=printed_numbers(paper or published(), joints),
        bench=Bench(loaded.base, box, window, simulate),
    )
    identity = task.identity([held.name for held in task.readings])
    if request.dry_run:
        foretell_refusal(folder, identity, talk, force=request.force)
        return _outline(task, folder) | {"dry_run": True, "config_sha256": loaded.sha256}
    with claimed(folder, identity, force=request.force) as held:
        return _identified(task, held, identity, talk)


def _check(fit: str, window: str, generations: int, population: int, seeds: int) -> None:
    efforts = ("generations", generations, 1), ("population", population, FEWEST_MEMBERS), ("seeds", seeds, 1)
    for option, value, fewest in efforts:
        if value < fewest:
            message = f"must be at least {fewest}, found {value}"
            raise UsageError(message, where=f"--{option}")
    for option, word, known in (("--fit", fit, get_args(Target)), ("--window", window, get_args(Window))):
        if word not in known:
            message = f"must be {' or '.join(known)}, found {word!r}"
            raise UsageError(message, where=option)


def _readings(text: str, loaded: LoadedEnsemble) -> tuple[Reading, ...]:
    if text == "default":
        return default_readings(loaded.config)
    found = tuple(dict.fromkeys(parse_reading(name.strip()) for name in text.split(",")))
    for held in found:
        if any(axis not in AXES for axis, _ in held.settings):
            message = f"{held.name} is a variation, not a reading"
            raise UsageError(message, where="--readings")
    return found


def _outline(task: Task, folder: Path) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "experiment": "identify",
        "fit": task.fit,
        "judged": task.fit != "all",
        "window": task.bench.window,
        "readings": [held.name for held in task.readings],
        "searches": list(dict.fromkeys(task.case(held).name for held in task.readings)),
        "evaluations": task.effort.evaluations,
        "generations": task.effort.generations,
        "population": task.effort.population,
        "seeds": task.effort.seeds,
        "seed": task.seed,
        "near_tolerance": NEAR,
        "joints": list(task.printed.joints),
        "out": str(folder),
    }


def _identified(task: Task, held: HeldFolder, identity: str, talk: Talk) -> dict[str, Any]:
    from tendonrepro.identify.figures import draw_identify_figures

    folder = held.path
    states = {reading.name: _searched(task, task.case(reading), folder, talk) for reading in task.readings}
    with talk.bar("judging", len(task.readings)) as progress:
        found = []
        for reading in task.readings:
            found.append(_reading_data(task, reading, states[reading.name]))
            progress(1)
    data = _outline(task, folder) | {"readings": found, "config": str(folder / CONFIG)}
    data["conclusions"] = conclusions(data)
    held.clear()
    place = int(np.argmin([entry["misfit_log"] for entry in found]))
    best = task.readings[place]
    config = task.bench.config(states[best.name].best()[0], best)
    write_config(folder / CONFIG, config, found[place]["misfit_log"], best.name)
    held.files += [folder / CONFIG, *write_identify_tables(data, folder / "tables")]
    held.files += draw_identify_figures(data, folder / "figures")
    held.write(DATA, to_json(data))
    manifest = make_manifest(task.loaded.base, held.seconds)
    manifest |= {"experiment": "identify", "seed": task.seed}
    manifest["config"] = manifest["config"] | {"sha256": identity, "ensemble_sha256": task.loaded.sha256}
    return data | {"manifest": held.finish(manifest, talk)}


def _searched(task: Task, case: Reading, folder: Path, talk: Talk) -> State:
    """Search under one case; a finished one is read from disk."""
    places = [RUNS.index(run) for run in task.fitted]
    goal = task.printed.values[places]

    def misfit(units: Array) -> Evaluated:
        measured = task.bench.measure(units, case, task.fitted)
        residuals = log_residuals(measured, goal).reshape(len(units), -1)
        return Evaluated(log_misfit(measured, goal), residuals)

    identity = task.identity([case.name])
    talk.detail(f"search under {case.name}")
    members, seeds = task.effort.population, range(task.effort.seeds)
    initial = np.stack([scrambled_sobol(task.bench.box, task.seed, place, 0, members) for place in seeds])
    path = folder / STATES / f"{identity[:16]}.npz"
    return search(initial, misfit, task.effort, task.seed, path, identity, talk)


def _reading_data(task: Task, held: Reading, state: State) -> dict[str, Any]:
    """Everything about one reading as plain values."""
    unit, misfit = state.best()
    limit = max(NEAR, 2.0 * misfit)
    near_units = state.near(limit)
    measured = task.bench.measure(np.concatenate([unit[np.newaxis], near_units]), held, RUNS)
    best, near = measured.part(slice(0, 1)), measured.part(slice(1, None))
    printed, fitted = task.printed, [RUNS.index(run) for run in task.fitted]
    rounding = rounding_misfit(best.sizes[:, fitted], printed.values[fitted], printed.half[fitted])
    return {
        "name": held.name,
        "search": task.case(held).name,
        "misfit_log": misfit,
        "misfit_rounding": float(rounding[0]),
        "fits": misfit <= NEAR,
        "near_limit": limit,
        "near_count": len(near_units),
        "misfit_by_seed": state.misfits.min(axis=1).tolist(),
        "history": state.history.tolist(),
        "best_status": judge.status_counts(best),
        "near_status": judge.status_counts(near),
        "numbers": judge.number_rows(best, near, printed, task.fitted),
        "order": judge.order_rows(near, printed),
        "ratios": judge.ratio_rows(near, printed),
        "parameters": judge.parameter_rows(task.bench.box, unit, near_units),
        "pareto": judge.pareto_rows(measured, printed, task.fitted),
    }
