"""The folder of one experiment's results: one writer, and nothing overwritten that another run made."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path, PurePath
from typing import Any

from filelock import FileLock, Timeout

from tendonrepro import __version__
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import (
    MOST_JSON,
    guards,
    ordinary,
    sha256_of,
    sweep_temporary,
    to_json,
    write_atomically,
    written,
)
from tendonrepro.results.manifest import with_outputs
from tendonrepro.results.records import TraceFile
from tendonrepro.results.traces import read_traces

MANIFEST = "manifest.json"
TRACES = "traces.h5"
LOCK = ".lock"
RESULTS = (TRACES, "[!.]*.json", "identified.yaml", "claims.*", "figures/**/[!.]*", "tables/**/[!.]*")
"""What commands write into a results folder."""
DRAWN = tuple(f"figures/fig[0-9][0-9].{form}" for form in ("pdf", "svg", "png"))
"""What other processes write there, so that an interrupted run does not know how far they came."""

MOST_LETTERS = 100
"""Of a name in a manifest, and of its folders: far more than ours have."""


class HeldFolder:
    """A results folder while it is written: knows its files, and ends with the manifest that lists them.

    Attributes
    ----------
    path : Path
    files : list of Path
        What the result consists of so far, without the manifest.
    lock : os.stat_result
        By which the folder is known, whatever is made in its place.
    """

    def __init__(self, path: Path, own: Sequence[str] = ()) -> None:
        self.path = path
        self._patterns = *RESULTS, *own
        self.files: list[Path] = []
        self._started = time.perf_counter()
        self.lock = (path / LOCK).stat()
        self._before: set[Path] | None = None

    @property
    def seconds(self) -> float:
        """Wall time since the folder is held."""
        return time.perf_counter() - self._started

    def clear(self) -> None:
        """Remove an earlier result, manifest first, so that no old figure stands among new ones.

        Files that its manifest does not list, or that were changed since, are left alone.

        Raises
        ------
        TendonreproError
            If someone removed the folder itself.
        """
        self._require()
        if (self.path / MANIFEST).exists():
            try:
                outputs = read_manifest(self.path).get("outputs", {})
            except DataMissingError:
                outputs = {}
            listed = [
                self.path / name for name, digest in outputs.items() if _is_whole(self.path, name, digest)
            ]
            old = [self.path / MANIFEST, *listed]
            for folder in dict.fromkeys(path.parent for path in old):
                if not os.access(folder, os.W_OK):
                    message, hint = "cannot remove the earlier result: no permission", "choose another --out"
                    raise TendonreproError(message, where=str(folder), hint=hint)
            try:
                for path in old:
                    path.unlink()
            except OSError as error:
                message = f"cannot remove the earlier result: {error.strerror}"
                raise TendonreproError(message, where=str(path), hint="choose another --out") from error
        self._before = set(found_in(self.path, self._patterns))

    def discard(self) -> None:
        """Remove what was written since `clear`: half a result is none. Files of other names are not ours."""
        ours = _is_same(self.path / LOCK, self.lock)
        if ours and self._before is not None and not (self.path / MANIFEST).exists():
            made = written.intersection(found_in(self.path, self._patterns))
            for path in {*made, *found_in(self.path, DRAWN)} - self._before:
                path.unlink(missing_ok=True)

    def write(self, name: str, content: bytes | str) -> None:
        """Write a file of the result."""
        write_atomically(self.path / name, content)
        self.files.append(self.path / name)

    def finish(self, manifest: dict[str, Any], talk: Talk) -> str:
        """Write the manifest with the digests of all files; return its path.

        Raises
        ------
        TendonreproError
            If someone removed the folder or a file of the result.
        """
        self._require()
        path = self.path / MANIFEST
        write_atomically(path, to_json(with_outputs(manifest, self.path, self.files)))
        talk.detail(f"{len(self.files)} files in {self.seconds:.1f} s")
        return str(path)

    def _require(self) -> None:
        """Stop where what is being written is taken away: a new folder would hold half a result."""
        _require_lock(self.path, self.lock)
        for path in self.files:
            if not path.exists():
                raise _removed(path)


def _require_lock(folder: Path, lock: os.stat_result) -> None:
    """Stop where a folder was removed, or is one that somebody made anew."""
    if not _is_same(folder / LOCK, lock):
        raise _removed(folder / LOCK)


@contextmanager
def guarded(folder: Path, lock: os.stat_result) -> Iterator[None]:
    """Write no file while a results folder is not the one whose lock is given; its workers do so too.

    Raises
    ------
    TendonreproError
        From whoever writes, if someone removed the folder, or made it anew.
    """
    guard = partial(_require_lock, folder, lock)
    guards.append(guard)
    try:
        yield
    finally:
        guards.remove(guard)


def _is_whole(folder: Path, name: str, digest: str) -> bool:
    """Whether a file of a folder is what its manifest lists; one behind a link is somebody's own."""
    path = folder / name
    within = path.resolve().is_relative_to(folder.resolve()) and not path.is_symlink()
    return within and path.is_file() and sha256_of(path) == digest


