"""What an ensemble leaves on disk: a file of records, and the plan of all."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError
from tendonrepro.files import Json, read_json
from tendonrepro.results.record_store import Records, finished

SHARDS = "shards"
"""Name of the folder of records in a folder of results."""

CaseName = tuple[str, str]
"""Run and what it was run under, such as ``("controller_1", "weights=extrapolating")``."""

Column: TypeAlias = Callable[[str], Records]
"""What records of N draws hold under a name: their numbers ``draws`` (N, P); by case ``status`` (N, C) and
statistics (N, C, n)."""

PLAN = "plan.json"
"""File that says what the ensemble in a folder consists of."""

AGAIN = "remove it, and run the same tendonrepro ensemble again with --force"


@dataclass(frozen=True, eq=False)
class EnsembleData:
    """An ensemble; N draws of P numbers, n joints, scrambling after scrambling.

    `of_paper` tells whether draws start from the paper's arm, gains and payload. `names` are of the P
    numbers. `lookup` gives the place of a case. `planned` is the number of draws that was asked for. `around`
    says around which arm of a user's own draws lie; it is empty where they are of the paper's ranges.
    `stored` (N,) is the scrambling of each record, in the order of the file, and `column` what records hold.
    """

    of_paper: bool
    around: str
    runs: tuple[str, ...]
    joints: tuple[int, ...]
    names: tuple[str, ...]
    readings: tuple[str, ...]
    lookup: Mapping[CaseName, int]
    identity: str
    planned: int
    stored: NDArray[np.int64]
    column: Column

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.stored)

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        """Places of the draws among the records, where scramblings may take turns."""
        return np.argsort(self.stored, kind="stable")

    @property
    def replicate(self) -> NDArray[np.int64]:
        """Scrambling of each draw, (N,)."""
        return self.stored[self._order]

    @property
    def draws(self) -> Array:
        """Numbers drawn, (N, P), in the units of the box."""
        return np.asarray(self.column("draws")[self._order])

    def has(self, run: str, reading: str) -> bool:
        """Whether a run was simulated under a reading or variation."""
        return (run, reading) in self.lookup

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Codes of a run, places in `physics.metrics.STATUSES`, (N,); else a DataMissingError."""
        return self._case("status", run, reading)

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One of `simulation.streaming.STATISTICS` of a run, SI units, (N, n); else a DataMissingError."""
        return np.asarray(self._case(name, run, reading), np.float64)

    def _case(self, name: str, run: str, reading: str) -> Records:
        if not self.has(run, reading):
            hint = f"It holds {', '.join(self.readings)}."
            raise DataMissingError(f"the ensemble holds no run {run!r} under {reading!r}", hint=hint)
        return np.asarray(self.column(name)[:, self.lookup[run, reading]][self._order])


def read_ensemble(folder: Path) -> EnsembleData:
    """Open a finished ensemble; of one from before 30 November 2026 the first population.

    Raises
    ------
    DataMissingError
        When there is none, or its records are damaged.
    """
    path = folder / PLAN
    if not path.exists():
        hint = "run tendonrepro ensemble first"
        raise DataMissingError("holds no finished ensemble", where=str(folder), hint=hint)
    plan = read_json(path, "run the same tendonrepro ensemble again with --force")
    read = _from_shards if "blocks" in plan else _from_records
    stored, column = read(folder / SHARDS, plan, next(iter(plan["populations"])))
    return EnsembleData(
        of_paper=plan["of_paper"],
        around=plan.get("around", ""),
        lookup={(run, name): place for run, name, place in plan["lookup"]},
        identity=plan["identity"],
        planned=plan["draws"],
        runs=tuple(plan["runs"]),
        joints=tuple(plan["joints"]),
        names=tuple(plan["names"]),
        readings=tuple(plan["readings"]),
        stored=stored,
        column=column,
    )


def _from_records(folder: Path, plan: Json, population: str) -> tuple[NDArray[np.int64], Column]:
    """Scramblings of records, which take turns, and what these hold."""
    records = finished(folder / plan["records"][population], plan["populations"][population], AGAIN)
    return np.arange(len(records)) % plan["replicates"], records.__getitem__


def _from_shards(folder: Path, plan: Json, population: str) -> tuple[NDArray[np.int64], Column]:
    """The same of an ensemble from before 28 November 2026, with a file for each block of draws."""
    blocks = [entry[1:] for entry in sorted(plan["blocks"]) if entry[0] == population]
    names = [f"{population}-r{r:03d}-d{first:08d}-n{count}" for r, first, count in blocks]
    paths = [folder / f"{name}-{plan['identity'][:12]}.npz" for name in names]

    @cache
    def column(name: str) -> Records:
        parts = [_shard_array(path, name) for path in paths]
        # Cases came first, and draws second.
        return np.concatenate(parts) if name == "draws" else np.concatenate(parts, axis=1).swapaxes(0, 1)

    return np.concatenate([np.full(count, r) for r, _, count in blocks]), column


def _shard_array(path: Path, name: str) -> Records:
    """Read one array; a DataMissingError where it is missing or damaged."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return np.asarray(stored[name])
    except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DataMissingError("is missing, damaged or no shard", where=str(path), hint=AGAIN) from error
