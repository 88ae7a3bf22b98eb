"""Independent pieces of work on all processors."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
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
        One that can be pickled; the pieces share nothing.
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
    begin = {"initializer": _begin, "initargs": (os.getpid(),)}
    pool = Parallel(jobs, "loky", return_as=order, batch_size=1, max_nbytes=None, **begin)
    try:
        yield from pool(delayed(function)(item) for item in items)
    except TerminatedWorkerError as error:
        message = "a worker process died, perhaps for want of memory; what is finished is kept"
        hint = "look at free memory, and at the limits that ulimit -a shows; fewer --jobs need less"
        raise TendonreproError(message, hint=hint) from error
    finally:
        # Idle workers would stay for minutes, and after an interrupt nobody waits for the rest.
        get_reusable_executor(reuse=True).shutdown(kill_workers=True)


def _begin(parent: int) -> None:
    """Leave interrupts to the process that started this one, and end as soon as that is gone, even killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
