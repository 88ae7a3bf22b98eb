"""How often `tendonrepro data recover` is right: readings x records, on plants of the parameter ranges.

Prints the tables of docs/recover.md. ``python benchmarks/recovery.py 10`` takes ten plants and some hours.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.readings import parse_reading, under
from tendonrepro.console import QUIET
from tendonrepro.evidence.controller import NONE, RECOVERED, UNTOLD
from tendonrepro.evidence.fit import equally_good
from tendonrepro.evidence.log import Log
from tendonrepro.evidence.recover import recover_controllers
from tendonrepro.experiments.loops import build_loops
from tendonrepro.monte_carlo.box import configured, make_box, scrambled_sobol
from tendonrepro.physics.arm import gravity_torque
from tendonrepro.physics.control import estimator_weights
from tendonrepro.results.records import PlantRecord, PlantValue, Trace, TraceFile
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import TimeDelayController
from tendonrepro.simulation.stepper import simulate

READINGS = (
    "printed",
    "weights=extrapolating",
    "Delta_unit=deg",
    "differencing=centred",
    "error_rate=difference_of_error",
)
FOREIGN = {
    "PD": lambda now: 60.0 * now.e + 3.0 * now.de,
    "PD with gravity": lambda now: now.weight + 60.0 * now.e + 3.0 * now.de,
    "PD with gravity, stiff": lambda now: now.weight + 300.0 * now.e + 8.0 * now.de,
    "PID": lambda now: now.tau_before + 3.0 * (now.de - now.de_before) + 0.06 * now.de + 0.15 * now.e,
    "sliding mode with gravity": lambda now: now.weight + 30.0 * np.tanh(now.de + 8.0 * now.e),
}
"""Negative controls: torque, N m, from errors, rad, their rates and what was commanded before."""
RECORDS = {
    "torque to 1 mN m, angles to 0.001 deg": {"torque": 1e-3, "angle": 1e-3},
    "torque to 10 mN m, angles to 0.001 deg": {"torque": 1e-2, "angle": 1e-3},
    "the first at 100 Hz": {"torque": 1e-3, "angle": 1e-3, "every": 10},
    "all digits": {},
}
SAMPLES = 4000
RIGHT, WEIGHTS, WRONG = "right", "weights alone right", "wrong"


def logs(plants: int) -> list[tuple[str, Log]]:
    """Runs of Controller 1 that end neither diverged nor ringing, with the reading they ran under."""
    loaded, found = load_ensemble(None), []
    box = make_box(loaded.config)
    for row in box.values(scrambled_sobol(box, 7, 0, 0, 16 * plants)):
        drawn = configured(loaded.base, box, row)
        known = box.named(row)
        runs = [
            dict(build_loops(under(parse_reading(name), drawn, known), loaded.base.folder))["controller_1"]
            for name in READINGS
        ]
        batch = simulate_batch(runs, drawn.status, record=True)
        if batch.traces and not batch.status.any():
            found += [
                (name, log_of(trace, run))
                for name, trace, run in zip(READINGS, batch.traces, runs, strict=True)
            ]
        if len(found) == plants * len(READINGS):
            break
    return found


def foreign_logs(plants: int) -> list[tuple[str, Log]]:
    """Runs of controllers that are none of the paper's, on as many plants."""
    loaded, found = load_ensemble(None), []
    box = make_box(loaded.config)
    for row in box.values(scrambled_sobol(box, 7, 0, 0, 16 * plants)):
        drawn = configured(loaded.base, box, row)
        run = dict(build_loops(drawn, loaded.base.folder))["controller_1"]
        reference = run.reference
        short = replace(
            reference, **{key: getattr(reference, key)[:SAMPLES] for key in ("time", "q_d", "dq_d", "ddq_d")}
        )
        for name, torque in FOREIGN.items():
            law = TimeDelayController(run.controller.law, command_of(torque, run))
            trace = simulate(replace(run, controller=law, reference=short))
            if len(trace["time"]) == SAMPLES:
                found.append((name, log_of(trace, run)))
        if len(found) >= plants * len(FOREIGN):
            break
    return found


