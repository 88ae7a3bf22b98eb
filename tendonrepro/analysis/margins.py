"""How far the sampled loop is from its limit of stability, in gain and lag.

For a margin the loop is cut between controller and plant: the plant feels another torque than the law
believes to have applied. With the other joints' loops closed, one channel ``G`` is left. It is on its limit
where ``factor · G(z) = 1`` on the unit circle, for a real gain or a lag ``exp(-j phase)``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.linear_loop import Complex, spectral_radius

Cut = tuple[Array, Array, Array]
"""``A``, ``B``, ``C`` of :func:`tendonrepro.physics.linear_loop.open_loop`."""

LOW_FREQUENCY = 0.1
"""Frequency at which the loop gain is given, Hz: about that of the desired motion."""

_LOWEST_ANGLE = 1e-6
# Not zero itself, where a law that integrates has no finite response.
_REST = 1e-8
_ZOOMS = 40
# A factor this much beyond a crossing must make the loop grow; else the mode only touched the circle.
_BEYOND = 1e-4


class ChannelMargins(NamedTuple):
    """Margins of one joint's torque with the other loops closed; NaN where there is none or the loop grows.

    The gain margin is the smallest factor above 1 that makes the loop grow. The phase margin is the smallest
    lag or lead that does, the delay margin the shortest extra delay unknown to the law. `loop_gain` is
    ``|G|`` at `LOW_FREQUENCY`.
    """

    stable: bool = False
    gain_margin: float = np.nan
    gain_margin_hz: float = np.nan
    phase_margin_deg: float = np.nan
    crossover_hz: float = np.nan
    delay_margin_s: float = np.nan
    loop_gain: float = np.nan


def channel(cut: Cut, joint: int) -> Cut:
    """Close the loops of all joints but one, counted from 0."""
    A, B, C = cut
    others = np.delete(np.arange(B.shape[1]), joint)
    return A + B[:, others] @ C[others], B[:, [joint]], C[[joint]]


def response(cut: Cut, angles: Array) -> Complex:
    """Transfer matrix (N, p, p), from torque felt to torque asked for, at angles ``2 pi f L``, rad."""
    A, B, C = cut
    z = np.exp(1j * angles)[:, np.newaxis, np.newaxis]
    return np.asarray(C @ np.linalg.solve(z * np.eye(A.shape[0]) - A, B.astype(np.complex128)))


def angle_grid(*matrices: Array) -> Array:
    """Angles, rising up to π, that leave no resonance of the matrices between two points.

    They are dense near zero, near π, where a delayed loop rings, and around every mode.
    """
    towards_zero = np.geomspace(_LOWEST_ANGLE, np.pi, 400)
    parts = [towards_zero, np.pi - np.geomspace(1e-7, 1.0, 120)]
    spread = np.geomspace(0.03, 30.0, 13)
    for z in np.concatenate([np.linalg.eigvals(matrix) for matrix in matrices]):
        if 0.5 < abs(z) < 2.0 and z.imag >= 0.0:
            width = max(abs(np.log(abs(z))), 1e-8)
            parts.append(np.angle(z) + width * np.concatenate([-spread, [0.0], spread]))
    angles = np.unique(np.concatenate(parts))
    return angles[(angles >= _LOWEST_ANGLE) & (angles <= np.pi)]


def channel_margins(cut: Cut, joint: int, L: float) -> ChannelMargins:
    """Margins of one joint, counted from 0; L in s."""
    A, b, c = single = channel(cut, joint)
    gain = float(np.abs(response(single, np.array([2.0 * np.pi * LOW_FREQUENCY * L])))[0, 0, 0])
    if spectral_radius(A + b @ c) >= 1.0:
        return ChannelMargins(loop_gain=gain)
    angles = angle_grid(A, A + b @ c)

    def at(where: Array) -> Complex:
        return response(single, where)[:, 0, 0]

    factor, place = _first_loss(single, *_gain_crossings(at, angles))
    unity = _crossings(lambda x: np.abs(at(x)) - 1.0, angles)
    lags = np.mod(np.angle(at(unity)), 2.0 * np.pi)
    turns = np.minimum(lags, 2.0 * np.pi - lags)
    hertz = 1.0 / (2.0 * np.pi * L)
    phase, crossover = (turns.min(), unity[turns.argmin()]) if unity.size else (np.nan, np.nan)
    delay = (lags / unity).min() * L if unity.size else np.nan
    return ChannelMargins(
        stable=True,
        gain_margin=factor,
        gain_margin_hz=hertz * place,
        phase_margin_deg=float(np.rad2deg(phase)),
        crossover_hz=float(hertz * crossover),
        delay_margin_s=float(delay),
        loop_gain=gain,
    )


def _crossings(value: Callable[[Array], Array], angles: Array) -> Array:
    """Zeros of a real function, by halving."""
    sign = np.sign(value(angles))
    left = np.flatnonzero(sign[:-1] * sign[1:] < 0.0)
    low, high, below = angles[left], angles[left + 1], sign[left]
    for _ in range(_ZOOMS):
        middle = 0.5 * (low + high)
        same = np.sign(value(middle)) == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)


def _gain_crossings(at: Callable[[Array], Complex], angles: Array) -> tuple[Array, Array]:
    """Real factors that put a mode on the unit circle, and where.

    At π ``G`` is real, and at rest too unless it has a pole there.
    """
    places = np.append(_crossings(lambda x: at(x).imag, angles), np.pi)
    rest = at(np.array([_REST]))
    if abs(rest[0].imag) < 1e-3 * abs(rest[0].real):
        places = np.append(places, _REST)
    real = at(places).real
    # Below 1e-9 it is the pole at z = 1 itself that was met.
    crosses = (real > 1e-9) & (real < 1e9)
    return 1.0 / real[crosses], places[crosses]


def _first_loss(single: Cut, factors: Array, places: Array) -> tuple[float, float]:
    """Smallest factor above 1 beyond which the loop grows, and the angle of its mode."""
    A, b, c = single
    for k in np.argsort(factors):
        beyond = factors[k] * (1.0 + _BEYOND)
        if factors[k] > 1.0 and spectral_radius(A + beyond * b @ c) > 1.0:
            return float(factors[k]), float(places[k])
    return np.nan, np.nan


def disk_margin(cut: Cut, L: float) -> tuple[float, float]:
    """Symmetric disk margin of all joints at once, 0 to 2 or NaN of a loop that grows, and where, Hz.

    Every torque may be multiplied by a complex factor ``(2 + d) / (2 - d)`` of its own while every ``|d|`` is
    below the margin, ``2 / max mu(S - T)`` over the frequencies; see `scaled_norm`.
    """
    A, B, C = cut
    if spectral_radius(A + B @ C) >= 1.0:
        return np.nan, np.nan
    identity = np.eye(B.shape[1])

    def size(where: Array) -> Array:
        G = response(cut, where)
        difference = np.linalg.solve((identity - G).mT, (identity + G).mT).mT
        return scaled_norm(np.asarray(difference, dtype=np.complex128))

    angles = angle_grid(A, A + B @ C)
    sizes = size(angles)
    for _ in range(4):
        top = int(sizes.argmax())
        angles = np.linspace(angles[max(top - 1, 0)], angles[min(top + 1, angles.size - 1)], 33)
        sizes = size(angles)
    return float(2.0 / sizes.max()), float(angles[sizes.argmax()] / (2.0 * np.pi * L))


def scaled_norm(M: Complex) -> Array:
    """Upper bound of the structured singular value of M (N, n, n) for diagonal complex perturbations.

    The largest singular value of ``D M D⁻¹`` with the diagonal ``D`` that makes its Frobenius norm smallest.
    For one and two rows the bound is the value.
    """
    M = M.copy()
    n = M.shape[-1]
    for i in range(n) if n == 2 else 20 * tuple(range(n)):
        others = np.arange(n) != i
        row = np.linalg.norm(M[:, i, others], axis=-1)
        column = np.linalg.norm(M[:, others, i], axis=-1)
        d = np.sqrt(np.maximum(column, 1e-150) / np.maximum(row, 1e-150))
        M[:, i, :] *= d[:, np.newaxis]
        M[:, :, i] /= d[:, np.newaxis]
    return np.asarray(np.linalg.norm(M, 2, axis=(-2, -1)))
