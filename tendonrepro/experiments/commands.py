"""The commands around the paper's experiments, results and configurations: what each asks for, and does."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, Unpack

from tendonrepro.errors import UsageError
from tendonrepro.files import Json
from tendonrepro.studies.command import CONFIG, ONE_ARM, RESULT, Example, command, study
from tendonrepro.studies.study import (
    ARGUMENT,
    TALK,
    Answer,
    Changes,
    ConfigOption,
    Controllers,
    Drawn,
    Folder,
    Formats,
    Laws,
    Overwrite,
    Seed,
    Study,
    Telling,
    Traces,
    Word,
    written,
)

__all__ = ["animate", "compare", "decouple", "diff", "export", "redraw", "statics", "sweep"]

Above: TypeAlias = Annotated[Path | str, Word(help="Results folder, or the one above several.")]
Again: TypeAlias = Annotated[bool, Word(help="Overwrite files changed since, or your own.")]


@study(ONE_ARM, Example(set={"control.gains.alpha": [0, 0]}, out="reports/no_alpha"))
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
        Run your own controller too; its file is executed.
    solver
        SciPy, or the one of ensembles.
    """
    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.run import experiment_study, prepared
    from tendonrepro.experiments.user_law import laws_of

    loaded = load_config(config, "compare", overrides=set, seed=seed, controllers=controllers)
    return experiment_study(prepared(loaded, laws_of(laws), solver), folder)


@study(ONE_ARM, Example(set={"manipulator.tendons.damping_factor": 3}, out="reports/damped"))
def decouple(
    config: ConfigOption = None, *, set: Changes = None, seed: Seed = None, **folder: Unpack[Folder]
) -> Study:
    """Joint angles from motor angles: Figures 6 and 9 to 12, Table 1."""
    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.run import experiment_study, prepared

    return experiment_study(prepared(load_config(config, "decouple", overrides=set, seed=seed)), folder)


@study(ONE_ARM, Example(set={"manipulator.tensioner.force": 30}))
def statics(
    config: ConfigOption = None, *, set: Changes = None, seed: Seed = None, **folder: Unpack[Folder]
) -> Study:
    """Tension of every tendon over the working half-plane.

    The configuration may be of either experiment: its arm and posture alone matter.
    """
    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.report import statics_result
    from tendonrepro.experiments.statics import survey

    loaded = load_config(config or "decouple", None, overrides=set, seed=seed)
    return Study(loaded, lambda _: statics_result(survey(loaded)), folder)


Over: TypeAlias = Annotated[Sequence[str] | Mapping[str, Sequence[object]], Word(metavar="KEY=A,B,C")]


@study(ONE_ARM, Example({"control.gains.alpha": [[0, 0], [0.1, 0.2], [0.3, 0.4]]}))
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
        One or two keys, each with its values.
    """
    from tendonrepro.experiments.report import sweep_result
    from tendonrepro.experiments.sweep import load_grid, simulate

    grid = load_grid(over, config, overrides=set, seed=seed, controllers=controllers)
    return Study(grid.base, lambda site: sweep_result(simulate(grid, site.talk)), folder)


@command(RESULT, Example(names=["14", "15"]))
def redraw(
    out: Above = Path("reports"),
    names: Annotated[Sequence[str], ARGUMENT] = (),
    *,
    formats: Formats = None,
    figures: Drawn = True,
    force: Again = False,
) -> Answer[list[Path]]:
    """Draw figures and write tables again, from stored traces.

    Parameters
    ----------
    names
        Figures alone, by name or the paper's number [default: all, and the tables].

    Returns
    -------
    list of Path
        Figures and tables.
    """
    from tendonrepro.experiments import run
    from tendonrepro.results.figures import formats_of

    kinds = formats_of(formats, figures=figures)
    paths = run.redraw(Path(out), names, formats=kinds, force=force)
    return written(paths, paths)


@command(RESULT, Example("reports/decouple", speed=2))
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

    Returns
    -------
    list of str
        Films.
    """
    from tendonrepro.results.figures.arm import animate as film

    made = film(Path(file), talk, run=run, speed=speed, out=None if out is None else Path(out), force=force)
    return Answer(made, "\n".join(made["files"]), list(made["files"]))


