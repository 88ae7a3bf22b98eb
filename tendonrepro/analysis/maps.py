"""Where the sampled loop is stable: its modes and its slowest decay while a parameter is multiplied."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law
from tendonrepro.physics.dynamics import Plant
from tendonrepro.physics.linear_loop import (
    DEADEST,
    Complex,
    closed,
    hold_discretised,
    law_matrices,
    plant_matrices,
    spectral_radius,
)

PARAMETERS = ("M_bar", "alpha", "K_s", "D_s")
"""What can be multiplied: two gains of the law, two properties of the tendons, each on all joints."""

_HALVINGS = 10


def scaled(plant: Plant, law: Law, parameter: str, factor: float) -> tuple[Plant, Law]:
    """Multiply one of `PARAMETERS` on all joints."""
    drive = plant.drive
    if parameter == "M_bar":
        return plant, law._replace(M_bar=factor * law.M_bar)
    if parameter == "alpha":
        # Of either sign: weights that extrapolate stay so.
        older = factor * law.weights[1]
        return plant, law._replace(weights=np.stack([1.0 - older, older]))
    if parameter == "K_s":
        return plant._replace(drive=drive._replace(stiffness=factor * drive.stiffness)), law
    return plant._replace(drive=drive._replace(damping=factor * drive.damping)), law


def root_locus(q: Array, plant: Plant, law: Law, delay: int, parameter: str, factors: Array) -> Complex:
    """Modes of the loop for every factor on a parameter, (F, m), each followed from factor to factor.

    Rates as of `modes`, of both signs of the frequency; NaN where one dies within a sample.
    """
    rows, parts = [], law_matrices(law, q.size, delay)
    for factor in factors:
        changed, gains = scaled(plant, law, parameter, float(factor))
        own = parts if gains is law else law_matrices(gains, q.size, delay)
        matrix = closed(*hold_discretised(*plant_matrices(q, changed), law.L), *own)
        rows.append(np.linalg.eigvals(matrix).astype(np.complex128))
    for before, row in pairwise(rows):
        row[:] = _followed(before, row)
    z = np.stack(rows)
    alive = np.abs(z) > DEADEST
    return np.where(alive, np.log(np.where(alive, z, 1.0)) / law.L, np.nan)


def _followed(before: Complex, now: Complex) -> Complex:
    """Put values into the order of those before, the closest pairs first."""
    distance = np.abs(before[:, np.newaxis] - now)
    ordered = np.empty_like(now)
    for _ in now:
        i, j = np.unravel_index(distance.argmin(), distance.shape)
        ordered[i] = now[j]
        distance[i], distance[:, j] = np.inf, np.inf
    return ordered


def tendon_decay(
    postures: Sequence[Array], plant: Plant, law: Law, delay: int, K_s: Array, D_s: Array
) -> Array:
    """Slowest decay over several postures, s⁻¹, for factors (N,) on the tendons' stiffness and damping."""
    plants = [
        scaled(scaled(plant, law, "K_s", k)[0], law, "D_s", d)[0] for k, d in zip(K_s, D_s, strict=True)
    ]
    return _decays(postures, plants, [law], delay)


def gain_decay(
    postures: Sequence[Array], plant: Plant, law: Law, delay: int, M_bar: Array, alpha: Array
) -> Array:
    """Slowest decay over several postures, s⁻¹, for factors (N,) on two gains of the law.

    A law without the second estimate has no α, and its factor does nothing.
    """
    pairs = np.column_stack([M_bar, alpha if law.weights[1].any() else np.ones_like(alpha)])
    pairs, places = np.unique(pairs, axis=0, return_inverse=True)
    laws = [scaled(plant, scaled(plant, law, "M_bar", m)[1], "alpha", a)[1] for m, a in pairs]
    return _decays(postures, [plant], laws, delay)[places.ravel()]


def _decays(postures: Sequence[Array], plants: Sequence[Plant], laws: Sequence[Law], delay: int) -> Array:
    """Slowest decay of N plants under one law, or of N laws on one plant, (N,)."""
    parts = (law_matrices(law, law.M_bar.size, delay) for law in laws)
    output, memory = (np.stack(part) for part in zip(*parts, strict=True))
    radius = np.zeros(1)
    for q in postures:
        held = (hold_discretised(*plant_matrices(q, plant), laws[0].L) for plant in plants)
        Phi, Gamma = (np.stack(part) for part in zip(*held, strict=True))
        radius = np.maximum(radius, spectral_radius(closed(Phi, Gamma, output, memory)))
    return np.asarray(-np.log(radius) / laws[0].L)


def border_distance(decay: Callable[[Array, Array], Array], across: Array, along: Array) -> Array:
    """Signed distance (Y, X) from the border of stability, positive inside, in the logarithm of `along`.

    The decay itself is no good for drawing the border: it is flat where a slow mode sets it and steep where
    the ringing does. The border is found by halving on every line, so that the distance is right on the grid;
    it is at most the length of the range.
    """
    height = np.log(along)
    grid = np.meshgrid(across, along)
    stable = decay(*(part.ravel() for part in grid)).reshape(grid[0].shape) > 0.0
    distance = np.full(stable.shape, height[-1] - height[0])
    row, column = np.nonzero(stable[:-1] != stable[1:])
    low, high, below = height[row], height[row + 1], stable[row, column]
    for _ in range(_HALVINGS if row.size else 0):
        middle = 0.5 * (low + high)
        same = (decay(across[column], np.exp(middle)) > 0.0) == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    for place, border in zip(column, 0.5 * (low + high), strict=True):
        distance[:, place] = np.minimum(distance[:, place], np.abs(height - border))
    return np.where(stable, distance, -distance)
