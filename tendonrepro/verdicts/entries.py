"""The types of ``claims.json``."""

from __future__ import annotations

from typing import TypedDict

from tendonrepro.verdicts.rules import Evidence


class Choice(TypedDict):
    """The verdict under another choice, and our share or number under it."""

    reading: str
    verdict: str
    ours: float | None


class Entry(TypedDict):
    """A claim in ``claims.json``."""

    id: str
    where: str
    kind: str
    printed: str
    ours: float | None
    unit: str | None
    rule: str
    verdict: str
    borderline: bool
    evidence: Evidence
    depends_on: list[str]
    readings_that_change_it: list[str]
    repeats: str | None
    shipped: bool
    by_choice: list[Choice]


class Origin(TypedDict):
    """Which ensemble judged the claims."""

    source: str
    draws: int
    tendonrepro_version: str
    created: str
    rules_edition: int


class Ledger(TypedDict):
    """``claims.json``."""

    schema_version: int
    claims: list[Entry]
    summary: dict[str, int]
    ensemble: Origin
