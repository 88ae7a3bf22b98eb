"""How many integration steps a plant needs between two samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dynamics import Plant, holding_torque, rest_state, state_derivative

STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of steps per sample there are to choose from."""

LARGEST_DECAY = 2.2
"""Largest decay of a mode per step; the Runge-Kutta method of order four is stable to 2.78."""
LARGEST_TURN = 0.25
"""Largest turn of an oscillating mode per step, rad."""

NUDGE = 1e-6
"""Change of the state for differences, rad and rad s⁻¹: far below any velocity over which friction turns."""

POSTURES = 5
"""Postures looked at, from the start to the end of the stroke."""


def plant_modes(plant: Plant, stroke: Array) -> NDArray[np.complex128]:
    """Eigenvalues of the plants near rest, friction included, at several postures, s⁻¹.

    At standstill friction is steepest, so that is where a plant is fastest.

    Parameters
    ----------
    plant : Plant
        Stacked over experiments.
    stroke : array (n, N)
        Largest joint angles of the reference, rad.

    Returns
    -------
    array (N, POSTURES, 4 n)
    """
    modes = [_modes_at(share * stroke, plant) for share in np.linspace(0.0, 1.0, POSTURES)]
    return np.stack(modes, axis=1)


def _modes_at(q: Array, plant: Plant) -> NDArray[np.complex128]:
    state, tau = rest_state(q, plant), holding_torque(q, plant)
    columns = []
    for j in range(state.shape[0]):
        nudge = np.zeros_like(state)
        nudge[j] = NUDGE
        ahead = state_derivative(0.0, state + nudge, tau, plant)
        columns.append((ahead - state_derivative(0.0, state - nudge, tau, plant)) / (2.0 * NUDGE))
    return np.linalg.eigvals(np.moveaxis(np.stack(columns, axis=1), -1, 0))


def steps_needed(modes: NDArray[np.complex128], L: float) -> NDArray[np.int64]:
    """Integration steps per sample, 0 for a plant that the largest number cannot resolve.

    Parameters
    ----------
    modes : array (N, ...)
        Eigenvalues, s⁻¹.
    L : float
        Sampling period, s.

    Returns
    -------
    array (N,)
        From `STEPS`.
    """
    flat = modes.reshape(modes.shape[0], -1) * L
    needed = np.maximum(np.abs(flat) / LARGEST_DECAY, np.abs(flat.imag) / LARGEST_TURN).max(axis=1)
    index = np.searchsorted(STEPS, needed)
    return np.append(STEPS, 0)[index]
