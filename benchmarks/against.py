"""The batch stepper of this checkout against that of an older commit, in turns on one machine.

``python benchmarks/against.py COMMIT`` prints, for the ensemble's mix and the shipped default case, the speed
of both and the median of their ratios turn by turn. Each build runs its own benchmarks, in its own process.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

from bench_common import ROOT, checkout_of

TURNS = 5

SNIPPET = """
import json, sys
sys.path.insert(0, "benchmarks")
from bench_batch import Stated, mix_case
from bench_common import seconds_of
default = Stated(8.0, (), 1000)
default.batch(default.loops)
seconds = seconds_of(lambda: default.batch(default.loops))
mix = mix_case(turns=1)["experiments_per_second"]
print(json.dumps({"ensemble_mix": mix, "batch_default": 1000 / seconds}))
"""


def speeds(checkout: Path) -> dict[str, float]:
    """Experiments per second of a checkout, by case."""
    environment = os.environ | {"PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", SNIPPET],
        cwd=checkout,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    commit = sys.argv[1]
    with checkout_of(commit) as old:
        turns = [(speeds(old), speeds(ROOT)) for _ in range(TURNS)]
    print("| case | then, experiments/s | now | ratio, median of the turns |\n|---|---:|---:|---:|")
    for case in turns[0][0]:
        then, now = ([turn[k][case] for turn in turns] for k in (0, 1))
        ratio = statistics.median(b / a for a, b in zip(then, now, strict=True))
        print(f"| `{case}` | {statistics.median(then):.0f} | {statistics.median(now):.0f} | {ratio:.2f} |")


if __name__ == "__main__":
    main()
