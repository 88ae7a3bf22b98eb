"""One block: what is shared among its loops changes nothing, and the spot check finds what differs."""

import numpy as np
import pytest
from support.fake_batch import DRAWS, fake_batch, small_study

from tendonrepro.errors import TendonreproError
from tendonrepro.monte_carlo.block import compute_blocks, loops_of
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
