"""A study on many plants: what it is known by, what it tells, what it keeps."""

import pytest

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.console import Talk
from tendonrepro.monte_carlo.kept import study_on_plants
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
