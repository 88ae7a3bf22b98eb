"""Recorded operations as vector instructions, and their machine code.

A product may be fused with a sum, in all lanes alike.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import binding

from tendonrepro.arrays import Array
from tendonrepro.simulation.codegen.symbols import COMPARISONS, Line, needed

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


class LaneCode(NamedTuple):
    """Addresses of two functions ``void (double *rows, double k)``; ``prepare`` comes first."""

    prepare: int
    run: int


class Store(NamedTuple):
    """A value to be put some numbers behind where each lane's pointer leads."""

    pointer: str
    offset: int
    value: str | float


def vector_code(
    name: str, lines: Mapping[str, Line], results: Mapping[int, str | float], stores: Iterable[Store] = ()
) -> str:
    """Source of ``<name>(rows, k)``: the lines that results need.

    Rows are read just before their first use and written as soon as known: few values wait in registers.
    """
    stores = list(stores)
    wanted = [*results.values(), *(part for store in stores for part in (store.pointer, store.value))]
    order = needed(lines, wanted)
    turn: dict[str | float, float] = {x: float(k) for k, x in enumerate(order)}
    reads = {x: lines[x][1][0] for x in order if lines[x][0] == "row"}
    for x in reversed(order):
        turn |= {operand: turn[x] - 0.5 for operand in lines[x][1] if operand in reads}
    pieces = [(turn[x], _instructions(x, *lines[x])) for x in order]
    read = {row: turn[x] for x, row in reads.items()}
    for row, value in results.items():
        place = f"%end{row} = getelementptr {V}, ptr %rows, i64 {row}"
        # Else LLVM stores by masks where a value may stay as it was, which takes AVX2 long.
        write = f"store volatile {V} {_text(value)}, ptr %end{row}, align {ALIGNED}"
        pieces.append((max(turn.get(value, 0.0), read.get(row, 0.0)) + 0.25, [place, write]))
    body = [part for _, parts in sorted(pieces) for part in parts]
    for k, store in enumerate(stores):
        body += [
            *(line.format(x=f"store{k}", a=f"%{store.pointer}", place=store.offset) for line in _PLACE),
            f"call void @llvm.masked.scatter.v{LANES}f64.v{LANES}p0("
            f"{V} {_text(store.value)}, {PLACES} %store{k}.place, i32 8, {_ALL})",
        ]
    head = f"define void @{name}(ptr noalias %rows, double %k) {{"
    return "\n".join([head, *(f"  {line}" for line in body), "  ret void", "}", ""])


def repeated(name: str, first: str, again: str, row: int) -> str:
    """Source of a call of one function, then another while any lane of a row is positive."""
    return f"""define void @{name}(ptr %rows, double %k) {{
start:
  %place = getelementptr {V}, ptr %rows, i64 {row}
  call void @{first}(ptr %rows, double %k)
  br label %look
look:
  %left = load {V}, ptr %place, align {ALIGNED}
  %most = call double @llvm.vector.reduce.fmax.v{LANES}f64({V} %left)
  %goes.on = fcmp ogt double %most, 0.0
  br i1 %goes.on, label %again, label %end
again:
  call void @{again}(ptr %rows, double %k)
  br label %look
end:
  ret void
}}
"""


_SWEEP = """define void @sweep(ptr %codes, ptr %bundles, i64 %count, i64 %first, i64 %last) {
start:
  br label %sample
sample:
  %k = phi i64 [ %first, %start ], [ %next, %sampled ]
  %number = sitofp i64 %k to double
  br label %bundle
bundle:
  %b = phi i64 [ 0, %sample ], [ %after, %bundle ]
  %code.place = getelementptr ptr, ptr %codes, i64 %b
  %rows.place = getelementptr ptr, ptr %bundles, i64 %b
  %code = load ptr, ptr %code.place
  %rows = load ptr, ptr %rows.place
  call void %code(ptr %rows, double %number)
  %after = add i64 %b, 1
  %was.last = icmp eq i64 %after, %count
  br i1 %was.last, label %sampled, label %bundle
sampled:
  %next = add i64 %k, 1
  %is.over = icmp eq i64 %next, %last
  br i1 %is.over, label %end, label %sample
end:
  ret void
}
"""


def sweep(parts: Sequence[tuple[int, Array]], first: int, last: int) -> None:
    """Call codes in turn, each with its bundle, at every sample of a span."""
    (address,) = assembled(_SWEEP, "sweep")
    run = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2, *[ctypes.c_int64] * 3)(address)
    codes = np.array([code for code, _ in parts])
    bundles = np.array([rows.ctypes.data for _, rows in parts])
    run(codes.ctypes.data, bundles.ctypes.data, len(parts), first, last)


def callable_code(address: int) -> Callable[[int, float], None]:
    """Machine code as a function of a bundle's address and a number."""
    return ctypes.PYFUNCTYPE(None, ctypes.c_void_p, ctypes.c_double)(address)


_ALL = f"{BITS} splat (i1 true)"
_PLACE = (
    f"%{{x}}.bits = bitcast {V} {{a}} to {WORDS}",
    f"%{{x}}.start = inttoptr {WORDS} %{{x}}.bits to {PLACES}",
    f"%{{x}}.place = getelementptr double, {PLACES} %{{x}}.start, i64 {{place}}",
)
"""Where the pointers of a row lead, so many numbers further."""
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
    # Pointers, kept as bits of numbers, moved on by whole numbers of numbers.
    "moved": (
        f"%{{x}}.bits = bitcast {V} {{a}} to {WORDS}",
        f"%{{x}}.count = fptosi {V} {{b}} to {WORDS}",
        f"%{{x}}.bytes = shl {WORDS} %{{x}}.count, splat (i64 3)",
        f"%{{x}}.sum = add {WORDS} %{{x}}.bits, %{{x}}.bytes",
        f"%{{x}} = bitcast {WORDS} %{{x}}.sum to {V}",
    ),
    "load": (
        *_PLACE,
        f"%{{x}} = call {V} @llvm.masked.gather.v{LANES}f64.v{LANES}p0("
        f"{PLACES} %{{x}}.place, i32 8, {_ALL}, {V} poison)",
    ),
    # Of the arguments only the number is read.
    "argument": (
        f"%{{x}}.one = insertelement {V} poison, double %k, i64 0",
        f"%{{x}} = shufflevector {V} %{{x}}.one, {V} poison, <{LANES} x i32> zeroinitializer",
    ),
}
"""Instructions that give ``%x`` the value of an operation on a, b and c."""


def _instructions(x: str, operation: str, operands: tuple[str | float, ...]) -> list[str]:
    named = dict(zip("abc", map(_text, operands), strict=False))
    place = int(operands[-1]) if operation in ("row", "load") else None
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


def _target() -> Any:
    """Everything this processor can do; every engine owns one."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    cpu, features = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(cpu=cpu, features=features, opt=3, codemodel="jitdefault", jit=True)


_DECLARED = "".join(
    (
        *(f"declare {V} @llvm.{name}.v{LANES}f64({V})\n" for name in _CALLED.values()),
        f"declare {V} @llvm.masked.gather.v{LANES}f64.v{LANES}p0({PLACES}, i32, {BITS}, {V})\n",
        f"declare void @llvm.masked.scatter.v{LANES}f64.v{LANES}p0({V}, {PLACES}, i32, {BITS})\n",
        f"declare double @llvm.vector.reduce.fmax.v{LANES}f64({V})\n",
    )
)
_engines: list[Any] = []
"""Engines own the code they hold; it is used until the process ends."""
