"""Search for plants, motions and readings that give the paper's numbers, or a user's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble, draws_rows, readings_on
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models import readings as axes
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.experiment import errors_from
from tendonrepro.configuration.models.readings import SHOWN, Reading, default_readings, named_readings
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import reference_period
from tendonrepro.files import Json
from tendonrepro.identification import report
from tendonrepro.identification.bench import (
    Bench,
    Goal,
    Repeats,
    Target,
    Window,
    bench_of,
    goal_of,
    with_input,
)
from tendonrepro.identification.optimisers import SEARCHES, SearchPoints
from tendonrepro.monte_carlo.kept import WHOLE_RUNS, identity_of, study_on_plants
from tendonrepro.monte_carlo.population import Population
from tendonrepro.parallel import as_ready, check_jobs, processors
from tendonrepro.physics.metrics import START
from tendonrepro.results.paper import OTHER_BASE, base_of_paper
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Folder, Site, Study, cost_of, folder_of

Results: TypeAlias = dict[str, tuple[Json, CompareConfig]]
"""Numbers and best plant by reading."""

Seen: TypeAlias = tuple[Array, Array]
"""Points (N, P) that a search looked at, and their misfits (N,)."""

SCHEMA_VERSION = 4

SECONDS_PER_EXPERIMENT = 1e-2
"""For estimates before a search. Measured: 7 to 10 ms; larger batches are faster."""

TRIED, AGAIN, REPEATS = (24, 3), (6, 15), 64
"""So many of the nearest points are repeated so often, then so many of the next.

It ends where no misfit that was seen is below the best median, or with as many evaluations as the search had.
Of the best by median so many are repeated more often, and the best of these once more.
"""

NEAR = 0.02
"""Misfit in log ratio, about 2 %, up to which a plant fits; near is up to twice the best misfit."""


@dataclass(frozen=True)
class IdentificationTask:
    """What an identification depends on."""

    loaded: LoadedEnsemble
    goal: Goal
    readings: tuple[Reading, ...]
    budget: int
    rows: tuple[str, ...]
    seed: int
    bench: Bench

    @property
    def draws(self) -> int:
        """Points that both searches know beforehand."""
        return (self.budget + 1) // 2

    @property
    def evaluations(self) -> int:
        """Points of one reading at most, repeats among them."""
        points, count = AGAIN
        return self.draws + len(SEARCHES) * (2 * self.budget + points * count + REPEATS)

    def cases(self) -> dict[Reading, list[Reading]]:
        """Readings by what of them changes the fitted runs; that is searched once."""
        found: dict[Reading, list[Reading]] = {}
        for held in self.readings:
            of_runs = [axes.case_of(held, run) if run in RUNS else held for run in self.goal.sought.runs]
            changing = {axis for of_run in of_runs for axis, _ in of_run.settings}
            case = axes.reading({axis: value for axis, value in held.settings if axis in changing})
            found.setdefault(case, []).append(held)
        return found

    def cost(self) -> dict[str, float]:
        """Experiments at most, and about how many hours of one processor they take."""
        plants = self.evaluations * len(self.cases())
        return cost_of(plants * len(self.goal.sought.runs), SECONDS_PER_EXPERIMENT)

    def outline(self) -> Json:
        """What is known beforehand."""
        around = self.loaded.around
        return {
            "schema_version": SCHEMA_VERSION,
            "experiment": "identify",
            **self.goal.named,
            **({"around": around.as_data() | {"told": around.told}} if around else {}),
            "window": self.bench.window,
            "searches": [case.name for case in self.cases()],
            "budget": self.budget,
            "draws": self.draws,
            "evaluations": self.evaluations,
            "rows": list(self.rows),
            "overrides": list(self.loaded.base.overrides),
            "near_tolerance": NEAR,
            "seed": self.seed,
            "joints": list(self.goal.joints),
        }

    @property
    def identity(self) -> str:
        """SHA-256 of what each search depends on: all of it but which other readings are searched."""
        numbers = [self.goal.name, self.goal.runs, self.goal.values.tolist(), self.goal.half.tolist()]
        outline = {name: value for name, value in self.outline().items() if name != "searches"}
        return identity_of(self.loaded, "identification", outline=outline, goal=numbers)


def identification(
    loaded: LoadedEnsemble,
    *,
    fit: Target,
    errors: Path | None = None,
    readings: str,
    window: Window,
    budget: int,
    rows: str,
    jobs: int,
    folder: Folder,
) -> Study:
    """Check and prepare a search.

    Parameters
    ----------
    loaded : LoadedEnsemble
        Its box is searched, or the ranges around the arm of its base.
    fit : {'controller_2', 'all'}
        Numbers of the paper.
    errors : Path, optional
        Table or log whose numbers are fitted instead.
    readings : str
        ``printed``, ``default``, those that pictures and tables show as ``shown``, or names joined by commas.
    budget : int
        Points of each search.
    rows : str
        Names of the rows that are searched, joined by commas; without one all that can vary.

    Raises
    ------
    UsageError
        For an unknown reading or row, no effort, or no numbers to fit.
    """
    if budget < 1:
        raise UsageError(f"must be at least 1, found {budget}", where="--budget")
    check_jobs(jobs)
    if errors and fit != "controller_2":
        message = f"is of the paper's tables; what is fitted stands in {errors}"
        raise UsageError(message, where="--fit", hint="leave it out")
    window = _window(loaded, window) if errors else window
    bench = bench_of(loaded, window)
    named = _named_rows(rows, bench.box)
    task = IdentificationTask(
        loaded=loaded,
        goal=goal_of(loaded, errors, window, fit),
        readings=_named(readings, loaded),
        budget=budget,
        rows=named,
        seed=int(loaded.config.seed.si),
        bench=bench.searching(np.isin(bench.box.names, named)) if named else bench,
    )
    out = folder_of("identify", folder)
    head = task.outline() | {"out": str(out), "config": str(out / report.CONFIG)}

    def run(site: Site, states: Path) -> Result:
        return _result(task, head, _searches(task, states, jobs, site.talk), site.files)

    told, averages = with_input(loaded, errors), "" if errors else WHOLE_RUNS
    study = study_on_plants("identify", told, task.identity, run, folder, cost=task.cost(), averages=averages)
    asked = [reading.name for reading in task.readings]
    text = f"identify would make {count_of(len(head['searches']), 'search', 'searches')}"
    text += f" of {head['evaluations']} plants\nwould write to {head['out']}"
    plan = {**head, "config_sha256": loaded.sha256, "readings": asked, "text": text}
    return replace(study, decided_by={"readings": asked}, plan=plan)


def _window(loaded: LoadedEnsemble, window: Window) -> Window:
    """What a user's errors average, as the comparison says; a UsageError where that is not known."""
    config = loaded.compare
    if window == "late":
        if loaded.around and not reference_period(config.reference):
            raise UsageError("the motion has no period", where="--window", hint="say --window whole")
        return window
    seconds = errors_from(config)
    if seconds not in (0.0, START):
        message = f"errors_from is {seconds:g} s; errors are fitted from 0 or {START:g} s on"
        raise UsageError(message, where=loaded.base.origin, hint="change errors_from, and average so")
    return "settled" if seconds else "whole"


