"""The commands around the paper's experiments: what each asks for, and what it does."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, Unpack

from tendonrepro.files import Json
from tendonrepro.studies.command import EXPLORE, REPRODUCE, command, study
from tendonrepro.studies.parameters import (
    ARGUMENT,
    TALK,
    Changes,
    ConfigOption,
    Controllers,
    Folder,
    Formats,
    Laws,
    Overwrite,
    Seed,
    Telling,
    Traces,
    Word,
)
from tendonrepro.studies.study import Answer, Study, written

__all__ = ["animate", "compare", "decouple", "diff", "export", "figures", "statics", "sweep", "tables"]

Above: TypeAlias = Annotated[Path | str, Word(help="Results folder, or the one above several.")]
Again: TypeAlias = Annotated[bool, Word(help="Overwrite files changed since, or your own.")]


@study(REPRODUCE, 'tendonrepro compare --set "control.gains.alpha=[0, 0]" --out reports/no_alpha')
def compare(
    config: ConfigOption = None,
    *,
    set: Changes = None,
    seed: Seed = None,
    controllers: Controllers = None,
    laws: Laws = None,
    solver: Literal["scipy", "compiled"] = "scipy",
    **folder: Unpack[Folder],
) -> Study:
    """Controllers 1 to 3, payload: Figures 13 to 16, Tables 2 and 3.

    Parameters
    ----------
    laws
        Run your own controller too; repeatable. FILE is executed.
    solver
        SciPy, or the one of ensembles.
    """
    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.paper import experiment_study
    from tendonrepro.experiments.run import prepared
    from tendonrepro.experiments.user_law import laws_of

    loaded = load_config(config, "compare", overrides=set, seed=seed, controllers=controllers)
    return experiment_study(prepared(loaded, laws_of(laws), solver), folder)


@study(REPRODUCE, "tendonrepro decouple --set manipulator.tendons.damping_factor=3 --out reports/damped")
def decouple(
    config: ConfigOption = None, *, set: Changes = None, seed: Seed = None, **folder: Unpack[Folder]
) -> Study:
    """Joint angles from motor angles: Figures 6 and 9 to 12, Table 1."""
    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.paper import experiment_study
    from tendonrepro.experiments.run import prepared

    return experiment_study(prepared(load_config(config, "decouple", overrides=set, seed=seed)), folder)


@command(REPRODUCE, "tendonrepro figures 14 15")
def figures(
    out: Above = Path("reports"),
    names: Annotated[Sequence[str], ARGUMENT] = (),
    *,
    formats: Formats = None,
    force: Again = False,
    talk: Telling = TALK,
) -> Answer[list[Path]]:
    """Draw figures again from stored traces.

    Parameters
    ----------
    names
        The paper's numbers, or names [default: all].
    """
    from tendonrepro.experiments.again import redraw
    from tendonrepro.results.formats import formats_of

    paths = redraw(Path(out), names, force=force, formats=formats_of(formats))
    return written(paths, paths, talk)


@command(REPRODUCE, "tendonrepro tables --out reports/compare")
def tables(out: Above = Path("reports"), *, force: Again = False, talk: Telling = TALK) -> Answer[list[Path]]:
    """Write tables again from stored traces."""
    from tendonrepro.experiments.again import rewrite_tables

    paths = rewrite_tables(Path(out), force=force)
    return written(paths, paths, talk)


@command(REPRODUCE, "tendonrepro animate reports/decouple --speed 2")
def animate(
    file: Traces,
    out: Path | str | None = None,
    *,
    run: str | None = None,
    speed: float = 1.0,
    force: Overwrite = False,
    talk: Telling = TALK,
) -> Answer[list[str]]:
    """The arm in motion, its tendons coloured by tension.

    Parameters
    ----------
    out
        File to write [default: beside the traces].
    run
        Run to show [default: the first].
    speed
        Seconds of the run in a second of film.
    """
    from tendonrepro.results.figures.animation import animate as film

    made = film(Path(file), talk, run=run, speed=speed, out=None if out is None else Path(out), force=force)
    return Answer(made, "\n".join(made["files"]), list(made["files"]))


@command(REPRODUCE, "tendonrepro export reports/compare --format mat")
def export(
    file: Traces,
    form: Annotated[str, Word(option="--format")] = "csv",
    out: Path | str | None = None,
    *,
    force: Overwrite = False,
    talk: Telling = TALK,
) -> Answer[Path]:
    """Write stored traces for other programs.

    Parameters
    ----------
    form
        csv, parquet or mat.
    out
        File to write [default: beside it].
    """
    from tendonrepro.results.traces import export_traces

    path = export_traces(Path(file), form, None if out is None else Path(out), force=force)
    return written([path], path, talk)


@command(REPRODUCE, "tendonrepro diff reports/compare reports/extrapolating")
def diff(
    first: Annotated[Path | str, ARGUMENT],
    second: Annotated[Path | str, ARGUMENT],
    *,
    tolerance: float | None = None,
) -> Answer[Json]:
    """What differs between two results.

    Ends with exit code 1 if anything does.

    Parameters
    ----------
    first
        Results folder or trace file.
    second
        Another one.
    tolerance
        Numbers closer than this share of the larger are equal [default: 0; 1e-6 between versions or solvers].
    """
    from tendonrepro.results.difference import difference, difference_text

    rows = difference(Path(first), Path(second), tolerance)
    return Answer(rows, difference_text(rows), rows, exit_code=0 if rows["same"] else 1)


Over: TypeAlias = Annotated[Sequence[str] | Mapping[str, Sequence[object]], Word(metavar="KEY=A,B,C")]


@study(EXPLORE, 'tendonrepro sweep --over "control.gains.alpha=[0,0],[0.1,0.2],[0.3,0.4]"')
def sweep(
    over: Over,
    config: ConfigOption = None,
    *,
    set: Changes = None,
    seed: Seed = None,
    controllers: Controllers = None,
    **folder: Unpack[Folder],
) -> Study:
    """The comparison over values of one or two keys.

    Parameters
    ----------
    over
        A key and its values; once or twice.
    """
    from tendonrepro.experiments.sweep import load_grid, simulate
    from tendonrepro.experiments.sweep_report import sweep_outcome

    grid = load_grid(over, config, overrides=set, seed=seed, controllers=controllers)
    return Study(grid.base, lambda site: sweep_outcome(simulate(grid, site.talk)), folder)


@study(EXPLORE, "tendonrepro statics --set manipulator.tensioner.force=30")
def statics(
    config: ConfigOption = None, *, set: Changes = None, seed: Seed = None, **folder: Unpack[Folder]
) -> Study:
    """Tension of every tendon over the working half-plane.

    The configuration may be of either experiment: its arm and posture alone matter.
    """
    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.statics import survey
    from tendonrepro.experiments.statics_report import statics_outcome

    loaded = load_config(config or "decouple", None, overrides=set, seed=seed)
    return Study(loaded, lambda _: statics_outcome(survey(loaded)), folder)
