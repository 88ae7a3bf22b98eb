"""The command line: parse, call one function, print."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from tendonrepro import __version__
from tendonrepro.cli.data import data_app
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
    UserLaw,
    Verbose,
    detail,
    list_files,
    numbers,
    show,
)
from tendonrepro.cli.study import study_app
from tendonrepro.errors import TendonreproError

if TYPE_CHECKING:
    from tendonrepro.experiments.command import Order

EPILOG = (
    "Exit codes: 0 done, 1 error, 2 usage or configuration, 3 a verdict is against the print "
    "(claims --check), 4 data missing or not reachable, 5 a run diverged, 130 interrupted."
)

app = typer.Typer(
    help="Reproduce Yan et al., Actuators 2026, 15(5), 271: kinematic decoupling and α-TDE-NTSM control.",
    epilog=EPILOG,
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
config_app = typer.Typer(help="Configurations: list, show, copy, check, schema.", invoke_without_command=True)
app.add_typer(config_app, name="config")
app.add_typer(study_app)
app.add_typer(data_app)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(__version__)
        raise typer.Exit


def _print_citation(wanted: bool) -> None:
    if wanted:
        from tendonrepro.cli.citation import bibtex

        typer.echo(bibtex())
        raise typer.Exit


@config_app.callback()
def _config(context: typer.Context) -> None:
    _help_if_alone(context)


@app.callback()
def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    cite: Annotated[
        bool,
        typer.Option(
            "--cite", callback=_print_citation, is_eager=True, help="Print BibTeX of paper and software."
        ),
    ] = False,
) -> None:
    del version, cite
    _help_if_alone(context)


def _help_if_alone(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command(epilog="Example: tendonrepro compare --set control.gains.alpha=[0,0] --out reports/no_alpha")
def compare(
    config: Config = None,
    out: Out = None,
    overrides: Set = None,
    seed: Seed = None,
    controllers: Controllers = None,
    law: UserLaw = None,
    solver: Annotated[
        Literal["scipy", "compiled"],
        typer.Option("--solver", help="Reference, or that of ensembles."),
    ] = "scipy",
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Controllers 1 to 3 and the payload case: traces, Figures 13 to 16, Tables 2 and 3."""
    from tendonrepro.experiments.command import Order

    order = Order("compare", config, out, overrides or (), seed, numbers(controllers), law, force, solver)
    return _run([order], dry_run=dry_run, as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(
    epilog="Example: tendonrepro decouple --set manipulator.tendons.damping_factor=3 --out reports/damped"
)
def decouple(
    config: Config = None,
    out: Out = None,
    overrides: Set = None,
    seed: Seed = None,
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Joint angles calculated from motor angles: traces, Figures 6 and 9 to 12, Table 1."""
    from tendonrepro.experiments.command import Order

    order = Order("decouple", config, out, overrides or (), seed, force=force)
    return _run([order], dry_run=dry_run, as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(epilog="Example: tendonrepro reproduce --out reports")
def reproduce(
    config: Annotated[
        Path | None, typer.Option("--config", help="Folder with decouple.yaml and compare.yaml.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for both results.")] = Path("reports"),
    overrides: Set = None,
    seed: Seed = None,
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Both experiments: every figure and table of the paper's section 5."""
    from tendonrepro.experiments.command import both_orders

    orders = both_orders(config, out, overrides or (), seed, force=force)
    return _run(orders, dry_run=dry_run, as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(epilog="Example: tendonrepro figures 14 15")
def figures(
    numbers: Annotated[
        list[int] | None, typer.Argument(help="The paper's figure numbers [default: all].")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Results folder, or the folder above several.")] = Path(
        "reports"
    ),
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Draw figures again from stored traces."""
    from tendonrepro.experiments.command import redraw

    list_files(redraw(out, numbers), as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(epilog="Example: tendonrepro tables --out reports/compare")
def tables(
    out: Annotated[Path, typer.Option("--out", help="Results folder, or the folder above several.")] = Path(
        "reports"
    ),
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Write tables again from stored traces."""
    from tendonrepro.experiments.command import rewrite_tables

    list_files(rewrite_tables(out), as_json=as_json, quiet=quiet, verbose=verbose)


@app.command(epilog="Example: tendonrepro doctor --json")
def doctor(as_json: Json = False, quiet: Quiet = False, verbose: Verbose = False) -> int:
    """Environment, versions, and whether everything needed is there."""
    from tendonrepro.cli.doctor import all_well, examine, report_text

    found = examine()
    detail(f"{len(found['checks'])} checks", quiet, verbose)
    show(found if as_json else report_text(found), as_json=as_json, quiet=quiet)
    return 0 if all_well(found) else 1


@config_app.command("list", epilog="Example: tendonrepro config list")
def config_list(as_json: Json = False, quiet: Quiet = False, verbose: Verbose = False) -> None:
    """Names of the shipped configurations."""
    from tendonrepro.config.load import shipped_folder, shipped_names

    names = shipped_names()
    detail(f"in {shipped_folder()}", quiet, verbose)
    show(
        {"schema_version": 1, "configs": names} if as_json else "\n".join(names), as_json=as_json, quiet=quiet
    )


@config_app.command("show", epilog="Example: tendonrepro config show compare")
def config_show(
    config: Annotated[
        str, typer.Argument(help="Configuration file, - for standard input, or a shipped name.")
    ],
    overrides: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """A configuration as it is used: complete, changes applied."""
    from tendonrepro.config.kinds import shown

    tree, text = shown(config, overrides or ())
    detail(f"{config} is valid", quiet, verbose)
    show(tree if as_json else text.rstrip(), as_json=as_json, quiet=quiet)


@config_app.command("init", epilog="Example: tendonrepro config init compare --out my_experiment")
def config_init(
    name: Annotated[str, typer.Argument(help="A shipped configuration.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the copy.")] = Path(),
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Copy a shipped configuration, with its manipulator and schema, to be edited."""
    from tendonrepro.config.load import init_config

    list_files(init_config(name, out), as_json=as_json, quiet=quiet, verbose=verbose)


@config_app.command("check", epilog="Example: tendonrepro config check my_experiment/compare.yaml")
def config_check(
    config: Annotated[
        str, typer.Argument(help="Configuration file, - for standard input, or a shipped name.")
    ],
    overrides: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Check a configuration; all its mistakes are listed at once."""
    from tendonrepro.experiments.command import check

    found = check(config, overrides or ())
    detail(
        f"sha256 {found.get('config_sha256', 'of a manipulator is that of its experiment')}", quiet, verbose
    )
    show(found if as_json else f"{found['config']}: valid {found['kind']}", as_json=as_json, quiet=quiet)


@config_app.command("schema", epilog="Example: tendonrepro config schema > schema.json")
def config_schema(
    kind: Annotated[
        str | None, typer.Argument(help="compare, decouple, ensemble or manipulator [default: any].")
    ] = None,
    as_json: Json = True,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """JSON schema of configuration files, for editors."""
    from tendonrepro.config.kinds import json_schema

    detail(f"for {kind or 'any'} configuration", quiet, verbose)
    if not quiet:
        show(json_schema(kind), as_json=as_json, quiet=quiet)


def _run(orders: Sequence[Order], *, dry_run: bool, as_json: bool, quiet: bool, verbose: bool) -> int:
    """Carry out orders, print what they found, and return the exit code."""
    from tendonrepro.console import Talk
    from tendonrepro.experiments.command import diverged, plan, run_experiment
    from tendonrepro.experiments.report import results_text

    talk = Talk(quiet=quiet, verbose=verbose)
    # All orders are checked before the first is carried out.
    found = {order.experiment: plan(order) for order in orders}
    if not dry_run:
        found = {order.experiment: run_experiment(order, talk) for order in orders}
    if as_json:
        alone = next(iter(found.values()))
        show(alone if len(found) == 1 else {"schema_version": 1, **found}, as_json=True, quiet=False)
    else:
        show("\n\n".join(results_text(data) for data in found.values()), as_json=False, quiet=quiet)
    return 5 if any(diverged(data) for data in found.values()) else 0


def main() -> None:
    """Run the command line and leave with its exit code."""
    try:
        code = app(standalone_mode=False)
    except TendonreproError as error:
        code = _fail(error.exit_code, error.message, error.where, error.hint)
    except Exception as error:
        # Typer's own usage errors have no public base class, only this shape.
        if not hasattr(error, "format_message"):
            raise
        code = _fail(2, error.format_message(), None, "tendonrepro --help lists commands and options")
    # Typer turns an interrupt into this exit code and says nothing.
    sys.exit(_fail(130, "interrupted", None, None) if code == 130 else code or 0)


def _fail(code: int, message: str, where: str | None, hint: str | None) -> int:
    if "--json" in sys.argv:
        error = {"code": code, "message": message, "where": where, "hint": hint}
        typer.echo(json.dumps({"error": error}, ensure_ascii=False))
    else:
        head = f"{where}: {message}" if where else message
        typer.echo("\n".join(["error: " + head, *([hint] if hint else [])]), err=True)
    return code


if __name__ == "__main__":
    main()
