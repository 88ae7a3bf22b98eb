"""An ensemble in memory, of three readings and 256 plants, from functions that give errors and statuses."""

from functools import cache
from types import SimpleNamespace

import numpy as np

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.monte_carlo.report import population_summary
from tendonrepro.monte_carlo.shares import printed_ratios

RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload")
READINGS = ("printed", "weights=extrapolating", "start=cold")
JOINTS = (2, 3)
OK, RINGING, DIVERGED, UNRESOLVED = range(4)
SCRAMBLINGS, EACH = 8, 32
PLANTS = SCRAMBLINGS * EACH


class Held(SimpleNamespace):
    def __len__(self):
        return PLANTS


def ensemble(errors, statuses):
    """An ensemble in memory."""
    return Held(
        population="box",
        around="",
        runs=RUNS,
        joints=JOINTS,
        alpha=(0.1, 0.2),
        readings=READINGS,
        replicate=np.repeat(np.arange(SCRAMBLINGS), EACH),
        status=statuses,
        statistic=errors,
    )


def seeded(*words):
    return np.random.default_rng([ord(letter) for word in words for letter in word])


def random_errors(run, reading, metric):
    """Ranked as printed more often than not; missing where the plant could not be resolved."""
    sizes = seeded(run, reading, metric).uniform(0.5, 1.5, (PLANTS, 2)) + 0.3 * RUNS[:3].index(run)
    sizes[random_statuses(run, reading) == UNRESOLVED] = np.nan
    return sizes


def random_statuses(run, reading):
    return seeded(run, reading).choice(4, PLANTS, p=[0.7, 0.1, 0.1, 0.1]).astype(np.int8)


def always_ok(run, reading):
    del run, reading
    return np.zeros(PLANTS, np.int8)


def printed_like(factor):
    """Plants whose ratios scatter by 5 % around the printed ones times a factor for Controller 1."""

    def errors(run, reading, metric):
        of_table = metric.removesuffix("_settled")
        first = np.array(printed_ratios((0, 1), of_table, JOINTS))
        third = 1.0 / np.array(printed_ratios((1, 2), of_table, JOINTS))
        size = {"controller_1": factor * first, "controller_3": third}.get(run, np.ones(2))
        return size * np.exp(0.05 * seeded(run, reading, metric).standard_normal((PLANTS, 2)))

    return ensemble(errors, always_ok)


@cache
def box():
    return population_of(load_ensemble(None))


def whole(data):
    return {
        "draws": PLANTS,
        "scramblings": SCRAMBLINGS,
        "experiments_per_second": 321.0,
        "out": "reports/ensemble",
        "populations": {"box": population_summary(box(), data)},
        "of_paper": True,
    }
