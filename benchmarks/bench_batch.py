"""The batch stepper against both plain baselines, in turns in one process, each speed beside its error."""

from __future__ import annotations

import statistics
import subprocess
import sys
from itertools import chain
from pathlib import Path

from bench_common import IDEAL_ENCODER, bar, case, largest, say, seconds_of, stated_case, tightened

# The package is imported where it is used; see bench.py.

DURATION = 8.0
COUNT = 1000
TURNS = 3
SPREAD = 0.01
"""Largest relative change of a link's mass from plant to plant, so that no two share a number of the arm."""
MIX_DRAWS = 8
"""Draws of the ensemble's mix, each under a hundred cases."""
CHECKED = 4
"""Plants of a batch whose angles are compared with their references."""
PLAIN_RUNS = 20
"""Runs of the numba loop, and of ours alone, in one turn: one is over too soon on a busy machine."""

SMOOTH_FRICTION = tuple(
    f"manipulator.friction.{side}.smoothing_velocity=[0.1, 0.1, 0.1]" for side in ("link", "winch")
)
"""Dry friction turns over 0.1 rad/s, a quarter of the joints' top speed; as shipped it is 0.01 rad/s."""

SOLVE_IVP = {"rtol": 1e-6, "method": "RK45"}
ERROR_BAR_RAD = 1e-8
ALONE_BAR, BATCH_BAR, BATCH_TARGET, SOLVE_IVP_TARGET = 100.0, 4.0, 7.0, 1200.0
CORES_BAR, DEFAULT_SHARE_BAR, COMPILATION_BAR = 1.8, 0.5, 30.0
HELD_OUT_BAR = 4.0

CONTROLLER_2 = ("control.gains.alpha=[0, 0]",)
"""What makes Controller 1 the second."""
STEPS_IN_STEEP_FRICTION = 4
"""Of the numba loop, where dry friction turns over 0.01 rad/s: with fewer it is not stable."""

WHAT = (
    "controller_1 of the shipped configuration plain, joints 2 and 3, first {:g} s, ideal encoder, "
    "friction smoothed over 0.1 rad/s"
)


def batch_cases(duration=DURATION, count=COUNT, turns=TURNS):
    """Both baselines, one experiment alone, a batch on one core and on two, and the default comparison."""
    stated = Stated(duration, (*IDEAL_ENCODER, *SMOOTH_FRICTION), count)
    default = Stated(duration, (), count)
    held_out = Stated(duration, (*IDEAL_ENCODER, *CONTROLLER_2), count)
    errors = errors_of(stated, default, held_out)
    found = []
    for _ in range(turns):
        found.append(one_turn(stated, default, held_out))
        say("batch, ms: " + ", ".join(f"{name} {1e3 * value:.3g}" for name, value in found[-1].items()))
    return entries(found, errors, WHAT.format(duration), stated, default, held_out)


