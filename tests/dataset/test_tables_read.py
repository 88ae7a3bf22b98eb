"""Tables in texts, workbooks, NumPy and HDF5 files: what is written comes back, with names and units."""

from __future__ import annotations

import datetime
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from support import seed_files

from tendonrepro.dataset.readers.arrays import read_hdf5, read_npy, read_npz
from tendonrepro.dataset.readers.filetype import FileType, kind_of
from tendonrepro.dataset.readers.signals import BELOW, Found, Unreadable
from tendonrepro.dataset.readers.text import read_text_table
from tendonrepro.dataset.readers.workbook import read_workbook


def of_text(content: str | bytes, folder: Path) -> Found:
    path = folder / "SYNTHETIC.txt"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_text_table(path)


def columns(found: Found) -> dict[str, list[float]]:
    return {signal.path: signal.values.tolist() for signal in found.signals}


def names_and_units(found: Found) -> list[tuple[str, str | None]]:
    return [(signal.label, signal.unit) for signal in found.signals]


TABLE = {"t": [0.0, 1.0, 2.0], "q": [1.5, 2.5, 3.5]}
SPELLINGS = {
    "pipe": "t | q\n0 | 1.5\n1 | 2.5\n2 | 3.5\n",
    "blanks": "  t   q\n  0   1.5\n  1   2.5\n 2   3.5\n",
    "comma and blank": "t, q\n0, 1.5\n1, 2.5\n2, 3.5\n",
    "decimal comma, blanks": "t q\n0,0 1,5\n1,0 2,5\n2,0 3,5\n",
    "line ends of Windows": "t,q\r\n0,1.5\r\n1,2.5\r\n2,3.5\r\n",
    "line ends of old Macs": "t,q\r0,1.5\r1,2.5\r2,3.5",
    "separator at the end": "t,q,\n0,1.5,\n1,2.5,\n2,3.5,\n",
    "quoted": '"t";"q"\n"0";"1,5"\n"1";"2,5"\n"2";"3,5"\n',
    "quotation mark left open": 't,q\n0,1.5"\n1,2.5\n2,3.5\n',
    "exponents of Fortran": "t q\n0.0D+00 0.15D+01\n0.1D+01 0.25D+01\n0.2D+01 0.35D+01\n",
    "comments": "% made up\n// nothing\nt,q\n0,1.5\n# pause\n1,2.5\n2,3.5\n",
    "names in a comment": "# t q\n0 1.5\n1 2.5\n2 3.5\n",
    "names by comma over blanks": "t,q\n0 1.5\n1 2.5\n2 3.5\n",
    "preamble": "SYNTHETIC\nDate: today\n\nt,q\n0,1.5\n1,2.5\n2,3.5\n",
    "settings above": "Rate,1000\nGain,2.5\n\nt,q\n0,1.5\n1,2.5\n2,3.5\n",
    "LabVIEW": "LabVIEW Measurement\t\n"
    "Samples\t1000\t1000\n***End_of_Header***\t\nt\tq\tComment\n0\t1.5\n1\t2.5\n2\t3.5\n",
    "hint of Excel": "sep=;\nt;q\n0;1.5\n1;2.5\n2;3.5\n",
    "byte order mark": "\ufefft,q\n0,1.5\n1,2.5\n2,3.5\n",
    "minus sign of typesetters": "t,q\n−0,1.5\n1,2.5\n2,3.5\n",
}  # fmt: skip


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_table_is_the_same_however_it_is_spelt(spelling: str, tmp_path: Path) -> None:
    found = of_text(SPELLINGS[spelling], tmp_path)
    assert columns(found) == TABLE
    assert {signal.group for signal in found.signals} == {"table"}


