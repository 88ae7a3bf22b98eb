"""Claims, numbers and verdicts in words: on pages, in tables, in the terminal."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from tendonrepro.configuration.models.readings import EVERY_RUN, in_words
from tendonrepro.configuration.published import published
from tendonrepro.configuration.strict_yaml import dump
from tendonrepro.console import columns, count_of
from tendonrepro.files import to_json
from tendonrepro.results.tables import NOTHING, Table
from tendonrepro.verdicts.ledger import SHARE, Verdict, summary
from tendonrepro.verdicts.rules import HEADINGS, VERDICTS

_NUMBERS = {
    "table1": "ratio of diameters",
    "table2": "error",
    "table3": "error",
    "S_inv": "inverse coupling matrix S⁻¹",
    "S": "coupling matrix S",
    "rmse_over_mae": "RMSE over MAE",
    "joints": "joint 3 over joint 2",
    "dose": "gain of Controller 1 on joint 3 over joint 2",
    "share": "error in per cent of another controller's",
    "increase": "change of Controller 1's error",
    "mae": "MAE",
    "rmse": "RMSE",
}

_UNITS = {"%": " %", "deg": "°"}
_WORDS = {
    "@sampling_period=([.0-9]+)ms": r" at L = \1 ms",
    "@M_bar=halved": " with half M̄",
    "(controller_1_|Controller 1 )payload": "Controller 1 with payload",
    "controller_": "Controller ",
    "is ok\\b": "is stable",
    "as printed": "as published",
    "t - 2L": "t − 2L",
    "epsilon": "ε",
    "H_hat": "Ĥ",
    "M_bar": "M̄",
    "gamma_": "γ",
    "Omega": "Ω",
    "alpha": "α",
    "phi": "φ",
    "Delta": "Δ",
    "D_(in|n)": r"D \1",
}
"""What stands in a claim or statement, and what a reader sees."""


def claim_in_words(identifier: str) -> str:
    """A claim in few words, or what a number is of."""
    return published().entries[identifier].short or number_in_words(identifier)


def number_in_words(identifier: str) -> str:
    """What a number is of: error, run and joint."""
    parts = identifier.split(".")
    words = [_NUMBERS.get(part) or part.replace("_over_", "/").replace("_", " ") for part in parts]
    return ", ".join(words).replace("controller", "Controller")


def two_digits(ratio: float | None) -> str:
    """A ratio, if there are plants.

    Examples
    --------
    >>> two_digits(1.1006), two_digits(math.nan)
    ('1.10', '–')
    """
    return "–" if ratio is None or math.isnan(ratio) else f"{ratio:.2f}"


def percent(share: float | None) -> str:
    """Share in per cent, two digits of a small one; only all of it is 100 %.

    Examples
    --------
    >>> percent(0.8917), percent(0.0085), percent(0.0), percent(None), percent(0.9997), percent(0.999999)
    ('89 %', '0.85 %', '0 %', '–', '99.97 %', 'over 99.99 %')
    """
    if share is None or math.isnan(share):
        return "–"
    value = 100.0 * share
    if 99.5 <= value < 100.0:
        texts = (f"{value:.{digits}g} %" for digits in (3, 4))
        return next((text for text in texts if text != "100 %"), "over 99.99 %")
    return f"{value:.0f} %" if value >= 10.0 or value == 0.0 else f"{value:.2g} %"


def named(judged: Verdict) -> str:
    """A claim in its words; a number by its name and value."""
    if "." not in judged.id:
        return statement_in_words(judged.printed)
    return statement_in_words(f"{number_in_words(judged.id)}: {judged.printed}{unit_of(judged)}")


def unit_of(judged: Verdict) -> str:
    """The unit as it follows a number; none of a share, a plain number, or a fraction of two lengths."""
    if judged.unit in {None, SHARE, "1"} or "/" in judged.printed:
        return ""
    return _UNITS.get(judged.unit or "", f" {judged.unit}")


def ours(judged: Verdict) -> str:
    """What came out here."""
    evidence, value, unit = judged.evidence, judged.ours, unit_of(judged)
    if evidence.get("missing"):
        return statement_in_words(f"missing: {evidence['missing']}")
    if judged.unit == SHARE and value is not None:
        return statement_in_words(_share_in_words(evidence, value))
    if box := evidence.get("box"):
        low, high = (f"{box[key]:.3g}".replace("-", "−") for key in ("low", "high"))
        return f"median {box['median']:.3g}{unit}, central 90 % {low} to {high}{unit}"
    if value is None:
        return "yes" if judged.verdict in {"exact", "reproduced"} else "–"
    return f"{value:.4g}{unit}"


def _share_in_words(evidence: Mapping[str, Any], share: float) -> str:
    """Say on how many plants a claim holds, by each measure; of none the most that it can be."""
    plants = f"of {evidence['plants']:,} plants"
    measured = evidence.get("by_measure", ())
    if len(measured) > 1:
        first, *others = (f"{percent(row['share'])} {{}}by {row['measure']}" for row in measured)
        return ", ".join([f"holds on {first.format(plants + ' ')}", *(other.format("") for other in others)])
    if share == 0.0:
        return f"holds on none {plants}, at most {percent(evidence['interval'][1])}"
    return f"holds on {percent(share)} {plants}"


def unless(judged: Verdict) -> str:
    """Motions and starts under which the verdict is another one, and which, for a reader."""
    return "; ".join(f"{in_words(choice.reading)}: {VERDICTS[choice.verdict]}" for choice in judged.unless)


def statement_in_words(statement: str) -> str:
    """A statement with symbols and words for the program's names."""
    for name, word in _WORDS.items():
        statement = re.sub(rf"(?<![A-Za-z]){name}", word, statement)
    return statement


def statements(judged: Verdict) -> list[tuple[str, str]]:
    """Parts of a claim, and the share of plants on which each holds, or whether it does on measured data."""
    evidence = judged.evidence
    parts = [*evidence.get("statements", ()), evidence.get("direction"), evidence.get("opposite")]
    return [(statement_in_words(part["statement"]), _holds_on(part)) for part in parts if part]


def _holds_on(part: Mapping[str, Any]) -> str:
    if "share" in part:
        return percent(part["share"])
    return "measured data" if part["holds"] else "not on measured data"


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
        f"{created.partition('T')[0]}). tendonrepro ensemble makes an ensemble of your own."
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
