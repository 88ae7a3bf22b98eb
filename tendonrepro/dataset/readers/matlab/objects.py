"""Objects in MATLAB files as plain values: timeseries, tables, dates, logs of Simulink."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.readers.matlab.values import (
    EXPORT,
    PACKAGE,
    Lost,
    Plain,
    Series,
    Table,
    brief,
    members,
    text_of,
)
from tendonrepro.dataset.readers.signals import seconds
from tendonrepro.dataset.repository.names import Numbered

_SECONDS = {
    "nanoseconds": 1e-9,
    "microseconds": 1e-6,
    "milliseconds": 1e-3,
    "minutes": 60.0,
    "hours": 3600.0,
    "days": 86400.0,
    "weeks": 604800.0,
}
_DEEPEST_STORAGE = 4


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep a library's warnings about a file to itself; what is lost is noted per variable."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def load_objects(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Read variables that are objects or may hold some, by name; `Lost` where one cannot be read."""
    if not names:
        return {}
    try:
        return _load(path, names)
    except ImportError:
        # There are machines without a build of mat-io.
        missing = Lost("reading it needs the package mat-io", PACKAGE)
        return dict.fromkeys(names, missing)
    except Exception as error:
        if len(names) == 1:
            return {names[0]: Lost(f"cannot be read ({brief(error)})", EXPORT)}
        # One variable may have spoiled the rest.
        return {name: load_objects(path, [name])[name] for name in names}


def _load(path: Path, names: Sequence[str]) -> dict[str, Any]:
    import matio

    found = matio.load_from_mat(str(path), variable_names=list(names), add_table_attrs=True, spmatrix=False)
    return {name: found[name] for name in names}


def translate(value: Any) -> Plain:
    """An object of a library as a plain value; `Lost` for what holds no numbers."""
    try:
        return _translated(value)
    except Exception as error:
        return Lost(f"{type(value).__name__} is not as expected ({brief(error)})", EXPORT)


def _translated(value: Any) -> Plain:
    kind = type(value).__name__
    if kind in _READERS:
        return _READERS[kind](value)
    if isinstance(value, Mapping):
        return {str(key): item for key, item in value.items()}
    numeric = isinstance(value, (np.generic, int, float))
    return np.atleast_1d(value) if numeric else Lost(f"{kind} holds no numbers")


def _object(value: Any) -> Plain:
    if isinstance(value, np.ndarray):
        return _unresolved(value)
    properties = value.properties
    if isinstance(properties, tuple):
        return Lost("empty")
    if not isinstance(properties, dict):
        return Lost(f"an object of class {value.classname} whose properties cannot be read", EXPORT)
    if value.classname in _CLASSES:
        return _CLASSES[value.classname](properties)
    return _element(properties) if {"Name", "Values"} <= properties.keys() else dict(properties)


def _unresolved(value: NDArray[Any]) -> Lost:
    """What is left of an object where only its class is known."""
    known = value.dtype.names is not None and "s2" in value.dtype.names and value.size
    name = value.flat[0]["s2"] if known else ""
    name = name.decode("latin-1") if isinstance(name, bytes) else str(name)
    return Lost(f"an object of class {name}" if name else "an object", EXPORT)