CHINESE = "时间(s),期望角度（deg）,角度(°)\n" + "0,1,2\n" * 3
GERMAN = "Zeit / s;Größe des Winkels (deg);M [N·m]\n" + "0,0;1,5;2,25\n" * 3
DEGREE = "t;q (°)\n" + "0;1\n" * 3
NAMES = {
    CHINESE: [("时间", "s"), ("期望角度", "deg"), ("角度", "°")],
    GERMAN: [("Zeit", "s"), ("Größe des Winkels", "deg"), ("M", "N·m")],
    DEGREE: [("t", None), ("q", "°")],
}
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "gbk", "gb18030", "utf-32"]


@pytest.mark.parametrize(
    ("table", "encoding", "mark"),
    [
        *((CHINESE, encoding, "") for encoding in ENCODINGS),
        *((CHINESE, encoding, "\ufeff") for encoding in ("utf-16-be", "utf-32-be")),
        (GERMAN, "utf-8", ""),
        *((DEGREE, encoding, "") for encoding in ("utf-8", "cp1252")),
    ],
)
def test_names_come_through_in_every_encoding(table: str, encoding: str, mark: str, tmp_path: Path) -> None:
    found = of_text((mark + table).encode(encoding), tmp_path)
    assert names_and_units(found) == NAMES[table]
    assert {len(signal.values) for signal in found.signals} == {3}
    assert kind_of(tmp_path / "SYNTHETIC.txt") is FileType.TEXT


UNITS = {"q2_deg": ("q2", "deg"), "vel_rad_s": ("vel", "rad/s"), "Time_s": ("Time", "s")}
NO_UNITS = {name: (name, None) for name in ("q_m", "q2 (desired)", "q[2]", "x/y")}


@pytest.mark.parametrize(("header", "expected"), (UNITS | NO_UNITS).items())
def test_a_unit_in_a_name(header: str, expected: tuple[str, str | None], tmp_path: Path) -> None:
    assert names_and_units(of_text(f"{header}\n1\n2\n3\n", tmp_path)) == [expected]


@pytest.mark.parametrize(
    ("head", "paths", "texts"),
    [
        ("", ["column 1", "column 2", "column 3"], {}),
        ("t,1,2", ["t", "1", "2"], {}),
        (",Controller 1,\nt,q2,q3", ["t", "Controller 1/q2", "Controller 1/q3"], {}),
        ("C1,,C2\nt,q2,q2", ["C1/t", "C1/q2", "C2/q2"], {}),
        ("Run 1\nOperator,Yan\nt,q2,q3", ["t", "q2", "q3"], {"title": "Run 1", "line 2": "Operator, Yan"}),
        ("Controller 1,,\nt,q2,q3", ["t", "q2", "q3"], {"title": "Controller 1"}),
        (",,Controller 1\nt,q2,q3", ["t", "q2", "q3"], {"title": "Controller 1"}),
    ],
)
def test_rows_above_the_numbers(head: str, paths: list[str], texts: dict[str, str], tmp_path: Path) -> None:
    found = of_text(f"{head}\n0,1,2\n1,1,2\n2,1,3\n".lstrip(), tmp_path)
    expected = [[0.0, 1.0, 2.0], [1.0, 1.0, 1.0], [2.0, 2.0, 3.0]]
    assert columns(found) == dict(zip(paths, expected, strict=True))
    assert found.texts == texts


def test_a_row_of_units(tmp_path: Path) -> None:
    found = of_text("t,q2,q3,q3\ns,deg,,rad\n" + "0,1,2,3\n" * 3, tmp_path)
    assert names_and_units(found) == [("t", "s"), ("q2", "deg"), ("q3", None), ("q3", "rad")]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("lead", ["", "t"])
def test_names_of_groups_span_the_empty_cells_behind_them(separator: str, lead: str, tmp_path: Path) -> None:
    text = f"SYNTHETIC\n,关节2,,关节3,\n{lead},期望,实际,期望,实际\n" + "0,1,2,3,4\n" * 3
    found = of_text(text.replace(",", separator), tmp_path)
    groups = [f"{joint} {name}" for joint in ("关节2", "关节3") for name in ("期望", "实际")]
    assert [signal.label for signal in found.signals] == [lead, *groups]
    paths = [lead or "column 1", *(name.replace(" ", "/") for name in groups)]
    assert [signal.path for signal in found.signals] == paths
    assert found.texts == {"title": "SYNTHETIC"}


