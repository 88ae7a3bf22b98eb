"""Files read in a process of their own, so that none can take the program down with it.

Signals come over one by one as they are read: what was read before a file was given up is a result, and
this process never holds more than what it keeps.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, TypeAlias

from tendonrepro.console import Talk
from tendonrepro.dataset.readers.archive import UNPACK
from tendonrepro.dataset.readers.filetype import kind_of
from tendonrepro.dataset.readers.read import read_bit_by_bit, unread
from tendonrepro.dataset.readers.signals import MOST_NUMBERS, Allowance, Skipped, Source
from tendonrepro.errors import TendonreproError
from tendonrepro.parallel import end_with_parent, interrupts_held

Read: TypeAlias = Callable[[Path, str, Allowance], Iterable[Source]]

_START_SECONDS = 120.0
"""A busy machine may need long to start a process, and that is no fault of the file."""
_ADVICE = "save it again in another format, such as CSV, or split it"
_NO_MEMORY = "reading it needed too much memory"
_PIECE = 2**24
"""Bytes handed over at once."""


@dataclass(frozen=True)
class Limits:
    """What one file may cost: time, more of it for a large one, and memory where the system can limit it.

    The memory, in bytes, is above what the process needs to start. The signals of a file may take one
    gigabyte, and up to three times as much while they are read.
    """

    seconds: float = 120.0
    seconds_per_megabyte: float = 1.0
    memory: int = 4 * 2**30

    def of(self, path: Path) -> float:
        """Seconds that a file may take."""
        with suppress(OSError):
            return self.seconds + self.seconds_per_megabyte * path.stat().st_size / 1e6
        return self.seconds


def read_guarded(
    files: Sequence[tuple[Path, str]], talk: Talk, limits: Limits | None = None, read: Read = read_bit_by_bit
) -> list[Source]:
    """Read files, each with the name a user knows it by, one after the other in a process of their own.

    It may crash, hang or run out of memory: files that were given up say so in `skipped`. Together the
    sources hold no more than an `Allowance`. The process that reads imports a script that calls this anew, so
    it must do so below ``if __name__ == "__main__":``; a TendonreproError when it cannot be started.
    """
    sources: list[Source] = []
    with (
        talk.bar("reading", len(files)) as advance,
        _Reader(limits or Limits(), read) as reader,
    ):
        for path, name in files:
            sources += reader.sources(path, name)
            advance(1)
    return sources


class _Reader:
    """The process that reads; replaced when it has to be ended."""

    def __init__(self, limits: Limits, read: Read) -> None:
        self.limits, self.read, self.left = limits, read, Allowance(numbers=_room())
        self.folder: tempfile.TemporaryDirectory[str] | None = None
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
        end = time.monotonic() + seconds
        found: dict[str, Source] = {}
        try:
            connection.send((path.absolute(), name, self.left))
            while connection.poll(max(0.0, end - time.monotonic())):
                answer = _received(connection)
                if answer is None:
                    return list(found.values())
                if isinstance(answer, str):
                    reason = answer
                    break
                source, self.left = answer
                found[source.name] = source
            else:
                reason = f"reading it took longer than {seconds:.0f} s"
        except (EOFError, OSError):
            reason = "its reader crashed, perhaps for want of memory"
        except MemoryError:
            reason = _NO_MEMORY
        self._end()
        return _given_up(path, name, reason, list(found.values()))

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.folder = tempfile.TemporaryDirectory(prefix="tendonrepro-", ignore_cleanup_errors=True)
        self.process = context.Process(
            target=_serve, args=(theirs, self.read, self.limits.memory, self.folder.name), daemon=True
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
        # What was being unpacked when it was ended.
        if self.folder is not None:
            self.folder.cleanup()
        self.process = self.connection = self.folder = None


def _given_up(path: Path, name: str, reason: str, found: Sequence[Source]) -> list[Source]:
    """What was read of a file until its reader was ended, and why it was."""
    if found:
        whole, *inside = found
        reason += f", after {len(inside)} of its files; the others were not read"
        return [replace(whole, skipped=(*whole.skipped, Skipped("", reason, UNPACK))), *inside]
    kind = "unknown"
    with suppress(OSError):
        kind = str(kind_of(path))
    return [unread(path, name, reason, _ADVICE, kind)]


def _sent(connection: Connection, answer: object) -> None:
    """Hand something over; arrays go in pieces, so that neither side needs a copy of them."""
    buffers: list[pickle.PickleBuffer] = []
    connection.send_bytes(pickle.dumps(answer, 5, buffer_callback=buffers.append))
    views = [buffer.raw() for buffer in buffers]
    connection.send([len(view) for view in views])
    for view in views:
        for start in range(0, len(view), _PIECE):
            connection.send_bytes(view[start : start + _PIECE])


def _received(connection: Connection) -> Any:
    head = connection.recv_bytes()
    buffers = [bytearray(size) for size in connection.recv()]
    for buffer in buffers:
        for start in range(0, len(buffer), _PIECE):
            connection.recv_bytes_into(buffer, start)
    return pickle.loads(head, buffers=buffers)


def _room() -> int:
    """Bytes of numbers to keep; where this process is limited itself, a quarter of that."""
    with suppress(ImportError):  # Windows
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            return min(MOST_NUMBERS, limit // 4)
    return MOST_NUMBERS


def _serve(connection: Connection, read: Read, memory: int, folder: str) -> None:
    """Read what is asked for until the pipe closes; the body of the process."""
    # Only the first process acts on an interrupt; this one ends with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Members of archives are unpacked where the first process cleans up, and this one where that was killed.
    end_with_parent(leaving=lambda: shutil.rmtree(folder, ignore_errors=True))
    _hush()
    _bound(memory)
    tempfile.tempdir = folder
    connection.send(True)
    with suppress(EOFError, OSError):
        while True:
            path, name, left = connection.recv()
            try:
                for source in read(path, name, left):
                    _sent(connection, (source, left))
                _sent(connection, None)
            except MemoryError:
                _sent(connection, _NO_MEMORY)


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
