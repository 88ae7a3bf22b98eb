"""Tables 2 and 3 from measured errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import METRICS, Published, rounding, row_of
from tendonrepro.console import count_of
from tendonrepro.physics.metrics import windows
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import sizes_deg

NUMBERS = 16
"""Numbers that Table 2 and the loaded row of Table 3 print."""
SPREAD = 0.1
"""Share of the printed number within which the chance remark takes errors to lie."""


class Timing(NamedTuple):
    """Start of the motion in a run's time, and period, s; 0 if unknown."""

    start: float
    period: float


@dataclass(frozen=True)
class Tried:
    """One way of averaging, the same for all runs.

    `sizes` are MAE and RMSE, deg, by id, over one of `spans`; with `offset_removed` after the error's mean is
    taken off. `agree` are the ids of printed numbers that they give.
    """

    window: str
    offset_removed: bool
    sizes: Mapping[str, float]
    agree: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name for a reader."""
        return f"{self.window}, offset removed" if self.offset_removed else self.window


@dataclass(frozen=True)
class PrintedTables:
    """All ways of averaging, the whole motion as it is first; without more, that nothing can be compared.

    `left_out` counts missing samples by run; `chance` is that of as many agreements by accident in as many
    tries. `held` names all runs of the file.
    """

    tried: tuple[Tried, ...] = (Tried("whole", False, {}, ()),)
    left_out: Mapping[str, int] = field(default_factory=dict)
    chance: float = 1.0
    held: tuple[str, ...] = ()

    @property
    def compared(self) -> int:
        """Printed numbers that the file has."""
        return len(self.tried[0].sizes)

    @property
    def best(self) -> Tried:
        """The first with most agreements."""
        return max(self.tried, key=lambda tried: len(tried.agree))

    @property
    def winner(self) -> Tried | None:
        """The first that gives all these numbers."""
        return self.best if 0 < self.compared == len(self.best.agree) else None

    @property
    def deciding(self) -> Tried:
        """The winner, else the whole motion."""
        return self.winner or self.tried[0]

    @property
    def window(self) -> str | None:
        """What decides; None without a run of the tables."""
        return self.deciding.name if self.compared else None

    def as_dict(self) -> dict[str, object]:
        """Plain data."""
        return {
            "tried": len(self.tried),
            "compared": self.compared,
            "printed": NUMBERS,
            "winner": self.winner and self.winner.name,
            "best": self.best.name,
            "best_agree": len(self.best.agree),
            "chance": self.chance,
            "left_out": dict(self.left_out),
            "remark": self.remark(),
        }

    def remark(self) -> str:
        """What was found, and what it is worth."""
        if not self.compared:
            return (
                f"The file holds no errors of a run of Tables 2 and 3, called {', '.join(RUNS)}. "
                f"Its runs are called {', '.join(self.held)}. The mapping names them."
            )
        tried = count_of(len(self.tried), "window")
        return (
            f"Of {tried} tried, {self.best.name} gives most: {len(self.best.agree)} of "
            f"{self.compared} printed numbers. Were errors independent and spread evenly within "
            f"{100 * SPREAD:g} % of the print, the chance of as many by accident would be {self.chance:.2g}."
        )


def try_windows(file: TraceFile, paper: Published, timing: Mapping[str, Timing]) -> PrintedTables:
    """Compare Tables 2 and 3 with measured errors, averaged in every way that all runs reach, each once."""
    runs = {name: file.runs[name] for name in RUNS if name in file.runs and "e" in file.runs[name]}
    parts = {name: spans(trace.time, timing[name]) for name, trace in runs.items()}
    windows: dict[str, dict[str, slice]] = {}
    for window in next(iter(parts.values()), {}):
        if all(window in part for part in parts.values()):
            over = {name: part[window] for name, part in parts.items()}
            if over not in windows.values():
                windows[window] = over
    every = [
        _tried(runs, paper, window, over, removed)
        for removed in (False, True)
        for window, over in windows.items()
    ]
    tried = [way for way in every if way.sizes] or [*PrintedTables.tried]
    left_out = {name: int((~np.isfinite(trace["e"])).any(axis=1).sum()) for name, trace in runs.items()}
    most = max(len(way.agree) for way in tried)
    chance = min(1.0, len(tried) * chance_of_at_least(paper, tried[0].sizes, most))
    return PrintedTables(tuple(tried), left_out, chance, tuple(file.runs))


def spans(time: Array, timing: Timing) -> dict[str, slice]:
    """Stretches of a run to average over, by name.

    Except ``with_standstill``, every sample, they begin with the motion or later.
    """
    count = len(time)
    step = float(time[-1] - time[0]) / max(count - 1, 1)
    first = int(np.searchsorted(time, timing.start - 0.5 * step))
    first = first if first < count else 0
    cut = {
        name: slice(part.start + first, part.stop + first)
        for name, part in windows(time[first:], timing.period).items()
    }
    named = {"whole": cut.pop("whole"), "with_standstill": slice(0, count)}
    periods = [part for name, part in cut.items() if name.startswith("period_")]
    if periods:
        named["whole_periods"] = slice(first, periods[-1].stop)
    return named | cut


def _tried(
    runs: Mapping[str, Trace], paper: Published, window: str, parts: Mapping[str, slice], removed: bool
) -> Tried:
    sizes: dict[str, float] = {}
    for name, trace in runs.items():
        e = trace["e"][parts[name]]
        if removed:
            e = e - np.ma.masked_invalid(e).mean(axis=0).filled(0.0)
        errors = sizes_deg(e)
        for metric in METRICS:
            for joint, size in zip(trace.joint, errors[f"{metric}_deg"], strict=True):
                identifier = f"{row_of(name)}.{metric}.joint_{joint}"
                if identifier in paper.entries and np.isfinite(size):
                    sizes[identifier] = float(size)
    printed = {identifier: rounding(paper.quantity(identifier)) for identifier in sizes}
    agree = [name for name, (low, high) in printed.items() if low <= Fraction(sizes[name]) <= high]
    return Tried(window, removed, sizes, tuple(agree))


def chance_of_at_least(paper: Published, identifiers: Mapping[str, float], least: int) -> float:
    """Chance of at least so many agreements among independent errors."""
    counts = np.ones(1)
    for identifier in identifiers:
        low, high = rounding(paper.quantity(identifier))
        share = float(high - low) / (2.0 * SPREAD * paper.number(identifier))
        counts = np.convolve(counts, [1.0 - share, share])
    return float(counts[least:].sum())
