"""Fit of a hypothesis to a log: parameters with intervals, and errors on samples it was not fitted to.

Triangular factors of blocks of samples stand for the samples, and lose nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq, minimize_scalar

from tendonrepro.arrays import Array
from tendonrepro.evidence.hypotheses import (
    FILTERS,
    LINEAR,
    NTSM,
    Hypothesis,
    coefficient_slopes,
    coefficients,
    hypotheses,
    regression,
)
from tendonrepro.evidence.log import Log, liveliest

BLOCK = 200
"""Samples of a block. Odd blocks are predicted from even ones."""
GROUPS = 16
"""Groups of blocks that are left out in turn, for intervals."""
SCREENED = 3000
"""Samples on which every hypothesis is tried: those of the fastest motion."""
SAME = 1e-6
"""Share of the torque's step below which a residual is arithmetic."""
DECISIVE = 10.0
"""Difference of the information criterion that counts as very strong evidence (Kass and Raftery 1995)."""
KEPT = 10
"""Hypotheses that are then fitted to all samples."""
NINETY = 1.753
"""Quantile of Student's t for a central 90 % interval from `GROUPS` values."""
CLOSE_TO_FREE = 1.05
"""Squared error over that of free coefficients up to which a second start is not worth its time."""
Solve: TypeAlias = Callable[[Array, Hypothesis], Array]
"""Coefficients of a hypothesis from a triangular factor."""

START = np.array([1.0, 0.0, 0.01, 8.0, 1.5])
"""The published values, from which a search begins where the linear solution is loose."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis with what a log says of it.

    Attributes
    ----------
    parameters, half : array (5,)
        ``w_1, w_2, M_bar, lam, eta``, or ``K_d, K_p`` at the end if linear; half their 90 % interval.
    position_gain, position_gain_half
        Gain of the error over the published one, near 0 without an integral; half its 90 % interval.
    residual
        RMS of the odd blocks beyond the fit to the even ones, N m.
    step
        RMS of the torque's step from sample to sample, N m.
    information
        Bayesian information criterion of the fit to all samples.
    condition
        Condition number of the scaled regressors.
    bias
        How far rounding of the record may have moved a weight: regressors are taken for exact.
    """

    hypothesis: Hypothesis
    parameters: Array
    half: Array
    position_gain: float
    position_gain_half: float
    residual: float
    step: float
    information: float
    condition: float
    samples: int
    bias: float

    @property
    def is_possible(self) -> bool:
        """Whether M_bar is positive, and no weight beyond those of any interpretation."""
        return bool(self.parameters[2] > 0.0 and np.abs(self.parameters[:2]).max() <= 2.0)

    @property
    def off_published(self) -> float:
        """Distance of M_bar and feedback gains from the published ones, sum of logarithms."""
        ratio = self.parameters[2:] / _published(self.hypothesis)[2:]
        return float(np.abs(np.log(ratio)).sum()) if (ratio > 0.0).all() else float("inf")


def ranked(log: Log, joint: int, rounding: tuple[float, float] = (0.0, 0.0)) -> list[Fit]:
    """Fits that come closest to one joint, counted from 0, best first; none if all torques stand at limits.

    ``rounding`` are the steps of the recorded torque, N m, and angle, rad.
    """
    window = liveliest(log, SCREENED)
    screened = [
        (_held_out_error(window, joint, hypothesis, _least_squares), k, hypothesis)
        for k, hypothesis in enumerate(hypotheses(log))
    ]
    best = [hypothesis for error, _, hypothesis in sorted(screened)[:KEPT] if np.isfinite(error)]
    if not best:
        return []
    printed = [Hypothesis(NTSM), Hypothesis(LINEAR)]
    tried = list(dict.fromkeys([*printed, *best]))
    if log.ddq_d[:, joint].any():
        # Coefficients that were free did without the acceleration where it was absent.
        tried += [hypothesis.without_acceleration() for hypothesis in tried]
    fits = [fitted(log, joint, hypothesis, rounding) for hypothesis in tried]
    if all(fit.residual > SAME * fit.step for fit in fits):
        # Filters have a free cutoff, so they are tried on what is published, and on what comes close without.
        bases = list(dict.fromkeys([*printed, best[0]]))
        tuned = [
            _tuned(window, joint, hypothesis, place) for hypothesis in bases for place in range(len(FILTERS))
        ]
        fits += [fitted(log, joint, hypothesis, rounding) for hypothesis in tuned]
    fits = [fit for fit in fits if fit.is_possible] or fits
    equal = equally_good(fits)
    # phi(k e; k Delta) = k^b phi(e; Delta): Delta and phi in degrees differ in eta alone. Gains decide.
    return sorted(
        fits,
        key=lambda fit: (
            fit not in equal,
            len(fit.hypothesis.settings),
            round(fit.off_published, 2),
            fit.information,
        ),
    )


