"""The commands around configurations: list, show, copy, check, schema."""

from pathlib import Path
from typing import Annotated

from tendonrepro.errors import UsageError
from tendonrepro.files import Json
from tendonrepro.studies.command import EXPLORE, command
from tendonrepro.studies.parameters import ARGUMENT, TALK, Changes, Telling, Word
from tendonrepro.studies.study import Answer, written

ABOUT = "Configurations: list, show, copy, check, schema."

Named = Annotated[
    str, Word(positional=True, help="Configuration file, - for standard input, or a shipped name.")
]


@command(EXPLORE, "tendonrepro config list", "config list")
def config_list(*, talk: Telling = TALK) -> Answer[list[str]]:
    """Names of the shipped configurations."""
    from tendonrepro.configuration.load import shipped_folder, shipped_names

    names = shipped_names()
    talk.detail(f"in {shipped_folder()}")
    return Answer({"schema_version": 1, "configs": names}, "\n".join(names), names)


@command(EXPLORE, "tendonrepro config show compare", "config show")
def config_show(config: Named, *, set: Changes = None) -> Answer[Json]:
    """A configuration as it is used: complete, changes applied."""
    from tendonrepro.configuration.any_kind import shown

    tree, text = shown(config, set or ())
    return Answer(tree, text.rstrip(), tree)


@command(EXPLORE, "tendonrepro config init --joints 2 --out mine/my_arm.yaml", "config init")
def config_init(
    name: Annotated[str | None, ARGUMENT] = None,
    *,
    joints: int | None = None,
    out: Path = Path(),
    talk: Telling = TALK,
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
    from tendonrepro.configuration.any_kind import init_config
    from tendonrepro.configuration.own_arm import init_arm

    if (name is None) == (joints is None):
        message = "either the name of a shipped configuration, or --joints"
        raise UsageError(message, where="config init", hint="tendonrepro config init --joints 2")
    paths = init_arm(joints, out) if joints is not None else init_config(str(name), out)
    return written(paths, paths, talk)


@command(EXPLORE, "tendonrepro config check my_experiment/compare.yaml", "config check")
def config_check(config: Named, *, set: Changes = None, talk: Telling = TALK) -> Answer[Json]:
    """Check a configuration, and list all its mistakes."""
    from tendonrepro.configuration.any_kind import checked
    from tendonrepro.configuration.ensemble import LoadedEnsemble
    from tendonrepro.configuration.load import LoadedConfig
    from tendonrepro.experiments.loops import all_loops
    from tendonrepro.studies.lifecycle import remarks

    read = checked(config, set or ())
    known: Json = {"schema_version": 1, "config": config, "kind": "manipulator"}
    if isinstance(read, LoadedEnsemble):
        known |= {"kind": "ensemble", "config_sha256": read.sha256}
    elif isinstance(read, LoadedConfig):
        for sentence in remarks(read):
            talk.note(sentence)
        runs = list(all_loops(read))
        known |= {"kind": read.config.experiment, "config_sha256": read.sha256, "runs": runs}
    return Answer(known, f"{config}: valid {known['kind']}", known)


@command(EXPLORE, "tendonrepro config schema > schema.json", "config schema")
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
