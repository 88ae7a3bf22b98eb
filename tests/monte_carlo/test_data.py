"""What is written of an ensemble comes back in canonical order; what is missing or damaged is named."""

import numpy as np
import pytest
from support.fake_batch import DRAWS, small_study

from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import SHARDS, Block, read_array, read_ensemble, shard_files, shard_image


def test_data_stand_in_canonical_order(unbroken):
    data, study = read_ensemble(unbroken), small_study()
    assert len(data) == DRAWS
    assert (np.diff(data.replicate) >= 0).all()
    held = {
        name: [read_array(path, name) for path in shard_files(unbroken / SHARDS)]
        for name in ("draws", "status", "mae")
    }
    np.testing.assert_array_equal(data.draws, np.concatenate(held["draws"]))
    for (name, reading), place in study.lookup.items():
        codes, sizes = ([values[place] for values in held[key]] for key in ("status", "mae"))
        np.testing.assert_array_equal(data.status(name, reading), np.concatenate(codes))
        expected = np.concatenate(sizes).astype(np.float64)
        np.testing.assert_array_equal(data.statistic(name, reading, "mae"), expected)


def test_what_is_not_there_is_missing(unbroken):
    with pytest.raises(DataMissingError, match="no population 'firm'"):
        read_ensemble(unbroken, "firm")
    with pytest.raises(DataMissingError, match="under 'start=cold'"):
        read_ensemble(unbroken).status("controller_1", "start=cold")


def test_a_large_ensemble_is_read_case_by_case(unbroken, monkeypatch):
    monkeypatch.setattr("tendonrepro.monte_carlo.data.KEPT_DRAWS", 0)
    pieces = read_ensemble(unbroken).statistic("controller_2", "printed", "mae")
    monkeypatch.undo()
    np.testing.assert_array_equal(pieces, read_ensemble(unbroken).statistic("controller_2", "printed", "mae"))


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
