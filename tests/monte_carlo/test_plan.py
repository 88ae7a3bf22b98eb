"""What an ensemble consists of: draws, cases and an identity of all that counts; each run in its place."""

from dataclasses import replace

import numpy as np
import pytest
from support.fake_batch import fake_batch, small_study

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.monte_carlo import kept, plan
from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.monte_carlo.plan import evaluated
from tendonrepro.simulation.streaming import STATISTICS


def test_pieces_hold_every_draw_once():
    """Consecutive draws of one scrambling, each of which depends on its number alone."""
    study = load_study(None, (), None, "default")
    pieces = study.pieces(4096)
    np.testing.assert_array_equal(np.sort(np.concatenate(pieces)), np.arange(4096))
    assert all(np.ptp(piece % study.replicates) == 0 for piece in pieces)
    assert max(map(len, pieces)) == 32
    last = next(piece for piece in pieces if piece[0] == 32 * 8 + 3)
    expected = study.population.sample(study.seed, 3, 0, 64)[32:]
    np.testing.assert_array_equal(study.values(last), expected)


@pytest.mark.parametrize("draws", [-8, 16, 33, 2**62])
def test_impossible_draws_are_refused(draws):
    with pytest.raises(UsageError, match="power of two from 32 to 1048576") as caught:
        small_study().check(draws)
    small_study().check(int(str(caught.value.hint).split()[0]))


def test_every_case_is_simulated_once():
    study = load_study(None, (), None, "default")
    assert len(set(study.cases)) == len(study.cases)
    assert all((name, reading.name) in study.lookup for name in RUNS for reading in study.readings)
    # The weights are Controller 1's alone: under another weight the others are as printed.
    for name in ("controller_2", "controller_3"):
        assert study.lookup[name, "weights=extrapolating"] == study.lookup[name, "printed"]
    assert study.lookup["controller_1", "weights=extrapolating"] != study.lookup["controller_1", "printed"]
    assert ("controller_2", "M_bar=halved") in study.lookup
    assert ("controller_1", "M_bar=halved") not in study.lookup
    assert ("controller_2", "encoder=ideal+sampling_period=2ms") in study.lookup
    assert ("controller_1", "encoder=ideal+sampling_period=2ms") not in study.lookup


def test_identity_holds_what_numbers_depend_on():
    study = small_study()
    loaded = study.loaded
    changes = [
        {"seed": 99},
        {"replicates": 16},
        {"readings": study.readings[:2]},
        {"loaded": replace(loaded, sha256="other")},
        {"loaded": replace(loaded, base=replace(loaded.base, sha256="other"))},
    ]
    assert len({replace(study, **change).identity for change in [{}, *changes]}) == len(changes) + 1
    assert replace(study).identity == study.identity


@pytest.mark.parametrize(
    ("module", "name", "other"),
    [
        (kept, "code_digest", lambda *_: "other"),
        (kept, "__version__", "other"),
        (plan, "STATISTICS", "other"),
    ],
)
def test_identity_holds_the_code(monkeypatch, module, name, other):
    """Shards begun by other code are not gone on with."""
    study = small_study()
    before = study.identity
    monkeypatch.setattr(module, name, other)
    assert replace(study).identity != before


PIECE = np.array([5, 6, 11])


def test_results_stand_in_the_place_of_their_draw_and_case():
    """Simulating each experiment alone gives what the records hold."""
    study = small_study()
    _, records = evaluated(study, PIECE, fake_batch)
    loops = study.population.loops(records["draws"], study.cases)
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