def command_of(torque, run):
    """A foreign law with the signature of the paper's."""

    def command(memory, q, q_d, dq_d, _ddq_d, law):
        e, de = q_d - q, dq_d - (q - memory.q[0]) / law.L
        weight = gravity_torque(q, run.plant.arm)
        now = SimpleNamespace(e=e, de=de, weight=weight, tau_before=memory.tau[0], de_before=memory.de)
        return torque(now), *[np.full(q.shape, np.nan)] * 2, de

    return command


def log_of(trace, run) -> Log:
    config, part = load_config(None, "compare").config, slice(0, SAMPLES)
    gains, reference = config.control.gains, run.reference
    return Log(
        run="run",
        joints=config.joints,
        L=run.controller.law.L,
        q=trace["q_encoder"][part],
        q_motor=None,
        q_d=reference.q_d[part],
        dq_d=reference.dq_d[part],
        ddq_d=reference.ddq_d[part],
        command=trace["tau_m"][part],
        applied=None,
        S=run.plant.drive.S,
        b=gains.b.si,
        Delta=gains.Delta.si,
        angle_rounding=np.zeros(len(config.joints)),
        encoder_step=config.manipulator.encoders.joint.resolution.si,
    )


def file_of(log: Log, record: dict[str, float]) -> TraceFile:
    """A log as a lab would have it: time, desired angle, encoder and torque, every column rounded."""

    def coarse(values, step):
        return np.round(values / step) * step if step else values

    every, angle = int(record.get("every", 1)), np.deg2rad(record.get("angle", 0.0))
    variables = {
        "q_d": coarse(log.q_d, angle),
        "q_encoder": coarse(log.q, angle),
        "tau_m": coarse(log.command, record.get("torque", 0.0)),
    }
    joints = load_config(None, "compare").config.joints
    time = log.L * np.arange(len(log.q))
    kept = {name: values[::every] for name, values in variables.items()}
    trace = Trace("run", time[::every], joints, kept, {})
    plant = PlantRecord({"S": PlantValue(log.S, "1", "", "")}, {})
    return TraceFile("compare", "measured", "", {"run": trace}, plant, "", "", {})


def judged(name: str, log: Log, record: dict[str, float]) -> list[tuple[str, bool | None]]:
    """For each joint `RIGHT`, `WEIGHTS`, `WRONG`, or what `recover` says; do intervals hold the truth?"""
    answers = []
    file, published = file_of(log, record), load_config(None, "compare")
    weights = "extrapolating" if "extrapolating" in name else "interpolating"
    true = estimator_weights(published.config.control.gains.alpha.si, weights)
    for place, one in enumerate(recover_controllers(file, published, QUIET)):
        names = {fit.hypothesis.name for fit in equally_good(one.fits)} if one.fits else set()
        found, holds = one.answer, None
        if one.prints_weights and name not in FOREIGN:
            apart = np.abs(one.best.parameters[:2] - true[:, place])
            holds = bool((apart <= one.half[:2]).all())
        if found == RECOVERED:
            is_among = name.replace(f"weights={weights}", "printed") in names
            found = WRONG if one.weights != weights or name in FOREIGN else RIGHT if is_among else WEIGHTS
        answers.append((found, holds))
    return answers


def main() -> None:
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    for runs, keys in (
        (logs(plants), (RIGHT, WEIGHTS, UNTOLD, NONE, WRONG)),
        (foreign_logs(plants), (NONE, UNTOLD, WRONG)),
    ):
        print(f"| record | joints | {' | '.join(keys)} | intervals |\n|---|---:|{'---:|' * len(keys)}---:|")
        for title, record in RECORDS.items():
            found = [judged(name, log, record) for name, log in runs]
            counts = Counter(answer for answers in found for answer, _ in answers)
            printed = [holds for answers in found for _, holds in answers if holds is not None]
            total = sum(counts.values())
            cells = [f"{100 * counts[key] / total:.0f} %" for key in keys]
            held = f"{sum(printed)} of {len(printed)}"
            print(f"| {title} | {total} | {' | '.join(cells)} | {held} |", flush=True)
            for (name, _), answers in zip(runs, found, strict=True):
                if WRONG in dict(answers):
                    print(f"{title}: {name} is wrong", file=sys.stderr)


if __name__ == "__main__":
    main()
