"""What the report says, and findings.md and tables.md too: the answer, claims in words, what is assumed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.shown import BOTH, FINE_STEPS, SHOWN, STEPS, every_run
from tendonrepro.configuration.strict_yaml import Node
from tendonrepro.evidence.figure_predictions import interpretation_in_words
from tendonrepro.monte_carlo.summary import ReadingSummary, Summary, in_all_errors, median
from tendonrepro.verdicts.judge import SHARE
from tendonrepro.verdicts.report import number_in_words
from tendonrepro.verdicts.rules import VERDICTS
from tendonrepro.verdicts.verdict import Verdict

TEMPLATES = Path(__file__).with_name("templates")

ROBUSTNESS_HEADS = (
    "interpretation",
    "plants",
    "published order",
    "Controller 1 first",
    "Controller 1 last",
    "… without the first 2 s",
    "error 1 / 2",
)
"""Heads of `robustness`; the last is the median ratio of the MAE of Controllers 1 and 2 on joint 2."""

BOX_HEADS = ("Row", "Range or choices", "Nominal", "Unit", "Scale", "Confidence", "From")
VALUE_HEADS = ("Key", "Value", "Unit", "Origin", "Why")
"""Heads of `box_rows` and `value_rows`."""

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


def by_name(summary: Summary, population: str = "box") -> dict[str, ReadingSummary]:
    """Readings of an ensemble by their names."""
    return {reading["name"]: reading for reading in summary["populations"][population]["readings"]}


OF_ANSWER = {
    "printed": "printed",
    "absent": "reference_acceleration=absent",
    "ramp": "motion=ramp",
    "apart": "starts=apart",
    "apart_absent": "reference_acceleration=absent+starts=apart",
    "apart_ramp": "motion=ramp+starts=apart",
    "friction": "run_friction=drawn",
    "steps": STEPS,
    "both": BOTH,
    "changed_ramp": "weights=extrapolating+motion=ramp+starts=apart",
}
"""Ends of the slots of the answer's table, and the readings of its rows."""


def numbers(summary: Summary) -> dict[str, str]:
    """Numbers of the answer as text, and its conditions, by slot."""
    readings, printed = by_name(summary), by_name(summary)["printed"]
    slots = {
        "conditions": f"Every run {every_run()}.",
        "first_fine": percent(in_all_errors(readings[FINE_STEPS]["share_c1_best"])["share"]),
        "tie": percent(in_all_errors(printed["share_c2_ties_c3"])["share"]),
        "plants": f"{summary['populations']['box']['plants']:,}",
        "stable": f"{stable_plants(printed):,}",
        "stable_share": percent(stable_plants(printed) / summary["populations"]["box"]["plants"]),
        "ratio": two_digits(median(printed["ratio_c1_c2"], 2)),
        "ratio_absent": two_digits(median(readings["reference_acceleration=absent"]["ratio_c1_c2"], 2)),
        "ratio_surfaces": two_digits(median(printed["ratio_c2_c3"], 2)),
        "ratio_degrees": two_digits(median(readings["Delta_unit=deg"]["ratio_c2_c3"], 2)),
    }
    for row, name in OF_ANSWER.items():
        reading, late = readings[name], readings[name]["without_start"]
        shares = {
            "order": in_all_errors(reading["share_c1_lt_c2_lt_c3"]),
            "first": in_all_errors(reading["share_c1_best"]),
            "last": in_all_errors(reading["share_c1_worst"]),
            "late": in_all_errors(late["share_c1_worst"]),
            "behind": reading["share_c2_lt_c1"]["all_ok"]["mae"]["joint_2"],
            "behind_late": late["share_c2_lt_c1"]["all_ok"]["mae"]["joint_2"],
            "smooth": reading["share_c1_smoother"],
        }
        slots |= {f"{column}_{row}": percent(share["share"]) for column, share in shares.items()}
    return slots


def stable_plants(reading: ReadingSummary) -> int:
    """How many plants are stable under all three controllers."""
    return in_all_errors(reading["share_c1_lt_c2_lt_c3"])["plants"]


def filled(name: str, values: Mapping[str, str]) -> str:
    """Text of a template, ``headline``, ``answer`` or ``why``, with its slots filled."""
    return (TEMPLATES / f"{name}.md").read_text(encoding="utf-8").format_map(values).strip()


def labelled(summary: Summary, labels: Mapping[str, str]) -> list[tuple[str, ReadingSummary]]:
    """Labels and readings, where the ensemble has the reading."""
    stored = by_name(summary)
    return [(label, stored[name]) for name, label in labels.items() if name in stored]


def robustness(summary: Summary) -> list[tuple[str, ...]]:
    """Rows of the table that says what the answer depends on."""
    (label, printed), *others = labelled(summary, SHOWN)
    last = ("… diverged controllers ranked last", *_shares(printed, "diverged_last"), "–", "–")
    rows = [_cells(label, printed), last]
    if "firm" in summary["populations"]:
        rows.append(_cells("… better known parameters alone varied", by_name(summary, "firm")["printed"]))
    return rows + [_cells(label, reading) for label, reading in others]


