"""An ensemble as the rules see it."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import Reading
from tendonrepro.monte_carlo.data import Case, EnsembleData, Stored
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.verdicts.measured import OneArm
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


class Plants:
    """All N plants under one reading."""

    def __init__(self, data: EnsembleData | OneArm, reading: str) -> None:
        self.data = data
        self.reading = reading
        self.joints = data.joints
        self._kept: dict[tuple[Run, str], Stored] = {}

    def status(self, run: Run) -> NDArray[np.int8]:
        """Status codes of a run, (N,)."""
        if (run, "status") not in self._kept:
            self._kept[run, "status"] = self.data.status(*self._case(run))
        return self._kept[run, "status"]

    def __getitem__(self, key: tuple[Run, str]) -> Array:
        """Statistic (N, n) by (run, name)."""
        run, name = key
        if name == SHAPE:
            return np.asarray(self[run, "rmse"] / self[run, "mae"])
        if key not in self._kept:
            self._kept[key] = self.data.statistic(*self._case(run), name)
        return self._kept[key]

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

    def has(self, run: Run) -> bool:
        """Whether a run was simulated."""
        return self.data.has(*self._case(run))

    def _case(self, run: Run) -> Case:
        return (run.run, run.reading.name) if isinstance(run, RunUnder) else (run, self.reading)
