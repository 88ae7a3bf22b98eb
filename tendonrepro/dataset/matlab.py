"""MATLAB files of every version: structs, tables, timeseries and Simulink's logs as nested plain values."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tendonrepro.dataset.arrays import Tree
from tendonrepro.dataset.source import Columns, Series, Unreadable

_SECONDS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "minutes": 60.0, "hours": 3600.0}
_DAMAGED = 0xDD000000
"""First number of what stands for an object whose properties cannot be read."""
_DEEPEST = 12


def read_matlab(path: Path) -> Tree:
    """Read all variables of a MATLAB file.

    Raises
    ------
    Unreadable
        If no variable can be read. One that cannot is left out.
    """
    found, reasons = {}, []
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for name in _names(path):
            try:
                found[name] = _plain(_variable(path, name))
            except Exception as error:
                reasons.append(f"{name}: {error}")
    if not found:
        raise Unreadable(f"no variable of this MATLAB file can be read: {'; '.join(reasons)[:200]}")
    return found


def _names(path: Path) -> list[str]:
    import h5py

    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            return [name for name in file if not name.startswith("#")]
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque, varmats_from_mat

    names = []
    with path.open("rb") as stream:
        for name, part in varmats_from_mat(stream):
            # SciPy calls every object so; its own name is in what it makes of it.
            value = loadmat(part).get(name) if name == "None" else None  # type: ignore[arg-type]
            names.append(value["s0"][0].decode("latin-1") if isinstance(value, MatlabOpaque) else name)
    return [name for name in names if name]


def _variable(path: Path, name: str) -> Any:
    """Read one variable, since one that is broken fails the load of all."""
    try:
        import matio
    except ImportError:
        from scipy.io import loadmat

        return loadmat(path, variable_names=[name], spmatrix=False)[name]
    return matio.load_from_mat(str(path), variable_names=[name], add_table_attrs=True, spmatrix=False)[name]


def _plain(value: Any, depth: int = 0) -> Any:  # noqa: PLR0911 (one return a kind)
    """Numbers as arrays, tables and timeseries as `Columns`, all else that has members as a dict."""
    if depth > _DEEPEST:
        return None
    if isinstance(value, pd.DataFrame):
        return _table(value)
    if isinstance(value, Mapping):
        return _members(value, depth)
    if hasattr(value, "properties") and hasattr(value, "classname"):
        return _object(value, depth)
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names is not None:
        return _struct(value, depth)
    if value.dtype == object:
        items = [_plain(item, depth + 1) for item in value.ravel(order="F")]
        return items[0] if len(items) == 1 else {str(k): item for k, item in enumerate(items, start=1)}
    if value.dtype == np.uint32 and value.size > 2 and value.flat[0] == _DAMAGED:
        return None
    return value


def _members(members: Mapping[Any, Any], depth: int) -> Any:
    tree = {str(name): _plain(value, depth + 1) for name, value in members.items()}
    return _scope(tree) if {"time", "signals"} <= tree.keys() else tree


def _struct(value: NDArray[Any], depth: int) -> Any:
    names = value.dtype.names or ()
    flat = value.ravel(order="F")
    if not flat.size:
        return None
    items = [_members({name: item[name] for name in names}, depth) for item in flat]
    return items[0] if len(items) == 1 else {str(k): item for k, item in enumerate(items, start=1)}


def _scope(tree: dict[str, Any]) -> Any:
    """Simulink's structure with time: labelled signals over one clock."""
    signals = tree["signals"]
    items = [signals] if isinstance(signals, dict) and "values" in signals else list((signals or {}).values())
    if not isinstance(tree["time"], np.ndarray) or not tree["time"].size:
        return tree
    inner: Tree = {"time (s)": tree["time"]}
    for number, item in enumerate(items, start=1):
        inner[_text(item.get("label")) or f"signal {number}"] = item["values"]
    return inner


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
    """Durations in s, or dates in s since the first."""
    since = times - times[0] if times.dtype.kind == "M" else times
    return np.asarray(since / np.timedelta64(1, "s"), np.float64)


def _object(value: Any, depth: int) -> Any:
    properties = value.properties
    if not isinstance(properties, dict):
        return None
    if value.classname == "timeseries":
        return _timeseries(properties)
    if {"Name", "Values"} <= properties.keys():
        # An element of a log has the name it was logged by.
        inner = _plain(properties["Values"], depth + 1)
        name = _text(properties["Name"])
        return _renamed(inner, name) if isinstance(inner, Series) and name else inner
    for key in ("Elements", "Elements_", "Data", "Storage_", "Storage"):
        if properties.get(key) is not None and "Dataset" in value.classname + key:
            return _plain(properties[key], depth + 1)
    return _members(properties, depth)


def _renamed(series: Series, name: str) -> Series:
    """A timeseries under another name."""
    time, *rest = series.items()
    found = Series([time])
    for old, values in rest:
        unit = old.rpartition(" (")[2].rstrip(")") if old.endswith(")") else ""
        found.add(name, values, unit)
    return found


def _timeseries(properties: Mapping[str, Any]) -> Series | None:
    """Time and samples of a ``timeseries``, from its properties as they are stored."""
    data = _numbers(properties, "Data_", "Data")
    if data is None:
        # Streamed logs lie elsewhere.
        data = _numbers(_inner(properties.get("Storage_")), "Data", "Data_")
    info = _inner(properties.get("TimeInfo"))
    if data is None:
        return None
    stored = _numbers(info, "Time_", "Time")
    if stored is None:
        start, step, length = (
            _number(info, key, default)
            for key, default in (("Start_", 0.0), ("Increment_", np.nan), ("Length", max(data.shape)))
        )
        stored = start + step * np.arange(int(length))
    time = np.ravel(stored).astype(float) * _SECONDS.get(_text(info.get("Units")), 1.0)
    about = _inner(properties.get("DataInfo"))
    unit = _text(about.get("Units")) or _text(_inner(about.get("Units")).get("Name"))
    axis = next((k for k, size in enumerate(data.shape) if size == len(time)), None)
    if axis is None:
        return None
    samples = np.moveaxis(data, axis, 0).reshape(len(time), -1)
    found = Series({"time (s)": time})
    name = _text(properties.get("Name")) or _text(about.get("Name"))
    for k, column in enumerate(samples.T, start=1):
        found.add(f"{name}[{k}]" if samples.shape[1] > 1 else name, column.astype(float), unit)
    return found


def _inner(value: Any) -> Mapping[str, Any]:
    """Properties of an object, or members of a struct, however deep it is packed."""
    while isinstance(value, np.ndarray) and value.size == 1 and value.dtype.names is None:
        value = value.flat[0]
    if isinstance(value, np.ndarray) and value.dtype.names is not None and value.size:
        value = value.flat[0]
    if isinstance(value, np.void):
        return {name: value[name] for name in value.dtype.names or ()}
    held = getattr(value, "properties", value)
    return held if isinstance(held, dict) else {}


def _numbers(properties: Mapping[str, Any], *names: str) -> NDArray[Any] | None:
    for name in names:
        value = properties.get(name)
        while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
            value = value.flat[0]
        if isinstance(value, np.ndarray) and value.size and value.dtype.kind in "biuf":
            return value
    return None


def _number(properties: Mapping[str, Any], name: str, default: float) -> float:
    found = _numbers(properties, name)
    return default if found is None else float(found.flat[0])


def _text(value: Any) -> str:
    while isinstance(value, np.ndarray) and value.size:
        value = value.flat[0]
    return value.strip() if isinstance(value, str) else ""
