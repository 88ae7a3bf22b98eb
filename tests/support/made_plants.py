"""A stepper of a few unknowns, plants around the printed numbers, and papers with other numbers."""

from functools import cache

import numpy as np

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.identification.bench import Simulated, printed_numbers
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import Batch
from tendonrepro.simulation.streaming import STATISTICS

OK, RINGING, DIVERGED, UNRESOLVED = range(len(STATUSES))


class Killed(BaseException):
    """What no handler catches."""


@cache
def loaded():
    return load_ensemble(None)


def measured(sizes, status=OK, lasted=1.0):
    """Plants with all four runs; `sizes` (N, 4, 2, 2)."""
    sizes = np.asarray(sizes, dtype=float)
    shape = sizes.shape[:2]
    return Simulated(sizes, np.broadcast_to(np.int8(status), shape), np.broadcast_to(lasted, shape))


PRINTED = printed_numbers(published(), (2, 3))


def plants():
    """200 plants around the printed numbers, within 5 per cent, every number by itself."""
    noise = np.random.default_rng(3).uniform(-0.05, 0.05, (200, 4, 2, 2))
    return measured(PRINTED.values * np.exp(noise))


def made_up(loops, threads=1):
    """A stepper of a few unknowns: size by motor damping and link length, order by the law's weights."""
    del threads
    mae, rmse = np.deg2rad([_size(loop) for loop in loops]).swapaxes(0, 1)
    values = dict.fromkeys(STATISTICS, np.zeros((len(loops), 2))) | {"mae": mae, "rmse": rmse}
    values |= {"mae_late": 2.0 * mae, "rmse_late": 2.0 * rmse}
    ends = np.array([loop.reference.time[-1] for loop in loops])
    return Batch(values, np.zeros(len(loops), np.int8), ends, np.full(len(loops), 2), None)


def _size(loop):
    """MAE and RMSE in degrees, (2, 2); Controller 1's is smaller by a share that no plant changes."""
    law, plant = loop.controller.law, loop.plant
    stroke = float(np.ptp(loop.reference.q_d[:, 1]))
    base = 0.4 * float(plant.drive.friction.viscous[0]) * np.array([stroke, 2.0 * stroke**2])
    two_weights = law.weights[1] != 0.0
    factor = 0.9 if two_weights.any() else 1.0
    return np.array([base, 1.25 * base]) * factor


def paper_with(errors, decimals=None):
    """The paper with these errors, (4, 2, 2) in degrees, in Tables 2 and 3."""
    names = [
        f"{row_of(run)}.{metric}.joint_{joint}" for run in RUNS for metric in METRICS for joint in (2, 3)
    ]
    return published().with_numbers(dict(zip(names, np.ravel(errors), strict=True)), decimals)


MADE_UP_ERRORS = np.einsum("r,m,j->rmj", [0.9, 1.0, 1.0, 0.9], [1.0, 1.25], [0.2, 0.2])
"""What the made-up stepper gives for a plant in the middle of the box, deg."""


def made_up_paper(**changed):
    """The paper with these numbers, but for some."""
    return paper_with(MADE_UP_ERRORS).with_numbers(changed)
