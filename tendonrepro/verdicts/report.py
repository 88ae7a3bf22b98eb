"""Verdicts as tables and text."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from tendonrepro.configuration.models.control import FIRST
from tendonrepro.configuration.shown import every_run
from tendonrepro.configuration.strict_yaml import dump
from tendonrepro.console import columns, count_of
from tendonrepro.files import to_json
from tendonrepro.results.tables import NOTHING, Table
from tendonrepro.verdicts.from_ensemble import COMMAND
from tendonrepro.verdicts.ledger import SHARE, Verdict, summary
from tendonrepro.verdicts.rules import HEADINGS, VERDICTS
from tendonrepro.verdicts.words import claim_in_words, ours, percent, unit_of

CAPTION = "What the printed numbers and claims are worth; rules in docs/verdicts.md."

JUDGED_ON = f"Judged where every run {every_run()}. A line 'with ...' has the verdict under another choice."
"""What the verdicts rest on that the paper does not say."""
FEW_NAMES = 5
"""Claims that one line names."""

MAIN = (
    "K1",
    "K3",
    "C1",
    "C2",
    "share.controller_1_of_2.mae.joint_2",
    "C3",
    "C6",
    "E1",
    "E3",
    "increase.with_load.mae.joint_2",
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
    row["by_choice"] = unless_text(verdict)
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
            rows.append(
                [
                    f"  {claim_in_words(claim.id)}",
                    _ours(claim, short=True),
                    verdict,
                    _rate(claim),
                    f"{claim.id} (counts with {claim.repeats})" if claim.repeats else claim.id,
                    _measured(claim) or NOTHING,
                ]
            )
            rows += [
                [
                    f"    with {choice.reading}",
                    _under(claim, choice.ours),
                    VERDICTS[choice.verdict],
                    *[""] * 3,
                ]
                for choice in claim.unless
            ]
    if not any(_measured(verdict) for verdict in verdicts):
        rows = [row[:-1] for row in rows]
    more = [] if every else [f"--all shows all {len(verdicts)} claims and numbers."]
    return "\n".join([columns(rows), "", headline(verdicts), *more, *_notes(verdicts, shown)])


def headline(verdicts: Sequence[Verdict]) -> str:
    """Count by heading, and say what is not counted."""
    counts = summary(verdicts)
    powerless = counts.pop("no_power")
    lines = [f"{count_of(sum(counts.values()), 'claim')} judged: {_by_heading(counts)}."]
    if powerless:
        lines.append(
            f"Not counted: {count_of(powerless, 'number')} that the plants allow, since they allow most "
            "other values, too."
        )
    if repeated := Counter(verdict.verdict for verdict in verdicts if verdict.repeats is not None):
        number = count_of(repeated.total(), "number")
        lines.append(f"Not counted: {number} of a claim that is counted already: {_by_heading(repeated)}.")
    return "\n".join(lines)


def _by_heading(counts: Mapping[str, int]) -> str:
    """How many verdicts stand under each heading that has some."""
    told = ("{} hold", "{} do not hold", "the opposite of {} holds", "{} cannot be tested here")
    sums = (sum(counts.get(name, 0) for name in names) for names in HEADINGS.values())
    return ", ".join(words.format(total) for words, total in zip(told, sums, strict=True) if total)


def unless_text(verdict: Verdict) -> str:
    """Which choice of what the paper leaves open gives another verdict, and which."""
    return "; ".join(f"{choice.reading}: {choice.verdict}" for choice in verdict.unless)


def _notes(verdicts: Sequence[Verdict], shown: Sequence[Verdict]) -> list[str]:
    """What verdicts rest on, and what the words of the table mean."""
    commands = {verdict.evidence.get("run") for verdict in verdicts if verdict.verdict == "not_testable"}
    notes = [f"For more verdicts run {command}." for command in sorted(filter(None, commands))]
    notes += shipped_note(shown)
    if any(verdict.by_choice for verdict in verdicts):
        notes.append(JUDGED_ON)
    if any(verdict.unit == SHARE and verdict.ours is not None for verdict in shown):
        notes.append("'holds on' is the share of the simulated plants on which a claim holds.")
    if any(verdict.borderline for verdict in shown):
        notes.append("* The share or number is so near a limit that more plants could change the verdict.")
    return notes


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
    """Verdicts that changed since those `before`, one a line, and which of today's these do not hold."""
    rows = [f"{name}: {old} -> {new or 'not judged'}" for name, (old, new) in changes.items()]
    lines = ["Changed since the baseline:", *(rows or ["nothing"])]
    absent = [verdict.id for verdict in verdicts if verdict.id not in before]
    if not absent:
        return "\n".join(lines)
    if len(before) <= FEW_NAMES:
        lines.append(f"The baseline holds only {', '.join(before)} of {count_of(len(verdicts), 'verdict')}.")
    else:
        names = ", ".join(absent[:FEW_NAMES]) + (", ..." if len(absent) > FEW_NAMES else "")
        lines.append(f"The baseline lacks {len(absent)} of {count_of(len(verdicts), 'verdict')}: {names}.")
    return "\n".join(lines)


