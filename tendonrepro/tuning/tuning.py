"""Find usable draws, tune every law on each, and compare the laws: ratios, intervals, verdicts, tables."""

from __future__ import annotations

from collections.abc import Iterator, KeysView, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import partial
from itertools import chain, combinations, groupby, islice, product
from operator import itemgetter
from pathlib import Path

import numpy as np

from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import UsageError, did_you_mean
from tendonrepro.experiments import user_law
from tendonrepro.files import Json
from tendonrepro.monte_carlo.kept import identity_of, refuse_on_lanes, study_on_plants
from tendonrepro.parallel import as_ready, check_jobs, counted
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Folder, Site, Study, cost_of
from tendonrepro.tuning import bench
from tendonrepro.tuning.bench import CONDITIONS, LAWS, TunedLaw
from tendonrepro.tuning.search import CAPS, SAME, TuningEffort, TuningTask

SCHEMA_VERSION = 3

# Pairs of laws whose errors are compared, the first over the second.
QUESTIONS: tuple[tuple[str, str], ...] = (
    ("alpha_published", "ntsm"),
    ("alpha_extrapolating", "ntsm"),
    ("alpha_free", "ntsm"),
    ("ntsm", "tsm"),
    ("ntsm", "tdc"),
    ("ntsm", "pid"),
    ("alpha_free", "pid"),
    ("dob", "pid"),
    ("super_twisting", "pid"),
)
VERDICTS = SMALLER, SAME_ERROR, LARGER, UNDECIDED = "smaller error", "alike", "larger error", "undecided"
ALIKE = 0.1  # a difference below this, in logs, counts as none
FEWEST = 8  # draws on which both laws must have gains, else all is undecided

# Keys of results: the second counts what is alike.
_COUNTED = "smaller_error", "no_difference", "larger_error", "undecided", "agree"
_SHOWN = "law", "over", "median_ratio", "low", "high", "alone_median_ratio", *_COUNTED
_KEY = "law", "condition", "alone", "cap", "draw"
_COMPARED = "draws", "ratio", "low", "high", "scatter", "held_out", "verdict"

MOST_DRAWS_PER_PLANT = 64  # looked at for each plant that is asked for; about one in four is usable

SECONDS_PER_EXPERIMENT = 8e-4
"""Time of a run of two joints on a fast processor; it grows with the square of their number."""

# The scatter of a law is that of two searches at least.
LEAST = {"plants": 1, "searches": 2, "generations": 2, "population": 4}


def tuning_study(
    loaded: LoadedEnsemble,
    users: Sequence[user_law.UserLaw],
    plants: int,
    effort: TuningEffort,
    *,
    any_plant: bool,
    seed: int,
    jobs: int,
    only: str,
    folder: Folder,
) -> Study:
    """Check and prepare a tuning of every law, or `only` of some, and of a user's.

    Raises
    ------
    UsageError
        For too little effort, impossible jobs, or a law that has no bounds or cannot run on lanes.
    """
    asked = {"plants": plants, **asdict(effort)}
    for name, least in LEAST.items():
        if asked[name] < least:
            raise UsageError(f"must be at least {least}, found {asked[name]}", where=f"--{name}")
    check_jobs(jobs)
    own = [bench.tuned_user_law(user) for user in users]
    if taken := [law.name for law in own if law.name in LAWS]:
        message = f"there is a law {taken[0]!r} already"
        raise UsageError(message, where="--law", hint="give it another name")
    task = TuningTask(loaded, _chosen(only, own), effort, seed, any_plant)
    for user, law in zip(users, own, strict=True):
        drawn = task.draw(0)
        n = drawn.alpha.size
        middle = bench.Candidate(law, bench.PUBLISHED, law.values(np.full(sum(law.sizes(n)), 0.5), n))
        refuse_on_lanes(user, bench.loops_of(drawn, middle, 1)[0])
    loaded = replace(loaded, base=user_law.with_user_laws(loaded.base, users))
    identity = identity_of(
        loaded, "tuning", effort=asdict(effort), seed=seed, any_plant=any_plant, laws=sorted(task.laws)
    )
    experiments = plants * task.experiments
    cost = cost_of(experiments, SECONDS_PER_EXPERIMENT * (len(loaded.compare.joints) / 2) ** 2)

    def run(site: Site, states: Path) -> Result:
        return tuning_result(task, _tuned(task, _usable(task, plants), states, jobs, site.talk))

    why = "a tuning has motions of its own"
    study = study_on_plants("tune", loaded, identity, run, folder, cost=cost, seed=seed, averages=why)
    return replace(study, decided_by={"plants": plants})