def _is_same(path: Path, before: os.stat_result) -> bool:
    """Whether a file is still the one that it was; another may have its name."""
    try:
        return os.path.samestat(path.stat(), before)
    except OSError:
        return False


def _removed(path: Path) -> TendonreproError:
    message = "was removed while results were written, so they are not complete"
    return TendonreproError(message, where=str(path), hint="run it again with --force")


@contextmanager
def claimed(
    folder: Path,
    config_sha256: str,
    *,
    force: bool,
    begun: str = "",
    command: str | None = None,
    own: Sequence[str] = (),
) -> Iterator[HeldFolder]:
    """Hold a results folder, made if it is missing, while writing results of one configuration into it.

    See :func:`refuse_others` for what is not overwritten without `force`.

    Raises
    ------
    UsageError
        If the folder holds what this would overwrite, or someone else is writing there.
    TendonreproError
        If the folder cannot be made.
    """
    with locked(folder):
        refuse_others(folder, config_sha256, force=force, begun=begun, command=command, own=own)
        held = HeldFolder(folder, own)
        try:
            with guarded(folder, held.lock):
                yield held
        except BaseException:
            with suppress(OSError):
                held.discard()
            raise


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Be the only process that writes into a folder, which is made if it is missing.

    Raises
    ------
    UsageError
        If another process is writing there.
    TendonreproError
        If the folder cannot be made or written.
    """
    path = folder / LOCK
    lock, made = FileLock(path), [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=0)
        mine = path.stat()
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
    except Timeout as error:
        message = "another tendonrepro is writing here"
        raise UsageError(message, where=str(folder), hint="wait for it, or choose another --out") from error
    except OSError as error:
        message = f"cannot write into the results folder: {error.strerror or error}"
        place = str(error.filename or folder)
        raise TendonreproError(message, where=place, hint="choose another --out") from error
    try:
        sweep_temporary(folder)
        yield
    finally:
        # Workers that an interrupt ended cannot clean up after themselves; nor can we without files.
        with suppress(OSError):
            sweep_temporary(folder)
        lock.release()
        # What failed before it wrote anything leaves nothing.
        with suppress(OSError):
            if made and _is_same(path, mine) and all(one == path for one in folder.iterdir()):
                path.unlink(missing_ok=True)
                for one in made:
                    one.rmdir()


def refuse_others(
    folder: Path,
    config_sha256: str,
    *,
    force: bool = False,
    begun: str = "",
    command: str | None = None,
    own: Sequence[str] = (),
) -> None:
    """Refuse a folder, which may be missing, whose files are not those of an earlier run of the same.

    Parameters
    ----------
    folder : Path
    config_sha256 : str
        Digest of what is to be written.
    force : bool
        Refuse nothing.
    begun : str
        Name of the file by which a command knows its own interrupted run.
    command : str, optional
        What stands under ``command`` in the manifests of the command that writes.
    own : sequence of str
        Patterns of what it alone writes, besides `RESULTS`.

    Raises
    ------
    UsageError
        If it holds results of another configuration, version or command, files that no manifest lists, or
        files that were changed since.
    DataMissingError
        If its manifest cannot be read.
    """
    if force:
        return
    outputs: dict[str, str] = {}
    if (folder / MANIFEST).exists():
        manifest = read_manifest(folder)
        outputs = manifest.get("outputs", {})
        made_of = manifest.get("config", {}).get("sha256"), manifest.get("tendonrepro_version")
        made_by = manifest.get("command"), manifest.get("experiment", "")
        for what, mine, theirs in (
            ("configuration", config_sha256, made_of[0]),
            ("version", __version__, made_of[1]),
            ("command", command or made_by[1], made_by[0] or made_by[1]),
        ):
            if mine != theirs:
                message = f"holds results of another {what}: {str(theirs)[:12]}, not {mine[:12]}"
                hint = "choose another --out, or say --force to overwrite them"
                raise UsageError(message, where=str(folder), hint=hint)
    refuse_foreign(folder, (*RESULTS, *own), outputs, but=(MANIFEST, begun))


def found_in(folder: Path, patterns: Sequence[str]) -> list[Path]:
    """Files in a folder by patterns."""
    return [path for pattern in patterns for path in folder.glob(pattern) if not path.is_dir()]


def refuse_foreign(
    folder: Path, patterns: Sequence[str], outputs: Mapping[str, str], but: Sequence[str] = ()
) -> None:
    """Refuse files that `outputs`, names with their digests, do not list, or that were changed since.

    Of those that are not listed only names by a pattern count, and not those of `but`.

    Raises
    ------
    UsageError
        If there is one.
    """
    found = {path.relative_to(folder).as_posix() for path in found_in(folder, patterns)}
    for name in sorted({*found, *outputs} - {*but}):
        path = folder / name
        if name not in outputs:
            message = f"no {MANIFEST} lists it: of an interrupted run, or someone's own"
        elif os.path.lexists(path) and not _is_whole(folder, name, outputs[name]):
            message = "was changed since tendonrepro wrote it"
        else:
            continue
        hint = "move it elsewhere, choose another --out, or say --force to overwrite what is there"
        raise UsageError(message, where=str(path), hint=hint)


def foretell_refusal(
    folder: Path,
    config_sha256: str,
    talk: Talk,
    *,
    force: bool,
    command: str | None = None,
    own: Sequence[str] = (),
) -> None:
    """Say what :func:`refuse_others` would refuse; a dry run writes nothing, so it goes on."""
    try:
        refuse_others(folder, config_sha256, force=force, command=command, own=own)
    except TendonreproError as error:
        talk.note(f"a run would be refused: {error}")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a results folder.

    Raises
    ------
    DataMissingError
        If there is none or it cannot be read.
    """
    path = folder / MANIFEST
    try:
        manifest = json.loads(ordinary(path, MOST_JSON).read_text(encoding="utf-8"))
        # JSON can name letters that no file can hold, and `figures` and `tables` write it back.
        to_json(manifest).encode()
    except OSError as error:
        message = f"cannot read the manifest: {error.strerror}"
        hint = "run the experiment first" if isinstance(error, FileNotFoundError) else "choose another --out"
        raise DataMissingError(message, where=str(path), hint=hint) from error
    except (ValueError, RecursionError):
        manifest = None
    sections = ("config", "outputs")
    known = isinstance(manifest, dict) and all(isinstance(manifest.get(key, {}), dict) for key in sections)
    if not known or not all(map(_is_plain, manifest.get("outputs", {}))):
        message = "is not a manifest of tendonrepro"
        raise DataMissingError(message, where=str(path), hint="run the experiment again with --force")
    return manifest  # type: ignore[no-any-return]


