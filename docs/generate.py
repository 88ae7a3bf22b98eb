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
from findings_pictures import draw_map
from harvest import take
from pages import fresh
from stored_results import DOCS, nearest, of_joints, stored

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import COMPARED, published
from tendonrepro.configuration.models.readings import GROUPS, KEPT
from tendonrepro.evidence.figure_predictions import draw_predictions
from tendonrepro.identification.figures import draw_edits
from tendonrepro.monte_carlo.shares import printed_ratios
from tendonrepro.reporting import contents
from tendonrepro.reporting.figures import draw_answer, draw_orders
from tendonrepro.reporting.contents import read_shown
from tendonrepro.results.figures.style import Drawing, save_drawing
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.tuning.figure import draw_tuning
from tendonrepro.tuning.bench import LAWS
from tendonrepro.verdicts import words
from tendonrepro.verdicts.ledger import read_ledger

README = DOCS.parent / "README.md"
PAGES = (README, *(DOCS / f"{name}.md" for name in
                  ("findings", "how_often_wrong", "predictions", "recover", "slips", "tables", "theory", "tune")))


def write_pages() -> None:
    """Fill the made parts of the pages, draw the pictures, and describe them where they stand."""
    (DOCS / "results" / "claims.csv").write_text(claims_csv(), encoding="utf-8")
    drawn = pictures()
    for page in (*DOCS.glob("*.md"), README):
        text = page.read_text(encoding="utf-8")
        page.write_text(described(fresh(text, MAKERS) if page in PAGES else text, drawn), encoding="utf-8")
    with TemporaryDirectory() as folder:
        for drawing in drawn.values():
            save_drawing(drawing, Path(folder))
            shutil.copy(Path(folder) / f"{drawing.stem}.png", DOCS)


def claims_csv() -> str:
    """Every claim and number with its verdict, as ``tendonrepro claims`` writes them."""
    return words.claims_table([*read_ledger(stored("claims")).verdicts.values()]).csv()


def pictures() -> dict[str, Drawing]:
    """The pictures of stored results, by name."""
    shown, found, tuned = read_shown(DOCS / "results"), stored("predict"), stored("tune")
    edits = stored("edits")
    drawn = (
        draw_answer(shown),
        draw_orders(shown),
        draw_map(shown, stored("closest")),
        draw_tuning(
            tuned["laws"], {name: law.title for name, law in LAWS.items()}, on=f"{tuned['plants']} plants"
        ),
        draw_predictions(found["experiments"], found["readings"], found["joints"]),
        draw_edits(edits["edits"], edits["ratios"], edits["plants"]),
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
        **of_papers(stored("planted")),
        **of_table_2(),
        "closest": of_closest(),
        "repeats": stored("repeats"),
        "stored": stored,
        "verdicts": verdicts,
    }


