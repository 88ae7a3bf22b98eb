"""How many integration steps a plant needs between two samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.dynamics import Plant, holding_torque, rest_state, state_derivative

STEPS = (1, 2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of steps per sample there are to choose from."""

COMPILED_STEPPER = "compiled Runge-Kutta of order 4"
"""What a manifest calls the stepper that these numbers are for."""

TOLERANCE = 4e-4
"""Error of a mode over one sample that is allowed unless asked for less, see :func:`steps_needed`."""

NUDGE = 1e-6
"""Change of the state for differences, rad and rad s⁻¹: far below any velocity over which friction turns."""

POSTURES = 5
"""Postures looked at, from the start to the end of the stroke."""


def plant_modes(plant: Plant, stroke: Array) -> NDArray[np.complex128]:
    """Eigenvalues of stacked plants near rest, friction included, s⁻¹, (N, POSTURES, 4 n).

    Postures lie along the stroke, rad, (n, N). At standstill friction is steepest, so a plant is fastest.
    """
    along = np.linspace(0.0, 1.0, POSTURES)
    q = np.concatenate([share * stroke for share in along], axis=-1)
    modes = _modes_at(q, _repeated(plant, POSTURES))
    return modes.reshape(POSTURES, stroke.shape[-1], -1).swapaxes(0, 1)


def _repeated(record: Any, times: int) -> Any:
    """Stacked record with its experiments several times over."""
    if isinstance(record, tuple):
        parts = (_repeated(part, times) for part in record)
        return type(record)(*parts)
    return np.concatenate([record] * times, axis=-1)


def _modes_at(q: Array, plant: Plant) -> NDArray[np.complex128]:
    state, tau = rest_state(q, plant), holding_torque(q, plant)
    columns = []
    for j in range(state.shape[0]):
        nudge = np.zeros_like(state)
        nudge[j] = NUDGE
        ahead = state_derivative(0.0, state + nudge, tau, plant)
        columns.append((ahead - state_derivative(0.0, state - nudge, tau, plant)) / (2.0 * NUDGE))
    return np.linalg.eigvals(np.moveaxis(np.stack(columns, axis=1), -1, 0)).astype(np.complex128)


def steps_needed(modes: NDArray[np.complex128], L: float, tolerance: float = TOLERANCE) -> NDArray[np.int64]:
    """Integration steps per sample from `STEPS`, (N,); 0 for a plant that the largest number cannot resolve.

    Over a sample a mode λ goes on by ``exp(λ L)``, in m Runge-Kutta steps by ``R(λ L/m)^m``. The difference
    is held below the tolerance. What a torque jump moves through a mode faster than the sample is smaller by
    ``(λ L)²``, and so is its error.
    """
    z = modes.reshape(modes.shape[0], -1) * L
    weight = 1.0 / np.maximum(1.0, np.abs(z)) ** 2
    needed = np.zeros(z.shape[0], dtype=np.int64)
    # A plant at rest may drift away slowly, upright ones do; what must not grow is the fast end.
    fast = np.abs(z) > 1.0
    for steps in reversed(STEPS):
        ratio = _amplification(z / steps)
        # A step far too long grows beyond all numbers, and then it is not within the tolerance.
        with np.errstate(over="ignore", invalid="ignore"):
            error = weight * np.abs(ratio**steps - np.exp(z))
        growing = (fast & (np.abs(ratio) > 1.0)).any(axis=1)
        needed[(error.max(axis=1) <= tolerance) & ~growing] = steps
    return needed


def _amplification(z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Factor by which one Runge-Kutta step of order four carries a mode on."""
    return 1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))
