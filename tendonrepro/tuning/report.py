"""From the rows of every draw to ratios with intervals, verdicts, and tables."""

from __future__ import annotations

from collections.abc import Iterator, KeysView, Mapping, Sequence
from dataclasses import asdict
from itertools import combinations, groupby, product
from operator import itemgetter

import numpy as np

from tendonrepro.console import count_of
from tendonrepro.monte_carlo.plan import code_digest
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result
from tendonrepro.tuning.laws import LAWS
from tendonrepro.tuning.search import CAPS, CONDITIONS, TunedRow, TuningTask

SCHEMA_VERSION = 2

# Pairs of laws whose errors are compared, the first over the second.
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
VERDICTS = "smaller error", "no difference", "larger error", "undecided", "too few plants"
SMALLER, NONE, LARGER, UNDECIDED, TOO_FEW = VERDICTS
ALIKE = 0.1  # a difference below this, in logs, is none; a wider interval that shows none leaves it undecided
FEWEST = 8  # draws on which both laws must have gains, for a verdict

_HEAD = "law", "over", "knows", "filtered", "cap", "draws"


def comparisons(rows: Sequence[TunedRow], pairs: Sequence[tuple[str, str]], seed: int) -> Iterator[TunedRow]:
    """Yield the error of one law over another's, both at their best, under every condition and cap.

    ``ratio`` is the median over draws with its 95 % bootstrap interval, ``scatter`` the ratio by which the
    second best search misses the best, ``held_out`` the median ratio on the held-out payload and motion.
    """
    by_key = {tuple(row[name] for name in ("law", "knows", "filtered", "cap", "draw")): row for row in rows}
    draws = sorted({row["draw"] for row in rows})
    for (law, over), (knows, filtered), cap in product(pairs, CONDITIONS, CAPS):
        both = [[by_key[which, knows, filtered, cap, draw] for which in (law, over)] for draw in draws]
        kept = [(a, b) for a, b in both if a["stable"] and b["stable"]]
        head = dict(zip(_HEAD, (law, over, knows, filtered, cap, len(kept)), strict=True))
        none = dict.fromkeys(("ratio", "low", "high", "scatter", "held_out"), np.nan) | {"verdict": TOO_FEW}
        yield head | (_compared(kept, seed) if len(kept) >= FEWEST else none)


def _compared(kept: Sequence[tuple[TunedRow, TunedRow]], seed: int) -> TunedRow:
    logs = np.log([a["error"] / b["error"] for a, b in kept])
    errors = [(a["held_out_error"], b["held_out_error"]) for a, b in kept]
    held_out = [a / b for a, b in errors if a and b]
    samples = np.random.default_rng(seed).choice(logs, (2000, logs.size))
    middle, (low, high) = np.median(logs), np.quantile(np.median(samples, axis=1), [0.025, 0.975])
    scatter = max(np.median([_miss(pair[k]["errors"]) for pair in kept]) for k in (0, 1))
    if low >= -ALIKE and high <= ALIKE:
        verdict = NONE
    elif low <= 0.0 <= high or abs(middle) <= scatter:
        verdict = UNDECIDED
    else:
        verdict = SMALLER if middle < 0.0 else LARGER
    names = ("ratio", "low", "high", "scatter")
    numbers = dict(zip(names, np.exp([middle, low, high, scatter]).tolist(), strict=True))
    return numbers | {"held_out": float(np.median(held_out)) if held_out else np.nan, "verdict": verdict}


def _miss(errors: Sequence[float | None]) -> float:
    """By how much the second best search misses the best, in logs."""
    sizes = sorted(error for error in errors if error is not None)
    return sizes[1] - sizes[0] if len(sizes) > 1 else np.inf


def law_rows(rows: Sequence[TunedRow], joints: Sequence[int]) -> Iterator[TunedRow]:
    """Yield errors, roughness and share of stable draws, by law, condition and cap."""
    names = ("law", "knows", "filtered", "cap", "alpha")
    groups: dict[tuple[object, ...], list[TunedRow]] = {}
    for row in rows:
        groups.setdefault(tuple(map(row.get, names)), []).append(row)
    for key, own in groups.items():
        good = [row for row in own if row["stable"]]
        summary = dict(zip(names, key, strict=True)) | {"share_stable": len(good) / len(own)}
        if good:
            degrees = np.degrees([row["mae"] for row in good])
            for i, joint in enumerate(joints):
                summary[f"mae_joint_{joint}_deg"] = float(np.median(degrees[..., i]))
                summary[f"mae_joint_{joint}_deg_90"] = float(np.quantile(degrees[..., i], 0.9))
            summary["error_deg"] = float(np.degrees(np.median([row["error"] for row in good])))
            summary["roughness_Nm"] = float(np.median([row["roughness"] for row in good]))
        yield summary


