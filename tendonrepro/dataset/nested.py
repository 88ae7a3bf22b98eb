"""Files of nested values as tables: MATLAB, with logs of Simulink, scopes and dSPACE; HDF5; TDMS.

What lies together in the tree with as many rows, or one clock, is a table.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

import h5py
import numpy as np
import pandas as pd
import scipy.io
from numpy.typing import NDArray

from tendonrepro.dataset.tables import FEWEST, Column, Columns, Unreadable, free_name
from tendonrepro.dataset.words import FACTORS, plain_unit

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    try:
        import matio
    except ImportError:
        # Some machines have no build of it; SciPy reads all but objects and version 7.3.
        matio = None

_DAMAGED = 0xDD000000
"""First number of what stands for an object whose properties cannot be read."""
_NAMES = re.compile(r"names?$|headers?$|labels?$|variables?$|columns?$", re.IGNORECASE)
_UNIT_AT_END = re.compile(r"^(.*?)\s*([(\[][^()\[\]]*[)\]])\s*$")
_MOST_COLUMNS = 40
"""Of an array whose columns are signals."""
_MOST_NAMED = 12
"""Arrays that a line on what was left out names."""

Nested: TypeAlias = dict[str, Any]
"""Arrays, `Series`, `Columns` and further trees by name."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one signal: `time` (T,), s, and `values`, T of them along the first axis.

    Where it has no `name` of its own, it has that of its place in the tree.
    """

    time: Column
    values: Column
    name: str = ""
    unit: str = ""


def _tables_of(tree: Nested, left_out: Sequence[str] = ()) -> list[Columns]:
    """Tables of a tree, by their paths in it; lines `left_out` come before its own."""
    rest = Columns(notes=left_out)
    tables = [rest]
    apart: dict[str, list[str]] = {}
    _collect(tree, "", tables, apart)
    for why, names in apart.items():
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        rest.notes.append(f"{', '.join(names[:_MOST_NAMED])}{more}: {why}")
    return tables


def _collect(tree: Nested, path: str, tables: list[Columns], apart: dict[str, list[str]]) -> None:
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
            value.name = where
            tables.append(value)
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
        columns.name = path if len(groups) == 1 else f"{path}{which}"
        tables.append(columns)
    for where, value in inner:
        _collect(value, where, tables, apart)


def _no_signals(values: Column) -> str:
    """Why an array holds no signals, or an empty text."""
    samples = max(values.shape)
    if values.dtype.kind == "c":
        return "complex numbers"
    if samples < FEWEST:
        return f"fewer than {FEWEST} samples"
    return f"more than {_MOST_COLUMNS} columns" if values.size > _MOST_COLUMNS * samples else ""


def _signals(name: str, values: Column, axis: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Columns of an array with samples along an axis, named by their places in it, counted from 1."""
    moved = np.moveaxis(values, axis, 0).astype(float)
    sizes = moved.shape[1:]
    columns = moved.reshape(len(moved), -1).T
    for place, column in zip(product(*map(range, sizes)), columns, strict=True):
        told = ",".join(str(k + 1) for k, size in zip(place, sizes, strict=True) if size > 1)
        yield f"{name}[{told}]" if told else name, column


def read_hdf5(path: Path) -> list[Columns]:
    """Read the datasets of an HDF5 file, with their ``units``."""
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
    return _tables_of(tree)


def read_tdms(path: Path) -> list[Columns]:
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
    return _tables_of(tree, left_out)


def read_matlab(path: Path) -> list[Columns]:
    """Read the variables that can be read; of the others it is said why not.

    Raises
    ------
    Unreadable
        If it is a figure or a text, or no variable can be read.
    """
    # A figure of MATLAB is a file of MATLAB, and its tables are of colours.
    if path.suffix.lower() == ".fig":
        raise Unreadable("a figure of MATLAB: open it there and save the data of its lines")
    with path.open("rb") as stream:
        if b"# name:" in stream.read(200):
            raise Unreadable("Octave's text format is not read: in Octave, load it, then save -v7 NEW.mat")
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        variables, reasons = _by_scipy(path) if matio is None else _by_matio(path)
    if not variables:
        raise Unreadable(f"no variable of this MATLAB file can be read: {'; '.join(reasons)[:200]}")
    return _tables_of(variables, reasons)


def _by_scipy(path: Path) -> tuple[Nested, list[str]]:
    loaded = scipy.io.loadmat(path, spmatrix=False)
    return {name: _plain(value) for name, value in loaded.items() if not name.startswith("_")}, []


def _by_matio(path: Path) -> tuple[Nested, list[str]]:
    """Variables, and lines that say which cannot be read, and why."""
    variables: Nested = {}
    streams: Nested = {}
    reasons: list[str] = []
    if h5py.is_hdf5(path):
        with h5py.File(path, locking=False) as file:
            names = [name for name in file if not name.startswith("#")]
            streams = _streams(file.get("#sigstream#", {}))
    else:
        names = list(matio.whosmat(str(path)))
    for name in names:
        try:
            # One by one, since a broken one fails the load of all.
            read = matio.load_from_mat(str(path), variable_names=[name], add_table_attrs=True)
            variables[name] = _plain(read[name])
        except Exception as error:
            reasons.append(f"{name}: cannot be read, {type(error).__name__} {error}"[:160])
    return variables | streams, reasons


