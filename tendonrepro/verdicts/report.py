"""Verdicts as tables and text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from tendonrepro.configuration.shown import EVERY_RUN
from tendonrepro.configuration.strict_yaml import dump
from tendonrepro.console import columns, count_of
from tendonrepro.files import to_json
from tendonrepro.results.tables import NOTHING, Table
from tendonrepro.verdicts.from_ensemble import COMMAND
from tendonrepro.verdicts.ledger import SHARE, Verdict, summary
from tendonrepro.verdicts.rules import HEADINGS, VERDICTS
from tendonrepro.verdicts.words import claim_in_words, ours, percent, unit_of

CAPTION = "What the printed numbers and claims are worth; rules in docs/verdicts.md."

LEGEND = (
    "'holds on' is the share of the simulated plants on which a claim holds. A line 'with ...' has the "
    f"verdict where that is so; else every run {EVERY_RUN}. *: near a limit, more plants could change it."
)
"""What the words of the table mean, and what the verdicts rest on that the paper does not say."""

MAIN = (
    *("K1", "K3", "C1", "C2", "share.controller_1_of_2.mae.joint_2"),
    *("C3", "C6", "E1", "E3", "increase.with_load.mae.joint_2"),
)
"""The main claims in the order of the paper's argument; of two, their main number."""


def claims_table(verdicts: Sequence[Verdict]) -> Table:
    """``claims.csv`` and ``.md``, beside ``claims.json``."""
    caption = " ".join([CAPTION, *shipped_note(verdicts)])
    rows = [_row(verdict) for verdict in verdicts]
    return Table("claims", caption, rows, terminal=(), suffixes=("csv", "md"), folder="")


def _row(verdict: Verdict) -> dict[str, object]:
    row = asdict(verdict)
    evidence = row.pop("evidence")
    box = evidence.get("box", {})
    row |= {name: box.get(name) for name in ("low", "high")}
    row |= {name: evidence.get(name) for name in ("also_passing", "missing")}
    row["by_choice"] = "; ".join(f"{choice.reading}: {choice.verdict}" for choice in verdict.unless)
    row["false_contradicted"] = verdict.false_contradicted and verdict.false_contradicted.share
    return row | {"measured": _measured(verdict)}


def table_text(verdicts: Sequence[Verdict], *, every: bool = False) -> str:
    """Main claims, or `every` verdict, under their headings."""
    by_id = {verdict.id: verdict for verdict in verdicts}
    shown = [by_id[name] for name in MAIN if name in by_id]
    shown += [verdict for verdict in verdicts if every and verdict.id not in MAIN]
    rows = [["claim", "ours", "verdict", "right papers contradicted", "id", "on the measurement"]]
    for heading, names in HEADINGS.items():
        under = [verdict for verdict in shown if verdict.verdict in names]
        rows += [[f"{heading}:", *[""] * 5]] if under else []
        for claim in under:
            verdict = f"{VERDICTS[claim.verdict]}{_marks(claim)}"
            name = f"{claim.id} (counts with {claim.repeats})" if claim.repeats else claim.id
            measured = _measured(claim) or NOTHING
            rows.append(
                [f"  {claim_in_words(claim.id)}", _ours(claim), verdict, _rate(claim), name, measured]
            )
            for choice in claim.unless:
                told = _number(claim, choice.ours), VERDICTS[choice.verdict]
                rows.append([f"    with {choice.reading}", *told, *[""] * 3])
    commands = {verdict.evidence.get("run") for verdict in verdicts if verdict.verdict == "not_testable"}
    notes = [f"For more verdicts run {command}." for command in sorted(filter(None, commands))]
    more = [] if every else [f"--all shows all {len(verdicts)} claims and numbers."]
    return "\n".join([columns(rows), "", headline(verdicts), *more, *notes, *shipped_note(shown), LEGEND])


