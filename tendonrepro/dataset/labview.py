"""LabVIEW's measurements, as text and as TDMS."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tendonrepro.dataset.columns import Columns, Tables, Unreadable
from tendonrepro.dataset.text import read_text_table

_BEGIN, _END = "LabVIEW Measurement", "***End_of_Header***"
_HEADERS = 2
"""Headers of a file: its own, and that of the one segment."""


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
    header, headers = _header(path)
    if headers > _HEADERS:
        raise Unreadable(
            "a LabVIEW measurement of several segments: write it with one header only, as TDMS, or cut it"
        )
    (recorded,) = read_text_table(path).values()
    columns = Columns()
    columns.notes = recorded.notes
    times = [name for name in recorded if re.match(r"X[_ ]Value", name)]
    start, step = (_number(header.get(key, [])) for key in ("X0", "Delta_X"))
    if step and not times:
        samples = len(next(iter(recorded.values()), []))
        columns.add("time", (start or 0.0) + step * np.arange(float(samples)), "s")
        columns.notes.append(f"times are made from Delta_X, {step:g} s")
    for name, values in recorded.items():
        columns.add("time" if name in times else name, values, "s" if name in times else "")
    return Tables({"": columns})


def _header(path: Path) -> tuple[dict[str, list[str]], int]:
    """Settings of all headers by name, and how many headers there are."""
    with path.open(encoding="latin-1") as stream:
        head, _, _ = stream.read(2**16).rpartition(_END)
        stream.seek(0)
        headers = sum(line.startswith(_END) for line in stream)
    rows = (line.split("\t") for line in head.splitlines())
    return {name: values for name, *values in rows if name}, headers


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
            tables[group.name if len(clocks) == 1 else f"{group.name}[clock {number}]"] = columns
    return tables
