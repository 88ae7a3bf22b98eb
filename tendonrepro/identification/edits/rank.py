"""How likely an edit gives the errors of a table, compared with no edit, and how good that is.

All that decides it was fixed before any planted table was looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from tendonrepro.arrays import Array
from tendonrepro.identification.goal import Goal
from tendonrepro.monte_carlo.shares import rate_of
from tendonrepro.results.run_noise import NOISE, noise_covariance, with_noise

FEWEST = 20
"""Stable plants without which an edit is not ranked."""

FALSE_ALARM = 0.05
"""Most clean tables of which an edit may be named.

Of a table without an edit a likelihood ratio is above c with a probability of 1/c at most. So of N edits any
is above N / 0.05 with 5 % at most, and that is the factor from which one is named.
"""

HEAVY = 4.0
"""Degrees of freedom of the kernels, Student's: a table beside all plants is unlikely, not impossible."""

ENDS = 0.05, 0.95
"""Quantiles beyond which plants do not widen the kernels."""

ALIKE, ALIKE_STABLE = 2.0, 0.9
"""Two edits are alike in effect where half of the plants differ by no more than two runs of one law would,
and at least so many of the plants on which either is stable are stable under both."""

FIRST = 3
"""Place up to which a planted edit counts as found."""


@dataclass(frozen=True)
class Outcomes:
    """What E edits, the first of which is none, did on N plants.

    `sizes` (E, N, R, 2, n) are errors, deg; `steps` (E, N, R) change of torque in a sample, RMS over joints,
    N m; `stable` (E, N) whether all runs are. With `absolute` sizes count, else their ratios alone.
    """

    sizes: Array
    steps: Array
    stable: NDArray[np.bool_]
    goal: Goal
    absolute: bool

    @cached_property
    def features(self) -> Array:
        """Logs of the errors that a table has, (E, N, d)."""
        sizes = np.where(self.stable[..., np.newaxis], self.sizes[..., self.goal.fitted], 1.0)
        return np.asarray(np.log(sizes) @ self.contrasts.T)

    @cached_property
    def contrasts(self) -> Array:
        """From logs of errors to what counts, (d, numbers): all their ratios, or the errors themselves."""
        unit = np.eye(self.goal.numbers)
        if self.absolute:
            return unit
        # Orthonormal differences to the mean: a factor on all errors changes none.
        values, vectors = np.linalg.eigh(unit - unit.mean())
        return np.asarray(vectors[:, values > 0.5].T)

    @cached_property
    def ranked(self) -> NDArray[np.bool_]:
        """Edits with enough stable plants, (E,)."""
        return np.asarray(self.stable.sum(axis=1) >= FEWEST)

    @property
    def factor(self) -> float:
        """Likelihood ratio from which an edit is named."""
        return max(int(self.ranked[1:].sum()), 1) / FALSE_ALARM

    def noise(self, goal: Goal) -> Array:
        """Covariance (d, d) of what counts: of runs that repeat, and of rounding."""
        rounding = np.nan_to_num(goal.half[goal.fitted]) / np.sqrt(3.0) / goal.values[goal.fitted]
        of_table = noise_covariance(goal.fitted) + np.diag(rounding**2)
        return np.asarray(self.contrasts @ of_table @ self.contrasts.T)

    @cached_property
    def spreads(self) -> Array:
        """Covariance (E, d, d) of the kernels, by Silverman's rule, of the plants that are not far out."""
        d = len(self.contrasts)
        spreads = np.zeros((len(self.stable), d, d))
        for k in np.flatnonzero(self.ranked):
            plants = self.features[k][self.stable[k]]
            within = np.clip(plants, *np.quantile(plants, ENDS, axis=0))
            width = (4.0 / ((d + 2.0) * len(plants))) ** (2.0 / (d + 4.0))
            spreads[k] = width * np.atleast_2d(np.cov(within.T))
        return spreads

    def of(self, goal: Goal, without: int | None = None) -> Array:
        """Log likelihood of a table under each edit, (E,), -inf where it is not ranked.

        It is the mean over all plants, zero on those without stable runs, of a Student kernel around each. A
        plant `without` which it shall be counts for no edit.
        """
        errors, d = self.contrasts @ np.log(goal.values[goal.fitted]), len(self.contrasts)
        kept = self.stable & self.ranked[:, np.newaxis]
        if without is not None:
            kept[:, without] = False
        width = self.spreads + self.noise(goal)
        apart = np.where(kept[..., np.newaxis], self.features - errors, 0.0)
        size = np.einsum("knd,kde,kne->kn", apart, np.linalg.inv(width), apart, optimize=True)
        constant = gammaln(0.5 * (HEAVY + d)) - gammaln(0.5 * HEAVY) - 0.5 * d * np.log(HEAVY * np.pi)
        scale = 0.5 * np.linalg.slogdet(width)[1][:, np.newaxis]
        logs = np.where(kept, constant - scale - 0.5 * (HEAVY + d) * np.log1p(size / HEAVY), -np.inf)
        plants = kept.shape[1] - (without is not None)
        return np.asarray(np.logaddexp.reduce(logs, axis=1) - np.log(plants))

    @cached_property
    def classes(self) -> NDArray[np.int64]:
        """Class of each edit, (E,), by its first member; those alike in effect share one."""
        inverse: Array = np.asarray(np.linalg.inv(self.noise(self.goal)), dtype=np.float64)
        first = np.arange(len(self.stable))
        for k in range(1, len(first)):
            for other in np.flatnonzero(first[:k] == np.arange(k)):
                if self._alike(k, int(other), inverse):
                    first[k] = other
                    break
        return first

    def _alike(self, k: int, other: int, inverse: Array) -> bool:
        both, either = self.stable[k] & self.stable[other], self.stable[k] | self.stable[other]
        if not both.any() or both.sum() < ALIKE_STABLE * either.sum():
            return False
        apart = self.features[k][both] - self.features[other][both]
        size = np.einsum("nd,de,ne->n", apart, inverse, apart) / apart.shape[1]
        return bool(np.median(size) <= ALIKE)


