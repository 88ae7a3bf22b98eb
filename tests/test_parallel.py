"""Work in several processes: same results, in order, errors and progress included."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import Mock

import psutil
import pytest
from support.command import hear_interrupts

from tendonrepro.errors import ConfigError, TendonreproError
from tendonrepro.parallel import advance, each, interrupts_held

if TYPE_CHECKING:
    from collections.abc import Iterator


def work(offset: int, item: int) -> tuple[int, int]:
    advance(item)
    return item + offset, os.getpid()


def fail(item: int) -> int:
    message = "cannot"
    raise ConfigError(message, where=f"item {item}", hint="do not")


@pytest.mark.parametrize("processors", [1, 2])
def test_results_are_in_order_and_progress_adds_up(monkeypatch: pytest.MonkeyPatch, processors: int) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    told: list[int] = []
    results = each(partial(work, 100), [3, 1, 2], told.append)
    assert [result for result, _ in results] == [103, 101, 102]
    assert ({process for _, process in results} == {os.getpid()}) == (processors == 1)
    assert sum(told) == 6
    assert each(fail, []) == []


@pytest.mark.parametrize("processors", [1, 2])
def test_errors_arrive_whole(monkeypatch: pytest.MonkeyPatch, processors: int) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    with pytest.raises(ConfigError) as caught:
        each(fail, [7, 7])
    assert (caught.value.where, caught.value.hint, caught.value.message) == ("item 7", "do not", "cannot")


def test_runs_do_not_depend_on_the_number_of_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    from tendonrepro.configuration.load import load_config
    from tendonrepro.console import Talk
    from tendonrepro.experiments.run import simulate_all

    short = ["reference.periods=1", "reference.rise=0.1", "reference.hold=0.05", "reference.amplitude=[2,2]"]
    loaded = load_config(None, "compare", overrides=short)

    def runs(processors: int) -> list[bytes]:
        monkeypatch.setattr(os, "cpu_count", lambda: processors)
        traces = simulate_all([(loaded, None)], Talk(quiet=True))[0]
        return [trace["q"].tobytes() + trace["tau_m"].tobytes() for trace in traces]

    assert runs(1) == runs(2)


def test_a_worker_that_dies_is_an_error_not_a_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with pytest.raises(TendonreproError, match="died"):
        each(os._exit, [1, 1])


def test_a_process_that_the_system_refuses_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    # What a server of processes that cannot fork leaves its client.
    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", Mock(side_effect=EOFError))
    with pytest.raises(TendonreproError, match="could not start"):
        each(fail, [1, 1])


@pytest.fixture(name="interrupts")
def _interrupts() -> Iterator[None]:
    """Interrupts as at a terminal, also where the tests run in the background of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(sys.platform == "win32", reason="no masks there")
@pytest.mark.usefixtures("interrupts")
def test_an_interrupt_while_processes_start_is_late_not_lost_and_ignored_ones_stay_ignored() -> None:
    done = []

    def interrupted() -> None:
        with interrupts_held():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
            done.append("all of the block")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert done

    def interrupted_and_failed() -> None:
        with interrupts_held():
            os.kill(os.getpid(), signal.SIGINT)
            raise EOFError

    with pytest.raises(KeyboardInterrupt):
        interrupted_and_failed()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with interrupts_held():
        done.append("nothing without one")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who ignores interrupts goes on doing so
    with interrupts_held():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_the_process_that_workers_fork_from_hears_no_interrupt() -> None:
    """Not even while it imports: at a terminal it is sent one too."""
    code = """
import os
from multiprocessing import forkserver
from pathlib import Path
from tendonrepro.parallel import prepare
if __name__ == "__main__":
    os.cpu_count = lambda: 2
    prepare("colorsys")
    status = Path(f"/proc/{forkserver._forkserver._forkserver_pid}/status").read_text()
    print(int(status.partition("SigBlk:")[2].split()[0], 16) & 2)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, preexec_fn=hear_interrupts
    )
    assert done.stdout == "2\n"


ORPHAN = """
import os, sys, time
from tendonrepro.parallel import each


def work(item):
    print(os.getpid(), flush=True)
    time.sleep(600)


if __name__ == "__main__":
    os.cpu_count = lambda: 2
    each(work, [1, 2])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL there")
def test_workers_end_with_a_killed_parent(tmp_path: Path) -> None:
    script = tmp_path / "orphan.py"
    script.write_text(ORPHAN)
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    workers = [psutil.Process(int(parent.stdout.readline())) for _ in range(2)]
    parent.kill()
    parent.wait()
    parent.stdout.close()
    _, alive = psutil.wait_procs(workers, timeout=30)
    assert not alive