def details_text(verdict: Verdict) -> str:
    """One claim with all its evidence."""
    head = [
        f"{verdict.id} ({verdict.where}): {verdict.printed}{unit_of(verdict)}",
        f"verdict: {verdict.verdict}{_marks(verdict)}",
        f"rule: {verdict.rule} ({verdict.kind}), see docs/verdicts.md",
        f"ours: {_ours(verdict)}",
        *_how_often_wrong(verdict),
        *_of_the_headline(verdict),
        f"depends on: {', '.join(verdict.depends_on) or 'nothing else'}",
        *_under_choices(verdict),
        f"readings with another verdict: {', '.join(verdict.readings_that_change_it) or 'none of those run'}",
    ]
    plain = to_json({"evidence": verdict.evidence})
    rounded = json.loads(plain, parse_float=lambda digits: float(f"{float(digits):.4g}"))
    return "\n".join([*head, dump(rounded).rstrip(), *shipped_note([verdict])])


def _of_the_headline(verdict: Verdict) -> list[str]:
    """Of an order also how often Controller 1 is last, and behind Controller 2."""
    rows = verdict.evidence.get("beside", ())
    last = next((row for row in rows if row["statement"].startswith(f"{FIRST} has the largest")), None)
    if last is None:
        return []
    ahead = verdict.evidence["statements"][0]
    return [
        f"on the same plants: {last['statement']}: {percent(last['share'])}; "
        f"not {ahead['statement']}: {percent(1.0 - ahead['share'])}"
    ]


def _under_choices(verdict: Verdict) -> list[str]:
    """The verdict under each other motion, start and friction that was run, with shares."""
    rows = [
        [
            f"  {choice.reading}",
            choice.verdict,
            _under(verdict, choice.ours),
            _opposite(verdict, choice.opposite).removeprefix(", "),
        ]
        for choice in verdict.by_choice
    ]
    return ["under other motions, starts and friction:", columns(rows)] if rows else []


def _under(verdict: Verdict, value: float | None) -> str:
    """Our share or number under another choice."""
    if value is None:
        return NOTHING
    if verdict.unit != SHARE:
        return f"{value:.4g}{unit_of(verdict)}"
    return f"holds on {percent(value) if value else 'none'}"


def _opposite(verdict: Verdict, share: float | None) -> str:
    """On how many plants the reverse of an order holds."""
    is_order = "reverse" in verdict.evidence.get("opposite", {}).get("statement", "")
    return f", reverse {percent(share)}" if is_order and share is not None else ""


def _ours(verdict: Verdict, *, short: bool = False) -> str:
    """What came out here, and what is printed; a share alone where it is to be `short`."""
    if verdict.ours is None:
        return NOTHING
    if verdict.unit == SHARE:
        opposite = verdict.evidence.get("opposite", {}).get("share")
        share = _under(verdict, verdict.ours) if short else ours(verdict)
        return share + _opposite(verdict, opposite)
    return f"{ours(verdict)}, printed {verdict.printed}{unit_of(verdict)}"


def _how_often_wrong(verdict: Verdict) -> list[str]:
    """How often a right paper has this verdict; made-up papers tell it of a contradiction alone."""
    rate = _rate(verdict)
    told = verdict.verdict == "contradicted" and rate != NOTHING
    return [f"made-up right papers that this rule contradicts: {rate}"] if told else []


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