def _result(task: IdentificationTask, head: Json, results: Results, files: Path) -> Result:
    """Numbers, tables and figures, and the best plants' configurations as files."""
    searches = [results[reading.name][0] for reading in task.readings]
    nearest = report.nearest_search(searches)["name"]
    paths = [(files / report.PLANTS / f"{name}.yaml", name) for name in results]
    for path, name in [*paths, (files / report.CONFIG, nearest)]:
        reading, best = results[name]
        report.write_config(path, best, task.bench.box, task.goal, reading)
    other = task.goal.of_paper and not base_of_paper(task.loaded.compare)
    remarks = [OTHER_BASE] if other else []
    return report.identification_result(head, searches, task.goal, task.bench.box, remarks)


def _named(readings: str, loaded: LoadedEnsemble) -> tuple[Reading, ...]:
    if readings == "default":
        every = default_readings(loaded.config.pairs)
    else:
        every = named_readings(",".join(SHOWN) if readings == "shown" else readings)
    # Around an arm those of a list that draw from the paper's ranges are left out; one by name is refused.
    listed = loaded.around and readings in ("default", "shown")
    return readings_on(
        loaded, ",".join(reading.name for reading in every if not (listed and draws_rows(reading)))
    )


def _named_rows(text: str, box: Population) -> tuple[str, ...]:
    """Rows of a list with commas between; a UsageError for one that there is not, or that cannot move."""
    rows = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    free = [row.name for row in box.rows if row.free]
    for name in rows:
        if name not in box.names:
            close = ", ".join(get_close_matches(name, free)) or f"there are: {', '.join(free)}"
            raise UsageError(f"no row of the ranges is called {name!r}", where="--rows", hint=close)
        if name not in free:
            message = f"{name} is off on this arm, or its range is a point"
            raise UsageError(message, where="--rows", hint=f"These can be searched: {', '.join(free)}")
    return rows


def _searches(task: IdentificationTask, states: Path, jobs: int, talk: Talk) -> Results:
    """Search for every reading, several at once."""
    cases, jobs = list(task.cases()), jobs if jobs > 0 else processors()
    processes = min(jobs, len(cases))
    threads = jobs if processes == 1 else 1
    simulate = partial(simulate_batch, threads=threads)
    task = replace(task, bench=replace(task.bench, simulate=simulate))
    results: Results = {}
    with talk.bar("searching", task.evaluations * len(cases)) as progress:
        # In this process a search tells each plant, in another one only its end.
        work = partial(_searched, task, states, progress if processes == 1 else None)
        with closing(as_ready(work, range(len(cases)), processes)) as stream:
            for of_case in stream:
                results |= of_case
                if processes > 1:
                    progress(task.evaluations)
    return results


