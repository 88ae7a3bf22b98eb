"""Copy what an ensemble and the ledger found beside this file, and write findings.md and tables.md from it.

``make findings`` runs it after ``tendonrepro ensemble`` and ``tendonrepro claims``. Every number between the
marks in these pages comes from ``docs/results``; a test makes the text again and compares.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tendonrepro.files import digest_of
from tendonrepro.report import rows
from tendonrepro.report.answer import filled, numbers as slots, percent
from tendonrepro.report.figure_orders import draw_orders
from tendonrepro.report.orders import HEADS, robustness
from tendonrepro.results.figures.style import save_drawing

DOCS = Path(__file__).parent
RESULTS = DOCS / "results"
PAGES = (DOCS / "findings.md", DOCS / "tables.md")
CLOSEST = DOCS.parent / "configs" / "closest.yaml"
CLAIMS = (
    *("C1", "C2", "F1", "C3", "C4", "C5", "C6", "P1", "E1", "E1a", "E2", "E2a", "E3", "L1", "T1"),
    *("K1", "K2", "K2a", "K2b", "K3", "K4", "K5", "K6", "A1"),
)
"""Claims in the order in which they are shown."""
PART = re.compile(r"(<!-- made by generate.py: ([a-z ]+) -->\n).*?(<!-- end -->)", re.S)


def main(reports: Path) -> None:
    """Take results over from a reports folder and rewrite the pages."""
    RESULTS.mkdir(exist_ok=True)
    summary = json.loads((reports / "ensemble" / "summary.json").read_text(encoding="utf-8"))
    ledger = json.loads((reports / "claims" / "claims.json").read_text(encoding="utf-8"))
    if (ledger.get("ensemble") or {}).get("source") != "local":
        sys.exit("these verdicts are the shipped ones; run tendonrepro claims again, beside the ensemble")
    _store("ensemble.json", rows.thinned(summary))
    ledger = _rounded(ledger)
    _store("claims.json", ledger | {"sha256": digest_of(ledger)})
    decides = json.loads((reports / "claims" / "decides.json").read_text(encoding="utf-8"))
    _store("decides.json", rows.thinned_decides(decides))
    if (reports / "identify_all").exists():
        take_closest(reports / "identify_all")
    write_pages()


def write_pages() -> None:
    """Fill the made parts of the pages, and draw the picture of the orders."""
    for page in PAGES:
        page.write_text(fresh(page.read_text(encoding="utf-8")), encoding="utf-8")
    with TemporaryDirectory() as folder:
        save_drawing(draw_orders(stored("ensemble.json")), Path(folder))
        shutil.copy(Path(folder) / "orders.png", DOCS / "orders.png")


def take_closest(folder: Path) -> None:
    """Add what `tendonrepro identify --fit all` found to what is stored, and ship the best plant of all."""
    found = rows.thinned_closest(json.loads((folder / "identify.json").read_text(encoding="utf-8")))
    fresh = {reading["name"]: reading for reading in found["readings"]}
    readings = {reading["name"]: reading for reading in stored("identify.json")["readings"]} | fresh
    _store("identify.json", found | {"readings": list(readings.values())})
    if min(readings.values(), key=lambda reading: reading["misfit_log"])["name"] in fresh:
        text = (folder / "identified.yaml").read_text(encoding="utf-8")
        CLOSEST.write_text(f"# yaml-language-server: $schema=schema.json\n#\n{text}", encoding="utf-8")


def fresh(text: str) -> str:
    """A page with its made parts made again."""
    values = slots(stored("ensemble.json"), stored("claims.json"))
    makers = {
        "the answer": lambda: filled("answer", values),
        "why": lambda: filled("why", values),
        "robustness": lambda: table(rows.Table(HEADS, robustness(stored("ensemble.json")))),
        "all results": generated,
    }
    return PART.sub(lambda part: f"{part[1]}\n{makers[part[2]]().strip()}\n\n{part[3]}", text)


def _store(name: str, content: Any) -> None:
    text = json.dumps(_rounded(content), indent=1, ensure_ascii=False) + "\n"
    (RESULTS / name).write_text(text, encoding="utf-8")


def _rounded(content: Any) -> Any:
    """Six digits are more than any of these numbers is worth, and keep the file small."""
    if isinstance(content, dict):
        return {key: _rounded(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_rounded(value) for value in content]
    return float(f"{content:.6g}") if isinstance(content, float) else content


def stored(name: str) -> Any:
    """Stored results."""
    return json.loads((RESULTS / name).read_text(encoding="utf-8"))


def claims(ledger: Mapping[str, Any]) -> rows.Table:
    """Claims, the most discussed first."""
    entries = {entry["id"]: entry for entry in ledger["claims"]}
    lines = []
    for name in [name for name in CLAIMS if name in entries]:
        entry = entries[name]
        others = entry["readings_that_change_it"]
        more = f" and {len(others) - 4} more" if others[4:] else ""
        shown = ", ".join(f"`{other}`" for other in others[:4]) + more
        mark = " (borderline)" if entry["borderline"] else ""
        lines.append((name, entry["printed"], f"`{entry['verdict']}`{mark}", holds_on(entry), shown or "–"))
    about = (
        "`contradicted` is about the equations and not about the measurement: the paper measured hardware."
    )
    return rows.Table(["claim", "printed", "verdict", "holds on", "readings with another verdict"], lines, about)


def holds_on(entry: Mapping[str, Any]) -> str:
    """On which share of the plants a claim holds, by which measure, and on how much by the others."""
    evidence = entry["evidence"]
    share, best, measures = evidence.get("share"), evidence.get("measure"), evidence.get("by_measure", ())
    text = percent(share) if isinstance(share, float | int) else "–"
    if not measures:
        return text
    others = ", ".join(
        f"{row['measure']} {percent(row['share'])}" for row in measures if row["measure"] != best
    )
    return f"{text} by {best}; {others}"


def numbers(ledger: Mapping[str, Any]) -> rows.Table:
    """How many numbers of each table have which verdict, and what else would have passed."""
    families: dict[str, list[Mapping[str, Any]]] = {}
    for entry in ledger["claims"]:
        if entry["id"] not in CLAIMS:
            families.setdefault(entry["id"].partition(".")[0], []).append(entry)
    lines = [(family, _counted(held), _also_passing(held)) for family, held in families.items()]
    about = (
        "Would also pass: how much of the decade around the printed value lies inside the central 90 % of the plants too, over "
        "the numbers of that family; 0 means that no other number would have been inside, 100 % that being inside says nothing."
    )
    return rows.Table(("numbers", "verdicts", "would also pass"), lines, about)


def _counted(entries: Sequence[Mapping[str, Any]]) -> str:
    names = Counter(f"`{entry['verdict']}`{' (borderline)' * entry['borderline']}" for entry in entries)
    return ", ".join(f"{count} {name}" for name, count in names.items())


def _also_passing(entries: Sequence[Mapping[str, Any]]) -> str:
    power = [entry["evidence"].get("also_passing") for entry in entries]
    known = [share for share in power if share is not None]
    return f"{percent(min(known))} to {percent(max(known))}" if known else "–"


def generated() -> str:
    """All stored results as tables."""
    summary, ledger = stored("ensemble.json"), stored("claims.json")
    parts = [
        rows.head(summary),
        "## In sentences",
        "\n".join(f"- {line}" for line in summary["conclusions"]),
        "## Reading by reading",
        table(rows.readings(summary)),
        "## Claim by claim",
        table(claims(ledger)),
        "## Number by number",
        table(numbers(ledger)),
        "## Which unknowns decide",
        table(rows.decides(stored("decides.json"))),
        "## The closest plants",
        table(rows.closest(stored("identify.json"))),
    ]
    return "\n\n".join(parts) + "\n"


def table(held: rows.Table) -> str:
    """Pipe table, and below it what has to be known to read it."""
    lines = [f"| {' | '.join(cells)} |" for cells in (held.heads, *held.rows)]
    text = "\n".join([lines[0], "|---" * len(held.heads) + "|", *lines[1:]])
    return f"{text}\n\n{held.about}" if held.about else text


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        write_pages()
