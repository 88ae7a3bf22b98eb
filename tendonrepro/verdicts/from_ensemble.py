"""Verdicts from an ensemble: numbers against their range over the box, claims by their shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import Published
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.shares import LEAST_PLANTS, Share, share_of, spread_of
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.numbers import FIRST, PERCENTAGES, formula_of
from tendonrepro.verdicts.plants import UNRESOLVED, Plants
from tendonrepro.verdicts.rules import (
    INSIDE,
    Decision,
    Evidence,
    Judged,
    Mask,
    missing,
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
    together,
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


def judge(plants: Plants, paper: Published, identifier: str) -> Judged:
    """Judge a number or a claim by its rule under one reading."""
    rule = paper.judgements[identifier].rule
    try:
        return _number(plants, paper, identifier) if rule in NUMBERS else _claim(plants, paper, rule)
    except DataMissingError as error:
        return missing(error.message, COMMAND)


def _too_few(judged: Mask) -> Judged | None:
    count = int(judged.sum())
    if count >= LEAST_PLANTS:
        return None
    what = f"only {count} of {len(judged)} plants can be judged, {LEAST_PLANTS} are needed"
    return missing(what, f"{COMMAND} --draws N with a larger N")


def _share(plants: Plants, holds: Mask, counted: Mask) -> Share:
    return share_of(holds[counted], plants.data.replicate[counted])


def _number(plants: Plants, paper: Published, identifier: str) -> Judged:
    found = numbers_of(plants, paper, identifier)
    few = _too_few(found.judged)
    if few:
        return few
    box = spread_of(found.values[found.judged], plants.data.replicate[found.judged])
    low, high = map(float, paper.interval(identifier))
    power = power_of((low, high), box, LEAST.get(identifier.partition(".")[0], 0.0))
    decision, remarks = of_number((low, high), box, None, power), []
    evidence: Evidence = {
        "box": asdict(box),
        "also_passing": power,
        "share_judged": float(found.judged.mean()),
    }
    if found.direction:
        statement, rankable = found.direction
        share, last = (_share(plants, statement.holds, counted) for counted in (found.judged, rankable))
        evidence["direction"] = {"statement": statement.text, **asdict(share), "diverged_last": asdict(last)}
        decision, ranked = (of_number((low, high), box, one, power) for one in (share, last))
        if ranked.verdict != decision.verdict:
            remarks = [f"with a diverged law ranked last: {ranked.verdict}"]
    return Judged(decision, box.median, evidence | _remarks(decision, remarks))


def _claim(plants: Plants, paper: Published, rule: str) -> Judged:
    found = findings_of(plants, paper, rule)
    few = _too_few(found.judged)
    if few:
        return few
    decision, evidence = _by_statements(plants, found, found.judged)
    evidence["share_judged"] = float(found.judged.mean())
    remarks = [*found.remarks]
    if found.beside:
        evidence["beside"] = _rows(plants, found.beside, found.judged)
    if found.chance:
        evidence["chance"], evidence["chance_together"] = found.chance
    if "measure" in evidence:
        shares = [f"{row['measure']} {100.0 * row['share']:.3g} %" for row in evidence["by_measure"]]
        remarks.append(
            f"decided by {evidence['measure']}, as it holds most often; by each: {', '.join(shares)}"
        )
    unresolved = int((~plants.none(UNRESOLVED, *CONTROLLERS)).sum())
    if unresolved:
        remarks.append(f"left out: {unresolved} plants too fast for the integrator")
    if found.rankable is not None:
        last, evidence["diverged_last"] = _by_statements(plants, found, found.rankable)
        if last.verdict != decision.verdict:
            remarks.append(f"with a diverged law ranked last, without regard to values: {last.verdict}")
    if rule in VALUES:
        names = (name for name in paper.entries if name.startswith(VALUES[rule]))
        values = [_number(plants, paper, name) for name in names]
        judged_by = of_values if rule == "payload" else with_values
        decision = judged_by(decision, [value.decision for value in values])
        if decision.verdict in INSIDE:
            passing = ", ".join(f"{100.0 * value.evidence['also_passing']:.0f} %" for value in values)
            remarks.append(f"of a decade around each printed value this much would also pass: {passing}")
    evidence |= _remarks(decision, remarks)
    if found.untestable:
        return missing(found.untestable, None, **evidence)
    return Judged(decision, evidence["share"], evidence)


def _by_statements(plants: Plants, found: Findings, counted: Mask) -> tuple[Decision, Evidence]:
    """Judge by the measure under which a claim holds most often; the shares behind that."""

    def against(statements: Sequence[Statement]) -> Share:
        none = np.logical_and.reduce([~one.holds for one in statements])
        return _share(plants, found.opposite.holds if found.opposite else none, counted)

    wholes = {name: _share(plants, together(held), counted) for name, held in found.measures.items()}
    best = max(wholes, key=lambda name: wholes[name].share)
    overall = against(found.statements)
    evidence: Evidence = asdict(wholes[best])
    if len(wholes) > 1:
        evidence["measure"] = best
        evidence["by_measure"] = [
            {
                "measure": name,
                "verdict": of_claim(wholes[name], against(held)).verdict,
                **asdict(wholes[name]),
            }
            for name, held in found.measures.items()
        ]
    told = found.opposite.text if found.opposite else "no statement holds"
    evidence["opposite"] = {"statement": told, **asdict(overall)}
    evidence["statements"] = _rows(plants, found.statements, counted)
    return of_claim(wholes[best], overall), evidence


def _rows(plants: Plants, statements: Sequence[Statement], counted: Mask) -> list[dict[str, Any]]:
    """Statements with their own shares and verdicts."""
    rows = []
    for one in statements:
        share = _share(plants, one.holds, counted)
        named = {"measure": one.measure} if one.measure else {}
        rows.append({"statement": one.text, **named, "verdict": of_share(share).verdict, **asdict(share)})
    return rows


def _remarks(decision: Decision, remarks: Sequence[str]) -> Evidence:
    hardware = [HARDWARE] if decision.verdict == "contradicted" else []
    return {"remarks": [*hardware, *remarks]}


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
    ways = map(together, claim.measures.values())
    deciding = max(ways, key=lambda holds: np.count_nonzero(holds[claim.judged]))
    return deciding.astype(np.float64), claim.judged
