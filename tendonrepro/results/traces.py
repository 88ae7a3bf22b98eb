"""Trace files: runs on disk as netCDF-4 flavoured HDF5."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError
from tendonrepro.files import ordinary, write_atomically
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.records import (
    EVERY_RUN,
    SCHEMA_VERSION,
    VARIABLES,
    PlantRecord,
    PlantValue,
    Trace,
    TraceFile,
)

# Mappings among a run's attributes are stored flat, since HDF5 attributes do not nest.
_NESTED = {"gains": "gain_", "readings": "reading_"}

UNDEFINED = "not defined in this run; all values are missing (NaN)"
"""Comment on a variable that a run's controller does not have, such as the sliding variable of a servo."""

NEEDED = ("law", "payload_mass", "status", "status_time", "reference_period")
"""Attributes that figures and tables need of every run."""

MOST_BYTES = 2**30
"""Of one array of numbers: far more than any run has, and what a damaged size soon exceeds."""

_KNOWN = {"experiment": ("compare", "decouple", "both"), "source": ("simulated", "measured")}
_SQUARE = ("S", "S_inv", "pulley_diameter")

_ROOT_TEXTS = (
    "experiment",
    "source",
    "title",
    "config_yaml",
    "config_sha256",
    "manifest_json",
    "created",
    "tendonrepro_version",
)


def write_traces(path: Path, file: TraceFile) -> None:
    """Write a trace file, whole or not at all; equal contents give equal bytes.

    Raises
    ------
    TendonreproError
        When it cannot be written.
    """
    # The file is built in memory, because the HDF5 library does not survive a disk that fills up under it.
    # Attributes beyond 64 KiB need the 1.8 format or later; the upper bound keeps old readers working.
    with h5py.File(
        path.name,
        "w",
        driver="core",
        backing_store=False,
        block_size=2**20,
        libver=("earliest", "v110"),
        track_order=True,
    ) as root:
        _write_root(root, file)
        root.flush()
        image = root.id.get_file_image()
    write_atomically(path, image)


def _write_root(root: h5py.File, file: TraceFile) -> None:
    root.attrs["Conventions"] = "CF-1.11"
    for name in _ROOT_TEXTS:
        root.attrs[name] = getattr(file, name)
    root.attrs["schema_version"] = np.int32(file.schema_version)
    for trace in file.runs.values():
        _write_run(root.create_group(trace.name, track_order=True), trace)
    moving = next(iter(file.runs.values())).joint if file.runs else ()
    _write_plant(root.create_group("plant", track_order=True), file.plant, moving)


def _write_run(group: h5py.Group, trace: Trace) -> None:
    scales = [
        _write_scale(group, "time", trace.time, "s", "time"),
        _write_scale(group, "joint", np.array(trace.joint, np.int32), "1", "joint number"),
    ]
    absent = {name: np.full((len(trace.time), len(trace.joint)), np.nan) for name in EVERY_RUN}
    for name, value in (absent | dict(trace.variables)).items():
        dataset = _write_values(group, name, value, scales)
        dataset.attrs["units"], dataset.attrs["long_name"] = VARIABLES[name]
        if name not in trace.variables:
            dataset.attrs["comment"] = UNDEFINED
    for name, value in trace.attributes.items():
        if name in _NESTED:
            for key, entry in value.items():
                group.attrs[_NESTED[name] + key] = entry
        else:
            group.attrs[name] = value


def _write_plant(group: h5py.Group, plant: PlantRecord, moving: tuple[int, ...]) -> None:
    largest = max((size for item in plant.values.values() for size in item.value.shape), default=0)
    for name, item in plant.values.items():
        shape = item.value.shape
        scales = [_plant_scale(group, size, axis, moving, largest) for axis, size in enumerate(shape)]
        dataset = _write_values(group, name, item.value, scales)
        for key in ("units", "source", "long_name"):
            dataset.attrs[key] = getattr(item, key)
    for key, text in plant.attributes.items():
        group.attrs[key] = text


def _plant_scale(
    group: h5py.Group, size: int, axis: int, moving: tuple[int, ...], largest: int
) -> h5py.Dataset:
    """Dimension of a plant value, told by its length: the moving joints, all joints, or a bare index."""
    every = tuple(range(1, size + 1))
    if size == len(moving) and moving != every:
        name, numbers, long_name = "moving_joint", moving, "joint number"
    elif size in (len(moving), largest):
        name, numbers, long_name = "joint", every, "joint number"
    else:
        name, numbers, long_name = f"index_{size}", every, "index"
    # CF allows a dimension once a variable, so the columns of a matrix have their own.
    name += "_other" * axis
    if name in group:
        return group[name]
    return _write_scale(group, name, np.array(numbers, np.int32), "1", long_name)


def _write_scale(
    group: h5py.Group, name: str, values: NDArray[Any], units: str, long_name: str
) -> h5py.Dataset:
    scale = group.create_dataset(name, data=values)
    scale.make_scale(name)
    scale.attrs["units"] = units
    scale.attrs["long_name"] = long_name
    return scale


