"""Every printed result and claim, judged from what has been run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from tendonrepro.errors import UsageError, did_you_mean
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.results.records import TraceFile
from tendonrepro.results.summary import tracking_errors
from tendonrepro.verdicts.formulas import NUMBERS, ErrorOf, formula_of
from tendonrepro.verdicts.from_ensemble import COMMAND, judge_plants
from tendonrepro.verdicts.from_measurement import judge_measured
from tendonrepro.verdicts.from_print import judge_print
from tendonrepro.verdicts.measurement import measurement_of
from tendonrepro.verdicts.plants import Plants
from tendonrepro.verdicts.rules import Evidence, Ruling, Rulings, not_testable
from tendonrepro.verdicts.sensitivity import deciding
from tendonrepro.verdicts.tension import tension
from tendonrepro.verdicts.verdict import ByChoice, Verdict

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
    wanted = _wanted(paper, only)
    over_the_box = _over_the_box(sources.ensemble, paper, wanted, progress or (lambda _: None))
    measured = judge_measured(measurement_of(sources.measured, paper), paper) if sources.measured else {}
    nominal = _nominal_numbers(sources.compare, paper)
    verdicts = []
    for name in wanted:
        kind = paper.judgements[name].kind
        rulings = over_the_box.get(name) or _without_ensemble(sources, paper, name)
        beside: Evidence = {}
        if decided_by and sources.ensemble and kind == "ensemble":
            beside["decided_by"] = deciding(sources.ensemble, paper, name)
        if name in measured and kind == "measured":
            rulings = {PRINTED: measured[name]}
        elif name in measured:
            head = {"verdict": measured[name].verdict, "ours": measured[name].ours}
            beside["measured"] = head | measured[name].evidence
        if name in nominal:
            beside["shipped_run"] = nominal[name]
        verdicts.append(_verdict(paper, name, rulings, beside))
    return verdicts


def _wanted(paper: Published, only: Sequence[str]) -> Sequence[str]:
    """All that is judged, or `only` some, in letters of either case; a UsageError for what is not."""
    names = [name for name, judgement in paper.judgements.items() if judgement.kind != "input"]
    judged = {name.casefold(): name for name in names}
    wanted = [judged.get(name.casefold(), "") for name in only]
    if "" in wanted:
        given = only[wanted.index("")]
        message = f"no claim or number {given!r} is judged{did_you_mean(given, names)}"
        raise UsageError(message, hint=f"Claims: {', '.join(n for n in names if '.' not in n)}")
    return wanted or names


def _over_the_box(
    data: EnsembleData | None, paper: Published, wanted: Sequence[str], progress: Callable[[int], None]
) -> Mapping[str, Rulings]:
    """Judge by an ensemble, one reading in memory at a time."""
    names = [name for name in wanted if paper.judgements[name].kind == "ensemble"]
    if data is None or PRINTED not in data.readings or not names:
        return {}
    rulings: dict[str, dict[str, Ruling]] = {name: {} for name in names}
    for reading in dict.fromkeys((PRINTED, *data.readings)):
        plants = Plants(data, reading)
        for name in names:
            rulings[name][reading] = judge_plants(plants, paper, name)
        progress(1)
    return rulings


def _without_ensemble(sources: Sources, paper: Published, identifier: str) -> Rulings:
    judgement = paper.judgements[identifier]
    if judgement.rule == "tension":
        return tension(sources.ensemble)
    if judgement.kind in {"arithmetic", "model"}:
        return judge_print(paper, identifier)
    if judgement.kind == "measured":
        return {PRINTED: not_testable("the measured motor and joint angles of the paper's data set", FETCH)}
    return {PRINTED: not_testable("the ensemble", COMMAND)}


def _verdict(paper: Published, identifier: str, rulings: Rulings, beside: Evidence) -> Verdict:
    """Put a verdict together from rulings by reading, and evidence `beside` that of the rule."""
    ruling = rulings[PRINTED]
    others = {reading: other for reading, other in rulings.items() if reading != PRINTED}
    unknown = [reading for reading, other in others.items() if other.verdict == "not_testable"]
    if unknown and ruling.verdict != "not_testable":
        beside = beside | {"not_testable_under": unknown}
    printed, unit = _as_printed(paper, identifier)
    return Verdict(
        id=identifier,
        where=paper.entries[identifier].where,
        printed=printed,
        unit=unit,
        ours=beside.get("shipped_run", ruling.ours),
        verdict=ruling.verdict,
        borderline=ruling.borderline,
        evidence=ruling.evidence | beside,
        readings_that_change_it=tuple(
            reading
            for reading, other in others.items()
            if other.verdict not in {ruling.verdict, "not_testable"}
        ),
        by_choice=tuple(
            ByChoice(reading, other.verdict, other.ours, other.evidence.get("opposite", {}).get("share"))
            for reading, other in others.items()
            if is_choice(reading)
        ),
        **paper.judgements[identifier].model_dump(exclude={"ids"}),
    )


def _nominal_numbers(compare: TraceFile | None, paper: Published) -> dict[str, float]:
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