def question_rows(rows: Sequence[TunedRow], titles: Mapping[str, str]) -> Iterator[TunedRow]:
    """Yield how often a pair has which verdict, and which it has in half of all cases."""
    for (law, over), group in groupby(rows, itemgetter("law", "over")):
        own = list(group)
        ratios = [row["ratio"] for row in own if row["verdict"] != TOO_FEW]
        counts = {name: sum(row["verdict"] == name for row in own) for name in VERDICTS}
        most = max(counts, key=lambda name: counts[name])
        yield {
            "law": titles[law],
            "over": titles[over],
            "median_ratio": float(np.median(ratios)) if ratios else None,
            **{name.replace(" ", "_"): count for name, count in counts.items()},
            "verdict": most if 2 * counts[most] >= len(own) else "depends on the condition",
        }


def pairs_among(laws: KeysView[str]) -> list[tuple[str, str]]:
    """Pairs to compare: the questions, a user's laws over NTSM and PID, and any two if some were chosen."""
    own = product((name for name in laws if name not in LAWS), ("ntsm", "pid"))
    pairs = [pair for pair in (*QUESTIONS, *own) if set(pair) <= set(laws)]
    if not laws >= LAWS.keys():
        asked = set(map(frozenset, pairs))
        pairs += [pair for pair in combinations(laws, 2) if frozenset(pair) not in asked]
    return pairs


def tuning_result(task: TuningTask, drawn: Sequence[TunedRow]) -> Result:
    """Numbers, tables and figure."""
    from tendonrepro.tuning.figure import draw_tuning

    joints = task.loaded.compare.joints
    gains = task.gains_told
    titles = {name: law.title.replace("published", gains) for name, law in task.laws.items()}
    rows, lost = (
        [{"draw": plant["draw"], **row} for plant in drawn for row in plant[part]]
        for part in ("rows", "lost")
    )
    compared, at_best = [*comparisons(rows, pairs_among(titles.keys()), task.seed)], [*law_rows(rows, joints)]
    questions = [*question_rows(compared, titles)]
    scattered = count_scattered(compared)
    around = task.loaded.around
    on = count_of(len(drawn), "plant") + (f" {around.told}" if around else "")
    data = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "tune",
        "effort": asdict(task.effort),
        "seed": task.seed,
        "physics_sha256": code_digest("physics"),
        "draws_looked_at": drawn[-1]["draw"] + 1,
        "plants": len(drawn),
        "joints": list(joints),
        "around": around and around.as_data(),
        "questions": questions,
        "comparisons": compared,
        "laws": at_best,
        "lost_to_special_case": lost,
        "without_difference_but_scattered": scattered,
        "by_plant": rows,
    }
    about = f"Two laws at their best on {on}: the first one's error under so many conditions."
    tables = [
        Table("questions", about, questions),
        Table("comparisons", "Error over error, paired by plant.", compared, terminal=()),
        Table("laws", f"Every law at its best, and with {gains} gains.", at_best, terminal=()),
    ]
    told = [*_warnings(len(lost), scattered)]
    return Result(data, [*told, *tables], {"tune": lambda: draw_tuning(at_best, titles, on, gains)})


def count_scattered(rows: Sequence[TunedRow]) -> int:
    """In how many cases without a difference two searches of one law differ by more than counts as none."""
    return sum(row["verdict"] == NONE and bool(np.log(row["scatter"]) > ALIKE) for row in rows)


def _warnings(lost: int, scattered: int) -> Iterator[str]:
    if lost:
        cases = count_of(lost, "case")
        yield f"NOT TO BE TRUSTED: in {cases} a law lost to its own special case; search longer."
    if scattered:
        yield (
            f"In {count_of(scattered, 'case')} without a difference, searches of one controller differ by "
            f"more than the {ALIKE:.0%} that count as none: search longer before you believe it."
        )
