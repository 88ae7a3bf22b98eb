"""A stand-in for the batch stepper: numbers that depend on everything in a loop and cost next to nothing."""

import io
import json
import time
import zlib
from dataclasses import fields, is_dataclass, replace
from functools import cache

import h5py
import numpy as np

from tendonrepro.console import Talk
from tendonrepro.ensemble.command import load_study, run_study
from tendonrepro.ensemble.shards import FOLDER, Block, Shard, shard_files
from tendonrepro.files import unsealed
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import Batch
from tendonrepro.simulation.streaming import STATISTICS

SHARES = {"ok": 0.8, "ringing": 0.08, "diverged": 0.08, "unresolved": 0.04}


def fake_batch(loops, limits):
    """Pseudo-statistics of each loop alone."""
    del limits
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
    """The shipped study with few readings, one population and small blocks."""
    study = load_study(None, (), None, "default")
    return replace(
        study,
        boxes={"box": study.boxes["box"]},
        shares={"box": 1.0},
        readings=study.readings[:3],
        variations=study.variations[:1],
        block_draws=4,
        check_every=0,
    )


DRAWS = 64
"""The fewest that the small study takes: 16 blocks."""


def slow_batch(loops, limits):
    """The same, slow enough for something to happen meanwhile."""
    time.sleep(0.3)
    return fake_batch(loops, limits)


def run_small(folder, jobs):
    """Body of a process that may be killed: figures left out, for they are no part of what is resumed.

    After one that was killed among its tables it takes `--force`, which keeps what is computed.
    """
    from tendonrepro.ensemble import command as ensemble

    ensemble.draw_ensemble_figures = lambda *_: []
    force, talk = (folder / "tables").exists(), Talk(quiet=True)
    ensemble.run_study(small_study(), DRAWS, folder, jobs=jobs, talk=talk, force=force, simulate=fake_batch)


def run_ensemble_of(folder, study=None, draws=DRAWS, **options):
    """Run a study, the small one if none is given, in this process and with the stand-in."""
    arguments = {"jobs": 1, "talk": Talk(quiet=True), "simulate": fake_batch} | options
    return run_study(study or small_study(), draws, folder, **arguments)


def read_shard(path):
    """All of a shard, as it was before it was stored."""
    with h5py.File(io.BytesIO(unsealed(path))) as root:
        attributes = dict(root.attrs)
        place = (int(attributes[key]) for key in ("replicate", "first", "count"))
        shard = Shard(
            block=Block(attributes["population"], *place),
            identity=attributes["identity"],
            names=tuple(json.loads(attributes["names"])),
            cases=tuple(map(tuple, json.loads(attributes["cases"]))),
            check=json.loads(attributes["check"]),
            statistics={name: values[()] for name, values in root["statistics"].items()},
            seconds=float(attributes["seconds"]),
            **{name: root[name][()] for name in ("draws", "status", "status_time", "steps")},
        )
    assert attributes["digest"] == shard.digest()
    return shard


def digests(folder):
    """Digest of every shard in a folder of results, by name."""
    return {path.name: read_shard(path).digest() for path in shard_files(folder / FOLDER)}


def results(folder):
    """Digest of every shard, and the tables byte for byte."""
    tables = {path.name: path.read_bytes() for path in sorted((folder / "tables").iterdir())}
    return digests(folder) | tables
