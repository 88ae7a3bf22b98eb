"""Machine code for the pure functions; the only module that knows numba.

For one run the plant is unrolled to straight-line code (`symbols`), and the control law is compiled as it
stands: its functions stay plain Python and are registered with numba, so that the entry point calls the very
same source. For many runs at once plant, law and statistics are all unrolled, onto lanes (`lanes`).

Compiled code is kept on disk. The plant's file is named after its own content; the law's folder after a hash
of the sources, because numba itself would not notice a change in a function of another module.
"""

from __future__ import annotations

import hashlib
import inspect
import math
import os
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numba
import platformdirs
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, register_jitable

from tendonrepro import arrays
from tendonrepro.arrays import Array
from tendonrepro.files import write_atomically
from tendonrepro.physics import control
from tendonrepro.physics import linalg as matrices
from tendonrepro.physics.control import Law, Memory
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.simulation.codegen import lane_loop
from tendonrepro.simulation.codegen.symbols import unrolled

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

FLAT = types.float64[::1]
ON_LANES: dict[str, Any] = {"nogil": True, "fastmath": {"contract"}}
"""Code on lanes may fuse a product with a sum; all lanes of all bundles do so alike."""

_plants: dict[str, Derivative] = {}
_lanes: dict[str, LaneCode] = {}


def cache_folder() -> Path:
    """Folder for compiled code of exactly these sources; made if it is missing.

    Where the user's cache cannot be written, a folder among the temporary files serves all processes.
    """
    modules = (*LAW_FUNCTIONS, arrays, lane_loop)
    sources = {Path(inspect.getfile(module)) for module in modules} | {Path(__file__)}
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
    """Compile :func:`tendonrepro.physics.dynamics.state_derivative` for a plant.

    The array (P,) holds the plant's numbers as that code reads them. Plants of one size with the same
    features switched off share one piece of code.
    """
    source, p = unrolled(state_derivative, plant, plant.preload.size)
    if source not in _plants:
        _plants[source] = _compile(_load(source, ("compiled",))[0])
    return _plants[source], p


class LaneCode(NamedTuple):
    """Compiled functions of one :func:`tendonrepro.simulation.codegen.lanes.lane_code`."""

    prepare: Callable[[Array], None]
    run: Callable[..., None]


def compiled_lanes(source: str, name: str, arguments: int) -> LaneCode:
    """Compile what `lanes.lane_code` wrote; ``arguments`` counts those besides the flat array."""
    if source not in _lanes:
        prepare, run = _load(source, (f"prepare_{name}", name))
        numbers = (types.float64,) * arguments
        _lanes[source] = LaneCode(
            _compile(prepare, types.void(FLAT), **ON_LANES),
            _compile(run, types.void(FLAT, *numbers), **ON_LANES),
        )
    return _lanes[source]


def _load(source: str, names: Sequence[str]) -> list[Any]:
    """Python functions of a generated source, kept in a file because numba caches by file.

    Their names get a digest, since numba's own names for machine code must not collide.
    """
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    text = source
    for name in names:
        text = text.replace(f"def {name}(", f"def {name}_{digest}(")
    path = _cache / f"{names[-1]}_{digest}.py"
    if not path.exists():
        write_atomically(path, text)
    scope: dict[str, Any] = {"__name__": __name__} | INTRINSICS
    exec(compile(text, str(path), "exec"), scope)
    return [scope[f"{name}_{digest}"] for name in names]


def _compile(function: Any, *signature: Any, **options: Any) -> Any:
    """Compile with our own cache folder; numba's setting is put back for other users of it."""
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_cache)
    try:
        build: Any = numba.njit
        return build(*signature, cache=True, error_model="numpy", **options)(function)
    finally:
        settings.CACHE_DIR = before


def command(
    memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, law: Law
) -> tuple[Array, Array, Array, Array]:
    """:func:`tendonrepro.physics.control.command`, compiled."""
    return control.command(memory, q, q_d, dq_d, ddq_d, law)


