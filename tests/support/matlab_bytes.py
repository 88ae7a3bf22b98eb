"""Small MATLAB files of every kind, made up here: SYNTHETIC, never a measurement."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

NOTE = b"SYNTHETIC, made by the tests"


def classic(path: Path, variables: Mapping[str, Any], *, packed: bool = False) -> Path:
    """MATLAB 5, 7 (packed) or 4, as SciPy writes it."""
    savemat(path, dict(variables), do_compression=packed)
    return _headed(path, b"MATLAB 5.0 MAT-file, ")


def _headed(path: Path, kind: bytes) -> Path:
    with path.open("r+b") as file:
        file.write((kind + NOTE).ljust(116))
    return path


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
