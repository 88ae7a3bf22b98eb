"""What ``tendonrepro claims`` does."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from tendonrepro import __version__
from tendonrepro.configuration.load import load_config
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import refuse_file, shipped, to_json
from tendonrepro.monte_carlo.data import PLAN, EnsembleData, read_ensemble
from tendonrepro.results.formats import FORMATS
from tendonrepro.results.paper import of_paper
from tendonrepro.results.store import NewResult, environment, make_manifest, read_manifest, replaced
from tendonrepro.results.summary import CONTROLLERS, fitted_under
from tendonrepro.results.traces import TRACES, read_traces
from tendonrepro.studies.outcome import Outcome, figure_formats
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer
from tendonrepro.verdicts.judge import SCHEMA_VERSION, Sources, Verdict, changed, judge_all
from tendonrepro.verdicts.measured import MEASURED, read_measured
from tendonrepro.verdicts.report import as_data, changes_text, details_text, table_text, write_claims
from tendonrepro.verdicts.rules import EDITION, FAILURES, ByChoice
from tendonrepro.verdicts.sensitivity import draw_influences, rankings

FOLDER = "claims"
ENSEMBLE = "ensemble"
AGAINST = 3
"""Exit code of a check that fails."""


class Ledger(NamedTuple):
    """Verdicts, as `text` for a terminal and as `data` for ``--json``.

    `failed` are the claims that fail a check; with a baseline, those that changed.
    """

    verdicts: tuple[Verdict, ...]
    failed: tuple[str, ...]
    text: str
    data: dict[str, Any]


@dataclass(frozen=True)
class Asked:
    """What is asked of the ledger.

    Attributes
    ----------
    out : Path
        Folder above the results.
    ids : sequence of str
        Claims to show with all their evidence; nothing is written then.
    baseline : Path, optional
        An earlier ``claims.json``; only changes fail a check then.
    measured : Path, optional
        By default ``data/measured.h5``.
    every : bool
        Show more than the main claims.
    force : bool
        Overwrite what no ledger wrote.
    formats : sequence of str
        Of the picture.
    """

    out: Path
    ids: Sequence[str] = ()
    baseline: Path | None = None
    measured: Path | None = None
    check: bool = False
    every: bool = False
    force: bool = False
    formats: Sequence[str] = FORMATS


def carry_out(name: str, asked: Asked, talk: Talk) -> Answer[Result | None]:
    """Judge, write the ledger and print it."""
    del name
    ledger = run_claims(asked, talk)
    return Answer(ledger.data, ledger.text, None, AGAINST if asked.check and ledger.failed else 0)


def result_of(name: str, asked: Asked) -> Result:
    """Judge for Python, where nothing is written."""
    started = time.perf_counter()
    _, verdicts, judged_by = judged(asked.out, asked.measured, asked.ids, Talk())
    shown = map(details_text, verdicts) if asked.ids else [table_text(verdicts, every=True)]
    outcome = Outcome(as_data(verdicts, judged_by), ["\n\n".join(shown)])
    manifest = make_manifest(load_config(None, "compare"), time.perf_counter() - started, name)
    return Result(name, outcome, manifest)


def run_claims(asked: Asked, talk: Talk) -> Ledger:
    """Judge the claims from what lies under `out`, and write the ledger.

    Raises
    ------
    DataMissingError
        If the baseline or the measured file cannot be read.
    UsageError
        For an unknown id, a baseline with ids, or where something would be overwritten.
    """
    out, ids = asked.out, asked.ids
    refuse_file(out)
    before = None if asked.baseline is None else _baseline(asked.baseline, ids)
    sources, verdicts, judged_by = judged(out, asked.measured, ids, talk)
    changes = {} if before is None else changed(before, verdicts)
    failing = [verdict.id for verdict in verdicts if verdict.verdict in FAILURES]
    failed = tuple(failing if before is None else changes)
    data = as_data(verdicts, judged_by) | ({} if before is None else {"changed": changes})
    if ids:
        return Ledger(tuple(verdicts), failed, "\n\n".join(map(details_text, verdicts)), data)
    ensemble = sources.ensemble
    with replaced(out / FOLDER, FOLDER, command=FOLDER, force=asked.force, talk=talk) as result:
        write_claims(verdicts, result.path, judged_by)
        if ensemble is not None:
            _write_influences(ensemble, result, asked.formats)
        # Whatever lies under the results, the ledger is the same command's.
        result.manifest = {
            "schema_version": SCHEMA_VERSION,
            "tendonrepro_version": __version__,
            "command": FOLDER,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "environment": environment(),
            "config": {"sha256": FOLDER},
            **figure_formats(asked.formats),
            "ensemble": None if ensemble is None else [ensemble.identity, ensemble.planned],
        }
    data["files"] = [str(out / FOLDER / name) for name in read_manifest(out / FOLDER)["outputs"]]
    since = [] if before is None else [changes_text(changes)]
    parts = [table_text(verdicts, every=asked.every), *since, f"The ledger is in {out / FOLDER}"]
    return Ledger(tuple(verdicts), failed, "\n\n".join(parts), data)


def _write_influences(data: EnsembleData, result: NewResult, formats: Sequence[str]) -> None:
    found = rankings(data)
    result.write("decides.json", to_json(found))
    if found and formats:
        from tendonrepro.results.figures.style import save_drawing

        drawn = replace(
            draw_influences(found), origin=f"Simulated, {count_of(len(data), 'plant')} of the box"
        )
        save_drawing(drawn, result.path / "figures", formats)


def judged(
    out: Path, measured: Path | None, ids: Sequence[str], talk: Talk
) -> tuple[Sources, list[Verdict], Mapping[str, Any]]:
    """Judge from what is under `out`; the last item tells which ensemble judged."""
    sources = _found(out, measured, talk)
    ensemble = sources.ensemble
    with talk.bar("judging", 0 if ensemble is None else len(ensemble.readings)) as progress:
        verdicts = judge_all(sources, only=ids, decided_by=bool(ids), progress=progress)
    if ensemble is not None:
        known = {"draws": len(ensemble.draws), "rules_edition": EDITION}
        return sources, verdicts, _origin("local", read_manifest(out / ENSEMBLE) | known)
    shipped = shipped_ledger()
    return sources, with_shipped(verdicts, shipped), shipped["ensemble"]


def _found(out: Path, measured: Path | None, talk: Talk) -> Sources:
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
        raise UsageError("a baseline is of the whole ledger, not of single claims", where="--baseline")
    try:
        ledger = json.loads(path.read_bytes())
        return {str(entry["id"]): str(entry["verdict"]) for entry in ledger["claims"]}
    except (OSError, ValueError, TypeError, LookupError) as error:
        message = "is missing, damaged or not the JSON of tendonrepro claims"
        raise DataMissingError(message, where=str(path), hint="write one with tendonrepro claims") from error


def shipped_ledger() -> dict[str, Any]:
    """Read the ``claims.json`` of the package."""
    path = shipped("docs/results") / "claims.json"
    stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return stored | {"ensemble": _origin("shipped", stored["ensemble"])}


def _origin(source: str, known: Mapping[str, Any]) -> dict[str, Any]:
    origin = ("draws", "tendonrepro_version", "created", "rules_edition")
    return {"source": source} | {key: known.get(key) for key in origin}


def with_shipped(verdicts: Sequence[Verdict], ledger: Mapping[str, Any]) -> list[Verdict]:
    """Take from a ledger what waits for an ensemble, if its text and rule are the same."""
    entries = {entry["id"]: entry for entry in ledger["claims"]}
    found = []
    for one in verdicts:
        entry = entries.get(one.id, {})
        waits = one.kind == "ensemble" and one.verdict == "not_testable"
        same = all(entry.get(key) == getattr(one, key) for key in ("kind", "rule", "printed"))
        found.append(_taken(one, entry, ledger["ensemble"]) if waits and same else one)
    return found


def _taken(waiting: Verdict, entry: Mapping[str, Any], origin: Mapping[str, Any]) -> Verdict:
    # The run of the shipped plant and the measurement are those that are here, or none.
    here = {name: waiting.evidence.get(name) for name in ("shipped_run", "measured")}
    evidence = {**entry["evidence"], **here, "ensemble": origin}
    return replace(
        waiting,
        ours=entry["ours"] if here["shipped_run"] is None else waiting.ours,
        verdict=entry["verdict"],
        borderline=entry["borderline"],
        evidence={name: value for name, value in evidence.items() if value is not None},
        readings_that_change_it=tuple(entry["readings_that_change_it"]),
        by_choice=tuple(ByChoice(**one) for one in entry.get("by_choice", ())),
        shipped=True,
    )
