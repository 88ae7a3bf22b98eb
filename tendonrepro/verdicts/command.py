"""What ``tendonrepro claims`` does: judge from the results there are, write and draw the ledger."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import published
from tendonrepro.console import Talk
from tendonrepro.dataset.measured_file import MEASURED, read_measured
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import to_json
from tendonrepro.monte_carlo.data import PLAN, EnsembleData, read_ensemble
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.manifest import environment
from tendonrepro.results.paper import of_paper
from tendonrepro.results.store import TRACES, NewResult, read_manifest, replaced, stored_traces
from tendonrepro.results.summary import CONTROLLERS, LOADS, fitted_under
from tendonrepro.verdicts.from_ensemble import outcome
from tendonrepro.verdicts.judge import Sources, Verdict, changed, failing, judge_all
from tendonrepro.verdicts.plants import Ensemble, Plants, StoredEnsemble
from tendonrepro.verdicts.report import as_data, changes_text, details_text, table_text, write_claims
from tendonrepro.verdicts.rules import NAMES
from tendonrepro.verdicts.sensitivity import Ranking, ranked
from tendonrepro.verdicts.shipped import local_origin, shipped_ledger, with_shipped

SCHEMA_VERSION = 1
FOLDER = "claims"
ENSEMBLE = "ensemble"
DECIDES = "decides.json"
SHOWN = 12
"""Unknowns against which a ratio is drawn."""
TORNADOES = ("C1", "C2", "C3", "C5", "C6", "E1")
"""Claims whose deciding unknowns are drawn."""
JOINTS = "joint_3_over_2"
"""What decides how large Controller 1's error of joint 3 is beside that of joint 2."""


@dataclass(frozen=True)
class Ledger:
    """Verdicts and what they mean for a check, as text for a terminal and as data for ``--json``.

    `failed` are the claims whose verdict fails a check: all that fail, or with a baseline those that changed.
    """

    verdicts: tuple[Verdict, ...]
    failed: tuple[str, ...]
    text: str
    data: dict[str, Any]


def run_claims(
    out: Path,
    ids: Sequence[str],
    baseline: Path | None,
    talk: Talk,
    measured: Path | None = None,
    *,
    force: bool = False,
    every: bool = False,
) -> Ledger:
    """Judge the claims from what has been run, and write the ledger.

    Without an ensemble the verdicts of the one that comes with the package stand in, and say so.

    Parameters
    ----------
    out : Path
        Folder above the results: ``decouple``, ``compare``, ``ensemble`` where they exist.
    ids : sequence of str
        Claims to judge, with all their evidence; empty for the whole ledger, which is also written.
    baseline : Path or None
        An earlier ``claims.json`` to compare with.
    talk : Talk
    measured : Path or None
        Measured trace file; None is ``data/measured.h5`` where there is one.
    every : bool
        Tell all verdicts, not those on the main claims alone.
    force : bool
        Overwrite what no earlier ledger wrote, or what was changed since.

    Returns
    -------
    Ledger

    Raises
    ------
    DataMissingError
        If the baseline, the measured file or the shipped verdicts cannot be read.
    UsageError
        For an unknown id, a baseline together with ids, or where something would be overwritten.
    """
    before = None if baseline is None else _baseline(baseline, ids)
    sources = found_sources(out, measured, talk)
    verdicts, judged_by = judged(sources, out, ids, talk)
    changes = {} if before is None else changed(before, verdicts)
    failed = tuple(failing(verdicts) if before is None else changes)
    data = as_data(verdicts, judged_by) | ({} if before is None else {"changed": changes})
    if ids:
        return Ledger(tuple(verdicts), failed, "\n\n".join(map(details_text, verdicts)), data)
    with replaced(out / FOLDER, FOLDER, command=FOLDER, force=force) as result:
        write_claims(verdicts, result.path, judged_by)
        _write_figures(sources, result)
        of = ensemble_of(sources.ensemble)
        result.manifest = _manifest() | ({"ensemble": of} if of else {})
    data["files"] = [str(out / FOLDER / name) for name in read_manifest(out / FOLDER)["outputs"]]
    parts = [table_text(verdicts, every=every), f"The ledger is in {out / FOLDER}"]
    if before is not None:
        parts.insert(1, changes_text(changes))
    return Ledger(tuple(verdicts), failed, "\n\n".join(parts), data)