def equally_good(fits: Sequence[Fit]) -> list[Fit]:
    """Fits that a log does not tell from the best one."""
    best = min(fit.information for fit in fits)
    exact = [fit for fit in fits if fit.residual <= SAME * fit.step]
    return exact or [fit for fit in fits if fit.information <= best + DECISIVE]


def fitted(log: Log, joint: int, hypothesis: Hypothesis, rounding: tuple[float, float]) -> Fit:
    """Fit a hypothesis to all samples of a joint; see :func:`ranked`."""
    regressed = regression(log, joint, hypothesis)
    block = regressed.rows // BLOCK
    factors = [_factor(regressed.X[rows], regressed.y[rows]) for rows in _groups(block)]
    whole = _stacked(factors)
    parameters = _solved(whole, hypothesis)
    left_out = np.stack(
        [
            _solved(_stacked(factors[:k] + factors[k + 1 :]), hypothesis, parameters)
            for k in range(len(factors))
        ]
    )
    samples = len(regressed.y)
    # Errors of the record are in the torque and in both remembered ones: heavy weights make them larger.
    noise = float(np.sqrt(1.0 + np.sum(_remembered(parameters, hypothesis) ** 2)))
    torque, angle = rounding
    # Of a step the variance is a twelfth of its square; an acceleration has six of the angle's, over L^4.
    errors = torque**2 / 12.0, 6.0 * angle**2 / 12.0 / log.L**4
    error = _residual(whole, coefficients(parameters, hypothesis)) / noise
    count = parameters.size + (hypothesis.newest < 1.0)
    scaled = whole[:, :-1] / _sizes(whole[:, :-1])
    # What is zero throughout, such as the acceleration of a ramp, is no regressor.
    scaled = scaled[:, scaled.any(axis=0)]
    return Fit(
        hypothesis=hypothesis,
        parameters=parameters,
        half=jackknife_half_width(left_out),
        position_gain=float(position_gain_of(parameters, hypothesis)),
        position_gain_half=float(jackknife_half_width(position_gain_of(left_out, hypothesis))),
        residual=_held_out_error(log, joint, hypothesis, _by_parameters),
        step=float(np.sqrt(np.nanmean(np.diff(log.command[:, joint]) ** 2))),
        information=samples * float(np.log(max(error, 1e-300) ** 2 / samples))
        + count * float(np.log(samples)),
        condition=float(np.linalg.cond(scaled)),
        samples=samples,
        bias=_bias(whole[:, :-1], parameters, hypothesis, samples, errors),
    )


def jackknife_half_width(left_out: Array) -> Array:
    """Half the 90 % interval by the jackknife, from values with one group left out each."""
    return np.asarray(NINETY * np.sqrt((len(left_out) - 1) * left_out.var(axis=0)))


def position_gain_of(parameters: Array, hypothesis: Hypothesis) -> Array:
    """Gain of the error over the published one; parameters are the last axis."""
    return _error_gain(parameters, hypothesis) / published_position_gain(hypothesis)


def published_position_gain(hypothesis: Hypothesis) -> float:
    """Gain of the error, over M_bar, of the published values: ``lam eta``, or ``K_p`` if linear."""
    return float(_error_gain(_published(hypothesis), hypothesis))


def _error_gain(parameters: Array, hypothesis: Hypothesis) -> Array:
    linear = hypothesis.surface == LINEAR
    return np.asarray(parameters[..., 4] if linear else parameters[..., 3] * parameters[..., 4])


def _remembered(parameters: Array, hypothesis: Hypothesis) -> Array:
    """Weights (2,) of the torques of one and two samples ago in the fitted equation."""
    weights = parameters[:2].copy()
    if hypothesis.readings["estimate_filter"] == "estimate":
        weights *= hypothesis.newest
        weights[0] += 1.0 - hypothesis.newest
    return weights


def _bias(
    factor: Array, parameters: Array, hypothesis: Hypothesis, samples: int, errors: tuple[float, float]
) -> float:
    """Largest shift of the two weights by errors of the regressors, to first order.

    Variances D of the columns of X move the parameters by ``-(J'X'X J)^-1 N J'D c`` with the slopes J of the
    coefficients c.
    """
    values, slopes = coefficients(parameters, hypothesis), coefficient_slopes(parameters, hypothesis)
    variance = np.zeros(values.size)
    variance[:2], variance[2:4] = errors
    moved = factor @ slopes
    scale = _sizes(moved)
    square = (moved / scale).T @ (moved / scale)
    shift = np.linalg.lstsq(square, slopes.T @ (samples * variance * values) / scale, rcond=1e-14)[0] / scale
    return float(np.abs(shift[:2]).max())


