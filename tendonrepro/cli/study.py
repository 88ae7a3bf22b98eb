"""Commands beyond the paper's own runs: sweep, ensemble, identify, explain, claims."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import typer

from tendonrepro.cli.options import (
    Config,
    Controllers,
    DryRun,
    Force,
    Json,
    Out,
    Quiet,
    Seed,
    Set,
    Verbose,
    numbers,
    show,
)

study_app = typer.Typer(rich_markup_mode=None)


@study_app.command(epilog='Example: tendonrepro sweep --over "control.gains.alpha=[0,0],[0.1,0.2],[0.3,0.4]"')
def sweep(
    over: Annotated[
        list[str], typer.Option("--over", metavar="KEY=A,B,C", help="A key and its values; once or twice.")
    ],
    config: Config = None,
    out: Out = None,
    overrides: Set = None,
    seed: Seed = None,
    controllers: Controllers = None,
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """The comparison over values of one or two keys: table and figures."""
    from tendonrepro.console import Talk
    from tendonrepro.experiments.sweep.command import run_sweep
    from tendonrepro.experiments.sweep.report import sweep_text

    talk = Talk(quiet=quiet, verbose=verbose)
    chosen = numbers(controllers)
    found = run_sweep(config, over, overrides or (), seed, chosen, out, force, dry_run, talk)
    show(found if as_json else sweep_text(found), as_json=as_json, quiet=quiet)
    return 5 if found.get("diverged") else 0


@study_app.command(epilog="Example: tendonrepro ensemble --draws 1024 --jobs 4")
def ensemble(
    config: Config = None,
    draws: Annotated[int, typer.Option("--draws", help="Plants drawn, a power of two.")] = 1024,
    jobs: Annotated[int, typer.Option("--jobs", help="Processes; -1 is one for each processor.")] = -1,
    dask: Annotated[
        str | None, typer.Option("--dask", metavar="ADDRESS", help="Scheduler to send the work to.")
    ] = None,
    readings: Annotated[
        Literal["default", "all"], typer.Option("--readings", help="Alternatives and pairs, or all together.")
    ] = "default",
    yes: Annotated[bool, typer.Option("--yes", help="The cost of all readings has been seen.")] = False,
    out: Out = None,
    overrides: Set = None,
    seed: Seed = None,
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Many plausible plants under many readings: what the claims are judged over."""
    from tendonrepro.console import Talk
    from tendonrepro.ensemble.command import run_ensemble
    from tendonrepro.ensemble.report import ensemble_text

    talk, changes = Talk(quiet=quiet, verbose=verbose), overrides or ()
    found = run_ensemble(
        config, draws, jobs, out, changes, seed, force, dask, readings, dry_run, talk, yes=yes
    )
    show(found if as_json else ensemble_text(found), as_json=as_json, quiet=quiet)


@study_app.command(epilog="Example: tendonrepro identify --readings printed,weights=extrapolating")
def identify(
    config: Config = None,
    fit: Annotated[
        Literal["controller_2", "all"],
        typer.Option("--fit", help="Fit Controller 2 and judge the others, or fit all sixteen numbers."),
    ] = "controller_2",
    readings: Annotated[
        str, typer.Option("--readings", help="printed, default, or names with commas between.")
    ] = "printed",
    window: Annotated[
        Literal["whole", "late"], typer.Option("--window", help="Whole run, or after the first period.")
    ] = "whole",
    generations: Annotated[int, typer.Option("--generations", help="Of the search.")] = 120,
    population: Annotated[int, typer.Option("--population", help="Members of each search.")] = 48,
    seeds: Annotated[int, typer.Option("--seeds", help="Independent searches.")] = 3,
    out: Out = None,
    overrides: Set = None,
    seed: Seed = None,
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Plants and readings closest to the printed numbers; an interrupted search goes on."""
    from tendonrepro.console import Talk
    from tendonrepro.identify.command import run_identify
    from tendonrepro.identify.report import identify_text

    talk, changes = Talk(quiet=quiet, verbose=verbose), overrides or ()
    effort = generations, population, seeds
    found = run_identify(config, fit, readings, window, *effort, changes, seed, out, force, dry_run, talk)
    show(found if as_json else identify_text(found), as_json=as_json, quiet=quiet)


@study_app.command(epilog="Example: tendonrepro explain --set manipulator.actuator.output_delay=1")
def explain(
    config: Config = None,
    out: Out = None,
    overrides: Set = None,
    seed: Seed = None,
    controllers: Controllers = None,
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Stability margins and predicted error ratios of the sampled loop."""
    # Thousands of eigenvalues of small matrices: threads of the library would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tendonrepro.config.load import load_config
    from tendonrepro.console import Talk
    from tendonrepro.explain.command import run_explain

    chosen = numbers(controllers)
    loaded = load_config(config, "compare", overrides=overrides or (), seed=seed, controllers=chosen)
    found = run_explain(loaded, out, Talk(quiet=quiet, verbose=verbose), force=force, dry_run=dry_run)
    text = found.pop("text")
    show(found if as_json else text, as_json=as_json, quiet=quiet)


@study_app.command(epilog="Example: tendonrepro claims C2")
def claims(
    ids: Annotated[
        list[str] | None, typer.Argument(metavar="[ID]...", help="Claims to show with all their evidence.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Folder above the results.")] = Path("reports"),
    check: Annotated[
        bool, typer.Option("--check", help="Leave with exit code 3 where a verdict is against the print.")
    ] = False,
    baseline: Annotated[
        Path | None, typer.Option("--baseline", help="Earlier claims.json: only changes count for --check.")
    ] = None,
    measured: Annotated[
        Path | None,
        typer.Option("--measured", help="Measured trace file [default: data/measured.h5 if there is one]."),
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """The verdict on every printed number and claim."""
    from tendonrepro.claims.command import run_claims
    from tendonrepro.console import Talk

    found = run_claims(out, ids or (), baseline, Talk(quiet=quiet, verbose=verbose), measured)
    show(found.data if as_json else found.text, as_json=as_json, quiet=quiet)
    return 3 if check and found.failed else 0
