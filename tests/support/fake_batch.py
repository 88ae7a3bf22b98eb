"""A stand-in for the batch stepper: numbers that depend on everything in a loop and cost next to nothing."""

import time
import zlib
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from functools import cache

import numpy as np

from tendonrepro.console import QUIET
from tendonrepro.monte_carlo.data import SHARDS
from tendonrepro.monte_carlo.ensemble import ensemble_study, load_study
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.store import PARTIAL
from tendonrepro.simulation.batch import Batch
from tendonrepro.simulation.streaming import STATISTICS
from tendonrepro.studies.lifecycle import carry_out

SHARES = {"ok": 0.8, "ringing": 0.08, "diverged": 0.08, "unresolved": 0.04}


def fake_batch(loops):
    """Pseudo-statistics of each loop alone."""
    numbers, codes = [], []
    for loop in loops:
        rng = np.random.default_rng(fingerprint(loop))
        codes.append(rng.choice(len(STATUSES), p=list(SHARES.values())))
        numbers.append(rng.uniform(1.0, 2.0, (len(STATISTICS), loop.reference.q_d.shape[1])))
    return Batch(
        statistics=dict(zip(STATISTICS, np.stack(numbers, axis=1), strict=True)),
        status=np.array(codes, np.int8),
        status_time=np.array([loop.reference.time[-1] for loop in loops]),
        steps=np.full(len(loops), 2),
        traces=None,
    )


def fingerprint(loop):
    """Checksum of every number of a loop, the long reference by its corners."""
    light = replace(loop, reference=loop.reference.q_d[::500], solver=loop.solver.rtol)
    digest = 0
    for leaf in _leaves(light):
        digest = zlib.crc32(leaf, digest)
    return digest


def _leaves(value):
    if is_dataclass(value):
        value = [getattr(value, field.name) for field in fields(value)]
    if isinstance(value, (tuple, list)):
        for item in value:
            yield from _leaves(item)
    elif value is not None and not callable(value):
        yield np.asarray(value).tobytes() if not isinstance(value, str) else value.encode()


@cache
def small_study():
    """The shipped study with few readings and scramblings, and small blocks."""
    study = load_study(None, (), None, "default")
    return replace(
        study,
        readings=study.readings[:3],
        variations=study.variations[:1],
        replicates=4,
        block_draws=2,
    )


DRAWS = 32
"""The fewest that the small study takes: 16 blocks."""


def slow_batch(loops):
    """The same, slow enough for something to happen meanwhile."""
    time.sleep(0.3)
    return fake_batch(loops)


def run_small(folder, jobs):
    """Body of a process that may be killed: figures left out, for they are no part of what is resumed."""
    from tendonrepro.monte_carlo import ensemble

    ensemble.ensemble_figures = lambda *_: {}
    run_ensemble_of(folder, jobs=jobs)


def run_ensemble_of(folder, study=None, draws=DRAWS, force=False, **options):
    """Run a study, the small one if none is given, in this process and with the stand-in."""
    study, arguments = study or small_study(), {"simulate": fake_batch} | options
    prepared = ensemble_study(study, draws, **arguments, folder={"out": folder, "force": force})
    return carry_out(replace(prepared, command="ensemble"), QUIET).data


def record_files(folder):
    """Files of records of a result, and of one that is not finished."""
    return [
        path for above in (folder, folder / PARTIAL) for path in sorted((above / SHARDS).glob("[!.]*.npy"))
    ]


def finished_in(folder):
    """Records that are done, as bytes, by file and plant."""
    done = {}
    for path in record_files(folder):
        with suppress(FileNotFoundError):  # while a result takes its place
            file = np.load(path, mmap_mode="r")
            done |= {(path.name, k): file[k].tobytes() for k in np.flatnonzero(file["done"]).tolist()}
    return done


def results(folder):
    """Files of records and tables, byte for byte."""
    paths = [*record_files(folder), *sorted((folder / "tables").iterdir())]
    return {path.name: path.read_bytes() for path in paths}
