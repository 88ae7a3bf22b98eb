"""What pages and stored results say, and Tables 2 and 3 as the shipped configurations give them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import pytest

from support import ROOT
from tendonrepro.configuration.load import load_config
from tendonrepro.console import QUIET
from tendonrepro.experiments.run import begin_all, prepared, trace_file
from tendonrepro.results.paper_tables import table_data

DOCS = ROOT / "docs"
NEEDS_DOCS = pytest.mark.skipif(not DOCS.is_dir(), reason="no docs folder beside the package")
CONTROLLERS = ("controller_1", "controller_2", "controller_3")


def stored(name: str) -> Any:
    """A stored result of docs/results."""
    return json.loads((DOCS / "results" / f"{name}.json").read_text(encoding="utf-8"))


def text_of(page: str) -> str:
    """A page of the checkout, all white space made one."""
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def cells_of(page: str, first: str) -> list[str]:
    """Cells behind the first of the one table row of a page that begins so."""
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|"))
    (cells,) = (cells for cell, *cells in rows if cell == first)
    return cells


def stated(pattern: str, page: str) -> list[float]:
    """Numbers in the groups of a pattern; a space in it stands for any white space of the page."""
    match = re.search(pattern, text_of(page))
    assert match, pattern
    return [float(group.replace("−", "-")) for group in match.groups()]


def tables_of(experiment: Any, *overrides: str) -> Mapping[str, Any]:
    """Tables 2 and 3, and how each run ended, of a shipped experiment that is run now."""
    loaded = load_config(experiment, None, overrides=overrides)
    (traces,) = begin_all([prepared(loaded)], QUIET)
    return table_data(trace_file(loaded, traces, {"created": "2026-01-01T00:00:00+00:00"}))
