"""The ledger: every printed result and claim, judged from what has been run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import (
    METRICS,
    PrintedNumber,
    PrintedRatio,
    PrintedText,
    Published,
    published,
)
from tendonrepro.configuration.shown import is_choice
from tendonrepro.errors import UsageError
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.results.records import TraceFile
from tendonrepro.results.summary import tracking_errors
from tendonrepro.verdicts.from_ensemble import COMMAND, NUMBERS, judge
from tendonrepro.verdicts.from_measurement import judge_measured
from tendonrepro.verdicts.from_print import FROM_THE_PRINT, ErrorOf, formula_of
from tendonrepro.verdicts.measured import measured_of
from tendonrepro.verdicts.plants import Plants
from tendonrepro.verdicts.rules import VERDICTS, ByChoice, Judged, missing
from tendonrepro.verdicts.sensitivity import deciding
from tendonrepro.verdicts.tension import tension
from tendonrepro.verdicts.verdict import Verdict

SCHEMA_VERSION = 1
SHARE = "share of the box"
FETCH = "tendonrepro fetch, then inspect --suggest and ingest"


@dataclass(frozen=True)
class Sources:
    """What has been run."""

    compare: TraceFile | None = None
    ensemble: EnsembleData | None = None
    measured: TraceFile | None = None


def judge_all(
    sources: Sources,
    paper: Published | None = None,
    only: Sequence[str] = (),
    *,
    decided_by: bool = False,
    progress: Callable[[int], None] | None = None,
) -> list[Verdict]:
    """Judge every printed result and claim, or `only` some.

    `decided_by` ranks the unknowns that decide, a second each. `progress` gets 1 after each reading.

    Raises
    ------
    UsageError
        For an id that is not printed, or is an input.
    """
    paper = paper or published()
    judged = [name for name, rule in paper.judgements.items() if rule.kind != "input"]
    for name in only:
        if name not in judged:
            message = f"no claim or number {name!r} is judged"
            raise UsageError(message, hint=f"Claims: {', '.join(n for n in judged if '.' not in n)}")
    wanted = list(only) or judged
    verdicts = _over_the_box(sources.ensemble, paper, wanted, progress or (lambda _: None))
    for name in wanted:
        verdicts.setdefault(name, _without_ensemble(sources, paper, name))
        if decided_by and sources.ensemble and paper.judgements[name].kind == "ensemble":
            verdicts[name].evidence["decided_by"] = deciding(sources.ensemble, paper, name)
    measured = judge_measured(measured_of(sources.measured, paper), paper) if sources.measured else {}
    for name in verdicts.keys() & measured.keys():
        beside = measured[name]
        if paper.judgements[name].kind == "measured":
            verdicts[name] = beside
        else:
            head = {"verdict": beside.decision.verdict, "ours": beside.ours}
            verdicts[name].evidence["measured"] = head | beside.evidence
    shipped = _shipped_numbers(sources.compare, paper)
    return [_verdict(paper, name, verdicts[name], shipped.get(name)) for name in wanted]


def _over_the_box(
    data: EnsembleData | None, paper: Published, wanted: Sequence[str], progress: Callable[[int], None]
) -> dict[str, Judged]:
    """Judge by an ensemble, one reading in memory at a time."""
    names = [name for name in wanted if paper.judgements[name].kind == "ensemble"]
    if data is None or PRINTED not in data.readings or not names:
        return {}
    plants = Plants(data, PRINTED)
    judged = {name: judge(plants, paper, name) for name in names}
    progress(1)
    for reading in data.readings:
        if reading != PRINTED:
            plants = Plants(data, reading)
            for name in names:
                other = judge(plants, paper, name)
                judged[name].other_readings[reading] = other.decision.verdict
                if is_choice(reading):
                    judged[name].by_choice.append(ByChoice(reading, other.decision.verdict, other.ours))
            progress(1)
    return judged


def _without_ensemble(sources: Sources, paper: Published, identifier: str) -> Judged:
    rule = paper.judgements[identifier]
    if rule.rule == "tension":
        return tension(sources.ensemble)
    if rule.rule in FROM_THE_PRINT:
        return FROM_THE_PRINT[rule.rule](paper, identifier)
    if rule.kind == "measured":
        return missing("the measured motor and joint angles of the paper's data set", FETCH)
    return missing("the ensemble", COMMAND)


def _verdict(paper: Published, identifier: str, judged: Judged, shipped: float | None) -> Verdict:
    entry, rule = paper.entries[identifier], paper.judgements[identifier]
    verdict, evidence, others = judged.decision.verdict, dict(judged.evidence), judged.other_readings
    if shipped is not None:
        evidence["shipped_run"] = shipped
    unknown = [name for name, other in others.items() if other == "not_testable"]
    if unknown and verdict != "not_testable":
        evidence["not_testable_under"] = unknown
    printed, unit = _as_printed(paper, identifier)
    return Verdict(
        id=identifier,
        where=entry.where,
        printed=printed,
        unit=unit,
        ours=judged.ours if shipped is None else shipped,
        verdict=verdict,
        borderline=judged.decision.borderline,
        evidence=evidence,
        readings_that_change_it=tuple(
            name for name, other in others.items() if other not in {verdict, "not_testable"}
        ),
        by_choice=tuple(judged.by_choice),
        **rule.model_dump(exclude={"ids"}),
    )


def _shipped_numbers(compare: TraceFile | None, paper: Published) -> dict[str, float]:
    """Numbers of the nominal run, in printed units."""
    sizes: dict[str, float] = {}
    for run, trace in compare.runs.items() if compare else ():
        whole = tracking_errors(trace)["whole"]
        for metric in METRICS:
            for joint, size in zip(trace.joint, whole[metric], strict=True):
                sizes[ErrorOf(run, metric, joint).id] = float(size)
    values = {}
    for name, judgement in paper.judgements.items():
        if judgement.rule in NUMBERS and judgement.rule != "dose":
            formula = formula_of(paper, name)
            errors = [sizes.get(error.id, np.nan) for error in formula.errors]
            if np.isfinite(errors).all() and errors[-1] > 0.0:
                values[name] = formula.value(*errors)
    return values


def _as_printed(paper: Published, identifier: str) -> tuple[str, str | None]:
    entry = paper.entries[identifier]
    if isinstance(entry, PrintedText):
        return entry.text, SHARE if paper.judgements[identifier].kind == "ensemble" else None
    if isinstance(entry, PrintedNumber | PrintedRatio):
        return entry.as_printed, entry.unit
    low, high = paper.interval(identifier)
    return f"{float(low):.3f} to {float(high):.3f}", entry.unit


def summary(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """Count verdicts, without what repeats another."""
    counts = Counter(verdict.verdict for verdict in verdicts if verdict.repeats is None)
    return {name: counts[name] for name in VERDICTS}


def changed(before: Mapping[str, str], now: Iterable[Verdict]) -> dict[str, tuple[str | None, str | None]]:
    """Id -> verdicts before and now that differ; None: not judged."""
    after = {verdict.id: verdict.verdict for verdict in now}
    return {
        name: (before.get(name), after.get(name))
        for name in dict.fromkeys((*before, *after))
        if before.get(name) != after.get(name)
    }
