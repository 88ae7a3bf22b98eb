"""An ensemble made from formulas on which every claim holds, and the paper of one of its plants."""

import numpy as np

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS, published
from tendonrepro.errors import DataMissingError
from tendonrepro.verdicts.judge import judge_all
from tendonrepro.verdicts.planted import print_of
from tendonrepro.verdicts.sensitivity import ranked
from tendonrepro.verdicts.statements import (
    HALVED,
    IDEAL,
    IDEAL_LONGER,
    IDEAL_SHORTER,
    LONGER,
    SHORTER,
    SIZES,
)

KNOWN = 3
ERRORS_DEG = {
    "controller_1": (0.26, 0.22),
    "controller_2": (0.29, 0.24),
    "controller_3": (0.31, 0.27),
    "controller_1_payload": (0.27, 0.23),
}

ORDER = {"controller_1": 0, "controller_1_payload": 0, "controller_2": 1, "controller_3": 2}


class MadeEnsemble:
    of_paper = True
    joints = (2, 3)
    names = ("size", "nothing")
    identity = "made"
    planned = 400

    def __init__(self, per_replicate=50, replicates=8, readings=(PRINTED,)):
        self.readings = readings
        count = per_replicate * replicates
        self.rng = np.random.default_rng(1)
        self.replicate = np.repeat(np.arange(replicates), per_replicate)
        self.draws = self.rng.random((count, 2))
        self.draws[KNOWN] = 0.5
        self.codes = {}
        self.values = {}
        for reading in (*readings, IDEAL.name):
            for run in RUNS:
                self._make(run, reading)
        variations = {SHORTER: 0.5, LONGER: 2.0, HALVED: 0.5}
        variations |= {IDEAL_SHORTER: 0.5, IDEAL_LONGER: 2.0}
        for variation, factor in variations.items():
            self._make("controller_2", variation.name)
            for name in ("mae", "epsilon_slow_rms", "torque_step_rms"):
                self.values["controller_2", variation.name, name] *= factor

    def _make(self, run, reading):
        count, place = len(self.draws), ORDER[run]
        self.codes[run, reading] = np.zeros(count, dtype=np.int8)
        size = 0.5 + self.draws[:, :1]
        wobble = 1.0 + 0.01 * (self.rng.random((count, 2)) - 0.5)
        wobble[KNOWN] = 1.0
        error = np.deg2rad(ERRORS_DEG[run]) * size * wobble
        rise = 1.0 + 0.1 * place
        made = {
            "mae": error,
            "rmse": (1.2 + 0.05 * place) * error,
            "mae_rapid": error * (1.0 + 0.2 * place),
            "mae_calm": error,
            "s_rms": 0.03 * size * wobble,
            "s_slow_rms": 0.02 * size * wobble,
            "torque_step_rms": size * rise,
            "epsilon_rms": 10.0 * size * rise,
            "epsilon_slow_rms": size * rise,
            "overshoot": 0.001 * size * rise,
            "epsilon_max": 0.8 * size * np.ones(2),
            "s_max": 0.05 * size * np.ones(2),
            "max_error": 0.01 * size * rise,
            "rate_max": 0.05 * size * np.ones(2),
        }
        for place, name in enumerate(SIZES, start=1):
            for phase, more in (("", rise), ("_up", rise), ("_down", wobble)):
                made |= {f"{signal}_{name}{phase}": place * size * more for signal in ("torque", "H_hat")}
        for name, value in made.items():
            self.values[run, reading, name] = np.broadcast_to(value, (count, 2)).copy()

    def has(self, run, reading):
        return (run, reading) in self.codes

    def status(self, run, reading):
        if not self.has(run, reading):
            raise DataMissingError(f"the ensemble holds no run {run!r} under {reading!r}")
        return self.codes[run, reading]

    def statistic(self, run, reading, name):
        return self.values[run, reading, name]


ESTIMATES = ("epsilon_rms", "epsilon_slow_rms")


def spoil(data, run, names, factor, reading=PRINTED):
    """Make some statistics of a run larger, by names."""
    for name in names:
        data.values[run, reading, name] *= factor


def sizes_of(signal, phase=""):
    """Names of the sizes of a signal in a phase."""
    return [f"{signal}_{size}{phase}" for size in SIZES]


def paper_of(data, plant=KNOWN):
    """What someone would have printed who measured one plant of the ensemble."""
    errors = [[data.values[run, PRINTED, metric][plant] for metric in METRICS] for run in RUNS]
    return print_of(published(), data.joints, np.rad2deg(errors))


def verdicts(data, paper, *only):
    return {verdict.id: verdict for verdict in judge_all(data, paper, only)}


def verdict_on(data, paper, name):
    return verdicts(data, paper, name)[name]


NAMES = ("a", "b", "c", "d")


def ranking_of(draws, outcome):
    """Rank the four unknowns of some draws."""
    ranking = ranked(NAMES, draws, outcome)
    assert ranking is not None
    return ranking
