"""What an identification depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from tendonrepro import __version__
from tendonrepro.config.ensemble import LoadedEnsemble
from tendonrepro.config.models.readings import RUNS, Reading, case_of, reading
from tendonrepro.identify.misfit import Bench, Printed
from tendonrepro.identify.search import Effort

SCHEMA_VERSION = 1

Fit: TypeAlias = Literal["controller_2", "all"]
FITTED: Mapping[Fit, tuple[str, ...]] = {"controller_2": ("controller_2",), "all": RUNS}
"""Runs whose numbers are fitted."""

NEAR = 0.02
"""Misfit in log ratio, about 2 %, up to which a plant is near-optimal; twice the best where that is more."""


@dataclass(frozen=True)
class Task:
    """All that an identification depends on.

    Attributes
    ----------
    loaded : LoadedEnsemble
    fit : str
        A key of `FITTED`.
    readings : tuple of Reading
    effort : Effort
    seed : int
    printed : Printed
    bench : Bench
    """

    loaded: LoadedEnsemble
    fit: Fit
    readings: tuple[Reading, ...]
    effort: Effort
    seed: int
    printed: Printed
    bench: Bench

    @property
    def fitted(self) -> tuple[str, ...]:
        """Runs whose numbers are fitted."""
        return FITTED[self.fit]

    def case(self, reading_: Reading) -> Reading:
        """What of a reading changes the fitted runs; readings with one case share a search."""
        changing = {axis for run in self.fitted for axis, _ in case_of(reading_, run).settings}
        return reading({axis: value for axis, value in reading_.settings if axis in changing})

    def identity(self, names: Sequence[str]) -> str:
        """SHA-256 of all that the numbers of some readings depend on."""
        effort = self.effort
        content = {
            "schema": SCHEMA_VERSION,
            "version": __version__,
            "config": self.loaded.sha256,
            "fit": self.fit,
            "window": self.bench.window,
            "readings": list(names),
            "effort": [effort.generations, effort.population, effort.seeds, effort.tolerance],
            "seed": self.seed,
            "printed": [self.printed.values.tolist(), self.printed.half.tolist()],
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
