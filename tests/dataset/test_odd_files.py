"""Files as labs and instruments write them: the right errors come out, or the right question.

All made up here, SYNTHETIC: joint 2 moves by 30 sin²(πt/4) deg and errs by 0.3 sin(πt/2) deg, joint 3 by a
third of that.
"""

import os
import shutil
import sys
import tarfile
import zipfile
from datetime import timedelta
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest
from support.command import answer, run
from support.matlab_bytes import classic, record

from tendonrepro.console import QUIET
from tendonrepro.dataset.ingestion import run_ingest, run_inspect
from tendonrepro.dataset.read import read_files
from tendonrepro.errors import ConfigError, DataMissingError
from tendonrepro.results.traces import read_traces

T = np.round(0.01 * np.arange(400), 2)
DESIRED = {joint: size * np.sin(np.pi * T / 4.0) ** 2 for joint, size in ((2, 30.0), (3, 20.0))}
ERROR = {joint: size * np.sin(np.pi * T / 2.0) for joint, size in ((2, 0.3), (3, 0.1))}
ACTUAL = {joint: DESIRED[joint] - ERROR[joint] for joint in (2, 3)}
MAE = [0.19098, 0.06366]
NAMES = ["time (s)", "q2_d (deg)", "q2 (deg)", "q3_d (deg)", "q3 (deg)"]
NUMBERS = np.column_stack([T, DESIRED[2], ACTUAL[2], DESIRED[3], ACTUAL[3]])


def lines(rows=NUMBERS, separator=",", form="{:.4f}"):
    return "".join(separator.join(form.format(x) for x in row) + "\n" for row in rows)


def ingested(folder, name, content, edit=lambda text: text):
    """Suggest a mapping for a file SYNTHETIC_c1<name>, edit it, ingest: the result, runs and the mapping."""
    path = folder / f"SYNTHETIC_c1{name}"
    if callable(content):
        content(path)
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return ingested_from(path, edit)


def ingested_from(path, edit=lambda text: text):
    mapping, out = path.parent / "m.yaml", path.parent / "o.h5"
    run_inspect([path], mapping, force=True)
    mapping.write_text(edit(mapping.read_text(encoding="utf-8")), encoding="utf-8")
    found = run_ingest([path], mapping, out, force=True, dry_run=False, talk=QUIET)
    return found, read_traces(out).runs, mapping.read_text(encoding="utf-8")


def mae(found, run="controller_1"):
    return pytest.approx(found["runs"][run]["mae_deg"], abs=2e-4)


HEADS = ",".join(NAMES) + "\n"


def durations(path):
    book = openpyxl.Workbook()
    book.active.append(["time", *NAMES[1:]])
    for row in NUMBERS.tolist():
        book.active.append([timedelta(seconds=row[0]), *row[1:]])
    book.save(path)


def with_names(path):
    classic(path, {"log": record(data=NUMBERS, signalNames=np.array([NAMES], dtype=object))})


HEAD_OF_LABVIEW = (
    "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\n\t\nChannels\t4\t\t\t\n"
    "Samples\t400\t400\t400\t400\nX0\t0\t0\t0\t0\nDelta_X\t0.01\t0.01\t0.01\t0.01\n***End_of_Header***\n"
)


def labview(columns):
    """Text of a LabVIEW measurement."""
    rows = NUMBERS if columns[0] == "X_Value" else NUMBERS[:, 1:]
    return HEAD_OF_LABVIEW + "\t".join([*columns, "Comment"]) + "\n" + lines(rows, "\t").replace("\n", "\t\n")


def thousands():
    rows = "".join(f"{3.5 * k:,.1f};{row[1]:.4f};{row[2]:.4f}\n" for k, row in enumerate(NUMBERS))
    return f"t (ms);q2_d (deg);q2 (deg)\n{rows}"


def clocked(form):
    """Times of day, as of a measurement that takes four seconds before noon."""
    day = [form.format(56.0 + t) for t in T]
    return HEADS.replace(" (s)", "", 1) + "".join(
        f"{clock},{row}\n" for clock, row in zip(day, lines(NUMBERS[:, 1:]).splitlines(), strict=True)
    )


