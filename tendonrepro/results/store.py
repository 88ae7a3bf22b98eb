"""Results folders: how a result takes its place in one, what must not be lost there, and what it holds.

A result is made in the hidden folder ``.partial`` inside its own. Then its files take their places, the
manifest last: a folder without one is no result. Where that is cut off, the next command goes on with it.
Files that no manifest lists are a user's own, and stay.
"""

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

from tendonrepro import __version__
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import Json, locked, read_json, refuse_file, sha256_of, to_json, write_atomically
from tendonrepro.parallel import interrupts_blocked
from tendonrepro.results.traces import TRACES

MANIFEST = "manifest.json"
PARTIAL = ".partial"
"""Folder in a results folder in which the next result is made."""

_LOCK = ".lock"
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
        path.write_bytes(content.encode(errors="backslashreplace") if isinstance(content, str) else content)


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
    """Make a result, whose files take their places when the block ends well.

    Parameters
    ----------
    digest, command : str
        See `refuse_others`.
    force : bool
        Replace any results. A user's own file with the name of a new one gets another one.
    keep : str
        Folder in it that survives an interruption.
    update : bool
        Files of the earlier result stay, unless they are made again.
    talk : Talk, optional
        Says where what is kept lies, and which own file has another name.

    Raises
    ------
    UsageError
        If something else would be lost, or another process writes there.
    TendonreproError
        If the folder cannot be written.
    """
    talk, partial, is_new = talk or Talk(), folder / PARTIAL, not folder.exists()
    refuse_file(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder / _LOCK, folder):
            _settle(folder)
            partial.mkdir(exist_ok=True)
            _clear(partial, keep)
            try:
                refuse_others(folder, digest, command=command, force=force)
                result = NewResult(partial)
                yield result
                _complete(folder, result, update=update, talk=talk)
            except BaseException as error:
                # The same command would be refused again.
                _leave(partial, keep, Talk(quiet=True) if isinstance(error, UsageError) else talk)
                raise
            _settle(folder)
    except OSError as error:
        place = Path(error.filename) if isinstance(error.filename, str) else folder
        hint = "choose another --out" if place.is_relative_to(folder) else None
        message = f"cannot be read or written: {error.strerror or error}"
        raise TendonreproError(message, where=str(place), hint=hint) from error
    finally:
        if is_new:
            with suppress(OSError):
                folder.rmdir()


def _leave(partial: Path, keep: str, talk: Talk) -> None:
    """Keep of what failed what must not be lost, and say where it lies."""
    _clear(partial, keep)
    if files_in(partial):
        talk.note(f"what is finished is kept in {partial / keep}: the same command goes on from there")
    else:
        shutil.rmtree(partial)


def _clear(partial: Path, keep: str) -> None:
    for path in partial.iterdir():
        if path.name != keep:
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def _complete(folder: Path, result: NewResult, *, update: bool, talk: Talk) -> None:
    """Write the manifest, with digests; own files make room for those of the result."""
    made = {name: sha256_of(result.path / name) for name in files_in(result.path)}
    names = {*made, *(str(above) for name in made for above in PurePosixPath(name).parents)}
    for own in names.intersection(own_files(folder)):
        free = (f"{own}.own{number or ''}" for number in count())
        now = next(name for name in free if not os.path.lexists(folder / name))
        (folder / own).rename(folder / now)
        talk.note(f"your own {folder / own} is now {Path(now).name}: the result has a file of that name")
    if update:
        stay = [name for name in outputs(folder) if name not in made and (folder / name).exists()]
        made |= {name: sha256_of(folder / name) for name in stay}
    # Its traces hold the manifest without outputs, so that stays as it is.
    result.manifest = result.manifest | {"outputs": made}
    write_atomically(result.path / MANIFEST, to_json(result.manifest))


def _settle(folder: Path) -> None:
    """Let the files of a result that is whole take their places; also go on where that was cut off."""
    partial = folder / PARTIAL
    if not (partial / MANIFEST).exists():
        return
    with interrupts_blocked():
        for name in outputs(folder).keys() - outputs(partial).keys():
            (folder / name).unlink(missing_ok=True)
        (folder / MANIFEST).unlink(missing_ok=True)
        for name in (*files_in(partial), MANIFEST):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (partial / name).replace(folder / name)
        shutil.rmtree(partial)


