"""What a long study on plants keeps on disk, to go on with after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.experiment import errors_from
from tendonrepro.files import atomic_path
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE
from tendonrepro.studies.parameters import Folder
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site, Study

WHOLE_RUNS = "errors are of whole runs"
"""Why a study leaves ``errors_from`` of its comparison aside."""


class Kept:
    """Values (N, K) of a function at points (N, P), in the order in which they are asked for.

    They are kept in a file, if one is named. Whoever asks once more for the same points, as a search does
    that was interrupted, gets what stands there; from the first other point on all is found anew.
    """

    def __init__(self, function: Callable[[Array], Array], path: Path | None) -> None:
        self._function, self._path = function, path
        self._table = np.load(path) if path and path.exists() else np.empty((0, 0))
        self.count = 0

    def __call__(self, points: Array) -> Array:
        """Values at points, found on disk or by the function."""
        asked, width = slice(self.count, self.count + len(points)), points.shape[1]
        if not np.array_equal(self._table[asked, :width], points, equal_nan=True):
            rows = np.column_stack([points, self._function(points)])
            self._table = np.concatenate([self._table[: self.count], rows]) if self.count else rows
            if self._path:
                with atomic_path(self._path) as temporary:
                    np.save(temporary, self._table)
        self.count += len(points)
        return self._table[asked, width:]

    @property
    def table(self) -> Array:
        """Points that were asked for, with their values, (N, P + K)."""
        return self._table[: self.count]


def study_on_plants(
    experiment: str,
    loaded: LoadedEnsemble,
    identity: str,
    run: Callable[[Site, Path], Result],
    folder: Folder,
    *,
    cost: Mapping[str, float],
    seed: int | None = None,
    stays: str = "",
    averages: str = WHOLE_RUNS,
) -> Study:
    """Study on plants of the box, or around an arm, that goes on after an interruption.

    Parameters
    ----------
    experiment
        What the manifest calls it.
    loaded
        Where plants are drawn from.
    identity
        Digest of all that decides what is kept, by `identity_of`. What has another is not taken up.
    run
        Makes the result, at a site, with a folder for what is kept.
    folder
        Of the result.
    cost
        As of `Study`.
    seed
        Of the study's own random numbers, where these are not those of the draws.
    stays
        Folder of what is kept, where that is a part of the result; its files have names by the identity.
    averages
        Why ``errors_from`` of the comparison is left aside; empty where it is not.
    """
    kept = stays or f"parts-{identity[:16]}"
    manifest = {
        "experiment": experiment,
        "seed": int(loaded.config.seed.si) if seed is None else seed,
        "solver": {"name": COMPILED_STEPPER, "tolerance": TOLERANCE},
        "config": {"ensemble_sha256": loaded.sha256},
    }

    def made(site: Site) -> Result:
        if averages and (seconds := errors_from(loaded.compare)):
            site.talk.note(f"errors_from, {seconds:g} s, is left aside: {averages}")
        return replace(run(site, site.files / kept), manifest=manifest)

    base = replace(loaded.base, sha256=identity, origin=loaded.origin)
    return Study(base, made, folder, keep=kept, stays=bool(stays), stored=True, cost=cost)
