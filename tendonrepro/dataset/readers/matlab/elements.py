"""The variables of a MATLAB 4 or 5 file as stretches of bytes."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from tendonrepro.dataset.readers.bounds import BEST_PACKING
from tendonrepro.dataset.readers.matlab.parts import (
    CHAR,
    COMPRESSED,
    MATRIX,
    NESTED,
    OPAQUE,
    SPARSE,
    Damaged,
    check_nesting,
    check_shared,
    children,
    matrix_class,
    part,
    parts_of,
)
from tendonrepro.dataset.readers.signals import MOST_BYTES

HEADER = 128
_HEAD = 512
# MATLAB 4: bytes of a number by the tens digit of its type, and the longest name that is plausible.
_V4_BYTES = (8, 4, 4, 2, 2, 1)
_V4_LONGEST_NAME = 256


@dataclass(frozen=True)
class Element:
    """One variable.

    Parameters
    ----------
    name : str
        Empty for what belongs to no variable by itself, such as the properties of objects.
    matrix : int
        Class of the matrix as stored; 0 in a MATLAB 4 file.
    data : memoryview
        Bytes from its tag on.
    packed : bool
        Whether they are compressed.
    order : str
        ``<`` or ``>``.
    plain : bool
        Whether it holds real numbers and no more, which its first bytes show.
    """

    name: str
    matrix: int
    data: memoryview
    packed: bool
    order: str
    plain: bool

    def unpacked(self) -> memoryview:
        """Bytes without compression, with sizes and nesting checked.

        Raises
        ------
        Damaged
        """
        plain = self.data
        if self.packed:
            try:
                plain = memoryview(zlib.decompressobj().decompress(self.data[8:], MOST_BYTES))
            except zlib.error as error:
                message = "its compressed bytes are damaged"
                raise Damaged(message) from error
        check_nesting(plain, self.order)
        if not self.name:
            check_shared(plain, self.order)
        return plain


def elements(data: bytes) -> Iterator[Element | tuple[str, str]]:
    """Variables of a MATLAB 5 file in their order, or the name and a reason where one is damaged.

    Parameters
    ----------
    data : bytes
        The whole file.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    view, at = memoryview(data), HEADER
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        stop = at + 8 + size
        if kind not in (MATRIX, COMPRESSED):
            yield "", f"unknown data at byte {at}"
            return
        if stop > len(data):
            yield "", f"the file ends at byte {len(data)}, before its variable at byte {at} does"
            return
        try:
            yield _element(view[at:stop], kind == COMPRESSED, order)
        except Damaged as damage:
            yield "", f"{damage} (byte {at})"
        at = stop


def _element(data: memoryview, packed: bool, order: str) -> Element:
    head = data[:_HEAD]
    if packed:
        try:
            head = memoryview(zlib.decompressobj().decompress(data[8:], _HEAD))
        except zlib.error as error:
            message = "its compressed bytes are damaged"
            raise Damaged(message) from error
    kind, size, at, _ = part(head, 0, order)
    if kind != MATRIX or (packed and size > len(data) * BEST_PACKING) or size > MOST_BYTES:
        message = "its header announces more than it holds"
        raise Damaged(message)
    parts = parts_of(head, at, at + size, order)
    matrix, complex_ = matrix_class(head, parts, order)
    plain = CHAR != matrix != SPARSE and matrix not in NESTED and not complex_
    if plain:
        children(head, parts, order)
    _, start, stop = parts[1 if matrix == OPAQUE else 2]
    return Element(bytes(head[start:stop]).decode("latin-1"), matrix, data, packed, order, plain)


def elements_4(data: bytes) -> Iterator[Element | tuple[str, str]]:
    """Variables of a MATLAB 4 file in their order; as `elements`.

    Yields nothing at all where the bytes are no MATLAB 4 file.
    """
    # The type is below 5000; big-endian machines write it as 1000 and more.
    order, at = ">" if data[:2] == b"\0\0" and data[2:4] != b"\0\0" else "<", 0
    while at + 20 <= len(data):
        kind, rows, columns, complex_, length = struct.unpack_from(f"{order}5I", data, at)
        type_, sort = kind // 10 % 10, kind % 10
        if (
            kind >= 5000
            or type_ >= len(_V4_BYTES)
            or sort > 2
            or complex_ > 1
            or not 0 < length <= _V4_LONGEST_NAME
        ):
            if at:
                yield "", f"unknown data at byte {at}"
            return
        stop = at + 20 + length + rows * columns * _V4_BYTES[type_] * (1 + complex_)
        name = data[at + 20 : at + 20 + length].rstrip(b"\0").decode("latin-1")
        if stop > len(data):
            if at or name.isidentifier():
                yield name, f"the file ends at byte {len(data)}, before this variable does"
            return
        yield Element(name, 0, memoryview(data)[at:stop], False, order, True)
        at = stop
