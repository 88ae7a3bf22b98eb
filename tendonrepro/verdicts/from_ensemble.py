"""Verdicts from an ensemble: numbers against their range over the box, claims by their shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import Published
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.shares import LEAST_PLANTS, Share, share_of, spread_of
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.from_print import Evidence, Judged, missing
from tendonrepro.verdicts.numbers import FIRST, PERCENTAGES, formula_of
from tendonrepro.verdicts.plants import UNRESOLVED, Plants
from tendonrepro.verdicts.rules import (
    INSIDE,
    MOST_UNRESOLVED,
    Decision,
    Mask,
    of_claim,
    of_number,
    of_share,
    of_values,
    power_of,
    with_values,
)
from tendonrepro.verdicts.statements import (
    Findings,
    Statement,
    findings_of,
    smaller,
)

COMMAND = "tendonrepro ensemble"
HARDWARE = "The paper measured hardware; this is what the printed equations do on the plants of the box."

VALUES: Mapping[str, str] = {"order": "table2.", "payload": "increase."}
"""Claims that print values, and how the ids of these begin."""

NUMBERS = ("value", "shape", "joints", "dose", "ratio", "increase")
"""Rules of numbers."""

LEAST: Mapping[str, float] = {"rmse_over_mae": 1.0}
"""Families of numbers that cannot be below a number: an RMSE is never below its MAE."""


@dataclass(frozen=True)
class PlantNumbers:
    """A printed number over all plants: its values (N,) in the printed unit, meaningful where `judged`.

    `direction` is what the number claims besides its size, with the plants on which that can be ranked when a
    diverged law counts last.
    """

    values: Array
    judged: Mask
    direction: tuple[Statement, Mask] | None = None


def numbers_of(plants: Plants, paper: Published, identifier: str) -> PlantNumbers:
    """Look up a number of Tables 2 and 3, or one that follows from them, on every plant."""
    formula = formula_of(paper, identifier)
    errors = formula.errors
    columns = [plants.joints.index(error.joint) for error in errors]
    sizes = [
        np.rad2deg(plants[error.run, error.metric][:, column])
        for error, column in zip(errors, columns, strict=True)
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        values = formula.value(*sizes)
    judged = plants.ok(*CONTROLLERS, *(error.run for error in errors)) & np.isfinite(values)
    if not identifier.startswith(PERCENTAGES):
        return PlantNumbers(values, judged)
    part, whole = (error.run for error in errors)
    pair = (part, whole) if part == FIRST else (whole, part)
    metric = errors[0].metric
    direction = smaller(plants, metric, *pair, metric.upper())[columns[0]]
    return PlantNumbers(values, judged, (direction, plants.rankable(*pair)))


def judge(plants: Plants, paper: Published, rule: str, identifier: str) -> Judged:
    """Judge a number or a claim by its rule under one reading."""
    work = partial(_number, identifier=identifier) if rule in NUMBERS else partial(_claim, rule=rule)
    try:
        return work(plants, paper)
    except DataMissingError as error:
        return missing(error.message, COMMAND)


def _too_few(judged: Mask) -> Judged | None:
    count = int(judged.sum())
    if count >= LEAST_PLANTS:
        return None
    what = f"only {count} of {len(judged)} plants can be judged, {LEAST_PLANTS} are needed"
    return missing(what, f"{COMMAND} --draws N with a larger N")


def _number(plants: Plants, paper: Published, identifier: str) -> Judged:
    found = numbers_of(plants, paper, identifier)
    few = _too_few(found.judged)
    if few:
        return few
    replicate = plants.data.replicate[found.judged]
    box = spread_of(found.values[found.judged], replicate)
    low, high = map(float, paper.interval(identifier))
    power = power_of((low, high), box, LEAST.get(identifier.partition(".")[0], 0.0))
    evidence: Evidence = {
        "box": box.as_dict(),
        "also_passing": power,
        "share_judged": float(found.judged.mean()),
    }
    share, remarks = None, []
    decision = of_number((low, high), box, share, power)
    if found.direction:
        statement, rankable = found.direction
        share = share_of(statement.holds[found.judged], replicate)
        evidence["direction"] = {"statement": statement.text} | share.as_dict()
        last = share_of(statement.last[rankable], plants.data.replicate[rankable])
        evidence["direction"]["diverged_last"] = last.as_dict()
        decision, ranked = (of_number((low, high), box, one, power) for one in (share, last))
        if ranked.verdict != decision.verdict:
            remarks = [f"with a diverged law ranked last: {ranked.verdict}"]
    return Judged(decision, box.median, evidence | _remarks(decision, *remarks))


def _claim(plants: Plants, paper: Published, rule: str) -> Judged:
    found = findings_of(plants, paper, rule)
    few = _too_few(found.judged)
    if few:
        return few
    if rule == "stable" and found.judged.mean() < 1.0 - MOST_UNRESOLVED:
        left = 100.0 * (1.0 - found.judged.mean())
        return missing(f"{left:.3g} % of the plants were too fast for the integrator")
    direction, evidence = _by_statements(plants, found, found.judged, "holds")
    evidence["share_judged"] = float(found.judged.mean())
    if found.beside:
        evidence["beside"] = _rows(plants, found.beside, found.judged, "holds")
    if found.chance is not None:
        evidence["chance"], evidence["chance_together"] = found.chance
    remarks = [*found.remarks, *_measures(evidence), *_unresolved(plants)]
    if found.rankable is not None:
        last, evidence["diverged_last"] = _by_statements(plants, found, found.rankable, "last")
        if last.verdict != direction.verdict:
            remarks.append(f"with a diverged law ranked last, without regard to values: {last.verdict}")
    decision = direction
    if rule in VALUES:
        names = (name for name in paper.entries if name.startswith(VALUES[rule]))
        values = [_number(plants, paper, name) for name in names]
        judged_by = of_values if rule == "payload" else with_values
        decision = judged_by(direction, [value.decision for value in values])
    if decision.verdict in INSIDE and rule in VALUES:
        passing = ", ".join(f"{100.0 * value.evidence['also_passing']:.0f} %" for value in values)
        remarks.append(f"of a decade around each printed value this much would also pass: {passing}")
    if found.cannot_fail:
        return missing(found.cannot_fail, None, **evidence, **_remarks(decision, *remarks))
    return Judged(decision, evidence["share"], evidence | _remarks(decision, *remarks))


def _by_statements(
    plants: Plants, found: Findings, counted: Mask, attribute: str
) -> tuple[Decision, Evidence]:
    """Judge by the measure under which a claim holds most often; the shares behind that."""
    replicate = plants.data.replicate[counted]

    def share(masks: Sequence[Mask]) -> Share:
        return share_of(np.logical_and.reduce(masks)[counted], replicate)

    def of(statements: Sequence[Statement]) -> list[Mask]:
        return [getattr(statement, attribute) for statement in statements]

    wholes = {name: share(of(held)) for name, held in found.measures.items()}
    best = max(wholes, key=lambda name: wholes[name].value)
    against = {
        name: share(of([found.opposite]) if found.opposite else [~mask for mask in of(held)])
        for name, held in found.measures.items()
    }
    told = found.opposite.text if found.opposite else "no statement holds"
    overall = share(of([found.opposite]) if found.opposite else [~mask for mask in of(found.statements)])
    evidence: Evidence = wholes[best].as_dict()
    if len(wholes) > 1:
        evidence["measure"] = best
        evidence["by_measure"] = [
            {"measure": name, "verdict": of_claim(whole, against[name]).verdict} | whole.as_dict()
            for name, whole in wholes.items()
        ]
    evidence["opposite"] = {"statement": told} | overall.as_dict()
    evidence["statements"] = _rows(plants, found.statements, counted, attribute)
    return of_claim(wholes[best], overall), evidence


def _rows(
    plants: Plants, statements: Sequence[Statement], counted: Mask, attribute: str
) -> list[dict[str, Any]]:
    """Statements with their own shares and verdicts."""
    rows = []
    for statement in statements:
        share = share_of(getattr(statement, attribute)[counted], plants.data.replicate[counted])
        named = {"measure": statement.measure} if statement.measure else {}
        verdict = of_share(share).verdict
        rows.append({"statement": statement.text} | named | {"verdict": verdict} | share.as_dict())
    return rows


def _measures(evidence: Evidence) -> list[str]:
    """Name the measure that decided, and on how many plants the claim holds by the others."""
    rows = [f"{row['measure']} {100.0 * row['share']:.3g} %" for row in evidence.get("by_measure", ())]
    return (
        [f"decided by {evidence['measure']}, as it holds most often; by each: {', '.join(rows)}"]
        if rows
        else []
    )


def _unresolved(plants: Plants) -> list[str]:
    count = int((~plants.none(UNRESOLVED, *CONTROLLERS)).sum())
    return [f"left out: {count} plants too fast for the integrator"] if count else []


def _remarks(decision: Decision, *more: str) -> Evidence:
    remarks = [HARDWARE] if decision.verdict == "contradicted" else []
    return {"remarks": [*remarks, *more]}


def outcome(plants: Plants, paper: Published, identifier: str) -> tuple[Array, Mask]:
    """What a verdict depends on, plant by plant, and the plants to look at.

    1 or 0 for a claim, the value of a number; values are logarithms where all are positive.
    """
    rule = paper.judgements[identifier].rule
    if rule in NUMBERS:
        found = numbers_of(plants, paper, identifier)
        positive = (found.values[found.judged] > 0.0).all()
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(found.values) if positive else found.values, found.judged
    claim = findings_of(plants, paper, rule)
    ways = [np.logical_and.reduce([one.holds for one in held]) for held in claim.measures.values()]
    deciding = max(ways, key=lambda holds: np.count_nonzero(holds[claim.judged]))
    return deciding.astype(np.float64), claim.judged
