"""Search for plants, motions and readings that give the printed numbers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from tendonrepro import __version__
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models import readings as axes
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import Reading, default_readings, named_readings
from tendonrepro.configuration.published import published
from tendonrepro.configuration.shown import SHOWN
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import UsageError
from tendonrepro.files import digest_of
from tendonrepro.identification import report
from tendonrepro.identification.misfit import Bench, Printed, Window, printed_numbers, rounding_misfit
from tendonrepro.identification.search import (
    Effort,
    Found,
    Plants,
    held_unit,
    search,
)
from tendonrepro.identification.unknowns import rows_that_explain
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol
from tendonrepro.monte_carlo.held import held_at
from tendonrepro.monte_carlo.plan import code_digest
from tendonrepro.monte_carlo.report import work_text
from tendonrepro.parallel import as_ready, processors
from tendonrepro.results.paper import OTHER_BASE, base_of_paper
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.device import DeviceName, require
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE
from tendonrepro.studies.lifecycle import folder_of
from tendonrepro.studies.outcome import Outcome
from tendonrepro.studies.parameters import Folder
from tendonrepro.studies.study import Site, Study

Target: TypeAlias = Literal["controller_2", "all"]
FITTED: Mapping[Target, tuple[str, ...]] = {"controller_2": ("controller_2",), "all": RUNS}
"""Runs whose numbers are fitted."""

Results: TypeAlias = dict[str, tuple[dict[str, Any], CompareConfig]]
"""Numbers and best plant by reading."""

SCHEMA_VERSION = 3

SECONDS_PER_EXPERIMENT = 1e-2
"""For estimates before a search. Measured: 10 ms, in generations of 48 plants; larger batches are faster."""

NEAR = 0.02
"""Misfit in log ratio, about 2 %, up to which a plant fits; near is up to twice the best misfit."""


@dataclass(frozen=True)
class Task:
    """What an identification depends on."""

    loaded: LoadedEnsemble
    fit: Target
    readings: tuple[Reading, ...]
    effort: Effort
    unknowns: int
    rows: tuple[str, ...]
    seed: int
    printed: Printed
    bench: Bench
    device: DeviceName = "cpu"

    @property
    def fitted(self) -> tuple[str, ...]:
        """Runs that are fitted."""
        return FITTED[self.fit]

    @property
    def places(self) -> list[int]:
        """Their places in `RUNS`."""
        return [RUNS.index(run) for run in self.fitted]

    def cases(self) -> dict[Reading, list[Reading]]:
        """Readings by what of them changes the fitted runs; that is searched once."""
        found: dict[Reading, list[Reading]] = {}
        for held in self.readings:
            changing = {axis for run in self.fitted for axis, _ in axes.case_of(held, run).settings}
            case = axes.reading({axis: value for axis, value in held.settings if axis in changing})
            found.setdefault(case, []).append(held)
        return found

    def cost(self) -> dict[str, float]:
        """Experiments at most, and about how many hours of one processor they take."""
        plants = self.effort.evaluations * len(self.cases())
        experiments = plants * len(self.fitted)
        return {
            "experiments": experiments,
            "processor_hours": experiments * SECONDS_PER_EXPERIMENT / 3600.0,
        }

    def outline(self) -> dict[str, Any]:
        """What is known beforehand."""
        return {
            "schema_version": SCHEMA_VERSION,
            "experiment": "identify",
            "fit": self.fit,
            "window": self.bench.window,
            "searches": [case.name for case in self.cases()],
            "evaluations": self.effort.evaluations,
            **asdict(self.effort),
            "unknowns": self.unknowns,
            "rows": list(self.rows),
            "overrides": list(self.loaded.base.overrides),
            "near_tolerance": NEAR,
            "seed": self.seed,
            "joints": list(self.printed.joints),
            # Rounding of another device can lead a search elsewhere.
            **({} if self.device == "cpu" else {"device": self.device}),
        }

    def identity(self) -> str:
        """SHA-256 of all of it, and of the code."""
        readings = [held.name for held in self.readings]
        return digest_of(self._content() | {"readings": readings})

    def of_searches(self) -> str:
        """SHA-256 of what each search depends on: all of it but which other readings are searched."""
        return digest_of({name: held for name, held in self._content().items() if name != "searches"})

    def _content(self) -> dict[str, Any]:
        return self.outline() | {
            "version": __version__,
            "code": code_digest("physics", "simulation", "identification"),
            "config": self.loaded.sha256,
            "printed": [self.printed.values.tolist(), self.printed.half.tolist()],
        }


def identification(
    loaded: LoadedEnsemble,
    effort: Effort,
    *,
    fit: Target,
    readings: str,
    window: Window,
    unknowns: int,
    rows: str,
    jobs: int,
    device: DeviceName = "cpu",
    folder: Folder,
) -> Study:
    """Check and prepare a search.

    Parameters
    ----------
    loaded : LoadedEnsemble
        Its box is searched.
    readings : str
        ``printed``, ``default``, those that pictures and tables show as ``shown``, or names joined by commas.
    unknowns : int
        Rows of the ranges that are searched at most, those that explain the fitted numbers best.
    rows : str
        Names of the rows that are searched instead, joined by commas.
    device : str
        ``gpu`` runs one search after the other on a GPU.

    Raises
    ------
    TendonreproError
        If no GPU can be used.
    UsageError
        For an unknown reading or row, or no effort.
    """
    check_at_least_one(**asdict(effort), unknowns=unknowns, jobs=abs(jobs))
    require(device)
    named = _named(readings, loaded)
    box = make_box(loaded.config)
    task = Task(
        loaded=loaded,
        fit=fit,
        readings=named,
        effort=effort,
        unknowns=unknowns,
        rows=_named_rows(rows, box.names),
        seed=int(loaded.config.seed.si),
        printed=printed_numbers(published(), loaded.compare.joints),
        bench=Bench(loaded.base, held_at(box, loaded.compare), window, simulate_batch),
        device=device,
    )
    out, identity = folder_of("identify", folder), task.identity()
    head = task.outline() | {"out": str(out), "config": str(out / report.CONFIG)}
    states = f"search-{task.of_searches()[:16]}"  # those of another search are not taken up

    def run(site: Site) -> Outcome:
        return _outcome(task, head, _searches(task, site.files / states, jobs, site.talk), site.files)

    base = replace(loaded.base, sha256=identity)
    return Study(base, run, folder, keep=states, stored=True, plan=_plan(task, head))


def _plan(task: Task, head: Mapping[str, Any]) -> dict[str, Any]:
    """What ``--json`` of a dry run says."""
    searches = count_of(len(head["searches"]), "search", "searches")
    cost = task.cost()
    text = f"identify would make {searches} of {head['evaluations']} plants: {work_text(*cost.values())}"
    text += f"\nwould write to {head['out']}"
    readings = [reading.name for reading in task.readings]
    return {
        **head,
        "config_sha256": task.loaded.sha256,
        "readings": readings,
        "cost": cost,
        "text": text,
    }


def _outcome(task: Task, head: Mapping[str, Any], found: Results, files: Path) -> Outcome:
    """Numbers, tables and figures, and the best plant's configuration as a file."""
    loaded = task.loaded
    data = {**head, "readings": [found[reading.name][0] for reading in task.readings]}
    data["conclusions"] = [OTHER_BASE] * (not base_of_paper(loaded.compare)) + report.conclusions(data)
    _write_plants(files, found, data)
    config = {"origin": loaded.base.origin, "sha256": task.identity(), "tree": loaded.base.tree}
    manifest = {
        "experiment": "identify",
        "seed": task.seed,
        "solver": {"name": COMPILED_STEPPER, "tolerance": TOLERANCE},
        "config": config | {"ensemble_sha256": loaded.sha256},
    }
    return replace(report.outcome(data), manifest=manifest)


