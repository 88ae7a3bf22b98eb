"""Every printed result and claim, judged from what has been run below the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from tendonrepro.configuration.models.readings import PRINTED, is_choice
from tendonrepro.configuration.published import (
    PrintedNumber,
    PrintedRatio,
    PrintedText,
    Published,
    published,
)
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError, did_you_mean
from tendonrepro.files import Json, read_json, refuse_file, to_json
from tendonrepro.monte_carlo.data import PLAN, EnsembleData, read_ensemble
from tendonrepro.results.paper import of_paper
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import read_manifest
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import MEASURED_FILE, Folder, Site, Study
from tendonrepro.verdicts import from_ensemble, ledger, measurement, planted, rules, words
from tendonrepro.verdicts.from_print import judge_print
from tendonrepro.verdicts.ledger import ByChoice, Verdict
from tendonrepro.verdicts.rules import Evidence, Ruling, Rulings, not_testable
from tendonrepro.verdicts.statements import Plants
from tendonrepro.verdicts.tension import tension

FETCH = "tendonrepro data fetch, then data inspect --suggest and data ingest"
FOLDER = "claims"
ENSEMBLE = "ensemble"


def judge_all(
    data: EnsembleData | None = None,
    paper: Published | None = None,
    only: Sequence[str] = (),
    *,
    measured: TraceFile | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> list[Verdict]:
    """Judge every printed result and claim, or `only` some, by an ensemble and a measurement.

    `progress` gets 1 after each reading.

    Raises
    ------
    UsageError
        For an id that is not printed, or is an input.
    """
    paper = paper or published()
    wanted = _wanted(paper, only)
    over_the_box = _over_the_box(data, paper, wanted, progress)
    on_bench = (
        measurement.judge_measured(measurement.measurement_of(measured, paper), paper) if measured else {}
    )
    verdicts = []
    for name in wanted:
        kind = paper.judgements[name].kind
        rulings = over_the_box.get(name) or _without_ensemble(data, paper, name)
        beside: Evidence = {}
        if name in on_bench and kind == "measured":
            rulings = {PRINTED: on_bench[name]}
        elif name in on_bench:
            head = {"verdict": on_bench[name].verdict, "ours": on_bench[name].ours}
            beside["measured"] = head | on_bench[name].evidence
        verdicts.append(_verdict(paper, name, rulings, beside))
    return verdicts


def _wanted(paper: Published, only: Sequence[str]) -> Sequence[str]:
    """All that is judged, or `only` some, in letters of either case; a UsageError for what is not."""
    names = [name for name, judgement in paper.judgements.items() if judgement.kind != "input"]
    judged = {name.casefold(): name for name in names}
    for given in only:
        if given.casefold() not in judged:
            message = f"no claim or number {given!r} is judged{did_you_mean(given, names)}"
            raise UsageError(message, hint=f"Claims: {', '.join(n for n in names if '.' not in n)}")
    return [judged[given.casefold()] for given in only] or names


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
            rulings[name][reading] = from_ensemble.judge_plants(plants, paper, name)
        progress(1)
    return rulings


def _without_ensemble(data: EnsembleData | None, paper: Published, identifier: str) -> Rulings:
    judgement = paper.judgements[identifier]
    if judgement.rule == "tension":
        return tension(data)
    if judgement.kind in {"arithmetic", "model"}:
        return judge_print(paper, identifier)
    if judgement.kind == "measured":
        return {PRINTED: not_testable("the measured motor and joint angles of the paper's data set", FETCH)}
    return {PRINTED: not_testable("the ensemble", from_ensemble.COMMAND)}


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
        ours=ruling.ours,
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


def _as_printed(paper: Published, identifier: str) -> tuple[str, str | None]:
    """What is printed, and its unit."""
    entry = paper.entries[identifier]
    if isinstance(entry, PrintedText):
        return entry.text, ledger.SHARE if paper.judgements[identifier].kind == "ensemble" else None
    if isinstance(entry, PrintedNumber | PrintedRatio):
        return entry.as_printed, entry.unit
    low, high = paper.interval(identifier)
    return f"{float(low):.3f} to {float(high):.3f}", entry.unit


def claims_study(
    above: Path,
    ids: Sequence[str] = (),
    *,
    baseline: Path | str | None = None,
    measured: Path | str | None = None,
    check: bool = False,
    every: bool = False,
    folder: Folder,
) -> Study:
    """Prepare `claims` of verdicts/commands.py; by default the measurement is ``data/measured.h5``.

    Raises
    ------
    DataMissingError
        If the baseline cannot be read.
    UsageError
        For a baseline with ids.
    """
    refuse_file(above)
    if baseline and ids:
        raise UsageError("compares all claims that it holds; name none", where="--baseline")
    before = _baseline(Path(baseline)) if baseline else None

    def run(site: Site) -> Result:
        data = _ensemble(above / ENSEMBLE, site.talk)
        verdicts, origin = _judged(data, _measured(measured, site.talk), ids, above / ENSEMBLE, site.talk)
        changes = ledger.changed(before or {}, verdicts)
        failing = [verdict.id for verdict in verdicts if verdict.verdict in rules.FAILURES]
        result = Result(
            ledger.as_data(verdicts, origin),
            list(map(words.details_text, verdicts)),
            manifest={"ensemble": None if data is None else [data.identity, data.planned]},
            beside={} if before is None else {"changed": changes},
            fails_check=check and bool(failing if before is None else changes),
        )
        if ids:
            return result
        since = [] if before is None else [words.changes_text(changes, before, verdicts)]
        result = replace(
            result, parts=[words.table_text(verdicts, every=every), *since, words.claims_table(verdicts)]
        )
        return result if data is None else _with_influences(result, data)

    # Whatever lies under the results, the ledger is the same command's.
    return Study(None, run, folder, place=above / FOLDER, shown=bool(ids))


def _with_influences(result: Result, data: EnsembleData) -> Result:
    """Add which unknowns decide, as a file and a figure."""
    # Only who draws loads what draws.
    from tendonrepro.verdicts import sensitivity

    influences = sensitivity.rankings(data)
    drawings = {"decides": partial(sensitivity.draw_influences, influences, len(data))} if influences else {}
    return replace(result, files={"decides.json": to_json(influences)}, drawings=drawings)


def _judged(
    data: EnsembleData | None, measured: TraceFile | None, ids: Sequence[str], folder: Path, talk: Talk
) -> tuple[list[Verdict], Json]:
    """Judge by the ensemble of a folder, else by the shipped one; and tell which of them judged."""
    with talk.bar("judging", 0 if data is None else len(data.readings)) as progress:
        verdicts = judge_all(data, only=ids, measured=measured, progress=progress)
    if data is None:
        shipped = ledger.shipped_ledger()
        return ledger.with_shipped(verdicts, shipped), shipped.ensemble
    rates = planted.false_contradicted(data, published(), [verdict.id for verdict in verdicts])
    known = {"draws": len(data.draws), "rules_edition": rules.EDITION}
    origin = ledger.origin_of("local", read_manifest(folder) | known)
    return [replace(verdict, false_contradicted=rates.get(verdict.id)) for verdict in verdicts], origin


def _ensemble(folder: Path, talk: Talk) -> EnsembleData | None:
    """Read an ensemble of the paper's arm, if there is one."""
    data = read_ensemble(folder) if (folder / PLAN).exists() else None
    if data is None or data.of_paper:
        return data
    talk.note(f"{folder}: not of the paper's arm, gains and payload; judging without it")
    return None


def _measured(path: Path | str | None, talk: Talk) -> TraceFile | None:
    """Read a measurement of the paper's arm, if there is one."""
    path = path or (MEASURED_FILE if MEASURED_FILE.exists() else None)
    file = measurement.read_measured(Path(path)) if path else None
    if file is None or of_paper(file):
        return file
    talk.note(f"{path}: not of the paper's arm; judging without it")
    return None


def _baseline(path: Path) -> dict[str, str]:
    """Verdicts of an earlier ledger, by id."""
    hint = "write one with tendonrepro claims"
    stored = read_json(path, hint)
    try:
        return {str(entry["id"]): str(entry["verdict"]) for entry in stored["claims"]}
    except (TypeError, LookupError) as error:
        raise DataMissingError("is not the JSON of tendonrepro claims", where=str(path), hint=hint) from error
