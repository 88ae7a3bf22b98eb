"""What an ensemble left on disk.

Opening shards takes longer than reading them. So of a small ensemble an array of all cases is kept.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.shards import FOLDER, Block, Case, read_array
from tendonrepro.simulation.streaming import STATISTICS

KEPT_DRAWS = 2**15
"""Draws of the largest ensemble of which arrays are kept: some 40 arrays of 45 MB."""

PLAN = "plan.json"
"""File that says which blocks make up the ensemble in a folder."""


@dataclass(frozen=True, eq=False)
class EnsembleData:
    """One population of one ensemble; N draws of P numbers, n joints, scrambling after scrambling.

    `of_paper` tells whether draws start from the paper's arm, gains and payload. `joints` are the paper's
    numbers; `alpha` are the configured weights of Controller 1's estimator; `names` are of the P numbers.
    `readings` include variations. `lookup` gives the place of a case from ``(run, reading or variation)``.
    `planned` is how many draws there were to be.
    """

    of_paper: bool
    joints: tuple[int, ...]
    alpha: tuple[float, ...]
    runs: tuple[str, ...]
    names: tuple[str, ...]
    readings: tuple[str, ...]
    lookup: Mapping[Case, int]
    files: Mapping[Block, Path]
    identity: str
    planned: int
    _kept: dict[str, NDArray[Any]] = field(default_factory=dict, repr=False)

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
        """Status codes of a run, (N,); see `physics.metrics.STATUSES`.

        Raises
        ------
        DataMissingError
            When that was not simulated.
        """
        return self._case("status", run, reading)

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
        values: Array = self._case(name, run, reading).astype(np.float64)
        return values

    def _case(self, name: str, run: str, reading: str) -> NDArray[Any]:
        if not self.has(run, reading):
            message = f"the ensemble holds no run {run!r} under {reading!r}"
            raise DataMissingError(message, hint=f"It holds {', '.join(self.readings)}.")
        place = self.lookup[run, reading]
        if len(self) > KEPT_DRAWS:
            return np.concatenate([read_array(path, name)[place] for path in self.files.values()])
        if name not in self._kept:
            pieces = [read_array(path, name) for path in self.files.values()]
            self._kept[name] = np.concatenate(pieces, axis=1)
        return np.array(self._kept[name][place])


def read_ensemble(folder: Path, population: str = "box") -> EnsembleData:
    """Open a finished ensemble; of population ``firm`` only rows of high and medium confidence vary.

    Raises
    ------
    DataMissingError
        When there is none, it has no such population, or a shard is missing or damaged.
    """
    path = folder / PLAN
    if not path.exists():
        message = "holds no finished ensemble"
        raise DataMissingError(message, where=str(folder), hint="run tendonrepro ensemble first")
    plan = json.loads(path.read_text(encoding="utf-8"))
    if population not in plan["populations"]:
        message = f"holds no population {population!r}"
        raise DataMissingError(message, where=str(folder), hint=f"It holds {', '.join(plan['populations'])}.")
    blocks = [Block(*entry) for entry in sorted(plan["blocks"]) if entry[0] == population]
    names = ("joints", "alpha", "runs", "names", "readings")
    of_plan: dict[str, Any] = {name: tuple(plan[name]) for name in names}
    return EnsembleData(
        of_paper=plan["of_paper"],
        lookup={(run, name): place for run, name, place in plan["lookup"]},
        files={block: folder / FOLDER / block.file_name(plan["identity"]) for block in blocks},
        identity=plan["identity"],
        planned=plan["draws"],
        **of_plan,
    )