def _write_plants(folder: Path, found: Results, data: Mapping[str, Any]) -> None:
    """The best plant under each reading as a configuration, and the best of all."""
    for name, (reading, best) in found.items():
        report.write_config(folder / report.PLANTS / f"{name}.yaml", best, data, reading)
    first = report.best_of(data)["name"]
    report.write_config(folder / report.CONFIG, found[first][1], data, found[first][0])


def _named(readings: str, loaded: LoadedEnsemble) -> tuple[Reading, ...]:
    if readings == "default":
        return default_readings(loaded.config.pairs)
    return named_readings(",".join(SHOWN) if readings == "shown" else readings)


def check_at_least_one(**options: int) -> None:
    """Refuse an option below 1, or a UsageError."""
    for option, value in options.items():
        if value < 1:
            raise UsageError(f"must be at least 1, found {value}", where=f"--{option}")


def _searches(task: Task, states: Path, jobs: int, talk: Talk) -> Results:
    """Search for every reading, several at once."""
    cases, jobs = list(task.cases()), jobs if jobs > 0 else processors()
    processes = min(jobs, len(cases)) if task.device == "cpu" else 1
    threads = jobs if processes == 1 else 1
    simulate = partial(simulate_batch, threads=threads, device=task.device)
    task = replace(task, bench=replace(task.bench, simulate=simulate))
    found: Results = {}
    talk.note(f"at most {work_text(*task.cost().values())}")
    with talk.bar("searching", task.effort.evaluations * len(cases)) as progress:
        # In this process a search tells each plant, in another one only its end.
        work = partial(_searched, task, states, progress if processes == 1 else None)
        with closing(as_ready(work, range(len(cases)), processes)) as stream:
            for one in stream:
                found |= one
                if processes > 1:
                    progress(task.effort.evaluations)
    return found


