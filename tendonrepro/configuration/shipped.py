"""The configurations that come with the package."""

from __future__ import annotations

from pathlib import Path

from tendonrepro.configuration.fewer_joints import with_joints
from tendonrepro.configuration.fields.strict_yaml import load, read_text
from tendonrepro.configuration.messages import did_you_mean
from tendonrepro.errors import UsageError
from tendonrepro.files import shipped, write_atomically

SCHEMA_FILE = "schema.json"


def shipped_folder() -> Path:
    """Folder of the shipped configurations."""
    return shipped("configs")


def shipped_names() -> list[str]:
    """Names of the shipped experiments and manipulators, in alphabetical order."""
    return sorted(path.stem for path in shipped_folder().glob("*.yaml"))


def shipped_file(name: str) -> Path:
    """Path of a shipped configuration; a UsageError names what there is."""
    names = shipped_names()
    if name not in names:
        message = f"no shipped configuration {name!r}{did_you_mean(name, names)}"
        raise UsageError(message, hint=f"There are: {', '.join(names)}")
    return shipped_folder() / f"{name}.yaml"


def init_config(name: str, folder: Path, joints: int | None = None) -> list[Path]:
    """Copy a shipped configuration, its manipulator and the JSON schema, to be edited.

    A companion file that is already there with the same content is left alone, so that both experiments
    can share a folder. With `joints` the copies are for an arm of the first so many joints.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    UsageError
        When the name is unknown, a file would be overwritten, or the arm has not so many joints.
    """
    source = shipped_file(name)
    companions = [source.with_name(SCHEMA_FILE), *_named(source)]
    texts = {path.name: read_text(path) for path in [source, *companions]}
    if joints is not None:
        if name == "ensemble":
            raise UsageError("the ensemble's box is for joints 2 and 3", where="--joints")
        texts |= {file: with_joints(text, joints) for file, text in texts.items() if file != SCHEMA_FILE}
    new = []
    for file, text in texts.items():
        target = folder / file
        same = target.is_file() and target.read_bytes() == text.encode()
        if target.exists() and (file == source.name or not same):
            hint = "Give another folder, or move the file away."
            raise UsageError(f"{target} exists and is not overwritten", hint=hint)
        new += [] if same else [target]
    for target in new:
        write_atomically(target, texts[target.name])
    return new


def _named(source: Path) -> list[Path]:
    """Files that a configuration names, those that they name included."""
    tree = load(read_text(source), str(source)).tree
    keys = [tree.get(key) for key in ("base", "manipulator")] if isinstance(tree, dict) else []
    files = [source.with_name(file) for file in keys if isinstance(file, str)]
    return [path for file in files for path in (file, *_named(file))]
