"""What ``tendonrepro report`` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import write_atomically

_MARK = b'<meta name="generator" content="tendonrepro'
"""What every page has near its beginning."""


def run_report(folder: Path, out: Path | None, *, force: bool) -> dict[str, Any]:
    """Write the page of the folder above the results; return what ``--json`` prints.

    It replaces an earlier page; any other file with `force` alone.

    Raises
    ------
    UsageError
        If a file that is no report is in the way.
    DataMissingError
        If there is no such folder, or something in it is damaged.
    """
    path = out or folder / "report.html"
    if not folder.is_dir():
        raise DataMissingError("no such folder", where=str(folder), hint="run tendonrepro reproduce first")
    if path.is_dir():
        raise UsageError("is a folder", where=str(path), hint="name the file to write, such as report.html")
    if path.exists() and not force and _MARK not in path.read_bytes()[:1000]:
        raise UsageError("exists and is no report", where=str(path), hint="choose another --out, or --force")
    from tendonrepro.reporting.page import page
    from tendonrepro.reporting.stored import stored_under

    found = stored_under(folder)
    content = page(found).encode()
    write_atomically(path, content)
    return {"schema_version": 1, "path": str(path), "bytes": len(content), "parts": found.origins}


def report_text(found: dict[str, Any]) -> str:
    """What the terminal says."""
    lines = [f"{found['path']}: {found['bytes'] / 1e6:.1f} MB, open it in a browser"]
    told = {"shipped": "as shipped with the package", "missing": "not run, the page says how"}
    for origin, words in told.items():
        names = [name for name, whence in found["parts"].items() if whence == origin]
        lines += [f"{words}: {', '.join(names)}"] if names else []
    return "\n".join(lines)
