"""Trace files: runs as netCDF-4, which xarray, h5py, MATLAB and HDFView open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tendonrepro.errors import DataMissingError
from tendonrepro.results.records import (
    RESERVED,
    SCHEMA_VERSION,
    VARIABLES,
    PlantRecord,
    PlantValue,
    Trace,
    TraceFile,
)

if TYPE_CHECKING:
    import xarray as xr

# netCDF attributes do not nest, so mappings among a run's are stored flat.
_NESTED = {"gains": "gain_", "readings": "reading_"}

_PACKED = {"zlib": True, "complevel": 1, "shuffle": True}
_ROOT = [field.name for field in fields(TraceFile) if field.name not in ("runs", "plant")]


def write_traces(path: Path, file: TraceFile) -> None:
    """Write a trace file; an OSError where it cannot be written."""
    import xarray as xr

    attributes = {name: getattr(file, name) for name in _ROOT}
    root = xr.Dataset(attrs={"Conventions": "CF-1.11", **attributes})
    nodes = {name: dataset_of(trace) for name, trace in file.runs.items()}
    tree = xr.DataTree.from_dict({"/": root, **nodes, RESERVED: _plant_dataset(file.plant)})
    encoding = {f"/{name}": dict.fromkeys(node.data_vars, _PACKED) for name, node in nodes.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    tree.to_netcdf(path, engine="h5netcdf", encoding=encoding)


def dataset_of(trace: Trace) -> xr.Dataset:
    """One run as an xarray dataset with the dimensions ``time`` and ``joint``."""
    import xarray as xr

    variables = {
        name: (("time", "joint"), trace[name], {"units": units, "long_name": meaning})
        for name, (units, meaning) in VARIABLES.items()
        if name in trace
    }
    coordinates = {
        "time": ("time", trace.time, {"units": "s", "long_name": "time"}),
        "joint": ("joint", np.array(trace.joint, np.int32), {"units": "1", "long_name": "joint number"}),
    }
    return xr.Dataset(variables, coordinates, _flat(trace.attributes))


def _flat(attributes: Mapping[str, Any]) -> dict[str, Any]:
    plain = {name: value for name, value in attributes.items() if name not in _NESTED}
    for name, prefix in _NESTED.items():
        plain |= {prefix + key: value for key, value in attributes.get(name, {}).items()}
    return plain


def _plant_dataset(plant: PlantRecord) -> xr.Dataset:
    """Its values, with dimensions named by their sizes."""
    import xarray as xr

    variables = {}
    for name, item in plant.values.items():
        # A variable has a dimension once, so the columns of a matrix have their own.
        dimensions = [f"size_{size}" + "_other" * axis for axis, size in enumerate(item.value.shape)]
        attributes = {key: getattr(item, key) for key in ("units", "source", "long_name")}
        variables[name] = (dimensions, np.asarray(item.value, np.float64), attributes)
    return xr.Dataset(variables, attrs=dict(plant.attributes))


def read_traces(path: Path) -> TraceFile:
    """Read a trace file bit for bit; a DataMissingError where it is absent, damaged or of another layout."""
    import xarray as xr

    hint = "run tendonrepro compare or tendonrepro decouple to make one"
    if not path.is_file():
        message = "there is no trace file"
        raise DataMissingError(message, where=str(path), hint=hint)
    try:
        with xr.open_datatree(path, engine="h5netcdf", decode_times=False) as tree:
            return _file_of(tree.load())
    except Exception as error:
        # What the library says of damage is of any type, and nothing but reading stands in this block.
        message = f"is not a sound trace file of tendonrepro: {error}"
        raise DataMissingError(message, where=str(path), hint=hint) from error


def _file_of(tree: xr.DataTree) -> TraceFile:
    found = int(tree.attrs["schema_version"])
    if found != SCHEMA_VERSION:
        message = f"its layout has version {found}, this tendonrepro reads version {SCHEMA_VERSION}"
        raise ValueError(message)
    attributes = {name: tree.attrs[name] for name in _ROOT} | {"schema_version": found}
    runs = {name: _trace_of(name, node) for name, node in tree.children.items() if name != RESERVED}
    return TraceFile(**attributes, runs=runs, plant=_plant_of(tree[RESERVED]))


def _trace_of(name: str, node: Any) -> Trace:
    variables = {str(key): item.values for key, item in node.data_vars.items()}
    joint = tuple(node["joint"].values.tolist())
    return Trace(name, node["time"].values, joint, variables, _attributes_of(node))


def _attributes_of(node: Any) -> dict[str, Any]:
    # NumPy's scalars and arrays become the plain numbers and lists they were written from.
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in node.attrs.items()}
    nested = {
        name: {key.removeprefix(prefix): plain.pop(key) for key in [*plain] if key.startswith(prefix)}
        for name, prefix in _NESTED.items()
    }
    # A netCDF attribute of one number is that number.
    nested["gains"] = {name: np.atleast_1d(value).tolist() for name, value in nested["gains"].items()}
    return plain | nested


def _plant_of(node: Any) -> PlantRecord:
    values = {str(name): PlantValue(item.values, **item.attrs) for name, item in node.data_vars.items()}
    return PlantRecord(values, dict(node.attrs))