def ensemble_of(ensemble: StoredEnsemble | None) -> list[str | int] | None:
    """What a ledger's manifest says of the ensemble that it was judged from: identity and number of draws."""
    return None if ensemble is None else [ensemble.identity, ensemble.planned]


def _manifest() -> dict[str, Any]:
    """What vouches for a ledger; whatever lies under the results, it is the same command's."""
    head = {"schema_version": SCHEMA_VERSION, "tendonrepro_version": __version__, "command": FOLDER}
    created = datetime.now(UTC).isoformat(timespec="seconds")
    return head | {"created": created, "config": {"sha256": FOLDER}, "environment": environment()}


def _write_figures(sources: Sources, result: NewResult) -> None:
    """Draw what decides the claims over an ensemble, and the laws of a comparison."""
    if sources.ensemble is not None:
        rankings = _rankings(sources.ensemble)
        result.write(DECIDES, to_json(rankings))
        _draw(sources.ensemble, rankings, result.path / "figures")
    if sources.compare is not None:
        from tendonrepro.results.figures.catalogue import origin_of
        from tendonrepro.results.figures.style import save_figure
        from tendonrepro.verdicts.figures import draw_laws

        caption = (
            "Torque and estimation error over frequency, distribution of the error, error at a reversal."
        )
        drawn, origin = draw_laws(sources.compare), origin_of(sources.compare)
        save_figure(drawn, result.path / "figures", "laws", "laws", caption, origin)


def judged(
    sources: Sources, out: Path, ids: Sequence[str], talk: Talk
) -> tuple[list[Verdict], Mapping[str, Any]]:
    """Judge from what was found under `out`, and say which ensemble judged; see `run_claims`.

    Where there is none the shipped verdicts stand in.
    """
    present = [one.name for one in fields(sources) if getattr(sources, one.name) is not None]
    talk.detail(f"found {', '.join(present) or 'no results'} under {out}")
    readings = 0 if sources.ensemble is None else len(sources.ensemble.readings)
    with talk.bar("judging", readings) as progress:
        verdicts = judge_all(sources, only=ids, decided_by=bool(ids), progress=progress)
    if sources.ensemble is not None:
        return verdicts, local_origin(out / ENSEMBLE, sources.ensemble.identity, len(sources.ensemble.draws))
    ledger = shipped_ledger()
    return with_shipped(verdicts, ledger), ledger.ensemble


def found_sources(out: Path, measured: Path | None, talk: Talk) -> Sources:
    """Read what claims are judged from: results under a folder, and the measured file; see `run_claims`."""
    runs = {}
    for name in ("decouple", "compare"):
        if (out / name / TRACES).exists():
            stored = stored_traces(out / name)
            judged = [stored.runs[run] for run in CONTROLLERS if run in stored.runs]
            if fitted_under(stored):
                talk.note(f"{out / name / TRACES}: fitted to what the paper prints; judging without it")
            elif of_paper(stored) and all(of_paper(stored, run) for run in judged):
                runs[name] = stored
            else:
                talk.note(f"{out / name / TRACES}: not the paper's arm, joints and gains; judging without it")
    file = measured or (MEASURED if MEASURED.exists() else None)
    return Sources(
        **runs, ensemble=_ensemble(out / ENSEMBLE, talk), measured=read_measured(file) if file else None
    )


def _ensemble(folder: Path, talk: Talk) -> EnsembleData | None:
    """Results over the box; one that is unfinished or not of the paper counts as none, and is told of."""
    if not (folder / PLAN).exists():
        return None
    data = read_ensemble(folder)
    if not data.of_paper:
        talk.note(f"{folder}: not drawn around the paper's arm, gains and payload; judging without it")
        return None
    return data


def _baseline(path: Path, ids: Sequence[str]) -> dict[str, str]:
    """Verdicts of an earlier ledger, by id."""
    if ids:
        raise UsageError("a baseline is of the whole ledger, not of single claims", where="--baseline")
    try:
        found = json.loads(path.read_bytes())
        before = {str(entry["id"]): str(entry["verdict"]) for entry in found["claims"]}
    except OSError as error:
        raise DataMissingError(f"cannot be read: {error.strerror or error}", where=str(path)) from error
    except (ValueError, TypeError, LookupError, RecursionError):
        before = {}
    if not before or not {*before.values()} <= {*NAMES}:
        message = "is damaged or not the JSON of tendonrepro claims"
        raise DataMissingError(message, where=str(path), hint="write one with tendonrepro claims")
    return before


