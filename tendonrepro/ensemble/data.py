"""What an ensemble left on disk: which blocks are whole and whose they are, and what they hold.

Data are read piece by piece: memory holds only what is asked for. Opening shards takes longer than reading
them, so of a small ensemble a whole dataset is kept once one of its cases was asked for.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.console import Talk
from tendonrepro.ensemble.plan import Study
from tendonrepro.ensemble.shards import FOLDER, Block, Case, check_shard, identity_of, opened, shard_files
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import MOST_JSON, digest_of, ordinary
from tendonrepro.results.folder import HeldFolder
from tendonrepro.simulation.streaming import STATISTICS

KEPT_BYTES = 64e6
"""Largest dataset, over all shards, that is kept in memory; an ensemble has some 25."""

PLAN = "plan.json"
"""File that says which blocks make up the ensemble in a folder."""

_HINT = "run the same tendonrepro ensemble again: it writes a new one and keeps what is computed"


class NotFinishedError(DataMissingError):
    """There is no ensemble in a folder, or it was interrupted."""


@dataclass(frozen=True, eq=False)
class EnsembleData:
    """One population of one ensemble; N draws of P numbers, n joints.

    Draws stand in canonical order, scrambling after scrambling, whatever the order they were made in.

    Attributes
    ----------
    population : str
        ``box`` or ``firm``.
    of_paper : bool
        Whether draws start from the paper's arm, gains and payload.
    joints : tuple of int
        The paper's numbers of the n joints.
    alpha : tuple of float
        Weights of Controller 1's estimator as configured, one a joint.
    runs : tuple of str
    names : tuple of str
        Of the P numbers drawn.
    readings, variations : tuple of str
        Names that `status` and `statistic` take; variations are no readings of the paper.
    lookup : mapping
        ``(run, reading or variation)`` -> place of its case.
    files : tuple of (Path, Block, int)
        Shards, their blocks, and how many of the block's draws are taken.
    identity, planned
        Of the ensemble, and how many draws it was to have.
    """

    population: str
    of_paper: bool
    joints: tuple[int, ...]
    alpha: tuple[float, ...]
    runs: tuple[str, ...]
    names: tuple[str, ...]
    readings: tuple[str, ...]
    variations: tuple[str, ...]
    lookup: Mapping[Case, int]
    files: tuple[tuple[Path, Block, int], ...]
    identity: str
    planned: int
    _kept: dict[str, list[NDArray[Any]]] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        """Return the number of draws."""
        return sum(taken for _, _, taken in self.files)

    @cached_property
    def draws(self) -> Array:
        """Numbers drawn, (N, P), in the units of the box."""
        return self._joined("draws", np.float64)

    @cached_property
    def replicate(self) -> NDArray[np.int64]:
        """Number of the scrambling of each draw, (N,)."""
        return np.repeat(
            np.array([block.replicate for _, block, _ in self.files]), [taken for _, _, taken in self.files]
        )

    def has(self, run: str, reading: str) -> bool:
        """Whether a run was simulated under a reading or variation."""
        return (run, reading) in self.lookup

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Status codes of a run under a reading or variation, (N,); see `physics.metrics.STATUSES`.

        Raises
        ------
        DataMissingError
            When that was not simulated.
        """
        return self._joined("status", np.int8, self._place(run, reading))

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One of `tendonrepro.simulation.batch.STATISTICS`, SI units, (N, n).

        Raises
        ------
        DataMissingError
            When that was not simulated, or there is no such statistic.
        """
        if name not in STATISTICS:
            message = f"the ensemble holds no statistic {name!r}"
            raise DataMissingError(message, hint=f"It holds {', '.join(STATISTICS)}.")
        return self._joined(f"statistics/{name}", np.float64, self._place(run, reading))

    def _place(self, run: str, reading: str) -> int:
        if not self.has(run, reading):
            message = f"the ensemble holds no run {run!r} under {reading!r}"
            raise DataMissingError(message, hint=f"It holds {', '.join((*self.readings, *self.variations))}.")
        return self.lookup[run, reading]

    def _joined(self, dataset: str, kind: type, place: int | None = None) -> NDArray[Any]:
        with _fitting(self.files[0][0].parent):
            return np.concatenate(self._pieces(dataset, place)).astype(kind)

    def _pieces(self, dataset: str, place: int | None = None) -> list[NDArray[Any]]:
        """Read one dataset, or one case of it, from shard after shard."""
        if place is not None and self._is_small(dataset):
            if dataset not in self._kept:
                self._kept[dataset] = [values[:, :taken] for values, taken in self._read(dataset, ())]
            return [values[place] for values in self._kept[dataset]]
        return [values[:taken] for values, taken in self._read(dataset, () if place is None else place)]

    def _read(self, dataset: str, index: int | tuple[()]) -> Iterator[tuple[NDArray[Any], int]]:
        """Part of a dataset from shard after shard, and how many of its draws are taken."""
        for path, _, taken in self.files:
            with opened(path) as root:
                if root.attrs["identity"] != self.identity:
                    message = "was written anew, of another ensemble, while the others were read"
                    raise DataMissingError(message, where=str(path), hint="run it again")
                if dataset not in root:
                    message = f"was stored by an older version, which did not keep {dataset}"
                    raise DataMissingError(
                        message, where=str(path), hint="run tendonrepro ensemble --force again"
                    )
                yield root[dataset][index], taken

    def _is_small(self, dataset: str) -> bool:
        with opened(self.files[0][0]) as root:
            return dataset in root and bool(root[dataset].nbytes * len(self.files) <= KEPT_BYTES)


def read_ensemble(folder: Path, population: str = "box", *, stride: int = 1) -> EnsembleData:
    """Open a finished ensemble.

    Parameters
    ----------
    folder : Path
        Results folder.
    population : str
        ``box``, or ``firm`` for the one where only rows of high and medium confidence vary.
    stride : int
        Thin to this part of the draws, a power of two. The first draws of every scrambling are kept, which
        are themselves evenly spread; every second one would fill only one half of the box.

    Returns
    -------
    EnsembleData

    Raises
    ------
    NotFinishedError
        When there is none, or it was interrupted.
    DataMissingError
        When its plan or a shard is damaged.
    UsageError
        When it cannot be thinned so far.
    """
    plan = _read_plan(folder)
    with _fitting(folder / PLAN):
        return _planned(folder, plan, population, stride)


def _planned(folder: Path, plan: Mapping[str, Any], population: str, stride: int) -> EnsembleData:
    """Population of an ensemble by its plan, thinned."""
    if population not in plan["populations"]:
        message = f"holds no population {population!r}"
        raise DataMissingError(message, where=str(folder), hint=f"It holds {', '.join(plan['populations'])}.")
    per_replicate = plan["populations"][population] // plan["replicates"]
    if stride < 1 or stride & (stride - 1) or stride > per_replicate:
        message = f"cannot thin {per_replicate} draws a scrambling to one in {stride}; a power of two can"
        raise UsageError(message)
    files = _files(folder, plan, population, per_replicate // stride)
    with opened(files[0][0]) as root:
        names = tuple(json.loads(root.attrs["names"]))
    return EnsembleData(
        population=population,
        of_paper=plan.get("of_paper", True),
        joints=tuple(plan["joints"]),
        alpha=tuple(plan["alpha"]),
        runs=tuple(plan["runs"]),
        names=names,
        readings=tuple(plan["readings"]),
        variations=tuple(plan["variations"]),
        lookup={(run, name): place for run, name, place in plan["lookup"]},
        files=files,
        identity=plan["identity"],
        planned=plan["draws"],
    )


@contextmanager
def _fitting(path: Path) -> Iterator[None]:
    """Tell what does not fit together, although its digests are right: it was not written by this package."""
    try:
        yield
    except (AttributeError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise DataMissingError(
            "is not of an ensemble of this version", where=str(path), hint=_HINT
        ) from error


def begun_in(folder: Path) -> str:
    """Name of the plan in a folder, if it is one or stands beside blocks; a user's own file is neither."""
    try:
        _read_plan(folder)
    except DataMissingError:
        return PLAN if shard_files(folder / FOLDER) else ""
    return PLAN


