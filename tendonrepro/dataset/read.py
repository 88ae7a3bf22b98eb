"""Files, folders and archives as tables. Texts are read by `text`, nested values by `nested`, others here."""

from __future__ import annotations

import json
import os
import re
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from tendonrepro.dataset import tables
from tendonrepro.dataset.tables import Columns, Unreadable
from tendonrepro.dataset.text import encoding_of_bytes, read_text_table
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import md5_of

MOST_BYTES = 2**31
"""Of a file, and of all files in an archive."""

_BOOKS = {".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"}
_ARCHIVES = {".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz"}
_TEXTS = {".csv", ".tsv", ".txt", ".dat", ".asc", ".lvm", ".log", ".prn", ".mot", ".sto", ""}
_UNICODE = 0x800
"""Flag of a name in a zip that is Unicode."""
_DEFAULT_SHEET = re.compile(r"(sheet|tabelle|工作表|feuil)\s*\d*", re.IGNORECASE)
_MOST_HEAD = 2000
"""Rows of a sheet that are looked through for the first numbers."""
_END = "***End_of_Header***"
"""Of a LabVIEW measurement; it has a header of its own, and one of its only segment."""


class Contents(NamedTuple):
    """Tables of files; by file why it was `unread`; and by file lines on what is in no table of it."""

    tables: list[Columns]
    unread: dict[str, str]
    left_out: dict[str, list[str]]


def read_files(paths: Sequence[Path]) -> Contents:
    """Read every table of files, folders and archives.

    Raises
    ------
    UsageError
        If there are no paths.
    DataMissingError
        If a path is missing, or nothing can be read.
    """
    if not paths:
        raise UsageError("names nothing to read", where="PATHS", hint="name files, folders or archives")
    for path in paths:
        if not path.exists():
            hint = "tendonrepro data fetch gets the record"
            raise DataMissingError("is not there", where=str(path), hint=hint)
    read: list[Columns] = []
    unread: dict[str, str] = {}
    left_out: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        names = {path: "" if path.is_dir() else _as_text(path.name) for path in paths}
        files = [file for path, name in names.items() for file in _files(path, name, scratch, unread)]
        # A package reads the tables beside it, and knows their units.
        described = {table.resolve() for path, _ in files for table in _packaged(path)}
        for path, name in files:
            if path.resolve() in described:
                continue
            try:
                of_file, lines = read_file(path, name)
            except Unreadable as error:
                unread[name] = str(error)
                continue
            read += of_file
            if lines:
                left_out[name] = lines
    if not read:
        reasons = "; ".join(f"{file}: {reason}" for file, reason in unread.items()) or "no files"
        raise DataMissingError(f"nothing to read: {reasons}"[:500])
    return Contents(read, unread, left_out)


def _files(path: Path, name: str, scratch: str, unread: dict[str, str]) -> Iterator[tuple[Path, str]]:
    """Files of a path, unpacked, and their names."""
    if path.is_dir():
        for member in sorted(path.glob("[!.]*")):
            yield from _files(member, f"{name}/{_as_text(member.name)}".lstrip("/"), scratch, unread)
    elif path.suffix.lower() in _ARCHIVES:
        folder = Path(tempfile.mkdtemp(dir=scratch))
        try:
            _unpack(path, folder)
        except Exception as error:
            unread[name] = f"cannot be unpacked: {error}"
        else:
            yield from _files(folder, name, scratch, unread)
    else:
        yield path, name


def _as_text(name: str) -> str:
    """A file's name without bytes that are not of this system's encoding."""
    return name.encode("utf-8", "replace").decode()


def _unpack(path: Path, folder: Path) -> None:
    """Unpack an archive of no more than a file may have, with names that may be Chinese or Western."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            # The others say that they are Unicode.
            names = [member.filename for member in archive.infolist() if not member.flag_bits & _UNICODE]
            _refuse_large(member.file_size for member in archive.infolist())
        encoding = _encoding_of(name.encode("cp437", "ignore") for name in names)
        with zipfile.ZipFile(path, metadata_encoding=encoding) as archive:
            archive.extractall(folder)
    elif tarfile.is_tarfile(path):
        with tarfile.open(path) as archive:
            _refuse_large(member.size for member in archive)
            encoding = _encoding_of(map(os.fsencode, archive.getnames()))
        with tarfile.open(path, encoding=encoding) as archive:
            archive.extractall(folder, filter="data")
    else:
        raise Unreadable("neither zip nor tar")


def _refuse_large(sizes: Iterable[int]) -> None:
    """Refuse what says that it needs more than `MOST_BYTES` when it is unpacked, before it is."""
    if sum(sizes) > MOST_BYTES:
        raise Unreadable(f"more than {MOST_BYTES >> 30} GiB when unpacked; unpack it, and name its folder")


def _encoding_of(names: Iterable[bytes]) -> str:
    return encoding_of_bytes(b"\n".join(names))[0].removesuffix("-sig")


def read_file(path: Path, name: str) -> tuple[list[Columns], list[str]]:
    """Read the tables of one file, and lines on what is in none of them.

    Raises
    ------
    Unreadable
        If there are none or the file is damaged.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise Unreadable(f"{size / 2**30:.1f} GiB, more than {MOST_BYTES >> 30} GiB")
    try:
        read = _reader_of(path)(path)
    except Unreadable:
        raise
    except Exception as error:
        raise Unreadable(f"damaged, or not what its name says: {error}"[:200]) from error
    left_out = [
        f"{columns.name}: {note}" if columns.name else note for columns in read for note in columns.notes
    ]
    filled = [columns for columns in read if columns]
    for columns in filled:
        tables.with_one_time(columns)
    filled += filter(None, map(tables.by_joint, filled))
    if not filled:
        reasons = f": {'; '.join(left_out)}" if left_out else ""
        raise Unreadable(f"holds no columns of numbers{reasons}"[:400])
    file: dict[str, str | int] = {"name": name, "size": size, "md5": md5_of(path)}
    for columns in filled:
        columns.name, columns.file = f"{name}:{columns.name}" if columns.name else name, file
    return filled, left_out


