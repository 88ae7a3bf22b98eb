"""Fit of a hypothesis to a log: parameters with intervals, and errors on samples it was not fitted to.

Triangular factors of blocks of samples stand for the samples, and lose nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq, minimize_scalar
from scipy.special import expit, logit

from tendonrepro.arrays import Array
from tendonrepro.evidence.hypotheses import FILTERS, LINEAR, NTSM, PID, Hypothesis, hypotheses, regression
from tendonrepro.evidence.log import Log, liveliest

BLOCK = 200
"""Samples of a block. Odd blocks are predicted from even ones."""
GROUPS = 16
"""Stretches of a log that are left out in turn, for intervals: what is wrong for a while is in one."""
SCREENED = 3000
"""Samples on which every hypothesis is tried: those of the fastest motion."""
SAME = 1e-6
"""Share of the torque's step below which a residual is arithmetic."""
DECISIVE = 10.0
"""Difference of the information criterion that counts as very strong evidence (Kass and Raftery 1995)."""
KEPT = 10
"""Least errors whose hypotheses are then fitted to all samples."""
MOST_OF_ROUNDING = 2.0
"""Square of what is left over that of white rounding, up to which it may be of rounding that alternates."""
NINETY = 1.753
"""Quantile of Student's t for a central 90 % interval from `GROUPS` values."""
CLOSE_TO_FREE = 1.05
"""Squared error over that of free coefficients up to which a second start is not worth its time."""
CUTOFF_STEP = 1e-4
"""Half the difference of a filter's cutoff, as the logit of its newest weight, that gives slopes by it."""
CUTOFF_STEPS = 12
"""Steps of a cutoff, each the linear one, after which it stays where it is."""
Rows: TypeAlias = NDArray[np.int64]
"""Numbers of samples of a log."""

START = np.array([1.0, 0.0, 0.01, 8.0, 1.5])
"""The published values, from which a search begins where the linear solution is loose."""
EXTRAPOLATING = np.array([1.15, -0.15, *START[2:]])
"""The same with weights beyond one."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis with what a log says of it.

    Attributes
    ----------
    parameters, half : array (5,)
        ``w_1, w_2, M_bar, lam, eta``, or ``K_d, K_p`` at the end if linear; half their 90 % interval.
    error_gain, error_gain_half
        Gain of the error over M_bar, s⁻², near 0 without an integral; half its 90 % interval.
    residual
        RMS of the odd blocks beyond the fit to the even ones, N m.
    step
        RMS of the torque's step from sample to sample, N m.
    information
        Bayesian information criterion of the fit to all samples.
    condition
        Condition number of the scaled regressors.
    bias
        How far rounding of the record may have moved a weight: regressors are taken for exact. Intervals have
        it, too.
    """

    hypothesis: Hypothesis
    parameters: Array
    half: Array
    error_gain: float
    error_gain_half: float
    residual: float
    step: float
    information: float
    condition: float
    samples: int
    bias: float

    @property
    def off_published(self) -> float:
        """Distance of M_bar and feedback gains from the published ones, sum of logarithms."""
        ratio = self.parameters[2:] / _published(self.hypothesis)[2:]
        return float(np.abs(np.log(ratio)).sum()) if (ratio > 0.0).all() else float("inf")


def ranked(log: Log, joint: int) -> list[Fit]:
    """Fits that come closest to one joint, counted from 0, best first; none if all torques stand at limits.

    Hypotheses are compared on samples that all of them can foretell: on more samples the criterion is lower,
    whatever the hypothesis.
    """
    window, candidates = liveliest(log, SCREENED), list(hypotheses(log))
    # A terminal surface needs no sample that the linear one does not.
    rows = rows_of_all(
        window, joint, [hypothesis for hypothesis in candidates if hypothesis.surface == LINEAR]
    )
    errors = [_held_out_error(regression(window, joint, hypothesis)[rows], rows) for hypothesis in candidates]
    # With free coefficients some are the same equation, and count as one.
    sizes = np.round(np.log(np.maximum(errors, 1e-300)), 6)
    order = [k for k in np.argsort(errors, kind="stable") if np.isfinite(sizes[k])]
    if not order:
        return []
    best = [candidates[k] for k in order if sizes[k] <= np.unique(sizes)[:KEPT][-1]]
    printed = [Hypothesis(NTSM), Hypothesis(LINEAR)]
    tried = list(dict.fromkeys([*printed, PID, *best]))
    if log.ddq_d[:, joint].any():
        # Coefficients that were free did without the acceleration where it was absent.
        absent = ("reference_acceleration", "absent")
        tried += [hypothesis.beside(absent) for hypothesis in tried]
    fits = _fitted_alike(log, joint, tried)
    if all(fit.residual > SAME * fit.step for fit in fits):
        # Filters have a free cutoff, so they are tried on what is published, and on what comes close without.
        bases = list(dict.fromkeys([*printed, best[0]]))
        if with_filters := [filtered for base in bases for filtered in _filtered(window, joint, base)]:
            fits = _fitted_alike(log, joint, [*tried, *with_filters])
    # M_bar is positive, and no weight beyond those of any interpretation.
    possible = [fit for fit in fits if fit.parameters[2] > 0.0 and np.abs(fit.parameters[:2]).max() <= 2.0]
    fits = possible or fits
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


