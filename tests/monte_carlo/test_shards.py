"""Shards: what is written comes back, and whatever is not whole is found out."""

import numpy as np
import pytest

from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import Block, read_array, shard_files, shard_image


def test_what_is_written_comes_back(tmp_path):
    made = {"draws": np.random.default_rng(1).random((4, 2)), "mae": np.array([np.nan, np.inf], np.float32)}
    made |= {"check": np.array('{"draw": 3}')}
    (tmp_path / "x.npz").write_bytes(shard_image(made))
    for name, values in made.items():
        np.testing.assert_array_equal(read_array(tmp_path / "x.npz", name), values)
        assert read_array(tmp_path / "x.npz", name).dtype == values.dtype


@pytest.mark.parametrize("harm", [lambda image: image[:-100], lambda _: b"text", lambda _: b""])
def test_a_damaged_one_is_named(tmp_path, harm):
    path = tmp_path / "x.npz"
    path.write_bytes(harm(shard_image({"draws": np.zeros((4, 2))})))
    with pytest.raises(DataMissingError) as caught:
        read_array(path, "draws")
    assert caught.value.where == str(path)


def test_files_of_an_ensemble_are_listed_in_canonical_order(tmp_path):
    blocks = [Block("firm", 0, 0, 4), Block("box", 1, 0, 4), Block("box", 0, 4, 4), Block("box", 0, 0, 4)]
    names = [block.file_name("abc") for block in sorted(blocks)]
    for name in [*names, f".{names[0]}", "other.npz", blocks[0].file_name("of another")]:
        (tmp_path / name).touch()
    assert [path.name for path in shard_files(tmp_path, "abc")] == names
    assert len(shard_files(tmp_path)) == len(names) + 1
    assert shard_files(tmp_path / "none") == []
