"""From the rows of every draw to answers: paired ratios with intervals, verdicts, and tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.results.tables import Table
from tendonrepro.tuning.study import CAPS, CONDITIONS

QUESTIONS: tuple[tuple[str, str], ...] = (
    ("alpha_published", "ntsm"),
    ("alpha_extrapolating", "ntsm"),
    ("alpha_free", "ntsm"),
    ("ntsm", "tsm"),
    ("ntsm", "tdc"),
    ("tdc", "pid"),
    ("alpha_free", "pid"),
    ("dob", "pid"),
    ("super_twisting", "pid"),
)
"""Pairs of laws whose errors are compared, the first over the second."""

VERDICTS = ("smaller error", "no difference", "larger error", "undecided", "too few plants")
ALIKE = 0.1
"""A difference below this, in logs, is none; a wider interval that shows none leaves it undecided."""
FEWEST = 8
"""Draws on which both laws must have gains, for a verdict."""
_RESAMPLES, _TAIL = 2000, 0.025

Rows = Sequence[Mapping[str, Any]]
"""What `study` keeps, with the number of the draw in each row."""


class Comparison(NamedTuple):
    """Error of one law over that of another under one condition and cap, both at their best.

    ``ratio`` is the median over draws with its 95 % bootstrap interval, ``scatter`` the ratio by which the
    second best search misses the best, ``held_out`` the median ratio on the held-out payload and motion.
    """

    law: str
    over: str
    knows: str
    filtered: bool
    cap: str
    draws: int
    ratio: float = np.nan
    low: float = np.nan
    high: float = np.nan
    scatter: float = np.nan
    held_out: float = np.nan
    verdict: str = VERDICTS[-1]


def comparisons(rows: Rows, pairs: Sequence[tuple[str, str]], seed: int) -> Iterator[Comparison]:
    """Yield every pair under every condition and cap."""
    by_key = {tuple(row[name] for name in ("law", "knows", "filtered", "cap", "draw")): row for row in rows}
    draws = sorted({row["draw"] for row in rows})
    for (law, over), condition, cap in product(pairs, CONDITIONS, CAPS):
        both = [(by_key[law, *condition, cap, draw], by_key[over, *condition, cap, draw]) for draw in draws]
        kept = [(a, b) for a, b in both if a["stable"] and b["stable"]]
        found = Comparison(law, over, *condition, cap, len(kept))
        yield found._replace(**_compared(kept, seed)) if len(kept) >= FEWEST else found


def _compared(kept: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]], seed: int) -> dict[str, Any]:
    logs = np.log([a["error"] / b["error"] for a, b in kept])
    held = [
        a["held_out_error"] / b["held_out_error"]
        for a, b in kept
        if a["held_out_error"] and b["held_out_error"]
    ]
    middle, (low, high) = float(np.median(logs)), _interval(logs, seed)
    scatter = max(float(np.median([_miss(pair[k]["errors"]) for pair in kept])) for k in (0, 1))
    if low >= -ALIKE and high <= ALIKE:
        verdict = VERDICTS[1]
    elif low <= 0.0 <= high or abs(middle) <= scatter:
        verdict = VERDICTS[3]
    else:
        verdict = VERDICTS[0] if middle < 0.0 else VERDICTS[2]
    names = ("ratio", "low", "high", "scatter")
    numbers = dict(zip(names, np.exp([middle, low, high, scatter]).tolist(), strict=True))
    return numbers | {"held_out": float(np.median(held)) if held else np.nan, "verdict": verdict}


def _miss(errors: Sequence[float | None]) -> float:
    """By how much the second best search misses the best, in logs; infinite where only one found gains."""
    found = sorted(error for error in errors if error is not None)
    return found[1] - found[0] if len(found) > 1 else np.inf


def _interval(logs: Array, seed: int) -> tuple[float, float]:
    """Bootstrap interval of the median over draws."""
    samples = np.random.default_rng(seed).choice(logs, (_RESAMPLES, logs.size))
    low, high = np.quantile(np.median(samples, axis=1), [_TAIL, 1.0 - _TAIL])
    return float(low), float(high)


def law_rows(rows: Rows, joints: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Yield errors, roughness, share of draws with gains and what limits them, by law, condition and cap."""
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        key = row["law"], row["knows"], row["filtered"], row["cap"], row.get("alpha")
        groups.setdefault(key, []).append(row)
    for key, own in groups.items():
        good = [row for row in own if row["stable"]]
        found = dict(zip(("law", "knows", "filtered", "cap", "alpha"), key, strict=True))
        found["share_stable"] = len(good) / len(own)
        if good:
            degrees = np.degrees([row["mae"] for row in good])
            for i, joint in enumerate(joints):
                found[f"mae_joint_{joint}_deg"] = float(np.median(degrees[..., i]))
                found[f"mae_joint_{joint}_deg_90"] = float(np.quantile(degrees[..., i], 0.9))
            found["error_deg"] = float(np.degrees(np.median([row["error"] for row in good])))
            found["roughness_Nm"] = float(np.median([row["roughness"] for row in good]))
            for limit in ("roughness", "margin", "bound"):
                found[f"{limit}_active"] = float(np.mean([limit in row.get("active", ()) for row in good]))
        yield found


def question_rows(found: Sequence[Comparison], titles: Mapping[str, str]) -> list[dict[str, Any]]:
    """For every pair of laws, how many conditions and caps have which verdict, and which has half of them."""
    rows = []
    for law, over in dict.fromkeys((one.law, one.over) for one in found):
        own = [one for one in found if (one.law, one.over) == (law, over)]
        ratios = [one.ratio for one in own if one.verdict != VERDICTS[-1]]
        counts = {name: sum(one.verdict == name for one in own) for name in VERDICTS}
        most = max(counts, key=lambda name: counts[name])
        rows.append(
            {
                "law": titles[law],
                "over": titles[over],
                "median_ratio": float(np.median(ratios)) if ratios else None,
                **{name.replace(" ", "_"): count for name, count in counts.items()},
                "verdict": most if 2 * counts[most] >= len(own) else "depends on the condition",
            }
        )
    return rows


def tables(questions: Rows, found: Sequence[Comparison], laws: Rows, draws: int) -> list[Table]:
    """Tables of an outcome; the terminal shows the questions."""
    about = f"Two laws at their best on {draws} plants: the first one's error under so many conditions."
    rows = [one._asdict() for one in found]
    return [
        Table("questions", about, questions),
        Table("comparisons", "Error over error, paired by plant.", rows, terminal=()),
        Table("laws", "Every law at its best, and as published.", laws, terminal=()),
    ]
