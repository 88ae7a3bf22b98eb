"""Whole commands of this checkout in turns with those of an earlier one.

``python benchmarks/bench_commands.py [COMMIT]`` prints a table; ``bench.py`` has the same numbers as JSON.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_common import ROOT, case, checkout_of, say

EARLIER = "9600c7e"
"""The build before workers became copies and fonts were thinned, of 2026-11-26."""

TURNS = 3
COMMANDS = {
    "compare": ["-m", "tendonrepro", "compare"],
    "decouple": ["-m", "tendonrepro", "decouple"],
    "reproduce": ["-m", "tendonrepro", "reproduce"],
    "tr.compare()": ["-c", "import tendonrepro as tr; tr.compare()"],
}
"""Python's arguments; ``tr.compare()`` draws and writes nothing."""


def spent(checkout, words):
    """Wall and processor seconds of a fresh process of a checkout, its workers' included."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--quiet", "--out", str(Path(folder) / "out")] if words[0] == "-m" else []
        command = [sys.executable, *words, *options]
        environment = os.environ | {"PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
        started = time.perf_counter()
        process = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
    return seconds, usage.ru_utime + usage.ru_stime


def in_turns(commit, commands, turns):
    """By command: wall and processor seconds then and now, and the medians of then / now turn by turn."""
    found = {}
    with checkout_of(commit) as old:
        for name, words in commands.items():
            # The first turn brings files into memory.
            pairs = [(spent(old, words), spent(ROOT, words)) for _ in range(turns + 1)][1:]
            entry = {}
            for place, clock in enumerate(("seconds", "cpu_seconds")):
                then, now = ([turn[k][place] for turn in pairs] for k in (0, 1))
                entry |= {f"{clock}_then": statistics.median(then), clock: statistics.median(now)}
                ratio = statistics.median(a / b for a, b in zip(then, now, strict=True))
                entry["ratio" if clock == "seconds" else "cpu_ratio"] = ratio
            say(f"{name}: " + ", ".join(f"{key} {value:.2f}" for key, value in entry.items()))
            found[name] = entry
    return found


def commands_case(commit=EARLIER, commands=None, turns=TURNS):
    """Entry of the result; without git or that commit it tells of no command."""
    try:
        found = in_turns(commit, commands or COMMANDS, turns)
    except (OSError, subprocess.CalledProcessError) as error:
        say(f"no turns with {commit}: {error}")
        found = {}
    what = f"whole commands in turns with the build {commit}, medians of {turns}"
    return case(what, None, None, None, {}) | {"commands": found}


def main():
    found = in_turns(sys.argv[1] if len(sys.argv) > 1 else EARLIER, COMMANDS, TURNS)
    print("| command | wall, s, then | now | ratio | processor, s, then | now | ratio |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for name, entry in found.items():
        keys = ("seconds_then", "seconds", "ratio", "cpu_seconds_then", "cpu_seconds", "cpu_ratio")
        print(f"| `{name}` | " + " | ".join(f"{entry[key]:.2f}" for key in keys) + " |")


if __name__ == "__main__":
    main()
