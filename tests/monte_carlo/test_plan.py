"""What an ensemble consists of: every draw once, every case once, and an identity of all that counts."""

from dataclasses import replace

import pytest
from support.fake_batch import small_study

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.errors import UsageError
from tendonrepro.monte_carlo import plan
from tendonrepro.monte_carlo.ensemble import load_study


def test_blocks_hold_every_draw_once():
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


def test_more_draws_keep_the_blocks_of_fewer():
    study = replace(small_study(), block_draws=8)
    assert set(study.blocks(64)) < set(study.blocks(256))


@pytest.mark.parametrize("draws", [0, -8, 8, 16, 33, 96, 1000, 2**62, 10**30])
def test_impossible_draws_are_refused(draws):
    with pytest.raises(UsageError, match="power of two from 32 to 1048576") as caught:
        small_study().draws_of("box", draws)
    suggested = int(str(caught.value.hint).split()[0])
    assert small_study().draws_of("box", suggested) == suggested


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


@pytest.mark.parametrize("name", ["code_digest", "__version__", "STATISTICS"])
def test_identity_holds_the_code(monkeypatch, name):
    """Shards begun by other code are not gone on with."""
    study = small_study()
    before = study.identity
    monkeypatch.setattr(plan, name, {"code_digest": lambda *_: "other"}.get(name, "other"))
    assert replace(study).identity != before
