"""From what all edits gave to rows, the sentence that matters, the table and the picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.configuration.published import METRICS
from tendonrepro.configuration.shown import run_in_words
from tendonrepro.identification.edits.rank import FEWEST, Outcomes, equal_order, planted, ranking
from tendonrepro.identification.edits.variants import Variant, Variants
from tendonrepro.identification.goal import Goal
from tendonrepro.results.run_noise import NOISE
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
"""Edits in the terminal, and in a table for readers."""

_OF_EDIT = ("edit", "runs", "also")
_SHOWN = "rank", "edit", "stable_share", "order_share", "log10_likelihood_ratio", "named"

EditRow: TypeAlias = dict[str, Any]
"""An edit, or a ratio, as it is stored."""


def edits_result(variants: Variants, outcomes: Mapping[str, Outcomes], seed: int) -> Result:
    """Numbers, the table and the picture, from outcomes by reading; the first is the one that ranks."""
    from tendonrepro.identification.edits import figure

    rows_of = {name: edit_rows(variants.edits, of) for name, of in outcomes.items()}
    of, rows = next(iter(outcomes.values())), next(iter(rows_of.values()))
    for row, apart in zip(rows, rows_of[APART], strict=True) if APART in outcomes else ():
        row["apart"] = {key: value for key, value in apart.items() if key not in _OF_EDIT}
    ratios, plants = ratios_of(of.goal), of.stable.shape[1]
    data: EditRow = {
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
    is_drawn = figure.pairs_of(ratios) and any(row["ranked"] for row in rows[1:])
    drawings = {"edits": partial(figure.draw_edits, rows, ratios, plants)} if is_drawn else {}
    return Result(data, [*_sentences(data), table], drawings)


def edit_rows(edits: Sequence[Variant], of: Outcomes) -> list[EditRow]:
    """A row for no edit, and one for each."""
    rank, ratios, rows = ranking(of, of.goal), ratios_of(of.goal), list[EditRow]()
    names = [NONE, *(edit.name for edit in edits)]
    for k, edit in enumerate((Variant(NONE, {}), *edits)):
        ranked = bool(of.ranked[k])
        row = {
            "edit": edit.name,
            "runs": list(edit.laws),
            "also": list(edit.others),
            **_outcome(of, k),
            "like": names[of.classes[k]] if of.classes[k] != k else None,
            "ranked": ranked,
            "log10_likelihood_ratio": float(rank.ratios[k] / np.log(10.0)) if ranked else None,
            "rank": rank.order.index(k) + 1 if k in rank.order else None,
            "named": k in rank.named,
        }
        rows.append(row | {"spoils": [*_spoiled(row, rows[0] if k else row, ratios)]})
    return rows


def _outcome(of: Outcomes, k: int) -> EditRow:
    """What an edit did on its stable plants.

    Shares on which runs rank as in the table, by metric, too; of each ratio the median and the central 90 %;
    change of torque over that without an edit; how often the first run's torque is the smoothest.
    """
    stable, goal = of.stable[k], of.goal
    sizes, steps, both = of.sizes[k][stable], of.steps[k][stable], stable & of.stable[0]
    over = (of.steps[k][both] / of.steps[0][both]).max(axis=1)
    quantiles: list[EditRow | None] = [None for _ in pairs_of(goal)]
    order = order_share = smoothest = None
    if len(sizes):
        quantiles = [
            dict(zip(("low", "median", "high"), np.quantile(a / b, [0.05, 0.5, 0.95]).tolist(), strict=True))
            for pair in pairs_of(goal)
            for a, b in [(sizes[:, run, 0, joint] for run, joint in pair)]
        ]
        if len(goal.runs) > 1:
            kept = equal_order(sizes, goal)
            order = dict(zip(METRICS, kept.mean(axis=0).tolist(), strict=True))
            order_share = float(kept.all(axis=(1, 2)).mean())
            smoothest = float((steps[:, 0] <= steps.min(axis=1)).mean())
    return {
        "stable": len(sizes),
        "stable_share": float(stable.mean()),
        "order_share": order_share,
        "order": order,
        "ratios": quantiles,
        "torque_steps_over_none": float(np.median(over)) if len(over) else None,
        "first_smoothest_share": smoothest,
    }


def pairs_of(goal: Goal) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Errors whose ratios rows give: of a run and the next by joint, and of the outer joints of the first."""
    runs, last = len(goal.runs), len(goal.joints) - 1
    pairs = [((r, i), (r + 1, i)) for r in range(runs - 1) for i in range(last + 1)]
    return pairs + [((0, last), (0, 0))] * (last > 0)


def ratios_of(goal: Goal) -> list[EditRow]:
    """Ratios of MAE that rows give, and what they are in the table."""
    ratios: list[EditRow] = []
    for (run, joint), (over, beside) in pairs_of(goal):
        given = float(goal.values[run, 0, joint] / goal.values[over, 0, beside])
        own = {"run": goal.runs[run], "joint": goal.joints[joint]}
        other = {"over_run": goal.runs[over], "over_joint": goal.joints[beside]}
        ratios.append({**own, **other, "given": given if np.isfinite(given) else None})
    return ratios


def _spoiled(row: EditRow, none: EditRow, ratios: Sequence[EditRow]) -> Iterator[str]:
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


def ratio_name(ratio: EditRow) -> str:
    """Words of a ratio."""
    if ratio["run"] == ratio["over_run"]:
        return f"joint {ratio['joint']} over {ratio['over_joint']}"
    return f"{run_in_words(ratio['run'])} over {run_in_words(ratio['over_run'])} on joint {ratio['joint']}"


def sentence(rows: Sequence[EditRow]) -> str:
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


def _table(rows: Sequence[EditRow], ratios: Sequence[EditRow]) -> Iterator[EditRow]:
    """Rows of the table, no edit first, then by likelihood."""
    for row in (rows[0], *sorted(rows[1:], key=lambda row: row["rank"] or len(rows))):
        medians = {
            ratio_name(ratio).lower().replace(" ", "_"): ours and ours["median"]
            for ratio, ours in zip(ratios, row["ratios"], strict=True)
        }
        first, last = ("rank", "edit", "stable_share", "order_share"), (*_SHOWN[4:], "like")
        shown = {name: row[name] for name in first} | medians
        yield shown | {name: row[name] for name in ("torque_steps_over_none", *last)}


def _sentences(data: Mapping[str, Any]) -> Iterator[str]:
    for name, words in data["sentences"].items():
        yield f"{'With starts apart' if name == APART else 'As published'}: {words}"
    named = [row["edit"] for row in data["edits"] if row["named"]]
    yield f"Named, since {data['factor']:,.0f} times as likely as no edit: {', '.join(named) or 'none'}."
    few = sum(not row["ranked"] for row in data["edits"])
    if few:
        yield f"{few} edits are stable on fewer than {FEWEST} plants, and are not ranked."
    if data["no_number"]:
        yield f"No number anywhere, and not ranked: {'; '.join(data['no_number'])}."
