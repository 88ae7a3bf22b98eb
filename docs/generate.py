"""Write from the stored results what docs are made of: ``python docs/generate.py [REPORTS]``.

``make findings`` runs it after ``tendonrepro ensemble`` and ``tendonrepro claims``. With a folder of reports it takes over
their results first. It writes the made parts of README, findings.md and others, and the pictures of findings.md.
The words of a part are its template in docs/made, or that of the report.
"""

from __future__ import annotations

import math
import re
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from findings_pictures import draw_map, draw_ranges
from harvest import take
from pages import fresh
from stored_results import DOCS, nearest, stored

from tendonrepro.configuration.shown import CHANGED, GROUPS, KEPT
from tendonrepro.evidence.figure_predictions import draw_predictions
from tendonrepro.reporting import contents
from tendonrepro.reporting.figures import draw_orders
from tendonrepro.reporting.readings import read_shown
from tendonrepro.results.figures.style import Drawing, save_drawing
from tendonrepro.tuning.figure import draw_tuning
from tendonrepro.tuning.laws import LAWS
from tendonrepro.verdicts.ledger import read_ledger

README = DOCS.parent / "README.md"
PAGES = (README, DOCS / "findings.md", DOCS / "predictions.md", DOCS / "tables.md", DOCS / "theory.md", DOCS / "tune.md")


def write_pages() -> None:
    """Fill the made parts of the pages, draw the pictures, and describe them where they stand."""
    drawn = pictures()
    for page in (*DOCS.glob("*.md"), README):
        text = page.read_text(encoding="utf-8")
        page.write_text(described(fresh(text, MAKERS) if page in PAGES else text, drawn), encoding="utf-8")
    with TemporaryDirectory() as folder:
        for drawing in drawn.values():
            save_drawing(drawing, Path(folder))
            shutil.copy(Path(folder) / f"{drawing.stem}.png", DOCS)


def pictures() -> dict[str, Drawing]:
    """The pictures of stored results, by name."""
    shown, found, tuned = read_shown(DOCS / "results"), stored("predict"), stored("tune")
    drawn = (
        draw_orders(shown),
        draw_map(shown, stored("closest")),
        draw_ranges(shown),
        draw_tuning(
            tuned["laws"], {name: law.title for name, law in LAWS.items()}, on=f"{tuned['plants']} plants"
        ),
        draw_predictions(found["experiments"], found["readings"], found["joints"]),
    )
    return {drawing.stem: drawing for drawing in drawn}


def described(text: str, drawn: Mapping[str, Drawing]) -> str:
    """A page whose pictures have the first sentence of their captions as the text instead of them."""

    def with_text(picture: re.Match[str]) -> str:
        if picture[2] not in drawn:
            return picture[0]
        sentence, _, _ = drawn[picture[2]].caption.partition(". ")
        return f"![{sentence.rstrip('.')}]({picture[1] or ''}{picture[2]}.png)"

    return re.sub(r"!\[[^\]]*\]\((docs/)?(\w+)\.png\)", with_text, text)


def made(name: str, **known: Any) -> str:
    """A part, from its template in docs/made or the report's, over the stored results, or what else is `known`."""
    shown = read_shown(DOCS / "results")
    return contents.rendered(name, shown, DOCS / "made", filters=FILTERS, **known or context())


def context() -> dict[str, Any]:
    """What templates speak of beside the ensemble: `stored` reads any other result."""
    verdicts = read_ledger(stored("claims")).verdicts.values()
    return {
        **of_searches(stored("identify")),
        **of_tables(stored("given")),
        "laws": LAWS,
        "stored": stored,
        "verdicts": verdicts,
    }


def deciding(ranking: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The unknowns that explain most of the variance alone, where that is above chance."""
    floor = ranking["noise_floor"]
    return [row for row in ranking["rows"] if row["index"] > max(row["half_width"], floor)][:3]


def likely(probability: float) -> str:
    """A probability; of a small one it counts that it is small."""
    return contents.percent(probability) if probability >= 1e-4 else "below 0.01 %"


def off(misfit: float) -> str:
    """A misfit in per cent; one above 1 is of no stable plant."""
    return f"{100.0 * misfit:.1f} %" if misfit < 1.0 else "none stable"


FILTERS: Mapping[str, Callable[[Any], Any]] = {
    "cell": lambda text: text.replace("|", r"\|"),
    "deciding": deciding,
    "likely": likely,
    "named": contents.named,
    "off": off,
    "ours": contents.ours,
}


def of_searches(found: Mapping[str, Any]) -> dict[str, Any]:
    """Closest plants: whether a changed equation is closer than all that keep them, and at what budget."""
    kept, changed = (nearest(found["readings"], names) for names in (KEPT, CHANGED))
    scatter = float(np.std(kept["misfit_by_seed"], ddof=1)) if kept and len(kept["misfit_by_seed"]) > 1 else 0.0
    misfits = {
        (held["name"], held["begun_at"]): off(held["misfit_log"])
        for held in (*found["readings"], *found.get("farther", ()))
    }
    return {
        "identify": found,
        "nearest": {held["name"]: held for held in found["readings"]},
        "kept": kept,
        "changed": changed,
        "closer": bool(kept and changed and changed["misfit_log"] < kept["misfit_log"] - scatter),
        "scatter": scatter,
        "begun": lambda name, place: misfits.get((name, place), ""),
    }


def of_groups(given: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Interpretations of each group, their probability, and the share of their plants that is named as one of them."""
    plants, confused = np.array(given["plants"]), np.array(given["confused"])
    found = []
    for title, names in GROUPS.items():
        own = np.array([name in names for name in given["names"]])
        right = np.average(confused[own][:, own].sum(axis=1), weights=plants[own]) if own.any() else math.nan
        together = float(np.array(given["probability"])[own].sum())
        found.append({"title": title, "count": int(own.sum()), "probability": together, "right": float(right)})
    return found


def of_tables(given: Mapping[str, Any]) -> dict[str, Any]:
    """The probability of each interpretation and group, given the tables, and how well such a naming does."""
    columns = zip(given["names"], given["plants"], given["probability"], np.diag(given["confused"]), strict=True)
    keys = ("name", "plants", "probability", "right")
    named = sorted((dict(zip(keys, row, strict=True)) for row in columns), key=lambda row: -row["probability"])
    groups = of_groups(given)
    return {
        "given": given,
        "named": named,
        "probable": max(named, key=lambda row: (row["probability"], row["name"])),
        "groups": groups,
        "group": max(groups, key=lambda group: group["probability"]),
    }


PARTS = (
    "the headline", "what it depends on", "the answer", "why", "robustness", "the closest", "closest plants", "readings",
    "claims", "numbers", "deciding unknowns", "questions", "at their best", "experiments on starts", "given the tables",
    "the bound", "the least misfits",
)  # fmt: skip
"""Parts of pages that are made of stored results; their templates have the same names."""
MAKERS: Mapping[str, Callable[[], str]] = {name: partial(made, name.replace(" ", "_")) for name in PARTS}


if __name__ == "__main__":
    if len(sys.argv) > 1:
        take(Path(sys.argv[1]))
    write_pages()
