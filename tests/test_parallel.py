"""Work in several processes: same results, errors whole, and no process left behind."""

from __future__ import annotations

import faulthandler
import io
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import psutil
import pytest
from support.command import hear_interrupts

from tendonrepro import parallel
from tendonrepro.errors import ConfigError, TendonreproError
from tendonrepro.parallel import as_ready, counted, interrupts_blocked, workers


@pytest.fixture(params=[(1, True), (2, True), (2, False)], ids=["alone", "copies", "started anew"])
def processors(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Beside another thread a copy of the process would not be sound, so workers are started anew."""
    count, copies = request.param
    monkeypatch.setattr(parallel, "processors", lambda: count)
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    if not copies:
        other.start()
    yield int(count)
    done.set()


def work(offset: int, item: int) -> tuple[int, int]:
    return item + offset, os.getpid()


def run(function: Callable[[int], int], items: Sequence[int]) -> Iterator[int]:
    with workers() as start:
        yield from start(function, items)


def fail(item: int) -> int:
    message = "cannot"
    raise ConfigError(message, where=f"item {item}", hint="do not")


def test_results_are_in_order_and_progress_adds_up(processors: int) -> None:
    told: list[int] = []
    with workers() as start:
        results = list(counted(start(partial(work, 100), [3, 1, 2]), told.append))
        again = list(start(partial(work, 0), [7]))
    assert [result for result, _ in results] == [103, 101, 102]
    assert again[0][0] == 7
    assert ({process for _, process in results + again} == {os.getpid()}) == (processors == 1)
    assert sum(told) == 3


def test_workers_work_where_standard_error_is_no_file(
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """As where somebody has put a stream there. pytest has a fault handler, other programs have none."""
    faulthandler.disable()
    request.addfinalizer(faulthandler.enable)
    monkeypatch.setattr(parallel, "processors", lambda: 2)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert [*run(abs, [-1, 2, -3])] == [1, 2, 3]


@pytest.mark.parametrize("processors", [(2, False)], indirect=True)
@pytest.mark.usefixtures("processors")
def test_workers_that_start_from_nothing_serve_the_whole_block() -> None:
    """They import for more than a second, as on macOS, on Windows and in notebooks."""
    with workers() as start:
        (_, first), *_ = start(partial(work, 0), [1])
        there = {child.pid for child in psutil.Process().children(recursive=True)}
        again = {process for _, process in start(partial(work, 0), [2, 3])}
    assert {first} | again <= there


@pytest.mark.usefixtures("processors")
def test_work_for_one_process_stays_in_this_one() -> None:
    with workers(1) as start:
        assert [*start(partial(work, 0), [1])] == [(1, os.getpid())]


def test_work_begins_before_a_result_is_asked_for(tmp_path: Path, processors: int) -> None:
    with workers() as start:
        results = start(Path.touch, [tmp_path / "a"])
        for _ in range(600):
            if processors == 1 or (tmp_path / "a").exists():
                break
            time.sleep(0.1)
        assert (tmp_path / "a").exists() == (processors == 2)
        assert list(results) == [None]


@pytest.mark.parametrize("jobs", [1, 2, -1])
def test_results_come_as_they_are_ready(jobs: int, processors: int) -> None:
    found = list(as_ready(partial(work, 0), range(5), jobs))
    assert sorted(result for result, _ in found) == [*range(5)]
    assert ({process for _, process in found} == {os.getpid()}) == ((jobs if jobs > 0 else processors) == 1)
    assert list(as_ready(fail, [], 2)) == []


def test_errors_arrive_whole(processors: int) -> None:
    for results in (as_ready(fail, [7, 7], processors), run(fail, [7, 7])):
        with pytest.raises(ConfigError) as caught:
            list(results)
        error = caught.value
        assert (error.where, error.hint, error.message) == ("item 7", "do not", "cannot")


def test_a_worker_that_dies_is_an_error_not_a_wait() -> None:
    with pytest.raises(TendonreproError, match="died"):
        list(as_ready(os._exit, [1, 1], 2))


@pytest.mark.slow
def test_who_leaves_early_leaves_no_thread_behind_that_dies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many tasks wait when workers are ended: loky's private queue has to be emptied, or its thread dies."""
    died: list[threading.ExceptHookArgs] = []
    monkeypatch.setattr(threading, "excepthook", died.append)
    # Short tasks: the queue of the workers is seldom full, so that the thread looks for the next number.
    for _ in range(3):
        results = as_ready(abs, range(4000), 2)
        next(results)
        results.close()
    assert not died


def begun(folder: Path, script: str, *words: str) -> subprocess.Popen[str]:
    """A script on its way, in a group of its own: a terminal interrupts all processes of a command."""
    path = folder / "script.py"
    path.write_text(script, encoding="utf-8")
    return subprocess.Popen(
        [sys.executable, path, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_interrupts,  # noqa: PLW1509 (there are no threads here)
        start_new_session=True,
    )


# Neither a main guard nor an importable function: a script or a console has none.
SLEEPERS = r"""
import os, time
from tendonrepro import parallel
from tendonrepro.parallel import workers


def work(item):
    os.write(1, b"%d\n" % os.getpid())  # whole, where print may write the line's end later
    time.sleep(600)


parallel.processors = lambda: 2
with workers() as start:
    list(start(work, [1, 2]))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no signals there")
@pytest.mark.parametrize("number", ["SIGKILL", "SIGINT"])
def test_workers_end_with_a_killed_or_interrupted_parent(tmp_path: Path, number: str) -> None:
    parent = begun(tmp_path, SLEEPERS)
    assert parent.stdout is not None
    workers = [psutil.Process(int(parent.stdout.readline())) for _ in range(2)]
    os.killpg(parent.pid, signal.SIGINT) if number == "SIGINT" else parent.kill()
    parent.communicate(timeout=60)
    _, alive = psutil.wait_procs(workers, timeout=30)
    assert not alive


# Far more pieces than the queue between the processes holds.
PIECES = r"""
import sys, time
from tendonrepro import parallel
from tendonrepro.parallel import as_ready, workers


def work(item):
    time.sleep(600 * (item > 0))


def in_order(function, items):
    with workers() as start:
        yield from start(function, items)


def as_they_come(function, items):
    yield from as_ready(function, items, 2)


parallel.processors = lambda: 2
try:
    for _ in globals()[sys.argv[1]](work, range(100)):
        print("begun", flush=True)
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for a child there")
@pytest.mark.parametrize("way", ["in_order", "as_they_come"])
def test_an_interrupt_says_nothing_of_work_that_waits(tmp_path: Path, way: str) -> None:
    parent = begun(tmp_path, PIECES, way)
    assert parent.stdout is not None
    assert parent.stdout.readline() == "begun\n"
    os.killpg(parent.pid, signal.SIGINT)
    out, err = parent.communicate(timeout=60)
    assert (parent.returncode, out, err) == (130, "", "")


@pytest.mark.skipif(sys.platform == "win32", reason="no masks there")
def test_an_interrupt_waits_for_the_end_of_a_block() -> None:
    before, done = signal.signal(signal.SIGINT, signal.default_int_handler), []
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_blocked():  # noqa: PT012 (that the rest runs is the test)
            signal.raise_signal(signal.SIGINT)
            done.append("the rest of the block")
    finally:
        signal.signal(signal.SIGINT, before)
    assert done


GROWING = """
import os, time
from tendonrepro.parallel import as_ready

def grown(size):
    os.kept = b"x" * size  # a module of the worker, so it outlives the task
    time.sleep(1.1)  # loky looks at the memory of a worker once a second
    return os.getpid()

if __name__ == "__main__":
    sizes = [1, 1, *[400_000_000] * 4, 1, 1]
    print(*as_ready(grown, sizes, 2))
"""


@pytest.mark.slow
def test_a_worker_that_has_grown_is_replaced_without_a_word(tmp_path: Path) -> None:
    """Its warning, as the error that warnings are in tests, made all wait for ever."""
    script = tmp_path / "growing.py"
    script.write_text(GROWING, encoding="utf-8")
    command = [sys.executable, "-W", "error", str(script)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stderr == ""
    assert len(done.stdout.split()) == 8
    assert len(set(done.stdout.split())) > 2