def deciding(ranking: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The unknowns that explain most of the variance alone, where that is above chance."""
    floor = ranking["noise_floor"]
    return [row for row in ranking["rows"] if row["index"] > max(row["half_width"], floor)][:3]


def off(misfit: float) -> str:
    """A misfit in per cent; one above 1 is of no stable plant, and NaN where none was drawn."""
    if math.isnan(misfit):
        return "–"
    return f"{100.0 * misfit:.1f} %" if misfit < 1.0 else "none stable"


def extent(rows: Sequence[Mapping[str, Any]], key: str) -> str:
    """The least and the greatest share of some interpretations."""
    return reach([row[key]["share"] for row in rows if row["papers"]])


def reach(shares: Sequence[float]) -> str:
    """The least and the greatest of some shares; a small one counts only as small."""
    ends = (words.percent(end) if end >= 1e-4 else "0 %" for end in (min(shares), max(shares)))
    low, *high = dict.fromkeys(ends)
    return f"{low.removesuffix(' %')} to {high[0]}" if high else low


FILTERS: Mapping[str, Callable[[Any], Any]] = {
    "cell": lambda text: text.replace("|", r"\|"),
    "deciding": deciding,
    "extent": extent,
    "named": words.named,
    "off": off,
    "ours": words.ours,
    "range": reach,
}


def of_searches(found: Mapping[str, Any]) -> dict[str, Any]:
    """Closest plants, the nearest first."""
    draws, bounds = (stored(name)["misfit_log"] for name in ("draws", "bounds"))
    searched = [
        {
            **held,
            **held["searches"][0],
            "name": held["name"],
            "by": {one["search"]: one["misfit_log"] for one in held["searches"]},
            "seen": min(one["seen"] for one in held["searches"]),
            "draw": draws.get(held["name"], math.nan),
            "bound": bounds.get(held["name"], math.nan),
            "of_joints": bool(of_joints([held["name"]])),
        }
        for held in sorted(found["readings"], key=lambda held: held["misfit_log"])
    ]
    return {
        "searched": searched,
        "nearest": {held["name"]: held for held in searched},
    }


ENDS = ("probability", "low", "high")
"""Of an estimator: with all plants, and with some left out."""


def of_tables(given: Mapping[str, Any]) -> dict[str, Any]:
    """How probable a changed equation is, given the tables: by what is compared and by which estimator."""
    ends: dict[str, dict[str, list[float]]] = {}
    for row in given["rows"]:
        kind = "kernel" if row["estimator"].startswith("kernel") else row["estimator"]
        own = ends.setdefault(f"{row['numbers']} {row['compared']}", {}).setdefault(kind, [])
        own += [row[key] for key in ENDS]
    estimators = [*dict.fromkeys(kind for kinds in ends.values() for kind in kinds)]
    cells = {
        compared: [reach(kinds[kind]).removesuffix(" %") if kind in kinds else "" for kind in estimators]
        for compared, kinds in ends.items()
    }
    between, *_, every = (sum(kinds.values(), []) for kinds in ends.values())
    without = given["without_the_nearest"]
    fewer = [row[key] for row in without["rows"] if row["compared"] == given["rows"][-1]["compared"] for key in ENDS]
    return {
        "given": given,
        "estimators": estimators,
        "compared": cells.items(),
        "between": between,
        "all": every,
        "without": without["names"],
        "all_without": fewer,
    }


def of_papers(planted: Mapping[str, Any]) -> dict[str, Any]:
    """Made-up papers: as published by each noise, then those of each group of interpretations."""
    first = [row for row in planted["readings"] if row["noise"] == planted["noise"]]
    papers = [
        (f"the published equations, noise {100 * row['noise']:.0f} %", [row])
        for row in planted["readings"]
        if row["reading"] == PRINTED
    ]
    titles = ("equations kept, a detail unsaid", "other references and starts", "equations changed")
    for title, names in zip(titles, GROUPS.values(), strict=True):
        papers.append((title, [row for row in first if row["reading"] in names and row["reading"] != PRINTED]))
    unsaid = max(row["false_contradicted"]["share"] for row in papers[-3][1] if row["papers"])
    return {"planted": planted, "papers": papers, "unsaid": unsaid}


def of_table_2() -> dict[str, Any]:
    """What the paper's Table 2 has: Controller 1's lead on joint 2, degrees, and by how much 3 errs more than 2, %."""
    first, second = (published().number(f"table2.controller_{k}.mae.joint_2") for k in (1, 2))
    ratios = printed_ratios((1, 2), "rmse", COMPARED)
    mae = [[published().number(f"table2.{run}.mae.joint_{joint}") for joint in COMPARED] for run in CONTROLLERS]
    return {
        "lead": second - first,
        "rmse_3_over_2": tuple(100.0 / ratio - 100.0 for ratio in ratios),
        "paper_mae": mae,
    }


def of_closest() -> dict[str, Any]:
    """The shipped closest arm: its interpretation, its most distant start, degrees, and mean errors by controller."""
    config = load_config("closest", "compare").config
    starts = [run.start_offset.si for run in config.runs.values() if run.start_offset is not None]
    errors = {(row["run"], row["joint"]): row["mae_deg"] for row in stored("closest")}
    return {
        "reading": nearest(stored("identify")["readings"], of_joints(KEPT))["name"],
        "apart_deg": float(np.degrees(np.max(np.abs(starts)))),
        "mae": [[errors[run, joint] for joint in COMPARED] for run in CONTROLLERS],
    }


PARTS = (
    "headline", "facts", "the answer", "what agrees", "what makes the order", "closest plants",
    "repeats", "names by recover", "readings", "claims", "numbers", "deciding unknowns", "tuned", "questions", "what tuning changes", "experiments on starts", "given the tables",
    "planted papers", "the bound", "the least misfits", "every small change",
)  # fmt: skip
"""Parts of pages that are made of stored results; their templates have the same names."""
MAKERS: Mapping[str, Callable[[], str]] = {name: partial(made, name.replace(" ", "_")) for name in PARTS}


if __name__ == "__main__":
    if len(sys.argv) > 1:
        take(Path(sys.argv[1]))
    write_pages()