def rows_of_all(log: Log, joint: int, needing: Sequence[Hypothesis]) -> Rows:
    """Samples that every one of some hypotheses can foretell."""
    kept = np.ones(len(log.q), dtype=np.bool_)
    for hypothesis in needing:
        kept &= np.isfinite(regression(log, joint, hypothesis)).all(axis=1)
    return np.flatnonzero(kept)


def _fitted_alike(log: Log, joint: int, tried: Sequence[Hypothesis]) -> list[Fit]:
    """Fits of hypotheses to the samples that all of them can foretell."""
    rows = rows_of_all(log, joint, tried)
    refined = [
        _with_best_cutoff(log, joint, hypothesis, rows) if hypothesis.newest < 1.0 else hypothesis
        for hypothesis in tried
    ]
    # Where a cutoff fell, the filter has more to forget first.
    rows = np.intersect1d(rows, rows_of_all(log, joint, refined), assume_unique=True)
    return [fitted(log, joint, hypothesis, rows) for hypothesis in refined]


def equally_good(fits: Sequence[Fit]) -> list[Fit]:
    """Fits that a log does not tell from the best one."""
    best = min(fit.information for fit in fits)
    exact = [fit for fit in fits if fit.residual <= SAME * fit.step]
    return exact or [fit for fit in fits if fit.information <= best + DECISIVE]


def fitted(log: Log, joint: int, hypothesis: Hypothesis, rows: Rows) -> Fit:
    """Fit a hypothesis to samples of a joint; see :func:`ranked`."""
    columns = regression(log, joint, hypothesis)[rows]
    whole, parameters, information = _solution(columns, hypothesis)
    parts = _without_each(columns)
    near, nears = parameters, parts
    if hypothesis.newest < 1.0:
        # The cutoff was fitted, too: intervals count what it moves.
        near = np.append(parameters, 0.0)
        nears = _without_each(_with_cutoff_slope(log, joint, hypothesis, rows, parameters))
    left_out = np.stack([_solved(part, hypothesis, near) for part in nears])[:, : parameters.size]
    residual = _held_out_error(columns, rows, hypothesis)
    step = float(np.sqrt(np.nanmean(np.diff(log.command[:, joint]) ** 2)))
    scaled = whole[:, :-1] / _sizes(whole[:, :-1])
    # What is zero throughout, such as the acceleration of a ramp, is no regressor.
    scaled = scaled[:, scaled.any(axis=0)]
    rounding = float(log.torque_rounding[joint]), float(log.angle_rounding[joint])
    without, without_left_out = parameters, left_out
    if residual > SAME * step and any(rounding):
        errors = rows.size * _errors_of(columns, rows, parameters, hypothesis, rounding, log.L)
        without = _without_errors(whole, parameters, errors, hypothesis)
        share = 1.0 - 1.0 / GROUPS
        without_left_out = np.stack(
            [
                _without_errors(part, left, share * errors, hypothesis, without)
                for part, left in zip(parts, left_out, strict=True)
            ]
        )
    # Errors may sit in what the controller remembered, or not: intervals have both answers.
    half = _half_width(parameters, left_out, without, without_left_out)
    gain, *gains = (
        hypothesis.error_gain(values) for values in (parameters, left_out, without, without_left_out)
    )
    return Fit(
        hypothesis=hypothesis,
        parameters=parameters,
        half=half,
        error_gain=float(gain),
        error_gain_half=float(_half_width(gain, *gains)),
        residual=residual,
        step=step,
        information=information,
        condition=float(np.linalg.cond(scaled)),
        samples=rows.size,
        bias=float(np.abs(without - parameters)[:2].max()),
    )


