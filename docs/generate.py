"""Copy what an ensemble and the ledger found beside this file, and write findings.md and tables.md from it.

``make findings`` runs it after ``tendonrepro ensemble`` and ``tendonrepro claims``. Every number between the
marks in these pages comes from ``docs/results``; a test makes the text again and compares.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from tendonrepro.files import digest_of
from tendonrepro.report import rows
from tendonrepro.report.findings import Results, findings

DOCS = Path(__file__).parent
RESULTS = DOCS / "results"
PAGES = (DOCS / "findings.md", DOCS / "tables.md")
CLOSEST = DOCS.parent / "configs" / "closest.yaml"
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
    for page in PAGES:
        page.write_text(fresh(page.read_text(encoding="utf-8")), encoding="utf-8")


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
    makers = {"the answer": answer, "the closest plant": closest, "all results": generated}
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


def answer() -> str:
    """What a reader should take away, the strongest first."""
    found = Results(stored("ensemble.json"), stored("claims.json"), stored("decides.json"))
    return "\n".join(f"- {line}" for line in findings(found))


def closest() -> str:
    """What the closest plants say together."""
    return rows.together(stored("identify.json"))


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
        table(rows.claims(ledger)),
        "## Number by number",
        table(rows.numbers(ledger)),
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
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports"))
