"""The ensemble's machinery: results depend on the plan alone, and no shard is lost or trusted blindly."""

from __future__ import annotations

import errno
import json
import pickle
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_batch import DRAWS, fake_batch, fingerprint, small_study

from tendonrepro import files
from tendonrepro.config.models.readings import RUNS, under
from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.ensemble.block import compute_block, loops_of, spot_check
from tendonrepro.ensemble.command import load_study, run_ensemble, run_study
from tendonrepro.ensemble.data import missing_blocks, read_ensemble
from tendonrepro.ensemble.plan import Study
from tendonrepro.ensemble.shards import FOLDER, read_shard, shard_files
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.metrics import mae, rmse
from tendonrepro.simulation.batch import Batch
from tendonrepro.simulation.stepper import Loop
from tendonrepro.simulation.streaming import STATISTICS

QUIET = Talk(quiet=True)


def run(folder: Path, study: Study | None = None, draws: int = DRAWS, **options: Any) -> dict[str, Any]:
    arguments = {"jobs": 1, "talk": QUIET, "simulate": fake_batch} | options
    return run_study(study or small_study(), draws, folder, **arguments)


def digests(folder: Path) -> dict[str, str]:
    return {path.name: read_shard(path).digest() for path in shard_files(folder / FOLDER)}


def results(folder: Path) -> dict[str, bytes]:
    """Tables, byte for byte."""
    return {path.name: path.read_bytes() for path in sorted((folder / "tables").iterdir())}


