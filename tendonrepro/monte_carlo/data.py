"""What an ensemble leaves on disk: a shard for each block, and the plan of all."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError
from tendonrepro.files import read_json

SHARDS = "shards"
"""Name of the folder of shards in a folder of results."""

CaseName = tuple[str, str]
"""Run and what it was run under, such as ``("controller_1", "weights=extrapolating")``."""

ShardArray: TypeAlias = NDArray[Any]
"""An array of a shard: numbers, codes, or a text."""

Shard = Mapping[str, ShardArray]
"""Everything kept of one block; B draws of P numbers, C cases, n joints.

``draws`` (B, P) and ``status`` (C, B); each statistic (C, B, n), SI; ``check`` is JSON of what the spot check
found.
"""

KEPT_DRAWS = 2**15
"""Draws of the largest ensemble of which arrays are kept, some 40 of 45 MB: opening shards takes longest."""

PLAN = "plan.json"
"""File that says which blocks make up the ensemble in a folder."""


@dataclass(frozen=True, order=True)
class Block:
    """Consecutive draws of a population in one scrambling, `replicate`: the unit of work and of storage."""

    population: str
    replicate: int
    first: int
    count: int

    def __str__(self) -> str:
        return f"{self.population}-r{self.replicate:03d}-d{self.first:08d}-n{self.count}"

    def file_name(self, identity: str) -> str:
        """Name of its shard."""
        return f"{self}-{identity[:12]}.npz"


def shard_files(folder: Path, identity: str = "*") -> list[Path]:
    """Shards of an ensemble, or of any, in canonical order."""
    return sorted(folder.glob(f"[!.]*-{identity[:12]}.npz"))


def shard_image(arrays: Shard) -> bytes:
    """Bytes of a shard, which a worker sends to the only writer."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def read_array(path: Path, name: str) -> ShardArray:
    """Read one array; a DataMissingError where it is missing or damaged."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return np.asarray(stored[name])
    except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        hint = "remove it, and run the same tendonrepro ensemble again with --force"
        raise DataMissingError("is missing, damaged or no shard", where=str(path), hint=hint) from error


@dataclass(frozen=True, eq=False)
class EnsembleData:
    """One population of one ensemble; N draws of P numbers, n joints, scrambling after scrambling.

    `of_paper` tells whether draws start from the paper's arm, gains and payload. `names` are of the P
    numbers. `lookup` gives the place of a case. `planned` is the number of draws that was asked for. `around`
    says around which arm of a user's own draws lie; it is empty where they are of the paper's ranges.
    """

    of_paper: bool
    around: str
    runs: tuple[str, ...]
    joints: tuple[int, ...]
    alpha: tuple[float, ...]
    names: tuple[str, ...]
    readings: tuple[str, ...]
    lookup: Mapping[CaseName, int]
    files: Mapping[Block, Path]
    identity: str
    planned: int
    _kept: dict[str, ShardArray] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        """Return the number of draws."""
        return sum(block.count for block in self.files)

    @cached_property
    def draws(self) -> Array:
        """Numbers drawn, (N, P), in the units of the box."""
        return np.concatenate([read_array(path, "draws") for path in self.files.values()])

    @cached_property
    def replicate(self) -> NDArray[np.int64]:
        """Scrambling of each draw, (N,)."""
        return np.concatenate([np.full(block.count, block.replicate) for block in self.files])

    def has(self, run: str, reading: str) -> bool:
        """Whether a run was simulated under a reading or variation."""
        return (run, reading) in self.lookup

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Codes of a run, places in `physics.metrics.STATUSES`, (N,); else a DataMissingError."""
        return self._case("status", run, reading)

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One of `simulation.streaming.STATISTICS` of a run, SI units, (N, n); else a DataMissingError."""
        return np.asarray(self._case(name, run, reading), np.float64)

    def _case(self, name: str, run: str, reading: str) -> ShardArray:
        if not self.has(run, reading):
            hint = f"It holds {', '.join(self.readings)}."
            raise DataMissingError(f"the ensemble holds no run {run!r} under {reading!r}", hint=hint)
        place = self.lookup[run, reading]
        if len(self) > KEPT_DRAWS:
            return np.concatenate([read_array(path, name)[place] for path in self.files.values()])
        if name not in self._kept:
            pieces = [read_array(path, name) for path in self.files.values()]
            self._kept[name] = np.concatenate(pieces, axis=1)
        return np.array(self._kept[name][place])


def read_ensemble(folder: Path, population: str | None = None) -> EnsembleData:
    """Open a finished ensemble; without a population its first one, by which claims are judged.

    Raises
    ------
    DataMissingError
        When there is none, or no such population.
    """
    path = folder / PLAN
    if not path.exists():
        hint = "run tendonrepro ensemble first"
        raise DataMissingError("holds no finished ensemble", where=str(folder), hint=hint)
    plan = read_json(path, "run the same tendonrepro ensemble again with --force")
    population = population or next(iter(plan["populations"]))
    if population not in plan["populations"]:
        hint = f"It holds {', '.join(plan['populations'])}."
        raise DataMissingError(f"holds no population {population!r}", where=str(folder), hint=hint)
    blocks = [Block(*entry) for entry in sorted(plan["blocks"]) if entry[0] == population]
    return EnsembleData(
        of_paper=plan["of_paper"],
        around=plan.get("around", ""),
        lookup={(run, name): place for run, name, place in plan["lookup"]},
        files={block: folder / SHARDS / block.file_name(plan["identity"]) for block in blocks},
        identity=plan["identity"],
        planned=plan["draws"],
        runs=tuple(plan["runs"]),
        joints=tuple(plan["joints"]),
        alpha=tuple(plan["alpha"]),
        names=tuple(plan["names"]),
        readings=tuple(plan["readings"]),
    )