def _chosen(only: str, own: Sequence[TunedLaw]) -> dict[str, TunedLaw]:
    """Laws of the package by the names that were asked for, and all of the user's."""
    users = {law.name: law for law in own}
    laws = LAWS | users
    names = [name.strip() for name in only.split(",") if name.strip()] or list(LAWS)
    for name in names:
        if name not in laws:
            message = f"there is no controller {name!r}{did_you_mean(name, laws)}"
            raise UsageError(message, where="--only", hint=f"There are: {', '.join(laws)}")
    return {name: law for name, law in LAWS.items() if name in names} | users


def _usable(task: TuningTask, wanted: int) -> list[int]:
    """Numbers of the first usable draws, or of every one."""
    numbers = range(MOST_DRAWS_PER_PLANT * wanted)
    found = [*islice((k for k in numbers if task.any_plant or bench.usable(task.draw(k))), wanted)]
    if len(found) < wanted:
        message = f"stable with {task.gains_told} gains are only {len(found)} of {len(numbers)} plants drawn"
        narrower = ", or a smaller --spread" if task.loaded.around else ""
        raise UsageError(message, where="--plants", hint=f"ask for fewer, or say --any-plant{narrower}")
    return found


def _tuned(task: TuningTask, numbers: Sequence[int], states: Path, jobs: int, talk: Talk) -> list[Json]:
    """Rows of draws, from what is on disk already; in the order of their numbers."""
    stream = as_ready(partial(task.tuned, states), numbers, jobs)
    with talk.bar("tuning on plants", len(numbers)) as progress, closing(stream):
        return sorted(chain.from_iterable(counted(stream, progress)), key=itemgetter("draw"))


def comparisons(rows: Sequence[Json], pairs: Sequence[tuple[str, str]], seed: int) -> Iterator[Json]:
    """Yield the error of one law over another's, both at their best, under every condition and cap.

    ``ratio`` is the median over draws with its 95 % bootstrap interval, ``scatter`` the ratio by which the
    second best search misses the best, ``held_out`` the median ratio on the held-out payload and motion.
    Names that begin with ``alone`` are of searches without gains handed on. The verdict is that of searches
    with them, undecided where those alone do not agree.
    """
    at, draws = _by_place(rows), sorted({row["draw"] for row in rows})
    for (law, over), condition, cap in product(pairs, CONDITIONS, CAPS):
        places = [[(condition, alone, cap, draw) for draw in draws] for alone in (False, True)]
        handed, own = (_compared([(at[law, *k], at[over, *k]) for k in way], seed) for way in places)
        agree = _agree(handed, own)
        head = {"law": law, "over": over, "condition": condition, "cap": cap}
        more = {f"alone_{name}": value for name, value in own.items()}
        yield head | handed | more | {"agree": agree, "verdict": handed["verdict"] if agree else UNDECIDED}


def _by_place(rows: Sequence[Json]) -> dict[tuple[object, ...], Json]:
    """Rows of laws at their best by law, condition, whether alone, cap, and draw."""
    return {tuple(row[name] for name in _KEY): row for row in rows if row.get("alpha") is None}


