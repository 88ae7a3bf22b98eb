"""What a MATLAB 7.3 file, which is an HDF5 file, announces before its variables are read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tendonrepro.dataset.readers.bounds import BEST_PACKING, HARMLESS
from tendonrepro.dataset.readers.matlab.parts import stands_for_objects
from tendonrepro.dataset.readers.signals import MOST_BYTES
from tendonrepro.dataset.readers.unreadable import Unreadable

STREAMS = "#sigstream#"
"""Group with the samples of streamed logs."""

_MOST_PARTS = 200_000
_DEEPEST = 60
# Arrays of numbers are longer than what stands for objects.
_MOST_OBJECTS = 10_000


@dataclass(frozen=True)
class Contents:
    """Variables of a file.

    Parameters
    ----------
    names : tuple of str
        Those that can be read without danger.
    refused : mapping
        Name -> reason for the others.
    streams : bool
        Whether samples of streamed logs are stored beside.
    """

    names: tuple[str, ...]
    refused: Mapping[str, str]
    streams: bool


def contents(path: Path) -> Contents:
    """List the variables of a MATLAB 7.3 file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    Unreadable
        If it is no HDF5 file, or what its variables share is not as announced.
    """
    import h5py

    most = min(MOST_BYTES, max(HARMLESS, BEST_PACKING * path.stat().st_size))
    try:
        with h5py.File(path, "r") as file:
            sizes = {str(name): _size(file, name) for name in file}
    except Exception as error:
        reason = f"its HDF5 structure is damaged ({' '.join(str(error).split())[:120]})"
        raise Unreadable(reason, "copy or download it again") from error
    shared = [size for name, size in sizes.items() if name.startswith("#")]
    if None in shared or any(size > most for size in shared if size):
        reason = "it announces more data than it can hold"
        raise Unreadable(reason, "copy or download it again")
    names, refused, total = [], {}, 0
    for name, size in sizes.items():
        if size is None:
            refused[name] = "it refers to another file"
        elif total + size > most:
            refused[name] = "it announces more than the file can hold, or than is read at once"
        elif not name.startswith("#"):
            names.append(name)
            total += size
    return Contents(tuple(names), refused, STREAMS in sizes)


def _size(file: Any, name: str) -> int | None:
    """Bytes that a variable announces; None if some lie in another file."""
    total = 0
    for number, node in enumerate(_nodes(file, name, 0)):
        if node is None:
            return None
        if number > _MOST_PARTS:
            return MOST_BYTES + 1
        total += int(getattr(node, "nbytes", 0))
        if not _stands(node):
            return MOST_BYTES + 1
    return total


def _stands(node: Any) -> bool:
    """Whether a dataset, if it stands for objects, announces as many as it lists."""
    few = getattr(node, "dtype", None) == "uint32" and 0 < node.size <= _MOST_OBJECTS
    return not few or stands_for_objects(node[()].ravel().tolist(), node.size)


def _nodes(group: Any, name: str, depth: int) -> Iterator[Any]:
    """A variable and all it holds; None for what lies in another file."""
    import h5py

    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        yield None
        return
    node = group[name]
    elsewhere = isinstance(node, h5py.Dataset) and (node.is_virtual or node.external)
    yield None if elsewhere else node
    if isinstance(node, h5py.Group) and depth < _DEEPEST:
        for inner in node:
            yield from _nodes(node, inner, depth + 1)
