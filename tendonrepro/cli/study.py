"""Commands beyond the paper's own runs: sweep, ensemble, identify, explain, statics, claims, report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from tendonrepro.cli.options import Terminal, command
from tendonrepro.configuration.request import Request

study_app = typer.Typer(rich_help_panel="Explore", rich_markup_mode=None)

NO_CONFIGURATION = ("config", "overrides", "seed", "controllers")
MeasuredFile = Annotated[
    Path | None,
    Option("--measured", help="Measured trace file [default: data/measured.h5 if there is one]."),
]


@command(study_app, 'tendonrepro sweep --over "control.gains.alpha=[0,0],[0.1,0.2],[0.3,0.4]"', without=())
def sweep(
    request: Request,
    terminal: Terminal,
    over: Annotated[
        list[str], Option("--over", metavar="KEY=A,B,C", help="A key and its values; once or twice.")
    ],
) -> int:
    """The comparison over values of one or two keys."""
    from tendonrepro.experiments.sweep.command import run_sweep

    found = run_sweep(request, over, terminal.talk)
    terminal.show(found, found["text"])
    return 5 if found.get("diverged") else 0


@command(study_app, "tendonrepro ensemble --draws 1024 --jobs 4")
def ensemble(
    request: Request,
    terminal: Terminal,
    draws: Annotated[
        int, Option("--draws", help="Plants drawn, a power of two; as shipped 256 at least.")
    ] = 1024,
    jobs: Annotated[int, Option("--jobs", help="Processes; -1 is one for each processor.")] = -1,
    dask: Annotated[
        str | None, Option("--dask", metavar="ADDRESS", help="Scheduler to send the work to.")
    ] = None,
    readings: Annotated[str, Option("--readings", help="default, or names with commas between.")] = "default",
) -> None:
    """Many plausible plants under many readings of the text."""
    from tendonrepro.monte_carlo.command import run_ensemble

    found = run_ensemble(request, terminal.talk, draws=draws, jobs=jobs, dask=dask, readings=readings)
    terminal.show(found, found["text"])


@command(study_app, "tendonrepro identify --readings printed,weights=extrapolating")
def identify(
    request: Request,
    terminal: Terminal,
    fit: Annotated[
        Literal["controller_2", "all"],
        Option("--fit", help="Fit Controller 2 and show the others, or fit all sixteen numbers."),
    ] = "controller_2",
    readings: Annotated[
        str, Option("--readings", help="printed, default, or names with commas between.")
    ] = "printed",
    window: Annotated[
        Literal["whole", "late"], Option("--window", help="Whole run, or after the first period.")
    ] = "whole",
    generations: Annotated[int, Option("--generations", help="Of each search.")] = 60,
    population: Annotated[int, Option("--population", help="Members of each seed.")] = 48,
    seeds: Annotated[int, Option("--seeds", help="Independent searches of a reading.")] = 3,
    jobs: Annotated[int, Option("--jobs", help="Processors; -1 is all.")] = -1,
) -> None:
    """Plants and readings closest to the printed numbers.

    An interrupted search goes on.
    """
    from tendonrepro.identification.command import run_identify

    found = run_identify(
        request,
        terminal.talk,
        fit=fit,
        readings=readings,
        window=window,
        generations=generations,
        population=population,
        seeds=seeds,
        jobs=jobs,
    )
    terminal.show(found, found.pop("text"))


@command(study_app, "tendonrepro predict --readings printed,Delta_unit=deg")
def predict(
    request: Request,
    terminal: Terminal,
    draws: Annotated[int, Option("--draws", help="Plants.")] = 256,
    readings: Annotated[
        str | None, Option("--readings", help="Names with commas between [default: nine main ones].")
    ] = None,
) -> None:
    """What experiments on a bench would give under each reading."""
    from tendonrepro.evidence.predict import READINGS, run_predict

    found = run_predict(request, terminal.talk, draws=draws, readings=readings or READINGS)
    terminal.show(found, found.pop("text"))


@command(study_app, "tendonrepro explain --set manipulator.actuator.output_delay=1", without=())
def explain(request: Request, terminal: Terminal) -> None:
    """Stability margins and error ratios of the sampled loop."""
    from tendonrepro.analysis.command import run_explain

    found = run_explain(request, terminal.talk)
    text = found.pop("text")
    terminal.show(found, text)


@command(study_app, "tendonrepro statics --set manipulator.tensioner.force=30")
def statics(request: Request, terminal: Terminal) -> None:
    """Tension of every tendon over the working half-plane."""
    from tendonrepro.experiments.statics.command import run_statics

    found = run_statics(request, terminal.talk)
    text = found.pop("text")
    terminal.show(found, text)


@command(
    study_app, "tendonrepro recover data/measured.h5", without=("config", "overrides", "seed", "controllers")
)
def recover(
    request: Request,
    terminal: Terminal,
    log: Annotated[Path, Argument(help="Trace file, or a results folder with one.")],
) -> None:
    """Which controller made a log, or why that cannot be told."""
    from tendonrepro.evidence.recover import run_recover

    found = run_recover(log, request, terminal.talk)
    text = found.pop("text")
    terminal.show(found, text)


@command(study_app, "tendonrepro claims C2")
def claims(
    terminal: Terminal,
    ids: Annotated[
        list[str] | None, Argument(metavar="[ID]...", help="Claims to show with all their evidence.")
    ] = None,
    out: Annotated[Path, Option("--out", help="Folder above the results.")] = Path("reports"),
    check: Annotated[
        bool, Option("--check", help="Leave with exit code 3 where a verdict is against the print.")
    ] = False,
    baseline: Annotated[
        Path | None, Option("--baseline", help="Earlier claims.json: only changes count for --check.")
    ] = None,
    measured: MeasuredFile = None,
    every: Annotated[bool, Option("--all", help="Show all verdicts, not the ten main ones alone.")] = False,
    force: Annotated[
        bool, Option("--force", help="Overwrite a ledger that was edited, or is another's.")
    ] = False,
) -> int:
    """The verdict on every printed number and claim."""
    from tendonrepro.verdicts.command import run_claims

    found = run_claims(out, ids or (), baseline, terminal.talk, measured, every=every, force=force)
    terminal.show(found.data, found.text)
    return 3 if check and found.failed else 0


@command(study_app, "tendonrepro report --out review.html")
def report(
    terminal: Terminal,
    results: Annotated[Path, Argument(help="Folder above the results.")] = Path("reports"),
    out: Annotated[
        Path | None, Option("--out", help="HTML file to write [default: report.html in that folder].")
    ] = None,
    force: Annotated[bool, Option("--force", help="Overwrite a file that is no report.")] = False,
) -> None:
    """One HTML file for a reviewer, of all that was run."""
    from tendonrepro.reporting.command import report_text, run_report

    found = run_report(results, out, terminal.talk, force=force)
    terminal.show(found, report_text)