PREAMBLE = "".join(f"Parameter {k},{1.5 * k}\n" for k in range(70))
BARE = "time(s),q2 desired(deg),q2 actual(deg),q3_d(deg),q3(deg)\n"
CHINESE = "时间(s),关节2期望角度(deg),关节2实际角度(deg),关节3期望角度(deg),关节3实际角度(deg)\n"
NOTED = HEADS.replace("time (s),", 'time (s),"note, operator",')
ROWS_OF_SCOPE = "".join(
    "\t".join([label, *(cells if isinstance(cells, list) else [cells] * 4)]) + "\n"
    for label, cells in {
        "Name": ["q2_d", "q2", "q3_d", "q3"],
        "Data-Type": "LREAL",
        "SymbolName": ["G.a", "G.b", "G.c", "G.d"],
        "Unit": "deg (Angle)",
        "Unit Offset": "0",
    }.items()
)
IN_MS = np.column_stack([1e3 * T, NUMBERS[:, 1:]])
IN_RADIANS = np.column_stack([T, np.deg2rad(NUMBERS[:, 1:])])
OF_ROS = "%time,field.header.seq,field.want.name0,field.desired.positions0,field.desired.positions1," + (
    "field.actual.positions0,field.actual.positions1\n"
)


def topics():
    rows = zip(range(400), NUMBERS[:, [1, 3, 2, 4]], strict=True)
    angles = ((k, ",".join(f"{np.deg2rad(x):.6f}" for x in row)) for k, row in rows)
    return OF_ROS + "".join(f"{17 * 10**17 + 10**7 * k},{k},elbow,{told}\n" for k, told in angles)


def stamps():
    rows = ((divmod(98 + k, 100), row) for k, row in enumerate(NUMBERS[:, 1:]))
    told = (f"{s},{10**7 * cs}," + ",".join(f"{x:.4f}" for x in row) + "\n" for (s, cs), row in rows)
    return "header.stamp.sec,header.stamp.nanosec," + ",".join(NAMES[1:]) + "\n" + "".join(told)


def a_row_a_joint(late=0.0, word="axis_"):
    rows = ((k, joint) for k in range(400) for joint in (2, 3))
    told = (
        f"{0.01 * k + late * (j == 3):.3f},{word}{j},{DESIRED[j][k]:.6f},{ACTUAL[j][k]:.6f}\n"
        for k, j in rows
    )
    return "stamp_sec,joint,desired_position,actual_position\n" + "".join(told)


def from_zero():
    return "t,q_d_0,q_0,q_d_1,q_1\n" + lines(IN_RADIANS, form="{:.6f}")


PLAIN = {
    "names over several lines": (
        ".csv",
        '"Time\n(s)","Soll\nq2_d (deg)",q2 (deg),q3_d (deg),"Ist\r\nq3 (deg)"\n' + lines(),
        MAE,
    ),
    "a quote that nothing closes": (".csv", 'Rod,"5\n' + HEADS + lines(), MAE),
    "commands above the numbers": (".csv", HEADS + "begin,home,home,home,home\n" + lines(), MAE),
    "names below the header": (".csv", HEADS + "clock,desired,actual,desired,actual\n" + lines(), MAE),
    "rows of a scope": (".csv", f"Name\trig\nFile\trig.csv\n\n{ROWS_OF_SCOPE}\n" + lines(IN_MS, "\t"), MAE),
    "times beside each signal of a scope": (
        ".csv",
        "Name\tq2_d\tName\tq2\nUnit\tdeg\tUnit\tdeg\nOffset\t0\tOffset\t0\n"
        + lines(IN_MS[:, [0, 1, 0, 2]], "\t"),
        MAE[:1],
    ),
    "degrees by a setting": (
        ".mot",
        "rig\nversion=1\ninDegrees=yes\nendheader\ntime\tq2_d\tq2\n"
        + lines(NUMBERS[:, :3] / [1, 20, 20], "\t", "{:.6f}"),
        [MAE[0] / 20],
    ),
    "a ring above as degrees": (".csv", HEADS.replace("deg", "˚") + lines(), MAE),
    "topics of ROS": (".csv", topics(), MAE),
    "seconds and nanoseconds": (".csv", stamps(), MAE),
    "a row a joint": (".csv", a_row_a_joint(), MAE),
    "a row a joint, by number": (".csv", a_row_a_joint(word=""), MAE),
    "joints from 0": (".csv", from_zero(), MAE),
    "quoted header": (".csv", NOTED + lines(np.insert(NUMBERS, 1, 7.0, axis=1)), MAE),
    "no blank before the bracket": (".csv", BARE + lines(), MAE),
    "Chinese, no blank": (".csv", (CHINESE + lines()).encode("gbk"), MAE),
    "quoted decimal commas": (
        ".csv",
        HEADS + "".join(",".join(f'"{x:.4f}"'.replace(".", ",") for x in row) + "\n" for row in NUMBERS),
        MAE,
    ),
    "thousands": (".csv", thousands(), MAE[:1]),
    "header below line 60": (".csv", PREAMBLE + HEADS + lines(), MAE),
    "exponents of Fortran": (".dat", HEADS + lines(form="{:.6e}").replace("e", "D"), MAE),
    "marks of LaTeX": (".csv", r"t,q_{d2},q_{2},\theta_{d3},\theta_3" + "\n" + lines(), MAE),
    "one bad byte": (".csv", b"\xce\xb8 " * 9 + b"\xff\n" + (HEADS + lines()).encode(), MAE),
    "LabVIEW": (".lvm", labview(["X_Value", *NAMES[1:]]), MAE),
    "LabVIEW without times": (".lvm", labview(NAMES[1:]), MAE),
    "tab text named xls": (".xls", "\t".join(NAMES) + "\n" + lines(separator="\t"), MAE),
    "durations of Excel": (".xlsx", durations, MAE),
    "durations": (".csv", clocked("0:59:{:06.3f}"), MAE),
    "dates": (".csv", clocked("2026-11-29T11:59:{:06.3f}"), MAE),
    "names beside a block": (".mat", with_names, MAE),
}


