"""Small MATLAB files of every kind, made up here: SYNTHETIC, never a measurement."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

NOTE = b"SYNTHETIC, made by the tests"


def classic(path: Path, variables: Mapping[str, Any], *, packed: bool = False) -> Path:
    """MATLAB 5, 7 (packed) or 4, as SciPy writes it."""
    savemat(path, dict(variables), do_compression=packed)
    return _headed(path, b"MATLAB 5.0 MAT-file, ")


def _headed(path: Path, kind: bytes, after: bytes = b"") -> Path:
    with path.open("r+b") as file:
        file.write((kind + NOTE).ljust(116) + after)
    return path


def hdf(path: Path, variables: Mapping[str, Any]) -> Path:
    """MATLAB 7.3, member by member: arrays transposed, cells as references, a header before the HDF5 data."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")
        for name, value in variables.items():
            put(file, file, name, value)
    return _headed(path, b"MATLAB 7.3 MAT-file, ", bytes(8) + b"\x00\x02IM")


def put(file: h5py.File, group: h5py.Group, name: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        kind, node = "struct", group.create_group(name)
        for key, item in value.items():
            put(file, node, key, item)
        fields = np.empty(len(value), dtype=h5py.vlen_dtype(np.dtype("S1")))
        for number, key in enumerate(value):
            fields[number] = np.array(list(key.encode()), np.uint8).view("S1")
        node.attrs.create("MATLAB_fields", fields)
    elif isinstance(value, list):
        refs = file["#refs#"]
        cells = [put(file, refs, f"r{len(refs)}", item).ref for item in value]
        kind, node = "cell", group.create_dataset(name, data=np.array([cells], h5py.ref_dtype).T)
    elif isinstance(value, str):
        codes = np.frombuffer(value.encode("utf-16-le"), np.uint16)[:, None]
        kind, node = "char", group.create_dataset(name, data=codes)
        node.attrs["MATLAB_int_decode"] = np.int32(2)
    else:
        array = np.atleast_2d(value)
        kind = {"float64": "double", "float32": "single"}.get(array.dtype.name, array.dtype.name)
        node = group.create_dataset(name, data=array.T)
    node.attrs["MATLAB_class"] = np.bytes_(kind)
    return node


def thing(kind: str, **properties: Any) -> Any:
    """An object of a class, to be written by `objects`."""
    # Some machines have no build of it.
    pytest.importorskip("matio")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from matio.utils.matclass import MatlabOpaque
    return MatlabOpaque(properties, kind)


def objects(path: Path, variables: Mapping[str, Any], version: str) -> Path:
    """A file with objects; `version` is ``v7`` or ``v7.3``."""
    matio = pytest.importorskip("matio")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), dict(variables), version=version)
    return _headed(path, b"MATLAB MAT-file, ")


EMPTY = np.empty((0, 0))


def timeseries(
    data: Any = None,
    time: Any = None,
    *,
    name: str = "",
    unit: str = "",
    time_first: bool = True,
    uniform: tuple[float, float, int] | None = None,
    storage: Any = None,
    time_unit: str = "seconds",
) -> Any:
    """A MATLAB timeseries; times as stored, or as start, step and count."""
    stored = EMPTY if time is None else np.reshape(time, (-1, 1))
    start, step, count = (np.array([[float(number)]]) for number in uniform or (0.0, np.nan, 0))
    clock = {"Start_": start, "Increment_": step, "Length": count}
    streamed = {} if storage is None else {"Data": storage, "Length": np.zeros((1, 1))}
    return thing(
        "timeseries",
        Data_=EMPTY if data is None else np.asarray(data),
        TimeInfo=thing("tsdata.timemetadata", Time_=stored, Units=time_unit, **clock),
        IsTimeFirst_=np.array([[time_first]]),
        Storage_=thing("tsdata.StreamingStorage", **streamed) if streamed else EMPTY,
        DataInfo=thing("tsdata.datametadata", Units=unit),
        Name=name,
    )


def record(**fields: Any) -> Any:
    """A struct of one element."""
    return records(fields)


def records(*elements: Mapping[str, Any]) -> Any:
    """A struct array, one row."""
    array = np.empty((1, len(elements)), dtype=[(name, object) for name in elements[0]])
    for number, fields in enumerate(elements):
        for name, value in fields.items():
            array[name][0, number] = value
    return array


def cells(*items: Any) -> Any:
    """A cell array, one row."""
    array = np.empty((1, len(items)), dtype=object)
    for number, item in enumerate(items):
        array[0, number] = item
    return array