def _held_out_error(log: Log, joint: int, hypothesis: Hypothesis, solve: Solve) -> float:
    """RMS error in the odd blocks of a fit to the even ones, N m; infinite if too short."""
    regressed = regression(log, joint, hypothesis)
    odd = regressed.rows // BLOCK % 2 == 1
    if min(odd.sum(), (~odd).sum()) < BLOCK:
        return float("inf")
    of_even = solve(_factor(regressed.X[~odd], regressed.y[~odd]), hypothesis)
    return _residual(_factor(regressed.X[odd], regressed.y[odd]), of_even) / float(np.sqrt(odd.sum()))


def _by_parameters(factor: Array, hypothesis: Hypothesis) -> Array:
    """Coefficients of the parameters that fit best."""
    return coefficients(_solved(factor, hypothesis), hypothesis)


def _least_squares(factor: Array, _: Hypothesis) -> Array:
    """Coefficients that fit best, whatever the parameters."""
    scale = _sizes(factor[:, :-1])
    return np.asarray(np.linalg.lstsq(factor[:, :-1] / scale, factor[:, -1], rcond=1e-12)[0] / scale)


def _sizes(columns: Array) -> Array:
    """Norms of columns; 1 of one that is zero throughout."""
    sizes = np.linalg.norm(columns, axis=0)
    return np.asarray(np.where(sizes == 0.0, 1.0, sizes))


def _tuned(log: Log, joint: int, hypothesis: Hypothesis, place: int) -> Hypothesis:
    """Put a low-pass filter into one place, with the cutoff that predicts best."""

    def error(logit: float) -> float:
        # A slow filter leaves too few samples of a short log, which is worse than any fit.
        filtered = [*hypothesis.filtered(_newest(logit))][place]
        return min(_held_out_error(log, joint, filtered, _by_parameters), 1e9)

    # Weights of the newest value from 0.01 to 0.99, coarsely first: the error has more than one valley.
    grid = np.linspace(-4.6, 4.6, 9)
    k = int(np.argmin([error(x) for x in grid]))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, 8)]
    minimum = minimize_scalar(error, bounds=(low, high), method="bounded", options={"xatol": 1e-9})
    return [*hypothesis.filtered(_newest(minimum.x))][place]


def _newest(logit: float) -> float:
    return float(1.0 / (1.0 + np.exp(-logit)))


def _solved(factor: Array, hypothesis: Hypothesis, near: Array | None = None) -> Array:
    """Parameters that fit best, searched from `near`, else from several starts."""
    matrix, target, free = factor[:, :-1], factor[:, -1], _least_squares(factor, hypothesis)
    w_1, w_2, M_bar = (
        free[0],
        free[1],
        -(free[0] * free[2] + free[1] * free[3]) / (free[0] ** 2 + free[1] ** 2),
    )
    second = free[6] / M_bar
    if hypothesis.surface != LINEAR and hypothesis.readings["eta_in_controller_2"] == "dropped":
        second = free[7] / free[5]
    published = _published(hypothesis)
    extrapolating = np.array([1.15, -0.15, *published[2:]])
    starts = [np.array([w_1, w_2, M_bar, free[5] / M_bar, second]), published, extrapolating]
    starts = starts if near is None else [near]

    def misses(x: Array) -> Array:
        return target - matrix @ coefficients(x, hypothesis)

    def slopes(x: Array) -> Array:
        return -matrix @ coefficient_slopes(x, hypothesis)

    best, least = published, np.inf
    for start in (point for point in starts if np.isfinite(point).all()):
        scale = np.maximum(np.abs(start), 1e-3)
        # MINPACK without the layers of `least_squares`, which take three times as long as the work.
        solution, _, details, _, _ = leastsq(
            misses, start, Dfun=slopes, full_output=True, diag=1.0 / scale, xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
        left = float(np.linalg.norm(details["fvec"]))
        if left < least:
            best, least = np.asarray(solution), left
        # No parameters fit better than free coefficients do.
        if least <= np.sqrt(CLOSE_TO_FREE) * _residual(factor, free):
            break
    return best


def _published(hypothesis: Hypothesis) -> Array:
    return np.array([1.0, 0.0, 0.01, 10.0, 16.0]) if hypothesis.surface == LINEAR else START


def _residual(factor: Array, coefficients_of: Array) -> float:
    return float(np.linalg.norm(factor[:, -1] - factor[:, :-1] @ coefficients_of))


def _stacked(factors: Sequence[Array]) -> Array:
    """Triangular factor of samples that factors stand for."""
    return np.asarray(np.linalg.qr(np.vstack(factors), mode="r"))


def _factor(X: Array, y: Array) -> Array:
    return np.asarray(np.linalg.qr(np.column_stack([X, y]), mode="r"))


def _groups(block: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Rows by group; blocks are dealt out in turn."""
    order = np.unique(block, return_inverse=True)[1]
    groups = [np.flatnonzero(order % GROUPS == k) for k in range(GROUPS)]
    return [rows for rows in groups if rows.size]
