"""Commands beyond the paper's own runs, and those around its data set."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import typer

from tendonrepro.cli.options import Terminal, command, options_of
from tendonrepro.configuration.request import Request, formats_of

study_app = typer.Typer(rich_help_panel="Explore", rich_markup_mode=None)
data_app = typer.Typer(rich_help_panel="Your data, or the paper's", rich_markup_mode=None)


@command(study_app, "tendonrepro ensemble --draws 1024 --jobs 4")
def ensemble(
    request: Request,
    terminal: Terminal,
    *,
    draws: int = 1024,
    jobs: int = -1,
    dask: str | None = None,
    readings: str = "default",
) -> None:
    """Many plausible plants under many interpretations of the paper.

    Parameters
    ----------
    draws
        Plants, a power of two; as shipped 256 at least.
    dask : ADDRESS
        Scheduler to send the work to.
    readings
        default, or comma-separated names.
    """
    from tendonrepro.monte_carlo.command import run_ensemble

    terminal.show(run_ensemble(request, terminal.talk, draws=draws, jobs=jobs, dask=dask, readings=readings))


@command(study_app, "tendonrepro identify --readings printed,weights=extrapolating")
def identify(
    request: Request,
    terminal: Terminal,
    *,
    fit: Literal["controller_2", "all"] = "controller_2",
    readings: str = "printed",
    window: Literal["whole", "late"] = "whole",
    generations: int = 60,
    population: int = 48,
    seeds: int = 3,
    unknowns: int = 10,
    rows: str = "",
    jobs: int = -1,
) -> None:
    """Plants and interpretations closest to the published numbers.

    An interrupted search goes on.

    Parameters
    ----------
    fit
        Fit Controller 2 alone, or all sixteen numbers.
    readings
        printed, default, or comma-separated names.
    window
        Whole run, or after the first period.
    generations
        Of each search.
    population
        Members of a generation.
    seeds
        Searches of each interpretation.
    unknowns
        Parameters that are searched at most.
    rows
        Names of the parameters to search instead, comma-separated.
    """
    options = options_of(locals())
    from tendonrepro.identification.command import run_identify

    terminal.show(run_identify(request, terminal.talk, **options))


@command(study_app, "tendonrepro claims C2")
def claims(
    terminal: Terminal,
    ids: list[str] | None = None,
    *,
    out: Path = Path("reports"),
    check: bool = False,
    baseline: Path | None = None,
    measured: Path | None = None,
    all: bool = False,
    formats: str | None = None,
    no_figures: bool = False,
    force: bool = False,
) -> int:
    """The verdict on every published number and claim.

    Parameters
    ----------
    ids : [ID]...
        Claims to show with all their evidence.
    out
        Folder above the results.
    check
        Exit with 3 where a verdict is against the paper.
    baseline
        Earlier claims.json: only changes count for --check.
    measured
        Measured trace file [default: data/measured.h5 if there is one].
    all
        Show all verdicts, not only the ten main ones.
    force
        Overwrite edited verdicts, or those of others.
    """
    from tendonrepro.verdicts.command import run_claims

    kinds = formats_of(formats, figures=not no_figures)
    found = run_claims(
        out, ids or (), baseline, terminal.talk, measured, every=all, force=force, formats=kinds
    )
    terminal.show(found.data, found.text)
    return 3 if check and found.failed else 0
