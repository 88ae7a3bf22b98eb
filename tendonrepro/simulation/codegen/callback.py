"""Machine code that SciPy calls with an array of its own.

SciPy asks for a slope some thirty times a period. Each copy in Python takes longer than the slope itself, so
the machine code reads SciPy's array where it lies.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.simulation.codegen.machine import LANES

_HEAD = object.__basicsize__
"""Bytes of what every Python object begins with. In a NumPy array the address of its numbers comes next.

That is the structure ``PyArrayObject`` of NumPy's C interface, where the macro ``PyArray_DATA`` looks, which
is compiled into every extension of NumPy. Machine code has no headers of C, so it is written down here, and
looked at before use.
"""


def on_array_code(name: str, inner: str, take: int, give: int, size: int) -> str:
    """Source of ``<name>(t, array, rows, out)``: call a function ``<inner>(rows, k, t)`` in the first lane.

    `size` numbers of the array go into rows from `take` on; those from `give` on come out.
    """
    body = [
        f"%field = getelementptr i8, ptr %array, i64 {_HEAD}",
        "%x = load ptr, ptr %field",
        *(line for k in range(size) for line in _moved(f"in{k}", ("x", k), ("rows", LANES * (take + k)))),
        f"call void @{inner}(ptr %rows, double 0.0, double %t)",
        *(line for k in range(size) for line in _moved(f"out{k}", ("rows", LANES * (give + k)), ("out", k))),
    ]
    head = f"define void @{name}(double %t, ptr %array, ptr %rows, ptr %out) {{"
    return "\n".join([head, *(f"  {line}" for line in body), "  ret void", "}", ""])


def _moved(name: str, source: tuple[str, int], target: tuple[str, int]) -> list[str]:
    """Instructions that copy a number from one place, an array and how far in it, to another."""
    return [
        f"%{name}.from = getelementptr double, ptr %{source[0]}, i64 {source[1]}",
        f"%{name} = load double, ptr %{name}.from",
        f"%{name}.to = getelementptr double, ptr %{target[0]}, i64 {target[1]}",
        f"store double %{name}, ptr %{name}.to",
    ]


def address_in(array: Array) -> int | None:
    """Read the address of an array's numbers as the machine code does."""
    return ctypes.c_void_p.from_address(id(array) + _HEAD).value


def callable_on_array(address: int, rows: Array, out: Array) -> Callable[[float, Array], Array]:
    """Function of a time and an array that gives `out`, filled by code of `on_array_code`.

    The array has as many float64 as `out`, one behind the other, which SciPy's arrays are. Whoever calls it
    keeps the rows.

    Raises
    ------
    TendonreproError
        If this Python or NumPy keeps an array's address somewhere else.
    """
    if address_in(out) != out.ctypes.data:
        message = "this Python or NumPy keeps the numbers of an array where machine code does not look"
        raise TendonreproError(message, hint="say compare --solver compiled, and report it")
    kinds = ctypes.c_double, ctypes.py_object, ctypes.c_void_p, ctypes.c_void_p
    run = ctypes.PYFUNCTYPE(None, *kinds)(address)
    source, target = rows.ctypes.data, out.ctypes.data

    def function(t: float, x: Array) -> Array:
        run(t, x, source, target)
        return out

    return function
