# ruff: noqa: I001 (the order is that of --help)
"""Every command as a function of Python; a new one is imported here."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from tendonrepro.configuration.request import Request, formats_of
from tendonrepro.console import Talk
from tendonrepro.reporting.reproduction import reproduce
from tendonrepro.experiments.commands import (
    animate,
    compare,
    decouple,
    diff,
    export,
    figures,
    statics,
    sweep,
    tables,
)
from tendonrepro.experiments import configurations, doctor  # noqa: F401 (of the shell alone)
from tendonrepro.evidence.commands import predict, recover
from tendonrepro.tuning.commands import tune
from tendonrepro.analysis.commands import explain
from tendonrepro.reporting.commands import live, report
from tendonrepro.dataset.commands import fetch, ingest, inspect
from tendonrepro.validation.commands import validate
from tendonrepro.studies.command import COMMANDS

if TYPE_CHECKING:
    from tendonrepro.configuration.load import Config, LoadedConfig
    from tendonrepro.studies.outcome import Outcome
    from tendonrepro.studies.result import Result

__all__ = [
    "COMMANDS",
    "animate",
    "claims",
    "compare",
    "config",
    "decouple",
    "diff",
    "ensemble",
    "explain",
    "export",
    "fetch",
    "figures",
    "identify",
    "ingest",
    "inspect",
    "live",
    "open",
    "predict",
    "recover",
    "report",
    "reproduce",
    "statics",
    "sweep",
    "tables",
    "tune",
    "validate",
]

Changes: TypeAlias = Mapping[str, Any] | None
Formats: TypeAlias = str | Sequence[str] | None


def _path(given: str | Path | None) -> Path | None:
    return None if given is None else Path(given)


def _request(given: dict[str, Any]) -> Request:
    """What many functions share, out of the arguments of one."""
    source = given.pop("config", None)
    return Request(
        None if source is None else str(source),
        _path(given.pop("out", None)),
        given.pop("set", None) or {},
        given.pop("seed", None),
        given.pop("controllers", None),
        force=given.pop("force", False),
        formats=formats_of(given.pop("formats", None), figures=given.pop("figures", True)),
    )


def _written(command: str, run: Callable[..., dict[str, Any]], given: dict[str, Any]) -> Result:
    """Result of a command that writes its own folder."""
    from tendonrepro.results.store import read_manifest
    from tendonrepro.studies.outcome import Outcome
    from tendonrepro.studies.result import Result

    found = run(request=_request(given), talk=Talk(), **given)
    text = found.pop("text")
    folder = Path(found["out"])
    return Result(command, Outcome(found, [text]), read_manifest(folder), _folder=folder)


def ensemble(
    draws: int = 1024,
    *,
    config: str | Path | None = None,
    set: Changes = None,
    seed: int | None = None,
    readings: str = "default",
    jobs: int = -1,
    out: str | Path = "reports/ensemble",
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Result:
    """Run many plausible plants under many readings of the text; an interrupted call goes on from `out`.

    Parameters
    ----------
    draws : int
        Plants, a power of two.
    config, set, seed
        As of `compare`; the configuration is that of an ensemble.
    readings : str
        ``default``, or comma-separated names.
    jobs : int
        Processes; -1 is one for each processor.
    formats : str or sequence of str, optional
        Of figures, ``png``, ``pdf`` or ``svg``; else all three.
    figures : bool
        Whether to draw any.
    force : bool
        Replace other results.
    """
    given = {**locals()}
    from tendonrepro.monte_carlo.command import run_ensemble

    return _written("ensemble", run_ensemble, given)


def identify(
    fit: Literal["controller_2", "all"] = "controller_2",
    *,
    config: str | Path | None = None,
    readings: str = "printed",
    generations: int = 60,
    population: int = 48,
    seeds: int = 3,
    unknowns: int = 10,
    rows: str = "",
    jobs: int = -1,
    out: str | Path = "reports/identify",
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Result:
    """Search plants and readings closest to the printed numbers; an interrupted call goes on.

    Parameters
    ----------
    fit : str
        ``controller_2``, or ``all`` sixteen numbers.
    generations, population, seeds : int
        Of each search, members of a generation, and searches of a reading.
    unknowns : int
        Parameters that are searched at most, those that move the fitted numbers most.
    rows : str
        Names of the parameters to search instead, comma-separated.
    config, readings, jobs, out, formats, figures, force
        As of `ensemble`.
    """
    given = {**locals()}
    from tendonrepro.identification.command import run_identify

    return _written("identify", run_identify, given)


def claims(*ids: str, out: str | Path = "reports", measured: str | Path | None = None) -> Result:
    """Judge the published claims, or those named, from results under `out`.

    Without an ensemble there the stored one stands in. Nothing is written.
    """
    from tendonrepro.configuration.load import load_config
    from tendonrepro.studies.outcome import Outcome
    from tendonrepro.verdicts.command import judged
    from tendonrepro.verdicts.report import as_data, details_text, table_text

    started = time.perf_counter()
    _, verdicts, judged_by = judged(Path(out), _path(measured), ids, Talk())
    text = "\n\n".join(map(details_text, verdicts)) if ids else table_text(verdicts, every=True)
    outcome = Outcome(as_data(verdicts, judged_by), [text])
    return _studied("claims", load_config(None, "compare"), outcome, started)


def config(source: str | Path | None = None, *, set: Changes = None) -> Config:
    """Return a checked, frozen configuration; `source` is a file or a shipped name."""
    from tendonrepro.configuration.load import load_config

    return load_config(source or "compare", None, overrides=set).config


def open(folder: str | Path) -> Result:
    """Read the stored result of any command, or a trace file; a measured one, too.

    Raises
    ------
    DataMissingError
        When there is none, or it is damaged.
    """
    from tendonrepro.results.on_disk import read_result
    from tendonrepro.results.traces import TRACES, read_traces
    from tendonrepro.studies.outcome import Outcome
    from tendonrepro.studies.result import Result

    path = Path(folder)
    if path.is_dir() and not (path / TRACES).exists():
        found = read_result(path)
        outcome = Outcome(found.data, list(found.tables.values()))
        return Result(found.command, outcome, dict(found.manifest), _folder=path)
    from tendonrepro.experiments.run import outcome_of

    file = read_traces(path)
    # A measured file has a mapping in place of a configuration.
    manifest = {"config": {"sha256": file.config_sha256}, **json.loads(file.manifest_json)}
    return Result(file.experiment, outcome_of(file), manifest, file)


def _studied(command: str, loaded: LoadedConfig, outcome: Outcome, started: float) -> Result:
    from tendonrepro.results.store import make_manifest
    from tendonrepro.studies.result import Result

    manifest = make_manifest(loaded, time.perf_counter() - started, command) | dict(outcome.manifest)
    return Result(command, outcome, manifest)
