"""Sensitivity indices by RBD-FAST: which share of an outcome's variance an unknown explains alone.

Outcomes in the order of an unknown, up through every second one and down through the rest, are one period of
a function of it. What the unknown explains is in the first harmonics.
Sources: Tarantola et al. 2006, doi:10.1016/j.ress.2005.06.003; Plischke 2010, doi:10.1016/j.ress.2009.11.005;
Tissot and Prieur 2012, doi:10.1016/j.ress.2012.06.010.
"""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array

HARMONICS = 6
"""The method's usual ten fit more of the noise of a few hundred plants."""

NORMAL_95 = 1.959963984540054
"""Standard deviations on each side that hold 95 % of a normal distribution."""


def first_order_index(unknown: Array, outcome: Array) -> float:
    """Share of an outcome's variance (N,) that an unknown (N,) explains alone.

    What the harmonics catch by chance is taken off, so an index can lie a little below 0.
    """
    by_size = np.argsort(unknown)
    period = outcome[np.concatenate([by_size[::2], by_size[1::2][::-1]])]
    power = np.abs(np.fft.rfft(period - period.mean())[1:]) ** 2
    if len(outcome) % 2 == 0:
        # Every other frequency stands for its negative, too.
        power[-1] *= 0.5
    caught = power[:HARMONICS].sum() / power.sum()
    chance = 2.0 * HARMONICS / len(outcome)
    return float(caught - chance / (1.0 - chance) * (1.0 - caught))


def half_width(unknown: Array, outcome: Array, resamples: int, rng: np.random.Generator) -> float:
    """Half the 95 % interval of the index, by a bootstrap of half the plants, which is on the wide side."""
    plants = len(outcome)
    indices = np.empty(resamples)
    for k in range(resamples):
        chosen = rng.choice(plants, size=plants // 2)
        indices[k] = first_order_index(unknown[chosen], outcome[chosen])
    return float(NORMAL_95 * indices.std(ddof=1))