def stored_traces(folder: Path) -> TraceFile:
    """Read the traces of a results folder, which a manifest beside them vouches for.

    Raises
    ------
    DataMissingError
        If they or the manifest cannot be read, or are not of each other.
    """
    path = folder / TRACES
    outputs = read_manifest(folder).get("outputs", {}) if (folder / MANIFEST).exists() else {}
    if TRACES in outputs and outputs[TRACES] != sha256_of(path):
        message = "is damaged: it is not what its manifest lists"
        raise DataMissingError(message, where=str(path), hint="run the experiment again with --force")
    return read_traces(path)


def named_traces(source: Path) -> TraceFile:
    """Read the trace file that is named, or that of the results folder that is; see `stored_traces`."""
    folder = source.parent if source.name == TRACES else source
    return stored_traces(folder) if folder.is_dir() else read_traces(source)


def trace_path(source: Path) -> Path:
    """Trace file that is named, or that of the results folder that is."""
    return source / TRACES if source.is_dir() else source


def refuse_existing(path: Path, *, force: bool) -> None:
    """Raise a UsageError where a file is in the way, unless `force`."""
    if path.exists() and not force:
        message = f"{path} is there already"
        raise UsageError(message, hint="choose another name with --out, or overwrite it with --force")


def _is_plain(name: str) -> bool:
    """Whether a name read from a file is that of a file below the folder, such as ``figures/fig14.svg``."""
    parts = PurePath(name).parts
    plain = "\0" not in name and not PurePath(name).is_absolute() and ".." not in parts
    return bool(parts) and plain and max(map(len, parts)) <= MOST_LETTERS >= len(parts)
