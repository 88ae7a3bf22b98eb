"""How many integration steps a plant needs between two samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array, Numeric, choose, times
from tendonrepro.physics.drive import to_winch_angle
from tendonrepro.physics.dynamics import Plant, both_ways, holding_torque, rest_state, state_derivative
from tendonrepro.physics.loads import no_disturbance
from tendonrepro.simulation.codegen.lanes import mapped, stacked
from tendonrepro.simulation.loop import Loop, Rest, rest_at
from tendonrepro.simulation.streaming import peak

STEPS = (1, 2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of steps per sample there are to choose from."""

COMPILED_STEPPER = "compiled Runge-Kutta of order 4"
"""What a manifest calls the stepper that these numbers are for."""

TOLERANCE = 1e-2
"""Error of a mode over one sample that is allowed unless asked for less, see :func:`steps_needed`."""

NUDGE = 1e-6
"""Change of the state for differences, SI: far below any velocity over which friction turns."""

POSTURES = 3
"""Postures looked at, from the start to the end of the stroke."""

FLAT, TURNING = 4.0, 1.5
"""Velocities, in units of the one over which dry friction turns, beyond which it is flat, and gentle."""

PACES = (FLAT, TURNING, 0.0)
"""Slowest motion of each level of :func:`demand`, in the same unit."""

HIGHEST = 2.0
"""Highest level of :func:`demand`."""


def demand(before: Array, after: Array, plant: Plant) -> Numeric:
    """Level of resolution that a step asks for, the highest of all joints and winches.

    2 is standstill or a change of direction, where dry friction is steep; 1 is slow and 0 fast motion. What
    has no dry friction does not count.
    """
    n, drive, link = plant.preload.shape[0], plant.drive, plant.link_friction
    winches = [to_winch_angle(state[3 * n :], drive) for state in (before, after)]
    most: Numeric = 0.0
    for i in range(n):
        lost = drive.friction.coulomb[i] + drive.pulley_loss[i] + drive.reducer_loss[i]
        for first, last, over, dry in (
            (before[n + i], after[n + i], link.smoothing_velocity[i], link.coulomb[i]),
            (winches[0][i], winches[1][i], drive.friction.smoothing_velocity[i], lost),
        ):
            slowest = np.minimum(abs(first / over), abs(last / over))
            nearest = choose(first * last > 0.0, slowest, 0.0)
            level = choose(nearest >= FLAT, 0.0, choose(nearest >= TURNING, 1.0, 2.0))
            most = np.maximum(most, choose(dry > 0.0, level, 0.0))
    return most


def plant_modes(plant: Plant, stroke: Array) -> list[NDArray[np.complex128]]:
    """Eigenvalues of stacked plants, friction included, s⁻¹, (N, cases, 4 n), at each of `PACES`.

    Postures lie along the stroke, rad, (n, N). A pace is in units of the velocity over which friction turns.
    Where the Stribeck effect falls steepest counts too, if that is beyond the pace.
    """
    q = np.linspace(0.0, 1.0, POSTURES)[:, np.newaxis] * stroke[:, np.newaxis]
    # A slack tendon is gentle: what a plant needs while taut will do.
    plants = _spread(both_ways(plant))
    rest = rest_state(q, plants), holding_torque(q, plants)
    modes = [[_modes_at(*rest, plants, speed) for speed in _speeds(plants, pace)] for pace in PACES]
    return [np.concatenate(cases).swapaxes(0, 1) for cases in modes]


def _speeds(plant: Plant, pace: float) -> list[list[Array]]:
    """Velocities of joints and winches, (n, 1, N)."""
    laws = plant.link_friction, plant.drive.friction
    edge = [pace * law.smoothing_velocity for law in laws]
    steepest = [law.stribeck_velocity / np.sqrt(2.0) for law in laws]
    faster = [np.maximum(*pair) for pair in zip(edge, steepest, strict=True)]
    return [edge] if pace == 0.0 or all(map(np.array_equal, edge, faster)) else [edge, faster]


def _spread(plant: Plant) -> Plant:
    """Stacked plants with an axis before that of the experiments."""
    return mapped(lambda leaf: np.expand_dims(leaf, -2), plant)


