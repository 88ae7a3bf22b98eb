"""Shards: what is written comes back, and whatever is not whole is found out."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from tendonrepro.monte_carlo.shards import (
    Block,
    Shard,
    identity_of,
    read_check,
    shard_files,
    shard_image,
)


def shard(**changes):
    rng = np.random.default_rng(1)
    cases, draws, joints = 3, 4, 2
    made = Shard(
        block=Block("box", 2, 8, draws),
        identity="abc",
        names=("mass", "length"),
        cases=(("controller_1", "printed"), ("controller_2", "printed"), ("controller_1", "weights=x")),
        draws=rng.random((draws, 2)),
        status=rng.integers(0, 4, (cases, draws)).astype(np.int8),
        status_time=rng.random((cases, draws)).astype(np.float32),
        steps=np.full((cases, draws), 2, np.int16),
        statistics={name: rng.random((cases, draws, joints)).astype(np.float32) for name in ("mae", "rmse")},
        check={"run": "controller_1", "ideal": 1e-12},
        provenance={"cpu": "any", "seed": 3},
        seconds=1.5,
    )
    made.statistics["rmse"][0] = np.nan
    return replace(made, **changes)


@pytest.fixture
def path(tmp_path):
    made = shard()
    path = tmp_path / made.block.file_name
    path.write_bytes(shard_image(made))
    return path


def test_what_is_written_comes_back(path):
    made = shard()
    with h5py.File(path) as root:
        for name in ("draws", "status", "status_time", "steps"):
            np.testing.assert_array_equal(root[name][()], getattr(made, name))
            assert root[name].dtype == getattr(made, name).dtype
        for name, values in made.statistics.items():
            np.testing.assert_array_equal(root["statistics"][name][()], values)
            assert root["statistics"][name].dtype == np.float32
    assert read_check(path) == made.check
    assert identity_of(path) == "abc"


def test_what_cannot_be_read_has_no_identity(path, tmp_path):
    path.write_bytes(path.read_bytes()[:-100])
    assert identity_of(path) is None
    assert identity_of(tmp_path / "none.h5") is None


def test_files_are_listed_in_canonical_order(tmp_path):
    blocks = [Block("firm", 0, 0, 4), Block("box", 1, 0, 4), Block("box", 0, 4, 4), Block("box", 0, 0, 4)]
    for block in blocks:
        (tmp_path / block.file_name).touch()
    (tmp_path / ".box-r000-d00000000-n4.1-ab.h5").touch()
    (tmp_path / "other.h5").touch()
    assert [path.name for path in shard_files(tmp_path)] == [block.file_name for block in sorted(blocks)]
    assert shard_files(tmp_path / "none") == []