def _searched(task: Task, states: Path, progress: Callable[[int], None] | None, place: int) -> Results:
    box, effort, goal = task.bench.box, task.effort, task.printed.values[task.places]
    case, readings = list(task.cases().items())[place]

    def plants(bench: Bench, most: int, name: str) -> Plants:
        misfit = partial(bench.evaluated, reading=case, runs=task.fitted, goal=goal)
        told = progress or (lambda _: None)
        return Plants(misfit, len(box.names), most, states / f"{case.name}-{name}.npy", told)

    known = None
    if task.rows:
        rows = np.array([name in task.rows for name in box.names])
    else:
        rows, known = rows_that_explain(box, plants(task.bench, sys.maxsize, "rows"), task.unknowns)
    bench = task.bench.searching(rows)
    starts = [scrambled_sobol(box, task.seed, k, 0, effort.population) for k in range(effort.seeds)]
    found = search(
        np.where(rows, np.stack(starts), held_unit(box)),
        rows,
        rows & [choices.size == 0 for choices in box.choices],
        partial(plants, bench, effort.plants),
        effort,
        task.seed,
        known,
    )
    return {held.name: _reading_data(task, bench, case, held, found) for held in readings}


def _named_rows(text: str, names: Sequence[str]) -> tuple[str, ...]:
    """Rows of a list with commas between; a UsageError for one that there is not."""
    rows = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in rows:
        if name not in names:
            close = ", ".join(get_close_matches(name, names)) or "see configs/ensemble.yaml"
            raise UsageError(f"no row of the ranges is called {name!r}", where="--rows", hint=close)
    return rows


def _reading_data(
    task: Task, bench: Bench, case: Reading, held: Reading, found: Found
) -> tuple[dict[str, Any], CompareConfig]:
    """Values of one reading, and its best plant."""
    limit = max(NEAR, 2.0 * found.misfit)
    units = np.vstack([found.closest, found.points[found.misfits <= limit]])
    ours, printed, places = bench.measure(units, held, RUNS), task.printed, task.places
    fitted = ours.sizes[0, places], printed.values[places], printed.half[places]
    data = {
        "name": held.name,
        "search": case.name,
        "misfit_log": found.misfit,
        "misfit_rounding": rounding_misfit(*fitted),
        "fits": found.misfit <= NEAR,
        "near_limit": limit,
        "near_count": len(units) - 1,
        "misfit_by_seed": found.misfits.tolist(),
        "seeds_agree": found.agree,
        "rows_searched": np.array(bench.box.names)[bench.box.free].tolist(),
        "best_shape": report.shape_rows(ours, printed),
        "numbers": report.number_rows(ours, printed, task.fitted),
        "parameters": report.parameter_rows(bench.box, units),
    }
    return data, bench.config(units[0], held)
