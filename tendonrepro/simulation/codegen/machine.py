"""Recorded operations as vector instructions, and those as machine code that is kept on disk.

Every lane does the same arithmetic on its own numbers, so no lane can change another. A product may be fused
with a sum; all lanes do so alike. LLVM is handed the instructions as they stand: with nothing to infer and
nothing to vectorise it compiles in about a second.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from llvmlite import binding

from tendonrepro.errors import TendonreproError
from tendonrepro.files import write_atomically
from tendonrepro.simulation.codegen.symbols import COMPARISONS, Line, needed

LANES = 8
"""Experiments in a bundle: one vector of the widest registers there are, so that few values leave them."""

ALIGNED = 8 * LANES
"""Bytes on whose multiples a row begins."""

V, WORDS, BITS = (f"<{LANES} x {kind}>" for kind in ("double", "i64", "i1"))

_COMPARED = dict(zip(COMPARISONS, ("oge", "ogt", "ole", "olt"), strict=True))
_CALLED = {"abs": "fabs", "sqrt": "sqrt", "floor": "floor"}


def _text(operand: str | float) -> str:
    """A name, or a number in all lanes, written by its bits."""
    if isinstance(operand, str):
        return f"%{operand}"
    (bits,) = struct.unpack("<Q", struct.pack("<d", operand))
    return f"splat (double 0x{bits:016X})"


class LaneCode(NamedTuple):
    """Addresses of two functions ``void (double *rows, double k)``, of which the first runs first."""

    prepare: int
    run: int


def vector_code(name: str, lines: Mapping[str, Line], results: Mapping[int, str | float]) -> str:
    """Source of ``<name>(rows, k)``: every line the results need, each result stored in its row."""
    body = [part for x in needed(lines, results.values()) for part in _instructions(x, *lines[x])]
    for row, value in results.items():
        body += [
            f"%end{row} = getelementptr {V}, ptr %rows, i64 {row}",
            f"store {V} {_text(value)}, ptr %end{row}, align {ALIGNED}",
        ]
    head = f"define void @{name}(ptr noalias %rows, double %k) {{"
    return "\n".join([head, *(f"  {line}" for line in body), "  ret void", "}", ""])


_ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
_SPLIT = {
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
}
_INSTRUCTIONS: dict[str, tuple[str, ...]] = {
    **_SPLIT,
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
        f"%{{x}}.place = getelementptr {V}, ptr %rows, i64 {{row}}",
        f"%{{x}} = load {V}, ptr %{{x}}.place, align {ALIGNED}",
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
    row = int(operands[0]) if operation == "row" else None
    return [line.format(x=x, row=row, **named) for line in _INSTRUCTIONS[operation]]


def assembled(source: str, name: str, folder: Path) -> LaneCode:
    """Machine code of a source with ``<name>`` and ``prepare_<name>``, taken from a folder if it is there.

    A file that is not as it was written is made again; one that cannot be written is done without.
    """
    digest = hashlib.sha256("\n".join((source, *_processor(), str(binding.llvm_version_info))).encode())
    path = folder / f"{name}_{digest.hexdigest()[:16]}.o"
    code = _stored(path)
    if code is None:
        module = binding.parse_assembly(_DECLARED + source)
        code = _simplified(module)
        with suppress(TendonreproError):
            write_atomically(path, hashlib.sha256(code).digest() + code)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), _target())
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return LaneCode(engine.get_function_address(f"prepare_{name}"), engine.get_function_address(name))


def _simplified(module: Any) -> bytes:
    """Machine code of a module, its instructions combined: the symbols write many that undo each other."""
    target = _target()
    passes = binding.create_new_module_pass_manager()
    passes.add_instruction_combine_pass()
    passes.run(module, binding.create_pass_builder(target, binding.PipelineTuningOptions()))
    code: bytes = target.emit_object(module)
    return code


def _stored(path: Path) -> bytes | None:
    """Machine code in a file, if it is whole."""
    try:
        image = path.read_bytes()
    except OSError:
        return None
    digest, code = image[:32], image[32:]
    return code if hashlib.sha256(code).digest() == digest else None


@cache
def _processor() -> tuple[str, str]:
    return binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()


def _target() -> Any:
    """Everything this processor can do; every engine owns one."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    cpu, features = _processor()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(cpu=cpu, features=features, opt=3, codemodel="jitdefault", jit=True)


_DECLARED = "".join(f"declare {V} @llvm.{name}.v{LANES}f64({V})\n" for name in _CALLED.values())
_engines: list[Any] = []
"""Engines own the code they hold; it is used until the process ends."""
