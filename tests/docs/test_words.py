"""Pages stay short: a new sentence replaces one, or stands on the page that is about it."""

from __future__ import annotations

import pytest
from support import ROOT
from support.pages import DOCS, NEEDS_DOCS

pytestmark = NEEDS_DOCS

LIMITS = {
    "README.md": 450,
    "architecture.md": 2_580,
    "assumptions.md": 1_880,
    "cli.md": 1_050,
    "configs.md": 1_840,
    "dataset.md": 1_550,
    "findings.md": 1_300,
    "how_often_wrong.md": 770,
    "index.md": 130,
    "notation.md": 1_450,
    "own_arm.md": 800,
    "predictions.md": 1_010,
    "python.md": 1_500,
    "recover.md": 560,
    "results.md": 2_370,
    "slips.md": 1_860,
    "tables.md": 1_250,
    "theory.md": 1_450,
    "tune.md": 810,
    "tutorial.md": 1_220,
    "verdicts.md": 2_300,
}
"""Most words of each page, made parts and tables included."""

WORDS = {
    path.name: len(path.read_text(encoding="utf-8").split())
    for path in (ROOT / "README.md", *DOCS.glob("*.md"))
    if path.exists()
}


def test_every_page_has_a_limit() -> None:
    assert WORDS.keys() == LIMITS.keys()


@pytest.mark.parametrize("page", LIMITS)
def test_page_is_within_its_limit(page: str) -> None:
    assert WORDS[page] <= LIMITS[page]


def test_all_pages_together_are_within_theirs() -> None:
    assert sum(WORDS.values()) <= 28_000
