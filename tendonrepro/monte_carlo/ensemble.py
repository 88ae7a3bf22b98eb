"""The ensemble: plants run here or on a cluster, stored as they come, and resumed."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from functools import partial
from pathlib import Path

import numpy as np

from tendonrepro import __version__
from tendonrepro.configuration.ensemble import (
    Ranges,
    load_plants,
    readings_on,
    with_all_controllers,
)
from tendonrepro.configuration.load import ConfigLike
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import PRINTED, Reading, default_readings, parse_reading
from tendonrepro.configuration.overrides import Overrides
from tendonrepro.console import count_of
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.user_law import UserLaw, with_user_laws
from tendonrepro.files import Json, to_json
from tendonrepro.monte_carlo import kept
from tendonrepro.monte_carlo.data import PLAN, SHARDS, read_ensemble
from tendonrepro.monte_carlo.figures import ensemble_figures
from tendonrepro.monte_carlo.plan import ARMS, SCHEMA_VERSION, EnsembleStudy, evaluated
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.monte_carlo.report import ensemble_tables, population_summary
from tendonrepro.monte_carlo.shares import LEAST_SCRAMBLINGS
from tendonrepro.parallel import Done, Item, as_ready, check_jobs
from tendonrepro.results.paper import OTHER_BASE, base_of_paper
from tendonrepro.results.record_store import RecordStore
from tendonrepro.results.store import take_over
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Folder, Site, Study, cost_text, folder_of

SUMMARY_VERSION = 2
"""Of ``summary.json``: from 2 on the first population stands under ``populations`` alone."""


def load_study(
    source: ConfigLike,
    overrides: Overrides | None,
    seed: int | None,
    readings: str,
    spread: float | None = None,
    ranges: Ranges = None,
    laws: Sequence[UserLaw] = (),
) -> EnsembleStudy:
    """Read an ensemble's configuration, or a comparison around whose arm plants are drawn.

    `readings` are names with commas between. ``default`` stands for the text as printed, alternatives and the
    pairs of the configuration; around an arm for what its comparison says. That or the printed reading is
    added to others. A UsageError for an unknown one.
    """
    loaded = with_all_controllers(load_plants(source, spread, ranges, overrides=overrides, seed=seed))
    if laws and not loaded.around:
        message = "runs around an arm of your own"
        raise UsageError(message, where="--law", hint="name a comparison, --config compare.yaml")
    for law in laws:
        if law.name in (*loaded.compare.runs, *RUNS):
            message = f"there is a run {law.name!r} already"
            raise UsageError(message, where="--law", hint="give the function another name")
    loaded = replace(loaded, base=with_user_laws(loaded.base, laws))
    config, name, population = loaded.config, ARMS, population_of(loaded)
    replicates = LEAST_SCRAMBLINGS
    variations: tuple[Reading, ...] = ()
    chosen = readings_on(loaded, PRINTED if readings == "default" else f"{PRINTED},{readings}")
    if not loaded.around:
        ((name, part),) = config.populations.items()
        population, replicates = population.only(part.confidences), int(config.scramblings.si)
        if readings == "default":
            chosen = default_readings(config.pairs)
            variations = tuple(map(parse_reading, config.variations))
    study = EnsembleStudy(
        loaded,
        name=name,
        population=population,
        readings=chosen,
        variations=variations,
        seed=int(config.seed.si),
        replicates=replicates,
        block_draws=int(config.block.si),
        laws=tuple(laws),
    )
    for law in laws:
        # What cannot run on many arms together is refused before hours of work.
        (loops,) = population.loops(np.ones((1, len(population.rows))), study.cases, [law])
        kept.refuse_on_lanes(law, loops[study.lookup[law.name, PRINTED]])
    return study


def ensemble_study(
    study: EnsembleStudy,
    draws: int,
    *,
    jobs: int = 1,
    dask: str | None = None,
    simulate: kept.Simulate = simulate_batch,
    folder: Folder,
) -> Study:
    """Prepare an ensemble: missing plants are run, then come tables and figures of all.

    Parameters
    ----------
    draws : int
        A power of two.
    jobs : int
        Processes; -1 is one for each processor.
    dask : str, optional
        Address of a dask.distributed scheduler.
    simulate : callable
        As `simulate_batch`.

    Raises
    ------
    UsageError
        For impossible draws or jobs.
    """
    check_jobs(jobs)
    study.check(draws)
    make = partial(evaluated, study, simulate=simulate)
    earlier, force = folder_of("ensemble", folder) / SHARDS, folder.get("force", False)

    def run(site: Site, shards: Path) -> Result:
        talk = site.talk
        _take_over(earlier, shards, study, force=force)
        store = RecordStore(shards / study.file_name(draws), study.record, draws)
        planned = study.pieces(draws)
        pieces = kept.still_missing(planned, store)
        ahead, resumed = study.cost(sum(map(len, pieces))), len(planned) - len(pieces)
        if resumed:
            left = f"; left are {cost_text(ahead)}" if pieces else ""
            talk.note(f"{resumed} of {len(planned)} blocks are on disk already{left}")
        stream = on_cluster(make, pieces, dask) if dask else as_ready(make, pieces, jobs)
        started = time.perf_counter()
        kept.fill(store, pieces, stream, talk)
        seconds = time.perf_counter() - started
        (site.files / PLAN).write_text(to_json(study.plan(draws)), encoding="utf-8")
        speed = ahead["experiments"] / seconds if pieces else None
        return _result(study, draws, site.files, speed, resumed)

    prepared = kept.study_on_plants(
        "ensemble",
        study.loaded,
        study.identity,
        run,
        folder,
        cost=study.cost(draws),
        seed=study.seed,
        stays=SHARDS,
    )
    arms = f" {study.loaded.around.told}" if study.loaded.around else ""
    plan = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "ensemble",
        "config_sha256": study.loaded.sha256,
        "draws": draws,
        "blocks": len(study.pieces(draws)),
        "text": f"ensemble: {draws} draws{arms}, {count_of(len(study.readings), 'reading')}",
    }
    return replace(prepared, numbers="summary", plan=plan)


def on_cluster(
    function: Callable[[Item], Done], items: Sequence[Item], address: str
) -> Generator[Done, None, None]:
    """Yield results of a dask.distributed cluster as they become ready.

    A dying worker's items are given to another.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        hint = "pip install 'tendonrepro[dask]'"
        raise UsageError("dask.distributed is not installed", where="--dask", hint=hint) from error
    try:
        client = Client(address, timeout=10)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise TendonreproError(f"no scheduler answers at {address}", where="--dask") from error
    with client:
        try:
            waiting = client.map(function, items, pure=False, retries=2)
            for future in as_completed(waiting):  # type: ignore[no-untyped-call]
                yield future.result()
                future.release()
        except KilledWorker as error:
            message = "workers died again and again on the same plants; finished ones are kept"
            raise TendonreproError(message, where="--dask") from error


