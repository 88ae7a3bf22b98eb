"""An ensemble as the rules see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import EnsembleData, ShardArray
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.verdicts.measured import OneArm
from tendonrepro.verdicts.rules import Mask

OK, DIVERGED, UNRESOLVED = (STATUSES.index(name) for name in ("ok", "diverged", "unresolved"))
"""Status codes."""

SHAPE = "rmse/mae"


class Plants:
    """All N plants under one reading; ``run@variation`` is a variation of a run."""

    def __init__(self, data: EnsembleData | OneArm, reading: str) -> None:
        self.data = data
        self.reading = reading
        self.joints = data.joints
        self._kept: dict[tuple[str, str], ShardArray] = {}

    def status(self, run: str) -> NDArray[np.int8]:
        """Status codes of a run, (N,)."""
        if (run, "status") not in self._kept:
            self._kept[run, "status"] = self.data.status(*self._address(run))
        return self._kept[run, "status"]

    def __getitem__(self, key: tuple[str, str]) -> Array:
        """Statistic (N, n) by (run, name)."""
        run, name = key
        if name == SHAPE:
            return np.asarray(self[run, "rmse"] / self[run, "mae"])
        if key not in self._kept:
            self._kept[key] = self.data.statistic(*self._address(run), name)
        return self._kept[key]

    def ranked(self, run: str, name: str) -> Array:
        """The same, infinite where the run diverged."""
        return np.where((self.status(run) == DIVERGED)[:, np.newaxis], np.inf, self[run, name])

    def ok(self, *runs: str) -> Mask:
        """Where all these runs are ``ok``."""
        return np.asarray(np.logical_and.reduce([self.status(run) == OK for run in runs]))

    def none(self, code: int, *runs: str) -> Mask:
        """Where none of these runs has a status."""
        return np.asarray(np.logical_and.reduce([self.status(run) != code for run in runs]))

    def rankable(self, *runs: str) -> Mask:
        """Where these runs are resolved and not all diverged."""
        lost = np.logical_and.reduce([self.status(run) == DIVERGED for run in runs])
        return np.asarray(self.none(UNRESOLVED, *runs) & ~lost)

    def _address(self, run: str) -> tuple[str, str]:
        name, _, variation = run.partition("@")
        reading = variation or self.reading
        if variation and self.reading != PRINTED:
            raise DataMissingError(f"variations of {name} are run under reading {PRINTED!r} alone")
        if not self.data.has(name, reading):
            raise DataMissingError(f"the ensemble holds no run {name!r} under {reading!r}")
        return name, reading
