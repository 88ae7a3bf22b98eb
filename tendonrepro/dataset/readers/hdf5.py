"""Datasets in HDF5 and netCDF-4 files."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.readers.numpy_files import add_array
from tendonrepro.dataset.readers.signals import BEST_PACKING, HARMLESS, Allowance, Found, Unreadable, is_full
from tendonrepro.dataset.readers.units import FACTORS, plain_unit

_MOST_OBJECTS = 50_000
_MOST_WORDS = 64
_PACKING = ("scale_factor", "add_offset")
_BROKEN = "copy or download it again; if it stays broken, export it again"
_ELSEWHERE = "copy that file's data into this one with h5repack or h5copy"


def read_hdf5(path: Path, left: Allowance | None = None) -> Found:
    """Read every dataset of numbers in an HDF5 file; nothing outside the file is ever opened.

    One signal a dataset, or one a field of a compound one. The group is the HDF5 group; times come from a
    dimension scale in a unit of time. `Unreadable` when it cannot be opened.
    """
    found = Found("HDF5", left or Allowance())
    try:
        with h5py.File(path, "r") as file:
            if "_NCProperties" in file.attrs:
                found.kind = "netCDF-4"
            for name in _objects(found, file):
                if is_full(found):
                    found.skip("", "more datasets left out", "split the file")
                    break
                _read_one(found, name, file[name or "/"])
    except Exception as error:  # h5py raises whatever class fits the place that is broken
        if found.signals:
            found.skip("", f"broken ({error})", _BROKEN)
            return found
        raise Unreadable(f"a broken HDF5 file ({error})", _BROKEN) from error
    return found


def _objects(found: Found, file: h5py.File) -> list[str]:
    """Names of everything in a file, each once however many links lead to it, and none outside of it."""
    names = [""]
    file.visititems_links(partial(_note_link, found))
    file.visit(lambda name: names.append(name) if len(names) < _MOST_OBJECTS else True)
    if len(names) == _MOST_OBJECTS:
        found.skip("", f"only the first {_MOST_OBJECTS} objects were looked at")
    return names


def _note_link(found: Found, name: str, link: Any) -> bool | None:
    if isinstance(link, h5py.ExternalLink):
        found.skip(name, f"a link to another file, {link.filename[:100]}", _ELSEWHERE)
    return len(found.skipped) >= _MOST_OBJECTS or None


def _note_attributes(found: Found, group: h5py.Group, path: str) -> None:
    for name in list(group.attrs)[:50]:
        found.text(f"{path}/@{name}".lstrip("/"), _text_attribute(group, name))


def _text_attribute(item: Any, name: str) -> str:
    """Value of an attribute that is a text; empty for one that is missing, broken or something else."""
    try:
        value = item.attrs.get(name)
    except Exception:
        return ""
    value = value.flat[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return value if isinstance(value, str) else ""


def _read_one(found: Found, path: str, dataset: Any) -> None:
    try:
        if isinstance(dataset, h5py.Group):
            _note_attributes(found, dataset, path)
            return
        reason, advice = _why_not(found, dataset)
        if reason:
            found.skip(path, reason, advice)
        elif _text_attribute(dataset, "MATLAB_class") == "char":
            found.text(path, "".join(map(chr, np.ravel(dataset[()]))))
        elif path.startswith("#") or "MATLAB_object_decode" in dataset.attrs:
            found.skip(path, "part of a MATLAB object or cell")
        elif dataset.dtype.kind in "OSU":
            found.skip(path, "text or objects")
            if h5py.check_string_dtype(dataset.dtype) and dataset.size <= _MOST_WORDS:
                found.text(path, ", ".join(np.atleast_1d(dataset.asstr(errors="replace")[()]).ravel()))
        else:
            _add(found, path, dataset)
    except Exception as error:
        found.skip(path, f"broken ({error})", _BROKEN)


def _why_not(found: Found, dataset: h5py.Dataset) -> tuple[str, str]:
    """Why a dataset is not read, and the way out; empty texts when it is."""
    sources = dataset.virtual_sources() if dataset.is_virtual else ()
    if dataset.external or any(source.file_name != "." for source in sources):
        return "its numbers lie in another file", _ELSEWHERE
    gap = "This is a netCDF dimension but"
    if dataset.shape is None or _text_attribute(dataset, "NAME").startswith(gap):
        return "no numbers in it", ""
    if packed := [name for name in _PACKING if name in dataset.attrs]:
        return f"packed with {' and '.join(packed)}", "write it unpacked, such as with xarray"
    size, stored = dataset.nbytes, dataset.id.get_storage_size()
    if not dataset.is_virtual and size > BEST_PACKING * stored and (size > HARMLESS or not stored):
        return f"announces {size} bytes but holds {stored}, so most were never written", ""
    return found.refusal(max(dataset.size, size // 8), max(dataset.shape, default=0))


def _add(found: Found, path: str, dataset: h5py.Dataset) -> None:
    values = dataset[()]
    if values.dtype.names:
        add_array(found, path, values)
        return
    group, _, name = path.rpartition("/")
    found.add(
        path,
        np.asarray(values),
        label=_text_attribute(dataset, "long_name") or name,
        unit=_text_attribute(dataset, "units") or None,
        group=group,
        time=_time(found, dataset),
        note="not applied: _FillValue" if "_FillValue" in dataset.attrs else "",
    )


def _time(found: Found, dataset: h5py.Dataset) -> Array | None:
    """Sampling times in s where the first axis has a scale in a unit of time, or ``seconds since ...``."""
    try:
        scale = dataset.dims[0][0]
    except Exception:  # none, or a broken reference: the numbers are still there
        return None
    unit = plain_unit(_text_attribute(scale, "units").partition(" since ")[0])
    factor = FACTORS["time"].get(unit or "")
    if dataset.is_scale or factor is None or scale.shape != dataset.shape[:1] or any(_why_not(found, scale)):
        return None
    return np.asarray(scale[()], np.float64) * factor
