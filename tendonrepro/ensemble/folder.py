"""What of an ensemble lies in a folder already: which blocks are whole, and whose they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tendonrepro.console import Talk
from tendonrepro.ensemble.plan import Study
from tendonrepro.ensemble.shards import FOLDER, Block, identity_of, read_shard, shard_files
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.results.folder import HeldFolder


def prepare(held: HeldFolder, study: Study, *, force: bool) -> None:
    """Make the folder of shards ready: no half-written files, and none of another ensemble.

    Parameters
    ----------
    held : HeldFolder
    study : Study
    force : bool
        Remove the shards of another ensemble.

    Raises
    ------
    UsageError
        When there are such shards and `force` is not given.
    """
    folder = held.path
    shards = folder / FOLDER
    try:
        for leftover in shards.glob(".*.h5"):
            leftover.unlink(missing_ok=True)
        others = _of_others(folder, study)
        if not force:
            refuse_shards(folder, study)
        for path in others:
            path.unlink()
        if others:
            # Tables of shards that are gone would make an interrupted run look like another one's results.
            held.clear()
    except OSError as error:
        message = f"cannot clear the folder of shards: {error.strerror or error}"
        raise TendonreproError(message, where=str(shards)) from error


def refuse_shards(folder: Path, study: Study) -> None:
    """Refuse a folder that holds shards of another ensemble.

    Raises
    ------
    UsageError
        If it does.
    """
    others = _of_others(folder, study)
    if others:
        message = f"holds {len(others)} blocks of another configuration, version or set of readings"
        hint = "choose another --out, or say --force to remove them"
        raise UsageError(message, where=str(folder / FOLDER), hint=hint)


def _of_others(folder: Path, study: Study) -> list[Path]:
    return [path for path in shard_files(folder / FOLDER) if identity_of(path) not in {study.identity, None}]


def missing_blocks(folder: Path, study: Study, blocks: Sequence[Block], talk: Talk) -> list[Block]:
    """Blocks that are not whole on disk; every shard is read and checked.

    Parameters
    ----------
    folder : Path
        Results folder.
    study : Study
    blocks : sequence of Block
        All that are wanted.
    talk : Talk
        Hears of damaged shards.

    Returns
    -------
    list of Block
        In the order of `blocks`.
    """
    missing = []
    for block in blocks:
        path = folder / FOLDER / block.file_name
        reason = _fault(path, block, study) if path.exists() else ""
        if reason is None:
            continue
        missing.append(block)
        if reason:
            talk.note(f"{path}: {reason}; it will be computed again")
    return missing


def _fault(path: Path, block: Block, study: Study) -> str | None:
    """What is wrong with a shard; None when nothing is."""
    try:
        shard = read_shard(path)
    except DataMissingError as error:
        return error.message
    cases = tuple((run, case.name) for run, case in study.cases)
    if shard.block != block or shard.cases != cases or shard.identity != study.identity:
        return "is not what its name says"
    return None
