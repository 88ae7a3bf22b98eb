"""HDF5, workbooks, LabVIEW's measurements, and frictionless data packages, as svgdigitizer writes them.

Nested arrays of MATLAB and HDF5 become tables here: what lies together with as many rows, or one clock.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tendonrepro.dataset import tables
from tendonrepro.dataset.tables import FEWEST, Column, Columns, Tables, Unreadable
from tendonrepro.dataset.text import read_text_table

Nested: TypeAlias = dict[str, Any]
"""Arrays, `Series`, `Columns` and further trees by name."""

MOST_COLUMNS = 40
"""Of an array whose columns are signals."""
MOST_NAMED = 12
"""Arrays that a line on what was left out names."""

_MOST_HEAD = 2000
"""Rows above the numbers that are looked through."""
_END = "***End_of_Header***"
_HEADERS = 2
"""Headers of a file: its own, and that of the one segment."""


def read_workbook(path: Path) -> Tables:
    """Read the sheets that hold numbers."""
    sheets = pd.read_excel(path, sheet_name=None, header=None, engine="calamine")
    read = {str(name): _sheet(sheet) for name, sheet in sheets.items()}
    filled = {name: columns for name, columns in read.items() if columns}
    empty = [name for name in read if name not in filled]
    left_out = [f"sheet {name!r}: no table of numbers" for name in empty if not sheets[name].empty]
    # A single sheet under the name that a program gave it has none.
    default = re.compile(r"(sheet|tabelle|工作表|feuil)\s*\d*", re.IGNORECASE)
    is_default = len(filled) == 1 and default.fullmatch(next(iter(filled)))
    return Tables({"": next(iter(filled.values()))} if is_default else filled, left_out)


def _sheet(sheet: pd.DataFrame) -> Columns:
    sheet = sheet.dropna(how="all").reset_index(drop=True)
    columns = Columns()
    head = sheet.iloc[:_MOST_HEAD].map(_written)
    tail = sheet.iloc[-60:].map(_written)
    rows: list[list[str]] = head.to_numpy().tolist()
    first = tables.first_numbers(rows, tail.to_numpy().tolist())
    if first is None:
        return columns
    names = tables.names_of(rows[:first], sheet.shape[1])
    body = sheet.iloc[first:]
    for place, name in enumerate(names):
        tables.add_column(columns, name, body.iloc[:, place], first + 1)
    return columns


def _written(cell: Any) -> str:
    """A cell as a text would have it; times and dates count as numbers."""
    if pd.isna(cell):
        return ""
    if hasattr(cell, "total_seconds") or hasattr(cell, "isoformat"):
        return "0"
    return str(cell).strip()


def read_lvm(path: Path) -> Tables:
    """Read a LabVIEW measurement; where it has no times, they follow from its header.

    Raises
    ------
    Unreadable
        If it is no table, or has several segments.
    """
    with path.open(encoding="latin-1") as stream:
        head, _, _ = stream.read(2**16).rpartition(_END)
        stream.seek(0)
        if sum(line.startswith(_END) for line in stream) > _HEADERS:
            raise Unreadable(
                "a LabVIEW measurement of several segments: write it with one header, or as TDMS"
            )
    told = re.findall(r"^(X0|Delta_X)\t([-+\d.,eE]+)", head, re.MULTILINE)
    settings = {name: float(number.replace(",", ".")) for name, number in told}
    (recorded,) = read_text_table(path).values()
    columns = Columns()
    columns.notes = recorded.notes
    times = [name for name in recorded if re.match(r"X[_ ]Value", name)]
    step = settings.get("Delta_X", 0.0)
    if step and not times:
        samples = len(next(iter(recorded.values()), []))
        columns.add("time", settings.get("X0", 0.0) + step * np.arange(float(samples)), "s")
        columns.notes.append(f"times are made from Delta_X, {step:g} s")
    for name, values in recorded.items():
        columns.add("time" if name in times else name, values, "s" if name in times else "")
    return Tables({"": columns})


def read_tdms(path: Path) -> Tables:
    """Read the groups of a TDMS file; a waveform's start and increment are its times.

    Raises
    ------
    Unreadable
        If the package npTDMS is not installed.
    """
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise Unreadable(
            "TDMS is read by the package npTDMS: pip install 'tendonrepro[tdms]', or export it as text"
        ) from None
    tree: Nested = {}
    left_out = []
    for group in TdmsFile.read(path).groups():
        signals = tree.setdefault(group.name, {})
        for channel in group.channels():
            values, properties = np.asarray(channel[:]), channel.properties
            unit = str(properties.get("unit_string") or properties.get("NI_UnitDescription") or "")
            if values.dtype.kind not in "biuf" or not values.size:
                left_out.append(f"channel {group.name}/{channel.name}: no numbers")
            elif properties.get("wf_increment"):
                times = np.asarray(channel.time_track(), float)
                signals[channel.name] = Series(times, values, channel.name, unit)
            else:
                # Channels without times lie together by their numbers of samples.
                signals[f"{channel.name} ({unit})" if unit else channel.name] = values
    tables = tables_of(tree)
    tables.left_out[:0] = left_out
    return tables


def packaged(path: Path) -> dict[Path, tuple[str, dict[str, str]]]:
    """Name, and units of the fields, of each table of a frictionless data package; none of other files."""
    tables = {}
    try:
        for resource in json.loads(path.read_text(encoding="utf-8-sig"))["resources"]:
            table = path.parent / resource["path"]
            fields = resource.get("schema", {}).get("fields", [])
            units = {field["name"]: field.get("unit") or "" for field in fields}
            if table.is_file():
                tables[table] = resource.get("name") or table.stem, units
    except (ValueError, KeyError, TypeError, AttributeError, OSError):
        return {}
    return tables


def read_package(path: Path) -> Tables:
    """Read the tables of a frictionless data package, with the units of its fields.

    Raises
    ------
    Unreadable
        If a JSON file is none, or its tables are missing.
    """
    resources = packaged(path)
    if not resources:
        raise Unreadable("a JSON file that is no data package with a table beside it")
    tables = Tables()
    for table, (name, units) in resources.items():
        cells = read_text_table(table)[""]
        columns = Columns()
        columns.notes = cells.notes
        for column, values in cells.items():
            # A curve is called y where its figure does not say more; then the table's name tells.
            said = name if column.casefold() in ("y", "value") else column
            columns.add(said, values, units.get(column, ""))
        tables["" if len(resources) == 1 and name == path.stem else name] = columns
    return tables


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one signal: `time` (T,), s, and `values`, T of them along the first axis.

    Where it has no `name` of its own, it has that of its place in the tree.
    """

    time: Column
    values: Column
    name: str = ""
    unit: str = ""


