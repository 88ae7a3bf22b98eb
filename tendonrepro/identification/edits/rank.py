"""How likely an edit gives the errors of a table, compared with no edit, and how good that is; its views.

All that decides it was fixed before any planted table was looked at.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import run_in_words
from tendonrepro.configuration.published import METRICS
from tendonrepro.files import Json
from tendonrepro.identification.bench import Goal
from tendonrepro.identification.edits.rules import Variant, Variants
from tendonrepro.monte_carlo.shares import rate_of
from tendonrepro.results.summary import NOISE, noise_covariance, with_noise
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result

SCHEMA_VERSION = 2

APART = "starts=apart"
"""Reading with starts up to 2° beside the reference, under which edits run, too."""

NONE = "no edit"
"""Name of the row without an edit."""

PAPERS = 100
"""Tables with a planted edit, and as many without."""

ROUGHER = 1.1
"""Torque steps over those without an edit above which an edit spoils the smooth torque."""

SHOWN = 12
"""Edits in a table for readers."""

_OF_EDIT = ("edit", "runs", "also")
_SHOWN = ("rank", "edit", "stable_share", "order_share", "log10_likelihood_ratio", "named")
_OF_RATIO = ("run", "joint", "over_run", "over_joint")

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


def planted(of: Outcomes, papers: int, seed: int) -> Json:
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


def edits_result(variants: Variants, outcomes: Mapping[str, Outcomes], seed: int) -> Result:
    """Numbers, the table and the picture, from outcomes by reading; the first is the one that ranks."""
    from tendonrepro.identification.figures import draw_edits, drawn_pairs

    rows_of = {name: edit_rows(variants.edits, of) for name, of in outcomes.items()}
    of, rows = next(iter(outcomes.values())), next(iter(rows_of.values()))
    for row, apart in zip(rows, rows_of[APART], strict=True) if APART in outcomes else ():
        row["apart"] = {key: value for key, value in apart.items() if key not in _OF_EDIT}
    ratios, plants = ratios_of(of.goal), of.stable.shape[1]
    data: Json = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "edits",
        "plants": plants,
        "runs": list(of.goal.runs),
        "joints": list(of.goal.joints),
        "made": variants.made,
        "unchanged": list(variants.unchanged),
        "no_number": list(variants.no_number),
        "ratios": ratios,
        "factor": of.factor,
        "noise": NOISE,
        "sentences": {name: sentence(own) for name, own in rows_of.items()},
        "planted": planted(of, PAPERS, seed),
        "edits": rows,
    }
    if APART in outcomes:
        data["planted_apart"] = planted(outcomes[APART], PAPERS, seed)
    every = [*_table(rows, ratios)]
    caption = f"Edits of one place each on {plants} plants, most likely first."
    printed = Table("edits", caption, every[: 1 + SHOWN])
    table = Table("edits", caption, every, terminal=_SHOWN, printed=printed)
    is_drawn = drawn_pairs(ratios) and any(row["ranked"] for row in rows[1:])
    drawings = {"edits": partial(draw_edits, rows, ratios, plants)} if is_drawn else {}
    return Result(data, [*_sentences(data), table], drawings)


def edit_rows(edits: Sequence[Variant], of: Outcomes) -> list[Json]:
    """A row for no edit, and one for each."""
    rank, ratios, every = ranking(of, of.goal), ratios_of(of.goal), [Variant(NONE, {}), *edits]
    rows: list[Json] = []
    for k, edit in enumerate(every):
        ranked = bool(of.ranked[k])
        row = {
            "edit": edit.name,
            "runs": list(edit.laws),
            "also": list(edit.others),
            **_outcome(of, k, ratios),
            "like": every[of.classes[k]].name if of.classes[k] != k else None,
            "ranked": ranked,
            "log10_likelihood_ratio": float(rank.ratios[k] / np.log(10.0)) if ranked else None,
            "rank": rank.order.index(k) + 1 if k in rank.order else None,
            "named": k in rank.named,
        }
        rows.append(row)
        row["spoils"] = [*_spoiled(row, rows[0], ratios)]
    return rows


def _outcome(of: Outcomes, k: int, ratios: Sequence[Json]) -> Json:
    """What an edit did on its stable plants.

    Shares on which runs rank as in the table, by metric, too; of each ratio the median and the central 90 %;
    change of torque over that without an edit, where both are stable; how often the first run's torque is the
    smoothest.
    """
    stable, both = of.stable[k], of.stable[k] & of.stable[0]
    sizes, steps = of.sizes[k][stable], of.steps[k][stable]
    over = (of.steps[k][both] / of.steps[0][both]).max(axis=1)
    row: Json = {
        "stable": len(sizes),
        "stable_share": float(stable.mean()),
        "order_share": None,
        "order": None,
        "ratios": [None] * len(ratios),
        "torque_steps_over_none": float(np.median(over)) if len(over) else None,
        "first_smoothest_share": None,
    }
    if not len(sizes):
        return row
    quantiles = [np.quantile(ratio_of(sizes, ratio, of.goal), [0.05, 0.5, 0.95]) for ratio in ratios]
    row["ratios"] = [dict(zip(("low", "median", "high"), each.tolist(), strict=True)) for each in quantiles]
    if len(of.goal.runs) > 1:
        kept = of.goal.same_order(sizes)
        row["order"] = dict(zip(METRICS, kept.mean(axis=0).tolist(), strict=True))
        row["order_share"] = float(kept.all(axis=(1, 2)).mean())
        row["first_smoothest_share"] = float((steps[:, 0] <= steps.min(axis=1)).mean())
    return row


def ratios_of(goal: Goal) -> list[Json]:
    """Ratios of MAE that rows give, with that of the table.

    They are of a run and the next by joint, and of the outer joints of the first.
    """
    runs, joints = goal.runs, goal.joints
    pairs = [(run, joint, over, joint) for run, over in pairwise(runs) for joint in joints]
    if len(joints) > 1:
        pairs.append((runs[0], joints[-1], runs[0], joints[0]))
    ratios: list[Json] = [dict(zip(_OF_RATIO, pair, strict=True)) for pair in pairs]
    for ratio in ratios:
        given = float(ratio_of(goal.values, ratio, goal))
        ratio["given"] = given if np.isfinite(given) else None
    return ratios


def ratio_of(sizes: Array, ratio: Json, goal: Goal) -> Array:
    """A ratio (...) of errors (..., R, 2, n)."""
    one, other = (
        sizes[..., goal.runs.index(ratio[run]), 0, goal.joints.index(ratio[joint])]
        for run, joint in (("run", "joint"), ("over_run", "over_joint"))
    )
    return np.asarray(one / other)


def _spoiled(row: Json, none: Json, ratios: Sequence[Json]) -> Iterator[str]:
    """What of the paper an edit does not give, beside the order."""
    smoothest = row["first_smoothest_share"]
    if row["stable"] < 0.5 * none["stable"]:
        yield "stability"
    if smoothest is not None and smoothest < 0.5 <= (none["first_smoothest_share"] or 0.0):
        yield "the smooth torque of " + run_in_words(ratios[0]["run"])
    if (steps := row["torque_steps_over_none"] or 0.0) > ROUGHER:
        yield f"torque steps, {steps:.2g} times as large"
    for ratio, ours in zip(ratios, row["ratios"], strict=True):
        if ours and ratio["given"] and not ours["low"] <= ratio["given"] <= ours["high"]:
            yield f"the ratio {ratio_name(ratio)}"


def ratio_name(ratio: Json) -> str:
    """Words of a ratio."""
    if ratio["run"] == ratio["over_run"]:
        return f"joint {ratio['joint']} over {ratio['over_joint']}"
    return f"{run_in_words(ratio['run'])} over {run_in_words(ratio['over_run'])} on joint {ratio['joint']}"


def sentence(rows: Sequence[Json]) -> str:
    """What all edits give, in a sentence."""
    edits = [row for row in rows[1:] if row["order_share"] is not None]
    if not edits:
        return f"Of {len(rows) - 1} single edits none is compared by an order: there is one run."
    most = [row for row in edits if row["stable"] >= FEWEST and row["order_share"] > 0.5]
    each = [
        f"{row['edit']} ({row['order_share']:.0%} of {row['stable']})"
        + (f", which spoils {'; '.join(row['spoils'])}" if row["spoils"] else "")
        for row in sorted(most, key=lambda row: -float(row["order_share"]))
    ]
    begin = f"Of {len(rows) - 1} single edits {len(most)} give the order of the table"
    return f"{begin} on more than half of the stable plants{': ' if each else ''}{'. '.join(each)}."


def _table(rows: Sequence[Json], ratios: Sequence[Json]) -> Iterator[Json]:
    """Rows of the table, no edit first, then by likelihood."""
    for row in (rows[0], *sorted(rows[1:], key=lambda row: row["rank"] or len(rows))):
        medians = {
            ratio_name(ratio).lower().replace(" ", "_"): ours and ours["median"]
            for ratio, ours in zip(ratios, row["ratios"], strict=True)
        }
        first, last = ("rank", "edit", "stable_share", "order_share"), (*_SHOWN[4:], "like")
        shown = {name: row[name] for name in first} | medians
        yield shown | {name: row[name] for name in ("torque_steps_over_none", *last)}


def _sentences(data: Json) -> Iterator[str]:
    for name, words in data["sentences"].items():
        yield f"{'With starts apart' if name == APART else 'As published'}: {words}"
    named = [row["edit"] for row in data["edits"] if row["named"]]
    yield f"Named, since {data['factor']:,.0f} times as likely as no edit: {', '.join(named) or 'none'}."
    few = sum(not row["ranked"] for row in data["edits"])
    if few:
        yield f"{few} edits are stable on fewer than {FEWEST} plants, and are not ranked."
    if data["no_number"]:
        yield f"No number anywhere, and not ranked: {'; '.join(data['no_number'])}."
