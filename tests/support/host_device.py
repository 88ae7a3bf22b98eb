"""A device for tests without a GPU: the source of its threads, compiled as C++ for a processor."""

from __future__ import annotations

import ctypes
import hashlib
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.simulation.codegen.threads import ENTRY

COMPILER = shutil.which("g++")


class Host:
    """Runs threads one after the other; `most` is the number of experiments that its memory holds."""

    def __init__(self, folder: Path, most: int = 2**20) -> None:
        self.folder, self.most, self.sources, self.launched = folder, most, [], []

    def compiled(self, source: str) -> Any:
        self.sources.append(source)
        name = hashlib.sha256(source.encode()).hexdigest()[:16]
        code, library = (self.folder / f"{name}{suffix}" for suffix in (".cpp", ".so"))
        if not library.exists():
            code.write_text(source, encoding="utf-8")
            command = [str(COMPILER), "-O1", "-shared", "-fPIC", str(code), "-o", str(library)]
            subprocess.run(command, check=True, timeout=600)
        return getattr(ctypes.CDLL(str(library)), ENTRY)

    def array(self, values: Any) -> Any:
        if values.ndim == 2 and values.shape[1] > self.most:
            raise MemoryError
        return np.ascontiguousarray(values)

    def zeros(self, shape: Sequence[int]) -> Array:
        return np.zeros(shape)

    def fetched(self, values: Any) -> Array:
        return np.array(values)

    def launch(self, entry: Any, lanes: int, arguments: Sequence[Any]) -> None:
        self.launched.append(lanes)
        entry(*map(_as_c, arguments))


def _as_c(argument: Any) -> Any:
    if isinstance(argument, np.ndarray):
        return ctypes.c_void_p(argument.ctypes.data)
    return ctypes.c_double(argument) if isinstance(argument, np.float64) else ctypes.c_longlong(int(argument))