@pytest.mark.parametrize("kind", PLAIN)
def test_a_plain_table_however_it_is_written(kind, tmp_path):
    suffix, content, expected = PLAIN[kind]
    found, runs, mapping = ingested(tmp_path, suffix, content)
    assert ":Sheet" not in mapping
    assert found["runs"]["controller_1"]["samples"] == 400
    assert mae(found) == expected
    assert runs["controller_1"].time[-1] == pytest.approx(1.3965 if kind == "thousands" else 3.99)
    assert any("UTF-8" in note for note in found["notes"]) == (kind == "one bad byte")


def test_a_first_sample_with_a_time_alone_is_a_sample(tmp_path):
    rows = lines().splitlines(keepends=True)
    found, runs, _ = ingested(tmp_path, ".csv", HEADS + "0.0000,,,,\n" + "".join(rows[1:]))
    assert found["runs"]["controller_1"]["samples"] == 400
    assert mae(found) == [np.abs(ERROR[joint][1:]).mean() for joint in (2, 3)]
    assert np.isnan(runs["controller_1"]["e"][0]).all()


def test_names_that_say_everything_are_not_asked_about(tmp_path):
    """Joints that are counted from 0 are."""
    _, _, mapping = ingested(tmp_path, ".csv", HEADS + lines())
    assert "CHECK" not in mapping
    _, _, mapping = ingested(tmp_path, ".csv", from_zero())
    assert all("CHECK" in line for line in mapping.splitlines() if line.startswith('  "q_'))


def test_joints_of_a_row_each_with_times_of_their_own(tmp_path):
    content = a_row_a_joint(late=0.002)
    found, runs, _ = ingested(tmp_path, ".csv", content)
    assert runs["controller_1"].joint == (2, 3)
    assert found["runs"]["controller_1"]["mae_deg"] == pytest.approx(MAE, rel=0.01)


@pytest.mark.parametrize("others", [0, 2])
def test_desired_and_measured_in_alternate_rows(tmp_path, others):
    """Other topics between them do not make a figure of it that was read off."""
    table = pd.DataFrame({"__time": T, "q2_d (deg)": DESIRED[2]})
    late = T + 0.003
    angle = 30.0 * np.sin(np.pi * late / 4.0) ** 2 - 0.3 * np.sin(np.pi * late / 2.0)
    table = pd.concat([table, pd.DataFrame({"__time": late, "q2 (deg)": angle})])
    for k in range(others):
        more = pd.DataFrame({"__time": T + 0.0041 + 0.0032 * k, f"tau{2 + k} (Nm)": DESIRED[2]})
        table = pd.concat([table, more])
    content = table.sort_values("__time").to_csv(index=False, float_format="%.6f")
    found, runs, _ = ingested(tmp_path, ".csv", content)
    assert found["runs"]["controller_1"]["mae_deg"][0] == pytest.approx(MAE[0], abs=1e-3)
    assert np.diff(runs["controller_1"].time) == pytest.approx(0.01)
    assert any("interpolated" in note for note in found["notes"])
    assert not any("gaps" in note or "missing" in note for note in found["notes"])


def test_gaps_of_one_signal_stay_gaps(tmp_path):
    """They are no alternate rows, even where two signals have theirs at different times."""
    rows = NUMBERS.copy()
    rows[50:80, 1] = rows[200:230, 2] = np.nan
    found, runs, _ = ingested(tmp_path, ".csv", HEADS + lines(rows).replace("nan", ""))
    assert found["runs"]["controller_1"]["samples"] == 400
    assert np.isnan(runs["controller_1"]["e"][:, 0]).sum() == 60


