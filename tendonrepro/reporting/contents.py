"""What the report says, and findings.md and tables.md too: the answer, claims in words, what is assumed."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.shown import SHOWN, every_run, in_words
from tendonrepro.configuration.strict_yaml import Node
from tendonrepro.reporting.readings import Shown
from tendonrepro.verdicts.ledger import SHARE, Verdict
from tendonrepro.verdicts.report import number_in_words
from tendonrepro.verdicts.rules import VERDICTS

TEMPLATES = Path(__file__).with_name("templates")
WORDS = ("headline", "answer", "why", "robustness")
"""Templates of what is said of an ensemble."""

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


def environment(*folders: Path, html: bool = False) -> jinja2.Environment:
    """Read templates of folders, and those of the report, with filters for shares, ratios and counts."""
    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, TEMPLATES]),
        undefined=jinja2.StrictUndefined,
        autoescape=html,
        trim_blocks=True,
    )
    made.filters |= {"thousands": "{:,.0f}".format, "percent": percent, "ratio": two_digits}
    return made


def rendered(
    name: str,
    shown: Shown,
    *folders: Path,
    filters: Mapping[str, Callable[..., object]] | None = None,
    **known: object,
) -> str:
    """Text of a template over the rows of an ensemble, one of `WORDS` or of other folders."""
    templates = environment(*folders)
    templates.filters |= filters or {}
    known |= {"r": shown.box, "drawn": shown.plants["box"]}
    known |= {"labels": SHOWN, "conditions": conditions_in_words()}
    return templates.get_template(f"{name}.md").render(**known).strip()


def has_all_words(shown: Shown) -> bool:
    """Whether an ensemble has every interpretation that `WORDS` speak of."""
    try:
        return all(rendered(name, shown) for name in WORDS)
    except jinja2.UndefinedError:
        return False


def conditions_in_words() -> str:
    """What every run does as published."""
    return f"Every run {every_run()}."


def cells_of(table: str) -> list[list[str]]:
    """Cells of a pipe table, its heads first."""
    heads, _, *rows = table.splitlines()
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in (heads, *rows)]


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
