"""The commands as functions, as a script uses them."""

from __future__ import annotations

import doctest
import importlib
import re
import shutil
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support import ROOT

import tendonrepro as tr
from tendonrepro.commands import FORMER
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.files import to_json
from tendonrepro.results.figures.style import NOTEBOOK_DPI
from tendonrepro.results.store import read_manifest, replaced
from tendonrepro.results.traces import read_traces

PAGE = ROOT / "docs" / "python.md"
SHORT = {"reference.periods": 1, "reference.period": 1, "reference.blend": 0.5, "control.gains.lam": 6}


@pytest.fixture(scope="module")
def found() -> tr.Result:
    return tr.compare(set=SHORT, controllers=[1, 2])


def test_every_public_name_is_there() -> None:
    for name in tr.__all__:
        assert getattr(tr, name) is not None
    with pytest.raises(AttributeError):
        _ = tr.no_such_name  # type: ignore[attr-defined]


def test_runs_are_datasets_with_units(found: tr.Result) -> None:
    assert list(found) == ["controller_1", "controller_2", "controller_1_payload"]
    run = found["controller_1"]
    assert run["e"].dims == ("time", "joint")
    assert run["tau_m"].attrs["units"] == "N m"
    with pytest.raises(KeyError):
        found["controller_3"]


def test_a_wrong_name_suggests_the_right_one_and_keys_are_offered(found: tr.Result) -> None:
    assert found._ipython_key_completions_() == [*found]
    wrong: list[tuple[Any, str, type[Exception]]] = [
        (lambda: found["controler_1"], "controller_1", KeyError),
        (lambda: found.tables["tabel2"], "table2", KeyError),
        (lambda: found.plot("fgi14"), "fig14", UsageError),
        (lambda: found.loop("controler_1"), "controller_1", KeyError),
        (lambda: tr.compare(sett={}), "set", TypeError),  # type: ignore[call-arg]
        (lambda: tr.ensemble(drawss=64), "draws", TypeError),  # type: ignore[call-arg]
        (lambda: tr.comparee, "compare", AttributeError),  # type: ignore[attr-defined]
    ]
    for call, right, kind in wrong:
        with pytest.raises(kind) as raised:
            call()
        assert f"{right!r}" in str(raised.value)


def test_tables_hold_the_numbers_of_the_runs(found: tr.Result) -> None:
    table = found.tables["table2"].set_index(["run", "joint"])
    for run in ("controller_1", "controller_2"):
        mae = np.rad2deg(np.abs(found[run]["e"]).mean("time"))
        assert table.loc[(run, 2), "mae_deg"] == pytest.approx(float(mae.sel(joint=2)))
        assert found.data["table2"][run]["mae_deg"][1] == pytest.approx(float(mae.sel(joint=3)))


def test_figures_are_drawn_by_number(found: tr.Result) -> None:
    assert "fig14" in found.figures
    assert len(found.plot(14).axes) >= 4
    with pytest.raises(TendonreproError):
        found.plot(9)


@pytest.mark.pictures
def test_a_figure_shows_itself_in_a_notebook(found: tr.Result) -> None:
    figure = found.plot(14)
    with Image.open(BytesIO(figure._repr_png_())) as image:
        assert image.format == "PNG"
        assert image.width == pytest.approx(NOTEBOOK_DPI * figure.get_figwidth(), abs=1)
        assert np.ptp(np.asarray(image.convert("L"))) > 200
    script = BytesIO()
    figure.savefig(script, format="png", dpi=50)
    assert script.getvalue().startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def alone() -> tr.Result:
    """One run: each takes its time to be written, read and drawn."""
    return tr.compare(set=SHORT, controllers=[2])


