"""Where the loop is stable while stiffness and damping of the tendons are multiplied."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.experiments.loops import View
from tendonrepro.physics.dynamics import Plant
from tendonrepro.physics.linear_loop import (
    closed,
    hold_discretised,
    law_matrices,
    plant_matrices,
    spectral_radius,
)

MAP_POINTS = 25
_HALVINGS = 10


@dataclass(frozen=True)
class TendonMap:
    """Distance (F, F) of every run from its border, in the logarithm of the damping, positive if stable.

    `factors` (F,) are on stiffness, across, and on damping.
    """

    factors: Array
    distance: Mapping[str, Array]


def tendon_map(views: Mapping[str, View], postures: Sequence[Array]) -> TendonMap:
    """Borders of every run, stable where it is at all postures."""
    factors = np.geomspace(0.1, 10.0, MAP_POINTS)

    def distance(view: View) -> Array:
        return border_distance(lambda K_s, D_s: decays(view, postures, K_s, D_s), factors, factors)

    return TendonMap(factors, {run: distance(view) for run, view in views.items()})


def with_tendons(plant: Plant, stiffness: float, damping: float) -> Plant:
    """Multiply stiffness and damping of all tendons."""
    drive = plant.drive
    return plant._replace(
        drive=drive._replace(stiffness=stiffness * drive.stiffness, damping=damping * drive.damping)
    )


def decays(view: View, postures: Sequence[Array], stiffness: Array, damping: Array) -> Array:
    """Slowest decay over several postures, s⁻¹, for factors on stiffness and damping, all (N,)."""
    law = view.law
    plants = [with_tendons(view.plant, K_s, D_s) for K_s, D_s in zip(stiffness, damping, strict=True)]
    output, memory = law_matrices(law, view.delay)
    radius = np.zeros(1)
    for q in postures:
        held = [hold_discretised(*plant_matrices(q, plant), law.L) for plant in plants]
        Phi, Gamma = (np.stack(parts) for parts in zip(*held, strict=True))
        radius = np.maximum(radius, spectral_radius(closed(Phi, Gamma, output, memory)))
    return np.asarray(-np.log(radius) / law.L)


def border_distance(decay: Callable[[Array, Array], Array], across: Array, along: Array) -> Array:
    """Signed distance (Y, X) from the border of stability, positive inside, in the logarithm of `along`.

    The decay itself draws no border: slow modes make it flat and ringing steep. The border is found by
    halving on every line. The distance is at most the length of the range.
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
