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
from support import synthetic_record
from support.matlab_bytes import classic, hdf

from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.dataset.ingest import ingest_text, run_ingest
from tendonrepro.dataset.inspection import inspect_text, run_inspect
from tendonrepro.errors import ConfigError, DataMissingError, UsageError
from tendonrepro.experiments.command import Order, run_experiment
from tendonrepro.results.figures.catalogue import available
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import table_data_compare
from tendonrepro.results.traces import read_traces, write_traces

Array = NDArray[np.float64]
QUIET = Talk(quiet=True)
SHORT = ("reference.periods=2", "reference.rise=0.5", "reference.hold=0.1")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> TraceFile:
    out = tmp_path_factory.mktemp("simulated")
    run_experiment(Order("compare", Request(out=out, overrides=SHORT)), QUIET)
    return read_traces(out / "traces.h5")


def table_of(trace: Trace) -> dict[str, Array]:
    """A run as a lab would export it, in degrees."""
    names = {"q_d": "desired", "q_encoder": "actual"}
    columns = {"time (s)": trace.time}
    for variable, word in names.items():
        for k, joint in enumerate(trace.joint):
            columns[f"joint {joint} {word} (deg)"] = np.rad2deg(trace[variable][:, k])
    return columns


def as_struct(trace: Trace) -> dict[str, Array]:
    degrees = {"q_des": np.rad2deg(trace["q_d"]), "q": np.rad2deg(trace["q_encoder"])}
    return {"t": trace.time[:, np.newaxis], **degrees}


def write_mat(folder: Path, file: TraceFile) -> None:
    classic(folder / "SYNTHETIC.mat", {name: as_struct(run) for name, run in file.runs.items()})


def write_hdf(folder: Path, file: TraceFile) -> None:
    hdf(folder / "SYNTHETIC.mat", {name: as_struct(run) for name, run in file.runs.items()})


def write_csv(folder: Path, file: TraceFile) -> None:
    for name, run in file.runs.items():
        table = table_of(run)
        rows = np.stack(list(table.values()), axis=1)
        header = ",".join(table)
        np.savetxt(
            folder / f"SYNTHETIC_{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g"
        )


def write_xlsx(folder: Path, file: TraceFile) -> None:
    for name, run in file.runs.items():
        content = synthetic_record.workbook(table_of(run), "Sheet1")
        (folder / f"SYNTHETIC_{name}.xlsx").write_bytes(content)


def ingested(folder: Path, tmp_path: Path) -> TraceFile:
    mapping, out = tmp_path / "mapping.yaml", tmp_path / "measured.h5"
    run_inspect([folder], mapping, force=False, talk=QUIET)
    run_ingest([folder], mapping, out, force=False, dry_run=False, talk=QUIET)
    return read_traces(out)


@pytest.mark.parametrize("write", [write_mat, write_hdf, write_csv, write_xlsx])
def test_simulated_runs_come_back_from_every_format(
    simulated: TraceFile, tmp_path: Path, write: Callable[[Path, TraceFile], None]
) -> None:
    """Times, angles and errors to the last digits, Tables 2 and 3 as they were."""
    folder = tmp_path / "files"
    folder.mkdir()
    write(folder, simulated)
    back = ingested(folder, tmp_path)
    assert back.source == "measured"
    assert set(back.runs) == set(simulated.runs)
    for name, run in simulated.runs.items():
        assert back.runs[name].joint == run.joint
        np.testing.assert_allclose(back.runs[name].time, run.time, rtol=1e-12, atol=1e-15)
        for variable in ("q_d", "q_encoder", "e"):
            np.testing.assert_allclose(back.runs[name][variable], run[variable], rtol=0.0, atol=1e-14)
        assert back.runs[name].status == run.status
    before, after = table_data_compare(simulated), table_data_compare(back)
    for table in ("table2", "table3"):
        _assert_same_tables(before[table], after[table])
    assert back.runs["controller_1_payload"].attributes["payload_mass"] == pytest.approx(0.2)


