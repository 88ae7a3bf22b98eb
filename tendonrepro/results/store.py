"""Results folders: made whole or not at all, what must not be lost in them, and the manifest in each."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from importlib import metadata
from itertools import count
from pathlib import Path, PurePosixPath
from typing import TypedDict

from tendonrepro import __version__
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import Json, read_json, refuse_file, sha256_of, to_json
from tendonrepro.results.place import files_in, only_writer

MANIFEST = "manifest.json"
_DERIVED = ("traces.csv", "traces.parquet", "traces.mat", "*.gif")
_LIBRARIES = ("numpy", "scipy", "llvmlite", "h5py", "matplotlib", "pandas", "pydantic", "pyyaml", "typer")


class NewResult:
    """A result while it is made; all files below its `path` belong to it.

    `manifest` is to be set; when the result is whole it has digests of the files, too.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.manifest: Json = {}
        self._started = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Wall time since it was begun."""
        return time.perf_counter() - self._started

    def write(self, name: str, content: bytes | str) -> None:
        """Write one of its files."""
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def replaced(
    folder: Path,
    digest: str,
    *,
    command: str,
    force: bool = False,
    keep: str = "",
    update: bool = False,
    talk: Talk | None = None,
) -> Iterator[NewResult]:
    """Make a result in a fresh folder, which takes its place when the block ends well.

    Parameters
    ----------
    digest, command : str
        See `refuse_others`.
    force : bool
        Replace any results. A user's own files move over; one with the name of a new file gets another one.
    keep : str
        Folder in it that survives an interruption.
    update : bool
        Begin with a copy of the earlier result.
    talk : Talk, optional
        Says where the result is made if that is not beside its place, and where what is kept lies.

    Raises
    ------
    UsageError
        If something else would be lost, or another process writes there.
    TendonreproError
        If the folder cannot be written.
    """
    talk = talk or Talk()
    refuse_file(folder)
    try:
        if Path.cwd().is_relative_to(folder.resolve()):
            message = "is the folder you are in, and a results folder is replaced as a whole"
            raise UsageError(message, where=str(folder), hint="name a folder below it with --out")
        with only_writer(folder, last=MANIFEST, own=own_files) as place:
            if place.in_place:
                talk.note(f"{folder} cannot be renamed, so the result is written into it, the manifest last")
            with _kept_alone(place.partial, keep, talk):
                refuse_others(folder, digest, command=command, force=force)
                if update:
                    take_over(place.target, place.partial, _outputs(place.target))
                result = NewResult(place.partial)
                yield result
                made = {name: sha256_of(place.partial / name) for name in files_in(place.partial)}
                # Its traces hold the manifest without outputs, so that stays as it is.
                result.manifest = result.manifest | {"outputs": made}
                result.write(MANIFEST, to_json(result.manifest))
            for before, now in _set_aside(place.target, made):
                talk.note(f"your own {before} is now {now.name}: the result has a file of that name")
            _tell_outdated(folder, digest, command, talk)
            place.put()
    except OSError as error:
        message = f"cannot write the result: {error.strerror or error}"
        raise TendonreproError(message, where=str(folder), hint="choose another --out") from error


@contextmanager
def _kept_alone(partial: Path, keep: str, talk: Talk) -> Iterator[None]:
    """Begin, and end after a failure, with what an interruption must not lose; say where it lies."""
    _clear(partial, keep)
    try:
        yield
    except BaseException:
        _clear(partial, keep)
        if any(files_in(partial)):
            talk.note(f"what is finished is kept in {partial / keep}: the same command goes on from there")
        else:
            _clear(partial, "")
        raise


def _clear(partial: Path, keep: str) -> None:
    for path in partial.iterdir():
        if path.name != keep:
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def take_over(earlier: Path, fresh: Path, names: Iterable[str]) -> None:
    """Give an unfinished result those files of an earlier one that it does not have."""
    for name in names:
        if (earlier / name).exists() and not (fresh / name).exists():
            (fresh / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(earlier / name, fresh / name)


def own_files(folder: Path) -> list[str]:
    """Files in a results folder that its manifest does not list; all of them where that is damaged."""
    try:
        listed = {MANIFEST, *_outputs(folder)}
    except DataMissingError:
        listed = {MANIFEST}
    return [name for name in files_in(folder) if name not in listed]


def _set_aside(folder: Path, new: Iterable[str]) -> Iterator[tuple[Path, Path]]:
    """Rename a user's own files where `new` ones, or folders of them, take their names; old and new path."""
    try:
        _outputs(folder)
    except DataMissingError:
        # Whose files these are nobody can tell; most are of the damaged result.
        return
    taken = {name for path in new for name in (path, *map(str, PurePosixPath(path).parents))}
    for name in own_files(folder):
        if name in taken:
            before = folder / name
            free = (before.with_name(f"{before.name}.own{k or ''}") for k in count())
            yield before, before.rename(next(path for path in free if not os.path.lexists(path)))


def _outputs(folder: Path) -> Mapping[str, str]:
    return read_manifest(folder).get("outputs", {}) if (folder / MANIFEST).exists() else {}


