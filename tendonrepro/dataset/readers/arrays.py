"""Arrays in HDF5, netCDF-4 and NumPy's own files."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import IO, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.readers.signals import (
    BEST_PACKING,
    HARMLESS,
    MOST_SIGNALS,
    Allowance,
    Found,
    Unreadable,
    is_full,
    note_rest,
    seconds,
    unpacked_size,
)

_BROKEN = "copy or download it again; if it stays broken, export it again"
_PICKLED = "objects run code when they are loaded; save the plain arrays one by one with numpy.savez"
_DEEPEST = 32
_MOST_OBJECTS = 50_000
"""Links followed; a group may hold millions that lead nowhere."""
_MOST_WORDS = 64
_PACKING = ("scale_factor", "add_offset")
_SCALES = frozenset({"scale", "gain", "factor", "multiplier", "conversion", "offset"})
_ELSEWHERE = "copy that file's data into this one with h5repack or h5copy"


def read_hdf5(path: Path, left: Allowance | None = None) -> Found:
    """Read every dataset of numbers in an HDF5 file; nothing outside the file is ever opened.

    One signal a dataset, or one a field of a compound one. The group is the HDF5 group. `Unreadable` when it
    cannot be opened.
    """
    found = Found("HDF5", left or Allowance())
    try:
        with h5py.File(path, "r") as file:
            if "_NCProperties" in file.attrs:
                found.kind = "netCDF-4"
            seen: set[object] = {h5py.h5o.get_info(file.id).addr}
            for name, dataset in _datasets(found, file, "", seen):
                if is_full(found):
                    found.skip("", "more datasets left out", "split the file")
                    break
                _read_one(found, name, dataset)
            if len(seen) > 2 * _MOST_OBJECTS:
                found.skip("", f"only the first {_MOST_OBJECTS} objects were looked at")
    except Exception as error:  # h5py raises whatever class fits the place that is broken
        if found.signals:
            found.skip("", f"broken ({error})", _BROKEN)
            return found
        raise Unreadable(f"a broken HDF5 file ({error})", _BROKEN) from error
    return found


def _datasets(
    found: Found, group: h5py.Group, path: str, seen: set[object], depth: int = 0
) -> Iterator[tuple[str, h5py.Dataset]]:
    """Every dataset of a file once; `seen` holds addresses, and the paths of links looked at."""
    _note_attributes(found, group, path)
    for name in islice(group, _MOST_OBJECTS):
        where = f"{path}/{name}".lstrip("/")
        if len(seen) > 2 * _MOST_OBJECTS:
            return
        seen.add(where)
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            found.skip(where, f"a link to another file, {link.filename[:100]}", _ELSEWHERE)
        if not isinstance(link, h5py.HardLink):
            continue
        try:
            item = group[name]
            address = h5py.h5o.get_info(item.id).addr
        except Exception as error:
            found.skip(where, f"broken ({error})", _BROKEN)
            continue
        if address in seen:
            continue
        seen.add(address)
        if isinstance(item, h5py.Dataset):
            yield where, item
        elif isinstance(item, h5py.Group) and depth < _DEEPEST:
            yield from _datasets(found, item, where, seen, depth + 1)


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


def _read_one(found: Found, path: str, dataset: h5py.Dataset) -> None:
    try:
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
    size, stored = unpacked_size(dataset), dataset.id.get_storage_size()
    if not dataset.is_virtual and size > BEST_PACKING * stored and (size > HARMLESS or not stored):
        return f"announces {size} bytes but holds {stored}, so most were never written", ""
    return found.refusal(max(dataset.size, size // 8), max(dataset.shape, default=0))


def _add(found: Found, path: str, dataset: h5py.Dataset) -> None:
    values = dataset[()]
    if values.dtype.names:
        add_array(found, path, values)
        return
    group, _, name = path.rpartition("/")
    notes = ["not applied: _FillValue"] * ("_FillValue" in dataset.attrs)
    notes += [
        f"its attribute {name} is not applied: should it be?"
        for name in dataset.attrs
        if name.lower() in _SCALES
    ]
    found.add(
        path,
        np.asarray(values),
        label=_text_attribute(dataset, "long_name") or name,
        unit=_text_attribute(dataset, "units") or None,
        group=group,
        note="; ".join(notes),
    )


def read_npy(path: Path, left: Allowance | None = None) -> Found:
    """Read the array of an npy file as ``array``."""
    found = Found("NumPy array (npy)", left or Allowance())
    with path.open("rb") as stream:
        add_array(found, "array", _array(found, stream, path.stat().st_size))
    return found


def read_npz(path: Path, left: Allowance | None = None) -> Found:
    """Read the arrays of an npz file under their names; one that is broken does not stop the rest."""
    found = Found("NumPy arrays (npz)", left or Allowance())
    try:
        archive = zipfile.ZipFile(path)
    except Exception as error:  # by what is broken, errors of many kinds
        raise Unreadable(f"a broken npz file ({error})", _BROKEN) from error
    with archive:
        entries = archive.infolist()
        for position, entry in enumerate(entries):
            if is_full(found) or position >= MOST_SIGNALS:
                note_rest(found, len(entries) - position, "arrays")
                break
            name = str(PurePosixPath(entry.filename).with_suffix(""))
            try:
                with archive.open(entry) as stream:
                    add_array(found, name, _array(found, stream, entry.file_size))
            except Unreadable as error:
                found.skip(name, error.reason, error.advice)
            except Exception as error:
                found.skip(name, f"broken ({error})", _BROKEN)
    return found


def _array(found: Found, stream: IO[bytes], size: int) -> NDArray[Any]:
    """Read an array of so many bytes if it may be kept; one of Python objects is never loaded."""
    reason, advice = found.refusal(size // 8)
    if reason:
        raise Unreadable(reason, advice)
    try:
        return np.lib.format.read_array(stream, allow_pickle=False)
    except Exception as error:
        pickled = "allow_pickle" in str(error)
        reason = "saved as Python objects" if pickled else f"broken or cut short ({str(error)[:200]})"
        raise Unreadable(reason, _PICKLED if pickled else _BROKEN) from error


def add_array(
    found: Found, path: str, values: NDArray[Any], *, unit: str | None = None, group: str = ""
) -> None:
    """Add an array of any type but objects as a signal, or one signal a field of a structured one."""
    if values.dtype.names:
        for field in values.dtype.names:
            if not is_full(found):
                add_array(found, f"{path}/{field}", values[field], unit=unit, group=group or path)
        return
    group = group or path.rpartition("/")[0]
    label = path.removeprefix(f"{group}/")
    if values.dtype.kind in "mM":
        numbers, note = seconds(values)
        found.add(path, numbers, label=label, unit="s", group=group, note=note)
    elif values.dtype.kind in "SU":
        found.text(path, ", ".join(values.ravel()[:20].astype(str)))
        found.skip(path, "text")
    else:
        found.add(path, values, label=label, unit=unit, group=group)