def test_groups_apart_by_an_empty_column(tmp_path: Path) -> None:
    text = "Controller 1,,,Controller 2,\nt,q2,,t,q2\n0,1,,0,3\n1,1,,1,3\n2,1,,2,3\n"
    found = of_text(text, tmp_path)
    assert list(columns(found)) == [f"Controller {k}/{name}" for k in (1, 2) for name in ("t", "q2")]
    assert not found.skipped


ORIGIN = "{names}\n\t°\tNm\n{comments}\n" + "".join(f"{n}\t1.5\t2.5\n" for n in range(3))


@pytest.mark.parametrize(
    ("names", "comments", "expected"),
    [
        ("\tActual\tTorque", "\tController 1\t", ["", "Actual Controller 1", "Torque"]),
        ("\tActual\tActual", "\tC1\tC2", ["", "Actual C1", "Actual C2"]),
        ("Sample\tActual\tTorque", "\t\t", ["Sample", "Actual", "Torque"]),
        ("\tActual\tTorque", "\t\t", ["", "Actual", "Torque"]),
        ("Sample\t\tTorque", "\tC1\tC2", ["Sample", "C1", "Torque C2"]),
    ],
)
def test_rows_of_origin(names: str, comments: str, expected: list[str], tmp_path: Path) -> None:
    found = of_text(ORIGIN.format(names=names, comments=comments), tmp_path)
    assert names_and_units(found) == list(zip(expected, [None, "°", "Nm"], strict=True))
    assert found.signals[1].path in {"Actual", "C1"}
    assert not found.texts


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # Names with blanks stand further apart.
        ("time (s)  joint 2\n0 1\n1 2\n2 3\n", {"time (s)": [0, 1, 2], "joint 2": [1, 2, 3]}),
        # An empty first cell keeps its place.
        ("\tq2\n0\t5\n1\t6\n2\t7\n", {"column 1": [0, 1, 2], "q2": [5, 6, 7]}),
        ("# \tq2\n0\t5\n1\t6\n2\t7\n", {"column 1": [0, 1, 2], "q2": [5, 6, 7]}),
        ("\tt\tq\n0\t1.5\n1\t2.5\n2\t3.5\n", TABLE),
    ],
)
def test_what_could_be_read_otherwise(text: str, expected: dict[str, list[float]], tmp_path: Path) -> None:
    assert columns(of_text(text, tmp_path)) == expected


@pytest.mark.parametrize(
    ("text", "expected", "note"),
    [
        ("t;q\n0;1.234,5\n1;2,5\n2;3,5\n", [np.nan, 2.5, 3.5], "'1.234,5'"),
        *(
            (f"when;p;q\n{day};1;1\n{day};2;2\n{day};3;3\n", [1, 2, 3], "cells of words")
            for day in ("1/31/2026", "31.1.2026")
        ),
    ],
)
def test_what_is_not_guessed_is_said(text: str, expected: list[float], note: str, tmp_path: Path) -> None:
    """Marks between thousands, dates with the year last."""
    found = of_text(text, tmp_path)
    assert_array_equal(found.signals[-1].values, expected)
    assert any(
        note in said for said in [*(one.note for one in found.signals), *(s.reason for s in found.skipped)]
    )