def _read_plan(folder: Path) -> dict[str, Any]:
    path = folder / PLAN
    try:
        plan = json.loads(ordinary(path, MOST_JSON).read_bytes())
    except FileNotFoundError as error:
        message = "holds no ensemble"
        raise NotFinishedError(message, where=str(folder), hint="run tendonrepro ensemble first") from error
    except OSError as error:
        raise DataMissingError(f"cannot be read: {error.strerror or error}", where=str(path)) from error
    except (ValueError, RecursionError):
        plan = None
    if not isinstance(plan, dict) or plan.pop("sha256", None) != digest_of(plan):
        message = "is damaged or not the plan of an ensemble"
        raise DataMissingError(message, where=str(path), hint=_HINT)
    return plan


def _files(
    folder: Path, plan: Mapping[str, Any], population: str, wanted: int
) -> tuple[tuple[Path, Block, int], ...]:
    files = tuple(
        (folder / FOLDER / block.file_name, block, min(block.count, wanted - block.first))
        for block in sorted(Block(*entry) for entry in plan["blocks"])
        if block.population == population and block.first < wanted
    )
    missing = sum(not path.exists() for path, _, _ in files)
    if missing:
        message = f"{missing} of {len(files)} blocks are missing; the ensemble was interrupted"
        hint = "run the same tendonrepro ensemble again to finish it"
        raise NotFinishedError(message, where=str(folder), hint=hint)
    for path, block, _ in files:
        check_shard(path, block, plan["identity"])
    return files


