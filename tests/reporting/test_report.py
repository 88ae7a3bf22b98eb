"""What the command reads, replaces and refuses."""

import importlib
import json
import math
import shutil
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from reporting.conftest import write_experiment
from support import ROOT
from support.html_page import read_page
from support.made_ensemble import DIVERGED, PLANTS, always_ok, ensemble, random_errors, whole

from tendonrepro.configuration.models.readings import SHOWN
from tendonrepro.errors import DataMissingError
from tendonrepro.files import to_json
from tendonrepro.monte_carlo.report import COLUMNS
from tendonrepro.reporting.contents import HEAD, read_shown, rendered, shown
from tendonrepro.reporting.figures import draw_orders
from tendonrepro.reporting.page import run_report, stored_under


def test_every_result_of_a_folder_is_shown_and_says_how_to_make_it_again(results, tmp_path):
    folder = tmp_path / "reports"
    shutil.copytree(results, folder)
    calls = {"log": "tendonrepro data recover a.csv", "swept": "tendonrepro sweep --config mine.yaml"}
    for name, again in calls.items():
        write_experiment(folder, name, ["fig90"])
        path = folder / name / "manifest.json"
        manifest = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(json.dumps(manifest | {"command": name, "again": again}), encoding="utf-8")
    # No configuration decides what a log tells, and this manifest is of an older version.
    manifest["config"] = {"sha256": "0" * 64}
    (folder / "old").mkdir()
    (folder / "old" / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    shutil.copytree(results, folder / "below")
    (folder / "notes").mkdir()
    found = run_report(folder, None, force=False, again="tendonrepro report elsewhere")
    run = {name for name, origin in found["parts"].items() if origin == "run"}
    assert run == {"decouple", "compare", *calls, "old"}
    assert found["left_out"].keys() == {"below", "notes"}
    assert str(folder / "below") in found["left_out"]["below"]
    text = Path(found["path"]).read_text(encoding="utf-8")
    made = read_page(text)
    for name in calls:
        assert len(made.one(id=name).all("figure")) == 1
        assert len(made.one(id=name).all("table")) == 3
    told = unescape(text.partition("<pre>")[2].partition("</pre>")[0]).splitlines()
    assert [line for line in told if line[0] != "#"] == [*calls.values(), "tendonrepro report elsewhere"]


@pytest.mark.parametrize("name", ["compare/manifest.json", "claims/claims.json"])
def test_damage_is_one_error_that_names_the_file(name, tmp_path):
    path = tmp_path / name
    path.parent.mkdir()
    path.write_text('{"a": ', encoding="utf-8")
    with pytest.raises(DataMissingError) as caught:
        run_report(tmp_path, None, force=False)
    assert caught.value.where == str(path)


def summary_of_256():
    summary = whole(ensemble(random_errors, always_ok))
    held = summary["populations"]["box"]["readings"]
    of_answer = {
        "Delta_unit=deg+stored_torque=applied+torque_step=0.0032",
        "weights=extrapolating+reference_acceleration=absent",
        *SHOWN,
    } - {"printed"}
    held += [{**held[1], "name": name} for name in sorted(of_answer)]
    rest = dict.fromkeys(("tendonrepro_version", "config_sha256"), "0")
    rest |= {"cost": {}}
    return json.loads(json.dumps(summary | rest))


def test_what_is_stored_of_an_ensemble_is_what_is_shown_of_one(monkeypatch, tmp_path):
    """Each number to six digits; where there are no plants it is unknown."""
    folder = ROOT / "docs" / "results"
    held = read_shown(folder)
    assert {*json.loads((folder / "ensemble.json").read_text(encoding="utf-8"))} <= {*HEAD, "plants"}
    assert all(row.keys() == COLUMNS.keys() for row in held.box.values())
    summary = summary_of_256()
    summary["populations"]["box"]["readings"][0]["share_c1_smoother"]["share"] = None
    monkeypatch.syspath_prepend(ROOT / "docs")
    monkeypatch.setattr(importlib.import_module("stored_results"), "RESULTS", tmp_path)
    importlib.import_module("harvest").store_ensemble(summary)
    ours, stored = shown(summary), read_shown(tmp_path)
    assert stored.plants == ours.plants
    assert stored.box.keys() == ours.box.keys()
    for name, row in ours.box.items():
        assert stored.box[name] == pytest.approx(row, rel=1e-5, nan_ok=True)
    assert math.isnan(stored.box["printed"]["smooth"])


@pytest.mark.parametrize(
    ("source", "of_paper", "population", "origin"),
    [
        ("local", True, "box", "run"),
        ("local", False, "box", "shipped"),
        ("local", True, "my_ranges", "shipped"),
        ("shipped", True, "box", "shipped"),
    ],
)
def test_an_ensemble_is_shown_with_its_own_verdicts(source, of_paper, population, origin, tmp_path):
    """Not one of another arm or population, nor one on which no claim was judged."""
    summary = summary_of_256() | {"of_paper": of_paper}
    summary["populations"] = {population: summary["populations"]["box"]}
    ledger = json.loads((ROOT / "docs" / "results" / "claims.json").read_text(encoding="utf-8"))
    files = {
        "claims/claims.json": ledger | {"ensemble": {"source": source}},
        "ensemble/summary.json": summary,
    }
    for name, content in files.items():
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(json.dumps(content), encoding="utf-8")
    found = stored_under(tmp_path)
    assert (found.origins["claims"], found.origins["ensemble"]) == ("run", origin)
    assert (found.ensemble.plants == PLANTS) == (origin == "run")
    (tmp_path / "claims" / "claims.json").unlink()
    assert stored_under(tmp_path).origins["ensemble"] == "shipped"


def test_an_ensemble_without_a_stable_plant_is_shown():
    """A small one of a user's own may have none under some interpretation."""
    summary = whole(ensemble(random_errors, lambda *_: np.full(PLANTS, DIVERGED, np.int8)))
    held = shown(json.loads(to_json(summary)))
    row = rendered("robustness", held).splitlines()[2]
    assert row.split(" | ")[1:] == ["0", "–", "–", "–", "–", "– |"]
    draw_orders(held)
