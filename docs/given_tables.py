"""How probable each interpretation of the paper is, given the published tables.

Ratios between runs tell interpretations apart. The size of an error tells nothing: the arm is unknown.
The density of the ratios under an interpretation is that of its stable plants, each with the noise of a
measurement (a kernel density). Equal priors and Bayes' rule give probabilities.

They hold in a closed world: one of the interpretations asked about is the paper's. `Given.typical` says
whether the published ratios look like those of any of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.errors import UsageError
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.shares import LEAST_PLANTS
from tendonrepro.physics.metrics import STATUSES

NOISE = 0.02
"""Relative noise of a measured error, one standard deviation. Assumed: the paper shows one run of each."""

FOLDS = 8

MOST_PLANTS = 512
"""Plants of one interpretation that are used, the first stable ones: enough for its shape, and quick."""

SURE = 0.9
"""Probability from which a naming counts as sure."""

WIDTHS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
"""Widths of the kernel over that of the noise. The one that serves held-out plants best is taken."""

BINS = (0.0, 0.5, 0.7, 0.9, 0.99, 1.0)
"""Edges of the table of calibration."""


@dataclass(frozen=True)
class Calibration:
    """Held-out plants whose most probable interpretation has a probability from `low` to `high`."""

    low: float
    high: float
    plants: int
    probability: float
    right: float


@dataclass(frozen=True)
class Given:
    """Interpretations, given the published tables, and how well such a naming does on plants left out.

    `names` (K,) and their `probability`; `plants` (K,) are stable in all runs. `accuracy` is that
    over held-out plants, `sure` the share that is named with `SURE` or more, `accuracy_when_sure` that among
    these. `confused` (K, K) has the share of a row's plants that is named as each column.

    `typical` is the share of held-out plants whose ratios are less likely than the published ones, each under
    the interpretation that fits best. A value near zero says that none has ratios like the paper's.
    """

    names: tuple[str, ...]
    probability: Array
    plants: NDArray[np.int64]
    left_out: tuple[str, ...]
    width: float
    accuracy: float
    sure: float
    accuracy_when_sure: float
    log_loss: float
    calibration: tuple[Calibration, ...]
    confused: Array
    typical: float


def given_tables(data: EnsembleData, names: Sequence[str], *, seed: int = 0) -> Given:
    """Probabilities of interpretations, given Tables 2 and 3.

    Parameters
    ----------
    data
        A finished ensemble of the paper's arm.
    names
        Interpretations that are asked about. One with fewer than `LEAST_PLANTS` stable plants is left out.
    seed
        Of the noise that held-out plants are measured with.

    Raises
    ------
    UsageError
        Where fewer than two interpretations have enough plants.
    """
    stable = {name: _stable(data, name)[:MOST_PLANTS] for name in names}
    kept = [name for name in names if len(stable[name]) >= LEAST_PLANTS]
    if len(kept) < 2:
        message = f"only {len(kept)} of the interpretations have {LEAST_PLANTS} stable plants; two are needed"
        raise UsageError(message, hint="more draws, or other interpretations")
    plant = np.concatenate([stable[name] for name in kept])
    truth = np.repeat(np.arange(len(kept)), [len(stable[name]) for name in kept])
    errors = np.concatenate([_log_errors(data, name, stable[name]) for name in kept])
    noise = NOISE * np.random.default_rng(seed).standard_normal(errors.shape)
    exact, measured = _between_runs(errors), _between_runs(errors + noise)

    squares = _squared_distances(measured, exact)
    # A plant is judged by those of other folds: under another interpretation it is not a stranger.
    squares[plant[:, None] % FOLDS == plant[None, :] % FOLDS] = np.inf
    tried = [_log_densities(squares, truth, width) for width in WIDTHS]
    losses = [_log_loss(densities, truth) for densities in tried]
    best = int(np.argmin(losses))
    densities, width = tried[best], WIDTHS[best]

    paper = _between_runs(_published_log_errors(data.joints)[None])
    of_paper = _log_densities(_squared_distances(paper, exact), truth, width)
    probabilities = _probabilities(densities)
    named, surest = probabilities.argmax(axis=1), probabilities.max(axis=1)
    right, sure = named == truth, surest >= SURE
    return Given(
        names=tuple(kept),
        probability=_probabilities(of_paper)[0],
        plants=np.bincount(truth),
        left_out=tuple(name for name in names if name not in kept),
        width=width,
        accuracy=float(right.mean()),
        sure=float(sure.mean()),
        accuracy_when_sure=float(right[sure].mean()) if sure.any() else float("nan"),
        log_loss=losses[best],
        calibration=_calibration(surest, right),
        confused=np.array([np.bincount(named[truth == k], minlength=len(kept)) for k in range(len(kept))])
        / np.bincount(truth)[:, None],
        typical=float((densities.max(axis=1) < of_paper.max()).mean()),
    )


def _stable(data: EnsembleData, name: str) -> NDArray[np.int64]:
    """Numbers of the plants on which every run is stable."""
    return np.flatnonzero(np.all([data.status(run, name) == STATUSES.index("ok") for run in RUNS], axis=0))


def _log_errors(data: EnsembleData, name: str, plants: NDArray[np.int64]) -> Array:
    """Logarithms of the errors of some plants under one interpretation, (M, runs, 2 n)."""
    by_metric = [[data.statistic(run, name, metric)[plants] for run in RUNS] for metric in METRICS]
    return np.asarray(np.log(np.concatenate([np.stack(runs, axis=1) for runs in by_metric], axis=2)))


def _published_log_errors(joints: Sequence[int]) -> Array:
    """Those of Tables 2 and 3, (runs, 2 n)."""
    columns = [f"{metric}.joint_{joint}" for metric in METRICS for joint in joints]
    printed = [[published().number(f"{row_of(run)}.{name}") for name in columns] for run in RUNS]
    return np.asarray(np.log(printed))


def _between_runs(errors: Array) -> Array:
    """Part of log errors (N, runs, 2 n) that compares runs, flat: each less the mean over the runs."""
    return np.asarray((errors - errors.mean(axis=1, keepdims=True)).reshape(len(errors), -1))


def _squared_distances(first: Array, second: Array) -> Array:
    """Squared distances (N, M) over that of the noise."""
    products = first @ second.T
    lengths = (first**2).sum(axis=1)[:, None] + (second**2).sum(axis=1)[None, :]
    return np.asarray(np.maximum(lengths - 2.0 * products, 0.0) / NOISE**2)


def _log_densities(squares: Array, truth: NDArray[np.int64], width: float) -> Array:
    """Logarithm of the mean kernel over the plants of each interpretation, (N, K), less a constant."""
    exponents = -0.5 * squares / width**2
    columns = []
    for k in range(int(truth.max()) + 1):
        of_one = exponents[:, truth == k]
        count = np.isfinite(of_one).sum(axis=1)
        columns.append(logsumexp(of_one, axis=1) - np.log(count))
    return np.stack(columns, axis=1)


def _probabilities(densities: Array) -> Array:
    """Bayes' rule with equal priors, (N, K)."""
    return np.asarray(np.exp(densities - logsumexp(densities, axis=1, keepdims=True)))


def _log_loss(densities: Array, truth: NDArray[np.int64]) -> float:
    """Mean of minus the log probability of the right interpretation, at least that of one in a million."""
    right = densities[np.arange(len(truth)), truth] - logsumexp(densities, axis=1)
    return float(-np.maximum(right, np.log(1e-6)).mean())


def _calibration(surest: Array, right: NDArray[np.bool_]) -> tuple[Calibration, ...]:
    place = np.minimum(np.searchsorted(BINS, surest, side="right") - 1, len(BINS) - 2)
    return tuple(
        Calibration(
            BINS[k], BINS[k + 1], int(here.sum()), float(surest[here].mean()), float(right[here].mean())
        )
        for k in range(len(BINS) - 1)
        for here in [place == k]
        if here.any()
    )
