"""Claims and numbers judged over the plants of an ensemble, by "Many plants" in docs/verdicts.md."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import Published
from tendonrepro.console import count_of
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.shares import FEW, LEAST_PLANTS, Share
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts import rules
from tendonrepro.verdicts.from_print import INCREASES, NUMBERS, PERCENTAGES, formula_of
from tendonrepro.verdicts.rules import Evidence, Mask, Ruling, not_testable
from tendonrepro.verdicts.statements import Claim, Plants, Statement, claim_on, direction, together

COMMAND = "tendonrepro ensemble"
HARDWARE = "The paper measured hardware; this is what the printed equations do on the plants of the box."

VALUES: Mapping[str, str] = {"order": "table2.", "payload": INCREASES}
"""Rules of claims that print values, and how the ids of these begin."""

LEAST: Mapping[str, float] = {"rmse_over_mae": 1.0}
"""What a family of numbers cannot be below: an RMSE is never below its MAE."""


def numbers_of(plants: Plants, paper: Published, identifier: str) -> tuple[Array, Mask]:
    """A printed number on every plant, in its unit, and the plants judged, (N,) each."""
    formula = formula_of(paper, identifier)
    errors = formula.errors
    sizes = [np.rad2deg(plants[of.run, of.metric][:, plants.joints.index(of.joint)]) for of in errors]
    with np.errstate(divide="ignore", invalid="ignore"):
        values = formula.value(*sizes)
    return values, plants.ok(*CONTROLLERS, *(error.run for error in errors)) & np.isfinite(values)


def _all_reversed(plants: Plants, paper: Published, identifier: str, judged: Mask) -> bool:
    """Whether the directions of all percentages between the same runs are reversed."""
    compared = re.split(r"mae|rmse", identifier)[0]
    directions = [direction(plants, paper, name) for name in paper.entries if name.startswith(compared)]
    shares = [plants.share(part.holds, judged).share for part in directions if part is not None]
    return len(shares) == len(directions) and max(shares) <= FEW


def judge_plants(plants: Plants, paper: Published, identifier: str) -> Ruling:
    """Judge a number or a claim under one reading."""
    rule = paper.judgements[identifier].rule
    try:
        return _number(plants, paper, identifier) if rule in NUMBERS else _claim(plants, paper, rule)
    except DataMissingError as error:
        return not_testable(error.message, COMMAND)


def _check_enough(judged: Mask) -> None:
    """Refuse to judge by too few plants."""
    count = int(judged.sum())
    if count < LEAST_PLANTS:
        told = f"only {count} of {len(judged)} plants can be judged"
        raise DataMissingError(f"{told}, {LEAST_PLANTS} are needed: more --draws")


def _number(plants: Plants, paper: Published, identifier: str) -> Ruling:
    """Judge a number by its spread, and a percentage by its direction too."""
    values, judged = numbers_of(plants, paper, identifier)
    _check_enough(judged)
    box = plants.spread(values, judged)
    low, high = map(float, paper.interval(identifier))
    power = rules.power_of((low, high), box, LEAST.get(identifier.partition(".")[0], 0.0))
    evidence: Evidence = {"box": asdict(box), "also_passing": power, "share_judged": float(judged.mean())}
    statement = direction(plants, paper, identifier) if identifier.startswith(PERCENTAGES) else None
    share, whole = None, False
    if statement is not None:
        share = plants.share(statement.holds, judged)
        whole = _all_reversed(plants, paper, identifier, judged)
        evidence["direction"] = {"statement": statement.text, **asdict(share)}
    ruling = rules.of_number((low, high), box, share, power, all_reversed=whole)
    remarks = [HARDWARE] if ruling.verdict == "contradicted" else []
    return replace(ruling, ours=box.median, evidence=evidence | {"remarks": remarks})


def _claim(plants: Plants, paper: Published, rule: str) -> Ruling:
    """Judge a claim by its statements, and by its values where it prints some."""
    claim = claim_on(plants, paper, rule)
    _check_enough(claim.judged)
    ruling = _by_statements(plants, claim)
    evidence = ruling.evidence | {"share_judged": float(claim.judged.mean())}
    if claim.beside:
        evidence["beside"] = _rows(plants, claim.beside, claim.judged)
    remarks = [*claim.remarks]
    if "measure" in evidence:
        shares = (f"{row['measure']} {100.0 * row['share']:.3g} %" for row in evidence["by_measure"])
        by = f"decided by {evidence['measure']}, as it holds most often; by each: {', '.join(shares)}"
        remarks.append(by)
    if unresolved := int((~plants.resolved(*CONTROLLERS)).sum()):
        remarks.append(f"left out: {count_of(unresolved, 'plant')} too fast for the integrator")
    if rule in VALUES:
        names = (name for name in paper.entries if name.startswith(VALUES[rule]))
        values = [_number(plants, paper, name) for name in names]
        # P1 is its values; an order that fails needs none.
        if rule == "payload" or ruling.verdict == "compatible":
            ruling = replace(rules.of_values(ruling, values), ours=ruling.ours)
        if ruling.verdict in rules.INSIDE:
            passing = ", ".join(f"{100.0 * value.evidence['also_passing']:.0f} %" for value in values)
            remarks.append(f"of a decade around each printed value this much would also pass: {passing}")
    if ruling.verdict == "contradicted":
        remarks.insert(0, HARDWARE)
    evidence["remarks"] = remarks
    if claim.untestable:
        return not_testable(claim.untestable, None, **evidence)
    return replace(ruling, evidence=evidence)


def _by_statements(plants: Plants, claim: Claim) -> Ruling:
    """Judge by the measure that holds most often."""
    counted = claim.judged

    def against(statements: Sequence[Statement]) -> Share:
        none = np.logical_and.reduce([~part.holds for part in statements])
        return plants.share(claim.opposite.holds if claim.opposite else none, counted)

    wholes = {name: plants.share(together(parts), counted) for name, parts in claim.measures.items()}
    best = max(wholes, key=lambda name: wholes[name].share)
    overall = against(claim.statements)
    evidence: Evidence = asdict(wholes[best])
    if len(wholes) > 1:
        evidence["measure"] = best
        evidence["by_measure"] = [
            {"measure": name, "verdict": rules.of_claim(whole, against(claim.measures[name])).verdict}
            | asdict(whole)
            for name, whole in wholes.items()
        ]
    told = claim.opposite.text if claim.opposite else "no statement holds"
    evidence["opposite"] = {"statement": told, **asdict(overall)}
    evidence["statements"] = _rows(plants, claim.statements, counted)
    return replace(rules.of_claim(wholes[best], overall), ours=wholes[best].share, evidence=evidence)


def _rows(plants: Plants, statements: Sequence[Statement], counted: Mask) -> list[Evidence]:
    """Share and verdict of each statement by itself."""
    rows = []
    for statement in statements:
        share = plants.share(statement.holds, counted)
        named = {"measure": statement.measure} if statement.measure else {}
        verdict = rules.of_share(share).verdict
        rows.append({"statement": statement.text, **named, "verdict": verdict, **asdict(share)})
    return rows
