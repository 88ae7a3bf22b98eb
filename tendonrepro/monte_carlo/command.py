"""The ensemble: blocks computed here or on a cluster, stored as they come, and resumed."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from tendonrepro import __version__
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.models.readings import PRINTED, default_readings, named_readings, parse_reading
from tendonrepro.configuration.request import FORMATS, Request
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.files import to_json, write_atomically
from tendonrepro.monte_carlo.block import DRAWS_AT_ONCE, Simulate, make_blocks
from tendonrepro.monte_carlo.box import make_box
from tendonrepro.monte_carlo.data import PLAN, SHARDS, Block, read_ensemble, shard_files
from tendonrepro.monte_carlo.figures import ensemble_figures
from tendonrepro.monte_carlo.plan import SCHEMA_VERSION, Study, code_digest
from tendonrepro.monte_carlo.report import cost_text, ensemble_tables, population_summary, spot_checks
from tendonrepro.parallel import Item, Result, as_ready
from tendonrepro.results.paper import OTHER_BASE, base_of_paper
from tendonrepro.results.store import make_manifest, refuse_others, replaced, take_over
from tendonrepro.results.study import Outcome, figure_formats
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.device import DeviceName, require
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE


def run_ensemble(
    request: Request,
    talk: Talk,
    *,
    draws: int,
    jobs: int = 1,
    dask: str | None = None,
    readings: str = "default",
    device: DeviceName = "cpu",
) -> dict[str, Any]:
    """Simulate many plausible plants under many readings; what ``--json`` prints.

    Parameters
    ----------
    request : Request
        `force` gives up the blocks of another configuration or version.
    draws : int
        A power of two.
    jobs : int
        Processes; -1 is one for each processor.
    dask : str or None
        Address of a dask.distributed scheduler.
    readings : str
        ``default``: as printed, alternatives and the configuration's pairs. Else names with commas between;
        the printed reading is added.
    device : str
        ``gpu`` runs all on a GPU, in this process or in each of a cluster.

    Raises
    ------
    UsageError
        For impossible draws, jobs or readings, or results of another configuration.
    TendonreproError
        When results cannot be written; whole blocks stay. Or when no GPU can be used.
    """
    if not jobs:
        message = "must be a number of processes, or -1 for one for each processor, found 0"
        raise UsageError(message, where="--jobs")
    require(device)
    study = replace(load_study(request.config, request.overrides, request.seed, readings), device=device)
    folder = request.folder("ensemble")
    if request.dry_run:
        return _plan(study, draws, folder, force=request.force)
    return run_study(
        study,
        draws,
        folder,
        jobs=jobs,
        force=request.force,
        dask=dask,
        talk=talk,
        simulate=partial(simulate_batch, device=device),
        formats=request.formats,
    )


def _plan(study: Study, draws: int, folder: Path, *, force: bool) -> dict[str, Any]:
    refuse_others(folder, study.identity, command="ensemble", force=force)
    blocks = study.blocks(draws)
    cost = study.cost(blocks)
    return {
        "schema_version": SCHEMA_VERSION,
        "experiment": "ensemble",
        "dry_run": True,
        "config_sha256": study.loaded.sha256,
        "draws": draws,
        "cost": cost,
        "blocks": len(blocks),
        "out": str(folder),
        "text": f"ensemble: {draws} draws, {count_of(len(study.readings), 'reading')}: {cost_text(cost)}",
    }


def load_study(source: str | None, overrides: Sequence[str], seed: int | None, readings: str) -> Study:
    """Read an ensemble's configuration; `readings` as for :func:`run_ensemble`."""
    loaded = load_ensemble(source, overrides=overrides, seed=seed)
    config, box = loaded.config, make_box(loaded.config)
    default = readings == "default"
    chosen = default_readings(config.pairs) if default else named_readings(f"{PRINTED},{readings}")
    return Study(
        loaded,
        boxes={name: box.only(held.confidences) for name, held in config.populations.items()},
        shares={name: held.share.si for name, held in config.populations.items()},
        readings=chosen,
        variations=tuple(parse_reading(name) for name in config.variations) if default else (),
        seed=int(config.seed.si),
        replicates=int(config.scramblings.si),
        block_draws=int(config.block.si),
    )


