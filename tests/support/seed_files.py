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
import xlwt
from odf.opendocument import OpenDocumentSpreadsheet
from odf.table import Table, TableCell, TableRow
from odf.text import P
from scipy.io import savemat

from support.matlab_bytes import hdf
from tendonrepro.dataset.readers.filetype import FileType
from tendonrepro.dataset.readers.read import read_bit_by_bit
from tendonrepro.dataset.readers.signals import Allowance, Source

ROWS = [[number * 0.01, number * 1.5, -number] for number in range(30)]
NAMES = ["SYNTHETIC time (s)", "q2 (deg)", "q3 (deg)"]


def read_file(path: Path, name: str, left: Allowance | None = None) -> list[Source]:
    """Sources of a file, read in this process; a later one of a name replaces an earlier one."""
    return list({source.name: source for source in read_bit_by_bit(path, name, left or Allowance())}.values())


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
    book.active.title = "Data"
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


def zipped(content: Mapping[Any, bytes]) -> bytes:
    """A zip archive; a name is a text or a `ZipInfo`."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in content.items():
            packed.writestr(name, data)
    return stream.getvalue()


def tarred(content: Mapping[str, bytes], mode: str = "w", *others: tarfile.TarInfo) -> bytes:
    """A tar archive of files, and of entries without content, such as links."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode=mode) as packed:  # type: ignore[call-overload]
        for name, data in content.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            packed.addfile(entry, io.BytesIO(data))
        for entry in others:
            packed.addfile(entry)
    return stream.getvalue()


def tar_entry(name: str, kind: bytes, target: str) -> tarfile.TarInfo:
    entry = tarfile.TarInfo(name)
    entry.type, entry.linkname = kind, target
    return entry


def encrypted_zip(content: Mapping[str, bytes]) -> bytes:
    """The first member is marked as encrypted."""
    raw = bytearray(zipped(content))
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        raw[raw.index(signature) + offset] |= 1
    return bytes(raw)


def ole2(name: str) -> bytes:
    """The least that is recognised: a header, and a directory with one name."""
    head = bytearray(512)
    head[:8] = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
    struct.pack_into("<H", head, 30, 9)
    return bytes(head) + (name + "\0").encode("utf-16-le").ljust(512, b"\0")


OUTSIDE = "/SYNTHETIC_root.csv"
# From where members are unpacked, four folders up is the one around all temporary folders.
HOSTILE = {"../../../../SYNTHETIC_out.csv": text(), OUTSIDE: text(), "good.csv": text()}


def readable() -> dict[str, tuple[FileType, bytes]]:
    """Types and contents of files that are read, by name."""
    rows, times = np.array(ROWS), np.arange(30.0)
    array = saved(lambda path: np.save(path, rows), "npy")
    table = np.zeros(9, [("a", "i4"), ("b", "f8")])
    arrays = saved(lambda path: np.savez_compressed(path, q=rows, table=table), "npz")
    newest = saved(lambda path: hdf(path, {"out": {"q": rows}, "t": times}), "mat")
    out = {"time": times, "q": rows, "name": "SYNTHETIC", "more": [{"a": 1.0}]}

    def level(tree: Mapping[str, Any], *, packed: bool = False) -> bytes:
        return saved(lambda path: savemat(path, tree, do_compression=packed), "mat")

    link = tar_entry("link", tarfile.SYMTYPE, "../../SYNTHETIC_link")
    inner = tarred({"a.npy": array}, "w", link)
    return {
        "SYNTHETIC_comma.csv": (FileType.TEXT, text()),
        "SYNTHETIC_semicolon.csv": (FileType.TEXT, text(";", ",")),
        "SYNTHETIC_utf16.txt": (FileType.TEXT, text("\t", ".", "utf-16")),
        "SYNTHETIC.xlsx": (FileType.XLSX, workbook()),
        "SYNTHETIC.xls": (FileType.XLS, old_workbook()),
        "SYNTHETIC.ods": (FileType.ODS, open_workbook()),
        "SYNTHETIC.npy": (FileType.NPY, array),
        "SYNTHETIC.npz": (FileType.NPZ, arrays),
        "SYNTHETIC.h5": (FileType.HDF5, saved(hdf5, "h5")),
        "SYNTHETIC_5.mat": (FileType.MATLAB_5, level({"out": out})),
        "SYNTHETIC_7.mat": (FileType.MATLAB_5, level({"out": out}, packed=True)),
        "SYNTHETIC_73.mat": (FileType.MATLAB_73, newest),
        "SYNTHETIC.zip": (FileType.ZIP, zipped(HOSTILE | {"inner.tar": inner})),
        "SYNTHETIC.tar": (FileType.TAR, tarred(HOSTILE, "w", link)),
        "SYNTHETIC.tar.gz": (FileType.GZIP, tarred(HOSTILE, "w:gz", link)),
        "SYNTHETIC.csv.gz": (FileType.GZIP, gzip.compress(text())),
        "SYNTHETIC.csv.bz2": (FileType.BZIP2, bz2.compress(text())),
        "SYNTHETIC.csv.xz": (FileType.XZ, lzma.compress(text())),
    }
