"""Every printed result and claim, judged from what has been run below the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

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
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import DataMissingError, UsageError, did_you_mean
from tendonrepro.files import read_json, refuse_file, to_json
from tendonrepro.monte_carlo.data import PLAN, EnsembleData, read_ensemble
from tendonrepro.results.paper import fitted_under, of_paper
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import read_manifest
from tendonrepro.results.summary import CONTROLLERS, tracking_errors
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import TRACES, read_traces
from tendonrepro.studies.parameters import MEASURED_FILE, Folder
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site, Study
from tendonrepro.verdicts import ledger
from tendonrepro.verdicts.from_ensemble import COMMAND, judge_plants
from tendonrepro.verdicts.from_print import NUMBERS, ErrorOf, formula_of, judge_print
from tendonrepro.verdicts.ledger import SHARE, ByChoice, Origin, Verdict
from tendonrepro.verdicts.measurement import judge_measured, measurement_of, read_measured
from tendonrepro.verdicts.planted import false_contradicted
from tendonrepro.verdicts.report import changes_text, claims_table, details_text, table_text
from tendonrepro.verdicts.rules import EDITION, FAILURES, Evidence, Ruling, Rulings, not_testable
from tendonrepro.verdicts.sensitivity import deciding, rankings
from tendonrepro.verdicts.statements import Plants
from tendonrepro.verdicts.tension import tension

if TYPE_CHECKING:
    from tendonrepro.results.figures.style import Drawing


FETCH = "tendonrepro data fetch, then data inspect --suggest and data ingest"


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


FOLDER = "claims"
ENSEMBLE = "ensemble"


def claims_study(
    above: Path,
    ids: Sequence[str] = (),
    *,
    baseline: Path | None = None,
    measured: Path | None = None,
    check: bool = False,
    every: bool = False,
    folder: Folder,
) -> Study:
    """Prepare the judging of claims.

    Parameters
    ----------
    above : Path
        Folder above the results.
    ids : sequence of str
        Claims to show with all their evidence; nothing is written then.
    baseline : Path, optional
        An earlier ``claims.json``; only changes fail a check then.
    measured : Path, optional
        By default ``data/measured.h5``.
    check : bool
        Whether a verdict against the paper fails the command.
    every : bool
        Show more than the main claims.

    Raises
    ------
    DataMissingError
        If the baseline cannot be read.
    UsageError
        For a baseline with ids.
    """
    refuse_file(above)
    before = None if baseline is None else _baseline(baseline, ids)

    def run(site: Site) -> Result:
        sources, verdicts, judged_by = _judged(above, measured, ids, site.talk)
        data = ledger.as_data(verdicts, judged_by)
        changes = {} if before is None else ledger.changed(before, verdicts)
        failing = [verdict.id for verdict in verdicts if verdict.verdict in FAILURES]
        told = Result(
            data,
            list(map(details_text, verdicts)),
            beside={} if before is None else {"changed": changes},
            fails_check=check and bool(failing if before is None else changes),
        )
        if ids:
            return told
        since = [] if before is None else [changes_text(changes, before, verdicts)]
        parts: list[Table | str] = [table_text(verdicts, every=every), *since, claims_table(verdicts)]
        return _with_influences(replace(told, parts=parts), sources.ensemble)

    # Whatever lies under the results, the ledger is the same command's.
    return Study(None, run, folder, place=above / FOLDER, shown=bool(ids))


def _with_influences(told: Result, data: EnsembleData | None) -> Result:
    """Add what an ensemble tells of the unknowns that decide."""
    if data is None:
        return replace(told, manifest={"ensemble": None})
    influences = rankings(data)

    def draw() -> Drawing:
        from tendonrepro.verdicts.figures import draw_influences

        origin = f"Simulated, {count_of(len(data), 'plant')} of the box"
        return replace(draw_influences(influences), origin=origin)

    return replace(
        told,
        manifest={"ensemble": [data.identity, data.planned]},
        files={"decides.json": to_json(influences)},
        drawings={"decides": draw} if influences else {},
    )


def _judged(
    out: Path, measured: Path | None, ids: Sequence[str], talk: Talk
) -> tuple[Sources, list[Verdict], Origin]:
    """Judge from what is under `out`; the last item tells which ensemble judged."""
    sources = _sources(out, measured, talk)
    ensemble = sources.ensemble
    with talk.bar("judging", 0 if ensemble is None else len(ensemble.readings)) as progress:
        verdicts = judge_all(sources, only=ids, decided_by=bool(ids), progress=progress)
    if ensemble is not None:
        rates = false_contradicted(ensemble, published(), [verdict.id for verdict in verdicts])
        verdicts = [replace(verdict, false_contradicted=rates.get(verdict.id)) for verdict in verdicts]
        known = {"draws": len(ensemble.draws), "rules_edition": EDITION}
        return sources, verdicts, ledger.origin_of("local", read_manifest(out / ENSEMBLE) | known)
    shipped = ledger.shipped_ledger()
    return sources, ledger.with_shipped(verdicts, shipped), shipped.ensemble


def _sources(out: Path, measured: Path | None, talk: Talk) -> Sources:
    """Read results and measurement, without what is not the paper's."""
    compare, ensemble = None, None
    if (out / "compare" / TRACES).exists():
        stored = read_traces(out / "compare")
        runs = [stored.runs[run] for run in CONTROLLERS if run in stored.runs]
        papers = of_paper(stored) and all(of_paper(stored, run) for run in runs)
        compare = stored if papers and not fitted_under(stored) else None
        if compare is None:
            talk.note(f"{out / 'compare'}: fitted, or not the paper's arm and gains; judging without it")
    if (out / ENSEMBLE / PLAN).exists():
        drawn = read_ensemble(out / ENSEMBLE)
        ensemble = drawn if drawn.of_paper else None
        if ensemble is None:
            talk.note(f"{out / ENSEMBLE}: not of the paper's arm, gains and payload; judging without it")
    path, file = measured or (MEASURED_FILE if MEASURED_FILE.exists() else None), None
    if path is not None:
        file = read_measured(path)
        if not of_paper(file):
            talk.note(f"{path}: not of the paper's arm; judging without it")
            file = None
    return Sources(compare, ensemble, file)


def _baseline(path: Path, ids: Sequence[str]) -> dict[str, str]:
    if ids:
        raise UsageError(
            f"compares all claims that it holds, not {' and '.join(ids)} alone",
            where="--baseline",
            hint="leave out either --baseline or the claims",
        )
    hint = "write one with tendonrepro claims"
    stored = read_json(path, hint)
    try:
        return {str(entry["id"]): str(entry["verdict"]) for entry in stored["claims"]}
    except (TypeError, LookupError) as error:
        raise DataMissingError("is not the JSON of tendonrepro claims", where=str(path), hint=hint) from error
