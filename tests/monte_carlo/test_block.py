"""One block: what is shared among its loops changes nothing, and the spot check finds what differs."""

from dataclasses import replace

import numpy as np
import pytest
from support.fake_batch import DRAWS, fake_batch, small_study

from tendonrepro.errors import TendonreproError
from tendonrepro.monte_carlo.block import compute_blocks, loops_of, spot_check
from tendonrepro.physics.metrics import mae, rmse
from tendonrepro.simulation.streaming import STATISTICS


def test_results_stand_in_the_place_of_their_draw_and_case():
    """Simulating each experiment alone gives what the block holds."""
    study = small_study()
    block = study.blocks(DRAWS)[3]
    (shard,) = compute_blocks(study, [block], fake_batch)
    for k, loops in enumerate(loops_of(study, block, shard["draws"])):
        for c, loop in enumerate(loops):
            alone = fake_batch([loop], None)
            assert shard["status"][c, k] == alone.status[0]
            for name in STATISTICS:
                np.testing.assert_array_equal(shard[name][c, k], alone.statistics[name][0].astype(np.float32))


def test_a_draw_that_cannot_be_run_is_named(monkeypatch):
    def broken(*_):
        message = "no such arm"
        raise TendonreproError(message)

    monkeypatch.setattr("tendonrepro.experiments.loops.build_reference", broken)
    study = small_study()
    block = study.blocks(DRAWS)[0]
    with pytest.raises(TendonreproError, match=f"{block}.*no such arm"):
        compute_blocks(study, [block], fake_batch)


E_TRUE = np.array([0.004, -0.003])


@pytest.fixture
def scipy_finds_e(monkeypatch):
    """A SciPy stepper whose runs all have this error, too slow to ring."""

    def simulate(loop):
        time = loop.reference.time
        return {"time": time, "e": np.broadcast_to(E_TRUE, (time.size, 2))}

    monkeypatch.setattr("tendonrepro.monte_carlo.block.simulate", simulate)


def batch_with(status, factor):
    """A batch stepper that finds the same error times a factor."""

    def simulate(loops, limits):
        found = fake_batch(loops, limits)
        sizes = {"mae": mae(E_TRUE[None]), "rmse": factor * rmse(E_TRUE[None])}
        statistics = {name: np.tile(size, (len(loops), 1)) for name, size in sizes.items()}
        return replace(found, statistics=statistics, status=np.full(len(loops), status, np.int8))

    return simulate


@pytest.mark.usefixtures("scipy_finds_e")
def test_the_spot_check_finds_what_differs():
    study = replace(small_study(), check_every=1)
    block = study.blocks(DRAWS)[0]
    (shard,) = compute_blocks(small_study(), [block], fake_batch)
    values = shard["draws"]

    def check(status, factor):
        return spot_check(study, block, values, batch_with(status, factor))["difference"]

    assert check(0, 1.0) == pytest.approx(0, abs=1e-12)
    assert check(0, 1.001) == pytest.approx(1e-3)
    assert check(1, 1.0) is None
    assert check(3, 2.0) == 0.0


@pytest.mark.usefixtures("scipy_finds_e")
def test_about_one_block_in_so_many_is_checked():
    study = replace(small_study(), check_every=8)
    (shard,) = compute_blocks(small_study(), study.blocks(DRAWS)[:1], fake_batch)
    values = shard["draws"]
    checks = [spot_check(study, block, values, batch_with(0, 1.0)) for block in study.blocks(512)]
    chosen = [check for check in checks if check]
    assert 0.5 / 8 <= len(chosen) / len(checks) <= 2.0 / 8
    assert len({(check["run"], check["reading"], check["draw"]) for check in chosen}) > len(chosen) // 3
    assert not any(spot_check(replace(study, check_every=0), block, values) for block in study.blocks(DRAWS))