def _rankings(data: Ensemble) -> dict[str, Ranking]:
    """Which unknowns decide claims, and the ratio of Controllers 1 and 2 on each joint, by name."""
    paper, plants = published(), Plants(data, PRINTED)
    outcomes: dict[str, tuple[Array, NDArray[np.bool_]]] = {}
    for claim in TORNADOES:
        with suppress(DataMissingError):
            outcomes[claim] = outcome(plants, paper, paper.judgements[claim].rule, claim)
    ok, ratio = _ratio(data)
    for i, joint in enumerate(data.joints):
        outcomes[f"ratio_joint_{joint}"] = np.log(ratio[:, i]), ok
    found = {
        name: ranked(data.names, data.draws[kept], values[kept]) for name, (values, kept) in outcomes.items()
    }
    for name, (values, kept) in _numbers(data):
        floor = found.get(f"ratio_joint_{data.joints[0]}")
        found[name] = ranked(
            data.names, data.draws[kept], values[kept], None if floor is None else floor["noise_floor"]
        )
    return {name: ranking for name, ranking in found.items() if ranking is not None}


def _numbers(data: Ensemble) -> Iterator[tuple[str, tuple[Array, NDArray[np.bool_]]]]:
    """Yield the logarithm of every number of Tables 2 and 3, and of joint 3's error over joint 2's."""
    for run in (*CONTROLLERS, LOADS["with_load"]):
        ok = data.status(run, PRINTED) == STATUSES.index("ok")
        table = f"table2.{run}" if run in CONTROLLERS else "table3.with_load"
        for metric in ("mae", "rmse"):
            with np.errstate(divide="ignore", invalid="ignore"):
                errors = np.log(data.statistic(run, PRINTED, metric))
            for i, joint in enumerate(data.joints):
                yield f"{table}.{metric}.joint_{joint}", (errors[:, i], ok)
            if (run, metric) == (CONTROLLERS[0], "mae"):
                yield JOINTS, (errors[:, -1] - errors[:, 0], ok)


def _ratio(data: Ensemble) -> tuple[NDArray[np.bool_], Array]:
    """Plants on which Controllers 1 and 2 are ok, and the ratio of their MAE, (N, n)."""
    runs = ("controller_1", "controller_2")
    ok = np.logical_and.reduce([data.status(run, PRINTED) == STATUSES.index("ok") for run in runs])
    first, second = (data.statistic(run, PRINTED, "mae") for run in runs)
    return ok, np.divide(first, second, out=np.ones_like(first), where=second > 0.0)


def _draw(data: Ensemble, rankings: Mapping[str, Ranking], folder: Path) -> None:
    """Draw which unknowns decide, and the ratio against the unknowns that explain most of it."""
    from tendonrepro.results.figures.style import save_figure
    from tendonrepro.verdicts.figures import draw_influences, draw_ratio_against_unknowns, draw_tornado

    origin = f"Simulated, {len(data.draws)} plants of the box"
    numbers = {name: held for name, held in rankings.items() if name.startswith("table") or name == JOINTS}
    if numbers:
        caption = "Share of the variance of a number that an unknown explains, alone or with one other."
        save_figure(draw_influences(numbers), folder, "decides_numbers", "decides_numbers", caption, origin)
    for claim in [name for name in rankings if name in TORNADOES]:
        caption = f"Share of the variance of claim {claim} that each unknown explains alone."
        figure = draw_tornado(f"What decides claim {claim}", rankings[claim])
        save_figure(figure, folder, f"decides_{claim}", f"decides_{claim}", caption, origin)
    ok, ratio = _ratio(data)
    for i, joint in enumerate(data.joints):
        name = f"ratio_joint_{joint}"
        if name not in rankings:
            continue
        places = [data.names.index(row["name"]) for row in rankings[name]["rows"][:SHOWN]]
        names, chosen = [data.names[place] for place in places], data.draws[ok][:, places]
        low, high = chosen.min(axis=0), chosen.max(axis=0)
        # An unknown that spans more than a decade stands on a logarithmic axis.
        wide = ((low > 0.0) & (high > 10.0 * low)).tolist()
        label, line = f"MAE of Controller 1 / 2, joint {joint}", 1.0 + data.alpha[i]
        figure = draw_ratio_against_unknowns(names, chosen, ratio[ok, i], line, label, log=wide)
        caption = f"{label}, against the unknowns that explain most of it; dashed: 1 + alpha."
        save_figure(figure, folder, name, name, caption, origin)