def _compared(both: Sequence[tuple[Json, Json]], seed: int) -> Json:
    kept = [(a, b) for a, b in both if a["stable"] and b["stable"]]
    if len(kept) < FEWEST:
        return dict.fromkeys(_COMPARED, np.nan) | {"draws": len(kept), "verdict": UNDECIDED}
    logs = np.log([a["error"] / b["error"] for a, b in kept])
    errors = [(a["held_out_error"], b["held_out_error"]) for a, b in kept]
    held_out = [a / b for a, b in errors if a and b]
    samples = np.random.default_rng(seed).choice(logs, (2000, logs.size))
    middle, (low, high) = np.median(logs), np.quantile(np.median(samples, axis=1), [0.025, 0.975])
    scatter = max(np.median([_miss(pair[k]) for pair in kept]) for k in (0, 1))
    if low >= -ALIKE and high <= ALIKE:
        verdict = SAME_ERROR if scatter <= ALIKE else UNDECIDED
    elif low <= 0.0 <= high or abs(middle) <= scatter:
        verdict = UNDECIDED
    else:
        verdict = SMALLER if middle < 0.0 else LARGER
    numbers = np.exp([middle, low, high, scatter]).tolist()
    other = float(np.median(held_out)) if held_out else np.nan
    return dict(zip(_COMPARED, (len(kept), *numbers, other, verdict), strict=True))


def _agree(handed: Json, own: Json) -> bool:
    """Whether both ways of searching have one verdict, or ratios that differ by less than their scatter."""
    scatter = float(np.log(max(handed["scatter"], own["scatter"])))
    same_winner = handed["verdict"] == own["verdict"] != UNDECIDED
    return same_winner or _apart(handed["ratio"], own["ratio"]) <= scatter


def _apart(first: float, second: float) -> float:
    return abs(float(np.log(first / second)))


def _errors(row: Json) -> list[float]:
    """Of each search that found gains, in logs, the least first."""
    return sorted(error for error in row.get("errors", ()) if error is not None)


def _miss(row: Json) -> float:
    """By how much the second best search misses the best, in logs."""
    best, *others = _errors(row)
    return others[0] - best if others else np.inf


def lost_to_special_case(rows: Sequence[Json]) -> Iterator[Json]:
    """Yield where a law does worse than its own special case, handed on to it: a failure of the search."""
    errors = {key: [*_errors(row), np.inf][0] for key, row in _by_place(rows).items() if not row["alone"]}
    for equal, key in product(bench.EQUIVALENCES, errors):
        general = (equal.target, *key[1:])
        if equal.exact and key[0] == equal.source and errors.get(general, -np.inf) > errors[key] + SAME:
            yield dict(zip(_KEY, general, strict=True)) | {"to": equal.source}


def law_rows(rows: Sequence[Json], joints: Sequence[int]) -> Iterator[Json]:
    """Yield errors, roughness and share of stable draws, by law, condition, whether alone, and cap."""
    names = ("law", "condition", "alone", "cap", "alpha")
    groups: dict[tuple[object, ...], list[Json]] = {}
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


def alpha_rows(rows: Sequence[Json]) -> Iterator[Json]:
    """Yield what the free α was tuned to, by condition and whether alone; a case is a draw under a cap.

    α is without effect where it is 0 or where, set to 0 beside the same gains, it changes the error by less
    than `SAME`. ``ratio_with_effect`` is the median error over that of TDE in the other cases.
    """
    tuned = _by_place(rows)
    zeroed = {tuple(row[name] for name in _KEY): row for row in rows if row.get("alpha") == 0.0}
    for condition, alone in product(CONDITIONS, (False, True)):
        keys = [key for key in zeroed if key[:3] == ("alpha_free", condition, alone) and tuned[key]["stable"]]
        if not keys:
            continue
        same = [key for key in keys if _apart(zeroed[key]["error"], tuned[key]["error"]) <= SAME]
        acting = [key for key in keys if key not in same or not zeroed[key]["stable"]]
        beside = [(tuned[key], tuned.get(("ntsm", *key[1:]))) for key in acting]
        ratios = [free["error"] / tde["error"] for free, tde in beside if tde and tde["stable"]]
        alphas = np.array([tuned[key]["gains"]["alpha"] for key in keys])
        quantiles = np.quantile(alphas, [0.1, 0.5, 0.9]).tolist()
        yield {
            "condition": condition,
            "alone": alone,
            "cases": len(keys),
            "share_zero": float((alphas == 0.0).all(axis=1).mean()),
            "share_without_effect": 1.0 - len(acting) / len(keys),
            **dict(zip(("alpha_10", "alpha_median", "alpha_90"), quantiles, strict=True)),
            "ratio_with_effect": float(np.median(ratios)) if ratios else None,
        }