def _of_bits(operations: Callable[[Any, Any], Any]) -> Any:
    """Function of one number given by its operations on LLVM values."""

    @intrinsic
    def function(context: Any, x: Any) -> Any:
        del context, x
        signature = types.float64(types.float64)
        return signature, lambda _, builder, __, arguments: operations(builder, arguments[0])

    return function


_WORD, _DOUBLE = ir.IntType(64), ir.DoubleType()
_FRACTION_BITS = ir.Constant(_WORD, 52)


def _power_of_two(builder: Any, x: Any) -> Any:
    """``2^x`` of a whole number: added to 3·2⁵¹ + 1023 its bits end up where a float keeps its exponent."""
    shifted = builder.fadd(x, ir.Constant(_DOUBLE, 3.0 * 2.0**51 + 1023.0))
    bits = builder.shl(builder.bitcast(shifted, _WORD), _FRACTION_BITS)
    return builder.bitcast(bits, _DOUBLE)


def _mantissa(builder: Any, x: Any) -> Any:
    """Mantissa of a positive number as in ``frexp``, in [1/2, 1)."""
    fraction = builder.and_(builder.bitcast(x, _WORD), ir.Constant(_WORD, 2**52 - 1))
    return builder.bitcast(builder.or_(fraction, ir.Constant(_WORD, 1022 << 52)), _DOUBLE)


def _exponent(builder: Any, x: Any) -> Any:
    """Exponent of a positive number as in ``frexp``, made a float by putting it behind 2⁵²."""
    bits = builder.lshr(builder.bitcast(x, _WORD), _FRACTION_BITS)
    number = builder.bitcast(builder.or_(bits, ir.Constant(_WORD, 1075 << 52)), _DOUBLE)
    return builder.fsub(number, ir.Constant(_DOUBLE, 2.0**52 + 1022.0))


def _floor(builder: Any, x: Any) -> Any:
    """Round down; Python's own returns a whole number, which does not run on lanes."""
    return builder.call(builder.module.declare_intrinsic("llvm.floor", [_DOUBLE]), [x])


INTRINSICS = {
    "power_of_two": _of_bits(_power_of_two),
    "mantissa": _of_bits(_mantissa),
    "exponent": _of_bits(_exponent),
    "floor": _of_bits(_floor),
    "sqrt": math.sqrt,
}
"""Names that generated code uses besides Python's own."""

# Machine code for one run computes only the value it chooses. numba compares the signatures: both are bare.
overload(arrays.choose)(
    lambda condition, then, otherwise: lambda condition, then, otherwise: then if condition else otherwise  # noqa: ARG005
)
_cache = cache_folder()
_began_empty = not any(_cache.glob("**/*.nbc"))
for _function in LAW_FUNCTIONS:
    register_jitable(_function)
command = _compile(command)


@cache
def compiled_lane_loop() -> Callable[..., None]:
    """Compile :func:`tendonrepro.simulation.codegen.lane_loop.follow`; SciPy's stepper does without it."""
    register_jitable(lane_loop.any_live)
    table, count, number = types.float64[:, ::1], types.int64, types.float64
    # Without a signature the loop and all its callees would be compiled again for every pair of functions.
    loop: Callable[..., None] = _compile(
        lane_loop.follow,
        types.void(
            *(FLAT, FLAT, count, count, table, table, number, count, count, table, table),
            types.FunctionType(types.void(FLAT, number)),
            types.FunctionType(types.void(FLAT, number, number)),
        ),
        nogil=True,
    )
    return loop


def cache_is_empty() -> bool:
    """Whether there was nothing compiled for this machine and these sources when this process began."""
    return _began_empty


def lanes_are_new() -> bool:
    """Whether no run on lanes has been compiled for this machine and these sources yet."""
    return not any(_cache.glob("**/sample_*.nbc"))