def files_in(folder: Path) -> list[str]:
    """Files and links in a folder and below, without the manifest, and without what is being made there."""
    paths = sorted(path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    names = [path.relative_to(folder).as_posix() for path in paths]
    return [name for name in names if name not in {MANIFEST, _LOCK} and not name.startswith(f"{PARTIAL}/")]


def take_over(earlier: Path, fresh: Path, names: Iterable[str]) -> None:
    """Give an unfinished result those files of an earlier one that it does not have."""
    for name in names:
        if (earlier / name).exists() and not (fresh / name).exists():
            (fresh / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(earlier / name, fresh / name)


def outputs(folder: Path) -> Mapping[str, str]:
    """Digests of the files that the manifest of a folder lists, by name; none where there is no sound one."""
    with suppress(DataMissingError):
        listed: Mapping[str, str] = read_manifest(folder).get("outputs", {})
        return listed
    return {}


def own_files(folder: Path) -> list[str]:
    """Files in a results folder that its manifest does not list; none where that is damaged."""
    if not (folder / MANIFEST).exists():
        return files_in(folder)
    try:
        listed = read_manifest(folder).get("outputs", {})
    except DataMissingError:
        return []
    return [name for name in files_in(folder) if name not in listed]


def refuse_others(folder: Path, digest: str, *, command: str, force: bool = False) -> None:
    """Refuse to replace a folder that is not an earlier, unchanged result of the same, unless `force`.

    Raises
    ------
    UsageError
        If it holds results of another configuration (`digest`), command or version, or files of a result that
        were changed; or other files, and no result. Hidden ones do not count. In any case if it is a file, or
        lies below one.
    """
    refuse_file(folder)
    if force or not folder.exists():
        return
    for path, message in _objections(folder, digest, command):
        hint = "choose another --out, or say --force: results are replaced, files of your own are kept"
        raise UsageError(message, where=str(path), hint=hint)


def _objections(folder: Path, digest: str, command: str) -> Iterator[tuple[Path, str]]:
    """What a replacement would lose: where, and why it is not this result's."""
    if not (folder / MANIFEST).exists():
        for name in own_files(folder):
            if not name.startswith("."):
                yield folder / name, f"is not a file of a result: there is no {MANIFEST}"
        return
    manifest = read_manifest(folder)
    # What a study on plants is known by has the code of plants in it.
    known_by = "configuration or build" if "ensemble_sha256" in manifest["config"] else "configuration"
    identities = {
        known_by: (digest, manifest["config"]["sha256"]),
        "version": (__version__, manifest["tendonrepro_version"]),
        "command": (command, manifest.get("command", "")),
    }
    for what, (mine, theirs) in identities.items():
        if mine != theirs:
            yield folder, f"holds results of another {what}: {theirs[:12]}, not {mine[:12]}"
    for name, sha256 in outputs(folder).items():
        if (folder / name).exists() and sha256_of(folder / name) != sha256:
            yield folder / name, "was changed since tendonrepro wrote it"


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
    """Read the manifest of the result of any command.

    Raises
    ------
    DataMissingError
        When the folder holds none, or it is damaged.
    """
    if not (folder / MANIFEST).is_file():
        message = f"holds no result: there is neither {MANIFEST} nor {TRACES}"
        hint = "name the folder of one result, such as reports/compare, or run a command first"
        raise DataMissingError(message, where=str(folder), hint=hint)
    return read_json(folder / MANIFEST, "run its command again with --force")


def numbers_in(folder: Path, manifest: Json) -> Json:
    """Numbers of a result by the keys of ``--json``; none of an experiment, whose follow from its traces."""
    command = str(manifest.get("command", ""))
    # An ensemble calls its numbers a summary.
    numbers = [path for path in (folder / f"{command}.json", folder / "summary.json") if path.is_file()]
    data = read_json(numbers[0], "run its command again") if numbers else {}
    return _upgraded(data) if command == "ensemble" else data


def _upgraded(summary: Json) -> Json:
    """Numbers of an ensemble by the keys of today: version 1 had its first population twice."""
    if summary.get("schema_version") != 1:
        return summary
    (first, *_) = summary["populations"].values()
    return {key: value for key, value in summary.items() if key not in first} | {"schema_version": 2}


def table_files(folder: Path, manifest: Json, ending: str) -> list[Path]:
    """Files of the tables that a command wrote, ``.csv``, ``.md`` or ``.tex``; a user's own are none."""
    outputs = {Path(name) for name in manifest.get("outputs", {})}
    tables = [name for name in outputs if {name.with_suffix(".csv"), name.with_suffix(".md")} <= outputs]
    paths = (folder / name for name in tables if name.suffix == ending)
    return sorted(path for path in paths if path.is_file())


def environment() -> Json:
    """Python, machine, library versions and the state of the checkout, if this is one, for JSON."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu": cpu_name(),
        "cpu_count": os.cpu_count(),
        "versions": {name: metadata.version(name) for name in _LIBRARIES},
        "git": _git_state(),
    }


def cpu_name() -> str | None:
    """Model name of the processor."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(names), platform.processor() or None)


def _git_state() -> Json | None:
    """``commit`` of the checkout the package runs from, and whether it is ``dirty``; None elsewhere."""
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
