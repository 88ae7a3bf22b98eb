"""Benchmarks: one JSON object on standard output, progress on standard error.

Every figure that has a bar is printed beside it; a missed bar is reported, it does not fail the command.
"""

from __future__ import annotations

import json
import os
import platform
import random
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from bench_batch import batch_cases, compilation_case, mix_case
from bench_common import bar, case, cpu, largest, say, seconds_of, stated_case, tightened
from bench_joints import joints_case
from bench_live import live_case

# NumPy and the package are imported where they are used, not here: a child's peak memory counts its parent's
# too until it execs, so this process has to stay small while it measures the commands.

REPEATS = 5
RUN_DURATION = 1.25
"""Simulated seconds of the compared run: the first half stroke, up to the highest speed."""
LADDER = tuple(10.0 ** (-k / 2) for k in range(10, 23))
"""Relative tolerances tried for a baseline, 1e-5 to 1e-11."""
DEFAULT_RTOL = 1e-3
"""Relative tolerance of ``solve_ivp`` where none is given."""
SAME_ERROR = 1.1
"""Errors within this factor count as equal: methods that take one step per sample agree to a few percent."""
BASELINES = {
    "solve_ivp_RK45": ("RK45", LADDER),
    "solve_ivp_DOP853": ("DOP853", LADDER),
    "solve_ivp_RK45_default_tolerance": ("RK45", (DEFAULT_RTOL,)),
}
"""Method and tolerances to choose from; the last is quick, but its error is larger than ours."""
WATCH_INTERVAL = 0.05
"""Seconds between two looks at a command's memory."""

TEXT_ROWS, TEXT_SECONDS_BAR, TEXT_MEMORY_BAR_MB = 750_000, 1.5, 250.0
TEXT_SIGNALS = ("q_d", "q", "dq", "tau")

RATIO_BAR, COMMAND_SECONDS_BAR, COMMAND_MEMORY_BAR_MB, HELP_SECONDS_BAR = 5.0, 15.0, 680.0, 0.3


def main():
    with tempfile.TemporaryDirectory() as folder:
        cases = {
            "help": help_case(REPEATS),
            "whole_command": command_case(
                ["compare", "--config", "plain", "--out", str(Path(folder) / "compare")], 3
            ),
            "reading": reading_case(Path(folder)),
        }
    cases["first_compilation"] = compilation_case()
    cases["compare_run"] = compare_case(RUN_DURATION, BASELINES, 3)
    cases |= batch_cases()
    cases["ensemble_mix"] = mix_case()
    cases["joints"] = joints_case()
    cases["live"] = live_case()
    found = {"schema_version": 1, "cpu": cpu(), "cores": os.cpu_count(), "python": platform.python_version()}
    print(json.dumps(found | {"cases": cases}, indent=2))


def compare_case(duration, baselines, repeats):
    """One Controller 1 run with the shipped solver against plain loops at an equal error of q."""
    from tendonrepro.simulation.stepper import simulate

    loop, parameters, reference = stated_case(duration)
    truth = simulate(tightened(loop))["q"]
    error = largest(simulate(loop)["q"] - truth)
    say(f"package: error {error:.1e} rad")
    found = {}
    for name, (method, ladder) in baselines.items():
        found[name] = against(loop, truth, error, plain_run(parameters, reference, method), ladder, repeats)
        say(f"{name}: " + ", ".join(f"{key} {value:.3g}" for key, value in found[name].items()))
    seconds = statistics.median(entry["seconds_ours_beside_it"] for entry in found.values())
    ratios = {name: entry["ratio"] for name, entry in found.items()}
    bars = {"smallest_ratio": bar(min(ratios.values()), RATIO_BAR, at_least=True)}
    what = f"controller_1 of the shipped configuration plain, ideal encoder, first {duration:g} s"
    return case(what, 1.0 / seconds, ratios, error, bars) | {"seconds": seconds, "baselines": found}


def against(loop, truth, error, plain, ladder, repeats):
    """Times of the package and of one baseline at the tolerance that makes their errors equal."""
    from tendonrepro.simulation.stepper import simulate

    rtol, plain_error = matching_tolerance(ladder, error, lambda rtol: largest(plain(rtol) - truth))
    seconds, plain_seconds, ratio = timed_in_turns(lambda: simulate(loop), lambda: plain(rtol), repeats)
    return {
        "rtol": rtol,
        "max_error_rad": plain_error,
        "error_matched": plain_error <= SAME_ERROR * error,
        "seconds": plain_seconds,
        "seconds_ours_beside_it": seconds,
        "ratio": ratio,
    }


def plain_run(parameters, reference, method):
    """A baseline's run as a function of its tolerance."""
    import baseline_solve_ivp

    return lambda rtol: baseline_solve_ivp.run(parameters, reference, rtol, method)


def matching_tolerance(ladder, target, error_at):
    """Loosest tolerance whose error is no larger than the target, and that error; else the most exact one."""
    tried = []
    for rtol in ladder:
        tried.append((error_at(rtol), rtol))
        if tried[-1][0] <= SAME_ERROR * target:
            return rtol, tried[-1][0]
    error, rtol = min(tried)
    return rtol, error


