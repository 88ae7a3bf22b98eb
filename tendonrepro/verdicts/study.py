"""The verdicts on the paper's claims, judged by what lies below the results, as a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tendonrepro.console import Talk, count_of
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import read_json, refuse_file, to_json
from tendonrepro.monte_carlo.data import PLAN, EnsembleData, read_ensemble
from tendonrepro.results.paper import of_paper
from tendonrepro.results.store import read_manifest
from tendonrepro.results.summary import CONTROLLERS, fitted_under
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import TRACES, read_traces
from tendonrepro.studies.parameters import MEASURED, Folder
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site, Study
from tendonrepro.verdicts.judge import Sources, judge_all
from tendonrepro.verdicts.ledger import Origin, as_data, changed, origin_of, shipped_ledger, with_shipped
from tendonrepro.verdicts.measurement import read_measured
from tendonrepro.verdicts.report import changes_text, claims_table, details_text, table_text
from tendonrepro.verdicts.rules import EDITION, FAILURES
from tendonrepro.verdicts.sensitivity import rankings
from tendonrepro.verdicts.verdict import Verdict

if TYPE_CHECKING:
    from tendonrepro.results.figures.style import Drawing

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
        data = as_data(verdicts, judged_by)
        changes = {} if before is None else changed(before, verdicts)
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
    return Study(None, run, folder, place=above / FOLDER, shown=bool(ids), lists_files=True)


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
        known = {"draws": len(ensemble.draws), "rules_edition": EDITION}
        return sources, verdicts, origin_of("local", read_manifest(out / ENSEMBLE) | known)
    shipped = shipped_ledger()
    return sources, with_shipped(verdicts, shipped), shipped.ensemble


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
    file = measured or (MEASURED if MEASURED.exists() else None)
    return Sources(compare, ensemble, read_measured(file) if file else None)


def _baseline(path: Path, ids: Sequence[str]) -> dict[str, str]:
    if ids:
        raise UsageError(
            f"compares all claims that it holds, not {' and '.join(ids)} alone",
            where="--baseline",
            hint="leave out either --baseline or the claims",
        )
    hint = "write one with tendonrepro claims"
    ledger = read_json(path, hint)
    try:
        return {str(entry["id"]): str(entry["verdict"]) for entry in ledger["claims"]}
    except (TypeError, LookupError) as error:
        raise DataMissingError("is not the JSON of tendonrepro claims", where=str(path), hint=hint) from error