def _simulation(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Logs of a run, without what describes the run."""
    others = {name: value for name, value in properties.items() if name not in ("Data", "Metadata")}
    return members(properties.get("Data")) or others


def _timeseries(properties: Mapping[str, Any]) -> Series | Lost:
    """Samples and times of a MATLAB ``timeseries`` from its properties as stored."""
    data = _stored(properties, "Data_", "Data")
    first = bool(_number(properties.get("IsTimeFirst_"), 1.0))
    if data is None:
        # Streamed logs lie elsewhere, samples along the last axis.
        data, first = _stored(_properties(properties.get("Storage_")), "Data", "Data_"), False
    if data is None:
        return Lost("a timeseries without samples")
    info = _properties(properties.get("TimeInfo"))
    stored = _stored(info, "Time_", "Time")
    announced = len(stored.ravel()) if stored is not None else int(_number(info.get("Length"), 0.0))
    if announced != data.shape[0 if first else -1] and announced in (data.shape[0], data.shape[-1]):
        first = announced == data.shape[0]
    values = data if first else np.moveaxis(data, -1, 0)
    time = _times(info, stored, len(values))
    about = _properties(properties.get("DataInfo"))
    label = text_of(properties.get("Name")) or text_of(about.get("Name"))
    return Series(values, time, label, _unit(about.get("Units")))


def _times(info: Mapping[str, Any], stored: NDArray[Any] | None, samples: int) -> Array | None:
    if stored is None:
        start, step = _number(info.get("Start_"), 0.0), _number(info.get("Increment_"), np.nan)
        time = np.asarray(start + step * np.arange(samples), np.float64)
    else:
        time = np.array(stored.ravel(), np.float64)
    time *= _SECONDS.get(text_of(info.get("Units")), 1.0)
    return time if np.isfinite(time).all() else None


def _dataset(properties: Mapping[str, Any]) -> dict[str, Any] | Lost:
    """Elements of a log by their names."""
    names = Numbered()
    return {
        names.take(_name(_properties(item)) or f"element {number}"): item
        for number, item in enumerate(_elements(properties, 0), start=1)
    } or Lost("a log without signals of its own", EXPORT)


def _elements(properties: Mapping[str, Any], depth: int) -> list[Any]:
    for name in ("Elements", "Elements_"):
        if isinstance(properties.get(name), np.ndarray):
            return [_only(item) for item in properties[name].ravel(order="F")]
        if properties.get(name) is not None:
            return [properties[name]]
    inner = (_properties(value) for value in properties.values()) if depth < _DEEPEST_STORAGE else ()
    return next((found for own in inner if own and (found := _elements(own, depth + 1))), [])


def _name(properties: Mapping[str, Any]) -> str:
    given = text_of(properties.get("Name")) or text_of(properties.get("PropagatedName"))
    return given or _block(properties).rpartition("/")[2]


def _block(properties: Mapping[str, Any]) -> str:
    return text_of(_properties(properties.get("BlockPath")).get("Path"))


def _element(properties: Mapping[str, Any]) -> Plain:
    """One logged signal, under the name it was logged by."""
    values = _only(properties["Values"])
    plain = values if type(values) is np.ndarray else translate(values)
    if isinstance(plain, np.ndarray) and plain.dtype.names is not None:
        return members(plain)
    if isinstance(plain, Series):
        return replace(plain, label=_name(properties) or plain.label, block=_block(properties))
    return plain


def _table(frame: Any) -> Table:
    columns = {str(name): frame[name].to_numpy() for name in frame.columns}
    units = frame.attrs.get("VariableUnits") or frame.attrs.get("varUnits") or []
    index = frame.index.to_numpy()
    time, note = seconds(index) if index.dtype.kind in "mM" else (None, "")
    note = f"row times: {note}" if note else ""
    known = dict(zip(columns, map(str, units), strict=True)) if len(units) == len(columns) else {}
    return Table(columns, known, time, note)


_CLASSES: Mapping[str, Callable[[Mapping[str, Any]], Plain]] = {
    "timeseries": _timeseries,
    "Simulink.SimulationData.Dataset": _dataset,
    "Simulink.SimulationOutput": _simulation,
    "Simulink.SimulationMetadata": lambda _: Lost("a description of a simulation run"),
    "function_handle_workspace": lambda _: Lost("variables of a function handle"),
}
_READERS: Mapping[str, Callable[[Any], Plain]] = {
    "MatlabOpaque": _object,
    "MatlabOpaqueArray": lambda value: np.asarray(value, object) if value.size else Lost("empty"),
    "MatlabOpaqueProperty": np.atleast_1d,
    "MatlabEnumerationArray": lambda _: Lost("an enumeration", EXPORT),
    "MatlabObject": np.asarray,
    "MatlabFunction": lambda _: Lost("a function handle"),
    "EmptyMatStruct": lambda _: Lost("empty"),
    "MatlabCanonicalEmpty": lambda _: Lost("empty"),
    "NoneType": lambda _: Lost("empty"),
    "Categorical": lambda _: Lost("categories"),
    "DataFrame": _table,
}


def _only(value: Any) -> Any:
    """The one thing in a cell of one."""
    while (
        type(value) is np.ndarray and value.dtype == object and value.dtype.names is None and value.size == 1
    ):
        value = value.flat[0]
    return value


def _properties(value: Any) -> Mapping[str, Any]:
    value = _only(value)
    own = getattr(value, "properties", value)
    if isinstance(own, dict):
        return own
    return members(own) if isinstance(own, np.ndarray) else {}


def _stored(properties: Mapping[str, Any], *names: str) -> NDArray[Any] | None:
    for name in names:
        value = _only(properties.get(name))
        if isinstance(value, np.ndarray) and value.size and value.dtype.kind in "biuf":
            return np.asarray(value)
    return None


def _number(value: Any, otherwise: float) -> float:
    array = np.asarray(_only(value))
    return float(array.flat[0]) if array.size and array.dtype.kind in "biuf" else otherwise


def _unit(value: Any) -> str | None:
    return text_of(value) or text_of(_properties(value).get("Name")) or None