def prepare(held: HeldFolder, study: Study, *, force: bool) -> None:
    """Make the folder of shards ready: none of another ensemble.

    Those are removed with `force`, and else refused.
    """
    folder = held.path
    shards = folder / FOLDER
    try:
        others = _of_others(folder, study)
        if not force:
            refuse_shards(folder, study)
        if others and shards.is_symlink():
            message, hint = (
                "leads elsewhere, so the blocks of another ensemble in it are kept",
                "remove the link",
            )
            raise UsageError(message, where=str(shards), hint=hint)
        for path in others:
            path.unlink()
        if others:
            # Tables of shards that are gone would make an interrupted run look like another one's results.
            held.clear()
    except OSError as error:
        message = f"cannot clear the folder of shards: {error.strerror or error}"
        raise TendonreproError(message, where=str(shards)) from error


def refuse_shards(folder: Path, study: Study) -> None:
    """Refuse a folder that holds shards of another ensemble."""
    others = _of_others(folder, study)
    if others:
        message = f"holds {len(others)} blocks of another configuration, version or set of readings"
        hint = "choose another --out, or say --force to remove them"
        raise UsageError(message, where=str(folder / FOLDER), hint=hint)


def _of_others(folder: Path, study: Study) -> list[Path]:
    return [path for path in shard_files(folder / FOLDER) if identity_of(path) not in {study.identity, None}]


def missing_blocks(folder: Path, study: Study, blocks: Sequence[Block], talk: Talk) -> list[Block]:
    """Blocks that are not whole on disk, in their order; every shard is read and checked."""
    missing = []
    for block in blocks:
        path = folder / FOLDER / block.file_name
        if path.is_dir():
            message = "is a folder, where a block is to be written"
            raise TendonreproError(message, where=str(path), hint="move it elsewhere")
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
        check_shard(path, block, study.identity)
    except DataMissingError as error:
        return error.message
    return None
