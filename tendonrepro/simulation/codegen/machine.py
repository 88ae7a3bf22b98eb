"""Recorded operations as vector instructions, and their machine code.

A product may be fused with a sum, in all lanes alike.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from llvmlite import binding

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.simulation.codegen.symbols import COMPARISONS, Line, Operand, as_operand, needed

LANES = 8
"""Experiments in a bundle: one vector of the widest registers there are."""

ALIGNED = 8 * LANES
"""Bytes on whose multiples a row begins."""

V, WORDS, BITS, PLACES = (f"<{LANES} x {kind}>" for kind in ("double", "i64", "i1", "ptr"))

_COMPARED = dict(zip(COMPARISONS, ("oge", "ogt", "ole", "olt"), strict=True))
_CALLED = {"abs": "fabs", "sqrt": "sqrt", "floor": "floor"}


def _text(operand: str | float) -> str:
    if isinstance(operand, str):
        return f"%{operand}"
    (bits,) = struct.unpack("<Q", struct.pack("<d", operand))
    return f"splat (double 0x{bits:016X})"


def vector_code(name: str, lines: Mapping[str, Line], results: Mapping[int, Operand]) -> str:
    """Source of ``<name>(rows, k, t)``: the lines that results, by row, need."""
    values = {row: as_operand(value) for row, value in results.items()}
    body: list[str] = []
    for x in _in_order(lines, values):
        body += _stored(x, values[x]) if isinstance(x, int) else _instructions(x, *lines[x])
    head = f"define void @{name}(ptr noalias %rows, double %k, double %t) {{"
    return "\n".join([head, *(f"  {line}" for line in body), "  ret void", "}", ""])


def _in_order(lines: Mapping[str, Line], results: Mapping[int, str | float]) -> Iterator[str | int]:
    """Lines to be worked out, by name, and rows to be written, so that few values wait in registers.

    A row is read just before the first use of what is in it. It is written as soon as its new value is known,
    and the old one has been read.
    """
    order = needed(lines, results.values())
    read = {x: int(lines[x][1][0]) for x in order if lines[x][0] == "row"}
    awaited = {row: {value} & lines.keys() for row, value in results.items()}
    for name, row in read.items():
        awaited.get(row, set()).add(name)
    writes: dict[str | float, list[int]] = {}
    for row, names in awaited.items():
        for x in names:
            writes.setdefault(x, []).append(row)
    known: set[str | float] = set()
    # What only moves from row to row comes last.
    for x in (*(x for x in order if x not in read), *read):
        for y in (*(operand for operand in lines[x][1] if operand in read), x):
            if isinstance(y, str) and y not in known:
                known.add(y)
                yield y
                yield from (row for row in writes.get(y, ()) if awaited[row] <= known)
    yield from (row for row, names in awaited.items() if not names)


def _stored(row: int, value: str | float) -> tuple[str, str]:
    return (
        f"%end{row} = getelementptr {V}, ptr %rows, i64 {row}",
        # Volatile: else LLVM stores by masks where a value may stay as it was, 4 % of the time on AVX2.
        f"store volatile {V} {_text(value)}, ptr %end{row}, align {ALIGNED}",
    )


def of_one_lane(source: str) -> str:
    """Source for one experiment instead of a bundle: a row is one number, and takes half the time."""
    narrow = source.replace(f"<{LANES} x ", "<1 x ").replace(f"v{LANES}f64", "v1f64")
    return narrow.replace(f"align {ALIGNED}", "align 8")


def repeated(name: str, first: str, again: str, row: int) -> str:
    """Source of a call of one function, then another while any lane of a row is positive."""
    return f"""define void @{name}(ptr %rows, double %k, double %t) {{
start:
  call void @{first}(ptr %rows, double %k, double %t)
  br label %look
look:
  {_any_positive("left", row)}
  br i1 %left.any, label %again, label %end
again:
  call void @{again}(ptr %rows, double %k, double %t)
  br label %look
end:
  ret void
}}
"""


def _any_positive(name: str, row: int) -> str:
    """Instructions that give ``%<name>.any``: whether any lane of a row is positive."""
    return f"""%{name}.place = getelementptr {V}, ptr %rows, i64 {row}
  %{name} = load {V}, ptr %{name}.place, align {ALIGNED}
  %{name}.each = fcmp ogt {V} %{name}, zeroinitializer
  %{name}.bits = bitcast {BITS} %{name}.each to i{LANES}
  %{name}.any = icmp ne i{LANES} %{name}.bits, 0"""


class Signal(NamedTuple):
    """Rows that are filled before each sample, from one array (samples, size) for each lane."""

    row: int
    size: int


class TraceBuffer(NamedTuple):
    """Rows kept after each sample in an array (entries, size, LANES), with `each` samples to an entry."""

    row: int
    size: int
    each: int


def sweep_code(live: int, signals: Sequence[Signal], records: Sequence[TraceBuffer]) -> str:
    """Source of ``sweep(sample, advance, rows, first, last, period, sources, kept)``.

    One bundle goes through samples ``first`` to ``last`` while a lane is alive: signals into their rows,
    ``sample``, rows into records, ``advance``. ``sources`` are LANES addresses for each signal, of sample 0;
    ``kept`` are addresses of the records, of sample ``first``.
    """
    places, reads, writes = [], [], []
    for k, signal in enumerate(signals):
        places.append(f"%of{k} = getelementptr {PLACES}, ptr %sources, i64 {k}")
        places.append(f"%source{k} = load {PLACES}, ptr %of{k}, align 8")
        reads.append(f"%at{k} = mul i64 %k, {signal.size}")
        for i in range(signal.size):
            x = f"%signal{k}.{i}"
            reads += [
                f"{x}.at = add i64 %at{k}, {i}",
                f"{x}.place = getelementptr double, {PLACES} %source{k}, i64 {x}.at",
                f"{x} = call {V} @llvm.masked.gather.v{LANES}f64.v{LANES}p0("
                f"{PLACES} {x}.place, i32 8, {BITS} splat (i1 true), {V} poison)",
                f"{x}.row = getelementptr {V}, ptr %rows, i64 {signal.row + i}",
                f"store {V} {x}, ptr {x}.row, align {ALIGNED}",
            ]
    for k, record in enumerate(records):
        places.append(f"%into{k} = getelementptr ptr, ptr %kept, i64 {k}")
        places.append(f"%record{k} = load ptr, ptr %into{k}, align 8")
        writes.append(f"%entry{k} = udiv i64 %done, {record.each}")
        writes.append(f"%start{k} = mul i64 %entry{k}, {record.size}")
        for i in range(record.size):
            x = f"%record{k}.{i}"
            writes += [
                f"{x}.row = getelementptr {V}, ptr %rows, i64 {record.row + i}",
                f"{x} = load {V}, ptr {x}.row, align {ALIGNED}",
                f"{x}.at = add i64 %start{k}, {i}",
                f"{x}.place = getelementptr {V}, ptr %record{k}, i64 {x}.at",
                f"store {V} {x}, ptr {x}.place, align 8",
            ]
    gap = "\n  "
    return f"""define void @sweep(
  ptr %sample, ptr %advance, ptr %rows, i64 %first, i64 %last, double %period, ptr %sources, ptr %kept
) {{
start:
  {gap.join(places)}
  br label %begin
begin:
  %k = phi i64 [ %first, %start ], [ %next, %advanced ]
  %done = sub i64 %k, %first
  %number = sitofp i64 %k to double
  %time = fmul double %number, %period
  {gap.join(reads)}
  call void %sample(ptr %rows, double %number, double %time)
  {gap.join(writes)}
  {_any_positive("live", live)}
  br i1 %live.any, label %alive, label %end
alive:
  call void %advance(ptr %rows, double %number, double %time)
  br label %advanced
advanced:
  %next = add i64 %k, 1
  %is.over = icmp eq i64 %next, %last
  br i1 %is.over, label %end, label %begin
end:
  ret void
}}
"""


def callable_sweep(address: int) -> Callable[..., None]:
    """Machine code of :func:`sweep_code` as a function; others may run meanwhile."""
    words, number = ctypes.c_void_p, ctypes.c_int64
    return ctypes.CFUNCTYPE(None, *[words] * 3, *[number] * 2, ctypes.c_double, *[words] * 2)(address)


def callable_code(address: int) -> Callable[[int, float, float], None]:
    """Machine code as a function of a bundle's address, the number of a sample, and a time, s."""
    return ctypes.PYFUNCTYPE(None, ctypes.c_void_p, ctypes.c_double, ctypes.c_double)(address)


_ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
_INSTRUCTIONS: dict[str, tuple[str, ...]] = {
    # As in frexp, in [1/2, 1).
    "mantissa": (
        f"%{{x}}.bits = bitcast {V} {{a}} to {WORDS}",
        f"%{{x}}.fraction = and {WORDS} %{{x}}.bits, splat (i64 {2**52 - 1})",
        f"%{{x}}.half = or {WORDS} %{{x}}.fraction, splat (i64 {1022 << 52})",
        f"%{{x}} = bitcast {WORDS} %{{x}}.half to {V}",
    ),
    # As in frexp; put behind 2⁵² it is a float.
    "exponent": (
        f"%{{x}}.bits = bitcast {V} {{a}} to {WORDS}",
        f"%{{x}}.shifted = lshr {WORDS} %{{x}}.bits, splat (i64 52)",
        f"%{{x}}.behind = or {WORDS} %{{x}}.shifted, splat (i64 {1075 << 52})",
        f"%{{x}}.float = bitcast {WORDS} %{{x}}.behind to {V}",
        f"%{{x}} = fsub {V} %{{x}}.float, {_text(2.0**52 + 1022.0)}",
    ),
    # Of a whole number: added to 3·2⁵¹ + 1023 its bits end up where a float keeps its exponent.
    "exp2": (
        f"%{{x}}.sum = fadd {V} {{a}}, {_text(3.0 * 2.0**51 + 1023.0)}",
        f"%{{x}}.bits = bitcast {V} %{{x}}.sum to {WORDS}",
        f"%{{x}}.moved = shl {WORDS} %{{x}}.bits, splat (i64 52)",
        f"%{{x}} = bitcast {WORDS} %{{x}}.moved to {V}",
    ),
    # Minus one to the power of a whole number: its last bit becomes a sign.
    "alternating": (
        f"%{{x}}.sum = fadd {V} {{a}}, {_text(3.0 * 2.0**51)}",
        f"%{{x}}.bits = bitcast {V} %{{x}}.sum to {WORDS}",
        f"%{{x}}.sign = shl {WORDS} %{{x}}.bits, splat (i64 63)",
        f"%{{x}}.one = or {WORDS} %{{x}}.sign, splat (i64 {1023 << 52})",
        f"%{{x}} = bitcast {WORDS} %{{x}}.one to {V}",
    ),
    **{name: (f"%{{x}} = {word} contract {V} {{a}}, {{b}}",) for name, word in _ARITHMETIC.items()},
    **{
        name: (f"%{{x}}.true = fcmp {word} {V} {{a}}, {{b}}", f"%{{x}} = uitofp {BITS} %{{x}}.true to {V}")
        for name, word in _COMPARED.items()
    },
    **{name: (f"%{{x}} = call {V} @llvm.{word}.v{LANES}f64({V} {{a}})",) for name, word in _CALLED.items()},
    "choose": (
        f"%{{x}}.true = fcmp une {V} {{a}}, zeroinitializer",
        f"%{{x}} = select {BITS} %{{x}}.true, {V} {{b}}, {V} {{c}}",
    ),
    "negative": (f"%{{x}} = fneg {V} {{a}}",),
    "row": (
        f"%{{x}}.place = getelementptr {V}, ptr %rows, i64 {{place}}",
        f"%{{x}} = load {V}, ptr %{{x}}.place, align {ALIGNED}",
    ),
    **{
        name: (
            f"%{{x}}.one = insertelement {V} poison, double %{argument}, i64 0",
            f"%{{x}} = shufflevector {V} %{{x}}.one, {V} poison, <{LANES} x i32> zeroinitializer",
        )
        for name, argument in (("sample", "k"), ("time", "t"))
    },
}
"""Instructions that give ``%x`` the value of an operation on a, b and c."""


