"""How often `tendonrepro data recover` is right: readings x records, on plants of the parameter ranges.

``python benchmarks/recovery.py`` stores in docs/results/recover.json what docs/recover.md is about: of two
plants, in seven minutes of a processor for each record. ``--intervals`` makes intervals alone, in seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.readings import parse_reading, under
from tendonrepro.console import QUIET
from tendonrepro.evidence.fit import fitted, rows_of_all
from tendonrepro.evidence.hypotheses import LINEAR, NTSM, PID, Hypothesis
from tendonrepro.evidence.log import Log, read_logs
from tendonrepro.evidence.recover import NONE, RECOVERED, recover_controllers
from tendonrepro.experiments.loops import build_loops
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.physics.arm import gravity_torque
from tendonrepro.physics.control import estimator_weights
from tendonrepro.results.records import PlantRecord, PlantValue, Trace, TraceFile
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import TimeDelayController
from tendonrepro.simulation.stepper import simulate

CASES = (
    ("controller_1", "printed"),
    ("controller_1", "weights=extrapolating"),
    ("controller_1", "Delta_unit=deg"),
    ("controller_1", "differencing=centred"),
    ("controller_1", "error_rate=difference_of_error"),
    ("controller_2", "printed"),
    ("controller_3", "printed"),
)
"""Runs of the paper's controllers, each under a reading."""
FOREIGN = {
    "PD": lambda now: 60.0 * now.e + 3.0 * now.de,
    "PD with gravity": lambda now: now.weight + 60.0 * now.e + 3.0 * now.de,
    "PD with gravity, stiff": lambda now: now.weight + 300.0 * now.e + 8.0 * now.de,
    "PID": lambda now: now.tau_before + 3.0 * (now.de - now.de_before) + 0.06 * now.de + 0.15 * now.e,
    "PID near the published gains": lambda now: (
        now.tau_before + 9.0 * (now.de - now.de_before) + 0.15 * now.de + 0.2 * now.e
    ),
    "sliding mode with gravity": lambda now: now.weight + 30.0 * np.tanh(now.de + 8.0 * now.e),
}
"""Negative controls: torque, N m, from errors, rad, their rates and what was commanded before."""
RECORDS = {
    "torque to 1 mN m, angles to 0.001 deg": {"torque": 1e-3, "angle": 1e-3},
    "torque to 10 mN m, angles to 0.001 deg": {"torque": 1e-2, "angle": 1e-3},
    "the first, of unequal samples": {"torque": 1e-3, "angle": 1e-3, "lost": 0.03, "jitter": 2e-5},
    "the first at 100 Hz": {"torque": 1e-3, "angle": 1e-3, "every": 10},
    "all digits": {},
}
SAMPLES = 20000
RIGHT, HALF, WRONG = "right", "half", "wrong"
"""Half right are weights without the reading, and another controller beside which a PID is named."""


def drawn_plants(plants: int):
    """Plants of the ranges, with what was drawn: of every second one the motion is a raised cosine."""
    loaded, cosine = load_ensemble(None), load_config("compare_cosine", "compare").config.reference
    box = population_of(loaded)
    for place, row in enumerate(box.sample(7, 0, 0, 16 * plants)):
        drawn = box.configured(row)
        yield drawn.model_copy(update={"reference": cosine}) if place % 2 else drawn, box.named(row)


def logs(plants: int) -> list[tuple[str, Log]]:
    """Runs that end neither diverged nor ringing, with the controller and the reading they ran under."""
    folder, found = load_ensemble(None).base.folder, []
    for drawn, known in drawn_plants(plants):
        runs = [
            dict(build_loops(under(parse_reading(reading), drawn, known), folder))[run]
            for run, reading in CASES
        ]
        batch = simulate_batch(runs, record=True)
        if batch.traces and not batch.status.any():
            found += [
                (" ".join(case), log_of(trace, run))
                for case, trace, run in zip(CASES, batch.traces, runs, strict=True)
            ]
        if len(found) == plants * len(CASES):
            break
    return found


def foreign_logs(plants: int) -> list[tuple[str, Log]]:
    """Runs of controllers that are none of the paper's, on as many plants."""
    folder, found = load_ensemble(None).base.folder, []
    for drawn, _ in drawn_plants(plants):
        run = dict(build_loops(drawn, folder))["controller_1"]
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
    reference = run.reference
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
        expected=config,
        angle_rounding=np.zeros(len(config.joints)),
        torque_rounding=np.zeros(len(config.joints)),
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
    rng, samples = np.random.default_rng(2), len(log.q)
    rows = np.sort(rng.choice(samples, round((1.0 - record.get("lost", 0.0)) * samples), replace=False))
    rows = rows[rows % every == 0]
    time = log.L * rows + rng.normal(scale=record.get("jitter", 0.0), size=len(rows))
    trace = Trace("run", time, joints, {name: values[rows] for name, values in variables.items()}, {})
    plant = PlantRecord({"S": PlantValue(log.S, "1", "", "")}, {})
    return TraceFile("compare", "measured", "", {"run": trace}, plant, "", "", {})


