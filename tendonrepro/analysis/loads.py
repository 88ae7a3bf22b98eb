"""How a load on the links becomes an error, by frequency."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.experiments.loops import View
from tendonrepro.physics.arm import mass_matrix
from tendonrepro.physics.linear_loop import Complex, hold_discretised, loop_matrix, plant_matrices

POINTS = 400
_LOWEST_HZ = 0.05
_MOTION_SHARE = 0.99
"""Share of the power of the desired velocity that lies within the motion's bandwidth."""


@dataclass(frozen=True)
class Loads:
    """Size of each joint's error per load on it, rad N⁻¹ m⁻¹, (n, F), of laws whose loops decay.

    `mode_hz` is the least damped mode of the arm without a controller, or NaN. Up to `motion_hz` the desired
    velocity has 99 % of its power.
    """

    hertz: Array
    error: Mapping[str, Array]
    mode_hz: float
    motion_hz: float


def loads(views: Mapping[str, View], q: Array, dq_d: Array) -> Loads:
    """Error per load at posture `q` (n,), rad, beside a motion's velocity (T, n), rad s⁻¹."""
    first = next(iter(views.values()))
    L = first.law.L
    hertz = np.geomspace(_LOWEST_HZ, 0.5 / L, POINTS)
    found = {law: load_to_error(view, q, 2.0 * np.pi * L * hertz) for law, view in views.items()}
    return Loads(
        hertz,
        {law: np.abs(values) for law, values in found.items() if values is not None},
        _least_damped(plant_matrices(q, first.plant)[0]),
        _bandwidth(dq_d, L),
    )


def load_to_error(view: View, q: Array, angles: Array) -> Complex | None:
    """Error of each joint per load on it, (n, F), at angles ``2 pi f L``; None if the loop grows.

    The load is held over a period. ``e = -q``.
    """
    n, law = q.size, view.law
    closed = loop_matrix(q, view.plant, law, view.delay)
    if np.abs(np.linalg.eigvals(closed)).max() >= 1.0:
        return None
    A, _ = plant_matrices(q, view.plant)
    pull = np.zeros((4 * n, n))
    pull[n : 2 * n] = -np.linalg.inv(mass_matrix(q, view.plant.arm))
    load = np.zeros((len(closed), n), dtype=np.complex128)
    load[: 4 * n] = hold_discretised(A, pull, law.L)[1]
    z = np.exp(1j * angles)[:, np.newaxis, np.newaxis]
    moved = np.linalg.solve(z * np.eye(len(closed)) - closed, load)
    return np.asarray(-np.diagonal(moved[:, :n, :], axis1=1, axis2=2).T)


def _least_damped(A: Array) -> float:
    """Frequency of the least damped oscillation of dx/dt = A x, Hz."""
    rates = np.linalg.eigvals(A)
    rates = rates[rates.imag > 0.0]
    if not rates.size:
        return float("nan")
    return float(rates[np.argmin(-rates.real / np.abs(rates))].imag / (2.0 * np.pi))


def _bandwidth(dq_d: Array, L: float) -> float:
    power = (np.abs(np.fft.rfft(dq_d, axis=0)) ** 2).sum(axis=1)
    share = np.cumsum(power) / max(power.sum(), 1e-300)
    return float(np.fft.rfftfreq(len(dq_d), L)[np.searchsorted(share, _MOTION_SHARE)])