def _take_over(earlier: Path, shards: Path, study: EnsembleStudy, *, force: bool) -> None:
    """Begin with the records of an interrupted run, or of the earlier result."""
    shards.mkdir(exist_ok=True)
    ours = f"[!.]*-{study.identity[:12]}.npy"
    others = [path for path in shards.iterdir() if not fnmatch(path.name, ours)]
    strangers = [path for path in others if not path.name.startswith(".")]
    if strangers and not force:
        left = count_of(len(strangers), "file")
        message = f"an interrupted run of another configuration or build left {left} here"
        hint = "choose another --out, or say --force to give them up"
        raise UsageError(message, where=str(shards), hint=hint)
    for path in others:
        path.unlink()
    take_over(earlier, shards, [path.name for path in earlier.glob(ours)])


def _result(study: EnsembleStudy, draws: int, folder: Path, speed: float | None, resumed: int) -> Result:
    """Numbers, tables and figures of all plants; `speed` is of those just run, experiments per second."""
    of_paper, around = base_of_paper(study.loaded.compare), study.loaded.around
    summary: Json = {
        "schema_version": SUMMARY_VERSION,
        "experiment": "ensemble",
        "tendonrepro_version": __version__,
        "config_sha256": study.loaded.sha256,
        "identity": study.identity,
        "of_paper": of_paper and not around,
        "seed": study.seed,
        "draws": draws,
        "scramblings": study.replicates,
        "populations": {study.name: population_summary(study.population, read_ensemble(folder))},
        "cost": study.cost(draws),
        "experiments_per_second": speed,
        "resumed_from": resumed,
        "blocks": len(study.pieces(draws)),
    }
    if around:
        summary["around"] = {**around.as_data(), "told": around.told}
    notes = () if of_paper or around else (OTHER_BASE,)
    parts = [*ensemble_tables(summary), *notes]
    return Result(summary, parts, ensemble_figures(summary))