def _instructions(x: str, operation: str, operands: tuple[str | float, ...]) -> list[str]:
    named = dict(zip("abc", map(_text, operands), strict=False))
    place = int(operands[0]) if operation == "row" else None
    return [line.format(x=x, place=place, **named) for line in _INSTRUCTIONS[operation]]


@cache
def assembled(source: str, *names: str) -> tuple[int, ...]:
    """Addresses of functions of a source, compiled once in a process."""
    target = _target()
    module = binding.parse_assembly(_DECLARED + source)
    passes = binding.create_new_module_pass_manager()
    # Combines instructions that undo each other.
    passes.add_instruction_combine_pass()
    passes.run(module, binding.create_pass_builder(target, binding.PipelineTuningOptions()))
    engine = binding.create_mcjit_compiler(module, target)
    engine.finalize_object()
    _engines.append(engine)
    return tuple(map(engine.get_function_address, names))


def _target() -> binding.TargetMachine:
    """Everything this processor can do; every engine owns one."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    cpu, features = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(cpu=cpu, features=features, opt=3, codemodel="jitdefault", jit=True)


def _of_vectors(name: str) -> tuple[str, str]:
    declared = f"declare {V} @llvm.{name}.v{LANES}f64({V})\n"
    return declared, of_one_lane(declared)


_DECLARED = "".join(
    (
        *(declared for name in _CALLED.values() for declared in _of_vectors(name)),
        f"declare {V} @llvm.masked.gather.v{LANES}f64.v{LANES}p0({PLACES}, i32, {BITS}, {V})\n",
    )
)
_engines: list[binding.ExecutionEngine] = []
"""Engines own the code they hold; it is used until the process ends."""


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

    `size` numbers of the array go into rows from `take` on. The function is bound to what it gives, an array
    that is the rows from `give` on.
    """
    moves = [
        line
        for k in range(size)
        for line in (
            f"%in{k}.from = getelementptr double, ptr %x, i64 {k}",
            f"%in{k} = load double, ptr %in{k}.from",
            f"%in{k}.to = getelementptr double, ptr %rows, i64 {take + k}",
            f"store double %in{k}, ptr %in{k}.to",
        )
    ]
    body = [
        "%time = load ptr, ptr %args",
        f"%t = call double {_of_python('PyFloat_AsDouble')}(ptr %time)",
        "%array.place = getelementptr ptr, ptr %args, i64 1",
        "%array = load ptr, ptr %array.place",
        *_numbers("x", "array"),
        *_numbers("y", "self"),
        f"%rows = getelementptr double, ptr %y, i64 {-give}",
        *moves,
        f"call void @{inner}(ptr %rows, double 0.0, double %t)",
        # Whoever calls a function owns what it gives.
        f"call void {_of_python('Py_IncRef')}(ptr %self)",
    ]
    head = f"define ptr @{name}(ptr %self, ptr %args, i64 %count) {{"
    return "\n".join([head, *(f"  {line}" for line in body), "  ret ptr %self", "}", ""])


