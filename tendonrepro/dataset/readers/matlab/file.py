"""MATLAB files of every version, told apart by their first bytes."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from tendonrepro.dataset.readers.bounds import MOST_SIGNALS
from tendonrepro.dataset.readers.matlab.elements import HEADER, Element, elements, elements_4
from tendonrepro.dataset.readers.matlab.figure import BESIDE, TREES, read_figure
from tendonrepro.dataset.readers.matlab.hdf import contents
from tendonrepro.dataset.readers.matlab.objects import load_objects, quiet, translate
from tendonrepro.dataset.readers.matlab.parts import NESTED, OPAQUE, Damaged
from tendonrepro.dataset.readers.matlab.streams import read_streams
from tendonrepro.dataset.readers.matlab.values import EXPORT, Lost
from tendonrepro.dataset.readers.matlab.walk import Walk
from tendonrepro.dataset.readers.signals import MOST_BYTES, Found
from tendonrepro.dataset.readers.unreadable import Unreadable

HDF_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_HDF_AT = 512
_AGAIN = "copy or download it again"
_SPLIT = "save what is needed of it into a file of its own"
_ORDERS = {b"IM": b"\x00\x01", b"MI": b"\x01\x00"}
_ORDERS_HDF = {b"IM": b"\x00\x02", b"MI": b"\x02\x00"}


def is_matlab(head: bytes) -> bool:
    """Whether a file is of MATLAB 5 or newer, a figure included.

    Parameters
    ----------
    head : bytes
        First 128 bytes of the file. Files of MATLAB 4 have no mark of their own.
    """
    version, order = head[124:126], head[126:128]
    return version in (_ORDERS.get(order), _ORDERS_HDF.get(order))


def read_matlab(path: Path) -> Found:
    """Read a MATLAB file: versions 4, 5, 7 and 7.3, and figures.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Found
        Every variable that cannot be read is noted as skipped.

    Raises
    ------
    Unreadable
        If it is no MATLAB file, or nothing in it can be read.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_HDF_AT + len(HDF_SIGNATURE))
        if is_matlab(head) and head[124:126] == _ORDERS_HDF.get(head[126:128]):
            return _read_hdf(path, head)
        if size > MOST_BYTES:
            reason = f"{size / 2**30:.1f} GiB are too large"
            raise Unreadable(reason, _SPLIT)
        return _read_elements(path, path.read_bytes())
    except OSError as error:
        raise Unreadable(str(error.strerror or error)) from error
    except (MemoryError, RecursionError) as error:
        reason = "it needs too much memory"
        raise Unreadable(reason, _SPLIT) from error


def _read_hdf(path: Path, head: bytes) -> Found:
    if head[_HDF_AT:] != HDF_SIGNATURE:
        reason = "the header says MATLAB 7.3, but no HDF5 data follows"
        raise Unreadable(reason, _AGAIN)
    found = Found("MATLAB 7.3")
    listed = contents(path)
    for name, reason in listed.refused.items():
        found.skip(name, reason, _SPLIT)
    wanted = _wanted(listed.names, found)
    values = load_objects(path, wanted) if wanted else {}
    _visit_all(found, values.items())
    if listed.streams:
        read_streams(path, found)
    return found


def _wanted(names: Sequence[str], found: Found) -> list[str]:
    """Variables to read: of a figure not those that say the same again."""
    figure = any(name in TREES for name in names)
    wanted = [name for name in names if not (figure and name in BESIDE)]
    if len(wanted) > MOST_SIGNALS:
        found.skip("", f"{len(wanted) - MOST_SIGNALS} more variables are left out", _SPLIT)
    return wanted[:MOST_SIGNALS]


def _visit_all(found: Found, values: Iterable[tuple[str, Any]]) -> None:
    walk = Walk(found, translate)
    for name, value in values:
        try:
            if name in TREES:
                found.kind = f"MATLAB figure ({found.kind})"
                read_figure(value, found)
            else:
                walk.visit(name, value)
        except Exception as error:
            reason = f"it is not as expected ({type(error).__name__}: {str(error)[:120]})"
            found.skip(name, reason, EXPORT)
    walk.finish()


def _read_elements(path: Path, data: bytes) -> Found:
    modern = is_matlab(data[:HEADER])
    parts = list(elements(data) if modern else elements_4(data))
    whole = [part for part in parts if isinstance(part, Element)]
    broken = [part for part in parts if not isinstance(part, Element)]
    if not whole:
        _refuse(modern, broken)
    packed = any(part.packed for part in whole)
    found = Found(("MATLAB 7" if packed else "MATLAB 5") if modern else "MATLAB 4")
    for name, reason in broken:
        found.skip(name, reason, _AGAIN)
    wanted = set(_wanted([part.name for part in whole if part.name], found))
    variables = [part for part in whole if part.name in wanted]
    figure = not wanted.isdisjoint(TREES)
    objects = set() if figure else _with_objects(variables, [part for part in whole if not part.name], found)
    loaded = load_objects(path, sorted(objects)) if objects else {}
    _visit_all(found, _values(variables, loaded, data[:HEADER], found))
    return found


def _values(
    variables: Iterable[Element], loaded: Mapping[str, Any], header: bytes, found: Found
) -> Iterator[tuple[str, Any]]:
    """Variables in their order, each read when its turn has come."""
    for part in variables:
        value = loaded.get(part.name)
        # The plain members of a struct can be read without its objects.
        if value is None or (isinstance(value, Lost) and part.matrix != OPAQUE):
            value = _load(part, header, found)
        if value is not None:
            yield part.name, value


def _refuse(modern: bool, broken: Iterable[tuple[str, str]]) -> NoReturn:
    nothing = "it holds no variables" if modern else "it is no MATLAB file"
    reason = next((reason for _, reason in broken), nothing)
    raise Unreadable(reason, "check that it was copied or downloaded whole")


def _with_objects(variables: list[Element], shared: list[Element], found: Found) -> set[str]:
    """Variables that may hold objects, whose properties lie apart."""
    if not shared:
        return set()
    nested: set[str] = set()
    try:
        for part in shared:
            part.unpacked()
    except (Damaged, MemoryError) as damage:
        found.skip("", f"objects cannot be read: {damage}", EXPORT)
        return nested
    for part in (part for part in variables if part.matrix in NESTED):
        # The other library would trust its sizes; here the reason is noted when it is read.
        with contextlib.suppress(Damaged, MemoryError):
            part.unpacked()
            nested.add(part.name)
    return nested


def _load(part: Element, header: bytes, found: Found) -> Any:
    """Read one variable as a file of its own, so that it fails alone; None if it does."""
    from scipy.io import loadmat

    try:
        body = part.data if part.plain else part.unpacked()
        head = header if part.matrix else b""
        with quiet():
            # The stubs know paths only.
            loaded = loadmat(io.BytesIO(b"".join((head, body))), spmatrix=False)  # type: ignore[arg-type]
        return next(value for name, value in loaded.items() if not name.startswith("__"))
    except Exception as error:
        detail = " ".join(str(error).split())[:120] or type(error).__name__
        found.skip(part.name, f"it cannot be read ({detail})", _AGAIN)
        return None
