"""Independent pieces of work on all processors."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from contextlib import ExitStack, contextmanager, suppress
from queue import Empty, Queue
from typing import Protocol, TypeVar

from tendonrepro.errors import TendonreproError, UsageError

Item = TypeVar("Item")
Done = TypeVar("Done")


class Start(Protocol):
    """Begins to apply a function to items, and yields the results in order."""

    def __call__(self, function: Callable[[Item], Done], items: Sequence[Item], /) -> Iterable[Done]:
        """Begin."""


MOST_WORKERS = 8
"""A worker takes some 60 MB of its own; the paper's experiments have ten runs and thirteen figures."""

MOST_STARTED = 4
"""Where a worker starts from nothing it imports for more than a second, and takes some 150 MB."""

LOOK_SECONDS = 1.0
"""How often a worker looks whether the process that started it is still there."""


def processors() -> int:
    """Processors that this process may use: what its affinity and its container's limits leave."""
    import loky

    return int(loky.cpu_count())


@contextmanager
def workers(most: int = MOST_WORKERS) -> Iterator[Start]:
    """Let other processes work for a block, `most` of them, while there are processors and pieces of work.

    Nothing is started before there is work. Copies of this process end with it, for beside them no others can
    be made; processes that start from nothing, which takes them long, serve the whole block.

    Yields
    ------
    callable
        Begins to apply a function to items, and yields the results in order. Where there is one processor,
        this process works when a result is asked for.

    Raises
    ------
    TendonreproError
        If a worker process dies.
    """
    anew: list[Executor] = []
    with ExitStack() as stack:

        def start(function: Callable[[Item], Done], items: Sequence[Item]) -> Iterable[Done]:
            jobs, copied = min(most, MOST_WORKERS, processors()), not anew and _can_fork()
            if jobs < 2 or not items:
                return map(function, items)
            ends = stack.enter_context(ExitStack())
            if copied:
                executor = ends.enter_context(_processes(min(jobs, len(items))))
            else:
                anew[:] = anew or [stack.enter_context(_processes(min(jobs, MOST_STARTED)))]
                (executor,) = anew
            return _results(ends, [executor.submit(function, item) for item in items])

        yield start


def _results(ends: ExitStack, begun: Sequence[Future[Done]]) -> Iterator[Done]:
    """Yield results in order; then the processes end that serve these alone."""
    with ends:
        for future in begun:
            yield future.result()


def _can_fork() -> bool:
    """Whether a copy of this process is sound.

    A lock that another thread holds would stay closed in it. And loky ends a copy whose standard error is no
    file, because it cannot report a crash there. On macOS libraries of the system do not bear a copy, and
    Windows makes none.
    """
    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):
        return False
    return sys.platform == "linux" and threading.active_count() == 1


def check_jobs(jobs: int) -> None:
    """Raise a UsageError unless there is a process at least, or -1 for one for each of `processors`."""
    if jobs < 1 and jobs != -1:
        message = f"must be a number of processes, or -1 for one for each processor, found {jobs}"
        raise UsageError(message, where="--jobs")


def counted(results: Iterable[Done], progress: Callable[[int], None]) -> Iterator[Done]:
    """Yield results, and call `progress` with 1 after each."""
    for result in results:
        progress(1)
        yield result


def as_ready(
    function: Callable[[Item], Done], items: Sequence[Item], jobs: int
) -> Generator[Done, None, None]:
    """Yield results as they become ready.

    With one job all work is done in this process; -1 is one job for each of `processors`.

    Raises
    ------
    TendonreproError
        If a worker process dies.
    """
    jobs = min(len(items), jobs if jobs > 0 else processors())
    if jobs < 2:
        yield from map(function, items)
        return
    with _processes(jobs) as executor:
        for done in as_completed([executor.submit(function, item) for item in items]):
            yield done.result()


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    """Start processes, and end them with the block, whatever they are at.

    Raises
    ------
    TendonreproError
        If the system gives them no locks, or one of them dies.
    """
    from multiprocessing import get_context, resource_tracker

    from loky import ProcessPoolExecutor
    from loky.process_executor import TerminatedWorkerError

    context = get_context("fork") if _can_fork() else None
    try:
        executor = ProcessPoolExecutor(jobs, context=context, initializer=_begin, initargs=(os.getpid(),))
    except OSError as error:
        message = f"worker processes cannot share their locks: {error.strerror or error}"
        hint = "they lie in /dev/shm on Linux: make it writable, or leave one processor, as taskset -c 0 does"
        raise TendonreproError(message, hint=hint) from error
    try:
        if sys.platform != "win32":
            # This process of the standard library lifts the block when it starts.
            resource_tracker.ensure_running()
        with interrupts_blocked(), warnings.catch_warnings():
            # Python 3.12 counts the threads of OpenBLAS too, which ends them before a fork.
            warnings.simplefilter("ignore", DeprecationWarning)
            executor.submit(int)
        with warnings.catch_warnings():
            # A worker that has grown by 300 MB ends after its task, and another one takes its place. As an
            # error the warning would end the thread that collects results, and all would wait for ever.
            warnings.filterwarnings("ignore", "A worker (stopped|was restarted) while some jobs", UserWarning)
            yield executor
    except TerminatedWorkerError as error:
        message = "a worker process died, perhaps for want of memory; what is finished is kept"
        hint = "look at free memory, and at what ulimit -a shows; where a command has --jobs, fewer need less"
        raise TendonreproError(message, hint=hint) from error
    finally:
        _empty(executor._work_ids)
        # After an interrupt nobody waits for the rest.
        executor.shutdown(kill_workers=True)


def _empty(waiting: Queue[int]) -> None:
    """Empty the queue of what no worker of an executor has begun.

    An executor that ends early drops the tasks, but not their numbers. Its thread would look for the first
    one and die with a traceback. loky has no public way to say this: a cancelled task leaves its number too.
    """
    with suppress(Empty):
        while True:
            waiting.get_nowait()


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


def _begin(parent: int) -> None:
    """Let this process end as soon as the one that started it is gone, even where that was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    # What a copy was made with stays: loky would look it through for garbage after a task, for 0.1 s.
    gc.freeze()
