"""Independent pieces of work on all processors."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection, forkserver, resource_tracker
from multiprocessing.sharedctypes import Synchronized
from typing import Any, TypeVar

from tendonrepro.errors import TendonreproError

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_WORKERS = 4
"""Each worker needs some 150 MB; the paper's experiments have four runs."""

LOOK_SECONDS = 1.0
"""How often a process that :mod:`multiprocessing` did not start looks whether its starter is still there."""

_POLL_SECONDS = 0.1
# A process that has loaded libraries of macOS must not fork, and Windows knows no fork.
_METHOD = "forkserver" if sys.platform == "linux" else "spawn"
_report: Callable[[int], None] | None = None


def prepare(module: str) -> None:
    """Begin to import a module for the processes that :func:`each` will start, while this one goes on.

    On Linux they fork from one that has imported them; elsewhere each imports for itself.

    Parameters
    ----------
    module : str
        Name of one that imports what is slow to import.
    """
    if _METHOD == "forkserver" and (os.cpu_count() or 1) > 1:
        forkserver.set_forkserver_preload([module])
        # It begins to hear interrupts again when it has started; the other process is not to.
        resource_tracker.ensure_running()
        with interrupts_held():
            forkserver.ensure_running()


def each(
    function: Callable[[Item], Result], items: Sequence[Item], progress: Callable[[int], None] | None = None
) -> list[Result]:
    """Apply a function to every item, each in a process of its own while there are processors.

    The pieces share nothing, so a result does not depend on how many processes there are.

    Parameters
    ----------
    function : callable
        Function of a module, or a partial of one: worker processes import it anew.
    items : sequence
    progress : callable, optional
        Called now and then with the number of steps that :func:`advance` was told of.

    Returns
    -------
    list
        Results in the order of the items.

    Raises
    ------
    TendonreproError
        If a worker process dies.
    """
    count = min(len(items), os.cpu_count() or 1, MOST_WORKERS)
    if count <= 1:
        _listen(progress)
        return [function(item) for item in items]
    context = multiprocessing.get_context(_METHOD)
    done = context.Value("q", 0)
    others = multiprocessing.active_children()
    pool = ProcessPoolExecutor(count, context, _start, (done,))
    try:
        with interrupts_held():
            waiting = [pool.submit(function, item) for item in items]
        _follow(waiting, done, progress or (lambda _: None))
        return [future.result() for future in waiting]
    except (BrokenProcessPool, EOFError) as error:
        message = "a worker process died or could not start, perhaps for want of memory"
        hint = "look at free memory, and at the limits that ulimit -a shows"
        raise TendonreproError(message, hint=hint) from error
    finally:
        for worker in multiprocessing.active_children():
            if worker not in others:
                worker.terminate()
        pool.shutdown(cancel_futures=True)


def _follow(waiting: Sequence[Future[Any]], done: Synchronized[int], progress: Callable[[int], None]) -> None:
    """Pass progress on until all is done or something failed."""
    seen = 0
    running = True
    while running:
        running = bool(wait(waiting, _POLL_SECONDS, FIRST_EXCEPTION).not_done)
        failed = any(future.done() and future.exception() for future in waiting)
        progress(done.value - seen)
        seen = done.value
        if failed:
            return


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Let processes start without hearing interrupts; the first one acts on them when the block has ended.

    A process inherits what its starter blocks, while a handler would be reset.
    """
    before = signal.getsignal(signal.SIGINT)
    # In the background of a shell interrupts are ignored, and processes inherit that.
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    heard: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    # Windows knows no masks; there every process of a console hears an interrupt.
    mask = getattr(signal, "pthread_sigmask", None)
    blocked = mask(signal.SIG_BLOCK, {signal.SIGINT}) if mask else set()
    try:
        yield
    finally:
        if mask:
            mask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, before)
        # Whatever else went wrong in the block came of it.
        if heard:
            before(heard[0], None)


def advance(steps: int) -> None:
    """Report steps done; heard by :func:`each`, which may be in another process."""
    if _report is not None:
        _report(steps)


def _listen(report: Callable[[int], None] | None) -> None:
    global _report  # noqa: PLW0603 (a process has one listener)
    _report = report


def end_with_parent(pid: int | None = None, leaving: Callable[[], None] | None = None) -> None:
    """End this process as soon as the one that started it is gone, even where that was killed.

    Parameters
    ----------
    pid : int, optional
        Number of that process, where :mod:`multiprocessing` did not start this one.
    leaving : callable, optional
        Called before.
    """
    if not any(thread.name == _outlive_nobody.__name__ for thread in threading.enumerate()):
        name = _outlive_nobody.__name__
        try:
            threading.Thread(target=_outlive_nobody, args=(pid, leaving), name=name, daemon=True).start()
        except RuntimeError:
            # The system refuses a thread, and who started this process says so in a sentence.
            os._exit(1)


def _outlive_nobody(pid: int | None, leaving: Callable[[], None] | None) -> None:
    parent = multiprocessing.parent_process()
    if pid is None and parent is not None:
        connection.wait([parent.sentinel])
    while pid is not None and os.getppid() == pid:
        time.sleep(LOOK_SECONDS)
    if leaving is not None:
        leaving()
    os._exit(1)


def _start(done: Synchronized[int]) -> None:
    # A process inherits this neither on Windows nor where two interrupts come at once.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()

    def count(steps: int) -> None:
        with done.get_lock():
            done.value += steps

    _listen(count)
