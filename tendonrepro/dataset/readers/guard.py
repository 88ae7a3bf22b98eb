"""Files read in a process of their own, so that none can take the program down with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import TypeAlias

from tendonrepro.console import Talk
from tendonrepro.dataset.readers.filetype import kind_of
from tendonrepro.dataset.readers.read import read_file, unread
from tendonrepro.dataset.readers.signals import Source
from tendonrepro.errors import TendonreproError
from tendonrepro.parallel import end_with_parent, interrupts_held

Read: TypeAlias = Callable[[Path, str], list[Source]]

_START_SECONDS = 120.0
"""A busy machine may need long to start a process, and that is no fault of the file."""
_ADVICE = "save it again in another format, such as CSV, or split it"


@dataclass(frozen=True)
class Limits:
    """What one file may cost: time, more of it for a large one, and memory where the system can limit it.

    The memory, in bytes, is above what the process needs to start. The signals of a file may take two
    gigabytes, as much again while they are read, and again while they are handed over.
    """

    seconds: float = 120.0
    seconds_per_megabyte: float = 1.0
    memory: int = 6 * 2**30

    def of(self, path: Path) -> float:
        """Seconds that a file may take."""
        with suppress(OSError):
            return self.seconds + self.seconds_per_megabyte * path.stat().st_size / 1e6
        return self.seconds


def read_guarded(
    files: Sequence[tuple[Path, str]], talk: Talk, limits: Limits | None = None, read: Read = read_file
) -> list[Source]:
    """Read files one after the other in a process that may crash, hang or run out of memory.

    A script that calls this must do so below ``if __name__ == "__main__":``, because the process that reads
    imports it anew.

    Parameters
    ----------
    files : sequence of (Path, str)
        Files and the names a user knows them by.
    talk : Talk
        Shows a progress bar.
    limits : Limits, optional
    read : callable, optional
        Reader, a function of a module.

    Returns
    -------
    list of Source
        In the order of the files; those that were given up say so in `skipped`.

    Raises
    ------
    TendonreproError
        When the process cannot be started.
    """
    sources: list[Source] = []
    with (
        talk.bar("reading", len(files)) as advance,
        tempfile.TemporaryDirectory(prefix="tendonrepro-", ignore_cleanup_errors=True) as folder,
        _Reader(limits or Limits(), read, folder) as reader,
    ):
        for path, name in files:
            sources += reader.sources(path, name)
            advance(1)
    return sources


class _Reader:
    """The process that reads; replaced when it has to be ended."""

    def __init__(self, limits: Limits, read: Read, folder: str) -> None:
        self.limits, self.read, self.folder = limits, read, folder
        self.process: multiprocessing.process.BaseProcess | None = None
        self.connection: Connection | None = None

    def __enter__(self) -> _Reader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def sources(self, path: Path, name: str) -> list[Source]:
        """What is in a file, or why that cannot be told."""
        connection = self.connection or self._start()
        seconds = self.limits.of(path)
        try:
            connection.send((path.absolute(), name))
            if connection.poll(seconds):
                answer: list[Source] | str = connection.recv()
                if not isinstance(answer, str):
                    return answer
                reason = answer
            else:
                reason = f"reading it took longer than {seconds:.0f} s"
        except (EOFError, OSError):
            reason = "its reader crashed, perhaps for want of memory"
        self._end()
        kind = "unknown"
        with suppress(OSError):
            kind = str(kind_of(path))
        return [unread(path, name, reason, _ADVICE, kind)]

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(
            target=_serve, args=(theirs, self.read, self.limits.memory, self.folder), daemon=True
        )
        with interrupts_held():
            self.process.start()
        # The end of the pipe is noticed only when nobody else holds it open.
        theirs.close()
        try:
            started = self.connection.poll(_START_SECONDS) and self.connection.recv()
        except (EOFError, OSError):
            started = False
        if not started:
            message = "the process that reads files did not start"
            hint = 'in a script, call it below: if __name__ == "__main__":'
            raise TendonreproError(message, hint=hint)
        return self.connection

    def _end(self) -> None:
        # One that the system refused to start has no number.
        if self.process is not None and self.process.pid is not None:
            self.process.kill()
            self.process.join()
            self.process.close()
        if self.connection is not None:
            self.connection.close()
        self.process = self.connection = None


def _serve(connection: Connection, read: Read, memory: int, folder: str) -> None:
    """Read what is asked for until the pipe closes; the body of the process."""
    # Only the first process acts on an interrupt; this one ends with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    _hush()
    _bound(memory)
    # Members of archives are unpacked where the first process cleans up, whatever happens here.
    tempfile.tempdir = folder
    connection.send(True)
    with suppress(EOFError, OSError):
        while True:
            path, name = connection.recv()
            try:
                connection.send(read(path, name))
            except MemoryError:
                connection.send("reading it needed too much memory")


def _hush() -> None:
    """Send what libraries print past Python's own streams nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    os.close(nowhere)


def _bound(memory: int) -> None:
    """Limit memory where the system can; a crash leaves no dump of it behind."""
    try:
        import resource
    except ImportError:  # Windows
        return
    # What the process holds already is told only on Linux, and a limit without it would end the process.
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * os.sysconf("SC_PAGE_SIZE") + memory
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
