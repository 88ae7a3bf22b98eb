"""Work in several processes: same results, errors whole, and no process left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import psutil
import pytest
from support.command import hear_interrupts

from tendonrepro.errors import ConfigError, TendonreproError
from tendonrepro.parallel import each


@pytest.fixture(params=[1, 2])
def processors(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(os, "cpu_count", lambda: request.param)
    return int(request.param)


def work(offset: int, item: int) -> tuple[int, int]:
    return item + offset, os.getpid()


def fail(item: int) -> int:
    message = "cannot"
    raise ConfigError(message, where=f"item {item}", hint="do not")


def test_results_are_in_order_and_progress_adds_up(processors: int) -> None:
    told: list[int] = []
    results = each(partial(work, 100), [3, 1, 2], told.append)
    assert [result for result, _ in results] == [103, 101, 102]
    assert ({process for _, process in results} == {os.getpid()}) == (processors == 1)
    assert sum(told) == 3
    assert each(fail, []) == []


def test_errors_arrive_whole(processors: int) -> None:
    del processors
    with pytest.raises(ConfigError) as caught:
        each(fail, [7, 7])
    assert (caught.value.where, caught.value.hint, caught.value.message) == ("item 7", "do not", "cannot")


def test_a_worker_that_dies_is_an_error_not_a_wait(processors: int) -> None:
    if processors == 2:
        with pytest.raises(TendonreproError, match="died"):
            each(os._exit, [1, 1])


# Neither a main guard nor an importable function: a script or a console has none.
SLEEPERS = """
import os, time
from tendonrepro.parallel import each


def work(item):
    print(os.getpid(), flush=True)
    time.sleep(600)


os.cpu_count = lambda: 2
each(work, [1, 2])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no signals there")
@pytest.mark.parametrize("number", ["SIGKILL", "SIGINT"])
def test_workers_end_with_a_killed_or_interrupted_parent(tmp_path: Path, number: str) -> None:
    script = tmp_path / "sleepers.py"
    script.write_text(SLEEPERS)
    parent = subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        preexec_fn=hear_interrupts,  # noqa: PLW1509 (there are no threads here)
        start_new_session=True,
    )
    assert parent.stdout is not None
    workers = [psutil.Process(int(parent.stdout.readline())) for _ in range(2)]
    # A terminal interrupts all processes of a command.
    os.killpg(parent.pid, signal.SIGINT) if number == "SIGINT" else parent.kill()
    parent.wait(60)
    parent.stdout.close()
    _, alive = psutil.wait_procs(workers, timeout=30)
    assert not alive
