"""Shards: one block as plain arrays in one file, written whole or not at all."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.errors import DataMissingError

FOLDER = "shards"
"""Name of the folder of shards in a folder of results."""

Case = tuple[str, str]
"""Run and what it was run under, such as ``("controller_1", "weights=extrapolating")``."""

Arrays = Mapping[str, NDArray[Any]]
"""Everything kept of one block; B draws of P numbers, C cases, n joints.

``draws`` (B, P) and ``status`` (C, B); each statistic (C, B, n), SI; ``check`` is JSON of what the spot check
found.
"""


@dataclass(frozen=True, order=True)
class Block:
    """Consecutive draws of one scrambling: the unit of work, of storage and of resuming.

    The population is ``box`` or ``firm``, `replicate` the scrambling.
    """

    population: str
    replicate: int
    first: int
    count: int

    def __str__(self) -> str:
        return f"{self.population}-r{self.replicate:03d}-d{self.first:08d}-n{self.count}"

    def file_name(self, identity: str) -> str:
        """Name of its shard; no other block or ensemble has it."""
        return f"{self}-{identity[:12]}.npz"


def shard_files(folder: Path, identity: str = "*") -> list[Path]:
    """Shards of an ensemble, or of any, in canonical order."""
    return sorted(folder.glob(f"[!.]*-{identity[:12]}.npz"))


def shard_image(arrays: Arrays) -> bytes:
    """Bytes of a shard, made in memory so that a worker can send them to the only writer."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def read_array(path: Path, name: str) -> NDArray[Any]:
    """Read one array; a missing or damaged one is told as missing data."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return np.asarray(stored[name])
    except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        hint = "remove it, and run the same tendonrepro ensemble again with --force"
        raise DataMissingError("is missing, damaged or no shard", where=str(path), hint=hint) from error
