"""The stored results are of the readings, claims, configuration and physics of today.

A reading, a claim or a change of physics needs them made again: docs/results.md says how.
"""

from __future__ import annotations

from support.pages import NEEDS_DOCS, stored

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.models.readings import default_readings
from tendonrepro.monte_carlo.plan import code_digest
from tendonrepro.verdicts.judge import Sources, judge_all

pytestmark = NEEDS_DOCS

PHYSICS = "physics_sha256"
"""Key of the digest of the physics that made a result; older searches lack it."""


def test_every_reading_was_drawn_and_searched() -> None:
    found = {name: held["readings"] for name, held in stored("ensemble")["populations"].items()}
    assert found.keys() == load_ensemble(None).config.populations.keys()
    today = {reading.name for reading in default_readings(load_ensemble(None).config.pairs)}
    for name, readings in [*found.items(), ("identify", stored("identify")["readings"])]:
        assert {reading["name"] for reading in readings} == today, name


def test_the_ensemble_is_of_the_shipped_configuration() -> None:
    assert stored("ensemble")["config_sha256"] == load_ensemble(None).sha256


def test_every_claim_was_judged_by_that_ensemble() -> None:
    ledger, ensemble = stored("claims"), stored("ensemble")
    entries = {entry["id"]: entry for entry in ledger["claims"]}
    assert list(entries) == [verdict.id for verdict in judge_all(Sources())]
    assert ledger["ensemble"]["draws"] == ensemble["draws"]
    assert all(held["draws"] <= ensemble["draws"] for held in stored("decides").values())


def test_results_were_made_by_the_physics_of_today() -> None:
    searches = {held[PHYSICS] for held in stored("identify")["readings"] if PHYSICS in held}
    assert searches | {stored(name)[PHYSICS] for name in ("ensemble", "tune")} == {code_digest("physics")}


def test_no_tuned_law_lost_to_its_special_case() -> None:
    assert stored("tune")["lost_to_special_case"] == []
