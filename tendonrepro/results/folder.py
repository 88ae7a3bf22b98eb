"""The folder of one experiment's results: one writer, and nothing overwritten that another run made."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from tendonrepro import __version__
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import sha256_of

MANIFEST = "manifest.json"
TRACES = "traces.h5"


@contextmanager
def claimed(folder: Path, config_sha256: str, *, force: bool) -> Iterator[None]:
    """Hold a results folder while writing into it.

    Parameters
    ----------
    folder : Path
        Made if it is missing.
    config_sha256 : str
        Digest of the configuration whose results are to be written.
    force : bool
        Overwrite results of another configuration or version.

    Raises
    ------
    UsageError
        If the folder holds results of another configuration or version, or someone else is writing there.
    TendonreproError
        If the folder cannot be made.
    """
    with locked(folder):
        if not force:
            refuse_others(folder, config_sha256)
        yield


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Be the only process that writes into a folder.

    Parameters
    ----------
    folder : Path
        Made if it is missing.

    Raises
    ------
    UsageError
        If another process is writing there.
    TendonreproError
        If the folder cannot be made or written.
    """
    lock = FileLock(folder / ".lock")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=0)
    except Timeout as error:
        message = "another tendonrepro is writing here"
        raise UsageError(message, where=str(folder), hint="wait for it, or choose another --out") from error
    except OSError as error:
        message = f"cannot write into the results folder: {error.strerror or error}"
        raise TendonreproError(message, where=str(folder), hint="choose another --out") from error
    try:
        yield
    finally:
        lock.release()


def refuse_others(folder: Path, config_sha256: str) -> None:
    """Refuse a folder that holds results of another configuration or version.

    Parameters
    ----------
    folder : Path
        May be missing.
    config_sha256 : str
        Digest of the configuration whose results are to be written.

    Raises
    ------
    UsageError
        If it does.
    DataMissingError
        If its manifest cannot be read.
    """
    hint = "choose another --out, or say --force to overwrite them"
    if not (folder / MANIFEST).exists():
        if (folder / TRACES).exists():
            message = f"holds {TRACES} without a {MANIFEST}, perhaps of an interrupted run"
            raise UsageError(message, where=str(folder), hint=hint)
        return
    manifest = read_manifest(folder)
    found = manifest.get("config", {}).get("sha256"), manifest.get("tendonrepro_version")
    for what, mine, theirs in zip(
        ("configuration", "version"), (config_sha256, __version__), found, strict=True
    ):
        if mine != theirs:
            message = f"holds results of another {what}: {_short(theirs)}, not {_short(mine)}"
            raise UsageError(message, where=str(folder), hint=hint)


def _short(identity: object) -> str:
    return str(identity)[:12]


def clear(folder: Path) -> None:
    """Remove an earlier result, manifest first, so that no old figure stands among new ones.

    Parameters
    ----------
    folder : Path
        Held by :func:`claimed`. Files that no manifest lists, or that were changed since, are left alone.
    """
    if not (folder / MANIFEST).exists():
        return
    try:
        outputs = read_manifest(folder).get("outputs", {})
    except DataMissingError:
        outputs = {}
    try:
        (folder / MANIFEST).unlink()
    except OSError as error:
        message = f"cannot remove the earlier result: {error.strerror}"
        raise TendonreproError(message, where=str(folder / MANIFEST)) from error
    for name, digest in outputs.items():
        path = folder / name
        if path.is_file() and sha256_of(path) == digest:
            path.unlink()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a results folder.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    dict

    Raises
    ------
    DataMissingError
        If there is none or it cannot be read.
    """
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        message = f"cannot read the manifest: {error.strerror}"
        raise DataMissingError(message, where=str(path), hint="run the experiment first") from error
    except ValueError as error:
        message = "is not a manifest of tendonrepro"
        raise DataMissingError(
            message, where=str(path), hint="run the experiment again with --force"
        ) from error
    sections = ("config", "outputs")
    if not isinstance(manifest, dict) or any(not isinstance(manifest.get(key, {}), dict) for key in sections):
        message = "is not a manifest of tendonrepro"
        raise DataMissingError(message, where=str(path), hint="run the experiment again with --force")
    return manifest
