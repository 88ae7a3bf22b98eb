"""What a long study on plants is known by, costs and keeps on disk, to go on with after an interruption."""

from __future__ import annotations

import ast
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.experiment import errors_from
from tendonrepro.console import Talk
from tendonrepro.experiments.user_law import UserLaw, refuse_memory, refused_on_lanes
from tendonrepro.files import atomic_path, digest_of
from tendonrepro.results.record_store import Records, RecordStore
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE
from tendonrepro.studies import study
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Folder, Site, Study

WHOLE_RUNS = "errors are of whole runs"
"""Why a study leaves ``errors_from`` of its comparison aside."""

MOST_DRAWS = 2**20
"""Weeks of work, and as many blocks as memory holds with ease."""

SECONDS_PER_EXPERIMENT = 2e-3
"""Processor's time, for estimates before anything has run; of the same order is all that is needed.

Measured: 1,179,648 experiments of the shipped ensemble in 2,459 s of one process.
"""

ROOMS = ("configuration", "experiments", "monte_carlo", "physics", "simulation")
"""Packages whose code decides what a draw is and what its runs give."""

PLANTS_AT_ONCE = 32
"""Plants simulated together at most; more fill lanes better, and each has motions of some 3 MB."""

_STUB = 64
"""Samples in which it shows whether a law can run."""

Simulate: TypeAlias = Callable[[Sequence[Loop]], Batch]
"""Signature of `tendonrepro.simulation.batch.simulate_batch`."""

Piece: TypeAlias = NDArray[np.int64]
"""Some plants by their numbers (M,): what is simulated together, and stored at once."""


@cache
def code_digest(*rooms: str) -> str:
    """SHA-256 of the code of some packages, without comments and docstrings."""
    package = Path(__file__).parents[1]
    files = [path for room in rooms for path in sorted((package / room).rglob("*.py"))]
    return digest_of({path.relative_to(package).as_posix(): _bare_code(path) for path in files})


def _bare_code(path: Path) -> str:
    tree = ast.parse(path.read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            node.body = node.body[1:]
    # Unlike a dump of the tree it is the same under every version of Python.
    return ast.unparse(tree)


def identity_of(loaded: LoadedEnsemble, *rooms: str, **decided_by: object) -> str:
    """SHA-256 of what numbers on plants depend on: version, code, configuration, and what else decides them.

    The code is that of `ROOMS`, and of some `rooms` more.
    """
    known = {
        "version": __version__,
        "code": code_digest(*ROOMS, *rooms),
        "config": loaded.sha256,
        "base": loaded.base.sha256,
    }
    return digest_of(known | decided_by)


def cost_of(experiments: int, numbers: int) -> dict[str, float]:
    """What experiments take, with so many numbers and a status kept of each."""
    gigabytes = experiments * (numbers * 4 + 1) / 1e9
    return study.cost_of(experiments, SECONDS_PER_EXPERIMENT) | {"gigabytes": gigabytes}


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


def record(batch: Batch, records: Records) -> None:
    """Write what became of runs, plant by plant, into the fields that records have for it."""
    records["status"] = batch.status.reshape(records["status"].shape)
    # What overflows single precision is of a diverged run, and infinite for every purpose.
    with np.errstate(over="ignore"):
        for name in batch.statistics.keys() & {*(records.dtype.names or ())}:
            records[name] = batch.statistics[name].reshape(records[name].shape)


def still_missing(pieces: Sequence[Piece], store: RecordStore) -> list[Piece]:
    """Pieces with a plant of which the store has no record; they are run whole."""
    missing = store.missing()
    return [piece for piece in pieces if np.isin(piece, missing).any()]


def fill(
    store: RecordStore,
    pieces: Sequence[Piece],
    stream: Generator[tuple[Piece, Records], None, None],
    talk: Talk,
) -> None:
    """Store the records of pieces as they come; this process is the only writer."""
    with talk.bar("simulating", len(pieces)) as progress, closing(stream):
        for piece, records in stream:
            store.put(piece, records)
            progress(1)


def refuse_on_lanes(law: UserLaw, loop: Loop, trial: Callable[[Loop], object] = lambda _: None) -> None:
    """Raise a UsageError for a law that cannot run on many plants together: the first samples show it.

    So does a `trial` of them that fails.
    """
    stub = stub_of(loop)
    try:
        simulate_batch([stub])
        trial(stub)
    except Exception as error:
        raise refused_on_lanes(law.name, error) from error
    refuse_memory(law, stub)


def stub_of(loop: Loop) -> Loop:
    """The first samples of a run."""
    names = ("time", "q_d", "dq_d", "ddq_d")
    start = {name: getattr(loop.reference, name)[:_STUB] for name in names}
    return replace(loop, reference=replace(loop.reference, **start))
