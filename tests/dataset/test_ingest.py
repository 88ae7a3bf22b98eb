"""From files to measured traces: layouts of labs, round trips of simulated runs, and what is refused."""

import h5py
import numpy as np
import pandas as pd
import pytest
from support import synthetic_record
from support.matlab_bytes import classic

from tendonrepro.console import QUIET
from tendonrepro.dataset.ingestion import run_ingest, run_inspect
from tendonrepro.dataset.read import read_files
from tendonrepro.errors import ConfigError, DataMissingError, UsageError
from tendonrepro.results.figures.catalogue import FIGURES, available
from tendonrepro.results.traces import read_traces

TIME = synthetic_record.TIME[::20]
RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload")
DESIRED = np.stack([synthetic_record.desired(joint)[::20] for joint in (2, 3)], axis=1)
MEASURED = {
    run: np.stack([synthetic_record.measured(run, joint)[::20] for joint in (2, 3)], axis=1) for run in RUNS
}
"""Degrees."""


def table(run, names):
    """Columns of a run under names that take the number of the joint."""
    time, desired, measured = names
    found = {time: TIME}
    for k, joint in enumerate((2, 3)):
        found[desired.format(joint)] = DESIRED[:, k]
        found[measured.format(joint)] = MEASURED[run][:, k]
    return found


ENGLISH = ("Time (s)", "Joint {} desired angle (deg)", "Joint {} actual angle (deg)")
GERMAN = ("Zeit / s", "Sollwinkel Gelenk {} [°]", "Istwinkel Gelenk {} [°]")
CHINESE = ("时间(s)", "关节{}期望角度(°)", "关节{}实际角度(°)")
SYMBOLS = ("t", "qd{}", "q{}")


def write_csv(folder, names, files, separator, encoding):
    """A file for each run, with decimal commas where semicolons separate."""
    for run, name in zip(RUNS, files, strict=True):
        style = {"sep": separator, "decimal": "," if separator == ";" else ".", "encoding": encoding}
        pd.DataFrame(table(run, names)).to_csv(folder / name, index=False, float_format="%.9f", **style)


def nested():
    """Desired and measured angles in structs of their own."""
    own = {run: {"desired": DESIRED, "encoder": MEASURED[run]} for run in RUNS}
    return {
        run: {name: {"t": TIME[:, None], "q2": q[:, :1], "q3": q[:, 1:]} for name, q in parts.items()}
        for run, parts in own.items()
    }


def write_hdf5(folder):
    with h5py.File(folder / "runs.h5", "w") as file:
        for run in RUNS:
            for name, values in table(run, ("time", "q{}_desired", "q{}_measured")).items():
                file[f"{run}/{name}"] = values if name == "time" else np.deg2rad(values)
                file[f"{run}/{name}"].attrs["units"] = "s" if name == "time" else "rad"


def write_apart(folder):
    """Desired and measured angles in files of their own, in a folder for each run."""
    for run in RUNS:
        (folder / run).mkdir()
        for name, angles in (("desired", DESIRED), ("encoder", MEASURED[run])):
            columns = {"t": TIME, "q2 (deg)": angles[:, 0], "q3 (deg)": angles[:, 1]}
            pd.DataFrame(columns).to_csv(folder / run / f"{name}.csv", index=False)


FILES = [f"{run}.csv" for run in RUNS]
OF_GERMANS = ("Regler 1.csv", "Regler 2.csv", "Regler 3.csv", "Regler 1 Nutzlast.csv")
OF_CHINESE = ("控制器1.csv", "控制器2.csv", "控制器3.csv", "控制器1负载.csv")
LAYOUTS = {
    "csv, English": lambda f: write_csv(f, ENGLISH, FILES, ",", "utf-8"),
    "csv, German": lambda f: write_csv(f, GERMAN, OF_GERMANS, ";", "cp1252"),
    "csv, Chinese": lambda f: write_csv(f, CHINESE, OF_CHINESE, ",", "gbk"),
    "csv, symbols": lambda f: write_csv(f, SYMBOLS, FILES, "\t", "utf-8"),
    "HDF5": write_hdf5,
    "folders": write_apart,
    "structs of structs": lambda f: classic(f / "runs.mat", {"exp": nested()}),
}


def ingest(files, mapping, **options):
    """Into measured.h5 beside the mapping."""
    out = mapping.with_name("measured.h5")
    return run_ingest([files], mapping, out, **{"force": False, "dry_run": False} | options, talk=QUIET)


