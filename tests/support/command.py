"""The command line, run as a user runs it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import BytesIO, StringIO, TextIOWrapper
from pathlib import Path
from typing import Any

import pytest
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from tendonrepro.cli import main
from tendonrepro.cli.app import app

SHORT = ["--set", "reference.periods=1", "--set", "reference.period=1", "--set", "reference.blend=0.5"]
SHORT_MOTION = "{kind: minimum_jerk, amplitude: {value: [5, 5, 5], unit: deg, source: 'assumed: test'}, "
SHORT_MOTION += "rise: {value: 0.3, unit: s, source: 'assumed: test'}, hold: {value: 0.1, unit: s, "
SHORT_MOTION += "source: 'assumed: test'}, periods: {value: 1, unit: '1', source: 'assumed: test'}}"
SHORT_DECOUPLE = [
    "--set",
    f"runs.decouple.reference={SHORT_MOTION}",
    "--set",
    "runs.pull_tendon_1.reference.rise=0.4",
]


SMALL = {
    "compare": ["--controllers", "1", *SHORT],
    "decouple": SHORT_DECOUPLE,
    "edits": ["--plants", "1", "--jobs", "1"],
    "ensemble": ["--draws", "256", "--readings", "printed", "--jobs", "1"],
    "identify": ["--budget", "8", "--jobs", "1"],
    "data ingest": ["controller_1.csv", "--mapping", "mapping.yaml", "--confirm"],
    "predict": ["--draws", "20", "--readings", "printed"],
    "data recover": ["measured.h5"],
    "sweep": ["--over", "control.gains.lam=4,5", *SHORT],
    "tune": ["--plants", "1", "--searches", "2", "--generations", "2", "--population", "4", "--jobs", "1"],
    "data validate": ["measured.h5"],
}
"""Words without which a command cannot do, or with which it does as little as it can; of `measured.h5`."""


def run(*words: str, cwd: Path, stdin: str = "", columns: int = 100) -> subprocess.CompletedProcess[str]:
    """Run the command line in this process: to load the libraries anew takes longer than most commands."""
    out, err = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(cwd)
        patch.setenv("COLUMNS", str(columns))
        patch.setattr(sys, "argv", ["tendonrepro", *words])
        patch.setattr(sys, "stdin", TextIOWrapper(BytesIO(stdin.encode()), encoding="utf-8"))
        with pytest.raises(SystemExit) as left:
            main()
    return subprocess.CompletedProcess(words, int(left.value.code or 0), out.getvalue(), err.getvalue())


def hear_interrupts() -> None:
    """For a child of a job in the background, whose shell lets it ignore them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def with_out() -> dict[str, TyperCommand]:
    """All commands that have an option --out, by the words that call them."""

    def commands(group: TyperGroup, above: str = "") -> Iterator[tuple[str, TyperCommand]]:
        for name, held in group.commands.items():
            if isinstance(held, TyperGroup):
                yield from commands(held, f"{above}{name} ")
            elif (
                isinstance(held, TyperCommand)
                and not held.hidden
                and any("--out" in one.opts for one in held.params)
            ):
                yield above + name, held

    program = get_command(app)
    assert isinstance(program, TyperGroup)
    return dict(commands(program))


def answer(*words: str, cwd: Path, code: int = 0) -> Any:
    """What a command prints as JSON."""
    done = run(*words, "--json", cwd=cwd)
    assert done.returncode == code, done.stderr + done.stdout
    return json.loads(done.stdout)