def _modes_at(rest: Array, tau: Array, plant: Plant, speed: Sequence[Array]) -> NDArray[np.complex128]:
    """Eigenvalues (P, N, 4 n) at states of rest (4 n, P, N) set to velocities of joints and winches."""
    state, n = rest.copy(), tau.shape[0]
    state[n : 2 * n], state[3 * n :] = speed[0], times(plant.drive.S, speed[1])
    nudges = NUDGE * np.hstack([np.eye(4 * n), -np.eye(4 * n)])
    nudged = state[:, np.newaxis] + nudges[..., np.newaxis, np.newaxis]
    slopes = state_derivative(0.0, nudged, tau[:, np.newaxis], _spread(plant))
    ahead, behind = np.split(slopes, 2, axis=1)
    jacobian = np.moveaxis((ahead - behind) / (2.0 * NUDGE), (0, 1), (-2, -1))
    return np.linalg.eigvals(jacobian).astype(np.complex128)


def steps_needed(
    modes: NDArray[np.complex128], L: float | Array, tolerance: float = TOLERANCE
) -> NDArray[np.int64]:
    """Integration steps per sample of `L` s, (N,), from `STEPS`; 0 where even the largest is too small.

    A mode λ goes on by ``exp(λ L)``, in m Runge-Kutta steps by ``R(λ L/m)^m``; the difference stays below the
    tolerance. What a torque jump moves through a mode faster than the sample is smaller by ``(λ L)²``; so is
    its error.
    """
    z = modes.reshape(modes.shape[0], -1) * np.reshape(L, (-1, 1))
    # The fall of the Stribeck rise may let a mode of a moving plant grow, and then it shall.
    truth, growth = np.exp(z), np.maximum(1.0, np.exp(np.minimum(z.real, 100.0)))
    weight = 1.0 / (np.maximum(1.0, np.abs(z)) ** 2 * growth)
    needed = np.zeros(z.shape[0], dtype=np.int64)
    # A plant at rest may drift away slowly, upright ones do; what must not grow is the fast end.
    bounded = (np.abs(z) > 1.0) & (growth == 1.0)
    for steps in STEPS:
        left = np.flatnonzero(needed == 0)
        ratio = _amplification(z[left] / steps)
        # A step far too long grows beyond all numbers, and then it is not within the tolerance.
        with np.errstate(over="ignore", invalid="ignore"):
            error = weight[left] * np.abs(ratio**steps - truth[left])
            growing = (bounded[left] & (np.abs(ratio) > 1.0)).any(axis=1)
        needed[left[(error.max(axis=1) <= tolerance) & ~growing]] = steps
    return needed


def _amplification(z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return 1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))


class PreparedLoop(NamedTuple):
    """A loop, where it rests, and its steps per sample, (levels,), one number for each level of demand.

    A number is 0 where none is enough.
    """

    loop: Loop
    rest: Rest
    steps: NDArray[np.int64]


def prepared_loops(loops: Sequence[Loop], tolerance: float) -> list[PreparedLoop]:
    """Loops in their order, with rest and steps."""
    # Runs under other readings share their plant and motion: these are worked out once.
    keys = [(id(loop.plant), id(loop.reference.q_d), loop.start_angles.tobytes(), loop.L) for loop in loops]
    single = dict(zip(keys, loops, strict=True))
    far = {id(q_d): peak(q_d) for q_d in (loop.reference.q_d for loop in single.values())}
    # A disturbance shifts no mode, and is not there at rest.
    calm = no_disturbance(loops[0].plant.preload.size)
    plants, stroke, q, L = stacked(
        [
            (
                loop.plant._replace(disturbance=calm),
                far[id(loop.reference.q_d)],
                loop.start_angles,
                np.array(loop.L),
            )
            for loop in single.values()
        ]
    )
    steps = np.stack([steps_needed(modes, L, tolerance) for modes in plant_modes(plants, stroke)], axis=1)
    state, tau, zero = (part.T for part in rest_at(q, plants))
    ready = {key: (Rest(state[k], tau[k], zero[k]), steps[k]) for k, key in enumerate(single)}
    return [PreparedLoop(loop, *ready[key]) for key, loop in zip(keys, loops, strict=True)]
