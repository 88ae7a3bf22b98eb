"""Trace files: runs as netCDF-4, which xarray, h5py, MATLAB and HDFView open; other formats of them."""

from __future__ import annotations

import json
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import atomic_path, refuse_existing, require_space, to_json, write_atomically
from tendonrepro.results import records

if TYPE_CHECKING:
    import h5netcdf
    import xarray as xr
    from pandas import DataFrame

TRACES = "traces.h5"
"""Name of the trace file in a results folder."""


# netCDF attributes do not nest, so mappings among a run's are stored flat.
_NESTED = {"gains": "gain_", "readings": "reading_"}

_COMPRESSION = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
_CHUNK = 2**17
"""Samples of a chunk: one MiB, as much as HDF5 keeps in memory while it reads."""
_ROOT = ("experiment", "source", "title", "config_yaml", "config_sha256")


def write_traces(path: Path, file: records.TraceFile) -> None:
    """Write a trace file, whole or not at all; a TendonreproError where it cannot be written.

    It is made in memory, since HDF5 ends the process where a disk is full.
    """
    import h5netcdf

    image = BytesIO()
    with h5netcdf.File(image, "w") as root:
        root.attrs.update({"Conventions": "CF-1.11", "schema_version": records.SCHEMA_VERSION})
        root.attrs.update({name: getattr(file, name) for name in _ROOT})
        for name in ("created", "tendonrepro_version"):
            root.attrs[name] = str(file.manifest.get(name, ""))
        root.attrs["manifest_json"] = to_json(file.manifest)
        for name, trace in file.runs.items():
            _write_run(root.create_group(name), trace)
        _write_plant(root.create_group(records.RESERVED), file.plant)
    content = image.getvalue()
    require_space(path, len(content))
    write_atomically(path, content)


def _write_run(group: h5netcdf.Group, trace: records.Trace) -> None:
    group.attrs.update(_flat(trace.attributes))
    group.dimensions = {"time": len(trace.time), "joint": len(trace.joint)}
    _write_variable(group, "time", ("time",), trace.time, "s", "time", **_packed(trace.time))
    _write_variable(group, "joint", ("joint",), np.array(trace.joint, np.int32), "1", "joint number")
    for name, (units, meaning) in trace.meanings.items():
        options = {"fillvalue": np.nan, **_packed(trace[name])}
        _write_variable(group, name, ("time", "joint"), trace[name], units, meaning, **options)


def _packed(values: Array) -> dict[str, object]:
    """How samples are compressed, each column for itself; nothing where there is none."""
    chunks = (min(len(values), _CHUNK), *[1] * (values.ndim - 1))
    return {**_COMPRESSION, "chunks": chunks} if values.size else {}


def _write_plant(group: h5netcdf.Group, plant: records.PlantRecord) -> None:
    """Its values, with dimensions named by their sizes."""
    group.attrs.update(plant.attributes)
    for name, item in plant.values.items():
        # A variable has a dimension once, so the columns of a matrix have their own.
        sizes = {f"size_{size}" + "_other" * axis: size for axis, size in enumerate(item.value.shape)}
        for key, size in sizes.items():
            if key not in group.dimensions:
                group.dimensions[key] = size
        values = np.asarray(item.value, np.float64)
        variable = _write_variable(group, name, tuple(sizes), values, item.units, item.long_name)
        variable.attrs["source"] = item.source


def _write_variable(
    group: h5netcdf.Group,
    name: str,
    dimensions: tuple[str, ...],
    values: Array | NDArray[np.int32],
    units: str,
    long_name: str,
    **options: object,
) -> h5netcdf.Variable:
    variable = group.create_variable(name, dimensions, values.dtype, data=values, **options)
    variable.attrs.update({"units": units, "long_name": long_name})
    return variable


def dataset_of(trace: records.Trace) -> xr.Dataset:
    """One run as an xarray dataset with the dimensions ``time`` and ``joint``."""
    import xarray as xr

    variables = {
        name: (("time", "joint"), trace[name], {"units": units, "long_name": meaning})
        for name, (units, meaning) in trace.meanings.items()
    }
    coordinates = {
        "time": ("time", trace.time, {"units": "s", "long_name": "time"}),
        "joint": ("joint", np.array(trace.joint, np.int32), {"units": "1", "long_name": "joint number"}),
    }
    return xr.Dataset(variables, coordinates, _flat(trace.attributes))


def _flat(attributes: records.Attributes) -> dict[str, object]:
    plain = {name: value for name, value in attributes.items() if name not in _NESTED}
    for name, prefix in _NESTED.items():
        plain |= {prefix + key: value for key, value in attributes.get(name, {}).items()}
    return plain