def tables_of(tree: Nested) -> Tables:
    """Tables of a tree, by their paths in it."""
    tables = Tables()
    apart: dict[str, list[str]] = {}
    _collect(tree, "", tables, apart)
    for why, names in apart.items():
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        tables.left_out.append(f"{', '.join(names[:MOST_NAMED])}{more}: {why}")
    return tables


def _collect(tree: Nested, path: str, tables: Tables, apart: dict[str, list[str]]) -> None:
    """Put what lies together into tables, and the rest into `apart`: why -> names."""
    groups: dict[tuple[int, bytes], Columns] = {}
    inner: list[tuple[str, Nested]] = []
    for name, value in tree.items():
        where = f"{path}.{name}" if path else name
        if isinstance(value, Series):
            same = len(value.time), value.time.tobytes()
            group = groups.setdefault(same, Columns({"time (s)": value.time}))
            for signal, column in _signals(value.name or name, value.values, 0):
                group.add(signal, column, value.unit)
        elif isinstance(value, Columns):
            tables[where] = value
        elif isinstance(value, dict):
            inner.append((where, value))
        elif not isinstance(value, np.ndarray) or value.size < 2 or value.dtype.kind not in "biufc":
            is_words = np.asarray(value).dtype.kind in "US"
            if value is not None and np.size(value) and not is_words:
                apart.setdefault("single values, no signals", []).append(where)
        elif reason := _no_signals(value):
            shape = "×".join(map(str, value.shape))
            apart.setdefault(reason, []).append(f"{where} ({shape})")
        else:
            group = groups.setdefault((max(value.shape), b""), Columns())
            for signal, column in _signals(name, value, int(np.argmax(value.shape))):
                group.add(signal, column)
    for number, ((rows, clock), columns) in enumerate(groups.items(), start=1):
        which = f"[clock {number}]" if clock else f"[{rows} rows]"
        tables[path if len(groups) == 1 else f"{path}{which}"] = columns
    for where, value in inner:
        _collect(value, where, tables, apart)


def _no_signals(values: Column) -> str:
    """Why an array holds no signals, or an empty text."""
    samples = max(values.shape)
    if values.dtype.kind == "c":
        return "complex numbers"
    if samples < FEWEST:
        return f"fewer than {FEWEST} samples"
    return f"more than {MOST_COLUMNS} columns" if values.size > MOST_COLUMNS * samples else ""


def _signals(name: str, values: Column, axis: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Columns of an array with samples along an axis, named by their places in it, counted from 1."""
    moved = np.moveaxis(values, axis, 0).astype(float)
    sizes = moved.shape[1:]
    columns = moved.reshape(len(moved), -1).T
    for place, column in zip(product(*map(range, sizes)), columns, strict=True):
        told = ",".join(str(k + 1) for k, size in zip(place, sizes, strict=True) if size > 1)
        yield f"{name}[{told}]" if told else name, column


def read_hdf5(path: Path) -> Tables:
    """Read the datasets of an HDF5 file, with their ``units``."""
    import h5py

    tree: Nested = {}

    def visit(name: str, node: object) -> None:
        if not isinstance(node, h5py.Dataset):
            return
        group, _, last = name.rpartition("/")
        unit = node.attrs.get("units", "")
        unit = unit.decode() if isinstance(unit, bytes) else str(unit)
        place = tree.setdefault(group.replace("/", "."), {})
        if node.dtype.names:
            place[last] = {str(field): node[field] for field in node.dtype.names}
        else:
            place[f"{last} ({unit})" if unit else last] = node[()]

    with h5py.File(path, locking=False) as file:
        file.visititems(visit)
    return tables_of(tree)