def _of_python(name: str) -> str:
    """A function of Python's C interface, by its address."""
    return f"inttoptr (i64 {ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value} to ptr)"


def _numbers(name: str, array: str) -> list[str]:
    """Instructions that load the address of a NumPy array's numbers."""
    return [
        f"%{name}.at = getelementptr i8, ptr %{array}, i64 {_HEAD}",
        f"%{name} = load ptr, ptr %{name}.at",
    ]


def callable_on_array(address: int, out: Array) -> Callable[[float, Array], Array]:
    """Code of `on_array_code` as a function of a time and an array that gives `out`.

    The array has as many float64 as `out`, one behind the other, which SciPy's arrays are.

    Raises
    ------
    TendonreproError
        If this Python or NumPy keeps an array's address somewhere else.
    """
    if ctypes.c_void_p.from_address(id(out) + _HEAD).value != out.ctypes.data:
        message = "this Python or NumPy keeps the numbers of an array where machine code does not look"
        raise TendonreproError(message, hint="say compare --solver compiled, and report it")
    bind = ctypes.pythonapi.PyCFunction_NewEx
    bind.argtypes = [ctypes.POINTER(_Definition), ctypes.py_object, ctypes.c_void_p]
    bind.restype = ctypes.py_object
    function: Callable[[float, Array], Array] = bind(_definition(address), out, None)
    return function


@cache
def _definition(address: int) -> _Definition:
    """Definition of a function, which Python reads as long as there is one of it."""
    return _Definition(b"slope", address, _METH_FASTCALL, None)
