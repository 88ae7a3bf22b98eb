"""How probable a changed equation is, given Tables 2 and 3, by what is compared and by which estimator.

Each interpretation is as likely as any other beforehand, and its plants are as likely as they were drawn. The
size of the errors tells nothing, since the arm is unknown. What is left depends on the estimator, so all stand
in one table: each is a classifier of plants, and says what it makes of the published errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier, HistGradientBoostingClassifier
from sklearn.isotonic import IsotonicRegression
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.configuration.models.readings import CHANGED
from tendonrepro.monte_carlo.shares import LEAST_PLANTS
from tendonrepro.results.summary import NOISE, with_noise
from tendonrepro.verdicts.planted import MOST_PLANTS, StableErrors

FOLDS = 5
"""A plant is in the same fold under every interpretation, so that none is judged by itself."""

WIDTHS = (0.02, 0.05, 0.1, 0.15)
"""Widths of the kernel, as relative differences of errors."""

NEIGHBOURS = 1000
"""Plants that a kernel sums over: farther ones weigh next to nothing."""

NEAR = (0.1, 0.12)
"""Root mean square of the relative differences up to which a plant lies near the print."""


def kernel(width: float, plants: int) -> KNeighborsClassifier:
    """Bayes' rule over the kernel density of each class, of the nearest plants."""

    def weights(distances: Array) -> Array:
        squares = distances**2
        return np.exp(0.5 * (squares.min(axis=1, keepdims=True) - squares) / width**2)

    return KNeighborsClassifier(min(NEIGHBOURS, plants), weights=weights, algorithm="brute")


def extra_trees(_: int) -> ExtraTreesClassifier:
    return ExtraTreesClassifier(100, min_samples_leaf=5, random_state=0)


def boosted_trees(_: int) -> HistGradientBoostingClassifier:
    return HistGradientBoostingClassifier(max_iter=100, random_state=0)


def quadratic_logistic(_: int) -> Any:
    return make_pipeline(StandardScaler(), PolynomialFeatures(2), StandardScaler(), LogisticRegression(C=0.1, max_iter=2000))


def between_runs(errors: Array) -> Array:
    """What log errors (N, runs, metrics, n) say of one run against another."""
    return (errors - errors.mean(axis=1, keepdims=True)).reshape(len(errors), -1)


def shape(errors: Array) -> Array:
    """Mean RMSE/MAE on each joint."""
    return (errors[:, :, 1] - errors[:, :, 0]).mean(axis=1)


def joints(errors: Array) -> Array:
    """Mean error of joint 3 over joint 2."""
    return (errors[..., -1] - errors[..., 0]).mean(axis=(1, 2))[:, None]


BETWEEN, ALL = "ratios between runs", "all ratios"
COMPARED: Mapping[str, tuple[int, Callable[[Array], Array]]] = {
    BETWEEN: (12, between_runs),
    "of MAE alone": (6, lambda errors: between_runs(errors[:, :, :1])),
    "with RMSE over MAE": (14, lambda errors: np.hstack([between_runs(errors), shape(errors)])),
    "with joint 3 over joint 2": (13, lambda errors: np.hstack([between_runs(errors), joints(errors)])),
    ALL: (15, lambda errors: (errors - errors.mean(axis=(1, 2, 3), keepdims=True)).reshape(len(errors), -1)),
}
"""How many numbers are compared, and how they follow from log errors (N, runs, metrics, n)."""

KERNELS = {f"kernel of {100 * width:.0f} %": partial(kernel, width) for width in WIDTHS}
TREES = {"extra trees": extra_trees, "boosted trees": boosted_trees}
ESTIMATORS: Mapping[str, Callable[[int], Any]] = KERNELS | TREES | {"quadratic logistic": quadratic_logistic}
"""Classifiers by name, each made for a number of plants. All are tried on the first and the last of `COMPARED`, the trees on the others, too."""


