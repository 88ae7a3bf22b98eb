"""Records of an ensemble: each run in its place, and an error that names its plant."""

import numpy as np
import pytest
from support.fake_batch import fake_batch, small_study

from tendonrepro.errors import TendonreproError
from tendonrepro.monte_carlo.evaluate import evaluated
from tendonrepro.monte_carlo.plan import Piece
from tendonrepro.simulation.streaming import STATISTICS

PIECE = Piece("box", np.array([5, 6, 11]))


def test_results_stand_in_the_place_of_their_draw_and_case():
    """Simulating each experiment alone gives what the records hold."""
    study = small_study()
    _, records = evaluated(study, PIECE, fake_batch)
    loops = study.populations["box"].loops(records["draws"], study.cases)
    for record, of_plant in zip(records, loops, strict=True):
        for c, loop in enumerate(of_plant):
            alone = fake_batch([loop])
            assert record["status"][c] == alone.status[0]
            for name in STATISTICS:
                np.testing.assert_array_equal(record[name][c], alone.statistics[name][0].astype(np.float32))


def test_a_draw_that_cannot_be_run_is_named(monkeypatch):
    def broken(*_):
        message = "no such arm"
        raise TendonreproError(message)

    monkeypatch.setattr("tendonrepro.experiments.loops.build_reference", broken)
    with pytest.raises(TendonreproError, match=r"plant 5 of box.*no such arm"):
        evaluated(small_study(), PIECE, fake_batch)