def _streams(group: Mapping[str, h5py.Group]) -> Nested:
    """Samples that Simulink streamed to the file, beside objects that do not name them."""
    numbered = sorted((name for name in group if name.isdigit()), key=int)
    doubles = [name for name in numbered if int(group[name]["#sampleSize#"][0]) == np.float64().itemsize]
    return {
        f"stream {name}": np.frombuffer(group[name]["#data#"][()].tobytes(), np.float64) for name in doubles
    }


def _plain(value: object) -> object:
    """Numbers as arrays, tables as `Columns`, all else with members as a dict."""
    if isinstance(value, pd.DataFrame | Mapping):
        return _table(value) if isinstance(value, pd.DataFrame) else _members(value)
    if hasattr(value, "properties") and hasattr(value, "classname"):
        return _as_object(value.classname, _members(value.properties))
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names is not None:
        names = value.dtype.names
        return _items([_members({name: item[name] for name in names}) for item in value.ravel(order="F")])
    if value.dtype == object:
        return _items([_plain(item) for item in value.ravel(order="F")])
    is_damaged = value.dtype == np.uint32 and value.size > 2 and value.flat[0] == _DAMAGED
    return None if is_damaged else value


def _items(items: Sequence[object]) -> object:
    """Elements of a struct or cell array by number; an only one itself."""
    return items[0] if len(items) == 1 else {str(k): item for k, item in enumerate(items, start=1)}


def _members(members: object) -> Nested:
    """Members of a struct, object or map."""
    if not isinstance(members, Mapping):
        return {}
    return _as_structure({str(name): _plain(value) for name, value in members.items()})


def _table(frame: pd.DataFrame) -> Columns:
    columns = Columns()
    units = frame.attrs.get("VariableUnits") or frame.attrs.get("varUnits") or [""] * frame.shape[1]
    if frame.index.dtype.kind in "mM":
        columns.add("time", _seconds(frame.index.to_numpy()), "s")
    for (name, column), unit in zip(frame.items(), units, strict=False):
        values = column.to_numpy()
        if values.dtype.kind in "mM":
            columns.add(str(name), _seconds(values), "s")
        elif values.dtype.kind in "biuf":
            columns.add(str(name), values.astype(float), str(unit))
        elif values.dtype == object:
            columns.add(str(name), values.astype(str))
    return columns


def _seconds(times: Column) -> NDArray[np.float64]:
    """Durations, or dates since the first, s."""
    since = times - times[0] if times.dtype.kind == "M" else times
    return np.asarray(since / np.timedelta64(1, "s"), np.float64)


def _as_object(kind: str, members: Nested) -> object:
    """Time series, elements and data sets of Simulink's logs; of other objects their members.

    Properties of a base class lie under ``any``.
    """
    base = members.pop("any", None)
    members = members | (base if isinstance(base, dict) else {})
    if kind == "timeseries":
        return _timeseries(members)
    if kind == "Simulink.SimulationOutput":
        return members["Data"] if isinstance(members.get("Data"), dict) else members
    if kind.endswith("Dataset") or "DatasetStorage" in kind:
        return _dataset(members)
    if kind.startswith("Simulink.SimulationData.") and "Values" in members:
        return {_element_name(members): members["Values"]}
    return members


def _as_structure(members: Nested) -> Nested:
    """Name the signals of scopes, named blocks of columns and dSPACE's captures; others stay as they are."""
    if isinstance(members.get("signals"), dict) and isinstance(members.get("time"), np.ndarray):
        return _scope(members["time"], members["signals"])
    if isinstance(members.get("X"), dict) and isinstance(members.get("Y"), dict):
        return _capture(members["X"], members["Y"]) or members
    # A signal of a scope has labels of its axes beside its values.
    return members if "values" in members else _named_block(members)


def _named_block(members: Nested) -> Nested:
    """A structure with a block of columns and as many names."""
    named = next((_texts(value) for key, value in members.items() if _NAMES.search(key)), [])
    for key, value in members.items():
        is_block = isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "biuf"
        if len(named) > 1 and is_block and len(named) in value.shape:
            block = value if value.shape[1] == len(named) else value.T
            columns = Columns()
            for name, column in zip(named, block.T, strict=True):
                columns.add(name, column.astype(float))
            return {key: columns} | {other: member for other, member in members.items() if other != key}
    return members


def _texts(value: object) -> list[str]:
    """Texts of a cell array, or an only one; none of anything else."""
    cells = list(value.values()) if isinstance(value, dict) else [value]
    words = [text(cell) for cell in cells]
    return words if all(words) else []


