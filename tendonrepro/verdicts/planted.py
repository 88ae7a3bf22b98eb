"""How often a right paper would be contradicted: made-up papers go through the rules that judge the paper.

A made-up paper has the errors of one plant under one reading, with the noise of a run, rounded to the printed
digits. It is judged as the paper is, by the plants under the reading ``printed``, its own plant left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS, Published
from tendonrepro.monte_carlo.shares import LEAST_PLANTS, Share, rate_of
from tendonrepro.results.summary import CONTROLLERS, NOISE, with_noise
from tendonrepro.verdicts.from_ensemble import judge_plants
from tendonrepro.verdicts.from_print import PERCENTAGES, error_of, formula_of
from tendonrepro.verdicts.rules import Ruling, not_testable
from tendonrepro.verdicts.statements import OK, ORDERED, UNRESOLVED, Plants, PlantTable, printed_order

RULES = ("ratio", "increase", "order", "rising_shape", "joints_alike", "payload")
"""Rules that can contradict a print and ask for nothing but the errors of Tables 2 and 3."""

PAPERS = 256
"""Made-up papers of one reading: the first plants on which every run is ``ok``."""

MOST_PLANTS = 512
"""Plants of an interpretation other than ``printed`` whose errors are stored."""


@dataclass(frozen=True, eq=False)
class StableErrors:
    """The errors of Tables 2 and 3 on plants with stable controllers, as a `PlantTable` of ``printed``.

    `plants` (M,) are their numbers among the `draws`, by reading. `errors` (M, runs, metrics, n) are in rad,
    NaN where a run is not ``ok``. `left_out` is the number of a plant that does not count.
    """

    joints: tuple[int, ...]
    draws: int
    plants: Mapping[str, NDArray[np.int64]]
    errors: Mapping[str, Array]
    left_out: int = -1

    @property
    def replicate(self) -> NDArray[np.int64]:
        """One scrambling, so that shares get no interval."""
        return np.zeros(len(self.plants[PRINTED]), np.int64)

    def has(self, run: str, reading: str) -> bool:
        """Whether there is such a run."""
        return run in RUNS and reading == PRINTED

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Status codes, (M,): ``ok``, or another one."""
        counts = np.isfinite(self.statistic(run, reading, "mae")[:, 0])
        counts &= self.plants[reading] != self.left_out
        return np.where(counts, OK, UNRESOLVED).astype(np.int8)

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """MAE or RMSE, rad, (M, n)."""
        return self.errors[reading][:, RUNS.index(run), METRICS.index(name)]

    def whole(self, reading: str, most: int) -> tuple[NDArray[np.int64], Array]:
        """Numbers and errors of the first plants of a reading on which every run is ``ok``."""
        kept = np.flatnonzero(np.isfinite(self.errors[reading]).all(axis=(1, 2, 3)))[:most]
        return self.plants[reading][kept], self.errors[reading][kept]


def stable_errors(table: PlantTable, readings: Sequence[str], most: int | None = None) -> StableErrors:
    """Errors of all plants as published, and of the first `most` under each other reading, or of all."""
    plants, errors = {}, {}
    for reading in readings:
        codes = np.array([table.status(run, reading) for run in RUNS])
        needed = codes[: len(CONTROLLERS)] if reading == PRINTED else codes
        kept = np.flatnonzero((needed == OK).all(axis=0))
        plants[reading] = kept if reading == PRINTED else kept[:most]
        sizes = [[table.statistic(run, reading, metric) for metric in METRICS] for run in RUNS]
        of_all = np.moveaxis(np.array(sizes), 2, 0)
        of_all[(codes != OK).T] = np.nan
        errors[reading] = of_all[plants[reading]]
    return StableErrors(table.joints, len(table.replicate), plants, errors)


def verdicts_on_papers(
    table: StableErrors,
    paper: Published,
    names: Sequence[str],
    *,
    reading: str = PRINTED,
    noise: float = NOISE,
    papers: int = PAPERS,
) -> Iterator[dict[str, Ruling]]:
    """Yield the rulings on each made-up paper of a reading, by the ids in `names` whose rule is in `RULES`.

    A claim that a paper does not make, such as one order in all columns, is ``not_testable``.
    """
    asked = [name for name in names if paper.judgements[name].rule in RULES]
    plants, errors = table.whole(reading, papers)
    measured = with_noise(errors, noise, np.random.default_rng([ord(letter) for letter in reading]))
    for plant, sizes in zip(plants, np.rad2deg(measured), strict=True):
        printed = print_of(paper, table.joints, sizes)
        others = Plants(replace(table, left_out=int(plant)), PRINTED)
        yield {name: _ruling(others, printed, name) for name in asked}


def _ruling(others: Plants, printed: Published | None, name: str) -> Ruling:
    if printed is None:
        return not_testable("digits that are not zero")
    statistics = ORDERED.get(printed.judgements[name].rule)
    if statistics and not printed_order(printed, others.joints, statistics):
        return not_testable("one order of the controllers in all columns")
    return judge_plants(others, printed, name)


def print_of(paper: Published, joints: Sequence[int], errors: Array) -> Published | None:
    """The print of someone who measured errors (runs, metrics, n), deg; None where one is printed as zero."""
    sizes = {}
    for name in paper.entries:
        if name.startswith(("table2.", "table3.")):
            error = error_of(name)
            place = RUNS.index(error.run), METRICS.index(error.metric), list(joints).index(error.joint)
            sizes[name] = errors[place]
    printed = paper.with_numbers(sizes)
    if not all(map(printed.number, sizes)):
        return None
    formulas = {name: formula_of(paper, name) for name in paper.entries if name.startswith(PERCENTAGES)}
    return printed.with_numbers(
        {name: formula.value(*map(printed.number, formula.names)) for name, formula in formulas.items()}
    )


def false_contradicted(table: PlantTable, paper: Published, names: Sequence[str]) -> dict[str, Share]:
    """How often each verdict contradicts a right paper as published, by id; nothing with too few plants."""
    errors = stable_errors(table, [PRINTED])
    if len(errors.plants[PRINTED]) <= LEAST_PLANTS:
        return {}
    papers = list(verdicts_on_papers(errors, paper, names))
    return {
        name: rate_of(sum(rulings[name].verdict == "contradicted" for rulings in papers), len(papers))
        for name in (papers[0] if papers else ())
    }
