"""From files to measured traces: round trips of simulated runs, a made-up record, and what is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from openpyxl import Workbook
from support import synthetic_record
from support.matlab_bytes import classic, hdf

from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.dataset.ingest import ingest_text, run_ingest
from tendonrepro.dataset.inspection import inspect_text, run_inspect
from tendonrepro.errors import ConfigError, DataMissingError, UsageError
from tendonrepro.experiments.command import Order, run_experiments
from tendonrepro.results.figures.catalogue import available
from tendonrepro.results.paper_tables import table_data
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.traces import read_traces, write_traces

Array = NDArray[np.float64]
QUIET = Talk(quiet=True)
SHORT = ("reference.periods=2", "reference.rise=0.5", "reference.hold=0.1")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> TraceFile:
    out = tmp_path_factory.mktemp("simulated")
    run_experiments([Order("compare", Request(out=out, overrides=SHORT))], QUIET)
    return read_traces(out / "traces.h5")


def table_of(trace: Trace) -> dict[str, Array]:
    """A run as a lab would export it, in degrees."""
    columns = {"time (s)": trace.time}
    for variable, word in (("q_d", "desired"), ("q_encoder", "actual")):
        for joint, angle in zip(trace.joint, np.rad2deg(trace[variable]).T, strict=True):
            columns[f"joint {joint} {word} (deg)"] = angle
    return columns


def as_struct(trace: Trace) -> dict[str, Array]:
    degrees = {"q_des": np.rad2deg(trace["q_d"]), "q": np.rad2deg(trace["q_encoder"])}
    return {"t": trace.time[:, np.newaxis], **degrees}


def write_mat(folder: Path, file: TraceFile) -> None:
    classic(folder / "SYNTHETIC.mat", {name: as_struct(run) for name, run in file.runs.items()})


def write_hdf(folder: Path, file: TraceFile) -> None:
    hdf(folder / "SYNTHETIC.mat", {name: as_struct(run) for name, run in file.runs.items()})


def save_table(path: Path, table: Mapping[str, Array], digits: str) -> None:
    rows, header = np.stack(list(table.values()), axis=1), ",".join(table)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt=digits)


def write_csv(folder: Path, file: TraceFile) -> None:
    for name, run in file.runs.items():
        save_table(folder / f"SYNTHETIC_{name}.csv", table_of(run), "%.17g")


def write_xlsx(folder: Path, file: TraceFile) -> None:
    for name, run in file.runs.items():
        content = synthetic_record.workbook(table_of(run))
        (folder / f"SYNTHETIC_{name}.xlsx").write_bytes(content)


def ingest(files: Path, mapping: Path, **options: bool) -> dict[str, Any]:
    """Into measured.h5 beside the mapping."""
    out = mapping.with_name("measured.h5")
    return run_ingest([files], mapping, out, **{"force": False, "dry_run": False} | options, talk=QUIET)


def inspect(files: Path, mapping: Path | None, *, force: bool = False) -> dict[str, Any]:
    return run_inspect([files], mapping, force=force, talk=QUIET)


@pytest.mark.parametrize("write", [write_mat, write_hdf, write_csv, write_xlsx])
def test_simulated_runs_come_back_from_every_format(
    simulated: TraceFile, tmp_path: Path, write: Callable[[Path, TraceFile], None]
) -> None:
    """Times, angles and errors to the last digits, Tables 2 and 3 as they were."""
    folder, mapping = tmp_path / "files", tmp_path / "mapping.yaml"
    folder.mkdir()
    write(folder, simulated)
    inspect(folder, mapping)
    ingest(folder, mapping)
    back = read_traces(tmp_path / "measured.h5")
    assert back.source == "measured"
    assert set(back.runs) == set(simulated.runs)
    for name, run in simulated.runs.items():
        assert back.runs[name].joint == run.joint
        np.testing.assert_allclose(back.runs[name].time, run.time, rtol=1e-12, atol=1e-15)
        for variable in ("q_d", "q_encoder", "e"):
            np.testing.assert_allclose(back.runs[name][variable], run[variable], rtol=0.0, atol=1e-14)
        assert back.runs[name].status == run.status
    before, after = table_data(simulated), table_data(back)
    for table in ("table2", "table3"):
        assert set(before[table]) == set(after[table])
        for run_name, sizes in before[table].items():
            for size, values in sizes.items():
                assert after[table][run_name][size] == pytest.approx(values, rel=1e-10), (run_name, size)
    assert back.runs["controller_1_payload"].attributes["payload_mass"] == pytest.approx(0.2)


def test_an_empty_column_parts_no_rows_from_their_times(tmp_path: Path) -> None:
    """With a sheet beside that is as long and has another clock."""
    path, mapping, times = (
        tmp_path / "SYNTHETIC_controller_1.xlsx",
        tmp_path / "map.yaml",
        0.01 * np.arange(181.0),
    )
    book = Workbook()
    for sheet, clock in (("One", 1.0), ("controller 2", 10.0)):
        rows = [[clock * t, np.sin(t), None, np.sin(t) - 0.1, 0.5 * np.sin(t)] for t in times.tolist()]
        for row in [["Time (s)", "q2_d (rad)", None, "q2 (rad)", "q3 (rad)"], *rows]:
            (book[sheet] if sheet in book else book.create_sheet(sheet)).append(row)
    book.save(path)
    inspect(path, mapping)
    assert "resample" not in mapping.read_text(encoding="utf-8")
    ingest(path, mapping)
    runs = read_traces(tmp_path / "measured.h5").runs
    assert {name: run.joint for name, run in runs.items()} == dict.fromkeys(runs, (2, 3))
    np.testing.assert_allclose(runs["controller_1"].time, times, rtol=1e-12)
    np.testing.assert_allclose(runs["controller_2"].time, 10.0 * times, rtol=1e-12)
    np.testing.assert_allclose(runs["controller_1"]["e"][:, 0], 0.1, rtol=1e-9)


def test_an_error_of_the_other_sign_is_asked_about(simulated: TraceFile, tmp_path: Path) -> None:
    run = simulated.runs["controller_1"]
    columns = {"time (s)": run.time}
    for k, joint in enumerate(run.joint):
        columns[f"joint {joint} actual (deg)"] = np.rad2deg(run["q_encoder"][:, k])
        columns[f"joint {joint} error (deg)"] = np.rad2deg(run["q_encoder"] - run["q_d"])[:, k]
    path, mapping = tmp_path / "SYNTHETIC_controller_1.csv", tmp_path / "mapping.yaml"
    save_table(path, columns, "%.6f")
    asked = inspect_text(inspect(path, mapping))
    assert "decide: controller_1: an error is taken for desired less measured; if it is" in asked
    notes = ingest(path, mapping)["notes"]
    way = "is q_encoder + e; if e was recorded as measured less desired, `sign: -1`"
    assert notes == [f"controller_1: q_d of joint {joint} {way}" for joint in run.joint]
    assert json.loads(read_traces(tmp_path / "measured.h5").manifest_json)["notes"] == notes
    text = mapping.read_text(encoding="utf-8")
    mapping.write_text(text.replace("variable: e\n", "variable: e\n      sign: -1\n"), encoding="utf-8")
    ingest(path, mapping, force=True)
    back = read_traces(tmp_path / "measured.h5").runs["controller_1"]
    np.testing.assert_allclose(back["q_d"], run["q_d"], rtol=0.0, atol=1e-7)


def test_a_folder_without_a_name_is_called_by_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "SYNTHETIC_files"
    folder.mkdir()
    rows = "\n".join(f"{1773300045123456 + 2000 * k},{k % 7}" for k in range(50))
    (folder / "SYNTHETIC.csv").write_text(f"time_us,q2\n{rows}")
    monkeypatch.chdir(folder)
    found = inspect(Path(), tmp_path / "mapping.yaml")
    assert "title: Measured data from SYNTHETIC_files\n" in (tmp_path / "mapping.yaml").read_text()
    assert "1773300045123456 to 1773300045221456 us -> time" in inspect_text(found, verbose=True)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("record") / "zenodo"
    synthetic_record.make_record(folder)
    return folder


@pytest.fixture(scope="module")
def from_record(record: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], TraceFile]:
    """What ingest says of the record, and what it has written."""
    mapping = tmp_path_factory.mktemp("ingested") / "mapping.yaml"
    inspect(record, mapping)
    return ingest(record, mapping), read_traces(mapping.with_name("measured.h5"))


def test_a_made_up_record_gives_its_own_tables(from_record: tuple[dict[str, Any], TraceFile]) -> None:
    _, file = from_record
    assert file.experiment == "both"
    for run, sizes in synthetic_record.expected_sizes().items():
        e = np.rad2deg(file.runs[run]["e"])
        np.testing.assert_allclose(np.abs(e).mean(axis=0), sizes["mae"], rtol=1e-9)
        np.testing.assert_allclose(np.sqrt((e**2).mean(axis=0)), sizes["rmse"], rtol=1e-9)
    q, motors = synthetic_record.joints_and_motors()
    decouple = file.runs["decouple"]
    np.testing.assert_allclose(np.rad2deg(decouple["q_encoder"]), q, atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(decouple["q_motor_encoder"]), motors, atol=1e-6)
    assert available(file) == [9, 10, 11, 12, 13, 14, 16]


def test_everything_guessed_is_written_down(from_record: tuple[dict[str, Any], TraceFile]) -> None:
    found, file = from_record
    manifest = json.loads(file.manifest_json)
    assert found["guesses"] == manifest["guesses"]
    assert len(manifest["guesses"]) == 22
    says = {"q_d": "desired", "q_encoder": "measured", "q_motor_encoder": "motor"}
    for guess in manifest["guesses"]:
        reason = re.match(r"\w+: (\w+) of joint [123]: the name '[^']+' says (\w+); ", guess)
        assert reason is not None, guess
        assert reason[2] == says[reason[1]], guess
    md5 = {entry["name"].rsplit("/", 1)[-1]: entry["md5"] for entry in manifest["inputs"]}
    assert set(md5) >= {"SYNTHETIC controller1.mat", "SYNTHETIC_controller3.xlsx", "SYNTHETIC_decoupling.csv"}
    assert all(len(digest) == 32 for digest in md5.values())
    assert manifest["mapping"]["file_sha256"]


def test_what_ingest_says_can_be_read(from_record: tuple[dict[str, Any], TraceFile]) -> None:
    text = ingest_text(from_record[0])
    assert "controller_1: joints 2, 3, 6001 samples every 2 ms, ok" in text
    assert "22 columns are guessed" in text


def test_a_confirmed_choice_is_no_guess(
    from_record: tuple[dict[str, Any], TraceFile], record: Path, tmp_path: Path
) -> None:
    mapping, guessed = tmp_path / "mapping.yaml", from_record[1].config_yaml
    mapping.write_text(guessed, encoding="utf-8")
    assert ingest(record, mapping, dry_run=True, confirm=True)["guesses"] == []
    assert mapping.read_text(encoding="utf-8") == guessed
    assert not (tmp_path / "measured.h5").exists()
    assert ingest(record, mapping, confirm=True)["guesses"] == []
    lines = [line for line in guessed.splitlines() if not line.lstrip().startswith("because:")]
    assert mapping.read_text(encoding="utf-8").splitlines() == lines


def test_what_inspect_says_can_be_read(record: Path) -> None:
    found = inspect(record, None)
    text = inspect_text(found, verbose=True)
    json.dumps(found)
    for words in ("every 2 ms", "desired 2 of controller_2", "motor 3 of decouple", "README.txt"):
        assert words in text
    assert "-> ?" not in text
    short = inspect_text(found)
    assert "  controller_2: desired 2, 3; measured 2, 3\n" in short
    assert "  decouple: " in short
    assert "not guessed" not in short
    assert len(short.splitlines()) <= 3 * len(found["files"]) + 2


def test_a_mapping_of_the_user_is_not_overwritten(tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("# mine")
    (tmp_path / "SYNTHETIC_controller1.csv").write_text(TABLE)
    with pytest.raises(UsageError, match="may hold work of yours"):
        inspect(tmp_path / "SYNTHETIC_controller1.csv", mapping)
    assert mapping.read_text() == "# mine"
    inspect(tmp_path / "SYNTHETIC_controller1.csv", mapping, force=True)
    assert "controller_1" in mapping.read_text(encoding="utf-8")


def test_results_of_other_data_are_not_overwritten(tmp_path: Path) -> None:
    path, mapping, out = (tmp_path / name for name in ("SYNTHETIC.csv", "mapping.yaml", "measured.h5"))
    path.write_text(TABLE)
    inspect(path, mapping)
    ingest(path, mapping)
    ingest(path, mapping)
    text = mapping.read_text(encoding="utf-8")
    mapping.write_text(text.replace("joint: 2", "joint: 3"), encoding="utf-8")
    with pytest.raises(UsageError, match="made by another mapping"):
        ingest(path, mapping)
    ingest(path, mapping, force=True)
    out.write_bytes(b"SYNTHETIC work of a user")
    with pytest.raises(UsageError, match="something else"):
        ingest(path, mapping)
    assert out.read_bytes() == b"SYNTHETIC work of a user"


@pytest.mark.parametrize("manifest", ["null", "{}", '{"inputs": 3}'])
def test_a_result_without_a_manifest_is_not_overwritten(
    from_record: tuple[dict[str, Any], TraceFile], record: Path, tmp_path: Path, manifest: str
) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(from_record[1].config_yaml, encoding="utf-8")
    write_traces(tmp_path / "measured.h5", replace(from_record[1], manifest_json=manifest))
    with pytest.raises(UsageError, match="made from other data"):
        ingest(record, mapping, dry_run=True)


TABLE = "t,q2\n" + "\n".join(f"{0.01 * k:.2f},{k % 7}" for k in range(50))


def test_a_file_that_was_not_taken_is_no_input(tmp_path: Path) -> None:
    folder, mapping = tmp_path / "files", tmp_path / "mapping.yaml"
    (folder / "old").mkdir(parents=True)
    (folder / "SYNTHETIC.csv").write_text(TABLE)
    inspect(folder, mapping)
    for unrelated in (TABLE, f"{TABLE}\n0.5,1"):
        (folder / "old" / "SYNTHETIC.csv").write_text(unrelated)
        assert [entry["name"] for entry in ingest(folder, mapping)["inputs"]] == ["SYNTHETIC.csv"]


def test_no_file_steers_the_terminal(tmp_path: Path) -> None:
    path, mapping = tmp_path / "SYNTHETIC.csv", tmp_path / "mapping.yaml"
    path.write_text(f"\x1b[2J SYNTHETIC\x9b31m\n{TABLE.replace('q2', chr(27) + 'q2')}")
    found = inspect(path, mapping)
    assert "\x1b" in json.loads(json.dumps(found))["files"][0]["signals"][1]["path"]
    text = mapping.read_text(encoding="utf-8")
    text = text.replace("title: Measured data", 'title: "\\e[2J" # ')
    mapping.write_text(text, encoding="utf-8")
    taken = ingest(path, mapping, dry_run=True)
    assert taken["title"].startswith("\x1b")
    for shown in (inspect_text(found, verbose=True), ingest_text(taken)):
        assert "\ufffd[2J" in shown
        assert all(line.isprintable() for line in shown.split("\n"))
    mapping.write_text(text.replace("q2", "q3"), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        ingest(path, mapping, force=True, dry_run=True)
    assert "\x1b" not in str(caught.value)


def test_what_is_missing_is_named(record: Path, tmp_path: Path) -> None:
    with pytest.raises(DataMissingError, match="nowhere"):
        inspect(tmp_path / "nowhere", None)
    with pytest.raises(ConfigError) as caught:
        ingest(record, tmp_path / "none.yaml")
    assert "inspect" in (caught.value.hint or "")


def test_where_nothing_is_understood_the_columns_are_listed(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).normal(size=(50, 2))
    np.savetxt(tmp_path / "SYNTHETIC.csv", noise, delimiter=",", header="aa,bb", comments="")
    found = inspect(tmp_path / "SYNTHETIC.csv", tmp_path / "m.yaml")
    assert found["left"] == 2
    text = inspect_text(found)
    assert "no column could be assigned" in text
    assert "  not guessed: aa, bb\n" in text
    assert (tmp_path / "m.yaml").read_text().count("#    - variable: CHOOSE") == 2
