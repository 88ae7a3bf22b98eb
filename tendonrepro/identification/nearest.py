"""The draw of an ensemble that comes nearest to the numbers that a search fits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import METRICS
from tendonrepro.errors import DataMissingError
from tendonrepro.identification.goal import Goal, Window
from tendonrepro.identification.misfit import SUFFIX, Simulated, log_misfit
from tendonrepro.monte_carlo.data import EnsembleData


class NearestDraw(NamedTuple):
    """Values (P,) of the rows of the ranges, and how far the numbers are."""

    values: Array
    misfit: float


def nearest_draw(ensemble: EnsembleData, goal: Goal, reading: str, window: Window = "whole") -> NearestDraw:
    """Nearest draw whose runs all end well.

    Parameters
    ----------
    ensemble : EnsembleData
        With every run of the goal, on the joints of the goal.
    goal : Goal
        The numbers.
    reading : str
        Its name.
    window : {'whole', 'late', 'settled'}
        What errors average.

    Raises
    ------
    DataMissingError
        Where the ensemble lacks the reading, or no draw ends well under it.
    """
    status = np.stack([ensemble.status(run, reading) for run in goal.runs], axis=1)
    sizes = np.array(
        [
            [ensemble.statistic(run, reading, metric + SUFFIX[window]) for metric in METRICS]
            for run in goal.runs
        ]
    )
    # How long a bad run lasted is not stored, and does not matter: only good ones count.
    drawn = Simulated(np.rad2deg(np.moveaxis(sizes, 2, 0)), status, np.ones(status.shape))
    stable = np.flatnonzero(drawn.ok.all(axis=1))
    if not stable.size:
        raise DataMissingError(f"no draw of the ensemble ends well under {reading}")
    misfits = log_misfit(drawn, goal)[stable]
    best = int(np.argmin(misfits))
    return NearestDraw(ensemble.draws[stable[best]], float(misfits[best]))