def question_rows(rows: Sequence[Json], titles: Mapping[str, str]) -> Iterator[Json]:
    """Yield how often a pair has which verdict, and in how many cases both ways of searching agree.

    Intervals are from the lowest to the highest end of the cases'.
    """
    for (law, over), group in groupby(rows, itemgetter("law", "over")):
        own = list(group)
        counts = [sum(row["verdict"] == name for row in own) for name in VERDICTS]
        yield {
            "law": titles[law],
            "over": titles[over],
            **_over_cases(own, ""),
            **_over_cases(own, "alone_"),
            **dict(zip(_COUNTED, (*counts, sum(row["agree"] for row in own)), strict=True)),
        }


def _over_cases(rows: Sequence[Json], way: str) -> Json:
    """Median ratio of the cases that have one, and the ends of their intervals."""
    names = [f"{way}{name}" for name in ("ratio", "low", "high")]
    judged = np.array([[row[name] for name in names] for row in rows if row[f"{way}draws"] >= FEWEST])
    if not judged.size:
        return dict.fromkeys((f"{way}median_ratio", *names[1:]))
    middle, low, high = np.median(judged[:, 0]), judged[:, 1].min(), judged[:, 2].max()
    return {f"{way}median_ratio": float(middle), names[1]: float(low), names[2]: float(high)}


def pairs_among(laws: KeysView[str]) -> list[tuple[str, str]]:
    """Pairs to compare: the questions, a user's laws over NTSM and PID, and any two if some were chosen."""
    own = product((name for name in laws if name not in LAWS), ("ntsm", "pid"))
    pairs = [pair for pair in (*QUESTIONS, *own) if set(pair) <= set(laws)]
    if not laws >= LAWS.keys():
        asked = set(map(frozenset, pairs))
        pairs += [pair for pair in combinations(laws, 2) if frozenset(pair) not in asked]
    return pairs


def tuning_result(task: TuningTask, rows: Sequence[Json]) -> Result:
    """Numbers, tables and figure."""
    from tendonrepro.tuning.figure import draw_tuning

    joints, gains = task.loaded.compare.joints, task.gains_told
    titles = {name: law.title.replace("published", gains) for name, law in task.laws.items()}
    compared, at_best = [*comparisons(rows, pairs_among(titles.keys()), task.seed)], [*law_rows(rows, joints)]
    questions, alphas = [*question_rows(compared, titles)], [*alpha_rows(rows)]
    lost, plants = [*lost_to_special_case(rows)], len({row["draw"] for row in rows})
    around = task.loaded.around
    on = count_of(plants, "plant") + (f" {around.told}" if around else "")
    data = {
        "schema_version": SCHEMA_VERSION,
        "experiment": "tune",
        "effort": asdict(task.effort),
        "seed": task.seed,
        "draws_looked_at": rows[-1]["draw"] + 1,
        "plants": plants,
        "any_plant": task.any_plant,
        "joints": list(joints),
        "around": around and around.as_data(),
        "questions": questions,
        "comparisons": compared,
        "laws": at_best,
        "alpha": alphas,
        "lost_to_special_case": lost,
        "by_plant": rows,
    }
    chosen = "" if task.any_plant else f", chosen because {gains} gains are stable there"
    about = f"Two laws at their best on {on}{chosen}: the first one's error under so many conditions."
    shown = () if questions else None
    tables = [
        Table("questions", about, questions, terminal=_SHOWN if questions else ()),
        Table("comparisons", "Error over error, paired by plant.", compared, terminal=()),
        Table("alpha", "What the free α of α-TDE was tuned to.", alphas, terminal=None if alphas else ()),
        Table("laws", f"Every law at its best, and with {gains} gains.", at_best, terminal=shown),
    ]
    cases = count_of(len(lost), "case")
    warning = f"NOT TO BE TRUSTED: in {cases} a law lost to its own special case; search longer."
    told = [warning] if lost else []
    return Result(data, [*told, *tables], {"tune": lambda: draw_tuning(at_best, titles, on, gains)})
