# ruff: noqa: I001 (the order is that of --help)
"""Every command as a function of Python, and what reads results; a new command is imported here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

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
from tendonrepro.monte_carlo.commands import ensemble
from tendonrepro.identification.commands import identify
from tendonrepro.evidence.commands import predict, recover
from tendonrepro.tuning.commands import tune
from tendonrepro.analysis.commands import explain
from tendonrepro.verdicts.commands import claims
from tendonrepro.reporting.commands import live, report
from tendonrepro.dataset.commands import fetch, ingest, inspect
from tendonrepro.validation.commands import validate
from tendonrepro.studies.command import COMMANDS

if TYPE_CHECKING:
    from tendonrepro.configuration.load import Config
    from tendonrepro.studies.parameters import Changes
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


PUBLIC = [name for name in __all__ if name != "COMMANDS"]
"""Names of the functions of ``import tendonrepro``."""


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
        stored = read_result(path)
        outcome = Outcome(stored.data, list(stored.tables.values()))
        return Result(stored.command, outcome, dict(stored.manifest), _folder=path)
    from tendonrepro.experiments.run import outcome_of

    file = read_traces(path)
    # A measured file has a mapping in place of a configuration.
    manifest = {"config": {"sha256": file.config_sha256}, **json.loads(file.manifest_json)}
    return Result(file.experiment, outcome_of(file), manifest)