@pytest.mark.parametrize(
    ("stamps", "first", "note"),
    [
        (("12:00:00.000", "12:00:00.500", "12:00:01.000"), 43200.0, "durations in s"),
        (("9:59:59.500", "10:00:00.000", "10:00:00.500"), 35999.5, "durations in s"),
        (("2026-01-01T12:00:00Z", "2026-01-01T12:00:00.5Z", "2026-01-01T13:00:01+01:00"), 0.0, "dates, in s"),
        (("2026/1/31 23:59:59.5", "2026/2/1 00:00:00.0", "2026/2/1 00:00:00.5"), 0.0, "dates, in s"),
    ],
)
@pytest.mark.parametrize("separator", [";", "\t"])
def test_clock_times_become_seconds(
    stamps: Sequence[str], first: float, note: str, separator: str, tmp_path: Path
) -> None:
    rows = [("when", "q"), *zip(stamps, "012", strict=True)]
    found = of_text("\n".join(map(separator.join, rows)), tmp_path)
    assert columns(found) == {"when": [first, first + 0.5, first + 1.0], "q": [0.0, 1.0, 2.0]}
    assert found.signals[0].unit == "s"
    assert note in found.signals[0].note


def test_gaps_and_words_among_numbers(tmp_path: Path) -> None:
    found = of_text("t,q,state\n0,1,idle\n1,,run\n2,ERR,run\n3,4,run\n", tmp_path)
    assert_array_equal(found.signals[1].values, [1.0, np.nan, np.nan, 4.0])
    assert "'ERR'" in found.signals[1].note
    assert_array_equal(found.signals[2].values, [1.0, 2.0, 2.0, 2.0])
    assert found.signals[2].note == "words as numbers: 1 is 'idle', 2 is 'run'"
    assert not found.texts


def test_a_column_of_one_word_describes_its_table(tmp_path: Path) -> None:
    found = of_text("t,q,law\n0,1,NTSM\n1,2,NTSM\n2,3,\n", tmp_path)
    (left,) = found.skipped
    assert (left.path, left.reason) == ("law", "2 cells of words, 1 different")
    assert found.texts == {"law": "NTSM"}


def test_rows_of_other_lengths_are_noted(tmp_path: Path) -> None:
    found = of_text("t,q\n" + "0,1\n" * 20 + "5,6,7\n8\n", tmp_path)
    assert columns(found)["t"] == [0.0] * 20 + [5.0, 8.0]
    assert found.skipped[0].reason.startswith("2 rows have another number of cells")


def test_several_tables(tmp_path: Path) -> None:
    numbers = "0,1\n1,2\n2,3\n"
    text = f"t,q\n{numbers}\nController 2\nPayload,0.2\n\nt,q\n{numbers}\n{numbers}the end\n"
    found = of_text(text, tmp_path)
    names = ["t", "q", "t", "q", "column 1", "column 2"]
    assert list(columns(found)) == [f"block {k // 2 + 1}/{name}" for k, name in enumerate(names)]
    assert found.texts == {"block 2/title": "Controller 2", "block 2/line 7": "Payload, 0.2"}


@pytest.mark.parametrize(
    ("text", "asked"), [("{0}A\n\n{0}B\n", True), ("A\n{0}B\n{0}", False), ("{0}A\n", False)]
)
def test_captions_below_tables_are_asked_about(text: str, asked: bool, tmp_path: Path) -> None:
    found = of_text(text.format("t,q\n0,1\n1,2\n2,3\n"), tmp_path)
    assert {signal.note for signal in found.signals} == {BELOW if asked else ""}


def test_many_tables_are_left_out_and_noted(tmp_path: Path) -> None:
    found = of_text("t,q\n0,1\n1,2\n2,3\n" * 150, tmp_path)
    assert len(found.signals) == 200
    assert [left.reason for left in found.skipped] == ["50 more tables, lines 402 to 600, left out"]


PROSE = ["SYNTHETIC\nPayload: 0.2 kg", "rate,1000\nSYNTHETIC", "SYNTHETIC notes\nangles in degrees"]


@pytest.mark.parametrize("text", PROSE)
def test_a_text_for_people_is_no_table(text: str, tmp_path: Path) -> None:
    found = of_text(text, tmp_path)
    assert not found.signals
    assert [left.reason for left in found.skipped] == ["a text without a table of numbers"]
    assert found.texts == {"text": text}


numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)
tables = st.integers(2, 5).flatmap(
    lambda width: st.lists(st.lists(numbers, min_size=width, max_size=width), min_size=4, max_size=12)
)
forms = st.sampled_from([",.", ";.", ";,", "\t.", "\t,", "|.", " ."])
encodings = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "gbk"])


@settings(max_examples=60)
@given(rows=tables, form=forms, encoding=encodings, units=st.booleans())
def test_what_is_written_is_read(rows: list[list[float]], form: str, encoding: str, units: bool) -> None:
    separator, decimal = form
    names = [f"角{number}" for number in range(len(rows[0]))]
    lines = [names, *([["deg"] * len(names)] if units else [])]
    lines += [[repr(value).replace(".", decimal) for value in row] for row in rows]
    with tempfile.TemporaryDirectory() as folder:
        found = of_text("\n".join(map(separator.join, lines)).encode(encoding), Path(folder))
    assert [signal.label for signal in found.signals] == names
    assert {signal.unit for signal in found.signals} == {"deg" if units else None}
    assert_array_equal(np.column_stack([signal.values for signal in found.signals]), rows)


def of_book(book: openpyxl.Workbook, folder: Path) -> Found:
    path = folder / "SYNTHETIC.xlsx"
    book.save(path)
    return read_workbook(path, "xlsx")


def book_of(rows: Sequence[Sequence[object]]) -> openpyxl.Workbook:
    book = openpyxl.Workbook()
    book.active.title = "Data"
    for row in rows:
        book.active.append(row)
    return book


def test_tables_side_by_side_and_below_each_other(tmp_path: Path) -> None:
    """Those side by side are one table, whose groups of columns are told apart by names above them."""
    head = [
        ["All controllers"],
        ["Controller 1", None, None, "Controller 2", None],
        ["t", "q2", None, "t", "q2"],
    ]
    side = [*head, *([n, 2 * n, None, n + 0.5, 3 * n] for n in range(4))]
    below = [[], ["Controller 2"], ["Payload", 0.2], [], ["t", "q2"], *([n, n + 7] for n in range(3))]
    book = book_of([*side, *below])
    book.active.merge_cells("A2:B2")
    book.active.merge_cells("D2:E2")
    found = of_book(book, tmp_path)
    names = [f"Data!4:7/Controller {k}/{name}" for k in (1, 2) for name in ("t", "q2")]
    assert list(columns(found)) == [*names, "Data!13:15/t", "Data!13:15/q2"]
    assert columns(found)[names[3]] == [0.0, 3.0, 6.0, 9.0]
    assert columns(found)["Data!13:15/q2"] == [7.0, 8.0, 9.0]
    title, payload = {"Data!13:15/title": "Controller 2"}, {"Data!13:15/row 10": "Payload, 0.2"}
    assert found.texts == {"Data!4:7/title": "All controllers"} | title | payload


def test_hidden_sheets_charts_and_empty_ones(tmp_path: Path) -> None:
    book = book_of([["t", "q2"], ["s", "deg"], *([n, 1] for n in range(3))])
    hidden = book.create_sheet("Old")
    hidden.sheet_state = "hidden"
    for number in range(3):
        hidden.append([number])
    book.create_sheet("Empty")
    book.create_chartsheet("Chart")
    found = of_book(book, tmp_path)
    told = [(signal.path, signal.unit, signal.note) for signal in found.signals]
    hidden_column = ("Old/column 1", None, "on a hidden sheet")
    assert told == [("Data/t", "s", ""), ("Data/q2", "deg", ""), hidden_column]
    assert {left.path for left in found.skipped} == {"Empty", "Chart"}


def test_formulas_without_results_and_dates(tmp_path: Path) -> None:
    start = datetime.datetime(2026, 1, 1, 12)
    times = [start + datetime.timedelta(seconds=n) for n in range(4)]
    rows = [[times[n], n, f"=B{n + 2}*2", "#DIV/0!" if n else 1] for n in range(4)]
    found = of_book(book_of([["when", "q", "twice", "bad"], *rows]), tmp_path)
    assert columns(found)["Data/when"] == [0.0, 1.0, 2.0, 3.0]
    assert found.signals[0].unit == "s"
    assert [(left.path, bool(left.advice)) for left in found.skipped] == [("Data/twice", True)]
    assert_array_equal(found.signals[2].values, [1.0, np.nan, np.nan, np.nan])