def inspect(files, mapping, *, force=False):
    return run_inspect([files], mapping, force=force)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_ordinary_layouts_need_no_edit(layout, tmp_path):
    """A file, sheet or struct for each run: angles and runs come back from a short mapping."""
    folder, mapping = tmp_path / "files", tmp_path / "mapping.yaml"
    folder.mkdir()
    LAYOUTS[layout](folder)
    inspect(folder, mapping)
    ingest(folder, mapping)
    file = read_traces(tmp_path / "measured.h5")
    assert set(file.runs) == set(RUNS)
    for run in RUNS:
        trace = file.runs[run]
        assert trace.joint == (2, 3)
        np.testing.assert_allclose(trace.time, TIME, atol=1e-9)
        np.testing.assert_allclose(np.rad2deg(trace["q_d"]), DESIRED, atol=1e-6)
        np.testing.assert_allclose(np.rad2deg(trace["q_encoder"]), MEASURED[run], atol=1e-6)
    assert file.runs["controller_1_payload"].attributes["payload_mass"] == pytest.approx(0.2)
    lines = mapping.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 20


@pytest.fixture(scope="module")
def made_record(tmp_path_factory):
    folder = tmp_path_factory.mktemp("record") / "zenodo"
    synthetic_record.make_record(folder)
    return folder


@pytest.fixture(scope="module")
def from_record(made_record, tmp_path_factory):
    """The mapping of the record, and what was written."""
    mapping = tmp_path_factory.mktemp("ingested") / "mapping.yaml"
    inspect(made_record, mapping)
    ingest(made_record, mapping)
    return mapping, read_traces(mapping.with_name("measured.h5"))


def test_a_made_up_record_gives_its_own_tables(from_record):
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
    calculated = motors @ synthetic_record.S.T
    np.testing.assert_allclose(np.rad2deg(decouple["q_calculated"]), calculated, atol=1e-6)
    # The paper's figures but those of one motor alone and of what a controller computes.
    paper = {name for name in FIGURES if name.startswith("fig")}
    assert paper - set(available(file)) == {"fig06", "fig15"}
    assert {len(entry["md5"]) for entry in file.manifest["inputs"]} == {32}
    assert file.manifest["guesses"]


def test_a_confirmed_mapping_has_no_guesses(from_record, made_record, tmp_path):
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(from_record[0].read_text(encoding="utf-8"), encoding="utf-8")
    assert ingest(made_record, mapping, confirm=True)["guesses"] == []
    assert "CHECK" not in mapping.read_text(encoding="utf-8")


def made(folder, text, **columns):
    """A csv file and a mapping for it."""
    path, mapping = folder / "x.csv", folder / "mapping.yaml"
    pd.DataFrame(columns).to_csv(path, index=False)
    mapping.write_text(text, encoding="utf-8")
    return path, mapping


BOTH = "columns: {t: time s, qd: q_d 2 deg, q: q_encoder 2 deg, e: e 2 deg}\n"


def test_rows_of_one_run(tmp_path):
    law = np.repeat([1.0, 2.0], len(TIME))
    columns = {"t": np.tile(TIME, 2), "law": law, "q": 10.0 * law}
    text = f"{BOTH}runs: {{controller_2: {{sources: x.csv, where: {{law: 2}}}}}}\n"
    ingest(*made(tmp_path, text, **columns))
    trace = read_traces(tmp_path / "measured.h5").runs["controller_2"]
    assert len(trace.time) == len(TIME)
    assert np.rad2deg(trace["q_encoder"]) == pytest.approx(20.0)


@pytest.mark.parametrize(("name", "absent"), [("q", "q_encoder"), ("qd", "q_d"), ("e", "e")])
def test_of_three_two_give_the_third(name, absent, tmp_path):
    columns = {"qd": DESIRED[:, 0], "q": MEASURED["controller_1"][:, 0]}
    columns["e"] = columns["qd"] - columns["q"]
    expected = columns.pop(name)
    ingest(*made(tmp_path, BOTH + "runs: {controller_1: x.csv}\n", t=TIME, **columns))
    trace = read_traces(tmp_path / "measured.h5").runs["controller_1"]
    assert np.rad2deg(trace[absent][:, 0]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"q": 57.0 * DESIRED[:, 0]}, "half a turn"),
        ({"qd": DESIRED[:, 0], "q": 0.5 * DESIRED[:, 0]}, "a tenth of its motion"),
        ({"qd": DESIRED[:, 0], "q": 0.95 * DESIRED[:, 0], "e": 0.1 * DESIRED[:, 0]}, "e of joint 2 is not"),
        ({"qd": DESIRED[:, 0], "q": 0.95 * DESIRED[:, 0], "e": -0.05 * DESIRED[:, 0]}, "the other sign"),
    ],
)
def test_what_looks_wrong_is_said(columns, words, tmp_path):
    found = ingest(*made(tmp_path, BOTH + "runs: {controller_1: x.csv}\n", t=TIME, **columns))
    assert any(words in doubt for doubt in found["doubts"])


