"""Workbooks, LabVIEW's measurements, and frictionless data packages, as svgdigitizer writes them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tendonrepro.dataset.nested import Nested, Series, tables_of
from tendonrepro.dataset.tables import (
    Columns,
    Tables,
    Unreadable,
    add_column,
    first_numbers,
    names_of,
)
from tendonrepro.dataset.text import read_text_table

_MOST_HEAD = 2000
"""Rows above the numbers that are looked through."""
_BEGIN, _END = "LabVIEW Measurement", "***End_of_Header***"
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
    first = first_numbers(rows, tail.to_numpy().tolist())
    if first is None:
        return columns
    names = names_of(rows[:first], sheet.shape[1])
    body = sheet.iloc[first:]
    for place, name in enumerate(names):
        add_column(columns, name, body.iloc[:, place], first + 1)
    return columns


def _written(cell: Any) -> str:
    """A cell as a text would have it; times and dates count as numbers."""
    if pd.isna(cell):
        return ""
    if hasattr(cell, "total_seconds") or hasattr(cell, "isoformat"):
        return "0"
    return str(cell).strip()


def is_labview(path: Path) -> bool:
    """Whether a file is a LabVIEW measurement written as text."""
    with path.open("rb") as stream:
        return stream.read(len(_BEGIN)) == _BEGIN.encode()


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