@pytest.mark.parametrize("status", [True, False])
def test_angles_in_radians_beside_rates_and_a_status(tmp_path, status):
    """As a robot's controller logs them: a status of 253 is no angle, and target_qd no desired angle."""
    rows = np.deg2rad(np.column_stack([DESIRED[2], np.gradient(DESIRED[2], 0.01), ACTUAL[2]]))
    rows = np.column_stack([T, rows, np.gradient(rows[:, 2], 0.01), np.full(400, 253.0)])
    head = "timestamp target_q_2 target_qd_2 actual_q_2 actual_qd_2 joint_mode_2\n"
    kept = slice(None) if status else slice(5)
    content = " ".join(head.split()[kept]) + "\n" + lines(rows[:, kept], " ", "{:.6f}")
    found, runs, mapping = ingested(tmp_path, ".csv", content)
    assert mae(found) == MAE[:1]
    assert set(runs["controller_1"].variables) == {"q_d", "q_encoder", "e", "dq", "dq_d"}
    assert runs["controller_1"]["dq_d"][:, 0] == pytest.approx(rows[:, 2], abs=1e-4)
    assert found["doubts"] == []
    assert all("CHECK" in line for line in mapping.splitlines() if "qd_2" in line)


def test_a_rate_of_what_was_measured_needs_nothing_beside_it(tmp_path):
    rows = np.column_stack([NUMBERS[:, [0, 2]], np.gradient(ACTUAL[2], 0.01)])
    _, runs, mapping = ingested(tmp_path, ".csv", "t,actual_q_2,actual_qd_2\n" + lines(rows))
    assert set(runs["controller_1"].variables) == {"q_encoder", "dq"}
    assert "CHECK" in next(line for line in mapping.splitlines() if "actual_qd_2" in line)


def test_the_load_of_a_column_goes_before_that_of_its_file(tmp_path):
    names = ["t (s)", "q2_d (deg)", "C1 q2 (deg)", "C2 q2 (deg)", "C1 with 0.2 kg payload q2 (deg)"]
    columns = [T, DESIRED[2], *(DESIRED[2] - k * ERROR[2] for k in (1, 2, 3))]
    path = tmp_path / "SYNTHETIC_payload.csv"
    path.write_text(",".join(names) + "\n" + lines(np.column_stack(columns)))
    found, _, _ = ingested_from(path)
    expected = {"controller_1": (1, 0.0), "controller_2": (2, 0.0), "controller_1_payload": (3, 0.2)}
    assert set(found["runs"]) == set(expected)
    assert found["guesses"] == []
    for name, (size, mass) in expected.items():
        assert mae(found, name) == [size * MAE[0]]
        assert found["runs"][name]["payload_mass_kg"] == mass


def test_a_name_does_not_speak_to_the_terminal(tmp_path):
    for sign in ("\x1b]0;mine\x07", "\x9b31m"):
        path = tmp_path / "SYNTHETIC_c1.csv"
        path.write_text(HEADS.replace("q2_d", f"{sign}q2_d") + lines(), encoding="utf-8")
        for words in ([], ["--json"]):
            shown = run("data", "inspect", str(path), *words, cwd=tmp_path).stdout
            assert sign[0] not in shown
            assert f"{ord(sign[0]):04x}" in shown


def test_a_name_with_characters_that_yaml_refuses_stands_in_a_mapping(tmp_path):
    for sign in ("\x1b[1m", "\x9b31m", "\x7f", "\u2028", "\ufffe"):
        # One is used, one is asked for.
        heads = HEADS.replace("q2_d", f"q2_d{sign}").replace("q3", f"{sign}odd{sign}word")
        found, mapping, _ = ingested(tmp_path, ".csv", heads + lines())
        assert found["runs"]["controller_1"]["joints"], mapping


def test_a_curve_follows_the_times_to_its_left(tmp_path):
    late = np.round(T + 0.05, 2)
    angle = 30.0 * np.sin(np.pi * late / 4.0) ** 2 - 0.3 * np.sin(np.pi * late / 2.0)
    rows = np.column_stack([T, DESIRED[2], late, angle])
    found, _, _ = ingested(tmp_path, ".csv", "time_ref (s),q2_ref (deg),time (s),q2 (deg)\n" + lines(rows))
    # The first 0.05 s, where the error is small, has no measured angle.
    assert mae(found) == [np.abs(ERROR[2])[5:].mean()]
    assert any("interpolated" in note for note in found["notes"])


def test_columns_of_one_name_are_asked(tmp_path):
    rows = NUMBERS[:, :3]
    _, _, mapping = ingested(tmp_path, ".csv", "time (s),q2 (deg),q2 (deg)\n" + lines(rows))
    assert "CHECK" in next(line for line in mapping.splitlines() if line.strip().startswith('"q2 (deg)"'))


