"""One block: what is shared among its loops changes nothing, and the spot check finds what differs."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from support.fake_batch import DRAWS, fake_batch, fingerprint, small_study

from tendonrepro.config.models.readings import under
from tendonrepro.ensemble.block import compute_block, loops_of, spot_check
from tendonrepro.ensemble.command import load_study
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.metrics import mae, rmse
from tendonrepro.simulation.streaming import STATISTICS


def test_a_study_can_be_sent_to_other_processes():
    study = small_study()
    sent = pickle.loads(pickle.dumps(study))
    assert sent.identity == study.identity
    block = study.blocks(DRAWS)[0]
    assert compute_block(sent, block, fake_batch).digest() == compute_block(study, block, fake_batch).digest()


def test_shared_loops_equal_loops_built_anew():
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


def block_values(study):
    return compute_block(replace(study, readings=study.readings[:1]), study.blocks(512)[0], fake_batch).draws


def test_results_stand_in_the_place_of_their_draw_and_case():
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


def test_a_draw_that_cannot_be_run_is_named(monkeypatch):
    def broken(*_):
        message = "no such arm"
        raise TendonreproError(message)

    monkeypatch.setattr("tendonrepro.ensemble.block.configured", broken)
    study = small_study()
    block = study.blocks(DRAWS)[0]
    with pytest.raises(TendonreproError, match=f"{block.file_name}.*no such arm"):
        compute_block(study, block, fake_batch)


def reference_with(e):
    """A SciPy stepper whose runs all have this error."""

    def simulate(loop):
        # Slow enough not to ring.
        time = loop.reference.time
        return {"time": time, "e": np.broadcast_to(e, (time.size, 2))}

    return simulate


def batch_with(e, status, factor):
    """A batch stepper that finds the same error times a factor."""

    def simulate(loops, limits):
        found = fake_batch(loops, limits)
        sizes = {"mae": mae(e[None]), "rmse": factor * rmse(e[None])}
        statistics = {name: np.tile(size, (len(loops), 1)) for name, size in sizes.items()}
        return replace(found, statistics=statistics, status=np.full(len(loops), status, np.int8))

    return simulate


def test_the_spot_check_finds_what_differs(monkeypatch):
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


def test_about_one_block_in_so_many_is_checked(monkeypatch):
    e = np.array([0.004, -0.003])
    monkeypatch.setattr("tendonrepro.ensemble.block.simulate", reference_with(e))
    study = replace(small_study(), check_every=8)
    values = compute_block(small_study(), study.blocks(DRAWS)[0], fake_batch).draws
    checks = [spot_check(study, block, values, batch_with(e, 0, 1.0)) for block in study.blocks(1024)]
    chosen = [check for check in checks if check]
    assert 0.5 / 8 <= len(chosen) / len(checks) <= 2.0 / 8
    assert len({(check["run"], check["reading"], check["draw"]) for check in chosen}) > len(chosen) // 3
    assert not any(spot_check(replace(study, check_every=0), block, values) for block in study.blocks(DRAWS))


def test_the_order_of_blocks_does_not_matter():
    study = small_study()
    blocks = study.blocks(DRAWS)[:6]

    def found(order):
        return {block.file_name: compute_block(study, block, fake_batch).digest() for block in order}

    shuffled = [blocks[k] for k in np.random.default_rng(1).permutation(len(blocks))]
    assert found(shuffled) == found(blocks)
