"""Independent pieces of work on all processors."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager, suppress
from queue import Empty
from typing import Any, TypeAlias, TypeVar

from tendonrepro.errors import TendonreproError

Item = TypeVar("Item")
Result = TypeVar("Result")

Start: TypeAlias = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Begins to apply a function to items, and yields the results in order."""

MOST_WORKERS = 4
"""Each worker needs some 150 MB; the paper's experiments have four runs."""

LOOK_SECONDS = 1.0
"""How often a worker looks whether the process that started it is still there."""


@contextmanager
def workers(most: int = MOST_WORKERS) -> Iterator[Start]:
    """Keep processes for a block of work, `most` of them, while there are processors.

    Yields
    ------
    callable
        Begins to apply a function to items, and yields the results in order. Where there is one process,
        this one, it works when a result is asked for.

    Raises
    ------
    TendonreproError
        If a worker process dies.
    """
    jobs = min(most, os.cpu_count() or 1)
    if jobs < 2:
        yield map
        return
    with _processes(jobs) as executor:

        def start(function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
            begun = [executor.submit(function, item) for item in items]
            return (one.result() for one in begun)

        yield start


def counted(results: Iterable[Result], progress: Callable[[int], None]) -> Iterator[Result]:
    """Yield results, and call `progress` with 1 after each."""
    for result in results:
        progress(1)
        yield result


def as_ready(
    function: Callable[[Item], Result], items: Sequence[Item], jobs: int
) -> Generator[Result, None, None]:
    """Yield results as they become ready.

    With one job all work is done in this process; -1 is one job for each processor.

    Raises
    ------
    TendonreproError
        If a worker process dies.
    """
    jobs = min(len(items), jobs if jobs > 0 else os.cpu_count() or 1)
    if jobs < 2:
        yield from map(function, items)
        return
    with _processes(jobs) as executor:
        for done in as_completed([executor.submit(function, item) for item in items]):
            yield done.result()


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    """Start processes, and end them with the block, whatever they are at."""
    from multiprocessing import resource_tracker

    from joblib.externals.loky import ProcessPoolExecutor
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    executor = ProcessPoolExecutor(jobs, initializer=_end_with, initargs=(os.getpid(),))
    try:
        if sys.platform != "win32":
            # This process of the standard library lifts the block when it starts.
            resource_tracker.ensure_running()
        with interrupts_blocked():
            executor.submit(int)
        yield executor
    except TerminatedWorkerError as error:
        message = "a worker process died, perhaps for want of memory; what is finished is kept"
        hint = "look at free memory, and at what ulimit -a shows; where a command has --jobs, fewer need less"
        raise TendonreproError(message, hint=hint) from error
    finally:
        _forget_waiting(executor)
        # After an interrupt nobody waits for the rest.
        executor.shutdown(kill_workers=True)


def _forget_waiting(executor: Any) -> None:
    """Empty the queue of what no worker has begun.

    An executor that ends early drops the tasks, but not their numbers. Its thread would look for the first
    one and die with a traceback. loky has no public way to say this.
    """
    with suppress(Empty):
        while True:
            executor._work_ids.get_nowait()


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Let an interrupt wait for the end of a block; processes that start in it hear none."""
    if sys.platform == "win32":  # which knows no masks
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with(parent: int) -> None:
    """End this process as soon as the one that started it is gone, even where that was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
