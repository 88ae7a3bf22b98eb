"""What a file truly is, told by its content, and the encoding of a text."""

from __future__ import annotations

import struct
import tarfile
import zipfile
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Self

_BYTE_ORDER_MARKS = {
    b"\xef\xbb\xbf": "utf-8-sig",
    b"\xff\xfe\x00\x00": "utf-32",
    b"\x00\x00\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
"""First bytes of a text -> its encoding; the longer of two marks that begin alike comes first."""
_HEAD = 65536
"""Bytes looked at; a text says within its first pages that it is one."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_OFFSETS = (0, 512, 1024, 2048, 4096)
_DIRECTORY = 16384
"""Bytes of an OLE2 directory looked at: 128 entries, a workbook has a dozen."""
_TAR_BLOCK = 512


_UNPACK = "unpack it and name the folder"
_PASSWORD = "ask its authors for the password, open it and save it without one"
_ELSEWHERE = "no numbers to read here; look for the data file beside it"
_WORKSHEETS = "open it in Origin or the free Origin Viewer and export the worksheets as CSV"
_RUN = "run the model and save its logged signals with save('x.mat')"
_PULL = "it only points to the data; run git lfs pull where it came from"


class FileType(StrEnum):
    """True type of a file: what a user is told, advice if it is not read, and its first bytes."""

    advice: str
    signatures: tuple[bytes, ...]

    def __new__(cls, value: str, advice: str = "", *signatures: bytes) -> Self:
        """Keep what belongs to a type beside its value."""
        member = str.__new__(cls, value)
        member._value_, member.advice, member.signatures = value, advice, signatures
        return member

    MATLAB_5 = "MATLAB 5"
    MATLAB_73 = "MATLAB 7.3"
    HDF5 = "HDF5"
    XLSX = "Excel workbook (xlsx)"
    XLSB = "Excel binary workbook (xlsb)"
    XLS = "Excel 97 workbook (xls)"
    ODS = "OpenDocument spreadsheet (ods)"
    NPY = "NumPy array (npy)", "", b"\x93NUMPY"
    NPZ = "NumPy arrays (npz)"
    TEXT = "text"
    ZIP = "zip archive"
    TAR = "tar archive"
    GZIP = "gzip file", "", b"\x1f\x8b"
    BZIP2 = "bzip2 file", "", b"BZh"
    XZ = "xz file", "", b"\xfd7zXZ\x00"
    ENCRYPTED_ZIP = "encrypted zip archive", _PASSWORD
    ENCRYPTED_OFFICE = "encrypted Office file", _PASSWORD
    RAR = "rar archive", _UNPACK, b"Rar!\x1a\x07"
    SEVEN_ZIP = "7z archive", _UNPACK, b"7z\xbc\xaf\x27\x1c"
    ZSTD = "zstd file", _UNPACK, b"\x28\xb5\x2f\xfd"
    ORIGIN = "Origin project", _WORKSHEETS, b"CPYA", b"CPYUA"
    TDMS = "LabVIEW TDMS", "export it as CSV from LabVIEW or DIAdem", b"TDSm"
    SIMULINK = "Simulink model", _RUN, b"# MathWorks OPC Text Package"
    MATLAB_CODE = "MATLAB code", _ELSEWHERE
    PYTHON_CODE = "Python code", _ELSEWHERE
    LIVE_SCRIPT = "MATLAB live script", _ELSEWHERE
    OFFICE = "Office document without a workbook", "save its tables as xlsx or CSV"
    PDF = "PDF", _ELSEWHERE, b"%PDF"
    IMAGE = "image", _ELSEWHERE, b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8", b"II*\x00", b"MM\x00*"
    HTML = "HTML page", "a web page was saved instead of the file; download the file again"
    XML = "XML", "open it in the program that wrote it and save as xlsx or CSV"
    LFS_POINTER = "Git LFS pointer", _PULL, b"version https://git-lfs"
    EMPTY = "empty file", "download it again"
    BINARY = "unknown binary", "export it as CSV, MAT or HDF5 from the program that wrote it"


_CODE = {".m": FileType.MATLAB_CODE, ".py": FileType.PYTHON_CODE}
_MEMBERS = (
    ("xl/workbook.xml", FileType.XLSX),
    ("xl/workbook.bin", FileType.XLSB),
    ("simulink/blockdiagram.xml", FileType.SIMULINK),
    ("matlab/document.xml", FileType.LIVE_SCRIPT),
    ("word/document.xml", FileType.OFFICE),
    ("ppt/presentation.xml", FileType.OFFICE),
)
_TEXT_STARTS = (
    ("<!doctype html", FileType.HTML),
    ("<html", FileType.HTML),
    ("<?xml", FileType.XML),
    ("model {", FileType.SIMULINK),
    ("library {", FileType.SIMULINK),
)
_CONTROLS = bytes(set(range(32)) - set(b"\t\n\r\f\x1a\x1b"))


def kind_of(path: Path) -> FileType:
    """True type of a file by its content; a name alone never decides. OSError when it cannot be opened."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    if not head:
        return FileType.EMPTY
    for kind in FileType:
        if kind.signatures and head.startswith(kind.signatures):
            return kind
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06", b"PK\x07\x08")):
        return _zip_kind(path, head)
    if head.startswith(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"):
        return _ole2_kind(path, head)
    return _matlab_or_hdf5(head) or _plain_kind(path, head)


def _matlab_or_hdf5(head: bytes) -> FileType | None:
    hdf5 = any(head[offset:].startswith(_HDF5) for offset in _HDF5_OFFSETS)
    if head.startswith(b"MATLAB 7.3") or (hdf5 and head.startswith(b"MATLAB")):
        return FileType.MATLAB_73
    if hdf5:
        return FileType.HDF5
    # The text before may be anything: what makes a level 5 file is its version and byte order.
    level_5 = head[124:128] in {b"\x00\x01IM", b"\x01\x00MI"}
    return FileType.MATLAB_5 if level_5 or head.startswith(b"MATLAB 5.0") else None


def _zip_kind(path: Path, head: bytes) -> FileType:
    try:
        with zipfile.ZipFile(path) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
    except Exception:  # a broken one raises whatever its bytes lead to; the reader of archives says so
        return FileType.ZIP
    if entries and all(entry.flag_bits & 1 for entry in entries):
        return FileType.ENCRYPTED_ZIP
    names = {entry.filename for entry in entries}
    for name, kind in _MEMBERS:
        if name in names:
            return kind
    # OpenDocument names its type in a first member that is never compressed.
    if {"mimetype", "content.xml"} <= names:
        return FileType.ODS if b"opendocument.spreadsheet" in head else FileType.OFFICE
    return FileType.NPZ if names and all(name.endswith(".npy") for name in names) else FileType.ZIP


def _ole2_kind(path: Path, head: bytes) -> FileType:
    shift, first = struct.unpack_from("<H16xI", head.ljust(52, b"\0"), 30)
    if shift not in {9, 12}:
        return FileType.BINARY
    with path.open("rb") as stream:
        stream.seek((first + 1) << shift)
        names = stream.read(_DIRECTORY)
    if "EncryptedPackage".encode("utf-16-le") in names:
        return FileType.ENCRYPTED_OFFICE
    # A name starts an entry of the directory; "Book" is what Excel 95 wrote.
    workbook = any(f"{name}\0".encode("utf-16-le") in names for name in ("Workbook", "Book"))
    return FileType.XLS if workbook else FileType.OFFICE


def is_tar(head: bytes) -> bool:
    """Whether bytes begin a tar archive: its first block carries a checksum of itself."""
    try:
        tarfile.TarInfo.frombuf(head[:_TAR_BLOCK], "utf-8", "surrogateescape")
    except (tarfile.HeaderError, ValueError):
        return False
    return True


def _plain_kind(path: Path, head: bytes) -> FileType:
    if is_tar(head):
        return FileType.TAR
    wide = head.startswith(tuple(_BYTE_ORDER_MARKS))
    if not wide and len(head.translate(None, _CONTROLS)) < len(head):
        return FileType.BINARY
    text = decoded(head)[0] if wide else head.decode("ascii", "ignore")
    lowered = text[:1000].lstrip().lower()
    for beginning, kind in _TEXT_STARTS:
        if lowered.startswith(beginning):
            return kind
    # Code and tables are both text: a name decides only where the text does not begin with a number.
    numeric = lowered[:1].isdigit() or lowered[:1] in {"-", "+", "."}
    return FileType.TEXT if numeric else _CODE.get(path.suffix.lower(), FileType.TEXT)


def decoded(raw: bytes) -> tuple[str, str]:
    """Decode everything in a file; returns the text without a byte order mark, and its encoding.

    That is what a mark says, else the first of UTF-8, Chinese and Western Windows that fits. Numbers are
    ASCII in all of these, so at worst a name is spoilt.
    """
    for mark, encoding in _BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            return raw.decode(encoding, "replace").removeprefix("\ufeff"), encoding
    for encoding in ("utf-8", "gb18030"):
        with suppress(UnicodeDecodeError):
            return raw.decode(encoding), encoding
    return raw.decode("cp1252", "replace"), "cp1252"
