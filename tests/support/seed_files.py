"""A small file of every format, made up by us, from which tests make broken ones."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import struct
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import scipy.io
import xlwt
from odf.opendocument import OpenDocumentSpreadsheet
from odf.table import Table, TableCell, TableRow
from odf.text import P

from support import matlab_bytes

ROWS = [[number * 0.01, number * 1.5, -number] for number in range(30)]
NAMES = ["SYNTHETIC time (s)", "q2 (deg)", "q3 (deg)"]


def text(separator: str = ",", decimal: str = ".", encoding: str = "utf-8") -> bytes:
    lines = [separator.join(NAMES)]
    lines += [separator.join(str(value).replace(".", decimal) for value in row) for row in ROWS]
    return "\n".join(lines).encode(encoding)


def saved(write: Callable[[Path], Any], suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"SYNTHETIC.{suffix}")
        write(path)
        return path.read_bytes()


def workbook() -> bytes:
    book = openpyxl.Workbook()
    for row in [NAMES, *ROWS]:
        book.active.append(row)
    return saved(book.save, "xlsx")


def old_workbook() -> bytes:
    book = xlwt.Workbook()
    sheet = book.add_sheet("Data")
    for row, cells in enumerate([NAMES, *ROWS]):
        for column, cell in enumerate(cells):
            sheet.write(row, column, cell)
    return saved(lambda path: book.save(str(path)), "xls")


def open_workbook() -> bytes:
    document = OpenDocumentSpreadsheet()
    table = Table(name="Data")
    for cells in [NAMES, *ROWS]:
        row = TableRow()
        for value in cells:
            known = (
                {"valuetype": "string"} if isinstance(value, str) else {"valuetype": "float", "value": value}
            )
            cell = TableCell(**known)
            cell.addElement(P(text=str(value)))
            row.addElement(cell)
        table.addElement(row)
    document.spreadsheet.addElement(table)
    return saved(lambda path: document.save(str(path)), "ods")


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        time = file.create_dataset("run/time", data=np.arange(30) * 0.01)
        time.make_scale()
        time.attrs["units"] = "s"
        q = file.create_dataset("run/q", data=np.array(ROWS), chunks=(10, 3), compression="gzip")
        q.dims[0].attach_scale(time)
        file["table"] = np.array([(1, 2.0), (3, 4.0)], [("a", "i4"), ("b", "f8")])
        file["words"] = "SYNTHETIC"
        file["away"] = h5py.ExternalLink("SYNTHETIC_secret.h5", "q")


def array() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array(ROWS))
    return stream.getvalue()


def arrays() -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, q=np.array(ROWS), table=np.zeros(9, [("a", "i4"), ("b", "f8")]))
    return stream.getvalue()


def zipped(content: Mapping[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in content.items():
            packed.writestr(name, data)
    return stream.getvalue()


def tarred(content: Mapping[str, bytes], mode: str = "w") -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode=mode) as packed:  # type: ignore[call-overload]
        for name, data in content.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            packed.addfile(entry, io.BytesIO(data))
        link = tarfile.TarInfo("link")
        link.type, link.linkname = tarfile.SYMTYPE, "../../SYNTHETIC_link"
        packed.addfile(link)
    return stream.getvalue()


def ole2(name: str) -> bytes:
    """The least that is recognised: a header, and a directory with one name."""
    head = bytearray(512)
    head[:8] = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
    struct.pack_into("<H", head, 30, 9)
    return bytes(head) + (name + "\0").encode("utf-16-le").ljust(512, b"\0")


def level_4() -> bytes:
    return saved(lambda path: scipy.io.savemat(path, {"q": np.array(ROWS)}, format="4"), "mat")


def level_5(*, packed: bool) -> bytes:
    tree = {"out": {"time": np.arange(30.0), "q": np.array(ROWS), "name": "SYNTHETIC", "more": [{"a": 1.0}]}}
    return saved(lambda path: scipy.io.savemat(path, tree, do_compression=packed), "mat")


def level_73() -> bytes:
    tree = {"out": {"q": np.array(ROWS)}, "t": np.arange(30.0)}
    return saved(lambda path: matlab_bytes.hdf(path, tree), "mat")


OUTSIDE = "/SYNTHETIC_root.csv"
# From where members are unpacked, four folders up is the one around all temporary folders.
HOSTILE = {"../../../../SYNTHETIC_out.csv": text(), OUTSIDE: text(), "good.csv": text()}


def readable() -> dict[str, bytes]:
    """Files that are read, by name."""
    return {
        "SYNTHETIC_comma.csv": text(),
        "SYNTHETIC_semicolon.csv": text(";", ","),
        "SYNTHETIC_utf16.txt": text("\t", ".", "utf-16"),
        "SYNTHETIC.xlsx": workbook(),
        "SYNTHETIC.xls": old_workbook(),
        "SYNTHETIC.ods": open_workbook(),
        "SYNTHETIC.npy": array(),
        "SYNTHETIC.npz": arrays(),
        "SYNTHETIC.h5": saved(hdf5, "h5"),
        "SYNTHETIC_4.mat": level_4(),
        "SYNTHETIC_5.mat": level_5(packed=False),
        "SYNTHETIC_7.mat": level_5(packed=True),
        "SYNTHETIC_73.mat": level_73(),
        "SYNTHETIC.zip": zipped(HOSTILE | {"inner.tar": tarred({"a.npy": array()})}),
        "SYNTHETIC.tar": tarred(HOSTILE),
        "SYNTHETIC.tar.gz": tarred(HOSTILE, "w:gz"),
        "SYNTHETIC.csv.gz": gzip.compress(text()),
        "SYNTHETIC.csv.bz2": bz2.compress(text()),
        "SYNTHETIC.csv.xz": lzma.compress(text()),
    }
