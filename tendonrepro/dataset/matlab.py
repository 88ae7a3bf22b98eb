"""MATLAB files of every version as nested plain values."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import scipy.io
from numpy.typing import NDArray

from tendonrepro.dataset.columns import Column, Columns, Tables, Unreadable
from tendonrepro.dataset.nested import Nested, tables_of
from tendonrepro.dataset.simulink import as_object, as_structure

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    try:
        import matio
    except ImportError:
        # Some machines have no build of it; SciPy reads all but objects and version 7.3.
        matio = None

_DAMAGED = 0xDD000000
"""First number of what stands for an object whose properties cannot be read."""


def read_matlab(path: Path) -> Tables:
    """Read the variables that can be read; of the others it is said why not.

    Raises
    ------
    Unreadable
        If it is a figure or a text, or no variable can be read.
    """
    # A figure of MATLAB is a file of MATLAB, and its tables are of colours.
    if path.suffix.lower() == ".fig":
        raise Unreadable("a figure of MATLAB: open it there and save the data of its lines")
    _refuse_text(path)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        variables, reasons = _by_scipy(path) if matio is None else _by_matio(path)
    if not variables:
        raise Unreadable(f"no variable of this MATLAB file can be read: {'; '.join(reasons)[:200]}")
    tables = tables_of(variables)
    tables.left_out[:0] = reasons
    return tables


def _by_scipy(path: Path) -> tuple[Nested, list[str]]:
    loaded = scipy.io.loadmat(path, spmatrix=False)
    return {name: _plain(value) for name, value in loaded.items() if not name.startswith("_")}, []


def _by_matio(path: Path) -> tuple[Nested, list[str]]:
    """Variables, and lines that say which cannot be read, and why."""
    variables, reasons = {}, []
    for name in _names(path):
        try:
            # One by one, since a broken one fails the load of all.
            read = matio.load_from_mat(str(path), variable_names=[name], add_table_attrs=True)
            variables[name] = _plain(read[name])
        except RecursionError:
            reasons.append(f"{name}: holds itself, as nested function handles do")
        except Exception as error:
            reasons.append(f"{name}: cannot be read, {type(error).__name__} {error}"[:160])
    return variables | _streams(path), reasons


def _refuse_text(path: Path) -> None:
    with path.open("rb") as stream:
        head = stream.read(200)
    if head.startswith(b"# Created by Octave") or b"# name:" in head:
        raise Unreadable("Octave's text format is not read: in Octave, load it, then save -v7 NEW.mat")


def _names(path: Path) -> list[str]:
    if h5py.is_hdf5(path):
        with h5py.File(path, locking=False) as file:
            return [name for name in file if not name.startswith("#")]
    return list(matio.whosmat(str(path)))


def _streams(path: Path) -> Nested:
    """Samples that Simulink streamed to the file, beside objects that do not name them."""
    if not h5py.is_hdf5(path):
        return {}
    with h5py.File(path, locking=False) as file:
        group = file.get("#sigstream#", {})
        numbered = sorted((name for name in group if name.isdigit()), key=int)
        doubles = [name for name in numbered if int(group[name]["#sampleSize#"][0]) == np.float64().itemsize]
        streams = {f"stream {name}": group[name]["#data#"][()].tobytes() for name in doubles}
    return {name: np.frombuffer(content, np.float64) for name, content in streams.items()}


def _plain(value: object) -> object:
    """Numbers as arrays, tables as `Columns`, all else with members as a dict."""
    if isinstance(value, pd.DataFrame | Mapping):
        return _table(value) if isinstance(value, pd.DataFrame) else _members(value)
    if hasattr(value, "properties") and hasattr(value, "classname"):
        return as_object(value.classname, _members(value.properties))
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
    return as_structure({str(name): _plain(value) for name, value in members.items()})


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
