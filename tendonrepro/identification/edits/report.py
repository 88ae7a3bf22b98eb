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
    from tendonrepro.identification.edits.figures_edits import draw_edits

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
    table = Table(
        "edits", caption, every, terminal=_SHOWN, printed=Table("edits", caption, every[: 1 + SHOWN])
    )
    draw = partial(draw_edits, rows, ratios, of.factor, plants)
    drawings = {"edits": draw} if any(row["ranked"] for row in rows[1:]) else {}
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
            "stable": int(of.stable[k].sum()),
            "stable_share": float(of.stable[k].mean()),
            **_order(of, k),
            "ratios": [*_quantiles(of, k, ratios)],
            **_smoothness(of, k),
            "like": names[of.classes[k]] if of.classes[k] != k else None,
            "ranked": ranked,
            "log10_likelihood_ratio": float(rank.ratios[k] / np.log(10.0)) if ranked else None,
            "rank": rank.order.index(k) + 1 if k in rank.order else None,
            "named": k in rank.named,
        }
        rows.append(row | {"spoils": [*_spoiled(row, rows[0] if k else row, ratios)]})
    return rows


def _order(of: Outcomes, k: int) -> EditRow:
    """Shares of stable plants on which runs rank as in the table."""
    if not of.stable[k].any() or len(of.goal.runs) < 2:
        return {"order_share": None, "order": None}
    kept = equal_order(of.sizes[k][of.stable[k]], of.goal)
    by_metric = dict(zip(METRICS, kept.mean(axis=0).tolist(), strict=True))
    return {"order_share": float(kept.all(axis=(1, 2)).mean()), "order": by_metric}


def ratios_of(goal: Goal) -> list[EditRow]:
    """Ratios of MAE that rows give: of a run over the next, by joint, and of the first run's outer joints."""
    joints = range(len(goal.joints))
    pairs = [((r, i), (r + 1, i)) for r in range(len(goal.runs) - 1) for i in joints]
    pairs += [((0, joints[-1]), (0, 0))] if len(joints) > 1 else []
    ratios = []
    for (run, joint), (over, beside) in pairs:
        given = float(goal.values[run, 0, joint] / goal.values[over, 0, beside])
        ratio: EditRow = {
            "run": goal.runs[run],
            "joint": goal.joints[joint],
            "over_run": goal.runs[over],
            "over_joint": goal.joints[beside],
            "given": given if np.isfinite(given) else None,
        }
        ratios.append(ratio)
    return ratios


def _quantiles(of: Outcomes, k: int, ratios: Sequence[EditRow]) -> Iterator[dict[str, float] | None]:
    """Median and central 90 % of each ratio; None where no plant is stable."""
    sizes, goal = of.sizes[k][of.stable[k]][:, :, 0], of.goal
    for ratio in ratios:
        run, over = (goal.runs.index(ratio[name]) for name in ("run", "over_run"))
        joint, beside = (goal.joints.index(ratio[name]) for name in ("joint", "over_joint"))
        values = sizes[:, run, joint] / sizes[:, over, beside]
        ends = np.quantile(values, [0.05, 0.5, 0.95]).tolist() if len(values) else None
        yield ends and dict(zip(("low", "median", "high"), ends, strict=True))


def _smoothness(of: Outcomes, k: int) -> EditRow:
    """How smooth the torque is: over that without an edit, and how often the first run's is the smoothest."""
    both, steps = of.stable[k] & of.stable[0], of.steps[k][of.stable[k]]
    over = (of.steps[k][both] / of.steps[0][both]).max(axis=1)
    first = float((steps[:, 0] <= steps.min(axis=1)).mean()) if len(of.goal.runs) > 1 and len(steps) else None
    rougher = float(np.median(over)) if len(over) else None
    return {"torque_steps_over_none": rougher, "first_smoothest_share": first}


def _spoiled(row: EditRow, none: EditRow, ratios: Sequence[EditRow]) -> Iterator[str]:
    """What of the paper an edit does not give, beside the order."""
    smoothest, steps = row["first_smoothest_share"], row["torque_steps_over_none"] or 0.0
    if row["stable"] < 0.5 * none["stable"]:
        yield "stability"
    if smoothest is not None and smoothest < 0.5 <= (none["first_smoothest_share"] or 0.0):
        yield "the smooth torque of " + run_in_words(ratios[0]["run"])
    if steps > ROUGHER:
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
