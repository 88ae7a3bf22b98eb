"""Arrays in NumPy's own files: npy and npz."""

from __future__ import annotations

import zipfile
from pathlib import Path, PurePosixPath
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.readers.signals import (
    MOST_SIGNALS,
    Allowance,
    Found,
    Unreadable,
    is_full,
    note_rest,
    seconds,
)

_BROKEN = "copy or download it again, or save it anew with numpy.save or numpy.savez"
_PICKLED = "objects run code when they are loaded; save the plain arrays one by one with numpy.savez"


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