def run_study(
    study: Study,
    draws: int,
    folder: Path,
    *,
    jobs: int,
    talk: Talk,
    force: bool = False,
    dask: str | None = None,
    simulate: Simulate = simulate_batch,
    formats: Sequence[str] = FORMATS,
) -> dict[str, Any]:
    """Compute missing blocks, then tables and figures of all."""
    blocks = study.blocks(draws)
    with replaced(folder, study.identity, command="ensemble", force=force, keep=SHARDS, talk=talk) as result:
        shards = result.path / SHARDS
        _take_over(folder / SHARDS, shards, study, force=force)
        paths = {block: shards / block.file_name(study.identity) for block in blocks}
        missing = [block for block, path in paths.items() if not path.exists()]
        resumed = len(blocks) - len(missing)
        if resumed:
            talk.note(f"{resumed} of {len(blocks)} blocks are on disk already")
        make, parts = partial(make_blocks, study, simulate=simulate), _parts(study, missing)
        # A GPU serves one process.
        jobs = jobs if study.device == "cpu" else 1
        stream = on_cluster(make, parts, dask) if dask else as_ready(make, parts, jobs)
        ahead = study.cost(missing)
        if missing:
            talk.note(cost_text(ahead))
        started = time.perf_counter()
        with talk.bar("simulating", len(missing)) as progress, closing(stream):
            # This process is the only writer.
            for made in stream:
                for block, image in made:
                    write_atomically(paths[block], image)
                    progress(1)
        seconds = time.perf_counter() - started
        result.write(PLAN, to_json(study.plan(draws)))
        speed = {
            "experiments_per_second": ahead["experiments"] / seconds if missing else None,
            "resumed_from": resumed,
            "blocks": len(blocks),
        }
        outcome = _outcome(study, draws, result.path, speed)
        outcome.save(result, "summary", formats)
        result.manifest = _manifest(study, seconds) | figure_formats(formats)
    text = f"{outcome.text()}\n\nResults are in {folder}"
    return {**outcome.data, "text": text, "out": str(folder)}


def _parts(study: Study, blocks: Sequence[Block]) -> list[list[Block]]:
    """Blocks that are computed together: one, or as many of a population as fill a GPU."""
    each = 1 if study.device == "cpu" else max(1, DRAWS_AT_ONCE[study.device] // study.block_draws)
    of_population = [[block for block in blocks if block.population == name] for name in study.boxes]
    return [held[k : k + each] for held in of_population for k in range(0, len(held), each)]


def on_cluster(
    function: Callable[[Item], Result], items: Sequence[Item], address: str
) -> Generator[Result, None, None]:
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
            message = "workers died again and again on the same block; finished blocks are kept"
            raise TendonreproError(message, where="--dask") from error


def _take_over(earlier: Path, shards: Path, study: Study, *, force: bool) -> None:
    """Begin with the blocks of an interrupted run and of the earlier result."""
    shards.mkdir(exist_ok=True)
    ours = shard_files(shards, study.identity)
    others = [path for path in shards.iterdir() if path not in ours]
    strangers = [path for path in others if not path.name.startswith(".")]
    if strangers and not force:
        left = count_of(len(strangers), "block")
        message = f"an interrupted run of another configuration or version left {left} here"
        hint = "choose another --out, or say --force to give them up"
        raise UsageError(message, where=str(shards), hint=hint)
    for path in others:
        path.unlink()
    take_over(earlier, shards, [path.name for path in shard_files(earlier, study.identity)])


def _outcome(study: Study, draws: int, folder: Path, speed: dict[str, Any]) -> Outcome:
    blocks = study.blocks(draws)
    populations = {name: population_summary(read_ensemble(folder, name)) for name in study.boxes}
    of_paper = base_of_paper(study.loaded.compare)
    summary: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "ensemble",
        "tendonrepro_version": __version__,
        "config_sha256": study.loaded.sha256,
        "identity": study.identity,
        "physics_sha256": code_digest("physics"),
        "of_paper": of_paper,
        "seed": study.seed,
        "draws": draws,
        "scramblings": study.replicates,
        **next(iter(populations.values())),
        "spot_check": spot_checks(folder / SHARDS, study.identity, blocks),
        "cost": study.cost(blocks),
        **speed,
        "populations": populations,
    }
    notes = [] if of_paper else [OTHER_BASE]
    return Outcome(summary, [*ensemble_tables(summary), *notes], ensemble_figures(summary))


def _manifest(study: Study, seconds: float) -> dict[str, Any]:
    manifest = make_manifest(study.loaded.base, seconds, "ensemble")
    config = manifest["config"] | {"sha256": study.identity, "ensemble_sha256": study.loaded.sha256}
    stepper = {"name": COMPILED_STEPPER, "tolerance": TOLERANCE, "device": study.device}
    return manifest | {"experiment": "ensemble", "seed": study.seed, "solver": stepper, "config": config}