def test_an_error_of_the_files_own_arithmetic_is_no_doubt(tmp_path):
    columns = {"qd": DESIRED[:, 0], "q": 0.95 * DESIRED[:, 0]}
    columns["e"] = np.round(columns["qd"] - columns["q"], 3)
    assert ingest(*made(tmp_path, BOTH + "runs: {controller_1: x.csv}\n", t=TIME, **columns))["doubts"] == []


def test_two_clocks_come_together_on_the_first(tmp_path):
    other = TIME[:-5] + 0.003
    late = pd.DataFrame({"ms": 1e3 * other, "qd": np.interp(other, TIME, DESIRED[:, 0])})
    late.to_csv(tmp_path / "y.csv", index=False)
    text = "columns: {t: time s, ms: time ms, qd: q_d 2 deg, q: q_encoder 2 deg}\n"
    _, mapping = made(
        tmp_path, text + "runs: {controller_1: [x.csv, y.csv]}\n", t=TIME, q=MEASURED["controller_1"][:, 0]
    )
    assert any("controller_1" in note for note in ingest(tmp_path, mapping)["notes"])
    trace = read_traces(tmp_path / "measured.h5").runs["controller_1"]
    expected = np.interp(trace.time + TIME[1], TIME, DESIRED[:, 0])
    assert np.rad2deg(trace["q_d"][:, 0]) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    "run",
    [
        "y.csv",
        *(f"{{sources: x.csv, {what}}}" for what in ("where: {law: 9}", "where: {other: 1}", "from_s: 100")),
    ],
)
def test_a_mapping_that_does_not_fit_names_its_line(run, tmp_path):
    path, mapping = made(
        tmp_path, f"{BOTH}runs: {{controller_1: {run}}}\n", t=TIME, law=0.0 * TIME, q=DESIRED[:, 0]
    )
    with pytest.raises(ConfigError, match=r"mapping\.yaml:2"):
        ingest(path, mapping)


def test_a_curve_that_was_read_off_needs_five_points(tmp_path):
    def read_off(points):
        run = f"{{sources: x.csv, reading_error_deg: 0.1, to_s: {TIME[points - 1] + 1e-6}}}"
        text = f"{BOTH}runs: {{controller_1: {run}}}\n"
        path, mapping = made(tmp_path, text, t=TIME, qd=DESIRED[:, 0], q=DESIRED[:, 0])
        return ingest(path, mapping, dry_run=True)["runs"]["controller_1"]

    assert read_off(5)["duration_s"] == pytest.approx(TIME[4])
    with pytest.raises(ConfigError, match=r"mapping\.yaml:2"):
        read_off(4)


def test_times_that_do_not_increase_are_refused(tmp_path):
    path, mapping = made(
        tmp_path, BOTH + "runs: {controller_1: x.csv}\n", t=np.tile(TIME, 2), q=np.tile(DESIRED[:, 0], 2)
    )
    with pytest.raises(ConfigError, match=r"x\.csv"):
        ingest(path, mapping)


def test_what_is_there_is_not_overwritten(tmp_path):
    path, mapping = made(tmp_path, BOTH + "runs: {controller_1: x.csv}\n", t=TIME, q=DESIRED[:, 0])
    with pytest.raises(UsageError):
        inspect(path, mapping)
    out = tmp_path / "measured.h5"
    assert ingest(path, mapping, dry_run=True)["runs"]
    assert not out.exists()
    out.write_bytes(b"SYNTHETIC work of a user")
    with pytest.raises(UsageError):
        ingest(path, mapping)
    assert out.read_bytes() == b"SYNTHETIC work of a user"
    ingest(path, mapping, force=True)


def test_missing_paths_and_mappings(tmp_path, made_record):
    with pytest.raises(DataMissingError, match="nowhere"):
        inspect(tmp_path / "nowhere", None)
    with pytest.raises(ConfigError, match=r"none\.yaml"):
        ingest(made_record, tmp_path / "none.yaml")


DAMAGED = {
    "a.mat": b"MATLAB 5.0 MAT-file" + b"x" * 300,
    "b.h5": b"\x89HDF\r\n\x1a\n" + b"x" * 300,
    "c.xlsx": b"PK\x03\x04" + b"x" * 300,
    "d.npy": b"\x93NUMPY" + b"x" * 100,
    "e.zip": b"PK\x03\x04" + b"x" * 100,
    "f.opju": b"x" * 100,
    "g.tar.gz": b"\x1f\x8b" + b"x" * 100,
    "h.csv": b"t,q2\n0,1\n1,2\n",
}


def test_a_damaged_file_is_a_sentence_and_the_rest_is_read(tmp_path):
    for name, content in DAMAGED.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "good.csv").write_text("t,q2\n" + "".join(f"{k},{k}\n" for k in range(20)))
    sources, unread, _ = read_files([tmp_path])
    assert [source.name for source in sources] == ["good.csv"]
    assert set(unread) == set(DAMAGED)
