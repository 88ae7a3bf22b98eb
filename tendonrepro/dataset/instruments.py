"""Files of instruments: LabVIEW's measurements as text and as TDMS."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tendonrepro.dataset.arrays import Columns, Tables, Unreadable
from tendonrepro.dataset.text import read_text_table

_BEGIN, _END = "LabVIEW Measurement", "***End_of_Header***"
_HEADERS = 2
"""Headers of a file: its own, and that of the one segment."""


def read_text(path: Path) -> Tables:
    """Read a table as text, LabVIEW's measurements too.

    Raises
    ------
    Unreadable
        If it is no table, or a measurement of several segments.
    """
    with path.open(encoding="latin-1") as stream:
        is_labview = stream.readline().startswith(_BEGIN)
        if is_labview and sum(line.startswith(_END) for line in stream) > _HEADERS:
            raise Unreadable(
                "a LabVIEW measurement of several segments: write it with one header only, as TDMS, or cut it"
            )
    tables = read_text_table(path)
    return _labview(tables, path) if is_labview else tables


def _labview(tables: Tables, path: Path) -> Tables:
    """Name the times of a LabVIEW measurement as such; a file without times gets them from its header."""
    with path.open(encoding="latin-1") as stream:
        header = [line.rstrip("\n").split("\t") for line in _head_of(stream.read(2**16))]
    settings = {row[0]: row[1:] for row in header if row[0]}
    columns = Columns()
    (recorded,) = tables.tables.values()
    columns.notes = recorded.notes
    if not any(re.match(r"X[_ ]Value", name) for name in recorded):
        start, step = (_number(settings.get(key, [])) for key in ("X0", "Delta_X"))
        if step:
            samples = len(next(iter(recorded.values()), []))
            columns.add("time", (start or 0.0) + step * np.arange(float(samples)), "s")
            columns.notes.append(f"times are made from Delta_X, {step:g} s")
    for name, values in recorded.items():
        is_time = re.match(r"X[_ ]Value", name) is not None
        columns.add("time" if is_time else name, values, "s" if is_time else "")
    return Tables({"": columns}, tables.left_out)


def _head_of(text: str) -> list[str]:
    return text[: text.rfind(_END)].splitlines() if _END in text else []


def _number(cells: list[str]) -> float | None:
    try:
        return float(cells[0].replace(",", "."))
    except (IndexError, ValueError):
        return None


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
    tables = Tables()
    for group in TdmsFile.read(path).groups():
        clocks: dict[tuple[int, bytes], Columns] = {}
        for channel in group.channels():
            values = np.asarray(channel[:])
            if values.dtype.kind not in "biuf" or not values.size:
                tables.left_out.append(f"channel {group.name}/{channel.name}: no numbers")
                continue
            time = None
            if channel.properties.get("wf_increment"):
                time = np.asarray(channel.time_track(), float)
            key = (len(values), b"" if time is None else time.tobytes())
            columns = clocks.setdefault(key, Columns({} if time is None else {"time (s)": time}))
            units = (channel.properties.get(key) for key in ("unit_string", "NI_UnitDescription"))
            columns.add(channel.name, values.astype(float), str(next(filter(None, units), "")))
        for number, columns in enumerate(clocks.values(), start=1):
            tables.tables[group.name if len(clocks) == 1 else f"{group.name}[clock {number}]"] = columns
    return tables