def _cells(label: str, reading: ReadingSummary) -> tuple[str, ...]:
    late = in_all_errors(reading["without_start"]["share_c1_worst"])["share"]
    return label, *_shares(reading, "all_ok"), percent(late), two_digits(median(reading["ratio_c1_c2"], 2))


def _shares(reading: ReadingSummary, plants: str) -> tuple[str, ...]:
    """How many plants of a set there are, and the shares on which the published order, or a place, holds."""
    rankings = (reading[name] for name in ("share_c1_lt_c2_lt_c3", "share_c1_best", "share_c1_worst"))
    order, best, worst = (in_all_errors(ranking, plants) for ranking in rankings)
    return f"{order['plants']:,}", *(percent(ranking["share"]) for ranking in (order, best, worst))


def two_digits(ratio: float | None) -> str:
    """A ratio, if there are plants.

    Examples
    --------
    >>> two_digits(1.1006), two_digits(None)
    ('1.10', '–')
    """
    return "–" if ratio is None else f"{ratio:.2f}"


def percent(share: float | None) -> str:
    """Share in per cent, two digits of a small one; only all of it is 100 %.

    Examples
    --------
    >>> percent(0.8917), percent(0.0085), percent(0.0), percent(None), percent(0.9997), percent(0.999999)
    ('89 %', '0.85 %', '0 %', '–', '99.97 %', 'over 99.99 %')
    """
    if share is None:
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
    return statement_in_words(f"{number_in_words(judged.id)}: {judged.printed}{_unit(judged)}")


def _unit(judged: Verdict) -> str:
    return _UNITS.get(judged.unit or "", "")


def ours(judged: Verdict) -> str:
    """What came out here."""
    evidence, value, unit = judged.evidence, judged.ours, _unit(judged)
    if evidence.get("missing"):
        return statement_in_words(f"missing: {evidence['missing']}")
    if judged.unit == SHARE and value is not None:
        favoured = ", by the measure that favours it most" if len(evidence.get("by_measure", ())) > 1 else ""
        return f"holds on {percent(value)} of {evidence['plants']:,} plants{favoured}"
    if box := evidence.get("box"):
        low, high = (f"{box[key]:.3g}".replace("-", "−") for key in ("low", "high"))
        return f"median {box['median']:.3g}{unit}, central 90 % {low} to {high}{unit}"
    if value is None:
        return "yes" if judged.verdict in {"exact", "reproduced"} else "–"
    return f"{value:.4g}{unit}"


def unless(judged: Verdict) -> str:
    """Motions and starts under which the verdict is another one, and which, for a reader."""
    return "; ".join(
        f"{interpretation_in_words(choice.reading)}: {VERDICTS[choice.verdict]}" for choice in judged.unless
    )


def statement_in_words(statement: str) -> str:
    """A statement with symbols and words for the program's names."""
    for name, word in _WORDS.items():
        statement = re.sub(rf"(?<![A-Za-z]){name}", word, statement)
    return statement


def statements(judged: Verdict) -> list[tuple[str, str]]:
    """Parts of a claim, and the share of plants on which each holds."""
    evidence = judged.evidence
    parts = [*evidence.get("statements", ()), evidence.get("direction"), evidence.get("opposite")]
    return [(statement_in_words(part["statement"]), percent(part["share"])) for part in parts if part]


def box_rows() -> Iterator[tuple[str, ...]]:
    """Yield the ranges that plants are drawn from, from the shipped ensemble, as `BOX_HEADS`."""
    for name, row in load_ensemble(None).config.box:
        entry = {"unit": "–", "scale": "choice"} | row.model_dump()
        extent = ", ".join(map(_short, entry.get("choices", ()))) or f"{entry['low']:g} to {entry['high']:g}"
        texts = [entry[key] for key in ("unit", "scale", "confidence", "source")]
        yield f"`{name}`", extent, _short(entry["nominal"]), *texts


def _short(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def quantities(tree: Node, path: tuple[str, ...] = ()) -> Iterator[tuple[str, dict[str, Node]]]:
    """Quantities of a configuration by their keys."""
    if isinstance(tree, dict) and {"value", "unit", "source"} <= tree.keys():
        yield ".".join(path), tree
    elif isinstance(tree, dict):
        for key, value in tree.items():
            yield from quantities(value, (*path, str(key)))


def value_rows(trees: Sequence[Node]) -> list[tuple[str, ...]]:
    """Quantities of some configurations, as `VALUE_HEADS`; of each key the first."""
    first: dict[str, dict[str, Node]] = {}
    for key, quantity in (pair for tree in trees for pair in quantities(tree)):
        first.setdefault(key, quantity)
    rows: list[tuple[str, ...]] = []
    for key, quantity in first.items():
        origin, _, why = str(quantity["source"]).partition(": ")
        rows.append((f"`{key}`", json.dumps(quantity["value"]), str(quantity["unit"]), origin, why))
    return rows
