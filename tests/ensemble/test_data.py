"""What is read of an ensemble on disk stands in canonical order, and what is not there is named."""

import numpy as np
import pytest
from support.fake_batch import DRAWS, small_study

from tendonrepro.ensemble.data import read_ensemble
from tendonrepro.ensemble.shards import FOLDER, read_shard, shard_files
from tendonrepro.errors import DataMissingError, UsageError


def test_data_stand_in_canonical_order(unbroken):
    data, study = read_ensemble(unbroken), small_study()
    assert len(data) == DRAWS
    assert (np.diff(data.replicate) >= 0).all()
    shards = [read_shard(path) for path in shard_files(unbroken / FOLDER)]
    np.testing.assert_array_equal(data.draws, np.concatenate([shard.draws for shard in shards]))
    for (name, reading), place in study.lookup.items():
        np.testing.assert_array_equal(
            data.status(name, reading), np.concatenate([shard.status[place] for shard in shards])
        )
        np.testing.assert_array_equal(
            data.statistic(name, reading, "mae"),
            np.concatenate([shard.statistics["mae"][place] for shard in shards]).astype(np.float64),
        )


def test_thinning_keeps_the_first_draws_of_every_scrambling(unbroken):
    data, thin = read_ensemble(unbroken), read_ensemble(unbroken, stride=4)
    kept = np.concatenate([np.flatnonzero(data.replicate == r)[:2] for r in range(8)])
    np.testing.assert_array_equal(thin.draws, data.draws[kept])
    np.testing.assert_array_equal(
        thin.statistic("controller_2", "printed", "rmse"),
        data.statistic("controller_2", "printed", "rmse")[kept],
    )
    for stride in (0, 3, 16):
        with pytest.raises(UsageError, match="cannot thin"):
            read_ensemble(unbroken, stride=stride)


def test_what_is_not_there_is_missing(unbroken, tmp_path):
    with pytest.raises(DataMissingError, match="holds no ensemble"):
        read_ensemble(tmp_path)
    with pytest.raises(DataMissingError, match="no population 'firm'"):
        read_ensemble(unbroken, "firm")
    with pytest.raises(DataMissingError, match="no statistic 'mean'"):
        read_ensemble(unbroken).statistic("controller_1", "printed", "mean")
    with pytest.raises(DataMissingError, match="under 'start=cold'"):
        read_ensemble(unbroken).status("controller_1", "start=cold")
    (tmp_path / "plan.json").write_text("{")
    with pytest.raises(DataMissingError, match="not the plan"):
        read_ensemble(tmp_path)
