"""From the records of all edits to rows, the sentence that matters, tables and the picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import METRICS
from tendonrepro.identification.edits.rank import FEWEST, Likelihoods, Ranking, equal_order, planted, ranking
from tendonrepro.identification.edits.runs import APART, EditStudy
from tendonrepro.identification.goal import Goal
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.record_store import Records
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result

SCHEMA_VERSION = 1
NONE = "no edit"
"""Name of the row without an edit."""

PAPERS = 100
"""Tables with a planted edit, and as many without."""

ROUGHER = 1.1
"""Torque steps over those without an edit above which an edit spoils the smooth torque."""

SHOWN = 12
"""Edits in the terminal."""
_SHOWN = "rank", "edit", "stable_share", "order_share", "log10_likelihood_ratio", "named"

EditRow: TypeAlias = dict[str, Any]
"""An edit as it is stored."""


class Measured(NamedTuple):
    """Of E edits on N plants under one reading, the first of which is none.

    `sizes` (E, N, R, 2, n) are errors, deg; `steps` (E, N, R) change of torque in a sample, RMS over joints,
    N m; `stable` (E, N) whether all runs are.
    """

    sizes: Array
    steps: Array
    stable: NDArray[np.bool_]


def measured(study: EditStudy, records: Records, reading: int) -> Measured:
    """Records by edit and run."""
    place = study.lookup
    ok = (records["status"][:, reading] == STATUSES.index("ok"))[:, place].all(axis=-1)
    errors = [records[name][:, reading][:, place].astype(float) for name in METRICS]
    sizes = np.rad2deg(np.stack(errors, axis=-2))
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.asarray(records["torque_step_rms"][:, reading][:, place], dtype=float) ** 2
    return Measured(np.moveaxis(sizes, 1, 0), np.sqrt(squares.mean(axis=-1)).swapaxes(0, 1), ok.T)


def edit_rows(study: EditStudy, of: Measured, likelihoods: Likelihoods, rank: Ranking) -> list[EditRow]:
    """A row for no edit, and one for each."""
    goal, rows = study.goal, []
    variants = study.variants.edits
    names = [NONE, *(edit.name for edit in variants)]
    for k, name in enumerate(names):
        kept = of.stable[k]
        edit = variants[k - 1] if k else None
        row: EditRow = {
            "edit": name,
            "equation": edit.equation if edit else None,
            "change": edit.words if edit else None,
            "runs": list(edit.runs) if edit else [],
            "also": list(edit.others) if edit else [],
            "stable": int(kept.sum()),
            "stable_share": float(kept.mean()),
            **_order(of.sizes[k][kept], study),
            "ratios": [*_quantiles(of.sizes[k][kept], goal)],
            **_smoothness(of, k, goal.runs),
            "like": names[likelihoods.classes[k]] if likelihoods.classes[k] != k else None,
            "ranked": bool(likelihoods.ranked[k]),
            "log10_likelihood_ratio": float(rank.ratios[k] / np.log(10.0)) if likelihoods.ranked[k] else None,
            "rank": rank.order.index(k) + 1 if k in rank.order else None,
            "named": k in rank.named,
        }
        rows.append(row)
    for row in rows:
        row["spoils"] = [*_spoiled(row, rows[0], ratios_of(goal))]
    return rows


def _order(sizes: Array, study: EditStudy) -> EditRow:
    """Shares of plants, of errors (N, R, 2, n), on which runs rank as in the table."""
    goal = study.goal
    if len(sizes) == 0 or len(goal.runs) < 2:
        return {"order_share": None, "order": None}
    kept = equal_order(sizes, goal)
    return {
        "order_share": float(kept.all(axis=(1, 2)).mean()),
        "order": {metric: kept[:, m].mean(axis=0).tolist() for m, metric in enumerate(METRICS)},
    }


def ratios_of(goal: Goal) -> list[EditRow]:
    """Ratios of MAE that rows give: of a run over the next, by joint, and of the first run's outer joints."""
    pairs = [((r, i), (r + 1, i)) for r in range(len(goal.runs) - 1) for i in range(len(goal.joints))]
    if len(goal.joints) > 1:
        pairs.append(((0, len(goal.joints) - 1), (0, 0)))
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


def _quantiles(sizes: Array, goal: Goal) -> Iterator[dict[str, float] | None]:
    """Median and central 90 % of each ratio, from errors (N, R, 2, n); None where no plant is stable."""
    for ratio in ratios_of(goal):
        run, over = (goal.runs.index(ratio[name]) for name in ("run", "over_run"))
        joint, beside = (goal.joints.index(ratio[name]) for name in ("joint", "over_joint"))
        if len(sizes) == 0:
            yield None
            continue
        each = np.quantile(sizes[:, run, 0, joint] / sizes[:, over, 0, beside], [0.05, 0.5, 0.95])
        yield dict(zip(("low", "median", "high"), each.tolist(), strict=True))


def _smoothness(of: Measured, k: int, runs: Sequence[str]) -> EditRow:
    """How smooth the torque is: over that without an edit, and how often the first run's is the smoothest."""
    both = of.stable[k] & of.stable[0]
    over = of.steps[k][both] / of.steps[0][both]
    rougher = float(np.median(over.max(axis=1))) if len(over) else None
    steps = of.steps[k][of.stable[k]]
    first = float((steps[:, 0] <= steps.min(axis=1)).mean()) if len(runs) > 1 and len(steps) else None
    return {"torque_steps_over_none": rougher, "first_smoothest_share": first}


