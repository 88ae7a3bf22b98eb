"""The question as it is posed: plants, loads, motions, what is known, and what is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.control import Readings
from tendonrepro.configuration.models.experiment import StatusLimits
from tendonrepro.experiments.loops import build_law, build_loops
from tendonrepro.experiments.rig import build_plant
from tendonrepro.monte_carlo.box import Box, configured
from tendonrepro.physics.arm import bias_torque, mass_matrix
from tendonrepro.physics.control import Law
from tendonrepro.physics.dynamics import Plant, load_at_rest
from tendonrepro.physics.kinematics import to_joint_matrix
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.physics.trajectory import Motion, Shape, minimum_jerk, motion, smooth_sine
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.controllers import TimeDelayController
from tendonrepro.simulation.loop import DesiredMotion, Loop
from tendonrepro.tuning.laws import LAWS, Gains, TunedLaw

CLASSES = ("none", "gravity", "full")
"""What is known beforehand along the desired motion: nothing, the weight, or all but dry friction."""

PAYLOAD = 0.2
"""Of the tuning's second run, kg, as in section 5.4."""
HELD_OUT_PAYLOAD = 0.1
LESS_DAMPING = 0.5
"""Tendon damping in the run that the stability margin asks for, over the plant's own."""
COUNTS = 2.0
"""Fast error, RMS in encoder counts, up to which a run that errs fast is not ringing but counting."""


def tuning_motion(L: float, n: int) -> DesiredMotion:
    """Up and down: 33 deg as shipped, a fifth faster than the box allows, so that a run is short."""
    return _motion(minimum_jerk(np.radians(33.0), 1.2, 0.0), 2.4, L, n)


def held_out_motion(L: float, n: int) -> DesiredMotion:
    """Another shape: a sine between 0 and 40 deg that begins softly."""
    middle = np.radians(20.0)
    return _motion(smooth_sine(middle, middle, 2.5, 1.25), 5.0, L, n)


def _motion(shape: Shape, period: float, L: float, n: int) -> DesiredMotion:
    time: Array = L * np.arange(round(period / L) + 1.0)
    return DesiredMotion(time, *motion(time, [Motion((shape,), period)] * n), period)


class Known(NamedTuple):
    """Torque that a class knows along a motion, N m (T, n), and what its law's torques are multiplied by."""

    torque: Array
    to_joint: Array


@dataclass(frozen=True)
class Plants:
    """One draw as the loops that a candidate is run in.

    Attributes
    ----------
    loops : tuple of Loop
        Without payload, with it, and without it at `LESS_DAMPING`; then the held-out payload and motion.
    law : Law
        As published, Controller 2.
    alpha : array (n,)
        As published.
    cutoff : float
        Weight of the newest value where velocities are filtered.
    known : mapping
        What each class knows along the motion of tuning, and along the held-out one.
    limits : StatusLimits
        What makes a run diverged or ringing.
    """

    loops: tuple[Loop, ...]
    law: Law
    alpha: Array
    newest: float
    known: dict[tuple[str, bool], Known]
    limits: StatusLimits


TUNED, ALL_RUNS = 3, 4
"""How many of the loops are tuned on, and how many there are with the held-out one, the last."""


class Measured(NamedTuple):
    """What a candidate gives in R runs: mean absolute error (R, n), rad, roughness, N m, and stability.

    Roughness is the root mean square of the applied torque's change from sample to sample, over the joints
    together, in the rougher of the first two runs.
    """

    mae: Array
    roughness: Array
    stable: NDArray[np.bool_]


def plants_of(loaded: LoadedEnsemble, box: Box, row: Array) -> Plants:
    """One draw (P,) of the box, with the motions and loads of the tuning in place of its own."""
    config = configured(loaded.base, box, row)
    n, L = len(config.joints), config.sampling_period.si
    motions = tuning_motion(L, n), held_out_motion(L, n)
    own = next(loop for _, loop in build_loops(config, loaded.base.folder, motions[0]))
    bare, carrying, other = (build_plant(config, mass) for mass in (0.0, PAYLOAD, HELD_OUT_PAYLOAD))
    weak = bare._replace(drive=bare.drive._replace(damping=LESS_DAMPING * bare.drive.damping))
    loops = [replace(own, plant=plant) for plant in (bare, carrying, weak)]
    loops.append(replace(own, plant=other, reference=motions[1]))
    filtered = config.control.readings.model_copy(update={"error_rate": "low_pass"})
    return Plants(
        loops=tuple(loops),
        law=build_law(config, "controller_2"),
        alpha=config.control.gains.alpha.si,
        newest=build_law(_reading(config, filtered), "controller_2").rate_filter,
        known={(name, bool(held)): _known(name, bare, motions[held]) for name in CLASSES for held in (0, 1)},
        limits=config.status,
    )


def _reading(config: CompareConfig, readings: Readings) -> CompareConfig:
    control = config.control.model_copy(update={"readings": readings})
    return config.model_copy(update={"control": control})


def known_along(plant: Plant, motions: Sequence[DesiredMotion]) -> dict[tuple[str, bool], Known]:
    """What each class knows of a plant along the motion of tuning, and along the held-out one."""
    return {
        (name, bool(k)): _known(name, plant, along) for name in CLASSES for k, along in enumerate(motions)
    }