def _half_width(values: Array, left_out: Array, without: Array, without_left_out: Array) -> Array:
    """Half the interval around values that has theirs, and that of other values."""
    other = np.abs(without - values) + _jackknife_half_width(without_left_out)
    return np.maximum(_jackknife_half_width(left_out), other)


def _without_each(columns: Array) -> list[Array]:
    """Triangular factors of samples, with one of `GROUPS` stretches left out each."""
    factors = [_factor(part) for part in np.array_split(columns, GROUPS)]
    return [_factor(np.vstack(factors[:k] + factors[k + 1 :])) for k in range(GROUPS)]


def _errors_of(
    columns: Array,
    rows: Rows,
    parameters: Array,
    hypothesis: Hypothesis,
    rounding: tuple[float, float],
    L: float,
) -> Array:
    """Mean products of the errors of rounding in the columns of regressors, and of the torque behind them.

    Of a step the variance is a twelfth of its square; an acceleration has six of the angle's, over L^4.
    """
    torque, angle = (step**2 / 12.0 for step in rounding)
    products = np.zeros([columns.shape[1]] * 2)
    products[[0, 1], [0, 1]], products[[2, 3], [2, 3]] = torque, 6.0 * angle / L**4
    if angle or not hypothesis.remembers_commands:
        return products
    # Where an encoder's step moves the torque by nearly whole or half steps, errors of rounding follow one
    # another. What is left, n_0 - w_1 n_1 - w_2 n_2, has their mean products at one and two delays.
    left, lag = columns[:, -1] - columns[:, :-1] @ hypothesis.coefficients(parameters), hypothesis.lag
    w_1, w_2 = parameters[:2]
    follow = np.isin(rows - lag, rows)
    before = np.searchsorted(rows, rows[follow] - lag)
    square, product = np.mean(left**2), np.mean(left[follow] * left[before])
    white = 1.0 + w_1**2 + w_2**2
    if square > MOST_OF_ROUNDING * white * torque:
        return products
    known = np.array([square - white * torque, product + (w_1 - w_1 * w_2) * torque])
    of_products = [[2.0 * w_1 * (w_2 - 1.0), -2.0 * w_2], [white - w_2, w_1 * (w_2 - 1.0)]]
    neighbours, next_ones = np.linalg.lstsq(np.array(of_products), known, rcond=None)[0]
    memory = [
        [torque, neighbours, neighbours],
        [neighbours, torque, next_ones],
        [neighbours, next_ones, torque],
    ]
    # What no errors can have is of something else.
    if np.linalg.eigvalsh(memory)[0] > 0.0:
        products[np.ix_([0, 1, -1], [0, 1, -1])] = memory
        products[-1, -1] = 0.0
    return products


def _solution(columns: Array, hypothesis: Hypothesis) -> tuple[Array, Array, float]:
    """Triangular factor of samples, parameters that fit them best, and the information criterion."""
    factor = _factor(columns)
    parameters = _solved(factor, hypothesis)
    # Errors of the record are in the torque and in both remembered ones: heavy weights make them larger.
    noise = float(np.sqrt(1.0 + np.sum(hypothesis.remembered(parameters) ** 2)))
    error = _residual(factor, hypothesis.coefficients(parameters)) / noise
    count = parameters.size + (hypothesis.newest < 1.0)
    samples = len(columns)
    of_error = samples * float(np.log(max(error, 1e-300) ** 2 / samples))
    return factor, parameters, of_error + count * float(np.log(samples))


def _with_best_cutoff(log: Log, joint: int, hypothesis: Hypothesis, rows: Rows) -> Hypothesis:
    """With the filter's cutoff that fits best together with the parameters."""
    for _ in range(CUTOFF_STEPS):
        parameters = _solved(_factor(_known(regression(log, joint, hypothesis)[rows])), hypothesis)
        factor = _factor(_with_cutoff_slope(log, joint, hypothesis, rows, parameters))
        step = float(np.clip(_solved(factor, hypothesis, np.append(parameters, 0.0))[-1], -0.5, 0.5))
        hypothesis = replace(hypothesis, newest=float(expit(logit(hypothesis.newest) + step)))
        if abs(step) < 1e-9:
            break
    return hypothesis