@pytest.fixture(scope="module", autouse=True)
def no_figures() -> Iterator[None]:
    """Figures take most of the time and have tests of their own."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("tendonrepro.ensemble.command.draw_ensemble_figures", lambda *_: [])
        yield


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unbroken")
    run(folder)
    return folder


# ---- The plan ----------------------------------------------------------------------------------------------


def test_blocks_hold_every_draw_once() -> None:
    study = load_study(None, (), None, "default")
    blocks = study.blocks(4096)
    for population, share in study.shares.items():
        held = [
            (block.replicate, block.first + k)
            for block in blocks
            if block.population == population
            for k in range(block.count)
        ]
        each = int(4096 * share) // study.replicates
        assert sorted(held) == [(r, k) for r in range(study.replicates) for k in range(each)]
    assert len({block.file_name for block in blocks}) == len(blocks)


def test_more_draws_keep_the_blocks_of_fewer() -> None:
    study = replace(small_study(), block_draws=8)
    assert set(study.blocks(64)) < set(study.blocks(256))


@pytest.mark.parametrize("draws", [0, -8, 8, 32, 65, 96, 1000])
def test_impossible_draws_are_refused(draws: int) -> None:
    with pytest.raises(UsageError, match="power of two from 64 on") as caught:
        small_study().blocks(draws)
    suggested = int(str(caught.value.hint).split()[0])
    assert small_study().blocks(suggested)


def test_every_case_is_simulated_once() -> None:
    study = load_study(None, (), None, "default")
    assert len(set(study.cases)) == len(study.cases)
    assert all((name, reading.name) in study.lookup for name in RUNS for reading in study.readings)
    # The weights are Controller 1's alone: under another weight the others are as printed.
    for name in ("controller_2", "controller_3"):
        assert study.lookup[name, "weights=extrapolating"] == study.lookup[name, "printed"]
    assert study.lookup["controller_1", "weights=extrapolating"] != study.lookup["controller_1", "printed"]
    assert ("controller_2", "M_bar=halved") in study.lookup
    assert ("controller_1", "M_bar=halved") not in study.lookup


@pytest.mark.parametrize(
    "change",
    [{"seed": 99}, {"replicates": 16}, {"sha256": "other"}, {"check_every": 3}, {"readings": ()}],
    ids=lambda change: next(iter(change)),
)
def test_identity_holds_what_numbers_depend_on(change: dict[str, Any]) -> None:
    study = small_study()
    if "readings" in change:
        change = {"readings": study.readings[:2]}
    assert replace(study, **change).identity != study.identity
    assert replace(study).identity == study.identity


def test_a_study_can_be_sent_to_other_processes() -> None:
    study = small_study()
    sent = pickle.loads(pickle.dumps(study))
    assert sent.identity == study.identity
    block = study.blocks(DRAWS)[0]
    assert compute_block(sent, block, fake_batch).digest() == compute_block(study, block, fake_batch).digest()


# ---- One block ---------------------------------------------------------------------------------------------


def test_shared_loops_equal_loops_built_anew() -> None:
    study = load_study(None, (), None, "default")
    block = study.blocks(512)[0]
    box = study.boxes["box"]
    for row in block_values(study)[:2]:
        from tendonrepro.ensemble.box import configured

        config, draw = configured(study.base, box, row), box.named(row)
        for (name, case), loop in zip(study.cases, loops_of(study, block, row), strict=True):
            plain = dict(build_loops(under(case, config, draw), study.base.folder))[name]
            assert fingerprint(loop) == fingerprint(plain), (name, case.name)
            np.testing.assert_array_equal(loop.reference.q_d, plain.reference.q_d)


def block_values(study: Study) -> np.ndarray:
    return compute_block(replace(study, readings=study.readings[:1]), study.blocks(512)[0], fake_batch).draws


def test_results_stand_in_the_place_of_their_draw_and_case() -> None:
    """Simulating each experiment alone gives what the block holds."""
    study = small_study()
    block = study.blocks(DRAWS)[3]
    shard = compute_block(study, block, fake_batch)
    for k, row in enumerate(shard.draws):
        for c, loop in enumerate(loops_of(study, block, row)):
            alone = fake_batch([loop], None)
            assert shard.status[c, k] == alone.status[0]
            for name in STATISTICS:
                np.testing.assert_array_equal(
                    shard.statistics[name][c, k], alone.statistics[name][0].astype(np.float32)
                )


def test_a_draw_that_cannot_be_run_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        message = "no such arm"
        raise TendonreproError(message)

    monkeypatch.setattr("tendonrepro.ensemble.block.configured", broken)
    study = small_study()
    block = study.blocks(DRAWS)[0]
    with pytest.raises(TendonreproError, match=f"{block.file_name}.*no such arm"):
        compute_block(study, block, fake_batch)


def reference_with(e: np.ndarray) -> Any:
    """A reference stepper whose runs all have this error."""

    def simulate(loop: Loop) -> dict[str, np.ndarray]:
        # Slow enough not to ring.
        time = loop.reference.time
        return {"time": time, "e": np.broadcast_to(e, (time.size, 2))}

    return simulate


def batch_with(e: np.ndarray, status: int, factor: float) -> Any:
    """A batch stepper that finds the same error times a factor."""

    def simulate(loops: Sequence[Loop], limits: Any) -> Batch:
        found = fake_batch(loops, limits)
        sizes = {"mae": mae(e[None]), "rmse": factor * rmse(e[None])}
        statistics = {name: np.tile(size, (len(loops), 1)) for name, size in sizes.items()}
        return replace(found, statistics=statistics, status=np.full(len(loops), status, np.int8))

    return simulate


def test_the_spot_check_finds_what_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    e = np.array([0.004, -0.003])
    monkeypatch.setattr("tendonrepro.ensemble.block.simulate", reference_with(e))
    study = replace(small_study(), check_every=1)
    block = study.blocks(DRAWS)[0]
    values = compute_block(small_study(), block, fake_batch).draws
    same, other = (spot_check(study, block, values, batch_with(e, 0, 1.0 + d)) for d in (0.0, 1e-3))
    assert (same["ideal"], same["quantised"], same["disagreements"]) == pytest.approx((0, 0, 0), abs=1e-12)
    assert other["ideal"] == pytest.approx(1e-3)
    assert other["quantised"] == pytest.approx(1e-3)
    ringing = spot_check(study, block, values, batch_with(e, 1, 1.0))
    assert ringing["disagreements"] == 2
    unresolved = spot_check(study, block, values, batch_with(e, 3, 2.0))
    assert (unresolved["disagreements"], unresolved["quantised"]) == (0, 0.0)


def test_about_one_block_in_so_many_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    e = np.array([0.004, -0.003])
    monkeypatch.setattr("tendonrepro.ensemble.block.simulate", reference_with(e))
    study = replace(small_study(), check_every=8)
    values = compute_block(small_study(), study.blocks(DRAWS)[0], fake_batch).draws
    checks = [spot_check(study, block, values, batch_with(e, 0, 1.0)) for block in study.blocks(1024)]
    chosen = [check for check in checks if check]
    assert 0.5 / 8 <= len(chosen) / len(checks) <= 2.0 / 8
    assert len({(check["run"], check["reading"], check["draw"]) for check in chosen}) > len(chosen) // 3
    assert not any(spot_check(replace(study, check_every=0), block, values) for block in study.blocks(DRAWS))


# ---- Order, jobs, interruptions ----------------------------------------------------------------------------


def test_the_order_of_blocks_does_not_matter() -> None:
    study = small_study()
    blocks = study.blocks(DRAWS)[:6]

    def found(order: Sequence[Any]) -> dict[str, str]:
        return {block.file_name: compute_block(study, block, fake_batch).digest() for block in order}

    shuffled = [blocks[k] for k in np.random.default_rng(1).permutation(len(blocks))]
    assert found(shuffled) == found(blocks)


def test_jobs_do_not_matter(unbroken: Path, tmp_path: Path) -> None:
    summary = run(tmp_path, jobs=2)
    assert digests(tmp_path) == digests(unbroken)
    assert results(tmp_path) == results(unbroken)
    assert summary["resumed_from"] == 0


class Stop(BaseException):
    """An interrupt, at a known place."""


def test_an_interrupted_run_resumes_to_the_same_results(unbroken: Path, tmp_path: Path) -> None:
    calls = 0

    def until_the_fifth(loops: Any, limits: Any) -> Batch:
        nonlocal calls
        calls += 1
        if calls == 6:
            raise Stop
        return fake_batch(loops, limits)

    with pytest.raises(Stop):
        run(tmp_path, simulate=until_the_fifth)
    assert len(shard_files(tmp_path / FOLDER)) == 5
    with pytest.raises(DataMissingError, match="11 of 16 blocks are missing"):
        read_ensemble(tmp_path)
    summary = run(tmp_path)
    assert summary["resumed_from"] == 5
    assert digests(tmp_path) == digests(unbroken)
    assert results(tmp_path) == results(unbroken)


def test_a_finished_run_is_not_computed_again(unbroken: Path) -> None:
    def never(*_: object) -> Batch:
        raise AssertionError

    summary = run(unbroken, simulate=never)
    assert (summary["resumed_from"], summary["experiments_per_second"]) == (16, None)


def test_more_draws_reuse_what_is_there(tmp_path: Path) -> None:
    study = replace(small_study(), block_draws=8)
    run(tmp_path, study)
    summary = run(tmp_path, study, draws=2 * DRAWS)
    assert (summary["resumed_from"], summary["blocks"]) == (8, 16)
    assert len(read_ensemble(tmp_path)) == 2 * DRAWS
    # And fewer again leave the rest on disk.
    assert run(tmp_path, study)["resumed_from"] == 8
    assert len(read_ensemble(tmp_path)) == DRAWS
    assert len(shard_files(tmp_path / FOLDER)) == 16


def test_half_written_files_of_a_killed_process_are_removed(unbroken: Path) -> None:
    leftover = unbroken / FOLDER / ".box-r000-d00000000-n4.123-abcd.h5"
    leftover.write_bytes(b"half")
    run(unbroken)
    assert not leftover.exists()


# ---- What may be wrong with the disk -----------------------------------------------------------------------


@pytest.mark.parametrize("harm", ["truncated", "text", "swapped"])
def test_a_corrupt_shard_is_computed_again(
    unbroken: Path, harm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = digests(unbroken)
    first, second = shard_files(unbroken / FOLDER)[2:4]
    if harm == "truncated":
        first.write_bytes(first.read_bytes()[:-100])
    elif harm == "text":
        first.write_text("no shard")
    else:
        first.write_bytes(second.read_bytes())
    summary = run(unbroken, talk=Talk())
    assert summary["resumed_from"] == 15
    assert f"{first.name}: " in capsys.readouterr().err
    assert digests(unbroken) == before


def test_another_configuration_is_refused_and_kept(tmp_path: Path) -> None:
    other = replace(small_study(), seed=77)
    with pytest.raises(Stop):
        run(tmp_path, simulate=stop_after(2))
    before = digests(tmp_path)
    assert len(before) == 2
    with pytest.raises(UsageError, match="2 blocks of another configuration"):
        run(tmp_path, other)
    assert digests(tmp_path) == before
    summary = run(tmp_path, other, force=True)
    assert summary["resumed_from"] == 0
    assert not set(digests(tmp_path).values()) & set(before.values())


def stop_after(blocks: int) -> Any:
    left = blocks

    def simulate(loops: Any, limits: Any) -> Batch:
        nonlocal left
        left -= 1
        if left < 0:
            raise Stop
        return fake_batch(loops, limits)

    return simulate


def test_a_finished_ensemble_of_another_configuration_is_refused(unbroken: Path) -> None:
    before = digests(unbroken)
    with pytest.raises(UsageError, match="another configuration"):
        run(unbroken, replace(small_study(), seed=77))
    assert digests(unbroken) == before


def test_a_full_disk_loses_nothing(tmp_path: Path, unbroken: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = Path.write_bytes
    left = 4

    def write_until_full(path: Path, data: bytes) -> int:
        nonlocal left
        if path.suffix == ".h5":
            left -= 1
            if left < 0:
                write(path, data[:100])
                raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    with monkeypatch.context() as patched:
        patched.setattr(files.Path, "write_bytes", write_until_full)
        with pytest.raises(TendonreproError, match="No space left on device") as caught:
            run(tmp_path)
    assert caught.value.exit_code == 1
    assert len(digests(tmp_path)) == 4
    assert not list((tmp_path / FOLDER).glob(".*"))
    assert run(tmp_path)["resumed_from"] == 4
    assert digests(tmp_path) == digests(unbroken)


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    with pytest.raises(TendonreproError, match="cannot write into the results folder"):
        run(blocked / "ensemble")
    (tmp_path / "ensemble").mkdir()
    (tmp_path / "ensemble" / FOLDER).write_text("in the way")
    with pytest.raises(TendonreproError, match="cannot"):
        run(tmp_path / "ensemble")


# ---- What is read ------------------------------------------------------------------------------------------


def test_data_stand_in_canonical_order(unbroken: Path) -> None:
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


def test_thinning_keeps_the_first_draws_of_every_scrambling(unbroken: Path) -> None:
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


def test_what_is_not_there_is_missing(unbroken: Path, tmp_path: Path) -> None:
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


def test_the_summary_holds_what_the_contract_names(unbroken: Path) -> None:
    summary = json.loads((unbroken / "summary.json").read_text())
    assert {"schema_version", "draws", "readings", "experiments_per_second", "resumed_from"} <= summary.keys()
    assert summary["draws"] == DRAWS
    assert set(summary["laws"]["controller_1"]) >= {"ok", "ringing", "diverged"}
    assert sum(summary["laws"]["controller_1"].values()) == DRAWS
    for reading in summary["readings"]:
        for key in ("share_c1_lt_c2_lt_c3", "share_c1_best", "ratio_c1_c2", "ratio_c2_c3"):
            assert set(reading[key]) == {"all_ok", "diverged_last"}
    manifest = json.loads((unbroken / "manifest.json").read_text())
    assert manifest["experiment"] == "ensemble"
    assert all((unbroken / name).exists() for name in manifest["outputs"])


# ---- The command's function --------------------------------------------------------------------------------


def test_a_dry_run_writes_nothing_and_states_the_cost(tmp_path: Path) -> None:
    out = tmp_path / "none"
    found = run_ensemble(Request(out=out, dry_run=True), QUIET, draws=4096)
    study = load_study(None, (), None, "default")
    draws = sum(4096 * share for share in study.shares.values())
    assert found["cost"]["experiments"] == draws * len(study.cases)
    assert (found["resumed_from"], found["blocks"]) == (0, len(study.blocks(4096)))
    assert not out.exists()


def test_a_dry_run_counts_what_is_there_and_refuses_what_a_run_would(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = replace(small_study(), block_draws=8)
    run(tmp_path, study)
    asked = Request(out=tmp_path, dry_run=True)
    monkeypatch.setattr("tendonrepro.ensemble.command.load_study", lambda *_: study)
    found = run_ensemble(asked, QUIET, draws=2 * DRAWS)
    assert (found["resumed_from"], found["blocks"]) == (8, 16)
    monkeypatch.setattr("tendonrepro.ensemble.command.load_study", lambda *_: replace(study, seed=77))
    with pytest.raises(UsageError, match="another configuration"):
        run_ensemble(asked, QUIET, draws=2 * DRAWS)
    (tmp_path / "manifest.json").unlink()
    with pytest.raises(UsageError, match="holds 8 blocks of another configuration"):
        run_ensemble(asked, QUIET, draws=2 * DRAWS)


def test_all_readings_need_a_yes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    readings = load_study(None, (), None, "default").readings
    monkeypatch.setattr("tendonrepro.ensemble.command.full_cross", lambda: readings)
    with pytest.raises(UsageError, match=r"minutes of one processor and .* MB") as caught:
        run_ensemble(Request(out=tmp_path / "none"), QUIET, draws=4096, readings="all")
    assert "--yes" in str(caught.value.hint)
    assert not (tmp_path / "none").exists()


def test_a_seed_changes_the_draws() -> None:
    first, second = (replace(load_study(None, (), seed, "default"), check_every=0) for seed in (1, 2))
    small = [replace(study, readings=study.readings[:1], variations=()) for study in (first, second)]
    values = [compute_block(study, study.blocks(256)[0], fake_batch).draws for study in small]
    assert not np.array_equal(*values)


def test_missing_blocks_are_those_not_on_disk(tmp_path: Path) -> None:
    study = small_study()
    blocks = study.blocks(DRAWS)
    assert missing_blocks(tmp_path, study, blocks, QUIET) == blocks
