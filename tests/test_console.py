"""Progress: a bar where one can be seen, lines of a log elsewhere, and the time that work takes before it."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.command import run

from tendonrepro import console
from tendonrepro.console import Talk


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A clock that the test sets."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(console.time, "monotonic", lambda: clock.now)
    return clock


def logged(clock: SimpleNamespace, capsys: pytest.CaptureFixture[str], steps: int, each: float) -> list[int]:
    """Percentages of the lines that work of so many steps leaves, each of so many seconds."""
    with Talk().bar("working", steps) as progress:
        for _ in range(steps):
            clock.now += each
            progress(1)
    return [int(found) for found in re.findall(r"(\d+) ?%", capsys.readouterr().err)]


def test_long_work_without_a_terminal_leaves_a_line_each_tenth(
    clock: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    assert logged(clock, capsys, 200, 2.0) == [*range(10, 100, 10)]


def test_slow_work_leaves_a_line_each_minute_and_quick_work_none(
    clock: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    assert len(logged(clock, capsys, 200, 20.0)) == pytest.approx(200 / 3, abs=1)
    assert logged(clock, capsys, 200, 0.01) == []


@pytest.mark.parametrize("words", ["ensemble --draws 256", "predict --draws 20", "tune", "identify", "edits"])
def test_long_work_tells_its_time_beforehand(tmp_path: Path, words: str) -> None:
    done = run(*words.split(), "--dry-run", cwd=tmp_path)
    assert re.search(r"about [\d,]+ (s|minutes|hours) of one processor", done.stdout)
