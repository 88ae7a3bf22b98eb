"""What ``tendonrepro report`` does: read what there is, and write one page of it."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import MOST_JSON, ordinary, write_atomically

SCHEMA_VERSION = 1
NAME = "report.html"
_SEAL = re.compile(rb"<!-- tendonrepro report, sha256 ([0-9a-f]{64}) -->\n\Z")


def run_report(
    folder: Path, out: Path | None, talk: Talk, *, measured: Path | None, force: bool
) -> dict[str, Any]:
    """Write the page of a results folder.

    A page that stands there already is replaced; any other file, or a page that someone edited, is not.

    Parameters
    ----------
    folder : Path
        Folder above the results: ``decouple``, ``compare``, ... where they exist.
    out : Path or None
        File to write; None is ``report.html`` in that folder.
    talk : Talk
    measured : Path or None
        Measured trace file; None is ``data/measured.h5`` where there is one.
    force : bool
        Replace whatever is there.

    Returns
    -------
    dict
        What ``--json`` prints: ``path``, ``bytes``, ``sha256``, and where each part comes from.

    Raises
    ------
    UsageError
        If a file that this command has not written is in the way.
    DataMissingError
        If there is no such folder, or something in it is damaged.
    """
    path = folder / NAME if out is None else out
    if not folder.is_dir():
        message = "there is no such folder"
        raise DataMissingError(
            message, where=str(folder), hint="run tendonrepro reproduce, or name another one"
        )
    _refuse_others(path, force=force)
    from tendonrepro.report.page import page
    from tendonrepro.report.sources import found_under

    found = found_under(folder, measured, talk)
    talk.detail("drawing figures, writing the page")
    content = sealed(page(found))
    write_atomically(path, content)
    digest = hashlib.sha256(content).hexdigest()
    head = {"schema_version": SCHEMA_VERSION, "path": str(path), "bytes": len(content), "sha256": digest}
    return head | {"parts": dict(found.origins), "inputs": dict(found.inputs)}


def sealed(text: str) -> bytes:
    """Page with its digest behind it, by which a later run knows that nobody edited it."""
    content = text.encode()
    return content + f"<!-- tendonrepro report, sha256 {hashlib.sha256(content).hexdigest()} -->\n".encode()


def _refuse_others(path: Path, *, force: bool) -> None:
    if path.is_dir():
        raise UsageError("is a folder", where=str(path), hint="name the file to write, such as report.html")
    if force or not path.exists():
        return
    try:
        content = ordinary(path, MOST_JSON).read_bytes()
    except OSError:
        content = b""
    seal = _SEAL.search(content)
    if seal is None or hashlib.sha256(content[: seal.start()]).hexdigest().encode() != seal[1]:
        message = "exists and is no report of tendonrepro, or was edited"
        raise UsageError(
            message, where=str(path), hint="choose another --out, or say --force to overwrite it"
        )


def report_text(found: dict[str, Any]) -> str:
    """What the terminal says."""
    missing = [name for name, origin in found["parts"].items() if origin == "missing"]
    ours = [name for name, origin in found["parts"].items() if origin == "shipped"]
    lines = [f"{found['path']}: {found['bytes'] / 1e6:.1f} MB, open it in a browser"]
    lines += [f"as shipped with the package: {', '.join(ours)}"] * bool(ours)
    lines += [f"not run, the page says how: {', '.join(missing)}"] * bool(missing)
    return "\n".join(lines)
