"""What is written of an ensemble comes back in canonical order; what is missing or damaged is named."""

import json
from itertools import product

import numpy as np
import pytest
from support.fake_batch import DRAWS, record_files, small_study

from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import PLAN, SHARDS, read_ensemble


def test_data_stand_in_canonical_order(unbroken):
    """One scrambling after another, though they take turns in the file."""
    data, study = read_ensemble(unbroken), small_study()
    assert len(data) == DRAWS
    assert (np.diff(data.replicate) >= 0).all()
    each = DRAWS // study.replicates
    samples = [study.population.sample(study.seed, r, 0, each) for r in range(study.replicates)]
    np.testing.assert_array_equal(data.draws, np.concatenate(samples))
    (path,) = record_files(unbroken)
    order = np.arange(DRAWS).reshape(each, study.replicates).T.ravel()
    records = np.load(path)[order]
    for (name, reading), place in study.lookup.items():
        np.testing.assert_array_equal(data.status(name, reading), records["status"][:, place])
        np.testing.assert_array_equal(data.statistic(name, reading, "mae"), records["mae"][:, place])


def test_what_is_not_there_is_missing(unbroken):
    with pytest.raises(DataMissingError, match="under 'start=cold'"):
        read_ensemble(unbroken).status("controller_1", "start=cold")


def as_shards(folder, old):
    """The same ensemble as versions before 28 November 2026 wrote it."""
    data, plan = read_ensemble(folder), json.loads((folder / PLAN).read_text("utf-8"))
    each, cases = 4, sorted({place: case for case, place in data.lookup.items()}.items())
    blocks = [["box", r, first, each] for r, first in product(range(4), range(0, DRAWS // 4, each))]
    (old / SHARDS).mkdir(parents=True)
    for k, (_, r, first, _) in enumerate(blocks):
        part = slice(k * each, (k + 1) * each)
        arrays = {"draws": data.draws[part]}
        arrays["status"] = np.array([data.status(*case)[part] for _, case in cases])
        arrays["mae"] = np.array([data.statistic(*case, "mae")[part] for _, case in cases], np.float32)
        name = f"box-r{r:03d}-d{first:08d}-n{each}-{plan['identity'][:12]}.npz"
        np.savez_compressed(old / SHARDS / name, **arrays)
    (old / PLAN).write_text(json.dumps(plan | {"blocks": blocks[::-1]}), "utf-8")


def test_an_ensemble_of_earlier_versions_is_read(unbroken, tmp_path):
    as_shards(unbroken, tmp_path / "old")
    new, old = read_ensemble(unbroken), read_ensemble(tmp_path / "old")
    np.testing.assert_array_equal(new.draws, old.draws)
    np.testing.assert_array_equal(new.replicate, old.replicate)
    for case in new.lookup:
        np.testing.assert_array_equal(new.status(*case), old.status(*case))
        np.testing.assert_array_equal(new.statistic(*case, "mae"), old.statistic(*case, "mae"))
    path = next((tmp_path / "old" / SHARDS).iterdir())
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataMissingError) as caught:
        read_ensemble(tmp_path / "old").status("controller_1", "printed")
    assert caught.value.where == str(path)
