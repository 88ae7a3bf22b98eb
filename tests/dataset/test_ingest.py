"""From files to measured traces: layouts of labs, round trips of simulated runs, and what is refused."""

import h5py
import numpy as np
import pandas as pd
import pytest
from support import synthetic_record

from tendonrepro.console import QUIET
from tendonrepro.dataset.ingestion import run_ingest, run_inspect
from tendonrepro.dataset.read import read_files
from tendonrepro.errors import ConfigError, DataMissingError, UsageError
from tendonrepro.results.figures.catalogue import FIGURES, drawings
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


LAYOUTS = {"HDF5": write_hdf5, "folders": write_apart}


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
    assert paper - drawings(file).keys() == {"fig06", "fig15"}
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


@pytest.mark.parametrize(("name", "absent"), [("q", "q_encoder"), ("qd", "q_d"), ("e", "e")])
def test_of_three_two_give_the_third(name, absent, tmp_path):
    columns = {"qd": DESIRED[:, 0], "q": MEASURED["controller_1"][:, 0]}
    columns["e"] = columns["qd"] - columns["q"]
    expected = columns.pop(name)
    ingest(*made(tmp_path, BOTH + "runs: {controller_1: x.csv}\n", t=TIME, **columns))
    trace = read_traces(tmp_path / "measured.h5").runs["controller_1"]
    assert np.rad2deg(trace[absent][:, 0]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("columns", "doubts"),
    [
        ({"q": 57.0 * DESIRED[:, 0]}, ["turn"]),
        ({"qd": DESIRED[:, 0], "q": 0.5 * DESIRED[:, 0]}, ["motion"]),
        ({"qd": DESIRED[:, 0], "q": 0.95 * DESIRED[:, 0], "e": 0.1 * DESIRED[:, 0]}, ["e of joint 2"]),
        ({"qd": DESIRED[:, 0], "q": 0.95 * DESIRED[:, 0], "e": -0.05 * DESIRED[:, 0]}, ["sign"]),
        # An error of the file's own arithmetic is no doubt.
        ({"qd": DESIRED[:, 0], "q": 0.95 * DESIRED[:, 0], "e": np.round(0.05 * DESIRED[:, 0], 3)}, []),
    ],
)
def test_what_looks_wrong_is_said(columns, doubts, tmp_path):
    found = ingest(*made(tmp_path, BOTH + "runs: {controller_1: x.csv}\n", t=TIME, **columns))
    told = [doubt for doubt in found["doubts"] if not doubt.startswith("the mapping")]
    assert len(told) == len(doubts)
    assert all(word in doubt for word, doubt in zip(doubts, told, strict=True))


UNFIT = (
    *("where: {law: 9}", "where: {other: 1}", "from_s: 100", "part: 2", "reading_error_deg: 0.1, to_s: 0.05"),
    "columns: {again: time s, q: q_encoder 2 deg}",
)


@pytest.mark.parametrize("key", ["", *UNFIT])
def test_a_mapping_that_does_not_fit_names_its_line(key, tmp_path):
    run = f"{{sources: x.csv, {key}}}" if key else "y.csv"
    text = f"{BOTH}runs: {{controller_1: {run}}}\n"
    path, mapping = made(tmp_path, text, t=TIME, law=0.0 * TIME, q=DESIRED[:, 0], again=TIME % 5.0)
    with pytest.raises(ConfigError, match=r"mapping\.yaml:2"):
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