@pytest.mark.parametrize("save", [seed_files.workbook, seed_files.old_workbook, seed_files.open_workbook])
def test_workbooks_of_every_kind(save: Callable[[], bytes], tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC"
    path.write_bytes(save())
    found = read_workbook(path, "x")
    assert names_and_units(found) == [("SYNTHETIC time", "s"), ("q2", "deg"), ("q3", "deg")]
    assert {signal.group for signal in found.signals} == {"Data"}
    assert_array_equal(np.column_stack([signal.values for signal in found.signals]), seed_files.ROWS)


def test_a_broken_workbook_is_named(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.xlsx"
    path.write_bytes(b"PK\x03\x04 and nothing more")
    with pytest.raises(Unreadable, match="broken workbook"):
        read_workbook(path, "xlsx")


kinds = st.sampled_from(["f8", "f4", "i2", "u1", "i8", ">f8", "?"])


@settings(max_examples=60)
@given(kind=kinds, length=st.integers(20, 40), width=st.integers(1, 3), seed=st.integers(0, 99))
def test_what_is_written_as_arrays_is_read(kind: str, length: int, width: int, seed: int) -> None:
    values = np.random.default_rng(seed).integers(0, 2, (length, width)).astype(kind)
    expected = values.astype(float).squeeze(1) if width == 1 else values.astype(float)
    with tempfile.TemporaryDirectory() as folder:
        npz, npy, hdf5 = (Path(folder, f"SYNTHETIC.{suffix}") for suffix in ("npz", "npy", "h5"))
        np.savez_compressed(npz, q=values, fortran=np.asfortranarray(values))
        np.save(npy, values)
        with h5py.File(hdf5, "w") as file:
            file["run/q"] = values
        found = [*read_npz(npz).signals, *read_npy(npy).signals, *read_hdf5(hdf5).signals]
    assert [signal.path for signal in found] == ["q", "fortran", "array", "run/q"]
    assert {signal.dtype for signal in found[:3]} == {str(values.dtype)}
    for signal in found:
        assert_array_equal(signal.values, expected)


def test_structured_arrays_dates_and_texts(tmp_path: Path) -> None:
    stamps = np.array(["2026-01-01T00:00:00.0", "2026-01-01T00:00:00.5", "NaT"], "datetime64[ms]")
    kind = np.dtype([("t", "<f8"), ("q", [("a", "i2"), ("b", "<f4", (2,))])], align=True)
    table = np.array([(0.0, (1, (2, 3))), (1.0, (3, (4, 5)))], kind)
    np.savez(tmp_path / "SYNTHETIC.npz", when=stamps, table=table, words=np.array(["a", "b"]))
    found = read_npz(tmp_path / "SYNTHETIC.npz")
    assert list(columns(found)) == ["when", "table/t", "table/q/a", "table/q/b"]
    assert_array_equal(found.signals[0].values, [0.0, 0.5, np.nan])
    assert columns(found)["table/q/b"] == [[2.0, 3.0], [4.0, 5.0]]
    assert {signal.group for signal in found.signals[1:]} == {"table"}
    assert found.texts == {"words": "a, b"}


def test_objects_are_refused_and_do_not_stop_the_rest(tmp_path: Path) -> None:
    objects = np.array([{"runs": "code"}], object)
    np.savez(tmp_path / "SYNTHETIC.npz", bad=objects, good=np.arange(3.0))
    np.save(tmp_path / "SYNTHETIC.npy", objects)
    found = read_npz(tmp_path / "SYNTHETIC.npz")
    assert columns(found) == {"good": [0.0, 1.0, 2.0]}
    assert [(left.path, left.reason) for left in found.skipped] == [("bad", "saved as Python objects")]
    with pytest.raises(Unreadable, match="Python objects"):
        read_npy(tmp_path / "SYNTHETIC.npy")


def test_a_header_that_announces_more_than_there_is(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.npy"
    np.save(path, np.arange(100.0))
    path.write_bytes(path.read_bytes().replace(b"(100,)", b"(999,)"))
    with pytest.raises(Unreadable, match="broken or cut short"):
        read_npy(path)


@pytest.fixture
def hdf5(tmp_path: Path) -> Path:
    path = tmp_path / "SYNTHETIC.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("controller_1")
        group.attrs["run"] = "SYNTHETIC"
        time = group.create_dataset("time", data=np.arange(5) * 10.0)
        time.make_scale()
        time.attrs["units"] = "ms"
        q = group.create_dataset("q", data=np.arange(10.0).reshape(5, 2))
        q.attrs["units"], q.attrs["long_name"] = "deg", "joint angle"
        q.dims[0].attach_scale(time)
    return path


def test_scales_units_and_names_of_hdf5(hdf5: Path) -> None:
    found = {signal.path: signal for signal in read_hdf5(hdf5).signals}
    q, time = found["controller_1/q"], found["controller_1/time"]
    assert (q.path, q.label, q.unit, q.group) == ("controller_1/q", "joint angle", "deg", "controller_1")
    assert (time.unit, time.group) == ("ms", q.group)
    assert read_hdf5(hdf5).texts == {"controller_1/@run": "SYNTHETIC"}


def test_links_loops_and_promises_of_hdf5(hdf5: Path, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "SYNTHETIC_secret.h5", "w") as other:
        other["q"] = np.arange(10.0)
    layout = h5py.VirtualLayout((10,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "SYNTHETIC_secret.h5"), "q", (10,))
    with h5py.File(hdf5, "a") as file:
        file["away"] = h5py.ExternalLink("SYNTHETIC_secret.h5", "q")
        file["here"], file["there"] = h5py.SoftLink("/there"), h5py.SoftLink("/here")
        file["loop"] = file["/"]
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("outside", (10,), "f8", external=[(str(tmp_path / "SYNTHETIC_secret.h5"), 0, 80)])
        file.create_dataset("huge", (10**12,), "f8", chunks=(1000,))
        file.create_dataset("partly", (10**8,), "f8", chunks=(1000,))[:10] = 1.0
        file.create_dataset("never", (100,), "f8")
    found = read_hdf5(hdf5)
    assert sorted(columns(found)) == ["controller_1/q", "controller_1/time"]
    left_out = {"away", "huge", "never", "outside", "partly", "virtual"}
    assert {left.path for left in found.skipped} == left_out
    assert len(found.skipped) == len(left_out)


def test_fields_packed_numbers_and_netcdf(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.nc"
    with h5py.File(path, "w") as file:
        file.attrs["_NCProperties"] = "version=2"
        file["table"] = np.array([(1, 2.0), (3, 4.0)], [("a", "i4"), ("b", "f8")])
        file.create_dataset("packed", data=np.array([1, 2], "i2")).attrs["scale_factor"] = 0.5
    found = read_hdf5(path)
    assert found.kind == "netCDF-4"
    signals = {signal.path: signal for signal in found.signals}
    (left,) = found.skipped
    assert (left.path, left.reason) == ("packed", "packed with scale_factor"), "unscaled it is wrong"
    assert_array_equal(signals["table/b"].values, [2.0, 4.0])


def test_our_own_traces_are_read(tmp_path: Path) -> None:
    from support.synthetic import make_compare_file

    from tendonrepro.results.traces import write_traces

    path = tmp_path / "SYNTHETIC_traces.h5"
    write_traces(path, make_compare_file(step=0.1))
    signals = {signal.path: signal for signal in read_hdf5(path).signals}
    q = signals["controller_1/q"]
    assert q.unit == "rad"
    assert (q.group, signals["controller_1/time"].unit) == ("controller_1", "s")
