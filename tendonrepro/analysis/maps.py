"""Where the sampled loop is stable: its modes and its slowest decay while a parameter is multiplied."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
    loop_matrix,
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
    changed = [scaled(plant, law, parameter, float(factor)) for factor in factors]
    rows = [np.linalg.eigvals(loop_matrix(q, *each, delay)).astype(np.complex128) for each in changed]
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


def decays(
    postures: Sequence[Array], plant: Plant, law: Law, delay: int, factors: Mapping[str, Array]
) -> Array:
    """Slowest decay over several postures, s⁻¹, (N,), for factors (N,) on some of `PARAMETERS`."""
    changed = []
    for values in zip(*factors.values(), strict=True):
        one = plant, law
        for parameter, factor in zip(factors, values, strict=True):
            one = scaled(*one, parameter, factor)
        changed.append(one)
    plants, laws = ([held[0]] if held[0] is held[-1] else held for held in zip(*changed, strict=True))
    output, memory = (
        np.stack(parts) for parts in zip(*(law_matrices(held, delay) for held in laws), strict=True)
    )
    radius = np.zeros(1)
    for q in postures:
        held = [hold_discretised(*plant_matrices(q, each), law.L) for each in plants]
        Phi, Gamma = (np.stack(parts) for parts in zip(*held, strict=True))
        radius = np.maximum(radius, spectral_radius(closed(Phi, Gamma, output, memory)))
    return np.asarray(-np.log(radius) / law.L)


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