@pytest.fixture(scope="module")
def saved(alone: tr.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return alone.save(tmp_path_factory.mktemp("api") / "compare")


def test_what_is_saved_is_opened_again(alone: tr.Result, found: tr.Result, saved: Path) -> None:
    assert {"traces.h5", "tables/table2.csv", "figures/fig14.png"} <= read_manifest(saved)["outputs"].keys()
    again = tr.open(str(saved))
    assert to_json(again.data) == to_json(alone.data)
    assert (again["controller_2"]["e"] == alone["controller_2"]["e"]).all()
    thesis = saved.with_name("thesis.docx")
    thesis.touch()
    wrong: list[tuple[Path, dict[str, Any]]] = [
        (saved, {}),
        (thesis, {"force": True}),
        (saved.with_name("other"), {"formats": "jpg"}),
        (saved.with_name("other"), {"formats": "png", "figures": False}),
    ]
    for folder, options in wrong:
        with pytest.raises(UsageError):
            found.save(folder, **options)
    assert not saved.with_name("other").exists()


def test_traces_hold_the_manifest_without_outputs_also_when_saved_from_a_folder(tmp_path: Path) -> None:
    found = tr.compare(set=SHORT, controllers=[2], out=tmp_path / "first", figures=False)
    copy = found.save(tmp_path / "copy", figures=False)
    for folder in (tmp_path / "first", copy):
        assert "outputs" in read_manifest(folder)
        assert "outputs" not in read_traces(folder).manifest


def test_a_study_opened_again_is_saved_with_the_figures_that_it_has(tmp_path: Path) -> None:
    with replaced(tmp_path / "first", "a", command="statics") as made:
        for name in ("statics.json", "figures/statics.png", "figures/statics.txt"):
            made.write(name, "{}")
        made.manifest = {"command": "statics", "config": {"sha256": "a"}, "figure_formats": ["png"]}
    opened = tr.open(tmp_path / "first")
    files = {"statics.json", "figures/statics.png", "figures/statics.txt"}
    cases: list[tuple[dict[str, Any], set[str], list[str]]] = [
        ({}, files, ["png"]),
        ({"figures": False}, {"statics.json"}, []),
    ]
    for options, kept, formats in cases:
        folder = opened.save(tmp_path / f"saved{len(options)}{len(kept)}", **options)
        assert read_manifest(folder)["outputs"].keys() == kept
        assert read_manifest(folder)["figure_formats"] == formats
        again = tr.open(folder).save(tmp_path / f"again{len(options)}{len(kept)}")
        assert read_manifest(again)["outputs"].keys() == kept
    with pytest.raises(UsageError):
        opened.save(tmp_path / "png", formats="png")
    assert not (tmp_path / "png").exists()


def test_examples_in_docstrings_are_true() -> None:
    package = Path(tr.__file__).parent
    found = [path for path in sorted(package.rglob("*.py")) if ">>> " in path.read_text(encoding="utf-8")]
    assert found
    for path in found:
        parts = path.relative_to(package.parent).with_suffix("").parts
        module = importlib.import_module(".".join(parts).removesuffix(".__init__"))
        assert doctest.testmod(module).failed == 0, path


@pytest.mark.slow
@pytest.mark.skipif(not PAGE.exists(), reason="no docs folder beside the package")
def test_the_examples_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.S | re.M):
        exec(block, names)
    assert (tmp_path / "reports" / "mine" / "manifest.json").exists()


def test_a_former_function_names_the_new_command() -> None:
    with pytest.raises(AttributeError, match=FORMER["figures"]):
        _ = tr.figures  # type: ignore[attr-defined]


def test_tables_are_those_of_the_folder_named_and_of_no_folder_in_it(saved: Path, tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    for folder in (tmp_path, inner):
        shutil.copy(saved / "traces.h5", folder)
    assert {path.parent.parent for path in tr.redraw(tmp_path, figures=False)} == {tmp_path}
    (tmp_path / "traces.h5").unlink()
    assert {path.parent.parent for path in tr.redraw(tmp_path, figures=False)} == {inner}


@pytest.mark.parametrize(
    ("options", "suffixes"),
    [
        ({"figures": False}, []),
        pytest.param({"formats": "svg"}, ["svg"], marks=pytest.mark.slow),
        pytest.param({"formats": ["png", "svg"]}, ["png", "svg"], marks=pytest.mark.slow),
    ],
)
def test_a_result_is_saved_in_the_formats_asked_for(
    alone: tr.Result, tmp_path: Path, options: dict[str, Any], suffixes: list[str]
) -> None:
    folder = alone.save(tmp_path / "saved", **options)
    drawn = {path.suffix.removeprefix(".") for path in folder.glob("figures/*")}
    assert drawn == {*suffixes, *(["txt"] if suffixes else [])}
    assert read_manifest(folder)["figure_formats"] == suffixes
    assert tr.open(folder).manifest["config"] == alone.manifest["config"]
    made = tr.redraw(folder, ["14"], formats=["svg"])
    assert {*made} == {folder / "figures" / name for name in ("fig14.svg", "fig14.txt")}, "and no tables"
    assert read_manifest(folder)["figure_formats"] == (suffixes or ["svg"])


@pytest.mark.slow
def test_reproduce_in_a_script_without_a_main_guard(tmp_path: Path) -> None:
    script = tmp_path / "all.py"
    script.write_text("import tendonrepro as tr\nprint(*tr.reproduce('out'))\n", encoding="utf-8")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["decouple", "compare", "closest"]


@pytest.mark.parametrize(
    ("command", "arguments", "named"),
    [
        ("compare", {"set": "no_such_key=1"}, "no_such_key"),
        ("compare", {"controllers": 9}, "9"),
        ("sweep", {"over": "no_such_key=1,2"}, "no_such_key"),
        ("predict", {"readings": ["printed", "no_such=reading"]}, "no_such"),
        ("identify", {"readings": ["no_such=reading"]}, "no_such"),
        ("tune", {"only": ["ntsm", "no_such_law"]}, "no_such_law"),
    ],
)
def test_one_of_several_needs_no_list_and_a_list_no_commas(
    command: str, arguments: dict[str, Any], named: str
) -> None:
    """A text is not taken for a sequence of letters, nor a list of names for one odd name."""
    with pytest.raises(TendonreproError) as raised:
        getattr(tr, command)(**arguments)
    assert named in str(raised.value)


def test_files_are_given_one_by_one(tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        lines = ["t (s),q2 (deg)", *(f"{0.1 * k:.1f},{k}" for k in range(50))]
        (tmp_path / name).write_text("\n".join(lines), encoding="utf-8")
    found = tr.inspect(tmp_path / "a.csv", tmp_path / "b.csv", mapping=tmp_path / "mapping.yaml")
    assert found
    with pytest.raises(TypeError):
        tr.inspect(tmp_path / "a.csv", maping=tmp_path / "mapping.yaml")
