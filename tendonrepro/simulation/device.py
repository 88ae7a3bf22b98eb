"""The first GPU of a machine, by CuPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import ModuleType
from typing import Any, Literal, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.simulation.codegen.threads import ENTRY

DeviceName: TypeAlias = Literal["cpu", "gpu"]
"""What a batch runs on."""

DEVICES: tuple[DeviceName, ...] = ("cpu", "gpu")

Kernel: TypeAlias = Any
"""A compiled function of a device, in CuPy's type."""

OnDevice: TypeAlias = Any
"""An array in a device's memory, or a number, in CuPy's type."""

Result = TypeVar("Result")

THREADS = 128
"""Threads of a block on the GPU."""


class Device(Protocol):
    """What runs threads of :mod:`.codegen.threads`."""

    def compiled(self, source: str) -> Kernel:
        """The entry of a source."""

    def array(self, values: Array | NDArray[np.int64]) -> OnDevice:
        """A copy of an array in the device's memory; a MemoryError if there is none left."""

    def zeros(self, shape: Sequence[int]) -> OnDevice:
        """Zeros in the device's memory."""

    def fetched(self, values: OnDevice) -> Array:
        """A copy of the device's array in this program's memory."""

    def launch(self, entry: Kernel, lanes: int, arguments: Sequence[OnDevice]) -> None:
        """Run so many threads to their end."""


class Graphics:
    """A GPU of NVIDIA's."""

    def __init__(self, cupy: ModuleType) -> None:
        self._cupy = cupy
        self._entries: dict[str, Kernel] = {}
        runtime = cupy.cuda.runtime
        self._errors = runtime.CUDARuntimeError, cupy.cuda.driver.CUDADriverError
        try:
            count = runtime.getDeviceCount()
        except self._errors as error:
            raise _no_device(str(error)) from error
        if not count:
            raise _no_device("none is seen")

    def compiled(self, source: str) -> Kernel:
        """Compile a source for this GPU, once in a process."""
        if source not in self._entries:
            # CuPy raises the others where NVIDIA's compiler is missing.
            failures = (self._cupy.cuda.compiler.CompileException, RuntimeError, OSError)
            entry = self._cupy.RawKernel(source, ENTRY)
            _sound(entry.compile, failures)
            self._entries[source] = entry
        return self._entries[source]

    def array(self, values: Array | NDArray[np.int64]) -> OnDevice:
        """A copy of an array in the GPU's memory."""
        return self._cupy.asarray(values)

    def zeros(self, shape: Sequence[int]) -> OnDevice:
        """Zeros in the GPU's memory."""
        return self._cupy.zeros(tuple(shape))

    def fetched(self, values: OnDevice) -> Array:
        """A copy of the GPU's array."""
        copy: Array = _sound(lambda: self._cupy.asnumpy(values), self._errors)
        return copy

    def launch(self, entry: Kernel, lanes: int, arguments: Sequence[OnDevice]) -> None:
        """Start a thread for each lane, and wait for all."""
        _sound(lambda: self._started(entry, lanes, arguments), self._errors)

    def _started(self, entry: Kernel, lanes: int, arguments: Sequence[OnDevice]) -> None:
        entry((-(-lanes // THREADS),), (THREADS,), tuple(arguments))
        self._cupy.cuda.runtime.deviceSynchronize()


def _sound(work: Callable[[], Result], failures: tuple[type[BaseException], ...]) -> Result:
    """What a piece of work on the GPU gives; its failure is one sentence."""
    try:
        return work()
    except failures as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        message = f"the GPU cannot run this: {reason}"
        hint = "the driver may be older than CuPy's CUDA: nvidia-smi shows it; --device cpu needs none"
        raise TendonreproError(message, hint=hint) from error


def _no_device(reason: str) -> TendonreproError:
    hint = "nvidia-smi shows GPUs and their driver; --device cpu needs none"
    return TendonreproError(f"no GPU can be used: {reason}", where="--device", hint=hint)


def require(device: str) -> None:
    """Refuse a device that is not there, before any work.

    Raises
    ------
    UsageError
        For a name that no device has, or without CuPy.
    TendonreproError
        If there is no GPU, or no driver of it.
    """
    if device not in DEVICES:
        raise UsageError(f"a device is {' or '.join(DEVICES)}, not {device!r}", where="--device")
    if device == "gpu":
        graphics()


@cache
def graphics() -> Device:
    """The GPU.

    Raises
    ------
    UsageError
        If CuPy is not installed.
    TendonreproError
        If there is no GPU, or no driver of it.
    """
    try:
        import cupy
    except ImportError as error:
        hint = "pip install 'tendonrepro[gpu]', or use --device cpu"
        raise UsageError("CuPy is not installed", where="--device", hint=hint) from error
    return Graphics(cupy)
