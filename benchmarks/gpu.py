"""``--device gpu`` against JAX and against the processor, in one run of some minutes; prints one JSON object.

    python benchmarks/gpu.py                          # on a machine with a GPU
    python benchmarks/gpu.py --device cpu --count 16 --draws 1 --seconds 0.5   # what a processor can try

It needs ``pip install 'tendonrepro[gpu]'``, and for its case ``pip install "jax[cuda12]"``. Two cases:

held_out
    As ``batch_held_out`` of bench.py: Controller 2 on plants with other link masses, ideal encoder, friction
    as shipped, first 8 s. JAX gets the same tape with four steps a sample, as ``vmap`` over ``scan``, and
    keeps the mean error alone; ours keeps all statistics.
printed
    Draws of the shipped ranges as published, with ideal encoders so that both devices must agree.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from itertools import chain

import numpy as np
from bench_batch import CONTROLLER_2, STEPS_IN_STEEP_FRICTION, different_plants
from bench_common import IDEAL_ENCODER, say, stated_case

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.monte_carlo.box import scrambled_sobol
from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.monte_carlo.plants import drawn_loops
from tendonrepro.parallel import processors
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.codegen.lanes import stacked
from tendonrepro.simulation.codegen.symbols import as_operand, needed
from tendonrepro.simulation.device import graphics
from tendonrepro.simulation.kernel import experiment_tape
from tendonrepro.simulation.parts import Part, law_numbers, plant_needs, thread_part
from tendonrepro.simulation.resolution import TOLERANCE

LIMITS = load_config(None, "compare").config.status


def timed(work):
    """Result and seconds."""
    started = time.perf_counter()
    found = work()
    return found, time.perf_counter() - started


def speeds(loops, device):
    """Batch, and seconds of a first call, which compiles, of a second, and of its kernels alone."""
    threads = processors() if device == "cpu" else 1
    run = lambda: simulate_batch(loops, LIMITS, device=device, threads=threads)  # noqa: E731
    _, first = timed(run)
    launches = clocked() if device == "gpu" else []
    batch, second = timed(run)
    say(f"{device}: {len(loops)} experiments, {first:.2f} s with compiling, {second:.2f} s without")
    found = {
        "experiments": len(loops),
        "seconds_with_compiling": first,
        "seconds": second,
        "experiments_per_second": len(loops) / second,
    }
    if launches:
        found["seconds_in_kernels"] = sum(launches)
        found["experiments_per_second_in_kernels"] = len(loops) / sum(launches)
    return batch, found


def clocked():
    """Seconds of each launch from now on."""
    gpu, seconds = graphics(), []

    def launch(entry, lanes, arguments):
        _, took = timed(lambda: type(gpu).launch(gpu, entry, lanes, arguments))
        seconds.append(took)

    gpu.launch = launch
    return seconds


def differences(found, expected):
    """How two batches differ: statuses, and the mean error of runs that end well in both, rad."""
    ok = (found.status == 0) & (expected.status == 0)
    error = np.abs(found.statistics["mae"] - expected.statistics["mae"])[ok]
    return {
        "other_status": int((found.status != expected.status).sum()),
        "of": len(ok),
        "largest_difference_of_mae_rad": float(error.max(initial=0.0)),
    }


def held_out(count, seconds, device):
    """The stated case on a device and in JAX."""
    loop, parameters, _ = stated_case(seconds, (*IDEAL_ENCODER, *CONTROLLER_2))
    loops, _ = different_plants(loop, parameters, count)
    batch, ours = speeds(loops, device)
    some = loops[: min(count, 1000)]
    expected, cpu = speeds(some, "cpu")
    case = {"ours": ours, "cpu": cpu | {"cores": processors()}}
    at_first = type(batch)(
        {name: values[: len(some)] for name, values in batch.statistics.items()},
        batch.status[: len(some)],
        batch.status_time[: len(some)],
        batch.steps[: len(some)],
    )
    case["against_cpu"] = differences(at_first, expected)
    try:
        import jax
    except ImportError:
        say("JAX is not installed, and left out")
        return case | {"jax": None}
    mae, jax_speed = by_jax(jax, loops)
    jax_speed["largest_difference_of_mae_rad"] = float(np.abs(mae - batch.statistics["mae"]).max())
    return case | {"jax": jax_speed, "ours_over_jax": jax_speed["seconds"] / ours["seconds"]}


def by_jax(jax, loops):
    """Mean absolute errors (N, n) by JAX on the same tape, and its speed."""
    jax.config.update("jax_enable_x64", True)
    members = dict(enumerate(loops))
    steps, rest = plant_needs(members, TOLERANCE, map)
    numbers = law_numbers([(loop, rest[k]) for k, loop in members.items()], lambda _: 1)
    code = experiment_tape(stacked([loop.plant for loop in loops]), numbers, STEPS_IN_STEEP_FRICTION)
    started = thread_part(members, rest, steps, lambda _: 1)
    rows = Part(code.rows, started.start, started.column).numbers([*members])
    named, n = code.rows.named, loops[0].plant.preload.size
    rows[named["period"]] = loops[0].L
    held, sample = loops[0].reference, in_jax(jax, code)
    desired = jax.numpy.asarray(np.hstack([held.q_d, held.dq_d, held.ddq_d]))

    def step(carry, given):
        w, total = carry
        k, motion = given
        w = sample(w.at[named["desired"] : named["desired"] + 3 * n].set(motion), k, k * loops[0].L)
        measured = w[named["trace"] + 4 * n : named["trace"] + 5 * n]
        return (w, total + jax.numpy.abs(motion[:n] - measured)), None

    def one(w):
        (_, total), _ = jax.lax.scan(step, (w, jax.numpy.zeros(n)), (numbers_of, desired))
        return total / len(held.time)

    numbers_of = jax.numpy.arange(len(held.time), dtype=jax.numpy.float64)
    run = jax.jit(jax.vmap(one))
    given = jax.numpy.asarray(rows.T)
    _, first = timed(lambda: run(given).block_until_ready())
    mae, second = timed(lambda: run(given).block_until_ready())
    say(f"JAX on {jax.devices()[0]}: {first:.2f} s with compiling, {second:.2f} s without")
    return np.asarray(mae), {
        "device": str(jax.devices()[0]),
        "version": jax.__version__,
        "seconds_with_compiling": first,
        "seconds": second,
        "experiments_per_second": len(loops) / second,
    }


def in_jax(jax, code):
    """The tape as a function of rows (rows,), sample and time that gives the rows after it."""
    np_ = jax.numpy
    apply = {
        "+": np_.add, "-": np_.subtract, "*": np_.multiply, "/": np_.divide,
        ">=": np_.greater_equal, ">": np_.greater, "<=": np_.less_equal, "<": np_.less,
        "abs": np_.abs, "sqrt": np_.sqrt, "floor": np_.floor, "exp2": np_.exp2, "negative": np_.negative,
        "alternating": lambda x: 1.0 - 2.0 * (x % 2.0),
        "mantissa": lambda x: np_.frexp(x)[0],
        "exponent": lambda x: np_.frexp(x)[1].astype(np_.float64),
        "choose": lambda condition, then, otherwise: np_.where(condition != 0.0, then, otherwise),
    }  # fmt: skip
    results = {row: as_operand(value) for row, value in code.written.items()}
    order = needed(code.tape.lines, results.values())

    def tape(w, k, t):
        known = {}
        value = lambda operand: known[operand] if isinstance(operand, str) else operand  # noqa: E731
        for name in order:
            operation, operands = code.tape.lines[name]
            if operation == "row":
                known[name] = w[int(operands[0])]
            elif operation in ("sample", "time"):
                known[name] = k if operation == "sample" else t
            else:
                known[name] = np_.asarray(apply[operation](*map(value, operands)), dtype=np_.float64)
        after = np_.stack([np_.asarray(value(held), np_.float64) for held in results.values()])
        return w.at[np.array([*results])].set(after)

    return tape


def printed(draws, device):
    """Draws of the shipped ranges on both devices, and what making their loops costs."""
    study = load_study(None, (), None, "encoder=ideal")
    box = study.boxes["box"]
    values: Array = box.values(scrambled_sobol(box, study.seed, 0, 0, draws))
    cases = [case for case in study.cases if "encoder=ideal" in case[1].name]

    def loops_of(rows):
        return [*chain.from_iterable(drawn_loops(study.loaded.base, box, rows, cases))]

    loops, seconds = timed(lambda: loops_of(values))
    batch, ours = speeds(loops, device)
    some = loops[: len(cases) * min(draws, 32)]
    expected, cpu = speeds(some, "cpu")
    first = slice(0, len(some))
    part = type(batch)(
        {name: held[first] for name, held in batch.statistics.items()},
        batch.status[first],
        batch.status_time[first],
        batch.steps[first],
    )
    cpu["cores"] = processors()
    return {"loops_seconds": seconds, "ours": ours, "cpu": cpu, "against_cpu": differences(part, expected)}


def main():
    """Run both cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--device", choices=("cpu", "gpu"), default="gpu")
    parser.add_argument("--count", type=int, default=65536, help="plants of held_out")
    parser.add_argument("--seconds", type=float, default=8.0, help="of a run of held_out")
    parser.add_argument("--draws", type=int, default=512, help="of printed")
    asked = parser.parse_args()
    found = {
        "device": asked.device,
        "machine": platform.platform(),
        "held_out": held_out(asked.count, asked.seconds, asked.device),
        "printed": printed(asked.draws, asked.device),
    }
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