class Ranking(NamedTuple):
    """Edits of a table, most likely first: their numbers from 1, and log likelihoods over that of no edit.

    `named` are the numbers of those that beat no edit by the factor.
    """

    order: list[int]
    ratios: Array
    named: list[int]


def ranking(of: Outcomes, goal: Goal, without: int | None = None) -> Ranking:
    """Rank edits by how likely they give the errors of a table."""
    logs = of.of(goal, without)
    with np.errstate(invalid="ignore"):
        ratios = logs - logs[0]
    order = [int(k) for k in np.argsort(-logs, kind="stable") if k and of.ranked[k]]
    return Ranking(order, ratios, [k for k in order if ratios[k] > np.log(of.factor)])


def planted(of: Outcomes, papers: int, seed: int) -> dict[str, object]:
    """How often the edit of a made table is found, and how often one is named where there is none.

    A table is that of a plant, with noise and rounded as the given one; the plant is left out of all that it
    is compared with. Edits are drawn from those that can be ranked and that are not alike to none.
    """
    generator = np.random.default_rng([seed, 56])
    can = [k for k in np.flatnonzero(of.ranked) if of.ranked[0] and of.classes[k] != 0]
    drawn = [int(k) for k in generator.choice(can, papers)] if can else []
    ranks = [_planted(of, k, generator) for k in drawn]
    clean = [_planted(of, 0, generator) for _ in range(papers if of.ranked[0] else 0)]
    places = [_place(rank, k, of.classes) for k, rank in zip(drawn, ranks, strict=True)]
    hits = {
        "in_first_three": [place < FIRST for place in places],
        "named": [k in rank.named for k, rank in zip(drawn, ranks, strict=True)],
        "clean_named": [bool(rank.named) for rank in clean],
    }
    rates = {name: rate_of(sum(each), len(each)).as_row() for name, each in hits.items()}
    tables = [{"edit": k, "place": place + 1} for k, place in zip(drawn, places, strict=True)]
    return {"papers": papers, "factor": of.factor, **rates, "tables": tables}


def _place(rank: Ranking, edit: int, classes: NDArray[np.int64]) -> int:
    """Place of an edit's class among classes, from 0."""
    seen: dict[int, None] = dict.fromkeys(int(classes[k]) for k in rank.order)
    return [*seen].index(int(classes[edit]))


def _planted(of: Outcomes, edit: int, generator: np.random.Generator) -> Ranking:
    """Ranking of a table that a plant under an edit makes."""
    plant = int(generator.choice(np.flatnonzero(of.stable[edit])))
    sizes = with_noise(of.sizes[edit, [plant]], NOISE, generator)[0]
    step = 2.0 * np.where(np.isfinite(of.goal.half), of.goal.half, np.nan)
    rounded = np.where(np.isfinite(step), np.maximum(np.round(sizes / step), 1.0) * step, sizes)
    return ranking(of, replace(of.goal, values=rounded), plant)


def equal_order(sizes: Array, goal: Goal) -> NDArray[np.bool_]:
    """Whether runs rank as in a table, (N, 2, n), from errors (N, R, 2, n)."""

    def ranks(values: Array) -> NDArray[np.int64]:
        return np.argsort(np.argsort(values, axis=-3, kind="stable"), axis=-3)

    kept = np.where(goal.fitted, sizes, np.inf)
    return np.asarray((ranks(kept) == ranks(np.where(goal.fitted, goal.values, np.inf))).all(axis=-3))