def test_a_rate_is_not_a_reference(tmp_path):
    rate = np.gradient(ACTUAL[2], 0.01)
    rows = np.column_stack([T, ACTUAL[2], rate, np.gradient(rate, 0.01), DESIRED[2]])
    found, runs, mapping = ingested(tmp_path, ".csv", "t,q2,qd2,qdd2,q2_ref\n" + lines(rows))
    assert mae(found) == MAE[:1]
    np.testing.assert_allclose(np.rad2deg(runs["controller_1"]["dq"][:, 0]), rate, atol=1e-3)
    assert "CHECK" in next(line for line in mapping.splitlines() if '"qd2"' in line)


def test_a_sheet_of_errors_for_each_joint(tmp_path):
    path = tmp_path / "SYNTHETIC.xlsx"
    with pd.ExcelWriter(path) as book:
        for joint in (2, 3):
            columns = {"t (s)": T} | {f"C{k} error (deg)": k * ERROR[joint] for k in (1, 2, 3)}
            pd.DataFrame(columns).to_excel(book, sheet_name=f"joint {joint}", index=False)
        pd.DataFrame({"operator": ["Yan"]}).to_excel(book, sheet_name="remarks", index=False)
    found, _, _ = ingested_from(path)
    assert any("sheet 'remarks'" in note for note in found["notes"])
    for k in (1, 2, 3):
        assert mae(found, f"controller_{k}") == [k * x for x in MAE]


def test_a_time_that_starts_again_begins_a_run(tmp_path):
    rows = [np.column_stack([T, DESIRED[2], DESIRED[2] - k * ERROR[2]]) for k in (1, 2, 3)]
    found, _, _ = ingested(tmp_path, ".csv", ",".join(NAMES[:3]) + "\n" + lines(np.concatenate(rows)))
    assert [run["samples"] for run in found["runs"].values()] == [400] * 3
    assert all(mae(found, f"controller_1_{k}") == [k * MAE[0]] for k in (1, 2, 3))


def test_of_times_side_by_side_the_first_count_and_the_others_are_asked(tmp_path):
    rows = np.column_stack([T, 2.0e3 * T, NUMBERS[:, 1:]])
    head = HEADS.replace("q2_d", "clock (ms),q2_d", 1)
    found, runs, mapping = ingested(tmp_path, ".csv", head + lines(rows))
    assert mae(found) == MAE
    assert runs["controller_1"].time[-1] == pytest.approx(3.99)
    asked = [line for line in mapping.splitlines() if "CHECK" in line]
    assert [line.split('"')[1] for line in asked] == ["clock (ms)"]


@pytest.mark.parametrize(
    ("keys", "named", "samples"),
    [
        ("part: 2", "part", 400),
        ("to_s: 99", "without a time", 399),
        ("where: {q2_d (deg): 15}, from_s: -1", "where", 2),
        ("step_s: 0.01, from_s: 1, to_s: 1.985", "from_s", 99),
    ],
)
def test_rows_left_out_are_counted_by_what_left_them_out(tmp_path, keys, named, samples):
    rows = np.concatenate([NUMBERS] * (2 if named == "part" else 1))
    rows[10, 0] = np.nan if named == "without a time" else 0.1
    columns = "{time (s): time s, q2 (deg): q_encoder 2 deg}"
    (tmp_path / "a.csv").write_text(HEADS + lines(rows).replace("nan", ""))
    mapping = tmp_path / "m.yaml"
    mapping.write_text(f"columns: {columns}\nruns: {{x: {{sources: a.csv, {keys}}}}}\n")
    found = run_ingest([tmp_path / "a.csv"], mapping, tmp_path / "o.h5", force=True, dry_run=True, talk=QUIET)
    assert found["runs"]["x"]["samples"] == samples
    (told,) = [note for note in found["notes"] if "left out" in note]
    assert f"{len(rows) - samples} of {len(rows)} rows" in told
    assert named in told


def test_rounded_times_that_repeat(tmp_path):
    rows = NUMBERS.copy()
    rows[:, 0] = np.round(rows[:, 0], 1)
    found, runs, mapping = ingested(tmp_path, ".csv", HEADS + lines(rows))
    assert mae(found) == MAE
    assert runs["controller_1"].time[-1] == pytest.approx(3.99)
    without = "\n".join(line for line in mapping.splitlines() if "step_s" not in line)
    with pytest.raises(ConfigError) as caught:
        ingested(tmp_path, ".csv", HEADS + lines(rows), lambda _: without)
    assert "step_s" in str(caught.value.hint)


