"""What is read of an ensemble on disk stands in canonical order, and what is not there is named."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from support.damage import by_chance, of_another_shape
from support.fake_batch import DRAWS, read_shard, run_ensemble_of, small_study

from tendonrepro.ensemble.data import PLAN, NotFinishedError, read_ensemble
from tendonrepro.ensemble.shards import FOLDER, shard_files
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import digest_of


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


def test_what_is_not_there_is_missing(unbroken):
    with pytest.raises(DataMissingError, match="no population 'firm'"):
        read_ensemble(unbroken, "firm")
    with pytest.raises(DataMissingError, match="no statistic 'mean'"):
        read_ensemble(unbroken).statistic("controller_1", "printed", "mean")
    with pytest.raises(DataMissingError, match="under 'start=cold'"):
        read_ensemble(unbroken).status("controller_1", "start=cold")


def test_shards_of_an_older_version_say_so(unbroken, monkeypatch):
    monkeypatch.setattr("tendonrepro.ensemble.data.STATISTICS", ("mae", "later"))
    data = read_ensemble(unbroken)
    with pytest.raises(
        DataMissingError, match=r"older version, which did not keep statistics/later"
    ) as caught:
        data.statistic("controller_1", "printed", "later")
    assert "run tendonrepro ensemble --force" in caught.value.hint
    assert np.isfinite(data.statistic("controller_1", "printed", "mae")).all()


def test_blocks_that_are_replaced_while_they_are_read_are_told(unbroken, tmp_path):
    shutil.copytree(unbroken, tmp_path / "first")
    run_ensemble_of(tmp_path / "other", replace(small_study(), seed=77))
    data = read_ensemble(tmp_path / "first")
    shutil.rmtree(tmp_path / "first" / FOLDER)
    shutil.copytree(tmp_path / "other" / FOLDER, tmp_path / "first" / FOLDER)
    with pytest.raises(DataMissingError, match="was written anew, of another ensemble"):
        data.statistic("controller_1", "printed", "mae")


def test_what_is_not_finished_is_no_damage(tmp_path):
    with pytest.raises(NotFinishedError, match="holds no ensemble"):
        read_ensemble(tmp_path)


def everything(folder):
    """All that a reader of the small ensemble may ask for; the name of the file that is told as damaged."""
    try:
        data = read_ensemble(folder)
        codes = [data.status(*case) for case in small_study().lookup]
        sizes = [data.statistic(*case, "rmse") for case in small_study().lookup]
    except NotFinishedError:
        return None
    except DataMissingError as error:
        return error.where if error.exit_code == 4 and "run the same" in error.hint else None
    return data.names, data.alpha, data.lookup, *map(np.ndarray.tolist, [data.draws, *codes, *sizes])


@pytest.mark.parametrize(
    "forged",
    [
        {"blocks": "abc"},
        {"blocks": []},
        {"replicates": 0},
        {"lookup": [["controller_1", "printed", 100_000]]},
        {"lookup": "abc"},
        {"populations": None},
        {"joints": 2},
    ],
)
def test_a_plan_that_does_not_fit_is_refused_though_its_digest_does(unbroken, forged):
    plan = json.loads((unbroken / PLAN).read_text()) | forged
    del plan["sha256"]
    (unbroken / PLAN).write_text(json.dumps(plan | {"sha256": digest_of(plan)}))
    with pytest.raises(DataMissingError, match="is not of an ensemble of this version"):
        read_ensemble(unbroken).status("controller_1", "printed")


def test_a_damaged_file_is_named_and_never_read_as_something_else(unbroken):
    before = everything(unbroken)
    plan, shard, other = unbroken / PLAN, *shard_files(unbroken / FOLDER)[3:5]
    images = {path: [by_chance(path.read_bytes(), seed) for seed in range(60)] for path in (plan, shard)}
    images[plan] += of_another_shape(plan.read_bytes())
    images[shard] += [b"", b"text", other.read_bytes()]
    for path, found in images.items():
        whole = path.read_bytes()
        for image in found:
            path.write_bytes(image)
            # Damage between the words of JSON changes nothing.
            assert everything(unbroken) in (str(path), before), image
        path.write_bytes(whole)
