"""Plants as the rules see them: statuses and statistics of runs, wherever these come from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import Reading
from tendonrepro.monte_carlo.data import CaseName, EnsembleData, ShardArray
from tendonrepro.monte_carlo.shares import Share, Spread, share_of, spread_of
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.verdicts.rules import Mask

OK, DIVERGED, UNRESOLVED = (STATUSES.index(name) for name in ("ok", "diverged", "unresolved"))
"""Status codes."""

SHAPE = "rmse/mae"


class RunUnder(NamedTuple):
    """A run under a reading or variation of its own, such as with half of M_bar."""

    run: str
    reading: Reading

    def __str__(self) -> str:
        return f"{self.run}@{self.reading.name}"


Run: TypeAlias = str | RunUnder
"""A run under the reading that is judged, by its name, or under one of its own."""


class Plants(ABC):
    """N plants with n joints under one reading: all of an ensemble, or the one arm that was measured."""

    joints: tuple[int, ...]
    reading: str

    @abstractmethod
    def has(self, run: Run) -> bool:
        """Whether there is such a run."""

    @abstractmethod
    def status(self, run: Run) -> NDArray[np.int8]:
        """Status codes of a run, (N,); else a DataMissingError."""

    @abstractmethod
    def statistic(self, run: Run, name: str) -> Array:
        """One statistic of a run, SI, (N, n); else a DataMissingError."""

    def __getitem__(self, key: tuple[Run, str]) -> Array:
        """Statistic (N, n) by (run, name), `SHAPE` too."""
        run, name = key
        if name == SHAPE:
            return np.asarray(self.statistic(run, "rmse") / self.statistic(run, "mae"))
        return self.statistic(run, name)

    def ranked(self, run: Run, name: str) -> Array:
        """The same, infinite where the run diverged."""
        return np.where((self.status(run) == DIVERGED)[:, np.newaxis], np.inf, self[run, name])

    def ok(self, *runs: Run) -> Mask:
        """Where all these runs are ``ok``."""
        return np.asarray(np.logical_and.reduce([self.status(run) == OK for run in runs]))

    def none(self, code: int, *runs: Run) -> Mask:
        """Where none of these runs has a status."""
        return np.asarray(np.logical_and.reduce([self.status(run) != code for run in runs]))

    def rankable(self, *runs: Run) -> Mask:
        """Where these runs are resolved and not all diverged."""
        lost = np.logical_and.reduce([self.status(run) == DIVERGED for run in runs])
        return np.asarray(self.none(UNRESOLVED, *runs) & ~lost)

    def counted(self, *runs: Run) -> tuple[Mask, Mask]:
        """Where all these runs are ``ok``, and where they can be ranked, a diverged one last."""
        return self.ok(*runs), self.rankable(*runs)


class EnsemblePlants(Plants):
    """All plants of an ensemble under one reading, with intervals from its scramblings."""

    def __init__(self, data: EnsembleData, reading: str) -> None:
        self.joints = data.joints
        self.reading = reading
        self._data = data
        # Claims ask for the same statistics, which a large ensemble reads from all its files.
        self._kept: dict[tuple[Run, str], ShardArray] = {}

    def has(self, run: Run) -> bool:
        """Whether a run was simulated."""
        return self._data.has(*self._case(run))

    def status(self, run: Run) -> NDArray[np.int8]:
        """Status codes of a run, (N,)."""
        if (run, "status") not in self._kept:
            self._kept[run, "status"] = self._data.status(*self._case(run))
        return self._kept[run, "status"]

    def statistic(self, run: Run, name: str) -> Array:
        """One of `simulation.streaming.STATISTICS`, SI, (N, n)."""
        if (run, name) not in self._kept:
            self._kept[run, name] = self._data.statistic(*self._case(run), name)
        return self._kept[run, name]

    def share(self, holds: Mask, counted: Mask) -> Share:
        """Share of the plants counted (N,) on which something holds (N,)."""
        return share_of(holds[counted], self._data.replicate[counted])

    def spread(self, values: Array, counted: Mask) -> Spread:
        """Spread of values (N,) over the plants counted (N,)."""
        return spread_of(values[counted], self._data.replicate[counted])

    def _case(self, run: Run) -> CaseName:
        return (run.run, run.reading.name) if isinstance(run, RunUnder) else (run, self.reading)
