"""MATLAB 7.3 files, which are HDF5 files: what they announce."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tendonrepro.dataset.readers.signals import BEST_PACKING, HARMLESS, Unreadable

STREAMS = "#sigstream#"
"""Group with the samples of streamed logs."""

_DEEPEST = 32


def contents(path: Path, left: int) -> tuple[list[str], dict[str, str], bool]:
    """Variables that can be read, reasons for the others by name, and whether logs are streamed beside.

    `left` is how many bytes may be read. `Unreadable` if what the variables share lies in another file or
    announces too much.
    """
    import h5py

    most = min(left, max(HARMLESS, BEST_PACKING * path.stat().st_size))
    refused: dict[str, str] = {}
    total = 0
    with h5py.File(path, "r") as file:
        names = [str(name) for name in file]
        for name in names:
            sizes = list(_sizes(file, name, 0))
            size = sum(filter(None, sizes))
            if None in sizes:
                refused[name] = "it refers to another file, or is nested too deeply"
            elif total + size > most:
                refused[name] = "it announces more than the file can hold, or than is read at once"
            else:
                total += size
    shared = [reason for name, reason in refused.items() if name.startswith("#")]
    if shared:
        raise Unreadable(shared[0], "copy or download it again")
    plain = [name for name in names if name not in refused and not name.startswith("#")]
    return plain, refused, STREAMS in names


def _sizes(group: Any, name: str, depth: int) -> Iterator[int | None]:
    """Bytes that each dataset of a variable announces; None for what lies in another file, or too deep."""
    import h5py

    if depth > _DEEPEST or not isinstance(group.get(name, getlink=True), h5py.HardLink):
        yield None
        return
    node = group[name]
    if isinstance(node, h5py.Dataset):
        yield None if node.is_virtual or node.external else node.nbytes
    else:
        for inner in node if isinstance(node, h5py.Group) else ():
            yield from _sizes(node, inner, depth + 1)