def read_traces(source: Path) -> records.TraceFile:
    """Read a trace file, or that of a results folder, bit for bit.

    Raises
    ------
    DataMissingError
        Where it is absent, damaged or of another layout.
    """
    import h5netcdf

    path = source / TRACES if source.is_dir() else source
    if not path.is_file():
        hint = "name the folder of one result, such as reports/compare; compare and decouple make them"
        raise DataMissingError("there is no such trace file", where=str(path), hint=hint)
    try:
        # Files take their places whole, so none is read while it is written; some file systems have no locks.
        with h5netcdf.File(path, "r", locking=False) as root:
            return _file_of(root)
    except Exception as error:
        # What the library says of damage is of any type, and nothing but reading stands in this block.
        message = f"is not a sound trace file of tendonrepro: {error}"
        hint = "make it again by tendonrepro compare, decouple, or ingest of measured files"
        raise DataMissingError(message, where=str(path), hint=hint) from error


def _file_of(root: h5netcdf.File) -> records.TraceFile:
    version = int(root.attrs["schema_version"])
    if version != records.SCHEMA_VERSION:
        message = f"its layout has version {version}, this tendonrepro reads version {records.SCHEMA_VERSION}"
        raise ValueError(message)
    attributes, manifest = {name: root.attrs[name] for name in _ROOT}, json.loads(root.attrs["manifest_json"])
    runs = {name: _trace_of(name, group) for name, group in root.groups.items() if name != records.RESERVED}
    plant = _plant_of(root[records.RESERVED])
    file = records.TraceFile(**attributes, runs=runs, plant=plant, manifest=manifest)
    if not all("printed_row" in run.attributes for run in runs.values()):
        # Before 28 November 2026 runs did not carry what they are.
        from tendonrepro.results.paper import with_what_they_are

        file = with_what_they_are(file)
    return file


def _trace_of(name: str, group: h5netcdf.Group) -> records.Trace:
    variables = {key: item[...] for key, item in group.variables.items()}
    time, joint = variables.pop("time"), tuple(variables.pop("joint").tolist())
    return records.Trace(name, time, joint, variables, _attributes_of(group))


def _attributes_of(group: h5netcdf.Group) -> records.Attributes:
    # NumPy's scalars and arrays become the plain numbers and lists they were written from.
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in group.attrs.items()}
    nested = {
        name: {key.removeprefix(prefix): plain.pop(key) for key in [*plain] if key.startswith(prefix)}
        for name, prefix in _NESTED.items()
    }
    # A netCDF attribute of one number is that number.
    nested["gains"] = {name: np.atleast_1d(value).tolist() for name, value in nested["gains"].items()}
    if "status_joints" in plain:
        plain["status_joints"] = np.atleast_1d(plain["status_joints"]).tolist()
    return plain | nested


def _plant_of(group: h5netcdf.Group) -> records.PlantRecord:
    values = {
        name: records.PlantValue(
            np.asarray(item[...]), *(item.attrs[key] for key in ("units", "source", "long_name"))
        )
        for name, item in group.variables.items()
    }
    return records.PlantRecord(values, dict(group.attrs))


def export_traces(source: Path, form: str, out: Path | None = None, *, force: bool = False) -> Path:
    """Write a trace file in another format, in SI units, and return the path.

    Parameters
    ----------
    source : Path
        Trace file, or a results folder.
    form : str
        ``csv`` and ``parquet`` have a row per run, sample and joint; ``mat`` a structure per run.
    out : Path, optional
        Else beside the trace file.

    Raises
    ------
    DataMissingError
        If the trace file cannot be read.
    UsageError
        For a format that is unknown or lacks its library, and a file that is there.
    """
    if form not in ("csv", "parquet", "mat"):
        raise UsageError(f"must be csv, parquet or mat, found {form!r}", where="--format")
    if out is not None and out.suffix != f".{form}":
        message = f"a file of the format {form} ends in .{form}, found {str(out)!r}"
        raise UsageError(message, where="--out")
    if form == "parquet" and find_spec("pyarrow") is None:
        message = "parquet needs the library pyarrow, which is not installed"
        raise UsageError(message, where="--format", hint="pip install 'tendonrepro[parquet]'")
    file, path = read_traces(source), source / TRACES if source.is_dir() else source
    target = out or path.with_suffix(f".{form}")
    refuse_existing(target, force=force, inputs=[path])
    with atomic_path(target) as temporary:
        if form == "mat":
            _write_mat(file, temporary)
        elif form == "parquet":
            _table(file).to_parquet(temporary, engine="pyarrow", index=False)
        else:
            _table(file).to_csv(temporary, index=False, lineterminator="\n")
    return target


def _table(file: records.TraceFile) -> DataFrame:
    """A row per run, sample and joint; what a run does not hold is missing there."""
    import pandas as pd

    runs = {name: dataset_of(trace).to_dataframe() for name, trace in file.runs.items()}
    return pd.concat(runs, names=["run"]).reset_index()


def _write_mat(file: records.TraceFile, path: Path) -> None:
    from scipy.io import savemat

    content = {
        name: {"time": trace.time, "joint": np.array(trace.joint), **trace.variables}
        | {key: trace.attributes[key] for key in ("law", "status", "payload_mass")}
        for name, trace in file.runs.items()
    }
    content["units"] = {"time": "s"} | {name: unit for name, (unit, _) in records.VARIABLES.items()}
    savemat(str(path), content, long_field_names=True, do_compression=True, oned_as="column")
