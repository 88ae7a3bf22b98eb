"""Experiments on a bench: each changes a run, and compares it with one as configured."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from scipy.interpolate import CubicSpline

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.control import FIRST, LOADED, SECOND, THIRD, Readings
from tendonrepro.physics.control import Law, estimator_weights, polynomial
from tendonrepro.simulation.loop import DesiredMotion, Loop, TimeDelayController

PUBLISHED_PERIOD = 1e-3
"""Sampling period, s, of which the doubled one is a variation."""
DOUBLED_PERIOD = "controller_1_period_doubled"
"""Name of Controller 1's loop at twice the published period: its motion and filters are others, too."""

Loops: TypeAlias = Mapping[str, Loop]
"""Loops of one plant by run, and that of `DOUBLED_PERIOD`."""
Change: TypeAlias = Callable[[Loops, Readings], Loop]
"""From the loops of a plant, and the readings that they have, to the loop of the changed run."""


@dataclass(frozen=True)
class BenchExperiment:
    """``change`` makes the loop of the changed run; its error is divided by that of the run ``beside``.

    ``error`` names the statistic of both: of the whole run, or ``mae_settled`` of all after two seconds.
    """

    name: str
    about: str
    change: Change
    beside: str = FIRST
    error: str = "mae"


def _run(name: str, loops: Loops, _: Readings) -> Loop:
    return loops[name]


def with_alpha(alpha: float, loops: Loops, readings: Readings) -> Loop:
    """Controller 1 with one alpha on all joints."""
    law = law_of(loops[FIRST])
    weights = estimator_weights(np.full_like(law.M_bar, alpha), readings.weights)
    return _with_law(loops[FIRST], law._replace(weights=weights))


def _with_law(loop: Loop, law: Law) -> Loop:
    return replace(loop, controller=TimeDelayController(law))


def law_of(loop: Loop) -> Law:
    """The law of a loop of the paper's own."""
    assert isinstance(loop.controller, TimeDelayController)
    return loop.controller.law


def _slower(loops: Loops, _: Readings) -> Loop:
    loop = loops[FIRST]
    motion, L = loop.reference, loop.L
    time = L * np.arange(2 * motion.time.size - 1, dtype=np.float64)
    half = 0.5 * time
    if motion.ddq_d.any():
        angle = CubicSpline(motion.time, motion.q_d)
        rates = angle(half), 0.5 * angle(half, 1), 0.25 * angle(half, 2)
    else:
        # Straight lines keep their corners.
        before = np.arange(time.size) // 2
        q_d = np.stack([np.interp(half, motion.time, column) for column in motion.q_d.T], axis=1)
        rates = q_d, 0.5 * motion.dq_d[before], np.zeros_like(q_d)
    return replace(loop, reference=DesiredMotion(time, *rates, 2.0 * motion.period))


def _last_joint_alone(loops: Loops, _: Readings) -> Loop:
    loop = loops[FIRST]

    def alone(values: Array) -> Array:
        kept = np.zeros_like(values)
        kept[:, -1] = values[:, -1]
        return kept

    given = loop.reference
    motion = replace(given, q_d=alone(given.q_d), dq_d=alone(given.dq_d), ddq_d=alone(given.ddq_d))
    return replace(loop, reference=motion)


def _same_slope(loops: Loops, _: Readings) -> Loop:
    """Controller 2 with η = β / γ₁ for a Delta of 0.2 rad, 1.548 as published, in degrees too."""
    law = law_of(loops[SECOND])
    gamma_1, _gamma_2 = polynomial(law.b, np.full_like(law.b, 0.2))
    eta = law.beta / gamma_1
    rate = eta if np.array_equal(law.rate_gain, law.eta) else law.rate_gain
    return _with_law(loops[SECOND], law._replace(eta=eta, rate_gain=rate))


def _with_inertia(factor: float, loops: Loops, _: Readings) -> Loop:
    law = law_of(loops[FIRST])
    return _with_law(loops[FIRST], law._replace(M_bar=factor * law.M_bar))


def _started_elsewhere(loops: Loops, _: Readings) -> Loop:
    """Controller 1 once more, from where Controller 2 started."""
    return replace(loops[FIRST], start_offset=loops[SECOND].start_offset)


def _other_encoders(loops: Loops, _: Readings) -> Loop:
    law = law_of(loops[FIRST])
    return _with_law(loops[FIRST], law._replace(motor_side=not law.motor_side))


# Controller 2 is Controller 1 at alpha = 0, but for the reading that drops eta from its printed law.
EXPERIMENTS = (
    BenchExperiment("controllers_1_2", "Controller 1 over Controller 2", partial(_run, FIRST), SECOND),
    BenchExperiment("controllers_2_3", "Controller 2 over Controller 3", partial(_run, SECOND), THIRD),
    BenchExperiment(
        "controllers_1_2_late",
        "Controller 1 over Controller 2, first two seconds left out",
        partial(_run, FIRST),
        SECOND,
        "mae_settled",
    ),
    BenchExperiment(
        "controllers_2_3_late",
        "Controller 2 over Controller 3, first two seconds left out",
        partial(_run, SECOND),
        THIRD,
        "mae_settled",
    ),
    BenchExperiment("repeat", "Controller 1 repeated from another start", _started_elsewhere),
    *(
        BenchExperiment(
            f"alpha_{alpha:g}",
            f"Controller 1 with α = {alpha:g} over α = 0",
            partial(with_alpha, alpha),
            SECOND,
        )
        for alpha in (0.1, 0.2, 0.3, 0.5)
    ),
    BenchExperiment("same_slope", "Controller 2 with η = 1.548 over Controller 3", _same_slope, THIRD),
    BenchExperiment("half_speed", "Controller 1 at half the speed over full speed", _slower),
    BenchExperiment("joint_3_alone", "Controller 1 with joint 3 alone over both joints", _last_joint_alone),
    BenchExperiment("inertia_up", "Controller 1 with M̄ 10 % up", partial(_with_inertia, 1.1)),
    BenchExperiment("inertia_down", "Controller 1 with M̄ 10 % down", partial(_with_inertia, 0.9)),
    BenchExperiment("period_doubled", "Controller 1 with L doubled", partial(_run, DOUBLED_PERIOD)),
    BenchExperiment("payload", "Controller 1 with 0.2 kg over without", partial(_run, LOADED)),
    BenchExperiment(
        "other_encoders", "Controller 1 with the motors' encoders over the joints'", _other_encoders
    ),
)


def experiments_on(loaded: LoadedEnsemble) -> Sequence[BenchExperiment]:
    """Experiments that the arm of a comparison can make, named by its own joints and payload."""
    if not loaded.around:
        return EXPERIMENTS
    config = loaded.compare
    apart = any(run.start_offset for run in config.runs.values())
    left_out = {
        "repeat": not apart,
        "joint_3_alone": len(config.joints) == 1,
        "period_doubled": config.sampling_period.si != PUBLISHED_PERIOD,
        "payload": LOADED not in config.runs,
    }
    own = {
        "joint_3_alone": f"Controller 1 with joint {config.joints[-1]} alone over all joints",
        "same_slope": "Controller 2 with η of the same slope over Controller 3",
    }
    if LOADED in config.runs:
        own["payload"] = f"Controller 1 with {config.runs[LOADED].payload.si:g} kg over without"
    kept = [experiment for experiment in EXPERIMENTS if not left_out.get(experiment.name)]
    return [replace(experiment, about=own.get(experiment.name, experiment.about)) for experiment in kept]
