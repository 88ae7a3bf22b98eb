"""A study on many plants: what it is known by, what it tells, what it keeps."""

from dataclasses import replace

import pytest

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.console import Talk
from tendonrepro.monte_carlo.kept import study_on_plants
from tendonrepro.monte_carlo.plan import identity_of
from tendonrepro.simulation.resolution import COMPILED_STEPPER
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site


@pytest.mark.parametrize(("averages", "told"), [("errors are of whole runs", True), ("", False)])
def test_a_start_that_comparisons_leave_out_is_told_where_it_counts(tmp_path, capsys, averages, told):
    loaded, folders = load_ensemble(None, overrides=["base.errors_from=2"]), []

    def run(_, kept):
        folders.append(kept)
        return Result({}, [])

    study = study_on_plants("x", loaded, "0123" * 16, run, {}, cost={}, averages=averages)
    found = study.run(Site(Talk(), tmp_path))
    assert ("errors_from" in capsys.readouterr().err) == told
    assert folders == [tmp_path / study.keep]
    assert found.manifest["solver"]["name"] == COMPILED_STEPPER


def test_what_was_kept_by_other_code_or_arguments_is_not_gone_on_with():
    loaded = load_ensemble(None)
    others = [
        identity_of(loaded, "tuning"),
        identity_of(loaded, seed=1),
        identity_of(replace(loaded, sha256="other")),
        identity_of(replace(loaded, base=replace(loaded.base, sha256="other"))),
    ]
    assert len({identity_of(loaded), *others}) == 5
    assert identity_of(loaded) == identity_of(load_ensemble(None))
