"""What a terminal shows of a fetch."""

from __future__ import annotations

from typing import Any


def fetch_text(found: dict[str, Any]) -> str:
    """Say what was fetched.

    Parameters
    ----------
    found : dict
        Of `fetch.run_fetch`.

    Returns
    -------
    str
        Title, version, licence, and a table of the files.
    """
    head = [
        f"{found['title'] or 'record'} ({found['doi'] or found['record']})",
        f"version {found['version'] or 'not given'}, licence {found['licence'] or 'not given'}",
    ]
    width = max(len(file["path"]) for file in found["files"])
    table = [
        f"  {file['path']:<{width}}  {readable(file['size']):>9}  {file['action']}" for file in found["files"]
    ]
    total = readable(sum(file["size"] for file in found["files"]))
    compared = "compared with the record" if found["verified"] else "NOT compared with the record"
    foot = f"{len(table)} files, {total}, in {found['out']}, {compared}"
    return "\n".join([*head, *table, "nothing written (--dry-run)" if found["dry_run"] else foot])


def readable(size: int) -> str:
    """A number of bytes for people.

    Examples
    --------
    >>> readable(1_234_567)
    '1.2 MB'
    """
    amount, unit = float(size), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if amount < 1000.0:
            break
        amount, unit = amount / 1000.0, larger
    return f"{amount:.0f} {unit}" if unit == "B" else f"{amount:.1f} {unit}"