class _End(NamedTuple):
    """What a search ends with: a row of the answer, and points (N, P) by medians (N,) of their repeats."""

    row: Json
    points: Array
    medians: Array


def _searched(
    task: IdentificationTask, states: Path, progress: Callable[[int], None] | None, place: int
) -> Results:
    """Search for one case, and tell what it found under each reading that shares it."""
    case, readings = list(task.cases().items())[place]
    box, told = task.bench.box, progress or (lambda _: None)
    misfit = partial(task.bench.evaluated, reading=case, goal=task.goal.sought)

    def plants(name: str, most: int) -> SearchPoints:
        return SearchPoints(misfit, len(box.names), most, states / f"{case.name}-{name}.npy", told)

    draws = plants("draws", task.draws)
    points = box.points(task.seed, 0, 0, task.draws)
    starts = points[np.argsort(draws(points).misfits, kind="stable")]
    smooth, ends, seen = np.array([not row.choices for row in box.rows]), [], [draws.seen]
    for name, search in SEARCHES.items():
        look = plants(name.replace(" ", "_"), task.budget)
        search(starts, box.free, smooth, look, task.seed)
        ends.append(_repeated(task, case, name, [draws.seen, look.seen], told))
        seen.append(look.seen)
    ends.sort(key=lambda end: end.row["misfit_log"])
    return {reading.name: _reading_data(task, case, reading, ends, seen) for reading in readings}


def _repeated(
    task: IdentificationTask, case: Reading, name: str, seen: Sequence[Seen], told: Callable[[int], None]
) -> _End:
    """Repeat the nearest points of a search: one that came near by luck does so once."""
    points, misfits = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    points, first = np.unique(points, axis=0, return_index=True)
    order = np.argsort(misfits[first], kind="stable")
    points, misfits = points[order], misfits[first][order]
    bench, goal = task.bench, task.goal.sought

    def repeated(nearest: Array, count: int, stage: int) -> Repeats:
        told(len(nearest) * count)
        return bench.repeated(bench.box.values(nearest), case, goal, count, [task.seed, stage])

    (at_once, count), most = TRIED, min(len(points), max(task.budget // TRIED[1], 1))
    medians = np.empty(0)
    while medians.size < most and not np.any(medians <= misfits[medians.size]):
        nearest = points[medians.size : min(medians.size + at_once, most)]
        medians = np.append(medians, repeated(nearest, count, medians.size).median)
    told(task.budget - medians.size * count)
    points = points[np.argsort(medians, kind="stable")[: AGAIN[0]]]
    medians = repeated(points, AGAIN[1], len(misfits)).median
    order = np.argsort(medians, kind="stable")
    points, medians = points[order], medians[order]
    repeats = repeated(points[:1], REPEATS, len(misfits) + 1)
    low, high = np.quantile(repeats.misfits, (0.25, 0.75)).tolist()
    row = {
        "search": name,
        "misfit_log": float(repeats.median[0]),
        "low": low,
        "high": high,
        "in_order": float(repeats.ordered.mean()) if len(goal.compared) > 1 else None,
        "seen": float(misfits[0]),
    }
    return _End(row, points, medians)


def _reading_data(
    task: IdentificationTask, case: Reading, reading: Reading, ends: Sequence[_End], seen: Sequence[Seen]
) -> tuple[Json, CompareConfig]:
    """Values of one reading, and its best plant."""
    bench, goal, nearest, misfit = task.bench, task.goal, ends[0], ends[0].row["misfit_log"]
    limit = max(NEAR, 2.0 * misfit)
    units = np.vstack([nearest.points[:1], *(end.points[end.medians <= limit] for end in ends)])
    config = bench.config(units[0], reading)
    ours = bench.measure(bench.box.values(units), reading, goal.runs)
    near = np.vstack([nearest.points[:1], *(points[misfits <= limit] for points, misfits in seen)])
    known = report.known_rows(bench.box, near, goal.numbers, fits=misfit <= NEAR)
    values = report.arm_values(config, bench.box)
    for row in known if values else ():
        row["value"], row["value_unit"] = values[row["name"]]
    data: Json = {
        "name": reading.name,
        "search": case.name,
        "misfit_log": misfit,
        "fits": misfit <= NEAR,
        "searches": [end.row for end in ends],
        "near_limit": limit,
        "near_count": len(units) - 1,
        "rows_searched": [row.name for row in bench.box.rows if row.free],
        "best_shape": report.shape_rows(ours, goal),
        "numbers": report.number_rows(ours, goal),
        "parameters": report.parameter_rows(bench.box, units[0]),
        "known": known,
    }
    return data, config