def test_a_table_without_times_asks_for_their_step(tmp_path):
    rest = HEADS.partition(",")[2] + lines(NUMBERS[:, 1:])
    found, runs, _ = ingested(tmp_path, ".csv", rest, lambda text: text.replace("STEP", "0.01"))
    assert mae(found) == MAE
    assert runs["controller_1"].time[-1] == pytest.approx(3.99)


def test_a_unit_row_with_a_unit_that_is_not_known(tmp_path):
    head = "Index:;0x60;0x61\n;Position demand q2;Position actual q2\nms;inc;inc\n"
    rows = np.column_stack([1e3 * T, 100.0 * DESIRED[2], 100.0 * ACTUAL[2]])

    def filled(text):
        return text.replace("q_d 2 UNIT", "q_d 2 deg * 0.01").replace(
            "q_encoder 2 UNIT", "q_encoder 2 deg * 0.01"
        )

    found, runs, _ = ingested(tmp_path, ".csv", head + lines(rows, ";"), filled)
    assert mae(found) == MAE[:1]
    assert runs["controller_1"].time[-1] == pytest.approx(3.99)


@pytest.mark.parametrize("first", [True, False])
def test_a_block_without_names_asks_for_them(tmp_path, first):
    """As To File of Simulink writes it: times in the first row."""
    block = NUMBERS.T if first else NUMBERS

    def filled(text):
        for k, use in enumerate(("q_d 2", "q_encoder 2", "q_d 3", "q_encoder 3"), start=2):
            text = text.replace(f'"ans[{k}]": VARIABLE JOINT UNIT', f'"ans[{k}]": {use} deg')
        return text

    with pytest.raises(ConfigError, match=r"m\.yaml:5"):
        ingested(tmp_path, ".mat", lambda path: classic(path, {"ans": block}))
    found, _, _ = ingested(tmp_path, ".mat", lambda path: classic(path, {"ans": block}), filled)
    assert mae(found) == MAE


def test_columns_of_an_array_that_would_be_the_same_are_not_guessed(tmp_path):
    blocks = np.stack([NUMBERS[:, [1, 2]], NUMBERS[:, [3, 4]]]).transpose(0, 2, 1)
    path = tmp_path / "SYNTHETIC_3d_joint2_c1.mat"
    classic(path, {"t": T[:, None], "q_d": blocks, "q": NUMBERS[:, 1:]})
    assert run_inspect([path], None, force=False)["runs"] == {"controller_1": 0}


def test_angles_in_a_file_that_is_named_after_torque_stay_angles(tmp_path):
    found, _, _ = ingested(tmp_path, "_torque.csv", HEADS + lines())
    assert mae(found) == MAE


def test_a_column_of_the_mapping_that_no_table_has_is_told(tmp_path):
    found, _, _ = ingested(tmp_path, ".csv", HEADS + lines(), lambda text: text.replace("q3_d", "q3_desired"))
    assert any("q3_desired" in doubt for doubt in found["doubts"])


def test_what_no_variable_holds_is_left_out(tmp_path):
    names = ["time", "q2_d", "q2", "m2", "motor 2 speed", "vel 2", "position 3", "joint 3 voltage", "dq2"]
    head = ";".join(names) + "\ns;deg;deg;V;rad/s;m/s;m;;deg/s\n"
    rows = np.column_stack([T, DESIRED[2], ACTUAL[2], *[ACTUAL[3]] * 6])
    found, _, _ = ingested(tmp_path, ".csv", head + lines(rows, ";"))
    assert mae(found) == MAE[:1]
    assert set(found["runs"]["controller_1"]["variables"]) == {"q_d", "q_encoder", "e", "dq"}


def test_a_structure_says_what_its_columns_are_of(tmp_path):
    """A velocity of the motors is none of the joints, nor is a voltage an angle."""
    path, angles = tmp_path / "SYNTHETIC_c1.mat", NUMBERS[:, [2, 4]]
    joints = record(time=T[:, None], desired=NUMBERS[:, [1, 3]], actual=angles, velocity=angles)
    motors = record(time=T[:, None], desired=angles, actual=angles, velocity=angles)
    volts = record(time=T[:, None], motor=angles, q=angles)
    classic(path, {"joint": joints, "motor": motors, "voltage": volts})
    found, _, mapping = ingested_from(path)
    assert mae(found) == MAE
    guessed = [line.strip().split(": ") for line in mapping.splitlines() if line.startswith('  "')]
    assert {name.strip('"'): use.split()[0] for name, use, *_ in guessed if "[2]" not in name} == {
        "time": "time",
        "desired[1]": "q_d",
        "joint:actual[1]": "q_encoder",
        "velocity[1]": "dq",
        "motor:actual[1]": "q_motor_encoder",
    }