def _spoiled(row: EditRow, none: EditRow, ratios: Sequence[EditRow]) -> Iterator[str]:
    """What of the paper an edit does not give, beside the order."""
    if row["stable"] < 0.5 * none["stable"]:
        yield "stability"
    smoothest = row["first_smoothest_share"]
    if smoothest is not None and smoothest < 0.5 and (none["first_smoothest_share"] or 0.0) >= 0.5:
        yield "the smooth torque of " + _told(ratios[0]["run"])
    if (row["torque_steps_over_none"] or 0.0) > ROUGHER:
        yield f"torque steps, {row['torque_steps_over_none']:.2g} times as large"
    for ratio, ours in zip(ratios, row["ratios"], strict=True):
        if ours and ratio["given"] and not ours["low"] <= ratio["given"] <= ours["high"]:
            yield f"the ratio {ratio_name(ratio)}"


def ratio_name(ratio: EditRow) -> str:
    """Words of a ratio."""
    if ratio["run"] == ratio["over_run"]:
        return f"joint {ratio['joint']} over {ratio['over_joint']}"
    return f"{_told(ratio['run'])} over {_told(ratio['over_run'])} on joint {ratio['joint']}"


def _told(run: str) -> str:
    return run.replace("controller_", "Controller ")


def sentence(rows: Sequence[EditRow]) -> str:
    """What all edits give, in a sentence."""
    edits = [row for row in rows[1:] if row["order_share"] is not None]
    if not edits:
        return f"Of {len(rows) - 1} single edits none is compared by an order: there is one run."
    most = [row for row in edits if row["stable"] >= FEWEST and row["order_share"] > 0.5]
    begin = f"Of {len(rows) - 1} single edits {len(most)} give the order of the table"
    end = " on more than half of the stable plants"
    each = [_told_of(row) for row in sorted(most, key=lambda row: -float(row["order_share"]))]
    return begin + end + (": " + ". ".join(each) if each else "") + "."


def _told_of(row: EditRow) -> str:
    """An edit, how often it gives the order, and what it spoils."""
    spoils = f", which spoils {'; '.join(row['spoils'])}" if row["spoils"] else ""
    return f"{row['edit']} ({row['order_share']:.0%} of {row['stable']}){spoils}"


def edits_result(study: EditStudy, records: Records) -> Result:
    """Numbers, tables and the picture."""
    from tendonrepro.identification.edits.figures_edits import draw_edits

    likelihoods: dict[str, Likelihoods] = {}
    rows_of: dict[str, list[EditRow]] = {}
    for place, reading in enumerate(study.readings):
        of = measured(study, records, place)
        absolute = study.loaded.around is not None
        likelihoods[reading.name] = Likelihoods(of.sizes, of.stable, study.goal, absolute)
        rank = ranking(likelihoods[reading.name], study.goal)
        rows_of[reading.name] = edit_rows(study, of, likelihoods[reading.name], rank)
    first, *others = rows_of
    rows, factor = rows_of[first], likelihoods[first].factor
    for name in others:
        for row, apart in zip(rows, rows_of[name], strict=True):
            row["apart"] = {key: value for key, value in apart.items() if key not in _OF_EDIT}
    seed = int(study.loaded.config.seed.si)
    data: EditRow = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "edits",
        "plants": study.plants,
        "runs": list(study.goal.runs),
        "joints": list(study.goal.joints),
        "made": study.variants.made,
        "unchanged": list(study.variants.unchanged),
        "no_number": list(study.variants.no_number),
        "ratios": ratios_of(study.goal),
        "factor": factor,
        "sentences": {name: sentence(own) for name, own in rows_of.items()},
        "planted": planted(likelihoods[first], PAPERS, seed),
        "edits": rows,
    }
    if APART in likelihoods:
        data["planted_apart"] = planted(likelihoods[APART], PAPERS, seed)
    caption = f"Edits of one place each on {study.plants} plants, most likely first."
    every = [*_table(rows, data["ratios"])]
    tables = [
        Table("edits", caption, every, terminal=()),
        Table("edits_first", caption, every[: 1 + SHOWN], terminal=_SHOWN),
    ]
    draw = partial(draw_edits, rows, data["ratios"], factor, study.plants)
    drawings = {"edits": draw} if any(row["ranked"] for row in rows[1:]) else {}
    return Result(data, [*_sentences(data), *tables], drawings)


_OF_EDIT = ("edit", "equation", "change", "runs", "also")


def _table(rows: Sequence[EditRow], ratios: Sequence[EditRow]) -> Iterator[EditRow]:
    """Rows of the table, no edit first, then by likelihood."""
    last = len(rows)
    for row in (rows[0], *sorted(rows[1:], key=lambda row: row["rank"] or last)):
        shown = {name: row[name] for name in ("rank", "edit", "stable_share", "order_share")}
        for ratio, ours in zip(ratios, row["ratios"], strict=True):
            shown[ratio_name(ratio).lower().replace(" ", "_")] = ours and ours["median"]
        yield shown | {
            "torque_steps_over_none": row["torque_steps_over_none"],
            "log10_likelihood_ratio": row["log10_likelihood_ratio"],
            "named": row["named"],
            "like": row["like"],
        }


def _sentences(data: Mapping[str, Any]) -> Iterator[str]:
    for name, told in data["sentences"].items():
        yield f"{'With starts apart' if name == APART else 'As published'}: {told}"
    named = [row["edit"] for row in data["edits"] if row["named"]]
    yield f"Named, since {data['factor']:,.0f} times as likely as no edit: {', '.join(named) or 'none'}."
    few = sum(not row["ranked"] for row in data["edits"])
    if few:
        yield f"{few} edits are stable on fewer than {FEWEST} plants, and are not ranked."
    if data["no_number"]:
        yield f"No number anywhere, and not ranked: {'; '.join(data['no_number'])}."