def timed_in_turns(ours, theirs, repeats):
    """Median seconds of both and median ratio of neighbours, so that a busy machine slows both alike."""
    pairs = []
    for _ in range(repeats):
        pairs.append((seconds_of(ours), seconds_of(theirs)))
    return (
        statistics.median(pair[0] for pair in pairs),
        statistics.median(pair[1] for pair in pairs),
        statistics.median(pair[1] / pair[0] for pair in pairs),
    )


def command_case(arguments, repeats):
    """Wall time and peak memory of a command after a run that brings files into memory.

    Processor time stands beside them, because other work on the machine lengthens it less than wall time.
    """
    run_command(arguments)
    runs = [run_command(arguments) for _ in range(repeats)]
    seconds = statistics.median(run[0] for run in runs)
    memory = max(run[1] for run in runs)
    bars = {
        "seconds": bar(seconds, COMMAND_SECONDS_BAR),
        "peak_memory_mb": bar(memory, COMMAND_MEMORY_BAR_MB),
    }
    cpu_seconds = statistics.median(run[2] for run in runs)
    say(f"{arguments[0]}: {seconds:.2f} s, {cpu_seconds:.2f} s of them computing, {memory:.0f} MB")
    what = f"tendonrepro {arguments[0]}, median of {repeats}"
    return case(what, 1.0 / seconds, None, None, bars) | {"cpu_seconds": cpu_seconds}


def reading_case(folder):
    """A made text of eight signals read by a process of its own."""
    rng, path = random.Random(1), folder / "SYNTHETIC.csv"
    with path.open("w") as stream:
        stream.write(
            "time (s)," + ",".join(f"{name}{joint}" for joint in (2, 3) for name in TEXT_SIGNALS) + "\n"
        )
        rows = ["".join(f",{rng.gauss(0.0, 30.0):.4f}" for _ in range(8)) for _ in range(1000)]
        for k in range(TEXT_ROWS):
            stream.write(f"{0.001 * k:.4f}{rows[k % 1000]}\n")
    script = (
        "import resource, sys, time; from pathlib import Path; "
        "from tendonrepro.dataset.read import read_files; start = time.perf_counter(), time.process_time(); "
        "read_files([Path(sys.argv[1])]); "
        "print(time.perf_counter() - start[0], time.process_time() - start[1], "
        "resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    )
    command = [sys.executable, "-c", script, str(path)]
    runs = [
        subprocess.run(command, check=True, capture_output=True, text=True).stdout.split() for _ in range(3)
    ]
    seconds, cpu_seconds, memory = (statistics.median(float(run[k]) for run in runs) for k in range(3))
    size = path.stat().st_size / 1e6
    bars = {"seconds": bar(seconds, TEXT_SECONDS_BAR), "peak_memory_mb": bar(memory, TEXT_MEMORY_BAR_MB)}
    say(f"reading {size:.0f} MB: {seconds:.2f} s, {cpu_seconds:.2f} s of them computing, {memory:.0f} MB")
    what = f"a text of {size:.0f} MB read, median of 3"
    return case(what, None, None, None, bars) | {"cpu_seconds": cpu_seconds}


def help_case(repeats):
    """Wall time of ``tendonrepro --help``."""
    run_command(["--help"])
    seconds = statistics.median(run_command(["--help"])[0] for _ in range(repeats))
    say(f"--help: {seconds:.2f} s")
    what = f"tendonrepro --help, median of {repeats}"
    return case(what, None, None, None, {"seconds": bar(seconds, HELP_SECONDS_BAR)})


def run_command(arguments):
    """Wall time, s, peak memory, MB, and processor time, s, of one command of the package and its workers.

    Memory is that of all processes together, and without ``/proc`` that of the largest one.
    """
    command = [sys.executable, "-m", "tendonrepro", *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        started = time.perf_counter()
        sums, ended = [0.0], threading.Event()
        watch = threading.Thread(target=watch_memory, args=(process.pid, sums, ended))
        watch.start()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        ended.set()
        watch.join()
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    per_mb = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    memory = max(usage.ru_maxrss / per_mb, *sums)
    return seconds, memory, usage.ru_utime + usage.ru_stime


def watch_memory(pid, sums, ended):
    """Append the memory of a process and its descendants, MB, now and then."""
    while not ended.wait(WATCH_INTERVAL):
        sums.append(together_mb(descendants(pid)))


def together_mb(pids):
    """Memory of processes, MB: what several of them share is counted once."""
    sizes = [kilobytes("Pss", read_if_there(Path(f"/proc/{pid}/smaps_rollup"))) for pid in pids]
    return sum(sizes) * 1024 / 1e6


def descendants(pid):
    """The process and those it started, as far as they are still there."""
    yield pid
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in read_if_there(task).split():
            yield from descendants(int(child))


def kilobytes(name, status):
    found = re.search(rf"^{name}:\s+(\d+) kB", status, re.MULTILINE)
    return int(found[1]) if found else 0


def read_if_there(path):
    """Text of a file of a process that may end at any time."""
    try:
        return path.read_text()
    except OSError:
        return ""


if __name__ == "__main__":
    main()