def refuse_others(folder: Path, digest: str, *, command: str, force: bool = False) -> None:
    """Refuse to replace a folder that is not an earlier, unchanged result of the same, unless `force`.

    Raises
    ------
    UsageError
        If it holds results of another configuration (`digest`), command or version, files that no manifest
        lists, or changed files; hidden ones do not count. In any case if it is a file, or lies below one.
    """
    refuse_file(folder)
    if force or not folder.exists():
        return
    for path, message in _objections(folder, digest, command):
        hint = "choose another --out, or say --force: results are replaced, files of your own are kept"
        raise UsageError(message, where=str(path), hint=hint)


def _objections(folder: Path, digest: str, command: str) -> Iterator[tuple[Path, str]]:
    """What a replacement would lose: where, and why it is not this result's."""
    for message in _other_identities(folder, digest, command):
        yield folder, message
    derived = derived_files(folder)
    for name in own_files(folder):
        if not name.startswith(".") and name not in derived:
            yield folder / name, f"is not a file of this result: no {MANIFEST} lists it"
    for name, sha256 in _outputs(folder).items():
        if (folder / name).exists() and sha256_of(folder / name) != sha256:
            yield folder / name, "was changed since tendonrepro wrote it"


def _other_identities(folder: Path, digest: str, command: str) -> Iterator[str]:
    """By what the result in a folder, if there is one, is another than that of a command."""
    if not (folder / MANIFEST).exists():
        return
    manifest = read_manifest(folder)
    identities = {
        "configuration": (digest, manifest["config"]["sha256"]),
        "version": (__version__, manifest["tendonrepro_version"]),
        "command": (command, manifest.get("command", "")),
    }
    for what, (mine, theirs) in identities.items():
        if mine != theirs:
            yield f"holds results of another {what}: {theirs[:12]}, not {mine[:12]}"


def derived_files(folder: Path) -> list[str]:
    """Files that `export` and `animate` made from the traces of a result, under their usual names.

    They are the user's own, and stay. A result of the same configuration need not ask about them.
    """
    listed = _outputs(folder)
    usual = [path.name for pattern in _DERIVED for path in folder.glob(pattern) if path.is_file()]
    return sorted(name for name in usual if "traces.h5" in listed and name not in listed)


def _tell_outdated(folder: Path, digest: str, command: str, talk: Talk) -> None:
    """Name files made from traces that another result now replaces."""
    with suppress(DataMissingError):
        derived = derived_files(folder)
        if derived and any(_other_identities(folder, digest, command)):
            for name in derived:
                talk.note(f"{folder / name} was made from the result that is replaced: make it again")


def make_manifest(loaded: LoadedConfig | None, seconds: float, command: str = "", digest: str = "") -> Json:
    """How a result came about, for JSON; what is unknown is None.

    Parameters
    ----------
    loaded : LoadedConfig or None
        None where no configuration decides the result.
    seconds : float
        Wall time.
    command : str
        Its name; else that of the experiment.
    digest : str
        Of all that decides the result; else that of the configuration.
    """
    everywhere: Json = {
        "schema_version": 1,
        "tendonrepro_version": __version__,
        "command": command,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "environment": environment(),
        "config": {"sha256": digest},
    }
    if loaded is None:
        return everywhere
    config = loaded.config
    return everywhere | {
        "command": command or config.experiment,
        "experiment": config.experiment,
        "config": {"origin": loaded.origin, "sha256": digest or loaded.sha256, "tree": loaded.tree},
        "overrides": list(loaded.overrides),
        "seed": int(config.seed.si),
        "solver": {
            "name": f"scipy.integrate.ode {config.solver.method}"
            + (", its steps compiled" if config.solver.method == "dop853" else ""),
            "rtol": config.solver.rtol.si,
            "atol": config.solver.atol.si,
            "max_step_s": config.solver.max_step.si,
        },
        "wall_time_s": round(seconds, 3),
        "inputs": {str(path): sha256_of(path) for path in loaded.inputs},
    }


def read_manifest(folder: Path) -> Json:
    """Read the manifest of a results folder; a DataMissingError where it cannot be read."""
    return read_json(folder / MANIFEST, "run its command again with --force")


class GitState(TypedDict):
    """Commit of a checkout, and whether it has been changed."""

    commit: str
    dirty: bool


class Environment(TypedDict):
    """Python, machine, library versions and the state of the checkout, if this is one."""

    python: str
    platform: str
    cpu: str | None
    cpu_count: int | None
    versions: dict[str, str]
    git: GitState | None


def environment() -> Environment:
    """Python, machine, library versions and the state of the checkout, if this is one."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu": cpu_name(),
        "cpu_count": os.cpu_count(),
        "versions": {name: metadata.version(name) for name in _LIBRARIES},
        "git": git_state(),
    }


def cpu_name() -> str | None:
    """Model name of the processor."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(names), platform.processor() or None)


def git_state() -> GitState | None:
    """Commit of the checkout the package runs from, and whether it has been changed; None elsewhere."""
    folder = Path(__file__).resolve().parent

    def git(*words: str) -> str:
        command = ["git", "-C", str(folder), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        # A package installed inside some other project's checkout is not that project's.
        git("ls-files", "--error-unmatch", Path(__file__).name)
        return {"commit": git("rev-parse", "HEAD"), "dirty": bool(git("status", "--porcelain"))}
    except (OSError, subprocess.SubprocessError):
        return None