class Stated:
    """Plants of one case: our closed loops and the same numbers for the baselines."""

    def __init__(self, duration, overrides, count):
        self.loop, self.parameters, self.reference = stated_case(duration, overrides)
        self.loops, self.plain = different_plants(self.loop, self.parameters, count)
        self.checked = range(0, count, -(-count // CHECKED))
        # Compiles what is not there yet.
        self.steps = sorted(map(int, set(self.batch(self.loops[:1]).steps)))

    def batch(self, loops, **options):
        from tendonrepro.simulation.batch import simulate_batch

        return simulate_batch(loops, **options)

    def batch_error(self):
        """Largest error of q over the checked plants; a lane does not depend on its neighbours."""
        loops = [self.loops[k] for k in self.checked]
        traces = self.batch(loops, record=True).traces
        return max(error_before_flip(trace, loop) for trace, loop in zip(traces, loops, strict=True))


def different_plants(loop, parameters, count):
    """Closed loops and baselines' parameters with link masses a little different in each."""
    from dataclasses import replace

    import numpy as np

    from tendonrepro.physics.arm import make_arm

    masses = parameters["mass"] * np.random.default_rng(1).uniform(1.0 - SPREAD, 1.0 + SPREAD, (count, 2))
    plain = [parameters | {"mass": mass} for mass in masses]
    fixed = {"phi_0": parameters["start_angle"], "payload_mass": parameters["payload"]}
    arms = [
        make_arm(p["length"], p["mass"], p["com"], p["inertia"], gravity=p["gravity"], **fixed) for p in plain
    ]
    return [replace(loop, plant=loop.plant._replace(arm=arm)) for arm in arms], plain


def truth(loop):
    """Traces with joint angles to 1e-10 rad and better."""
    from tendonrepro.simulation.stepper import simulate

    return simulate(tightened(loop))


def error_before_flip(trace, loop):
    """Largest error of q up to the first encoder count that differs; an ideal encoder has none.

    From there on the two runs differ by whole counts, however exact both are.
    """
    exact = truth(loop)
    differs = abs(trace["q_encoder"] - exact["q_encoder"]).max(axis=1) > loop.joint_encoder.resolution / 2.0
    until = differs.argmax() + 1 if loop.joint_encoder.resolution and differs.any() else len(differs)
    return largest(trace["q"][:until] - exact["q"][:until])


def errors_of(stated, default, held_out):
    """Largest error of q of everything that is timed, rad; this is also what compiles the numba loop."""
    import baseline_numba
    import baseline_solve_ivp

    parameters, reference, exact = stated.parameters, stated.reference, truth(stated.loop)["q"]
    alone = stated.batch([stated.loop], record=True).traces[0]["q"]
    errors = {
        "solve_ivp": largest(baseline_solve_ivp.run(parameters, reference, **SOLVE_IVP) - exact),
        "numba_rk4": largest(baseline_numba.run(parameters, reference) - exact),
        "alone": largest(alone - exact),
        "one_core": stated.batch_error(),
        "default": default.batch_error(),
        "held_out": held_out.batch_error(),
    }
    say("batch, errors of q, rad: " + ", ".join(f"{name} {value:.1e}" for name, value in errors.items()))
    # The number of threads does not change a bit.
    return errors | {"two_cores": errors["one_core"]}


def one_turn(stated, default, held_out):
    """Seconds per experiment of everything, one after the other, so that a busy machine slows all alike."""
    import baseline_numba
    import baseline_solve_ivp

    plain, reference, loops = stated.plain[:PLAIN_RUNS], stated.reference, stated.loops
    few, count = len(plain), len(loops)
    work = {
        "solve_ivp": (1, lambda: baseline_solve_ivp.run(stated.parameters, reference, **SOLVE_IVP)),
        "alone": (few, lambda: [stated.batch([loop]) for loop in loops[:few]]),
        "numba_rk4": (few, lambda: [baseline_numba.run(parameters, reference) for parameters in plain]),
        "one_core": (count, lambda: stated.batch(loops)),
        "two_cores": (count, lambda: stated.batch(loops, threads=2)),
        "default": (count, lambda: default.batch(default.loops)),
        "held_out": (count, lambda: held_out.batch(held_out.loops)),
        "held_out_numba": (
            few,
            lambda: [
                baseline_numba.run(parameters, held_out.reference, STEPS_IN_STEEP_FRICTION)
                for parameters in held_out.plain[:few]
            ],
        ),
    }
    return {name: seconds_of(run) / runs for name, (runs, run) in work.items()}


def entries(found, errors, what, stated, default, held_out):
    """Entries of the result from the seconds of every turn."""

    def ratio(slow, fast):
        return statistics.median(turn[slow] / turn[fast] for turn in found)

    def entry(name, detail, bars, baselines=("solve_ivp", "numba_rk4"), **more):
        seconds = statistics.median(turn[name] for turn in found)
        ratios = {baseline: ratio(baseline, name) for baseline in baselines}
        # Torque that jumps with every encoder count is harder to follow; the bar is on the stated case.
        exact = {} if name in ("default", "held_out") else {"max_error_rad": bar(errors[name], ERROR_BAR_RAD)}
        return case(detail, 1.0 / seconds, ratios, errors[name], bars | exact) | {"seconds": seconds} | more

    def at_least(slow, fast, limit):
        return bar(ratio(slow, fast), limit, at_least=True)

    batch, steps = f"{len(stated.loops)} plants, link masses within {SPREAD:.0%}", {"steps": stated.steps}
    one_core = {"ratio_to_numba_rk4": at_least("numba_rk4", "one_core", BATCH_BAR)}
    targets = {
        "ratio_to_numba_rk4": at_least("numba_rk4", "one_core", BATCH_TARGET),
        "ratio_to_solve_ivp": at_least("solve_ivp", "one_core", SOLVE_IVP_TARGET),
    }
    shipped = what.split(", ideal")[0] + ", encoder and friction as shipped, error before a count differs"
    return {
        "plain_solve_ivp": entry("solve_ivp", f"{what}; RK45, rtol 1e-6 and atol 1e-8", {}, ()),
        "plain_numba": entry("numba_rk4", f"{what}; scalar RK4, two steps per sample", {}, ("solve_ivp",)),
        "batch_alone": entry(
            "alone",
            f"{what}; a batch of one",
            {"ratio_to_solve_ivp": at_least("solve_ivp", "alone", ALONE_BAR)},
            **steps,
        ),
        "batch_one_core": entry("one_core", f"{what}; {batch}", one_core, **steps, targets=targets),
        "batch_two_cores": entry(
            "two_cores",
            f"{what}; {batch}, two threads",
            {"ratio_to_one_core": at_least("one_core", "two_cores", CORES_BAR)},
            **steps,
        ),
        "batch_default": entry(
            "default",
            f"{shipped}; {batch}",
            {"share_of_stated_speed": at_least("one_core", "default", DEFAULT_SHARE_BAR)},
            steps=default.steps,
        ),
        "batch_held_out": entry(
            "held_out",
            f"Controller 2, friction as shipped, else as {what}; {batch}",
            {"ratio_to_numba_rk4": at_least("held_out_numba", "held_out", HELD_OUT_BAR)},
            ("held_out_numba",),
            steps=held_out.steps,
        ),
    }


def mix_case(draws=MIX_DRAWS, turns=TURNS):
    """Experiments per second of what an ensemble runs: draws of the shipped box under all its readings."""
    from tendonrepro.monte_carlo.ensemble import load_study
    from tendonrepro.simulation.batch import simulate_batch

    study = load_study(None, (), None, "default")
    box = study.population
    loops = [*chain.from_iterable(box.loops(box.sample(study.seed, 0, 0, draws), study.cases))]
    simulate_batch(loops)  # compiles what is not there yet
    seconds = statistics.median(seconds_of(lambda: simulate_batch(loops)) for _ in range(turns))
    what = f"{len(loops)} runs of {draws} draws of the shipped ensemble, one core"
    return case(what, len(loops) / seconds, None, None, {}) | {"seconds": seconds}


FIRST_RUN = """
import sys
sys.path.insert(0, {folder!r})
from bench_batch import Stated
Stated({duration!r}, {overrides!r}, 1)
"""


def compilation_case(duration=DURATION, overrides=()):
    """Wall time of a process that compiles and runs its first experiment."""
    source = FIRST_RUN.format(folder=str(Path(__file__).parent), duration=duration, overrides=overrides)
    seconds = seconds_of(lambda: subprocess.run([sys.executable, "-c", source], check=True))
    say(f"first experiment: {seconds:.1f} s")
    what = "a process that compiles and runs one default controller_1 experiment as a batch"
    return case(what, None, None, None, {"seconds": bar(seconds, COMPILATION_BAR)})