def headline(verdicts: Sequence[Verdict]) -> str:
    """Count by heading; what repeats another claim or would hold of most values is not counted."""
    counts = summary(verdicts) | {"no_power": 0}
    told = ("{} hold", "{} do not hold", "the opposite of {} holds", "{} cannot be tested here")
    sums = (sum(counts[name] for name in names) for names in HEADINGS.values())
    by_heading = (words.format(total) for words, total in zip(told, sums, strict=True) if total)
    return (
        f"{count_of(sum(counts.values()), 'claim')} judged: {', '.join(by_heading)}. Not counted are numbers "
        "of a claim that is counted, and those that the plants allow as they do most other values."
    )


def shipped_note(verdicts: Sequence[Verdict]) -> list[str]:
    """Say which ensemble shipped verdicts rest on."""
    origin = next((verdict.evidence["ensemble"] for verdict in verdicts if verdict.shipped), None)
    if origin is None:
        return []
    draws, version, created = (origin[key] for key in ("draws", "tendonrepro_version", "created"))
    return [
        f"(shipped): judged on the {draws} plants that come with the package (tendonrepro {version}, "
        f"{created.partition('T')[0]}). {COMMAND} makes an ensemble of your own."
    ]


def changes_text(
    changes: Mapping[str, tuple[str, str | None]], before: Mapping[str, str], verdicts: Sequence[Verdict]
) -> str:
    """Verdicts that changed since those `before`, one a line, and how many of today's these do not hold."""
    rows = [f"{name}: {old} -> {new or 'not judged'}" for name, (old, new) in changes.items()]
    absent = sum(verdict.id not in before for verdict in verdicts)
    lacks = [f"The baseline lacks {absent} of {count_of(len(verdicts), 'verdict')}."] if absent else []
    return "\n".join(["Changed since the baseline:", *(rows or ["nothing"]), *lacks])


def details_text(verdict: Verdict) -> str:
    """One claim with all its evidence, as ``claims.json`` has it, with four digits."""
    told = (
        f"{verdict.printed}{unit_of(verdict)}: {VERDICTS[verdict.verdict]}{_marks(verdict)}; {ours(verdict)}"
    )
    plain = to_json(asdict(verdict))
    entry = json.loads(plain, parse_float=lambda digits: float(f"{float(digits):.4g}"))
    # What is long comes last.
    for name in ("evidence", "readings_that_change_it"):
        entry[name] = entry.pop(name)
    return "\n".join([told, dump(entry).rstrip(), *shipped_note([verdict])])


def _number(verdict: Verdict, value: float | None) -> str:
    """Our share or number, under any choice."""
    if value is None:
        return NOTHING
    if verdict.unit != SHARE:
        return f"{value:.4g}{unit_of(verdict)}"
    return f"holds on {percent(value) if value else 'none'}"


def _ours(verdict: Verdict) -> str:
    """What came out here, and what is printed or, of an order, on how many plants the reverse holds."""
    if verdict.ours is None:
        return NOTHING
    if verdict.unit != SHARE:
        return f"{ours(verdict)}, printed {verdict.printed}{unit_of(verdict)}"
    opposite = verdict.evidence.get("opposite", {})
    reverse = f", reverse {percent(opposite['share'])}" if "reverse" in opposite.get("statement", "") else ""
    return _number(verdict, verdict.ours) + reverse


def _rate(verdict: Verdict) -> str:
    """How often the rule contradicts a right paper."""
    rate = verdict.false_contradicted
    if rate is None or rate.interval is None:
        return NOTHING
    return f"{percent(rate.share)} of {rate.plants}, at most {percent(rate.interval[1])}"


def _measured(verdict: Verdict) -> str | None:
    beside = verdict.evidence.get("measured")
    if beside is None:
        return None
    ours = "" if beside["ours"] is None else f" ({beside['ours']:.4g})"
    return f"{beside['verdict']}{ours}"


def _marks(verdict: Verdict) -> str:
    return " *" * verdict.borderline + " (shipped)" * verdict.shipped