def _write_values(group: h5py.Group, name: str, value: Array, scales: list[h5py.Dataset]) -> h5py.Dataset:
    # Chunks cost more than they save on the few numbers of a plant value.
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if value.size > 1024 else {}
    dataset = group.create_dataset(name, data=np.asarray(value, np.float64), **packing)
    for axis, scale in enumerate(scales):
        dataset.dims[axis].attach_scale(scale)
    return dataset


def read_traces(path: Path) -> TraceFile:
    """Read a trace file, bit for bit what `write_traces` wrote.

    Raises
    ------
    DataMissingError
        When the file is absent, not HDF5, damaged, not a trace file, or of another schema version.
    """
    with _opened(path) as root:
        _check_schema(path, root)
        _require(all(isinstance(root.get(name, getlink=True), h5py.HardLink) for name in root))
        texts = {name: _text(root.attrs[name]) for name in _ROOT_TEXTS}
        runs = {name: _read_run(name, group) for name, group in root.items() if name != "plant"}
        _require(all(texts[name] in known for name, known in _KNOWN.items()))
        return TraceFile(**texts, runs=runs, plant=_read_plant(root["plant"]))  # type: ignore[arg-type]


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    hint = "Run `tendonrepro compare` or `tendonrepro decouple` to make one."
    try:
        ordinary(path, None).open("rb").close()
    except OSError as error:
        message = f"cannot read the trace file {path}: {error.strerror}"
        raise DataMissingError(message, hint=hint) from error
    if not h5py.is_hdf5(path):
        message = f"{path} is not an HDF5 file"
        raise DataMissingError(message, hint=hint)
    try:
        with h5py.File(path, "r") as root:
            yield root
    except DataMissingError:
        raise
    except Exception as error:
        # What the library says of damage is of any type, so nothing but reading stands in this block.
        message = f"{path} is damaged or incomplete and cannot be read"
        raise DataMissingError(message, hint=hint) from error


def _check_schema(path: Path, root: h5py.File) -> None:
    if "schema_version" not in root.attrs or "tendonrepro_version" not in root.attrs:
        message = f"{path} is an HDF5 file, but not a trace file of tendonrepro"
        raise DataMissingError(message)
    found = int(root.attrs["schema_version"])
    if found != SCHEMA_VERSION:
        message = f"{path} has layout version {found}; this tendonrepro reads version {SCHEMA_VERSION}"
        raise DataMissingError(message, hint="Make the traces again with this version.")


def _require(holds: bool) -> None:
    """Take a file for damaged unless something holds that is true of every file that was written."""
    if not holds:
        raise ValueError


def _text(stored: object) -> str:
    _require(isinstance(stored, str))
    return str(stored)


def _numbers(item: Any, dimensions: int | None = None) -> NDArray[Any]:
    """Numbers of a dataset, as many dimensions as a run's have or any up to two."""
    _require(isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and item.nbytes <= MOST_BYTES)
    _require(item.ndim <= 2 if dimensions is None else item.ndim == dimensions)
    return np.asarray(item[()])


def _read_run(name: str, group: h5py.Group) -> Trace:
    time, joint = _numbers(group["time"], 1), _numbers(group["joint"], 1)
    _require(bool(np.isfinite(time).all() and (np.diff(time) > 0.0).all()))
    _require(joint.dtype.kind in "iu" and joint.min() > 0 and len(set(joint.tolist())) == len(joint))
    variables = {
        key: _numbers(item, 2)
        for key, item in group.items()
        if key not in ("time", "joint") and item.attrs.get("comment") != UNDEFINED
    }
    attributes = _read_attributes(group)
    missing = [key for key in NEEDED if key not in attributes]
    if missing:
        message = f"the run {name!r} in {group.file.filename} lacks the attribute {missing[0]!r}"
        raise DataMissingError(message)
    _text(attributes["law"])
    _require(attributes["status"] in STATUSES)
    _require(all(math.isfinite(attributes[key]) for key in NEEDED if key not in ("law", "status")))
    return Trace(name, time, tuple(joint.tolist()), variables, attributes)


def _read_attributes(group: h5py.Group) -> dict[str, Any]:
    attributes: dict[str, Any] = {name: {} for name in _NESTED}
    for key, stored in group.attrs.items():
        # numpy scalars and arrays become the plain numbers and lists they were written from.
        value = stored.tolist() if isinstance(stored, np.generic | np.ndarray) else stored
        for name, prefix in _NESTED.items():
            if key.startswith(prefix):
                attributes[name][key.removeprefix(prefix)] = value
                break
        else:
            attributes[key] = value
    return attributes


def _read_plant(group: h5py.Group) -> PlantRecord:
    values = {}
    for name, item in group.items():
        if not item.is_scale:
            units, source, long_name = (_text(item.attrs[key]) for key in ("units", "source", "long_name"))
            values[name] = PlantValue(_numbers(item), units, source, long_name)
    shapes = {name: values[name].value.shape for name in (*_SQUARE, "winch_diameter") if name in values}
    sizes = {shape[:1] for name, shape in shapes.items() if name.endswith("_diameter")}
    _require(all(len(shape) and shape == shape[:1] * 2 for name, shape in shapes.items() if name in _SQUARE))
    _require(len(sizes) < 2 and () not in sizes)
    return PlantRecord(values, {key: _text(text) for key, text in group.attrs.items()})
