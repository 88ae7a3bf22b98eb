"""The run: its results depend on the plan alone, and no shard is lost or trusted blindly."""

import errno
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command import answer
from support.fake_batch import (
    DRAWS,
    fake_batch,
    finished_in,
    record_files,
    results,
    run_ensemble_of,
    small_study,
)

from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.monte_carlo.data import read_ensemble
from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.results import record_store


def test_jobs_do_not_matter(unbroken, tmp_path):
    summary = run_ensemble_of(tmp_path, jobs=2)
    assert results(tmp_path) == results(unbroken)
    assert summary["resumed_from"] == 0


class Stop(KeyboardInterrupt):
    """An interrupt, at a known place."""


def stop_after(blocks):
    left = blocks

    def simulate(loops):
        nonlocal left
        left -= 1
        if left < 0:
            raise Stop
        return fake_batch(loops)

    return simulate


def test_more_draws_reuse_what_is_there(tmp_path):
    study = replace(small_study(), block_draws=4)
    run_ensemble_of(tmp_path, study)
    summary = run_ensemble_of(tmp_path, study, draws=2 * DRAWS)
    assert (summary["resumed_from"], summary["blocks"]) == (8, 16)
    assert len(read_ensemble(tmp_path)) == 2 * DRAWS
    # And fewer again leave the rest on disk.
    assert run_ensemble_of(tmp_path, study)["resumed_from"] == 8
    assert len(read_ensemble(tmp_path)) == DRAWS
    (path,) = record_files(tmp_path)
    assert len(np.load(path, mmap_mode="r")) == 2 * DRAWS


def test_the_summary_holds_what_the_contract_names(unbroken):
    summary = json.loads((unbroken / "summary.json").read_text())
    assert {"draws", "populations", "experiments_per_second", "resumed_from"} <= summary.keys()
    assert (summary["schema_version"], summary["draws"]) == (2, DRAWS)
    (population,) = summary["populations"].values()
    assert set(population["laws"]["controller_1"]) >= {"ok", "ringing", "diverged"}
    assert sum(population["laws"]["controller_1"].values()) == DRAWS
    for reading in population["readings"]:
        for key in ("share_c1_lt_c2_lt_c3", "share_c1_best", "ratio_c1_c2", "ratio_c2_c3"):
            assert set(reading[key]) == {"all_ok", "diverged_last"}
    manifest = json.loads((unbroken / "manifest.json").read_text())
    assert manifest["experiment"] == "ensemble"
    assert "ensemble.yaml" in {Path(name).name for name in manifest["inputs"]}
    assert "compiled" in manifest["solver"]["name"]
    assert all((unbroken / name).exists() for name in manifest["outputs"])


def test_a_dry_run_writes_nothing_and_states_the_cost(tmp_path):
    out = tmp_path / "none"
    found = answer("ensemble", "--draws", "4096", "--out", "none", "--dry-run", cwd=tmp_path)
    study = load_study(None, (), None, "default")
    assert found["cost"]["experiments"] == 4096 * len(study.cases)
    assert not out.exists()


def test_an_interrupted_run_resumes_to_the_same_results(unbroken, tmp_path):
    with pytest.raises(Stop):
        run_ensemble_of(tmp_path / "new", simulate=stop_after(5))
    assert len(finished_in(tmp_path / "new")) == 5 * 2
    assert not (tmp_path / "new" / "manifest.json").exists()
    with pytest.raises(DataMissingError, match="new"):
        read_ensemble(tmp_path / "new")
    assert run_ensemble_of(tmp_path / "new")["resumed_from"] == 5
    assert results(tmp_path / "new") == results(unbroken)


def test_blocks_of_an_interrupted_run_of_others_are_refused_and_kept(tmp_path):
    other = replace(small_study(), seed=77)
    with pytest.raises(Stop):
        run_ensemble_of(tmp_path / "new", simulate=stop_after(2))
    before = finished_in(tmp_path / "new")
    with pytest.raises(UsageError):
        run_ensemble_of(tmp_path / "new", other)
    assert finished_in(tmp_path / "new") == before
    assert run_ensemble_of(tmp_path / "new", other, force=True)["resumed_from"] == 0


def test_a_full_disk_loses_nothing(tmp_path, unbroken, monkeypatch):
    left = 4

    def sync(_):
        nonlocal left
        left -= 1
        if left < 0:
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(record_store.os, "fsync", sync)
        with pytest.raises(TendonreproError) as caught:
            run_ensemble_of(tmp_path / "new")
    assert caught.value.exit_code == 1
    kept = finished_in(tmp_path / "new")
    assert 4 * 2 <= len(kept) <= 5 * 2
    assert run_ensemble_of(tmp_path / "new")["resumed_from"] == len(kept) // 2
    assert results(tmp_path / "new") == results(unbroken)


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ("printed", ["printed"]),
        ("weights=extrapolating,output_delay=1", ["printed", "weights=extrapolating", "output_delay=1"]),
    ],
)
def test_readings_are_run_by_name(asked, expected):
    study = load_study(None, (), None, asked)
    assert [reading.name for reading in study.readings] == expected
    assert len(study.cases) < 12


def test_what_is_no_reading_of_the_paper_is_refused():
    for name in ("weights=sideways", "M_bar=halved"):
        with pytest.raises(UsageError):
            load_study(None, (), None, name)
