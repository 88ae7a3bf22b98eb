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
    """MATLAB 7.3, member by member: arrays transposed, a header before the HDF5 data."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            put(file, name, value)
    return _headed(path, b"MATLAB 7.3 MAT-file, ", bytes(8) + b"\x00\x02IM")


def put(group: h5py.Group, name: str, value: Any) -> None:
    """Write a struct or a double."""
    if isinstance(value, Mapping):
        kind, node = "struct", group.create_group(name)
        for key, item in value.items():
            put(node, key, item)
        fields = np.empty(len(value), dtype=h5py.vlen_dtype(np.dtype("S1")))
        for number, key in enumerate(value):
            fields[number] = np.array(list(key.encode()), np.uint8).view("S1")
        node.attrs.create("MATLAB_fields", fields)
    else:
        kind, node = "double", group.create_dataset(name, data=np.atleast_2d(value).T)
    node.attrs["MATLAB_class"] = np.bytes_(kind)


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


def timeseries(data: Any, time: Any, *, name: str, unit: str) -> Any:
    """A MATLAB timeseries."""
    start, step, count = (np.array([[number]]) for number in (0.0, np.nan, 0.0))
    clock = {"Start_": start, "Increment_": step, "Length": count, "Units": "seconds"}
    return thing(
        "timeseries",
        Data_=np.asarray(data),
        TimeInfo=thing("tsdata.timemetadata", Time_=np.reshape(time, (-1, 1)), **clock),
        IsTimeFirst_=np.array([[True]]),
        Storage_=EMPTY,
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
