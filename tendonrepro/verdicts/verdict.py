"""A verdict, and the ledger: all verdicts, and which ensemble judged them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TypedDict

from tendonrepro.files import Json
from tendonrepro.verdicts.rules import Evidence


@dataclass(frozen=True)
class ByChoice:
    """A verdict under another choice of what the paper leaves open, and our share or number under it."""

    reading: str
    verdict: str
    ours: float | None


@dataclass(frozen=True)
class Verdict:
    """One line of the ledger; its fields are the keys of ``claims.json``.

    `ours` is a claim's share, or the number of the nominal run, else its median over the box. What `repeats`
    another entry is not counted. `shipped` is from the package's ensemble. `by_choice` has the verdict under
    each other choice of motion, starts, reference and friction of a run that was run.
    """

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
    depends_on: tuple[str, ...]
    readings_that_change_it: tuple[str, ...]
    repeats: str | None = None
    shipped: bool = False
    by_choice: tuple[ByChoice, ...] = ()

    @property
    def is_shown(self) -> bool:
        """Whether a page shows it: it counts, or it is a number over the plants that counts with a claim."""
        return self.repeats is None or self.kind == "ensemble"

    @property
    def unless(self) -> tuple[ByChoice, ...]:
        """Choices with another verdict, each with no more in it than that takes; `not_testable` is none."""
        changing = [
            choice for choice in self.by_choice if choice.verdict not in {self.verdict, "not_testable"}
        ]
        settings = {choice.reading: set(choice.reading.split("+")) for choice in changing}
        return tuple(
            choice
            for choice in changing
            if not any(fewer < settings[choice.reading] for fewer in settings.values())
        )


class Origin(TypedDict):
    """Which ensemble judged the claims."""

    source: str
    draws: int
    tendonrepro_version: str
    created: str
    rules_edition: int


@dataclass(frozen=True)
class Ledger:
    """Verdicts by their ids, and which ensemble judged."""

    verdicts: Mapping[str, Verdict]
    ensemble: Origin


def read_ledger(content: Json) -> Ledger:
    """Ledger from what ``claims.json`` holds, of an earlier version too."""
    verdicts = map(_read_verdict, content["claims"])
    return Ledger({verdict.id: verdict for verdict in verdicts}, content["ensemble"])


def _read_verdict(entry: Json) -> Verdict:
    known = {field.name: entry[field.name] for field in fields(Verdict) if field.name in entry}
    lists = {name: tuple(known[name]) for name in ("depends_on", "readings_that_change_it")}
    choices = tuple(ByChoice(**choice) for choice in entry.get("by_choice", ()))
    return Verdict(**(known | lists | {"by_choice": choices}))
