"""A verdict, as it stands in the ledger."""

from __future__ import annotations

from dataclasses import dataclass

from tendonrepro.verdicts.rules import Evidence


@dataclass(frozen=True)
class ByChoice:
    """A verdict under another choice of what the paper leaves open, and our share or number under it.

    `opposite` is the share of plants on which the opposite of a claim holds.
    """

    reading: str
    verdict: str
    ours: float | None
    opposite: float | None = None


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
