"""What ``tendonrepro claims`` does: judge from the results there are, write and draw the ledger."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.claim_ensemble import outcome
from tendonrepro.claim_plants import Ensemble, Plants
from tendonrepro.claim_report import as_data, details_text, table_text, write_claims
from tendonrepro.claims import Sources, Verdict, changed, failing, judge_all
from tendonrepro.ensemble_data import EnsembleData, read_ensemble
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.published import published
from tendonrepro.readings import PRINTED
from tendonrepro.records import TraceFile
from tendonrepro.results import TRACES
from tendonrepro.talk import Talk
from tendonrepro.traces import read_traces

FOLDER = "claims"
TORNADOES = ("C1", "C2", "C3", "C5", "C6", "E1")
"""Claims whose deciding unknowns are drawn."""


@dataclass(frozen=True)
class Ledger:
    """Verdicts and what they mean for a check.

    Attributes
    ----------
    verdicts : tuple of Verdict
    failed : tuple of str
        Claims whose verdict fails a check: all that fail, or with a baseline those that changed.
    text : str
        For a terminal.
    data : dict
        For ``--json``.
    """

    verdicts: tuple[Verdict, ...]
    failed: tuple[str, ...]
    text: str
    data: dict[str, Any]


def run_claims(out: Path, ids: Sequence[str], baseline: Path | None, talk: Talk) -> Ledger:
    """Judge the claims from what has been run, and write the ledger.

    Parameters
    ----------
    out : Path
        Folder above the results: ``decouple``, ``compare``, ``ensemble`` where they exist.
    ids : sequence of str
        Claims to judge, with all their evidence; empty for the whole ledger, which is also written.
    baseline : Path or None
        An earlier ``claims.json`` to compare with.
    talk : Talk

    Returns
    -------
    Ledger

    Raises
    ------
    DataMissingError
        If the baseline cannot be read.
    UsageError
        For an unknown id, or a baseline together with ids.
    """
    before = None if baseline is None else _baseline(baseline, ids)
    sources = _sources(out)
    talk.detail(f"found {', '.join(_present(sources)) or 'no results'} under {out}")
    readings = 0 if sources.ensemble is None else len(sources.ensemble.readings)
    with talk.bar("judging", readings) as progress:
        verdicts = judge_all(sources, only=ids, decided_by=bool(ids), progress=progress)
    failed = tuple(failing(verdicts)) if before is None else tuple(changed(before, verdicts))
    data = as_data(verdicts)
    if ids:
        return Ledger(tuple(verdicts), failed, "\n\n".join(map(details_text, verdicts)), data)
    files = write_claims(verdicts, out / FOLDER)
    if sources.ensemble is not None:
        files += _draw(sources.ensemble, out / FOLDER / "figures")
    data["files"] = [str(path) for path in files]
    text = f"{table_text(verdicts)}\n\nThe ledger is in {out / FOLDER}"
    return Ledger(tuple(verdicts), failed, text, data)


def _sources(out: Path) -> Sources:
    return Sources(
        decouple=_traces(out / "decouple" / TRACES),
        compare=_traces(out / "compare" / TRACES),
        ensemble=_ensemble(out / "ensemble"),
    )


def _present(sources: Sources) -> list[str]:
    return [name for name in ("decouple", "compare", "ensemble") if getattr(sources, name) is not None]


def _traces(path: Path) -> TraceFile | None:
    return read_traces(path) if path.exists() else None


def _ensemble(folder: Path) -> EnsembleData | None:
    try:
        return read_ensemble(folder)
    except DataMissingError:
        if folder.exists():
            raise
        return None


def _baseline(path: Path, ids: Sequence[str]) -> dict[str, Any]:
    if ids:
        message = "a baseline is of the whole ledger, not of single claims"
        raise UsageError(message, where="--baseline")
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        message = f"cannot be read as the JSON of tendonrepro claims: {error}"
        raise DataMissingError(message, where=str(path)) from error
    return found


def _wide(draws: Array) -> list[bool]:
    """Which unknowns span more than a decade."""
    low, high = draws.min(axis=0), draws.max(axis=0)
    return [bool(wide) for wide in (low > 0.0) & (high > 10.0 * low)]


def _draw(data: Ensemble, folder: Path) -> list[Path]:
    """Draw which unknowns decide, and the ratio of Controllers 1 and 2 against each unknown."""
    from tendonrepro.figure_claims import draw_ratio_against_unknowns, draw_tornado, save_figure
    from tendonrepro.sensitivity import ranked

    paper, plants, written = published(), Plants(data, PRINTED), []
    for claim in TORNADOES:
        try:
            values, judged = outcome(plants, paper, paper.judgements[claim].rule, claim)
        except DataMissingError:
            continue
        ranking = ranked(data.names, data.draws[judged], values[judged])
        if ranking is not None:
            figure = draw_tornado(f"What decides claim {claim}", ranking)
            caption = f"Share of the variance of claim {claim} that each unknown explains alone."
            written += save_figure(figure, folder, f"decides_{claim}", caption)
    ok = np.logical_and.reduce([data.status(run, PRINTED) == 0 for run in ("controller_1", "controller_2")])
    sizes = [data.statistic(run, PRINTED, "mae") for run in ("controller_1", "controller_2")]
    for i, joint in enumerate(data.joints):
        figure = draw_ratio_against_unknowns(
            data.names,
            data.draws[ok],
            sizes[0][ok, i] / sizes[1][ok, i],
            1.0 + data.alpha[i],
            f"MAE of Controller 1 / 2, joint {joint}",
            log=_wide(data.draws),
        )
        caption = f"MAE of Controller 1 over 2 on joint {joint} against each unknown; line: 1 + alpha."
        written += save_figure(figure, folder, f"ratio_joint_{joint}", caption)
    return written
