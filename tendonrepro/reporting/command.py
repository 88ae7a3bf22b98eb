"""What ``tendonrepro report`` does: read what there is, and write one page of it."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import write_atomically

SCHEMA_VERSION = 1
NAME = "report.html"
_MARK = b'<meta name="generator" content="tendonrepro'
"""What every page has near its beginning."""


def run_report(folder: Path, out: Path | None, talk: Talk, *, force: bool) -> dict[str, Any]:
    """Write the page of a results folder.

    An earlier page is replaced, any other file is not.

    Parameters
    ----------
    folder : Path
        Folder above the results: ``decouple``, ``compare``, ... where they exist.
    out : Path or None
        File to write; None is ``report.html`` in that folder.
    talk : Talk
    force : bool
        Replace whatever is there.

    Returns
    -------
    dict
        What ``--json`` prints: ``path``, ``bytes``, ``sha256``, and where each part comes from.

    Raises
    ------
    UsageError
        If a file that is no report is in the way.
    DataMissingError
        If there is no such folder, or something in it is damaged.
    """
    path = folder / NAME if out is None else out
    if not folder.is_dir():
        message = "there is no such folder"
        hint = "run tendonrepro reproduce, or name another one"
        raise DataMissingError(message, where=str(folder), hint=hint)
    if path.is_dir():
        raise UsageError("is a folder", where=str(path), hint="name the file to write, such as report.html")
    if path.exists() and not force and _MARK not in path.read_bytes()[:1000]:
        message = "exists and is no report of tendonrepro"
        raise UsageError(message, where=str(path), hint="choose another --out, or say --force")
    from tendonrepro.reporting.page import page
    from tendonrepro.reporting.stored import stored_under

    found = stored_under(folder)
    talk.detail("writing the page")
    content = page(found).encode()
    write_atomically(path, content)
    digest = hashlib.sha256(content).hexdigest()
    head = {"schema_version": SCHEMA_VERSION, "path": str(path), "bytes": len(content), "sha256": digest}
    return head | {"parts": found.origins, "inputs": found.inputs}


def report_text(found: dict[str, Any]) -> str:
    """What the terminal says."""
    missing = [name for name, origin in found["parts"].items() if origin == "missing"]
    ours = [name for name, origin in found["parts"].items() if origin == "shipped"]
    lines = [f"{found['path']}: {found['bytes'] / 1e6:.1f} MB, open it in a browser"]
    lines += [f"as shipped with the package: {', '.join(ours)}"] * bool(ours)
    lines += [f"not run, the page says how: {', '.join(missing)}"] * bool(missing)
    return "\n".join(lines)
