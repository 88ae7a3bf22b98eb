"""A user's own numbers on a user's own arm: known factors come back, and what stays unknown is said."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.synthetic import FEW, make_compare_file

import tendonrepro as tr
from tendonrepro.arrays import Array
from tendonrepro.commands import COMMANDS
from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.ensemble import LoadedEnsemble, load_plants
from tendonrepro.configuration.load import load_config
from tendonrepro.console import QUIET
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.identification.bench import Bench, Simulated, bench_of, own_numbers
from tendonrepro.identification.report import known_rows
from tendonrepro.results.traces import write_traces
from tendonrepro.studies.lifecycle import carry_out

TRUTH = {"links.mass_2": 1.2, "winches.viscous": 0.8}
ASKED = {"budget": 150, "jobs": 1, "spread": 0.5}


def cheap(bench: Bench, plants: Array, held: object, runs: Sequence[str]) -> Simulated:
    """Errors that depend on two factors alone, each run and metric a little else."""
    del held
    values = dict(zip(bench.box.names, plants.T, strict=True))
    mass, viscous = values["links.mass_2"], values["winches.viscous"]
    numbers = [
        0.2 * np.stack([mass ** (0.5 + m) * viscous, viscous**2 * (1.0 + 0.1 * k + m)], axis=1)
        for k in range(len(runs))
        for m in (0.0, 0.25)
    ]
    sizes = np.stack(numbers, axis=1).reshape(len(plants), len(runs), 2, 2)
    return Simulated(sizes, np.zeros(sizes.shape[:2], np.int8), np.ones(sizes.shape[:2]))


@pytest.fixture(scope="module")
def compare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mine")
    init_arm(2, folder)
    return folder / "compare.yaml"


@pytest.fixture(scope="module")
def loaded(compare: Path) -> LoadedEnsemble:
    return load_plants(compare, 0.5)


def table(loaded: LoadedEnsemble, path: Path, runs: Sequence[str] = ("controller_1", "controller_2")) -> Path:
    """The errors of the truth, as `compare` lays them out."""
    bench = bench_of(loaded)
    unit = np.array([[np.log(TRUTH.get(name, 1.0) * 1.5) / np.log(2.25) for name in bench.box.names]])
    sizes = cheap(bench, bench.box.values(unit), None, runs).sizes[0]
    lines = [
        f"{run},{joint},{sizes[r, 0, joint - 1]:.5f},{sizes[r, 1, joint - 1]:.5f},,ok"
        for r, run in enumerate(runs)
        for joint in (1, 2)
    ]
    path.write_text("\n".join(["run,joint,mae_deg,rmse_deg,max_deg,status", *lines]), encoding="utf-8")
    return path


def fitted(compare: Path, errors: Path, out: Path, **asked: Any) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Bench, "measure", cheap)
        study = COMMANDS["identify"].prepare(
            config=compare, errors=errors, out=out, figures=False, **(ASKED | asked)
        )
        return carry_out(study, QUIET).data


def test_known_factors_come_back_and_the_arm_keeps_the_rest(
    loaded: LoadedEnsemble, compare: Path, tmp_path: Path
) -> None:
    data = fitted(compare, table(loaded, tmp_path / "mine.csv"), tmp_path / "out", rows=",".join(TRUTH))
    (found,) = data["readings"]
    known = {row["name"]: row for row in found["known"]}
    assert {name: row["best"] for name, row in known.items()} == pytest.approx(TRUTH, rel=1e-3)
    assert all(row["determined"] and row["lowest"] <= row["best"] <= row["highest"] for row in known.values())
    assert known["links.mass_2"]["value"] == pytest.approx(1.2 * 0.47, rel=1e-3)
    assert found["fits"]
    assert len(found["numbers"]) == 8
    assert not any("printed" in key for row in found["numbers"] + found["best_shape"] for key in row)
    config, own = (load_config(path, "compare").config.manipulator for path in (data["config"], compare))
    assert config.links.mass.si == pytest.approx([0.77, 1.2 * 0.47], rel=1e-3)
    assert config.links.inertia.si[1] == pytest.approx(1.2 * own.links.inertia.si[1], rel=1e-3)
    assert config.tendons == own.tendons
    assert config.links.length == own.links.length
    moved = [config.links.mass, config.links.inertia, config.winches.viscous]
    assert all(held.source.startswith("identified: mine.csv, misfit ") for held in moved)


def test_what_near_plants_differ_in_is_not_determined(loaded: LoadedEnsemble) -> None:
    box = bench_of(loaded).box
    rows = [name in {"links.mass_1", "links.mass_2"} for name in box.names]
    box = box.freeing(np.array(rows))
    units = np.full((3, len(rows)), 0.5)
    units[1:, box.names.index("links.mass_1")] = 0.2, 0.7
    units[1:, box.names.index("links.mass_2")] = 0.45, 0.55
    found = {row["name"]: row for row in known_rows(box, units, 4, fits=True)}
    assert {name: row["determined"] for name, row in found.items()} == {
        "links.mass_1": False,
        "links.mass_2": True,
    }
    assert found["links.mass_1"]["of_range"] == pytest.approx(0.5)
    assert found["links.mass_1"]["lowest"] == pytest.approx(2.25**0.2 / 1.5)
    assert not any(row["determined"] for row in known_rows(box, units, 1, fits=True))
    # One plant alone says nothing, nor do plants of which none fits.
    assert not any(row["determined"] for row in known_rows(box, units[:1], 4, fits=True))
    assert not any(row["determined"] for row in known_rows(box, units, 4, fits=False))


def test_another_table_begins_anew(loaded: LoadedEnsemble, compare: Path, tmp_path: Path) -> None:
    errors = table(loaded, tmp_path / "mine.csv")
    fitted(compare, errors, tmp_path / "out", rows="links.mass_2", budget=2)
    errors.write_text(errors.read_text("utf-8").replace("controller_1,1,0.", "controller_1,1,0.0"), "utf-8")
    with pytest.raises(UsageError):
        fitted(compare, errors, tmp_path / "out", rows="links.mass_2", budget=2)


def test_numbers_of_a_table_and_of_traces(loaded: LoadedEnsemble, tmp_path: Path) -> None:
    rows = "controller_2,2,0.25,,", "controller_2,1,0.3,0.400,", "controller_1,1,0.3,,0.002"
    path = tmp_path / "mine.csv"
    path.write_text("\n".join(["run, joint,mae_deg,rmse_deg,half_deg", *rows]), "utf-8-sig")
    own = own_numbers(path, loaded, "whole")
    nothing = [np.nan, np.nan]
    np.testing.assert_array_equal(own.values, [[[0.3, np.nan], nothing], [[0.3, 0.25], [0.4, np.nan]]])
    np.testing.assert_allclose(own.half, [[[0.002, np.nan], nothing], [[0.05, 0.005], [0.0005, np.nan]]])
    assert (own.numbers, own.runs) == (4, ("controller_1", "controller_2"))
    file = make_compare_file(**FEW, runs=("controller_2",), source="measured")
    (trace,) = file.runs.values()
    folder = tmp_path / "measured"
    folder.mkdir()
    write_traces(folder / "traces.h5", file)
    of_log = own_numbers(folder, loaded, "settled")
    # Joint 3 of the log is none of this arm.
    late = np.rad2deg(np.abs(trace["e"][trace.time >= 2.0, 0]))
    np.testing.assert_allclose(of_log.values[0, :, 1], [late.mean(), np.sqrt((late**2).mean())])
    assert of_log.numbers == 2


WIDE = "run,joint,mae_deg,rmse_deg\n"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (WIDE, None),
        ("run,mae_deg\ncontroller_1,1\n", 1),
        ("run,joint,mae_deg,rms_deg\ncontroller_1,1,1,1\n", 1),
        (WIDE + "controller_1,1,0.2,0.3\ncontroler_2,1,0.2,0.3\n", 3),
        (WIDE + "controller_1,3,0.2,0.3\n", 2),
        (WIDE + "controller_1,1,0,0.3\n", 2),
        (WIDE + "controller_1,1,two,0.3\n", 2),
        (WIDE + "controller_1,1,1,25,0,3\n", 2),
        (WIDE + "controller_1,1,0.2,0.3\ncontroller_1,1,0.2,0.3\n", 3),
    ],
)
def test_a_table_that_is_none_is_told_with_its_line(
    loaded: LoadedEnsemble, tmp_path: Path, text: str, line: int | None
) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError) as caught:
        own_numbers(path, loaded, "whole")
    assert caught.value.where == (str(path) if line is None else f"{path}:{line}")
    assert caught.value.hint


@pytest.mark.parametrize(
    "asked",
    [
        {"errors": None},
        {"fit": "all"},
        {"rows": "tensioner.force"},
        {"set": ["errors_from=1"]},
    ],
)
def test_what_cannot_be_asked(
    loaded: LoadedEnsemble, compare: Path, tmp_path: Path, asked: dict[str, Any]
) -> None:
    words = {"errors": table(loaded, tmp_path / "mine.csv"), "config": compare, "spread": 0.5} | asked
    with pytest.raises(TendonreproError) as caught:
        COMMANDS["identify"].prepare(**words)
    assert caught.value.exit_code == 2


def test_rows_that_are_off_or_fixed_do_not_move(compare: Path) -> None:
    box = bench_of(load_plants(compare, 0.5, ["links.length=1", "winches.viscous=2"])).box
    free = dict(zip(box.names, box.free, strict=True))
    assert not free["tensioner.force"]
    assert not free["links.length_1"]
    assert free["links.mass_1"]
    unit = np.full((1, len(box.names)), 0.5)
    assert dict(zip(box.names, box.values(unit)[0], strict=True))["winches.viscous"] == 2.0


@pytest.mark.slow
def test_a_changed_arm_is_fitted_back_from_its_own_errors(tmp_path: Path) -> None:
    """By the simulation: the mass of link 2 and the friction of the winches, from errors of three digits."""
    init_arm(2, tmp_path)
    config, motion = tmp_path / "compare.yaml", ["reference.rise=1", "reference.hold=0.5"]
    changed = ["manipulator.links.mass=[0.77,0.6]", "manipulator.winches.viscous=1.3"]
    truth = tr.compare(config, set=[*motion, *changed], solver="compiled", figures=False)
    rows = [
        f"{run},{joint},{truth.data['table2'][run]['mae_deg'][k]:.4f},"
        f"{truth.data['table2'][run]['rmse_deg'][k]:.4f}"
        for run in ("controller_1", "controller_2")
        for k, joint in enumerate((1, 2))
    ]
    (tmp_path / "mine.csv").write_text("\n".join([WIDE.strip(), *rows]), encoding="utf-8")
    asked = {"rows": "links.mass_2,winches.viscous", "spread": 0.5, "set": motion, "jobs": 1}
    found = tr.identify(
        config=config, errors=tmp_path / "mine.csv", out=tmp_path / "out", figures=False, budget=100, **asked
    ).data["readings"][0]
    known = {row["name"]: row["best"] for row in found["known"]}
    assert known["winches.viscous"] == pytest.approx(1.3, rel=0.003)
    assert known["links.mass_2"] == pytest.approx(0.6 / 0.47, rel=0.03)
    assert found["misfit_log"] < 1e-3
