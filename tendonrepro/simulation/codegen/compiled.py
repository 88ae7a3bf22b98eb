"""Machine code for the pure functions; the only module that knows numba.

For one run the plant is unrolled to straight-line code (`symbols`), and the control law is compiled as it
stands: its functions stay plain Python and are registered with numba, so that the entry point calls the very
same source. For many runs at once plant, law and statistics are all unrolled, onto lanes (`lanes`).

Compiled code is kept on disk (`cache`). The plant's file is named after its own content.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, register_jitable

from tendonrepro import arrays
from tendonrepro.arrays import Array
from tendonrepro.files import write_atomically
from tendonrepro.physics import control, instruments
from tendonrepro.physics import linalg as matrices
from tendonrepro.physics.control import Law, Memory
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.simulation import sampled
from tendonrepro.simulation.codegen import dop853, lane_loop, run_loop
from tendonrepro.simulation.codegen.cache import CACHE
from tendonrepro.simulation.codegen.machine import LaneCode, assembled
from tendonrepro.simulation.codegen.symbols import unrolled

FUNCTIONS: tuple[Any, ...] = (
    matrices.times,
    control.sig,
    control.polynomial,
    control.phi,
    control.phi_slope,
    control.surface_and_feedback,
    control.delayed_acceleration,
    control.time_delay_estimate,
    control.error_rate,
    control.command,
    control._shifted,
    control.remember,
    control.servo_torque,
    instruments.applied_torque,
    sampled.measure,
    sampled.is_bounded,
    dop853._step,
    dop853.advance,
    *(function for law in sampled.LAWS.values() for function in law),
)
"""Functions that compiled law and run call, each after those it calls itself."""

_plants: dict[str, Any] = {}
_lanes: dict[str, LaneCode] = {}


def compiled_plant(plant: Plant) -> tuple[int, Array]:
    """Compile :func:`tendonrepro.physics.dynamics.state_derivative` for a plant.

    Returns its address, for :func:`derivative` and :func:`advance`, and the plant's numbers (P,) as that code
    reads them. Plants of one size with the same features switched off share one piece of code.
    """
    source, p = unrolled(state_derivative, plant, plant.preload.size)
    if source not in _plants:
        signature = f"void(float64{4 * ', CPointer(float64)'})"
        _plants[source] = _compile(_load(source), signature, build=numba.cfunc)
    return _plants[source].address, p


def compiled_lanes(source: str, name: str) -> LaneCode:
    """Compile what `lanes.lane_code` wrote."""
    if source not in _lanes:
        _lanes[source] = assembled(source, name, CACHE)
    return _lanes[source]


def _load(source: str) -> Any:
    """Python function of a generated source, kept in a file because numba caches by file.

    Its name gets a digest, since numba's own names for machine code must not collide.
    """
    name = f"compiled_{hashlib.sha256(source.encode()).hexdigest()[:16]}"
    path, text = CACHE / f"{name}.py", source.replace("def compiled(", f"def {name}(")
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_atomically(path, text)
    scope: dict[str, Any] = {"__name__": __name__}
    exec(compile(text, str(path), "exec"), scope)
    return scope[name]


def _compile(function: Any, *signature: Any, build: Any = numba.njit, **options: Any) -> Any:
    """Compile with our own cache folder; numba's setting is put back for other users of it."""
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(CACHE)
    try:
        return build(*signature, cache=True, error_model="numpy", **options)(function)
    finally:
        settings.CACHE_DIR = before


def command(
    memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, law: Law
) -> tuple[Array, Array, Array, Array]:
    """:func:`tendonrepro.physics.control.command`, compiled."""
    return control.command(memory, q, q_d, dq_d, ddq_d, law)


def derivative(code: int, t: float, state: Array, tau_m: Array, p: Array, result: Array) -> None:
    """:func:`tendonrepro.simulation.codegen.dop853.derivative`, compiled."""
    dop853.derivative(code, t, state, tau_m, p, result)


@intrinsic
def _derivative(context: Any, code: Any, t: Any, state: Any, tau_m: Any, p: Any, result: Any) -> Any:
    """Call machine code with a time and the addresses of four arrays."""
    del context, code, t, state, tau_m, p, result

    def build(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        code, t, *rows = arguments
        row = ir.DoubleType().as_pointer()
        function = ir.FunctionType(ir.VoidType(), [t.type, *[row] * len(rows)])
        called = builder.inttoptr(code, function.as_pointer())
        builder.call(called, [t, *(builder.inttoptr(address, row) for address in rows)])

    return types.void(types.int64, types.float64, *[types.uintp] * 4), build


@overload(dop853.derivative)
def _overloaded(code, t, state, tau_m, p, result):  # type: ignore[no-untyped-def]
    del code, t, state, tau_m, p, result
    return lambda code, t, state, tau_m, p, result: _derivative(  # type: ignore[call-arg]
        code, t, state.ctypes.data, tau_m.ctypes.data, p.ctypes.data, result.ctypes.data
    )


@intrinsic
def _call(context: Any, code: Any, rows: Any, k: Any) -> Any:
    """Call machine code with the address of its rows and a number."""
    del context, code, rows, k

    def build(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        code, rows, k = arguments
        function = ir.FunctionType(ir.VoidType(), [rows.type, k.type])
        builder.call(builder.inttoptr(code, function.as_pointer()), [rows, k])

    return types.void(types.int64, types.int64, types.float64), build


@overload(sampled.decide)
def _decided(memory, measured, desired, law):  # type: ignore[no-untyped-def]
    del memory, measured, desired
    of_law, _ = sampled.LAWS[law.instance_class]
    return lambda memory, measured, desired, law: of_law(memory, measured, desired, law)  # noqa: PLW0108


@overload(sampled.keep)
def _kept(measured, torques, carry, law):  # type: ignore[no-untyped-def]
    del measured, torques, carry
    _, of_law = sampled.LAWS[law.instance_class]
    return lambda measured, torques, carry, law: of_law(measured, torques, carry, law)  # noqa: PLW0108


# Machine code for one run computes only the value it chooses. numba compares the signatures: all are bare.
overload(arrays.choose)(
    lambda condition, then, otherwise: lambda condition, then, otherwise: then if condition else otherwise  # noqa: ARG005
)
overload(lane_loop.call)(
    lambda code, rows, k: lambda code, rows, k: _call(code, rows.ctypes.data, k)  # type: ignore[call-arg]  # noqa: ARG005
)
overload(instruments.quantise)(
    lambda value, step: lambda value, step: value if step == 0.0 else step * np.floor(value / step + 0.5)  # noqa: ARG005
)
for _function in FUNCTIONS:
    register_jitable(_function)
command = _compile(command)
derivative = _compile(derivative)
advance = _compile(dop853.advance)
run = _compile(run_loop.sweep)


@cache
def compiled_lane_loop() -> Callable[..., None]:
    """Compile :func:`tendonrepro.simulation.codegen.lane_loop.sweep`; SciPy's stepper does without it."""
    for function in lane_loop.PARTS:
        register_jitable(function)
    rows, whole, number = types.float64[:, :, ::1], types.int64[:, :, ::1], types.float64
    controllers = plants = rows, types.int64[::1], whole
    loop: Callable[..., None] = _compile(
        lane_loop.sweep,
        types.void(*controllers, *plants, rows, rows, types.int64, number, types.int64, rows, rows),
        nogil=True,
    )
    return loop
