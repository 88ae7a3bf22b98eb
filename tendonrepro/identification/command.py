"""Search for plants, motions and readings that give the printed numbers, and judge what was not fitted."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble, load_ensemble
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import Reading, default_readings, named_readings
from tendonrepro.configuration.published import Published, published
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.files import to_json
from tendonrepro.identification import judge
from tendonrepro.identification.misfit import (
    NEAR,
    SCHEMA_VERSION,
    Bench,
    Target,
    Task,
    Window,
    log_misfit,
    log_residuals,
    nominal_unit,
    printed_numbers,
    rounding_misfit,
    rows_that_matter,
)
from tendonrepro.identification.report import CONFIG, conclusions, write_config, write_identify_tables
from tendonrepro.identification.search import Effort, Evaluated, Found, load_arrays, save_arrays, search
from tendonrepro.monte_carlo.block import Simulate
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol
from tendonrepro.monte_carlo.workers import here
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.paper import OTHER_BASE, base_of_paper
from tendonrepro.results.store import MANIFEST, NewResult, replaced, take_over
from tendonrepro.results.study import foretell
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE

Searched: TypeAlias = tuple[NDArray[np.bool_], Found]
"""Rows of the box that were searched, (P,), and the search."""

DATA = "identify.json"
STATES = "search"

FEWEST_MEMBERS = 5
MOST = {"generations": 10**5, "population": 2048, "seeds": 64}
"""Largest effort that memory holds."""

GENERATIONS, POPULATION, SEEDS = 60, 48, 3
"""Effort of each search unless told otherwise."""


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
    jobs: int = -1,
    simulate: Simulate | None = None,
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
    jobs : int
        Processors; -1 is all. Searches run side by side, a single one on all of them.
    simulate : callable, optional
        Another batch stepper.
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
    if not jobs:
        raise UsageError("must be a number of processors, or -1 for all, found 0", where="--jobs")
    processors = jobs if jobs > 0 else os.cpu_count() or 1
    loaded = load_ensemble(request.config, overrides=request.overrides, seed=request.seed)
    joints, box = loaded.compare.joints, make_box(loaded.config)
    task = Task(
        loaded=loaded,
        fit=fit,
        readings=_readings(readings, loaded),
        effort=Effort(generations, population, seeds, NEAR, (), fit != "all"),
        seed=int(loaded.config.seed.si),
        printed=printed_numbers(paper or published(), joints),
        bench=Bench(loaded.base, box, window, simulate or partial(simulate_batch, threads=processors)),
    )
    identity = task.identity([held.name for held in task.readings])
    if request.dry_run:
        foretell(folder, identity, "identify", request, talk)
        return _outline(task, folder) | {"dry_run": True, "config_sha256": loaded.sha256}
    with replaced(folder, identity, command="identify", force=request.force, keep=STATES) as result:
        names = [path.name for path in (folder / STATES).glob("*.npz")]
        take_over(folder / STATES, result.path / STATES, names)
        return _identified(task, folder, result, identity, processors, talk)


def _check(fit: str, window: str, generations: int, population: int, seeds: int) -> None:
    efforts = ("generations", generations, 1), ("population", population, FEWEST_MEMBERS), ("seeds", seeds, 1)
    for option, value, fewest in efforts:
        if not fewest <= value <= MOST[option]:
            message = f"must be at least {fewest} and at most {MOST[option]}, found {value}"
            raise UsageError(message, where=f"--{option}")
    for option, word, known in (("--fit", fit, get_args(Target)), ("--window", window, get_args(Window))):
        if word not in known:
            raise UsageError(f"must be {' or '.join(known)}, found {word!r}", where=option)


def _readings(text: str, loaded: LoadedEnsemble) -> tuple[Reading, ...]:
    return default_readings(loaded.config.pairs) if text == "default" else named_readings(text)


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


def _identified(
    task: Task, out: Path, result: NewResult, identity: str, processors: int, talk: Talk
) -> dict[str, Any]:
    from tendonrepro.identification.figures import draw_identify_figures

    folder = result.path
    found = _searches(task, folder, processors, talk)
    with talk.bar("judging", len(task.readings)) as progress:
        readings = []
        for reading in task.readings:
            readings.append(_reading_data(task, reading, *found[task.case(reading)]))
            progress(1)
    data = _outline(task, out) | {"readings": readings, "config": str(out / CONFIG)}
    data["conclusions"] = [OTHER_BASE] * (not base_of_paper(task.loaded.compare)) + conclusions(data)
    place = int(np.argmin([entry["misfit_log"] for entry in readings]))
    best = task.readings[place]
    rows, state = found[task.case(best)]
    config = task.bench.searching(rows).config(_whole(task, rows, state.closest[np.newaxis])[0], best)
    write_config(folder / CONFIG, config, data, readings[place])
    write_identify_tables(data, folder / "tables")
    draw_identify_figures(data, folder / "figures")
    result.write(DATA, to_json(data))
    manifest = make_manifest(task.loaded.base, result.seconds, "identify")
    stepper = {"name": COMPILED_STEPPER, "tolerance": TOLERANCE}
    manifest |= {"experiment": "identify", "seed": task.seed, "solver": stepper}
    manifest["config"] = manifest["config"] | {"sha256": identity, "ensemble_sha256": task.loaded.sha256}
    result.manifest = manifest
    return data | {"manifest": str(out / MANIFEST)}


def _searches(task: Task, folder: Path, processors: int, talk: Talk) -> dict[Reading, Searched]:
    """Search under every case, side by side where there are several."""
    cases = list(dict.fromkeys(task.case(reading) for reading in task.readings))
    evaluations, processes = task.effort.evaluations, min(processors, len(cases))
    with talk.resumable(), talk.bar("searching", evaluations * len(cases)) as progress:
        if processes == 1:
            return dict(_searched(task, folder, talk, case, progress) for case in cases)
        # Another stepper knows nothing of threads.
        if isinstance(task.bench.simulate, partial):
            alone = partial(task.bench.simulate, threads=1)
            task = replace(task, bench=replace(task.bench, simulate=alone))
        found = {}
        with closing(here(partial(_searched, task, folder, talk), cases, processes)) as stream:
            for case, one in stream:
                found[case] = one
                progress(evaluations)
        return found


def _searched(
    task: Task, folder: Path, talk: Talk, case: Reading, progress: Callable[[int], None] = lambda _: None
) -> tuple[Reading, Searched]:
    """Choose rows and search under one case; what is on disk already is not done again."""
    identity = task.identity([case.name])
    path, chosen = (folder / STATES / f"{identity[:16]}{name}.npz" for name in ("", "-rows"))
    kept = load_arrays(chosen, identity, talk)
    if kept is None or kept.get("rows", np.empty(0)).shape != np.shape(task.bench.box.names):
        # What is judged may feel rows that what is fitted does not.
        every = np.ones(len(task.bench.box.names), dtype=np.bool_)
        is_all = task.fit == "all"
        felt = rows_that_matter(task.bench, case, task.fitted, task.goal, task.seed) if is_all else every
        kept = {"rows": felt}
        save_arrays(chosen, identity, **kept)
    rows: NDArray[np.bool_] = kept["rows"]
    bench, effort = task.bench.searching(rows), task.effort
    talk.detail(f"{case.name}: searches {', '.join(np.array(bench.box.names)[rows])}")

    def misfit(points: Array) -> Evaluated:
        measured = bench.measure(_whole(task, rows, points), case, task.fitted)
        residuals = log_residuals(measured, task.goal).reshape(len(points), -1)
        return Evaluated(log_misfit(measured, task.goal), residuals)

    smooth = tuple(bench.box.choices[row].size == 0 for row in np.flatnonzero(rows))
    draws = [scrambled_sobol(bench.box, task.seed, k, 0, effort.population) for k in range(effort.seeds)]
    first, effort = np.stack(draws)[..., rows], replace(effort, smooth=smooth)
    return case, (rows, search(first, misfit, effort, task.seed, path, identity, talk, progress))


def _whole(task: Task, rows: NDArray[np.bool_], points: Array) -> Array:
    """Points (N, F) of the searched rows as points (N, P) of the box."""
    units = np.tile(nominal_unit(task.bench.box), (len(points), 1))
    units[:, rows] = points
    return units


def _reading_data(task: Task, held: Reading, rows: NDArray[np.bool_], state: Found) -> dict[str, Any]:
    """Everything about one reading as plain values."""
    point, misfit = state.closest, state.misfit
    limit = max(NEAR, 2.0 * misfit)
    units = _whole(task, rows, np.vstack([point, state.near(limit)]))
    bench = task.bench.searching(rows)
    measured = bench.measure(units, held, RUNS)
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
        "near_count": len(units) - 1,
        "misfit_by_seed": state.history[-1].tolist(),
        "seeds_agree": state.agree(NEAR),
        "rows_searched": [name for name, free in zip(bench.box.names, rows, strict=True) if free],
        "history": state.history.tolist(),
        "best_shape": judge.shape_rows(best, printed),
        "numbers": judge.number_rows(best, near, printed, task.fitted),
        "order": judge.order_rows(near, printed),
        "parameters": judge.parameter_rows(bench.box, units[0], units[1:]),
        "pareto": judge.pareto_rows(measured, printed, task.fitted),
    }