def test_rows_cells_and_gaps_are_counted(tmp_path):
    rows = lines().splitlines(keepends=True)
    rows[50] = "a remark\n"
    rows[100] = rows[100].replace(rows[100].split(",")[2], "ERR", 1)
    del rows[200:210]
    found, _, _ = ingested(tmp_path, ".csv", HEADS + "".join(rows))
    told = " ".join(found["notes"])
    assert "1 rows without a number" in told
    assert "'ERR' in row 100" in told
    assert "gaps in the times, the longest of 0.11 s" in told
    assert found["runs"]["controller_1"]["samples"] == 389


def test_a_comma_that_may_mean_two_things_is_told(tmp_path):
    """Beside numbers with points it stands between thousands, which is told, too."""
    rows = "".join(f"{x:.2f};{1 + k % 3},{100 + k};{k % 7}.5\n" for k, x in enumerate(T))
    path = tmp_path / "SYNTHETIC.csv"
    path.write_text("t;q2;n\n" + rows + "4.00;1,500;1,234\n")
    found = read_files([path])
    assert any("q2" in line and "unclear" in line for line in found.left_out["SYNTHETIC.csv"])
    assert found.tables[0]["q2"].dtype.kind != "f"
    assert any("'n'" in line and "thousands" in line for line in found.left_out["SYNTHETIC.csv"])
    assert found.tables[0]["n"][-1] == 1234.0


class _Chinese(zipfile.ZipInfo):
    """A member that is named as Windows in Chinese names it, without saying so."""

    def _encodeFilenameFlags(self):
        return self.filename.encode("gbk"), self.flag_bits


def zipped(path, names, content):
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(_Chinese(name), content)


def packed(path, names, content, encoding="gbk"):
    with tarfile.open(path, "w:gz", encoding=encoding, format=tarfile.GNU_FORMAT) as archive:
        for name in names:
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, BytesIO(content))


@pytest.mark.parametrize(
    ("suffix", "write"), [("zip", zipped), ("tar.gz", packed), ("tar.gz", partial(packed, encoding="utf-8"))]
)
def test_chinese_names_in_an_archive(tmp_path, suffix, write):
    names = [f"控制器{k}空载.csv" for k in (1, 2)]
    path = tmp_path / f"SYNTHETIC.{suffix}"
    write(path, names, (HEADS + lines()).encode())
    sources, unread, _ = read_files([path])
    assert [source.name for source in sources] == [f"{path.name}/{name}" for name in names]
    assert not unread


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text there")
def test_a_name_on_disk_that_is_not_of_this_system(tmp_path):
    (tmp_path / "SYNTHETIC").mkdir()
    (tmp_path / "SYNTHETIC" / os.fsdecode("größe_c1.csv".encode("cp1252"))).write_text(HEADS + lines())
    words = "ingest", "SYNTHETIC", "--mapping", "m.yaml", "--out", "o.h5"
    answer("data", "inspect", "SYNTHETIC", "--mapping", "m.yaml", cwd=tmp_path)
    assert [*answer(*words, "--confirm", cwd=tmp_path)["runs"]] == ["controller_1"]


@pytest.mark.parametrize("suffix", ["zip", "gztar"])
def test_an_archive_of_more_than_a_file_may_have_is_not_unpacked(tmp_path, monkeypatch, suffix):
    (tmp_path / "files").mkdir()
    for name in ("a.csv", "b.csv"):
        (tmp_path / "files" / name).write_text(HEADS + lines())
    archive = Path(shutil.make_archive(str(tmp_path / "big"), suffix, tmp_path / "files"))
    size = len(HEADS + lines())
    monkeypatch.setattr("tendonrepro.dataset.read.MOST_BYTES", 2 * size)
    assert len(read_files([archive]).tables) == 2
    monkeypatch.setattr("tendonrepro.dataset.read.MOST_BYTES", 2 * size - 1)
    for kind in (zipfile.ZipFile, tarfile.TarFile):
        monkeypatch.setattr(kind, "extractall", lambda *_, **__: pytest.fail("it was unpacked"))
    with pytest.raises(DataMissingError, match="big"):
        read_files([archive])


def test_tdms_of_labview(tmp_path):
    nptdms = pytest.importorskip("nptdms")

    def write(path):
        waveform = {"wf_increment": 0.01, "wf_start_offset": 0.0, "unit_string": "deg"}
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    nptdms.ChannelObject("arm", name, column, properties=waveform)
                    for name, column in (("q2_d", DESIRED[2]), ("q2", ACTUAL[2]))
                ]
            )

    found, _, _ = ingested(tmp_path, ".tdms", write)
    assert mae(found) == MAE[:1]