def _assert_same_tables(
    before: Mapping[str, Mapping[str, list[float]]], after: Mapping[str, Mapping[str, list[float]]]
) -> None:
    assert set(before) == set(after)
    for run, sizes in before.items():
        for name, values in sizes.items():
            assert after[run][name] == pytest.approx(values, rel=1e-10), (run, name)


LONG = """    {name}:
      payload_mass_kg: {mass}
      time: {{file: SYNTHETIC_long.csv, signal: time_s}}
      where:
      - {{signal: controller, equals: {controller}}}
      - {{signal: payload_kg, equals: {mass}}}
      signals:
"""
LONG_COLUMN = (
    "      - {{variable: {variable}, joint: {joint}, file: SYNTHETIC_long.csv, signal: {signal}, unit: deg, "
    "where: {{signal: joint, equals: {joint}}}}}\n"
)


def write_long(folder: Path, file: TraceFile) -> str:
    """All runs and joints below each other in one table; returns the mapping that takes them apart."""
    blocks, mapping = [], "schema_version: 1\ntitle: SYNTHETIC\nruns:\n"
    for name, run in file.runs.items():
        controller, mass = int(name.split("_")[1]), 0.2 if "payload" in name else 0.0
        mapping += LONG.format(name=name, controller=controller, mass=mass)
        for k, joint in enumerate(run.joint):
            angles = (np.rad2deg(run[variable][:, k]) for variable in ("q_d", "q_encoder"))
            kind = (np.full(len(run.time), value) for value in (controller, mass, joint))
            blocks.append(np.stack([run.time, *kind, *angles], axis=1))
            for variable, signal in (("q_d", "desired"), ("q_encoder", "measured")):
                mapping += LONG_COLUMN.format(variable=variable, joint=joint, signal=signal)
    header = "time_s,controller,payload_kg,joint,desired,measured"
    rows = np.concatenate(blocks)
    np.savetxt(folder / "SYNTHETIC_long.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return mapping


def test_a_table_in_long_form_gives_its_own_tables(simulated: TraceFile, tmp_path: Path) -> None:
    mapping, out = tmp_path / "mapping.yaml", tmp_path / "measured.h5"
    mapping.write_text(write_long(tmp_path, simulated), encoding="utf-8")
    path = tmp_path / "SYNTHETIC_long.csv"
    run_ingest([path], mapping, out, force=False, dry_run=False, talk=QUIET)
    back = read_traces(out)
    assert set(back.runs) == set(simulated.runs)
    before, after = table_data_compare(simulated), table_data_compare(back)
    for table in ("table2", "table3"):
        _assert_same_tables(before[table], after[table])


def test_an_error_of_the_other_sign_is_asked_about(simulated: TraceFile, tmp_path: Path) -> None:
    run = simulated.runs["controller_1"]
    columns = {"time (s)": run.time}
    for k, joint in enumerate(run.joint):
        columns[f"joint {joint} actual (deg)"] = np.rad2deg(run["q_encoder"][:, k])
        columns[f"joint {joint} error (deg)"] = np.rad2deg(run["q_encoder"] - run["q_d"])[:, k]
    path, mapping = tmp_path / "SYNTHETIC_controller_1.csv", tmp_path / "mapping.yaml"
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.6f")
    asked = inspect_text(run_inspect([path], mapping, force=False, talk=QUIET))
    assert "decide: controller_1: an error is taken for desired less measured; if it is" in asked
    found = run_ingest([path], mapping, tmp_path / "m.h5", force=False, dry_run=False, talk=QUIET)
    (note,) = found["notes"]
    assert note.endswith("q_d is q_encoder + e; if e was recorded as measured less desired, `sign: -1`")
    assert json.loads(read_traces(tmp_path / "m.h5").manifest_json)["notes"] == [note]
    text = mapping.read_text(encoding="utf-8")
    mapping.write_text(text.replace("variable: e\n", "variable: e\n      sign: -1\n"), encoding="utf-8")
    run_ingest([path], mapping, tmp_path / "m.h5", force=True, dry_run=False, talk=QUIET)
    back = read_traces(tmp_path / "m.h5").runs["controller_1"]
    np.testing.assert_allclose(back["q_d"], run["q_d"], rtol=0.0, atol=1e-7)


def test_a_folder_without_a_name_is_called_by_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "SYNTHETIC_files"
    folder.mkdir()
    rows = "\n".join(f"{1773300045123456 + 2000 * k},{k % 7}" for k in range(50))
    (folder / "SYNTHETIC.csv").write_text(f"time_us,q2\n{rows}")
    monkeypatch.chdir(folder)
    found = run_inspect([Path()], tmp_path / "mapping.yaml", force=False, talk=QUIET)
    assert 'title: "Measured data from SYNTHETIC_files"' in (tmp_path / "mapping.yaml").read_text()
    assert "1773300045123456 to 1773300045221456 us, 0.098 s long -> time" in inspect_text(found)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("record") / "zenodo"
    synthetic_record.make_record(folder)
    return folder


@pytest.fixture(scope="module")
def from_record(record: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], TraceFile]:
    """What ingest says of the record, and what it has written."""
    folder = tmp_path_factory.mktemp("ingested")
    mapping, out = folder / "mapping.yaml", folder / "measured.h5"
    run_inspect([record], mapping, force=False, talk=QUIET)
    found = run_ingest([record], mapping, out, force=False, dry_run=False, talk=QUIET)
    return found, read_traces(out)


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


