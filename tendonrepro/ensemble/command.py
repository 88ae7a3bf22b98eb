"""The ensemble: blocks computed on this machine or a cluster, stored as they come, and resumed by itself."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, Literal

from tendonrepro import __version__
from tendonrepro.config.ensemble import load_ensemble
from tendonrepro.config.models.readings import default_readings, every_pair, parse_reading
from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.ensemble.block import Simulate, make_block
from tendonrepro.ensemble.box import make_box
from tendonrepro.ensemble.conclusions import conclusions
from tendonrepro.ensemble.data import PLAN, begun_in, missing_blocks, prepare, read_ensemble, refuse_shards
from tendonrepro.ensemble.figures import draw_ensemble_figures
from tendonrepro.ensemble.plan import Study
from tendonrepro.ensemble.report import cost_text, population_summary, spot_checks, write_ensemble_tables
from tendonrepro.ensemble.shards import FOLDER, SCHEMA_VERSION, Block
from tendonrepro.ensemble.workers import here, on_cluster
from tendonrepro.errors import UsageError
from tendonrepro.files import to_json, write_atomically
from tendonrepro.results.folder import HeldFolder, claimed, refuse_others
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.paper import OTHER_BASE, base_of_paper
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.codegen.cache import NOTHING_COMPILED
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE

SUMMARY = "summary.json"


def run_ensemble(
    request: Request,
    talk: Talk,
    *,
    draws: int,
    jobs: int = 1,
    dask: str | None = None,
    readings: Literal["default", "all"] = "default",
    yes: bool = False,
) -> dict[str, Any]:
    """Simulate many plausible plants under many readings, and write tables and figures.

    Parameters
    ----------
    request : Request
        `force` removes the shards of another configuration or version.
    talk : Talk
    draws : int
        Of each population; a power of two.
    jobs : int
        Processes; results do not depend on it.
    dask : str or None
        Address of a dask.distributed scheduler to send the blocks to.
    readings : {'default', 'all'}
        As printed, alternatives and the configuration's pairs; or every combination, which needs `yes`.
    yes : bool
        The cost of all readings has been seen.

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    UsageError
        For impossible draws or jobs, shards of another configuration, or all readings without `yes`.
    TendonreproError
        When results cannot be written; whole blocks stay and are not computed again.
    """
    if not jobs:
        message = "must be a number of processes, or -1 for one for each processor, found 0"
        raise UsageError(message, where="--jobs")
    study = load_study(request.config, request.overrides, request.seed, readings)
    folder = request.folder("ensemble")
    cost = study.cost(draws)
    outline = {"schema_version": SCHEMA_VERSION, "experiment": "ensemble", "draws": draws, "out": str(folder)}
    outline |= {"readings_count": len(study.readings), "cases": len(study.cases), "cost": cost}
    if request.dry_run:
        outline |= {"dry_run": True, "config_sha256": study.sha256}
        return outline | _ahead(study, draws, folder, force=request.force)
    if readings == "all" and not yes:
        message = f"all {len(study.readings)} readings mean {cost_text(cost)}"
        raise UsageError(message, where="--readings all", hint="say --yes if that is what you want")
    return run_study(study, draws, folder, jobs=jobs, force=request.force, dask=dask, talk=talk)


def _ahead(study: Study, draws: int, folder: Path, *, force: bool) -> dict[str, int]:
    """Blocks that a run would need, and those of them that are on disk."""
    refuse_others(folder, study.identity, force=force, begun=begun_in(folder))
    if not force:
        refuse_shards(folder, study)
    blocks = study.blocks(draws)
    missing = missing_blocks(folder, study, blocks, Talk(quiet=True))
    return {"resumed_from": len(blocks) - len(missing), "blocks": len(blocks)}


def load_study(
    source: str | None, overrides: Sequence[str], seed: int | None, readings: Literal["default", "all"]
) -> Study:
    """Read a configuration of an ensemble."""
    loaded = load_ensemble(source, overrides=overrides, seed=seed)
    config, box = loaded.config, make_box(loaded.config)
    return Study(
        base=loaded.base,
        boxes={name: box.only(held.confidences) for name, held in config.populations.items()},
        shares={name: held.share.si for name, held in config.populations.items()},
        readings=every_pair() if readings == "all" else default_readings(config.pairs),
        variations=tuple(parse_reading(name) for name in config.variations),
        sha256=loaded.sha256,
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
) -> dict[str, Any]:
    """Compute the blocks that are not on disk yet, then tables and figures of all."""
    blocks = study.blocks(draws)
    with claimed(folder, study.identity, force=force, begun=begun_in(folder)) as held:
        prepare(held, study, force=force)
        write_atomically(folder / PLAN, to_json(study.plan(draws)))
        missing = missing_blocks(folder, study, blocks, talk)
        resumed = len(blocks) - len(missing)
        if resumed:
            talk.note(f"{resumed} of {len(blocks)} blocks are on disk already")
        started = time.perf_counter()
        make = partial(make_block, study, simulate=simulate)
        stream = on_cluster(make, missing, dask) if dask else here(make, missing, jobs)
        experiments = sum(block.count for block in missing) * len(study.cases)
        if missing:
            _announce(study, draws, missing, talk)
        with talk.resumable(), talk.bar("simulating", experiments) as progress, closing(stream):
            # This process is the only writer.
            for block, image in stream:
                write_atomically(folder / FOLDER / block.file_name, image)
                progress(block.count * len(study.cases))
        seconds = time.perf_counter() - started
        speed = {
            "experiments_per_second": experiments / seconds if experiments else None,
            "resumed_from": resumed,
            "blocks": len(blocks),
        }
        return _finish(study, draws, held, speed, seconds, talk)


def _announce(study: Study, draws: int, missing: Sequence[Block], talk: Talk) -> None:
    """Say what is ahead: nothing is counted before the first blocks are done, minutes later."""
    share = sum(block.count for block in missing) / sum(block.count for block in study.blocks(draws))
    text = cost_text({key: share * value for key, value in study.cost(draws).items()})
    if NOTHING_COMPILED:
        talk.note("compiling once for this machine, some twenty seconds")
    talk.note(f"{text}, counted in blocks of {missing[0].count * len(study.cases):,}")


def _finish(
    study: Study, draws: int, held: HeldFolder, speed: dict[str, Any], seconds: float, talk: Talk
) -> dict[str, Any]:
    """Write tables, figures, summary and manifest of a complete ensemble."""
    folder = held.path
    data = {name: read_ensemble(folder, name) for name in study.boxes}
    populations = {name: population_summary(one) for name, one in data.items()}
    summary: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "ensemble",
        "tendonrepro_version": __version__,
        "config_sha256": study.sha256,
        "identity": study.identity,
        "seed": study.seed,
        "draws": draws,
        "scramblings": study.replicates,
        **next(iter(populations.values())),
        "conclusions": [OTHER_BASE] * (not base_of_paper(study.config)) + conclusions(populations),
        "spot_check": spot_checks(folder, study.blocks(draws)),
        "cost": study.cost(draws),
        **speed,
        "out": str(folder),
        "populations": populations,
    }
    held.clear()
    held.files += write_ensemble_tables(summary, folder / "tables")
    held.files += draw_ensemble_figures(summary, folder / "figures")
    held.write(SUMMARY, to_json(summary))
    manifest = make_manifest(study.base, seconds)
    stepper = {"name": COMPILED_STEPPER, "tolerance": TOLERANCE}
    manifest |= {"experiment": "ensemble", "seed": study.seed, "solver": stepper}
    manifest["config"] = manifest["config"] | {"sha256": study.identity, "ensemble_sha256": study.sha256}
    held.finish(manifest, talk)
    return summary
