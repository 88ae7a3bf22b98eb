"""The configurations that come with the package."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from tendonrepro.configuration.fields.strict_yaml import load, read_text
from tendonrepro.configuration.messages import did_you_mean
from tendonrepro.errors import UsageError
from tendonrepro.files import shipped, write_atomically

SCHEMA_FILE = "schema.json"
ARM = 3  # joints of the shipped arm


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
    texts = {path.name: read_text(path) for path in _with_named(source)}
    if joints is not None:
        if name == "ensemble" or not 1 <= joints <= ARM:
            message = f"cannot be {joints}: the shipped arm has {ARM} joints, and the ensemble moves 2 and 3"
            raise UsageError(message, where="--joints")
        texts = {file: _with_joints(text, joints) for file, text in texts.items()}
    texts[SCHEMA_FILE] = read_text(source.with_name(SCHEMA_FILE))
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


def _with_named(source: Path) -> list[Path]:
    """A file and those that it names, those that they name included."""
    tree = load(read_text(source), str(source)).tree
    named = [tree[key] for key in ("base", "manipulator") if isinstance(tree.get(key), str)]
    return [source, *(path for name in named for path in _with_named(source.with_name(name)))]


def _with_joints(text: str, joints: int) -> str:
    """Shorten all that has an entry per joint, or per moving joint, to the first joints; comments stay.

    As many joints move as did, at most all; they are the last ones, as always.
    """
    # A file without the key has the comparison as its base, where two joints move.
    named = len(load(text, "").tree.get("joints", (2, 3)))
    moving = list(range(joints + 1 - min(named, joints), joints + 1))
    root = yaml.compose(text, Loader=yaml.BaseLoader)
    cuts = _cuts(root, "", {ARM: joints, named: len(moving)}, moving)
    for start, end, new in sorted(cuts, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _cuts(node: Any, key: str, sizes: dict[int, int], moving: list[int]) -> Iterator[tuple[int, int, str]]:
    """Start and end of pieces of the text, and what replaces each; `sizes` has new lengths of lists."""
    if isinstance(node, yaml.MappingNode):
        for name, item in node.value:
            yield from _cuts(item, name.value, sizes, moving)
    elif key == "joints":
        yield node.start_mark.index, node.end_mark.index, str(moving)
    elif key == "turns":
        turns = [[int(joint.value) for joint in turn.value] for turn in node.value]
        left = [[joint for joint in turn if joint in moving] for turn in turns]
        yield node.start_mark.index, node.end_mark.index, str([turn for turn in left if turn])
    elif key == "value" and isinstance(node, yaml.SequenceNode):
        kept = node.value[: sizes.get(len(node.value))]
        yield kept[-1].end_mark.index, node.value[-1].end_mark.index, ""
        for row in kept:
            yield from _cuts(row, key, sizes, moving)
