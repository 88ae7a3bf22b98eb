"""A study on many plants: what it is known by, what it tells, what it keeps."""

import numpy as np
import pytest

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.console import Talk
from tendonrepro.monte_carlo.kept import still_missing, study_on_plants
from tendonrepro.results.record_store import RecordStore
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


def test_a_piece_that_lacks_a_record_is_run_whole(tmp_path):
    store = RecordStore(tmp_path / "records.npy", np.dtype([("x", float)]), 6)
    store.put([0, 1, 2], np.zeros(3, store.dtype))
    whole, part, none = np.arange(6).reshape(3, 2)
    assert [*map(list, still_missing([whole, part, none], store))] == [[*part], [*none]]
