"""MATLAB files of every version, told apart by their first bytes."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from tendonrepro.dataset.readers.arrays import read_hdf5
from tendonrepro.dataset.readers.matlab.figure import BESIDE, TREES, read_figure
from tendonrepro.dataset.readers.matlab.hdf import contents, read_streams
from tendonrepro.dataset.readers.matlab.objects import load_objects, quiet, translate
from tendonrepro.dataset.readers.matlab.values import EXPORT, PACKAGE, Lost, brief
from tendonrepro.dataset.readers.matlab.walk import Walk
from tendonrepro.dataset.readers.signals import MOST_NUMBERS, MOST_SIGNALS, Allowance, Found, Unreadable

_AGAIN = "copy or download it again"
_SPLIT = "save what is needed of it into a file of its own"
# SciPy has no name for the class of objects whose properties lie apart.
_OPAQUE = "opaque"
_NESTED = frozenset({"cell", "struct", "object", "function", _OPAQUE})
_COMPRESSED = 15


class _Variable(NamedTuple):
    """A variable of a MATLAB 5 file, its bytes as a file of its own so that it fails alone."""

    name: str
    kind: str
    size: int
    part: BytesIO


def read_matlab(path: Path, left: Allowance | None = None) -> Found:
    """Read a MATLAB file of version 5, 7 or 7.3, or a figure; `Unreadable` if that fails as a whole.

    Sizes inside the variables of versions before 7.3 are not checked, only what they unpack into: the process
    that reads is limited in memory and time, and may crash.
    """
    import h5py

    size = path.stat().st_size
    try:
        with quiet():
            if h5py.is_hdf5(path):
                return _read_hdf(path, left or Allowance())
            if size > MOST_NUMBERS:
                raise Unreadable(f"{size / 2**30:.1f} GiB are too large", _SPLIT)
            return _read_5(path, left or Allowance())
    except (Unreadable, MemoryError):
        raise
    except Exception as error:
        raise Unreadable(f"a broken MATLAB file ({brief(error)})", _AGAIN) from error


def _read_hdf(path: Path, left: Allowance) -> Found:
    if find_spec("matio") is None:
        found = read_hdf5(path, left)
        found.kind = "MATLAB 7.3"
        found.skip("", "its arrays are read as HDF5 holds them, the rest needs the package mat-io", PACKAGE)
        return found
    found = Found("MATLAB 7.3", left)
    names, refused, streams = contents(path, left.numbers)
    for name, reason in refused.items():
        found.skip(name, reason, _SPLIT)
    _visit_all(found, load_objects(path, _wanted(names, found)).items())
    if streams:
        read_streams(path, found)
    return found


def _wanted(names: Sequence[str], found: Found) -> list[str]:
    """Variables to read: of a figure not those that say the same again."""
    figure = any(name in TREES for name in names)
    wanted = [name for name in names if not (figure and name in BESIDE)]
    if len(wanted) > MOST_SIGNALS:
        found.skip("", f"{len(wanted) - MOST_SIGNALS} more variables are left out", _SPLIT)
    return wanted[:MOST_SIGNALS]


def _visit_all(found: Found, values: Iterable[tuple[str, Any]]) -> None:
    walk = Walk(found, translate)
    for name, value in values:
        try:
            if name in TREES:
                found.kind = f"MATLAB figure ({found.kind})"
                read_figure(value, found)
            else:
                walk.visit(name, value)
        except Exception as error:
            found.skip(name, f"it is not as expected ({brief(error)})", EXPORT)
    walk.finish()


def _read_5(path: Path, left: Allowance) -> Found:
    from scipy.io.matlab import varmats_from_mat

    with path.open("rb") as file:
        parts = varmats_from_mat(file)
    packed = any(_COMPRESSED in part.getbuffer()[128:132] for _, part in parts)
    found = Found("MATLAB 7" if packed else "MATLAB 5", left)
    # What has no name are the properties of objects.
    variables = [_variable(name, part) for name, part in parts if name]
    wanted = set(_wanted([variable.name for variable in variables], found))
    variables = [variable for variable in variables if variable.name in wanted]
    objects: Mapping[str, Any] = {}
    whole = sum(_announced(part) for _, part in parts)
    if not all(name for name, _ in parts) and wanted.isdisjoint(TREES) and not any(found.refusal(whole // 8)):
        objects = load_objects(path, [variable.name for variable in variables if variable.kind in _NESTED])
    _visit_all(found, _values(variables, objects, found))
    return found


def _variable(name: str, part: BytesIO) -> _Variable:
    from scipy.io import whosmat
    from scipy.io.matlab import MatlabOpaque

    # SciPy calls every object so; its name is in what it makes of it.
    if name == "None" and isinstance(value := _load(part), MatlabOpaque):
        return _Variable(value["s0"][0].decode("latin-1"), _OPAQUE, 0, part)
    # The stubs know paths only.
    _, shape, kind = whosmat(part)[0]  # type: ignore[arg-type]
    numbers = 0 if kind == "sparse" else math.prod(shape)
    return _Variable(name, kind, max(numbers, _announced(part) // 8), part)


def _announced(part: BytesIO) -> int:
    """Bytes of a variable as it says itself, once it is unpacked."""
    data = part.getbuffer()
    if _COMPRESSED not in data[128:132]:
        return len(data)
    tag = zlib.decompressobj().decompress(data[136:], 8)
    return int.from_bytes(tag[4:], "little" if bytes(data[126:128]) == b"IM" else "big")


def _values(
    variables: Iterable[_Variable], objects: Mapping[str, Any], found: Found
) -> Iterator[tuple[str, Any]]:
    """Variables in their order, each read when its turn has come."""
    for name, kind, size, part in variables:
        value = objects.get(name)
        # The plain members of a struct can be read without its objects.
        if value is not None and (kind == _OPAQUE or not isinstance(value, Lost)):
            yield name, value
            continue
        reason, advice = found.refusal(size)
        if reason:
            found.skip(name, reason, advice)
            continue
        try:
            yield name, _load(part)
        except Exception as error:
            found.skip(name, f"it cannot be read ({brief(error)})", _AGAIN)


def _load(part: BytesIO) -> Any:
    from scipy.io import loadmat

    loaded = loadmat(part, spmatrix=False)  # type: ignore[arg-type]
    return next(value for name, value in loaded.items() if not name.startswith("__"))
