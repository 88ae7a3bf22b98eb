"""Machine code that SciPy calls as one of Python's built-in functions, with arrays of its own.

SciPy asks for a slope some thirty times a period. A call through ``ctypes`` takes longer than the slope
itself, and so does each copy in Python. So the machine code is what a function of an extension in C is:
Python calls it directly, and it reads arrays where they lie.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from itertools import chain

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError

_HEAD = object.__basicsize__
"""Bytes of what every Python object begins with. In a NumPy array the address of its numbers comes next.

That is the structure ``PyArrayObject`` of NumPy's C interface, where the macro ``PyArray_DATA`` looks, which
is compiled into every extension of NumPy. Machine code has no headers of C, so it is written down here, and
looked at before use.
"""

_METH_FASTCALL = 0x0080
"""How Python calls the function: ``PyObject *(PyObject *self, PyObject *const *args, Py_ssize_t nargs)``."""


class _Definition(ctypes.Structure):
    """``PyMethodDef`` of Python's C interface."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def on_array_code(name: str, inner: str, take: int, give: int, size: int) -> str:
    """Source of ``<name>(t, array)`` for Python, which calls ``<inner>(rows, k, t)`` of one experiment.

    `size` numbers of the array go into rows from `take` on; those from `give` on go into an array that is
    the result. It and the rows are the tuple that the function is bound to.
    """
    item = _of_python("PyTuple_GetItem")
    into = (_moved(f"in{k}", ("x", k), ("rows", take + k)) for k in range(size))
    out_of = (_moved(f"out{k}", ("rows", give + k), ("y", k)) for k in range(size))
    body = [
        "%time = load ptr, ptr %args",
        f"%t = call double {_of_python('PyFloat_AsDouble')}(ptr %time)",
        "%array.place = getelementptr ptr, ptr %args, i64 1",
        "%array = load ptr, ptr %array.place",
        f"%bundle = call ptr {item}(ptr %self, i64 0)",
        f"%result = call ptr {item}(ptr %self, i64 1)",
        *_numbers("x", "array"),
        *_numbers("rows", "bundle"),
        *_numbers("y", "result"),
        *chain.from_iterable(into),
        f"call void @{inner}(ptr %rows, double 0.0, double %t)",
        *chain.from_iterable(out_of),
        # Whoever calls a function owns what it gives.
        f"call void {_of_python('Py_IncRef')}(ptr %result)",
    ]
    head = f"define ptr @{name}(ptr %self, ptr %args, i64 %count) {{"
    return "\n".join([head, *(f"  {line}" for line in body), "  ret ptr %result", "}", ""])


def _of_python(name: str) -> str:
    """A function of Python's C interface, by its address."""
    return f"inttoptr (i64 {ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value} to ptr)"


def _numbers(name: str, array: str) -> list[str]:
    """Instructions that load the address of a NumPy array's numbers."""
    return [
        f"%{name}.at = getelementptr i8, ptr %{array}, i64 {_HEAD}",
        f"%{name} = load ptr, ptr %{name}.at",
    ]


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
    """Code of `on_array_code` as a function of a time and an array that gives `out`.

    The array has as many float64 as `out`, one behind the other, which SciPy's arrays are.

    Raises
    ------
    TendonreproError
        If this Python or NumPy keeps an array's address somewhere else.
    """
    if address_in(out) != out.ctypes.data:
        message = "this Python or NumPy keeps the numbers of an array where machine code does not look"
        raise TendonreproError(message, hint="say compare --solver compiled, and report it")
    bind = ctypes.pythonapi.PyCFunction_NewEx
    bind.argtypes = [ctypes.POINTER(_Definition), ctypes.py_object, ctypes.c_void_p]
    bind.restype = ctypes.py_object
    function: Callable[[float, Array], Array] = bind(_definition(address), (rows, out), None)
    return function


@cache
def _definition(address: int) -> _Definition:
    """Definition of a function, which Python reads as long as there is one of it."""
    return _Definition(b"slope", address, _METH_FASTCALL, None)
