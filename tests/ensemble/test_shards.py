"""Shards: what is written comes back, and whatever is not whole is found out."""

import io
from dataclasses import replace

import h5py
import numpy as np
import pytest
from support.fake_batch import read_shard

from tendonrepro.ensemble.shards import (
    Block,
    Shard,
    check_shard,
    identity_of,
    read_check,
    shard_files,
    shard_image,
)
from tendonrepro.errors import DataMissingError
from tendonrepro.files import sealed, unsealed


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
    made, found = shard(), read_shard(path)
    assert found.block == made.block
    assert (found.names, found.cases, found.identity, found.seconds) == (
        made.names,
        made.cases,
        made.identity,
        made.seconds,
    )
    for name in ("draws", "status", "status_time", "steps"):
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
        assert getattr(found, name).dtype == getattr(made, name).dtype
    for name, values in made.statistics.items():
        np.testing.assert_array_equal(found.statistics[name], values)
        assert found.statistics[name].dtype == np.float32
    assert read_check(path) == made.check
    assert identity_of(path) == "abc"


def test_the_digest_leaves_out_only_time_and_machine():
    base = shard().digest()
    assert shard(seconds=9.0, provenance={"cpu": "other"}).digest() == base
    status = shard().status.copy()
    status[0, 0] = (status[0, 0] + 1) % 4
    others = [
        shard(status=status),
        shard(identity="other"),
        shard(block=Block("box", 2, 12, 4)),
        shard(check={}),
        shard(statistics={"mae": shard().statistics["mae"]}),
    ]
    assert len({base, *(other.digest() for other in others)}) == 6


def test_what_is_not_the_shard_asked_for_is_refused(path, tmp_path):
    block = shard().block
    check_shard(path, block, "abc")
    for other in ((replace(block, replicate=3), "abc"), (block, "abd")):
        with pytest.raises(DataMissingError, match="is not what its name says"):
            check_shard(path, *other)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(DataMissingError, match="is not as it was written"):
        check_shard(path, block, "abc")
    with pytest.raises(DataMissingError, match="No such file"):
        check_shard(tmp_path / "none.h5", block, "abc")
    assert identity_of(path) is None


@pytest.mark.parametrize("name", ["draws", "status", "steps", "statistics"])
@pytest.mark.parametrize("value", [np.zeros((1, 4)), np.full((3, 4), b"text"), 1.0, None])
def test_another_content_under_our_seal_is_refused(path, name, value):
    image = io.BytesIO(unsealed(path))
    with h5py.File(image, "r+") as root:
        del root[name]
        if value is not None:
            root[name] = value
    path.write_bytes(sealed(image.getvalue()))
    with pytest.raises(DataMissingError, match=r"is not what its name says|is damaged"):
        check_shard(path, shard().block, "abc")


def test_files_are_listed_in_canonical_order(tmp_path):
    blocks = [Block("firm", 0, 0, 4), Block("box", 1, 0, 4), Block("box", 0, 4, 4), Block("box", 0, 0, 4)]
    for block in blocks:
        (tmp_path / block.file_name).touch()
    (tmp_path / ".box-r000-d00000000-n4.1-ab.h5").touch()
    (tmp_path / "other.h5").touch()
    assert [path.name for path in shard_files(tmp_path)] == [block.file_name for block in sorted(blocks)]
    assert shard_files(tmp_path / "none") == []