def given_tables(held: StableErrors, *, seed: int = 0) -> dict[str, Any]:
    """Rows of how probable a changed equation is, and how near the nearest plant lies to the print."""
    whole = {name: held.whole(name, MOST_PLANTS) for name in held.plants}
    names = [name for name, (plants, _) in whole.items() if len(plants) >= LEAST_PLANTS]
    each = max(len(whole[name][0]) for name in names)
    # An interpretation with fewer plants has some of them again, with other noise: all count alike.
    plants, errors = (np.concatenate([np.resize(whole[name][i], (each, *whole[name][i].shape[1:])) for name in names])
                      for i in (0, 1))
    fresh = np.concatenate([np.arange(each) < len(whole[name][0]) for name in names])
    changed = np.repeat([name in CHANGED for name in names], each)
    measured = np.log(with_noise(errors, NOISE, np.random.default_rng(seed)))
    paper = published_log_errors(held.joints)
    rows = [
        {"compared": compared, "numbers": count, "estimator": name}
        | estimated(make, numbers(measured), changed, plants % FOLDS, numbers(paper[None]))
        for compared, (count, numbers) in COMPARED.items()
        for name, make in (ESTIMATORS if compared in {BETWEEN, ALL} else TREES).items()
    ]
    apart = {compared: distances(np.log(errors), paper, COMPARED[compared][1]) for compared in (BETWEEN, ALL)}
    near = {f"plants within {100 * reach:.0f} %": apart[ALL] <= reach for reach in NEAR}
    order = (measured[:, :2] < measured[:, 1:3]).all(axis=(1, 2, 3))
    first = (measured[:, :1] < measured[:, 1:3]).all(axis=(1, 2, 3))
    counted = {"order of Table 2": order, "Controller 1 first": first} | near
    return {
        "draws": held.draws,
        "noise": NOISE,
        "folds": FOLDS,
        "names": names,
        "left_out": [name for name in whole if name not in names],
        "plants": [len(whole[name][0]) for name in names],
        "rows": rows,
        "counted": [
            {"what": what, "plants": int((hits & fresh).sum()), "probability": float(changed[hits].mean()) if hits.any() else None}
            for what, hits in counted.items()
        ],
        "nearest": {compared: float(sizes.min()) for compared, sizes in apart.items()},
        "nearest_of": apart[ALL].reshape(len(names), each).min(axis=1).tolist(),
    }


def without_the_nearest(held: StableErrors, given: Mapping[str, Any], count: int = 2) -> dict[str, Any]:
    """The same rows without the interpretations whose plants come nearest: how much hangs on which are asked."""
    by_distance = sorted(zip(given["nearest_of"], given["names"], strict=True))
    dropped = [name for _, name in by_distance[:count]]
    plants, errors = ({name: of[name] for name in of if name not in dropped} for of in (held.plants, held.errors))
    return {"names": dropped, "rows": given_tables(replace(held, plants=plants, errors=errors))["rows"]}


def estimated(make: Callable[[int], Any], X: Array, changed: Array, fold: Array, paper: Array) -> dict[str, float]:
    """Probability of a changed equation given the paper's numbers, and how good such a naming is on plants left out.

    `low` and `high` are of the estimators that saw all folds but one. `recalibrated` corrects the probability
    by how often such a one is right on plants left out, `right` is how often the more probable one is.
    """
    left_out, of_fold = np.empty(len(X)), []
    for number in range(FOLDS):
        seen = fold != number
        fitted = make(int(seen.sum())).fit(X[seen], changed[seen])
        left_out[~seen] = fitted.predict_proba(X[~seen])[:, 1]
        of_fold.append(fitted.predict_proba(paper)[0, 1])
    probability = make(len(X)).fit(X, changed).predict_proba(paper)[0, 1]
    recalibrated = IsotonicRegression(out_of_bounds="clip").fit(left_out, changed).predict([probability])[0]
    return {
        "probability": float(probability),
        "recalibrated": float(recalibrated),
        "low": float(min(of_fold)),
        "high": float(max(of_fold)),
        "right": float(((left_out > 0.5) == changed).mean()),
        "log_loss": float(log_loss(changed, np.clip(left_out, 1e-6, 1.0 - 1e-6))),
    }


def distances(errors: Array, paper: Array, numbers: Callable[[Array], Array]) -> Array:
    """Root mean square of the differences between each plant's numbers and the paper's, (N,)."""
    return np.sqrt(((numbers(errors) - numbers(paper[None])) ** 2).mean(axis=1))


def published_log_errors(joints: Sequence[int]) -> Array:
    """Those of Tables 2 and 3, (runs, metrics, n)."""
    return np.log([[published().per_joint(f"{row_of(run)}.{metric}", joints) for metric in METRICS] for run in RUNS])
