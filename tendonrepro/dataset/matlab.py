"""MATLAB files of every version as nested plain values."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import scipy.io
from numpy.typing import NDArray

from tendonrepro.dataset.arrays import Columns, Series, Tree, Unreadable

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    try:
        import matio
    except ImportError:
        # Some machines have no build of it; SciPy reads all but objects and version 7.3.
        matio = None

_SECONDS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "minutes": 60.0, "hours": 3600.0}
_DAMAGED = 0xDD000000
"""First number of what stands for an object whose properties cannot be read."""


def read_matlab(path: Path) -> Tree:
    """Read the variables that can be read.

    Raises
    ------
    Unreadable
        If none can.
    """
    found, reasons = {}, []
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        if matio is None:
            held = scipy.io.loadmat(path, spmatrix=False)
            return {name: _plain(value) for name, value in held.items() if not name.startswith("_")}
        for name in _names(path):
            try:
                # One by one, since a broken one fails the load of all.
                read = matio.load_from_mat(str(path), variable_names=[name], add_table_attrs=True)
                found[name] = _plain(read[name])
            except Exception as error:
                reasons.append(f"{name}: {error}")
    if not found:
        raise Unreadable(f"no variable of this MATLAB file can be read: {'; '.join(reasons)[:200]}")
    return found


def _names(path: Path) -> list[str]:
    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            return [name for name in file if not name.startswith("#")]
    return list(matio.whosmat(str(path)))


def _plain(value: Any) -> Any:
    """Numbers as arrays, tables as `Columns`, all else with members as a dict."""
    if isinstance(value, pd.DataFrame | Mapping):
        return _table(value) if isinstance(value, pd.DataFrame) else _members(value)
    if hasattr(value, "properties") and hasattr(value, "classname"):
        return _object(value.classname, _members(value.properties))
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names is not None:
        names = value.dtype.names
        return _items([_members({name: item[name] for name in names}) for item in value.ravel(order="F")])
    if value.dtype == object:
        return _items([_plain(item) for item in value.ravel(order="F")])
    is_damaged = value.dtype == np.uint32 and value.size > 2 and value.flat[0] == _DAMAGED
    return None if is_damaged else value


def _items(items: list[Any]) -> Any:
    """Elements of a struct or cell array by number; an only one itself."""
    return items[0] if len(items) == 1 else {str(k): item for k, item in enumerate(items, start=1)}


def _members(members: Any) -> Tree:
    """Members of a struct, object or map; of Simulink's structure with time its signals."""
    if not isinstance(members, Mapping):
        return {}
    tree = {str(name): _plain(value) for name, value in members.items()}
    if not isinstance(tree.get("signals"), dict) or not isinstance(tree.get("time"), np.ndarray):
        return tree
    signals = tree["signals"]
    items = [signals] if "values" in signals else list(signals.values())
    labelled = {_text(item["label"]) or f"signal {k}": item["values"] for k, item in enumerate(items, 1)}
    return {"time (s)": tree["time"]} | labelled


def _object(kind: str, tree: Tree) -> Any:
    """Timeseries, elements and data sets of Simulink's logs; else members."""
    if kind == "timeseries":
        return _timeseries(tree)
    series = tree.get("Values")
    if isinstance(series, Series) and (name := _text(tree.get("Name"))):
        # An element of a log has the name it was logged by.
        time, *rest = series.items()
        return Series([time, *((re.sub(r"^[^\[(]*(?=\[| \(|$)", name, old), values) for old, values in rest)])
    if "Dataset" in kind:
        keys = ("Elements", "Elements_", "Storage_", "Storage")
        return next((tree[key] for key in keys if tree.get(key) is not None), None)
    return tree


def _table(frame: pd.DataFrame) -> Columns:
    found = Columns()
    units = frame.attrs.get("VariableUnits") or frame.attrs.get("varUnits") or [""] * frame.shape[1]
    if frame.index.dtype.kind in "mM":
        found.add("time", _seconds(frame.index.to_numpy()), "s")
    for (name, column), unit in zip(frame.items(), units, strict=False):
        values = column.to_numpy()
        if values.dtype.kind in "mM":
            found.add(str(name), _seconds(values), "s")
        elif values.dtype.kind in "biuf":
            found.add(str(name), values.astype(float), str(unit))
        elif values.dtype == object:
            found.add(str(name), values.astype(str))
    return found


def _seconds(times: NDArray[Any]) -> NDArray[np.float64]:
    """Durations, or dates since the first, s."""
    since = times - times[0] if times.dtype.kind == "M" else times
    return np.asarray(since / np.timedelta64(1, "s"), np.float64)


def _timeseries(tree: Tree) -> Series | None:
    held = (tree.get(key) for key in ("TimeInfo", "DataInfo", "Storage_"))
    info, about, storage = (part if isinstance(part, dict) else {} for part in held)
    # Streamed logs lie elsewhere.
    data = next(
        (v for v in (tree.get("Data_"), tree.get("Data"), storage.get("Data")) if _is_filled(v)), None
    )
    if data is None:
        return None
    time = next((info[key] for key in ("Time_", "Time") if _is_filled(info.get(key))), None)
    if time is None:
        start, step = (float(np.ravel(info[key])[0]) for key in ("Start_", "Increment_"))
        time = start + step * np.arange(int(np.ravel(info["Length"])[0]))
    time = np.ravel(time).astype(float) * _SECONDS.get(_text(info.get("Units")), 1.0)
    axis = next((k for k, size in enumerate(data.shape) if size == len(time)), None)
    if axis is None:
        return None
    samples = np.moveaxis(data, axis, 0).reshape(len(time), -1)
    unit = about.get("Units")
    unit = _text(unit.get("Name") if isinstance(unit, dict) else unit)
    name = _text(tree.get("Name")) or _text(about.get("Name"))
    found = Series({"time (s)": time})
    for k, column in enumerate(samples.T, start=1):
        found.add(f"{name}[{k}]" if samples.shape[1] > 1 else name, column.astype(float), unit)
    return found


def _is_filled(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.size > 0 and value.dtype.kind in "biuf"


def _text(value: Any) -> str:
    while isinstance(value, np.ndarray) and value.size:
        value = value.flat[0]
    return value.strip() if isinstance(value, str) else ""
