"""Commands beyond the paper's own runs, and those around its data set."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import typer

from tendonrepro.cli.options import Terminal, command, options_of
from tendonrepro.configuration.request import Request, formats_of

study_app = typer.Typer(rich_help_panel="Explore", rich_markup_mode=None)
data_app = typer.Typer(rich_help_panel="Your data, or the paper's", rich_markup_mode=None)


@command(study_app, 'tendonrepro sweep --over "control.gains.alpha=[0,0],[0.1,0.2],[0.3,0.4]"', without=())
def sweep(request: Request, terminal: Terminal, *, over: list[str]) -> int:
    """The comparison over values of one or two keys.

    Parameters
    ----------
    over : KEY=A,B,C
        A key and its values; once or twice.
    """
    from tendonrepro.experiments.sweep import run_sweep

    return terminal.show(run_sweep(request, over, terminal.talk))


@command(study_app, "tendonrepro ensemble --draws 1024 --jobs 4")
def ensemble(
    request: Request,
    terminal: Terminal,
    *,
    draws: int = 1024,
    jobs: int = -1,
    dask: str | None = None,
    readings: str = "default",
    device: Literal["cpu", "gpu"] = "cpu",
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
    options = options_of(locals())
    from tendonrepro.monte_carlo.command import run_ensemble

    terminal.show(run_ensemble(request, terminal.talk, **options))


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
    device: Literal["cpu", "gpu"] = "cpu",
) -> None:
    """Plants and interpretations closest to the published numbers.

    An interrupted search goes on.

    Parameters
    ----------
    fit
        Fit Controller 2 alone, or all sixteen numbers.
    readings
        printed, default, shown (in findings), or comma-separated names.
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


@command(study_app, "tendonrepro predict --readings printed,Delta_unit=deg")
def predict(
    request: Request,
    terminal: Terminal,
    *,
    draws: int = 256,
    readings: str | None = None,
    device: Literal["cpu", "gpu"] = "cpu",
) -> None:
    """What experiments on a bench would give, by interpretation.

    Parameters
    ----------
    draws
        Plants.
    readings
        Comma-separated names [default: fourteen main ones].
    """
    from tendonrepro.evidence.predict import READINGS, run_predict

    found = run_predict(request, terminal.talk, draws=draws, readings=readings or READINGS, device=device)
    terminal.show(found)


@command(study_app, "tendonrepro tune --plants 24")
def tune(
    request: Request,
    terminal: Terminal,
    *,
    plants: int = 16,
    searches: int = 4,
    generations: int = 4,
    population: int = 6,
    law: list[str] | None = None,
    any_plant: bool = False,
    jobs: int = -1,
    device: Literal["cpu", "gpu"] = "cpu",
) -> None:
    """Controllers at their best: each one tuned, then compared.

    An interrupted tuning goes on.

    Parameters
    ----------
    plants
        Plants to tune on.
    searches
        Of each law on each plant.
    generations
        Of each search.
    population
        Members of a generation.
    law : FILE:NAME
        Tune your own controller too; repeatable. FILE is executed.
    any_plant
        Also plants where the published gains are unstable.
    """
    options = options_of(locals(), "law")
    from tendonrepro.tuning.command import run_tune

    terminal.show(run_tune(request, terminal.talk, laws=law or (), **options))


@command(study_app, "tendonrepro explain --set manipulator.actuator.output_delay=1", without=())
def explain(request: Request, terminal: Terminal) -> None:
    """Stability margins and error ratios of the sampled loop."""
    from tendonrepro.analysis.command import run_explain

    terminal.show(run_explain(request, terminal.talk))


@command(study_app, "tendonrepro statics --set manipulator.tensioner.force=30")
def statics(request: Request, terminal: Terminal) -> None:
    """Tension of every tendon over the working half-plane."""
    from tendonrepro.experiments.statics import run_statics

    terminal.show(run_statics(request, terminal.talk))


@command(
    study_app,
    "tendonrepro recover data/measured.h5",
    without=("config", "overrides", "seed", "controllers", "formats", "no_figures"),
)
def recover(request: Request, terminal: Terminal, log: Path) -> None:
    """Which controller made a log, or why that cannot be told.

    Parameters
    ----------
    log
        Trace file, or results folder with one.
    """
    from tendonrepro.evidence.recover import run_recover

    terminal.show(run_recover(log, request, terminal.talk))


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


