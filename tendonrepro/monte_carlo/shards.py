"""Shards: one block of an ensemble in one HDF5 file, which is written whole or not at all."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError

SCHEMA_VERSION = 1

FOLDER = "shards"
"""Name of the folder of shards in a folder of results."""

Single = NDArray[np.float32]
Case = tuple[str, str]
"""Run and what it was run under, such as ``("controller_1", "weights=extrapolating")``."""

_CHUNK_BYTES = 2**16

_FILE_NAME = re.compile(r"^\w+-r\d+-d\d+-n\d+\.h5$")
_ARRAYS = ("draws", "status", "status_time", "steps")


@dataclass(frozen=True, order=True)
class Block:
    """Consecutive draws of one scrambling: the unit of work, of storage and of resuming.

    The population is ``box`` or ``firm``, `replicate` the number of the scrambling, `first` and `count` its
    draws.
    """

    population: str
    replicate: int
    first: int
    count: int

    @property
    def file_name(self) -> str:
        """Name of its shard; blocks of different sizes never share one."""
        return f"{self.population}-r{self.replicate:03d}-d{self.first:08d}-n{self.count}.h5"


@dataclass(frozen=True, eq=False)
class Shard:
    """Everything kept of one block; B draws of P numbers, C cases, n joints.

    All shards of one ensemble share an `identity`, see `plan.Study`. `draws` is (B, P); `status` and the
    integrator's `steps` per sample are (C, B), and so is `status_time`, s; `statistics` are (C, B, n) by
    name, SI. `check` is what the spot check found, empty where there was none; `provenance` is for a
    reader: versions, processor, seed, digest of the configuration.
    """

    block: Block
    identity: str
    names: tuple[str, ...]
    cases: tuple[Case, ...]
    draws: Array
    status: NDArray[np.int8]
    status_time: Single
    steps: NDArray[np.int16]
    statistics: Mapping[str, Single]
    check: Mapping[str, float | int | str] = field(default_factory=dict)
    provenance: Mapping[str, str | int] = field(default_factory=dict)
    seconds: float = 0.0


def shard_image(shard: Shard) -> bytes:
    """Bytes of a shard's file; made in memory, so that a worker can send them to the only writer."""
    with h5py.File(
        "shard.h5", "w", driver="core", backing_store=False, block_size=2**20, libver=("earliest", "v110")
    ) as root:
        root.attrs["schema_version"] = np.int32(SCHEMA_VERSION)
        root.attrs["identity"] = shard.identity
        root.attrs["seconds"] = shard.seconds
        texts = {"names": shard.names, "cases": shard.cases, "check": dict(shard.check)}
        for name, value in texts.items():
            root.attrs[name] = json.dumps(value)
        for name, entry in (vars(shard.block) | dict(shard.provenance)).items():
            root.attrs[name] = entry
        for name in _ARRAYS:
            _put(root, name, getattr(shard, name))
        for name, values in shard.statistics.items():
            _put(root, f"statistics/{name}", values)
        root.flush()
        return bytes(root.id.get_file_image())


def _put(root: h5py.File, name: str, values: NDArray[Any]) -> None:
    """Store an array; a chunk holds whole cases, since those are what a reader asks for."""
    rows = max(_CHUNK_BYTES // values[0].nbytes, 1)
    chunks = (min(rows, len(values)), *values.shape[1:])
    packed = {"compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}
    root.create_dataset(name, data=values, chunks=chunks, **packed)


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a shard to read parts of it; what is missing or damaged is told as missing data."""
    try:
        with h5py.File(path, "r") as root:
            yield root
    except (OSError, LookupError, RuntimeError) as error:
        hint = "run the same tendonrepro ensemble again, with --force"
        raise DataMissingError("is missing, damaged or no shard", where=str(path), hint=hint) from error


def shard_files(folder: Path) -> list[Path]:
    """Files that bear the name of a shard, in canonical order; none when there is no such folder."""
    return sorted(path for path in folder.glob("*.h5") if _FILE_NAME.match(path.name))


def identity_of(path: Path) -> str | None:
    """Identity of the ensemble that a shard belongs to; None when it cannot be read."""
    try:
        with opened(path) as root:
            return str(root.attrs["identity"])
    except DataMissingError:
        return None


def read_check(path: Path) -> dict[str, float | int | str]:
    """What the spot check of a shard found; empty where there was none."""
    with opened(path) as root:
        check: dict[str, float | int | str] = json.loads(root.attrs["check"])
    return check