def text(value: object) -> str:
    """A text, or an empty one of anything else."""
    while isinstance(value, np.ndarray) and value.size:
        value = value.flat[0]
    return value.strip() if isinstance(value, str) else ""


def _element_name(members: Nested) -> str:
    """Name an element was logged by, else that of its signal, else of its block."""
    path = members.get("BlockPath")
    block = text(path.get("path")) if isinstance(path, dict) else ""
    own = (text(members.get("Name")), text(members.get("PropagatedName")), block.rpartition("/")[2])
    return next((name for name in own if name), "")


def _dataset(members: Nested) -> Nested | Series | None:
    """Signals of a data set by name; a storage within it holds the same."""
    stored = map(members.get, ("Elements", "Elements_", "Storage", "Storage_"))
    elements = next((part for part in stored if isinstance(part, dict | Series) and part), None)
    if not isinstance(elements, dict):
        return elements
    # An only element stands alone, not in a numbered list.
    named: Nested = {}
    for number, item in elements.items() if all(map(str.isdigit, elements)) else [("1", elements)]:
        for label, signal in _named_signals(item):
            named[free_name(named, label or f"signal {number}")] = signal
    return named


def _named_signals(item: object, label: str = "") -> Iterator[tuple[str, object]]:
    """Signals of an element or bus, with names from the element down; a bare series has its own."""
    if isinstance(item, dict) and not isinstance(item, Columns):
        for name, member in item.items():
            yield from _named_signals(member, f"{label} {name}".strip())
    elif isinstance(item, Series):
        yield label or item.name, replace(item, name=label or item.name)
    elif item is not None:
        yield label, item


def _scope(time: Column, signals: Nested) -> Nested:
    """Signals of a structure with time, by label, or title and legend."""
    items = [signals] if "values" in signals else list(signals.values())
    columns: Nested = {"time (s)": time} if time.size else {}
    for number, item in enumerate(items, start=1):
        if not isinstance(item, dict) or not isinstance(item.get("values"), np.ndarray):
            continue
        values, labels, legend = item["values"], _texts(item.get("label")), _texts(item.get("legend"))
        title = text(item.get("title"))
        # A scope's title may be a pattern, and its labels may be those of the axes.
        name = (title if not title.startswith("%<") else "") or (labels[-1] if labels else "")
        name = name or f"signal {number}"
        parts = legend or labels
        if len(parts) > 1 and values.shape[1:] == (len(parts),):
            said = _UNIT_AT_END.match(name)
            head, unit = (said[1], f" {said[2]}") if said else (name, "")
            for part, column in zip(parts, values.T, strict=True):
                columns[free_name(columns, f"{head} {part}{unit}")] = column
        else:
            columns[free_name(columns, name)] = values
    return columns


def _capture(X: Nested, Y: Nested) -> Nested:
    """Signals of dSPACE's ControlDesk, each on its own raster; nothing of other structures."""
    clocks, signals = ([part] if "Data" in part else list(part.values()) for part in (X, Y))
    if not all(isinstance(part, dict) and "Data" in part for part in clocks + signals):
        return {}
    named: Nested = {}
    for number, signal in enumerate(signals, start=1):
        time = np.ravel(clocks[int(np.ravel(signal.get("XIndex", 1))[0]) - 1]["Data"]).astype(float)
        values = np.ravel(signal["Data"]).astype(float)
        name = text(signal.get("Name")).replace('"', "").rpartition("/")[2] or f"signal {number}"
        is_on_time = len(values) == len(time)
        series = Series(time, values, name, text(signal.get("Unit"))) if is_on_time else values
        named[free_name(named, name)] = series
    return named


def _timeseries(tree: Nested) -> Series | None:
    members = (tree.get(key) for key in ("TimeInfo", "DataInfo", "Storage_"))
    info, about, storage = (part if isinstance(part, dict) else {} for part in members)
    # Streamed logs lie elsewhere.
    data = next(filter(_is_filled, (tree.get("Data_"), tree.get("Data"), storage.get("Data"))), None)
    time = next(filter(_is_filled, (info.get("Time_"), info.get("Time"))), None)
    if data is None:
        return None
    if time is None:
        start, step, count = (float(np.ravel(info[key])[0]) for key in ("Start_", "Increment_", "Length"))
        time = start + step * np.arange(count)
    time = np.ravel(time) * FACTORS["time"].get(plain_unit(text(info.get("Units"))) or "s", 1.0)
    axis = next((k for k, size in enumerate(data.shape) if size == len(time)), None)
    if axis is None:
        return None
    unit = about.get("Units")
    unit = text(unit.get("Name") if isinstance(unit, dict) else unit)
    name = text(tree.get("Name")) or text(about.get("Name"))
    return Series(time, np.moveaxis(data, axis, 0), name, unit)


def _is_filled(value: object) -> TypeGuard[Column]:
    return isinstance(value, np.ndarray) and value.size > 0 and value.dtype.kind in "biuf"