def _with_cutoff_slope(log: Log, joint: int, hypothesis: Hypothesis, rows: Rows, parameters: Array) -> Array:
    """Columns of a filtered hypothesis; before the last one the slope of what it foretells, by the cutoff.

    The cutoff counts as the logit of the filter's newest weight.
    """
    place, values = logit(hypothesis.newest), hypothesis.coefficients(parameters)
    ends = [
        regression(log, joint, replace(hypothesis, newest=expit(place + step)))[rows]
        for step in (-CUTOFF_STEP, CUTOFF_STEP)
    ]
    below, above = (end[:, :-1] @ values - end[:, -1] for end in ends)
    slope = (above - below) / (2.0 * CUTOFF_STEP)
    return _known(np.insert(regression(log, joint, hypothesis)[rows], -1, slope, axis=1))


def _jackknife_half_width(left_out: Array) -> Array:
    """Half the 90 % interval by the jackknife, from values with one group left out each."""
    if not np.isfinite(left_out).all():
        return np.full(left_out.shape[1:], np.inf)  # nothing is known, which is not a disagreement
    return np.asarray(NINETY * np.sqrt((len(left_out) - 1) * left_out.var(axis=0)))


def _without_errors(
    factor: Array, parameters: Array, errors: Array, hypothesis: Hypothesis, near: Array | None = None
) -> Array:
    """Parameters that fit best where `errors` are the products of errors in the columns.

    What `parameters` leave beyond these is taken for an error of the newest torque alone. The search begins
    `near` some, else from several starts.
    """

    def with_torque(x: Array) -> Array:
        return np.append(hypothesis.coefficients(x), -1.0)

    values, total = with_torque(parameters), errors.copy()
    total[-1, -1] = max(np.sum((factor @ values) ** 2) - values @ errors @ values, errors[0, 0])

    def misses(x: Array) -> Array:
        values = with_torque(x)
        return np.asarray(factor @ values / np.sqrt(values @ total @ values))

    def slopes(x: Array) -> Array:
        values = with_torque(x)
        by_parameter = np.vstack([hypothesis.coefficient_slopes(x), np.zeros(5)])
        size = values @ total @ values
        lighter = np.outer(misses(x), by_parameter.T @ total @ values) / size
        return np.asarray(factor @ by_parameter / np.sqrt(size) - lighter)

    starts = [near] if near is not None else [parameters, *_starts(factor, hypothesis)]
    # With the full output it gives no warning where arithmetic ends it.
    searched = [
        leastsq(misses, start, Dfun=slopes, full_output=True, diag=1.0 / np.maximum(np.abs(start), 1e-3))
        for start in starts
    ]
    return np.asarray(min(searched, key=lambda search: float(np.sum(search[2]["fvec"] ** 2)))[0])


def _held_out_error(columns: Array, rows: Rows, hypothesis: Hypothesis | None = None) -> float:
    """RMS error in the odd blocks of a fit to the even ones, N m; infinite if too short.

    Without a hypothesis coefficients are free.
    """
    odd = rows // BLOCK % 2 == 1
    if min(odd.sum(), (~odd).sum()) < BLOCK:
        return float("inf")
    even = _factor(columns[~odd])
    of_even = hypothesis.coefficients(_solved(even, hypothesis)) if hypothesis else _least_squares(even)
    return _residual(_factor(columns[odd]), of_even) / float(np.sqrt(odd.sum()))


def _least_squares(factor: Array) -> Array:
    """Coefficients that fit best, whatever the parameters."""
    scale = _sizes(factor[:, :-1])
    return np.asarray(np.linalg.lstsq(factor[:, :-1] / scale, factor[:, -1], rcond=1e-12)[0] / scale)


def _sizes(columns: Array) -> Array:
    """Norms of columns; 1 of one that is zero throughout."""
    sizes = np.linalg.norm(columns, axis=0)
    return np.asarray(np.where(sizes == 0.0, 1.0, sizes))


