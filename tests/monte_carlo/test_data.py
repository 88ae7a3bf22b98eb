"""What is read of an ensemble on disk stands in canonical order, and what is not there is named."""

import numpy as np
import pytest
from support.fake_batch import DRAWS, small_study

from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import SHARDS, read_array, read_ensemble, shard_files


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
    with pytest.raises(DataMissingError, match="no statistic 'mean'"):
        read_ensemble(unbroken).statistic("controller_1", "printed", "mean")
    with pytest.raises(DataMissingError, match="under 'start=cold'"):
        read_ensemble(unbroken).status("controller_1", "start=cold")


def test_a_large_ensemble_is_read_case_by_case(unbroken, monkeypatch):
    monkeypatch.setattr("tendonrepro.monte_carlo.data.KEPT_DRAWS", 0)
    pieces = read_ensemble(unbroken).statistic("controller_2", "printed", "mae")
    monkeypatch.undo()
    np.testing.assert_array_equal(pieces, read_ensemble(unbroken).statistic("controller_2", "printed", "mae"))
