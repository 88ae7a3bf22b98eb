# ruff: noqa: F403, I001, PLC0414 (the order is that of --help)
"""Every command as a function of Python, and what reads results. A package with commands is named here."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tendonrepro.reporting.commands import *
from tendonrepro.experiments.commands import *
from tendonrepro.analysis.commands import *
from tendonrepro.monte_carlo.commands import *
from tendonrepro.verdicts.commands import *
from tendonrepro.identification.commands import *
from tendonrepro.dataset.commands import *
from tendonrepro.validation.commands import *
from tendonrepro.evidence.commands import *
from tendonrepro.tuning.commands import *
from tendonrepro.studies.command import COMMANDS as COMMANDS

if TYPE_CHECKING:
    from tendonrepro.configuration.load import Config
    from tendonrepro.studies.study import Changes
    from tendonrepro.studies.result import Result

PUBLIC = sorted({"config", "open"} | ({command.word for command in COMMANDS.values()} & globals().keys()))
"""Names of the functions of ``import tendonrepro``; commands of the shell alone are none of them."""

AT_THE_TOP = ("fetch", "ingest", "validate")
"""Commands of a group that work without its name, too."""

FORMER = {
    "inspect": "data inspect",
    "recover": "data recover",
    "animate": "result animate",
    "export": "result export",
    "diff": "result diff",
    "figures": "result redraw",
    "tables": "result redraw --no-figures",
    "doctor": "--version --verbose",
}
"""Commands by the words that called them before, which go with the next version."""


def config(source: str | Path | None = None, *, set: Changes = None) -> Config:
    """A checked, frozen configuration.

    Parameters
    ----------
    source
        A file or a shipped name [default: compare].
    set
        Changes of its values by their keys.

    Returns
    -------
    Config
        Its values have units and sources; ``.si`` is in SI units.

    Raises
    ------
    ConfigError
        If it cannot be used; the message has file and line.

    Examples
    --------
    ``tr.config("compare", set={"control.gains.lam": 6}).control.gains.lam.si``
    """
    from tendonrepro.configuration.load import load_config

    return load_config(source or "compare", None, overrides=set).config


def open(folder: str | Path) -> Result:
    """Read the stored result of any command, or a trace file; a measured one, too.

    Returns
    -------
    Result
        As the command gave it.

    Raises
    ------
    DataMissingError
        When there is none, or it is damaged.

    Examples
    --------
    ``tr.open("reports/compare")["controller_1"]["e"]``
    """
    from tendonrepro.results.store import numbers_in, read_manifest, table_files
    from tendonrepro.results.traces import TRACES, read_traces
    from tendonrepro.studies.result import Result

    path = Path(folder)
    if path.is_dir() and not (path / TRACES).exists():
        manifest = read_manifest(path)
        tables = [table.read_text("utf-8") for table in table_files(path, manifest, ".md")]
        command = str(manifest.get("command", ""))
        return Result(numbers_in(path, manifest), tables, manifest=manifest, command=command, folder=path)
    from tendonrepro.experiments.run import experiment_result

    file = read_traces(path)
    # A measured file has a mapping in place of a configuration.
    manifest = {"config": {"sha256": file.config_sha256}, **file.manifest}
    return experiment_result(file).stamped(file.experiment, manifest)