def test_a_confirmed_choice_is_no_guess(record: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    run_inspect([record], mapping, force=False, talk=QUIET)
    lines = [line for line in mapping.read_text(encoding="utf-8").splitlines() if "because:" not in line]
    mapping.write_text("\n".join(lines), encoding="utf-8")
    found = run_ingest([record], mapping, tmp_path / "m.h5", force=False, dry_run=True, talk=QUIET)
    assert found["guesses"] == []
    assert not (tmp_path / "m.h5").exists()


def test_what_inspect_says_can_be_read(record: Path) -> None:
    found = run_inspect([record], None, force=False, talk=QUIET)
    text = inspect_text(found)
    json.dumps(found)
    assert "every 2 ms" in text
    assert "desired 2 of controller_2" in text
    assert "motor 3 of decouple" in text
    assert "README.txt" in text
    assert "-> ?" not in text


def test_a_mapping_of_the_user_is_not_overwritten(record: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("# mine")
    with pytest.raises(UsageError, match="may hold work of yours"):
        run_inspect([record], mapping, force=False, talk=QUIET)
    assert mapping.read_text() == "# mine"
    run_inspect([record], mapping, force=True, talk=QUIET)
    assert "controller_1" in mapping.read_text(encoding="utf-8")


def test_results_of_other_data_are_not_overwritten(record: Path, tmp_path: Path) -> None:
    mapping, out = tmp_path / "mapping.yaml", tmp_path / "measured.h5"

    def ingest(*, force: bool = False) -> None:
        run_ingest([record], mapping, out, force=force, dry_run=False, talk=QUIET)

    run_inspect([record], mapping, force=False, talk=QUIET)
    ingest()
    ingest()
    text = mapping.read_text(encoding="utf-8").replace("payload_mass_kg: 0.2", "payload_mass_kg: 0.3")
    mapping.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="made by another mapping"):
        ingest()
    ingest(force=True)
    out.write_bytes(b"SYNTHETIC work of a user")
    with pytest.raises(UsageError, match="something else"):
        ingest()
    assert out.read_bytes() == b"SYNTHETIC work of a user"


@pytest.mark.parametrize("manifest", ["[]", "null", "", "{}", '{"inputs": 3}'])
def test_a_result_without_a_manifest_is_not_overwritten(
    from_record: tuple[dict[str, Any], TraceFile], record: Path, tmp_path: Path, manifest: str
) -> None:
    mapping, out = tmp_path / "mapping.yaml", tmp_path / "measured.h5"
    mapping.write_text(from_record[1].config_yaml, encoding="utf-8")
    write_traces(out, replace(from_record[1], manifest_json=manifest))
    with pytest.raises(UsageError, match="made from other data"):
        run_ingest([record], mapping, out, force=False, dry_run=True, talk=QUIET)


def test_a_file_that_was_not_taken_is_no_input(tmp_path: Path) -> None:
    folder, mapping, out = tmp_path / "files", tmp_path / "mapping.yaml", tmp_path / "measured.h5"
    (folder / "old").mkdir(parents=True)
    table = "t,q2\n" + "\n".join(f"{0.01 * k:.2f},{k % 7}" for k in range(50))
    (folder / "SYNTHETIC.csv").write_text(table)
    run_inspect([folder], mapping, force=False, talk=QUIET)
    for unrelated in (table, table + "\n0.5,1"):
        (folder / "old" / "SYNTHETIC.csv").write_text(unrelated)
        found = run_ingest([folder], mapping, out, force=False, dry_run=False, talk=QUIET)
        assert [entry["name"] for entry in found["inputs"]] == ["SYNTHETIC.csv"]


def test_no_file_steers_the_terminal(tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    rows = "\n".join(f"{0.01 * k:.2f},{k % 7}" for k in range(50))
    (tmp_path / "SYNTHETIC.csv").write_text(f"\x1b[2J SYNTHETIC\x9b31m\nt,\x1bq2\n{rows}")
    found = run_inspect([tmp_path / "SYNTHETIC.csv"], mapping, force=False, talk=QUIET)
    assert "\x1b" in json.loads(json.dumps(found))["files"][0]["signals"][1]["path"]
    text = mapping.read_text(encoding="utf-8").replace('title: "', 'title: "\\e[2J')
    mapping.write_text(text, encoding="utf-8")
    ingested = run_ingest(
        [tmp_path / "SYNTHETIC.csv"], mapping, tmp_path / "m.h5", force=False, dry_run=True, talk=QUIET
    )
    assert ingested["title"].startswith("\x1b")
    for shown in (inspect_text(found), ingest_text(ingested)):
        assert "\ufffd[2J" in shown
        assert all(line.isprintable() for line in shown.split("\n"))
    mapping.write_text(text.replace("q2", "q3"), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        run_ingest(
            [tmp_path / "SYNTHETIC.csv"], mapping, tmp_path / "m.h5", force=True, dry_run=True, talk=QUIET
        )
    assert "\x1b" not in str(caught.value)


def test_what_is_missing_is_named(record: Path, tmp_path: Path) -> None:
    with pytest.raises(DataMissingError, match="nowhere"):
        run_inspect([tmp_path / "nowhere"], None, force=False, talk=QUIET)
    with pytest.raises(ConfigError) as caught:
        run_ingest(
            [record], tmp_path / "none.yaml", tmp_path / "m.h5", force=False, dry_run=False, talk=QUIET
        )
    assert "inspect" in (caught.value.hint or "")


def test_where_nothing_is_understood_the_columns_are_listed(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).normal(size=(50, 2))
    np.savetxt(tmp_path / "SYNTHETIC.csv", noise, delimiter=",", header="aa,bb", comments="")
    found = run_inspect([tmp_path / "SYNTHETIC.csv"], tmp_path / "m.yaml", force=False, talk=QUIET)
    assert found["left"] == 2
    assert "no column could be assigned" in inspect_text(found)
    assert (tmp_path / "m.yaml").read_text().count("#    - variable: CHOOSE") == 2