@command(study_app, "tendonrepro report --out review.html")
def report(
    terminal: Terminal, results: Path = Path("reports"), *, out: Path | None = None, force: bool = False
) -> None:
    """One HTML file for a reviewer, of all that was run.

    Parameters
    ----------
    results
        Folder above the results, or a result.
    out
        HTML file to write [default: report.html in that folder, or NAME.html beside a result].
    force
        Overwrite a file that is no report.
    """
    from tendonrepro.reporting.command import report_text, run_report

    found = run_report(results, out, force=force)
    terminal.show(found, report_text(found))


@command(study_app, "tendonrepro live --config mine.yaml --out mine.html")
def live(
    terminal: Terminal,
    *,
    config: str | None = None,
    set: list[str] | None = None,
    out: Path = Path("live.html"),
    force: bool = False,
) -> None:
    """One HTML file that runs the experiment in a browser.

    It needs no network. A configuration of your own becomes one of its presets.

    Parameters
    ----------
    out
        HTML file to write.
    force
        Overwrite a file that is no such page.
    """
    from tendonrepro.reporting.live.command import live_text, run_live

    found = run_live(Request(config=config, overrides=set or (), out=out, force=force))
    terminal.show(found, live_text(found))


@command(data_app, "tendonrepro fetch --out data/zenodo")
def fetch(
    terminal: Terminal,
    record: str = "19467931",
    *,
    out: Path = Path("data/zenodo"),
    base_url: str | None = None,
    dry_run: bool = False,
    force: bool = False,
) -> None:
    """Download the paper's data set and verify it.

    A second run needs no network.

    Parameters
    ----------
    record
        Number, DOI or address of the record.
    out
        Folder for the files.
    base_url
        Another server [default: $TENDONREPRO_ZENODO_URL, else Zenodo].
    dry_run
        List the record, download nothing.
    force
        Replace altered files, or another record's.
    """
    from tendonrepro.dataset.fetch import fetch_text, run_fetch

    found = run_fetch(record, out, base_url, force, dry_run, terminal.talk)
    terminal.show(found, fetch_text(found))


@command(data_app, "tendonrepro inspect data/zenodo --suggest")
def inspect(
    terminal: Terminal,
    paths: list[Path],
    *,
    suggest: bool = False,
    mapping: Path = Path("data/mapping.yaml"),
    force: bool = False,
) -> None:
    """What is in files of any format, and what it seems to mean.

    Parameters
    ----------
    paths
        Files, folders or archives.
    suggest
        Write a mapping file to edit.
    force
        Overwrite the mapping file.
    """
    from tendonrepro.dataset.command import inspect_text, run_inspect

    found = run_inspect(paths, mapping if suggest else None, force=force)
    terminal.show(found, inspect_text(found))


@command(data_app, "tendonrepro ingest data/zenodo --mapping data/mapping.yaml")
def ingest(
    terminal: Terminal,
    paths: list[Path],
    *,
    mapping: Path = Path("data/mapping.yaml"),
    out: Path = Path("data/measured.h5"),
    confirm: bool = False,
    dry_run: bool = False,
    force: bool = False,
) -> None:
    """Convert measured data to the layout of simulated traces.

    Parameters
    ----------
    paths
        Files, folders or archives.
    out
        Trace file to write.
    confirm
        The mapping is right: delete every CHECK in it.
    dry_run
        Check everything, write nothing.
    """
    from tendonrepro.dataset.command import ingest_text, run_ingest

    found = run_ingest(paths, mapping, out, force=force, dry_run=dry_run, talk=terminal.talk, confirm=confirm)
    terminal.show(found, ingest_text(found))


@command(data_app, "tendonrepro validate data/measured.h5")
def validate(request: Request, terminal: Terminal, measured: Path = Path("data/measured.h5")) -> int:
    """Compare measured data with the paper and with the model.

    Parameters
    ----------
    measured
        Trace file written by ingest.
    """
    from tendonrepro.validation.command import run_validate

    return terminal.show(run_validate(measured, request, terminal.talk))
