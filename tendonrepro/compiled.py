"""Machine code for the pure functions; the only module that knows numba.

The plant branches on nothing it computes, so it is unrolled to straight-line code first
(:mod:`tendonrepro.unroll`). The control law branches on measured values and is compiled as it stands: its
functions stay plain Python and are registered with numba, so that the entry point calls the very same source.

Compiled code is kept on disk. The plant's file is named after its own content; the law's folder after a hash
of the sources, because numba itself would not notice a change in a function of another module.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.extending import register_jitable

from tendonrepro import control, matrices
from tendonrepro.arrays import Array
from tendonrepro.control import Law, Memory
from tendonrepro.dynamics import Plant, state_derivative
from tendonrepro.files import write_atomically
from tendonrepro.unroll import unrolled

LAW_FUNCTIONS = (
    matrices.times,
    control.sig,
    control.polynomial,
    control.phi,
    control.phi_slope,
    control.surface_and_feedback,
    control.time_delay_estimate,
    control.error_rate,
    control.command,
)
"""Functions the compiled law calls, each after those it calls itself."""

Derivative = Callable[[float, Array, Array, Array], Array]
"""Compiled ``(t, state, tau_m, p)`` to the state's time derivative (4 n,)."""

_plants: dict[str, Derivative] = {}


def cache_folder() -> Path:
    """Folder for compiled code of exactly these sources; made if it is missing.

    Where the user's cache cannot be written, a folder among the temporary files serves all processes.
    """
    sources = {Path(inspect.getfile(function)) for function in LAW_FUNCTIONS} | {Path(__file__)}
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(source.read_bytes())
    name = Path("compiled", digest.hexdigest()[:16])
    temporary = Path(tempfile.gettempdir(), f"tendonrepro-{getattr(os, 'getuid', lambda: 0)()}")
    for folder in (Path(platformdirs.user_cache_dir("tendonrepro")) / name, temporary / name):
        if _is_writable(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="tendonrepro-"))


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(2**20))
    except OSError:
        return False
    return True


def compiled_plant(plant: Plant) -> tuple[Derivative, Array]:
    """Compile :func:`tendonrepro.dynamics.state_derivative` for a plant.

    Plants of one size with the same features switched off share one piece of code.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    derivative : callable
        ``(t, state, tau_m, p)`` to an array (4 n,).
    p : array (P,)
        The plant's numbers as that code reads them.
    """
    source, p = unrolled(state_derivative, plant, plant.preload.size)
    if source not in _plants:
        _plants[source] = _compile(_load(source))
    return _plants[source], p


def _load(source: str) -> Any:
    """Python function of an unrolled source, kept in a file because numba caches by file.

    Its name holds a digest, since numba's own names for machine code must not collide between plants.
    """
    name = f"plant_{hashlib.sha256(source.encode()).hexdigest()[:16]}"
    text = source.replace("def compiled(", f"def {name}(")
    path = _cache / f"{name}.py"
    if not path.exists():
        write_atomically(path, text)
    scope: dict[str, Any] = {"__name__": __name__}
    exec(compile(text, str(path), "exec"), scope)
    return scope[name]


def _compile(function: Any) -> Any:
    """Compile with our own cache folder; numba's setting is put back for other users of it."""
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_cache)
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    finally:
        settings.CACHE_DIR = before


def command(
    memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, law: Law
) -> tuple[Array, Array, Array, Array]:
    """:func:`tendonrepro.control.command`, compiled."""
    return control.command(memory, q, q_d, dq_d, ddq_d, law)


_cache = cache_folder()
for _function in LAW_FUNCTIONS:
    register_jitable(_function)
command = _compile(command)


def cache_is_empty() -> bool:
    """Whether the first run on this machine, or with these sources, still has to compile."""
    return not any(_cache.glob("**/*.nbc"))