def truth_of(name: str) -> tuple[Hypothesis, str]:
    """What made a log of the paper's, and which weights it has."""
    run, _, reading = name.partition(" ")
    settings = () if reading in ("printed", "weights=extrapolating") else (tuple(reading.split("=")),)
    extrapolates = reading == "weights=extrapolating"
    weights = "tde" if run != "controller_1" else "extrapolating" if extrapolates else "interpolating"
    return Hypothesis(LINEAR if run == "controller_3" else NTSM, settings), weights


def true_weights(weights: str) -> np.ndarray:
    """Weights (2, n) of the two joints."""
    alpha = load_config(None, "compare").config.control.gains.alpha.si
    return estimator_weights(*((0.0 * alpha, "interpolating") if weights == "tde" else (alpha, weights)))


def intervals(runs: list[tuple[str, Log]], record: dict[str, float]) -> dict[str, int]:
    """How many 90 % intervals of the true hypothesis hold both weights, M_bar, and the gain of the error."""
    held: Counter[str] = Counter()
    for name, log in runs:
        held.update(key for keys in _held(name, log, record) for key in ("joints", *keys))
    return dict(held)


def _held(name: str, log: Log, record: dict[str, float]) -> Iterator[list[str]]:
    (hypothesis, weights), expected = truth_of(name), load_config(None, "compare").config
    ((read,), _), gains = read_logs(file_of(log, record), expected), expected.control.gains
    for place in range(len(read.joints)):
        rows = rows_of_all(read, place, [hypothesis, Hypothesis(LINEAR), PID])
        fit = fitted(read, place, hypothesis, rows)
        off = np.abs(fit.parameters[:3] - [*true_weights(weights)[:, place], gains.M_bar.si[place]])
        other = gains.beta if hypothesis.surface == LINEAR else gains.eta
        gain = gains.lam.si[place] * other.si[place]
        inside = {"weights": (off <= fit.half[:3])[:2].all(), "M_bar": off[2] <= fit.half[2],
                  "gain": abs(fit.error_gain - gain) <= fit.error_gain_half}  # fmt: skip
        yield [key for key, holds in inside.items() if holds]


def judged(name: str, log: Log, record: dict[str, float]) -> list[str]:
    """For each joint `RIGHT`, `HALF`, `WRONG`, or what `recover` says."""
    answers = []
    for one in recover_controllers(file_of(log, record), load_config(None, "compare"), QUIET):
        found = one.answer
        if found == RECOVERED and name in FOREIGN:
            found = HALF if one.pid else WRONG
        elif found == RECOVERED:
            truth, weights = truth_of(name)
            named = [fit.hypothesis for fit in one.equal]
            right_law = one.weights == weights and truth.surface in {each.surface for each in named}
            found = WRONG if not right_law else RIGHT if truth in named else HALF
        elif found == NONE and name not in FOREIGN:
            found = WRONG
        answers.append(found)
    return answers


RESULTS = Path(__file__).parents[1] / "docs" / "results" / "recover.json"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("records", nargs="*", default=list(RECORDS), help="some of them, by name")
    options.add_argument("--plants", type=int, default=2)
    options.add_argument("--intervals", action="store_true")
    asked = options.parse_args()
    paper, foreign = logs(asked.plants), [] if asked.intervals else foreign_logs(asked.plants)
    stored = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    # Answers of other plants do not stand beside these.
    stored = stored if stored.get("plants") == asked.plants else {"plants": asked.plants, "records": {}}
    for title in asked.records:
        found = stored["records"].setdefault(title, {})
        if "every" not in RECORDS[title]:
            found["intervals"] = intervals(paper, RECORDS[title])
        if not asked.intervals:
            found |= {"paper": counted(paper, title), "foreign": counted(foreign, title)}
        RESULTS.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def counted(runs: list[tuple[str, Log]], title: str) -> dict[str, int]:
    """How often each answer was given, by joints."""
    counts: Counter[str] = Counter()
    for name, log in runs:
        answers = judged(name, log, RECORDS[title])
        print(f"{title}: {name}: {answers}", file=sys.stderr, flush=True)
        counts.update(answers)
    return dict(counts)


if __name__ == "__main__":
    main()
