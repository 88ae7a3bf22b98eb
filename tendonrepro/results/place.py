"""Where a result is made, and how it takes its place: by one process at a time, whatever cuts it off.

A result is made in the hidden folder ``.NAME.partial`` beside its place. Then the old folder becomes
``.NAME.old``, the new one takes its place, a user's own files move over, and the rest of the old one goes.

A mount point, a folder of an image's layer and one below a folder that is not writable cannot be renamed.
There a result is made in the hidden folder ``.tendonrepro.partial`` inside, and its files take their places,
the manifest last.

The lock lies beside the folder, and inside too where that cannot be renamed: other containers may see it by
another path.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from tendonrepro.errors import UsageError
from tendonrepro.parallel import interrupts_blocked

_LOCK = ".tendonrepro.lock"
_PARTIAL = ".tendonrepro.partial"
"""Names in a folder that cannot be renamed."""


@dataclass(frozen=True)
class ResultPlace:
    """The place of a result, which this process alone writes.

    Parameters
    ----------
    target : Path
        Results folder, without links.
    partial : Path
        Hidden folder in which the result is made.
    last : str
        File of a result without which it is not complete.
    own : callable
        Names of those files in a results folder that are the user's.
    """

    target: Path
    partial: Path
    last: str
    own: Callable[[Path], Iterable[str]]

    @property
    def in_place(self) -> bool:
        """Whether the folder itself stays, since it cannot be renamed."""
        return self.partial.parent == self.target

    def put(self) -> None:
        """Let the complete result take its place; a user's own files stay."""
        if self.in_place:
            self._move_files()
            return
        with interrupts_blocked():
            aside = _beside(self.target, "old")
            if self.target.exists():
                _keep_access(self.target, self.partial)
                self.target.rename(aside)
            try:
                self.partial.rename(self.target)
            except OSError:
                if aside.exists():
                    aside.rename(self.target)
                raise
        self.settle()

    def settle(self) -> None:
        """Go on, or back, with what a cut off `put` left."""
        if self.in_place:
            if (self.partial / self.last).exists():
                self._move_files()
            return
        aside = _beside(self.target, "old")
        if not aside.exists():
            return
        if not self.target.exists():
            aside.rename(self.target)
            return
        for name in (*self.own(aside), *_empty_folders(aside)):
            new = self.target / name
            if not os.path.lexists(new):
                new.parent.mkdir(parents=True, exist_ok=True)
                (aside / name).rename(new)
        # Half removed, it would look like a user's own files; in there the next command removes the rest.
        rest = self.partial / "old"
        shutil.rmtree(rest, ignore_errors=True)
        self.partial.mkdir(exist_ok=True)
        aside.rename(rest)
        shutil.rmtree(rest, ignore_errors=True)

    def _move_files(self) -> None:
        new, own = files_in(self.partial), {*self.own(self.target)}
        for name in files_in(self.target):
            if name not in {self.last, *new, *own}:
                (self.target / name).unlink()
        (self.target / self.last).unlink(missing_ok=True)
        for name in sorted(new, key=lambda name: name == self.last):
            (self.target / name).parent.mkdir(parents=True, exist_ok=True)
            (self.partial / name).replace(self.target / name)
        shutil.rmtree(self.partial)


@contextmanager
def only_writer(folder: Path, *, last: str, own: Callable[[Path], Iterable[str]]) -> Iterator[ResultPlace]:
    """Be the only process that writes a results folder, until the block ends; see `ResultPlace`.

    Raises
    ------
    UsageError
        If another process writes there.
    OSError
        If the folder cannot be written.
    """
    target = folder.resolve()
    place = ResultPlace(target, _beside(target, "partial"), last, own)
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
    with ExitStack() as stack:
        target.parent.mkdir(parents=True, exist_ok=True)
        moves = os.access(target.parent, os.W_OK) or not target.exists()
        if moves:
            stack.enter_context(locked(_beside(target, "lock"), folder))
            place.settle()
            moves = _can_be_renamed(target)
        if not moves:
            place = ResultPlace(target, target / _PARTIAL, last, own)
            stack.enter_context(locked(target / _LOCK, folder))
            place.settle()
        place.partial.mkdir(exist_ok=True)
        if target.exists() and moves:
            # Files that are made in it get its group and its access lists.
            _keep_access(target, place.partial)
            shutil.copystat(target, place.partial)
        try:
            yield place
        finally:
            if place.partial.exists() and not any(place.partial.iterdir()):
                place.partial.rmdir()


def files_in(folder: Path) -> list[str]:
    """Files and links in a folder and below, without what a process that writes there leaves."""
    paths = sorted(path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    names = [path.relative_to(folder).as_posix() for path in paths]
    return [name for name in names if name != _LOCK and not name.startswith(f"{_PARTIAL}/")]


def _empty_folders(folder: Path) -> list[str]:
    """Folders without anything in them: no result has one, so a user made them."""
    paths = sorted(path for path in folder.rglob("*") if path.is_dir() and not path.is_symlink())
    return [path.relative_to(folder).as_posix() for path in paths if not any(path.iterdir())]


def _beside(target: Path, what: str) -> Path:
    return target.with_name(f".{target.name}.{what}")


def _can_be_renamed(target: Path) -> bool:
    """Try it: only the system knows all of its reasons against."""
    if not target.exists():
        return True
    aside = _beside(target, "old")
    with interrupts_blocked():
        try:
            target.rename(aside)
        except OSError:
            return False
        aside.rename(target)
    return True


def _keep_access(old: Path, new: Path) -> None:
    """Give a folder, and those in it, the groups and permissions of earlier ones."""
    for folder in (new, *(path for path in new.rglob("*") if path.is_dir())):
        before = old / folder.relative_to(new)
        if before.is_dir() and os.name == "posix":
            with suppress(PermissionError):
                os.chown(folder, -1, before.stat().st_gid)
            folder.chmod(before.stat().st_mode & 0o7777)


@contextmanager
def locked(path: Path, folder: Path) -> Iterator[None]:
    """Hold a lock file while the block writes into a folder.

    Raises
    ------
    UsageError
        If another process holds it.
    OSError
        If it cannot be made.
    """
    lock = FileLock(path)
    try:
        try:
            lock.acquire(timeout=0)
        except Timeout:
            if path.exists():
                raise
            # Whoever held it is just gone, or no file can be made here, which this says by its OSError.
            path.touch()
            lock.acquire(timeout=0)
    except Timeout as error:
        message = "another tendonrepro is writing here"
        raise UsageError(message, where=str(folder), hint="wait for it, or choose another --out") from error
    try:
        yield
    finally:
        # While it is held: after that it may be another's. Windows removes no open file.
        if os.name == "posix":
            path.unlink(missing_ok=True)
        lock.release()
