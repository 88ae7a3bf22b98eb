"""Plants as the rules see them: statuses and statistics of runs, wherever these come from."""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import Reading
from tendonrepro.monte_carlo.data import CaseName
from tendonrepro.monte_carlo.shares import Share, Spread, share_of, spread_of
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.verdicts.rules import Mask

OK, UNRESOLVED = STATUSES.index("ok"), STATUSES.index("unresolved")
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


class PlantTable(Protocol):
    """Runs of N plants by their readings: all draws of an ensemble, or the one arm that was measured."""

    @property
    def joints(self) -> tuple[int, ...]:
        """The moving joints, n of them."""

    @property
    def replicate(self) -> NDArray[np.int64]:
        """Scrambling of each plant, (N,)."""

    def has(self, run: str, reading: str) -> bool:
        """Whether there is such a run."""

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Status codes, (N,); else a DataMissingError."""

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One of `results.summary.STATISTICS`, SI, (N, n); else a DataMissingError."""


class Plants:
    """The N plants of a table under one reading, with intervals from their scramblings.

    `looked_up` are the statistics that were asked for, by run and name.
    """

    def __init__(self, table: PlantTable, reading: str) -> None:
        self.joints = table.joints
        self.reading = reading
        self._table = table
        # Claims ask for the same statistics, which a large ensemble reads from all its files.
        self.looked_up: dict[tuple[Run, str], Array] = {}
        self._statuses: dict[Run, NDArray[np.int8]] = {}

    def has(self, run: Run) -> bool:
        """Whether there is such a run."""
        return self._table.has(*self._case(run))

    def status(self, run: Run) -> NDArray[np.int8]:
        """Status codes of a run, (N,); else a DataMissingError."""
        if run not in self._statuses:
            self._statuses[run] = self._table.status(*self._case(run))
        return self._statuses[run]

    def statistic(self, run: Run, name: str) -> Array:
        """One statistic of a run, SI, (N, n); else a DataMissingError."""
        if (run, name) not in self.looked_up:
            self.looked_up[run, name] = self._table.statistic(*self._case(run), name)
        return self.looked_up[run, name]

    def __getitem__(self, key: tuple[Run, str]) -> Array:
        """Statistic (N, n) by (run, name), `SHAPE` too."""
        run, name = key
        if name == SHAPE:
            return np.asarray(self.statistic(run, "rmse") / self.statistic(run, "mae"))
        return self.statistic(run, name)

    def ok(self, *runs: Run) -> Mask:
        """Where all these runs are ``ok``."""
        return np.asarray(np.logical_and.reduce([self.status(run) == OK for run in runs]))

    def resolved(self, *runs: Run) -> Mask:
        """Where all these runs could be integrated."""
        return np.asarray(np.logical_and.reduce([self.status(run) != UNRESOLVED for run in runs]))

    def share(self, holds: Mask, counted: Mask) -> Share:
        """Share of the plants counted (N,) on which something holds (N,)."""
        return share_of(holds[counted], self._table.replicate[counted])

    def spread(self, values: Array, counted: Mask) -> Spread:
        """Spread of values (N,) over the plants counted (N,)."""
        return spread_of(values[counted], self._table.replicate[counted])

    def _case(self, run: Run) -> CaseName:
        return (run.run, run.reading.name) if isinstance(run, RunUnder) else (run, self.reading)
