"""What a run costs on arms of two, three, four and six joints, as ``tendonrepro config init`` writes them."""

from __future__ import annotations

import statistics
import tempfile
import time
from itertools import chain
from pathlib import Path

from bench_common import case, say

JOINTS = (2, 3, 4, 6)
ARMS, SPREAD, TURNS = 32, 0.1, 3


def joints_case():
    """Processor time of Controllers 1 to 3 on arms around each, in turns; ratios to two joints."""
    with tempfile.TemporaryDirectory() as folder:
        batches = {joints: batch_of(joints, Path(folder)) for joints in JOINTS}
    seconds = {joints: [] for joints in JOINTS}
    for _ in range(TURNS):
        for joints, run in batches.items():
            start = time.process_time()
            steps = run()
            seconds[joints].append(time.process_time() - start)
            say(f"joints: {joints} joints, {seconds[joints][-1]:.2f} s, up to {steps} steps a sample")
    each = {joints: statistics.median(found) / (3 * ARMS) for joints, found in seconds.items()}
    what = f"Controllers 1 to 3 on {ARMS} arms within 10 % of those of config init, runs of 15.2 s, one core"
    found = case(what, 1.0 / each[2], {f"{n} joints": each[n] / each[2] for n in JOINTS}, None, {})
    return found | {"milliseconds": {str(n): 1e3 * each[n] for n in JOINTS}}


def batch_of(joints, folder):
    """The runs as a function that gives the most steps a sample; their code is compiled already."""

    from tendonrepro.configuration.any_kind import init_arm
    from tendonrepro.configuration.ensemble import load_plants
    from tendonrepro.configuration.models.readings import parse_reading
    from tendonrepro.monte_carlo.population import population_of
    from tendonrepro.simulation.batch import simulate_batch

    init_arm(joints, folder / str(joints))
    loaded = load_plants(folder / str(joints) / "compare.yaml", SPREAD, None)
    arm = population_of(loaded)
    cases = [(f"controller_{k}", parse_reading("printed")) for k in (1, 2, 3)]
    loops = [*chain.from_iterable(arm.loops(arm.sample(1, 0, 0, ARMS), cases))]
    simulate_batch(loops[:3])
    return lambda: int(simulate_batch(loops).steps.max())