def _read_workbook(path: Path) -> list[Columns]:
    """Read the sheets that hold numbers."""
    sheets = pd.read_excel(path, sheet_name=None, header=None, engine="calamine")
    read = [_sheet(name, sheet) for name, sheet in sheets.items() if not sheet.empty]
    filled = [columns for columns in read if columns]
    empty = [f"sheet {columns.name!r}: no table of numbers" for columns in read if not columns]
    # A single sheet under the name that a program gave it has none.
    if len(filled) == 1 and _DEFAULT_SHEET.fullmatch(filled[0].name):
        filled[0].name = ""
    return [Columns(notes=empty), *filled]


def _sheet(name: str, sheet: pd.DataFrame) -> Columns:
    sheet = sheet.dropna(how="all").reset_index(drop=True)
    columns = Columns(name=name)
    rows: list[list[str]] = sheet.iloc[:_MOST_HEAD].map(_written).to_numpy().tolist()
    last: list[list[str]] = sheet.iloc[-60:].map(_written).to_numpy().tolist()
    first = tables.first_numbers(rows, last)
    if first is not None:
        for place, head in enumerate(tables.names_of(rows[:first], sheet.shape[1])):
            tables.add_column(columns, head, sheet.iloc[first:, place], first + 1)
    return columns


def _written(cell: Any) -> str:
    """A cell as a text would have it; times and dates count as numbers."""
    if pd.isna(cell):
        return ""
    return "0" if hasattr(cell, "total_seconds") or hasattr(cell, "isoformat") else str(cell).strip()


def _read_text(path: Path) -> list[Columns]:
    return [read_text_table(path)]


def _read_lvm(path: Path) -> list[Columns]:
    """Read a LabVIEW measurement of one segment; where it has no times, they follow from its header."""
    with path.open(encoding="latin-1") as stream:
        head, _, _ = stream.read(2**16).rpartition(_END)
        stream.seek(0)
        if sum(line.startswith(_END) for line in stream) > 2:
            raise Unreadable(
                "a LabVIEW measurement of several segments: write it with one header, or as TDMS"
            )
    told = re.findall(r"^(X0|Delta_X)\t([-+\d.,eE]+)", head, re.MULTILINE)
    settings = {name: float(number.replace(",", ".")) for name, number in told}
    recorded = read_text_table(path)
    columns = Columns(notes=recorded.notes)
    times = [name for name in recorded if re.match(r"X[_ ]Value", name)]
    step = settings.get("Delta_X", 0.0)
    if step and not times:
        samples = len(next(iter(recorded.values()), []))
        columns.add("time", settings.get("X0", 0.0) + step * np.arange(float(samples)), "s")
        columns.notes.append(f"times are made from Delta_X, {step:g} s")
    for name, values in recorded.items():
        columns.add("time" if name in times else name, values, "s" if name in times else "")
    return [columns]


def _packaged(path: Path) -> dict[Path, tuple[str, dict[str, str]]]:
    """Name, and units of the fields, of each table of a frictionless data package; none of other files."""
    if path.suffix.lower() != ".json":
        return {}
    described = {}
    try:
        for resource in json.loads(path.read_text(encoding="utf-8-sig"))["resources"]:
            table = path.parent / resource["path"]
            fields = resource.get("schema", {}).get("fields", [])
            units = {field["name"]: field.get("unit") or "" for field in fields}
            if table.is_file():
                described[table] = resource.get("name") or table.stem, units
    except (ValueError, KeyError, TypeError, AttributeError, OSError):
        return {}
    return described


def _read_package(path: Path) -> list[Columns]:
    """Read the tables of a data package, as svgdigitizer writes them, with the units of its fields."""
    resources = _packaged(path)
    if not resources:
        raise Unreadable("a JSON file that is no data package with a table beside it")
    read = []
    for table, (name, units) in resources.items():
        cells = read_text_table(table)
        inner = "" if len(resources) == 1 and name == path.stem else name
        columns = Columns(name=inner, notes=cells.notes)
        for column, values in cells.items():
            # A curve is called y where its figure does not say more; then the table's name tells.
            said = name if column.casefold() in ("y", "value") else column
            columns.add(said, values, units.get(column, ""))
        read.append(columns)
    return read


def _reader_of(path: Path) -> Callable[[Path], list[Columns]]:
    """What reads a file, by its first bytes before its name."""
    with path.open("rb") as stream:
        head = stream.read(512)
    suffix = path.suffix.lower()
    is_matlab = suffix == ".mat" or head.startswith(b"MATLAB")
    is_tdms = suffix == ".tdms" or head.startswith(b"TDSm")
    if is_matlab or is_tdms or head.startswith(b"\x89HDF"):
        # Its libraries take half a second to import.
        from tendonrepro.dataset import nested

        return nested.read_matlab if is_matlab else nested.read_tdms if is_tdms else nested.read_hdf5
    if head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        return _read_workbook
    if suffix == ".json":
        return _read_package
    if suffix in _TEXTS | _BOOKS:
        return _read_lvm if head.startswith(b"LabVIEW Measurement") else _read_text
    raise Unreadable(f"a format that is not read: {suffix or 'no suffix'}")