def test_desired_angles_of_their_own_file_are_given_to_every_controller(tmp_path):
    folder = tmp_path / "SYNTHETIC"
    folder.mkdir()
    pd.DataFrame({"t (s)": T, "q2_d (deg)": DESIRED[2]}).to_csv(folder / "desired.csv", index=False)
    for k in (1, 2):
        columns = {"t (s)": T, "q2 (deg)": DESIRED[2] - k * ERROR[2]}
        pd.DataFrame(columns).to_csv(folder / f"controller{k}.csv", index=False)
    found, _, mapping = ingested_from(folder)
    assert set(found["runs"]) == {"controller_1", "controller_2"}
    for k in (1, 2):
        assert mae(found, f"controller_{k}") == [k * MAE[0]]
    assert mapping.count("desired angles from") == 2


def test_desired_angles_alone_are_a_run(tmp_path):
    """Each joint's in a file of its own, as curves of a figure are."""
    (tmp_path / "SYNTHETIC").mkdir()
    for joint in (2, 3):
        columns = {"t (s)": T, f"q{joint}_d (deg)": DESIRED[joint]}
        pd.DataFrame(columns).to_csv(tmp_path / "SYNTHETIC" / f"curve{joint}.csv", index=False)
    found, _, _ = ingested_from(tmp_path / "SYNTHETIC")
    assert {name: run["joints"] for name, run in found["runs"].items()} == {"desired": [2, 3]}


def test_a_standstill_is_left_out_as_validate_leaves_it_out(tmp_path):
    """Two seconds of rest before the motion would halve the error of one number beside the other."""
    still = np.column_stack([T[:200], *np.zeros((4, 200))])
    moving = NUMBERS.copy()
    moving[:, 0] += 2.0
    found, _, _ = ingested(tmp_path, ".csv", HEADS + lines(np.concatenate([still, moving])))
    assert found["runs"]["controller_1"]["errors_from_s"] == pytest.approx(2.0, abs=0.1)
    assert found["runs"]["controller_1"]["mae_deg"] == pytest.approx(MAE, rel=0.02)


def test_what_cannot_be_read_is_named_with_a_remedy_and_the_rest_is_read(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "nptdms", None)
    one = labview(["X_Value", *NAMES[1:]])
    # Its second header would stand in the middle of the numbers.
    (tmp_path / "segments.lvm").write_text(one + one[one.index("Channels") :])
    (tmp_path / "octave.mat").write_text("# Created by Octave 6.4.0\n# name: t\n# type: matrix\n 0\n 1\n")
    (tmp_path / "labview.tdms").write_bytes(b"TDSm" + bytes(100))
    (tmp_path / "good.csv").write_text(HEADS + lines())
    found = read_files([tmp_path])
    assert len(found.tables) == 1
    words = {"segments.lvm": "segments", "octave.mat": "Octave", "labview.tdms": "tendonrepro[tdms]"}
    assert all(word in found.unread[name] for name, word in words.items())


SHAKE = 60.0 * np.sin(6.0 * np.pi * T)
"""Of the size of the motion, and nothing like it, deg."""


@pytest.mark.parametrize(
    ("factor", "shake", "doubts"),
    [(1.0, 0.0, 0), (57.3, 0.0, 1), (-1.0, 0.0, 1), (0.0, 0.0, 1), (1.0, 1.0, 1)],
)
def test_a_rate_that_is_no_slope_is_told(tmp_path, factor, shake, doubts):
    rate = factor * np.gradient(ACTUAL[2], 0.01) + shake * np.gradient(SHAKE, 0.01)
    rows = np.column_stack([NUMBERS[:, :3], rate])
    found, _, _ = ingested(tmp_path, ".csv", ",".join(NAMES[:3]) + ",dq2 (deg/s)\n" + lines(rows))
    assert len(found["doubts"]) == doubts


def test_a_joint_at_rest_has_no_rate_to_doubt(tmp_path):
    """Noise of its tachometer, summed up, is not how far it turned."""
    noise = np.random.default_rng(5).normal(0.2, 1.0, 400)
    rows = np.column_stack([NUMBERS[:, :3], 0.02 * np.sign(noise), noise])
    head = ",".join(NAMES[:3]) + ",q3 (deg),dq3 (deg/s)\n"
    found, _, _ = ingested(tmp_path, ".csv", head + lines(rows))
    assert found["doubts"] == []