def _filtered(log: Log, joint: int, hypothesis: Hypothesis) -> Iterator[Hypothesis]:
    """With a low-pass filter in each place where one explains more than none does."""
    for place in FILTERS:
        # Weights of the newest value from 0.01 to 0.99, coarsely first: the error has more than one valley.
        grid = np.linspace(-4.6, 4.6, 9)
        rows = rows_of_all(log, joint, [hypothesis.beside(place, expit(grid[0]))])

        def error(x: float, place: tuple[str, str] = place, rows: Rows = rows) -> float:
            filtered = hypothesis.beside(place, expit(x))
            # A log may be too short, which is worse than any fit. Free coefficients let filters fit noise.
            columns = regression(log, joint, filtered)[rows]
            return min(_held_out_error(columns, rows, filtered), 1e9)

        k = int(np.argmin([error(x) for x in grid]))
        low, high = grid[max(k - 1, 0)], grid[min(k + 1, 8)]
        minimum = minimize_scalar(error, bounds=(low, high), method="bounded", options={"xatol": 1e-3})
        filtered = hypothesis.beside(place, float(expit(minimum.x)))
        rows = rows_of_all(log, joint, [hypothesis, filtered])
        if rows.size < 2 * BLOCK:
            continue
        # Samples that a slow filter cannot foretell are lost to all: it has to explain more than none does.
        without, with_filter = (
            _solution(regression(log, joint, tried)[rows], tried)[2] for tried in (hypothesis, filtered)
        )
        if with_filter < without - DECISIVE:
            yield filtered


def _solved(factor: Array, hypothesis: Hypothesis, near: Array | None = None) -> Array:
    """Parameters that fit best, searched from `near`, else from several starts.

    `near` has one more where a last column of the factor, beside the regressors, may be added in any size.
    """
    matrix, target = factor[:, :-1], factor[:, -1]
    starts = [near] if near is not None else _starts(factor, hypothesis)
    enough = np.sqrt(CLOSE_TO_FREE) * _residual(factor, _least_squares(factor))

    def misses(x: Array) -> Array:
        return target - matrix @ np.append(hypothesis.coefficients(x[:5]), x[5:])

    def slopes(x: Array) -> Array:
        by_parameter = hypothesis.coefficient_slopes(x[:5])
        own = len(by_parameter)
        return -np.column_stack([matrix[:, :own] @ by_parameter, matrix[:, own:]])

    best, least = starts[-1], np.inf
    for start in starts:
        scale = np.maximum(np.abs(start), 1e-3)
        # MINPACK without the layers of `least_squares`, which take three times as long as the work.
        solution, _, details, _, _ = leastsq(
            misses, start, Dfun=slopes, full_output=True, diag=1.0 / scale, xtol=1e-10, ftol=1e-10, gtol=1e-10
        )
        left = float(np.linalg.norm(details["fvec"]))
        if left < least:
            best, least = np.asarray(solution), left
        # No parameters fit better than free coefficients do.
        if least <= enough:
            break
    return best


def _starts(factor: Array, hypothesis: Hypothesis) -> list[Array]:
    """Parameters (5,) of free coefficients, where these are of any, and published ones."""
    w_1, w_2, *others = free = _least_squares(factor)
    published = _published(hypothesis)
    dropped = hypothesis.surface != LINEAR and hypothesis.readings["eta_in_controller_2"] == "dropped"
    with np.errstate(all="ignore"):  # without torques or accelerations there are none
        M_bar = -(w_1 * others[0] + w_2 * others[1]) / (w_1**2 + w_2**2)
        second = free[7] / free[5] if dropped else free[6] / M_bar
        starts = np.array([[w_1, w_2, M_bar, free[5] / M_bar, second], published, EXTRAPOLATING])
    starts[2, 2:] = published[2:]
    return [start for start in starts if np.isfinite(start).all()]


def _published(hypothesis: Hypothesis) -> Array:
    return np.array([1.0, 0.0, 0.01, 10.0, 16.0]) if hypothesis.surface == LINEAR else START


def _residual(factor: Array, coefficients_of: Array) -> float:
    return float(np.linalg.norm(factor[:, -1] - factor[:, :-1] @ coefficients_of))


def _known(columns: Array) -> Array:
    return columns[np.isfinite(columns).all(axis=1)]


def _factor(columns: Array) -> Array:
    return np.asarray(np.linalg.qr(columns, mode="r"))