def _known(name: str, plant: Plant, along: DesiredMotion) -> Known:
    q, dq, ddq = along.q_d.T, along.dq_d.T, along.ddq_d.T
    n = q.shape[0]
    if name == "none":
        return Known(np.zeros_like(along.q_d), np.eye(n))
    weight = load_at_rest(q, plant)
    if name == "gravity":
        return Known(weight.T, np.eye(n))
    drive = plant.drive
    inertia = to_joint_matrix(drive.inertia, drive.S_inv)
    viscous = to_joint_matrix(drive.friction.viscous, drive.S_inv) + np.diag(plant.link_friction.viscous)
    moving = bias_torque(q, dq, plant.arm) - bias_torque(q, 0.0 * dq, plant.arm)
    M = np.moveaxis(mass_matrix(q, plant.arm), -1, 0) + inertia
    torque = weight.T + moving.T + np.einsum("tij,jt->ti", M, ddq) + dq.T @ viscous.T
    middle = M[M.shape[0] // 4]
    return Known(torque, middle / np.mean(np.diag(middle)))


class Candidate(NamedTuple):
    """A law with gains in a class, its velocities low-pass filtered or not."""

    law: TunedLaw
    knows: str
    filtered: bool
    gains: Gains


def loops_of(plants: Plants, candidate: Candidate, runs: int = TUNED) -> list[Loop]:
    """Loops of the first so many runs of a candidate; runs of one motion share what its law is given."""
    law, command = _law_of(plants, candidate), candidate.law.command
    controller = TimeDelayController(law, command, on_lanes=command is not None)
    references = {id(loop.reference): loop.reference for loop in plants.loops[:runs]}
    if candidate.knows != "none":
        for held, (name, reference) in zip((False, True), references.items(), strict=False):
            torque = plants.known[candidate.knows, held].torque
            extra = _entering(torque, law, increments=command is None) @ law.from_joint.T / law.M_bar
            references[name] = replace(reference, ddq_d=reference.ddq_d + extra)
    return [
        replace(loop, controller=controller, reference=references[id(loop.reference)])
        for loop in plants.loops[:runs]
    ]


def _law_of(plants: Plants, candidate: Candidate) -> Law:
    law = candidate.law.law(plants.law, candidate.gains, plants.alpha)
    weight = plants.newest if candidate.filtered else 1.0
    to_joint = plants.known[candidate.knows, False].to_joint
    return law._replace(
        rate_filter=weight,
        ddq_filter=weight,
        to_joint=to_joint,
        from_joint=np.asarray(np.linalg.inv(to_joint), dtype=np.float64),
    )


def _entering(torque: Array, law: Law, *, increments: bool) -> Array:
    """What has to be added to a law's torque (T, n) so that a known torque acts from the start on.

    A law with an estimator holds the torque of the past already, and is given only what is new.
    """
    first = np.broadcast_to(torque[0], torque.shape)
    if not increments:
        return np.asarray(torque - first)
    past = (np.concatenate([first[:back], torque[:-back]]) for back in (law.lag, 2 * law.lag))
    held = sum(weight * part for weight, part in zip(law.weights, past, strict=True))
    keeps = 1.0 - law.estimate_filter
    return np.asarray(torque - lfilter([1.0 - keeps], [1.0, -keeps], held, axis=0, zi=keeps * first[:1])[0])


def measure(plants: Plants, candidates: Sequence[Candidate], runs: int = TUNED) -> Measured:
    """Run candidates on one draw in the first so many runs; leading axis (C,)."""
    loops = [loop for candidate in candidates for loop in loops_of(plants, candidate, runs)]
    batch = simulate_batch(loops, plants.limits)
    shape = len(candidates), runs, -1
    mae, rmse, share, steps = (batch.statistics[name].reshape(shape) for name in _STATISTICS)
    # A tuned law errs by a count or so, and fast for that reason alone.
    loud = (rmse * np.sqrt(share) > COUNTS * plants.loops[0].joint_encoder.resolution).any(axis=2)
    status = batch.status.reshape(shape[:2])
    stable = (status == STATUSES.index("ok")) | (status == STATUSES.index("ringing")) & ~loud
    return Measured(mae, np.sqrt(np.mean(steps[:, :2] ** 2, axis=2)).max(axis=1), stable)


_STATISTICS = ("mae", "rmse", "fast_share", "torque_step_rms")


PUBLISHED: Mapping[str, str] = {
    "controller_1": "alpha_published",
    "controller_2": "ntsm",
    "controller_3": "tsm",
}
"""Which law each controller of the paper is."""


def published(plants: Plants, controller: str, knows: str = "none", filtered: bool = False) -> Candidate:
    """One of Controllers 1 to 3 with its published gains."""
    law = next(law for law in LAWS if law.name == PUBLISHED[controller])
    return Candidate(law, knows, filtered, {name: getattr(plants.law, name) for name in law.gains})


def usable(plants: Plants) -> bool:
    """Whether Controllers 1 to 3 as published are stable on a draw, with and without payload."""
    found = measure(plants, [published(plants, name) for name in PUBLISHED])
    return bool(found.stable[:, :2].all())
