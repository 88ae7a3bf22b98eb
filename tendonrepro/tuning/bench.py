"""The question: plants, loads, motions, knowledge, and what is measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.control import SECOND
from tendonrepro.configuration.models.readings import parse_reading, under
from tendonrepro.experiments.loops import Once, build_law, run_loop
from tendonrepro.experiments.rig import build_plant, start_angles
from tendonrepro.physics.arm import bias_torque, mass_matrix
from tendonrepro.physics.control import Law
from tendonrepro.physics.drive import to_joint_matrix
from tendonrepro.physics.dynamics import Plant, load_at_rest
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.physics.trajectory import Motion, minimum_jerk, motion, smooth_sine
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import DesiredMotion, Loop, TimeDelayController
from tendonrepro.tuning.laws import LAWS, Gains, TunedLaw

# As published a law knows nothing of the arm, and differences positions for its velocity. Where all is known
# it is given the torque of all but dry friction along the desired motion, and velocities are filtered.
CONDITIONS = PUBLISHED, KNOWN = "as published", "all known"

PAYLOAD = 0.2  # kg, as in section 5.4, where no run has one
HELD_OUT_SHARE = 0.5  # of the payload, in the held-out run
LESS_DAMPING = 0.5  # of the tendons, over the plant's own, in the run that the stability margin asks for
COUNTS = 2.0  # fast error, RMS in encoder counts, up to which a run is not ringing but counting

TUNED, ALL_RUNS = 3, 4  # loops of a plant that are tuned on, and all; the last is the held-out one

# Up and down by 33 deg as the plain arm, a fifth faster than the box allows, so that a run is short.
_STROKE, _PERIOD = np.radians(33.0), 2.4
# Held out is another shape: a sine between 0 and 40 deg that begins softly.
_HALF_SINE, _SINE_PERIOD = np.radians(20.0), 2.5


def _motions(config: CompareConfig) -> Iterator[DesiredMotion]:
    """Yield the motion of tuning and the held-out one, with strokes by which no link comes near upright."""
    n, L = len(config.joints), config.sampling_period.si
    most = float(0.9 * (np.pi - start_angles(config).max()) / n)
    half = min(_HALF_SINE, most / 2.0)
    for shape, period in (
        (minimum_jerk(min(_STROKE, most), _PERIOD / 2.0, 0.0), _PERIOD),
        (smooth_sine(half, half, _SINE_PERIOD, _SINE_PERIOD / 2.0), 2.0 * _SINE_PERIOD),
    ):
        time: Array = L * np.arange(round(period / L) + 1.0)
        yield DesiredMotion(time, *motion(time, [Motion((shape,), period)] * n), period)


class TrialPlants(NamedTuple):
    """One draw as loops to run in, and what laws are made of.

    Loops are without payload, with it, and without it at `LESS_DAMPING`; then with the held-out payload and
    motion. `controllers` are 1 to 3 with the gains and readings of the configuration, `alpha` (n,) is the
    weight of the first; `newest` is the weight of the newest value where velocities are filtered. `known` is
    what `known_along` gives for the motion of tuning and for the held-out one.
    """

    loops: tuple[Loop, ...]
    controllers: Mapping[str, Law]
    alpha: Array
    newest: float
    known: Sequence[tuple[Array, Array]]


class Candidate(NamedTuple):
    """A law with gains, under a condition; where it is one of the configuration, `given` is all of it."""

    law: TunedLaw
    condition: str
    gains: Gains
    given: Law | None = None


class Performance(NamedTuple):
    """Of C candidates in R runs: mean absolute error (C, R, n), rad, roughness (C,), N m, stability (C, R).

    Roughness is the RMS change of torque in a sample, in the rougher of the first two runs.
    """

    mae: Array
    roughness: Array
    stable: NDArray[np.bool_]


def posed(config: CompareConfig) -> TrialPlants:
    """A configuration with the motions and loads of the tuning; its own motion is not looked at.

    Nor is its ``errors_from``, which speaks of that motion: errors are of the whole of these.
    """
    config = config.model_copy(update={"errors_from": None})
    motions = [*_motions(config)]
    own = run_loop(config, next(iter(config.runs)), motions[0], Once())
    payload = max(run.payload.si for run in config.runs.values()) or PAYLOAD
    bare, carrying, other = (build_plant(config, mass) for mass in (0.0, payload, HELD_OUT_SHARE * payload))
    weak = bare._replace(drive=bare.drive._replace(damping=LESS_DAMPING * bare.drive.damping))
    loops = [replace(own, plant=plant) for plant in (bare, carrying, weak)]
    filtering = under(parse_reading("error_rate=low_pass"), config, {})
    return TrialPlants(
        loops=(*loops, replace(own, plant=other, reference=motions[1])),
        controllers={name: build_law(config, name) for name in CONTROLLERS},
        alpha=config.control.gains.alpha.si,
        newest=build_law(filtering, SECOND).rate_filter,
        known=[known_along(bare, along) for along in motions],
    )


def known_along(plant: Plant, along: DesiredMotion) -> tuple[Array, Array]:
    """What is known along a motion: torque, N m (T, n), and map of the law's torques (n, n)."""
    q, dq, ddq = along.q_d.T, along.dq_d.T, along.ddq_d.T
    weight, drive = load_at_rest(q, plant), plant.drive
    inertia = to_joint_matrix(drive.inertia, drive.S_inv)
    viscous = to_joint_matrix(drive.friction.viscous, drive.S_inv) + np.diag(plant.link_friction.viscous)
    moving = bias_torque(q, dq, plant.arm) - bias_torque(q, 0.0 * dq, plant.arm)
    M = np.moveaxis(mass_matrix(q, plant.arm), -1, 0) + inertia
    torque = weight.T + moving.T + np.einsum("tij,jt->ti", M, ddq) + dq.T @ viscous.T
    middle = M[M.shape[0] // 4]
    return torque, middle / np.mean(np.diag(middle))


def loops_of(plants: TrialPlants, candidate: Candidate, runs: int = TUNED) -> list[Loop]:
    """Loops of the first so many runs; runs of one motion share what a law is given."""
    law, command = _law_under(plants, candidate), candidate.law.command
    controller = TimeDelayController(law, command, on_lanes=command is not None)
    given = [plants.loops[0].reference, plants.loops[-1].reference]
    if candidate.condition == KNOWN:
        for place, reference in enumerate(given[: 1 + (runs == ALL_RUNS)]):
            torque, _ = plants.known[place]
            extra = _entering(torque, law, increments=command is None) @ law.from_joint.T / law.M_bar
            given[place] = replace(reference, ddq_d=reference.ddq_d + extra)
    return [
        replace(loop, controller=controller, reference=given[k == ALL_RUNS - 1])
        for k, loop in enumerate(plants.loops[:runs])
    ]


def _law_under(plants: TrialPlants, candidate: Candidate) -> Law:
    law = candidate.given or candidate.law.law(plants.controllers[SECOND], candidate.gains, plants.alpha)
    weight, to_joint = 1.0, np.eye(plants.alpha.size)
    if candidate.condition == KNOWN:
        weight, (_, to_joint) = plants.newest, plants.known[0]
    from_joint = np.asarray(np.linalg.inv(to_joint), dtype=np.float64)
    return law._replace(rate_filter=weight, ddq_filter=weight, to_joint=to_joint, from_joint=from_joint)


def _entering(torque: Array, law: Law, *, increments: bool) -> Array:
    """What to add to a law's torque (T, n) so that a known torque acts from the start.

    An estimator holds past torque already, and is given only what is new.
    """
    first = np.broadcast_to(torque[0], torque.shape)
    if not increments:
        return np.asarray(torque - first)
    past = (np.concatenate([first[:back], torque[:-back]]) for back in (law.lag, 2 * law.lag))
    past_torque = sum(weight * part for weight, part in zip(law.weights, past, strict=True))
    keeps = 1.0 - law.estimate_filter
    return np.asarray(
        torque - lfilter([1.0 - keeps], [1.0, -keeps], past_torque, axis=0, zi=keeps * first[:1])[0]
    )


def measure(plants: TrialPlants, candidates: Sequence[Candidate], runs: int = TUNED) -> Performance:
    """Run candidates on one draw, in the first so many runs."""
    loops = [loop for candidate in candidates for loop in loops_of(plants, candidate, runs)]
    batch = simulate_batch(loops)
    shape = len(candidates), runs, -1
    names = ("mae", "rmse", "fast_share", "torque_step_rms")
    mae, rmse, share, steps = (batch.statistics[name].reshape(shape) for name in names)
    # A tuned law errs by a count or so, and fast for that reason alone.
    loud = (rmse * np.sqrt(share) > COUNTS * plants.loops[0].joint_encoder.resolution).any(axis=2)
    status = batch.status.reshape(shape[:2])
    stable = (status == STATUSES.index("ok")) | (status == STATUSES.index("ringing")) & ~loud
    return Performance(mae, np.sqrt(np.mean(steps[:, :2] ** 2, axis=2)).max(axis=1), stable)


def as_published(plants: TrialPlants, condition: str = PUBLISHED) -> dict[str, Candidate]:
    """Controllers 1 to 3 with the gains and readings of the configuration, as published or a user's."""
    candidates = {}
    for name, kind in zip(CONTROLLERS, ("alpha_published", "ntsm", "tsm"), strict=True):
        law, given = LAWS[kind], plants.controllers[name]
        gains = {gain: getattr(given, gain) for gain in law.gains}
        candidates[name] = Candidate(law, condition, gains, given)
    return candidates


def usable(plants: TrialPlants) -> bool:
    """Whether these gains are stable, with and without payload."""
    return bool(measure(plants, [*as_published(plants).values()]).stable[:, :2].all())