@command(RESULT, Example("reports/compare", "mat"))
def export(
    file: Traces,
    form: Annotated[Literal["csv", "parquet", "mat"], Word(option="--format")] = "csv",
    out: Path | str | None = None,
    *,
    force: Overwrite = False,
) -> Answer[Path]:
    """Write stored traces for other programs.

    Parameters
    ----------
    form
        csv, parquet or mat.
    out
        File to write [default: beside it].

    Returns
    -------
    Path
        The file.
    """
    from tendonrepro.results.traces import export_traces

    path = export_traces(Path(file), form, None if out is None else Path(out), force=force)
    return written([path], path)


@command(RESULT, Example("reports/compare", "reports/extrapolating"))
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

    Returns
    -------
    dict
        What differs; ``same`` says whether anything does.
    """
    from tendonrepro.results.difference import difference, difference_text

    rows = difference(Path(first), Path(second), tolerance)
    return Answer(rows, difference_text(rows), rows, exit_code=0 if rows["same"] else 1)


Named: TypeAlias = Annotated[
    str, Word(positional=True, help="Configuration file, - for standard input, or a shipped name.")
]


@command(CONFIG, Example())
def config_list() -> Answer[list[str]]:
    """Names of the shipped configurations."""
    from tendonrepro.configuration.load import shipped_names

    names = shipped_names()
    return Answer({"schema_version": 1, "configs": names}, "\n".join(names), names)


@command(CONFIG, Example("compare"))
def config_show(config: Named, *, set: Changes = None) -> Answer[Json]:
    """A configuration as it is used: complete, changes applied."""
    from tendonrepro.configuration.any_kind import checked
    from tendonrepro.configuration.strict_yaml import dump

    tree = checked(config, set or ()).tree
    return Answer(tree, dump(tree).rstrip(), tree)


@command(CONFIG, Example(joints=2, out="mine/my_arm.yaml"))
def config_init(
    name: Annotated[str | None, ARGUMENT] = None,
    *,
    joints: int | None = None,
    out: Path = Path(),
) -> Answer[list[Path]]:
    """Begin an arm of your own, or copy a shipped configuration.

    Parameters
    ----------
    name
        A shipped configuration; what it names is copied too.
    joints
        Write an arm with so many joints, compare.yaml and decouple.yaml.
    out
        Folder, or the file to write, with the others beside it.
    """
    from tendonrepro.configuration.any_kind import init_arm, init_config

    if (name is None) == (joints is None):
        message = "either the name of a shipped configuration, or --joints"
        raise UsageError(message, where="config init", hint="tendonrepro config init --joints 2")
    paths = init_arm(joints, out) if joints is not None else init_config(str(name), out)
    return written(paths, paths)


@command(CONFIG, Example("my_experiment/compare.yaml"))
def config_check(config: Named, *, set: Changes = None, talk: Telling = TALK) -> Answer[Json]:
    """Check a configuration, and list all its mistakes."""
    from tendonrepro.configuration.any_kind import checked
    from tendonrepro.configuration.ensemble import LoadedEnsemble
    from tendonrepro.configuration.load import LoadedConfig
    from tendonrepro.experiments.loops import all_loops

    read = checked(config, set or ())
    known: Json = {"schema_version": 1, "config": config, "kind": "manipulator"}
    if isinstance(read, LoadedEnsemble):
        known |= {"kind": "ensemble", "config_sha256": read.sha256}
    elif isinstance(read, LoadedConfig):
        runs = list(all_loops(read))
        known |= {"kind": read.config.experiment, "config_sha256": read.sha256, "runs": runs}
    known["remarks"] = [*read.remarks]
    for sentence in known["remarks"]:
        talk.note(sentence)
    return Answer(known, f"{config}: valid {known['kind']}", known)


@command(CONFIG, Example("compare"))
def config_schema(kind: Annotated[str | None, ARGUMENT] = None) -> Answer[Json]:
    """JSON schema of configuration files, for editors.

    Parameters
    ----------
    kind
        compare, decouple, ensemble or manipulator [default: any].
    """
    from tendonrepro.configuration.any_kind import json_schema
    from tendonrepro.files import to_json

    schema = json_schema(kind)
    return Answer(schema, to_json(schema).rstrip(), schema)
