"""The installed command, run as a user runs it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

SHORT = ["--set", "reference.periods=1", "--set", "reference.rise=0.4", "--set", "reference.hold=0.1"]
SHORT_MOTION = "{kind: minimum_jerk, amplitude: {value: [5, 5, 5], unit: deg, source: 'assumed: test'}, "
SHORT_MOTION += "rise: {value: 0.3, unit: s, source: 'assumed: test'}, hold: {value: 0.1, unit: s, "
SHORT_MOTION += "source: 'assumed: test'}, periods: {value: 1, unit: '1', source: 'assumed: test'}}"
SHORT_DECOUPLE = [
    "--set",
    f"runs.decouple.reference={SHORT_MOTION}",
    "--set",
    "runs.pull_tendon_1.reference.rise=0.4",
]


def run(
    command: str, *words: str, cwd: Path, stdin: str = "", **environment: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [command, *words],
        cwd=cwd,
        input=stdin,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=os.environ | {"COLUMNS": "100"} | environment,
    )


def hear_interrupts() -> None:
    """For a child of a job in the background, whose shell lets it ignore them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def answer(command: str, *words: str, cwd: Path, code: int = 0) -> Any:
    done = run(command, *words, "--json", cwd=cwd)
    assert done.returncode == code, done.stderr + done.stdout
    return json.loads(done.stdout)
