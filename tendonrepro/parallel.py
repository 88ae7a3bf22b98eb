"""Independent pieces of work on all processors."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import TypeVar

from tendonrepro.errors import TendonreproError

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_WORKERS = 4
"""Each worker needs some 150 MB; the paper's experiments have four runs."""

LOOK_SECONDS = 1.0
"""How often a worker looks whether the process that started it is still there."""


def each(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    progress: Callable[[int], None] = lambda _: None,
) -> list[Result]:
    """Apply a function to every item, each in a process of its own while there are processors.

    Parameters
    ----------
    function : callable
        One that can be pickled.
    items : sequence
    progress : callable, optional
        Called with 1 whenever an item is done.

    Returns
    -------
    list
        Results in the order of the items.

    Raises
    ------
    TendonreproError
        If a worker process dies.
    """
    found = []
    jobs = min(len(items), os.cpu_count() or 1, MOST_WORKERS)
    with closing(as_ready(function, items, jobs, ordered=True)) as ready:
        for result in ready:
            found.append(result)
            progress(1)
    return found


def as_ready(
    function: Callable[[Item], Result], items: Sequence[Item], jobs: int, *, ordered: bool = False
) -> Generator[Result, None, None]:
    """Yield results as they become ready, or in order; with one job all work is done in this process.

    Raises
    ------
    TendonreproError
        If a worker process dies.
    """
    if jobs == 1 or len(items) < 2:
        yield from map(function, items)
        return
    from joblib import Parallel, delayed
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    order = "generator" if ordered else "generator_unordered"
    begin = {"initializer": _end_with, "initargs": (os.getpid(),)}
    pool = Parallel(jobs, "loky", return_as=order, batch_size=1, max_nbytes=None, **begin)
    try:
        with _interrupts_blocked():
            ready = pool(delayed(function)(item) for item in items)
        yield from ready
    except TerminatedWorkerError as error:
        message = "a worker process died, perhaps for want of memory; what is finished is kept"
        hint = "look at free memory, and at the limits that ulimit -a shows; fewer --jobs need less"
        raise TendonreproError(message, hint=hint) from error
    finally:
        # Idle workers would stay for minutes, and after an interrupt nobody waits for the rest.
        get_reusable_executor(reuse=True).shutdown(kill_workers=True)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Start processes that hear no interrupt, which a terminal sends to them too; ours waits for the end."""
    if sys.platform == "win32":  # which knows no masks
        yield
        return
    from multiprocessing import resource_tracker

    # This process of the standard library lifts the block when it starts.
    resource_tracker.ensure_running()
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
