"""This checkout against an older commit, in turns on one machine: whole commands, and the batch stepper.

``python benchmarks/against.py COMMIT`` prints the medians of both, and that of their ratios turn by turn.
Each build runs in processes of its own.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from bench_common import ROOT

TURNS = 3

COMMANDS = {
    "compare": ["-m", "tendonrepro", "compare"],
    "decouple": ["-m", "tendonrepro", "decouple"],
    "reproduce": ["-m", "tendonrepro", "reproduce"],
    "tr.compare()": ["-c", "import tendonrepro as tr; tr.compare()"],
}
"""Python's arguments; ``tr.compare()`` draws and writes nothing."""

STEPPER = """
import json, sys
sys.path.insert(0, "benchmarks")
from bench_batch import Stated, mix_case
from bench_common import seconds_of
default = Stated(8.0, (), 1000)
default.batch(default.loops)
seconds = seconds_of(lambda: default.batch(default.loops))
mix = mix_case(turns=1)["experiments_per_second"]
print(json.dumps({"ensemble_mix, s": 1 / mix, "batch_default, s": seconds / 1000}))
"""


@contextmanager
def checkout_of(commit):
    """Folder with an earlier commit of this repository, for a block."""
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "old"
        words = ["git", "worktree", "add", "--detach", str(old), commit]
        subprocess.run(words, cwd=ROOT, check=True, capture_output=True)
        try:
            yield old
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(old)], cwd=ROOT, check=True)


def environment_of(checkout):
    return os.environ | {"PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}


def spent(checkout, name, words):
    """Wall and processor seconds of a fresh process of a checkout, its workers' included."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--quiet", "--out", str(Path(folder) / "out")] if words[0] == "-m" else []
        command = [sys.executable, *words, *options]
        started = time.perf_counter()
        process = subprocess.Popen(
            command, cwd=folder, env=environment_of(checkout), stdout=subprocess.DEVNULL
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
    return {f"{name}, s": seconds, f"{name}, processor s": usage.ru_utime + usage.ru_stime}


def stepped(checkout):
    """Seconds an experiment of the batch stepper of a checkout, by case."""
    command, environment = [sys.executable, "-c", STEPPER], environment_of(checkout)
    done = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def rows_of(old, new, commands, turns):
    """Then, now, and then over now of each case: medians of the turns."""
    work = [lambda checkout, one=one: spent(checkout, *one) for one in commands.items()]
    for run in (*work, stepped):
        # The first turn brings files into memory.
        pairs = [(run(old), run(new)) for _ in range(turns + 1)][1:]
        for case in pairs[0][0]:
            then, now = ([turn[k][case] for turn in pairs] for k in (0, 1))
            ratio = statistics.median(a / b for a, b in zip(then, now, strict=True))
            yield case, statistics.median(then), statistics.median(now), ratio


if __name__ == "__main__":
    print("| case | then | now | then / now |\n|---|---:|---:|---:|")
    with checkout_of(sys.argv[1]) as earlier:
        for name, then, now, ratio in rows_of(earlier, ROOT, COMMANDS, TURNS):
            print(f"| `{name}` | {then:.3g} | {now:.3g} | {ratio:.2f} |", flush=True)
