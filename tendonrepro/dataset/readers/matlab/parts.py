"""Sizes and nesting of a MATLAB 5 matrix, compared with its bytes before a library reads it.

A library that trusts what is announced can be led to fill the memory or the stack, or to read past its
buffers.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import TypeAlias

CELL, STRUCT, OBJECT, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NESTED = frozenset({CELL, STRUCT, OBJECT, FUNCTION, OPAQUE})
"""Matrix classes that hold other matrices."""

# Types of data by their numbers in the file.
_FLAGS, MATRIX, COMPRESSED, _LAST_TYPE = 6, 14, 15, 18
_NUMBERS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
_NAMES, _INTEGERS, _CHARS = frozenset({1, 2, 16}), frozenset({5, 6}), frozenset({1, 2, 4, 16, 17, 18})
_COMPLEX = 0x800
_LAST_CLASS, _MOST_DIMENSIONS, _LONGEST_FIELD = 17, 32, 4096
_OBJECT_PLACE, _UINT32 = 0xDD000000, 13
_DEEPEST = 60
_MOST_PARTS = 1_000_000
_SHARED_HEADER = 8
# Elements of a struct array without fields cost no bytes.
_MOST_BARE = 1000
_FEW = 64

Part: TypeAlias = tuple[int, int, int]
"""Type, first byte and end of the contents."""


class Damaged(Exception):
    """Bytes that are not what their header announces."""


def check_nesting(view: memoryview, order: str) -> None:
    """Check every size inside a matrix against its bytes, and its parts against its class.

    Parameters
    ----------
    view : memoryview
        Bytes from the tag of the matrix on.
    order : str

    Raises
    ------
    Damaged
        If a part does not fit into its parent or is not of the type due, or matrices lie in each other too
        deeply.
    """
    kind, size, at, _ = part(view, 0, order)
    if kind != MATRIX or at + size > len(view):
        message = "it ends too early"
        raise Damaged(message)
    waiting, count = [(at, at + size, 1)], 0
    while waiting:
        at, stop, depth = waiting.pop()
        parts = parts_of(view, at, stop, order)
        count += len(parts)
        if depth > _DEEPEST or count > _MOST_PARTS:
            message = "it is nested too deeply" if depth > _DEEPEST else "it has too many parts"
            raise Damaged(message)
        inner = children(view, parts, order)
        waiting += [(start, end, depth + 1) for _, start, end in inner if end > start]


def check_shared(view: memoryview, order: str) -> None:
    """Check what all objects share: a matrix whose bytes are another, behind a header of its own."""
    _, size, at, _ = part(view, 0, order)
    _, start, stop = parts_of(view, at, at + size, order)[-1]
    if stop - start > _SHARED_HEADER:
        own = "<" if bytes(view[start + 2 : start + 4]) == b"IM" else ">"
        check_nesting(view[start + _SHARED_HEADER : stop], own)


def part(view: memoryview, at: int, order: str) -> tuple[int, int, int, int]:
    """Type, size, first byte of the contents and of what follows; short contents share the tag."""
    if at + 8 > len(view):
        message = "it ends too early"
        raise Damaged(message)
    kind, size = struct.unpack_from(f"{order}II", view, at)
    if kind >> 16:
        _due(kind >> 16 <= 4)
        return kind & 0xFFFF, kind >> 16, at + 4, at + 8
    return kind, size, at + 8, at + 8 + -(-size // 8) * 8


def parts_of(view: memoryview, at: int, stop: int, order: str) -> list[Part]:
    """What a matrix consists of, as far as the bytes at hand show it."""
    found: list[Part] = []
    while at + 8 <= min(stop, len(view)):
        kind, size, contents, following = part(view, at, order)
        if not 0 < kind <= _LAST_TYPE or kind == COMPRESSED or contents + size > stop:
            message = f"a part inside, of {size} bytes, does not fit"
            raise Damaged(message)
        found.append((kind, contents, contents + size))
        at = following
    return found


def matrix_class(view: memoryview, parts: list[Part], order: str) -> tuple[int, bool]:
    """Class of a matrix, and whether its numbers are complex."""
    kind, start, stop = parts[0] if len(parts) > 2 else (0, 0, 0)
    _due(kind == _FLAGS and stop - start == 8)
    flags = struct.unpack_from(f"{order}I", view, start)[0]
    _due(0 < flags & 0xFF <= _LAST_CLASS)
    return flags & 0xFF, bool(flags & _COMPLEX)


def _due(holds: bool) -> None:
    if not holds:
        message = "its parts are not those of its class"
        raise Damaged(message)


def children(view: memoryview, parts: list[Part], order: str) -> list[Part]:
    """Matrices inside a matrix, once its parts are known to be those of its class."""
    matrix, complex_ = matrix_class(view, parts, order)
    if matrix == OPAQUE:
        _due(len(parts) == 5 and all(kind in _NAMES for kind, _, _ in parts[1:4]) and parts[4][0] == MATRIX)
        return parts[4:]
    dimensions = _integers(view, parts[1], order)
    _due(2 <= len(dimensions) <= _MOST_DIMENSIONS and min(dimensions) >= 0 and parts[2][0] in _NAMES)
    cells, rest = math.prod(dimensions), parts[3:]
    if matrix not in NESTED:
        _check_numbers(matrix, cells, complex_, rest)
        if matrix == _UINT32 and cells and rest[0][2] <= len(view):
            _due(
                stands_for_objects(struct.unpack_from(f"{order}{min(cells, _FEW)}I", view, rest[0][1]), cells)
            )
        return []
    if matrix in (STRUCT, OBJECT):
        rest = rest[1:] if matrix == OBJECT else rest
        fields = _fields(view, rest, order)
        _due(fields > 0 or cells <= _MOST_BARE)
        cells, rest = cells * fields, rest[2:]
    cells = min(cells, 1) if matrix == FUNCTION else cells
    if cells != len(rest) or any(kind != MATRIX for kind, _, _ in rest):
        message = f"it announces {cells} values and holds {len(rest)}"
        raise Damaged(message)
    return rest


def stands_for_objects(first: Sequence[int], count: int) -> bool:
    """Whether an array of uint32 that stands for objects announces as many as it lists; true for any other.

    Parameters
    ----------
    first : sequence of int
        Its first numbers.
    count : int
        How many there are.
    """
    if count < 3 or first[0] != _OBJECT_PLACE:
        return True
    dimensions = first[2 : 2 + first[1]]
    return len(dimensions) == first[1] and 3 + len(dimensions) + math.prod(dimensions) == count


def _integers(view: memoryview, part: Part, order: str) -> tuple[int, ...]:
    kind, start, stop = part
    _due(kind in _INTEGERS and stop <= len(view))
    return struct.unpack_from(f"{order}{(stop - start) // 4}i", view, start)


def _fields(view: memoryview, parts: list[Part], order: str) -> int:
    """Number of fields of a struct."""
    _due(len(parts) >= 2 and parts[1][0] in _NAMES)
    length = _integers(view, parts[0], order)
    _due(len(length) == 1 and 0 < length[0] <= _LONGEST_FIELD)
    _, start, stop = parts[1]
    return (stop - start) // length[0]


def _check_numbers(matrix: int, count: int, complex_: bool, parts: list[Part]) -> None:
    kinds = [kind for kind, _, _ in parts]
    if matrix == CHAR:
        _due(len(kinds) == 1 and kinds[0] in _CHARS)
        return
    _due(all(kind in _NUMBERS for kind in kinds))
    if matrix == SPARSE:
        _due(len(kinds) == 3 + complex_)
        return
    _due(len(kinds) == 1 + complex_)
    if any(stop - start != count * _NUMBERS[kind] for kind, start, stop in parts):
        message = f"it announces {count} numbers, which do not fit its bytes"
        raise Damaged(message)
